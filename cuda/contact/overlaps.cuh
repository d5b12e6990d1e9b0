/* The grid of tetrahedra on the GPU (overlaps.cu), for who looks at what is near a point, too. */
#ifndef PLIANT_CUDA_OVERLAPS_CUH
#define PLIANT_CUDA_OVERLAPS_CUH

#include "cuda/contact/overlaps.h"
#include "cuda/contact/overlaps_side.h"

#include <algorithm>

namespace overlaps {

struct entry { unsigned long long cell; int32_t tet, end; float low[3], high[3]; }; /* end: of its list; box: outwards */
struct tet_box { double low[3], high[3]; };

/* how many there are, and the most fine cells along an axis that a box lies in, of those that lie in many */
enum { ENTRIES, PAIRS, CELLS, NUM_COUNTS };
typedef unsigned long long number;

/* What is another in every step. */
struct step {
    double side, fine; /* of the cells, and as it was asked for */
    double margin;     /* that boxes are larger by on every side */
    number most;       /* fine cells along an axis that a box may lie in */
};

/* what kernels see */
struct view {
    int32_t count, table; /* table: a power of two, less 1 */
    const step *now;
    const int32_t *tets, *tet;
    const double *positions;
    tet_box *box;        /* (count) */
    number *counts;      /* (NUM_COUNTS), then: */
    int32_t *length;     /* (table + 1) of each list */
    int32_t *start;      /* (table + 1) its first entry */
    int32_t *next;       /* (table + 1) where the next one goes */
    entry *entries;
    int2 *pairs;
    number room[CELLS];
};

static __device__ __forceinline__ int32_t cell_of(double side, double x) { return (int32_t)fmin(fmax(floor(x / side), -1e9), 1e9); }

static __device__ __forceinline__ uint32_t hash_of(const view &v, int32_t a, int32_t b, int32_t c)
{
    return ((uint32_t)a * 73856093u ^ (uint32_t)b * 19349663u ^ (uint32_t)c * 83492791u) & (uint32_t)v.table;
}

static __device__ __forceinline__ unsigned long long key_of(int32_t a, int32_t b, int32_t c)
{
    const unsigned long long mask = (1ull << 21) - 1; /* no box reaches as far as a cell with the same key */
    return ((unsigned long long)a & mask) | ((unsigned long long)b & mask) << 21 | ((unsigned long long)c & mask) << 42;
}

/* Whether lists and pairs are whole: whoever finds that they have too little room does nothing, and it is all done
 * again with more. */
static __device__ __forceinline__ bool are_whole(const view &v) { return v.counts[ENTRIES] <= v.room[ENTRIES] && v.counts[CELLS] <= v.now->most; }

} // namespace overlaps

struct gpu_overlaps;
const overlaps::view &gpu_overlaps_view(const gpu_overlaps *overlaps);

#endif
