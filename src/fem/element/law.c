#include "fem/element/law.h"

#include <math.h>
#include <string.h>

static void cofactor_of(const double f[9], double c[9])
{
    for (int r = 0; r < 3; r++)
        for (int s = 0; s < 3; s++) {
            int a = (r + 1) % 3, b = (r + 2) % 3, d = (s + 1) % 3, e = (s + 2) % 3;
            c[3 * r + s] = f[3 * a + d] * f[3 * b + e] - f[3 * a + e] * f[3 * b + d];
        }
}

/* Return ln J. Below the smallest ratio it continues as the parabola whose slope is the linear continuation of 1 /
 * J. */
static double logarithm(double ratio)
{
    const double minimum = PLIANT_SMALLEST_RATIO;
    if (ratio > minimum) return log(ratio);
    double below = (ratio - minimum) / minimum;
    return log(minimum) + below - 0.5 * below * below;
}

static double saint_venant_kirchhoff(double lambda, double mu, const double f[9], double stress[9])
{
    double s[9], trace = 0, squares = 0;
    for (int a = 0; a < 3; a++)
        for (int b = 0; b < 3; b++) {
            double e = -0.5 * (a == b);
            for (int k = 0; k < 3; k++) e += 0.5 * f[3 * k + a] * f[3 * k + b];
            s[3 * a + b] = 2 * mu * e;
            trace += a == b ? e : 0;
            squares += e * e;
        }
    for (int d = 0; d < 3; d++) s[4 * d] += lambda * trace;
    for (int r = 0; stress && r < 3; r++)
        for (int c = 0; c < 3; c++)
            stress[3 * r + c] = f[3 * r] * s[c] + f[3 * r + 1] * s[3 + c] + f[3 * r + 2] * s[6 + c];
    return 0.5 * lambda * trace * trace + mu * squares;
}

double pliant_law_response(pliant_law law, double lambda, double mu, const double f[9], double stress[9])
{
    if (law == PLIANT_LAW_SAINT_VENANT_KIRCHHOFF) return saint_venant_kirchhoff(lambda, mu, f, stress);
    double h[9], ch[9], cf[9], a, shear, trace = 0, squares = 0;
    for (int m = 0; m < 9; m++) {
        h[m] = f[m] - (m % 4 == 0);
        squares += h[m] * h[m];
    }
    cofactor_of(h, ch);
    cofactor_of(f, cf);
    trace = h[0] + h[4] + h[8];
    double change = trace + ch[0] + ch[4] + ch[8] + h[0] * ch[0] + h[1] * ch[1] + h[2] * ch[2];
    double first = 2 * trace + squares, modulus = pliant_law_modulus(law, lambda, mu);
    pliant_law_double_terms(law, mu, first, change, &a, &shear);
    double b = shear + modulus * pliant_law_double_volume(law, change);
    for (int r = 0; stress && r < 3; r++)
        for (int c = 0; c < 3; c++) {
            double term = h[3 * r + c] + h[3 * c + r] - (r == c ? trace : 0) - ch[3 * r + c];
            stress[3 * r + c] = a * term + b * cf[3 * r + c];
        }
    double ratio = 1 + change;
    if (law == PLIANT_LAW_COMPRESSIBLE) {
        double power, slope;
        pliant_law_double_power(ratio, &power, &slope);
        return 0.5 * mu * (power * (3 + first) - 3) + 0.25 * modulus * (ratio * ratio - 1 - 2 * logarithm(ratio));
    }
    return 0.5 * mu * first - mu * logarithm(ratio) + 0.5 * modulus * change * change;
}

bool pliant_law_cauchy(pliant_law law, double lambda, double mu, const double f[9], double stress[6])
{
    double p[9], c[9];
    cofactor_of(f, c);
    double ratio = f[0] * c[0] + f[1] * c[1] + f[2] * c[2];
    memset(stress, 0, 6 * sizeof *stress);
    if (!(ratio > 0)) return false;
    pliant_law_response(law, lambda, mu, f, p);
    static const int row[6] = {0, 1, 2, 0, 0, 1}, column[6] = {0, 1, 2, 1, 2, 2};
    for (int m = 0; m < 6; m++) {
        const double *left = p + 3 * row[m], *right = f + 3 * column[m];
        stress[m] = (left[0] * right[0] + left[1] * right[1] + left[2] * right[2]) / ratio;
    }
    return true;
}

/* Uses the trigonometric solution of the cubic (Smith 1961). */
void pliant_symmetric_eigenvalues(const double m[6], double out[3])
{
    double mean = (m[0] + m[1] + m[2]) / 3, a = m[0] - mean, b = m[1] - mean, c = m[2] - mean;
    double off = m[3] * m[3] + m[4] * m[4] + m[5] * m[5], size = sqrt((a * a + b * b + c * c + 2 * off) / 6);
    out[0] = out[1] = out[2] = mean;
    if (!(size > 0)) return;
    double determinant = a * (b * c - m[5] * m[5]) - m[3] * (m[3] * c - m[5] * m[4]) + m[4] * (m[3] * m[5] - b * m[4]);
    double angle = acos(fmin(fmax(0.5 * determinant / (size * size * size), -1), 1)) / 3;
    const double third = 2.0943951023931954923;
    out[2] = mean + 2 * size * cos(angle);
    out[0] = mean + 2 * size * cos(angle + third);
    out[1] = 3 * mean - out[0] - out[2];
}
