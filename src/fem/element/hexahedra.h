/* Whole cubes of a lattice, which are hexahedra (hexahedra.c): for explicit dynamics. */
#ifndef PLIANT_FEM_ELEMENT_HEXAHEDRA_H
#define PLIANT_FEM_ELEMENT_HEXAHEDRA_H

#include "state/model.h"

#ifdef __cplusplus
extern "C" {
#endif

/* nodes by the bits of their corners, and tetrahedra by slot */
typedef struct pliant_cube {
    int32_t tet[5], node[8];
} pliant_cube;

/* Cubes whose five tetrahedra meet at eight nodes, and that are boxes, ascending: *out (*count). Errors: MEMORY. */
pliant_status pliant_cubes_find(const pliant_mesh *mesh, pliant_cube **out, int32_t *count);
/* Moduli of its tetrahedra: what is without tissue keeps a small part of what the others have. */
void pliant_cube_moduli(const pliant_cube *cube, const double volume[5], const pliant_tet_material *material, double lambda[5], double mu[5]);

#ifdef __cplusplus
}
#endif

#endif
