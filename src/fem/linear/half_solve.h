/* Half of a solve at a node: Z = L^-1 of its three unit forces. Z is zero except in rows into which the node is
 * eliminated. Since (L L')^-1 = L^-T L^-1,
 *     Z_a' Z_b          is the displacement of node a per force at node b,
 *     Z_a' (L^-1 right) is the displacement of node a for a right side,
 *     Z_a f             is L^-1 of the force f at a.
 * Once the half solves exist, a few nodes cost only their products, without a pass through the factor. */
#ifndef PLIANT_FEM_LINEAR_HALF_SOLVE_H
#define PLIANT_FEM_LINEAR_HALF_SOLVE_H

#include "fem/linear/panels.h"

#ifdef __cplusplus
extern "C" {
#endif

typedef struct pliant_half_solve {
    int32_t supernode;      /* lowest supernode that contains the node */
    /* Length: number of unknowns in that supernode and in all supernodes into which it is eliminated, in elimination
     * order; `capacity`: allocated length. */
    int32_t length, capacity;
    double *value;          /* (3 x `capacity`), each with `length` values */
} pliant_half_solve;

void pliant_half_solve_free(pliant_half_solve *half); /* and empty */
/* Compute the half solve of a node. Errors: MEMORY. */
pliant_status pliant_half_solve_compute(pliant_panels *panels, const pliant_supernodes *of, pliant_reach *reach,
                                        int32_t node, pliant_half_solve *out);
/* Compute Z_a' Z_b, (3 x 3), row-major. */
void pliant_half_solve_product(const pliant_reach *reach, const pliant_half_solve *a, const pliant_half_solve *b,
                               double out[9]);
/* Compute Z' x, or add Z f to x. x is in elimination order. */
void pliant_half_solve_displacement(const pliant_supernodes *of, const pliant_reach *reach,
                                    const pliant_half_solve *half, const double *x, double out[3]);
void pliant_half_solve_add_force(const pliant_supernodes *of, const pliant_reach *reach, const pliant_half_solve *half,
                                 const double force[3], double *x);

#ifdef __cplusplus
}
#endif
#endif
