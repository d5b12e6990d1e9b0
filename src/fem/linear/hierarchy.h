/* Inside a hierarchy: for hierarchy.c and galerkin.c, which make it, and multigrid.c, which uses it.
 *
 * All levels are matrices of 3 x 3 blocks. Nodes of a level are gathered in aggregates (aggregate.h) that move as rigid bodies: aggregate
 * a has two nodes on the next level, 2 a for how it moves (t) and 2 a + 1 for how it turns (w). A node at the arm d from its aggregate's
 * centre follows by t + w x d, one that itself says how something turns by w. Rigid motions, and so bending of what is thin, pass through
 * all levels (rigid-body modes: Vanek, Mandel and Brezina 1996; Griebel, Oeltz and Schweitzer 2003). */
#ifndef PLIANT_FEM_LINEAR_HIERARCHY_H
#define PLIANT_FEM_LINEAR_HIERARCHY_H

#include "fem/linear/multigrid.h"

#ifdef __cplusplus
extern "C" {
#endif

enum { PLIANT_MAX_LEVELS = 8 };

typedef struct pliant_grid_level {
    pliant_pattern pattern;   /* of the lower triangle; the system's own at level 0, without terms below it */
    int32_t *block_column;    /* (pattern.num_blocks) */
    /* to the next coarser level; absent at the last */
    int32_t num_aggregates;
    int32_t *aggregate;       /* (num_columns) */
    int32_t *member_start, *member; /* the other way round */
    pliant_pattern pairs;     /* of aggregates; terms: 2 * block of this level + (1: transposed) */
    /* the matrix by full rows of 3 x 3 blocks; absent at the last */
    int32_t *row_start;       /* (num_columns + 1) */
    int32_t *column;
    int32_t *place;           /* (pattern.num_blocks x 2) where a block and its transpose stand; -1: on the diagonal */
} pliant_grid_level;

struct pliant_hierarchy {
    pliant_system system;     /* view of the model's */
    int num_levels;
    pliant_grid_level level[PLIANT_MAX_LEVELS];
    double length;            /* an edge of the mesh [m] */
    pliant_factor *factor;    /* symbolic, of the coarsest */
};

/* whether a node of a level says how something turns */
static inline bool pliant_level_turns(int level, int32_t node) { return level > 0 && node % 2 == 1; }

/* ---- galerkin.c: numbers of levels from those of the level above */
/* blocks (pattern.num_blocks x 9) of the finest level */
void pliant_galerkin_finest(const pliant_system *system, const pliant_tangent *tangents, double *blocks);
/* Centres of aggregates and arms of nodes (num_columns x 3), from the places of what moves: those of level 0, the centres of the level
 * above below it. place: (nodes that move x 3), centre: (num_aggregates x 3) */
void pliant_galerkin_arms(const pliant_hierarchy *hierarchy, int level, const double *place, double *centre, double *arm);
/* P' K P: blocks of the next level */
void pliant_galerkin_product(const pliant_hierarchy *hierarchy, int level, const double *blocks, const double *arm, int num_threads, double *coarse);

#ifdef __cplusplus
}
#endif
#endif
