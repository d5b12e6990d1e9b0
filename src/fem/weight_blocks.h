/* Sparse 3 x 3 blocks of the unknowns, summed in a dense array. The used unknowns are listed, so that reading and
 * clearing take no time for the others. */
#ifndef PLIANT_FEM_WEIGHT_BLOCKS_H
#define PLIANT_FEM_WEIGHT_BLOCKS_H

#include <stdbool.h>
#include <stdint.h>
#include <stdlib.h>
#include <string.h>

typedef struct pliant_weight_blocks {
    double *block;      /* (unknowns x 9), zero for unknowns that are not listed */
    uint8_t *is_listed; /* (unknowns); NULL: nothing is listed */
    int32_t *unknown;   /* (unknowns) the listed ones, in the order of their first use */
    int32_t count;
} pliant_weight_blocks;

/* Return the block of an unknown, to add to it. */
static inline double *pliant_weight_blocks_at(pliant_weight_blocks *of, int32_t unknown)
{
    if (of->is_listed && !of->is_listed[unknown]) {
        of->is_listed[unknown] = 1;
        of->unknown[of->count++] = unknown;
    }
    return of->block + 9 * (size_t)unknown;
}

static inline int pliant_weight_blocks_order(const void *a, const void *b)
{
    const int32_t *i = (const int32_t *)a, *j = (const int32_t *)b;
    return (*i > *j) - (*i < *j);
}

/* Remove unknowns whose block is zero from the list, and sort it. */
static inline void pliant_weight_blocks_sort(pliant_weight_blocks *of)
{
    int32_t count = 0;
    for (int32_t n = 0; n < of->count; n++) {
        const int32_t unknown = of->unknown[n];
        bool used = false;
        for (int m = 0; m < 9; m++) used = used || of->block[9 * (size_t)unknown + (size_t)m] != 0;
        if (used) of->unknown[count++] = unknown;
        else of->is_listed[unknown] = 0;
    }
    of->count = count;
    qsort(of->unknown, (size_t)count, sizeof *of->unknown, pliant_weight_blocks_order);
}

/* Set all blocks to zero. */
static inline void pliant_weight_blocks_clear(pliant_weight_blocks *of)
{
    for (int32_t n = 0; n < of->count; n++) {
        memset(of->block + 9 * (size_t)of->unknown[n], 0, 9 * sizeof *of->block);
        of->is_listed[of->unknown[n]] = 0;
    }
    of->count = 0;
}

#endif
