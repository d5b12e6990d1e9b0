#include "model_data/coincident_grasps.h"

#include <math.h>
#include <string.h>

static void held_point_at_rest(const pliant_mesh *fine, const pliant_tool *tool, double out[3])
{
    memset(out, 0, 3 * sizeof *out);
    for (int32_t h = 0; h < tool->num_held; h++)
        for (int d = 0; d < 3; d++) out[d] += tool->weight[h] * fine->rest[3 * (size_t)tool->held[h] + (size_t)d];
}

static bool is_rigid(const pliant_tool *tool) { return tool->holding && pliant_tool_drive(tool) == PLIANT_DRIVE_RIGID; }

bool pliant_holds_coincide(const pliant_mesh *fine, const pliant_tool *a, const pliant_tool *b)
{
    const double closer = 0.25 * fmin(fine->cell_size[0], fmin(fine->cell_size[1], fine->cell_size[2]));
    double at[2][3], squares = 0;
    if (!is_rigid(a) || !is_rigid(b)) return false;
    held_point_at_rest(fine, a, at[0]);
    held_point_at_rest(fine, b, at[1]);
    for (int d = 0; d < 3; d++) squares += (at[0][d] - at[1][d]) * (at[0][d] - at[1][d]);
    return squares < closer * closer;
}
