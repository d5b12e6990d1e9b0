/* Every allocation of the library goes through here: 64-byte aligned, zeroed, counted, and made to fail
 *  on purpose by tests.
 */
#ifndef PLIANT_BASE_MEMORY_H
#define PLIANT_BASE_MEMORY_H

#include "base/export.h"

#include <stddef.h>
#include <stdint.h>

#ifdef __cplusplus
extern "C" {
#endif

/** count x size bytes, zeroed, 64-byte aligned. NULL when out of memory, on overflow, and for 0 bytes.
 *  Free with pliant_free. */
PLIANT_INTERNAL void *pliant_calloc(size_t count, size_t size);

/** A larger or smaller copy of block; the added bytes are zero. NULL when out of memory (block is kept). */
PLIANT_INTERNAL void *pliant_resize(void *block, size_t count, size_t size);

/** Nullable. */
PLIANT_INTERNAL void pliant_free(void *block);
/** Free several blocks. */
void pliant_free_blocks(void *const *blocks, size_t count);
#define PLIANT_FREE(...) \
    pliant_free_blocks((void *const[]){__VA_ARGS__}, sizeof((void *const[]){__VA_ARGS__}) / sizeof(void *))

/** Bytes held now by pliant_calloc, and the largest value since the last reset of the peak. */
PLIANT_INTERNAL size_t pliant_memory_in_use(void);
PLIANT_INTERNAL size_t pliant_memory_peak(void);
PLIANT_INTERNAL void pliant_memory_reset_peak(void);

/** For tests: the allocation after the next `calls` ones fails, once. Negative: none fails (the default). */
void pliant_memory_fail_after(int64_t calls);

#ifdef __cplusplus
}
#endif
#endif
