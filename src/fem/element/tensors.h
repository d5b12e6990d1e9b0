/* Stress, strain and shape of elements, for mesh files. */
#ifndef PLIANT_FEM_ELEMENT_TENSORS_H
#define PLIANT_FEM_ELEMENT_TENSORS_H

#include "model_data/model.h"

#ifdef __cplusplus
extern "C" {
#endif

/* Compute Cauchy stress [Pa, world axes] and Green-Lagrange strain [axes at rest] of every fine tetrahedron. A
 * tetrahedron that is part of a hexahedron has the hexahedron's deformation. Quasi-static methods have linear
 * elasticity in the element's rotated axes. A tetrahedron that is partly tissue has the stress in its tissue. stress,
 * strain: (fine.num_tets x 9) out. Errors: MEMORY. */
pliant_status pliant_tet_tensors(const pliant_model *model, const pliant_body *body, const double *positions,
                                 float *stress, float *strain);

enum { PLIANT_IS_TETRAHEDRON = -1, PLIANT_IN_HEXAHEDRON = -2 };
/* Find the hexahedra (element/kind hexahedra). The first tetrahedron of a hexahedron gets its eight nodes in VTK's
 * order, the other four get PLIANT_IN_HEXAHEDRON as first number. All others get PLIANT_IS_TETRAHEDRON. out:
 * (fine.num_tets x 8). Errors: MEMORY. */
pliant_status pliant_tet_hexahedra(const pliant_model *model, const pliant_body *body, int32_t (*out)[8]);

#ifdef __cplusplus
}
#endif
#endif
