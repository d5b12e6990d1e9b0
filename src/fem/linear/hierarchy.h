/* Inside a hierarchy: for hierarchy.c and nested.c, which make it, and multigrid.c, which uses it. */
#ifndef PLIANT_FEM_LINEAR_HIERARCHY_H
#define PLIANT_FEM_LINEAR_HIERARCHY_H

#include "fem/linear/multigrid.h"

enum { PLIANT_MAX_LEVELS = 8 };

typedef struct pliant_grid_level {
    pliant_system system;   /* level 0: a view of the model's; else owned, without elements: Galerkin products fill them in */
    pliant_mesh mesh;       /* owned; empty at level 0, but of a graded system where its nodes lie in the fine lattice */
    /* to the next coarser level; absent at the last */
    int corners;            /* of a coarse element: 4, of hexahedra 8 */
    int32_t *parent;        /* (elements) coarse element; of fragments that do not move -1 */
    int32_t *child_start, *child; /* the other way round */
    int32_t *to;            /* (num_free x corners) coarse unknown or -1 */
    float *weight;          /* (num_free x corners) barycentric or trilinear */
    int32_t *from_start, *from; /* by coarse unknown: corners * fine unknown + corner */
    /* the matrix by full rows of 3 x 3 blocks */
    int32_t *row_start;     /* (num_free + 1) */
    int32_t *column;
    int32_t *place;         /* (pattern.num_blocks x 2) where a block and its transpose stand; -1: on the diagonal */
} pliant_grid_level;

struct pliant_hierarchy {
    int32_t holders;        /* changed atomically */
    int num_levels;
    pliant_grid_level level[PLIANT_MAX_LEVELS];
    pliant_factor *factor;  /* symbolic, of the coarsest */
};

/* elements of a level: hexahedra and the tetrahedra beside them, or tetrahedra alone */
static inline int32_t pliant_level_elements(const pliant_system *system)
{
    return system->macros ? system->macros->count : system->mesh->num_tets;
}

/* ---- interpolation.c */
/* What a node of the finer level takes from the corners of a coarse element that holds it: out (corners); false, and
 * nothing: it lies outside of the cube. */
bool pliant_level_weights(const pliant_system *fine, const pliant_system *coarse, int32_t node, int32_t element, double *out);
/* cube of the coarser lattice that a cell of the finer one lies in */
int32_t pliant_coarse_cell(const pliant_mesh *fine, const pliant_mesh *coarse, int32_t cell);

/* ---- nested.c: where elements are fragments */
/* A mesh for the first level of a graded system: places in the fine lattice. Errors: MEMORY. */
pliant_status pliant_nested_places(pliant_grid_level *level);
/* Elements and nodes of the next level, in a lattice of so many cells, without unknowns; and who is whose parent.
 * Errors: MEMORY. */
pliant_status pliant_nested_elements(const pliant_system *fine, const int32_t cells[3], pliant_grid_level *level, pliant_grid_level *next);

#endif
