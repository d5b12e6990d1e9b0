/* Contacts of explicit dynamics on the GPU: points are found by the host as a frame begins (src/sim/step/contact.c),
 * put right in every sub-step by one block (tled_touch.cuh), and their forces come back as it ends. */
#ifndef PLIANT_CUDA_TLED_TOUCH_H
#define PLIANT_CUDA_TLED_TOUCH_H

#include "cuda/fem/dynamics/tled_state.h"

#ifdef __cplusplus
extern "C" {
#endif

/* The points of a frame by levels: each comes after those before it that it has a node in common with, so that points
 * of one level can be put right at once, and the outcome is that of one after the other. */
typedef struct gpu_touching {
    int32_t num_points, num_levels, num_near;
    int32_t room_points, room_near;
    pliant_contact_point *h_point; /* (num_points) page-locked, as the next ones; their nodes are places in near */
    pliant_tled_touch *h_touch;
    int32_t *h_level;          /* (num_levels + 1) the first of each */
    int32_t *order;            /* (num_points) which of the host's points */
    int32_t *level_of;         /* (num_points) of the host's */
    int32_t *near;             /* (num_near) nodes that points have */
    int32_t *place, *last;     /* (nodes) in near, or -1; the level of the last point that has it */
} gpu_touching;

void pliant_cuda_touching_free(gpu_touching *touching, gpu_tled *tled);
/* The points of this frame, which has begun (pliant_tled_touch_begin), sorted. moved: out: rooms are elsewhere, for
 * what was recorded with them. Errors: MEMORY. */
pliant_status pliant_cuda_touching_sort(const pliant_tled *tled, gpu_touching *touching, gpu_tled *gpu, bool *moved);
pliant_status pliant_cuda_touching_send(const gpu_touching *touching, const gpu_tled *gpu, cudaStream_t stream);
/* enqueue; then, when they have come, to the host's */
pliant_status pliant_cuda_touching_download(const gpu_touching *touching, const gpu_tled *gpu, cudaStream_t stream);
void pliant_cuda_touching_take(const gpu_touching *touching, pliant_tled *tled);

#ifdef __cplusplus
}
#endif
#endif
