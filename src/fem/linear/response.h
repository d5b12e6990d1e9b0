/* How the whole fine mesh answers to a force on a tool's footprint, to second order: what a patch's surroundings are
 * made of. */
#ifndef PLIANT_FEM_LINEAR_RESPONSE_H
#define PLIANT_FEM_LINEAR_RESPONSE_H

#include "fem/system.h"

#ifdef __cplusplus
extern "C" {
#endif

enum { PLIANT_RESPONSE_MODES = 9 };

/* The fine mesh around one state, for products with its stiffness. Used by one thread. */
typedef struct pliant_linearized {
    pliant_system system;            /* a view of the constant one, one thread */
    const double *x;                 /* (3 num_nodes) the state */
    double *at;                      /* (3 num_nodes) room */
    double (*element_forces)[12][LANES];
    pliant_progress progress;        /* asked whether to go on; the caller's to set */
} pliant_linearized;

/* Errors: MEMORY. */
pliant_status pliant_linearized_create(const pliant_system *system, const double *x, pliant_linearized *out);
void pliant_linearized_free(pliant_linearized *linearized);
/* Errors: CANCELLED, without a message: whoever cancelled needs none. */
pliant_status pliant_linearized_go_on(const pliant_linearized *linearized);
/* Elastic forces at x + u; u, out: (3 num_free). */
void pliant_linearized_forces(pliant_linearized *linearized, const double *u, double *out);
/* K v, K the tangent stiffness at x; room: (3 num_free). */
void pliant_linearized_product(pliant_linearized *linearized, const double *v, double *room, double *out);

/* z_d = K^-1 W' e_d for the three directions, then -K^-1 f''(z_i, z_j) for i <= j, f'' the second derivative of the
 * elastic forces (modal derivatives: Barbic and James 2005, 4): the terms of the answer to a force l are z l + 1/2 sum
 * l_i l_j of these. By conjugate gradients, to 1e-4 in the preconditioned residual.
 * @param nodes, weights Of the footprint, sum 1.
 * @param modes (9 x 3 num_free) out. Errors: MEMORY, CANCELLED. */
pliant_status pliant_response_modes(pliant_linearized *linearized, pliant_preconditioner *preconditioner, int32_t count,
                                    const int32_t *nodes, const double *weights, double *modes);

/* -K^-1 f''(z_i, z_j), z_i of one footprint's modes and z_j of another's: what two tools do together. out (9 x 3
 * num_free). */
pliant_status pliant_response_crossed(pliant_linearized *linearized, pliant_preconditioner *preconditioner, const double *first,
                                      const double *second, double *out);

/* Floating-point operations: elastic forces of the whole mesh; nine modes of either kind at these positions (num_nodes
 * x 3), with as many products in a solve as are usual there. */
double pliant_response_force_operations(const pliant_system *system);
double pliant_response_operations(const pliant_system *system, const pliant_preconditioner *preconditioner, const double *positions);

#ifdef __cplusplus
}
#endif

#endif
