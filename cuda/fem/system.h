/* The constant system on the GPU (struct pliant_system has the meaning of each part). */
#ifndef PLIANT_CUDA_SYSTEM_H
#define PLIANT_CUDA_SYSTEM_H

#include "cuda/fem/element/macro.h"

#include <cuda_runtime_api.h>

#ifdef __cplusplus
extern "C" {
#endif

/* Every pointer is of the device. */
typedef struct gpu_system {
    int32_t num_tets, num_nodes, num_free, num_fine;
    int32_t tet_stride;        /* num_tets, or more where a cut may add some */
    int32_t *d_tets;           /* (num_tets x 4) */
    double *d_rest;            /* (num_nodes x 3) [m] */
    double *d_gradients;       /* (12 x tet_stride) */
    double *d_lame;            /* (2 x tet_stride) */
    double *d_stiffness;       /* (144 x tet_stride); NULL: isotropic */
    uint8_t *d_grounded;       /* (num_tets); NULL: none */
    int32_t *d_node_of_free;   /* (num_free) */
    int32_t *d_corner_start, *d_corner_end, *d_corner;
    /* upsampling; all NULL when the fine mesh is solved */
    double *d_fine_rest;       /* (num_fine x 3) */
    int corners;               /* 4, or 8 */
    int32_t *d_upsample_node;  /* (num_fine x corners); NULL: by homogenized shape functions, or by macro-elements */
    double *d_weights;         /* (num_fine x corners) */
    int32_t *d_entry_start, *d_entry_element;
    double *d_entry_share, *d_entry_shape;
    uint8_t *d_still;          /* Nullable */
    gpu_macros macros;         /* in place of tetrahedra */
} gpu_system;

enum { SYSTEM_ARRAYS = 18 };

/* How much its arrays have room for. */
typedef struct gpu_system_room {
    bool grows;                /* more than there is now, for what cuts will add */
    size_t bytes[SYSTEM_ARRAYS], macros[MACRO_ARRAYS];
    void *d_passage;           /* what elements go through on their way */
} gpu_system_room;

/* room: zeroed, but for grows. Errors: MEMORY, UNAVAILABLE. */
pliant_status pliant_cuda_system_create(const pliant_system *system, cudaStream_t stream, gpu_system *out, gpu_system_room *room);
/* Of the next body, in place of the one before: what is the same is not sent again, but of macros. After an error it is
 * of neither. */
pliant_status pliant_cuda_system_follow(const pliant_system *system, const pliant_system *before, cudaStream_t stream, gpu_system *gpu, gpu_system_room *room);
void pliant_cuda_system_free(gpu_system *system, gpu_system_room *room);

#ifdef __cplusplus
}
#endif
#endif
