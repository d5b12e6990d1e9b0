/* Simulations: what the library needs beyond pliant/data.h. */
#ifndef PLIANT_SIM_DATA_H
#define PLIANT_SIM_DATA_H

#include "base/export.h"
#include "pliant/data.h"

#ifdef __cplusplus
extern "C" {
#endif

PLIANT_INTERNAL const char *pliant_step_stage_name(int stage);

/* Set this simulation to the state of another one of the same pliant_model: pliant_state_save and pliant_state_restore in one call. A second model of
 *  the same scan and scene is another model. Errors: as of pliant_data_copy; after an error the simulation is as before. */
PLIANT_INTERNAL pliant_status pliant_data_take(const pliant_model *model, pliant_data *data, pliant_data *from);

/* From now on another body is true: the next one, or one from before. What is derived from a body is made for it first, and only
 *  then put to use: on an error everything goes on with the body before, bit for bit. Nodes keep their positions and velocities, copies
 *  begin with those of what they are copies of; tools keep hold. A body of the same topology changes no bits of what follows. Errors: MEMORY, NUMERIC, SCENE, ARGUMENT (not of this simulation's mesh). */
pliant_status pliant_data_set_body(const pliant_model *model, pliant_data *data, const pliant_body *body);

/* Highest revision of its bodies so far: the next one takes one more. */
PLIANT_INTERNAL uint64_t pliant_data_get_last_revision(const pliant_data *data);

/* What the factors of a simulation hold, which pliant_memory_in_use() does not know of [bytes]. */
PLIANT_INTERNAL size_t pliant_data_get_factor_bytes(const pliant_data *data);

#ifdef __cplusplus
}
#endif
#endif
