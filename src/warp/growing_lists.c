/* Growing lists for the computation of parts. */
#include "warp/parts_maker.h"

#include "base/buffer.h"
#include "base/fail.h"

pliant_status pliant_parts_no_memory(void) { return pliant_fail_memory("the parts of the deformed volume"); }

void *pliant_parts_grow(part_list *list, size_t more)
{
    if (list->count + more > list->capacity) {
        size_t capacity = 2 * (list->count + more);
        if (!pliant_grow(&list->at, capacity, list->size)) return NULL;
        list->capacity = capacity;
    }
    list->count += more;
    return (char *)list->at + (list->count - more) * list->size;
}
