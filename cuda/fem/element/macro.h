/* Macro-elements on the GPU (struct pliant_macros of src/fem/system.h, src/fem/element/macro.c). */
#ifndef PLIANT_CUDA_MACRO_H
#define PLIANT_CUDA_MACRO_H

#include "fem/element/macro_element.h"
#include "fem/system.h"

#include <cuda_runtime_api.h>

struct gpu_system;
struct gpu_iteration;

/* The arrays of struct pliant_macros; arrays per cube are concatenated. All pointers are device pointers. */
typedef struct gpu_macros {
    int32_t count, corners;         /* 0: no macro-elements */
    int32_t max_unknowns, max_rank; /* maxima over the cubes */
    int32_t *d_start, *d_node, *d_own, *d_rank, *d_cube_of_corner, *d_fine_start, *d_fine;
    uint8_t *d_held, *d_grounded;
    double *d_gradient, *d_shear; /* d_shear is NULL for homogenized elements */
    pliant_macro_law *d_law;      /* (count) NULL: corotational */
    double *d_addition;           /* (count x 9) additional stress of the law; NULL without d_law [N m] */
    pliant_macro_frame *d_frame; /* (count) of the last requested iterate */
    int64_t *d_root_start;     /* (count) into d_root */
    float *d_root;
    int32_t *d_entry_start;    /* (following fine nodes + 1) into the entries */
    uint16_t *d_entry_corner;
    float *d_entry_shape;
} gpu_macros;

enum { MACRO_ARRAYS = 19 };

/* Create the macro-elements, or replace them after a cut. `capacity`: (MACRO_ARRAYS) of the arrays, in bytes.
 * Errors: MEMORY, UNAVAILABLE; the caller frees partial results. */
pliant_status pliant_cuda_macros_set(const pliant_macros *macros, bool grows, cudaStream_t stream, size_t *capacity,
                                     gpu_macros *out);
void pliant_cuda_macros_free(gpu_macros *macros);

/* Compute the forces of the evaluated iterate in d_element_force, four numbers per corner. */
pliant_status pliant_cuda_macro_forces(const struct gpu_system *system, const struct gpu_iteration *iteration,
                                       cudaStream_t stream);
/* Compute the cubes' contributions to the axes of their nodes (nodal_rotations.h) for the present iterate, in
 * d_rotations, 16 numbers per cube. */
pliant_status pliant_cuda_macro_rotations(const struct gpu_system *system, const struct gpu_iteration *iteration,
                                          cudaStream_t stream);
/* Compute the frames of the cubes of the present iterate in d_frame. */
pliant_status pliant_cuda_macro_frames(const struct gpu_system *system, const struct gpu_iteration *iteration,
                                       cudaStream_t stream);
/* Compute the fine nodes of the present iterate. */
pliant_status pliant_cuda_macro_positions(const struct gpu_system *system, const struct gpu_iteration *iteration,
                                          double *d_fine, cudaStream_t stream);

#endif
