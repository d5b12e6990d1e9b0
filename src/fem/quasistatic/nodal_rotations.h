/* The axes in which a preconditioner is used. Its numbers belong to one state; from there on the tissue turns, here more, there
 * less. A piece that turned by Q has the stiffness Q K Q', so that the old numbers stay good in axes that turn with each node:
 *     M^-1 = T V T',  T = diag(Q of every node)
 * (Courtecuisse, Allard, Duriez and Cotin 2010, Asynchronous preconditioners for efficient solving of non-linear deformations).
 * Secants are kept in these axes too: what was learned of a piece turns with it, and products of steps and pulls stay what
 * they are. */
#ifndef PLIANT_FEM_QUASISTATIC_NODAL_ROTATIONS_H
#define PLIANT_FEM_QUASISTATIC_NODAL_ROTATIONS_H

#include "fem/system.h"

#ifdef __cplusplus
extern "C" {
#endif

typedef struct pliant_nodal_rotations {
    bool turned;             /* false: Q = I everywhere */
    double *rotation;        /* (num_free x 9) Q */
    float (*before)[9][LANES]; /* (num_blocks) V mu F0, F0 at the positions that the preconditioner belongs to [N m] */
    float (*product)[LANES][9]; /* (num_blocks) V mu F F0', one element after the other, as nodes gather them */
} pliant_nodal_rotations;

/* *out is NULL for systems that are not turned: what is homogenized, macro-elements, patches. Errors: MEMORY. */
pliant_status pliant_nodal_rotations_create(const pliant_system *system, pliant_nodal_rotations **out);
void pliant_nodal_rotations_free(pliant_nodal_rotations *rotations); /* Nullable */
/* The preconditioner belongs to these positions now; they are taken for the present ones until pliant_nodal_rotations_update. Nullable rotations */
void pliant_nodal_rotations_refer(const pliant_system *system, const double *positions, pliant_nodal_rotations *rotations);
/* Turn with the tissue to these positions. Nullable rotations */
void pliant_nodal_rotations_update(const pliant_system *system, const double *positions, pliant_nodal_rotations *rotations);

/* Q' v, Q v of one unknown node, in place; rotations may be NULL */
static inline void pliant_into_node_axes(const pliant_nodal_rotations *rotations, int32_t node, double v[3])
{
    if (!rotations || !rotations->turned) return;
    const double *q = rotations->rotation + 9 * (size_t)node;
    double x = v[0], y = v[1], z = v[2];
    for (int d = 0; d < 3; d++) v[d] = q[d] * x + q[3 + d] * y + q[6 + d] * z;
}
static inline void pliant_from_node_axes(const pliant_nodal_rotations *rotations, int32_t node, double v[3])
{
    if (!rotations || !rotations->turned) return;
    const double *q = rotations->rotation + 9 * (size_t)node;
    double x = v[0], y = v[1], z = v[2];
    for (int d = 0; d < 3; d++) v[d] = q[3 * d] * x + q[3 * d + 1] * y + q[3 * d + 2] * z;
}

#ifdef __cplusplus
}
#endif
#endif
