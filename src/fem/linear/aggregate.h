/* Nodes of a matrix gathered where it couples them strongly: smoothed aggregation's aggregates (Vanek, Mandel and Brezina 1996,
 * Algebraic multigrid by smoothed aggregation for second and fourth order elliptic problems, algorithm 5.1). Air and tissue, the two
 * sides of a cut or of a fold do not share one. */
#ifndef PLIANT_FEM_LINEAR_AGGREGATE_H
#define PLIANT_FEM_LINEAR_AGGREGATE_H

#include "fem/system.h"

#ifdef __cplusplus
extern "C" {
#endif

/* Neighbours of every vertex of a graph, with how strongly it is tied to them: |K_ij| / sqrt(|K_ii| |K_jj|), Frobenius. */
typedef struct pliant_ties {
    int32_t count;
    int32_t *start;    /* (count + 1) */
    int32_t *neighbour;
    float *strength;
} pliant_ties;

/* Of the blocks (num_blocks x 9) of a pattern; stride 2 takes every second node only, those that say how aggregates move. Errors: MEMORY. */
pliant_status pliant_ties_create(const pliant_pattern *pattern, const double *blocks, int32_t stride, pliant_ties *out);
void pliant_ties_free(pliant_ties *ties);

/* Ties below `least` do not bind. of: (count) aggregate of every vertex; returns how many there are. */
int32_t pliant_aggregate(const pliant_ties *ties, float least, int32_t *of);

#ifdef __cplusplus
}
#endif
#endif
