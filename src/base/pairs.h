/* Lists of pairs of indices. */
#ifndef PLIANT_BASE_PAIRS_H
#define PLIANT_BASE_PAIRS_H

#include <stdint.h>

/* by the first, then by the second: -1, 0 or 1, as qsort asks for it */
int pliant_pair_order(const void *a, const void *b);
/* Puts pairs in order, each once. @param pair count x 2 @return how many are left */
int32_t pliant_pairs_sort(int32_t *pair, int32_t count);

#endif
