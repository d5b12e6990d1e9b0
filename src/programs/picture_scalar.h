/* Pictures of a number per tetrahedron, in colours, where the deformed tissue is cut by the three planes. */
#ifndef PLIANT_TOOLS_PICTURE_SCALAR_H
#define PLIANT_TOOLS_PICTURE_SCALAR_H

#include "pliant/mesh.h"

#ifdef __cplusplus
extern "C" {
#endif

typedef struct picture_scalars {
    const pliant_mesh *mesh;
    const double *positions; /* (mesh.num_nodes x 3) LPS [m] */
    const float *of_tet;     /* (mesh.num_tets) */
} picture_scalars;

/* folder/NAME_axial.png, NAME_coronal.png, NAME_sagittal.png: blue, cyan, green, yellow, red from the 1st to the 99th percentile, told
 * in the log, with that scale at the right edge; black where no tissue is. Errors: FILE, MEMORY.
 *  @param shown the grid whose box is seen */
pliant_status picture_scalar(const char *folder, const char *name, const picture_scalars *scalars, const pliant_geometry *shown, const double point[3]);

#ifdef __cplusplus
}
#endif
#endif
