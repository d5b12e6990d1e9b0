/* Internals of a hierarchy. hierarchy.c and hierarchy_fragments.c build it, and multigrid.c uses it. */
#ifndef PLIANT_FEM_LINEAR_HIERARCHY_H
#define PLIANT_FEM_LINEAR_HIERARCHY_H

#include "fem/linear/multigrid.h"

enum { PLIANT_MAX_LEVELS = 8 };

typedef struct pliant_grid_level {
    /* Level 0: a view of the model's system. Other levels: owned, with Galerkin products as elements. */
    pliant_system system;
    /* Owned. It is empty at level 0, except in a graded system, where its nodes are positions in the fine lattice. */
    pliant_mesh mesh;
    /* To the next coarser level; absent at the last level. */
    int corners;            /* corners of a coarse element: 4, or 8 for hexahedra */
    int32_t *parent;        /* (elements) coarse element; -1 for fragments that do not move */
    int32_t *child_start, *child; /* the inverse mapping */
    int32_t *to;            /* (num_free x corners) coarse unknown or -1 */
    float *weight;          /* (num_free x corners) barycentric or trilinear */
    int32_t *from_start, *from; /* by coarse unknown: corners * fine unknown + corner */
    /* The matrix by complete rows of 3 x 3 blocks. */
    int32_t *row_start;     /* (num_free + 1) */
    int32_t *column;
    int32_t *place;         /* (pattern.num_blocks x 2) index of a block and of its transpose; -1: on the diagonal */
} pliant_grid_level;

struct pliant_hierarchy {
    int32_t holders;        /* reference count, changed atomically */
    int num_levels;
    pliant_grid_level level[PLIANT_MAX_LEVELS];
    pliant_factor *factor;  /* symbolic factor of the coarsest level */
};

/* Return the number of elements of a level: hexahedra with adjacent tetrahedra, or tetrahedra alone. */
static inline int32_t pliant_level_elements(const pliant_system *system)
{
    return system->macros ? system->macros->count : system->mesh->num_tets;
}

/* ---- Implemented in interpolation.c. */
/* Compute the weights of a finer node in a coarse element: out (corners). Return false, with zero weights, if the node
 * is outside of the cube. */
bool pliant_coarse_weights(const pliant_system *fine, const pliant_system *coarse, int32_t node, int32_t element,
                           double *out);
/* Return the cube of the coarser lattice that contains a cell of the finer lattice. */
int32_t pliant_coarse_cell(const pliant_mesh *fine, const pliant_mesh *coarse, int32_t cell);

/* ---- Implemented in hierarchy_fragments.c: levels whose elements are fragments. */
/* Build the mesh of a graded system's first level: positions in the fine lattice. Errors: MEMORY. */
pliant_status pliant_nested_places(pliant_grid_level *level);
/* Build elements and nodes of the next level in a lattice of so many cells, without unknowns, and the parents. Errors:
 * MEMORY. */
pliant_status pliant_nested_elements(const pliant_system *fine, const int32_t cells[3], pliant_grid_level *level,
                                     pliant_grid_level *next);

#endif
