/* Cutting: the first stage of a step, and what can be undone. */
#ifndef PLIANT_SIM_CUT_H
#define PLIANT_SIM_CUT_H

#include "cut/cut.h"
#include "state/data.h"

#ifdef __cplusplus
extern "C" {
#endif

/* What blades sweep through in this step is severed, as far as its toughness lets it. What goes wrong is logged, once a stroke, and leaves
 * everything as it was: the step goes on. Always OK. */
pliant_status pliant_cut_stage(const pliant_model *model, pliant_data *data);

/* What a sweep severs becomes the simulation's body; the one before can be had again. Nothing severed: nothing changes.
 * @param tool -1: of pliant_data_cut; @param report out. Errors: MEMORY, NUMERIC, SCENE, ARGUMENT. */
pliant_status pliant_data_sever(const pliant_model *model, pliant_data *data, int tool, const pliant_cut_sweep *sweep, pliant_cut_report *report);

/* rehearse.c: what a first cut asks for is there afterwards, as far as it can be had, and nothing else is another. */
void pliant_rehearse_cut(const pliant_model *model, pliant_data *data);

/* Nothing can be undone any more. */
void pliant_undo_clear(pliant_data *data);

#ifdef __cplusplus
}
#endif
#endif
