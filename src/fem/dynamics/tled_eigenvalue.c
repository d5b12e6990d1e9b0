/* Ratio of an element's stiffness to its mass, which bounds the time step. */
#include "fem/dynamics/tled.h"

#include <math.h>

/* Return the largest eigenvalue of an element with constant strain. K / V has the eigenvalues of  lambda tr(A)^2 + 2 mu
 * |sym A|^2  relative to  tr(A H^-1 A'), with A = sum u_v g_v' and H = sum g_v g_v'. The reason is that the shortest u
 * for a given A is u_v = A H^-1 g_v. In the axes of H with eigenvalues h, the diagonal of A decouples. It has the 3 x 3
 * matrix lambda sqrt(h_i h_j) + 2 mu h_i delta_ij. Each pair of off-diagonal entries has mu (h_i + h_j). */
double pliant_gram_largest_eigenvalue(const double gram[6], double lambda, double mu)
{
    double h[3], values[3];
    pliant_symmetric_eigenvalues(gram, h);
    double diagonal[6];
    for (int d = 0; d < 3; d++) diagonal[d] = (lambda + 2 * mu) * h[d];
    diagonal[3] = lambda * sqrt(h[0] * h[1]);
    diagonal[4] = lambda * sqrt(h[0] * h[2]);
    diagonal[5] = lambda * sqrt(h[1] * h[2]);
    pliant_symmetric_eigenvalues(diagonal, values);
    return fmax(values[2], mu * (h[1] + h[2]));
}

double pliant_element_largest_eigenvalue(const double g[12], double lambda, double mu)
{
    double gram[6] = {0};
    for (int v = 0; v < 4; v++) {
        const double *x = g + 3 * v;
        double term[6] = {x[0] * x[0], x[1] * x[1], x[2] * x[2], x[0] * x[1], x[0] * x[2], x[1] * x[2]};
        for (int m = 0; m < 6; m++) gram[m] += term[m];
    }
    return pliant_gram_largest_eigenvalue(gram, lambda, mu);
}
