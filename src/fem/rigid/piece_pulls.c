/* A piece as a rigid body, with the pulls of tools and joints. */
#include "fem/rigid/rigid_pieces_data.h"

#include <string.h>

static void centre_of(const pliant_rigid_pieces *rigid_pieces, int32_t p, const double *x, double *mass,
                      double centre[3])
{
    const pliant_pieces *pieces = rigid_pieces->body->pieces;
    *mass = centre[0] = centre[1] = centre[2] = 0;
    for (int32_t i = pieces->start[p]; i < pieces->start[p + 1]; i++) {
        const double m = rigid_pieces->body->node_mass[pieces->node[i]];
        *mass += m;
        for (int d = 0; d < 3; d++) centre[d] += m * x[3 * (size_t)i + (size_t)d];
    }
    for (int d = 0; d < 3; d++) centre[d] = *mass > 0 ? centre[d] / *mass : 0;
}

void pliant_rigid_pieces_body(const pliant_rigid_pieces *rigid_pieces, int32_t p, pliant_rigid *out)
{
    const pliant_pieces *pieces = rigid_pieces->body->pieces;
    memset(out, 0, sizeof *out);
    centre_of(rigid_pieces, p, rigid_pieces->x, &out->mass, out->centre);
    for (int32_t i = pieces->start[p]; i < pieces->start[p + 1]; i++) {
        const double m = rigid_pieces->body->node_mass[pieces->node[i]];
        double r[3], squares = 0;
        for (int d = 0; d < 3; d++) {
            r[d] = rigid_pieces->x[3 * (size_t)i + (size_t)d] - out->centre[d];
            squares += r[d] * r[d];
        }
        for (int a = 0; a < 3; a++)
            for (int b = 0; b < 3; b++) out->inertia[3 * a + b] += m * ((a == b) * squares - r[a] * r[b]);
    }
    memcpy(out->velocity, rigid_pieces->pieces[p].velocity, sizeof out->velocity);
    memcpy(out->momentum, rigid_pieces->pieces[p].momentum, sizeof out->momentum);
}

static grip *find_grip(grip *list, int count, int tool, int32_t p)
{
    for (int g = 0; g < count; g++)
        if (list[g].tool == tool && list[g].piece == p) return list + g;
    return NULL;
}

void pliant_rigid_pieces_find_grips(pliant_rigid_pieces *rigid_pieces, const pliant_data *data)
{
    grip found[MAX_GRIPS];
    int count = 0;
    for (int t = 0; t < data->num_tools; t++) {
        const pliant_tool *tool = data->tools + t;
        const int first = count;
        double whole[3] = {0, 0, 0};
        for (int32_t h = 0; tool->holding && h < tool->num_held; h++) {
            const int32_t place = rigid_pieces->place[tool->held[h]];
            const double *x =
                place >= 0 ? rigid_pieces->x + 3 * (size_t)place : data->positions + 3 * (size_t)tool->held[h];
            for (int d = 0; d < 3; d++) whole[d] += tool->weight[h] * x[d];
            if (place < 0) continue;
            grip *at = find_grip(found + first, count - first, t, rigid_pieces->piece_of[place]);
            if (!at && count == MAX_GRIPS) continue;
            if (!at) {
                at = found + count++;
                *at = (grip){.tool = t, .piece = rigid_pieces->piece_of[place], .hold = tool->hold};
            }
            at->fraction += tool->weight[h];
            for (int d = 0; d < 3; d++) at->point[d] += tool->weight[h] * x[d];
        }
        for (int g = first; g < count; g++) {
            grip *at = found + g;
            const grip *before = find_grip(rigid_pieces->grips, rigid_pieces->num_grips, t, at->piece);
            const bool known = before && before->hold == at->hold;
            for (int d = 0; d < 3; d++) {
                at->point[d] /= at->fraction;
                at->offset[d] = known ? before->offset[d] : at->point[d] - whole[d];
                at->last[d] = known ? before->last[d] : pliant_tool_target(tool, d) + at->offset[d];
            }
        }
    }
    memcpy(rigid_pieces->grips, found, (size_t)count * sizeof *found);
    rigid_pieces->num_grips = count;
}

static pliant_rigid_pull pull_of(const grip *at, const pliant_tool *tool, const double centre[3])
{
    pliant_rigid_pull pull = {.is_force = pliant_tool_drive(tool) == PLIANT_DRIVE_FORCE};
    if (pliant_tool_drive(tool) == PLIANT_DRIVE_SPRING) {
        pull.compliance = 1 / (at->fraction * pliant_tool_stiffness(tool));
        pull.damping = at->fraction * pliant_tool_damping(tool);
    }
    for (int d = 0; d < 3; d++) {
        pull.arm[d] = at->point[d] - centre[d];
        pull.force[d] = pull.is_force ? at->fraction * tool->driving_force[d] : 0;
        pull.from[d] = at->last[d];
        pull.to[d] = pliant_tool_target(tool, d) + at->offset[d];
    }
    return pull;
}

/* Add the joints, at which the attached tissue pulls the piece along. */
static int add_joints(const pliant_rigid_pieces *rigid_pieces, int32_t p, const double *positions,
                      const double centre[3], int count, pliant_rigid_pull *pulls)
{
    const pliant_pieces *pieces = rigid_pieces->body->pieces;
    for (int32_t j = 0; j < pieces->num_joints && count < PLIANT_RIGID_PULLS; j++) {
        const int32_t own = pieces->joint[2 * j], to = pieces->joint[2 * j + 1], place = rigid_pieces->place[own];
        if (rigid_pieces->piece_of[place] != p) continue;
        pliant_rigid_pull *pull = pulls + count++;
        *pull = (pliant_rigid_pull){.compliance = 0};
        for (int d = 0; d < 3; d++) {
            pull->arm[d] = rigid_pieces->x[3 * (size_t)place + (size_t)d] - centre[d];
            pull->from[d] = rigid_pieces->joint_at[j][d];
            pull->to[d] = (own == to ? rigid_pieces->body->fine.rest : positions)[3 * (size_t)to + (size_t)d];
        }
    }
    return count;
}

int pliant_rigid_pieces_pulls(const pliant_rigid_pieces *rigid_pieces, const pliant_data *data, int32_t p,
                              const double centre[3], int num_grips, grip *const *grips,
                              pliant_rigid_pull pulls[PLIANT_RIGID_PULLS])
{
    for (int g = 0; g < num_grips; g++) pulls[g] = pull_of(grips[g], data->tools + grips[g]->tool, centre);
    return add_joints(rigid_pieces, p, data->positions, centre, num_grips, pulls);
}

int pliant_rigid_pieces_grips(pliant_rigid_pieces *rigid_pieces, int32_t p, grip **out)
{
    int count = 0;
    for (int g = 0; g < rigid_pieces->num_grips && count < PLIANT_MAX_TOOLS; g++)
        if (rigid_pieces->grips[g].piece == p) out[count++] = rigid_pieces->grips + g;
    return count;
}
