/* Contact in one leg: find the contact points of tissue with tools, obstacles and tissue, and find the largest
 * fraction of the leg that is free of penetration. */
#ifndef PLIANT_SIM_CONTACT_H
#define PLIANT_SIM_CONTACT_H

#include "contact/advance/advance.h"
#include "contact/detect/part_contacts.h"
#include "model_data/data.h"

#ifdef __cplusplus
extern "C" {
#endif

/* Return whether nothing could be in contact with the tissue, and no tool could invert elements by a pull. */
bool pliant_contact_is_idle(const pliant_model *model, const pliant_data *data);
/* Find the contact points of the leg that data->legs describes. Points that persist keep their forces and anchors.
 * Errors: MEMORY (the points stay unchanged). */
pliant_status pliant_contact_find_points(const pliant_model *model, pliant_data *data);
/* Find the largest fraction of a leg in which no tissue enters the core of a part. The leg goes from the surface at its
 * start to data->positions.
 * @param fraction fraction of the proxies' motion that belongs to these positions
 * @param find_islands if the leg is blocked, find the fraction of each island (contact_islands.c)
 * @param out the largest fraction
 * Errors: MEMORY. */
pliant_status pliant_contact_advance(const pliant_model *model, pliant_data *data, double fraction, bool find_islands,
                                     double *out);
/* Find the largest fraction of a leg in which no tissue passes through tissue. Errors: MEMORY. */
pliant_status pliant_contact_advance_tissue(const pliant_model *model, pliant_data *data, double *fraction);
/* Return the largest fraction of a leg in which the sides of a severed cut do not overlap (pliant_cut_advance). */
double pliant_contact_advance_cuts(const pliant_model *model, const pliant_data *data);
/* For debug builds: check the invariant after a leg, by other algorithms than pliant_contact_advance. Return whether no
 * tissue is in the core of a part. True if a pair overlapped when the leg began, or without memory for the check. */
bool pliant_contact_is_outside_cores(const pliant_model *model, pliant_data *data);
/* Move the contact points of tools from the proxies' predicted poses to their poses after the leg. */
void pliant_contact_follow_proxies(pliant_data *data);
/* Check a tool at a pose: whether no surface is in its core, and whether the tool is inside tissue. Errors: MEMORY. */
pliant_status pliant_contact_is_free(const pliant_model *model, pliant_data *data, int tool,
                                     const pliant_tool_pose *pose, bool *is_free, bool *is_inside);
/* Return whether a tool's motion comes near the bounding box of the surface. True also without memory for the check. */
bool pliant_contact_is_near(pliant_data *data, const pliant_tool *tool, const pliant_tool_pose *from,
                            const pliant_tool_pose *to);
/* Return the rigid piece of each fine node, or -1. NULL: there are no rigid pieces, or explicit dynamics moves them. */
const int32_t *pliant_contact_pieces(const pliant_data *data);
/* Return whether an element may be small (backend.h). False: the volume bound has nothing to do. */
bool pliant_contact_may_have_small_elements(const pliant_model *model, pliant_data *data, bool in_leg);
/* Discard all contact points. */
void pliant_contact_discard(pliant_data *data);
/* Copy the contact state to another simulation of the same topology. Errors: MEMORY. */
pliant_status pliant_contact_copy(const pliant_data *from, pliant_data *to);
void pliant_contact_free(pliant_data *data);

/* Compare by feature, for sorting. */
static inline int pliant_contact_compare(const void *a, const void *b)
{
    const uint64_t x = ((const pliant_contact_point *)a)->feature, y = ((const pliant_contact_point *)b)->feature;
    return (x > y) - (x < y);
}
static inline void pliant_contacts_swap(pliant_contacts *a, pliant_contacts *b)
{
    const pliant_contacts swap = *a;
    *a = *b;
    *b = swap;
}

/* ---- contact_obstacles.c */
/* Write the scene's boxes and planes as parts. Return their number. */
int32_t pliant_contact_obstacles(const pliant_model *model, pliant_part out[2 * PLIANT_MAX_FIXED]);
/* Return the largest motion in the rest of this step divided by the depth of the part. The motion is the sum of the
 * part's and of the nearby tissue's motion. Parts of tools far from tissue do not count.
 * @param increment (nodes x 3) motion of each node in one sub-step [m]
 * @param times number of sub-steps
 * @param tool_motion out: largest sum for a tool near tissue, not divided by a depth [m] */
double pliant_contact_max_motion_ratio(const pliant_model *model, const pliant_data *data, const double *increment,
                                       int32_t times, double *tool_motion);
/* Mark the detached pieces that can meet a tool with a shape in this leg, by their predicted motion. */
void pliant_contact_mark_pieces(pliant_data *data);
/* ---- contact_access.c
 * Compute the force and torque of a tool's parts on the tissue in the last step, about the tip of its proxy
 * [N, N m]. */
void pliant_contact_wrench(const pliant_data *data, int tool, double force[3], double torque[3]);
/* ---- contact_error.c
 * Estimate the error of a tool's contact force [N], as a standard deviation. Each part of the tool has its own error,
 * and their squares are added. */
double pliant_contact_force_error(const pliant_data *data, int tool);
/* Log one warning for each tool under which the mesh lacks a tenth of the dimple. */
void pliant_contact_warn_of_cells(pliant_data *data);
/* Compute the position at which a point's force acts, on the side with positive weights. positions: (nodes x 3) */
void pliant_contact_force_position(const double *positions, const pliant_contact_point *point, double out[3]);
/* Return whether a point has a contact force. */
bool pliant_contact_presses(const pliant_data *data, const pliant_contact_point *point);

/* Return the largest distance of a tool near tissue in one leg [m]. No proxy that is loaded at the end moves twice
 * as far. */
double pliant_contact_leg_distance(const pliant_data *data);

#ifdef __cplusplus
}
#endif

#endif
