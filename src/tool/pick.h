/* Picking: what the library needs beyond pliant/pick.h. */
#ifndef PLIANT_TOOL_PICK_H
#define PLIANT_TOOL_PICK_H

#include "pliant/pick.h"

#ifdef __cplusplus
extern "C" {
#endif

/* Find the first point along the ray where the volume, interpolated trilinearly, is not below the threshold and where there
 *  is tissue. A ray that starts in tissue above the threshold hits right there, as it is drawn. With a threshold below all values
 *  that is the first tissue.
 *  Steps of half a voxel, then bisection to 1e-4 voxels; features thinner than a step may be missed.
 *  @param volume    the deformed volume (pliant_warp_volume), or the scan for a mesh at rest
 *  @param positions (mesh->num_nodes x 3) LPS [m]
 *  @param threshold value, slope and intercept applied
 *  Errors: ARGUMENT (a number of the ray or the threshold that is not finite, no direction). */
pliant_status pliant_pick(const pliant_volume *volume, const pliant_mesh *mesh, const double *positions, const pliant_ray *ray,
                                     double threshold, pliant_picked *out);

/* The same in what a warp has drawn last. Where a GPU has drawn it the ray is followed there, and no volume comes to the host:
 *  the result is the same, bit for bit. Should the GPU fail, the volume is fetched and the CPU picks, with a line in the log.
 *  @param positions (num_nodes x 3) LPS [m], those of the warp's last update
 *  Errors: as pliant_pick. */
pliant_status pliant_pick_warped(const pliant_warp *warp, const double *positions, const pliant_ray *ray, double threshold,
                                            pliant_picked *out);

#ifdef __cplusplus
}
#endif
#endif
