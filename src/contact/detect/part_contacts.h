/* Contact points of the tissue's surface with moving rigid parts, for one leg. */
#ifndef PLIANT_CONTACT_PART_CONTACTS_H
#define PLIANT_CONTACT_PART_CONTACTS_H

#include "contact/contact.h"
#include "contact/advance/advance.h"
#include "contact/advance/near_triangles.h"
#include "contact/shapes/shapes.h"

#ifdef __cplusplus
extern "C" {
#endif

/* A rigid part in a leg. Its core is everything deeper than the guard depth below its surface. No tissue is in the
 * core at the start of the leg (contact/advance). */
typedef struct pliant_moving_part {
    const pliant_part *part;
    pliant_obstacle kind;
    int32_t tool, index;     /* for PLIANT_OBSTACLE_TOOL: tool and part; otherwise -1 and the obstacle's number */
    double friction;
    pliant_pose begin, end;  /* poses at the start and at the end of the leg */
    const pliant_tool_shape *shape; /* Nullable: the part is fixed */
    pliant_tool_pose from, to; /* poses of the tool, if there is a shape */
    double max_motion;              /* upper bound of the motion of the part's points [m] */
    double guard;            /* depth of the core below the surface [m] */
    double core_offset;      /* enlargement of the core by the error of the part's distance field [m] */
    double margin;           /* maximum distance from the surface for contact points [m] */
    double recovery;         /* maximum reduction of the penetration depth in the leg [m] */
    double remaining_depth_fraction; /* fraction of the penetration depth that remains (pliant_contact_permitted_gap) */
    double pushed_depth_fraction; /* fraction of the removed depth that counts as motion of the part */
    int32_t num_held;
    const int32_t *held;     /* (num_held) nodes that the tool holds, ascending; they have no contact with it */
} pliant_moving_part;

/* Buffers of the search. They keep no results. */
typedef struct pliant_contact_detector pliant_contact_detector;
/* @param settings Nullable: the defaults. Errors: MEMORY */
pliant_status pliant_contact_detector_create(const pliant_contact_settings *settings, pliant_contact_detector **out);
void pliant_contact_detector_free(pliant_contact_detector *detector);          /* Nullable */

/* Grow the capacity for points. Errors: MEMORY (nothing changed). */
pliant_status pliant_contacts_reserve(pliant_contacts *contacts, int32_t capacity);
/* Copy points. Errors: MEMORY (nothing changed). */
pliant_status pliant_contacts_copy(const pliant_contacts *from, pliant_contacts *to);

/* Set a function that lists the triangles near the parts, for the searches that follow. Nullable */
void pliant_contact_detector_set_finder(pliant_contact_detector *detector, const pliant_near_finder *finder);

/* Find the contact points of all parts and append them. They are ordered by part, and within a part by feature.
 * The top byte of a feature is 16 tool + part, or 128 + the obstacle's number. The next two bits are the kind: 0
 * node, 1 edge, 2 triangle, 3 corner of a triangle with a plane constraint. Two numbers of 26 bits follow: nodes,
 * or triangle and corner.
 * @param positions (fine nodes x 3) at the start of the leg [m]
 * @param before points of the previous leg, sorted by feature. An edge or triangle that had contact keeps it until
 *   it is higher than its neighbors. Its point follows the nearest point of a resting part with a delay.
 * @param blocked the previous leg was blocked: add plane constraints
 * Errors: MEMORY. */
pliant_status pliant_contact_find(pliant_contact_detector *detector, const pliant_body *body, const double *positions,
                                  const pliant_contacts *before, bool blocked, int32_t count,
                                  const pliant_moving_part *parts, int num_threads, pliant_contacts *out);
/* Return whether the last search delayed the motion of a point, so that its points must not be reused. */
bool pliant_contact_has_delayed(const pliant_contact_detector *detector);

#ifdef __cplusplus
}
#endif

#endif
