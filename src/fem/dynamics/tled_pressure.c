/* Pressures of nearly incompressible tissue in a sub-step (tled_pressure.h). */
#include "fem/dynamics/tled_pressure.h"

#include "base/vector3.h"
#include "fem/element/stress.h"
#include "fem/dynamics/tled_cubes.h"
#include "fem/system.h"

#include <math.h>
#include <string.h>

enum { MAX_PASSES = 12 /* of the conjugate gradients */ };
/* Residual of the conjugate gradients over the first one. */
static const double tolerance = 0.05;
/* Time constant with which offsets decay [s], as penetrations (NUMERICS.md). */
static const double offset_time = 0.15;

/* ---- Volumes. */

/* Compute J - 1 of a block of hexahedra, and cof F times the gradients along the axes: axes (3 a + r). */
PLIANT_VECTORIZED static void find_block(const pliant_tled_cubes *cubes, const double *u, int32_t block,
                                         double change[LANES], float axes[9][LANES])
{
    double h[9][LANES];
    float cofactor[9][LANES];
    for (int l = 0; l < LANES; l++) {
        const double *first = u + 3 * (size_t)cubes->nodes[block][0][l], finer = (double)cubes->finer[block][l];
        for (int r = 0; r < 3; r++) {
            double difference[8], along[3];
            for (int v = 0; v < 8; v++) difference[v] = u[3 * (size_t)cubes->nodes[block][v][l] + (size_t)r] - first[r];
            pliant_cube_differences(difference, along);
            for (int c = 0; c < 3; c++)
                h[3 * r + c][l] =
                    finer * (along[0] * (double)cubes->gradient[c] + along[1] * (double)cubes->gradient[3 + c] +
                             along[2] * (double)cubes->gradient[6 + c]);
        }
    }
    for (int l = 0; l < LANES; l++) {
        double one[9];
        for (int m = 0; m < 9; m++) one[m] = h[m][l];
        change[l] = pliant_exact_change_of(one);
    }
    for (int l = 0; l < LANES; l++) {
        float one[9], of_h[9], trace = 1;
        for (int m = 0; m < 9; m++) one[m] = (float)h[m][l];
        pliant_change_of(one, of_h);
        for (int r = 0; r < 3; r++) trace += one[4 * r];
        for (int r = 0; r < 3; r++)
            for (int c = 0; c < 3; c++) cofactor[3 * r + c][l] = (r == c) * trace - one[3 * c + r] + of_h[3 * r + c];
    }
    for (int a = 0; a < 3; a++)
        for (int r = 0; r < 3; r++)
            for (int l = 0; l < LANES; l++)
                axes[3 * a + r][l] = cubes->finer[block][l] * (cofactor[3 * r][l] * cubes->gradient[3 * a] +
                                                               cofactor[3 * r + 1][l] * cubes->gradient[3 * a + 1] +
                                                               cofactor[3 * r + 2][l] * cubes->gradient[3 * a + 2]);
}

/* Compute T and B of the hexahedra in a block. */
static void find_cubes(const pliant_tled *tled, int32_t block)
{
    pliant_tled_pressure *pressure = tled->pressure_of_groups;
    const pliant_tled_groups *groups = pressure->groups;
    double change[LANES];
    float axes[9][LANES];
    find_block(tled->system->cubes, tled->u, block, change, axes);
    for (int l = 0; l < LANES; l++) {
        const int32_t cube = LANES * block + l, group = cube < tled->system->cubes->count ? groups->of_cube[cube] : -1;
        if (group < 0) continue;
        const float volume = (float)groups->volume[group];
        float *row = pressure->rows + PLIANT_ROW * (size_t)groups->corner_start[group];
        pressure->change[group] = groups->volume[group] * change[l];
        for (int r = 0; r < 3; r++) {
            const float x = volume * axes[r][l], y = volume * axes[3 + r][l], z = volume * axes[6 + r][l];
            for (int v = 0; v < 8; v++)
                row[PLIANT_ROW * v + r] = (v & 1 ? x : -x) + (v & 2 ? y : -y) + (v & 4 ? z : -z);
        }
    }
}

/* Compute T and B of a group of tetrahedra, from their volumes. */
PLIANT_VECTORIZED static void find_tets(const pliant_tled *tled, int32_t group)
{
    pliant_tled_pressure *pressure = tled->pressure_of_groups;
    const pliant_tled_groups *groups = pressure->groups;
    const int32_t first = groups->corner_start[group], corners = groups->corner_start[group + 1] - first;
    double x[PLIANT_GROUP_CORNERS][PLIANT_ROW], row[PLIANT_GROUP_CORNERS][PLIANT_ROW], sum = 0;
    for (int32_t c = 0; c < corners; c++) {
        const size_t at = 3 * (size_t)groups->node[first + c];
        for (size_t d = 0; d < 3; d++) x[c][d] = tled->system->mesh->rest[at + d] + tled->u[at + d];
        for (int d = 0; d < PLIANT_ROW; d++) row[c][d] = 0;
    }
    for (int32_t i = groups->tet_start[group]; i < groups->tet_start[group + 1]; i++) {
        const int32_t *corner = groups->tet_corner + 4 * (size_t)i;
        double edge[3][3], face[3][3];
        for (int v = 0; v < 3; v++)
            for (int d = 0; d < 3; d++) edge[v][d] = x[corner[v + 1]][d] - x[corner[0]][d];
        for (int v = 0; v < 3; v++) pliant_cross3(edge[(v + 1) % 3], edge[(v + 2) % 3], face[v]);
        sum += pliant_dot3(edge[0], face[0]);
        for (int d = 0; d < 3; d++) {
            row[corner[0]][d] -= face[0][d] + face[1][d] + face[2][d];
            for (int v = 0; v < 3; v++) row[corner[v + 1]][d] += face[v][d];
        }
    }
    for (int32_t c = 0; c < corners; c++)
        for (int d = 0; d < 3; d++)
            pressure->rows[PLIANT_ROW * (size_t)(first + c) + (size_t)d] = (float)(row[c][d] * (1.0 / 6));
    pressure->change[group] = sum / 6 - groups->volume[group];
}

void pliant_tled_pressure_find(pliant_tled *tled)
{
    const pliant_tled_system *system = tled->system;
    pliant_tled_pressure *pressure = tled->pressure_of_groups;
    const pliant_tled_groups *groups = pressure->groups;
    double *offset = pressure->state + groups->count;
    const double kept = exp(-tled->time_step / offset_time);
    if (system->cubes) {
#pragma omp for schedule(static)
        for (int32_t block = 0; block < system->cubes->num_blocks; block++) find_cubes(tled, block);
    }
#pragma omp for schedule(static)
    for (int32_t g = 0; g < groups->count; g++) {
        if (groups->cube[g] < 0) find_tets(tled, g);
        offset[g] *= kept;
    }
}

/* ---- Products with B. */

/* Compute B' p at a node. */
PLIANT_INLINE void force_at(const pliant_tled_groups *groups, const float *rows, const double *p, int32_t node,
                            double sum[PLIANT_ROW])
{
    for (int d = 0; d < PLIANT_ROW; d++) sum[d] = 0;
    for (int32_t i = groups->node_start[node]; i < groups->node_start[node + 1]; i++) {
        const int32_t corner = groups->node_corner[i];
        const float *row = rows + PLIANT_ROW * (size_t)corner;
        const double at = p[groups->group[corner]];
        for (int d = 0; d < PLIANT_ROW; d++) sum[d] += at * (double)row[d];
    }
}

void pliant_tled_pressure_add(const pliant_tled *tled, int32_t node, double force[3])
{
    const pliant_tled_pressure *pressure = tled->pressure_of_groups;
    double sum[PLIANT_ROW];
    force_at(pressure->groups, pressure->rows, pressure->state, node, sum);
    for (int d = 0; d < 3; d++) force[d] += sum[d];
}

/* Compute the motion of nodes, factor / M B' direction. */
PLIANT_VECTORIZED static void move_nodes(const pliant_tled_pressure *pressure, const double *inverse_mass,
                                         double factor, int32_t first, int32_t end)
{
    for (int32_t n = first; n < end; n++) {
        double sum[PLIANT_ROW], *at = pressure->motion + PLIANT_ROW * (size_t)n;
        force_at(pressure->groups, pressure->rows, pressure->direction, n, sum);
        for (int d = 0; d < PLIANT_ROW; d++) at[d] = factor * inverse_mass[n] * sum[d];
    }
}

/* Compute the product S direction of a group, from the motion. */
PLIANT_VECTORIZED static void multiply_groups(const pliant_tled_pressure *pressure, int32_t first, int32_t end)
{
    const pliant_tled_groups *groups = pressure->groups;
    for (int32_t g = first; g < end; g++) {
        double sum[PLIANT_ROW] = {0};
        for (int32_t c = groups->corner_start[g]; c < groups->corner_start[g + 1]; c++) {
            const float *row = pressure->rows + PLIANT_ROW * (size_t)c;
            const double *at = pressure->motion + PLIANT_ROW * (size_t)groups->node[c];
            for (int d = 0; d < PLIANT_ROW; d++) sum[d] += (double)row[d] * at[d];
        }
        pressure->product[g] = groups->compliance[g] * pressure->direction[g] + (sum[0] + sum[1] + sum[2]);
    }
}

/* Return B v of a group. vector: (num_nodes x 3). */
static double volume_of(const pliant_tled_pressure *pressure, const double *vector, int32_t group)
{
    const pliant_tled_groups *groups = pressure->groups;
    double sum = 0;
    for (int32_t c = groups->corner_start[group]; c < groups->corner_start[group + 1]; c++) {
        const float *row = pressure->rows + PLIANT_ROW * (size_t)c;
        const double *at = vector + 3 * (size_t)groups->node[c];
        sum += (double)row[0] * at[0] + (double)row[1] * at[1] + (double)row[2] * at[2];
    }
    return sum;
}

/* ---- Held directions. */

/* Remove the motion of a weighted point: along one direction, or by a fraction in all directions. The result is
 * orthogonal in the mass norm, so W stays symmetric. direction: Nullable. */
static void hold_point(const pliant_tled *tled, int32_t count, const int32_t *node, const double *weight,
                       const double *direction, double fraction, double *motion)
{
    double point[3] = {0, 0, 0}, inverse = 0;
    for (int32_t k = 0; k < count; k++) {
        inverse += weight[k] * weight[k] * tled->inverse_mass[node[k]];
        for (int d = 0; d < 3; d++) point[d] += weight[k] * motion[PLIANT_ROW * (size_t)node[k] + (size_t)d];
    }
    if (!(inverse > 0)) return;
    if (direction) {
        const double along = pliant_dot3(direction, point);
        for (int d = 0; d < 3; d++) point[d] = along * direction[d];
    }
    for (int32_t k = 0; k < count; k++)
        for (int d = 0; d < 3; d++)
            motion[PLIANT_ROW * (size_t)node[k] + (size_t)d] -=
                fraction * weight[k] * tled->inverse_mass[node[k]] / inverse * point[d];
}

/* Hold the point of a tool. A spring holds it by the fraction of a motion that its force takes away in a sub-step. The
 * point is held twice. */
static void hold_tool(const pliant_tled *tled, const pliant_tool *tool, double factor, double *motion)
{
    const pliant_drive drive = pliant_tool_drive(tool);
    if (!tool->holding || (drive == PLIANT_DRIVE_FORCE && tool->mass == 0)) return;
    double fraction = 1;
    if (drive != PLIANT_DRIVE_RIGID) {
        const double dt = tled->time_step, spring = drive == PLIANT_DRIVE_SPRING,
                     stiffness = spring * (pliant_tool_stiffness(tool) + pliant_tool_damping(tool) / dt) +
                                 pliant_tool_mass(tool) / (dt * dt),
                     answer = factor * stiffness * pliant_tled_tool_compliance(tled, tool, tool);
        fraction = 1 - sqrt(1 / (1 + answer));
    }
    hold_point(tled, tool->num_held, tool->held, tool->weight, NULL, fraction, motion);
}

/* Hold a contact point that presses, in all directions if friction lets it stick. */
static void hold_contact(const pliant_tled *tled, int32_t index, double *motion)
{
    const pliant_contact_point *point = tled->contacts->point + index;
    const double *impulse = tled->contact[index].impulse, pressure = pliant_dot3(point->normal, impulse);
    if (point->kind == PLIANT_OBSTACLE_ELEMENT || !tled->contact[index].is_pressed || !(pressure > 0)) return;
    const double along = sqrt(fmax(pliant_dot3(impulse, impulse) - pressure * pressure, 0));
    const bool sticks = along < 0.999 * point->friction * pressure;
    hold_point(tled, point->count, point->node, point->weight, sticks ? NULL : point->normal, 1, motion);
}

/* Apply the projections of all points, forward and backward, so that W stays symmetric. */
static void hold_points(const pliant_tled *tled, const pliant_tool *tools, int num_tools, double factor, double *motion)
{
    const int32_t contacts = pliant_tled_touches(tled) ? tled->contacts->count : 0;
    for (int t = 0; t < num_tools; t++) hold_tool(tled, tools + t, factor, motion);
    for (int32_t p = 0; p < contacts; p++) hold_contact(tled, p, motion);
    for (int32_t p = contacts - 1; p >= 0; p--) hold_contact(tled, p, motion);
    for (int t = num_tools - 1; t >= 0; t--) hold_tool(tled, tools + t, factor, motion);
}

/* Hold a node at the walls that it touches, in all directions if friction lets it stick. */
static void hold_at_walls(const pliant_tled *tled, int32_t node, double motion[3])
{
    const pliant_tled_system *system = tled->system;
    const double *d = tled->d + 3 * (size_t)node, *u = tled->u + 3 * (size_t)node,
                 *rest = system->mesh->rest + 3 * (size_t)node;
    for (int w = 0; w < system->num_walls; w++) {
        const pliant_wall *wall = system->walls + w;
        if (!pliant_substep_touches(wall, 1, rest, u)) continue;
        const double normal = pliant_dot3(wall->normal, d), along = pliant_dot3(wall->normal, motion);
        bool sticks = system->friction > 0;
        for (int k = 0; k < 3; k++) sticks = sticks && d[k] == normal * wall->normal[k];
        for (int k = 0; k < 3; k++) motion[k] -= sticks ? motion[k] : along * wall->normal[k];
    }
}

/* ---- Correction. */

static double dot_of(int32_t count, const double *a, const double *b)
{
    double sum = 0;
    for (int32_t i = 0; i < count; i++) sum += a[i] * b[i];
    return sum;
}

/* Compute the next direction of the conjugate gradients. One thread calls this function. */
static void find_direction(pliant_tled_pressure *pressure, int pass)
{
    const int32_t count = pressure->groups->count;
    const double before = pressure->slope;
    pressure->status = pliant_factor_solve(pressure->factor, 1, pressure->residual, pressure->solution);
    pressure->slope = dot_of(count, pressure->residual, pressure->solution);
    const double kept = pass > 0 && before > 0 ? pressure->slope / before : 0;
    for (int32_t g = 0; g < count; g++) pressure->direction[g] = pressure->solution[g] + kept * pressure->direction[g];
}

/* Compute the step along the direction, and update the pressures. One thread calls this function. */
static void find_step(pliant_tled_pressure *pressure, double largest)
{
    const int32_t count = pressure->groups->count;
    const double curvature = dot_of(count, pressure->direction, pressure->product),
                 step = pressure->step = curvature > 0 ? pressure->slope / curvature : 0;
    double square = 0;
    for (int32_t g = 0; g < count; g++) {
        pressure->state[g] += step * pressure->direction[g];
        pressure->residual[g] -= step * pressure->product[g];
        square += pressure->residual[g] * pressure->residual[g] / pressure->groups->volume[g];
    }
    pressure->is_solved = !(square > tolerance * tolerance * largest);
}

/* Compute the product S direction, and the motion W B' direction. */
static void multiply(pliant_tled *tled, const pliant_tool *tools, int num_tools, double factor)
{
    const pliant_tled_system *system = tled->system;
    pliant_tled_pressure *pressure = tled->pressure_of_groups;
    const int32_t nodes = system->mesh->num_nodes, groups = pressure->groups->count;
#pragma omp for schedule(static)
    for (int32_t first = 0; first < nodes; first += PLIANT_CHUNK) {
        const int32_t end = first + PLIANT_CHUNK < nodes ? first + PLIANT_CHUNK : nodes;
        move_nodes(pressure, tled->inverse_mass, factor, first, end);
        for (int32_t n = first; system->num_walls > 0 && n < end; n++)
            if (tled->inverse_mass[n] > 0) hold_at_walls(tled, n, pressure->motion + PLIANT_ROW * (size_t)n);
    }
    if (num_tools > 0 || pliant_tled_touches(tled)) {
#pragma omp single
        hold_points(tled, tools, num_tools, factor, pressure->motion);
    }
#pragma omp for schedule(static)
    for (int32_t first = 0; first < groups; first += PLIANT_CHUNK)
        multiply_groups(pressure, first, first + PLIANT_CHUNK < groups ? first + PLIANT_CHUNK : groups);
}

void pliant_tled_pressure_correct(pliant_tled *tled, const pliant_tool *tools, int num_tools, double factor)
{
    pliant_tled_pressure *pressure = tled->pressure_of_groups;
    const pliant_tled_groups *groups = pressure->groups;
    const int32_t count = groups->count, nodes = tled->system->mesh->num_nodes;
    const double *offset = pressure->state + count;
    double largest = 0;
#pragma omp for schedule(static)
    for (int32_t g = 0; g < count; g++)
        pressure->residual[g] = pressure->change[g] - offset[g] - groups->compliance[g] * pressure->state[g] +
                                volume_of(pressure, tled->d, g);
    for (int32_t g = 0; g < count; g++) largest += pressure->residual[g] * pressure->residual[g] / groups->volume[g];
#pragma omp single
    {
        pressure->is_solved = !(largest > 0);
        pressure->status = PLIANT_OK;
    }
    for (int pass = 0; pass < MAX_PASSES && !pressure->is_solved && pressure->status == PLIANT_OK; pass++) {
#pragma omp barrier /* until all threads have read the status */
#pragma omp single
        find_direction(pressure, pass);
        multiply(tled, tools, num_tools, factor);
#pragma omp single
        find_step(pressure, largest);
#pragma omp for schedule(static)
        for (int32_t n = 0; n < nodes; n++)
            for (size_t d = 0; d < 3; d++) {
                const double moved = pressure->step * pressure->motion[PLIANT_ROW * (size_t)n + d];
                tled->u[3 * (size_t)n + d] -= moved;
                tled->d[3 * (size_t)n + d] -= moved;
                tled->acceleration[3 * (size_t)n + d] -= moved / factor;
            }
    }
}
