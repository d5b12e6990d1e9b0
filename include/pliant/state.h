/** @file state.h
 *  The state of a simulation: everything that a step changes and that cannot be recomputed. Undo, snapshots and replay
 *  use it.
 *
 *  The state contains:
 *  - the topology after cuts, and the topologies that an undo returns to
 *  - positions; in explicit dynamics also velocities, relaxed stresses and the number of sub-steps
 *  - contact points with forces and anchors
 *  - tools: poses, shapes, grasps, blades and strokes
 *  - rigid pieces: poses and velocities
 *  - gravity, the limits of a step, statistics
 *
 *  A restored simulation starts as a new one with everything else: factors, the solver's history, patches
 *  (model/patch), background work.
 */
#ifndef PLIANT_STATE_H
#define PLIANT_STATE_H

#include "pliant/data.h"

#ifdef __cplusplus
extern "C" {
#endif

typedef struct pliant_state pliant_state; /**< opaque */

/** Create an empty state.
 *  @param out Out: free with pliant_state_free, before the model of the saved simulation.
 *  @return Errors: MEMORY. */
PLIANT_API pliant_status pliant_state_create(pliant_state **out);

/** Free a state.
 *  @param state Nullable. */
PLIANT_API void pliant_state_free(pliant_state *state);

/** Copy the state of a simulation. Arrays that fit are reused. The simulation does not change.
 *  @param model The model of the simulation.
 *  @param data  The simulation.
 *  @param state Unchanged after an error.
 *  @return Errors: MEMORY, ARGUMENT (a simulation of another model). */
PLIANT_API pliant_status pliant_state_save(const pliant_model *model, pliant_data *data, pliant_state *state);

/** Set a simulation to a saved state, any number of times. After each restore, the same steps give the same bits. The
 *  deformed volume follows at the next step. A simulation that was only saved keeps its factors. Its next steps may
 *  differ from the steps after a restore, by rounding and by the solver's tolerance. Restore it at once where this
 *  matters.
 *  @param model The model of the simulation.
 *  @param data  Unchanged after an error. It may be another simulation of the same pliant_model.
 *  @param state The saved state.
 *  @return Errors: ARGUMENT (an empty state, or a state of another model), MEMORY, NUMERIC, SCENE. */
PLIANT_API pliant_status pliant_state_restore(const pliant_model *model, pliant_data *data, const pliant_state *state);

/** Write a state to memory, for this version on the same kind of machine. The bytes do not contain the topology, tool
 *  shapes, topologies to undo, and the memory of the contact search. Without that memory, rigid pieces in contact may
 *  continue with other contact points.
 *  @param state The state.
 *  @param size  Size of out [bytes]; if it is too small, nothing is written.
 *  @param out   (size) Out; Nullable if size is 0.
 *  @return The required size [bytes]; 0 for an empty state. */
PLIANT_API size_t pliant_state_write(const pliant_state *state, size_t size, void *out);

/** Read a state of an equal model. Tools are compared with the tools of data by name, blade and order. Equal tools are
 *  restored, with the shapes of data. Otherwise the state gets the tools of data, without grasps and contacts.
 *  @param model The model of the simulation.
 *  @param data  A simulation of the model.
 *  @param body  The saved topology: the model's body, or a body with the saved cuts.
 *  @param size  Size of bytes.
 *  @param bytes (size) From pliant_state_write.
 *  @param state Out: unchanged after an error.
 *  @return Errors: FORMAT (damaged, another version, another mesh), MEMORY. */
PLIANT_API pliant_status pliant_state_read(const pliant_model *model, const pliant_data *data, const pliant_body *body,
                                           size_t size, const void *bytes, pliant_state *state);

#ifdef __cplusplus
}
#endif
#endif
