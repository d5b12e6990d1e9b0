/* Bisect edges of severed faces that cannot open. A face opens where one of its corners gets a copy. Corners on the
 * border of a cut get none, so a face with three of them would still join its tetrahedra. A node on an edge between two
 * severed faces is inside the cut and gets a copy. */
#include "cut/subdivide.h"

#include "base/buffer.h"
#include "base/fail.h"
#include "base/memory.h"
#include "base/vector3.h"

#include <stdlib.h>
#include <string.h>

static pliant_status no_memory(void) { return pliant_fail_memory("the faces that the blade splits"); }

/* Mark the severed faces whose sides use different copies of a node.
 * part: buffer for two numbers per corner around the node */
static void mark_open(const cut_splitting *work, int32_t *part, uint8_t *is_open)
{
    const int32_t count = work->num_around;
    if (pliant_split_find_parts(work, part, part + count) == 1) return;
    for (int32_t i = 0; i < count; i++)
        for (int c = 0; c < 4; c++) {
            const int32_t at = work->around[i] / 4 * 4 + c, other = work->severed[at] - 1;
            if (at == work->around[i] || other < 0) continue;
            for (int32_t j = 0; j < count; j++)
                if (work->around[j] / 4 == other / 4 && pliant_set_root(part, i) != pliant_set_root(part, j))
                    is_open[at] = 1;
        }
}

/* is_open: (num_tets x 4) */
static pliant_status find_open(cut_splitting *work, uint8_t *is_open)
{
    int32_t *buffer = NULL, capacity = 0;
    pliant_status status = PLIANT_OK;
    for (int32_t n = 0; n < work->num_nodes && status == PLIANT_OK; n++) {
        if (!(work->on[n] & CUT_PASSED)) continue;
        status = pliant_split_around(work, n);
        if (status != PLIANT_OK || !pliant_split_has_severed(work)) continue;
        if (2 * work->num_around > capacity) {
            capacity = 4 * work->num_around;
            if (!pliant_grow(&buffer, (size_t)capacity, sizeof *buffer)) status = no_memory();
        }
        if (status == PLIANT_OK) mark_open(work, buffer, is_open);
    }
    pliant_free(buffer);
    return status;
}

static void nodes_of(const cut_splitting *work, int32_t face, int32_t node[3])
{
    for (int c = 0, n = 0; c < 4; c++)
        if (c != face % 4) node[n++] = work->corners[face / 4 * 4 + c];
}

/* List the edges of severed faces once, with the number of these faces as bits. */
static pliant_status list_edges(const cut_splitting *work, cut_edge_points *list)
{
    pliant_status status = PLIANT_OK;
    int32_t count = 0;
    for (int32_t f = 0; f < 4 * work->num_tets; f++) {
        int32_t node[3];
        if (work->severed[f] - 1 <= f) continue; /* whole, or listed from the other side */
        nodes_of(work, f, node);
        for (int i = 0; i < 3 && status == PLIANT_OK; i++)
            status = pliant_split_list_edge(list, node[i], node[(i + 1) % 3], 0.5);
    }
    if (status != PLIANT_OK || list->count == 0) return status;
    qsort(list->edges, (size_t)list->count, sizeof *list->edges, pliant_split_by_ends);
    for (int32_t e = 0; e < list->count; e++) {
        if (count == 0 || memcmp(list->edges[count - 1].end, list->edges[e].end, sizeof list->edges->end) != 0) {
            cut_edge_point *one = list->edges + count++;
            *one = list->edges[e];
            one->length =
                pliant_distance3(work->rest + 3 * (size_t)one->end[0], work->rest + 3 * (size_t)one->end[1]);
            one->bits = 0;
        }
        if (list->edges[count - 1].bits < UINT8_MAX) list->edges[count - 1].bits++;
    }
    list->count = count;
    return PLIANT_OK;
}

/* Find the edge of a face to bisect: the longest between two severed faces, or else the longest. Edges whose parts
 * would be too small are not bisected.
 * out: NULL: none */
static pliant_status choose_edge(cut_splitting *work, const cut_edge_points *list, int32_t face, cut_edge_point **out)
{
    cut_edge_point *best = NULL;
    pliant_status status = PLIANT_OK;
    int32_t node[3];
    nodes_of(work, face, node);
    for (int i = 0; i < 3 && status == PLIANT_OK; i++) {
        const int32_t a = node[i], b = node[(i + 1) % 3];
        bool is_large = false;
        const cut_edge_point key = {.end = {a < b ? a : b, a < b ? b : a}, .fraction = 0.5};
        cut_edge_point *one =
            bsearch(&key, list->edges, (size_t)list->count, sizeof *list->edges, pliant_split_by_ends);
        if (one->length < 2 * work->body->subdivision->min_edge) continue;
        status = pliant_split_can_bisect(work, one, &is_large);
        if (is_large && (!best || (one->bits > 1) > (best->bits > 1) ||
                         ((one->bits > 1) == (best->bits > 1) && one->length > best->length)))
            best = one;
    }
    *out = best;
    return status;
}

/* Choose the edges to bisect. Keep only these. */
static pliant_status choose_edges(cut_splitting *work, const uint8_t *is_open, cut_edge_points *list)
{
    int32_t count = 0;
    uint8_t *is_chosen = pliant_calloc((size_t)list->count, 1);
    pliant_status status = is_chosen ? PLIANT_OK : no_memory();
    for (int32_t f = 0; f < 4 * work->num_tets && status == PLIANT_OK; f++) {
        cut_edge_point *one = NULL;
        if (work->severed[f] - 1 <= f || is_open[f] || is_open[work->severed[f] - 1]) continue;
        status = choose_edge(work, list, f, &one);
        if (one) is_chosen[one - list->edges] = 1;
    }
    for (int32_t e = 0; e < list->count && status == PLIANT_OK; e++) {
        if (!is_chosen[e]) continue;
        list->edges[count] = list->edges[e];
        list->edges[count++].bits = CUT_ON_SURFACE | CUT_ON_SWEEP | CUT_PASSED;
    }
    list->count = count;
    pliant_free(is_chosen);
    return status;
}

pliant_status pliant_split_open_faces(cut_splitting *work, bool *changed)
{
    const int32_t nodes = work->num_nodes;
    cut_edge_points list = {0};
    /* Cuts leave tetrahedra of the minimum height. A bisection halves the height at worst. */
    work->min_height = 0.5 * work->body->subdivision->min_height;
    uint8_t *is_open = pliant_calloc(4 * (size_t)work->num_tets, 1);
    pliant_status status = is_open ? find_open(work, is_open) : no_memory();
    if (status == PLIANT_OK) status = list_edges(work, &list);
    if (status == PLIANT_OK && list.count > 0) status = choose_edges(work, is_open, &list);
    if (status == PLIANT_OK && list.count > 0) status = pliant_split_listed(work, &list, 0);
    *changed = work->num_nodes > nodes;
    pliant_free(list.edges);
    pliant_free(is_open);
    return status;
}
