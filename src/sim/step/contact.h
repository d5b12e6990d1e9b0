/* A stage of the step: where tools touch the tissue. */
#ifndef PLIANT_SIM_CONTACT_H
#define PLIANT_SIM_CONTACT_H

#include "contact/detect/find.h"
#include "state/data.h"

#ifdef __cplusplus
extern "C" {
#endif

/* The points of this step; what was in touch in the last one goes on. Errors: MEMORY (those of the last step stay) */
pliant_status pliant_contact_stage(const pliant_model *model, pliant_data *data);
/* Whether there are parts that tissue may pass in this step: pliant_contact_passed has to be asked. */
bool pliant_contact_may_pass(const pliant_model *model, const pliant_data *data);
/* What a solve is repeated from: it began so, and what is found goes to its points; or all is as that solve has ended. */
typedef struct pliant_contact_start {
    const double *positions; /* (fine nodes x 3) [m] */
    pliant_contacts *points; /* of the same features as the simulation's, with forces and anchors of then */
} pliant_contact_start;
/* A quasi-static step, or a part of a frame of explicit dynamics, is solved, and its positions are the host's, those of pieces where its forces take them: whether tissue has gone by a tool's part, or slid into it, where no point was; there are points in `start` now, with which it is
 * solved again. Without memory for it: false. */
bool pliant_contact_passed(const pliant_model *model, pliant_data *data, const pliant_contact_start *start);
/* What that has found is left out: nothing is known of it. For the last one, if it was the only one since the points were found. */
void pliant_contact_forget_passed(pliant_data *data);
/* Of what that was last, how deep the deepest is in a tool, from the side that it has come in by, over how deep that is there; from 2 on it is through. */
double pliant_contact_passed_by(const pliant_data *data);
/* The most that a tool with a shape turns in the step, of what can be followed; one that has jumped turns nothing on its way. */
double pliant_contact_turn(const pliant_model *model, const pliant_data *data);
/* Over all of these points, the most of how deep one is in a tool, over how deep that is. began: where tools were as the step, or the part of a frame, began */
double pliant_contact_deepest(const pliant_data *data, const pliant_contacts *points, const double *positions, bool began);
/* Over points that the coarse model has to hold beside patches, the most of how deep one is in a tool, over how deep that is. */
double pliant_contact_deep_beside_patch(const pliant_data *data);
/* Whether a piece that has come off, and lies free, is in a tool by more than a tenth of that's depth, with pieces where the forces of now take them: in `start` it gives way less there now. */
bool pliant_contact_piece_is_deep(pliant_data *data, const pliant_contact_start *start);
/* It is solved again from where it has ended: what begins to touch sticks where it is now. */
void pliant_contact_goes_on_from_here(pliant_data *data);
/* The step is done: tools were where they are now. */
void pliant_contact_end(pliant_data *data);
/* Nothing has touched yet. */
void pliant_contact_forget(pliant_data *data);
/* Of a simulation that goes on as another one, of the same body. Errors: MEMORY */
pliant_status pliant_contact_copy(const pliant_data *from, pliant_data *to);
void pliant_contact_free(pliant_data *data);

/* What the stage begins with: tools, points, and what the search knows. All zero: nothing. */
typedef struct pliant_contact_kept {
    pliant_tool tools[PLIANT_MAX_TOOLS]; /* what they point to is the simulation's */
    pliant_contacts points;
    pliant_contact_search *search;       /* Nullable */
} pliant_contact_kept;
pliant_status pliant_contact_keep(const pliant_data *data, pliant_contact_kept *kept);  /* Errors: MEMORY */
pliant_status pliant_contact_again(const pliant_contact_kept *kept, pliant_data *data); /* Errors: MEMORY: it has to be undone */
void pliant_contact_undo(pliant_contact_kept *kept, pliant_data *data);                 /* needs no memory: what was kept is gone */
void pliant_contact_kept_free(pliant_contact_kept *kept);                               /* what it holds */
/* By feature. */
static inline int pliant_contact_compare(const void *a, const void *b)
{
    const uint64_t x = ((const pliant_contact_point *)a)->feature, y = ((const pliant_contact_point *)b)->feature;
    return (x > y) - (x < y);
}
static inline void pliant_contacts_exchange(pliant_contacts *a, pliant_contacts *b)
{
    const pliant_contacts swap = *a;
    *a = *b;
    *b = swap;
}

/* ---- contact_way.c */
#define PLIANT_CONTACT_MARGIN 1e-3 /* [m] that tissue may move in a step without a reason that is seen beforehand */
/* Whether the tool goes on from where it was in the last step: it was there, and has not jumped. */
bool pliant_contact_goes_on(const pliant_model *model, const pliant_tool *tool);
/* Where a tool is at a share of its way in the step, at whose end it is as it is set. */
void pliant_contact_pose(const pliant_tool *end, double share, double tip[3], double rotation[4], double *jaw);
/* There it goes, or, where it has jumped, it is at the end at once. */
void pliant_contact_go(const pliant_model *model, const pliant_tool *end, double share, pliant_tool *tool);
/* How far no point of a tool's part goes beyond in this step [m] */
double pliant_contact_way_of(const pliant_tool *tool, const pliant_part *part);
/* Whether any tool with a shape goes further in this step than half of an element, or a piece that may meet one. */
bool pliant_contact_goes_far(const pliant_model *model, const pliant_data *data);
/* Which pieces that have come off may meet a tool with a shape in this step, once it is foreseen how far they go. */
void pliant_contact_mark_pieces(const pliant_model *model, pliant_data *data);
/* The scene's obstacles, but for shapes. @return how many */
int32_t pliant_contact_obstacles(const pliant_model *model, pliant_part out[2 * PLIANT_MAX_FIXED]);
/* Whether anything that tissue can get by pressed as the last step ended. */
bool pliant_contact_presses(const pliant_model *model, const pliant_data *data);
/* Over parts of obstacles, and of tools that tissue is near, the most of how far one and the tissue near it go in this step, over its depth; every node goes on by its increment (nodes x 3) so
 * many times [m]. */
double pliant_contact_deeps(const pliant_model *model, const pliant_data *data, const double *increment, int32_t times);
/* ---- contact_access.c: of a tool's parts on the tissue in the last step, about where its tip was [N, N m] */
void pliant_contact_wrench(const pliant_data *data, int tool, double force[3], double torque[3]);

#ifdef __cplusplus
}
#endif

#endif
