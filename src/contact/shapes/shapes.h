/* Rigid parts: signed distances, and their motion with a tool. */
#ifndef PLIANT_CONTACT_SHAPES_H
#define PLIANT_CONTACT_SHAPES_H

#include "pliant/contact.h"

#ifdef __cplusplus
extern "C" {
#endif

/* Return the signed distance of a point in the part's frame, negative inside [m]. The surface point nearest to p is
 * p - distance normal.
 * @param normal out: the gradient, a unit vector; 0 0 0 where the shortest direction out is not unique */
double pliant_part_distance(const pliant_part *part, const double p[3], double normal[3]);
/* Compute the point at which a ray from inside leaves the part. direction: unit vector; out: in the part's frame */
void pliant_part_exit_point(const pliant_part *part, const double p[3], const double direction[3], double out[3]);
/* Return the depth of the part's deepest point [m]. */
double pliant_part_depth(const pliant_part *part);
/* Return the core: everything deeper than the guard depth below the surface. The guard depth is less than the
 * part's depth. Outside the core, its distance is the part's distance plus the guard depth. A box has rounded edges
 * then, with the guard depth as radius. */
pliant_part pliant_part_core(const pliant_part *part, double guard);
/* Compute the center of the part's box in its frame; a half-space has none. */
void pliant_part_centre(const pliant_part *part, double out[3]);
/* Return the largest distance of the part's points from a point in its frame [m]. */
double pliant_part_reach(const pliant_part *part, const double from[3]);
/* Return NULL if the part is valid, and otherwise the reason, written to a buffer. */
const char *pliant_part_check(const pliant_part *part, bool of_tool, char *reason, size_t size);

/* Return the cell size of the distance field of a part that is not convex [m]; 0: the part is convex. */
double pliant_part_cell_size(const pliant_part *part);
/* Retain the solids of a shape. */
void pliant_tool_shape_retain(const pliant_tool_shape *shape);

/* x = rotation l + place, for a point l in a frame; row-major. */
typedef struct pliant_pose { double rotation[9], place[3]; } pliant_pose;

/* Transform a point from the frame, or into the frame. */
void pliant_pose_to(const pliant_pose *pose, const double local[3], double out[3]);
void pliant_pose_from(const pliant_pose *pose, const double x[3], double out[3]);
void pliant_pose_turn(const pliant_pose *pose, const double local[3], double out[3]); /* directions */
void pliant_pose_turn_back(const pliant_pose *pose, const double v[3], double out[3]);
/* Compute the pose of a tool's part. rotation: quaternion x y z w */
void pliant_part_pose(const pliant_tool_shape *shape, pliant_part_frame frame, const double tip[3],
                      const double rotation[4], double jaw, pliant_pose *out);
/* Compute the box around a part at a pose, [low, high); infinite for half-spaces. */
void pliant_part_box(const pliant_part *part, const pliant_pose *pose, double low[3], double high[3]);

/* Return the smallest distance of an edge or triangle from the part. If it is above `enough`, a lower bound of it
 * may be returned; then the outputs are not valid.
 * @param at corners in the part's frame [m]; @param weight out: weights of the corners at the minimum
 * @param normal out: as in pliant_part_distance */
double pliant_edge_minimum(const pliant_part *part, const double at[2][3], double enough, double weight[2],
                           double normal[3]);
double pliant_face_minimum(const pliant_part *part, const double at[3][3], double enough, double weight[3],
                           double normal[3]);

#ifdef __cplusplus
}
#endif

#endif
