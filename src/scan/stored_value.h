/* Conversion of a stored voxel to its value, shared by CPU and kernels. */
#ifndef PLIANT_SCAN_STORED_VALUE_H
#define PLIANT_SCAN_STORED_VALUE_H

#include "base/inline.h"
#include "pliant/scan.h"

PLIANT_INLINE float pliant_stored_number(const void *voxels, pliant_encoding encoding, size_t index)
{
    switch (encoding) {
    case PLIANT_UINT8: return ((const uint8_t *)voxels)[index];
    case PLIANT_INT16: return ((const int16_t *)voxels)[index];
    case PLIANT_FLOAT32: return ((const float *)voxels)[index];
    }
    return 0.0f;
}

PLIANT_INLINE float pliant_stored_value(const void *voxels, pliant_encoding encoding, float slope, float intercept,
                                        size_t index)
{
    return slope * pliant_stored_number(voxels, encoding, index) + intercept;
}

#endif
