/* What stands for the inverse of the stiffness matrix, turned along with the tissue at each node: that at rest, or of a
 * state, turned back to rest. */
#ifndef PLIANT_CUDA_PRECONDITIONER_H
#define PLIANT_CUDA_PRECONDITIONER_H

#include "cuda/fem/linear/carried.h"
#include "fem/linear/carried.h"
#include "cuda/fem/linear/multigrid.h"

#ifdef __cplusplus
extern "C" {
#endif

typedef struct gpu_preconditioner {
    gpu_inverse inverse;
    gpu_multigrid *multigrid; /* NULL: the inverse */
    pliant_carried_layout layout; /* of the system that it is of, which is a body's before, where it is carried over; of the host */
    double *d_axes;           /* (num_free x 9) Nullable: that a V-cycle was made in, where that is not at rest; of an inverse it has them */
    float *d_turned;          /* (num_free x 3, padded) room, beside those */
    size_t bytes;
    gpu_carried carried;
    gpu_carried_room room;
} gpu_preconditioner;

/* A state that one is made at, of the host: nodes (x 3), and the axes of the unknown ones there (x 9). At rest: NULL in
 * place of it. */
typedef struct gpu_state_made_at {
    const double *x, *axes;
} gpu_state_made_at;

/* auto: whatever is quicker for so many nodes. at: Nullable; where the exact matrix is not positive definite there, it
 * is that part of it which is. The system has its pattern. Errors: MEMORY (with figures), NUMERIC, UNAVAILABLE. */
pliant_status pliant_cuda_preconditioner_create(const pliant_system *system, pliant_preconditioner_choice choice, const gpu_state_made_at *at, cudaStream_t stream,
                                                gpu_preconditioner *out);
void pliant_cuda_preconditioner_free(gpu_preconditioner *preconditioner);
/* d_left = M d_right of the iteration; nothing where the state says that it skips. */
pliant_status pliant_cuda_precondition(const gpu_preconditioner *preconditioner, const gpu_iteration *iteration, cudaStream_t stream);
/* Z = T M T' W' for one tool's W, with T the turn at each node: d_response (3 x 3 num_free). Takes d_right and
 * d_left. */
pliant_status pliant_cuda_respond(const gpu_preconditioner *preconditioner, const gpu_iteration *iteration, const gpu_tool *tool, double *d_response,
                                  cudaStream_t stream);

/* Columns of M, at rest: three for each unknown node. which: (count x 2) unknown node and the first of the slots of its
 * columns, of the host and of the GPU; d_column + stride slot: a column, padded. Takes d_right. */
pliant_status pliant_cuda_columns(const gpu_preconditioner *preconditioner, const gpu_iteration *iteration, int32_t count, const int32_t *h_which,
                                  const int32_t *d_which, size_t stride, float *d_column, cudaStream_t stream);

#ifdef __cplusplus
}
#endif
#endif
