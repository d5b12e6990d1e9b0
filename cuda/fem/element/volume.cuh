/* Changes of volume and forces of pressures (src/fem/element/pressures.h), one thread per element or corner. */
#ifndef PLIANT_CUDA_VOLUME_CUH
#define PLIANT_CUDA_VOLUME_CUH

#include "base/matrix.h"
#include "cuda/fem/solver_state.h"
#include "fem/element/pressure_rules.h"

/* Store the change of volume of an element and its derivative. r: the rotation nearest to F; unused by the neo-Hookean
 * law. */
static __device__ __forceinline__ void store_volume(const gpu_pressures &pressures, pliant_elasticity law, int e,
                                                    const double *f, const double *r, double *derivative)
{
    if (law == PLIANT_ELASTICITY_COROTATIONAL) {
#pragma unroll
        for (int m = 0; m < 9; m++) derivative[m] = r[m];
    } else {
        pliant_cofactor(f, derivative);
    }
    pressures.d_change[e] = pliant_volume_change(law, f, derivative);
#pragma unroll
    for (int m = 0; m < 9; m++) pressures.d_derivative[(size_t)m * pressures.elements + e] = derivative[m];
}

static __device__ __forceinline__ void load_derivative(const gpu_pressures &pressures, int e, double *out)
{
#pragma unroll
    for (int m = 0; m < 9; m++) out[m] = pressures.d_derivative[(size_t)m * pressures.elements + e];
}

/* Add the force of a pressure on a corner. */
static __device__ __forceinline__ void add_pressure(double pressure, double volume, const double *derivative,
                                                    const double *gradient, double *force)
{
    double row[3];
    pliant_volume_row(derivative, volume, gradient, row);
#pragma unroll
    for (int d = 0; d < 3; d++) force[d] += pressure * row[d];
}

#endif
