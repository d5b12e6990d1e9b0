/* A preconditioner carried over a cut. src/fem/linear/carried_preconditioner.h derives the formula:
 *     M^-1 = S + E P V P' E',  E = I - S K
 * S is the inverse of the stiffness on the inner unknowns i. Outer unknowns o share an element with an inner one. E
 * changes only inner unknowns, where it gives -S K_io v_o. S and K_oi S are stored as dense matrices, from one
 * symmetric sweep over the inner unknowns. Like V they belong to the rest state, and vectors are in the nodes' axes. */
#ifndef PLIANT_CUDA_FEM_LINEAR_CARRIED_PRECONDITIONER_H
#define PLIANT_CUDA_FEM_LINEAR_CARRIED_PRECONDITIONER_H

#include "fem/linear/carried_preconditioner.h"
#include "cuda/fem/linear/inverse.h"
#include "cuda/fem/system.h"

enum { CARRIED_ARRAYS = 12 };

typedef struct gpu_carried {
    int32_t num_free, base_free;  /* unknown nodes after and before the cut; base_free 0: no carried preconditioner */
    int32_t inner, outer;         /* unknown nodes */
    int32_t stride;               /* row stride of d_answer */
    const int32_t *d_node_of_free;/* from the system */
    int32_t *d_source;            /* (num_free) unknown before the cut, or -1 */
    int32_t *d_taker_start, *d_taker; /* (base_free + 1), (num_free) unknowns sorted by their source */
    int32_t *d_near;              /* (inner + outer) unknowns */
    int32_t *d_place;             /* (nodes of the system) index in d_near + 1, or 0 */
    float *d_answer;              /* (3 (inner + outer) x stride): rows of S, then of K_oi S; 3 inner columns */
    float *d_found, *d_pull;      /* (3 inner) S r_i; (3 outer) K_oi S r_i */
    float *d_right, *d_left;      /* vectors of the base, padded */
} gpu_carried;

/* Capacities and work arrays of a carried preconditioner. */
typedef struct gpu_carried_capacity {
    size_t bytes[CARRIED_ARRAYS];
    gpu_sweep sweep;
    size_t sweep_capacity[3];
    int32_t *h_source;            /* (num_free) on the host; NULL: no carried preconditioner */
} gpu_carried_capacity;

/* Carry over a preconditioner.
 * @param base      Layout of V's system.
 * @param h_source  (num_free) allocated with pliant_calloc; this function takes ownership, also on an error.
 * @param possible  Out: false: the cut has opened too much tissue, and nothing was changed except h_source.
 * Errors: MEMORY, UNAVAILABLE. */
pliant_status pliant_cuda_carried_set(const pliant_system *system, const gpu_system *gpu,
                                      const pliant_carried_layout *base, int32_t *h_source, cudaStream_t stream,
                                      gpu_carried *carried, gpu_carried_capacity *capacity, bool *possible);
/* Removes the carried preconditioner; arrays stay allocated. */
void pliant_cuda_carried_clear(gpu_carried *carried, gpu_carried_capacity *capacity);
void pliant_cuda_carried_free(gpu_carried *carried, gpu_carried_capacity *capacity);

/* Load the kernels in advance. CUDA loads a kernel at its first use and waits for all device work, which would make a
 * step wait for background work. */
pliant_status pliant_cuda_carried_load_kernels(void);

/* Apply the parts of a product before (below) and after (above) the base's d_left = V d_right. */
pliant_status pliant_cuda_carried_restrict(const gpu_carried *carried, const int32_t *d_skip, const float *d_right,
                                           cudaStream_t stream);
pliant_status pliant_cuda_carried_extend(const gpu_carried *carried, const int32_t *d_skip, float *d_left,
                                         cudaStream_t stream);

#endif
