/* Internal functions of the deformed volume, in addition to pliant/warp.h. */
#ifndef PLIANT_WARP_WARP_H
#define PLIANT_WARP_WARP_H

#include "base/export.h"
#include "pliant/warp.h"

#ifdef __cplusplus
extern "C" {
#endif

/* Use a smooth fit through the nodes as the inverse map ([C] 5.3), instead of the tetrahedra's maps. The fit is a
 * moving least-squares fit of second order with a Gaussian kernel. It is computed every `step` voxels of the target and
 * interpolated trilinearly. Voxels become background if no tissue contains their rest position, or if they are more
 * than a voxel outside of every tetrahedron. Every update recomputes the whole volume, on the CPU until
 * pliant_warp_backend selects a backend. Within the kernel's reach of a cut, the CPU draws tetrahedra as without a fit.
 * Errors (the warp is unchanged): ARGUMENT (step below 1), MEMORY. */
PLIANT_INTERNAL pliant_status pliant_warp_fit(pliant_warp *warp, int32_t step);
/* The step of warp/kind: fit, in voxels. */
enum { PLIANT_FIT_STEP = 4 };

/* Give each voxel the value of the scan's nearest voxel instead of an interpolated value, for labels. The CPU does the
 * updates until pliant_warp_backend selects a backend.
 * Errors (the warp is unchanged): ARGUMENT (not UINT8, or a fit). */
pliant_status pliant_warp_nearest(pliant_warp *warp);

/* Return the times of the last update's stages [s]. cull: boxes, change detection and lists; rasterize: voxels. With a
 * fit: the map, and the voxels. */
PLIANT_INTERNAL void pliant_warp_seconds(const pliant_warp *warp, double *cull, double *rasterize);

#ifdef __cplusplus
}
#endif
#endif
