/* Does the same as pliant_volume_value, on the GPU. */
#ifndef PLIANT_CUDA_SEGMENT_VALUE_CUH
#define PLIANT_CUDA_SEGMENT_VALUE_CUH

#include "scan/stored_value.h"
#include "cuda/scan/segment.h"

static __device__ __forceinline__ float value_of(const gpu_segment &segment, int32_t v)
{
    return pliant_stored_value(segment.d_source, segment.encoding, segment.slope, segment.intercept, (size_t)v);
}

enum { SEGMENT_THREADS = 256, SEGMENT_BLOCKS = 1024 }; /* for kernels over all voxels or rows */

#endif
