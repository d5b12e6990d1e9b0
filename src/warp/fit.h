/* Warp by fitting ([C] 5.3): a smooth inverse map through the nodes instead of one affine map a tetrahedron. */
#ifndef PLIANT_WARP_FIT_H
#define PLIANT_WARP_FIT_H

#include "warp/fit_point.h"
#include "warp/parts.h"

#ifdef __cplusplus
extern "C" {
#endif

typedef struct pliant_fit pliant_fit;

/* Moving least squares ([C] 12): at a point p of the target the rest positions X of the nodes around it, as a polynomial of second order of
 * where they are now, x, weighted by a Gaussian of |x - p|; its value at p is where p was at rest. Any map that is a polynomial of second
 * order is met exactly.
 *  @param rest (num_nodes x 3) continuous index in the scan; borrowed
 *  @param step voxels of the target between two fits along each axis; trilinear in between
 *  Errors: ARGUMENT, MEMORY. */
pliant_status pliant_fit_create(const pliant_mesh *mesh, const pliant_geometry *scan, const double *rest, const pliant_geometry *target,
                                int32_t step, int num_threads, pliant_fit **out);
void pliant_fit_free(pliant_fit *fit); /* Nullable */
/* The same fit of the next body. Where tissue is cut, nodes on the other side are no neighbours: within the kernel's reach of what is cut,
 * elements (parts.h) are drawn by their own affine maps, and from there to the fit by a blend that is continuous across faces.
 *  @param rest, parts borrowed; parts Nullable: nothing is cut. Errors: MEMORY. */
pliant_status pliant_fit_next(const pliant_fit *fit, const pliant_body *body, const pliant_parts *parts, const double *rest, pliant_fit **out);
/* (elements) whether each is drawn by its own map, wholly or partly; NULL: none is */
const uint8_t *pliant_fit_zone(const pliant_fit *fit);

/* The map for these positions (num_nodes x 3, LPS); needs no more memory. */
void pliant_fit_map(pliant_fit *fit, const double *positions);
/* Where a point of the target (continuous index) was: index in the scan; false: too far from any node. */
bool pliant_fit_at(const pliant_fit *fit, const double target[3], double scan[3]);
/* For backends: what it works with, on the host. */
const fit_view *pliant_fit_parts(const pliant_fit *fit);
/* One brick, of which the zone's elements own some voxels (raster_brick, all_masked); true when a voxel is another than before. */
bool pliant_fit_draw_brick(const pliant_fit *fit, const raster_source *source, const raster_tet *tets, const int32_t brick[3],
                           const raster_brick *owned, void *voxels);
/* Voxels of the target from the map; changed (bricks): 1 where a voxel is another than before, else 0. */
void pliant_fit_draw(const pliant_fit *fit, const raster_source *source, const int32_t bricks[3], void *voxels, uint8_t *changed);

#ifdef __cplusplus
}
#endif

#endif
