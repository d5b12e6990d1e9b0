#include "base/pairs.h"

#include <stdlib.h>
#include <string.h>

int pliant_pair_order(const void *a, const void *b)
{
    const int32_t *i = a, *j = b;
    if (i[0] != j[0]) return i[0] < j[0] ? -1 : 1;
    return i[1] < j[1] ? -1 : i[1] > j[1];
}

int pliant_triple_order(const void *a, const void *b)
{
    const int32_t *i = a, *j = b;
    const int order = pliant_pair_order(a, b);
    return order != 0 ? order : i[2] < j[2] ? -1 : i[2] > j[2];
}

int32_t pliant_pairs_sort(int32_t *pair, int32_t count)
{
    int32_t kept = 0;
    qsort(pair, (size_t)count, 2 * sizeof *pair, pliant_pair_order);
    for (int32_t i = 0; i < count; i++) {
        if (kept > 0 && pliant_pair_order(pair + 2 * kept - 2, pair + 2 * i) == 0) continue;
        memmove(pair + 2 * kept++, pair + 2 * i, 2 * sizeof *pair);
    }
    return kept;
}
