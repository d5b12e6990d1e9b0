/* Severed links and the resulting fragments. Each body has its own copy, except of the fragment of each voxel, which
 * bodies share because most of it stays equal. */
#include "base/fail.h"
#include "base/buffer.h"
#include "topology/links.h"
#include "base/memory.h"

#include <stdatomic.h>
#include <string.h>

/* A new pool is larger than requested, by an eighth and this number of voxels. */
enum { SPARE_VOXELS = 1 << 17 };

/* A request returns unused capacity, because several threads may cut a body, and more than once. */
struct pliant_cuts_pool {
    atomic_int holders;
    atomic_size_t used;
    size_t capacity;
    int32_t *voxel;
};

static void release(struct pliant_cuts_pool *pool)
{
    if (!pool || atomic_fetch_sub_explicit(&pool->holders, 1, memory_order_acq_rel) != 1) return;
    pliant_free(pool->voxel);
    pliant_free(pool);
}

static void hold(struct pliant_cuts_pool *pool, pliant_cuts *cuts)
{
    if (!pool) return;
    atomic_fetch_add_explicit(&pool->holders, 1, memory_order_relaxed);
    cuts->pool = pool;
    cuts->voxel_fragment = pool->voxel;
}

/* Return false if the pool is full; it then stays full. */
static bool take(struct pliant_cuts_pool *pool, size_t more, int32_t *first)
{
    size_t used = atomic_load(&pool->used);
    while (more <= pool->capacity - used)
        if (atomic_compare_exchange_weak(&pool->used, &used, used + more)) {
            *first = (int32_t)used;
            return true;
        }
    return false;
}

pliant_status pliant_cuts_reserve(const pliant_cuts *cuts, size_t kept, size_t more, pliant_cuts *next, int32_t *first)
{
    if (cuts && cuts->pool && take(cuts->pool, more, first)) {
        hold(cuts->pool, next);
        return PLIANT_OK;
    }
    const size_t capacity = kept + more + (kept + more) / 8 + SPARE_VOXELS;
    struct pliant_cuts_pool *pool = pliant_calloc(1, sizeof *pool);
    if (!pool || capacity > INT32_MAX || !(pool->voxel = pliant_calloc(capacity, sizeof *pool->voxel))) {
        pliant_free(pool);
        return pliant_fail_memory("the fragments");
    }
    atomic_init(&pool->holders, 1);
    atomic_init(&pool->used, kept + more);
    pool->capacity = capacity;
    next->pool = pool;
    next->voxel_fragment = pool->voxel;
    *first = 0;
    return PLIANT_OK;
}

void pliant_cuts_free(pliant_cuts *cuts)
{
    if (!cuts) return;
    PLIANT_FREE(cuts->link, cuts->bridge, cuts->tet, cuts->start, cuts->fragment, cuts->voxel_start);
    release(cuts->pool);
    PLIANT_FREE(cuts->chip, cuts->join, cuts->cut_end, cuts->stroke, cuts->severed, cuts);
}

static bool copy(const void *from, size_t count, size_t size, void *to)
{
    void *made = pliant_copy_block(from, count, size);
    if (made) memcpy(to, &made, sizeof made);
    return made != NULL;
}

pliant_status pliant_cuts_copy(const pliant_cuts *from, pliant_cuts **out)
{
    pliant_cuts *to = pliant_calloc(1, sizeof *to);
    if (!to) return pliant_fail_memory("the cuts of the mesh");
    to->num_links = from->num_links;
    to->num_bridges = from->num_bridges;
    to->num_tets = from->num_tets;
    to->num_chips = from->num_chips;
    to->num_joins = from->num_joins;
    to->num_cuts = from->num_cuts;
    const size_t severed = from->num_cuts > 0 ? (size_t)from->cut_end[from->num_cuts - 1] : 0;
    to->num_pieces = from->num_pieces;
    hold(from->pool, to);
    const size_t tets = (size_t)from->num_tets, one = sizeof(int32_t);
    if (!copy(from->link, (size_t)from->num_links, sizeof *to->link, &to->link) ||
        !copy(from->bridge, (size_t)from->num_bridges, one, &to->bridge) || !copy(from->tet, tets, one, &to->tet) ||
        !copy(from->start, tets + 1, one, &to->start) ||
        !copy(from->fragment, (size_t)from->start[tets], one, &to->fragment) ||
        !copy(from->voxel_start, tets, one, &to->voxel_start) ||
        !copy(from->cut_end, (size_t)from->num_cuts, one, &to->cut_end) ||
        !copy(from->stroke, (size_t)from->num_cuts, 2 * sizeof *to->stroke, &to->stroke) ||
        !copy(from->severed, severed, sizeof *to->severed, &to->severed) ||
        !copy(from->chip, (size_t)from->num_chips, 2 * one, &to->chip) ||
        !copy(from->join, (size_t)from->num_joins, 2 * one, &to->join)) {
        pliant_cuts_free(to);
        return pliant_fail_memory("the cuts of the mesh");
    }
    *out = to;
    return PLIANT_OK;
}
