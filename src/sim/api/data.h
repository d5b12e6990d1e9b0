/* Simulations: functions for nodes, Python and tests. */
#ifndef PLIANT_SIM_DATA_H
#define PLIANT_SIM_DATA_H

#include "base/export.h"
#include "pliant/data.h"

#ifdef __cplusplus
extern "C" {
#endif

/* Return the name of a pliant_step_stage, static. */
PLIANT_INTERNAL const char *pliant_step_stage_name(int stage);

/* Set a simulation to the state of another one of the same pliant_model, as pliant_state_save and pliant_state_restore
 * do. Errors (data unchanged): as of pliant_data_copy. */
PLIANT_INTERNAL pliant_status pliant_data_move(const pliant_model *model, pliant_data *data, pliant_data *from);

/* Replace the body of a simulation. All derived data are prepared first, then swapped: after an error, the simulation
 * continues with the same bits. Nodes keep their positions and velocities, and copies start with those of their source.
 * Tools keep their grasps. Errors: MEMORY, NUMERIC, SCENE, ARGUMENT (another mesh). */
pliant_status pliant_data_set_body(const pliant_model *model, pliant_data *data, const pliant_body *body);

/* Return the highest revision of the simulation's bodies so far. The next body has a higher one. */
PLIANT_INTERNAL uint64_t pliant_data_get_last_revision(const pliant_data *data);

/* Return the memory of the factors, which pliant_memory_in_use() does not include [bytes]. */
PLIANT_INTERNAL size_t pliant_data_get_factor_bytes(const pliant_data *data);

#ifdef __cplusplus
}
#endif
#endif
