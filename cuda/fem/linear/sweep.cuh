/* Layout of a symmetric matrix in sweeps (inverse.h). */
#ifndef PLIANT_CUDA_SWEEP_CUH
#define PLIANT_CUDA_SWEEP_CUH

#include "cuda/fem/linear/inverse.h"

enum { SWEEP = INVERSE_SWEEP, SWEEP_TILE = SWEEP * SWEEP };

static __host__ __device__ __forceinline__ size_t triangle(size_t i, size_t j) { return i * (i + 1) / 2 + j; }

/* Store an entry. row >= column, or both are in one tile; diagonal tiles are stored completely. */
static __device__ __forceinline__ void put(double *tiles, int row, int column, double value)
{
    int i = row / SWEEP, j = column / SWEEP, r = row % SWEEP, c = column % SWEEP;
    double *tile = tiles + SWEEP_TILE * triangle(i, j);
    tile[SWEEP * r + c] = value;
    if (i == j) tile[SWEEP * c + r] = value;
}

#endif
