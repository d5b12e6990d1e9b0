/* Labels of the voxels around every tetrahedron that a cut passes. */
#include "base/fail.h"
#include "base/threads.h"
#include "pliant/memory.h"
#include "warp/parts_maker.h"

#include <omp.h>

typedef struct parts_work {
    const pliant_body *body;
    const pliant_parts *before;    /* Nullable: nothing can be taken from there */
    part_hosts *hosts;
    int32_t *cut_of;               /* (tetrahedra at load) */
    part_changes changes;
    int32_t *kept;                 /* (tetrahedra at load) box of the parts before; -1: none */
    int32_t num_anew, *anew;       /* tetrahedra at load, ascending */
    part_made *made;               /* (num_anew) */
    int num_makers;
    part_maker *makers;
} parts_work;

/* whether a tetrahedron at load, or one that shares a node with it, is in the cuts */
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

/* Which tetrahedra keep their box, or that they have none, and which are looked at anew. */
static void plan(parts_work *all)
{
    const pliant_voxels *voxels = all->body->voxels;
    for (int32_t t = 0; t < voxels->num_tets; t++) {
        const int32_t old = all->before ? all->before->view.elements[t].box : -1;
        all->kept[t] = -1;
        if (voxels->start[t] == voxels->start[t + 1]) continue;
        if (all->before && !pliant_parts_differ(&all->changes, t, &all->hosts->box[t], old >= 0 && all->before->by_node[old])) all->kept[t] = old;
        else if (is_near(all, t)) all->anew[all->num_anew++] = t;
    }
}

static pliant_status make_boxes(parts_work *all)
{
    pliant_work work = {.what = "the parts of the deformed volume"};
#pragma omp parallel num_threads(all->num_makers)
    {
        const int maker = omp_get_thread_num();
        pliant_status status = PLIANT_OK;
#pragma omp for schedule(dynamic, 2)
        for (int32_t n = 0; n < all->num_anew; n++) {
            const int32_t tet = all->anew[n];
            all->made[n].maker = -1;
            if (status == PLIANT_OK) status = pliant_parts_make_box(all->makers + maker, tet, &all->hosts->box[tet], maker, all->made + n);
        }
        pliant_work_leave(&work, status);
    }
    return pliant_work_outcome(&work);
}

/* What each element is a part of. Guests follow the tetrahedra. */
static void set_elements(const parts_work *all, pliant_parts *parts, part_element *elements)
{
    const int32_t tets = all->body->fine.num_tets;
    const pliant_cuts *cuts = all->body->cuts;
    for (int32_t t = 0; t < tets + parts->num_guests; t++) elements[t].box = -1;
    int32_t guest = 0;
    for (int32_t b = 0; b < parts->num_boxes; b++) {
        const int32_t host = parts->host[b], cut = all->cut_of[host], *carrier = parts->carrier + parts->carrier_start[b];
        if (cut < 0) elements[host] = (part_element){b, 0};
        for (int32_t f = cut < 0 ? 0 : cuts->start[cut]; cut >= 0 && f < cuts->start[cut + 1]; f++)
            elements[cuts->fragment[f]] = (part_element){b, f - cuts->start[cut]};
        for (int32_t label = 0; guest < parts->guest_start[b + 1]; label++)
            if (carrier[label] == parts->guests[guest].carrier) elements[tets + guest++] = (part_element){b, label};
    }
    parts->view.elements = elements;
    parts->view.num_elements = tets + parts->num_guests;
}

/* One more box at the end, with its carriers and guests. */
static void add_box(pliant_parts *parts, part_box *boxes, const part_box *box, int32_t host, bool by_node, int32_t taken, const int32_t *carrier,
                    int32_t num_carriers, const part_guest *guest, int32_t num_guests)
{
    const int32_t b = parts->num_boxes++;
    boxes[b] = *box;
    parts->host[b] = host;
    parts->by_node[b] = by_node;
    parts->taken[b] = taken;
    memcpy(parts->carrier + parts->carrier_start[b], carrier, (size_t)num_carriers * sizeof *carrier);
    if (num_guests > 0) memcpy(parts->guests + parts->guest_start[b], guest, (size_t)num_guests * sizeof *guest);
    parts->carrier_start[b + 1] = parts->carrier_start[b] + num_carriers;
    parts->guest_start[b + 1] = parts->guest_start[b] + num_guests;
    parts->num_guests = parts->guest_start[b + 1];
}

static void add_kept(pliant_parts *parts, part_box *boxes, const pliant_parts *from, int32_t old)
{
    part_box box = from->view.boxes[old];
    if (parts->pool != from->pool) {
        memcpy(parts->pool->at + parts->pool->used, from->view.labels + box.first, (size_t)part_count(&box) * sizeof *from->view.labels);
        box.first = (int32_t)parts->pool->used;
        parts->pool->used += (size_t)part_count(&box);
    }
    parts->live += (size_t)part_count(&box);
    add_box(parts, boxes, &box, from->host[old], from->by_node[old], old, from->carrier + from->carrier_start[old],
            from->carrier_start[old + 1] - from->carrier_start[old], from->guests + from->guest_start[old],
            from->guest_start[old + 1] - from->guest_start[old]);
}

static void add_made(pliant_parts *parts, part_box *boxes, const parts_work *all, int32_t n)
{
    const part_made *made = all->made + n;
    const part_maker *by = all->makers + made->maker;
    part_box box = all->hosts->box[all->anew[n]];
    box.first = (int32_t)parts->pool->used;
    memcpy(parts->pool->at + box.first, (const uint16_t *)by->labels.at + made->labels, (size_t)made->num_labels * sizeof *parts->pool->at);
    parts->pool->used += (size_t)made->num_labels;
    parts->live += (size_t)made->num_labels;
    add_box(parts, boxes, &box, all->anew[n], made->by_node, -1, (const int32_t *)by->carriers.at + made->carriers, made->num_carriers,
            by->guests.at ? (const part_guest *)by->guests.at + made->guests : NULL, made->num_guests);
}

/* Counts, and room for them. */
static pliant_status make_lists(const parts_work *all, pliant_parts *parts, part_box **boxes, part_element **elements)
{
    const pliant_parts *from = all->before;
    size_t count = 0, carriers = 0, guests = 0, more = 0, live = 0;
    for (int32_t t = 0; t < all->body->voxels->num_tets; t++) {
        const int32_t old = all->kept[t];
        if (old < 0) continue;
        count++;
        carriers += (size_t)(from->carrier_start[old + 1] - from->carrier_start[old]);
        guests += (size_t)(from->guest_start[old + 1] - from->guest_start[old]);
        live += (size_t)part_count(&from->view.boxes[old]);
    }
    for (int32_t n = 0; n < all->num_anew; n++) {
        if (all->made[n].maker < 0) continue;
        count++;
        carriers += (size_t)all->made[n].num_carriers;
        guests += (size_t)all->made[n].num_guests;
        more += (size_t)all->made[n].num_labels;
    }
    parts->view.boxes = *boxes = pliant_calloc(count + 1, sizeof **boxes);
    *elements = pliant_calloc((size_t)all->body->fine.num_tets + guests, sizeof **elements);
    parts->view.elements = *elements;
    parts->host = pliant_calloc(count + 1, sizeof *parts->host);
    parts->by_node = pliant_calloc(count + 1, sizeof *parts->by_node);
    parts->taken = pliant_calloc(count + 1, sizeof *parts->taken);
    parts->carrier_start = pliant_calloc(count + 1, sizeof *parts->carrier_start);
    parts->guest_start = pliant_calloc(count + 1, sizeof *parts->guest_start);
    parts->carrier = pliant_calloc(carriers + 1, sizeof *parts->carrier);
    parts->guests = pliant_calloc(guests + 1, sizeof *parts->guests);
    if (!*boxes || !*elements || !parts->host || !parts->by_node || !parts->taken || !parts->carrier_start || !parts->guest_start || !parts->carrier ||
        !parts->guests)
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
    int32_t n = 0;
    for (int32_t t = 0; t < all->body->voxels->num_tets; t++) {
        if (all->kept[t] >= 0) add_kept(parts, boxes, all->before, all->kept[t]);
        if (n == all->num_anew || all->anew[n] != t) continue;
        if (all->made[n].maker >= 0) add_made(parts, boxes, all, n);
        n++;
    }
    parts->view.labels = parts->pool->at;
    parts->num_labels = (int32_t)parts->pool->used;
    set_elements(all, parts, elements);
    return PLIANT_OK;
}

static pliant_status create(parts_work *all, const pliant_body *body_before, pliant_parts *parts)
{
    pliant_status status = pliant_part_hosts_find(all->makers, all->before, &parts->hosts);
    if (status != PLIANT_OK) return status;
    all->hosts = parts->hosts;
    if (all->before) status = pliant_parts_compare(all->makers, body_before, all->hosts, &all->changes);
    if (status != PLIANT_OK) return status;
    plan(all);
    all->made = pliant_calloc((size_t)all->num_anew + 1, sizeof *all->made);
    status = all->made ? make_boxes(all) : pliant_parts_no_memory();
    return status == PLIANT_OK ? gather(all, parts) : status;
}

static void free_maker(part_maker *maker)
{
    void *blocks[] = {maker->label, maker->queue, maker->carried, maker->step, maker->severed, maker->touched, maker->wanted, maker->carriers.at,
                      maker->labels.at, maker->guests.at};
    for (size_t b = 0; b < sizeof blocks / sizeof *blocks; b++) pliant_free(blocks[b]);
}

pliant_status pliant_parts_create(const pliant_body *body, const pliant_geometry *scan, const pliant_body *body_before, const pliant_parts *before,
                                  int num_threads, pliant_parts **out)
{
    *out = NULL;
    if (!body->cuts || !body->voxels) return PLIANT_OK;
    if (memcmp(body->voxels->geometry.size, scan->size, sizeof scan->size) != 0)
        return pliant_fail(PLIANT_ERROR_ARGUMENT, "the voxels of the body that is drawn are not those of the scan");
    const size_t tets = (size_t)body->voxels->num_tets;
    parts_work all = {.body = body, .before = before && body_before && body_before->voxels == body->voxels ? before : NULL, .num_makers = num_threads};
    all.cut_of = pliant_calloc(tets, sizeof *all.cut_of);
    all.kept = pliant_calloc(tets, sizeof *all.kept);
    all.anew = pliant_calloc(tets, sizeof *all.anew);
    all.makers = pliant_calloc((size_t)num_threads, sizeof *all.makers);
    pliant_parts *parts = pliant_calloc(1, sizeof *parts);
    pliant_status status = all.cut_of && all.kept && all.anew && all.makers && parts ? PLIANT_OK : pliant_parts_no_memory();
    if (status == PLIANT_OK) {
        for (size_t t = 0; t < tets; t++) all.cut_of[t] = -1;
        for (int32_t t = 0; t < body->cuts->num_tets; t++) all.cut_of[body->cuts->tet[t]] = t;
        for (int m = 0; m < num_threads; m++)
            all.makers[m] = (part_maker){.body = body, .voxels = body->voxels, .cuts = body->cuts, .scan = scan, .cut_of = all.cut_of,
                                         .carriers.size = sizeof(int32_t), .labels.size = sizeof(uint16_t), .guests.size = sizeof(part_guest)};
        status = create(&all, body_before, parts);
    }
    for (int m = 0; all.makers && m < num_threads; m++) free_maker(all.makers + m);
    pliant_part_changes_free(&all.changes);
    void *blocks[] = {all.cut_of, all.kept, all.anew, all.made, all.makers};
    for (size_t b = 0; b < sizeof blocks / sizeof *blocks; b++) pliant_free(blocks[b]);
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
    pliant_free(parts->host);
    pliant_free(parts->by_node);
    pliant_free(parts->taken);
    pliant_free(parts->carrier_start);
    pliant_free(parts->carrier);
    pliant_free(parts->guest_start);
    pliant_free(parts->guests);
    pliant_free(parts);
}

bool pliant_parts_same(const pliant_parts *before, int32_t box_before, const pliant_parts *now, int32_t box)
{
    if (box_before < 0 || box < 0) return box_before < 0 && box < 0;
    if (now->taken[box] == box_before) return true;
    const part_box *one = &before->view.boxes[box_before], *other = &now->view.boxes[box];
    const int32_t *from = before->carrier + before->carrier_start[box_before], *to = now->carrier + now->carrier_start[box];
    const int32_t carriers = before->carrier_start[box_before + 1] - before->carrier_start[box_before];
        return before->host[box_before] == now->host[box] && part_same_list(from, carriers, to, now->carrier_start[box + 1] - now->carrier_start[box]) &&
           memcmp(before->view.labels + one->first, now->view.labels + other->first, (size_t)part_count(one) * sizeof *now->view.labels) == 0;
}
