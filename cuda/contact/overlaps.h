/* Tetrahedra that overlap, found on the GPU by the rules of contact/detect/grid.c and contact/detect/overlap.h: the
 * same pairs. */
#ifndef PLIANT_CUDA_OVERLAPS_H
#define PLIANT_CUDA_OVERLAPS_H

#include "cuda/base/check.h"

#include <stdint.h>

#ifdef __cplusplus
extern "C" {
#endif

typedef struct gpu_overlaps gpu_overlaps;

/* @param tets (num_tets x 4) nodes; @param tet (count, one at least) those that are looked at; @param side of the
 *     grid's cells, best as large as they are [m].
 * Errors: MEMORY, UNAVAILABLE. */
pliant_status gpu_overlaps_create(int32_t num_tets, const int32_t *tets, int32_t count, const int32_t *tet, double side, cudaStream_t stream,
                                  gpu_overlaps **out);
void gpu_overlaps_free(gpu_overlaps *overlaps); /* Nullable */
/* What else is to be done with the grid, enqueued after the search; more than once, where the grid is made anew. */
typedef pliant_status (*gpu_overlaps_more)(void *context, gpu_overlaps *overlaps);
/* Waits for the stream, which is none of the default ones. @param d_positions (nodes x 3) [m]; @param margin of boxes
 * in the grid [m]; @param more Nullable;
 * @param count Out: pairs. Errors: MEMORY, UNAVAILABLE. */
pliant_status gpu_overlaps_find(gpu_overlaps *overlaps, const double *d_positions, double margin, cudaStream_t stream, gpu_overlaps_more more, void *context, int32_t *count);
/* The pairs that were found last, lower tetrahedron first, ascending. @param pair (count x 2) out. Errors:
 * UNAVAILABLE. */
pliant_status gpu_overlaps_get_pairs(const gpu_overlaps *overlaps, cudaStream_t stream, int32_t *pair);

#ifdef __cplusplus
}
#endif
#endif
