/* Which nodes move, which element forces they gather, and what elements add to the matrix's diagonal. */
#include "base/fail.h"
#include "base/room.h"
#include "fem/system.h"
#include "pliant/memory.h"

#include <stdlib.h>
#include <string.h>

static pliant_status number_free(pliant_system *system, const uint8_t *fixed)
{
    const pliant_mesh *mesh = system->mesh;
    system->free_of_node = pliant_calloc((size_t)mesh->num_nodes, sizeof *system->free_of_node);
    system->node_of_free = pliant_calloc((size_t)mesh->num_nodes, sizeof *system->node_of_free);
    if (!system->free_of_node || !system->node_of_free) return pliant_fail_memory("the unknowns");
    for (int32_t n = 0; n < mesh->num_nodes; n++) {
        system->free_of_node[n] = fixed[n] ? -1 : system->num_free;
        if (!fixed[n]) system->node_of_free[system->num_free++] = n;
    }
    if (system->num_free == 0) return pliant_fail(PLIANT_ERROR_SCENE, "every node is fixed: nothing can move");
    return PLIANT_OK;
}

static pliant_status list_corners(pliant_system *system)
{
    const pliant_mesh *mesh = system->mesh;
    system->corner_start = pliant_calloc((size_t)system->num_free + 2, sizeof *system->corner_start);
    system->corner = pliant_calloc((size_t)mesh->num_tets, 4 * sizeof *system->corner);
    if (!system->corner_start || !system->corner) return pliant_fail_memory("the unknowns");
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
    return PLIANT_OK;
}

/* ---- of the next body: corners of tetrahedra that are kept stay in the lists */

typedef struct place {
    int32_t unknown, corner;
} place;

static int by_unknown(const void *a, const void *b)
{
    const place *i = a, *j = b;
    if (i->unknown != j->unknown) return i->unknown < j->unknown ? -1 : 1;
    return i->corner < j->corner ? -1 : i->corner > j->corner;
}

/* unknowns of before have the same numbers */
static bool numbered_alike(const pliant_system *system, const pliant_system *before)
{
    return system->num_free >= before->num_free && system->mesh->num_nodes >= before->mesh->num_nodes && system->mesh->num_tets >= before->mesh->num_tets &&
           memcmp(system->free_of_node, before->free_of_node, (size_t)before->mesh->num_nodes * sizeof *before->free_of_node) == 0;
}

/* Corners of what is not kept, in order; other: (unknowns) has such a corner, or had */
static int32_t list_places(const pliant_system *system, const pliant_system *before, const uint8_t *kept, place *out, uint8_t *other)
{
    const pliant_mesh *mesh = system->mesh;
    int32_t count = 0;
    for (int32_t t = pliant_next_not_kept(kept, mesh->num_tets, 0); t < mesh->num_tets; t = pliant_next_not_kept(kept, mesh->num_tets, t + 1))
        for (int32_t v = 4 * t; v < 4 * t + 4; v++) {
            const int32_t now = system->free_of_node[mesh->tets[v]], was = t < before->mesh->num_tets ? before->free_of_node[before->mesh->tets[v]] : -1;
            if (was >= 0) other[was] = 1;
            if (now < 0) continue;
            other[now] = 1;
            out[count++] = (place){now, v};
        }
    qsort(out, (size_t)count, sizeof *out, by_unknown);
    return count;
}

static int32_t count_not_kept(const uint8_t *kept, int32_t tets)
{
    int32_t count = 0;
    for (int32_t t = pliant_next_not_kept(kept, tets, 0); t < tets; t = pliant_next_not_kept(kept, tets, t + 1)) count++;
    return count;
}

/* of one unknown: what it keeps, and what is listed; in order. Returns where the next one's begin */
static int32_t merge(const pliant_system *before, const uint8_t *kept, int32_t unknown, const place *now, int32_t listed, int32_t at, int32_t *corner)
{
    int32_t n = 0;
    const bool known = unknown < before->num_free;
    for (int32_t c = known ? before->corner_start[unknown] : 0; known && c < before->corner_start[unknown + 1]; c++) {
        if (!kept[before->corner[c] / 4]) continue;
        while (n < listed && now[n].corner < before->corner[c]) corner[at++] = now[n++].corner;
        corner[at++] = before->corner[c];
    }
    while (n < listed) corner[at++] = now[n++].corner;
    return at;
}

static void fill_lists(pliant_system *system, const pliant_system *before, const uint8_t *kept, const place *now, int32_t count, const uint8_t *other)
{
    int32_t *start = system->corner_start, at = 0, listed = 0;
    for (int32_t n = 0; n < system->num_free;) {
        if (n < before->num_free && !other[n]) {
            const uint8_t *end = memchr(other + n, 1, (size_t)(before->num_free - n));
            const int32_t last = end ? (int32_t)(end - other) : before->num_free, from = before->corner_start[n], to = before->corner_start[last];
            memcpy(system->corner + at, before->corner + from, (size_t)(to - from) * sizeof *system->corner);
            for (; n < last; n++) start[n] = before->corner_start[n] - from + at;
            at += to - from;
            continue;
        }
        int32_t end = listed;
        while (end < count && now[end].unknown == n) end++;
        start[n] = at;
        at = merge(before, kept, n++, now + listed, end - listed, at, system->corner);
        listed = end;
    }
    start[system->num_free] = start[system->num_free + 1] = at;
    memset(system->corner + at, 0, (4 * (size_t)system->mesh->num_tets - (size_t)at) * sizeof *system->corner);
}

static pliant_status list_corners_next(pliant_system *system, const pliant_system *before, const uint8_t *kept)
{
    const size_t tets = (size_t)system->mesh->num_tets, anew = 4 * (size_t)count_not_kept(kept, system->mesh->num_tets);
    place *now = pliant_calloc(anew + 1, sizeof *now);
    uint8_t *other = pliant_calloc((size_t)system->num_free, 1);
    system->corner_start = pliant_room((size_t)system->num_free + 2, sizeof *system->corner_start);
    system->corner = pliant_room(tets, 4 * sizeof *system->corner);
    const bool good = now && other && system->corner_start && system->corner;
    if (good) fill_lists(system, before, kept, now, list_places(system, before, kept, now, other), other);
    pliant_free(now);
    pliant_free(other);
    return good ? PLIANT_OK : pliant_fail_memory("the unknowns");
}

pliant_status pliant_system_number_next(pliant_system *system, const uint8_t *fixed, const pliant_system *before, const uint8_t *kept)
{
    pliant_status status = number_free(system, fixed);
    if (status == PLIANT_OK && system->macros) return pliant_macro_number(system);
    if (status != PLIANT_OK) return status;
    return kept && !before->macros && numbered_alike(system, before) ? list_corners_next(system, before, kept) : list_corners(system);
}

pliant_status pliant_system_number(pliant_system *system, const uint8_t *fixed) { return pliant_system_number_next(system, fixed, NULL, NULL); }

/* ---- the diagonal */

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

pliant_status pliant_system_find_mean_diagonal(pliant_system *system, const pliant_system *before, const uint8_t *kept)
{
    double sum = 0;
    if (system->macros) {
        system->mean_diagonal = pliant_macro_mean_diagonal(system);
        return PLIANT_OK;
    }
    const int32_t tets = system->mesh->num_tets, same = kept && before->trace && !system->stiffness ? before->mesh->num_tets / LANES : 0;
    if (!(system->trace = pliant_room((size_t)system->num_blocks, sizeof *system->trace))) return pliant_fail_memory("the elements");
    for (int32_t block = 0; block < system->num_blocks; block++) {
        const bool keeps = block < same && pliant_next_not_kept(kept, tets < LANES * (block + 1) ? tets : LANES * (block + 1), LANES * block) == LANES * (block + 1);
        system->trace[block] = keeps ? before->trace[block] : trace_of_block(system, block);
        sum += system->trace[block];
    }
    system->mean_diagonal = sum / (3.0 * system->num_free);
    return PLIANT_OK;
}
