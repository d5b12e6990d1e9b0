#include "pliant/memory.h"

#include <stdatomic.h>
#include <stdlib.h>
#include <string.h>

/* The size stands in front of the block, in the 64 bytes that alignment leaves free. */
enum { ALIGNMENT = 64 };

static atomic_size_t in_use, peak;
static atomic_llong calls_left = -1;

static int fails_now(void)
{
    long long left = atomic_load(&calls_left);
    while (left >= 0)
        if (atomic_compare_exchange_weak(&calls_left, &left, left - 1)) return left == 0;
    return 0;
}

static void count(size_t bytes)
{
    size_t now = atomic_fetch_add(&in_use, bytes) + bytes, old = atomic_load(&peak);
    while (now > old && !atomic_compare_exchange_weak(&peak, &old, now)) {}
}

static size_t *size_of(void *block) { return (size_t *)((char *)block - ALIGNMENT); }

void *pliant_calloc(size_t number, size_t size)
{
    if (number == 0 || size == 0 || number > (SIZE_MAX - 2 * ALIGNMENT) / size || fails_now()) return NULL;
    size_t bytes = number * size;
    size_t whole = (bytes + 2 * ALIGNMENT - 1) / ALIGNMENT * ALIGNMENT;
    char *base = aligned_alloc(ALIGNMENT, whole);
    if (!base) return NULL;
    memset(base, 0, whole);
    *(size_t *)base = bytes;
    count(bytes);
    return base + ALIGNMENT;
}

void *pliant_resize(void *block, size_t number, size_t size)
{
    void *larger = pliant_calloc(number, size);
    if (!larger || !block) return larger;
    size_t old = *size_of(block), bytes = number * size;
    memcpy(larger, block, old < bytes ? old : bytes);
    pliant_free(block);
    return larger;
}

void pliant_free(void *block)
{
    if (!block) return;
    atomic_fetch_sub(&in_use, *size_of(block));
    free(size_of(block));
}

size_t pliant_memory_in_use(void) { return atomic_load(&in_use); }
size_t pliant_memory_peak(void) { return atomic_load(&peak); }
void pliant_memory_reset_peak(void) { atomic_store(&peak, atomic_load(&in_use)); }
void pliant_memory_fail_after(int64_t calls) { atomic_store(&calls_left, calls); }
