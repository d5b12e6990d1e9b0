/* pliant_volume_value on the GPU */
#ifndef PLIANT_CUDA_SEGMENT_VALUE_CUH
#define PLIANT_CUDA_SEGMENT_VALUE_CUH

#include "segment.h"

static __device__ __forceinline__ float value_of(const gpu_segment &segment, int32_t v)
{
    float stored = 0;
    switch (segment.encoding) {
    case PLIANT_UINT8: stored = static_cast<const uint8_t *>(segment.d_source)[v]; break;
    case PLIANT_INT16: stored = static_cast<const int16_t *>(segment.d_source)[v]; break;
    case PLIANT_FLOAT32: stored = static_cast<const float *>(segment.d_source)[v]; break;
    }
    return segment.slope * stored + segment.intercept;
}

enum { SEGMENT_THREADS = 256, SEGMENT_BLOCKS = 1024 }; /* kernels that walk over all voxels or rows */

#endif
