/* The cut stage, the first stage of a step, and the topologies for undo. */
#ifndef PLIANT_SIM_CUT_H
#define PLIANT_SIM_CUT_H

#include "cut/cut.h"
#include "model_data/data.h"

#ifdef __cplusplus
extern "C" {
#endif

/* Cut the tissue that the blades sweep through in this step, up to the limit that its toughness sets. An error is
 * logged once for each stroke and leaves the state unchanged; the step continues. Always return PLIANT_OK. */
pliant_status pliant_cut_stage(const pliant_model *model, pliant_data *data);

/* Cut along a sweep and install the new topology; the previous one is kept for undo. A sweep that cuts nothing
 * changes nothing.
 * @param tool -1: for pliant_data_cut; @param report out
 * Errors: MEMORY, NUMERIC, SCENE, ARGUMENT. */
pliant_status pliant_data_cut_along_sweep(const pliant_model *model, pliant_data *data, int tool,
                                          const pliant_cut_sweep *sweep, pliant_cut_report *report);

/* warm_up_cut.c: make and discard cuts, so that the first real cut finds its memory, threads and kernels ready. Nothing
 * else changes. Failures are ignored. */
void pliant_warm_up_cut(const pliant_model *model, pliant_data *data);

/* Discard all topologies for undo. */
void pliant_undo_clear(pliant_data *data);

#ifdef __cplusplus
}
#endif
#endif
