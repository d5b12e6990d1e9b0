/* Edges of blades: where they are, what of the tissue they are in, and the hold by which they drag it along. */
#ifndef PLIANT_INTERACT_BLADE_H
#define PLIANT_INTERACT_BLADE_H

#include "state/data.h"

#ifdef __cplusplus
extern "C" {
#endif

/* Arrays of so many points, all 0. *edge is overwritten; empty on errors. Errors: MEMORY. */
pliant_status pliant_edge_create(int32_t count, double reach, pliant_edge *edge);

bool pliant_blade_is_there(const pliant_blade *blade);
double pliant_blade_length(const pliant_blade *blade); /* [m] */
/* Begin a stroke with the edge where the tool is now, points at most `spacing` [m] apart, which go with tissue no more than `reach` [m] beside
 * them. Errors: MEMORY (none is under way). */
pliant_status pliant_blade_begin(pliant_data *data, int tool, double spacing, double reach);
/* Whether the blade has a previous pose: the pose of the last step, or the tool's pose when the blade was switched on. */
bool pliant_blade_has_pose(const pliant_blade *blade);
/* The stroke is over; the blade stays. */
void pliant_blade_end(pliant_tool *tool);
/* And what it has cut is forgotten. */
void pliant_blade_reset(pliant_tool *tool);
/* Of another tool on the next body, at these positions: copied, with the tissue that its points go with. Errors: MEMORY; end it then, too. */
pliant_status pliant_blade_carry(pliant_blade *blade, const pliant_blade *from, const pliant_data *data, const pliant_body *next,
                                 const double *positions);

/* Points of the edge of a tool in a pose. @param out (edge.count x 3) */
void pliant_blade_points(const pliant_blade *blade, const double tip[3], const double rotation[4], double *out);
/* Points in tissue, and beside it, to where it is now. */
void pliant_blade_follow(const pliant_data *data, pliant_edge *edge);
/* The edge is at `now` from here on: what of the tissue its points go with. */
void pliant_blade_settle(const pliant_data *data, pliant_edge *edge);
/* Points in no tissue go on towards `now` until they meet some, looked for every `spacing` [m]. */
void pliant_blade_touch(const pliant_data *data, pliant_edge *edge, double spacing);
int32_t pliant_blade_num_inside(const pliant_edge *edge);

/* Middle of the edge, of its points `now` or of others. */
void pliant_blade_middle(const pliant_edge *edge, const double *points, double out[3]);
/* The tool holds what the edge is in, each point alike. Errors: MEMORY. */
pliant_status pliant_blade_hold(const pliant_body *body, pliant_tool *tool);
/* And lets go of it, and feels nothing. */
void pliant_blade_loosen(pliant_tool *tool);
/* What the blade takes, once the tissue is solved for: at least its own spring. */
void pliant_blade_feel(pliant_tool *tool);

#ifdef __cplusplus
}
#endif

#endif
