/* Changes of volume on which the pressures of nearly incompressible tetrahedra act (pressures.c). */
#ifndef PLIANT_FEM_ELEMENT_VOLUME_CHANGE_H
#define PLIANT_FEM_ELEMENT_VOLUME_CHANGE_H

#include "fem/element/pressures.h"

#ifdef __cplusplus
extern "C" {
#endif

/* Compute the mean volume change of the group of every tetrahedron: *out (num_tets); free with pliant_free. Errors:
 * MEMORY. */
pliant_status pliant_group_changes(const pliant_mesh *mesh, const double *positions, pliant_elasticity law,
                                   double **out);

#ifdef __cplusplus
}
#endif
#endif
