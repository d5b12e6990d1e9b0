/* The target grid of a warp. */
#include "pliant/warp.h"

#include "base/fail.h"

#include <math.h>

/* a box may stick out so far before the grid grows: rounding, not tissue [voxels] */
static const double slack = 1e-4;

static bool usable(const pliant_geometry *geometry)
{
    for (int d = 0; d < 3; d++)
        if (geometry->size[d] < 1 || !(geometry->spacing[d] > 0) || !isfinite(geometry->spacing[d])) return false;
    return true;
}

/* Voxels to add before and behind, so that voxels (edge to edge) hold the box. */
static void find_growth(const pliant_geometry *scan, const double *low, const double *high, double before[3],
                        double behind[3])
{
    for (int d = 0; d < 3; d++) before[d] = behind[d] = 0;
    for (int corner = 0; low && corner < 8; corner++) {
        double world[3], index[3];
        for (int d = 0; d < 3; d++) world[d] = (corner >> d & 1 ? high : low)[d];
        pliant_geometry_to_index(scan, world, index);
        for (int d = 0; d < 3; d++) {
            before[d] = fmax(before[d], ceil(-0.5 - index[d] - slack));
            behind[d] = fmax(behind[d], ceil(index[d] - (scan->size[d] - 0.5) - slack));
        }
    }
}

pliant_status pliant_warp_target(const pliant_geometry *scan, const double *low, const double *high, size_t max_voxels,
                                 pliant_geometry *out)
{
    if (!usable(scan))
        return pliant_fail(PLIANT_ERROR_ARGUMENT, "the scan of a warp target has no voxels or no spacing");
    if (!low != !high)
        return pliant_fail(PLIANT_ERROR_ARGUMENT, "a box for the warp target needs both corners, or none");
    for (int d = 0; low && d < 3; d++)
        if (!isfinite(low[d]) || !isfinite(high[d]) || low[d] > high[d])
            return pliant_fail(PLIANT_ERROR_ARGUMENT,
                               "the box for the warp target must be finite and low <= high, not [%g, %g] along axis %d",
                               low[d], high[d], d);
    double before[3], behind[3], size[3], voxels = 1;
    find_growth(scan, low, high, before, behind);
    for (int d = 0; d < 3; d++) voxels *= size[d] = before[d] + scan->size[d] + behind[d];
    if (!(voxels <= (double)max_voxels) || !(fmax(size[0], fmax(size[1], size[2])) <= INT32_MAX))
        return pliant_fail(PLIANT_ERROR_ARGUMENT,
                           "the warp target would have %.0f x %.0f x %.0f voxels, more than can be held: a smaller margin or a coarser scan is needed",
                           size[0], size[1], size[2]);
    pliant_geometry target = *scan;
    pliant_geometry_to_world(scan, (const double[3]){-before[0], -before[1], -before[2]}, target.origin);
    for (int d = 0; d < 3; d++) target.size[d] = (int32_t)size[d];
    /* not grown on this side: the origin stays as it is, to the bit */
    if (before[0] == 0 && before[1] == 0 && before[2] == 0)
        for (int d = 0; d < 3; d++) target.origin[d] = scan->origin[d];
    *out = target;
    return PLIANT_OK;
}
