/* Broad phase of contact with rigid parts on the GPU (contact/advance/near_triangles.h). */
#ifndef PLIANT_CUDA_CONTACT_NEAR_TRIANGLES_H
#define PLIANT_CUDA_CONTACT_NEAR_TRIANGLES_H

#include "backend/backend.h"
#include "cuda/base/check.h"

#ifdef __cplusplus
extern "C" {
#endif

enum { NEAR_TRIANGLES, NEAR_NODES, NEAR_WEIGHTS, NEAR_REGIONS, NEAR_BLOCKS };

/* All zero: without a surface. It takes 12 bytes for each triangle, and 48 bytes for each corner. */
typedef struct gpu_near {
    uint64_t revision; /* of the topology; 0: none */
    int32_t num_triangles;
    /* (num_triangles x 3) corners; (corners x 4) nodes that move each corner, and their weights; regions */
    void *d_block[NEAR_BLOCKS];
    size_t capacity[NEAR_BLOCKS];
    uint32_t *mask; /* bit t: triangle t is near; page-locked host memory that the kernel writes to */
    int32_t mask_capacity, triangle_capacity;
    int32_t *triangle; /* (triangle_capacity) list of the host */
} gpu_near;

void pliant_cuda_near_free(gpu_near *near); /* frees its contents */
/* Send the surface, unless it is there. Errors: MEMORY, UNAVAILABLE. */
pliant_status pliant_cuda_near_set_surface(gpu_near *near, const pliant_near_surface *surface, cudaStream_t stream);
/* List the triangles that may be near one of the regions while all nodes move along straight lines. Wait for the
 * stream. d_from, d_to: (nodes x 3) [m]. Errors: UNAVAILABLE. */
pliant_status pliant_cuda_near_find(gpu_near *near, const double *d_from, const double *d_to, int32_t count,
                                    const pliant_near_region *regions, cudaStream_t stream, pliant_triangle_list *out);

#ifdef __cplusplus
}
#endif
#endif
