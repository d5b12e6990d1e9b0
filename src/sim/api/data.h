/* Internal functions of simulations, in addition to pliant/data.h. */
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

/* Install another topology in a simulation: the next one after a cut, or an earlier one. All derived data are
 * prepared first and installed together, so an error leaves the simulation unchanged. Nodes keep their positions
 * and velocities, and copied nodes start with those of their originals. Grasps stay. An equal topology changes no
 * results. Errors: MEMORY, NUMERIC, SCENE, ARGUMENT (another mesh). */
pliant_status pliant_data_set_body(const pliant_model *model, pliant_data *data, const pliant_body *body);

/* Return the highest revision of the simulation's topologies; the next topology gets this number plus 1. */
PLIANT_INTERNAL uint64_t pliant_data_get_last_revision(const pliant_data *data);

/* Return the size of the simulation's factors, which pliant_memory_in_use() does not include [bytes]. */
PLIANT_INTERNAL size_t pliant_data_get_factor_bytes(const pliant_data *data);

#ifdef __cplusplus
}
#endif
#endif
