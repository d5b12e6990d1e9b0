/* A stage of the step: where tools touch the tissue. */
#ifndef PLIANT_SIM_CONTACT_H
#define PLIANT_SIM_CONTACT_H

#include "state/data.h"

#ifdef __cplusplus
extern "C" {
#endif

/* The points of this step; what was in touch in the last one goes on. Errors: MEMORY (those of the last step stay) */
pliant_status pliant_contact_stage(const pliant_model *model, pliant_data *data);
/* Whether the tool goes on from where it was in the last step: it was there, and has not jumped. */
bool pliant_contact_goes_on(const pliant_model *model, const pliant_tool *tool);
/* Whether any tool with a shape goes further in this step than half of an element. */
bool pliant_contact_goes_far(const pliant_model *model, const pliant_data *data);
/* Over parts of tools and obstacles, the most of how far one and the tissue near it go in this step, over its depth; every node goes on by its increment (nodes x 3) so many times [m]. */
double pliant_contact_deeps(const pliant_model *model, const pliant_data *data, const double *increment, int32_t times);
/* Whether there are parts that tissue may pass in this step: pliant_contact_passed has to be asked. */
bool pliant_contact_may_pass(const pliant_model *model, const pliant_data *data);
/* A quasi-static step is solved, and its positions are the host's: whether tissue has gone by a tool's part, or slid into it, where no point was; there are points now, with which it is solved
 * again. Without memory for it: false. */
bool pliant_contact_passed(const pliant_model *model, pliant_data *data);
/* The most that a tool with a shape turns in the step, of what can be followed; one that has jumped turns nothing on its way. */
double pliant_contact_turn(const pliant_model *model, const pliant_data *data);
/* Whether anything pressed as the last step ended. */
bool pliant_contact_presses(const pliant_data *data);
/* It is solved again from where it has ended: what begins to touch sticks where it is now. */
void pliant_contact_goes_on_from_here(pliant_data *data);
/* The step is done: tools were where they are now. */
void pliant_contact_end(pliant_data *data);
/* Nothing has touched yet. */
void pliant_contact_forget(pliant_data *data);
/* Of a simulation that goes on as another one, of the same body. Errors: MEMORY */
pliant_status pliant_contact_copy(const pliant_data *from, pliant_data *to);
void pliant_contact_free(pliant_data *data);
/* ---- contact_access.c: of a tool's parts on the tissue in the last step, about where its tip was [N, N m] */
void pliant_contact_wrench(const pliant_data *data, int tool, double force[3], double torque[3]);

#ifdef __cplusplus
}
#endif

#endif
