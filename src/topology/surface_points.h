/* Collect the points of a surface for output files. */
#ifndef PLIANT_TOPOLOGY_SURFACE_POINTS_H
#define PLIANT_TOPOLOGY_SURFACE_POINTS_H

#include "topology/visible_surface.h"

/* Nodes of the fine mesh, followed by the surface's additional vertices. */
typedef struct surface_points {
    size_t count;
    int32_t *row;              /* (count) row in the file; -1: not in the file */
    int32_t num_rows;
    double *at, *rest, *value; /* (count x 3), (count x 3), (count x values) */
    uint16_t *material;        /* (count) */
} surface_points;

/* Collect the points.
 * values: (num_values x fine.num_nodes) consecutive arrays; NULL: no values
 * out: zeroed by the caller; must be freed even after an error
 * Errors: MEMORY. */
pliant_status pliant_surface_points_find(const pliant_surface *surface, const double *positions, int num_values,
                                         const float *values, surface_points *out);
void pliant_surface_points_free(surface_points *points);

#endif
