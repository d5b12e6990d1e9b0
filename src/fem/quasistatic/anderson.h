/* The rules of safeguarded Anderson acceleration, for the CPU's solver and for the kernels of cuda/anderson.cu. */
#ifndef PLIANT_FEM_QUASISTATIC_ANDERSON_H
#define PLIANT_FEM_QUASISTATIC_ANDERSON_H

#include "base/inline.h"

#include <math.h>

/* The merit of a state: the energy norm of its step [sqrt(J)], from energy = step . residual and the norm of the load. Below zero by
 * more than rounding, what stands for the inverse of the stiffness is not positive there: no measure, and such a state is never
 * accepted. */
PLIANT_INLINE double pliant_anderson_merit(double energy, double scale)
{
    const double rounding = 1e-10;
    if (!isfinite(scale) || !isfinite(energy) || !(energy > -rounding * scale * scale)) return INFINITY;
    return energy > 0 ? sqrt(energy) : 0.0;
}

#endif
