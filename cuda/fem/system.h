/* The constant system on the GPU. struct pliant_system documents each part. */
#ifndef PLIANT_CUDA_SYSTEM_H
#define PLIANT_CUDA_SYSTEM_H

#include "cuda/fem/element/macro.h"

#include <cuda_runtime_api.h>

/* The system. All pointers are device pointers. */
typedef struct gpu_system {
    int32_t num_tets, num_nodes, num_free, num_fine;
    int32_t tet_stride;        /* num_tets, or more if cuts may add tetrahedra */
    int32_t *d_tets;           /* (num_tets x 4) */
    double *d_rest;            /* (num_nodes x 3) [m] */
    double *d_gradients;       /* (12 x tet_stride) */
    double *d_lame;            /* (2 x tet_stride) */
    double *d_stiffness;       /* (144 x tet_stride); NULL: isotropic */
    pliant_elasticity law;     /* of isotropic tetrahedra */
    uint8_t *d_grounded;       /* (num_tets); NULL: no grounded element */
    int32_t *d_node_of_free;   /* (num_free) */
    int32_t *d_free_of_node;   /* (num_nodes) or -1; NULL: no cut has put nodes on edges */
    int32_t *d_corner_start, *d_corner_end, *d_corner;
    /* Upsampling; all NULL if the fine mesh is the solved mesh. */
    double *d_fine_rest;       /* (num_fine x 3) */
    int corners;               /* 4, or 8 */
    int32_t *d_upsample_node;  /* (num_fine x corners); NULL: homogenized shape functions or macro-elements */
    double *d_weights;         /* (num_fine x corners) */
    int32_t *d_entry_start, *d_entry_element;
    double *d_entry_weight, *d_entry_shape;
    uint8_t *d_still;          /* Nullable */
    gpu_macros macros;         /* replace the tetrahedra */
} gpu_system;

enum { SYSTEM_ARRAYS = 19 };

/* Capacities of the arrays. */
typedef struct gpu_system_capacity {
    bool grows;                /* reserve memory for elements that cuts will add */
    size_t bytes[SYSTEM_ARRAYS], macros[MACRO_ARRAYS];
    void *d_passage;           /* buffer for the transfer of elements */
} gpu_system_capacity;

/* Create the system on the GPU. `capacity`: zeroed, except for `grows`. Errors: MEMORY, UNAVAILABLE. */
pliant_status pliant_cuda_system_create(const pliant_system *system, cudaStream_t stream, gpu_system *out,
                                        gpu_system_capacity *capacity);
/* Update the system after a cut. Only changed data is sent, except for macro-elements. After an error the
 * content is undefined. */
pliant_status pliant_cuda_system_carry_over_cut(const pliant_system *system, const pliant_system *before,
                                                cudaStream_t stream, gpu_system *gpu, gpu_system_capacity *capacity);
void pliant_cuda_system_free(gpu_system *system, gpu_system_capacity *capacity);

#endif
