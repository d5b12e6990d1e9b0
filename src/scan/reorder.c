/* The same grid, walked along other axes: programs that draw labels often turn the axes of the scan around. */
#include "pliant/scan.h"

#include "base/fail.h"
#include "pliant/memory.h"

#include <math.h>

/* The axis of `from` that runs along axis `d` of `to`, and whether it runs the other way; -1: none does. */
static int axis_along(const pliant_geometry *from, const pliant_geometry *to, int d, bool *flipped)
{
    for (int a = 0; a < 3; a++) {
        double cosine = 0.0;
        for (int row = 0; row < 3; row++) cosine += from->direction[3 * row + a] * to->direction[3 * row + d];
        if (!(fabs(cosine) > 0.5)) continue;
        *flipped = cosine < 0.0;
        return a;
    }
    return -1;
}

/* `from` walked along the axes of `to`: its geometry, the first voxel and the steps from voxel to voxel in `from`. */
static bool turn(const pliant_geometry *from, const pliant_geometry *to, pliant_geometry *out, size_t *first, ptrdiff_t step[3])
{
    const ptrdiff_t stride[3] = {1, from->size[0], (ptrdiff_t)from->size[0] * from->size[1]};
    double corner[3] = {0, 0, 0};
    *first = 0;
    *out = *from;
    for (int d = 0; d < 3; d++) {
        bool flipped;
        int axis = axis_along(from, to, d, &flipped);
        if (axis < 0) return false;
        out->size[d] = from->size[axis];
        out->spacing[d] = from->spacing[axis];
        for (int row = 0; row < 3; row++)
            out->direction[3 * row + d] = flipped ? -from->direction[3 * row + axis] : from->direction[3 * row + axis];
        step[d] = flipped ? -stride[axis] : stride[axis];
        if (!flipped) continue;
        corner[axis] = from->size[axis] - 1;
        *first += (size_t)(from->size[axis] - 1) * (size_t)stride[axis];
    }
    pliant_geometry_to_world(from, corner, out->origin);
    return true;
}

pliant_status pliant_labels_reorder(pliant_labels *labels, const pliant_geometry *grid)
{
    pliant_labels out = {0};
    pliant_geometry turned;
    size_t first;
    ptrdiff_t step[3];
    if (pliant_geometry_equal(&labels->geometry, grid)) return PLIANT_OK;
    if (!turn(&labels->geometry, grid, &turned, &first, step) || !pliant_geometry_equal(&turned, grid))
        return pliant_fail(PLIANT_ERROR_ARGUMENT,
                           "labels: %d x %d x %d voxels of %g x %g x %g mm do not lie on a grid of %d x %d x %d voxels of %g x %g x %g mm, "
                           "whichever way its axes are turned: size, origin, spacing and axes must agree",
                           labels->geometry.size[0], labels->geometry.size[1], labels->geometry.size[2], 1e3 * labels->geometry.spacing[0],
                           1e3 * labels->geometry.spacing[1], 1e3 * labels->geometry.spacing[2], grid->size[0], grid->size[1],
                           grid->size[2], 1e3 * grid->spacing[0], 1e3 * grid->spacing[1], 1e3 * grid->spacing[2]);
    pliant_status status = pliant_labels_create(grid, &out);
    if (status != PLIANT_OK) return status;
    size_t n = 0;
    for (int32_t k = 0; k < grid->size[2]; k++)
        for (int32_t j = 0; j < grid->size[1]; j++) {
            const uint16_t *row = labels->voxels + (ptrdiff_t)first + j * step[1] + k * step[2];
            for (int32_t i = 0; i < grid->size[0]; i++) out.voxels[n++] = row[i * step[0]];
        }
    pliant_labels_free(labels);
    *labels = out;
    return PLIANT_OK;
}
