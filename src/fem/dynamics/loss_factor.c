/* A loss factor that hardly depends on frequency, as rubber and tissue have, from a Prony series.
 *
 * With shares g_i of the instantaneous shear modulus and relaxation times t_i, the complex modulus is
 *     G(w) / G(inf) = 1 - sum of g_i / (1 + i w t_i)
 * The loss factor is Im G / Re G. Setting it to `factor` gives linear equations for the shares:
 *     sum of g_i (w t_i + factor) / (1 + w^2 t_i^2) = factor
 * They are solved by least squares over the band, with relaxation times that divide the logarithmic band evenly
 * (Emmerich and Korn, Geophysics 52:1252, 1987: the same for the quality factor 1 / factor of seismic waves). */
#include "fem/dynamics/loss_factor.h"

#include "base/dense.h"

#include <math.h>

enum { FREQUENCIES = 41 /* of the band, for the sums of the least squares */ };

static const double pi = 3.14159265358979323846;

/* Fit `count` shares to the band [Hz]. Return false if one of them is not positive. */
static bool fit(double factor, double low, double high, int count, double fraction[], double time[])
{
    double matrix[PLIANT_PRONY_TERMS * PLIANT_PRONY_TERMS] = {0}, row[PLIANT_PRONY_TERMS];
    for (int i = 0; i < count; i++) {
        time[i] = 1 / (2 * pi * low * pow(high / low, (double)i / (count - 1)));
        fraction[i] = 0;
    }
    for (int f = 0; f < FREQUENCIES; f++) {
        const double w = 2 * pi * low * pow(high / low, (double)f / (FREQUENCIES - 1));
        for (int i = 0; i < count; i++) row[i] = (w * time[i] + factor) / (1 + w * w * time[i] * time[i]);
        for (int i = 0; i < count; i++) {
            for (int j = 0; j < count; j++) matrix[count * i + j] += row[i] * row[j];
            fraction[i] += row[i] * factor;
        }
    }
    bool good = pliant_dense_solve(count, matrix, 1, fraction);
    for (int i = 0; i < count; i++) good = good && fraction[i] > 0;
    return good;
}

int pliant_loss_terms(double factor, double low, double high, double fraction[PLIANT_PRONY_TERMS],
                      double time[PLIANT_PRONY_TERMS])
{
    /* In a narrower band three relaxation times are nearly the same. */
    const double middle = sqrt(low * high), narrowest = 10;
    if (high < narrowest * low) {
        low = middle / sqrt(narrowest);
        high = middle * sqrt(narrowest);
    }
    for (int count = PLIANT_PRONY_TERMS; count > 1; count--)
        if (fit(factor, low, high, count, fraction, time)) return count;
    return 0;
}
