/* The stiffness around what a cut has opened: unknowns near it, everything beyond held, exact there. Beside a
 * preconditioner that knows the body only as it was before, it is one of the two parts of an overlapping Schwarz method
 * (carried.h). */
#ifndef PLIANT_FEM_LINEAR_SUBDOMAIN_H
#define PLIANT_FEM_LINEAR_SUBDOMAIN_H

#include "fem/system.h"

#ifdef __cplusplus
extern "C" {
#endif

typedef struct pliant_subdomain {
    pliant_mesh mesh;         /* the elements that an inner unknown has a corner of, by numbers of their own */
    pliant_system system;     /* of it; its unknowns are the inner ones */
    int32_t *unknown;         /* (mesh.num_nodes) of the whole, or -1 */
    int32_t num_elements;
    int32_t *element;         /* (num_elements) of the whole */
    pliant_tangent *tangents; /* (system.num_blocks) */
    double *stiffness;        /* of every tetrahedron, (12 x 12); NULL: macro-elements, which have theirs */
    double *axes;             /* (mesh.num_nodes x 9) Nullable: of the nodes, when it was made; the whole's vectors are in these */
    pliant_factor *factor;
    double *values;           /* (pattern.num_values) */
    double *inner;            /* (3 num_free) room */
    double *x, *y;            /* (3 mesh.num_nodes) room */
} pliant_subdomain;

/* Elements that lie within so many elements of one of these unknowns. *out is NULL where nothing is opened. positions:
 * NULL: without numbers yet. axes: (num_free x 9) Nullable. Errors: MEMORY, NUMERIC. */
pliant_status pliant_subdomain_create(const pliant_system *system, const uint8_t *opened, int32_t rings, const double *positions, const double *axes,
                                      pliant_subdomain **out);
/* What is inner: inner (num_free): opened ones on entry; list (num_free): those first. Returns how many there are. */
int32_t pliant_subdomain_inner(const pliant_system *system, int32_t rings, uint8_t *inner, int32_t *list);
/* Numbers of a state where the whole's elements have these tangents; or those of another one of the same unknowns.
 * Errors: MEMORY, NUMERIC. */
pliant_status pliant_subdomain_numeric(pliant_subdomain *subdomain, const pliant_tangent *tangents);
pliant_status pliant_subdomain_copy(pliant_subdomain *to, const pliant_subdomain *from);
void pliant_subdomain_free(pliant_subdomain *subdomain); /* Nullable */

/* z = S right, S the inverse of the inner stiffness, and rest = right - K z: zero within. All (3 num_free of the
 * whole); rest and right may be the same; z is written at inner unknowns only, after it has been zeroed by whoever
 * calls. Errors: MEMORY. */
pliant_status pliant_subdomain_solve(pliant_subdomain *subdomain, const double *right, double *z, double *rest);
/* z -= S K v */
pliant_status pliant_subdomain_extend(pliant_subdomain *subdomain, const double *v, double *z);

#ifdef __cplusplus
}
#endif
#endif
