/* Contacts of the tissue's surface with rigid parts that move: the points of a leg. */
#ifndef PLIANT_CONTACT_FIND_H
#define PLIANT_CONTACT_FIND_H

#include "contact/contact.h"
#include "contact/advance/advance.h"
#include "contact/shapes/shapes.h"

#ifdef __cplusplus
extern "C" {
#endif

/* A part in a leg. Its core, everything deeper than the guard depth below its surface, has no tissue in it as the leg begins (contact/advance). */
typedef struct pliant_moving_part {
    const pliant_part *part;
    pliant_obstacle kind;
    int32_t tool, index;     /* of PLIANT_OBSTACLE_TOOL: tool and part; otherwise -1 and which obstacle */
    double friction;
    pliant_pose begin, end;  /* where it is as the leg begins, and where it shall go */
    const pliant_tool_shape *shape; /* Nullable: it stands still */
    pliant_tool_pose from, to; /* of its tool, with that */
    double way;              /* no point of it goes further [m] */
    double guard;            /* depth of its core below its surface [m] */
    double off;              /* by which that core is larger, since the part's distances may be off by it [m] */
    double margin;           /* points are looked for up to this distance from its surface [m] */
    double recovery;         /* of how far tissue is in it as the leg begins, at most this is undone [m] */
    double stays;            /* and this share of it is left (pliant_contact_left) */
    int32_t num_held;
    const int32_t *held;     /* (num_held) ascending: nodes that its tool holds, and that it does not touch */
} pliant_moving_part;

/* Room for the search; nothing of it outlives one. */
typedef struct pliant_finder pliant_finder;
/* @param settings Nullable: the defaults. Errors: MEMORY */
pliant_status pliant_finder_create(const pliant_contact_settings *settings, pliant_finder **out);
void pliant_finder_free(pliant_finder *finder);          /* Nullable */

/* Room for more points. Errors: MEMORY (nothing changed). */
pliant_status pliant_contacts_reserve(pliant_contacts *contacts, int32_t room);
/* Errors: MEMORY (nothing changed). */
pliant_status pliant_contacts_copy(const pliant_contacts *from, pliant_contacts *to);

/* Append the points of parts, in their order, each part's ascending by feature. The feature's top byte is 16 tool + part, or 128 + the obstacle's number;
 * then come two bits for what of the surface it is (0: a node, 1: an edge, 2: a triangle, 3: a corner of a triangle that a plane keeps out of a core), and
 * 26 for each of two numbers: nodes, or a triangle and its corner.
 * @param before points of the leg before, ascending by feature: an edge or a triangle that pressed then goes on until it is higher than what borders it
 * @param positions (fine nodes x 3) as the leg begins
 * @param blocked   the leg before could not go all of its way: planes keep what stopped it out of cores. Errors: MEMORY */
pliant_status pliant_contact_find(pliant_finder *finder, const pliant_body *body, const double *positions, const pliant_contacts *before, bool blocked, int32_t count,
                                  const pliant_moving_part *parts, pliant_contacts *out);

#ifdef __cplusplus
}
#endif

#endif
