/* Rasterize the deformed volume on the GPU. Tetrahedra are set up and sorted into bricks; then one block writes each
 * brick. The volume is bitwise identical to the CPU's for the same positions (rules in src/warp/raster.h). */
#ifndef PLIANT_CUDA_RASTERIZE_H
#define PLIANT_CUDA_RASTERIZE_H

#include "warp/parts.h"
#include "warp/raster.h"

#include <cuda_runtime_api.h>

/* Kernel arguments. All pointers are device pointers. */
typedef struct gpu_raster {
    raster_grid grid;
    double reciprocal[3];            /* of the target's spacing */
    pliant_encoding encoding;
    int32_t source_size[3], source_step[3];
    /* (scan voxels) 8 and 16 bit voxels are stored as 32 bits: the voxel in the low half, its right neighbour in the
     * high half, 16 bit ones plus 2^15 to avoid negative numbers. Floats are stored as two: the voxel, and the
     * difference to its right neighbour. */
    const void *d_source;
    /* only the background value and the interpolation mode are used; labels take the nearest voxel */
    raster_source background;
    int32_t num_tets, num_elements, num_bricks; /* elements: tetrahedra followed by carried tetrahedra */
    const int32_t *d_tets;           /* (num_tets x 4) */
    const part_carried_tet *d_carried;      /* (num_elements - num_tets) */
    part_view parts;                 /* elements NULL: no cuts */
    uint8_t *d_has_parts;            /* (num_bricks) whether an element at a cut touches the brick; 0 between updates */
    const uint8_t *d_zone;           /* (num_elements) for a fit, 0: not drawn by its own map; NULL: all are */
    const double *d_rest;            /* (num_nodes x 3) continuous index in the scan */
    int32_t *d_fixed;                /* (num_elements x 12) fixed-point corners of the last update */
    void *d_setup;                   /* (num_elements) gpu_tet of the last update */
    int32_t *d_count;                /* (num_bricks) number of candidates; 0 between updates */
    int32_t *d_list;                 /* (num_bricks x capacity) candidates, in any order */
    int32_t capacity;
    uint8_t *d_dirty, *d_changed;    /* (num_bricks); dirty is 0 between updates */
    /* maximum list length of all updates; above capacity, lists were truncated and the update is repeated */
    int32_t *d_longest;
    void *d_volume;
} gpu_raster;

size_t pliant_cuda_source_bytes(pliant_encoding encoding); /* bytes per voxel in d_source */
size_t pliant_cuda_setup_bytes(void); /* bytes per tetrahedron in d_setup */

/* Convert d_voxels (count, in the scan's encoding) to d_source. */
pliant_status pliant_cuda_prepare_source(const gpu_raster *raster, const void *d_voxels, void *d_source, int64_t count,
                                         cudaStream_t stream);
/* Fill the volume with the background. */
pliant_status pliant_cuda_clear_volume(const gpu_raster *raster, cudaStream_t stream);
/* Enqueue the setup and the lists.
 * all: draw every brick
 * d_positions: (num_nodes x 3) [m] */
pliant_status pliant_cuda_cull(const gpu_raster *raster, const double *d_positions, bool all, cudaStream_t stream);
/* Draw the bricks. With crowded, a second kernel draws the bricks with more than pliant_cuda_longest_usual()
 * candidates; without it they stay. */
pliant_status pliant_cuda_rasterize(const gpu_raster *raster, bool crowded, cudaStream_t stream);
int32_t pliant_cuda_longest_usual(void);
/* Find the owner of every voxel instead of its value.
 * d_owner: (target voxels) element, -1: none */
pliant_status pliant_cuda_find_owners(const gpu_raster *raster, int32_t *d_owner, cudaStream_t stream);

/* Carry the elements and their drawn state over to another body. The lists are those in pliant_warp_changes. */
pliant_status pliant_cuda_carry_elements(const gpu_raster *before, const gpu_raster *now, int32_t common,
                                         const int32_t *d_from, int32_t num_rebuilt, const int32_t *d_rebuilt,
                                         cudaStream_t stream);
/* Mark the bricks of removed elements as dirty. */
pliant_status pliant_cuda_mark_removed(const gpu_raster *before, int32_t num_removed, const int32_t *d_removed,
                                       cudaStream_t stream);

#endif
