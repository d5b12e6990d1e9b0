/* Homogenized shape functions of coarse elements, listed by element and by fine node ([H] 2.3). */
#ifndef PLIANT_FEM_COARSE_SHAPE_FUNCTIONS_H
#define PLIANT_FEM_COARSE_SHAPE_FUNCTIONS_H

#include "fem/coarse/submesh.h"

/* Shape functions of one element. */
typedef struct pliant_shapes {
    int32_t count;
    int32_t *node;             /* (count) fine nodes */
    double *shape;             /* (count x 9 corners) */
} pliant_shapes;

/* Allocate the shape functions of a submesh and copy its nodes. Errors: MEMORY. */
pliant_status pliant_shapes_of(const pliant_submesh *submesh, int corners, pliant_shapes *out);
void pliant_shapes_free(pliant_shapes *lists, int32_t count); /* Nullable */
/* Build system->upsample from all elements' shape functions. corners: maximum number per element. Errors: MEMORY. */
pliant_status pliant_shapes_sort(pliant_system *system, int corners, const pliant_shapes *lists);

#endif
