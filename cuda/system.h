/* The constant system on the GPU (struct pliant_system has the meaning of each part). */
#ifndef PLIANT_CUDA_SYSTEM_H
#define PLIANT_CUDA_SYSTEM_H

#include "macro.h"

#include <cuda_runtime_api.h>

#ifdef __cplusplus
extern "C" {
#endif

/* Every pointer is of the device. */
typedef struct gpu_system {
    int32_t num_tets, num_nodes, num_free, num_fine;
    int32_t *d_tets;           /* (num_tets x 4) */
    double *d_rest;            /* (num_nodes x 3) [m] */
    double *d_gradients;       /* (12 x num_tets) */
    double *d_lame;            /* (2 x num_tets) */
    double *d_stiffness;       /* (144 x num_tets); NULL: isotropic */
    uint8_t *d_grounded;       /* (num_tets); NULL: none */
    int32_t *d_node_of_free;   /* (num_free) */
    int32_t *d_corner_start, *d_corner;
    /* upsampling; all NULL when the fine mesh is solved */
    double *d_fine_rest;       /* (num_fine x 3) */
    int corners;               /* 4, or 8 */
    int32_t *d_upsample_node;  /* (num_fine x corners); NULL: by homogenized shape functions, or by macro-elements */
    double *d_weights;         /* (num_fine x corners) */
    int32_t *d_entry_start, *d_entry_tet;
    double *d_entry_share, *d_entry_shape;
    uint8_t *d_still;          /* Nullable */
    gpu_macros macros;         /* in place of tetrahedra */
} gpu_system;

pliant_status pliant_cuda_system_create(const pliant_system *system, cudaStream_t stream, gpu_system *out);
void pliant_cuda_system_free(gpu_system *system);

#ifdef __cplusplus
}
#endif
#endif
