/* Contact in a leg: where tools and what stands still touch the tissue, and tissue itself; and how far the leg may go. */
#ifndef PLIANT_SIM_CONTACT_H
#define PLIANT_SIM_CONTACT_H

#include "contact/advance/advance.h"
#include "contact/detect/find.h"
#include "state/data.h"

#ifdef __cplusplus
extern "C" {
#endif

/* Whether there is nothing that could touch anything. */
bool pliant_contact_is_idle(const pliant_model *model, const pliant_data *data);
/* Points of the leg that data->legs describes; what was in touch in the last one goes on. Errors: MEMORY (points stay as they are) */
pliant_status pliant_contact_stage(const pliant_model *model, pliant_data *data);
/* How far the leg may go whose points were found last, and that has led the tissue to data->positions. @param share of proxies' ways. Errors: MEMORY */
pliant_status pliant_contact_advance(const pliant_model *model, pliant_data *data, double share, pliant_advance_result *out);
/* Points of tools go with proxies from where they were to go in the leg to where they are. */
void pliant_contact_follow_proxies(pliant_data *data);
/* Of a tool in a pose: whether no surface is in its core, and whether it is inside of one. Errors: MEMORY */
pliant_status pliant_contact_is_free(const pliant_model *model, pliant_data *data, int tool, const pliant_tool_pose *pose, bool *is_free, bool *is_inside);
/* Box around the surface, as the points were found last: whether a tool comes near it on its way. */
bool pliant_contact_comes_near(pliant_data *data, const pliant_tool *tool, const pliant_tool_pose *from, const pliant_tool_pose *to);
/* (fine nodes) which rigid piece, or -1; NULL: there is none. */
const int32_t *pliant_contact_pieces(const pliant_data *data);
/* Whether elements keep their least volume (contact/advance/volume.h): linear tetrahedra whose own nodes the solver moves. */
bool pliant_contact_keeps_volumes(const pliant_data *data);
/* Nothing has touched yet. */
void pliant_contact_forget(pliant_data *data);
/* Of a simulation that goes on as another one, of the same body. Errors: MEMORY */
pliant_status pliant_contact_copy(const pliant_data *from, pliant_data *to);
void pliant_contact_free(pliant_data *data);

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
/* The scene's obstacles, but for shapes. @return how many */
int32_t pliant_contact_obstacles(const pliant_model *model, pliant_part out[2 * PLIANT_MAX_FIXED]);
/* Over parts of obstacles, and of tools that tissue is near, the most of how far one and the tissue near it go in this step, over its depth; every node goes on by its increment (nodes x 3) so
 * many times [m]. */
double pliant_contact_deeps(const pliant_model *model, const pliant_data *data, const double *increment, int32_t times);
/* Which pieces that have come off may meet a tool with a shape in this leg, once it is foreseen how far they go. */
void pliant_contact_mark_pieces(pliant_data *data);
/* ---- contact_access.c: of a tool's parts on the tissue in the last step, about where its proxy's tip was [N, N m] */
void pliant_contact_wrench(const pliant_data *data, int tool, double force[3], double torque[3]);

/* What the coupling of a tool gives way for the tissue of pieces under it, which are rigid here: as of a cube of that volume, 1 / (E V^(1/3)) [m/N]; and its jaws at
 * the levers of those points [rad/(N m)]. 0: it touches none.
 * @param pressing of points that have pushed; otherwise of those that overlap */
void pliant_contact_gives(const pliant_data *data, int tool, bool pressing, const double joint[3], const double axis[3], double out[2]);

#ifdef __cplusplus
}
#endif

#endif
