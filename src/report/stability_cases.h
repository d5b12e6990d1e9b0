/* Stability cases, grouped in files: bodies, loads, shapes, dynamics. */
#ifndef PLIANT_REPORT_STABILITY_CASES_H
#define PLIANT_REPORT_STABILITY_CASES_H

#include "report/stability_block.h"
#include "report/stability_trial.h"

#define STABILITY_CASE_LIST(X)                                                                                         \
    X(contrast) X(poisson) X(anisotropic) X(thin) X(empty) X(single_tetrahedron) X(pieces) X(pull) X(teleport)        \
    X(gravity) X(spring) X(half_turn) X(not_finite) X(flat) X(inverted) X(scrambled) X(plane) X(point) X(long_run)     \
    X(time_step) X(energy) X(dynamic_teleport) X(dynamic_not_finite) X(dynamic_spring) X(dynamic_octree)               \
    X(dynamic_bone_surface) X(dynamic_fit)
#define STABILITY_DECLARE(name) pliant_status stability_##name(stability_context *context);
STABILITY_CASE_LIST(STABILITY_DECLARE)
#undef STABILITY_DECLARE

/* Treatments that several cases use. */
/* Move the grasped point to a different position in every step.
 * @param argument a pliant_drive */
pliant_status trial_teleport(stability_trial *trial, const void *argument);
/* Move a spring by a tenth of the body's size in one step.
 * @param argument its stiffness, a double [N/m] */
pliant_status trial_spring(stability_trial *trial, const void *argument);
/* Pass values that are not finite. They must be rejected without any effect. */
pliant_status trial_not_finite(stability_trial *trial, const void *argument);

#endif
