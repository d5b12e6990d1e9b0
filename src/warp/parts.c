/* Labels of the voxels around every tetrahedron that a cut passes. */
#include "base/fail.h"
#include "pliant/memory.h"
#include "warp/parts_maker.h"

#include <math.h>

/* A voxel of another tetrahedron counts to a carrier that so many links lead to: as far as two corners of a cell lie apart. */
enum { STEPS = 3 };
enum { NO_LABEL = -1, IN_QUEUE = -2 };

pliant_status pliant_parts_no_memory(void) { return pliant_fail_memory("the parts of the deformed volume"); }

void *pliant_parts_grow(part_list *list, size_t more)
{
    if (list->count + more > list->room) {
        size_t room = 2 * (list->count + more);
        void *longer = pliant_resize(list->at, room, list->size);
        if (!longer) return NULL;
        list->at = longer;
        list->room = room;
    }
    list->count += more;
    return (char *)list->at + (list->count - more) * list->size;
}

static int32_t load_node(const part_maker *work, int32_t node) { return work->body->node_parent ? work->body->node_parent[node] : node; }

static int32_t scan_voxel(const part_maker *work, int32_t local)
{
    int32_t at[3];
    part_place_of(work->box.size, local, at);
    for (int d = 0; d < 3; d++) at[d] += work->box.low[d];
    return part_index_of(work->voxels->geometry.size, at);
}

static bool in_box(const part_box *box, const int32_t scan[3], int32_t *local)
{
    int32_t at[3];
    for (int d = 0; d < 3; d++) {
        at[d] = scan[d] - box->low[d];
        if (at[d] < 0 || at[d] >= box->size[d]) return false;
    }
    *local = part_index_of(box->size, at);
    return true;
}

/* ---- links */

/* Those of the box, to severed; whether there are any. */
static bool find_severed(part_maker *work)
{
    const part_box *box = &work->box;
    const int32_t *size = work->voxels->geometry.size;
    bool any = false;
    memset(work->severed, 0, (size_t)work->count);
    for (int32_t k = 0; k < box->size[2]; k++) {
        const int32_t slice = size[0] * (box->low[1] + size[1] * (box->low[2] + k));
        const uint32_t *link = work->cuts->link, *from = link + pliant_lower(link, work->cuts->num_links, 4 * (uint32_t)slice);
        const uint32_t *end = link + pliant_lower(link, work->cuts->num_links, 4 * (uint32_t)(slice + size[0] * box->size[1]));
        for (int32_t j = 0; j < box->size[1] && from < end; j++) {
            const uint32_t row = (uint32_t)(slice + size[0] * j + box->low[0]);
            from += pliant_lower(from, (int32_t)(end - from), 4 * row);
            for (; from < end && *from / 4 < row + (uint32_t)box->size[0]; from++) {
                work->severed[(int32_t)(*from / 4 - row) + box->size[0] * (j + box->size[1] * k)] |= (uint8_t)(1 << *from % 4);
                any = true;
            }
        }
    }
    return any;
}

/* ---- carriers */

static int32_t carrier_of(const part_maker *work, int32_t voxel)
{
    const int32_t tet = work->voxels->owner[voxel], cut = work->cut_of[tet];
    return cut < 0 ? tet : work->cuts->voxel_fragment[work->cuts->voxel_start[cut] + pliant_voxel_in(work->voxels, tet, voxel)];
}

/* its label among the carriers of the box; -1: no memory */
static int32_t label_of(part_maker *work, int32_t carrier)
{
    const int32_t *all = (const int32_t *)work->carriers.at + work->first_carrier;
    for (int32_t n = 0; n < work->num_carriers; n++)
        if (all[n] == carrier) return n;
    int32_t *added = pliant_parts_grow(&work->carriers, 1);
    if (!added) return -1;
    *added = carrier;
    return work->num_carriers++;
}

static bool list_fragments(part_maker *work)
{
    const int32_t cut = work->cut_of[work->tet];
    work->first_carrier = (int32_t)work->carriers.count;
    work->num_carriers = 0;
    if (cut < 0 && label_of(work, work->tet) < 0) return false;
    for (int32_t f = cut < 0 ? 0 : work->cuts->start[cut]; cut >= 0 && f < work->cuts->start[cut + 1]; f++)
        if (label_of(work, work->cuts->fragment[f]) < 0) return false;
    work->num_fragments = work->num_carriers;
    return true;
}

/* ---- labels */

/* Corners of the cells that the tetrahedron touches; whether one of these has a severed link. */
static bool find_touched(part_maker *work)
{
    const int32_t *size = work->box.size;
    bool any = false;
    int32_t at[3], last[3];
    memset(work->touched, 0, (size_t)work->count);
    for (int d = 0; d < 3; d++) last[d] = size[d] > 1 ? size[d] - 2 : 0;
    for (at[2] = 0; at[2] <= last[2]; at[2]++)
        for (at[1] = 0; at[1] <= last[1]; at[1]++)
            for (at[0] = 0; at[0] <= last[0]; at[0]++) {
                const double low[3] = {work->box.low[0] + at[0], work->box.low[1] + at[1], work->box.low[2] + at[2]};
                if (!pliant_parts_touches(&work->at, low, (const double[3]){1, 1, 1})) continue;
                for (int c = 0; c < 8; c++) {
                    int32_t corner[3];
                    bool there = true;
                    uint8_t links = 0;
                    for (int d = 0; d < 3; d++) {
                        corner[d] = at[d] + (c >> d & 1);
                        there = there && corner[d] < size[d];
                        if (!(c >> d & 1)) links |= (uint8_t)(1 << d);
                    }
                    if (!there) continue;
                    work->touched[part_index_of(size, corner)] = 1;
                    any = any || work->severed[part_index_of(size, corner)] & links;
                }
            }
    return any;
}

static bool label_own(part_maker *work, int32_t *queued)
{
    const pliant_voxels *voxels = work->voxels;
    for (int32_t n = voxels->start[work->tet]; n < voxels->start[work->tet + 1]; n++) {
        int32_t at[3], local;
        pliant_place_of(voxels, voxels->voxel[n], at);
        if (!in_box(&work->box, at, &local)) continue;
        if ((work->label[local] = label_of(work, carrier_of(work, voxels->voxel[n]))) < 0) return false;
        work->step[local] = 0;
        work->queue[(*queued)++] = local;
    }
    return true;
}

/* From the voxels in the queue on over links to those without a label; where as many links lead to several carriers, the lowest label. */
static void spread(part_maker *work, int32_t queued, int steps)
{
    const int32_t *size = work->box.size, stride[3] = {1, size[0], size[0] * size[1]};
    for (int32_t head = 0; head < queued; head++) {
        const int32_t from = work->queue[head];
        int32_t at[3];
        if (work->step[from] >= steps) continue;
        part_place_of(size, from, at);
        for (int d = 0; d < 3; d++)
            for (int way = -1; way <= 1; way += 2) {
                if (at[d] + way < 0 || at[d] + way >= size[d]) continue;
                const int32_t to = from + way * stride[d];
                if (work->severed[way > 0 ? from : to] >> d & 1) continue;
                if (work->label[to] < 0) {
                    work->label[to] = work->label[from];
                    work->step[to] = (uint8_t)(work->step[from] + 1);
                    work->queue[queued++] = to;
                } else if (work->step[to] == work->step[from] + 1 && work->label[from] < work->label[to]) {
                    work->label[to] = work->label[from];
                }
            }
    }
}

/* Whether a voxel beyond reach of links, at a sharp corner of the tetrahedron, is of a tetrahedron that has the same node there as one of
 * the fragments: its label, or NO_LABEL. */
static int32_t label_by_node(const part_maker *work, int32_t local)
{
    const int32_t *tets = work->body->fine.tets, voxel = scan_voxel(work, local), by = carrier_of(work, voxel);
    int32_t at[3], corner = 0;
    double most = -INFINITY;
    pliant_place_of(work->voxels, voxel, at);
    for (int v = 0; v < 4; v++) {
        double weight = work->at.value[v];
        for (int d = 0; d < 3; d++) weight += work->at.slope[v][d] * at[d];
        if (weight > most) corner = v;
        most = fmax(most, weight);
    }
    const int32_t *fragment = (const int32_t *)work->carriers.at + work->first_carrier;
    for (int32_t label = 0; label < work->num_fragments; label++)
        for (int v = 0; v < 4; v++)
            if (tets[4 * (size_t)by + v] == tets[4 * (size_t)fragment[label] + corner]) return label;
    return NO_LABEL;
}

/* Voxels from a first one on that are without a label, wanted, and hang together: in the queue. How many. */
static int32_t hang_together(part_maker *work, int32_t first)
{
    const int32_t *size = work->box.size, stride[3] = {1, size[0], size[0] * size[1]};
    int32_t queued = 0;
    work->label[first] = IN_QUEUE;
    work->queue[queued++] = first;
    for (int32_t head = 0; head < queued; head++) {
        int32_t at[3];
        part_place_of(size, work->queue[head], at);
        for (int d = 0; d < 3; d++)
            for (int way = -1; way <= 1; way += 2) {
                if (at[d] + way < 0 || at[d] + way >= size[d]) continue;
                const int32_t from = work->queue[head], to = from + way * stride[d];
                if (work->severed[way > 0 ? from : to] >> d & 1 || work->label[to] != NO_LABEL || !work->wanted[to]) continue;
                work->label[to] = IN_QUEUE;
                work->queue[queued++] = to;
            }
    }
    return queued;
}

/* The carrier of most of the voxels in the queue; of as many, the lowest. */
static int32_t most_of(const part_maker *work, int32_t queued)
{
    int32_t best = -1, most = 0;
    for (int32_t n = 0; n < queued; n++) work->carried[n] = carrier_of(work, scan_voxel(work, work->queue[n]));
    for (int32_t n = 0; n < queued; n++) {
        const int32_t carrier = work->carried[n];
        int32_t same = 0;
        if (carrier < 0) continue;
        for (int32_t m = n; m < queued; m++) {
            if (work->carried[m] != carrier) continue;
            same++;
            work->carried[m] = -1; /* is counted */
        }
        if (same > most || (same == most && carrier < best)) {
            best = carrier;
            most = same;
        }
    }
    return best;
}

/* Every voxel that is asked for gets a label. Where neither links nor a node lead to it, those that hang together have one carrier: that of most of them.
 * Air goes with what is beside it. */
static bool label_others(part_maker *work)
{
    int32_t queued = 0;
    for (int32_t n = 0; n < work->count; n++) {
        work->wanted[n] = work->label[n] < 0 && work->touched[n] && work->voxels->owner[scan_voxel(work, n)] >= 0;
        if (!work->wanted[n]) continue;
        work->label[n] = label_by_node(work, n);
        work->by_node = true;
    }
    for (int32_t n = 0; n < work->count; n++) {
        if (work->label[n] >= 0 || !work->wanted[n]) continue;
        const int32_t together = hang_together(work, n), label = label_of(work, most_of(work, together));
        if (label < 0) return false;
        for (int32_t m = 0; m < together; m++) work->label[work->queue[m]] = label;
    }
    bool air = false;
    for (int32_t n = 0; n < work->count; n++) {
        air = air || (work->touched[n] && work->label[n] < 0);
        if (work->label[n] < 0) continue;
        work->step[n] = 0;
        work->queue[queued++] = n;
    }
    if (air) spread(work, queued, UINT8_MAX - 1);
    for (int32_t n = 0; n < work->count; n++)
        if (work->label[n] < 0) work->label[n] = 0;
    return true;
}

/* ---- a tetrahedron */

static bool make_room(part_maker *work)
{
    work->count = work->box.size[0] * work->box.size[1] * work->box.size[2];
    if (work->count <= work->room) return true;
    void **blocks[] = {(void **)&work->label, (void **)&work->queue, (void **)&work->carried, (void **)&work->step, (void **)&work->severed, (void **)&work->touched, (void **)&work->wanted};
    const size_t sizes[] = {sizeof *work->label, sizeof *work->queue, sizeof *work->carried, 1, 1, 1, 1};
    work->room = 0;
    for (size_t b = 0; b < sizeof blocks / sizeof *blocks; b++) {
        pliant_free(*blocks[b]);
        if (!(*blocks[b] = pliant_calloc((size_t)work->count, sizes[b]))) return false;
    }
    work->room = work->count;
    return true;
}

/* room for a box and its labels; NULL: none */
uint16_t *pliant_parts_add_box(part_maker *work, int32_t tet, const part_box *box, size_t count, bool by_node, int32_t taken)
{
    const size_t first = work->labels.count;
    if (first + count > INT32_MAX) return NULL;
    uint16_t *labels = pliant_parts_grow(&work->labels, count);
    part_box *made = pliant_parts_grow(&work->boxes, 1);
    int32_t *host = pliant_parts_grow(&work->hosts, 1), *start = pliant_parts_grow(&work->starts, 1);
    uint8_t *nodes = pliant_parts_grow(&work->by_nodes, 1);
    int32_t *from = pliant_parts_grow(&work->taken, 1);
    if (!labels || !made || !host || !start || !nodes || !from) return NULL;
    *nodes = by_node;
    *from = taken;
    *made = *box;
    made->first = (int32_t)first;
    *host = tet;
    *start = work->first_carrier;
    return labels;
}

static void write_labels(const part_maker *work, uint16_t *labels)
{
    const int32_t *size = work->box.size, step[3] = {size[0] > 1, size[1] > 1 ? size[0] : 0, size[2] > 1 ? size[0] * size[1] : 0};
    for (int32_t n = 0; n < work->count; n++) {
        int32_t at[3];
        bool uniform = true;
        part_place_of(size, n, at);
        for (int d = 0; d < 3; d++) uniform = uniform && (size[d] < 2 || at[d] + 1 < size[d]);
        for (int c = 1; c < 8 && uniform; c++)
            uniform = work->label[n + (c & 1 ? step[0] : 0) + (c & 2 ? step[1] : 0) + (c & 4 ? step[2] : 0)] == work->label[n];
        labels[n] = (uint16_t)((uint32_t)work->label[n] | (uniform ? PART_UNIFORM : 0));
    }
}

static pliant_status make_box(part_maker *work, int32_t tet)
{
    int32_t queued = 0;
    work->tet = tet;
    work->by_node = false;
    pliant_parts_shape(work, tet, &work->at);
    pliant_parts_box(work, &work->at, &work->box);
    if (!make_room(work)) return pliant_parts_no_memory();
    bool severed = find_severed(work);
    if (!(severed && find_touched(work)) && work->cut_of[tet] < 0) return PLIANT_OK;
    if (!severed) find_touched(work);
    for (int32_t n = 0; n < work->count; n++) work->label[n] = NO_LABEL;
    if (!list_fragments(work) || !label_own(work, &queued)) return pliant_parts_no_memory();
    spread(work, queued, STEPS);
    if (!label_others(work)) return pliant_parts_no_memory();
    if (work->num_carriers > PART_MOST_LABELS) return pliant_fail(PLIANT_ERROR_MEMORY, "more than %d fragments meet in one tetrahedron", PART_MOST_LABELS);
    uint16_t *labels = pliant_parts_add_box(work, tet, &work->box, (size_t)work->count, work->by_node, -1);
    if (!labels) return pliant_parts_no_memory();
    write_labels(work, labels);
    return pliant_parts_add_guests(work);
}

/* ---- all of them */

static void find_near(part_maker *work)
{
    const pliant_voxels *voxels = work->voxels;
    for (int32_t t = 0; t < work->cuts->num_tets; t++) {
        work->cut_of[work->cuts->tet[t]] = t;
        for (int v = 0; v < 4; v++) {
            const int32_t node = load_node(work, work->body->fine.tets[4 * (size_t)work->cuts->tet[t] + v]);
            for (int32_t a = voxels->around_start[node]; a < voxels->around_start[node + 1]; a++) work->near[voxels->around[a] / 4] = 1;
        }
    }
}

/* What each element is a part of. Guests follow the tetrahedra. */
static pliant_status set_elements(const part_maker *work, pliant_parts *parts)
{
    const int32_t tets = work->body->fine.num_tets;
    part_element *elements = pliant_calloc((size_t)(tets + parts->num_guests), sizeof *elements);
    if (!elements) return pliant_parts_no_memory();
    for (int32_t t = 0; t < tets + parts->num_guests; t++) elements[t].box = -1;
    int32_t guest = 0;
    for (int32_t b = 0; b < parts->num_boxes; b++) {
        const int32_t host = parts->host[b], cut = work->cut_of[host], *carrier = parts->carrier + parts->carrier_start[b];
        if (cut < 0) elements[host] = (part_element){b, 0};
        for (int32_t f = cut < 0 ? 0 : work->cuts->start[cut]; cut >= 0 && f < work->cuts->start[cut + 1]; f++)
            elements[work->cuts->fragment[f]] = (part_element){b, f - work->cuts->start[cut]};
        for (int32_t label = 0; guest < parts->num_guests && parts->guests[guest].host == host; label++)
            if (carrier[label] == parts->guests[guest].carrier) elements[tets + guest++] = (part_element){b, label};
    }
    parts->view.elements = elements;
    parts->view.num_elements = tets + parts->num_guests;
    return PLIANT_OK;
}

static pliant_status gather(part_maker *work, pliant_parts *parts)
{
    int32_t *end = pliant_parts_grow(&work->starts, 1);
    if (!end) return pliant_parts_no_memory();
    *end = (int32_t)work->carriers.count;
    memcpy(parts->view.scan_size, work->voxels->geometry.size, sizeof parts->view.scan_size);
    parts->num_boxes = (int32_t)work->boxes.count;
    parts->num_labels = (int32_t)work->labels.count;
    parts->num_guests = (int32_t)work->guests.count;
    parts->view.boxes = work->boxes.at;
    parts->view.labels = work->labels.at;
    parts->host = work->hosts.at;
    parts->by_node = work->by_nodes.at;
    parts->taken = work->taken.at;
    parts->carrier_start = work->starts.at;
    parts->carrier = work->carriers.at;
    parts->guests = work->guests.at;
    work->boxes.at = work->labels.at = work->hosts.at = work->by_nodes.at = work->taken.at = work->starts.at = work->carriers.at = work->guests.at = NULL;
    return set_elements(work, parts);
}

pliant_status pliant_parts_create(const pliant_body *body, const pliant_geometry *scan, const pliant_body *body_before, const pliant_parts *before,
                                  pliant_parts **out)
{
    *out = NULL;
    if (!body->cuts || !body->voxels) return PLIANT_OK;
    if (memcmp(body->voxels->geometry.size, scan->size, sizeof scan->size) != 0)
        return pliant_fail(PLIANT_ERROR_ARGUMENT, "the voxels of the body that is drawn are not those of the scan");
    part_maker work = {.body = body, .voxels = body->voxels, .cuts = body->cuts, .scan = scan};
    const size_t tets = (size_t)body->voxels->num_tets;
    work.carriers.size = work.hosts.size = work.taken.size = work.starts.size = sizeof(int32_t);
    work.labels.size = sizeof(uint16_t);
    work.by_nodes.size = sizeof(uint8_t);
    work.boxes.size = sizeof(part_box);
    work.guests.size = sizeof(part_guest);
    work.cut_of = pliant_calloc(tets, sizeof *work.cut_of);
    work.near = pliant_calloc(tets, 1);
    pliant_parts *parts = pliant_calloc(1, sizeof *parts);
    pliant_status status = work.cut_of && work.near && parts ? PLIANT_OK : pliant_parts_no_memory();
    for (size_t t = 0; status == PLIANT_OK && t < tets; t++) work.cut_of[t] = -1;
    if (status == PLIANT_OK) find_near(&work);
    if (status == PLIANT_OK) status = pliant_parts_compare(&work, body_before, before);
    for (int32_t t = 0; t < body->voxels->num_tets && status == PLIANT_OK; t++)
        if (work.near[t] && body->voxels->start[t] < body->voxels->start[t + 1] && !pliant_parts_take_before(&work, t, &status)) status = make_box(&work, t);
    if (status == PLIANT_OK) status = gather(&work, parts);
    void *blocks[] = {work.cut_of, work.near, work.other, work.label, work.queue, work.carried, work.step, work.severed, work.touched, work.wanted, work.carriers.at,
                      work.labels.at, work.boxes.at, work.hosts.at, work.by_nodes.at, work.taken.at, work.starts.at, work.guests.at};
    for (size_t b = 0; b < sizeof blocks / sizeof *blocks; b++) pliant_free(blocks[b]);
    if (status != PLIANT_OK) {
        pliant_parts_free(parts);
        return status;
    }
    *out = parts;
    return PLIANT_OK;
}

void pliant_parts_free(pliant_parts *parts)
{
    if (!parts) return;
    pliant_free((void *)(uintptr_t)parts->view.elements);
    pliant_free((void *)(uintptr_t)parts->view.boxes);
    pliant_free((void *)(uintptr_t)parts->view.labels);
    pliant_free(parts->host);
    pliant_free(parts->by_node);
    pliant_free(parts->taken);
    pliant_free(parts->carrier_start);
    pliant_free(parts->carrier);
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
    const size_t labels = (size_t)one->size[0] * (size_t)one->size[1] * (size_t)one->size[2];
    return before->host[box_before] == now->host[box] && part_same_list(from, carriers, to, now->carrier_start[box + 1] - now->carrier_start[box]) &&
           memcmp(before->view.labels + one->first, now->view.labels + other->first, labels * sizeof *now->view.labels) == 0;
}
