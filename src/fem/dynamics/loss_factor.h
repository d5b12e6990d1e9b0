/* Prony terms of a loss factor. */
#ifndef PLIANT_FEM_DYNAMICS_LOSS_FACTOR_H
#define PLIANT_FEM_DYNAMICS_LOSS_FACTOR_H

#include "fem/dynamics/tled.h"

#ifdef __cplusplus
extern "C" {
#endif

/* Compute Prony terms whose loss factor is close to `factor` in a band of frequencies [Hz].
 * @param factor  Loss factor: tangent of the loss angle, about twice the damping ratio of a vibration.
 * @param fraction   Out: fractions of the instantaneous shear modulus.
 * @param time    Out: relaxation times [s].
 * @return Number of terms; 0: none fit. */
int pliant_loss_terms(double factor, double low, double high, double fraction[PLIANT_PRONY_TERMS],
                      double time[PLIANT_PRONY_TERMS]);

#ifdef __cplusplus
}
#endif

#endif
