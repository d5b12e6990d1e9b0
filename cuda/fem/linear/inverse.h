/* The preconditioner of small systems, and of the coarsest level of large ones: a dense inverse in single precision,
 * applied as one matrix-vector product. Only the lower triangle of tiles is stored, and read once. The inversion runs
 * in double precision, by symmetric sweeps. */
#ifndef PLIANT_CUDA_INVERSE_H
#define PLIANT_CUDA_INVERSE_H

#include "cuda/fem/solver_state.h"

enum { INVERSE_TILE = 128, INVERSE_SWEEP = 64 };

/* Symmetric sweeps over a matrix in double precision. Tiles have INVERSE_SWEEP unknowns; the lower triangle of tiles is
 * stored row by row (sweep.cu). */
typedef struct gpu_sweep {
    double *d_tiles;  /* pliant_cuda_sweep_bytes */
    double *d_buffer; /* pliant_cuda_sweep_buffer_bytes */
    int *d_failed;    /* out: 1: not positive definite */
} gpu_sweep;

size_t pliant_cuda_sweep_bytes(int32_t tiles);
size_t pliant_cuda_sweep_buffer_bytes(int32_t tiles);
/* Enqueue sweeps over the unknowns p of the first `pivots` tiles, overwriting the matrix: A_pp becomes -A_pp^-1, A_op
 * becomes A_op A_pp^-1. Columns beyond p are not used.
 * @param d_whole  Nullable: (SWEEP pivots) original diagonal. It replaces a pivot that is at most
 *     `fraction` times the original, instead of a failure.
 * @param tiles    Number of tiles along each side. */
pliant_status pliant_cuda_sweep(const gpu_sweep *sweep, const double *d_whole, double fraction, int32_t pivots,
                                int32_t tiles, cudaStream_t stream);

typedef struct gpu_inverse {
    int32_t size, tiles;  /* number of unknowns, and of tiles along each side */
    float *d_tiles;       /* (tiles (tiles + 1) / 2 x TILE x TILE), tiles row by row */
    float *d_parts;       /* (tiles x TILE tiles): contribution of each column of tiles to each unknown */
} gpu_inverse;

/* Return the number of unknowns, rounded up to complete tiles. */
int32_t pliant_cuda_inverse_padded(int32_t size);
/* Return the maximum memory during creation, and the permanent memory in `kept` [bytes]. */
size_t pliant_cuda_inverse_memory(int32_t size, size_t *kept);
/* Create the inverse. Errors: MEMORY, NUMERIC (not positive definite, only without `holds`), UNAVAILABLE.
 * @param h_values  Values of the pattern (pliant_system_assemble).
 * @param holds     Hold unknowns that move without force. They occur on a level above fragments, where several unknowns
 *     can move the same few nodes. */
pliant_status pliant_cuda_inverse_create(const pliant_pattern *pattern, const double *h_values, bool holds,
                                         cudaStream_t stream, gpu_inverse *out);
void pliant_cuda_inverse_free(gpu_inverse *inverse);

/* Compute d_left = inverse * d_right. Both are padded, with zeros in the padding of d_right. d_skip: Nullable: nonzero:
 * do nothing. */
pliant_status pliant_cuda_inverse_apply(const gpu_inverse *inverse, const int32_t *d_skip, const float *d_right,
                                        float *d_left, cudaStream_t stream);
/* Apply the inverse to `count` vectors, `stride` numbers apart. d_parts of the inverse must hold `count` times
 * pliant_cuda_inverse_parts numbers. */
pliant_status pliant_cuda_inverse_apply_all(const gpu_inverse *inverse, const int32_t *d_skip, int32_t count,
                                            size_t stride, const float *d_right, float *d_left, cudaStream_t stream);
size_t pliant_cuda_inverse_parts(const gpu_inverse *inverse);
/* Copy complete columns of the inverse to d_column + stride slot. d_which: (count x 2) unknown node, and the first slot
 * of its three columns. */
pliant_status pliant_cuda_inverse_columns(const gpu_inverse *inverse, int32_t count, const int32_t *d_which,
                                          size_t stride, float *d_column, cudaStream_t stream);
/* Compute Z = T inverse T' W' for one tool's W, with T the rotations of the nodes. d_response: (3 x size). */
pliant_status pliant_cuda_inverse_response(const gpu_inverse *inverse, const gpu_iteration *iteration,
                                           const gpu_tool *tool, double *d_response, cudaStream_t stream);

#endif
