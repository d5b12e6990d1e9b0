/* Change a warp to another body without redrawing unchanged parts. */
#include "base/fail.h"
#include "base/buffer.h"
#include "topology/links.h"
#include "base/memory.h"
#include "warp/warp_state.h"

#include <string.h>

/* arrays of the warp that may need a larger capacity */
enum { NODE_ARRAYS = 4, ELEMENT_ARRAYS = 2, NUM_ARRAYS = 7 };

struct pliant_warp_next {
    const pliant_mesh *mesh;
    const pliant_body *body;
    int32_t load_nodes;        /* number of initial nodes, which are the same in all bodies */
    pliant_parts *parts;
    pliant_fit *fit;
    size_t node_capacity, element_capacity, candidate_capacity;
    void *longer[NUM_ARRAYS];     /* larger arrays that replace the warp's; NULL: the capacity suffices */
    int32_t *carried_tet_fixed;   /* (carried_tets x 12) */
    raster_tet *carried_tet_tets; /* (carried_tets) */
    pliant_warp_changes changes;
    uint8_t *still_exists;     /* (previous elements - common) */
    const pliant_warp_device *device;
    void *device_next;
    bool device_lost;          /* the device cannot change, so the CPU draws from now on */
};

/* a position that no node has */
static const int32_t no_position = INT32_MIN;

void pliant_warp_next_free(pliant_warp_next *next)
{
    if (!next) return;
    pliant_parts_free(next->parts);
    pliant_fit_free(next->fit);
    for (int a = 0; a < NUM_ARRAYS; a++) pliant_free(next->longer[a]);
    PLIANT_FREE(next->carried_tet_fixed, next->carried_tet_tets, next->changes.rebuilt, next->changes.from,
                next->changes.removed, next->still_exists);
    if (next->device_next) next->device->drop(next->device_next);
    pliant_free(next);
}

/* Return whether a body directly follows the drawn one, so that it lists the differences. */
static bool is_next(const pliant_warp *warp, const pliant_body *body)
{
    return warp->body && body->changes.since == warp->body->revision;
}

static pliant_status check(const pliant_warp *warp, const pliant_body *body)
{
    const pliant_mesh *mesh = &body->fine;
    if (memcmp(mesh->cells, warp->mesh->cells, sizeof mesh->cells) != 0 ||
        memcmp(mesh->corner, warp->mesh->corner, sizeof mesh->corner) != 0)
        return pliant_fail(PLIANT_ERROR_ARGUMENT,
                           "a mesh topology of another model cannot replace the current one of the deformed volume");
    if (is_next(warp, body)) return PLIANT_OK;
    for (int32_t v = 0; v < 4 * mesh->num_tets; v++)
        if (mesh->tets[v] < 0 || mesh->tets[v] >= mesh->num_nodes)
            return pliant_fail(PLIANT_ERROR_ARGUMENT, "tetrahedron %d of the warped mesh names node %d of %d", v / 4,
                               mesh->tets[v], mesh->num_nodes);
    return PLIANT_OK;
}

/* List the nodes' arrays, then the elements' arrays, then the candidates. */
static void list_arrays(pliant_warp *warp, void **array[NUM_ARRAYS], size_t size[NUM_ARRAYS])
{
    void **arrays[NUM_ARRAYS] = {(void **)&warp->rest,      (void **)&warp->fixed, (void **)&warp->next,
                                 (void **)&warp->moved,     (void **)&warp->tets,  (void **)&warp->rebuilt,
                                 (void **)&warp->candidates};
    const size_t sizes[NUM_ARRAYS] = {3 * sizeof *warp->rest,  3 * sizeof *warp->fixed, 3 * sizeof *warp->next,
                                      sizeof *warp->moved,     sizeof *warp->tets,      sizeof *warp->rebuilt,
                                      sizeof *warp->candidates};
    memcpy(array, arrays, sizeof arrays);
    memcpy(size, sizes, sizeof sizes);
}

/* Allocate larger arrays if the capacity for nodes or elements is too small. */
static bool reserve_capacity(pliant_warp *warp, size_t nodes, size_t elements, pliant_warp_next *next)
{
    void **array[NUM_ARRAYS];
    size_t size[NUM_ARRAYS];
    list_arrays(warp, array, size);
    next->node_capacity = nodes > warp->node_capacity ? nodes + nodes / 4 : warp->node_capacity;
    next->element_capacity = elements > warp->element_capacity ? elements + elements / 4 : warp->element_capacity;
    next->candidate_capacity = elements > warp->capacity ? elements + elements / 4 : warp->capacity;
    for (int a = 0; a < NUM_ARRAYS; a++) {
        const size_t capacity = a < NODE_ARRAYS                    ? next->node_capacity
                            : a < NODE_ARRAYS + ELEMENT_ARRAYS ? next->element_capacity
                                                               : next->candidate_capacity;
        const size_t now = a < NODE_ARRAYS                    ? warp->node_capacity
                           : a < NODE_ARRAYS + ELEMENT_ARRAYS ? warp->element_capacity
                                                              : warp->capacity;
        if (capacity > now && !(next->longer[a] = pliant_calloc(capacity, size[a]))) return false;
    }
    return true;
}

static void take_capacity(pliant_warp *warp, pliant_warp_next *next)
{
    void **array[NUM_ARRAYS];
    size_t size[NUM_ARRAYS];
    list_arrays(warp, array, size);
    for (int a = 0; a < NUM_ARRAYS; a++) {
        if (!next->longer[a]) continue;
        memcpy(next->longer[a], *array[a],
               size[a] * (a < NODE_ARRAYS ? (size_t)warp->mesh->num_nodes : (size_t)warp->num_elements));
        void *shorter = *array[a];
        *array[a] = next->longer[a];
        next->longer[a] = shorter;
    }
    warp->node_capacity = next->node_capacity;
    warp->element_capacity = next->element_capacity;
    warp->capacity = next->candidate_capacity;
}

/* Return the box of a host; parts Nullable. */
static int32_t box_of(const pliant_parts *parts, int32_t tet) { return parts ? parts->view.elements[tet].box : -1; }

/* Return whether a node of the next body is not in the drawn body, or differs from the node with its number, as copies
 * may after an undo. */
static bool is_new(const pliant_warp *warp, const pliant_warp_next *next, int32_t node)
{
    const pliant_mesh *old = warp->mesh, *mesh = next->mesh;
    if (node < next->load_nodes) return false;
    return node >= old->num_nodes ||
           memcmp(old->rest + 3 * (size_t)node, mesh->rest + 3 * (size_t)node, 3 * sizeof *mesh->rest) != 0;
}

static bool differs(const pliant_warp *warp, const pliant_warp_next *next, int32_t tet)
{
    const int32_t *before = warp->mesh->tets + 4 * (size_t)tet, *now = next->mesh->tets + 4 * (size_t)tet;
    bool other = memcmp(before, now, 4 * sizeof *now) != 0;
    for (int v = 0; v < 4; v++) other = other || is_new(warp, next, now[v]);
    return other || !pliant_parts_same(warp->parts, box_of(warp->parts, tet), next->parts, box_of(next->parts, tet));
}

/* Keep the drawn state of carried tetrahedra that both bodies have. */
static void carry_carried_tets(const pliant_warp *warp, pliant_warp_next *next)
{
    const pliant_parts *old = warp->parts, *now = next->parts;
    const pliant_warp_changes *changes = &next->changes;
    const int32_t before = warp->mesh->num_tets, first = next->mesh->num_tets;
    int32_t from = 0;
    for (int32_t g = 0; now && g < now->num_carried_tets; g++) {
        const part_carried_tet *carried_tet = &now->carried_tets[g];
        for (int n = 0; n < 12; n++) next->carried_tet_fixed[12 * g + n] = no_position;
        while (old && from < old->num_carried_tets && old->carried_tets[from].host < carried_tet->host) from++;
        for (int32_t o = from; old && o < old->num_carried_tets && old->carried_tets[o].host == carried_tet->host;
             o++) {
            const int32_t host = carried_tet->host;
            if (old->carried_tets[o].carrier != carried_tet->carrier ||
                !pliant_parts_same(old, box_of(old, host), now, box_of(now, host)))
                continue;
            memcpy(next->carried_tet_fixed + 12 * g, warp->carried_tet_fixed + 12 * o,
                   12 * sizeof *next->carried_tet_fixed);
            next->carried_tet_tets[g] = warp->tets[before + o];
            changes->from[first + g - changes->common] = before + o;
            next->still_exists[before + o - changes->common] = 1;
        }
    }
}

static int32_t count_fragments(const pliant_body *body, int32_t host)
{
    const int32_t *list;
    return pliant_fragments_of(body->cuts, &host, &list);
}

/* List the fragments of an initial tetrahedron that both bodies have; return their number. */
static int32_t list_fragments(const pliant_body *body, int32_t host, int32_t common, int32_t *out)
{
    const int32_t *list, count = pliant_fragments_of(body->cuts, &host, &list);
    int32_t listed = 0;
    for (int32_t f = 0; f < count; f++)
        if (list[f] < common) out[listed++] = list[f];
    return listed;
}

/* List the tetrahedra of both bodies that may be drawn differently: the next body's list, and tetrahedra with
 * other parts. If the body is not the next one, all are listed. NULL: out of memory. */
static int32_t *list_doubtful(const pliant_warp *warp, const pliant_warp_next *next, int32_t *count)
{
    const pliant_body_changes *changes = &next->body->changes;
    const pliant_parts *parts = next->parts;
    const int32_t common = next->changes.common, hosts = parts ? parts->num_other : 0;
    const bool listed = is_next(warp, next->body) && (parts || !warp->parts);
    size_t maximum = listed ? (size_t)changes->num_touched : (size_t)common;
    for (int32_t i = 0; listed && i < hosts; i++)
        maximum +=
            (size_t)count_fragments(warp->body, parts->other[i]) + (size_t)count_fragments(next->body, parts->other[i]);
    int32_t *list = pliant_malloc(maximum + 1, sizeof *list);
    *count = 0;
    for (int32_t t = 0; list && !listed && t < common; t++) list[(*count)++] = t;
    if (!list || !listed) return list;
    for (int32_t i = 0; i < changes->num_touched; i++) list[(*count)++] = changes->touched[i];
    for (int32_t i = 0; i < hosts; i++) {
        *count += list_fragments(warp->body, parts->other[i], common, list + *count);
        *count += list_fragments(next->body, parts->other[i], common, list + *count);
    }
    if (*count > 0) *count = sort_once(list, *count);
    return list;
}

static bool find_changes(const pliant_warp *warp, pliant_warp_next *next)
{
    pliant_warp_changes *changes = &next->changes;
    const int32_t common = changes->common;
    if (!(changes->rebuilt = list_doubtful(warp, next, &changes->num_rebuilt))) return false;
    int32_t kept = 0;
    for (int32_t i = 0; i < changes->num_rebuilt; i++)
        if (differs(warp, next, changes->rebuilt[i])) changes->rebuilt[kept++] = changes->rebuilt[i];
    changes->num_rebuilt = kept;
    for (int32_t e = common; e < changes->now; e++) changes->from[e - common] = -1;
    carry_carried_tets(warp, next);
    if (!(changes->removed =
              pliant_calloc((size_t)kept + (size_t)(changes->before - common) + 1, sizeof *changes->removed)))
        return false;
    memcpy(changes->removed, changes->rebuilt, (size_t)kept * sizeof *changes->removed);
    changes->num_removed = kept;
    for (int32_t e = common; e < changes->before; e++)
        if (!next->still_exists[e - common]) changes->removed[changes->num_removed++] = e;
    return true;
}

static bool allocate(const pliant_warp *warp, pliant_warp_next *next)
{
    const size_t carried_tets = next->parts ? (size_t)next->parts->num_carried_tets : 0,
                 elements = (size_t)next->mesh->num_tets + carried_tets;
    const int32_t common = warp->mesh->num_tets < next->mesh->num_tets ? warp->mesh->num_tets : next->mesh->num_tets;
    next->changes = (pliant_warp_changes){.before = warp->num_elements, .now = (int32_t)elements, .common = common};
    next->carried_tet_fixed = pliant_calloc(carried_tets + 1, 12 * sizeof *next->carried_tet_fixed);
    next->carried_tet_tets = pliant_calloc(carried_tets + 1, sizeof *next->carried_tet_tets);
    next->changes.from = pliant_calloc(elements - (size_t)common + 1, sizeof *next->changes.from);
    next->still_exists = pliant_calloc((size_t)(warp->num_elements - common) + 1, sizeof *next->still_exists);
    return next->carried_tet_fixed && next->carried_tet_tets && next->changes.from && next->still_exists;
}

static void find_rest(const pliant_warp *warp, const pliant_mesh *mesh, int32_t node, double *rest)
{
    pliant_geometry_to_index(&warp->scan, mesh->rest + 3 * (size_t)node, rest + 3 * (size_t)node);
}

/* Prepare the device. A failure or a lack of memory of the device must not prevent a cut. */
static pliant_status prepare_device(pliant_warp *warp, pliant_warp_next *next)
{
    const int32_t known = next->load_nodes < warp->mesh->num_nodes ? next->load_nodes : warp->mesh->num_nodes;
    double *rest = pliant_malloc((size_t)next->mesh->num_nodes, 3 * sizeof *rest);
    if (!rest) return pliant_fail_memory("the warp");
    memcpy(rest, warp->rest, 3 * (size_t)known * sizeof *rest);
    for (int32_t n = known; n < next->mesh->num_nodes; n++) find_rest(warp, next->mesh, n, rest);
    pliant_warp_parts parts = pliant_warp_device_parts(warp);
    parts.mesh = next->mesh;
    parts.rest = rest;
    parts.parts = next->parts;
    parts.num_same_rest = known;
    if (next->fit) parts.fit = pliant_fit_parts(next->fit);
    next->device = warp->device;
    next->device_lost =
        warp->device->prepare(warp->accelerated, &parts, &next->changes, &next->device_next) != PLIANT_OK;
    pliant_free(rest);
    return PLIANT_OK;
}

static pliant_status prepare_fit(const pliant_warp *warp, pliant_warp_next *next)
{
    const double *rest = next->longer[0] ? next->longer[0] : warp->rest;
    return pliant_fit_next(warp->fit, next->body, next->parts, rest, &next->fit);
}

pliant_status pliant_warp_prepare(pliant_warp *warp, const pliant_body *body, pliant_warp_next **out)
{
    pliant_status status = check(warp, body);
    if (status != PLIANT_OK) return status;
    pliant_warp_next *next = pliant_calloc(1, sizeof *next);
    if (!next) return pliant_fail_memory("the warp");
    next->mesh = &body->fine;
    next->load_nodes = body->voxels ? body->voxels->num_nodes : 0;
    next->body = body;
    status =
        pliant_parts_create(body, &warp->scan, warp->body, warp->parts, warp->hosts, warp->num_threads, &next->parts);
    if (status == PLIANT_OK && warp->fit && !next->parts) status = pliant_parts_whole(body, &warp->scan, &next->parts);
    if (status == PLIANT_OK && (!allocate(warp, next) ||
                                !reserve_capacity(warp, (size_t)body->fine.num_nodes, (size_t)next->changes.now, next)))
        status = pliant_fail_memory("the warp");
    if (status == PLIANT_OK && !find_changes(warp, next)) status = pliant_fail_memory("the warp");
    if (status == PLIANT_OK && warp->fit) status = prepare_fit(warp, next);
    if (status == PLIANT_OK && warp->accelerated) status = prepare_device(warp, next);
    if (status != PLIANT_OK) {
        pliant_warp_next_free(next);
        return status;
    }
    *out = next;
    return PLIANT_OK;
}

static void swap(void *a, void *b)
{
    void *one, *other;
    memcpy(&one, a, sizeof one);
    memcpy(&other, b, sizeof other);
    memcpy(a, &other, sizeof other);
    memcpy(b, &one, sizeof one);
}

static void switch_to_cpu(pliant_warp *warp)
{
    pliant_warp_volume(warp); /* keep the last drawn volume, if available, until the next update */
    pliant_warp_fall_back(warp);
}

void pliant_warp_take(pliant_warp *warp, pliant_warp_next *next)
{
    if (next->device_lost) switch_to_cpu(warp);
    const pliant_mesh *mesh = next->mesh;
    const int32_t carried_tets = next->changes.now - mesh->num_tets;
    const pliant_warp_changes *changes = &next->changes;
    for (int32_t i = 0; i < changes->num_removed; i++) pliant_warp_remove_from_bricks(warp, changes->removed[i]);
    take_capacity(warp, next);
    for (int32_t n = next->load_nodes; n < mesh->num_nodes; n++) {
        if (!is_new(warp, next, n)) continue;
        find_rest(warp, mesh, n, warp->rest);
        for (int d = 0; d < 3; d++) warp->fixed[3 * n + d] = no_position;
    }
    /* in addition to elements already marked, if there was no update since */
    for (int32_t i = 0; i < changes->num_rebuilt; i++) warp->rebuilt[changes->rebuilt[i]] = 1;
    for (int32_t e = changes->common; e < changes->now; e++)
        warp->rebuilt[e] = changes->from[e - changes->common] < 0 || (e < mesh->num_tets && warp->rebuilt[e]);
    for (int32_t t = warp->mesh->num_tets; t < mesh->num_tets; t++) memset(&warp->tets[t], 0, sizeof warp->tets[t]);
    memcpy(warp->tets + mesh->num_tets, next->carried_tet_tets, (size_t)carried_tets * sizeof *warp->tets);
    warp->mesh = mesh;
    warp->body = next->body;
    warp->num_elements = next->changes.now;
    warp->has_new_body = true;
    swap(&warp->parts, &next->parts);
    swap(&warp->carried_tet_fixed, &next->carried_tet_fixed);
    if (next->fit) swap(&warp->fit, &next->fit);
    if (next->device_next) warp->device->take(warp->accelerated, next->device_next);
}

pliant_status pliant_warp_expect_cuts(pliant_warp *warp, const pliant_body *body)
{
    if (!body->voxels || memcmp(body->voxels->geometry.size, warp->scan.size, sizeof warp->scan.size) != 0)
        return PLIANT_OK;
    if (!warp->hosts) {
        pliant_status status = pliant_part_hosts_create(body, &warp->scan, &warp->hosts);
        if (status != PLIANT_OK) return status;
    }
    pliant_warp_next *larger = pliant_calloc(1, sizeof *larger);
    const bool made =
        larger && reserve_capacity(warp, (size_t)warp->mesh->num_nodes + 1, (size_t)warp->num_elements + 1, larger);
    if (made) take_capacity(warp, larger);
    pliant_warp_next_free(larger);
    return made ? PLIANT_OK : pliant_fail_memory("the warp");
}

pliant_status pliant_warp_set_body(pliant_warp *warp, const pliant_body *body)
{
    pliant_warp_next *next = NULL;
    pliant_status status = pliant_warp_prepare(warp, body, &next);
    if (status == PLIANT_OK) pliant_warp_take(warp, next);
    pliant_warp_next_free(next);
    return status;
}
