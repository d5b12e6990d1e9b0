/* Half a solve at a node: Z = L^-1 of its three unit forces, which is zero but where the node is eliminated into. Since
 * (L L')^-1 = L^-T L^-1,
 *     what forces at node b move at node a is Z_a' Z_b,    what a right side moves there Z_a' (L^-1 right),    and L^-1 of forces at a is Z_a f:
 * around the half solves that any solve makes, a few nodes cost their own products, no pass through the factor. */
#ifndef PLIANT_FEM_LINEAR_HALVES_H
#define PLIANT_FEM_LINEAR_HALVES_H

#include "fem/linear/panels.h"

#ifdef __cplusplus
extern "C" {
#endif

typedef struct pliant_half {
    int32_t supernode;      /* the lowest that the node stands in */
    int32_t length, room;   /* unknowns of that and of all that it is eliminated into, in the order of elimination */
    double *value;          /* (3 x room), of which each has length */
} pliant_half;

void pliant_half_free(pliant_half *half); /* and empty */
/* Errors: MEMORY. */
pliant_status pliant_half_find(pliant_panels *panels, const pliant_supernodes *of, pliant_reach *reach, int32_t node, pliant_half *out);
/* Z_a' Z_b, (3 x 3) by rows */
void pliant_half_product(const pliant_reach *reach, const pliant_half *a, const pliant_half *b, double out[9]);
/* Z' x, and x += Z f, of x in the order of elimination */
void pliant_half_answer(const pliant_supernodes *of, const pliant_reach *reach, const pliant_half *half, const double *x, double out[3]);
void pliant_half_add(const pliant_supernodes *of, const pliant_reach *reach, const pliant_half *half, const double force[3], double *x);

#ifdef __cplusplus
}
#endif
#endif
