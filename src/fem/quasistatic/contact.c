#include "fem/quasistatic/contact.h"

#include "base/fail.h"
#include "contact/volume/volume.h"
#include "contact/solve/cones.h"
#include "fem/quasistatic/solver.h"
#include "base/memory.h"

#include <math.h>
#include <string.h>

/* ---- creation and destruction */

static void free_points(pliant_touches *touches)
{
    pliant_free(touches->point);
    pliant_free(touches->frame);
    pliant_free(touches->goal);
    pliant_free(touches->start);
    pliant_free(touches->arm_start);
    pliant_free(touches->friction);
    pliant_free(touches->taken.force);
    pliant_free(touches->taken.motion);
    pliant_free(touches->found.force);
    pliant_free(touches->found.motion);
    pliant_free(touches->change);
}

void pliant_touches_free(pliant_touches *touches)
{
    if (!touches) return;
    free_points(touches);
    pliant_answers_free(&touches->answers);
    pliant_free(touches->unknown);
    pliant_free(touches->arm);
    pliant_free(touches->moving);
    pliant_free(touches->block);
    pliant_free(touches->turned);
    pliant_free(touches->touched);
    pliant_free(touches->seen);
    pliant_free(touches->matrix);
    pliant_free(touches->motion);
    pliant_free(touches->force);
    pliant_free(touches->sweeps);
    pliant_free(touches->step);
    pliant_free(touches);
}

static pliant_status create(pliant_solver *solver)
{
    const size_t nodes = (size_t)solver->system->num_free;
    pliant_touches *touches = pliant_calloc(1, sizeof *touches);
    if (!touches) return pliant_fail_memory("contact");
    pliant_status status = pliant_answers_create(solver->system->num_free, &touches->answers);
    touches->touched = pliant_calloc(nodes, sizeof *touches->touched);
    touches->seen = pliant_calloc(nodes, 1);
    touches->step = pliant_calloc(nodes, 3 * sizeof *touches->step);
    if (status == PLIANT_OK && !(touches->touched && touches->seen && touches->step))
        status = pliant_fail_memory("contact");
    if (status != PLIANT_OK) {
        pliant_touches_free(touches);
        return status;
    }
    solver->touches = touches;
    return PLIANT_OK;
}

static pliant_status make_room(pliant_touches *touches, int32_t count)
{
    const int32_t least = 32, room = 2 * count > least ? 2 * count : least;
    const size_t size = (size_t)room;
    if (count <= touches->room) return PLIANT_OK;
    pliant_touches made = {.room = room};
    made.point = pliant_calloc(size, sizeof *made.point);
    made.frame = pliant_calloc(size, 9 * sizeof *made.frame);
    made.goal = pliant_calloc(size, 3 * sizeof *made.goal);
    made.start = pliant_calloc(size + 1, sizeof *made.start);
    made.arm_start = pliant_calloc(size + 1, sizeof *made.arm_start);
    made.friction = pliant_calloc(size + PLIANT_MAX_TOOLS, sizeof *made.friction);
    made.taken.force = pliant_calloc(size, 3 * sizeof *made.taken.force);
    made.taken.motion = pliant_calloc(size, 3 * sizeof *made.taken.motion);
    made.found.force = pliant_calloc(size, 3 * sizeof *made.found.force);
    made.found.motion = pliant_calloc(size, 3 * sizeof *made.found.motion);
    made.change = pliant_calloc(size, 3 * sizeof *made.change);
    if (!made.point || !made.frame || !made.goal || !made.start || !made.arm_start || !made.friction ||
        !made.taken.force || !made.taken.motion || !made.found.force || !made.found.motion || !made.change) {
        free_points(&made);
        return pliant_fail_memory("contact");
    }
    free_points(touches);
    touches->room = room;
    touches->point = made.point;
    touches->frame = made.frame;
    touches->goal = made.goal;
    touches->start = made.start;
    touches->arm_start = made.arm_start;
    touches->friction = made.friction;
    touches->taken = made.taken;
    touches->found = made.found;
    touches->change = made.change;
    return PLIANT_OK;
}

/* ---- contact points of a step */

static pliant_status add_weight(pliant_touches *touches, int32_t unknown, const double block[9])
{
    if (touches->num_weights == touches->room_weights) {
        const size_t room = 2 * (size_t)touches->room_weights + 64;
        int32_t *list = pliant_resize(touches->unknown, room, sizeof *list);
        if (list) touches->unknown = list;
        double *blocks = pliant_resize(touches->block, room, 9 * sizeof *blocks);
        if (blocks) touches->block = blocks;
        double *turned = pliant_resize(touches->turned, room, 9 * sizeof *turned);
        if (turned) touches->turned = turned;
        if (!list || !blocks || !turned) return pliant_fail_memory("contact");
        touches->room_weights = (int32_t)room;
    }
    touches->unknown[touches->num_weights] = unknown;
    memcpy(touches->block + 9 * (size_t)touches->num_weights++, block, 9 * sizeof *block);
    return PLIANT_OK;
}

static pliant_status add_weights(pliant_solver *solver, const pliant_contact_point *point, const double *fine_positions)
{
    const pliant_system *system = solver->system;
    pliant_touches *touches = solver->touches;
    double *dense = solver->dense_weights;
    pliant_status status = PLIANT_OK;
    if (pliant_solves_fine(system)) {
        double gradient[4][3];
        const bool keeps_volume = point->kind == PLIANT_OBSTACLE_ELEMENT;
        if (keeps_volume) pliant_volume_gradient(point, fine_positions, gradient);
        for (int32_t k = 0; k < point->count && status == PLIANT_OK; k++) {
            const double w = point->weight[k], *n = point->normal;
            double block[9] = {w, 0, 0, 0, w, 0, 0, 0, w};
            for (int m = 0; m < 9 && keeps_volume; m++) block[m] += n[m / 3] * (gradient[k][m % 3] - w * n[m % 3]);
            const int32_t unknown = system->free_of_node[point->node[k]];
            if (unknown >= 0 && (w != 0 || keeps_volume)) status = add_weight(touches, unknown, block);
        }
        return status;
    }
    memset(dense, 0, 9 * (size_t)system->num_free * sizeof *dense);
    pliant_upsample_weights(system, solver->now.x, point->count, point->node, point->weight, dense);
    for (int32_t f = 0; f < system->num_free && status == PLIANT_OK; f++)
        for (int m = 0; m < 9; m++)
            if (dense[9 * (size_t)f + (size_t)m] != 0) {
                status = add_weight(touches, f, dense + 9 * (size_t)f);
                break;
            }
    return status;
}

static void set_frame(const double normal[3], double frame[9])
{
    const int least = fabs(normal[0]) < fabs(normal[1]) ? (fabs(normal[0]) < fabs(normal[2]) ? 0 : 2)
                                                        : (fabs(normal[1]) < fabs(normal[2]) ? 1 : 2);
    double *n = frame, *t = frame + 3, *s = frame + 6, length = 0;
    memcpy(n, normal, 3 * sizeof *n);
    for (int d = 0; d < 3; d++) {
        t[d] = (d == least) - normal[least] * normal[d];
        length += t[d] * t[d];
    }
    length = sqrt(length);
    for (int d = 0; d < 3; d++) t[d] /= length;
    for (int d = 0; d < 3; d++) s[d] = n[(d + 1) % 3] * t[(d + 2) % 3] - n[(d + 2) % 3] * t[(d + 1) % 3];
}

/* Compute W x of a point. x: (nodes of the solved mesh x 3) */
static void moved_point(const pliant_system *system, const pliant_touches *touches, int32_t c, const double *x,
                        double out[3])
{
    memset(out, 0, 3 * sizeof *out);
    for (int32_t w = touches->start[c]; w < touches->start[c + 1]; w++) {
        const double *block = touches->block + 9 * (size_t)w,
                     *at = x + 3 * (size_t)system->node_of_free[touches->unknown[w]];
        for (int r = 0; r < 3; r++)
            out[r] += block[3 * r] * at[0] + block[3 * r + 1] * at[1] + block[3 * r + 2] * at[2];
    }
}

static void into_frame(const double frame[9], const double v[3], double out[3])
{
    for (int r = 0; r < 3; r++) out[r] = frame[3 * r] * v[0] + frame[3 * r + 1] * v[1] + frame[3 * r + 2] * v[2];
}

static void from_frame(const double frame[9], const double v[3], double out[3])
{
    for (int r = 0; r < 3; r++) out[r] = frame[r] * v[0] + frame[3 + r] * v[1] + frame[6 + r] * v[2];
}

/* Compute the position at which the point touches and sticks. A force from the previous step stays, limited to the
 * current cone. */
static void set_point(const pliant_solver *solver, pliant_contact_point *point, int32_t c, const double *fine_positions)
{
    pliant_touches *touches = solver->touches;
    const double *frame = touches->frame + 9 * (size_t)c;
    double y[3] = {0, 0, 0}, bend[3] = {0, 0, 0}, moved[3], *force = touches->taken.force + 3 * (size_t)c;
    for (int32_t k = 0; k < point->count; k++)
        for (int d = 0; d < 3; d++) y[d] += point->weight[k] * fine_positions[3 * (size_t)point->node[k] + (size_t)d];
    for (int d = 0; d < 3 && !point->begun; d++) point->anchor[d] = y[d] + point->drift[d] - point->place[d];
    moved_point(solver->system, touches, c, solver->now.x, moved);
    pliant_touches_bend(touches, c, bend);
    double across = 0;
    for (int d = 0; d < 3; d++) across += frame[d] * point->anchor[d];
    for (int d = 0; d < 3; d++)
        touches->goal[3 * (size_t)c + (size_t)d] =
            point->place[d] + point->anchor[d] - across * frame[d] - (y[d] + bend[d] - moved[d]);
    into_frame(frame, point->force, force);
    const double slide = sqrt(force[1] * force[1] + force[2] * force[2]), most = point->friction * fmax(force[0], 0);
    for (int k = 1; k < 3 && slide > most; k++) force[k] *= most / slide;
    force[0] = fmax(force[0], 0);
    touches->friction[c] = point->friction;
    memset(touches->taken.motion + 3 * (size_t)c, 0, 3 * sizeof *touches->taken.motion);
}

pliant_status pliant_solver_touch(pliant_solver *solver, pliant_contacts *points, const pliant_touch_pieces *pieces,
                                  const double *fine_positions)
{
    if ((!points || points->count == 0) && !solver->touches) return PLIANT_OK;
    pliant_status status = solver->touches ? PLIANT_OK : create(solver);
    if (status != PLIANT_OK) return status;
    pliant_touches *touches = solver->touches;
    touches->points = points;
    touches->pieces = pieces;
    touches->count = touches->num_weights = touches->num_arms = touches->num_moving = 0;
    memset(touches->yields, 0, sizeof touches->yields);
    if (!points) return PLIANT_OK;
    status = make_room(touches, points->count);
    for (int32_t p = 0; p < points->count && status == PLIANT_OK; p++) {
        const int32_t c = touches->count;
        touches->start[c] = touches->num_weights;
        touches->arm_start[c] = touches->num_arms;
        status = add_weights(solver, points->point + p, fine_positions);
        if (status == PLIANT_OK && pieces) status = pliant_touches_add_arms(touches, points->point + p, fine_positions);
        /* fixed */
        if (status != PLIANT_OK ||
            (touches->num_weights == touches->start[c] && touches->num_arms == touches->arm_start[c]))
            continue;
        touches->start[c + 1] = touches->num_weights;
        touches->arm_start[c + 1] = touches->num_arms;
        touches->point[c] = p;
        set_frame(points->point[p].normal, touches->frame + 9 * (size_t)c);
        set_point(solver, points->point + p, c, fine_positions);
        touches->count++;
    }
    if (status != PLIANT_OK) touches->count = 0;
    return status;
}

/* ---- compliance */

static void turn(pliant_solver *solver)
{
    pliant_touches *touches = solver->touches;
    for (int32_t c = 0; c < touches->count; c++)
        for (int32_t w = touches->start[c]; w < touches->start[c + 1]; w++) {
            const double *frame = touches->frame + 9 * (size_t)c, *block = touches->block + 9 * (size_t)w;
            double *turned = touches->turned + 9 * (size_t)w;
            for (int r = 0; r < 3; r++) {
                for (int d = 0; d < 3; d++)
                    turned[3 * r + d] =
                        frame[3 * r] * block[d] + frame[3 * r + 1] * block[3 + d] + frame[3 * r + 2] * block[6 + d];
                pliant_into_node_axes(solver->rotations, touches->unknown[w], turned + 3 * r);
            }
        }
}

void pliant_touches_apply(const pliant_touches *touches, int32_t c, const double *v, double out[3])
{
    for (int32_t w = touches->start[c]; w < touches->start[c + 1]; w++) {
        const double *block = touches->turned + 9 * (size_t)w, *at = v + 3 * (size_t)touches->unknown[w];
        for (int r = 0; r < 3; r++)
            out[r] += block[3 * r] * at[0] + block[3 * r + 1] * at[1] + block[3 * r + 2] * at[2];
    }
}

void pliant_touches_pull(const pliant_touches *touches, const double *force, double *v)
{
    for (int32_t c = 0; c < touches->count; c++) {
        const double *f = force + 3 * (size_t)c;
        for (int32_t w = touches->start[c]; w < touches->start[c + 1]; w++) {
            const double *block = touches->turned + 9 * (size_t)w;
            double *at = v + 3 * (size_t)touches->unknown[w];
            for (int k = 0; k < 3; k++) at[k] += block[k] * f[0] + block[3 + k] * f[1] + block[6 + k] * f[2];
        }
    }
}

/* Compute the block of A of two points. */
static void answer_of(const pliant_touches *touches, int32_t a, int32_t b, double out[9])
{
    memset(out, 0, 9 * sizeof *out);
    for (int32_t v = touches->start[a]; v < touches->start[a + 1]; v++) {
        double moved[9] = {0}; /* motion of the unknown of v by unit forces at b */
        for (int32_t w = touches->start[b]; w < touches->start[b + 1]; w++) {
            const double *answer = pliant_answer(&touches->answers, touches->unknown[v], touches->unknown[w]),
                         *block = touches->turned + 9 * (size_t)w;
            for (int r = 0; r < 3; r++)
                for (int c = 0; c < 3; c++)
                    moved[3 * r + c] += answer[3 * r] * block[3 * c] + answer[3 * r + 1] * block[3 * c + 1] +
                                        answer[3 * r + 2] * block[3 * c + 2];
        }
        const double *block = touches->turned + 9 * (size_t)v;
        for (int r = 0; r < 3; r++)
            for (int c = 0; c < 3; c++)
                out[3 * r + c] +=
                    block[3 * r] * moved[c] + block[3 * r + 1] * moved[3 + c] + block[3 * r + 2] * moved[6 + c];
    }
}

int pliant_touches_springs(const pliant_solver *solver, int index[PLIANT_MAX_TOOLS])
{
    int count = 0;
    for (int t = 0; t < PLIANT_MAX_TOOLS; t++)
        if (pliant_handle_is_spring(solver->handles + t)) index[count++] = t;
    return count;
}

/* Set the blocks of the tools' springs, whose responses are whole vectors. */
static void set_springs(const pliant_solver *solver, const int *tool, int num_tools, size_t row)
{
    pliant_touches *touches = solver->touches;
    const size_t n = pliant_solver_unknowns(solver), points = 3 * (size_t)touches->count;
    for (size_t t = 0; t < (size_t)num_tools; t++)
        for (size_t d = 0; d < 3; d++) {
            const double *response = solver->handles[tool[t]].response + n * d;
            for (int32_t c = 0; c < touches->count; c++) {
                double moved[3] = {0, 0, 0};
                pliant_touches_apply(touches, c, response, moved);
                for (size_t r = 0; r < 3; r++)
                    touches->matrix[(3 * (size_t)c + r) * row + points + 3 * t + d] =
                        touches->matrix[(points + 3 * t + d) * row + 3 * (size_t)c + r] = moved[r];
            }
            for (size_t b = 0; b < (size_t)num_tools; b++) {
                double moved[3] = {0, 0, 0};
                pliant_handle_apply(solver->handles + tool[b], response, moved);
                for (size_t r = 0; r < 3; r++)
                    touches->matrix[(points + 3 * b + r) * row + points + 3 * t + d] =
                        moved[r] + (b == t && r == d ? solver->handles[tool[t]].compliance : 0);
            }
        }
}

pliant_status pliant_touches_make_matrix(pliant_touches *touches, int num_tools)
{
    const size_t row = 3 * (size_t)(touches->count + num_tools), room = 2 * row;
    for (int t = 0; t < num_tools; t++) touches->friction[touches->count + t] = PLIANT_CONE_HELD;
    if (row <= touches->room_matrix) return PLIANT_OK;
    double *matrix = pliant_calloc(room, room * sizeof *matrix), *motion = pliant_calloc(room, sizeof *motion),
           *force = pliant_calloc(room, sizeof *force);
    double *sweeps = pliant_calloc(room * PLIANT_CONE_ROOM + PLIANT_CONE_EQUATIONS, sizeof *sweeps);
    if (!matrix || !motion || !force || !sweeps) {
        pliant_free(matrix);
        pliant_free(motion);
        pliant_free(force);
        pliant_free(sweeps);
        return pliant_fail_memory("contact");
    }
    pliant_free(touches->matrix);
    pliant_free(touches->motion);
    pliant_free(touches->force);
    pliant_free(touches->sweeps);
    touches->matrix = matrix;
    touches->motion = motion;
    touches->force = force;
    touches->sweeps = sweeps;
    touches->room_matrix = room;
    return PLIANT_OK;
}

pliant_status pliant_touches_respond(pliant_solver *solver)
{
    pliant_touches *touches = solver->touches;
    if (!pliant_touches_any(touches)) return PLIANT_OK;
    turn(solver);
    int32_t num_touched = 0;
    for (int32_t w = 0; w < touches->num_weights; w++) {
        if (touches->seen[touches->unknown[w]]) continue;
        touches->seen[touches->unknown[w]] = 1;
        touches->touched[num_touched++] = touches->unknown[w];
    }
    int tool[PLIANT_MAX_TOOLS];
    const int num_tools = pliant_touches_springs(solver, tool);
    const int32_t num_answers = num_touched;
    for (int t = 0; t < num_tools; t++)
        for (int32_t h = 0; h < solver->handles[tool[t]].count; h++) {
            const int32_t unknown = solver->handles[tool[t]].unknown[h];
            if (!touches->seen[unknown]) touches->touched[num_touched++] = unknown;
            touches->seen[unknown] = 1;
        }
    for (int32_t i = 0; i < num_touched; i++) touches->seen[touches->touched[i]] = 0;
    bool splits = false;
    pliant_factor *factor = pliant_preconditioner_factor(solver->preconditioner);
    pliant_status status = factor ? pliant_factor_reach(factor, num_touched, touches->touched, &splits) : PLIANT_OK;
    touches->factor = status == PLIANT_OK && splits ? factor : NULL;
    touches->by_halves = touches->factor && num_tools == 0;
    touches->num_touched = num_answers;
    if (status != PLIANT_OK) return status;
    /* a preconditioner that is carried over from the previous topology changes in every step */
    if (touches->of_factor != solver->factors || pliant_preconditioner_base(solver->preconditioner))
        pliant_answers_forget(&touches->answers);
    touches->of_factor = solver->factors;
    status =
        pliant_answers_find(&touches->answers, solver->preconditioner, touches->factor, num_answers, touches->touched);
    if (status != PLIANT_OK) return status;
    const size_t row = 3 * (size_t)(touches->count + num_tools);
    if ((status = pliant_touches_make_matrix(touches, num_tools)) != PLIANT_OK) return status;
    for (int32_t a = 0; a < touches->count; a++)
        for (int32_t b = 0; b <= a; b++) {
            double block[9];
            answer_of(touches, a, b, block);
            if (touches->pieces) pliant_touches_answer_pieces(touches, a, b, block);
            for (int d = 0; a == b && d < 3; d++) block[4 * d] *= 1 + PLIANT_CONE_GIVES;
            for (size_t r = 0; r < 3; r++)
                for (size_t c = 0; c < 3; c++)
                    touches->matrix[(3 * (size_t)a + r) * row + 3 * (size_t)b + c] =
                        touches->matrix[(3 * (size_t)b + c) * row + 3 * (size_t)a + r] = block[3 * r + c];
        }
    set_springs(solver, tool, num_tools, row);
    return PLIANT_OK;
}

/* ---- evaluations */

void pliant_touches_load(const pliant_touches *touches, double *residual)
{
    for (int32_t c = 0; c < touches->count; c++) {
        double force[3];
        from_frame(touches->frame + 9 * (size_t)c, touches->taken.force + 3 * (size_t)c, force);
        for (int32_t w = touches->start[c]; w < touches->start[c + 1]; w++) {
            const double *block = touches->block + 9 * (size_t)w;
            double *at = residual + 3 * (size_t)touches->unknown[w];
            for (int k = 0; k < 3; k++)
                at[k] += block[k] * force[0] + block[3 + k] * force[1] + block[6 + k] * force[2];
        }
    }
}

pliant_status pliant_touches_begin(pliant_solver *solver, pliant_iterate *at)
{
    if (!solver->touches->factor)
        return pliant_preconditioner_solve(solver->preconditioner, 1, at->residual, at->free_step);
    const pliant_touches *touches = solver->touches;
    if (touches->by_halves) pliant_factor_begin_half(touches->factor, at->residual);
    else pliant_factor_begin(touches->factor, at->residual, at->free_step);
    for (int32_t i = 0; i < touches->num_touched && touches->by_halves; i++)
        pliant_factor_half_answer(touches->factor, pliant_answer_half(&touches->answers, touches->touched[i]),
                                  at->free_step + 3 * (size_t)touches->touched[i]);
    return PLIANT_OK;
}

bool pliant_touches_find(pliant_touches *touches, int num_tools, const double *matrix)
{
    const size_t points = 3 * (size_t)touches->count;
    memcpy(touches->force, touches->taken.force, points * sizeof *touches->force);
    memset(touches->force + points, 0, 3 * (size_t)num_tools * sizeof *touches->force);
    pliant_cones_solve(touches->count + num_tools, matrix, touches->friction, touches->motion, touches->force,
                       touches->sweeps);
    /* a GPU has its own copies of A and of the couplings */
    if (matrix == touches->matrix) pliant_touches_keep_limits(touches, num_tools);
    memcpy(touches->found.force, touches->force, points * sizeof *touches->force);
    memcpy(touches->found.motion, touches->motion, points * sizeof *touches->motion);
    bool changed = false;
    for (size_t i = 0; i < points; i++) {
        touches->change[i] = touches->force[i] - touches->taken.force[i];
        changed = changed || touches->change[i] != 0;
    }
    return changed;
}

pliant_status pliant_touches_step(pliant_solver *solver, pliant_iterate *at)
{
    pliant_touches *touches = solver->touches;
    int tool[PLIANT_MAX_TOOLS];
    const int num_tools = pliant_touches_springs(solver, tool);
    const size_t points = 3 * (size_t)touches->count, n = pliant_solver_unknowns(solver);
    for (int32_t c = 0; c < touches->count; c++) {
        double y[3], *motion = touches->motion + 3 * (size_t)c;
        moved_point(solver->system, touches, c, at->x, y);
        for (int d = 0; d < 3; d++) y[d] -= touches->goal[3 * (size_t)c + (size_t)d];
        into_frame(touches->frame + 9 * (size_t)c, y, motion);
        pliant_touches_apply(touches, c, at->free_step, motion);
    }
    if (touches->pieces) pliant_touches_move_pieces(touches, touches->taken.force, false, touches->motion);
    for (int t = 0; t < num_tools; t++)
        pliant_handle_gap(solver, tool[t], at, touches->motion + points + 3 * (size_t)t);
    const bool changed = pliant_touches_find(touches, num_tools, touches->matrix);
    if (!changed && !touches->factor) return PLIANT_OK;
    memset(touches->step, 0, n * sizeof *touches->step);
    pliant_touches_pull(touches, touches->change, touches->step);
    pliant_touches_pull(touches, touches->change, at->residual);
    for (int32_t i = 0; i < touches->num_touched && touches->by_halves; i++)
        pliant_factor_half_add(touches->factor, pliant_answer_half(&touches->answers, touches->touched[i]),
                               touches->step + 3 * (size_t)touches->touched[i]);
    if (touches->by_halves) pliant_factor_end_half(touches->factor, at->step);
    else if (touches->factor) pliant_factor_end(touches->factor, touches->step, at->step);
    if (touches->factor) return PLIANT_OK;
    pliant_status status = pliant_preconditioner_solve(solver->preconditioner, 1, touches->step, touches->step);
    for (size_t i = 0; i < n; i++) at->step[i] += touches->step[i];
    return status;
}

void pliant_touches_take(pliant_touches *touches)
{
    const pliant_touch_forces swap = touches->taken;
    touches->taken = touches->found;
    touches->found = swap;
}

static double depth_of(const pliant_touches *touches, int32_t c, const double *moved)
{
    const double *frame = touches->frame + 9 * (size_t)c, *goal = touches->goal + 3 * (size_t)c;
    return -(frame[0] * (moved[0] - goal[0]) + frame[1] * (moved[1] - goal[1]) + frame[2] * (moved[2] - goal[2]));
}

void pliant_touches_tell(pliant_touches *touches, const double *moved, pliant_statistics *statistics)
{
    statistics->contacts = 0;
    statistics->penetration = 0;
    for (int32_t p = 0; touches && touches->points && p < touches->points->count; p++) {
        pliant_contact_point *point = touches->points->point + p;
        memset(point->force, 0, sizeof point->force);
        point->begun = false;
    }
    for (int32_t c = 0; touches && c < touches->count; c++) {
        pliant_contact_point *point = touches->points->point + touches->point[c];
        const double *frame = touches->frame + 9 * (size_t)c, *force = touches->taken.force + 3 * (size_t)c,
                     *motion = touches->taken.motion + 3 * (size_t)c;
        const bool touches_something = point->kind != PLIANT_OBSTACLE_ELEMENT;
        if (touches_something)
            statistics->penetration = fmax(statistics->penetration, depth_of(touches, c, moved + 3 * (size_t)c));
        from_frame(frame, force, point->force);
        point->begun = force[0] > 0;
        statistics->contacts += point->begun && touches_something;
        /* this motion is 0 while the point sticks */
        for (int d = 0; d < 3; d++) point->anchor[d] += motion[1] * frame[3 + d] + motion[2] * frame[6 + d];
    }
}

/* Compute W x of all points at the solver's state. */
static void find_moved(const pliant_solver *solver)
{
    pliant_touches *touches = solver->touches;
    const int32_t count = touches->count;
    for (int32_t c = 0; c < count; c++)
        moved_point(solver->system, touches, c, solver->now.x, touches->motion + 3 * (size_t)c);
    if (count > 0 && touches->pieces) {
        memset(touches->found.motion, 0, 3 * (size_t)count * sizeof(double));
        pliant_touches_move_pieces(touches, touches->taken.force, true, touches->found.motion);
        for (int32_t c = 0; c < count; c++) {
            double by[3];
            from_frame(touches->frame + 9 * (size_t)c, touches->found.motion + 3 * (size_t)c, by);
            for (int d = 0; d < 3; d++) touches->motion[3 * (size_t)c + (size_t)d] += by[d];
        }
    }
}

void pliant_touches_report(pliant_solver *solver, pliant_statistics *statistics)
{
    pliant_touches *touches = solver->touches;
    if (touches) find_moved(solver);
    pliant_touches_tell(touches, touches ? touches->motion : NULL, statistics);
}
