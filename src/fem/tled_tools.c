/* What touches the tissue in a sub-step: tools that hold it, walls that it rests on. */
#include "fem/tled.h"

#include <math.h>
#include <string.h>

/* target, held point, and c of  c l = target - y  for one tool */
typedef struct pull { pliant_tool *tool; int index; double compliance, gap[3]; } pull;

/* One of so many parts of the way to the tip, or as much of it as elements can follow. */
static void approach(double target[3], const double goal[3], int32_t parts, double longest)
{
    double apart[3], length = 0;
    for (int d = 0; d < 3; d++) {
        apart[d] = goal[d] - target[d];
        length += apart[d] * apart[d];
    }
    length = sqrt(length) / parts;
    double part = (length > longest ? longest / length : 1) / parts;
    for (int d = 0; d < 3; d++) target[d] += part * apart[d];
}

static void held_point(const pliant_tled *tled, const pliant_tool *tool, const double *shift, double sign, double out[3])
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
        tools[t].attached = true;
    }
}

static void push(pliant_tled *tled, const pliant_tool *tool, const double force[3], double factor)
{
    for (int32_t h = 0; h < tool->num_held; h++) {
        size_t node = (size_t)tool->held[h];
        double answer = tled->system->inverse_mass[node] * tool->weight[h];
        for (int d = 0; d < 3; d++) {
            tled->u[3 * node + (size_t)d] += factor * answer * force[d];
            tled->d[3 * node + (size_t)d] += factor * answer * force[d];
            tled->acceleration[3 * node + (size_t)d] += answer * force[d];
        }
    }
}

/* summed over a frame's motion, of which the mean is told; of dynamic relaxation only the last counts */
static void add_force(const pliant_tled *tled, pliant_tool *tool, const double force[3])
{
    for (int d = 0; d < 3; d++) tool->force[d] = (tled->system->quasi_static ? 0 : tool->force[d]) + force[d];
}

static double load_of(const pliant_tled *tled, const pliant_tool *tool, const double force[3])
{
    double sum = 0;
    for (int32_t h = 0; h < tool->num_held; h++) sum += tled->system->inverse_mass[tool->held[h]] * tool->weight[h] * tool->weight[h];
    return sum * (force[0] * force[0] + force[1] * force[1] + force[2] * force[2]);
}

/* how far a unit force at b takes the point that a holds, in this step */
static double answer_between(const pliant_tled *tled, const pliant_tool *a, const pliant_tool *b, double factor)
{
    double sum = 0;
    for (int32_t i = 0, j = 0; i < a->num_held && j < b->num_held;) {
        if (a->held[i] < b->held[j]) i++;
        else if (a->held[i] > b->held[j]) j++;
        else {
            sum += a->weight[i] * b->weight[j] * tled->system->inverse_mass[a->held[i]];
            i++, j++;
        }
    }
    return factor * sum;
}

/* Solve for the forces by Cholesky, in place; a tool that cannot move anything (all it holds is fixed) gets none. */
static void solve_forces(int count, double matrix[PLIANT_MAX_TOOLS][PLIANT_MAX_TOOLS], double force[PLIANT_MAX_TOOLS][3])
{
    double largest = 0;
    for (int i = 0; i < count; i++) largest = fmax(largest, matrix[i][i]);
    for (int i = 0; i < count; i++) {
        for (int j = 0; j <= i; j++) {
            double sum = matrix[i][j];
            for (int k = 0; k < j; k++) sum -= matrix[i][k] * matrix[j][k];
            if (j < i) matrix[i][j] = matrix[j][j] > 0 ? sum / matrix[j][j] : 0;
            else matrix[i][i] = sum > 1e-12 * largest ? sqrt(sum) : 0;
        }
    }
    for (int d = 0; d < 3; d++) {
        for (int i = 0; i < count; i++) {
            for (int k = 0; k < i; k++) force[i][d] -= matrix[i][k] * force[k][d];
            force[i][d] = matrix[i][i] > 0 ? force[i][d] / matrix[i][i] : 0;
        }
        for (int i = count - 1; i >= 0; i--) {
            for (int k = i + 1; k < count; k++) force[i][d] -= matrix[k][i] * force[k][d];
            force[i][d] = matrix[i][i] > 0 ? force[i][d] / matrix[i][i] : 0;
        }
    }
}

/* A spring of compliance c (0: rigid) pulls with  c l = target - y+  at where the point will be, y+ = y + sum of the answers: stable
 * for any stiffness. A damper b beside it over a step h is a stiffer spring towards another target, as in the corotational solver. */
double pliant_tled_pull(pliant_tled *tled, pliant_tool *tools, int num_tools, double factor, int32_t parts)
{
    double load = 0;
    pull pulls[PLIANT_MAX_TOOLS];
    double matrix[PLIANT_MAX_TOOLS][PLIANT_MAX_TOOLS], force[PLIANT_MAX_TOOLS][3];
    int count = 0;
    for (int t = 0; t < num_tools; t++) {
        pliant_tool *tool = tools + t;
        if (!tool->holding) continue;
        if (tool->drive == PLIANT_DRIVE_FORCE) {
            push(tled, tool, tool->driving_force, factor);
            load += load_of(tled, tool, tool->driving_force);
            add_force(tled, tool, tool->driving_force);
            continue;
        }
        pull *one = &pulls[count++];
        *one = (pull){.tool = tool, .index = t};
    }
    for (int i = 0; i < count; i++) {
        pliant_tool *tool = pulls[i].tool;
        double goal[3], now[3], before[3], old_target[3], *target = tled->target[pulls[i].index];
        for (int d = 0; d < 3; d++) goal[d] = tool->tip[d] - tool->grip[d];
        memcpy(old_target, target, sizeof old_target);
        approach(target, goal, parts, tled->reach);
        held_point(tled, tool, NULL, 0, now);
        held_point(tled, tool, tled->d, -1, before);
        bool spring = tool->drive == PLIANT_DRIVE_SPRING;
        double damper = spring && !tled->system->quasi_static ? tool->damping / tled->time_step : 0, whole = tool->stiffness + damper;
        pulls[i].compliance = spring ? 1 / whole : 0;
        for (int d = 0; d < 3; d++) {
            double towards = spring ? (tool->stiffness * target[d] + damper * (target[d] - old_target[d] + before[d])) / whole : target[d];
            force[i][d] = towards - now[d];
        }
        for (int j = 0; j <= i; j++) matrix[i][j] = answer_between(tled, tool, pulls[j].tool, factor);
        matrix[i][i] += pulls[i].compliance;
    }
    solve_forces(count, matrix, force);
    for (int i = 0; i < count; i++) {
        push(tled, pulls[i].tool, force[i], factor);
        load += load_of(tled, pulls[i].tool, force[i]);
        add_force(tled, pulls[i].tool, force[i]);
    }
    return load;
}

/* A node behind a wall is put back on it; its way along the wall is cut short by friction, in proportion to how far it was pushed
 * (Coulomb), and its normal speed is turned around in part. */
void pliant_tled_collide(pliant_tled *tled, double factor, int32_t first, int32_t end)
{
    const pliant_tled_system *system = tled->system;
    for (int32_t n = first; n < end; n++) {
        if (system->inverse_mass[n] == 0) continue;
        double *u = tled->u + 3 * (size_t)n, *d = tled->d + 3 * (size_t)n;
        const double *rest = system->mesh->rest + 3 * (size_t)n;
        for (int w = 0; w < system->num_walls; w++) {
            const pliant_wall *wall = system->walls + w;
            double depth = wall->offset, normal = 0, slide = 0;
            for (int k = 0; k < 3; k++) {
                depth -= wall->normal[k] * (rest[k] + u[k]);
                normal += wall->normal[k] * d[k];
            }
            if (depth <= 0) continue;
            double along[3];
            for (int k = 0; k < 3; k++) {
                along[k] = d[k] - normal * wall->normal[k];
                slide += along[k] * along[k];
            }
            slide = sqrt(slide);
            double kept = slide > 0 ? fmax(0, 1 - system->friction * depth / slide) : 0;
            double back = normal < 0 ? -system->restitution * normal : normal;
            for (int k = 0; k < 3; k++) {
                double moved = depth * wall->normal[k] - (1 - kept) * along[k];
                u[k] += moved;
                tled->acceleration[3 * (size_t)n + (size_t)k] += moved / factor;
                d[k] = kept * along[k] + back * wall->normal[k];
            }
        }
    }
}
