#include "fem/rotation.h"

#include <math.h>
#include <string.h>

/* Eigenvectors of a symmetric 3 x 3 matrix by cyclic Jacobi rotations (Golub and Van Loan, 8.5); columns of vectors. */
static void symmetric_eigen(double a[9], double vectors[9])
{
    static const int pairs[3][2] = {{0, 1}, {0, 2}, {1, 2}};
    memset(vectors, 0, 9 * sizeof *vectors);
    vectors[0] = vectors[4] = vectors[8] = 1;
    for (int sweep = 0; sweep < 12; sweep++) {
        double off = a[1] * a[1] + a[2] * a[2] + a[5] * a[5], on = a[0] * a[0] + a[4] * a[4] + a[8] * a[8];
        if (off <= 1e-30 * on) return;
        for (int n = 0; n < 3; n++) {
            int p = pairs[n][0], q = pairs[n][1];
            double apq = a[3 * p + q];
            if (apq == 0) continue;
            double theta = (a[4 * q] - a[4 * p]) / (2 * apq);
            double t = (theta >= 0 ? 1 : -1) / (fabs(theta) + sqrt(theta * theta + 1));
            double c = 1 / sqrt(t * t + 1), s = t * c;
            for (int r = 0; r < 3; r++) {
                double arp = a[3 * r + p], arq = a[3 * r + q];
                a[3 * r + p] = c * arp - s * arq;
                a[3 * r + q] = s * arp + c * arq;
            }
            for (int r = 0; r < 3; r++) {
                double apr = a[3 * p + r], aqr = a[3 * q + r];
                a[3 * p + r] = c * apr - s * aqr;
                a[3 * q + r] = s * apr + c * aqr;
                double vrp = vectors[3 * r + p], vrq = vectors[3 * r + q];
                vectors[3 * r + p] = c * vrp - s * vrq;
                vectors[3 * r + q] = s * vrp + c * vrq;
            }
        }
    }
}

void pliant_symmetric_eigen(const double matrix[9], double values[3], double vectors[9])
{
    double a[9];
    memcpy(a, matrix, sizeof a);
    symmetric_eigen(a, vectors);
    for (int k = 0; k < 3; k++) values[k] = a[4 * k];
}

static void column(const double m[9], int c, double out[3])
{
    for (int r = 0; r < 3; r++) out[r] = m[3 * r + c];
}

static double normalize(double v[3])
{
    double length = sqrt(v[0] * v[0] + v[1] * v[1] + v[2] * v[2]);
    if (length > 0)
        for (int d = 0; d < 3; d++) v[d] /= length;
    return length;
}

static void cross(const double a[3], const double b[3], double out[3])
{
    for (int d = 0; d < 3; d++) out[d] = a[(d + 1) % 3] * b[(d + 2) % 3] - a[(d + 2) % 3] * b[(d + 1) % 3];
}

static void orthogonal_to(const double v[3], double out[3])
{
    int smallest = 0;
    for (int d = 1; d < 3; d++)
        if (fabs(v[d]) < fabs(v[smallest])) smallest = d;
    double axis[3] = {0, 0, 0};
    axis[smallest] = 1;
    cross(v, axis, out);
    normalize(out);
}

/* F = U S V' with U and V rotations and the sign of det F on the smallest singular value (Irving et al. 2004); R = U V'.
 * The two larger directions are mapped, the third follows by the cross product: no division by a small one. */
void pliant_rotation_signed_svd(const double deformation[9], double rotation[9])
{
    double largest = 0, f[9], gram[9], v[9];
    for (int m = 0; m < 9; m++) largest = fmax(largest, fabs(deformation[m]));
    if (!(largest > 0) || !isfinite(largest)) { /* collapsed to a point, or not a number: no direction is nearer than another */
        memset(rotation, 0, 9 * sizeof *rotation);
        rotation[0] = rotation[4] = rotation[8] = 1;
        return;
    }
    for (int m = 0; m < 9; m++) f[m] = deformation[m] / largest;
    for (int r = 0; r < 3; r++)
        for (int c = 0; c < 3; c++) gram[3 * r + c] = f[r] * f[c] + f[3 + r] * f[3 + c] + f[6 + r] * f[6 + c];
    symmetric_eigen(gram, v);
    int order[3] = {0, 1, 2};
    for (int pass = 0; pass < 2; pass++)
        for (int n = 0; n < 2; n++)
            if (gram[4 * order[n]] < gram[4 * order[n + 1]]) {
                int swap = order[n];
                order[n] = order[n + 1];
                order[n + 1] = swap;
            }
    double v0[3], v1[3], v2[3], u0[3], u1[3], u2[3];
    column(v, order[0], v0);
    column(v, order[1], v1);
    cross(v0, v1, v2);
    for (int r = 0; r < 3; r++) {
        u0[r] = f[3 * r] * v0[0] + f[3 * r + 1] * v0[1] + f[3 * r + 2] * v0[2];
        u1[r] = f[3 * r] * v1[0] + f[3 * r + 1] * v1[1] + f[3 * r + 2] * v1[2];
    }
    double stretch = normalize(u0), along = u0[0] * u1[0] + u0[1] * u1[1] + u0[2] * u1[2];
    for (int d = 0; d < 3; d++) u1[d] -= along * u0[d];
    if (normalize(u1) <= 1e-12 * stretch) orthogonal_to(u0, u1); /* collapsed to a line */
    cross(u0, u1, u2);
    for (int r = 0; r < 3; r++)
        for (int c = 0; c < 3; c++) rotation[3 * r + c] = u0[r] * v0[c] + u1[r] * v1[c] + u2[r] * v2[c];
}
