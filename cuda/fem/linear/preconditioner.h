/* The approximate inverse of the stiffness matrix, applied in axes that rotate with each node. It belongs to the rest
 * state, or to another state rotated back to rest. */
#ifndef PLIANT_CUDA_PRECONDITIONER_H
#define PLIANT_CUDA_PRECONDITIONER_H

#include "cuda/fem/linear/carried_preconditioner.h"
#include "fem/linear/carried_preconditioner.h"
#include "cuda/fem/linear/multigrid.h"

#ifdef __cplusplus
extern "C" {
#endif

typedef struct gpu_preconditioner {
    gpu_inverse inverse;
    gpu_multigrid *multigrid; /* NULL: the inverse is used */
    pliant_carried_layout layout; /* on the host: layout of the preconditioner's system, which belongs to an earlier
                                   * body if it is carried over */
    /* Nullable: (num_free x 9) axes in which a V-cycle was created, if not at rest. An inverse includes its axes. */
    double *d_axes;
    float *d_turned;          /* (num_free x 3, padded) work array for those axes */
    size_t bytes;
    gpu_carried carried;
    gpu_carried_capacity capacity;
} gpu_preconditioner;

/* A state for a preconditioner, on the host: nodes (x 3) and axes of the unknown nodes (x 9). A NULL pointer to it
 * means rest. */
typedef struct gpu_preconditioner_state {
    const double *x, *axes;
} gpu_preconditioner_state;

/* Create the preconditioner.
 * @param choice  AUTO chooses the faster kind for the number of nodes.
 * @param at      Nullable: state. If the exact matrix is not positive definite there, only its positive part is used.
 * Errors: MEMORY (with figures), NUMERIC, UNAVAILABLE. The system must have its pattern. */
pliant_status pliant_cuda_preconditioner_create(const pliant_system *system, pliant_preconditioner_choice choice,
                                                const gpu_preconditioner_state *at, cudaStream_t stream,
                                                gpu_preconditioner *out);
void pliant_cuda_preconditioner_free(gpu_preconditioner *preconditioner);
/* Compute d_left = M d_right of the iteration, unless the state says that there is no work. */
pliant_status pliant_cuda_precondition(const gpu_preconditioner *preconditioner, const gpu_iteration *iteration,
                                       cudaStream_t stream);
/* Compute Z = T M T' W' for one tool's W, with T the rotations of the nodes. d_response: (3 x 3 num_free). Overwrites
 * d_right and d_left. */
pliant_status pliant_cuda_respond(const gpu_preconditioner *preconditioner, const gpu_iteration *iteration,
                                  const gpu_tool *tool, double *d_response, cudaStream_t stream);

/* Compute columns of M at rest, three for each unknown node. Overwrites d_right.
 * @param h_which, d_which  (count x 2) unknown node and the first slot of its columns, on host and GPU.
 * @param d_column          Column `slot` begins at stride * slot, padded. */
pliant_status pliant_cuda_columns(const gpu_preconditioner *preconditioner, const gpu_iteration *iteration,
                                  int32_t count, const int32_t *h_which, const int32_t *d_which, size_t stride,
                                  float *d_column, cudaStream_t stream);

#ifdef __cplusplus
}
#endif
#endif
