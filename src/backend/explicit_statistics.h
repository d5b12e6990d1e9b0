/* Figures of explicit dynamics (solver/kind tled). */
#ifndef PLIANT_BACKEND_EXPLICIT_STATISTICS_H
#define PLIANT_BACKEND_EXPLICIT_STATISTICS_H

#include "base/export.h"
#include "pliant/data.h"

#ifdef __cplusplus
extern "C" {
#endif

/* Time steps and energies of explicit dynamics (solver/kind tled). */
typedef struct pliant_dynamics {
    double edge_bound;        /* largest stable step by [C] 1: edge over speed of sound [s] */
    double eigenvalue_bound;  /* by the largest eigenvalue of an element [s]; the smaller of the two is the bound */
    double time_step;         /* of a sub-step [s]; 1 for dynamic relaxation, which has no time */
    int32_t substeps;         /* in a step; of dynamic relaxation: at most */
    double kinetic_energy;    /* half a sub-step ago [J]; 0 for dynamic relaxation */
    double strain_energy;     /* of the elastic law, without relaxation [J] */
    /* Sum of both energies at the same time [J]; the strain energy for dynamic relaxation. Without loads and damping it
     * is constant, except for rounding and a term in the square of the time step. */
    double kept_energy;
    /* Work of the tools' contact forces on the tissue in the last step [J]: sum over the sub-steps of the forces times
     * the motion of the tools. */
    double tool_work;
} pliant_dynamics;
/* Errors: ARGUMENT (another solver/kind). */
PLIANT_INTERNAL pliant_status pliant_data_get_dynamics(const pliant_model *model, const pliant_data *data,
                                                       pliant_dynamics *out);

#ifdef __cplusplus
}
#endif
#endif
