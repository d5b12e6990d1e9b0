/* What a search for contacts keeps from step to step. */
#include "contact/detect/finder.h"

#include "base/fail.h"
#include "base/room.h"
#include "pliant/memory.h"

#include <stdlib.h>
#include <string.h>

pliant_status pliant_finder_create(pliant_finder **out)
{
    *out = pliant_calloc(1, sizeof **out);
    return *out ? PLIANT_OK : pliant_fail_memory("contacts");
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
    pliant_free(finder->sides);
    pliant_free(finder->next);
    pliant_free(finder->kept);
    pliant_free(finder->keep);
    pliant_free(finder);
}

void pliant_finder_forget(pliant_finder *finder)
{
    finder->num_sides = finder->num_kept = 0;
    finder->more = false;
    finder->broad.knows_last = false;
}

/* Of a node that presses, the side is that by which it does: what is merely near says nothing that would count against it. */
static void tell_sides(pliant_finder *finder, const pliant_kept_point *kept)
{
    for (int32_t k = 0; k < kept->count && finder->num_sides > 0; k++) {
        const uint64_t key = pliant_side_key(kept->feature >> 56, kept->node[k]);
        pliant_side *side = bsearch(&key, finder->sides, (size_t)finder->num_sides, sizeof *side, pliant_compare_keys);
        if (!side) continue;
        for (int d = 0; d < 3; d++) side->normal[d] = (side->pressed ? side->normal[d] : 0) + kept->normal[d];
        side->pressed = true;
    }
}

void pliant_finder_tell(pliant_finder *finder, const pliant_contacts *contacts)
{
    int32_t c = 0;
    for (int32_t k = 0; k < finder->num_kept; k++) {
        while (c < contacts->count && contacts->point[c].feature < finder->kept[k].feature) c++;
        finder->kept[k].pressed = c < contacts->count && contacts->point[c].feature == finder->kept[k].feature && contacts->point[c].begun;
        if (finder->kept[k].pressed) tell_sides(finder, finder->kept + k);
    }
}

pliant_status pliant_finder_copy(const pliant_finder *from, pliant_finder *to)
{
    if (from->num_sides > to->room_sides) {
        if (!pliant_grow(&to->sides, (size_t)from->num_sides, sizeof *to->sides)) return pliant_fail_memory("contacts");
        to->room_sides = from->num_sides;
    }
    if (from->num_kept > to->room_kept) {
        if (!pliant_grow(&to->kept, (size_t)from->num_kept, sizeof *to->kept)) return pliant_fail_memory("contacts");
        to->room_kept = from->num_kept;
    }
    pliant_status status = pliant_broad_copy(&from->broad, &to->broad);
    if (status != PLIANT_OK) return status;
    if (from->num_sides > 0) memcpy(to->sides, from->sides, (size_t)from->num_sides * sizeof *to->sides);
    to->num_sides = from->num_sides;
    if (from->num_kept > 0) memcpy(to->kept, from->kept, (size_t)from->num_kept * sizeof *to->kept);
    to->num_kept = from->num_kept;
    to->more = false;
    return PLIANT_OK;
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
    if (!pliant_grow(&finder->triangle, triangles, sizeof *finder->triangle) || !pliant_grow(&finder->face, triangles, sizeof *finder->face) ||
        !pliant_grow(&finder->edge, 3 * triangles, sizeof *finder->edge) || !pliant_grow(&finder->node, 3 * triangles, sizeof *finder->node) ||
        !pliant_grow(&finder->edge_of, 3 * triangles, sizeof *finder->edge_of) || !pliant_grow(&finder->order, 3 * triangles, sizeof *finder->order))
        return pliant_fail_memory("contacts");
    finder->room_triangles = finder->broad.num_near;
    return PLIANT_OK;
}

pliant_status pliant_finder_reserve(pliant_finder *finder, int32_t points, pliant_contacts *out)
{
    pliant_status status = pliant_contacts_reserve(out, out->count + points);
    const int32_t sides = finder->num_next + 3 * points, keep = finder->num_keep + points;
    if (status != PLIANT_OK) return status;
    if (sides > finder->room_next) {
        if (!pliant_grow(&finder->next, (size_t)sides * 2, sizeof *finder->next)) return pliant_fail_memory("contacts");
        finder->room_next = 2 * sides;
    }
    if (keep > finder->room_keep) {
        if (!pliant_grow(&finder->keep, (size_t)keep * 2, sizeof *finder->keep)) return pliant_fail_memory("contacts");
        finder->room_keep = 2 * keep;
    }
    return PLIANT_OK;
}

/* Of sides the mean of what was said of a node. */
void pliant_finder_remember(pliant_finder *finder)
{
    int32_t left = 0;
    if (finder->num_next > 0) qsort(finder->next, (size_t)finder->num_next, sizeof *finder->next, pliant_compare_keys);
    for (int32_t n = 0; n < finder->num_next; n++) {
        if (left > 0 && finder->next[n].key == finder->next[left - 1].key)
            for (int d = 0; d < 3; d++) finder->next[left - 1].normal[d] += finder->next[n].normal[d];
        else finder->next[left++] = finder->next[n];
    }
    pliant_side *sides = finder->sides;
    const int32_t room = finder->room_sides;
    finder->sides = finder->next;
    finder->num_sides = left;
    finder->room_sides = finder->room_next;
    finder->next = sides;
    finder->room_next = room;
    pliant_kept_point *keep = finder->kept;
    const int32_t room_kept = finder->room_kept;
    finder->kept = finder->keep;
    finder->num_kept = finder->num_keep;
    finder->room_kept = finder->room_keep;
    finder->keep = keep;
    finder->room_keep = room_kept;
}

pliant_status pliant_finder_remember_more(pliant_finder *finder, pliant_contacts *out)
{
    const int32_t made = finder->num_keep, kept = finder->num_kept, sides = finder->num_sides;
    pliant_status status = pliant_finder_reserve(finder, finder->num_kept + finder->num_sides, out);
    if (status != PLIANT_OK) return status;
    for (int32_t k = 0; k < finder->num_kept; k++) {
        const uint64_t *key = &finder->kept[k].feature;
        if (made == 0 || !bsearch(key, finder->keep, (size_t)made, sizeof *finder->keep, pliant_compare_keys)) finder->keep[finder->num_keep++] = finder->kept[k];
    }
    for (int32_t k = 0; k < finder->num_sides; k++) finder->next[finder->num_next++] = finder->sides[k];
    if (finder->num_keep > 0) qsort(finder->keep, (size_t)finder->num_keep, sizeof *finder->keep, pliant_compare_keys);
    pliant_finder_remember(finder);
    finder->more = true;
    finder->kept_before = kept;
    finder->sides_before = sides;
    return PLIANT_OK;
}

void pliant_finder_forget_more(pliant_finder *finder)
{
    if (!finder->more) return;
    finder->num_next = finder->num_keep = 0;
    pliant_finder_remember(finder); /* what was known before is still there */
    finder->num_sides = finder->sides_before;
    finder->num_kept = finder->kept_before;
    finder->more = false;
}
