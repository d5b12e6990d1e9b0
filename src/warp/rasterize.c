/* Draw all voxels of one brick: find the owner of each, then compute the values row by row. */
#include "warp/raster.h"
#include "scan/volume.h"

#include <string.h>

void pliant_raster_clear(const int32_t extent[3], raster_brick *brick)
{
    memset(brick->owned, 0, sizeof brick->owned);
    memset(brick->num_entries, 0, sizeof brick->num_entries);
    brick->num_masked = 0;
    brick->num_free = extent[0] * extent[1] * extent[2];
    if (extent[1] == BRICK && extent[2] == BRICK) return;
    for (int32_t row = 0; row < BRICK_ROWS; row++) /* rows outside the target are not free */
        if (row % BRICK >= extent[1] || row / BRICK >= extent[2])
            brick->owned[row / ROWS_AT_ONCE] |= (uint64_t)ENTRY_MASK << 16 * (row % ROWS_AT_ONCE);
}

void pliant_raster_brick(const raster_grid *grid, const raster_source *source, const part_view *parts,
                         const raster_kernels *kernels, const raster_tet *tets, const int32_t *candidates,
                         size_t num_candidates, const int32_t brick[3], raster_brick *scratch, void *out)
{
    const int32_t *size = grid->target.size;
    int32_t origin[3], extent[3];
    for (int d = 0; d < 3; d++) {
        origin[d] = brick[d] * BRICK;
        extent[d] = size[d] - origin[d] < BRICK ? size[d] - origin[d] : BRICK;
    }
    pliant_raster_clear(extent, scratch);
    kernels->find_owners(source, parts, tets, candidates, num_candidates, origin, scratch);
    ptrdiff_t row_step = size[0], slice_step = row_step * size[1];
    ptrdiff_t first = origin[0] + row_step * origin[1] + slice_step * origin[2];
    char *voxels = (char *)out + first * (ptrdiff_t)pliant_encoding_size(source->encoding);
    kernels->write(source, scratch, extent, voxels, row_step, slice_step);
    if (scratch->num_masked > 0)
        pliant_raster_write_masked(source, parts, tets, origin, scratch, voxels, row_step, slice_step);
}
