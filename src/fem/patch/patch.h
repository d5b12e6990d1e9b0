/* Patches: a local fine solution around the nodes that tools hold or press, on top of a coarse model. The coarse model
 * does not resolve point forces (NUMERICS.md).
 *
 * After a grasp, a background thread computes the fine mesh's response to it. The basis (basis.h) consists of the
 * responses and of the nodes around all grasps. It is installed a fixed number of steps later, independent of the
 * thread's speed. From then on these tools pull at the patch instead of the coarse model. Until then, and if a patch
 * cannot be computed, they pull at the coarse model.
 *
 * The patch's displacement is relative to the coarse model's fine node positions (the base). The elastic forces at the
 * base are a constant load, so a tool without force changes no position. The coarse model keeps its own loads. */
#ifndef PLIANT_FEM_PATCH_PATCH_H
#define PLIANT_FEM_PATCH_PATCH_H

#include "fem/quasistatic/solver.h"

#ifdef __cplusplus
extern "C" {
#endif

/* Return whether a scene uses patches: model/patch above 0, and a coarse method. */
static inline bool pliant_patch_is_enabled(const pliant_scene *scene)
{
    return scene->model.patch > 0 && scene->model.method != PLIANT_FINE;
}

/* Create the fine mesh's system with its stiffness at rest, for responses. Errors: MEMORY, NUMERIC, SCENE. */
pliant_status pliant_patch_system(const pliant_scene *scene, const pliant_body *body, int num_threads,
                                  pliant_system **out);

/* Create the fine system after a cut, without a factor. Patches carry over the factor from load time. Errors:
 * MEMORY. */
pliant_status pliant_patch_next_system(const pliant_scene *scene, const pliant_body *body, int num_threads,
                                       const pliant_unchanged_elements *kept, pliant_system **out);

/* Create the patches. The scene is borrowed. */
pliant_status pliant_patch_create(const pliant_scene *scene, const pliant_discretization *discretization,
                                  pliant_patch **out);
void pliant_patch_free(pliant_patch *patch); /* Nullable */
/* Replace the patches from before a cut. If threads still work for them, a later step frees them without waiting. */
void pliant_patch_replace(pliant_patch *patch, pliant_patch *before);
/* Select the step's contact points that the coarse model must handle; all: data->contacts. Errors: MEMORY. */
pliant_status pliant_patch_select_coarse_points(pliant_data *data, pliant_contacts **coarse);
/* Remove all grasps and displacements. */
void pliant_patch_reset(pliant_patch *patch);

/* Prepare a step before the tools interact: install due results, start new background work, free unused data.
 * data->positions are the result of the last step. Errors: MEMORY; the state is unchanged. */
pliant_status pliant_patch_begin(pliant_data *data);
/* Return the number of tools that patches serve in this step. Call it after pliant_patch_begin. */
int pliant_patch_count_tools(const pliant_data *data);
/* Return the solver that a tool pulls at. */
pliant_solver *pliant_patch_solver(const pliant_data *data, int tool);
/* Do the same as pliant_solver_add_grasp, for the solver of pliant_patch_solver. */
pliant_status pliant_patch_hold(pliant_data *data, int tool);
/* Suspend the patch from the next leg on. It then moves with the coarse model, which has all contact points. Use it if
 * a patch solve would shorten the leg. */
void pliant_patch_suspend(pliant_data *data, bool is_suspended);
/* Run the patch stage of a step. data->positions are the coarse model's fine node positions on entry, and the patch's
 * on return. The tools' reports (pliant_tool_report) are updated. Errors: NOT_CONVERGED, NUMERIC, MEMORY as in
 * pliant_solver_step. After a failure, the coarse model's part of the step is rolled back as well. */
pliant_status pliant_patch_step(pliant_data *data);
/* Move the patch after nodes and coarse model were moved during a step. start_positions: data->positions at the start
 * of the step. */
void pliant_patch_follow_move(pliant_data *data, const double *start_positions);
/* Set the displacement to zero: the nodes move to the coarse model's positions. */
void pliant_patch_clear_displacement(pliant_patch *patch);

#ifdef __cplusplus
}
#endif

#endif
