/* Scalars at nodes and tetrahedra for given positions. */
#ifndef PLIANT_FEM_SCALAR_H
#define PLIANT_FEM_SCALAR_H

#include "base/export.h"
#include "pliant/model.h"

#ifdef __cplusplus
extern "C" {
#endif

/* Count the inverted tetrahedra of a mesh.
 * @param positions (num_nodes x 3) LPS [m] */
PLIANT_INTERNAL int32_t pliant_mesh_inverted(const pliant_mesh *mesh, const double *positions);

/* Compute a scalar at the fine nodes, as pliant_data_get_scalar does. Errors: ARGUMENT (contact_force), MEMORY.
 * @param positions (body->fine.num_nodes x 3) LPS [m]
 * @param out (body->fine.num_nodes) */
PLIANT_INTERNAL pliant_status pliant_data_scalar(const pliant_model *model, const pliant_body *body,
                                                 const double *positions, pliant_scalar scalar, float *out);

/* Compute a scalar in the fine tetrahedra; contact_force is 0. Errors: MEMORY.
 * @param positions (body->fine.num_nodes x 3) LPS [m]
 * @param out (body->fine.num_tets) */
PLIANT_INTERNAL pliant_status pliant_data_tet_scalar(const pliant_model *model, const pliant_body *body,
                                                     const double *positions, pliant_scalar scalar, float *out);

#ifdef __cplusplus
}
#endif
#endif
