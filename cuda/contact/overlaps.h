/* Overlapping tetrahedra, found on the GPU by the rules of contact/detect/tet_grid.c and contact/detect/overlap.h. The
 * pairs are identical to the CPU's. */
#ifndef PLIANT_CUDA_OVERLAPS_H
#define PLIANT_CUDA_OVERLAPS_H

#include "cuda/base/check.h"

#include <stdint.h>

#ifdef __cplusplus
extern "C" {
#endif

typedef struct gpu_overlaps gpu_overlaps;

/* Create the search.
 * @param tets (num_tets x 4) nodes
 * @param tet (count, at least one) tetrahedra to test
 * @param side of the grid's cells, best the size of the tetrahedra [m]
 * Errors: MEMORY, UNAVAILABLE. */
pliant_status gpu_overlaps_create(int32_t num_tets, const int32_t *tets, int32_t count, const int32_t *tet, double side,
                                  cudaStream_t stream, gpu_overlaps **out);
void gpu_overlaps_free(gpu_overlaps *overlaps); /* Nullable */
/* Enqueue further work on the grid after the search. It is called again if the grid is rebuilt. */
typedef pliant_status (*gpu_overlaps_more)(void *context, gpu_overlaps *overlaps);
/* Find the pairs, and wait for the stream, which must not be a default stream.
 * @param d_positions (nodes x 3) [m]
 * @param margin enlarges boxes in the grid [m]
 * @param more Nullable
 * @param count out: number of pairs
 * Errors: MEMORY, UNAVAILABLE. */
pliant_status gpu_overlaps_find(gpu_overlaps *overlaps, const double *d_positions, double margin, cudaStream_t stream,
                                gpu_overlaps_more more, void *context, int32_t *count);
/* Copy the last pairs to the host, the lower tetrahedron first, ascending. pair: (count x 2) out. Errors:
 * UNAVAILABLE. */
pliant_status gpu_overlaps_get_pairs(const gpu_overlaps *overlaps, cudaStream_t stream, int32_t *pair);

#ifdef __cplusplus
}
#endif
#endif
