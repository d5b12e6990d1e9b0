/* Work data for building coarse hexahedra, shared by cubes.c and cubes_schur.c. */
#ifndef PLIANT_FEM_COARSE_CUBES_H
#define PLIANT_FEM_COARSE_CUBES_H

#include "fem/coarse/shape_functions.h"

typedef struct pliant_cube_work {
    pliant_system *system;
    const pliant_tet_material *material;
    const uint8_t *fixed;            /* (fine nodes) */
    int32_t *element_of_tet;         /* (coarse tetrahedra) */
    int32_t *element_of_fine;        /* (fine tetrahedra) */
    int32_t *tet_of_element;         /* (elements) a coarse tetrahedron of it */
    pliant_cube *cubes;              /* complete cubes of the fine mesh */
    int32_t *cube_of_tet;            /* (fine tetrahedra) or -1 */
    pliant_cube_shape *shapes;       /* (2) by parity */
    pliant_submesh_lists lists;      /* fine tetrahedra by element */
    pliant_shapes *schur;            /* Nullable: (elements) shape functions; method schur only */
    int32_t linear;                  /* number of disconnected elements */
} pliant_cube_work;

/* Work arrays of one thread, in addition to its submesh. */
typedef struct pliant_cube_buffers {
    double *weights;  /* (nodes x 8) P */
    double *local;    /* (nodes x 3) in [-1, 1] along the lattice */
    int32_t nodes;
} pliant_cube_buffers;

/* Return the hexahedron of a fine tetrahedron for the first of its five tetrahedra, and NULL for the others. *alone:
 * the tetrahedron is in no hexahedron. */
static inline const pliant_cube *pliant_cube_at(const pliant_submesh *submesh, int32_t tet, bool *alone)
{
    int32_t cube = submesh->cube_of_tet[tet];
    *alone = cube < 0;
    return *alone || submesh->cubes[cube].tet[0] != tet ? NULL : submesh->cubes + cube;
}

/* ---- Implemented in cube_galerkin.c. */
/* Compute P'KP of the submesh with the weights in `buffers`, with one change of volume for the whole cube. out: (24 x
 * 24). */
void pliant_cube_galerkin(const pliant_submesh *submesh, const pliant_cube_buffers *buffers, double *out);
/* Errors: MEMORY. */
pliant_status pliant_cube_keep_root(pliant_macros *macros, int32_t element, int32_t unknowns, int32_t rank,
                                    const double *root);

/* ---- Implemented in cubes_schur.c: condensation on the corners, [H] 1 to 7, as for tetrahedra (homogenize.c). */
/* List the fine elements of each coarse element, and flag elements with fixed nodes. Lists of hexahedra contain
 * complete fine hexahedra. Errors: MEMORY. */
pliant_status pliant_cubes_schur_begin(pliant_cube_work *work, pliant_submesh_extent extent);
/* Condense one element. Its submesh is loaded, and for a hexahedron `buffers` is filled. Errors: MEMORY, NUMERIC. */
pliant_status pliant_cubes_schur(pliant_cube_work *work, pliant_submesh *submesh, pliant_cube_buffers *buffers,
                                 int32_t element);

#endif
