/* Numbering of free nodes, gather lists of element forces, and contributions to the matrix's diagonal. */
#include "base/fail.h"
#include "base/buffer.h"
#include "fem/system.h"
#include "base/memory.h"

#include <stdlib.h>
#include <string.h>

/* Return whether the fixed nodes among the earlier nodes are unchanged. */
static bool same_fixed(const pliant_mesh *mesh, const uint8_t *fixed, const pliant_system *before)
{
    int32_t differ = 0;
    if (!before || before->mesh->num_nodes > mesh->num_nodes) return false;
    for (int32_t n = 0; n < before->mesh->num_nodes; n++) differ |= (fixed[n] != 0) != (before->free_of_node[n] < 0);
    return differ == 0;
}

/* Number the free nodes. before: Nullable: a system whose valid numbers are copied. */
static pliant_status number_free(pliant_system *system, const uint8_t *fixed, const pliant_system *before)
{
    const pliant_mesh *mesh = system->mesh;
    const bool same = same_fixed(mesh, fixed, before);
    const size_t nodes = (size_t)mesh->num_nodes, known = same ? (size_t)before->mesh->num_nodes : 0;
    system->free_of_node = same ? pliant_next_version(before->free_of_node, known, nodes, sizeof *system->free_of_node)
                                : pliant_calloc(nodes, sizeof *system->free_of_node);
    system->node_of_free = same ? pliant_next_version(before->node_of_free, known, nodes, sizeof *system->node_of_free)
                                : pliant_calloc(nodes, sizeof *system->node_of_free);
    if (!system->free_of_node || !system->node_of_free) return pliant_fail_memory("the unknowns");
    system->num_free = same ? before->num_free : 0;
    for (int32_t n = (int32_t)known; n < mesh->num_nodes; n++) {
        system->free_of_node[n] = fixed[n] ? -1 : system->num_free;
        if (!fixed[n]) system->node_of_free[system->num_free++] = n;
    }
    if (same) {
        pliant_mark_written(system->free_of_node, known, nodes - known, sizeof *system->free_of_node);
        pliant_mark_written(system->node_of_free, (size_t)before->num_free,
                            (size_t)(system->num_free - before->num_free), sizeof *system->node_of_free);
    }
    if (system->num_free == 0) return pliant_fail(PLIANT_ERROR_SCENE, "every node is fixed: nothing can move");
    return PLIANT_OK;
}

static pliant_status list_corners(pliant_system *system)
{
    const pliant_mesh *mesh = system->mesh;
    const size_t nodes = (size_t)system->num_free;
    system->corner_start = pliant_calloc(nodes + 2, sizeof *system->corner_start);
    system->corner_end = pliant_calloc(nodes, sizeof *system->corner_end);
    system->corner = pliant_calloc((size_t)mesh->num_tets, 4 * sizeof *system->corner);
    if (!system->corner_start || !system->corner_end || !system->corner) return pliant_fail_memory("the unknowns");
    int32_t *start = system->corner_start;
    for (int32_t v = 0; v < 4 * mesh->num_tets; v++) {
        int32_t n = system->free_of_node[mesh->tets[v]];
        if (n >= 0) start[n + 2]++;
    }
    for (int32_t n = 0; n < system->num_free; n++) start[n + 2] += start[n + 1];
    for (int32_t v = 0; v < 4 * mesh->num_tets; v++) {
        int32_t n = system->free_of_node[mesh->tets[v]];
        if (n >= 0) system->corner[start[n + 1]++] = v;
    }
    memcpy(system->corner_end, start + 1, nodes * sizeof *start);
    system->num_corners = start[nodes];
    return PLIANT_OK;
}

/* ---- After a cut: corners of kept tetrahedra stay in the lists. */

typedef struct place {
    int32_t unknown, corner;
} place;

static int by_unknown(const void *a, const void *b)
{
    const place *i = a, *j = b;
    if (i->unknown != j->unknown) return i->unknown < j->unknown ? -1 : 1;
    return i->corner < j->corner ? -1 : i->corner > j->corner;
}

bool pliant_has_same_numbers(const pliant_system *system, const pliant_system *before)
{
    const size_t bytes = (size_t)before->mesh->num_nodes * sizeof *before->free_of_node;
    if (system->num_free < before->num_free || system->mesh->num_nodes < before->mesh->num_nodes) return false;
    for (size_t from = 0, to = 0;
         pliant_next_difference(system->free_of_node, before->free_of_node, bytes, &from, &to);)
        if (memcmp((const char *)system->free_of_node + from, (const char *)before->free_of_node + from, to - from) !=
            0)
            return false;
    return true;
}

/* A changed list: a corner of its node is not kept, or was not kept. */
typedef struct relist {
    int32_t unknown, length;
    int32_t begin, end;      /* range of its listed changes */
} relist;

static int32_t count_not_kept(const uint8_t *kept, int32_t tets)
{
    int32_t count = 0;
    for (int32_t t = pliant_next_changed(kept, tets, 0); t < tets; t = pliant_next_changed(kept, tets, t + 1))
        count++;
    return count;
}

/* List the corners of elements that are not kept, in order: present ones with their number, earlier ones with -1. */
static int32_t list_places(const pliant_system *system, const pliant_system *before, const uint8_t *kept, place *out)
{
    const pliant_mesh *mesh = system->mesh;
    int32_t count = 0;
    for (int32_t t = pliant_next_changed(kept, mesh->num_tets, 0); t < mesh->num_tets;
         t = pliant_next_changed(kept, mesh->num_tets, t + 1))
        for (int32_t v = 4 * t; v < 4 * t + 4; v++) {
            const int32_t now = system->free_of_node[mesh->tets[v]],
                          was = t < before->mesh->num_tets ? before->free_of_node[before->mesh->tets[v]] : -1;
            if (was >= 0) out[count++] = (place){was, -1};
            if (now >= 0) out[count++] = (place){now, v};
        }
    qsort(out, (size_t)count, sizeof *out, by_unknown);
    return count;
}

/* Return the list's range in the earlier system; it is empty for a new unknown. */
static int32_t list_begin(const pliant_system *before, int32_t unknown)
{
    return unknown < before->num_free ? before->corner_start[unknown] : 0;
}
static int32_t list_end(const pliant_system *before, int32_t unknown)
{
    return unknown < before->num_free ? before->corner_end[unknown] : 0;
}

/* Collect the changes by node, and return the number of lists. more: out: corners of lists that do not fit in their
 * earlier range. */
static int32_t list_relists(const pliant_system *before, const uint8_t *kept, const place *now, int32_t count,
                            relist *out, int32_t *more)
{
    int32_t lists = 0;
    *more = 0;
    for (int32_t end = 0; end < count; lists++) {
        relist *one = out + lists;
        *one = (relist){.unknown = now[end].unknown};
        while (end < count && now[end].unknown == one->unknown && now[end].corner < 0) end++;
        one->begin = end;
        while (end < count && now[end].unknown == one->unknown) end++;
        one->end = end;
        one->length = end - one->begin;
        const int32_t first = list_begin(before, one->unknown), last = list_end(before, one->unknown);
        for (int32_t c = first; c < last; c++) one->length += kept[before->corner[c] / 4];
        if (one->length > last - first) *more += one->length;
    }
    return lists;
}

/* Merge a list in order at its new position. */
static void merge(const pliant_system *before, const uint8_t *kept, const relist *one, const place *now,
                  int32_t *corner)
{
    int32_t n = one->begin;
    for (int32_t c = list_begin(before, one->unknown); c < list_end(before, one->unknown); c++) {
        if (!kept[before->corner[c] / 4]) continue;
        while (n < one->end && now[n].corner < before->corner[c]) *corner++ = now[n++].corner;
        *corner++ = before->corner[c];
    }
    while (n < one->end) *corner++ = now[n++].corner;
}

static void fill_lists(pliant_system *system, const pliant_system *before, const uint8_t *kept, const place *now,
                       const relist *list, int32_t count)
{
    int32_t at = before->num_corners;
    for (int32_t i = 0; i < count; i++) {
        const size_t n = (size_t)list[i].unknown;
        const bool fits = list[i].length <= list_end(before, list[i].unknown) - list_begin(before, list[i].unknown);
        const int32_t first = fits && list[i].length > 0 ? before->corner_start[n] : at;
        if (first == at) at += list[i].length;
        system->corner_start[n] = first;
        system->corner_end[n] = first + list[i].length;
        merge(before, kept, list + i, now, system->corner + first);
        pliant_mark_written(system->corner, (size_t)first, (size_t)list[i].length, sizeof *system->corner);
        pliant_mark_written(system->corner_start, n, 1, sizeof *system->corner_start);
        pliant_mark_written(system->corner_end, n, 1, sizeof *system->corner_end);
    }
}

/* Update the lists after a cut. A list keeps its position unless it gets longer. done: out: false if the gaps would be
 * larger than the lists. */
static pliant_status list_corners_next(pliant_system *system, const pliant_system *before, const uint8_t *kept,
                                       bool *done)
{
    const size_t rebuilt = 8 * (size_t)count_not_kept(kept, system->mesh->num_tets) + 1;
    place *now = pliant_calloc(rebuilt, sizeof *now);
    relist *list = pliant_calloc(rebuilt, sizeof *list);
    pliant_status status = now && list ? PLIANT_OK : pliant_fail_memory("the unknowns");
    if (status == PLIANT_OK) {
        int32_t more;
        const int32_t count = list_relists(before, kept, now, list_places(system, before, kept, now), list, &more);
        const size_t was = (size_t)before->num_free, is = (size_t)system->num_free,
                     corners = (size_t)before->num_corners;
        *done = corners + (size_t)more <= 8 * (size_t)system->mesh->num_tets;
        if (*done) {
            system->num_corners = before->num_corners + more;
            system->corner_start = pliant_next_version(before->corner_start, was, is, sizeof *system->corner_start);
            system->corner_end = pliant_next_version(before->corner_end, was, is, sizeof *system->corner_end);
            system->corner =
                pliant_next_version(before->corner, corners, (size_t)system->num_corners, sizeof *system->corner);
            if (system->corner_start && system->corner_end && system->corner)
                fill_lists(system, before, kept, now, list, count);
            else status = pliant_fail_memory("the unknowns");
        }
    }
    pliant_free(now);
    pliant_free(list);
    return status;
}

pliant_status pliant_system_number_next(pliant_system *system, const uint8_t *fixed, const pliant_system *before,
                                        const uint8_t *kept)
{
    pliant_status status = number_free(system, fixed, before);
    if (status == PLIANT_OK && system->macros) return pliant_macro_number(system);
    if (status != PLIANT_OK) return status;
    bool done = false;
    if (kept && !before->macros && system->mesh->num_tets >= before->mesh->num_tets &&
        pliant_has_same_numbers(system, before))
        status = list_corners_next(system, before, kept, &done);
    return status == PLIANT_OK && !done ? list_corners(system) : status;
}

pliant_status pliant_system_number_unknowns(pliant_system *system, const uint8_t *fixed)
{
    return pliant_system_number_next(system, fixed, NULL, NULL);
}

/* ---- The diagonal. */

static double trace_of_block(const pliant_system *system, int32_t block)
{
    const pliant_mesh *mesh = system->mesh;
    double sum = 0;
    for (int32_t lane = 0; lane < LANES && block * LANES + lane < mesh->num_tets; lane++) {
        const int32_t tet = block * LANES + lane;
        double squares = 0, stiff = 0;
        for (int v = 0; v < 4; v++) {
            if (system->free_of_node[mesh->tets[4 * (size_t)tet + v]] < 0) continue;
            for (int d = 0; d < 3; d++) {
                const double g = system->stiffness ? 0 : system->gradients[block][3 * v + d][lane];
                squares += g * g;
                if (system->stiffness) stiff += system->stiffness[144 * (size_t)tet + 13 * (size_t)(3 * v + d)];
            }
        }
        sum += system->stiffness ? stiff : squares * (system->lame[block][0][lane] + 4 * system->lame[block][1][lane]);
    }
    return sum;
}

/* Copy traces (num_blocks) from the earlier system, except for blocks with changed elements, and for the incomplete
 * last blocks. */
static bool follow_traces(pliant_system *system, const pliant_system *before, const uint8_t *kept)
{
    const int32_t tets = system->mesh->num_tets, were = before->mesh->num_tets,
                  same = (tets < were ? tets : were) / LANES;
    if (!(system->trace =
              pliant_next_version(before->trace, (size_t)same, (size_t)system->num_blocks, sizeof *system->trace)))
        return false;
    for (int32_t t = pliant_next_changed(kept, tets, 0); t < LANES * same;) {
        const int32_t block = t / LANES;
        system->trace[block] = trace_of_block(system, block);
        pliant_mark_written(system->trace, (size_t)block, 1, sizeof *system->trace);
        t = pliant_next_changed(kept, tets, LANES * (block + 1));
    }
    for (int32_t block = same; block < system->num_blocks; block++)
        system->trace[block] = trace_of_block(system, block);
    return true;
}

static bool find_traces(pliant_system *system)
{
    if (!(system->trace = pliant_malloc((size_t)system->num_blocks, sizeof *system->trace))) return false;
    for (int32_t block = 0; block < system->num_blocks; block++) system->trace[block] = trace_of_block(system, block);
    return true;
}

pliant_status pliant_system_find_mean_diagonal(pliant_system *system, const pliant_system *before, const uint8_t *kept)
{
    double sum = 0;
    if (system->macros) {
        system->mean_diagonal = pliant_macro_mean_diagonal(system);
        return PLIANT_OK;
    }
    if (!(kept && before->trace && !system->stiffness ? follow_traces(system, before, kept) : find_traces(system)))
        return pliant_fail_memory("the elements");
    for (int32_t block = 0; block < system->num_blocks; block++) sum += system->trace[block];
    system->mean_diagonal = sum / (3.0 * system->num_free);
    return PLIANT_OK;
}
