/* What a stored voxel means, for the CPU and for kernels. */
#ifndef PLIANT_SCAN_STORED_H
#define PLIANT_SCAN_STORED_H

#include "base/inline.h"
#include "pliant/scan.h"

PLIANT_INLINE float pliant_stored_value(const void *voxels, pliant_encoding encoding, float slope, float intercept, size_t index)
{
    float stored = 0.0f;
    switch (encoding) {
    case PLIANT_UINT8: stored = ((const uint8_t *)voxels)[index]; break;
    case PLIANT_INT16: stored = ((const int16_t *)voxels)[index]; break;
    case PLIANT_FLOAT32: stored = ((const float *)voxels)[index]; break;
    }
    return slope * stored + intercept;
}

#endif
