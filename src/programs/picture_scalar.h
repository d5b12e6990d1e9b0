/* Coloured pictures of a scalar per tetrahedron on three planes through the deformed tissue. */
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

/* Write folder/NAME_axial.png, NAME_coronal.png, NAME_sagittal.png. Colours are blue, cyan, green, yellow, red from the
 * 1st to the 99th percentile, and black without tissue. The scale is at the right edge, and its range is logged.
 * Errors: FILE, MEMORY.
 * @param shown grid whose box is drawn */
pliant_status picture_scalar(const char *folder, const char *name, const picture_scalars *scalars,
                             const pliant_geometry *shown, const double point[3]);

#ifdef __cplusplus
}
#endif
#endif
