/* A preconditioner of a body before, carried over to the next one (src/fem/linear/carried.h has the formula and what it
 * is around):
 *     M^-1 = S + E P V P' E',  E = I - S K
 * With inner unknowns i, where S is the inverse of the stiffness, and outer ones o, which share an element with an
 * inner one, E leaves what it is given but for inner unknowns, where it puts -S K_io v_o. S and K_oi S are kept dense;
 * both come of one symmetric sweep over the inner unknowns. As all that stands for an inverse on the GPU, they are of
 * rest, and vectors are in the nodes' own axes. */
#ifndef PLIANT_CUDA_CARRIED_H
#define PLIANT_CUDA_CARRIED_H

#include "fem/linear/carried.h"
#include "cuda/fem/linear/inverse.h"
#include "cuda/fem/system.h"

#ifdef __cplusplus
extern "C" {
#endif

enum { CARRIED_ARRAYS = 12 };

typedef struct gpu_carried {
    int32_t num_free, base_free;  /* here; there. base_free 0: nothing is carried over */
    int32_t inner, outer;         /* unknown nodes */
    int32_t stride;               /* of d_answer */
    const int32_t *d_node_of_free;/* of the system */
    int32_t *d_source;            /* (num_free) unknown there, or -1 */
    int32_t *d_taker_start, *d_taker; /* (base_free + 1), (num_free) the unknowns here by their source */
    int32_t *d_near;              /* (inner + outer) unknowns */
    int32_t *d_place;             /* (nodes of the system) place there + 1, or 0 */
    float *d_answer;              /* (3 (inner + outer) x stride): rows of S, then of K_oi S; 3 inner columns */
    float *d_found, *d_pull;      /* (3 inner) S r_i; (3 outer) K_oi S r_i */
    float *d_right, *d_left;      /* of the base, padded */
} gpu_carried;

/* What making and keeping it takes. */
typedef struct gpu_carried_room {
    size_t bytes[CARRIED_ARRAYS];
    gpu_sweep sweep;
    size_t sweep_room[3];
    int32_t *h_source;            /* (num_free) of the host; NULL: nothing is carried over */
} gpu_carried_room;

/* h_source: (num_free) of pliant_alloc, taken over, also on an error; base: what V is of. *possible: false: too much is
 * opened, and nothing was done but that. Errors: MEMORY, UNAVAILABLE. */
pliant_status pliant_cuda_carried_set(const pliant_system *system, const gpu_system *gpu, const pliant_carried_layout *base, int32_t *h_source,
                                      cudaStream_t stream, gpu_carried *carried, gpu_carried_room *room, bool *possible);
void pliant_cuda_carried_clear(gpu_carried *carried, gpu_carried_room *room); /* nothing is carried over; arrays stay */
void pliant_cuda_carried_free(gpu_carried *carried, gpu_carried_room *room);

/* Kernels are loaded when they are first used, which waits for all that the device does: what steps may want while
 * something is made in the background is loaded ahead. */
pliant_status pliant_cuda_carried_load(void);

/* The two halves of a product, before and after the base's d_left = V d_right. */
pliant_status pliant_cuda_carried_below(const gpu_carried *carried, const int32_t *d_skip, const float *d_right, cudaStream_t stream);
pliant_status pliant_cuda_carried_above(const gpu_carried *carried, const int32_t *d_skip, float *d_left, cudaStream_t stream);

#ifdef __cplusplus
}
#endif
#endif
