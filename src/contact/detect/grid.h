/* Tetrahedra in the cells of a regular grid, by their deformed boxes ([C] 5.2 assigns them by their corners alone, and misses the cells between
 * those of large ones), and which of them overlap. */
#ifndef PLIANT_CONTACT_GRID_H
#define PLIANT_CONTACT_GRID_H

#include "pliant/status.h"

#include <stddef.h>
#include <stdint.h>

#ifdef __cplusplus
extern "C" {
#endif

enum { PLIANT_GRID_CHUNKS = 64 /* of cells, whose pairs are found by one thread */ };

/* of a tetrahedron; cell: the lowest one that it lies in */
typedef struct pliant_grid_box {
    double low[3], high[3];
    int32_t cell[3];
} pliant_grid_box;

typedef struct pliant_grid_pairs {
    int32_t count, room;
    int32_t *pair;             /* (count x 2) */
} pliant_grid_pairs;

/* Kept from step to step for its room. All zero: empty. */
typedef struct pliant_grid {
    int32_t count;
    const int32_t *tet;        /* (count) that are in it, borrowed */
    double low[3], side;       /* of the cells [m] */
    int32_t cells[3];
    pliant_grid_box *box;      /* (count) */
    int32_t *start;            /* (cells + 1) into item */
    int32_t *item;             /* indices into tet, ascending in every cell */
    int32_t box_room, start_room, item_room;
    pliant_grid_pairs found[PLIANT_GRID_CHUNKS];
} pliant_grid;

void pliant_grid_free(pliant_grid *grid); /* what it holds */

/* Assigns tetrahedra to cells. Those with a number that is none are left out.
 *  @param tets      (x 4) nodes
 *  @param positions (nodes x 3) [m]
 *  @param margin    boxes are larger by that on every side [m]
 *  Errors: MEMORY. */
pliant_status pliant_grid_fill(pliant_grid *grid, int32_t count, const int32_t *tet, const int32_t *tets, const double *positions, double margin,
                               int threads);

/* Pairs of tetrahedra that overlap, each once, lower first, without those that share a node; they are in found, the same and in the same order for
 * any number of threads. The arguments of pliant_grid_fill. Errors: MEMORY. */
pliant_status pliant_grid_overlaps(pliant_grid *grid, const int32_t *tets, const double *positions, int threads, int32_t *count);

/* Room for pairs that somebody else has found, in *pair, in place of those that were found last. Errors: MEMORY. */
pliant_status pliant_grid_take_pairs(pliant_grid *grid, int32_t count, int32_t **pair);

/* The cell of a point; -1: outside, or a number that is none. */
int64_t pliant_grid_cell(const pliant_grid *grid, const double point[3]);

#ifdef __cplusplus
}
#endif
#endif
