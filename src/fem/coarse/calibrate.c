#include "fem/coarse/calibrate.h"

#include "base/dense.h"

#include <math.h>
#include <string.h>

enum { MODES = 18, UNKNOWNS = 24, MOST = MODES };

/* Compute out (rows x columns) = a (rows x inner) b (inner x columns). */
static void multiply(int rows, int inner, int columns, const double *a, const double *b, double *out)
{
    for (int i = 0; i < rows; i++)
        for (int j = 0; j < columns; j++) {
            double sum = 0;
            for (int k = 0; k < inner; k++) sum += a[i * inner + k] * b[k * columns + j];
            out[i * columns + j] = sum;
        }
}

/* Fill the strain matrix of corner displacements: xx yy zz, and sqrt(2) times yz xz xy. */
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

/* Compute B+' = (B B')^-1 B, 6 x 12. */
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

/* Compute C = B+' K B+ / V. */
static void material_of(const double plus[72], double volume, const double stiffness[144], double c[36])
{
    double turned[72], half[72];
    for (int i = 0; i < 6; i++)
        for (int k = 0; k < 12; k++) turned[6 * k + i] = plus[12 * i + k];
    multiply(6, 12, 12, plus, stiffness, half);
    multiply(6, 12, 6, half, turned, c);
    for (int m = 0; m < 36; m++) c[m] /= volume;
}

/* Compute a power of a symmetric positive definite n x n matrix. Return false if it is not positive definite. */
static bool power_of(int n, const double *matrix, double exponent, double *out)
{
    double work[MOST * MOST], values[MOST], vectors[MOST * MOST], most = 0;
    for (int i = 0; i < n; i++)
        for (int j = 0; j < n; j++) work[n * i + j] = 0.5 * (matrix[n * i + j] + matrix[n * j + i]);
    pliant_dense_symmetric_eigen(n, work, values, vectors);
    for (int m = 0; m < n; m++) most = fmax(most, values[m]);
    for (int m = 0; m < n; m++)
        if (!(values[m] > 1e-12 * most)) return false;
    for (int i = 0; i < n; i++)
        for (int j = 0; j < n; j++) {
            out[n * i + j] = 0;
            for (int m = 0; m < n; m++)
                out[n * i + j] += vectors[n * i + m] * pow(values[m], exponent) * vectors[n * j + m];
        }
    return true;
}

static void sandwich(int n, const double *outer, const double *inner, double *out)
{
    double half[MOST * MOST];
    multiply(n, n, n, outer, inner, half);
    multiply(n, n, n, half, outer, out);
}

/* Compute S C S, (n x n), with S C_h S = C_true. `out` may be c. Return false if a matrix is not positive definite. */
static bool correct(int n, const double *c, const double *c_h, const double *c_true, double *out)
{
    double root[MOST * MOST], inverse_root[MOST * MOST], mean[MOST * MOST], s[MOST * MOST];
    if (!power_of(n, c_h, 0.5, root) || !power_of(n, c_h, -0.5, inverse_root)) return false;
    sandwich(n, root, c_true, mean);
    if (!power_of(n, mean, 0.5, s)) return false;
    sandwich(n, inverse_root, s, mean);
    sandwich(n, mean, c, s);
    memcpy(out, s, (size_t)(n * n) * sizeof *out);
    return true;
}

bool pliant_calibrate(const double gradients[12], double volume, const pliant_tet_material *reference,
                      const double condensed[144], const double of_reference[144], double out[144])
{
    double b[72], plus[72], c[36], c_h[36], c_true[36] = {0}, half[72];
    strain_matrix(gradients, b);
    if (!pseudoinverse(b, plus)) return false;
    material_of(plus, volume, condensed, c);
    material_of(plus, volume, of_reference, c_h);
    for (int i = 0; i < 6; i++) {
        for (int j = 0; j < 3 && i < 3; j++) c_true[6 * i + j] = reference->lambda;
        c_true[7 * i] += 2 * reference->mu;
    }
    if (!correct(6, c, c_h, c_true, c)) return false;
    multiply(6, 6, 12, c, b, half);
    for (int i = 0; i < 12; i++)
        for (int j = 0; j <= i; j++) {
            double sum = 0;
            for (int k = 0; k < 6; k++) sum += b[12 * k + i] * half[12 * k + j];
            out[12 * i + j] = out[12 * j + i] = volume * sum;
        }
    return true;
}

/* C = Q'K Q */
static void on_modes(const double q[MODES * UNKNOWNS], const double *stiffness, double c[MODES * MODES])
{
    double half[MODES * UNKNOWNS], turned[MODES * UNKNOWNS];
    for (int m = 0; m < MODES; m++)
        for (int i = 0; i < UNKNOWNS; i++) turned[MODES * i + m] = q[UNKNOWNS * m + i];
    multiply(MODES, UNKNOWNS, UNKNOWNS, q, stiffness, half);
    multiply(MODES, UNKNOWNS, MODES, half, turned, c);
}

bool pliant_calibrate_cube(const double truth[576], const double condensed[576], const double of_reference[576],
                           double out[576])
{
    double work[UNKNOWNS * UNKNOWNS], values[UNKNOWNS], vectors[UNKNOWNS * UNKNOWNS], q[MODES * UNKNOWNS],
        half[MODES * UNKNOWNS], turned[MODES * UNKNOWNS];
    double c[MODES * MODES], c_h[MODES * MODES], c_true[MODES * MODES], most = 0;
    int modes = 0;
    memcpy(work, truth, sizeof work);
    pliant_dense_symmetric_eigen(UNKNOWNS, work, values, vectors);
    for (int m = 0; m < UNKNOWNS; m++) most = fmax(most, values[m]);
    for (int m = 0; m < UNKNOWNS; m++) {
        if (!(values[m] > 1e-9 * most)) continue;
        if (modes == MODES) return false;
        for (int i = 0; i < UNKNOWNS; i++) q[UNKNOWNS * modes + i] = vectors[UNKNOWNS * i + m];
        modes++;
    }
    if (modes < MODES) return false;
    on_modes(q, condensed, c);
    on_modes(q, of_reference, c_h);
    on_modes(q, truth, c_true);
    if (!correct(MODES, c, c_h, c_true, c)) return false;
    for (int m = 0; m < MODES; m++)
        for (int i = 0; i < UNKNOWNS; i++) turned[MODES * i + m] = q[UNKNOWNS * m + i];
    multiply(MODES, MODES, UNKNOWNS, c, q, half);
    multiply(UNKNOWNS, MODES, UNKNOWNS, turned, half, out);
    for (int i = 0; i < UNKNOWNS * UNKNOWNS; i++)
        if (!isfinite(out[i])) return false;
    return true;
}
