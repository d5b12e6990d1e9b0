/* Homogenized shape functions of coarse elements, as they are found, and by fine node ([H] 2.3). */
#ifndef PLIANT_FEM_COARSE_SHAPES_H
#define PLIANT_FEM_COARSE_SHAPES_H

#include "fem/coarse/submesh.h"

#ifdef __cplusplus
extern "C" {
#endif

/* Of one element. */
typedef struct pliant_shapes {
    int32_t count;
    int32_t *node;             /* (count) fine nodes */
    double *shape;             /* (count x 9 corners) */
} pliant_shapes;

/* Room for those of a submesh, and its nodes. Errors: MEMORY. */
pliant_status pliant_shapes_of(const pliant_submesh *submesh, int corners, pliant_shapes *out);
void pliant_shapes_free(pliant_shapes *lists, int32_t count); /* Nullable */
/* system->upsample of all elements of it, with so many corners each or fewer. Errors: MEMORY. */
pliant_status pliant_shapes_sort(pliant_system *system, int corners, const pliant_shapes *lists);

#ifdef __cplusplus
}
#endif

#endif
