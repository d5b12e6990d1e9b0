/* The exact inverse stiffness around a cut: unknowns near it, with all other nodes held. Together with a preconditioner
 * from before the cut it forms an overlapping Schwarz method (carried_preconditioner.h). */
#ifndef PLIANT_FEM_LINEAR_SUBDOMAIN_H
#define PLIANT_FEM_LINEAR_SUBDOMAIN_H

#include "fem/system.h"

#ifdef __cplusplus
extern "C" {
#endif

typedef struct pliant_subdomain {
    pliant_mesh mesh;         /* elements with an inner unknown as a corner, with local node numbers */
    pliant_system system;     /* of the mesh; its unknowns are the inner ones */
    int32_t *unknown;         /* (mesh.num_nodes) unknown of the whole system, or -1 */
    int32_t num_elements;
    int32_t *element;         /* (num_elements) element of the whole system */
    pliant_tangent *tangents; /* (system.num_blocks) */
    double *stiffness;        /* of every tetrahedron, (12 x 12); NULL: macro-elements, which store their own */
    /* Nullable: (mesh.num_nodes x 9) axes of the nodes at creation; vectors of the whole system are in these axes. */
    double *axes;
    pliant_factor *factor;
    double *values;           /* (pattern.num_values) */
    double *inner;            /* (3 num_free) work array */
    double *x, *y;            /* (3 mesh.num_nodes) work arrays */
} pliant_subdomain;

/* Create a subdomain with the elements within `rings` elements of a marked unknown. *out is NULL if no unknown is
 * marked.
 * @param opened     (num_free) marked unknowns.
 * @param positions  Nullable: (num_nodes x 3) [m]; NULL: without values.
 * @param axes       Nullable: (num_free x 9).
 * Errors: MEMORY, NUMERIC. */
pliant_status pliant_subdomain_create(const pliant_system *system, const uint8_t *opened, int32_t rings,
                                      const double *positions, const double *axes, pliant_subdomain **out);
/* List the inner unknowns and return their number.
 * @param inner  (num_free) in: marked unknowns; out: inner unknowns.
 * @param list   (num_free) out: marked unknowns first. */
int32_t pliant_subdomain_inner(const pliant_system *system, int32_t rings, uint8_t *inner, int32_t *list);
/* Compute the values for these tangents of the whole system's elements, or copy them from another subdomain with the
 * same unknowns. Errors: MEMORY, NUMERIC. */
pliant_status pliant_subdomain_numeric(pliant_subdomain *subdomain, const pliant_tangent *tangents);
pliant_status pliant_subdomain_copy(pliant_subdomain *to, const pliant_subdomain *from);
void pliant_subdomain_free(pliant_subdomain *subdomain); /* Nullable */

/* Compute z = S right, with S the inverse of the inner stiffness, and rest = right - K z, which is zero inside. All are
 * (3 num_free of the whole system). `rest` and `right` may be the same array. z is written at inner unknowns only; the
 * caller zeroes it before. Errors: MEMORY. */
pliant_status pliant_subdomain_solve(pliant_subdomain *subdomain, const double *right, double *z, double *rest);
/* Subtract S K v from z. */
pliant_status pliant_subdomain_extend(pliant_subdomain *subdomain, const double *v, double *z);

#ifdef __cplusplus
}
#endif
#endif
