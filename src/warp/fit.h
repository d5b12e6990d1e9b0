/* Warp by moving least squares ([C] 5.3): a smooth inverse map through the nodes instead of one affine map per
 * tetrahedron. */
#ifndef PLIANT_WARP_FIT_H
#define PLIANT_WARP_FIT_H

#include "warp/fit_point.h"
#include "warp/parts.h"

#ifdef __cplusplus
extern "C" {
#endif

typedef struct pliant_fit pliant_fit;

/* Create a moving-least-squares fit ([C] 12). Around a point p of the target, a second-order polynomial of the deformed
 * positions x fits the rest positions X of nearby nodes, with Gaussian weights of |x - p|. Its value at p is the rest
 * position of p. Any second-order polynomial map is reproduced exactly.
 * @param rest (num_nodes x 3) continuous index in the scan; borrowed
 * @param step distance between fits along each axis in target voxels; trilinear interpolation in between
 * Errors: ARGUMENT, MEMORY. */
pliant_status pliant_fit_create(const pliant_mesh *mesh, const pliant_geometry *scan, const double *rest,
                                const pliant_geometry *target, int32_t step, int num_threads, pliant_fit **out);
void pliant_fit_free(pliant_fit *fit); /* Nullable */
/* Create the same fit for the next body. Within the kernel's reach of a cut, nodes on the other side must not
 * contribute. Elements (parts.h) there are drawn by their own affine maps. A blend that is continuous across faces
 * connects them to the fit.
 * @param rest, parts borrowed; parts Nullable: no cuts
 * Errors: MEMORY. */
pliant_status pliant_fit_next(const pliant_fit *fit, const pliant_body *body, const pliant_parts *parts,
                              const double *rest, pliant_fit **out);
/* Return (elements) whether each is drawn by its own map, completely or blended; NULL: none is. */
const uint8_t *pliant_fit_zone(const pliant_fit *fit);

/* Compute the map for positions (num_nodes x 3, LPS). Allocates no memory. */
void pliant_fit_map(pliant_fit *fit, const double *positions);
/* Return the host data of the fit, for backends. */
const fit_view *pliant_fit_parts(const pliant_fit *fit);
/* Draw a brick in which elements of the zone own some voxels (raster_brick, all_masked). Return whether a voxel has
 * changed. */
bool pliant_fit_draw_brick(const pliant_fit *fit, const raster_source *source, const raster_tet *tets,
                           const int32_t brick[3], const raster_brick *owned, void *voxels);
/* Draw the target's voxels from the map.
 * changed: output, (bricks) 1 if a voxel has changed, otherwise 0 */
void pliant_fit_draw(const pliant_fit *fit, const raster_source *source, const int32_t bricks[3], void *voxels,
                     uint8_t *changed);

#ifdef __cplusplus
}
#endif

#endif
