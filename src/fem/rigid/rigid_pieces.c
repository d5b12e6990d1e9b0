#include "fem/rigid/rigid_pieces.h"

#include "base/fail.h"
#include "fem/rigid/rigid_pieces_data.h"
#include "fem/dynamics/tled.h"
#include "fem/element/rotation.h"
#include "fem/quasistatic/solver.h"
#include "base/memory.h"

#include <math.h>
#include <string.h>

static int32_t nodes_of(const pliant_rigid_pieces *rigid_pieces)
{
    return rigid_pieces->body->pieces->start[rigid_pieces->body->pieces->count];
}

bool pliant_rigid_pieces_contain(const pliant_rigid_pieces *rigid_pieces, int32_t node)
{
    return rigid_pieces && rigid_pieces->place[node] >= 0;
}

const double *pliant_rigid_pieces_detachment_position(const pliant_rigid_pieces *rigid_pieces, int32_t node)
{
    return pliant_rigid_pieces_contain(rigid_pieces, node)
               ? rigid_pieces->detachment_positions + 3 * (size_t)rigid_pieces->place[node]
               : NULL;
}

void pliant_rigid_pieces_set_detachment_positions(const pliant_rigid_pieces *rigid_pieces, const pliant_system *system,
                                                  double *solved)
{
    for (int32_t n = 0; rigid_pieces && system->mesh == system->fine && n < system->mesh->num_nodes; n++) {
        const double *at = pliant_rigid_pieces_detachment_position(rigid_pieces, n);
        if (at) memcpy(solved + 3 * (size_t)n, at, 3 * sizeof *at);
    }
}

/* ---- Creation. */

static pliant_status allocate(pliant_rigid_pieces *rigid_pieces)
{
    const pliant_pieces *pieces = rigid_pieces->body->pieces;
    const size_t nodes = (size_t)nodes_of(rigid_pieces);
    size_t largest = 1;
    for (int32_t p = 0; p < pieces->count; p++) {
        const size_t count = (size_t)(pieces->start[p + 1] - pieces->start[p]);
        largest = count > largest ? count : largest;
    }
    rigid_pieces->pieces = pliant_calloc((size_t)pieces->count, sizeof *rigid_pieces->pieces);
    rigid_pieces->x = pliant_calloc(nodes, 3 * sizeof *rigid_pieces->x);
    rigid_pieces->detachment_positions = pliant_calloc(nodes, 3 * sizeof *rigid_pieces->detachment_positions);
    rigid_pieces->piece_of = pliant_calloc(nodes, sizeof *rigid_pieces->piece_of);
    rigid_pieces->place = pliant_calloc((size_t)rigid_pieces->body->fine.num_nodes, sizeof *rigid_pieces->place);
    rigid_pieces->of_node = pliant_calloc((size_t)rigid_pieces->body->fine.num_nodes, sizeof *rigid_pieces->of_node);
    rigid_pieces->contact_body = pliant_calloc((size_t)pieces->count, sizeof *rigid_pieces->contact_body);
    rigid_pieces->joint_at = pliant_calloc((size_t)pieces->num_joints + 1, sizeof *rigid_pieces->joint_at);
    rigid_pieces->arms = pliant_calloc(largest, 3 * sizeof *rigid_pieces->arms);
    rigid_pieces->near_walls = pliant_calloc(largest, 3 * sizeof *rigid_pieces->near_walls);
    rigid_pieces->node_area = pliant_calloc(largest, sizeof *rigid_pieces->node_area);
    rigid_pieces->triangle_start = pliant_calloc((size_t)pieces->count + 1, sizeof *rigid_pieces->triangle_start);
    rigid_pieces->triangle =
        pliant_calloc((size_t)rigid_pieces->body->num_triangles + 1, sizeof *rigid_pieces->triangle);
    return rigid_pieces->node_area && rigid_pieces->triangle_start && rigid_pieces->triangle && rigid_pieces->pieces &&
                   rigid_pieces->x && rigid_pieces->detachment_positions && rigid_pieces->piece_of &&
                   rigid_pieces->place && rigid_pieces->of_node && rigid_pieces->contact_body &&
                   rigid_pieces->joint_at && rigid_pieces->arms && rigid_pieces->near_walls
               ? PLIANT_OK
               : pliant_fail_memory("the detached pieces");
}

/* Set the bounds of the drawn volume: the body at rest plus a margin (warp/margin). */
static void set_bounds(pliant_rigid_pieces *rigid_pieces, const pliant_scene *scene)
{
    const pliant_mesh *fine = &rigid_pieces->body->fine;
    for (int d = 0; d < 3; d++) {
        rigid_pieces->low[d] = INFINITY;
        rigid_pieces->high[d] = -INFINITY;
    }
    for (int32_t n = 0; n < 3 * fine->num_nodes; n++) {
        rigid_pieces->low[n % 3] = fmin(rigid_pieces->low[n % 3], fine->rest[n] - scene->warp.margin);
        rigid_pieces->high[n % 3] = fmax(rigid_pieces->high[n % 3], fine->rest[n] + scene->warp.margin);
    }
}

/* Give a new piece the motion of the falling piece from which it was cut, as a part of the same rigid body. */
static void continue_motion(pliant_rigid_pieces *rigid_pieces, int32_t p, const pliant_rigid_pieces *from,
                            int32_t source)
{
    const piece *before = from->pieces + source;
    piece *now = rigid_pieces->pieces + p;
    pliant_rigid was, is;
    double spin[3];
    pliant_rigid_pieces_body(from, source, &was);
    pliant_rigid_pieces_body(rigid_pieces, p, &is);
    pliant_rigid_spin(&was, spin);
    for (int d = 0; d < 3; d++) {
        const int e = (d + 1) % 3, f = (d + 2) % 3;
        now->velocity[d] =
            was.velocity[d] + spin[e] * (is.centre[f] - was.centre[f]) - spin[f] * (is.centre[e] - was.centre[e]);
        now->momentum[d] =
            is.inertia[3 * d] * spin[0] + is.inertia[3 * d + 1] * spin[1] + is.inertia[3 * d + 2] * spin[2];
    }
    now->has_rest_shape = before->has_rest_shape;
    now->has_left_view = before->has_left_view;
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
static void find_moduli(pliant_rigid_pieces *rigid_pieces)
{
    const pliant_body *body = rigid_pieces->body;
    for (int32_t p = 0; p < body->pieces->count; p++)
        rigid_pieces->contact_body[p].young = rigid_pieces->contact_body[p].size =
            rigid_pieces->contact_body[p].num_young = 0;
    for (int32_t t = 0; t < body->fine.num_tets && body->fine_material; t++) {
        const int32_t p = rigid_pieces->of_node[body->fine.tets[4 * (size_t)t]];
        const double lambda = body->fine_material[t].lambda, mu = body->fine_material[t].mu;
        if (p < 0 || !(body->fine_material[t].tissue > 0) || !(lambda + mu > 0)) continue;
        rigid_pieces->contact_body[p].young += mu * (3 * lambda + 2 * mu) / (lambda + mu);
        rigid_pieces->contact_body[p].size += volume_of(&body->fine, t) / 6;
        rigid_pieces->contact_body[p].num_young++;
    }
    for (int32_t p = 0; p < body->pieces->count; p++) {
        if (rigid_pieces->contact_body[p].num_young > 0)
            rigid_pieces->contact_body[p].young /= rigid_pieces->contact_body[p].num_young;
        rigid_pieces->contact_body[p].size = cbrt(rigid_pieces->contact_body[p].size);
    }
}

/* List the surface triangles of each piece, by a counting sort. */
static void list_triangles(pliant_rigid_pieces *rigid_pieces)
{
    const pliant_body *body = rigid_pieces->body;
    int32_t *start = rigid_pieces->triangle_start;
    for (int pass = 0; pass < 2; pass++) {
        for (int32_t t = 0; t < body->num_triangles; t++) {
            const int32_t p = rigid_pieces->of_node[body->triangles[3 * (size_t)t]];
            if (p < 0) continue;
            if (pass == 0) start[p + 1]++;
            else rigid_pieces->triangle[start[p]++] = t;
        }
        for (int32_t p = 0; pass == 0 && p < body->pieces->count; p++) start[p + 1] += start[p];
    }
    for (int32_t p = body->pieces->count; p > 0; p--) start[p] = start[p - 1];
    start[0] = 0;
}

static void fill(pliant_rigid_pieces *rigid_pieces, const double *positions, const pliant_rigid_pieces *from,
                 const pliant_body_map *map)
{
    const pliant_pieces *pieces = rigid_pieces->body->pieces;
    memset(rigid_pieces->place, 0xff, (size_t)rigid_pieces->body->fine.num_nodes * sizeof *rigid_pieces->place);
    memset(rigid_pieces->of_node, 0xff, (size_t)rigid_pieces->body->fine.num_nodes * sizeof *rigid_pieces->of_node);
    rigid_pieces->together =
        (pliant_contact_bodies){.of_node = rigid_pieces->of_node, .piece = rigid_pieces->contact_body};
    for (int32_t p = 0; p < pieces->count; p++) {
        int32_t source = -1;
        for (int32_t i = pieces->start[p]; i < pieces->start[p + 1]; i++) {
            const int32_t node = pieces->node[i];
            const double *was = from ? pliant_rigid_pieces_detachment_position(from, map->node[node]) : NULL;
            rigid_pieces->place[node] = i;
            rigid_pieces->piece_of[i] = rigid_pieces->of_node[node] = p;
            memcpy(rigid_pieces->x + 3 * (size_t)i, positions + 3 * (size_t)node, 3 * sizeof *positions);
            memcpy(rigid_pieces->detachment_positions + 3 * (size_t)i, was ? was : positions + 3 * (size_t)node,
                   3 * sizeof *positions);
            const pliant_between *between =
                was && map->between && map->between[node].end[0] >= 0 ? map->between + node : NULL;
            const int32_t ends[2] = {between ? rigid_pieces->place[between->end[0]] : -1,
                                     between ? rigid_pieces->place[between->end[1]] : -1};
            for (int d = 0; d < 3 && ends[0] >= 0 && ends[1] >= 0; d++) { /* they come before it */
                const double a = rigid_pieces->detachment_positions[3 * (size_t)ends[0] + d],
                             b = rigid_pieces->detachment_positions[3 * (size_t)ends[1] + d];
                rigid_pieces->detachment_positions[3 * (size_t)i + d] = a + between->fraction * (b - a);
            }
            if (was && source < 0) source = from->piece_of[from->place[map->node[node]]];
        }
        if (source >= 0) continue_motion(rigid_pieces, p, from, source);
    }
    find_moduli(rigid_pieces);
    list_triangles(rigid_pieces);
    for (int32_t j = 0; j < pieces->num_joints; j++) {
        const int32_t to = pieces->joint[2 * j + 1];
        const bool still = to == pieces->joint[2 * j];
        memcpy(rigid_pieces->joint_at[j], (still ? rigid_pieces->body->fine.rest : positions) + 3 * (size_t)to,
               sizeof rigid_pieces->joint_at[j]);
    }
}

pliant_status pliant_rigid_pieces_create(const pliant_scene *scene, const pliant_body *body, const double *positions,
                                         const pliant_rigid_pieces *from, const pliant_body_map *map,
                                         pliant_rigid_pieces **out)
{
    *out = NULL;
    if (!body->pieces) return PLIANT_OK;
    pliant_rigid_pieces *rigid_pieces = pliant_calloc(1, sizeof *rigid_pieces);
    if (!rigid_pieces) return pliant_fail_memory("the detached pieces");
    rigid_pieces->body = body;
    rigid_pieces->whole = rigid_pieces->step = scene->solver.step;
    rigid_pieces->num_walls = pliant_tled_walls(scene, rigid_pieces->walls);
    rigid_pieces->friction = scene->ground.friction;
    rigid_pieces->restitution = scene->ground.restitution;
    set_bounds(rigid_pieces, scene);
    pliant_status status = allocate(rigid_pieces);
    if (status != PLIANT_OK) {
        pliant_rigid_pieces_free(rigid_pieces);
        return status;
    }
    fill(rigid_pieces, positions, from, map);
    if (from) {
        memcpy(rigid_pieces->grips, from->grips, sizeof rigid_pieces->grips);
        memcpy(rigid_pieces->gravity, from->gravity, sizeof rigid_pieces->gravity);
        rigid_pieces->num_grips = 0; /* for pieces this is a new grasp */
        rigid_pieces->reported = from->reported;
    }
    *out = rigid_pieces;
    return PLIANT_OK;
}

void pliant_rigid_pieces_free(pliant_rigid_pieces *rigid_pieces)
{
    if (!rigid_pieces) return;
    PLIANT_FREE(rigid_pieces->pieces, rigid_pieces->x, rigid_pieces->detachment_positions, rigid_pieces->piece_of,
                rigid_pieces->place, rigid_pieces->of_node, rigid_pieces->contact_body, rigid_pieces->joint_at,
                rigid_pieces->arms, rigid_pieces->near_walls, rigid_pieces->node_area, rigid_pieces->triangle_start,
                rigid_pieces->triangle);
    pliant_free(rigid_pieces);
}

void pliant_rigid_pieces_set_positions(pliant_rigid_pieces *rigid_pieces, const double *positions)
{
    const pliant_pieces *pieces = rigid_pieces->body->pieces;
    for (int32_t i = 0; i < nodes_of(rigid_pieces); i++)
        memcpy(rigid_pieces->x + 3 * (size_t)i, positions + 3 * (size_t)pieces->node[i], 3 * sizeof *positions);
    memset(rigid_pieces->pieces, 0, (size_t)pieces->count * sizeof *rigid_pieces->pieces);
}

void pliant_rigid_pieces_hold(const pliant_rigid_pieces *rigid_pieces, double *positions)
{
    const pliant_pieces *pieces = rigid_pieces->body->pieces;
    for (int32_t i = 0; !rigid_pieces->body->has_inertia && i < nodes_of(rigid_pieces); i++)
        memcpy(positions + 3 * (size_t)pieces->node[i], rigid_pieces->x + 3 * (size_t)i, 3 * sizeof *rigid_pieces->x);
}

/* Store the targets of this step as start of the next one. */
static void keep_pulls(pliant_rigid_pieces *rigid_pieces, int32_t p, int num_grips, grip *const *grips,
                       const pliant_rigid_pull *pulls)
{
    const pliant_pieces *pieces = rigid_pieces->body->pieces;
    int count = num_grips;
    for (int g = 0; g < num_grips; g++) memcpy(grips[g]->last, pulls[g].to, sizeof grips[g]->last);
    for (int32_t j = 0; j < pieces->num_joints && count < PLIANT_RIGID_PULLS; j++)
        if (rigid_pieces->piece_of[rigid_pieces->place[pieces->joint[2 * j]]] == p)
            memcpy(rigid_pieces->joint_at[j], pulls[count++].to, sizeof rigid_pieces->joint_at[j]);
}

/* ---- A step of one piece. */

/* List the nodes' arms from the centre. Nodes that may reach a wall in this step are copied to near_walls.
 * @param reach  Out: distance of the farthest node [m].
 * @return Number of nodes in near_walls. */
static int32_t list_arms(const pliant_rigid_pieces *rigid_pieces, int32_t p, const pliant_rigid *body,
                         double max_motion, double *reach)
{
    const pliant_pieces *pieces = rigid_pieces->body->pieces;
    const int32_t first = pieces->start[p], count = pieces->start[p + 1] - first;
    double spin[3], farthest = 0;
    int32_t near_walls = 0;
    for (int32_t i = 0; i < 3 * count; i++)
        rigid_pieces->arms[i] = rigid_pieces->x[3 * (size_t)first + (size_t)i] - body->centre[i % 3];
    for (int32_t i = 0; i < count; i++) {
        const double *arm = rigid_pieces->arms + 3 * i;
        farthest = fmax(farthest, arm[0] * arm[0] + arm[1] * arm[1] + arm[2] * arm[2]);
    }
    *reach = sqrt(farthest);
    pliant_rigid_spin(body, spin);
    max_motion += rigid_pieces->step * sqrt(spin[0] * spin[0] + spin[1] * spin[1] + spin[2] * spin[2]) * *reach;
    for (int32_t i = 0; i < count; i++) {
        const double *arm = rigid_pieces->arms + 3 * i;
        double gap = INFINITY;
        for (int w = 0; w < rigid_pieces->num_walls; w++) {
            const double *normal = rigid_pieces->walls[w].normal;
            double at = -rigid_pieces->walls[w].offset;
            for (int d = 0; d < 3; d++) at += normal[d] * (body->centre[d] + arm[d]);
            gap = fmin(gap, at);
        }
        if (gap <= max_motion) memcpy(rigid_pieces->near_walls + 3 * near_walls++, arm, 3 * sizeof *arm);
    }
    return near_walls;
}

/* Compute new positions: the rotated arms, and a fraction of the motion to the best-fitting rest shape. */
static void place_nodes(pliant_rigid_pieces *rigid_pieces, int32_t p, const pliant_rigid *body)
{
    const double springs_back = 0.05, same = 1e-9; /* [s, m] */
    const pliant_pieces *pieces = rigid_pieces->body->pieces;
    const double *rest = rigid_pieces->body->fine.rest, part = 1 - exp(-rigid_pieces->step / springs_back);
    const int32_t first = pieces->start[p], count = pieces->start[p + 1] - first;
    double *x = rigid_pieces->x + 3 * (size_t)first, fit[9] = {0}, rotation[9], origin[3] = {0, 0, 0}, maximum = 0;
    for (int32_t i = 0; i < count; i++) {
        const double *arm = rigid_pieces->arms + 3 * i;
        for (int r = 0; r < 3; r++)
            x[3 * i + r] = body->centre[r] + body->rotation[3 * r] * arm[0] + body->rotation[3 * r + 1] * arm[1] +
                           body->rotation[3 * r + 2] * arm[2];
    }
    if (rigid_pieces->pieces[p].has_rest_shape) return;
    for (int32_t i = 0; i < count; i++)
        for (int d = 0; d < 3; d++)
            origin[d] += rigid_pieces->body->node_mass[pieces->node[first + i]] / body->mass *
                         rest[3 * (size_t)pieces->node[first + i] + (size_t)d];
    for (int32_t i = 0; i < count; i++)
        for (int r = 0; r < 3; r++)
            for (int c = 0; c < 3; c++)
                fit[3 * r + c] += rigid_pieces->body->node_mass[pieces->node[first + i]] *
                                  (x[3 * i + r] - body->centre[r]) *
                                  (rest[3 * (size_t)pieces->node[first + i] + (size_t)c] - origin[c]);
    pliant_rotation_signed_svd(fit, rotation);
    for (int pass = 0; pass < 2; pass++) { /* first measure the distance, then move */
        const double taken = maximum <= same ? 1 : part;
        for (int32_t i = 0; i < count; i++) {
            const double *at = rest + 3 * (size_t)pieces->node[first + i];
            for (int r = 0; r < 3; r++) {
                const double shape = body->centre[r] + rotation[3 * r] * (at[0] - origin[0]) +
                                     rotation[3 * r + 1] * (at[1] - origin[1]) +
                                     rotation[3 * r + 2] * (at[2] - origin[2]);
                if (pass == 0) maximum = fmax(maximum, fabs(shape - x[3 * i + r]));
                else x[3 * i + r] += taken * (shape - x[3 * i + r]);
            }
        }
    }
    rigid_pieces->pieces[p].has_rest_shape = maximum <= same;
}

/* Move nodes back in front of walls, after rounding, rotation and spring-back. */
static void move_out_of_walls(pliant_rigid_pieces *rigid_pieces, int32_t p)
{
    const pliant_pieces *pieces = rigid_pieces->body->pieces;
    for (int w = 0; w < rigid_pieces->num_walls; w++) {
        const pliant_wall *wall = rigid_pieces->walls + w;
        double depth = 0;
        for (int32_t i = pieces->start[p]; i < pieces->start[p + 1]; i++) {
            const double *x = rigid_pieces->x + 3 * (size_t)i;
            depth =
                fmax(depth, wall->offset - wall->normal[0] * x[0] - wall->normal[1] * x[1] - wall->normal[2] * x[2]);
        }
        for (int32_t i = pieces->start[p]; depth > 0 && i < pieces->start[p + 1]; i++)
            for (int d = 0; d < 3; d++) rigid_pieces->x[3 * (size_t)i + (size_t)d] += depth * wall->normal[d];
    }
}

static bool is_out_of_view(const pliant_rigid_pieces *rigid_pieces, int32_t p, const double *x, bool by_node)
{
    const pliant_pieces *pieces = rigid_pieces->body->pieces;
    bool below[3] = {true, true, true}, above[3] = {true, true, true};
    for (int32_t i = pieces->start[p]; i < pieces->start[p + 1]; i++)
        for (int d = 0; d < 3; d++) {
            const double at = x[3 * (size_t)(by_node ? pieces->node[i] : i) + (size_t)d];
            below[d] = below[d] && at < rigid_pieces->low[d];
            above[d] = above[d] && at > rigid_pieces->high[d];
        }
    return below[0] || below[1] || below[2] || above[0] || above[1] || above[2];
}

static void stop(pliant_rigid_pieces *rigid_pieces, int32_t p)
{
    piece *at = rigid_pieces->pieces + p;
    memset(at->velocity, 0, sizeof at->velocity);
    memset(at->momentum, 0, sizeof at->momentum);
    at->has_left_view = true;
    if (!rigid_pieces->reported)
        pliant_log(
            PLIANT_LOG_WARNING,
            "a detached piece has left the deformed volume and stops there; increase warp/margin, or set ground/");
    rigid_pieces->reported = true;
}

static void move(pliant_rigid_pieces *rigid_pieces, pliant_data *data, int32_t p, int num_grips, grip *const *grips)
{
    const double slow = 0.01, patience = 0.2; /* [m/s, s] limits below which a piece on the ground comes to rest */
    piece *at = rigid_pieces->pieces + p;
    pliant_rigid body;
    pliant_rigid_pull pulls[PLIANT_RIGID_PULLS];
    double max_motion = 0, speed = 0, reach, spin[3];
    pliant_rigid_pieces_body(rigid_pieces, p, &body);
    if (!(body.mass > 0)) return;
    const int num_pulls = pliant_rigid_pieces_pulls(rigid_pieces, data, p, body.centre, num_grips, grips, pulls);
    for (int k = 0; k < num_pulls; k++)
        for (int d = 0; d < 3; d++) max_motion += fabs(pulls[k].to[d] - body.centre[d] - pulls[k].arm[d]);
    for (int d = 0; d < 3; d++)
        max_motion += rigid_pieces->step * (fabs(body.velocity[d]) + rigid_pieces->step * fabs(data->gravity[d]));
    const double old[3] = {body.centre[0], body.centre[1], body.centre[2]};
    const int32_t near_walls = list_arms(rigid_pieces, p, &body, max_motion, &reach);
    const pliant_rigid_walls around = {.walls = rigid_pieces->walls,
                                       .count = rigid_pieces->num_walls,
                                       .friction = rigid_pieces->friction,
                                       .restitution = rigid_pieces->restitution,
                                       .num_points = near_walls,
                                       .arm = rigid_pieces->near_walls};
    const bool touches =
        !at->is_near_wall && pliant_rigid_step(&body, data->gravity, rigid_pieces->step, num_pulls, pulls, &around);
    if (at->is_near_wall) pliant_rigid_pieces_move_in_contact(rigid_pieces, data, p, &body, num_pulls, pulls);
    keep_pulls(rigid_pieces, p, num_grips, grips, pulls);
    place_nodes(rigid_pieces, p, &body);
    move_out_of_walls(rigid_pieces, p);
    memcpy(at->velocity, body.velocity, sizeof at->velocity);
    memcpy(at->momentum, body.momentum, sizeof at->momentum);
    for (int g = 0; g < num_grips; g++) {
        pliant_tool *tool = data->tools + grips[g]->tool;
        /* Relaxation has pulled at the attachment from before the piece detached. */
        const bool alone = !data->solver && grips[g]->fraction > 0.999;
        for (int d = 0; d < 3 && !pulls[g].is_force; d++)
            tool->force[d] = (alone ? 0 : tool->force[d]) + pulls[g].impulse[d] / rigid_pieces->step;
    }
    for (int d = 0; d < 3; d++) speed += fabs(body.centre[d] - old[d]) / rigid_pieces->step;
    pliant_rigid_spin(&body, spin);
    speed += reach * sqrt(spin[0] * spin[0] + spin[1] * spin[1] + spin[2] * spin[2]);
    at->rest_time =
        touches && at->has_rest_shape && num_pulls == 0 && speed < slow ? at->rest_time + rigid_pieces->step : 0;
    at->is_at_rest = at->rest_time > patience;
    if (at->is_at_rest) {
        memset(at->velocity, 0, sizeof at->velocity);
        memset(at->momentum, 0, sizeof at->momentum);
    }
    if (is_out_of_view(rigid_pieces, p, rigid_pieces->x, false)) stop(rigid_pieces, p);
}

/* ---- A step of all pieces. */

static void move_all(pliant_rigid_pieces *rigid_pieces, pliant_data *data)
{
    const pliant_pieces *pieces = rigid_pieces->body->pieces;
    const bool turned = memcmp(rigid_pieces->gravity, data->gravity, sizeof rigid_pieces->gravity) != 0;
    memcpy(rigid_pieces->gravity, data->gravity, sizeof rigid_pieces->gravity);
    pliant_rigid_pieces_find_grips(rigid_pieces, data);
    for (int32_t p = 0; p < pieces->count; p++) {
        piece *at = rigid_pieces->pieces + p;
        grip *grips[PLIANT_MAX_TOOLS];
        const int num_grips = pliant_rigid_pieces_grips(rigid_pieces, p, grips);
        if (num_grips > 0 || turned || at->is_near_wall) at->is_at_rest = false;
        if (num_grips > 0) at->has_left_view = false;
        if (at->is_at_rest || at->has_left_view) continue;
        data->statistics.rigid_pieces++;
        move(rigid_pieces, data, p, num_grips, grips);
    }
}

/* Update the fixed part of the solver's grasps after their pieces have moved. */
static void move_origins(const pliant_rigid_pieces *rigid_pieces, pliant_data *data)
{
    for (int g = 0; data->solver && g < rigid_pieces->num_grips; g++) {
        const grip *at = rigid_pieces->grips + g;
        const pliant_tool *tool = data->tools + at->tool;
        double *origin = data->solver->grasps[at->tool].origin;
        for (int d = 0; d < 3; d++) origin[d] -= at->fraction * at->point[d];
        for (int32_t h = 0; h < tool->num_held; h++) {
            const int32_t place = rigid_pieces->place[tool->held[h]];
            if (place < 0 || rigid_pieces->piece_of[place] != at->piece) continue;
            for (int d = 0; d < 3; d++) origin[d] += tool->weight[h] * rigid_pieces->x[3 * (size_t)place + (size_t)d];
        }
    }
}

bool pliant_rigid_pieces_step(pliant_data *data)
{
    pliant_rigid_pieces *rigid_pieces = data->rigid_pieces;
    const pliant_pieces *pieces = rigid_pieces->body->pieces;
    bool rebuilt = false;
    data->statistics.rigid_pieces = 0;
    if (!rigid_pieces->body->has_inertia) {
        pliant_rigid_pieces_set_step(rigid_pieces, data);
        pliant_rigid_pieces_have_contact(rigid_pieces, &data->contacts);
        move_all(rigid_pieces, data);
        move_origins(rigid_pieces, data);
        pliant_rigid_pieces_hold(rigid_pieces, data->positions);
        return false;
    }
    for (int32_t p = 0; p < pieces->count; p++) {
        if (rigid_pieces->pieces[p].has_left_view) continue;
        data->statistics.rigid_pieces++;
        if (!is_out_of_view(rigid_pieces, p, data->positions, true)) continue;
        stop(rigid_pieces, p);
        pliant_tled_fix_nodes(data->tled, pieces->start[p + 1] - pieces->start[p], pieces->node + pieces->start[p]);
        rebuilt = true;
    }
    return rebuilt;
}
