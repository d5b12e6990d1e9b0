/* Parts of a set, by union and find; the root of a part is its first element. */
#ifndef PLIANT_BODY_PARTS_H
#define PLIANT_BODY_PARTS_H

#include <stdint.h>

static inline int32_t first_of(int32_t *part, int32_t i)
{
    while (part[i] != i) i = part[i] = part[part[i]];
    return i;
}

static inline void join(int32_t *part, int32_t i, int32_t j)
{
    int32_t a = first_of(part, i), b = first_of(part, j);
    part[a > b ? a : b] = a > b ? b : a;
}

#endif
