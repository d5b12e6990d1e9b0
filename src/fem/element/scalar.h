/* Numbers at nodes and tetrahedra that follow from positions. */
#ifndef PLIANT_FEM_SCALAR_H
#define PLIANT_FEM_SCALAR_H

#include "base/export.h"
#include "pliant/model.h"

#ifdef __cplusplus
extern "C" {
#endif

/* The same of any mesh at these positions. */
PLIANT_INTERNAL int32_t pliant_mesh_inverted(const pliant_mesh *mesh, const double *positions);

/* A number per fine node (volume-weighted mean of its tetrahedra, which have that of the hexahedron that they are part of). Stresses are of the tissue
 *  in a tetrahedron, energy is over the volume of all of it.
 *  @param out (body->fine.num_nodes). Errors: ARGUMENT, MEMORY. */
PLIANT_INTERNAL pliant_status pliant_data_scalar(const pliant_model *model, const pliant_body *body, const double *positions, pliant_scalar scalar,
                                            float *out);

/* And per fine tetrahedron; 0 for contact_force. @param out (body->fine.num_tets). Errors: MEMORY. */
PLIANT_INTERNAL pliant_status pliant_data_tet_scalar(const pliant_model *model, const pliant_body *body, const double *positions, pliant_scalar scalar,
                                                float *out);

#ifdef __cplusplus
}
#endif
#endif
