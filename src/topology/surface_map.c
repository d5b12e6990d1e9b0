/* Hash table of surface points, by nodes and weights. */
#include "base/buffer.h"
#include "base/fail.h"
#include "topology/surface.h"
#include "base/memory.h"

#include <string.h>

enum { FIRST_SLOTS = 1024 };

pliant_status pliant_surface_no_memory(void) { return pliant_fail_memory("the surface of the cut mesh"); }

void *pliant_surface_add(surface_list *list)
{
    if (list->count == list->capacity) {
        const size_t capacity = list->capacity > 0 ? 2 * list->capacity : 64;
        if (!pliant_grow(&list->at, capacity, list->size)) return NULL;
        list->capacity = capacity;
    }
    return (char *)list->at + list->count++ * list->size;
}

void pliant_surface_key_of(const int32_t node[4], const int32_t weight[4], surface_key *out)
{
    int count = 0;
    *out = (surface_key){{0}, {0}};
    for (int v = 0; v < 4; v++) {
        if (weight[v] == 0) continue;
        int at = count++;
        for (; at > 0 && out->node[at - 1] > node[v]; at--) {
            out->node[at] = out->node[at - 1];
            out->weight[at] = out->weight[at - 1];
        }
        out->node[at] = node[v];
        out->weight[at] = weight[v];
    }
}

static uint32_t hash_of(const surface_key *key)
{
    uint64_t hash = 0;
    for (int v = 0; v < 4; v++) {
        hash = (hash ^ (uint32_t)key->node[v]) * 0x9e3779b97f4a7c15u;
        hash = (hash ^ (hash >> 29) ^ (uint32_t)key->weight[v]) * 0xbf58476d1ce4e5b9u;
    }
    return (uint32_t)(hash >> 32);
}

static void put(surface_map *map, int32_t number)
{
    uint32_t at = hash_of(map->key + number) & (uint32_t)(map->num_slots - 1);
    while (map->slot[at]) at = (at + 1) & (uint32_t)(map->num_slots - 1);
    map->slot[at] = number + 1;
}

static bool grow(surface_map *map)
{
    const int32_t slots = map->num_slots > 0 ? 2 * map->num_slots : FIRST_SLOTS;
    int32_t *slot = pliant_calloc((size_t)slots, sizeof *slot);
    if (!slot || !pliant_grow(&map->key, (size_t)slots / 2, sizeof *map->key)) {
        pliant_free(slot);
        return false;
    }
    pliant_free(map->slot);
    map->slot = slot;
    map->num_slots = slots;
    map->capacity = slots / 2;
    for (int32_t n = 0; n < map->count; n++) put(map, n);
    return true;
}

int32_t pliant_surface_number(surface_map *map, const surface_key *key)
{
    if (map->count == map->capacity && !grow(map)) return -1;
    uint32_t at = hash_of(key) & (uint32_t)(map->num_slots - 1);
    for (; map->slot[at]; at = (at + 1) & (uint32_t)(map->num_slots - 1))
        if (memcmp(map->key + map->slot[at] - 1, key, sizeof *key) == 0) return map->slot[at] - 1;
    map->key[map->count] = *key;
    map->slot[at] = ++map->count;
    return map->count - 1;
}

void pliant_surface_map_clear(surface_map *map)
{
    map->count = 0;
    if (map->slot) memset(map->slot, 0, (size_t)map->num_slots * sizeof *map->slot);
}

void pliant_surface_map_free(surface_map *map)
{
    pliant_free(map->key);
    pliant_free(map->slot);
}
