/** @file state.h
 *  The simulation state: everything that a step changes and that cannot be recomputed.
 *
 *  The state contains:
 *  - the topology after cuts, and the topologies that an undo returns to
 *  - positions; in explicit dynamics also velocities, relaxed stresses and the number of sub-steps
 *  - contact points with forces and anchors
 *  - tools: poses, shapes, grasps, blades and strokes
 *  - rigid pieces: poses and velocities
 *  - gravity, the limits of a step, statistics
 *
 *  A restored simulation starts as a new one with everything else: factors, the solver's history, patches (model/patch), other work in the background.
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

/** Set a simulation to a saved state, as often as needed. After each restore the same steps give the same bits. The state may be of another
 *  simulation of the same pliant_model. The deformed volume follows at the next step. A simulation that was only saved keeps its factors, so its
 *  next steps may differ from those after a restore by rounding and by the solver's tolerance. Restore it at once where this matters.
 *  Errors: ARGUMENT (an empty state; a state of another model), MEMORY, NUMERIC, SCENE. After an error the simulation is as before. */
PLIANT_API pliant_status pliant_state_restore(const pliant_model *model, pliant_data *data, const pliant_state *state);

/** Write a state to memory, for a file that this version reads on this kind of machine. The bytes hold the topology's positions but not the topology
 *  (save the body's cuts beside them), no tool shapes, nothing to undo,
 *  and no memory of the contact search, so that rigid pieces in contact may continue with other contact points.
 *  @param room bytes in out; less than needed: nothing is written. @param out Nullable when room is 0. @return bytes that are needed; 0: an empty state */
PLIANT_API size_t pliant_state_write(const pliant_state *state, size_t room, void *out);
/** Read a state of a model that was built alike. If the tools of data have the saved names and blades, in the saved order, they are restored with the
 *  shapes that they have in data. Otherwise the state has the tools of data, without grasps and contacts.
 *  @param body of that topology: the model's, or one that was cut as the saved one
 *  Errors: FORMAT (damaged, of another version, of another mesh), MEMORY. After an error the state is as before. */
PLIANT_API pliant_status pliant_state_read(const pliant_model *model, const pliant_data *data, const pliant_body *body, size_t size, const void *bytes,
                                           pliant_state *state);

#ifdef __cplusplus
}
#endif
#endif
