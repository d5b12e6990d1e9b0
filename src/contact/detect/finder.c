/* Buffers of the search for contacts, and lists of contact points. */
#include "contact/detect/finder.h"

#include "base/fail.h"
#include "base/room.h"
#include "base/memory.h"

#include <string.h>

pliant_status pliant_finder_create(const pliant_contact_settings *settings, pliant_finder **out)
{
    *out = pliant_calloc(1, sizeof **out);
    if (!*out) return pliant_fail_memory("contacts");
    (*out)->settings = settings ? *settings : pliant_contact_settings_default();
    return PLIANT_OK;
}

void pliant_finder_free(pliant_finder *finder)
{
    if (!finder) return;
    pliant_broad_free(&finder->broad);
    pliant_free(finder->triangle);
    pliant_free(finder->face);
    pliant_free(finder->edge);
    pliant_free(finder->node);
    pliant_free(finder->edge_of);
    pliant_free(finder->order);
    pliant_free(finder->slot);
    pliant_free(finder);
}

pliant_status pliant_contacts_reserve(pliant_contacts *contacts, int32_t room)
{
    if (room <= contacts->room) return PLIANT_OK;
    room += room / 2;
    if (!pliant_grow(&contacts->point, (size_t)room, sizeof *contacts->point)) return pliant_fail_memory("contacts");
    contacts->room = room;
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

pliant_status pliant_finder_room(pliant_finder *finder, const pliant_body *body)
{
    const size_t triangles = (size_t)finder->broad.num_near, nodes = (size_t)body->fine.num_nodes;
    if (body->fine.num_nodes > finder->room_nodes) {
        if (!pliant_grow(&finder->slot, nodes, sizeof *finder->slot)) return pliant_fail_memory("contacts");
        finder->room_nodes = body->fine.num_nodes;
    }
    if (finder->broad.num_near <= finder->room_triangles) return PLIANT_OK;
    if (!pliant_grow(&finder->triangle, triangles, sizeof *finder->triangle) ||
        !pliant_grow(&finder->face, triangles, sizeof *finder->face) ||
        !pliant_grow(&finder->edge, 3 * triangles, sizeof *finder->edge) ||
        !pliant_grow(&finder->node, 3 * triangles, sizeof *finder->node) ||
        !pliant_grow(&finder->edge_of, 3 * triangles, sizeof *finder->edge_of) ||
        !pliant_grow(&finder->order, 3 * triangles, sizeof *finder->order))
        return pliant_fail_memory("contacts");
    finder->room_triangles = finder->broad.num_near;
    return PLIANT_OK;
}
