/** @file state.h
 *  The simulation state: everything that a step changes and that cannot be recomputed. Save it, restore it, and the same steps follow.
 *
 *  | in the state | not in the state: a restored simulation starts with it as a new one does |
 *  |---|---|
 *  | topology after cuts, and the topologies that an undo returns to | factors, and what the solver learned in earlier steps |
 *  | positions; in explicit dynamics velocities, relaxed stresses, number of sub-steps | patches (model/patch) and other work in the background |
 *  | contact points with forces and anchors | the deformed volume, which follows at the next step |
 *  | tools: poses, shapes, grasps, blades and their strokes | buffers |
 *  | rigid pieces: poses and velocities | |
 *  | gravity, limits of a step, statistics | |
 */
#ifndef PLIANT_STATE_H
#define PLIANT_STATE_H

#include "pliant/data.h"

#ifdef __cplusplus
extern "C" {
#endif

typedef struct pliant_state pliant_state; /**< opaque */

/** An empty state. Errors: MEMORY. */
PLIANT_API pliant_status pliant_state_create(pliant_state **out);
PLIANT_API void pliant_state_free(pliant_state *state); /**< Nullable. Before the model of the simulation that it was saved from. */

/** Copy a simulation's state. Arrays that fit are reused; the simulation stays as it is.
 *  Errors: MEMORY, ARGUMENT (a simulation of another model). After an error the state is as before. */
PLIANT_API pliant_status pliant_state_save(const pliant_model *model, pliant_data *data, pliant_state *state);

/** Set a simulation to a saved state, as often as needed: the same steps give the same bits each time. The state may be of another simulation
 *  of the same pliant_model. The deformed volume follows at the next step. After save the simulation does not continue with the same bits as
 *  after restore, because it keeps its factors; restore at once where this matters.
 *  Errors: ARGUMENT (an empty state; a state of another model), MEMORY, NUMERIC, SCENE. After an error the simulation is as before. */
PLIANT_API pliant_status pliant_state_restore(const pliant_model *model, pliant_data *data, const pliant_state *state);

#ifdef __cplusplus
}
#endif
#endif
