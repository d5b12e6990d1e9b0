/* The preconditioner of small systems, and of the coarsest level of large ones: the inverse of the matrix, dense, in
 * float, applied as one matrix-vector product. Only the lower triangle of tiles is kept, and read once. The inversion
 * is done in double, by symmetric sweeps. */
#ifndef PLIANT_CUDA_INVERSE_H
#define PLIANT_CUDA_INVERSE_H

#include "cuda/fem/state.h"

#ifdef __cplusplus
extern "C" {
#endif

enum { INVERSE_TILE = 128, INVERSE_SWEEP = 64 };

/* Symmetric sweeps over a matrix in double, in tiles of INVERSE_SWEEP unknowns, the lower triangle of them row after
 * row (sweep.cu). */
typedef struct gpu_sweep {
    double *d_tiles;      /* pliant_cuda_sweep_bytes */
    double *d_room;       /* pliant_cuda_sweep_room */
    int *d_failed;        /* out: 1: not positive definite */
} gpu_sweep;

size_t pliant_cuda_sweep_bytes(int32_t tiles);
size_t pliant_cuda_sweep_room(int32_t tiles);
/* Enqueue sweeps over the unknowns p of the first `pivots` of so many tiles along each side, in place: A_pp becomes
 * -A_pp^-1, A_op becomes A_op A_pp^-1; columns beyond are not used. d_whole: Nullable: (SWEEP pivots) the diagonal:
 * where no more than a share is left of it, an unknown is held by as much, in place of a failure. */
pliant_status pliant_cuda_sweep(const gpu_sweep *sweep, const double *d_whole, double share, int32_t pivots, int32_t tiles, cudaStream_t stream);

typedef struct gpu_inverse {
    int32_t size, tiles;  /* unknowns; tiles along each side */
    float *d_tiles;       /* (tiles (tiles + 1) / 2 x TILE x TILE), row after row of tiles */
    float *d_parts;       /* (tiles x TILE tiles): what each column of tiles adds to each unknown */
} gpu_inverse;

/* Unknowns, rounded up to whole tiles. */
int32_t pliant_cuda_inverse_padded(int32_t size);
/* Bytes that making it takes at most, and that it keeps. */
size_t pliant_cuda_inverse_room(int32_t size, size_t *kept);
/* h_values: of the pattern (pliant_system_assemble). holds: what moves without force is held: of a level above
 * fragments, where several unknowns may stand for what moves few nodes. Errors: MEMORY, NUMERIC (not positive definite;
 * not where it holds), UNAVAILABLE. */
pliant_status pliant_cuda_inverse_create(const pliant_pattern *pattern, const double *h_values, bool holds, cudaStream_t stream, gpu_inverse *out);
void pliant_cuda_inverse_free(gpu_inverse *inverse);

/* d_left = inverse * d_right, both padded, the padding of d_right 0. d_skip: Nullable; nothing is done where it is not
 * 0. */
pliant_status pliant_cuda_inverse_apply(const gpu_inverse *inverse, const int32_t *d_skip, const float *d_right, float *d_left, cudaStream_t stream);
/* Of so many vectors at once, the next ones after each `stride` numbers; d_parts of inverse has room for as many of
 * pliant_cuda_inverse_parts numbers. */
pliant_status pliant_cuda_inverse_apply_all(const gpu_inverse *inverse, const int32_t *d_skip, int32_t count, size_t stride, const float *d_right, float *d_left,
                                            cudaStream_t stream);
size_t pliant_cuda_inverse_parts(const gpu_inverse *inverse);
/* Whole columns of it: d_column + stride slot of the (3 count) unknowns in d_which, which come with their slots: (count
 * x 2) unknown node and the first of the slots of its three columns. */
pliant_status pliant_cuda_inverse_columns(const gpu_inverse *inverse, int32_t count, const int32_t *d_which, size_t stride, float *d_column, cudaStream_t stream);
/* Z = T inverse T' W' for one tool's W, with T the turn at each node: d_response (3 x size). */
pliant_status pliant_cuda_inverse_response(const gpu_inverse *inverse, const gpu_iteration *iteration, const gpu_tool *tool, double *d_response,
                                           cudaStream_t stream);

#ifdef __cplusplus
}
#endif
#endif
