/* Broad phase of the surface against itself on the GPU (contact/advance/self_rules.h). */
#ifndef PLIANT_CUDA_CONTACT_SELF_PAIRS_H
#define PLIANT_CUDA_CONTACT_SELF_PAIRS_H

#include "contact/advance/advance_workspace.h"
#include "cuda/base/check.h"

#ifdef __cplusplus
extern "C" {
#endif

typedef struct gpu_self_pairs gpu_self_pairs;

/* Create the search for the triangles of a tree (pliant_advance_tree_set).
 * @param num_nodes of the mesh
 * @param exempt, piece (num_nodes) as in pliant_advance_self; copied. piece: Nullable
 * Errors: MEMORY, UNAVAILABLE. */
pliant_status gpu_self_pairs_create(const pliant_advance_tree *tree, int32_t num_nodes, const uint8_t *exempt,
                                    const int32_t *piece, cudaStream_t stream, gpu_self_pairs **out);
void gpu_self_pairs_free(gpu_self_pairs *pairs); /* Nullable */
/* Do the work of pliant_advance_audit_self, and wait for the stream. The order of the pairs is always the same, but it
 * is not the order on the CPU.
 * @param d_positions (nodes x 3) [m]
 * @param advance out: its pairs
 * @param crossing (num_nodes) as in pliant_advance_audit_self
 * Errors: MEMORY, UNAVAILABLE. */
pliant_status gpu_self_pairs_find(gpu_self_pairs *pairs, const double *d_positions, double margin, cudaStream_t stream,
                                  pliant_advance *advance, uint8_t *crossing);

#ifdef __cplusplus
}
#endif
#endif
