#include "fem/coarse/shape_functions.h"

#include "base/fail.h"
#include "base/memory.h"

#include <math.h>
#include <string.h>

static pliant_status no_memory(void) { return pliant_fail_memory("the shape functions"); }

pliant_status pliant_shapes_of(const pliant_submesh *submesh, int corners, pliant_shapes *out)
{
    const size_t count = (size_t)submesh->num_nodes;
    out->count = submesh->num_nodes;
    out->node = pliant_calloc(count, sizeof *out->node);
    out->shape = pliant_calloc(count, 9 * (size_t)corners * sizeof *out->shape);
    if (!out->node || !out->shape) return no_memory();
    memcpy(out->node, submesh->node, count * sizeof *out->node);
    return PLIANT_OK;
}

void pliant_shapes_free(pliant_shapes *lists, int32_t count)
{
    for (int32_t c = 0; lists && c < count; c++) {
        pliant_free(lists[c].node);
        pliant_free(lists[c].shape);
    }
    pliant_free(lists);
}

static int corners_of(const pliant_system *system, int32_t element)
{
    return pliant_element_begin(system, element + 1) - pliant_element_begin(system, element);
}

static void centre_of(const pliant_system *system, int32_t element, double centre[3])
{
    const int corners = corners_of(system, element);
    const int32_t *node = pliant_element_nodes(system) + pliant_element_begin(system, element);
    for (int d = 0; d < 3; d++) centre[d] = 0;
    for (int v = 0; v < corners; v++)
        for (int d = 0; d < 3; d++) centre[d] += system->mesh->rest[3 * node[v] + d] / corners;
}

static pliant_status reserve_capacity(pliant_system *system, int corners, const pliant_shapes *lists, int32_t elements)
{
    const size_t nodes = (size_t)system->fine->num_nodes;
    pliant_upsample *upsample = system->upsample = pliant_calloc(1, sizeof *upsample);
    if (!upsample || !(upsample->start = pliant_calloc(nodes + 2, sizeof *upsample->start))) return no_memory();
    upsample->corners = corners;
    for (int32_t c = 0; c < elements; c++)
        for (int32_t e = 0; e < lists[c].count; e++) upsample->start[lists[c].node[e] + 2]++;
    for (size_t n = 0; n < nodes; n++) upsample->start[n + 2] += upsample->start[n + 1];
    const size_t total = (size_t)upsample->start[nodes + 1];
    upsample->entry_element = pliant_calloc(total, sizeof *upsample->entry_element);
    upsample->entry_weight = pliant_calloc(total, sizeof *upsample->entry_weight);
    upsample->entry_shape = pliant_calloc(total, 9 * (size_t)corners * sizeof *upsample->entry_shape);
    return upsample->entry_element && upsample->entry_weight && upsample->entry_shape ? PLIANT_OK : no_memory();
}

/* The weights are inverse distances to the centroids. A node may be at a centroid, so the distance is clamped. */
pliant_status pliant_shapes_sort(pliant_system *system, int corners, const pliant_shapes *lists)
{
    const pliant_mesh *fine = system->fine;
    const int32_t elements = pliant_element_count(system);
    const size_t each = 9 * (size_t)corners;
    pliant_status status = reserve_capacity(system, corners, lists, elements);
    if (status != PLIANT_OK) return status;
    pliant_upsample *upsample = system->upsample;
    const double nearest = 1e-3 * fine->cell_size[0];
    for (int32_t c = 0; c < elements; c++) {
        const size_t own = 9 * (size_t)corners_of(system, c);
        double centre[3];
        centre_of(system, c, centre);
        for (int32_t e = 0; e < lists[c].count; e++) {
            int32_t node = lists[c].node[e], at = upsample->start[node + 1]++;
            const double *x = fine->rest + 3 * node;
            double distance = hypot(hypot(x[0] - centre[0], x[1] - centre[1]), x[2] - centre[2]);
            upsample->entry_element[at] = c;
            upsample->entry_weight[at] = 1 / fmax(distance, nearest);
            memcpy(upsample->entry_shape + each * (size_t)at, lists[c].shape + own * (size_t)e, own * sizeof(double));
        }
    }
    for (int32_t n = 0; n < fine->num_nodes; n++) {
        double sum = 0;
        for (int32_t e = upsample->start[n]; e < upsample->start[n + 1]; e++) sum += upsample->entry_weight[e];
        for (int32_t e = upsample->start[n]; e < upsample->start[n + 1]; e++) upsample->entry_weight[e] /= sum;
    }
    return PLIANT_OK;
}
