/* Settings shared by all sets of inner loops. Include this file first. */
#ifndef PLIANT_WARP_INNER_LOOPS_H
#define PLIANT_WARP_INNER_LOOPS_H

/* Disable fused multiply-adds, which round differently and exist only in some sets and machines. */
#if defined(__GNUC__) && !defined(__clang__)
#pragma GCC optimize("fp-contract=off")
#endif

#include "warp/raster.h"

/* Along x, 8 and 16 bit voxels have integer weights with this sum. Two products and their sum are then one instruction,
 * and the result is exact. The resolution is 6e-5 of a voxel. */
enum { SAMPLE_ONE = 1 << 14 };

static inline int64_t sample_copy_start(const raster_copy *copy, int32_t row)
{
    return copy->first + row % BRICK * copy->step_j + row / BRICK * copy->step_k;
}

#endif
