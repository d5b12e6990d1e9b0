/* Pressures of nearly incompressible tissue (pressures.h): the rules that the CPU and the GPU share. Matrices have 9
 * numbers, row-major. */
#ifndef PLIANT_FEM_ELEMENT_PRESSURE_RULES_H
#define PLIANT_FEM_ELEMENT_PRESSURE_RULES_H

#include "base/inline.h"
#include "pliant/scene.h"

/* Return the change of volume: tr(R'F) - 3, or J - 1 = F : cof F / 3 - 1 (neo-Hookean law).
 * @param derivative  Its derivative by F: R, or cof F. */
PLIANT_INLINE double pliant_volume_change(pliant_elasticity law, const double f[9], const double derivative[9])
{
    double sum = -3;
    PLIANT_UNROLL
    for (int m = 0; m < 9; m++) sum += derivative[m] * f[m];
    return law == PLIANT_ELASTICITY_COROTATIONAL ? sum : sum / 3;
}

/* Compute volume times the derivative of the change of volume by a corner's position. gradient: g of the corner. */
PLIANT_INLINE void pliant_volume_row(const double derivative[9], double volume, const double *gradient, double row[3])
{
    PLIANT_UNROLL
    for (int d = 0; d < 3; d++)
        row[d] = volume * (derivative[3 * d] * gradient[0] + derivative[3 * d + 1] * gradient[1] +
                           derivative[3 * d + 2] * gradient[2]);
}

/* Return the step of a pressure. change: t(x) + t'(x) dx (quasistatic/pressure.c). */
PLIANT_INLINE double pliant_pressure_increment(double gain, double change, double compliance, double pressure)
{
    return gain * (change - compliance * pressure);
}

/* Return the weight of squared pressures in the merit's norm [m^3 / Pa]. */
PLIANT_INLINE double pliant_pressure_weight(double volume, double gain) { return volume / gain; }

#endif
