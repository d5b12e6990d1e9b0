/* Memory for data that is rebuilt after every cut, and memory that a device copies from and to. */
#ifndef PLIANT_BASE_BUFFER_H
#define PLIANT_BASE_BUFFER_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#ifdef __cplusplus
extern "C" {
#endif

/* Allocate as pliant_calloc, but without clearing. The caller writes all of it. */
void *pliant_malloc(size_t count, size_t size);
/* Copy `count` elements; at least one element is allocated. NULL: out of memory. */
void *pliant_copy_block(const void *from, size_t count, size_t size);

/* Add a holder to a block, which from then on nobody may write to. Each holder calls pliant_free, and the last call
 * frees the block. It counts for the account that allocated it. */
void *pliant_retain_block(void *block);

/* Allocate an array that is a changed version of another one, as after a cut. The first `kept` of `number` elements are
 * copied from another block of the library, and the others are zero. number 0: allocates one element. The function
 * reuses a freed earlier version if possible, and then copies only the differences. Therefore all later writes to the
 * array must be reported by pliant_mark_written before another version is derived from it. Exceptions are elements
 * appended by the last pliant_resize, and blocks that are no such array. NULL: out of memory. */
void *pliant_next_version(const void *from, size_t kept, size_t number, size_t size);
void pliant_mark_written(void *array, size_t first, size_t number, size_t size);
/* Find the next byte range, [*from, *to), in which two blocks of the library may differ. Start with *to = 0. Return
 * false at the end. */
bool pliant_next_difference(const void *now, const void *before, size_t bytes, size_t *from, size_t *to);

/* Resize the block of a pointer as pliant_resize. array: address of the pointer. Return false if out of memory; the
 * block is then unchanged. */
bool pliant_grow(void *array, size_t count, size_t size);
/* Grow the block of a pointer as pliant_grow, unless it has memory for `count` elements. */
bool pliant_ensure(void *array, size_t count, size_t size);
/* Reserve memory for one more element after the first `count`. If the array is full, its capacity becomes the double,
 * or `first` for an empty array. array: address of the pointer. Return false if out of memory; array and capacity are
 * then unchanged. */
bool pliant_reserve(void *array, int32_t *capacity, int32_t count, int32_t first, size_t size);

/* Allocate as pliant_calloc, on separate pages. A device locks complete pages, and may refuse other blocks on them.
 * pliant_is_on_own_pages: return whether a block of the library is alone on its pages. */
void *pliant_calloc_pages(size_t count, size_t size);
bool pliant_is_on_own_pages(const void *block);

/* Change the limit of freed large blocks that are kept for reuse by `bytes`, which may be negative. New pages cost more
 * than writing to them. The initial limit is 0. */
void pliant_memory_change_reserve(int64_t bytes);
/* Mark the calling thread as a background thread. Blocks that it frees are not kept for reuse, except versions of an
 * array. */
void pliant_memory_set_background(void);
/* Return the bytes that the calling thread has allocated minus the bytes that it has freed. */
int64_t pliant_memory_thread_bytes(void);
/* Return the bytes kept for reuse; they do not count as in use. */
size_t pliant_memory_reserved(void);

#ifdef __cplusplus
}
#endif
#endif
