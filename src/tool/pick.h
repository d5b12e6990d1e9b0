/* Internal functions of picking, in addition to pliant/pick.h. */
#ifndef PLIANT_TOOL_PICK_H
#define PLIANT_TOOL_PICK_H

#include "pliant/pick.h"

#ifdef __cplusplus
extern "C" {
#endif

/* Find the first point on a ray with tissue and with an interpolated value at or above the threshold. The interpolation
 * is trilinear. A ray that starts in such tissue hits at its start, as in the picture. With a threshold below all
 * values, the result is the first tissue. The search uses steps of half a voxel and then bisection to 1e-4 voxels, so
 * it may miss smaller features.
 *   @param volume    the deformed volume (pliant_warp_volume), or the scan for a mesh at rest
 *   @param positions (mesh->num_nodes x 3) LPS [m]
 *   @param threshold value, slope and intercept applied
 * Errors: ARGUMENT (a number of the ray or the threshold is not finite, no direction). */
pliant_status pliant_pick(const pliant_volume *volume, const pliant_mesh *mesh, const double *positions,
                          const pliant_ray *ray, double threshold, pliant_picked *out);

/* Pick in the last update of a warp. If a GPU has drawn it, the GPU follows the ray without a copy of the volume to the
 * host. The result is bitwise identical. If the GPU fails, the CPU picks in the fetched volume, and a log line reports
 * it.
 *   @param positions (num_nodes x 3) LPS [m] of the warp's last update
 * Errors: as pliant_pick. */
pliant_status pliant_pick_warped(const pliant_warp *warp, const double *positions, const pliant_ray *ray,
                                 double threshold, pliant_picked *out);

#ifdef __cplusplus
}
#endif
#endif
