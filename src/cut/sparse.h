/* Sparse array of numbers, one per tetrahedron, nearly all of them 0. Only runs of tetrahedra with a nonzero number are
 * stored. */
#ifndef PLIANT_CUT_SPARSE_H
#define PLIANT_CUT_SPARSE_H

#include "base/buffer.h"
#include "base/memory.h"

#include <stdbool.h>
#include <stdint.h>

#ifdef __cplusplus
extern "C" {
#endif

enum { CUT_RUN = 256 };

typedef struct cut_sparse {
    int32_t *place;    /* (runs) index of each run in number, in units of runs; 0: the common run of zeros */
    int32_t *number;   /* (capacity x CUT_RUN) */
    int32_t runs, capacity;
} cut_sparse;

/* Create an array for tetrahedra below count. Return false if memory is exhausted; the array must be freed
 * nevertheless. */
static inline bool cut_sparse_create(int32_t count, cut_sparse *sparse)
{
    sparse->place = (int32_t *)pliant_calloc((size_t)count / CUT_RUN + 1, sizeof *sparse->place);
    sparse->number = (int32_t *)pliant_calloc(4 * CUT_RUN, sizeof *sparse->number);
    sparse->runs = 1;
    sparse->capacity = 4;
    return sparse->place && sparse->number;
}

static inline void cut_sparse_free(cut_sparse *sparse)
{
    pliant_free(sparse->place);
    pliant_free(sparse->number);
    sparse->place = sparse->number = NULL;
}

static inline int32_t cut_sparse_get(const cut_sparse *sparse, int32_t tet)
{
    return sparse->number[CUT_RUN * (size_t)sparse->place[tet / CUT_RUN] + (size_t)(tet % CUT_RUN)];
}

/* Return false if memory is exhausted; the array is then unchanged. */
static inline bool cut_sparse_set(cut_sparse *sparse, int32_t tet, int32_t number)
{
    int32_t *place = sparse->place + tet / CUT_RUN;
    if (*place == 0) {
        if (!pliant_reserve(&sparse->number, &sparse->capacity, sparse->runs, 4, CUT_RUN * sizeof *sparse->number))
            return false;
        *place = sparse->runs++;
    }
    sparse->number[CUT_RUN * (size_t)*place + (size_t)(tet % CUT_RUN)] = number;
    return true;
}

#ifdef __cplusplus
}
#endif
#endif
