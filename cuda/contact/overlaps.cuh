/* The grid of tetrahedra on the GPU (overlaps.cu). Searches near a point use it too. */
#ifndef PLIANT_CUDA_OVERLAPS_CUH
#define PLIANT_CUDA_OVERLAPS_CUH

#include "cuda/contact/overlaps.h"
#include "cuda/contact/overlaps_side.h"

#include <algorithm>

namespace overlaps {

/* end: end of the list; box: rounded outwards */
struct entry { unsigned long long cell; int32_t tet, end; float low[3], high[3]; };
struct tet_box { double low[3], high[3]; };

/* number of entries, number of pairs, and the largest number of fine cells along an axis that a box covers */
enum { ENTRIES, PAIRS, CELLS, NUM_COUNTS };
typedef unsigned long long number;

/* Values that change in every step. */
struct step {
    double side, fine; /* side of the cells; side at creation */
    double margin;     /* enlarges boxes on every side */
    number maximum;    /* maximum number of fine cells along an axis that a box may cover */
};

/* Data of the kernels. */
struct view {
    int32_t count, table; /* table: a power of two, minus 1 */
    const step *now;
    const int32_t *tets, *tet;
    const double *positions;
    tet_box *box;        /* (count) */
    number *counts;      /* (NUM_COUNTS), followed by: */
    int32_t *length;     /* (table + 1) length of each list */
    int32_t *start;      /* (table + 1) first entry of each list */
    int32_t *next;       /* (table + 1) position of the next new entry */
    entry *entries;
    int2 *pairs;
    number capacity[CELLS];
};

static __device__ __forceinline__ int32_t cell_of(double side, double x)
{
    return (int32_t)fmin(fmax(floor(x / side), -1e9), 1e9);
}

static __device__ __forceinline__ uint32_t hash_of(const view &v, int32_t a, int32_t b, int32_t c)
{
    return ((uint32_t)a * 73856093u ^ (uint32_t)b * 19349663u ^ (uint32_t)c * 83492791u) & (uint32_t)v.table;
}

static __device__ __forceinline__ unsigned long long key_of(int32_t a, int32_t b, int32_t c)
{
    /* no box is so large that it covers two cells with the same key */
    const unsigned long long mask = (1ull << 21) - 1;
    return ((unsigned long long)a & mask) | ((unsigned long long)b & mask) << 21 | ((unsigned long long)c & mask) << 42;
}

/* Return whether lists and pairs are complete. If a buffer is too small, the kernels do nothing. The search is then
 * repeated with larger buffers. */
static __device__ __forceinline__ bool are_whole(const view &v)
{
    return v.counts[ENTRIES] <= v.capacity[ENTRIES] && v.counts[CELLS] <= v.now->maximum;
}

} // namespace overlaps

struct gpu_overlaps;
const overlaps::view &gpu_overlaps_view(const gpu_overlaps *overlaps);

#endif
