/* Blade edges: their position, the tissue that contains their points, and the constraint by which they drag tissue. */
#ifndef PLIANT_INTERACT_BLADE_H
#define PLIANT_INTERACT_BLADE_H

#include "tool/pose.h"

/* Allocate an edge with `count` points, zeroed. *edge is overwritten; it is empty on errors. Errors: MEMORY. */
pliant_status pliant_edge_create(int32_t count, double reach, pliant_edge *edge);

double pliant_blade_length(const pliant_blade *blade); /* [m] */
/* Begin a stroke with the edge at pliant_blade_pose. Points are at most `spacing` [m] apart, and follow tissue at
 * most `reach` [m] away. Errors: MEMORY (no stroke has begun). */
pliant_status pliant_blade_begin_stroke(pliant_data *data, int tool, double spacing, double reach);
/* Return whether the blade has a previous pose: its pose in the last step, or when it was switched on. */
bool pliant_blade_has_pose(const pliant_blade *blade);
/* End the stroke; the blade stays. */
void pliant_blade_end_stroke(pliant_tool *tool);
/* End the stroke and clear the record of its cuts. */
void pliant_blade_reset(pliant_tool *tool);
/* Copy a blade to the next body at these positions, including the tissue that its points follow. Errors: MEMORY;
 * pliant_blade_end_stroke is needed then, too. */
pliant_status pliant_blade_transfer(pliant_blade *blade, const pliant_blade *from, const pliant_data *data,
                                    const pliant_body *next, const double *positions);

/* Compute the points of a tool's edge at a pose.
 * @param out (edge.count x 3) */
void pliant_blade_points(const pliant_blade *blade, const double tip[3], const double rotation[4], double *out);
/* Return the pose at which a tool's blade cuts in this step. For a tool with a shape it is the proxy at the end of the
 * last step, because contact moves the proxy after the cut. Without a shape it is the measured pose. */
pliant_tool_pose pliant_blade_pose(const pliant_tool *tool);
/* Move the points in tissue, and near tissue, to the tissue's current position. */
void pliant_blade_move_with_tissue(const pliant_data *data, pliant_edge *edge);
/* Move the edge to `now`, and find the tissue that its points follow. */
void pliant_blade_set_edge(const pliant_data *data, pliant_edge *edge);
/* Move the points outside tissue towards `now` until they enter tissue, which is tested every `spacing` [m]. */
void pliant_blade_move_to_tissue(const pliant_data *data, pliant_edge *edge, double spacing);
int32_t pliant_blade_num_inside(const pliant_edge *edge);

/* Return the midpoint of the edge.
 * points: `now` or other positions of the points */
void pliant_blade_middle(const pliant_edge *edge, const double *points, double out[3]);
/* Constrain the tool to the tissue at the edge, with equal weights. Errors: MEMORY. */
pliant_status pliant_blade_hold(const pliant_body *body, pliant_tool *tool);
/* Remove this constraint and set the force to zero. */
void pliant_blade_release(pliant_tool *tool);
/* Compute the blade's force after the solve; it is at least the spring's force. */
void pliant_blade_update_force(pliant_tool *tool);

#endif
