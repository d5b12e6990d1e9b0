/** @file warp.h
 *  The deformed volume from the positions of the fine nodes ([H] 2.4).
 *
 *  Fine tetrahedra are rasterized into a target grid. Inside a tetrahedron, the map to the rest position is affine, and
 *  the scan is sampled trilinearly in its own type. Each voxel is written by exactly one tetrahedron: the lowest index
 *  among all tetrahedra around its centre. All other voxels have the background, also where nothing moves (see
 *  mesh/keep_air). At rest, the result equals the scan exactly inside the tissue; after a shift by whole voxels, it
 *  equals the shifted scan.
 *
 *  A simulation makes its own warp with pliant_data_set_warp. Create one here to draw other positions.
 */
#ifndef PLIANT_WARP_H
#define PLIANT_WARP_H

#include "pliant/body.h"
#include "pliant/scene.h"

#ifdef __cplusplus
extern "C" {
#endif

enum { PLIANT_BRICK_SIZE = 16 /**< voxels along each edge of a brick; bricks at the end of an axis may be smaller */ };

typedef struct pliant_warp pliant_warp; /**< opaque: the target volume, and the data for incremental updates */

/** Compute a target grid: the scan's grid, extended by whole voxels along its axes until it contains all points and a
 *  margin.
 *  @param scan       Grid of the scan.
 *  @param points     (num_points x 3) LPS [m]; Nullable if num_points is 0.
 *  @param num_points 0: the result is the scan's grid.
 *  @param margin     Distance around the points [m].
 *  @param max_voxels Largest allowed number of voxels.
 *  @param out        Out: the grid.
 *  @return Errors: ARGUMENT (more than max_voxels). */
PLIANT_API pliant_status pliant_warp_target(const pliant_geometry *scan, const double *points, int32_t num_points,
                                            double margin, size_t max_voxels, pliant_geometry *out);

/** Create a warp on the CPU.
 *  @param scan        Borrowed; must outlive the warp.
 *  @param mesh        Borrowed fine mesh; must outlive the warp, or live until pliant_warp_set_body.
 *  @param target      Any grid; its axes may differ from the scan's.
 *  @param num_threads 0: the number of cores.
 *  @param out         Out: free with pliant_warp_free.
 *  @return Errors: ARGUMENT, MEMORY. */
PLIANT_API pliant_status pliant_warp_create(const pliant_volume *scan, const pliant_mesh *mesh,
                                            const pliant_geometry *target, int num_threads, pliant_warp **out);

/** Free a warp.
 *  @param warp Nullable. */
PLIANT_API void pliant_warp_free(pliant_warp *warp);

/** Draw another body of the same load; the next update draws the difference. Where tissue is cut, each voxel has the
 *  value of the same side of the cut.
 *  @param warp Unchanged after an error.
 *  @param body Borrowed; must outlive the warp, or live until the next call.
 *  @return Errors: ARGUMENT, MEMORY. */
PLIANT_API pliant_status pliant_warp_set_body(pliant_warp *warp, const pliant_body *body);

/** Select the CPU or a GPU for updates; the next update draws everything. If a GPU fails later, the CPU continues and
 *  the log says so.
 *  @param warp   Unchanged after an error.
 *  @param choice Auto: a GPU if there is one. cuda: a GPU, or an error.
 *  @return Errors: UNAVAILABLE, MEMORY (with the missing size). */
PLIANT_API pliant_status pliant_warp_backend(pliant_warp *warp, pliant_backend_choice choice);

/** Update the volume where positions have changed. Inverted and flat tetrahedra draw nothing. Tissue outside of the
 *  target is cut off; the log says so once.
 *  @param warp      Unchanged after an error.
 *  @param positions (num_nodes x 3) LPS [m].
 *  @return Errors: ARGUMENT (a position is not finite), MEMORY. */
PLIANT_API pliant_status pliant_warp_update(pliant_warp *warp, const double *positions);

/** Return the deformed volume, with the encoding, slope, intercept and background of the scan. A GPU's changed voxels
 *  are copied to the host. If that fails, the volume of the last successful copy is returned, and the log says so.
 *  @param warp The warp.
 *  @return The volume, valid until the next update. */
PLIANT_API const pliant_volume *pliant_warp_volume(const pliant_warp *warp);

/** Return which bricks of the volume the last update may have changed.
 *  @param warp    The warp.
 *  @param count   (3) Out: number of bricks along i, j, k.
 *  @param changed Out: (bricks) 1 for a brick that may have changed, valid until the next update. */
PLIANT_API void pliant_warp_bricks(const pliant_warp *warp, int32_t count[3], const uint8_t **changed);

#ifdef __cplusplus
}
#endif
#endif
