/* Rigid obstacles: how far a point is from a part, and where parts are while they move. */
#ifndef PLIANT_CONTACT_SHAPES_H
#define PLIANT_CONTACT_SHAPES_H

#include "pliant/contact.h"

#ifdef __cplusplus
extern "C" {
#endif

/* Signed distance [m] of a point in the part's frame, negative inside. @param normal outwards, unit: the gradient; 0 0 0 where no direction
 * out is the shortest. The surface's point next to p is p - distance normal. */
double pliant_part_distance(const pliant_part *part, const double p[3], double normal[3]);
/* From a point inside along a direction (unit) to where it leaves the part. @param out in the part's frame */
void pliant_part_leave(const pliant_part *part, const double p[3], const double direction[3], double out[3]);
/* How deep its deepest point is [m]. */
double pliant_part_depth(const pliant_part *part);
/* What lies deeper than the guard depth below its surface, which is less than it is deep: all that is that far from this core has the part's distance plus
 * guard from it. A box has no edges then: its surface is rounded off by the guard depth. */
pliant_part pliant_part_core(const pliant_part *part, double guard);
/* The middle of what it covers, in its frame; of a half-space: nothing. */
void pliant_part_centre(const pliant_part *part, double out[3]);
/* The largest distance from a point in the part's frame [m]. */
double pliant_part_reach(const pliant_part *part, const double from[3]);
/* NULL, or what is wrong with it. */
const char *pliant_part_check(const pliant_part *part, bool of_tool, char *reason, size_t size);

/* Distance of points that tell a part that is not convex [m]; 0: it is convex. */
double pliant_part_grain(const pliant_part *part);
/* Holds a shape's solids once more. */
void pliant_tool_shape_retain(const pliant_tool_shape *shape);

/* x = rotation l + place of a point l in a frame; row-major. */
typedef struct pliant_pose { double rotation[9], place[3]; } pliant_pose;

void pliant_pose_to(const pliant_pose *pose, const double local[3], double out[3]);
void pliant_pose_from(const pliant_pose *pose, const double x[3], double out[3]);
void pliant_pose_turn(const pliant_pose *pose, const double local[3], double out[3]); /* directions */
void pliant_pose_turn_back(const pliant_pose *pose, const double v[3], double out[3]);
/* Of a tool's parts. @param rotation quaternion x y z w */
void pliant_part_pose(const pliant_tool_shape *shape, pliant_part_frame frame, const double tip[3], const double rotation[4], double jaw,
                      pliant_pose *out);
/* Box around a part in a pose, [low, high); infinite for half-spaces. */
void pliant_part_box(const pliant_part *part, const pliant_pose *pose, double low[3], double high[3]);

/* Where its distance is least on an edge or a triangle, in the part's frame. Distances above `enough` need no minimum: a lower bound of it is
 * returned then, and what is written means nothing.
 * @param at     corners; @param weight of them, at the minimum
 * @param normal as of pliant_part_distance */
double pliant_edge_minimum(const pliant_part *part, const double at[2][3], double enough, double weight[2], double normal[3]);
double pliant_face_minimum(const pliant_part *part, const double at[3][3], double enough, double weight[3], double normal[3]);

#ifdef __cplusplus
}
#endif

#endif
