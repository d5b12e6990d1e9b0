/* The test of the volume bound for small elements (contact/volume/volume_bound.h), on the GPU. If no element is small,
 * the host skips its own test. */
#ifndef PLIANT_CUDA_VOLUME_BOUND_H
#define PLIANT_CUDA_VOLUME_BOUND_H

#include "contact/settings.h"
#include "cuda/base/check.h"
#include "topology/body.h"

#ifdef __cplusplus
extern "C" {
#endif

/* All zero: without a topology. It takes 16 bytes for each tetrahedron, and 48 bytes for each node. */
typedef struct gpu_volume_bound {
    uint64_t revision; /* of the topology; 0: none */
    int32_t num_tets;
    void *d_tets, *d_rest, *d_from; /* (num_tets x 4), (nodes x 3), (nodes x 3) start of the leg [m] */
    size_t tets_capacity, rest_capacity, from_capacity;
    int32_t *d_any, *h_any; /* (2) results */
    bool has_from;          /* d_from is set */
    bool is_enqueued;       /* the test of the present leg is enqueued */
    /* result of the last test: an element is below volume_near at its end */
    bool has_near, is_near;
} gpu_volume_bound;

void pliant_cuda_volume_free(gpu_volume_bound *bound); /* frees its contents */
/* Enqueue a copy of the positions at the start of a leg. Errors: UNAVAILABLE. */
pliant_status pliant_cuda_volume_begin_leg(gpu_volume_bound *bound, const double *d_positions, size_t num_nodes,
                                           cudaStream_t stream);
/* Enqueue the test of the elements. Errors: UNAVAILABLE.
 * @param is_still    the nodes do not move: d_from is not read
 * @param d_positions (nodes x 3) end of the leg [m] */
pliant_status pliant_cuda_volume_enqueue(gpu_volume_bound *bound, const pliant_contact_settings *settings,
                                         bool is_still, const double *d_positions, cudaStream_t stream);
/* Wait for the stream. Find whether an element may become too small during the leg, and whether one is below
 * volume_near at its end. Errors: UNAVAILABLE. */
pliant_status pliant_cuda_volume_finish(gpu_volume_bound *bound, cudaStream_t stream, bool *may_be_small);
/* Send the topology, unless it is there. Errors: MEMORY, UNAVAILABLE. */
pliant_status pliant_cuda_volume_set_body(gpu_volume_bound *bound, const pliant_body *body, cudaStream_t stream);

#ifdef __cplusplus
}
#endif
#endif
