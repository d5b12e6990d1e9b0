/* The deformed volume: what the library needs beyond pliant/warp.h. */
#ifndef PLIANT_WARP_WARP_H
#define PLIANT_WARP_WARP_H

#include "base/export.h"
#include "pliant/warp.h"

#ifdef __cplusplus
extern "C" {
#endif

/* From now on the inverse map is not that of tetrahedra but a smooth fit through the nodes ([C] 5.3): moving least squares of second order
 *  with a Gaussian kernel, every `step` voxels of the target and trilinear in between. Voxels whose rest position no tissue holds get the
 *  background, and so do those more than a voxel outside every tetrahedron. Every update redoes all; on the CPU until
 *  pliant_warp_backend says who does it. Within the kernel's reach of what is cut tetrahedra draw as without a fit, on the CPU. Errors (as it was before): ARGUMENT (step below 1), MEMORY. */
PLIANT_INTERNAL pliant_status pliant_warp_fit(pliant_warp *warp, int32_t step);

/* From now on every voxel has the value of the scan's nearest one in place of an interpolated one: for labels. On the CPU until
 *  pliant_warp_backend says who does the updates. Errors (as it was before): ARGUMENT (not UINT8, or a fit). */
pliant_status pliant_warp_nearest(pliant_warp *warp);

/* Seconds of the last update, by stage: cull (boxes, change detection, lists), rasterize; of a fit: the map, the voxels. */
PLIANT_INTERNAL void pliant_warp_seconds(const pliant_warp *warp, double *cull, double *rasterize);

#ifdef __cplusplus
}
#endif
#endif
