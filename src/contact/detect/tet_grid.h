/* Broad and narrow phase of tissue on tissue: tetrahedra in the cells of a regular grid, and the overlapping pairs.
 * Tetrahedra are assigned to cells by their deformed boxes. [C] 5.2 assigns them by their corners, which misses
 * cells inside large tetrahedra. */
#ifndef PLIANT_CONTACT_DETECT_TET_GRID_H
#define PLIANT_CONTACT_DETECT_TET_GRID_H

#include "pliant/status.h"

#include <stddef.h>
#include <stdint.h>

#ifdef __cplusplus
extern "C" {
#endif

enum { PLIANT_GRID_CHUNKS = 64 /* groups of cells; one thread finds the pairs of a group */ };

/* Box of a tetrahedron; cell: the lowest cell that it overlaps. */
typedef struct pliant_grid_box {
    double low[3], high[3];
    int32_t cell[3];
} pliant_grid_box;

typedef struct pliant_grid_pairs {
    int32_t count, capacity;
    int32_t *pair;             /* (count x 2) */
} pliant_grid_pairs;

/* The grid keeps its buffers from step to step. All zero: empty. */
typedef struct pliant_grid {
    int32_t count;
    const int32_t *tet;        /* (count) tetrahedra in the grid, borrowed */
    double low[3], side;       /* lowest corner and side of the cells [m] */
    int32_t cells[3];
    pliant_grid_box *box;      /* (count) */
    int32_t *start;            /* (cells + 1) offsets into item */
    int32_t *item;             /* indices into tet, ascending in each cell */
    int32_t box_capacity, start_capacity, item_capacity;
    pliant_grid_pairs found[PLIANT_GRID_CHUNKS];
} pliant_grid;

void pliant_grid_free(pliant_grid *grid); /* frees its contents */

/* Assign tetrahedra to cells. Tetrahedra with a position that is not finite are left out.
 * @param tets (tetrahedra x 4) nodes
 * @param positions (nodes x 3) [m]
 * @param margin enlarges boxes on every side [m]
 * Errors: MEMORY. */
pliant_status pliant_grid_fill(pliant_grid *grid, int32_t count, const int32_t *tet, const int32_t *tets,
                               const double *positions, double margin, int threads);

/* Find pairs of overlapping tetrahedra that share no node; each pair once, the lower number first. The pairs are in
 * grid->found. Their order does not depend on the number of threads. Arguments as in pliant_grid_fill. Errors:
 * MEMORY. */
pliant_status pliant_grid_overlaps(pliant_grid *grid, const int32_t *tets, const double *positions, int threads,
                                   int32_t *count);

/* Return in *pair a buffer for pairs that a GPU has found. They replace the last result. Errors: MEMORY. */
pliant_status pliant_grid_take_pairs(pliant_grid *grid, int32_t count, int32_t **pair);

/* Return the cell of a point; -1: outside, or not finite. */
int64_t pliant_grid_cell(const pliant_grid *grid, const double point[3]);

#ifdef __cplusplus
}
#endif
#endif
