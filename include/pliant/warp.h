/** @file warp.h
 *  From the positions of the fine nodes to the deformed volume ([H] 2.4).
 *
 *  Fine tetrahedra are rasterized into a target grid; inside one, the map back to rest is affine, and the original
 *  scan is sampled trilinearly in its own type. Every voxel is written by exactly one tetrahedron: the one with
 *  the lowest index of those that hold its centre. Voxels that no tetrahedron holds get the background, also where
 *  nothing moved: of the scan only what the mesh holds is drawn (mesh/keep_air).
 *  At rest the result equals the scan bit for bit inside the tissue; so does a shift by whole voxels.
 */
#ifndef PLIANT_WARP_H
#define PLIANT_WARP_H

#include "pliant/body.h"
#include "pliant/scene.h"

#ifdef __cplusplus
extern "C" {
#endif

enum { PLIANT_BRICK_SIZE = 16 }; /**< voxels along each edge of a brick; the last ones may be smaller */

typedef struct pliant_warp pliant_warp; /**< owns the target volume and what is needed to redo only what changed */

/** Target grid: the scan's, grown along its own axes by whole voxels so that it holds the points and a margin around them as well.
 *  @param points (num_points x 3) LPS [m]; none: the scan's grid itself
 *  @param margin [m]
 *  Errors: ARGUMENT when it would exceed max_voxels. */
PLIANT_API pliant_status pliant_warp_target(const pliant_geometry *scan, const double *points, int32_t num_points, double margin,
                                            size_t max_voxels, pliant_geometry *out);

/** @param scan   borrowed; must outlive the warp
 *  @param mesh   borrowed; fine mesh, must outlive the warp
 *  @param target any grid; its axes may differ from the scan's
 *  Errors: ARGUMENT, MEMORY. */
PLIANT_API pliant_status pliant_warp_create(const pliant_volume *scan, const pliant_mesh *mesh, const pliant_geometry *target,
                                            int num_threads, pliant_warp **out);
PLIANT_API void pliant_warp_free(pliant_warp *warp); /**< Nullable */

/** From now on this body is drawn, one of the same load as the mesh before: the next update redoes what differs. Where tissue is cut, every
 *  voxel is drawn where its own side of the cut is, from voxels of that side alone. Memory stays what the larger body needed.
 *  @param body borrowed; must outlive the warp, or the next call
 *  Errors (as it was before): ARGUMENT, MEMORY. */
PLIANT_API pliant_status pliant_warp_set_body(pliant_warp *warp, const pliant_body *body);

/** Who does the updates from now on (the CPU at first): auto: a GPU if one can be used; cuda: a GPU, or an error. When a GPU
 *  fails later, the CPU goes on, with a line in the log. The next update redoes everything.
 *  Errors (as it was before): UNAVAILABLE, MEMORY (with figures). */
PLIANT_API pliant_status pliant_warp_backend(pliant_warp *warp, pliant_backend_choice choice);

/** Redo what the new positions change. Non-finite positions are refused (ARGUMENT) and change nothing.
 *  A tetrahedron that is inverted or flat draws nothing. Tissue that leaves the target is cut off, with a line in the log the first time.
 *  @param positions (num_nodes x 3) LPS [m] */
PLIANT_API pliant_status pliant_warp_update(pliant_warp *warp, const double *positions);

/** The deformed volume: same encoding, slope, intercept and background as the scan. Valid until the next update. What a GPU
 *  has drawn is copied to the host now, where it changed since the last call. */
PLIANT_API const pliant_volume *pliant_warp_volume(const pliant_warp *warp);

/** Bricks along i, j, k, and for every brick whether a voxel of it may have changed in the last update. */
PLIANT_API void pliant_warp_bricks(const pliant_warp *warp, int32_t count[3], const uint8_t **changed);

#ifdef __cplusplus
}
#endif
#endif
