/* Macro-elements of lod on the GPU (struct pliant_macros of src/fem/system.h, src/fem/element/macro.c). */
#ifndef PLIANT_CUDA_MACRO_H
#define PLIANT_CUDA_MACRO_H

#include "fem/element/macro_element.h"
#include "fem/system.h"

#include <cuda_runtime_api.h>

#ifdef __cplusplus
extern "C" {
#endif

struct gpu_system;
struct gpu_iteration;

/* As struct pliant_macros has them, what it keeps a cube on its own after each other. Every pointer is of the
 * device. */
typedef struct gpu_macros {
    int32_t count, corners;    /* 0: there are none */
    int32_t most_unknowns, most_rank; /* of a cube */
    int32_t *d_start, *d_node, *d_own, *d_rank, *d_cube_of_corner, *d_fine_start, *d_fine;
    uint8_t *d_held, *d_grounded;
    double *d_gradient, *d_shear; /* the latter NULL: homogenized */
    pliant_macro_frame *d_frame; /* (count) of the iterate that was asked for last */
    int64_t *d_root_start;     /* (count) into d_root */
    float *d_root;
    int32_t *d_entry_start;    /* (fine nodes that follow + 1) into the entries */
    uint16_t *d_entry_corner;
    float *d_entry_shape;
} gpu_macros;

enum { MACRO_ARRAYS = 17 };

/* Made, or those of the next body in the place of those before; room: (MACRO_ARRAYS) bytes of its arrays. Errors:
 * MEMORY, UNAVAILABLE. What was made until then is freed by the caller. */
pliant_status pliant_cuda_macros_set(const pliant_macros *macros, bool grows, cudaStream_t stream, size_t *room, gpu_macros *out);
void pliant_cuda_macros_free(gpu_macros *macros);

/* Forces of the iterate under evaluation to d_element_force, four numbers a corner. */
pliant_status pliant_cuda_macro_forces(const struct gpu_system *system, const struct gpu_iteration *iteration, cudaStream_t stream);
/* What cubes of the present iterate say of the axes of their nodes (nodal_rotations.h) to d_rotations, 16 numbers a
 * cube. */
pliant_status pliant_cuda_macro_rotations(const struct gpu_system *system, const struct gpu_iteration *iteration, cudaStream_t stream);
/* Frames of the cubes of the present iterate, to d_frame. */
pliant_status pliant_cuda_macro_frames(const struct gpu_system *system, const struct gpu_iteration *iteration, cudaStream_t stream);
/* Fine nodes of the present iterate. */
pliant_status pliant_cuda_macro_positions(const struct gpu_system *system, const struct gpu_iteration *iteration, double *d_fine, cudaStream_t stream);

#ifdef __cplusplus
}
#endif
#endif
