/* Buffers of the search for contacts, and lists of contact points. */
#include "contact/detect/detector.h"

#include "base/fail.h"
#include "base/buffer.h"
#include "base/memory.h"

#include <string.h>

pliant_status pliant_contact_detector_create(const pliant_contact_settings *settings, pliant_contact_detector **out)
{
    *out = pliant_calloc(1, sizeof **out);
    if (!*out) return pliant_fail_memory("contacts");
    (*out)->settings = settings ? *settings : pliant_contact_settings_default();
    return PLIANT_OK;
}

void pliant_contact_detector_free(pliant_contact_detector *detector)
{
    if (!detector) return;
    pliant_broad_free(&detector->broad);
    PLIANT_FREE(detector->triangle, detector->face, detector->edge, detector->node, detector->edge_of, detector->slot,
                detector);
}

void pliant_contact_detector_set_finder(pliant_contact_detector *detector, const pliant_near_finder *finder)
{
    detector->finder = finder;
}

pliant_status pliant_contacts_reserve(pliant_contacts *contacts, int32_t capacity)
{
    if (capacity <= contacts->capacity) return PLIANT_OK;
    capacity += capacity / 2;
    if (!pliant_grow(&contacts->point, (size_t)capacity, sizeof *contacts->point))
        return pliant_fail_memory("contacts");
    contacts->capacity = capacity;
    return PLIANT_OK;
}

pliant_status pliant_contacts_copy(const pliant_contacts *from, pliant_contacts *to)
{
    pliant_status status = pliant_contacts_reserve(to, from->count);
    if (status != PLIANT_OK) return status;
    if (from->count > 0) memcpy(to->point, from->point, (size_t)from->count * sizeof *to->point);
    to->count = from->count;
    return PLIANT_OK;
}

/* Slots always have a value, which may belong to another part or topology. */
static bool reserve_slots(pliant_contact_detector *detector, int32_t nodes)
{
    const int32_t more = nodes - detector->num_slots;
    if (more <= 0) return true;
    if (!pliant_grow(&detector->slot, (size_t)nodes, sizeof *detector->slot)) return false;
    memset(detector->slot + detector->num_slots, 0, (size_t)more * sizeof *detector->slot);
    detector->num_slots = nodes;
    return true;
}

pliant_status pliant_contact_detector_reserve(pliant_contact_detector *detector, const pliant_body *body)
{
    const size_t triangles = (size_t)detector->broad.num_near;
    return reserve_slots(detector, body->fine.num_nodes) &&
                   pliant_ensure(&detector->triangle, triangles, sizeof *detector->triangle) &&
                   pliant_ensure(&detector->face, triangles, sizeof *detector->face) &&
                   pliant_ensure(&detector->edge, 3 * triangles, sizeof *detector->edge) &&
                   pliant_ensure(&detector->node, 3 * triangles, sizeof *detector->node) &&
                   pliant_ensure(&detector->edge_of, 3 * triangles, sizeof *detector->edge_of)
               ? PLIANT_OK
               : pliant_fail_memory("contacts");
}
