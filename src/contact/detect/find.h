/* Contacts of the tissue's surface with rigid parts that move: the points of a step. */
#ifndef PLIANT_CONTACT_FIND_H
#define PLIANT_CONTACT_FIND_H

#include "contact/contact.h"
#include "contact/shapes/shapes.h"

#ifdef __cplusplus
extern "C" {
#endif

/* A part while a step goes on. */
typedef struct pliant_moving_part {
    const pliant_part *part;
    pliant_obstacle kind;
    int32_t tool, index;     /* of PLIANT_OBSTACLE_TOOL: tool and part; otherwise -1 and which obstacle */
    double friction;
    int32_t num_poses;       /* at least 1 */
    const pliant_pose *pose; /* (num_poses) from where it was, at equal times, to where it is at the end of the step */
    double stride;           /* no point of it goes further from one pose to the next [m] */
    double margin;           /* points are looked for up to this distance, and the tissue's own way [m] */
    double recovery;         /* of how far tissue is in it as the step begins, at most this is undone [m] */
    double stays;            /* and this share of it is left (pliant_contact_left) */
    bool briefly;            /* of a part of a frame of explicit dynamics: the search is repeated before tissue or part go far */
    bool remembers;          /* where it is now is where it was at the end of the last step: which side of it tissue was on still holds */
    int32_t num_held;
    const int32_t *held;     /* (num_held) ascending: nodes that its tool holds, and that it does not touch */
} pliant_moving_part;

/* Room for the search, and which side of parts the tissue was on. */
typedef struct pliant_finder pliant_finder;
pliant_status pliant_finder_create(pliant_finder **out); /* Errors: MEMORY */
void pliant_finder_free(pliant_finder *finder);          /* Nullable */
/* Sides are forgotten, and how the tissue moved. */
void pliant_finder_forget(pliant_finder *finder);

/* Points of the last step, ascending by feature, with the forces that were found for them. */
void pliant_finder_tell(pliant_finder *finder, const pliant_contacts *contacts);

/* What is known of the step before, of the same body. Errors: MEMORY (nothing changed) */
pliant_status pliant_finder_copy(const pliant_finder *from, pliant_finder *to);

/* What pliant_contact_find_passed has added to what is known, where it was called once since pliant_contact_find, is forgotten. */
void pliant_finder_forget_more(pliant_finder *finder);

/* Room for more points. Errors: MEMORY (nothing changed). */
pliant_status pliant_contacts_reserve(pliant_contacts *contacts, int32_t room);
/* Errors: MEMORY (nothing changed). */
pliant_status pliant_contacts_copy(const pliant_contacts *from, pliant_contacts *to);

/* Append the points of parts, in their order, each part's ascending by feature. The feature's top byte is 16 tool + part, or 128 + the obstacle's number;
 * then come two bits for what of the surface it is (0: a node, 1: an edge, 2 and 3: a triangle), 26 for each of two node numbers, and two for which of its points
 * it is: 0, and more where an edge or a triangle has slid into the part beside it.
 * A step that is undone is searched for again. @param positions (fine nodes x 3) as the step begins. Errors: MEMORY */
pliant_status pliant_contact_find(pliant_finder *finder, const pliant_body *body, const double *positions, int32_t count, const pliant_moving_part *parts,
                                  pliant_contacts *out);

/* ---- passed.c: once a step is solved */
/* How far a node of the surface has gone in it, at most [m]. */
double pliant_contact_way(const pliant_finder *finder, const double *positions);
/* Appends points of what has passed a part in the step or slid into it, where any of it gets by: beyond the part or a quarter of its depth in it, or by twice
 * its depth further on. Of the search of which the finder's is the last; one of a feature that has
 * PLIANT_FEATURE_POINTS already takes the place of the last. Parts: their poses are those of the step, with as many between as its way and the tissue's take; margin and stride are of both.
 * @param positions (fine nodes x 3) as the step has ended. Errors: MEMORY */
pliant_status pliant_contact_find_passed(pliant_finder *finder, const pliant_body *body, const double *positions, int32_t count,
                                         const pliant_moving_part *parts, pliant_contacts *out);
#ifdef __cplusplus
}
#endif

#endif
