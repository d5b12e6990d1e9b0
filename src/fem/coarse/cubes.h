/* What the files that make coarse hexahedra share (cubes.c, cubes_schur.c). */
#ifndef PLIANT_FEM_COARSE_CUBES_H
#define PLIANT_FEM_COARSE_CUBES_H

#include "fem/coarse/shapes.h"

#ifdef __cplusplus
extern "C" {
#endif

typedef struct pliant_cube_work {
    pliant_system *system;
    const pliant_tet_material *material;
    const uint8_t *fixed;            /* (fine nodes) */
    int32_t *element_of_tet;         /* (coarse tetrahedra) */
    int32_t *element_of_fine;        /* (fine tetrahedra) */
    int32_t *tet_of_element;         /* (elements) a coarse tetrahedron of it */
    pliant_cube *cubes;              /* whole ones of the fine mesh */
    int32_t *cube_of_tet;            /* (fine tetrahedra) or -1 */
    pliant_cube_shape *shapes;       /* (2) by parity */
    pliant_submesh_lists lists;      /* fine tetrahedra by element */
    bool calibrated;                 /* where that is possible */
    pliant_shapes *schur;            /* Nullable: (elements) method schur: the shape functions */
    int32_t linear;                  /* elements that fall apart */
} pliant_cube_work;

/* what a thread needs besides its submesh */
typedef struct pliant_cube_room {
    double *weights;  /* (nodes x 8) P */
    double *local;    /* (nodes x 3) in [-1, 1] along the lattice */
    int32_t nodes;
} pliant_cube_room;

/* the hexahedron of a fine tetrahedron, once for its five: NULL elsewhere; *alone: it is in none */
static inline const pliant_cube *pliant_cube_at(const pliant_submesh *submesh, int32_t tet, bool *alone)
{
    int32_t cube = submesh->cube_of_tet[tet];
    *alone = cube < 0;
    return *alone || submesh->cubes[cube].tet[0] != tet ? NULL : submesh->cubes + cube;
}

/* ---- cube_galerkin.c */
/* P'KP of its submesh by the room's weights, with one change of volume in all: out (24 x 24) */
void pliant_cube_galerkin(const pliant_submesh *submesh, const pliant_cube_room *room, double *out);
/* Errors: MEMORY. */
pliant_status pliant_cube_keep_root(pliant_macros *macros, int32_t element, int32_t unknowns, int32_t rank, const double *root);

/* ---- cubes_schur.c: condensed on the corners, [H] 1 to 7, as tetrahedra are (homogenize.c) */
/* Lists of the fine elements of each coarse one, and whether some of their nodes are fixed; hexahedra have whole fine
 * ones. Errors: MEMORY. */
pliant_status pliant_cubes_schur_begin(pliant_cube_work *work, pliant_touch touch);
/* One whose submesh is loaded, and its room filled where it is a hexahedron. Errors: MEMORY, NUMERIC. */
pliant_status pliant_cubes_schur(pliant_cube_work *work, pliant_submesh *submesh, pliant_cube_room *room, int32_t element);

#ifdef __cplusplus
}
#endif

#endif
