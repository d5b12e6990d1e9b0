/* A frame of explicit dynamics is run in parts where tools and tissue go far in it: each finds its points of contact anew. */
#ifndef PLIANT_SIM_FRAME_PARTS_H
#define PLIANT_SIM_FRAME_PARTS_H

#include "state/data.h"

#ifdef __cplusplus
extern "C" {
#endif

/* Before the contact stage of each part, the first one, too: how many sub-steps it has, and tools go as far. Without memory for what the frame begins with it is run
 * as a whole. Of quasi-static solvers: nothing. */
void pliant_frame_part_begin(const pliant_model *model, pliant_data *data);
/* Its points are found, and it is to be run. */
void pliant_frame_part_found(pliant_data *data);
/* It has been run, and its positions are the host's. *again: tissue has got by a tool in it; it is as it began, and has points of that now: to be run once more. If that is of no use, it is as it has ended first.
 * Errors: of a backend that cannot go on from there. */
pliant_status pliant_frame_part_gets_by(const pliant_model *model, pliant_data *data, bool *again);
/* Running it has failed: whether it was run before, and is as that has ended now. */
bool pliant_frame_part_stays(const pliant_model *model, pliant_data *data);
/* A part is done. *more: another one follows; otherwise contacts tell of the whole frame. Errors: MEMORY */
pliant_status pliant_frame_part_end(pliant_data *data, bool *more);
/* The step has failed: as it began, and tools are where they were set; needs no memory. */
void pliant_frame_undo(const pliant_model *model, pliant_data *data);
void pliant_frame_parts_free(pliant_data *data);

#ifdef __cplusplus
}
#endif

#endif
