#include "base/memory.h"

#include "base/account.h"
#include "base/buffer.h"

#include <pthread.h>
#include <stdatomic.h>
#include <stdbool.h>
#include <stdlib.h>
#include <string.h>
#include <sys/mman.h>
#include <unistd.h>

/* Header of a block, stored before it in the 64 bytes that the alignment leaves free. */
enum { ALIGNMENT = 64 };

typedef struct header {
    void *base;      /* address returned by the system */
    size_t bytes;    /* requested size */
    size_t capacity; /* capacity */
    bool pages;      /* no other block is on its pages */
    /* Nullable: (pieces of the capacity) stamps of an array with versions. Pieces with equal stamps at the same offset
     * have equal content. */
    _Atomic(uint64_t *) stamp;
    pliant_account *account; /* Nullable: the account of the block */
    atomic_int others;       /* number of additional holders */
} header;

_Static_assert(sizeof(header) <= ALIGNMENT, "a header is in front of its block");

struct pliant_account {
    atomic_size_t bytes, holders; /* bytes of its blocks, and number of holders */
};

/* Minimum size for reuse. Such blocks have up to an eighth more capacity. */
static const size_t large = 1 << 18;

/* The same for versions of arrays, which are compared in pieces. */
static const size_t large_series = 1 << 14;

enum { MAX_KEPT = 128, PIECE = 4096 };

/* Minimum size for large pages, if the system has them. */
static const size_t huge = 1 << 22;

/* Freed blocks, in the order in which they were freed. */
static struct {
    pthread_mutex_t lock;
    int64_t limit; /* [bytes] */
    size_t bytes;
    int count;
    header *block[MAX_KEPT];
} kept = {.lock = PTHREAD_MUTEX_INITIALIZER};

static atomic_size_t in_use, peak;
static _Thread_local int64_t taken; /* [bytes] */
static _Thread_local bool is_background_thread;
static _Thread_local pliant_account *account; /* Nullable: account of the thread's allocations */
static atomic_uint_least64_t last_stamp;
static atomic_llong calls_left = -1;

static int must_fail(void)
{
    long long left = atomic_load(&calls_left);
    while (left >= 0)
        if (atomic_compare_exchange_weak(&calls_left, &left, left - 1)) return left == 0;
    return 0;
}

static void count(const header *block, size_t bytes)
{
    size_t now = atomic_fetch_add(&in_use, bytes) + bytes, old = atomic_load(&peak);
    taken += (int64_t)bytes;
    if (block->account) atomic_fetch_add(&block->account->bytes, bytes);
    while (now > old && !atomic_compare_exchange_weak(&peak, &old, now)) {}
}

static void uncount(const header *block, size_t bytes)
{
    atomic_fetch_sub(&in_use, bytes);
    taken -= (int64_t)bytes;
    if (block->account) atomic_fetch_sub(&block->account->bytes, bytes);
}

/* Set up a block for the caller. All of it counts as in use. */
static void enter(header *block, size_t bytes)
{
    block->bytes = bytes;
    atomic_store_explicit(&block->others, 0, memory_order_relaxed);
    block->account = pliant_account_retain(account);
    count(block, bytes);
}

static header *header_of(const void *block) { return (header *)((char *)(uintptr_t)block - ALIGNMENT); }

static size_t pieces_of(size_t bytes) { return (bytes + PIECE - 1) / PIECE; }

static uint64_t new_stamp(void) { return atomic_fetch_add(&last_stamp, 1) + 1; }

static void return_to_system(header *block)
{
    free(block->stamp);
    free(block->base);
}

/* ---- Kept blocks. */

/* Return the capacity for a size. Large blocks have few sizes, so that they can be reused. With a memory checker,
 * capacities are exact, so that writes behind a block are detected. */
static size_t capacity_for(size_t bytes, bool series)
{
    size_t step = 1;
#ifdef __SANITIZE_ADDRESS__
    return bytes;
#endif
    if (bytes < (series ? large_series : large)) return bytes;
    while (bytes / step >= 16) step *= 2;
    return (bytes + step - 1) / step * step;
}

static header *remove_reserved(int place)
{
    header *block = kept.block[place];
    kept.bytes -= block->capacity;
    kept.count--;
    memmove(kept.block + place, kept.block + place + 1, (size_t)(kept.count - place) * sizeof *kept.block);
    return block;
}

static header *take_reserved(size_t capacity)
{
    header *found = NULL;
    if (capacity < large || is_background_thread) return NULL;
    pthread_mutex_lock(&kept.lock);
    for (int b = kept.count - 1; b >= 0 && !found; b--)
        if (kept.block[b]->capacity == capacity && !kept.block[b]->stamp) found = remove_reserved(b);
    pthread_mutex_unlock(&kept.lock);
    return found;
}

static size_t count_alike(const header *a, const header *b, size_t pieces)
{
    size_t alike = 0;
    for (size_t p = 0; p < pieces; p++) alike += a->stamp[p] == b->stamp[p];
    return alike;
}

/* Take the fitting block that has the most content in common with another one. other: Nullable */
static header *take_alike(const header *other, size_t capacity)
{
    int best = -1;
    size_t maximum = 0;
    pthread_mutex_lock(&kept.lock);
    for (int b = kept.count - 1; b >= 0; b--) {
        if (kept.block[b]->capacity != capacity || !kept.block[b]->stamp) continue;
        const size_t alike =
            other && other->stamp
                ? count_alike(other, kept.block[b], pieces_of(capacity < other->capacity ? capacity : other->capacity))
                : 0;
        if (best >= 0 && alike <= maximum) continue;
        best = b;
        maximum = alike;
    }
    header *found = best < 0 ? NULL : remove_reserved(best);
    pthread_mutex_unlock(&kept.lock);
    return found;
}

/* Free the oldest blocks first. */
static void release_above(int64_t bytes, int blocks)
{
    while (kept.count > 0 && ((int64_t)kept.bytes > bytes || kept.count > blocks)) return_to_system(remove_reserved(0));
}

static bool keep(header *block)
{
    /* The first version of an array may have an unusual size. */
    const bool fits = block->capacity == capacity_for(block->capacity, block->stamp != NULL);
    if (!fits || block->capacity < (block->stamp ? large_series : large) || (is_background_thread && !block->stamp))
        return false;
    pthread_mutex_lock(&kept.lock);
    const bool keeps = (int64_t)block->capacity <= kept.limit / 2;
    if (keeps) {
        release_above(kept.limit - (int64_t)block->capacity, MAX_KEPT - 1);
        kept.block[kept.count++] = block;
        kept.bytes += block->capacity;
    }
    pthread_mutex_unlock(&kept.lock);
    return keeps;
}

void pliant_memory_change_reserve(int64_t bytes)
{
    pthread_mutex_lock(&kept.lock);
    kept.limit += bytes;
    release_above(kept.limit, MAX_KEPT);
    pthread_mutex_unlock(&kept.lock);
}

void pliant_memory_set_background(void) { is_background_thread = true; }
int64_t pliant_memory_thread_bytes(void) { return taken; }

size_t pliant_memory_reserved(void)
{
    pthread_mutex_lock(&kept.lock);
    const size_t bytes = kept.bytes;
    pthread_mutex_unlock(&kept.lock);
    return bytes;
}

/* ---- Blocks. */

/* Allocate a block whose header precedes an aligned address. */
static header *from_system(size_t capacity, size_t alignment)
{
    char *base = calloc(capacity + ALIGNMENT + alignment, 1); /* calloc skips pages that are already clear */
    if (!base) return NULL;
    char *aligned = base + ALIGNMENT + (alignment - ((uintptr_t)base + ALIGNMENT) % alignment) % alignment;
    header *block = header_of(aligned);
    block->base = base;
    block->capacity = capacity;
    return block;
}

/* Request pages for a new block: large pages, and immediately if the block will be written completely. A page fault for
 * each page costs more than writing the page. */
static void find_pages(const header *block, bool written)
{
    const uintptr_t page = (uintptr_t)sysconf(_SC_PAGESIZE), begin = ((uintptr_t)block->base + page - 1) / page * page;
    const uintptr_t end = ((uintptr_t)block + ALIGNMENT + block->capacity) / page * page;
    if (begin >= end) return;
    if (block->capacity >= huge)
        madvise((void *)begin, end - begin, MADV_HUGEPAGE); /* advice that the system may ignore */
#ifdef MADV_POPULATE_WRITE
    if (written) madvise((void *)begin, end - begin, MADV_POPULATE_WRITE);
#else
    (void)written;
#endif
}

static bool may_be(size_t number, size_t size)
{
    return number > 0 && size > 0 && number <= (SIZE_MAX / 2 - 2 * ALIGNMENT) / size && !must_fail();
}

static void *allocate(size_t bytes, bool clear)
{
    const size_t capacity = capacity_for(bytes, false);
    header *block = take_reserved(capacity);
    if (block && clear) memset((char *)block + ALIGNMENT, 0, bytes);
    if (!block) {
        if (!(block = from_system(capacity, ALIGNMENT))) return NULL;
        if (capacity >= large) find_pages(block, !clear);
    }
    enter(block, bytes);
    return (char *)block + ALIGNMENT;
}

void *pliant_calloc(size_t number, size_t size) { return may_be(number, size) ? allocate(number * size, true) : NULL; }

void *pliant_calloc_pages(size_t number, size_t size)
{
#ifdef __SANITIZE_ADDRESS__
    return pliant_calloc(number, size); /* exact size, so that writes behind it are detected */
#endif
    const size_t page = (size_t)sysconf(_SC_PAGESIZE);
    if (!may_be(number, size)) return NULL;
    header *block = from_system((number * size + page - 1) / page * page, page);
    if (!block) return NULL;
    block->pages = true;
    enter(block, number * size);
    return (char *)block + ALIGNMENT;
}

bool pliant_is_on_own_pages(const void *block) { return ((const header *)((const char *)block - ALIGNMENT))->pages; }

void *pliant_malloc(size_t number, size_t size) { return may_be(number, size) ? allocate(number * size, false) : NULL; }

void *pliant_copy_block(const void *from, size_t number, size_t size)
{
    if (number == 0) return pliant_calloc(1, size);
    void *made = pliant_malloc(number, size);
    if (made) memcpy(made, from, number * size);
    return made;
}

/* ---- Versions of an array. */

static void stamp_new_versions(header *block, size_t from, size_t to)
{
    const uint64_t stamp = new_stamp();
    for (size_t p = from / PIECE; p < pieces_of(to); p++) block->stamp[p] = stamp;
}

/* Stamp the first version of an array, such as an array from load time, which other threads may read. Later versions
 * then share its stamps. Without memory for stamps, the content is copied once more. */
static void create_stamps(header *block)
{
    uint64_t *none = NULL, *made = block->stamp || block->bytes < large_series
                                       ? NULL
                                       : calloc(pieces_of(block->capacity), sizeof *made);
    if (!made) return;
    for (size_t p = 0; p < pieces_of(block->capacity); p++) made[p] = new_stamp();
    if (!atomic_compare_exchange_strong(&block->stamp, &none, made)) free(made);
}

/* Copy the first bytes of another block, limited to pieces that differ, and clear the rest. */
static void copy_differing_pieces(header *block, const header *from, size_t kept_bytes)
{
    char *to = (char *)block + ALIGNMENT;
    const char *of = (const char *)from + ALIGNMENT;
    const bool all = kept_bytes == from->bytes;
    for (size_t p = 0; p < pieces_of(kept_bytes); p++) {
        const size_t first = p * PIECE, last = first + PIECE < kept_bytes ? first + PIECE : kept_bytes;
        const uint64_t stamp = from->stamp && (all || last - first == PIECE) ? from->stamp[p] : 0;
        if (stamp > 0 && block->stamp[p] == stamp) continue;
        memcpy(to + first, of + first, last - first);
        block->stamp[p] = stamp > 0 ? stamp : new_stamp();
    }
    if (block->bytes == kept_bytes) return;
    memset(to + kept_bytes, 0, block->bytes - kept_bytes);
    stamp_new_versions(block, kept_bytes, block->bytes);
}

static void *next_of(header *from, size_t kept_bytes, size_t bytes)
{
    const size_t capacity = capacity_for(bytes, true);
    create_stamps(from);
    header *block = take_alike(from, capacity);
    if (!block) {
        if (!(block = from_system(capacity, ALIGNMENT))) return NULL;
        if (must_fail() || !(block->stamp = calloc(pieces_of(capacity), sizeof *block->stamp))) {
            return_to_system(block);
            return NULL;
        }
        if (capacity >= large_series) find_pages(block, true);
    }
    block->bytes = bytes;
    copy_differing_pieces(block, from, kept_bytes);
    enter(block, bytes);
    return (char *)block + ALIGNMENT;
}

void *pliant_next_version(const void *from, size_t kept_elements, size_t number, size_t size)
{
    if (number == 0) return pliant_calloc(1, size);
    return may_be(number, size) ? next_of(header_of(from), kept_elements * size, number * size) : NULL;
}

void pliant_mark_written(void *array, size_t first, size_t number, size_t size)
{
    header *block = header_of(array);
    if (block->stamp && number > 0) stamp_new_versions(block, first * size, (first + number) * size);
}

bool pliant_next_difference(const void *now, const void *before, size_t bytes, size_t *from, size_t *to)
{
    const header *is = header_of(now), *was = header_of(before);
    size_t p = pieces_of(*to);
    const size_t pieces = pieces_of(bytes);
    for (bool in = false; p < pieces; p++) {
        const size_t first = p * PIECE, last = first + PIECE < bytes ? first + PIECE : bytes;
        const bool same = is->stamp && was->stamp
                              ? is->stamp[p] == was->stamp[p]
                              : memcmp((const char *)now + first, (const char *)before + first, last - first) == 0;
        if (!same) *to = last;
        if (!same && !in) *from = first;
        if (same && in) return true;
        in = in || !same;
        if (in && p + 1 == pieces) return true;
    }
    return false;
}

/* Change the size within the capacity. Return false if the capacity is too small. */
static bool stretch(header *block, size_t bytes)
{
    if (block->capacity < (block->stamp ? large_series : large) ||
        capacity_for(bytes, block->stamp != NULL) != block->capacity)
        return false;
    if (bytes > block->bytes) {
        memset((char *)block + ALIGNMENT + block->bytes, 0, bytes - block->bytes);
        if (block->stamp) stamp_new_versions(block, block->bytes, bytes);
        count(block, bytes - block->bytes);
    } else {
        uncount(block, block->bytes - bytes);
        if (block->stamp) stamp_new_versions(block, bytes, bytes);
    }
    block->bytes = bytes;
    return true;
}

void *pliant_resize(void *block, size_t number, size_t size)
{
    if (!may_be(number, size)) return NULL;
    const size_t bytes = number * size;
    if (!block) return allocate(bytes, true);
    if (stretch(header_of(block), bytes)) return block;
    const size_t old = header_of(block)->bytes;
    char *made =
        header_of(block)->stamp ? next_of(header_of(block), old < bytes ? old : bytes, bytes) : allocate(bytes, false);
    if (!made) return NULL;
    if (!header_of(block)->stamp) {
        memcpy(made, block, old < bytes ? old : bytes);
        if (bytes > old) memset(made + old, 0, bytes - old);
    }
    pliant_free(block);
    return made;
}

bool pliant_grow(void *array, size_t number, size_t size)
{
    void *block;
    memcpy(&block, array, sizeof block);
    if (!(block = pliant_resize(block, number, size))) return false;
    memcpy(array, &block, sizeof block);
    return true;
}

bool pliant_ensure(void *array, size_t number, size_t size)
{
    const void *block;
    memcpy(&block, array, sizeof block);
    return number == 0 || (block && number <= header_of(block)->bytes / size) || pliant_grow(array, number, size);
}

bool pliant_reserve(void *array, int32_t *capacity, int32_t count, int32_t first, size_t size)
{
    if (count < *capacity) return true;
    if (*capacity > INT32_MAX / 2) return false;
    const int32_t larger = *capacity > 0 ? 2 * *capacity : first;
    if (!pliant_grow(array, (size_t)larger, size)) return false;
    *capacity = larger;
    return true;
}

void *pliant_retain_block(void *block)
{
    if (block) atomic_fetch_add_explicit(&header_of(block)->others, 1, memory_order_relaxed);
    return block;
}

/* An unshared block needs no atomic write. */
static bool is_last(header *block)
{
    if (atomic_load_explicit(&block->others, memory_order_acquire) == 0) return true;
    return atomic_fetch_sub_explicit(&block->others, 1, memory_order_acq_rel) == 0;
}

void pliant_free(void *block)
{
    if (!block) return;
    header *own = header_of(block);
    if (!is_last(own)) return;
    pliant_account *of = own->account;
    uncount(own, own->bytes);
    if (!keep(own)) return_to_system(own);
    pliant_account_close(of);
}

void pliant_free_blocks(void *const *blocks, size_t count)
{
    for (size_t b = 0; b < count; b++) pliant_free(blocks[b]);
}

size_t pliant_memory_in_use(void) { return atomic_load(&in_use); }
size_t pliant_memory_peak(void) { return atomic_load(&peak); }
void pliant_memory_reset_peak(void) { atomic_store(&peak, atomic_load(&in_use)); }
void pliant_memory_fail_after(int64_t calls) { atomic_store(&calls_left, calls); }

/* ---- Accounts. */

pliant_account *pliant_account_open(void)
{
    pliant_account *before = pliant_account_use(NULL), *made = pliant_calloc(1, sizeof *made);
    pliant_account_use(before);
    if (made) atomic_store(&made->bytes, sizeof *made);
    return pliant_account_retain(made);
}

pliant_account *pliant_account_retain(pliant_account *of)
{
    if (of) atomic_fetch_add(&of->holders, 1);
    return of;
}

void pliant_account_close(pliant_account *of)
{
    if (of && atomic_fetch_sub(&of->holders, 1) == 1) pliant_free(of);
}

pliant_account *pliant_account_use(pliant_account *of)
{
    pliant_account *before = account;
    account = of;
    return before;
}

pliant_account *pliant_account_in_use(void) { return account; }
size_t pliant_account_bytes(const pliant_account *of) { return of ? atomic_load(&of->bytes) : 0; }
