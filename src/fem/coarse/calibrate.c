#include "fem/coarse/calibrate.h"

#include "fem/linear/dense.h"

#include <math.h>
#include <string.h>

/* out (rows x columns) = a (rows x inner) b (inner x columns) */
static void multiply(int rows, int inner, int columns, const double *a, const double *b, double *out)
{
    for (int i = 0; i < rows; i++)
        for (int j = 0; j < columns; j++) {
            double sum = 0;
            for (int k = 0; k < inner; k++) sum += a[i * inner + k] * b[k * columns + j];
            out[i * columns + j] = sum;
        }
}

/* strain of corner displacements: xx yy zz, and sqrt(2) times yz xz xy */
static void strain_matrix(const double gradients[12], double b[72])
{
    const double half = sqrt(0.5);
    memset(b, 0, 72 * sizeof *b);
    for (int v = 0; v < 4; v++)
        for (int d = 0; d < 3; d++) {
            int p = (d + 1) % 3, q = (d + 2) % 3;
            b[12 * d + 3 * v + d] = gradients[3 * v + d];
            b[12 * (3 + d) + 3 * v + p] = half * gradients[3 * v + q];
            b[12 * (3 + d) + 3 * v + q] = half * gradients[3 * v + p];
        }
}

/* B+' = (B B')^-1 B, 6 x 12 */
static bool pseudoinverse(const double b[72], double out[72])
{
    double square[36];
    for (int i = 0; i < 6; i++)
        for (int j = 0; j < 6; j++) {
            square[6 * i + j] = 0;
            for (int k = 0; k < 12; k++) square[6 * i + j] += b[12 * i + k] * b[12 * j + k];
        }
    memcpy(out, b, 72 * sizeof *out);
    if (!pliant_dense_cholesky(6, square)) return false;
    pliant_dense_cholesky_solve(6, square, 12, out);
    return true;
}

/* C = B+' K B+ / V */
static void material_of(const double plus[72], double volume, const double stiffness[144], double c[36])
{
    double turned[72], half[72];
    for (int i = 0; i < 6; i++)
        for (int k = 0; k < 12; k++) turned[6 * k + i] = plus[12 * i + k];
    multiply(6, 12, 12, plus, stiffness, half);
    multiply(6, 12, 6, half, turned, c);
    for (int m = 0; m < 36; m++) c[m] /= volume;
}

/* the power of a symmetric positive definite 6 x 6; false: it is not */
static bool power_of(const double matrix[36], double exponent, double out[36])
{
    double work[36], values[6], vectors[36], most = 0;
    for (int i = 0; i < 6; i++)
        for (int j = 0; j < 6; j++) work[6 * i + j] = 0.5 * (matrix[6 * i + j] + matrix[6 * j + i]);
    pliant_dense_symmetric_eigen(6, work, values, vectors);
    for (int m = 0; m < 6; m++) most = fmax(most, values[m]);
    for (int m = 0; m < 6; m++)
        if (!(values[m] > 1e-12 * most)) return false;
    for (int i = 0; i < 6; i++)
        for (int j = 0; j < 6; j++) {
            out[6 * i + j] = 0;
            for (int m = 0; m < 6; m++) out[6 * i + j] += vectors[6 * i + m] * pow(values[m], exponent) * vectors[6 * j + m];
        }
    return true;
}

static void sandwich(const double outer[36], const double inner[36], double out[36])
{
    double half[36];
    multiply(6, 6, 6, outer, inner, half);
    multiply(6, 6, 6, half, outer, out);
}

bool pliant_calibrate(const double gradients[12], double volume, const pliant_tet_material *reference, const double condensed[144],
                      const double of_reference[144], double out[144])
{
    double b[72], plus[72], c[36], c_h[36], c_true[36] = {0}, root[36], inverse_root[36], mean[36], s[36];
    strain_matrix(gradients, b);
    if (!pseudoinverse(b, plus)) return false;
    material_of(plus, volume, condensed, c);
    material_of(plus, volume, of_reference, c_h);
    for (int i = 0; i < 6; i++) {
        for (int j = 0; j < 3 && i < 3; j++) c_true[6 * i + j] = reference->lambda;
        c_true[7 * i] += 2 * reference->mu;
    }
    if (!power_of(c_h, 0.5, root) || !power_of(c_h, -0.5, inverse_root)) return false;
    sandwich(root, c_true, mean);
    if (!power_of(mean, 0.5, mean)) return false;
    sandwich(inverse_root, mean, s);
    sandwich(s, c, mean);
    double half[72];
    multiply(6, 6, 12, mean, b, half);
    for (int i = 0; i < 12; i++)
        for (int j = 0; j <= i; j++) {
            double sum = 0;
            for (int k = 0; k < 6; k++) sum += b[12 * k + i] * half[12 * k + j];
            out[12 * i + j] = out[12 * j + i] = volume * sum;
        }
    return true;
}
