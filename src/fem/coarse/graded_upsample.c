/* Upsampling of a graded system (graded.c). */
#include "base/fail.h"
#include "base/buffer.h"
#include "fem/coarse/graded.h"
#include "base/memory.h"
#include "mesh/mesh.h"

#include <math.h>
#include <string.h>

static pliant_status no_memory(void) { return pliant_fail_memory("the interpolation weights of nodes near a cut"); }

static bool is_cube(const pliant_macros *macros, int32_t element)
{
    return macros && macros->start[element + 1] - macros->start[element] == GRADED_CORNERS;
}

static void follow_itself(const grading *work, int32_t node, followed *out)
{
    out->count = 1;
    out->node[0] = work->graded->coarse_nodes + node;
    out->weight[0] = 1;
}

void pliant_graded_follow(const grading *work, int32_t node, followed *out)
{
    follow_itself(work, node, out);
    if (work->graded->unrefined_neighbour[node] < 0) return;
    const int32_t tet = work->body->coarse_of_fine[work->graded->unrefined_neighbour[node]],
                  element = work->graded->base->element_of_tet[tet];
    const bool cube = is_cube(work->base->macros, element);
    const int32_t *corners =
        cube ? work->base->macros->node + work->base->macros->start[element] : work->coarse->tets + 4 * (size_t)tet;
    double weights[GRADED_CORNERS];
    const double *rest = work->fine->rest + 3 * (size_t)node;
    if (cube) pliant_trilinear_weights(work->base, work->base->macros->cell[element], rest, weights);
    else pliant_mesh_barycentric(work->coarse, tet, rest, weights);
    out->count = 0;
    for (int v = 0; v < (cube ? GRADED_CORNERS : 4); v++) {
        if (fabs(weights[v]) < 1e-9) continue;
        if (work->body->fine_fixed[node] && work->base->free_of_node[corners[v]] >= 0) {
            follow_itself(work, node, out);
            return;
        }
        out->node[out->count] = corners[v];
        out->weight[out->count++] = weights[v];
    }
}

/* Return the node's number in the base's body. */
static size_t node_of_base(const grading *work, size_t node)
{
    return node < (size_t)work->base->fine->num_nodes ? node : (size_t)work->body->node_parent[node];
}

/* Return whether the node's entry in the earlier upsampling is still valid. Only entries of other nodes are
 * rewritten. */
static bool follows_as_listed(const grading *work, int32_t node)
{
    const pliant_graded *was = work->before ? work->before->graded : NULL;
    if (work->graded->in_refined[node]) return was && work->alike[node];
    return was ? node < work->before->fine->num_nodes && !was->in_refined[node] : node < work->base->fine->num_nodes;
}

static pliant_status follow_linearly(grading *work, pliant_upsample *upsample)
{
    const pliant_upsample *load = work->base->upsample, *was = work->before ? work->before->upsample : load;
    const size_t corners = (size_t)load->corners, nodes = (size_t)work->fine->num_nodes;
    const size_t before = (size_t)(work->before ? work->before : work->base)->fine->num_nodes,
                 both = corners * (before < nodes ? before : nodes);
    upsample->node = pliant_next_version(was->node, both, corners * nodes, sizeof *upsample->node);
    upsample->weights = pliant_next_version(was->weights, both, corners * nodes, sizeof *upsample->weights);
    if (!upsample->node || !upsample->weights) return no_memory();
    for (size_t n = 0; n < nodes; n++) {
        if (follows_as_listed(work, (int32_t)n)) continue;
        int32_t *node = upsample->node + corners * n;
        double *weights = upsample->weights + corners * n;
        const size_t of_load = node_of_base(work, n);
        memcpy(node, load->node + corners * of_load, corners * sizeof *node);
        memcpy(weights, load->weights + corners * of_load, corners * sizeof *weights);
        if (work->graded->in_refined[n]) {
            followed of;
            pliant_graded_follow(work, (int32_t)n, &of);
            for (size_t v = 0; v < corners; v++) {
                node[v] = of.node[v < (size_t)of.count ? v : 0];
                weights[v] = v < (size_t)of.count ? of.weight[v] : 0;
            }
        }
        pliant_mark_written(upsample->node, corners * n, corners, sizeof *node);
        pliant_mark_written(upsample->weights, corners * n, corners, sizeof *weights);
    }
    return PLIANT_OK;
}

/* Follow the shape functions of the remaining coarse elements, and of points. */
static pliant_status follow_shapes(grading *work, pliant_upsample *upsample)
{
    const pliant_upsample *was = work->base->upsample;
    const size_t each = 9 * (size_t)was->corners;
    const int32_t nodes = work->fine->num_nodes;
    size_t maximum = (size_t)nodes;
    for (int32_t n = 0; n < nodes; n++)
        maximum += (size_t)(was->start[node_of_base(work, (size_t)n) + 1] - was->start[node_of_base(work, (size_t)n)]);
    upsample->start = pliant_calloc((size_t)nodes + 1, sizeof *upsample->start);
    upsample->entry_element = pliant_calloc(maximum, sizeof *upsample->entry_element);
    upsample->entry_weight = pliant_calloc(maximum, sizeof *upsample->entry_weight);
    upsample->entry_shape = pliant_calloc(maximum, each * sizeof *upsample->entry_shape);
    if (!upsample->start || !upsample->entry_element || !upsample->entry_weight || !upsample->entry_shape)
        return no_memory();
    for (int32_t n = 0; n < nodes; n++) {
        const size_t load = node_of_base(work, (size_t)n);
        const int32_t begin = upsample->start[n];
        int32_t at = begin;
        double sum = 0;
        for (int32_t e = was->start[load]; work->point[n] < 0 && e < was->start[load + 1]; e++) {
            if (work->now[was->entry_element[e]] < 0) continue;
            upsample->entry_element[at] = work->now[was->entry_element[e]];
            sum += upsample->entry_weight[at] = was->entry_weight[e];
            memcpy(upsample->entry_shape + each * (size_t)at++, was->entry_shape + each * (size_t)e,
                   each * sizeof(double));
        }
        for (int32_t e = begin; e < at; e++) upsample->entry_weight[e] /= sum;
        if (work->point[n] >= 0) {
            upsample->entry_element[at] = work->point[n];
            upsample->entry_weight[at] = 1;
            for (size_t m = 0; m < 9; m += 4) upsample->entry_shape[each * (size_t)at + m] = 1;
            at++;
        }
        upsample->start[n + 1] = at;
    }
    return PLIANT_OK;
}

pliant_status pliant_graded_upsample(grading *work)
{
    pliant_upsample *upsample = work->system->upsample = pliant_calloc(1, sizeof *upsample);
    if (!upsample) return no_memory();
    upsample->corners = work->base->upsample->corners;
    upsample->still = work->body->fine_fixed;
    return work->point ? follow_shapes(work, upsample) : follow_linearly(work, upsample);
}

static void find_alike(grading *work)
{
    const pliant_graded *was = work->before->graded, *now = work->graded;
    const pliant_body *before = work->kept->before->body;
    const uint8_t *fixed = work->body->fine_fixed;
    const int32_t nodes =
        before->fine.num_nodes < work->fine->num_nodes ? before->fine.num_nodes : work->fine->num_nodes;
    for (int32_t n = 0; n < nodes; n++)
        work->alike[n] = (was->in_refined[n] != 0) & (was->unrefined_neighbour[n] == now->unrefined_neighbour[n]) &
                         (before->fine_fixed[n] == fixed[n]);
}

void pliant_graded_followers(grading *work)
{
    const int32_t *tets = work->fine->tets;
    pliant_graded *graded = work->graded;
    memset(graded->unrefined_neighbour, 0xff, (size_t)work->fine->num_nodes * sizeof *graded->unrefined_neighbour);
    for (int32_t i = 0; i < 4 * work->num_tets; i++)
        graded->in_refined[tets[4 * (size_t)work->tet[i / 4] + (size_t)(i % 4)]] = 1;
    for (int32_t i = 0; i < 4 * work->num_adjacent; i++) {
        const int32_t tet = work->adjacent[i / 4], node = tets[4 * (size_t)tet + (size_t)(i % 4)];
        if (graded->in_refined[node] && graded->unrefined_neighbour[node] < 0) graded->unrefined_neighbour[node] = tet;
    }
    if (work->alike) find_alike(work);
}
