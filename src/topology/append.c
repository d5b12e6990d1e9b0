/* Append copies of elements to a body under construction. */
#include "topology/divide.h"

#include "base/fail.h"
#include "base/memory.h"

#include <string.h>

pliant_status pliant_body_append(void *list, size_t size, int32_t count, int32_t appended, const int32_t *source)
{
    char *old;
    memcpy(&old, list, sizeof old);
    if (!old || appended == 0) return PLIANT_OK;
    char *made = pliant_resize(old, (size_t)count + (size_t)appended, size);
    if (!made) return pliant_fail_memory("the next body");
    for (int32_t i = 0; i < appended; i++)
        memcpy(made + size * (size_t)(count + i), made + size * (size_t)source[i], size);
    memcpy(list, &made, sizeof made);
    return PLIANT_OK;
}

pliant_status pliant_body_append_parents(int32_t **parent, int32_t count, int32_t appended, const int32_t *source)
{
    if (appended == 0) return PLIANT_OK;
    if (!*parent) {
        if (!(*parent = pliant_calloc((size_t)count, sizeof **parent))) return pliant_fail_memory("the next body");
        for (int32_t i = 0; i < count; i++) (*parent)[i] = i;
    }
    return pliant_body_append(parent, sizeof **parent, count, appended, source);
}

pliant_status pliant_body_append_nodes(pliant_body *next, int32_t appended, const int32_t *source)
{
    pliant_mesh *fine = &next->fine;
    pliant_body_changes *changes = &next->changes;
    int32_t before = fine->num_nodes, *sources = NULL;
    pliant_status status = pliant_body_append_parents(&next->node_parent, before, appended, source);
    if (status == PLIANT_OK) status = pliant_body_append(&fine->rest, 3 * sizeof *fine->rest, before, appended, source);
    if (status == PLIANT_OK)
        status = pliant_body_append(&fine->lattice_of_node, sizeof *fine->lattice_of_node, before, appended, source);
    if (status == PLIANT_OK)
        status = pliant_body_append(&fine->place_of_node, sizeof *fine->place_of_node, before, appended, source);
    if (status == PLIANT_OK)
        status = pliant_body_append(&next->fine_fixed, sizeof *next->fine_fixed, before, appended, source);
    if (status == PLIANT_OK)
        status = pliant_body_append(&next->node_mass, sizeof *next->node_mass, before, appended, source);
    if (status == PLIANT_OK && next->subdivision)
        status = pliant_subdivision_append(next->subdivision, before, appended, source);
    if (status != PLIANT_OK || appended == 0) return status;
    const int32_t already = before - changes->nodes_before;
    if (!(sources = pliant_resize(changes->node_source, (size_t)(already + appended), sizeof *sources)))
        return pliant_fail_memory("the next body");
    changes->node_source = sources;
    for (int32_t n = 0; n < appended; n++)
        sources[already + n] =
            source[n] < changes->nodes_before ? source[n] : sources[source[n] - changes->nodes_before];
    fine->num_nodes = before + appended;
    return PLIANT_OK;
}
