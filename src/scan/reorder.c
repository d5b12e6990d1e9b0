/* The same grid, walked along other axes: programs that draw labels often turn the axes of the scan around. */
#include "pliant/scan.h"

#include "base/fail.h"
#include "pliant/memory.h"

#include <math.h>
#include <stdio.h>

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

/* Maximum distance of a corner of labels from a voxel of the scan [voxels]. Origins and axes are written with a few
 * digits. Up to this distance there is no doubt which voxel is meant; above the second one it is no mere rounding. */
static const double nearest = 0.25, notable = 0.1;

/* Set `first` to the index in `to` of voxel (0, 0, 0) of `from`. Return the maximum distance of its corners from voxels
 * of `to` [voxels]. */
static double misplacement(const pliant_geometry *from, const pliant_geometry *to, double first[3])
{
    const double zero[3] = {0, 0, 0};
    double point[3], largest = 0.0;
    pliant_geometry_to_world(from, zero, point);
    pliant_geometry_to_index(to, point, first);
    for (int corner = 0; corner < 8; corner++) {
        double at[3], index[3];
        for (int d = 0; d < 3; d++) at[d] = corner >> d & 1 ? from->size[d] - 1 : 0;
        pliant_geometry_to_world(from, at, point);
        pliant_geometry_to_index(to, point, index);
        for (int d = 0; d < 3; d++) largest = fmax(largest, fabs(index[d] - at[d] - round(first[d])));
    }
    return largest;
}

/* Fail with the differences between two grids and the remedy. */
static pliant_status refuse(const pliant_geometry *labels, const pliant_geometry *turned, const pliant_geometry *grid)
{
    double spacing = 0.0, angle = 0.0, cosine, first[3] = {0, 0, 0}, off = 0.0;
    for (int d = 0; d < 3 && turned; d++) {
        spacing = fmax(spacing, fabs(turned->spacing[d] / grid->spacing[d] - 1.0));
        cosine = 0.0;
        for (int row = 0; row < 3; row++) cosine += turned->direction[3 * row + d] * grid->direction[3 * row + d];
        angle = fmax(angle, acos(fmin(fabs(cosine), 1.0)));
    }
    if (turned) off = misplacement(turned, grid, first);
    char where[240] = "their axes run along none of the scan's";
    if (turned)
        snprintf(where, sizeof where,
                 "spacing differs by %.3g %%, axes by %.3g degrees, voxel (0, 0, 0) lies at (%.6g, %.6g, %.6g) of the "
                 "scan's, corners up to "
                 "%.3g voxels from voxels of the scan (at most %g are accepted)",
                 100.0 * spacing, angle * 57.29577951308232, first[0], first[1], first[2], off, nearest);
    return pliant_fail(PLIANT_ERROR_ARGUMENT,
                       "labels: %d x %d x %d voxels of %.9g x %.9g x %.9g mm do not lie on the scan's grid of %d x %d "
                       "x %d voxels of %.9g x %.9g x %.9g mm, "
                       "whichever way their axes are turned: %s; resample the labels to the scan's grid by nearest "
                       "neighbour (3D Slicer and SimpleITK do)",
                       labels->size[0], labels->size[1], labels->size[2], 1e3 * labels->spacing[0],
                       1e3 * labels->spacing[1], 1e3 * labels->spacing[2], grid->size[0], grid->size[1], grid->size[2],
                       1e3 * grid->spacing[0], 1e3 * grid->spacing[1], 1e3 * grid->spacing[2], where);
}

static size_t num_labelled(const pliant_labels *labels)
{
    size_t count = 0;
    for (size_t v = 0; v < pliant_geometry_voxels(&labels->geometry); v++) count += labels->voxels[v] != 0;
    return count;
}

/* The part of the scan's grid that labels cover, and their voxel (0, 0, 0) there. */
typedef struct {
    int32_t at[3], begin[3], end[3];
} covered;

/* Return false if the labels cover no voxel of the grid. */
static bool cover(const pliant_geometry *turned, const pliant_geometry *grid, const double corner[3], covered *out)
{
    bool meets = true;
    for (int d = 0; d < 3; d++) {
        out->at[d] = (int32_t)fmax(fmin(round(corner[d]), 1e9), -1e9);
        out->begin[d] = out->at[d] > 0 ? out->at[d] : 0;
        out->end[d] = (int32_t)fmin((double)out->at[d] + turned->size[d], grid->size[d]);
        meets = meets && out->begin[d] < out->end[d];
    }
    return meets;
}

static void warn(const pliant_geometry *turned, const pliant_geometry *grid, const int32_t at[3], double off,
                 size_t outside)
{
    bool whole = true;
    for (int d = 0; d < 3; d++) whole = whole && turned->size[d] == grid->size[d] && at[d] == 0;
    if (off > notable)
        pliant_log(PLIANT_LOG_WARNING,
                   "labels: corners lie up to %.3g voxels from voxels of the scan; each label is taken "
                   "for the nearest voxel",
                   off);
    if (!whole)
        pliant_log(PLIANT_LOG_WARNING,
                   "labels: %d x %d x %d voxels begin at voxel (%d, %d, %d) of the scan, which has %d x %d x %d; "
                   "there is no label in the rest of it; %zu voxels with a label lie outside it",
                   turned->size[0], turned->size[1], turned->size[2], at[0], at[1], at[2], grid->size[0], grid->size[1],
                   grid->size[2], outside);
}

pliant_status pliant_labels_reorder(pliant_labels *labels, const pliant_geometry *grid)
{
    pliant_labels out = {0};
    pliant_geometry turned;
    size_t first;
    ptrdiff_t step[3];
    double corner[3];
    covered part;
    if (pliant_geometry_equal(&labels->geometry, grid)) return PLIANT_OK;
    if (!turn(&labels->geometry, grid, &turned, &first, step)) return refuse(&labels->geometry, NULL, grid);
    const double off = misplacement(&turned, grid, corner);
    if (!(off <= nearest) || !cover(&turned, grid, corner, &part)) return refuse(&labels->geometry, &turned, grid);
    pliant_status status = pliant_labels_create(grid, &out);
    if (status != PLIANT_OK) return status;
    for (int32_t k = part.begin[2]; k < part.end[2]; k++)
        for (int32_t j = part.begin[1]; j < part.end[1]; j++) {
            const uint16_t *row =
                labels->voxels + (ptrdiff_t)first + (j - part.at[1]) * step[1] + (k - part.at[2]) * step[2];
            uint16_t *to = out.voxels + (size_t)grid->size[0] * ((size_t)j + (size_t)grid->size[1] * (size_t)k);
            for (int32_t i = part.begin[0]; i < part.end[0]; i++) to[i] = row[(i - part.at[0]) * step[0]];
        }
    warn(&turned, grid, part.at, off, num_labelled(labels) - num_labelled(&out));
    pliant_labels_free(labels);
    *labels = out;
    return PLIANT_OK;
}
