/* Patches: a local fine solution around what the tools hold or press, on top of a coarse model, which sees no point
 * force (NUMERICS.md).
 *
 * When a tool takes hold, the fine mesh's response to it is computed in the background, and the basis (basis.h) made of
 * that and of the nodes around all holds. It is put to use a fixed number of steps later, whether the other thread was
 * fast or not; from then on these tools pull at the patch, no longer at the coarse model. Until then, and where a patch
 * cannot be made, they pull at the coarse model.
 *
 * The patch's displacement is relative to where the coarse model has the fine nodes (base): elastic forces at the base
 * are a constant load, so that a tool that does not pull changes nothing, and the coarse model's loads stay its own. */
#ifndef PLIANT_FEM_PATCH_PATCH_H
#define PLIANT_FEM_PATCH_PATCH_H

#include "fem/quasistatic/solver.h"

#ifdef __cplusplus
extern "C" {
#endif

/* Whether a scene asks for patches: model/patch above 0, and a coarse method. */
static inline bool pliant_patch_asked(const pliant_scene *scene) { return scene->model.patch > 0 && scene->model.method != PLIANT_FINE; }

/* The fine mesh with its stiffness at rest, which responses are computed with. Errors: MEMORY, NUMERIC, SCENE. */
pliant_status pliant_patch_system(const pliant_scene *scene, const pliant_body *body, int num_threads, pliant_system **out);

/* That of the next body: without a factor; patches carry over the one of the body at load. Errors: MEMORY. */
pliant_status pliant_patch_next_system(const pliant_scene *scene, const pliant_body *body, int num_threads, const pliant_kept *kept, pliant_system **out);

/* The scene is borrowed. */
pliant_status pliant_patch_create(const pliant_scene *scene, const pliant_discretization *discretization, pliant_patch **out);
void pliant_patch_free(pliant_patch *patch); /* Nullable */
/* The patches of the next body are there. Where threads still work for those before, these are freed later, by a step
 * that need not wait. */
void pliant_patch_succeed(pliant_patch *patch, pliant_patch *before);
/* The step's points that the coarse model has to hold; all: data->contacts. Errors: MEMORY. */
pliant_status pliant_patch_divide(pliant_data *data, pliant_contacts **coarse);
/* Nothing held, nothing moved. */
void pliant_patch_reset(pliant_patch *patch);

/* Before the tools interact: deliver what is due, start what is new, free what nothing holds. data->positions: of the
 * last step. Errors: MEMORY; the state is as before. */
pliant_status pliant_patch_begin(pliant_data *data);
/* How many tools the patches serve in this step, once it has begun. */
int pliant_patch_serves(const pliant_data *data);
/* The solver that a tool pulls at. */
pliant_solver *pliant_patch_solver(const pliant_data *data, int tool);
/* As pliant_solver_hold, of the solver that pliant_patch_solver says. */
pliant_status pliant_patch_hold(pliant_data *data, int tool);
/* From the next leg on a patch solves nothing, and moves with the coarse model, which has all points of contact: where
 * a patch after it would stop the leg. */
void pliant_patch_rest(pliant_data *data, bool rests);
/* The stage: data->positions are the coarse model's fine nodes, and become those of the patch. NOT_CONVERGED, NUMERIC,
 * MEMORY as pliant_solver_step; where it fails, the coarse model's part of the step is undone, too. What is told of the
 * tools (pliant_tool_report) changes with it. */
pliant_status pliant_patch_step(pliant_data *data);
/* Amid a step that they serve in, nodes and the coarse model are elsewhere, and they go there. begun: data->positions
 * as the step began. */
void pliant_patch_moved(pliant_data *data, const double *begun);
/* The displacement is dropped: the nodes are where the coarse model has them. */
void pliant_patch_flatten(pliant_patch *patch);

#ifdef __cplusplus
}
#endif

#endif
