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

/** Write a state to memory. This version reads it again on the same kind of machine. The bytes do not contain the topology: save the cuts (pliant_cuts)
 *  in addition. They do not contain tool shapes, topologies to undo, and the memory of the contact search. Without that memory, rigid pieces
 *  in contact may continue with other contact points.
 *  @param size bytes in out; if fewer than needed, nothing is written. @param out Nullable when size is 0. @return number of bytes needed; 0: an empty state */
PLIANT_API size_t pliant_state_write(const pliant_state *state, size_t size, void *out);
/** Read a state of a model that was built alike. Tools are compared with those of data: names, blades, order. Equal tools are restored, with the
 *  shapes of data. Otherwise the state gets the tools of data, without grasps and contacts.
 *  @param body the saved topology: the model's body, or a body with the saved cuts
 *  Errors: FORMAT (damaged, of another version, of another mesh), MEMORY. After an error the state is as before. */
PLIANT_API pliant_status pliant_state_read(const pliant_model *model, const pliant_data *data, const pliant_body *body, size_t size, const void *bytes,
                                           pliant_state *state);

#ifdef __cplusplus
}
#endif
#endif
