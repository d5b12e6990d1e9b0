/* The preconditioner of large systems: one V-cycle (src/fem/linear/multigrid.c) in single precision, down to a level
 * with a dense inverse. */
#ifndef PLIANT_CUDA_MULTIGRID_H
#define PLIANT_CUDA_MULTIGRID_H

#include "fem/system.h"
#include "cuda/fem/linear/inverse.h"

typedef struct gpu_multigrid gpu_multigrid;

/* Create the multigrid of one state.
 * @param h_x      (3 num_nodes) the state [m].
 * @param largest  Maximum number of free nodes of the dense level.
 * @param out      NULL if the lattice cannot be coarsened that much.
 * Errors: MEMORY, NUMERIC, UNAVAILABLE. */
pliant_status pliant_cuda_multigrid_create(const pliant_system *system, const double *h_x, int32_t largest,
                                           cudaStream_t stream, gpu_multigrid **out);
void pliant_cuda_multigrid_free(gpu_multigrid *multigrid); /* Nullable */
size_t pliant_cuda_multigrid_bytes(const gpu_multigrid *multigrid);
/* Do the same as pliant_cuda_inverse_apply. */
pliant_status pliant_cuda_multigrid_apply(const gpu_multigrid *multigrid, const int32_t *d_skip, const float *d_right,
                                          float *d_left, cudaStream_t stream);
/* Do the same as pliant_cuda_inverse_columns, with several V-cycles at once. Errors: MEMORY, UNAVAILABLE. */
pliant_status pliant_cuda_multigrid_columns(gpu_multigrid *multigrid, int32_t count, const int32_t *d_which,
                                            size_t stride, float *d_column, cudaStream_t stream);

#endif
