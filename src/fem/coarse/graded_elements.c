/* Elements of a graded system (graded.c): the remaining coarse elements, then fine hexahedra, then fine tetrahedra.
 * Unchanged elements are copied from the system before the cut. */
#include "base/fail.h"
#include "base/buffer.h"
#include "fem/coarse/graded.h"
#include "fem/element/hexahedra.h"
#include "base/memory.h"

#include <string.h>

enum { CORNERS = GRADED_CORNERS };

/* Fine elements of the earlier system, and data shared by hexahedra. */
typedef struct fine_elements {
    grading *work;
    /* (fine tetrahedra in refined cubes) 1 + earlier element that contained the tetrahedron as its first one; 0:
     * none. */
    int32_t *was;
    pliant_cube_shape *shape;  /* (2) by parity */
    bool known[2];
    /* (fine tetrahedra in refined cubes) nonzero: the tetrahedron is in a hexahedron. */
    uint8_t *done;
} fine_elements;

static pliant_status no_memory(void) { return pliant_fail_memory("the elements near a cut"); }

/* Copy elements [from, to) of another system to elements e and following. The first function copies gradients, the
 * second all other data; start[e] must be set. Roots are shared. */
static void copy_gradients(const pliant_macros *was, int32_t from, int32_t to, pliant_macros *macros, int32_t e)
{
    memcpy(macros->gradient + 24 * (size_t)e, was->gradient + 24 * (size_t)from,
           24 * (size_t)(to - from) * sizeof *was->gradient);
}

static void copy_others(const pliant_macros *was, int32_t from, int32_t to, pliant_macros *macros, int32_t e)
{
    const size_t at = (size_t)e, first = (size_t)from, count = (size_t)(to - from),
                 corners = (size_t)(was->start[to] - was->start[from]);
    const int32_t begin = macros->start[e], shift = begin - was->start[from];
    memcpy(macros->own + CORNERS * at, was->own + CORNERS * first, CORNERS * count * sizeof *was->own);
    memcpy(macros->node + begin, was->node + was->start[from], corners * sizeof *was->node);
    memcpy(macros->held + begin, was->held + was->start[from], corners);
    memcpy(macros->cell + at, was->cell + first, count * sizeof *was->cell);
    memcpy(macros->grounded + at, was->grounded + first, count);
    memcpy(macros->shear + at, was->shear + first, count * sizeof *was->shear);
    memcpy(macros->rank + at, was->rank + first, count * sizeof *was->rank);
    memcpy(macros->root + at, was->root + first, count * sizeof *was->root);
    for (size_t i = 0; i < count; i++) macros->start[at + i + 1] = was->start[first + i + 1] + shift;
}

/* ---- Elements of the coarse mesh. */

/* Find the next range [*from, *to) of coarse elements whose cubes are not refined. In: *to is the end of the last
 * range. Return false at the end. */
static bool next_base(const grading *work, int32_t *from, int32_t *to)
{
    const int32_t count = work->elements->count, *cell = work->elements->cell;
    const uint8_t *refined = work->graded->refined;
    for (*from = *to; *from < count && refined[cell[*from]];) ++*from;
    for (*to = *from; *to < count && !refined[cell[*to]];) ++*to;
    return *from < count;
}

static int32_t add_base_gradients(const grading *work)
{
    int32_t e = 0;
    for (int32_t from = 0, to = 0; next_base(work, &from, &to); e += to - from)
        copy_gradients(work->elements, from, to, work->system->macros, e);
    return e;
}

static void add_base_others(const grading *work)
{
    int32_t e = 0;
    memset(work->now, 0xff, (size_t)work->elements->count * sizeof *work->now);
    for (int32_t from = 0, to = 0; next_base(work, &from, &to); e += to - from) {
        copy_others(work->elements, from, to, work->system->macros, e);
        memcpy(work->system->trace + e, work->graded->base->trace + from,
               (size_t)(to - from) * sizeof *work->system->trace);
        for (int32_t i = from; i < to; i++) work->now[i] = e + i - from;
    }
}

/* Copy the coarse elements with at most two threads, since both halves copy a similar amount. Roots are borrowed. */
static void add_base(grading *work)
{
    pliant_macros *macros = work->system->macros;
    const int threads = work->system->num_threads < 2 ? work->system->num_threads : 2;
    int32_t count = 0;
#pragma omp parallel sections num_threads(threads)
    {
#pragma omp section
        count = add_base_gradients(work);
#pragma omp section
        {
            add_base_others(work);
            pliant_graded_followers(work);
        }
    }
    work->graded->num_base = macros->num_lent = macros->count = count;
}

/* ---- Elements of the fine mesh. */

static bool is_held(const grading *work, int32_t node)
{
    const int32_t coarse_nodes = work->graded->coarse_nodes;
    return node < coarse_nodes ? work->base->free_of_node[node] < 0
                               : work->body->fine_fixed[node - coarse_nodes] != PLIANT_MOVES;
}

/* Reduce the followed nodes to at most eight by dropping nodes that are fixed at rest. There can be more than eight
 * next to fixed nodes inside a coarse element, and next to nodes moved onto bone. Such an element keeps R = I like the
 * coarse element, so nodes fixed at rest contribute no force. Return the remaining number. */
static int drop_fixed(const grading *work, int n, int count, int32_t *list, double c[][CORNERS * CORNERS])
{
    int kept = 0;
    for (int m = 0; m < count; m++) {
        const int32_t fine = list[m] - work->graded->coarse_nodes;
        if (fine >= 0 && work->body->fine_fixed[fine] == PLIANT_FIXED_AT_REST) continue;
        list[kept] = list[m];
        for (int v = 0; v < n; v++) c[v][kept] = c[v][m];
        kept++;
    }
    return kept;
}

/* Replace the corners of an element by the nodes that they follow. Gradient and root are still in terms of the
 * corners. */
static pliant_status add_corners(const grading *work, const int32_t *node, int n, int32_t e)
{
    pliant_macros *macros = work->system->macros;
    double c[CORNERS][CORNERS * CORNERS] = {{0}}, gradient[3 * CORNERS] = {0};
    int32_t list[CORNERS * CORNERS];
    int count = 0;
    for (int v = 0; v < n; v++) {
        followed of;
        pliant_graded_follow(work, node[v], &of);
        for (int i = 0; i < of.count; i++) {
            int at = 0;
            while (at < count && list[at] != of.node[i]) at++;
            if (at == count) list[count++] = of.node[i];
            c[v][at] += of.weight[i];
        }
    }
    macros->grounded[e] = count > CORNERS;
    if (count > CORNERS) count = drop_fixed(work, n, count, list, c);
    const int32_t rank = macros->rank[e], begin = macros->start[e];
    float *root = rank > 0 ? pliant_calloc((size_t)rank * 3 * (size_t)count, sizeof *root) : NULL;
    if (rank > 0 && !root) return no_memory();
    for (int32_t r = 0; r < rank; r++)
        for (int v = 0; v < n; v++)
            for (int m = 0; m < count; m++)
                for (int d = 0; d < 3; d++)
                    root[3 * count * r + 3 * m + d] += (float)(c[v][m] * macros->root[e][3 * n * r + 3 * v + d]);
    pliant_free(macros->root[e]);
    macros->root[e] = root;
    for (int m = 0; m < count && m < CORNERS; m++)
        for (int v = 0; v < n; v++)
            for (int d = 0; d < 3; d++)
                gradient[3 * m + d] += c[v][m] * macros->gradient[24 * (size_t)e + (size_t)(3 * v + d)];
    memcpy(macros->gradient + 24 * (size_t)e, gradient, sizeof gradient);
    for (int m = 0; m < CORNERS; m++) macros->own[CORNERS * (size_t)e + (size_t)m] = m < count ? list[m] : -1;
    memcpy(macros->node + begin, list, (size_t)count * sizeof *list);
    memset(macros->held + begin, macros->grounded[e], (size_t)count);
    macros->start[e + 1] = begin + count;
    work->system->trace[e] = -1;
    return PLIANT_OK;
}

/* Return whether all nodes are fixed. Such an element is left out. */
static bool is_fixed(const grading *work, const int32_t *node, int n)
{
    for (int v = 0; v < n; v++)
        if (!work->body->fine_fixed[node[v]]) return false;
    return true;
}

/* Return 1 + the earlier element with the same unchanged nodes and of the same kind, or 0. */
static int32_t find_same(const fine_elements *fine, int32_t first, const int32_t *node, int n, bool cube)
{
    const grading *work = fine->work;
    const int32_t was = work->before ? fine->was[first] : 0;
    if (was == 0 || (work->before->graded->tet[was - 1 - work->before->graded->num_base] < 0) != cube) return 0;
    for (int v = 0; v < n; v++)
        if (!work->alike[node[v]]) return 0;
    return was;
}

static const pliant_cube_shape *shape_of(fine_elements *fine, const pliant_cube *cube)
{
    const pliant_mesh *mesh = fine->work->fine;
    const int parity = pliant_cell_parity(mesh, mesh->lattice_of_tet[cube->tet[0]] / 5);
    if (!fine->known[parity] || mesh->num_moved > 0) pliant_cube_integrate(mesh, cube, parity, fine->shape + parity);
    fine->known[parity] = true;
    return fine->shape + parity;
}

/* Append an element and return its index. of: its entry in pliant_graded.tet. */
static int32_t begin_element(grading *work, int32_t tet, int32_t of)
{
    const int32_t e = work->system->macros->count++;
    work->system->macros->cell[e] = graded_cell_of(work, tet);
    work->graded->tet[e - work->graded->num_base] = of;
    return e;
}

/* Share elements [from, to) of the earlier system. */
static void share_before(grading *work, int32_t from, int32_t to)
{
    const pliant_system *before = work->before;
    pliant_macros *macros = work->system->macros;
    const int32_t e = macros->count;
    copy_gradients(before->macros, from, to, macros, e);
    copy_others(before->macros, from, to, macros, e);
    macros->count += to - from;
    memcpy(work->system->trace + e, before->trace + from, (size_t)(to - from) * sizeof *before->trace);
    memcpy(work->graded->tet + e - work->graded->num_base, before->graded->tet + from - before->graded->num_base,
           (size_t)(to - from) * sizeof *work->graded->tet);
    for (int32_t i = from; i < to; i++) pliant_retain_block(before->macros->root[i]);
}

/* Collect consecutive earlier elements, and copy a completed range at once. from, to: the range so far; was: 1 + the
 * next element, or 0. */
static void take_run(grading *work, int32_t was, int32_t *from, int32_t *to)
{
    if (was > 0 && was - 1 == *to) {
        ++*to;
        return;
    }
    if (*to > *from) share_before(work, *from, *to);
    *from = was > 0 ? was - 1 : 0;
    *to = was;
}

static bool stays_whole(const grading *work, const pliant_cube *cube)
{
    if (!work->before || cube->part) return false; /* another fragment may have been at a part's tip */
    for (int slot = 0; slot < 5; slot++)
        if (!work->kept->fine[cube->tet[slot]]) return false;
    return true;
}

static pliant_status add_cube(fine_elements *fine, const pliant_cube *cube)
{
    grading *work = fine->work;
    pliant_macros *macros = work->system->macros;
    if (is_fixed(work, cube->node, CORNERS)) return PLIANT_OK;
    const int32_t e = begin_element(work, cube->tet[0], -1 - cube->tet[0]);
    pliant_status status =
        pliant_macros_add_hexahedron(work->body->fine_material, NULL, cube, shape_of(fine, cube), macros, e);
    return status == PLIANT_OK ? add_corners(work, cube->node, CORNERS, e) : status;
}

static pliant_status add_cubes(fine_elements *fine, const pliant_cube *cubes, int32_t count)
{
    pliant_status status = PLIANT_OK;
    int32_t from = 0, to = 0;
    for (int32_t i = 0; status == PLIANT_OK && i < count; i++) {
        const pliant_cube *cube = cubes + i;
        const int32_t was =
            stays_whole(fine->work, cube) ? find_same(fine, cube->tet[0], cube->node, CORNERS, true) : 0;
        for (int slot = 0; slot < 5; slot++) fine->done[cube->tet[slot]] = 1;
        take_run(fine->work, was, &from, &to);
        if (was == 0) status = add_cube(fine, cube);
    }
    if (status == PLIANT_OK) take_run(fine->work, 0, &from, &to);
    return status;
}

static pliant_status add_tet(fine_elements *fine, int32_t tet)
{
    grading *work = fine->work;
    pliant_macros *macros = work->system->macros;
    const int32_t *node = work->fine->tets + 4 * (size_t)tet;
    if (is_fixed(work, node, 4)) return PLIANT_OK;
    const int32_t e = begin_element(work, tet, tet);
    pliant_status status = pliant_macros_add_tet(work->fine, work->body->fine_material, tet, macros, e);
    return status == PLIANT_OK ? add_corners(work, node, 4, e) : status;
}

/* Add the tetrahedra that are in no hexahedron. */
static pliant_status add_tets(fine_elements *fine)
{
    const grading *work = fine->work;
    pliant_status status = PLIANT_OK;
    int32_t from = 0, to = 0;
    for (int32_t i = 0; status == PLIANT_OK && i < work->num_tets; i++) {
        const int32_t tet = work->tet[i];
        if (fine->done[tet]) continue;
        const int32_t was = work->before && work->kept->fine[tet]
                                ? find_same(fine, tet, work->fine->tets + 4 * (size_t)tet, 4, false)
                                : 0;
        take_run(fine->work, was, &from, &to);
        if (was == 0) status = add_tet(fine, tet);
    }
    if (status == PLIANT_OK) take_run(fine->work, 0, &from, &to);
    return status;
}

/* Fill was and done, for tetrahedra in refined cubes alone. */
static void list_before(fine_elements *fine)
{
    const grading *work = fine->work;
    const pliant_graded *was = work->before ? work->before->graded : NULL;
    const int32_t tets = work->fine->num_tets;
    for (int32_t i = 0; i < work->num_tets; i++) fine->was[work->tet[i]] = fine->done[work->tet[i]] = 0;
    for (int32_t i = 0; was && i < was->num_fine; i++) {
        const int32_t tet = was->tet[i] < 0 ? -1 - was->tet[i] : was->tet[i];
        if (tet < tets) fine->was[tet] = was->num_base + i + 1;
    }
}

static pliant_status add_fine(grading *work)
{
    const size_t tets = (size_t)work->fine->num_tets;
    pliant_cube *cubes = NULL;
    int32_t num_cubes = 0;
    fine_elements fine = {.work = work,
                          .was = pliant_malloc(tets, sizeof *fine.was),
                          .done = pliant_malloc(tets, 1),
                          .shape = pliant_calloc(2, sizeof *fine.shape)};
    pliant_status status = fine.was && fine.done && fine.shape ? PLIANT_OK : no_memory();
    if (status == PLIANT_OK) list_before(&fine);
    if (status == PLIANT_OK && work->hexahedra)
        status = pliant_cubes_find_among(work->fine, work->tet, work->num_tets, &cubes, &num_cubes);
    if (status == PLIANT_OK) status = add_cubes(&fine, cubes, num_cubes);
    if (status == PLIANT_OK) status = add_tets(&fine);
    work->graded->num_fine = work->system->macros->count - work->graded->num_base;
    PLIANT_FREE(fine.was, fine.done, fine.shape, cubes);
    return status;
}

/* Add an element without stiffness for every free fine node, if fine nodes follow the shape functions of elements. */
static void add_points(grading *work)
{
    pliant_macros *macros = work->system->macros;
    memset(work->point, 0xff, (size_t)work->fine->num_nodes * sizeof *work->point);
    for (int32_t i = 0; i < 4 * work->num_tets; i++) {
        const int32_t tet = work->tet[i / 4], fine = work->fine->tets[4 * (size_t)tet + (size_t)(i % 4)];
        const int32_t node = work->graded->coarse_nodes + fine, e = macros->count, begin = macros->start[e];
        if (!work->free[node] || work->point[fine] >= 0) continue;
        work->point[fine] = e;
        macros->node[begin] = node;
        macros->held[begin] = macros->grounded[e] = 1;
        for (int m = 0; m < CORNERS; m++) macros->own[CORNERS * (size_t)e + (size_t)m] = m == 0 ? node : -1;
        memset(macros->gradient + 24 * (size_t)e, 0, 24 * sizeof *macros->gradient);
        work->system->trace[e] = macros->shear[e] = 0;
        macros->rank[e] = 0;
        macros->root[e] = NULL;
        macros->cell[e] = graded_cell_of(work, tet);
        macros->start[e + 1] = begin + 1;
        macros->count++;
    }
}

static void find_used(grading *work)
{
    const pliant_macros *macros = work->system->macros;
    const int32_t coarse = work->graded->coarse_nodes, base = macros->start[work->graded->num_base];
    uint8_t *used = work->graded->used;
    for (int32_t c = 0; c < base; c++) used[macros->node[c]] = 1;
    for (int32_t c = base; c < macros->start[macros->count]; c++) {
        const int32_t node = macros->node[c];
        if (node < coarse) used[node] = 1;
        else work->free[node] = !is_held(work, node);
    }
    for (int32_t n = 0; n < coarse; n++) work->free[n] = used[n] && !is_held(work, n);
}

pliant_status pliant_graded_elements(grading *work)
{
    pliant_system *system = work->system;
    const size_t maximum = (size_t)work->elements->count, tets = (size_t)work->num_tets,
                 points = work->point ? 4 * tets : 0;
    const size_t count = maximum + tets + points,
                 corners = (size_t)work->elements->start[maximum] + 4 * CORNERS * tets + points;
    if (!(system->macros = pliant_calloc(1, sizeof *system->macros))) return no_memory();
    pliant_status status = pliant_macros_reserve_entries(system->macros, count, corners);
    if (status != PLIANT_OK) return status;
    system->trace = pliant_malloc(count, sizeof *system->trace);
    work->graded->tet = pliant_calloc(tets + 1, sizeof *work->graded->tet);
    if (!system->trace || !work->graded->tet) return no_memory();
    add_base(work);
    if ((status = add_fine(work)) != PLIANT_OK) return status;
    find_used(work);
    if (work->point) add_points(work);
    system->num_blocks =
        pliant_macros_blocks((size_t)system->macros->count, (size_t)system->macros->start[system->macros->count]);
    return PLIANT_OK;
}
