/* Search and sort numbers. Parts are disjoint sets (base/union_find.h). */
#ifndef PLIANT_TOPOLOGY_SORTED_NUMBERS_H
#define PLIANT_TOPOLOGY_SORTED_NUMBERS_H

#include "base/union_find.h"

#include <stdint.h>
#include <stdlib.h>

/* Return the index of a number in an ascending list; -1: not found. */
static inline int32_t place_of(const int32_t *sorted, int32_t count, int32_t number)
{
    int32_t low = 0, high = count;
    while (low < high) {
        const int32_t middle = low + (high - low) / 2;
        if (sorted[middle] < number) low = middle + 1;
        else high = middle;
    }
    return low < count && sorted[low] == number ? low : -1;
}

static inline int by_number(const void *a, const void *b)
{
    const int32_t *i = (const int32_t *)a, *j = (const int32_t *)b;
    return *i < *j ? -1 : *i > *j;
}

/* Sort and remove duplicates; return the remaining count. */
static inline int32_t sort_once(int32_t *number, int32_t count)
{
    int32_t kept = 0;
    qsort(number, (size_t)count, sizeof *number, by_number);
    for (int32_t i = 0; i < count; i++)
        if (kept == 0 || number[i] != number[kept - 1]) number[kept++] = number[i];
    return kept;
}

#endif
