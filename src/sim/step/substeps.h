/* A step that tissue gets by a tool in is taken anew, in parts: tools go there by and by. */
#ifndef PLIANT_SIM_SUBSTEPS_H
#define PLIANT_SIM_SUBSTEPS_H

#include "sim/step/contact.h"

#ifdef __cplusplus
extern "C" {
#endif

typedef struct pliant_substeps {
    int32_t count, at;     /* 0: it has not begun; 1: the step is whole; which of them it is at, from 1 */
    int32_t most;          /* that it may be taken in */
    bool patched;          /* a patch has had its part of it */
    int32_t turns;         /* that the coarse model and patches have taken beyond that */
    bool kept;             /* where nodes were as it, or the part that it is at, began, and with which points */
    double left;           /* share of the budget as the parts begin */
    double target[PLIANT_MAX_TOOLS][3]; /* of tools that hold by springs, as the step ends [m] */
} pliant_substeps;

/* Before the contact stage, as a whole, or in as many parts as tools turn far for. Where something presses that tissue can get by, or tools go far, it is kept where nodes
 * are; in the latter case all that the step begins with. */
void pliant_substeps_begin(const pliant_model *model, pliant_data *data, pliant_substeps *parts);
/* The points of the step, or of the part that it is at, are found: forces and anchors that it begins with are kept, where nodes are. */
void pliant_substeps_found(pliant_data *data, pliant_substeps *parts);
/* A part is done: pieces that have come off go on by theirs, and the next one begins. false: that was the last */
bool pliant_substeps_next(const pliant_model *model, pliant_data *data, pliant_substeps *parts);
/* Whether the step can be taken in more parts: as it began is kept, and there is time. */
bool pliant_substeps_can_be_more(const pliant_data *data, const pliant_substeps *parts);
/* Back to what the step began with, which is taken in twice as many parts, the first of which begins. Errors: MEMORY, of a backend that cannot go on from there. */
pliant_status pliant_substeps_again(const pliant_model *model, pliant_data *data, pliant_substeps *parts);
/* What a solve is repeated from: as the step, or the part that it is at, began, if that is kept; otherwise as it is now. */
pliant_contact_start pliant_substeps_start(pliant_data *data, const pliant_substeps *parts);
/* Of what is kept: whether there is memory for where it would have to return to. */
bool pliant_substeps_can_go_back(pliant_data *data);
/* Nodes and points to those of pliant_substeps_start, once that is asked; they have ended last where they were. Errors: of a backend that cannot go on from there. */
pliant_status pliant_substeps_back(const pliant_model *model, pliant_data *data);
/* Of what is kept: where a solve has ended. */
typedef enum pliant_substeps_end { PLIANT_ENDED_LAST, PLIANT_ENDED_WELL, PLIANT_ENDS } pliant_substeps_end;
/* It is where nodes and points are now. false: there is no memory for it */
bool pliant_substeps_here(const pliant_model *model, pliant_data *data, pliant_substeps_end which);
/* Nodes and points to it. Errors: as of pliant_substeps_back */
pliant_status pliant_substeps_there(const pliant_model *model, pliant_data *data, pliant_substeps_end which);
/* The step has failed: as it began, and tools are where they were set, where all that it began with is kept; needs no memory. */
void pliant_substeps_undo(const pliant_model *model, pliant_data *data, const pliant_substeps *parts);
/* Whether elements are inside out that were not as the step began, which is kept. */
bool pliant_substeps_turned(const pliant_data *data);
/* How many there are that were not as the part that it is at began, if that is kept. */
int32_t pliant_substeps_turn_over(const pliant_data *data);
void pliant_substeps_free(pliant_data *data);

#ifdef __cplusplus
}
#endif

#endif
