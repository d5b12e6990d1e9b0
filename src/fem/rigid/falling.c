#include "fem/rigid/falling.h"

#include "base/fail.h"
#include "fem/rigid/pieces.h"
#include "fem/dynamics/tled.h"
#include "fem/element/rotation.h"
#include "fem/quasistatic/solver.h"
#include "base/memory.h"

#include <math.h>
#include <string.h>

static int32_t nodes_of(const pliant_falling *falling)
{
    return falling->body->pieces->start[falling->body->pieces->count];
}

bool pliant_falling_has(const pliant_falling *falling, int32_t node) { return falling && falling->place[node] >= 0; }

const double *pliant_falling_home(const pliant_falling *falling, int32_t node)
{
    return pliant_falling_has(falling, node) ? falling->home + 3 * (size_t)falling->place[node] : NULL;
}

/* ---- Creation. */

static pliant_status allocate(pliant_falling *falling)
{
    const pliant_pieces *pieces = falling->body->pieces;
    const size_t nodes = (size_t)nodes_of(falling);
    size_t largest = 1;
    for (int32_t p = 0; p < pieces->count; p++) {
        const size_t count = (size_t)(pieces->start[p + 1] - pieces->start[p]);
        largest = count > largest ? count : largest;
    }
    falling->pieces = pliant_calloc((size_t)pieces->count, sizeof *falling->pieces);
    falling->x = pliant_calloc(nodes, 3 * sizeof *falling->x);
    falling->home = pliant_calloc(nodes, 3 * sizeof *falling->home);
    falling->piece_of = pliant_calloc(nodes, sizeof *falling->piece_of);
    falling->place = pliant_calloc((size_t)falling->body->fine.num_nodes, sizeof *falling->place);
    falling->of_node = pliant_calloc((size_t)falling->body->fine.num_nodes, sizeof *falling->of_node);
    falling->touch = pliant_calloc((size_t)pieces->count, sizeof *falling->touch);
    falling->joint_at = pliant_calloc((size_t)pieces->num_joints + 1, sizeof *falling->joint_at);
    falling->arms = pliant_calloc(largest, 3 * sizeof *falling->arms);
    falling->near_walls = pliant_calloc(largest, 3 * sizeof *falling->near_walls);
    falling->node_area = pliant_calloc(largest, sizeof *falling->node_area);
    falling->triangle_start = pliant_calloc((size_t)pieces->count + 1, sizeof *falling->triangle_start);
    falling->triangle = pliant_calloc((size_t)falling->body->num_triangles + 1, sizeof *falling->triangle);
    return falling->node_area && falling->triangle_start && falling->triangle && falling->pieces && falling->x &&
                   falling->home && falling->piece_of && falling->place && falling->of_node && falling->touch &&
                   falling->joint_at && falling->arms && falling->near_walls
               ? PLIANT_OK
               : pliant_fail_memory("the detached pieces");
}

/* Set the bounds of the drawn volume: the body at rest plus a margin (warp/margin). */
static void set_bounds(pliant_falling *falling, const pliant_scene *scene)
{
    const pliant_mesh *fine = &falling->body->fine;
    for (int d = 0; d < 3; d++) {
        falling->low[d] = INFINITY;
        falling->high[d] = -INFINITY;
    }
    for (int32_t n = 0; n < 3 * fine->num_nodes; n++) {
        falling->low[n % 3] = fmin(falling->low[n % 3], fine->rest[n] - scene->warp.margin);
        falling->high[n % 3] = fmax(falling->high[n % 3], fine->rest[n] + scene->warp.margin);
    }
}

/* Give a new piece the motion of the falling piece from which it was cut, as a part of the same rigid body. */
static void go_on(pliant_falling *falling, int32_t p, const pliant_falling *from, int32_t source)
{
    const piece *before = from->pieces + source;
    piece *now = falling->pieces + p;
    pliant_rigid was, is;
    double spin[3];
    pliant_falling_rigid(from, source, &was);
    pliant_falling_rigid(falling, p, &is);
    pliant_rigid_spin(&was, spin);
    for (int d = 0; d < 3; d++) {
        const int e = (d + 1) % 3, f = (d + 2) % 3;
        now->velocity[d] =
            was.velocity[d] + spin[e] * (is.centre[f] - was.centre[f]) - spin[f] * (is.centre[e] - was.centre[e]);
        now->momentum[d] =
            is.inertia[3 * d] * spin[0] + is.inertia[3 * d + 1] * spin[1] + is.inertia[3 * d + 2] * spin[2];
    }
    now->shaped = before->shaped;
    now->gone = before->gone;
}

/* Return six times the volume at rest. */
static double volume_of(const pliant_mesh *mesh, int32_t t)
{
    double edge[3][3];
    for (int v = 0; v < 3; v++)
        for (int d = 0; d < 3; d++)
            edge[v][d] = mesh->rest[3 * (size_t)mesh->tets[4 * (size_t)t + (size_t)v + 1] + (size_t)d] -
                         mesh->rest[3 * (size_t)mesh->tets[4 * (size_t)t] + (size_t)d];
    double six = 0;
    for (int d = 0; d < 3; d++)
        six += edge[0][d] * (edge[1][(d + 1) % 3] * edge[2][(d + 2) % 3] - edge[1][(d + 2) % 3] * edge[2][(d + 1) % 3]);
    return fabs(six);
}

/* Compute Young's modulus of each piece, the mean over its tetrahedra, and its size. */
static void find_moduli(pliant_falling *falling)
{
    const pliant_body *body = falling->body;
    for (int32_t p = 0; p < body->pieces->count; p++)
        falling->touch[p].young = falling->touch[p].size = falling->touch[p].num_young = 0;
    for (int32_t t = 0; t < body->fine.num_tets && body->fine_material; t++) {
        const int32_t p = falling->of_node[body->fine.tets[4 * (size_t)t]];
        const double lambda = body->fine_material[t].lambda, mu = body->fine_material[t].mu;
        if (p < 0 || !(body->fine_material[t].tissue > 0) || !(lambda + mu > 0)) continue;
        falling->touch[p].young += mu * (3 * lambda + 2 * mu) / (lambda + mu);
        falling->touch[p].size += volume_of(&body->fine, t) / 6;
        falling->touch[p].num_young++;
    }
    for (int32_t p = 0; p < body->pieces->count; p++) {
        if (falling->touch[p].num_young > 0) falling->touch[p].young /= falling->touch[p].num_young;
        falling->touch[p].size = cbrt(falling->touch[p].size);
    }
}

/* List the surface triangles of each piece, by a counting sort. */
static void list_triangles(pliant_falling *falling)
{
    const pliant_body *body = falling->body;
    int32_t *start = falling->triangle_start;
    for (int pass = 0; pass < 2; pass++) {
        for (int32_t t = 0; t < body->num_triangles; t++) {
            const int32_t p = falling->of_node[body->triangles[3 * (size_t)t]];
            if (p < 0) continue;
            if (pass == 0) start[p + 1]++;
            else falling->triangle[start[p]++] = t;
        }
        for (int32_t p = 0; pass == 0 && p < body->pieces->count; p++) start[p + 1] += start[p];
    }
    for (int32_t p = body->pieces->count; p > 0; p--) start[p] = start[p - 1];
    start[0] = 0;
}

static void fill(pliant_falling *falling, const double *positions, const pliant_falling *from,
                 const pliant_body_map *map)
{
    const pliant_pieces *pieces = falling->body->pieces;
    memset(falling->place, 0xff, (size_t)falling->body->fine.num_nodes * sizeof *falling->place);
    memset(falling->of_node, 0xff, (size_t)falling->body->fine.num_nodes * sizeof *falling->of_node);
    falling->together = (pliant_touch_pieces){.of_node = falling->of_node, .piece = falling->touch};
    for (int32_t p = 0; p < pieces->count; p++) {
        int32_t source = -1;
        for (int32_t i = pieces->start[p]; i < pieces->start[p + 1]; i++) {
            const int32_t node = pieces->node[i];
            const double *was = from ? pliant_falling_home(from, map->node[node]) : NULL;
            falling->place[node] = i;
            falling->piece_of[i] = falling->of_node[node] = p;
            memcpy(falling->x + 3 * (size_t)i, positions + 3 * (size_t)node, 3 * sizeof *positions);
            memcpy(falling->home + 3 * (size_t)i, was ? was : positions + 3 * (size_t)node, 3 * sizeof *positions);
            const pliant_between *between =
                was && map->between && map->between[node].end[0] >= 0 ? map->between + node : NULL;
            const int32_t ends[2] = {between ? falling->place[between->end[0]] : -1,
                                     between ? falling->place[between->end[1]] : -1};
            for (int d = 0; d < 3 && ends[0] >= 0 && ends[1] >= 0; d++) { /* they come before it */
                const double a = falling->home[3 * (size_t)ends[0] + d], b = falling->home[3 * (size_t)ends[1] + d];
                falling->home[3 * (size_t)i + d] = a + between->share * (b - a);
            }
            if (was && source < 0) source = from->piece_of[from->place[map->node[node]]];
        }
        if (source >= 0) go_on(falling, p, from, source);
    }
    find_moduli(falling);
    list_triangles(falling);
    for (int32_t j = 0; j < pieces->num_joints; j++) {
        const int32_t to = pieces->joint[2 * j + 1];
        const bool still = to == pieces->joint[2 * j];
        memcpy(falling->joint_at[j], (still ? falling->body->fine.rest : positions) + 3 * (size_t)to,
               sizeof falling->joint_at[j]);
    }
}

pliant_status pliant_falling_create(const pliant_scene *scene, const pliant_body *body, const double *positions,
                                    const pliant_falling *from, const pliant_body_map *map, pliant_falling **out)
{
    *out = NULL;
    if (!body->pieces) return PLIANT_OK;
    pliant_falling *falling = pliant_calloc(1, sizeof *falling);
    if (!falling) return pliant_fail_memory("the detached pieces");
    falling->body = body;
    falling->whole = falling->step = scene->solver.step;
    falling->num_walls = pliant_tled_walls(scene, falling->walls);
    falling->friction = scene->ground.friction;
    falling->restitution = scene->ground.restitution;
    set_bounds(falling, scene);
    pliant_status status = allocate(falling);
    if (status != PLIANT_OK) {
        pliant_falling_free(falling);
        return status;
    }
    fill(falling, positions, from, map);
    if (from) {
        memcpy(falling->grips, from->grips, sizeof falling->grips);
        memcpy(falling->gravity, from->gravity, sizeof falling->gravity);
        falling->num_grips = 0; /* for pieces this is a new grasp */
        falling->told = from->told;
    }
    *out = falling;
    return PLIANT_OK;
}

void pliant_falling_free(pliant_falling *falling)
{
    if (!falling) return;
    void *blocks[] = {falling->pieces,  falling->x,          falling->home,      falling->piece_of,
                      falling->place,   falling->of_node,    falling->touch,     falling->joint_at,
                      falling->arms,    falling->near_walls, falling->node_area, falling->triangle_start,
                      falling->triangle};
    for (size_t b = 0; b < sizeof blocks / sizeof *blocks; b++) pliant_free(blocks[b]);
    pliant_free(falling);
}

void pliant_falling_set_positions(pliant_falling *falling, const double *positions)
{
    const pliant_pieces *pieces = falling->body->pieces;
    for (int32_t i = 0; i < nodes_of(falling); i++)
        memcpy(falling->x + 3 * (size_t)i, positions + 3 * (size_t)pieces->node[i], 3 * sizeof *positions);
    memset(falling->pieces, 0, (size_t)pieces->count * sizeof *falling->pieces);
}

void pliant_falling_stay(const pliant_falling *falling, double *positions)
{
    const pliant_pieces *pieces = falling->body->pieces;
    for (int32_t i = 0; !falling->body->has_inertia && i < nodes_of(falling); i++)
        memcpy(positions + 3 * (size_t)pieces->node[i], falling->x + 3 * (size_t)i, 3 * sizeof *falling->x);
}

/* Store the targets of this step as start of the next one. */
static void keep_pulls(pliant_falling *falling, int32_t p, int num_grips, grip *const *grips,
                       const pliant_rigid_pull *pulls)
{
    const pliant_pieces *pieces = falling->body->pieces;
    int count = num_grips;
    for (int g = 0; g < num_grips; g++) memcpy(grips[g]->last, pulls[g].to, sizeof grips[g]->last);
    for (int32_t j = 0; j < pieces->num_joints && count < PLIANT_RIGID_PULLS; j++)
        if (falling->piece_of[falling->place[pieces->joint[2 * j]]] == p)
            memcpy(falling->joint_at[j], pulls[count++].to, sizeof falling->joint_at[j]);
}

/* ---- A step of one piece. */

/* List the nodes' arms from the centre. Nodes that may reach a wall in this step are copied to near_walls.
 * @param reach  Out: distance of the farthest node [m].
 * @return Number of nodes in near_walls. */
static int32_t list_arms(const pliant_falling *falling, int32_t p, const pliant_rigid *body, double way, double *reach)
{
    const pliant_pieces *pieces = falling->body->pieces;
    const int32_t first = pieces->start[p], count = pieces->start[p + 1] - first;
    double spin[3], farthest = 0;
    int32_t near_walls = 0;
    for (int32_t i = 0; i < 3 * count; i++)
        falling->arms[i] = falling->x[3 * (size_t)first + (size_t)i] - body->centre[i % 3];
    for (int32_t i = 0; i < count; i++) {
        const double *arm = falling->arms + 3 * i;
        farthest = fmax(farthest, arm[0] * arm[0] + arm[1] * arm[1] + arm[2] * arm[2]);
    }
    *reach = sqrt(farthest);
    pliant_rigid_spin(body, spin);
    way += falling->step * sqrt(spin[0] * spin[0] + spin[1] * spin[1] + spin[2] * spin[2]) * *reach;
    for (int32_t i = 0; i < count; i++) {
        const double *arm = falling->arms + 3 * i;
        double gap = INFINITY;
        for (int w = 0; w < falling->num_walls; w++) {
            const double *normal = falling->walls[w].normal;
            double at = -falling->walls[w].offset;
            for (int d = 0; d < 3; d++) at += normal[d] * (body->centre[d] + arm[d]);
            gap = fmin(gap, at);
        }
        if (gap <= way) memcpy(falling->near_walls + 3 * near_walls++, arm, 3 * sizeof *arm);
    }
    return near_walls;
}

/* Compute new positions: the rotated arms, and a fraction of the motion to the best-fitting rest shape. */
static void place_nodes(pliant_falling *falling, int32_t p, const pliant_rigid *body)
{
    const double springs_back = 0.05, same = 1e-9; /* [s, m] */
    const pliant_pieces *pieces = falling->body->pieces;
    const double *rest = falling->body->fine.rest, part = 1 - exp(-falling->step / springs_back);
    const int32_t first = pieces->start[p], count = pieces->start[p + 1] - first;
    double *x = falling->x + 3 * (size_t)first, fit[9] = {0}, rotation[9], origin[3] = {0, 0, 0}, most = 0;
    for (int32_t i = 0; i < count; i++) {
        const double *arm = falling->arms + 3 * i;
        for (int r = 0; r < 3; r++)
            x[3 * i + r] = body->centre[r] + body->rotation[3 * r] * arm[0] + body->rotation[3 * r + 1] * arm[1] +
                           body->rotation[3 * r + 2] * arm[2];
    }
    if (falling->pieces[p].shaped) return;
    for (int32_t i = 0; i < count; i++)
        for (int d = 0; d < 3; d++)
            origin[d] += falling->body->node_mass[pieces->node[first + i]] / body->mass *
                         rest[3 * (size_t)pieces->node[first + i] + (size_t)d];
    for (int32_t i = 0; i < count; i++)
        for (int r = 0; r < 3; r++)
            for (int c = 0; c < 3; c++)
                fit[3 * r + c] += falling->body->node_mass[pieces->node[first + i]] * (x[3 * i + r] - body->centre[r]) *
                                  (rest[3 * (size_t)pieces->node[first + i] + (size_t)c] - origin[c]);
    pliant_rotation_signed_svd(fit, rotation);
    for (int pass = 0; pass < 2; pass++) { /* first measure the distance, then move */
        const double taken = most <= same ? 1 : part;
        for (int32_t i = 0; i < count; i++) {
            const double *at = rest + 3 * (size_t)pieces->node[first + i];
            for (int r = 0; r < 3; r++) {
                const double shape = body->centre[r] + rotation[3 * r] * (at[0] - origin[0]) +
                                     rotation[3 * r + 1] * (at[1] - origin[1]) +
                                     rotation[3 * r + 2] * (at[2] - origin[2]);
                if (pass == 0) most = fmax(most, fabs(shape - x[3 * i + r]));
                else x[3 * i + r] += taken * (shape - x[3 * i + r]);
            }
        }
    }
    falling->pieces[p].shaped = most <= same;
}

/* Move nodes back in front of walls, after rounding, rotation and spring-back. */
static void stay_in_front(pliant_falling *falling, int32_t p)
{
    const pliant_pieces *pieces = falling->body->pieces;
    for (int w = 0; w < falling->num_walls; w++) {
        const pliant_wall *wall = falling->walls + w;
        double depth = 0;
        for (int32_t i = pieces->start[p]; i < pieces->start[p + 1]; i++) {
            const double *x = falling->x + 3 * (size_t)i;
            depth =
                fmax(depth, wall->offset - wall->normal[0] * x[0] - wall->normal[1] * x[1] - wall->normal[2] * x[2]);
        }
        for (int32_t i = pieces->start[p]; depth > 0 && i < pieces->start[p + 1]; i++)
            for (int d = 0; d < 3; d++) falling->x[3 * (size_t)i + (size_t)d] += depth * wall->normal[d];
    }
}

static bool out_of_sight(const pliant_falling *falling, int32_t p, const double *x, bool by_node)
{
    const pliant_pieces *pieces = falling->body->pieces;
    bool below[3] = {true, true, true}, above[3] = {true, true, true};
    for (int32_t i = pieces->start[p]; i < pieces->start[p + 1]; i++)
        for (int d = 0; d < 3; d++) {
            const double at = x[3 * (size_t)(by_node ? pieces->node[i] : i) + (size_t)d];
            below[d] = below[d] && at < falling->low[d];
            above[d] = above[d] && at > falling->high[d];
        }
    return below[0] || below[1] || below[2] || above[0] || above[1] || above[2];
}

static void stop(pliant_falling *falling, int32_t p)
{
    piece *at = falling->pieces + p;
    memset(at->velocity, 0, sizeof at->velocity);
    memset(at->momentum, 0, sizeof at->momentum);
    at->gone = true;
    if (!falling->told)
        pliant_log(
            PLIANT_LOG_WARNING,
            "a detached piece has left the deformed volume and stops there; increase warp/margin, or set ground/");
    falling->told = true;
}

static void move(pliant_falling *falling, pliant_data *data, int32_t p, int num_grips, grip *const *grips)
{
    const double slow = 0.01, patience = 0.2; /* [m/s, s] limits below which a piece on the ground comes to rest */
    piece *at = falling->pieces + p;
    pliant_rigid body;
    pliant_rigid_pull pulls[PLIANT_RIGID_PULLS];
    double way = 0, speed = 0, reach, spin[3];
    pliant_falling_rigid(falling, p, &body);
    if (!(body.mass > 0)) return;
    const int num_pulls = pliant_falling_pulls(falling, data, p, body.centre, num_grips, grips, pulls);
    for (int k = 0; k < num_pulls; k++)
        for (int d = 0; d < 3; d++) way += fabs(pulls[k].to[d] - body.centre[d] - pulls[k].arm[d]);
    for (int d = 0; d < 3; d++)
        way += falling->step * (fabs(body.velocity[d]) + falling->step * fabs(data->gravity[d]));
    const double old[3] = {body.centre[0], body.centre[1], body.centre[2]};
    const int32_t near_walls = list_arms(falling, p, &body, way, &reach);
    const pliant_rigid_walls around = {.walls = falling->walls,
                                       .count = falling->num_walls,
                                       .friction = falling->friction,
                                       .restitution = falling->restitution,
                                       .num_points = near_walls,
                                       .arm = falling->near_walls};
    const bool touches =
        !at->touched && pliant_rigid_step(&body, data->gravity, falling->step, num_pulls, pulls, &around);
    if (at->touched) pliant_falling_move_touched(falling, data, p, &body, num_pulls, pulls);
    keep_pulls(falling, p, num_grips, grips, pulls);
    place_nodes(falling, p, &body);
    stay_in_front(falling, p);
    memcpy(at->velocity, body.velocity, sizeof at->velocity);
    memcpy(at->momentum, body.momentum, sizeof at->momentum);
    for (int g = 0; g < num_grips; g++) {
        pliant_tool *tool = data->tools + grips[g]->tool;
        /* Relaxation has pulled at the attachment from before the piece detached. */
        const bool alone = !data->solver && grips[g]->share > 0.999;
        for (int d = 0; d < 3 && !pulls[g].given; d++)
            tool->force[d] = (alone ? 0 : tool->force[d]) + pulls[g].impulse[d] / falling->step;
    }
    for (int d = 0; d < 3; d++) speed += fabs(body.centre[d] - old[d]) / falling->step;
    pliant_rigid_spin(&body, spin);
    speed += reach * sqrt(spin[0] * spin[0] + spin[1] * spin[1] + spin[2] * spin[2]);
    at->quiet = touches && at->shaped && num_pulls == 0 && speed < slow ? at->quiet + falling->step : 0;
    at->rests = at->quiet > patience;
    if (at->rests) {
        memset(at->velocity, 0, sizeof at->velocity);
        memset(at->momentum, 0, sizeof at->momentum);
    }
    if (out_of_sight(falling, p, falling->x, false)) stop(falling, p);
}

/* ---- A step of all pieces. */

static void move_all(pliant_falling *falling, pliant_data *data)
{
    const pliant_pieces *pieces = falling->body->pieces;
    const bool turned = memcmp(falling->gravity, data->gravity, sizeof falling->gravity) != 0;
    memcpy(falling->gravity, data->gravity, sizeof falling->gravity);
    pliant_falling_find_grips(falling, data);
    for (int32_t p = 0; p < pieces->count; p++) {
        piece *at = falling->pieces + p;
        grip *grips[PLIANT_MAX_TOOLS];
        const int num_grips = pliant_falling_grips(falling, p, grips);
        if (num_grips > 0 || turned || at->touched) at->rests = false;
        if (num_grips > 0) at->gone = false;
        if (at->rests || at->gone) continue;
        data->statistics.falling++;
        move(falling, data, p, num_grips, grips);
    }
}

/* Update the fixed part of the solver's grasps after their pieces have moved. */
static void move_origins(const pliant_falling *falling, pliant_data *data)
{
    for (int g = 0; data->solver && g < falling->num_grips; g++) {
        const grip *at = falling->grips + g;
        const pliant_tool *tool = data->tools + at->tool;
        double *origin = data->solver->handles[at->tool].origin;
        for (int d = 0; d < 3; d++) origin[d] -= at->share * at->point[d];
        for (int32_t h = 0; h < tool->num_held; h++) {
            const int32_t place = falling->place[tool->held[h]];
            if (place < 0 || falling->piece_of[place] != at->piece) continue;
            for (int d = 0; d < 3; d++) origin[d] += tool->weight[h] * falling->x[3 * (size_t)place + (size_t)d];
        }
    }
}

bool pliant_falling_step(pliant_data *data)
{
    pliant_falling *falling = data->falling;
    const pliant_pieces *pieces = falling->body->pieces;
    bool anew = false;
    data->statistics.falling = 0;
    if (!falling->body->has_inertia) {
        pliant_falling_set_step(falling, data);
        pliant_falling_is_touched(falling, &data->contacts);
        move_all(falling, data);
        move_origins(falling, data);
        pliant_falling_stay(falling, data->positions);
        return false;
    }
    for (int32_t p = 0; p < pieces->count; p++) {
        if (falling->pieces[p].gone) continue;
        data->statistics.falling++;
        if (!out_of_sight(falling, p, data->positions, true)) continue;
        stop(falling, p);
        pliant_tled_stop(data->tled, pieces->start[p + 1] - pieces->start[p], pieces->node + pieces->start[p]);
        anew = true;
    }
    return anew;
}
