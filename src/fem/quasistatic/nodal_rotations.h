/* Axes in which a preconditioner is applied. A preconditioner is computed at one state, and the tissue rotates away
 * from that state by different angles. Tissue that rotated by Q has the stiffness Q K Q'. The old preconditioner
 * therefore stays accurate in axes that rotate with each node:
 *     M^-1 = T V T',  T = diag(Q of every node)
 * (Courtecuisse, Allard, Duriez and Cotin 2010, Asynchronous preconditioners for efficient solving of non-linear
 * deformations). The secants are stored in these axes as well. They rotate with the tissue, and products of steps and
 * residuals do not change. */
#ifndef PLIANT_FEM_QUASISTATIC_NODAL_ROTATIONS_H
#define PLIANT_FEM_QUASISTATIC_NODAL_ROTATIONS_H

#include "fem/system.h"

#ifdef __cplusplus
extern "C" {
#endif

typedef struct pliant_nodal_rotations {
    bool is_rotated;             /* false: Q = I everywhere */
    double *rotation;        /* (num_free x 9) Q */
    float (*before)[9][LANES]; /* (num_blocks) V mu F0; F0 at the reference positions of the preconditioner [N m] */
    float (*product)[LANES][9]; /* (num_blocks) V mu F F0', element by element, in the order in which nodes sum them */
} pliant_nodal_rotations;

/* Create the axes. *out is NULL for systems without rotating axes: homogenized elements, macro-elements, patches.
 * Errors: MEMORY. */
pliant_status pliant_nodal_rotations_create(const pliant_system *system, pliant_nodal_rotations **out);
void pliant_nodal_rotations_free(pliant_nodal_rotations *rotations); /* Nullable */
/* Set the reference positions of the preconditioner. All rotations are I until pliant_nodal_rotations_update. Nullable
 * rotations */
void pliant_nodal_rotations_refer(const pliant_system *system, const double *positions,
                                  pliant_nodal_rotations *rotations);
/* Rotate the axes with the tissue to these positions. Nullable rotations */
void pliant_nodal_rotations_update(const pliant_system *system, const double *positions,
                                   pliant_nodal_rotations *rotations);

/* Compute Q' v (into) or Q v (from) of one unknown node, overwriting v. Nullable rotations */
static inline void pliant_into_node_axes(const pliant_nodal_rotations *rotations, int32_t node, double v[3])
{
    if (!rotations || !rotations->is_rotated) return;
    const double *q = rotations->rotation + 9 * (size_t)node;
    double x = v[0], y = v[1], z = v[2];
    for (int d = 0; d < 3; d++) v[d] = q[d] * x + q[3 + d] * y + q[6 + d] * z;
}
static inline void pliant_from_node_axes(const pliant_nodal_rotations *rotations, int32_t node, double v[3])
{
    if (!rotations || !rotations->is_rotated) return;
    const double *q = rotations->rotation + 9 * (size_t)node;
    double x = v[0], y = v[1], z = v[2];
    for (int d = 0; d < 3; d++) v[d] = q[3 * d] * x + q[3 * d + 1] * y + q[3 * d + 2] * z;
}

#ifdef __cplusplus
}
#endif
#endif
