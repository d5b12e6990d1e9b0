/* Label the voxels around every tetrahedron at a cut. */
#include "base/fail.h"
#include "base/buffer.h"
#include "base/threads.h"
#include "topology/links.h"
#include "base/memory.h"
#include "warp/parts_maker.h"

#include <omp.h>

/* minimum number of tetrahedra per thread */
enum { MIN_TETS_PER_THREAD = 8 };

typedef struct parts_work {
    const pliant_body *body;
    const pliant_parts *before;    /* Nullable: no earlier parts to reuse */
    part_hosts *hosts;
    const pliant_body *body_before;
    int32_t *cut_of;               /* (initial tetrahedra) index in the cuts; -1: not cut */
    part_changes changes;
    int32_t num_other, other_capacity, *other; /* see parts.h */
    int32_t num_rebuilt, *rebuilt;             /* initial tetrahedra in `other` with a new box, ascending */
    part_made *made;                           /* (num_rebuilt) */
    int num_makers;
    part_maker *makers;
} parts_work;

/* Return whether an initial tetrahedron is cut, or shares a node with a cut tetrahedron. */
static bool is_near(const parts_work *all, int32_t tet)
{
    const pliant_voxels *voxels = all->body->voxels;
    for (int v = 0; v < 4; v++) {
        const int32_t node = part_load_node(all->makers, all->body->fine.tets[4 * (size_t)tet + v]);
        for (int32_t a = voxels->around_start[node]; a < voxels->around_start[node + 1]; a++)
            if (all->cut_of[voxels->around[a] / 4] >= 0) return true;
    }
    return false;
}

static bool has_voxels(const parts_work *all, int32_t tet)
{
    return all->body->voxels->start[tet] < all->body->voxels->start[tet + 1];
}

static bool add_other(parts_work *all, int32_t tet)
{
    if (!pliant_reserve(&all->other, &all->other_capacity, all->num_other, 1024, sizeof *all->other)) return false;
    all->other[all->num_other++] = tet;
    return true;
}

static bool add_cube(parts_work *all, const int32_t at[3])
{
    const part_hosts *hosts = all->hosts;
    const int32_t cube = part_index_of(hosts->cubes, at);
    bool good = true;
    for (int32_t i = hosts->cube_start[cube]; i < hosts->cube_start[cube + 1] && good; i++) {
        const int32_t tet = hosts->of_cube[i], old = all->before->view.elements[tet].box;
        if (has_voxels(all, tet) &&
            pliant_parts_differ(&all->changes, &hosts->box[tet], old >= 0 && all->before->by_node[old]))
            good = add_other(all, tet);
    }
    return good;
}

/* List the tetrahedra whose boxes may differ from before: those in the lists, and those near a difference. */
static bool list_other(parts_work *all)
{
    const part_changes *changes = &all->changes;
    int32_t at[3], low[3], high[3];
    bool good = true;
    for (int32_t i = 0; i < changes->num_listed && good; i++)
        good = !has_voxels(all, changes->listed[i]) || add_other(all, changes->listed[i]);
    for (int d = 0; d < 3; d++) {
        low[d] = changes->low[d] * PART_REGION / PART_CUBE;
        high[d] = changes->high[d] < 0 ? -1 : changes->high[d] * PART_REGION / PART_CUBE;
    }
    for (at[2] = low[2]; at[2] <= high[2]; at[2]++)
        for (at[1] = low[1]; at[1] <= high[1]; at[1]++)
            for (at[0] = low[0]; at[0] <= high[0] && good; at[0]++)
                good = !pliant_parts_differ_in(changes, at) || add_cube(all, at);
    if (good && all->num_other > 0) all->num_other = sort_once(all->other, all->num_other);
    return good;
}

/* List the cut tetrahedra and all tetrahedra that share an initial node with them. */
static bool list_near(parts_work *all)
{
    const pliant_voxels *voxels = all->body->voxels;
    const pliant_cuts *cuts = all->body->cuts;
    bool good = true;
    for (int32_t i = 0; i < cuts->num_tets; i++)
        for (int v = 0; v < 4; v++) {
            const int32_t node = part_load_node(all->makers, all->body->fine.tets[4 * (size_t)cuts->tet[i] + v]);
            for (int32_t a = voxels->around_start[node]; a < voxels->around_start[node + 1] && good; a++)
                good = !has_voxels(all, voxels->around[a] / 4) || add_other(all, voxels->around[a] / 4);
        }
    if (good && all->num_other > 0) all->num_other = sort_once(all->other, all->num_other);
    return good;
}

/* Find the tetrahedra that do not keep their box (or the absence of a box), and those among them that need a new
 * one. */
static bool plan(parts_work *all)
{
    const bool good = all->before ? list_other(all) : list_near(all);
    if (!good || !(all->rebuilt = pliant_calloc((size_t)all->num_other + 1, sizeof *all->rebuilt))) return false;
    for (int32_t i = 0; i < all->num_other; i++)
        if (is_near(all, all->other[i])) all->rebuilt[all->num_rebuilt++] = all->other[i];
    return true;
}

static pliant_status make_boxes(parts_work *all)
{
    pliant_work work = {.what = "the parts of the deformed volume"};
    const int fair = 1 + all->num_rebuilt / MIN_TETS_PER_THREAD;
#pragma omp parallel num_threads(fair < all->num_makers ? fair : all->num_makers)
    {
        const int maker = omp_get_thread_num();
        pliant_status status = PLIANT_OK;
#pragma omp for schedule(dynamic, 2)
        for (int32_t n = 0; n < all->num_rebuilt; n++) {
            const int32_t tet = all->rebuilt[n];
            all->made[n].maker = -1;
            if (status == PLIANT_OK)
                status = pliant_parts_make_box(all->makers + maker, tet, &all->hosts->box[tet], maker, all->made + n);
        }
        pliant_work_finish_thread(&work, status);
    }
    return pliant_work_result(&work);
}

static void set_element(part_element *elements, int32_t at, int32_t box, int32_t label)
{
    if (elements[at].box == box && elements[at].label == label) return;
    elements[at] = (part_element){box, label};
    pliant_mark_written(elements, (size_t)at, 1, sizeof *elements);
}

/* Set the box and label of each element. Carried tetrahedra follow the tetrahedra.
 * elements: input: previous elements; the rest is undefined */
static void set_elements(const parts_work *all, pliant_parts *parts, part_element *elements)
{
    const int32_t tets = all->body->fine.num_tets, *list;
    const int32_t known = all->before ? all->body_before->fine.num_tets : 0;
    for (int32_t t = known; t < tets; t++) elements[t] = (part_element){-1, 0};
    for (int32_t g = 0; g < parts->num_carried_tets; g++) elements[tets + g] = (part_element){-1, 0};
    for (int32_t i = 0; all->before && i < all->num_other; i++) {
        const int32_t count = pliant_fragments_of(all->body_before->cuts, all->other + i, &list);
        for (int32_t f = 0; f < count; f++)
            if (list[f] < tets) set_element(elements, list[f], -1, 0);
    }
    int32_t carried_tet = 0;
    for (int32_t b = 0; b < parts->num_boxes; b++) {
        const int32_t *carrier = parts->carrier + parts->carrier_start[b],
                      count = pliant_fragments_of(all->body->cuts, parts->host + b, &list);
        for (int32_t f = 0; f < count; f++) set_element(elements, list[f], b, f);
        for (int32_t label = 0; carried_tet < parts->carried_tet_start[b + 1]; label++)
            if (carrier[label] == parts->carried_tets[carried_tet].carrier)
                elements[tets + carried_tet++] = (part_element){b, label};
    }
    parts->view.elements = elements;
    parts->view.num_elements = tets + parts->num_carried_tets;
}

/* Append a box with its carriers and carried tetrahedra. */
static void add_box(pliant_parts *parts, part_box *boxes, const part_box *box, int32_t host, bool by_node,
                    int32_t taken, const int32_t *carrier, int32_t num_carriers, const part_carried_tet *carried_tet,
                    int32_t num_carried_tets)
{
    const int32_t b = parts->num_boxes++;
    boxes[b] = *box;
    parts->host[b] = host;
    parts->by_node[b] = by_node;
    parts->taken[b] = taken;
    memcpy(parts->carrier + parts->carrier_start[b], carrier, (size_t)num_carriers * sizeof *carrier);
    if (num_carried_tets > 0)
        memcpy(parts->carried_tets + parts->carried_tet_start[b], carried_tet,
               (size_t)num_carried_tets * sizeof *carried_tet);
    parts->carrier_start[b + 1] = parts->carrier_start[b] + num_carriers;
    parts->carried_tet_start[b + 1] = parts->carried_tet_start[b] + num_carried_tets;
    parts->num_carried_tets = parts->carried_tet_start[b + 1];
}

static void add_kept(pliant_parts *parts, part_box *boxes, const pliant_parts *from, int32_t old)
{
    part_box box = from->view.boxes[old];
    if (parts->pool != from->pool) {
        memcpy(parts->pool->at + parts->pool->used, from->view.labels + box.first,
               (size_t)part_count(&box) * sizeof *from->view.labels);
        box.first = (int32_t)parts->pool->used;
        parts->pool->used += (size_t)part_count(&box);
    }
    parts->live += (size_t)part_count(&box);
    add_box(parts, boxes, &box, from->host[old], from->by_node[old], old, from->carrier + from->carrier_start[old],
            from->carrier_start[old + 1] - from->carrier_start[old], from->carried_tets + from->carried_tet_start[old],
            from->carried_tet_start[old + 1] - from->carried_tet_start[old]);
}

static void add_made(pliant_parts *parts, part_box *boxes, const parts_work *all, int32_t n)
{
    const part_made *made = all->made + n;
    const part_maker *by = all->makers + made->maker;
    part_box box = all->hosts->box[all->rebuilt[n]];
    box.first = (int32_t)parts->pool->used;
    memcpy(parts->pool->at + box.first, (const uint16_t *)by->labels.at + made->labels,
           (size_t)made->num_labels * sizeof *parts->pool->at);
    parts->pool->used += (size_t)made->num_labels;
    parts->live += (size_t)made->num_labels;
    add_box(parts, boxes, &box, all->rebuilt[n], made->by_node, -1, (const int32_t *)by->carriers.at + made->carriers,
            made->num_carriers,
            by->carried_tets.at ? (const part_carried_tet *)by->carried_tets.at + made->carried_tets : NULL,
            made->num_carried_tets);
}

/* Return whether a host is in `other`. Hosts must be queried in ascending order.
 * next: input and output; position in the list */
static bool is_other(const parts_work *all, int32_t host, int32_t *next)
{
    while (*next < all->num_other && all->other[*next] < host) (*next)++;
    return *next < all->num_other && all->other[*next] == host;
}

/* Count the entries of all lists and allocate them. */
static pliant_status make_lists(const parts_work *all, pliant_parts *parts, part_box **boxes, part_element **elements)
{
    const pliant_parts *from = all->before;
    size_t count = 0, carriers = 0, carried_tets = 0, more = 0, live = 0;
    for (int32_t old = 0, other = 0; from && old < from->num_boxes; old++) {
        if (is_other(all, from->host[old], &other)) continue;
        count++;
        carriers += (size_t)(from->carrier_start[old + 1] - from->carrier_start[old]);
        carried_tets += (size_t)(from->carried_tet_start[old + 1] - from->carried_tet_start[old]);
        live += (size_t)part_count(&from->view.boxes[old]);
    }
    for (int32_t n = 0; n < all->num_rebuilt; n++) {
        if (all->made[n].maker < 0) continue;
        count++;
        carriers += (size_t)all->made[n].num_carriers;
        carried_tets += (size_t)all->made[n].num_carried_tets;
        more += (size_t)all->made[n].num_labels;
    }
    parts->view.boxes = *boxes = pliant_calloc(count + 1, sizeof **boxes);
    const size_t tets = (size_t)all->body->fine.num_tets, known = from ? (size_t)all->body_before->fine.num_tets : 0;
    *elements = from ? pliant_next_version(from->view.elements, known < tets ? known : tets, tets + carried_tets,
                                           sizeof **elements)
                     : pliant_malloc(tets + carried_tets, sizeof **elements);
    parts->view.elements = *elements;
    parts->host = pliant_calloc(count + 1, sizeof *parts->host);
    parts->by_node = pliant_calloc(count + 1, sizeof *parts->by_node);
    parts->taken = pliant_calloc(count + 1, sizeof *parts->taken);
    parts->carrier_start = pliant_calloc(count + 1, sizeof *parts->carrier_start);
    parts->carried_tet_start = pliant_calloc(count + 1, sizeof *parts->carried_tet_start);
    parts->carrier = pliant_calloc(carriers + 1, sizeof *parts->carrier);
    parts->carried_tets = pliant_calloc(carried_tets + 1, sizeof *parts->carried_tets);
    if (!*boxes || !*elements || !parts->host || !parts->by_node || !parts->taken || !parts->carrier_start ||
        !parts->carried_tet_start || !parts->carrier || !parts->carried_tets)
        return pliant_parts_no_memory();
    return pliant_part_pool_find(from, live, more, &parts->pool);
}

static pliant_status gather(const parts_work *all, pliant_parts *parts)
{
    part_box *boxes;
    part_element *elements;
    pliant_status status = make_lists(all, parts, &boxes, &elements);
    if (status != PLIANT_OK) return status;
    memcpy(parts->view.scan_size, all->body->voxels->geometry.size, sizeof parts->view.scan_size);
    const int32_t olds = all->before ? all->before->num_boxes : 0;
    for (int32_t n = 0, old = 0, other = 0; n < all->num_rebuilt || old < olds;) {
        const int32_t host = old < olds ? all->before->host[old] : INT32_MAX;
        if (n < all->num_rebuilt && all->rebuilt[n] <= host) {
            if (all->made[n].maker >= 0) add_made(parts, boxes, all, n);
            old += all->rebuilt[n++] == host;
        } else {
            if (!is_other(all, host, &other)) add_kept(parts, boxes, all->before, old);
            old++;
        }
    }
    parts->view.labels = parts->pool->at;
    parts->num_labels = (int32_t)parts->pool->used;
    set_elements(all, parts, elements);
    return PLIANT_OK;
}

static pliant_status create(parts_work *all, pliant_parts *parts)
{
    pliant_status status = PLIANT_OK;
    if (all->before) all->hosts = all->before->hosts;
    if (all->hosts) all->hosts->holders++;
    else status = pliant_part_hosts_create(all->body, all->makers->scan, &all->hosts);
    if (status != PLIANT_OK) return status;
    parts->hosts = all->hosts;
    if (all->before) status = pliant_parts_compare(all->makers, all->body_before, all->hosts, &all->changes);
    if (status != PLIANT_OK) return status;
    const bool planned = plan(all);
    if (planned) all->made = pliant_calloc((size_t)all->num_rebuilt + 1, sizeof *all->made);
    status = all->made ? make_boxes(all) : pliant_parts_no_memory();
    if (status == PLIANT_OK) status = gather(all, parts);
    parts->num_other = all->num_other;
    parts->other = all->other;
    all->other = NULL;
    return status;
}

static void free_maker(part_maker *maker)
{
    PLIANT_FREE(maker->label, maker->queue, maker->carried, maker->step, maker->severed, maker->touched, maker->wanted,
                maker->wall, maker->carriers.at, maker->labels.at, maker->carried_tets.at);
}

pliant_status pliant_parts_create(const pliant_body *body, const pliant_geometry *scan, const pliant_body *body_before,
                                  const pliant_parts *before, part_hosts *hosts, int num_threads, pliant_parts **out)
{
    *out = NULL;
    if (!body->cuts || !body->voxels) return PLIANT_OK;
    if (memcmp(body->voxels->geometry.size, scan->size, sizeof scan->size) != 0)
        return pliant_fail(PLIANT_ERROR_ARGUMENT, "the voxels of the mesh topology differ from the voxels of the scan");
    const size_t tets = (size_t)body->voxels->num_tets;
    parts_work all = {.body = body,
                      .before = before && body_before && body_before->voxels == body->voxels ? before : NULL,
                      .hosts = hosts,
                      .body_before = body_before,
                      .num_makers = num_threads};
    all.cut_of = pliant_malloc(tets, sizeof *all.cut_of);
    all.makers = pliant_calloc((size_t)num_threads, sizeof *all.makers);
    pliant_parts *parts = pliant_calloc(1, sizeof *parts);
    pliant_status status = all.cut_of && all.makers && parts ? PLIANT_OK : pliant_parts_no_memory();
    if (status == PLIANT_OK) {
        memset(all.cut_of, 0xff, tets * sizeof *all.cut_of);
        for (int32_t t = 0; t < body->cuts->num_tets; t++) all.cut_of[body->cuts->tet[t]] = t;
        for (int m = 0; m < num_threads; m++)
            all.makers[m] = (part_maker){.body = body,
                                         .voxels = body->voxels,
                                         .cuts = body->cuts,
                                         .scan = scan,
                                         .cut_of = all.cut_of,
                                         .carriers.size = sizeof(int32_t),
                                         .labels.size = sizeof(uint16_t),
                                         .carried_tets.size = sizeof(part_carried_tet)};
        status = create(&all, parts);
    }
    for (int m = 0; all.makers && m < num_threads; m++) free_maker(all.makers + m);
    pliant_part_changes_free(&all.changes);
    PLIANT_FREE(all.cut_of, all.other, all.rebuilt, all.made, all.makers);
    if (status != PLIANT_OK) {
        pliant_parts_free(parts);
        return status;
    }
    *out = parts;
    return PLIANT_OK;
}

pliant_status pliant_parts_whole(const pliant_body *body, const pliant_geometry *scan, pliant_parts **out)
{
    *out = NULL;
    if (!body || !body->subdivision || !body->subdivision->between) return PLIANT_OK;
    pliant_parts *parts = pliant_calloc(1, sizeof *parts);
    part_element *elements = parts ? pliant_calloc((size_t)body->fine.num_tets, sizeof *elements) : NULL;
    if (!elements) {
        pliant_free(parts);
        return pliant_parts_no_memory();
    }
    for (int32_t t = 0; t < body->fine.num_tets; t++) elements[t].box = -1;
    memcpy(parts->view.scan_size, scan->size, sizeof parts->view.scan_size);
    parts->view.num_elements = body->fine.num_tets;
    parts->view.elements = elements;
    *out = parts;
    return PLIANT_OK;
}

void pliant_parts_free(pliant_parts *parts)
{
    if (!parts) return;
    pliant_free((void *)(uintptr_t)parts->view.elements);
    pliant_free((void *)(uintptr_t)parts->view.boxes);
    pliant_part_pool_release(parts->pool);
    pliant_part_hosts_release(parts->hosts);
    PLIANT_FREE(parts->host, parts->by_node, parts->taken, parts->other, parts->carrier_start, parts->carrier,
                parts->carried_tet_start, parts->carried_tets, parts);
}

bool pliant_parts_same(const pliant_parts *before, int32_t box_before, const pliant_parts *now, int32_t box)
{
    if (box_before < 0 || box < 0) return box_before < 0 && box < 0;
    if (now->taken[box] == box_before) return true;
    const part_box *one = &before->view.boxes[box_before], *other = &now->view.boxes[box];
    const int32_t *from = before->carrier + before->carrier_start[box_before],
                  *to = now->carrier + now->carrier_start[box];
    const int32_t carriers = before->carrier_start[box_before + 1] - before->carrier_start[box_before];
    return before->host[box_before] == now->host[box] &&
           part_same_list(from, carriers, to, now->carrier_start[box + 1] - now->carrier_start[box]) &&
           memcmp(before->view.labels + one->first, now->view.labels + other->first,
                  (size_t)part_count(one) * sizeof *now->view.labels) == 0;
}
