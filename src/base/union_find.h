/* Disjoint sets of indices (union-find), as a forest of parents. The lowest index of a set is its root. */
#ifndef PLIANT_BASE_UNION_FIND_H
#define PLIANT_BASE_UNION_FIND_H

#include <stdint.h>

/* Return the root of an index, and halve the path to it. */
static inline int32_t pliant_set_root(int32_t *parent, int32_t i)
{
    while (parent[i] != i) i = parent[i] = parent[parent[i]];
    return i;
}

/* Join the sets of two indices. */
static inline void pliant_set_join(int32_t *parent, int32_t a, int32_t b)
{
    a = pliant_set_root(parent, a);
    b = pliant_set_root(parent, b);
    if (a < b) parent[b] = a;
    else parent[a] = b;
}

#endif
