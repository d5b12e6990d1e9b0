/* The approximate inverse of the stiffness matrix of one state, applied in axes that rotate with each node. */
#ifndef PLIANT_CUDA_PRECONDITIONER_H
#define PLIANT_CUDA_PRECONDITIONER_H

#include "cuda/fem/linear/carried_preconditioner.h"
#include "fem/linear/carried_preconditioner.h"
#include "cuda/fem/linear/multigrid.h"

typedef struct gpu_preconditioner {
    gpu_inverse inverse;
    gpu_multigrid *multigrid; /* NULL: the inverse is used */
    pliant_carried_layout layout; /* on the host: layout of the preconditioner's system, which belongs to an earlier
                                   * body if it is carried over */
    size_t bytes;
    gpu_carried carried;
    gpu_carried_capacity capacity;
} gpu_preconditioner;

/* Create the preconditioner.
 * @param h_x     (3 num_nodes) the state [m].
 * @param choice  AUTO chooses the faster kind for the number of nodes.
 * Errors: MEMORY (with figures), NUMERIC, UNAVAILABLE. The system must have its pattern. */
pliant_status pliant_cuda_preconditioner_create(const pliant_system *system, const double *h_x,
                                                pliant_preconditioner_choice choice, cudaStream_t stream,
                                                gpu_preconditioner *out);
void pliant_cuda_preconditioner_free(gpu_preconditioner *preconditioner);
/* Compute d_left = M d_right of the iteration, unless the state says that there is no work. */
pliant_status pliant_cuda_precondition(const gpu_preconditioner *preconditioner, const gpu_iteration *iteration,
                                       cudaStream_t stream);
/* Compute Z = T M T' W' for one tool's W, with T the rotations of the nodes. d_response: (3 x 3 num_free). Overwrites
 * d_right and d_left. */
pliant_status pliant_cuda_respond(const gpu_preconditioner *preconditioner, const gpu_iteration *iteration,
                                  const gpu_tool *tool, double *d_response, cudaStream_t stream);

/* Compute columns of M in the nodes' axes, three for each unknown node. Overwrites d_right.
 * @param h_which, d_which  (count x 2) unknown node and the first slot of its columns, on host and GPU.
 * @param d_column          Column `slot` begins at stride * slot, padded. */
pliant_status pliant_cuda_columns(const gpu_preconditioner *preconditioner, const gpu_iteration *iteration,
                                  int32_t count, const int32_t *h_which, const int32_t *d_which, size_t stride,
                                  float *d_column, cudaStream_t stream);

#endif
