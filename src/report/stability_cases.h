/* The cases of stability, in files of their own: bodies, loads, shapes, dynamics. */
#ifndef PLIANT_REPORT_STABILITY_CASES_H
#define PLIANT_REPORT_STABILITY_CASES_H

#include "report/stability_block.h"
#include "report/stability_trial.h"

#ifdef __cplusplus
extern "C" {
#endif

#define STABILITY_CASE_LIST(X)                                                                                         \
    X(contrast) X(poisson) X(anisotropic) X(thin) X(empty) X(single_tetrahedron) X(pieces) X(pull) X(teleport)        \
    X(gravity) X(spring) X(half_turn) X(not_finite) X(flat) X(inverted) X(scrambled) X(plane) X(point) X(long_run)     \
    X(time_step) X(energy) X(dynamic_teleport) X(dynamic_not_finite) X(dynamic_spring) X(dynamic_octree)               \
    X(dynamic_bone_surface) X(dynamic_fit)
#define STABILITY_DECLARE(name) pliant_status stability_##name(stability_context *context);
STABILITY_CASE_LIST(STABILITY_DECLARE)
#undef STABILITY_DECLARE


/* Treatments of more than one case. */
/* The grabbed point is somewhere else every step. @param argument a pliant_drive */
pliant_status trial_teleport(stability_trial *trial, const void *argument);
/* A spring is moved by a tenth of the body at once. @param argument its stiffness, a double [N/m] */
pliant_status trial_spring(stability_trial *trial, const void *argument);
/* What is not a number is refused, and the body does not notice. */
pliant_status trial_not_finite(stability_trial *trial, const void *argument);

#ifdef __cplusplus
}
#endif
#endif
