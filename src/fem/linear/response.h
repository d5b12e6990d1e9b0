/* Second-order response of the whole fine mesh to a force on a tool's footprint. Patches describe their surroundings
 * with it. */
#ifndef PLIANT_FEM_LINEAR_RESPONSE_H
#define PLIANT_FEM_LINEAR_RESPONSE_H

#include "fem/system.h"

#ifdef __cplusplus
extern "C" {
#endif

enum { PLIANT_RESPONSE_MODES = 9 };

/* The fine mesh around one state, for products with its tangent stiffness. Used by one thread. */
typedef struct pliant_linearized {
    pliant_system system;            /* view of the constant system, with one thread */
    const double *x;                 /* (3 num_nodes) the state */
    double *at;                      /* (3 num_nodes) work array */
    double (*element_forces)[12][LANES];
    pliant_progress progress;        /* callback that may cancel; set by the caller */
} pliant_linearized;

/* Create the linearization around x. Errors: MEMORY. */
pliant_status pliant_linearized_create(const pliant_system *system, const double *x, pliant_linearized *out);
void pliant_linearized_free(pliant_linearized *linearized);
/* Return CANCELLED, without a message, if the callback requests it. */
pliant_status pliant_linearized_check_cancel(const pliant_linearized *linearized);
/* Compute elastic forces at x + u. u, out: (3 num_free). */
void pliant_linearized_forces(pliant_linearized *linearized, const double *u, double *out);
/* Compute K v with the tangent stiffness K at x. `buffers`: (3 num_free) work array. */
void pliant_linearized_product(pliant_linearized *linearized, const double *v, double *buffers, double *out);

/* Compute the nine response modes of a footprint: z_d = K^-1 W' e_d for the three directions, and -K^-1 f''(z_i, z_j)
 * for i <= j. f'' is the second derivative of the elastic forces (modal derivatives: Barbic and James 2005, 4). The
 * response to a force l is z l + 1/2 sum l_i l_j of these. Conjugate gradients stop at 1e-4 of the preconditioned
 * residual.
 * @param nodes, weights  Of the footprint, sum 1.
 * @param modes           Out: (9 x 3 num_free).
 * Errors: MEMORY, CANCELLED. */
pliant_status pliant_response_modes(pliant_linearized *linearized, pliant_preconditioner *preconditioner, int32_t count,
                                    const int32_t *nodes, const double *weights, double *modes);

/* Compute -K^-1 f''(z_i, z_j), with z_i of one footprint and z_j of another: the interaction of two tools. out: (9 x 3
 * num_free). */
pliant_status pliant_response_pair_modes(pliant_linearized *linearized, pliant_preconditioner *preconditioner,
                                         const double *first, const double *second, double *out);

/* Return floating-point operations: of the elastic forces of the whole mesh, and of nine modes of either kind at these
 * positions (num_nodes x 3). The estimate assumes a typical number of products per solve. */
double pliant_response_force_operations(const pliant_system *system);
double pliant_response_operations(const pliant_system *system, const pliant_preconditioner *preconditioner,
                                  const double *positions);

#ifdef __cplusplus
}
#endif

#endif
