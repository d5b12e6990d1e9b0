/* Find the voxels near cut faces. */
#ifndef PLIANT_WARP_NEAR_CUT_H
#define PLIANT_WARP_NEAR_CUT_H

#include "pliant/scan.h"
#include "topology/visible_surface.h"

/* Set the mask to value at every voxel whose centre is at most `distance` voxels along each axis from a cut face.
 * positions: (fine.num_nodes x 3) of the surface's body
 * mask: (voxels of the grid)
 * Errors: MEMORY. */
pliant_status pliant_near_cut_mark(const pliant_surface *surface, const double *positions, const pliant_geometry *grid,
                                   double distance, uint8_t *mask, uint8_t value);

#endif
