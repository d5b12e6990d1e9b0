/* Compute the target grid of a warp. */
#include "pliant/warp.h"

#include "base/fail.h"

#include <math.h>

/* maximum protrusion of a box that does not extend the grid, a rounding tolerance [voxels] */
static const double slack = 1e-4;

static bool usable(const pliant_geometry *geometry)
{
    for (int d = 0; d < 3; d++)
        if (geometry->size[d] < 1 || !(geometry->spacing[d] > 0) || !isfinite(geometry->spacing[d])) return false;
    return true;
}

/* Compute the number of voxels to add before and behind along the scan's axes, so that the grid (edge to edge) contains
 * the points and a margin. Return false if a point is not finite. */
static bool find_padding(const pliant_geometry *scan, const double *points, int32_t num_points, double margin,
                         double before[3], double behind[3])
{
    bool finite = isfinite(margin) && margin >= 0;
    for (int d = 0; d < 3; d++) before[d] = behind[d] = 0;
    for (int32_t n = 0; n < num_points; n++) {
        double index[3];
        pliant_geometry_to_index(scan, points + 3 * (size_t)n, index);
        for (int d = 0; d < 3; d++) {
            double extent = margin / scan->spacing[d];
            finite = finite && isfinite(index[d]);
            before[d] = fmax(before[d], ceil(-0.5 - (index[d] - extent) - slack));
            behind[d] = fmax(behind[d], ceil(index[d] + extent - (scan->size[d] - 0.5) - slack));
        }
    }
    return finite;
}

pliant_status pliant_warp_target(const pliant_geometry *scan, const double *points, int32_t num_points, double margin,
                                 size_t max_voxels, pliant_geometry *out)
{
    if (!usable(scan))
        return pliant_fail(PLIANT_ERROR_ARGUMENT, "the scan of a warp target has no voxels or no spacing");
    double before[3], behind[3], size[3], voxels = 1;
    if (!find_padding(scan, points, num_points, margin, before, behind))
        return pliant_fail(
            PLIANT_ERROR_ARGUMENT,
            "the points of a warp target must be finite, and the margin around them finite and not negative");
    for (int d = 0; d < 3; d++) voxels *= size[d] = before[d] + scan->size[d] + behind[d];
    if (!(voxels <= (double)max_voxels) || !(fmax(size[0], fmax(size[1], size[2])) <= INT32_MAX))
        return pliant_fail(
            PLIANT_ERROR_ARGUMENT,
            "the warp target would have %.0f x %.0f x %.0f voxels, which is too many: use a smaller margin or a "
            "coarser scan",
            size[0], size[1], size[2]);
    pliant_geometry target = *scan;
    pliant_geometry_to_world(scan, (const double[3]){-before[0], -before[1], -before[2]}, target.origin);
    for (int d = 0; d < 3; d++) target.size[d] = (int32_t)size[d];
    /* a side without growth keeps the origin bitwise identical */
    if (before[0] == 0 && before[1] == 0 && before[2] == 0)
        for (int d = 0; d < 3; d++) target.origin[d] = scan->origin[d];
    *out = target;
    return PLIANT_OK;
}
