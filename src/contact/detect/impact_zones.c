#include "contact/detect/impact_zones.h"

#include "base/buffer.h"
#include "base/fail.h"
#include "base/memory.h"
#include "base/union_find.h"
#include "base/vector3.h"
#include "contact/advance/advance_rules.h"
#include "contact/advance/self_rules.h"

#include <math.h>
#include <string.h>

enum {
    MAX_IMPULSES = 16 /* rounds over the pairs that would come too near, before they form zones */,
    MAX_MARGINS = 8 /* motion of two nodes relative to each other in a stable sub-step, over the margin of the pairs */
};

static int32_t num_nodes(const pliant_impact_zones *zones) { return zones->tissue->body->fine.num_nodes; }

void pliant_impact_zones_free(pliant_impact_zones *zones)
{
    PLIANT_FREE(zones->pair, zones->blocked, zones->before, zones->center, zones->start, zones->wanted[0],
                zones->wanted[1], zones->from, zones->to, zones->root, zones->zone);
    memset(zones, 0, sizeof *zones);
}

static pliant_status reserve(pliant_impact_zones *zones, size_t nodes)
{
    return pliant_ensure(&zones->before, 3 * nodes, sizeof *zones->before) &&
                   pliant_ensure(&zones->center, 3 * nodes, sizeof *zones->center) &&
                   pliant_ensure(&zones->start, 3 * nodes, sizeof *zones->start) &&
                   pliant_ensure(&zones->wanted[0], 3 * nodes, sizeof *zones->wanted[0]) &&
                   pliant_ensure(&zones->wanted[1], 3 * nodes, sizeof *zones->wanted[1]) &&
                   pliant_ensure(&zones->from, 3 * nodes, sizeof *zones->from) &&
                   pliant_ensure(&zones->to, 3 * nodes, sizeof *zones->to) &&
                   pliant_ensure(&zones->root, nodes, sizeof *zones->root) &&
                   pliant_ensure(&zones->zone, nodes, sizeof *zones->zone)
               ? PLIANT_OK
               : pliant_fail_memory("the self-contacts of the tissue");
}

/* ---- the list of pairs */

/* Take over the pairs that pliant_tissue_list_pairs has found. */
static pliant_status take_pairs(pliant_impact_zones *zones)
{
    const pliant_advance *advance = zones->tissue->advance;
    const pliant_advance_self self = {.exempt = zones->tissue->exempt, .piece = zones->tissue->piece};
    if (!pliant_ensure(&zones->pair, (size_t)advance->max_self, sizeof *zones->pair))
        return pliant_fail_memory("the self-contacts of the tissue");
    zones->num_pairs = 0;
    zones->motion = 0;
    zones->next = INFINITY;
    for (int32_t n = 0; n < advance->num_self; n++) {
        const pliant_advance_self_pair *pair = advance->self + n;
        if (pliant_advance_is_exempt(&self, 4, pair->node, pair->is_edges ? 2 : 1)) continue;
        const double slack = pair->limit - zones->rule.settings->advance_stop * zones->rule.thickness;
        zones->pair[zones->num_pairs++] = (pliant_impact_pair){.index = n, .thickness = -1, .slack = slack};
        zones->next = slack < zones->next ? slack : zones->next;
    }
    return PLIANT_OK;
}

/* Compute the position of a surface node from displacements. */
static void corner_of(const pliant_impact_zones *zones, int32_t node, const double *u, double out[3])
{
    const double *rest = zones->tissue->body->fine.rest;
    int32_t support[4] = {node};
    double weights[4] = {1};
    const int count = zones->surface ? pliant_contact_surface_support(zones->surface, node, support, weights) : 1;
    memset(out, 0, 3 * sizeof *out);
    for (int v = 0; v < count; v++)
        for (size_t d = 0; d < 3; d++)
            out[d] += weights[v] * (rest[3 * (size_t)support[v] + d] + u[3 * (size_t)support[v] + d]);
}

pliant_status pliant_impact_zones_set(pliant_impact_zones *zones, pliant_tissue *tissue,
                                      const pliant_contact_surface *surface, const pliant_tissue_rule *rule)
{
    zones->tissue = tissue;
    zones->surface = surface;
    zones->rule = *rule;
    const pliant_status status = reserve(zones, (size_t)num_nodes(zones));
    return status == PLIANT_OK ? take_pairs(zones) : status;
}

/* List the pairs at the start of a sub-step. motion: of two nodes relative to each other in the sub-step [m] */
static void list_pairs(pliant_impact_zones *zones, double motion)
{
    pliant_tissue *tissue = zones->tissue;
    for (int32_t n = 0; n < tissue->num_nodes; n++)
        corner_of(zones, tissue->node[n], zones->before, zones->from + 3 * (size_t)tissue->node[n]);
    zones->status =
        pliant_tissue_list_pairs(tissue, zones->from, fmax(zones->rule.max_margin, motion + zones->rule.thickness));
    if (zones->status == PLIANT_OK) zones->status = take_pairs(zones);
    memcpy(zones->start, zones->before, 3 * (size_t)num_nodes(zones) * sizeof *zones->start);
}

void pliant_impact_zones_begin(pliant_impact_zones *zones, const double *u)
{
    const size_t bytes = 3 * (size_t)num_nodes(zones) * sizeof *u;
    zones->status = PLIANT_OK;
    zones->is_too_fast = false;
    memcpy(zones->before, u, bytes);
    if (zones->motion > 0) list_pairs(zones, 0); /* after a rollback */
    memcpy(zones->start, u, bytes);
}

void pliant_impact_zones_accelerate(pliant_impact_zones *zones, double step, const double *acceleration)
{
    for (size_t i = 0; i < 3 * (size_t)num_nodes(zones); i++) zones->center[i] = 0.5 * step * step * acceleration[i];
}

/* Return a bound of the motion of two nodes relative to each other [m]. */
static double find_motion(const pliant_impact_zones *zones, const double *from, const double *to)
{
    return pliant_advance_relative_motion(num_nodes(zones), NULL, from, to);
}

/* ---- pairs that would come too near */

static pliant_advance_self_pair *pair_at(const pliant_impact_zones *zones, int32_t n)
{
    return zones->tissue->advance->self + zones->pair[n].index;
}

/* Return the nodes that move a pair, at most 16. */
static int nodes_of(const pliant_impact_zones *zones, int32_t n, int32_t out[16])
{
    const pliant_advance_self_pair *pair = pair_at(zones, n);
    double weights[4];
    int count = 0;
    for (int c = 0; c < 4; c++) {
        const int32_t node = pair->node[c];
        if (zones->surface)
            count += pliant_contact_surface_support(zones->surface, node, out + count, weights);
        else
            out[count++] = node;
    }
    return count;
}

/* Return the largest fraction of the sub-step that is free for a pair. */
static double free_fraction(pliant_impact_zones *zones, int32_t n, const double *u)
{
    pliant_advance_self_pair *pair = pair_at(zones, n);
    for (int c = 0; c < 4; c++) {
        corner_of(zones, pair->node[c], zones->before, zones->from + 3 * (size_t)pair->node[c]);
        corner_of(zones, pair->node[c], u, zones->to + 3 * (size_t)pair->node[c]);
    }
    return pliant_tissue_advance_pair(zones->tissue, zones->from, zones->to, &zones->rule, pair);
}

static double distance_at(pliant_impact_zones *zones, int32_t n, const double *u)
{
    const pliant_advance_self_pair *pair = pair_at(zones, n);
    for (int c = 0; c < 4; c++) corner_of(zones, pair->node[c], u, zones->from + 3 * (size_t)pair->node[c]);
    return pliant_advance_self_distance(pair, zones->from);
}

/* Return a bound of the motion of a pair's nodes relative to each other since the pairs were listed, up to the end of
 * this sub-step [m]. */
static double find_pair_motion(const pliant_impact_zones *zones, int32_t n, const double *u)
{
    double low[2][3] = {{0}}, high[2][3] = {{0}}, square[2] = {0, 0};
    int32_t node[16];
    const int count = nodes_of(zones, n, node);
    for (int k = 0; k < count; k++)
        for (size_t d = 0; d < 3; d++) {
            const size_t at = 3 * (size_t)node[k] + d;
            const double motion[2] = {zones->before[at] - zones->start[at], u[at] - zones->start[at]};
            for (int m = 0; m < 2; m++) {
                low[m][d] = k == 0 || motion[m] < low[m][d] ? motion[m] : low[m][d];
                high[m][d] = k == 0 || motion[m] > high[m][d] ? motion[m] : high[m][d];
            }
        }
    for (int m = 0; m < 2; m++)
        for (int d = 0; d < 3; d++) square[m] += (high[m][d] - low[m][d]) * (high[m][d] - low[m][d]);
    return sqrt(square[0] > square[1] ? square[0] : square[1]);
}

static bool add_blocked(pliant_impact_zones *zones, int32_t n)
{
    if (!pliant_reserve(&zones->blocked, &zones->max_blocked, zones->num_blocked, 64, sizeof *zones->blocked)) {
        zones->status = pliant_fail_memory("the self-contacts of the tissue");
        return false;
    }
    zones->blocked[zones->num_blocked++] = n;
    return true;
}

/* Return the distance of a pair beyond the smallest distance that a leg may leave. The smallest distance rises more
 * slowly than the distance at the start of the leg. */
static double gap_of(const pliant_impact_zones *zones, const pliant_impact_pair *pair, double distance)
{
    return distance - pliant_advance_limit(zones->rule.settings, pair->thickness, distance);
}

/* Return whether a pair would come too near in this sub-step. First use the motion of the pair's nodes since the pairs
 * were listed, then the distance at the start of this sub-step. before: motion up to there [m] */
static bool is_blocked(pliant_impact_zones *zones, int32_t n, double before, const double *u)
{
    pliant_impact_pair *pair = zones->pair + n;
    if (pair->thickness < 0) {
        pair->thickness = pliant_tissue_pair_thickness(zones->tissue, &zones->rule, pair_at(zones, n));
        pair->slack = pair->gap =
            pair->thickness > 0 ? gap_of(zones, pair, distance_at(zones, n, zones->start)) : INFINITY;
    }
    if (pair->slack > zones->motion || pair->gap > find_pair_motion(zones, n, u)) return false;
    pair->slack = before + gap_of(zones, pair, distance_at(zones, n, zones->before));
    return pair->slack <= zones->motion && free_fraction(zones, n, u) < 1;
}

/* List the pairs that would come too near. */
static void find_blocked(pliant_impact_zones *zones, double motion, const double *u)
{
    zones->num_blocked = 0;
    zones->next = INFINITY;
    for (int32_t n = 0; n < zones->num_pairs; n++) {
        const pliant_impact_pair *pair = zones->pair + n;
        if (pair->slack <= zones->motion && is_blocked(zones, n, zones->motion - motion, u) && !add_blocked(zones, n))
            return;
        zones->next = pair->slack < zones->next ? pair->slack : zones->next;
    }
}

/* ---- impulses */

/* Find the nodes of a pair's closest points and their weights. Return the number of nodes. */
static int find_weights(const pliant_impact_zones *zones, const pliant_advance_self_pair *pair, int32_t node[16],
                        double weight[16], double normal[3])
{
    double of_corner[4];
    int32_t count = 0;
    pliant_advance_self_contact(pair, zones->from, zones->to, of_corner, normal);
    for (int c = 0; c < 4; c++) {
        int32_t support[4] = {pair->node[c]};
        double weights[4] = {1};
        const int supports =
            zones->surface ? pliant_contact_surface_support(zones->surface, pair->node[c], support, weights) : 1;
        for (int v = 0; v < supports; v++)
            pliant_contact_add_weight(&count, node, weight, support[v], of_corner[c] * weights[v]);
    }
    return count;
}

/* Reduce the approach of a pair to the fraction that is free, by an impulse along the line between its closest
 * points. The energy of increments d is (d - c)' M (d - c) / 2 h^2 plus a constant, with the increments c of least
 * energy. The impulse at most reverses the approach d - c of the pair, so that it adds no energy. */
static void apply_impulse(pliant_impact_zones *zones, int32_t n, const double *inverse_mass, double *u, double *d)
{
    const pliant_advance_self_pair *pair = pair_at(zones, n);
    int32_t node[16];
    double weight[16], normal[3], approach = 0, speed = 0, excess = 0, compliance = 0;
    (void)free_fraction(zones, n, u);
    if (!(pair->t < 1)) return;
    const int count = find_weights(zones, pair, node, weight, normal);
    for (int k = 0; k < count; k++) {
        const size_t at = 3 * (size_t)node[k];
        compliance += weight[k] * weight[k] * inverse_mass[node[k]];
        for (size_t c = 0; c < 3; c++) {
            approach -= weight[k] * normal[c] * (u[at + c] - zones->before[at + c]);
            speed -= weight[k] * normal[c] * d[at + c];
            excess -= weight[k] * normal[c] * (d[at + c] - zones->center[at + c]);
        }
    }
    if (!(approach > 0) || !(compliance > 0)) return;
    const double wanted = (1 - pair->t) * fmax(speed, 0) /* not what moved overlaps apart */,
                 slowed = fmin(wanted, 2 * fmax(excess, 0)),
                 moved = fmax((1 - pair->t) * approach - (wanted - slowed), 0);
    for (int k = 0; k < count; k++) {
        const double share = weight[k] * inverse_mass[node[k]] / compliance;
        for (size_t c = 0; c < 3; c++) {
            u[3 * (size_t)node[k] + c] += share * moved * normal[c];
            d[3 * (size_t)node[k] + c] += share * slowed * normal[c];
        }
    }
}

/* ---- zones */

/* Put the nodes of a pair into one zone. */
static void join_pair(pliant_impact_zones *zones, int32_t n)
{
    int32_t node[16];
    const int count = nodes_of(zones, n, node);
    for (int k = 0; k < count; k++) {
        if (zones->root[node[k]] < 0) zones->root[node[k]] = node[k];
        pliant_set_join(zones->root, node[k], node[0]);
    }
}

/* Compute the free fraction of each zone, and its mean motion. */
static void find_means(pliant_impact_zones *zones, const double *inverse_mass)
{
    const int32_t nodes = num_nodes(zones);
    for (int32_t n = 0; n < nodes; n++)
        if (zones->root[n] == n) zones->zone[n] = (pliant_impact_zone){.t = 1};
    for (int32_t b = 0; b < zones->num_blocked; b++) {
        const int32_t pair = zones->blocked[b];
        int32_t node[16];
        (void)nodes_of(zones, pair, node);
        pliant_impact_zone *zone = zones->zone + pliant_set_root(zones->root, node[0]);
        zone->t = fmin(zone->t, pair_at(zones, pair)->t);
    }
    for (int32_t n = 0; n < nodes; n++) {
        if (zones->root[n] < 0) continue;
        pliant_impact_zone *zone = zones->zone + pliant_set_root(zones->root, n);
        zone->is_fixed = zone->is_fixed || !(inverse_mass[n] > 0);
        if (!(inverse_mass[n] > 0)) continue;
        zone->mass += 1 / inverse_mass[n];
        for (size_t d = 0; d < 3; d++) {
            const size_t at = 3 * (size_t)n + d;
            zone->motion[d] += (zones->wanted[0][at] - zones->before[at]) / inverse_mass[n];
            zone->increment[d] += zones->wanted[1][at] / inverse_mass[n];
            zone->center[d] += zones->center[at] / inverse_mass[n];
        }
    }
    for (int32_t n = 0; n < nodes; n++)
        for (int d = 0; d < 3 && zones->root[n] == n; d++) {
            pliant_impact_zone *zone = zones->zone + n;
            const bool moves = !zone->is_fixed && zone->mass > 0;
            zone->motion[d] = moves ? zone->motion[d] / zone->mass : 0;
            zone->increment[d] = moves ? zone->increment[d] / zone->mass : 0;
            zone->center[d] = moves ? zone->center[d] / zone->mass : 0;
        }
}

/* Find the fraction of its velocities that each zone keeps, so that it adds no energy.
 *
 * A shorter motion of strained tissue can raise the energy (apply_impulse). At the start of the next sub-step, the
 * energy of the same increments is (d + c)' M (d + c) / 2 h^2 plus a constant. The zone has hardly moved, so c is
 * nearly the same. The zone shortens d + c until the gain is lost. */
static void find_kept(pliant_impact_zones *zones, const double *inverse_mass)
{
    const int32_t nodes = num_nodes(zones);
    for (int32_t n = 0; n < nodes; n++) {
        if (zones->root[n] < 0 || !(inverse_mass[n] > 0)) continue;
        pliant_impact_zone *zone = zones->zone + pliant_set_root(zones->root, n);
        for (size_t k = 0; k < 3; k++) {
            const size_t at = 3 * (size_t)n + k;
            const double wanted = zones->wanted[1][at] - zone->increment[k], d = zone->t * wanted,
                         c = zones->center[at] - zone->center[k];
            zone->gain += ((d - c) * (d - c) - (wanted - c) * (wanted - c)) / inverse_mass[n];
            zone->energy += (d + c) * (d + c) / inverse_mass[n];
        }
    }
    for (int32_t n = 0; n < nodes; n++)
        if (zones->root[n] == n) {
            pliant_impact_zone *zone = zones->zone + n;
            zone->kept = zone->gain > 0 ? sqrt(fmax(1 - zone->gain / zone->energy, 0)) : 1;
        }
}

/* Move each zone by its mean, and by a fraction of the motion relative to it. */
static void move_zones(pliant_impact_zones *zones, const double *inverse_mass, double *u, double *d)
{
    find_means(zones, inverse_mass);
    find_kept(zones, inverse_mass);
    for (int32_t n = 0; n < num_nodes(zones); n++) {
        if (zones->root[n] < 0 || !(inverse_mass[n] > 0)) continue;
        const pliant_impact_zone *zone = zones->zone + pliant_set_root(zones->root, n);
        for (size_t k = 0; k < 3; k++) {
            const size_t at = 3 * (size_t)n + k;
            const double motion = zones->wanted[0][at] - zones->before[at],
                         increment = zone->t * (zones->wanted[1][at] - zone->increment[k]),
                         lost = (1 - zone->kept) * (increment + zones->center[at] - zone->center[k]);
            u[at] = zones->before[at] + zone->motion[k] + zone->t * (motion - zone->motion[k]);
            d[at] = zone->increment[k] + increment - lost;
        }
    }
}

/* Let zones grow by the pairs at their borders that would come too near. Return whether any has grown. */
static bool grow(pliant_impact_zones *zones, const double *u)
{
    bool grown = false;
    for (int32_t n = 0; n < zones->num_pairs; n++) {
        int32_t node[16];
        if (!(zones->pair[n].slack <= zones->motion)) continue;
        const int count = nodes_of(zones, n, node);
        bool is_in_one = zones->root[node[0]] >= 0, is_in_any = is_in_one;
        for (int k = 1; k < count; k++) {
            const bool is_in = zones->root[node[k]] >= 0;
            is_in_any = is_in_any || is_in;
            is_in_one = is_in_one && is_in &&
                        pliant_set_root(zones->root, node[k]) == pliant_set_root(zones->root, node[0]);
        }
        if (!is_in_any || is_in_one) continue;
        const double t = pair_at(zones, n)->t;
        const bool is_blocked = free_fraction(zones, n, u) < 1;
        pair_at(zones, n)->t = t; /* of the motion without zones */
        if (is_blocked) join_pair(zones, n);
        grown = grown || is_blocked;
    }
    return grown;
}

static void limit_zones(pliant_impact_zones *zones, const double *inverse_mass, double *u, double *d)
{
    const int32_t nodes = num_nodes(zones);
    memcpy(zones->wanted[0], u, 3 * (size_t)nodes * sizeof *u);
    memcpy(zones->wanted[1], d, 3 * (size_t)nodes * sizeof *d);
    for (int32_t n = 0; n < nodes; n++) zones->root[n] = -1;
    for (int32_t b = 0; b < zones->num_blocked; b++) join_pair(zones, zones->blocked[b]);
    move_zones(zones, inverse_mass, u, d);
    while (grow(zones, u)) move_zones(zones, inverse_mass, u, d); /* ends: zones only merge */
}

void pliant_impact_zones_limit(pliant_impact_zones *zones, const double *inverse_mass, double *u, double *d)
{
    const double stop = zones->rule.settings->advance_stop * zones->rule.thickness;
    double before = zones->motion, motion = 0;
    for (int round = 0; zones->status == PLIANT_OK; round++) {
        motion = fmax(find_motion(zones, zones->before, u), motion);
        zones->is_too_fast = !(motion < MAX_MARGINS * zones->rule.max_margin);
        if (zones->is_too_fast) break;
        if (!(zones->tissue->listed - find_motion(zones, zones->start, u) > stop)) {
            list_pairs(zones, motion);
            before = 0;
        }
        zones->motion = before + motion;
        if (zones->status != PLIANT_OK || !(zones->next <= zones->motion)) break;
        find_blocked(zones, motion, u);
        if (zones->status != PLIANT_OK || zones->num_blocked == 0) break;
        if (round == MAX_IMPULSES) {
            limit_zones(zones, inverse_mass, u, d);
            break;
        }
        for (int32_t b = 0; b < zones->num_blocked; b++) apply_impulse(zones, zones->blocked[b], inverse_mass, u, d);
    }
    memcpy(zones->before, u, 3 * (size_t)num_nodes(zones) * sizeof *u);
}
