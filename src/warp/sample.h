/* What all sets of inner loops agree on. Include this first. */
#ifndef PLIANT_WARP_SAMPLE_H
#define PLIANT_WARP_SAMPLE_H

/* A fused multiply-add would round differently in the sets, and on machines, that have one. */
#if defined(__GNUC__) && !defined(__clang__)
#pragma GCC optimize("fp-contract=off")
#endif

#include "warp/raster.h"

/* Along x, 8 and 16 bit voxels are weighed with whole numbers that sum to this: two products and their sum are one
 * instruction, and the result is exact. A step is 6e-5 of a voxel. */
enum { SAMPLE_ONE = 1 << 14 };

static inline int64_t sample_copy_start(const raster_copy *copy, int32_t row)
{
    return copy->first + row % BRICK * copy->step_j + row / BRICK * copy->step_k;
}

#endif
