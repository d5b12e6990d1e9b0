/* Memory that a simulation which is cut asks for over and over: what a next body and all that follows from it are made
 * in; and memory that a device copies from and to. */
#ifndef PLIANT_BASE_ROOM_H
#define PLIANT_BASE_ROOM_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#ifdef __cplusplus
extern "C" {
#endif

/* As pliant_calloc, but with whatever was there: who asks writes all of it. */
void *pliant_room(size_t count, size_t size);
/* A copy of count elements; room for one where there are none. NULL: out of memory. */
void *pliant_copy_of(const void *from, size_t count, size_t size);

/* The same block for one holder more, which does not write to it any more than the others do; pliant_free is each
 * one's, and the last of them gives it back. It counts where it was asked for. */
void *pliant_share(void *block);

/* Arrays that follow one another, of which most stays the same: those of a body, of the next body, of what follows from
 * them. An array of `number` elements whose first `kept` are those of another block of the library, zeros behind them;
 * number 0: room for one. It lies where one of them lay that was freed, as far as there is one, and only what differs
 * is copied; the first of them may be any block. So who writes to such an array, but to what the last pliant_resize has
 * added, says where (pliant_writes; nothing happens with others), before anything else is made of it. NULL: out of
 * memory. */
void *pliant_next_of(const void *from, size_t kept, size_t number, size_t size);
void pliant_writes(void *array, size_t first, size_t number, size_t size);
/* The next bytes, from *from to before *to, of so many in which two blocks of the library may differ; to begin with,
 * *to is 0. false: there are no more. */
bool pliant_next_difference(const void *now, const void *before, size_t bytes, size_t *from, size_t *to);

/* pliant_resize of the block that a pointer points to, array: its address. false: out of memory, and it is as it
 * was. */
bool pliant_grow(void *array, size_t count, size_t size);

/* As pliant_calloc, on pages that nothing else is on: a device that reads and writes a block locks whole pages, and
 * may then refuse what lies on such a page in part. pliant_has_pages: whether a block of the library is alone on its
 * pages. */
void *pliant_pages(size_t count, size_t size);
bool pliant_has_pages(const void *block);

/* So many bytes more, or less, of large blocks that are freed are kept for those who ask next: pages that the system
 * has to find and to clear cost more than what is written to them. None at first. */
void pliant_memory_keep(int64_t bytes);
/* From now on the calling thread, which works beside steps, leaves them to those: what it frees is not kept, but for
 * arrays that follow one another. */
void pliant_memory_apart(void);
/* Bytes that the calling thread has taken, less those that it has given back, whoever took them. */
int64_t pliant_memory_taken(void);
/* Bytes that are kept now; they do not count as in use. */
size_t pliant_memory_kept(void);

#ifdef __cplusplus
}
#endif
#endif
