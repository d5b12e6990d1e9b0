/* Lists of pairs and triples of indices. */
#ifndef PLIANT_BASE_PAIRS_H
#define PLIANT_BASE_PAIRS_H

#include <stdint.h>

/* Compare by the first index, then by the second and the third, for qsort: -1, 0 or 1. The elements begin with these
 * indices. */
int pliant_pair_order(const void *a, const void *b);
int pliant_triple_order(const void *a, const void *b);
/* Sort pairs and remove duplicates.
 * @param pair  (count x 2).
 * @return Number of remaining pairs. */
int32_t pliant_pairs_sort(int32_t *pair, int32_t count);

#endif
