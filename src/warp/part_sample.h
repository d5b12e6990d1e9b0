/* Sample a voxel at a cut; shared by CPU and kernels. */
#ifndef PLIANT_WARP_PART_SAMPLE_H
#define PLIANT_WARP_PART_SAMPLE_H

#include "warp/part.h"
#include "warp/raster.h"

PLIANT_INLINE double raster_stored(const raster_source *source, ptrdiff_t place)
{
    switch (source->encoding) {
    case PLIANT_UINT8: return (double)((const uint8_t *)source->voxels)[place];
    case PLIANT_INT16: return (double)((const int16_t *)source->voxels)[place];
    default: return (double)((const float *)source->voxels)[place];
    }
}

/* Sample the scan at an index from an element's voxels alone; it must have some there. */
PLIANT_INLINE double part_sample(const raster_source *source, const part_view *parts, part_element element,
                                 const double index[3])
{
    double values[8];
    part_cell cell;
    part_find_cell(parts->scan_size, index, &cell);
    const ptrdiff_t from =
        cell.low[0] * source->step[0] + cell.low[1] * source->step[1] + cell.low[2] * source->step[2];
    PLIANT_UNROLL for (int c = 0; c < 8; c++) values[c] = raster_stored(
        source, from + (c & 1 ? source->step[0] : 0) + (c & 2 ? source->step[1] : 0) + (c & 4 ? source->step[2] : 0));
    return source->nearest ? part_nearest(parts, element, &cell, values) : part_value(parts, element, &cell, values);
}

#endif
