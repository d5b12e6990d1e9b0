/* External actions on the tissue in a sub-step: tools that hold it, walls that support it. */
#include "fem/dynamics/tled.h"
#include "model_data/coincident_grasps.h"

#include <string.h>

/* A tool that pulls at a point. Rigid tools at one point share the pull: the first tool's hold pulls towards the mean
 * of their targets. */
typedef struct pull { pliant_tool *tool; int index, members; } pull;

static void held_point(const pliant_tled *tled, const pliant_tool *tool, const double *shift, double sign,
                       double out[3])
{
    const double *rest = tled->system->mesh->rest;
    memset(out, 0, 3 * sizeof *out);
    for (int32_t h = 0; h < tool->num_held; h++)
        for (int d = 0; d < 3; d++) {
            size_t at = 3 * (size_t)tool->held[h] + (size_t)d;
            out[d] += tool->weight[h] * (rest[at] + tled->u[at] + (shift ? sign * shift[at] : 0));
        }
}

void pliant_tled_interact(pliant_tled *tled, const double gravity[3], pliant_tool *tools, int num_tools)
{
    memcpy(tled->gravity, gravity, sizeof tled->gravity);
    for (int t = 0; t < num_tools; t++) {
        if (!tools[t].holding || tools[t].attached) continue;
        held_point(tled, tools + t, NULL, 0, tled->target[t]);
        held_point(tled, tools + t, tled->d, -1, tled->previous_point[t]);
        memcpy(tled->previous_target[t], tled->previous_point[t], sizeof tled->previous_point[t]);
        tled->previous_time_step = tled->time_step;
        tools[t].attached = true;
    }
}

void pliant_tled_shift_targets(pliant_tled *tled, const pliant_tool *tools, int num_tools, const double *fraction)
{
    for (int t = 0; t < num_tools; t++)
        for (int32_t h = 0; tools[t].holding && h < tools[t].num_held; h++) {
            const size_t node = (size_t)tools[t].held[h];
            for (int d = 0; d < 3; d++) {
                const double moved = tled->u[3 * node + (size_t)d] - tled->start_u[3 * node + (size_t)d],
                             shift = tools[t].weight[h] * (fraction[node] - 1) * moved;
                tled->target[t][d] += shift;
                tled->previous_point[t][d] += shift;
                tled->previous_target[t][d] += shift;
            }
        }
}

static void push(pliant_tled *tled, const pliant_tool *tool, const double force[3], double factor)
{
    for (int32_t h = 0; h < tool->num_held; h++) {
        size_t node = (size_t)tool->held[h];
        double answer = tled->inverse_mass[node] * tool->weight[h];
        for (int d = 0; d < 3; d++) {
            tled->u[3 * node + (size_t)d] += factor * answer * force[d];
            tled->d[3 * node + (size_t)d] += factor * answer * force[d];
            tled->acceleration[3 * node + (size_t)d] += answer * force[d];
        }
    }
}

/* Sum over a frame's sub-steps; their mean is reported. In dynamic relaxation the last force counts. */
static void add_force(const pliant_tled *tled, pliant_tool *tool, const double force[3])
{
    for (int d = 0; d < 3; d++) tool->force[d] = (tled->system->quasi_static ? 0 : tool->force[d]) + force[d];
}

static double load_of(const pliant_tled *tled, const pliant_tool *tool, const double force[3])
{
    double sum = 0;
    for (int32_t h = 0; h < tool->num_held; h++)
        sum += tled->inverse_mass[tool->held[h]] * tool->weight[h] * tool->weight[h];
    return sum * (force[0] * force[0] + force[1] * force[1] + force[2] * force[2]);
}

double pliant_tled_tool_compliance(const pliant_tled *tled, const pliant_tool *a, const pliant_tool *b)
{
    double sum = 0;
    for (int32_t i = 0, j = 0; i < a->num_held && j < b->num_held;) {
        if (a->held[i] < b->held[j]) i++;
        else if (a->held[i] > b->held[j]) j++;
        else {
            sum += a->weight[i] * b->weight[j] * tled->inverse_mass[a->held[i]];
            i++, j++;
        }
    }
    return sum;
}

/* Compute one row of the equations for the forces of tools that pull at a point.
 * @param answer  Displacement of the held point per force in this sub-step [m/N]. */
static double set_gap(pliant_tled *tled, const pliant_tool *tool, int index, int32_t parts, double answer,
                      double gap[3])
{
    const pliant_drive drive = pliant_tool_drive(tool);
    const bool spring = drive == PLIANT_DRIVE_SPRING, rigid = drive == PLIANT_DRIVE_RIGID,
               still = tled->system->quasi_static;
    const double dt = tled->time_step, since = dt / tled->previous_time_step,
                 inertia = rigid || still ? 0 : pliant_tool_mass(tool) / (dt * dt);
    double stiffness = spring ? pliant_tool_stiffness(tool) : 0,
           damper = spring && !still ? pliant_tool_damping(tool) / dt : 0;
    double goal[3], now[3], before[3], ahead[3], pushed[3], start[3], older[3], old_target[3];
    double *target = tled->target[index], *previous_point = tled->previous_point[index],
           *previous_target = tled->previous_target[index];
    for (int d = 0; d < 3; d++) goal[d] = pliant_tool_target(tool, d);
    memcpy(old_target, target, sizeof old_target);
    pliant_substep_approach(target, goal, parts, tled->reach);
    held_point(tled, tool, NULL, 0, now);
    held_point(tled, tool, tled->d, -1, before);
    for (int d = 0; d < 3; d++) {
        start[d] = old_target[d] - before[d];
        older[d] = previous_target[d] - previous_point[d];
        ahead[d] = before[d] + since * (before[d] - previous_point[d]);
        pushed[d] = rigid ? 0
                          : pliant_tool_mass(tool) * tled->gravity[d] +
                                (drive == PLIANT_DRIVE_FORCE ? tool->driving_force[d] : 0);
    }
    memcpy(previous_point, before, sizeof before);
    memcpy(previous_target, old_target, sizeof old_target);
    if (spring && !still) pliant_substep_center(answer, since, start, older, &stiffness, &damper, pushed);
    return pliant_substep_gap(stiffness, damper, inertia, target, old_target, now, before, ahead, pushed, gap);
}

/* Give each member its part of the force. */
static void report_force(const pliant_tled *tled, pliant_tool *tools, const int *pull_of, int num_tools, int pulled,
                         int members, const double force[3])
{
    const double part[3] = {force[0] / members, force[1] / members, force[2] / members};
    for (int t = 0; t < num_tools; t++)
        if (pull_of[t] == pulled) add_force(tled, tools + t, part);
}

double pliant_tled_pull(pliant_tled *tled, pliant_tool *tools, int num_tools, double factor, int32_t parts)
{
    double load = 0;
    pull pulls[PLIANT_MAX_TOOLS];
    double matrix[PLIANT_MAX_TOOLS][PLIANT_MAX_TOOLS], force[PLIANT_MAX_TOOLS][3];
    int count = 0, pull_of[PLIANT_MAX_TOOLS];
    for (int t = 0; t < num_tools; t++) {
        pliant_tool *tool = tools + t;
        pull_of[t] = -1;
        if (!tool->holding) continue;
        if (pliant_tool_drive(tool) == PLIANT_DRIVE_FORCE && (tool->mass == 0 || tled->system->quasi_static)) {
            double pushed[3];
            for (int d = 0; d < 3; d++) pushed[d] = tool->driving_force[d] + tool->mass * tled->gravity[d];
            push(tled, tool, pushed, factor);
            load += load_of(tled, tool, pushed);
            add_force(tled, tool, pushed);
            continue;
        }
        for (int p = 0; p < count && pull_of[t] < 0; p++)
            if (pliant_holds_coincide(tled->system->mesh, pulls[p].tool, tool)) pull_of[t] = p;
        if (pull_of[t] < 0) pulls[pull_of[t] = count++] = (pull){.tool = tool, .index = t};
        pulls[pull_of[t]].members++;
    }
    for (int i = 0; i < count; i++) {
        const pliant_tool *tool = pulls[i].tool;
        for (int j = 0; j <= i; j++) matrix[i][j] = factor * pliant_tled_tool_compliance(tled, tool, pulls[j].tool);
        const double answer = matrix[i][i];
        memset(force[i], 0, sizeof force[i]);
        for (int t = 0; t < num_tools; t++) {
            double gap[3];
            if (pull_of[t] != i) continue;
            const double own = set_gap(tled, tools + t, t, parts + tled->substeps_after_part[t], answer, gap);
            if (t == pulls[i].index) matrix[i][i] += own;
            for (int d = 0; d < 3; d++) force[i][d] += gap[d] / pulls[i].members;
        }
    }
    tled->previous_time_step = tled->time_step;
    pliant_substep_forces(count, matrix, force);
    for (int i = 0; i < count; i++) {
        push(tled, pulls[i].tool, force[i], factor);
        load += load_of(tled, pulls[i].tool, force[i]);
        report_force(tled, tools, pull_of, num_tools, i, pulls[i].members, force[i]);
    }
    return load;
}

/* As pliant_substep_collide for a node of nearly incompressible tissue. It bounces with at most its velocity towards
 * the wall before the sub-step. Otherwise large pressures, which change the velocity within a sub-step, add energy. */
static void bounce(pliant_tled *tled, double factor, int32_t node)
{
    const pliant_tled_system *system = tled->system;
    const size_t at = 3 * (size_t)node;
    const double kept = pliant_tled_scheme_of(tled->time_step, system->damping).kept;
    double *u = tled->u + at, *d = tled->d + at, *acceleration = tled->acceleration + at;
    for (int w = 0; w < system->num_walls; w++) {
        const pliant_wall *wall = system->walls + w;
        double now = 0, before = 0;
        for (int k = 0; k < 3; k++) {
            now += wall->normal[k] * d[k];
            before += wall->normal[k] * (d[k] - factor * acceleration[k]) / kept;
        }
        const double restitution = now < 0 && before < 0 ? system->restitution * fmin(1, before / now) : 0;
        pliant_substep_collide(wall, 1, system->friction, restitution, system->mesh->rest + at, factor, u, d,
                               acceleration);
    }
}

void pliant_tled_collide(pliant_tled *tled, double factor, int32_t first, int32_t end)
{
    const pliant_tled_system *system = tled->system;
    for (int32_t n = first; n < end; n++) {
        if (tled->inverse_mass[n] == 0) continue;
        size_t at = 3 * (size_t)n;
        if (tled->pressure_of_groups && system->restitution > 0) {
            bounce(tled, factor, n);
            continue;
        }
        pliant_substep_collide(system->walls, system->num_walls, system->friction, system->restitution,
                               system->mesh->rest + at, factor, tled->u + at, tled->d + at, tled->acceleration + at);
    }
}
