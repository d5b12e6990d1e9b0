/* The deformed volume on the GPU: tetrahedra are set up and sorted into bricks, then one block writes one brick. The volume
 * equals the CPU's, bit for bit, for the same positions (src/warp/raster.h has the rules). */
#ifndef PLIANT_CUDA_RASTERIZE_H
#define PLIANT_CUDA_RASTERIZE_H

#include "warp/parts.h"
#include "warp/raster.h"

#include <cuda_runtime_api.h>

#ifdef __cplusplus
extern "C" {
#endif

/* What the kernels see. All pointers are of the device. */
typedef struct gpu_raster {
    raster_grid grid;
    double reciprocal[3];            /* of the target's spacing */
    pliant_encoding encoding;
    int32_t source_size[3], source_step[3];
    const void *d_source;            /* (voxels of the scan): 8 and 16 bit ones as 32 bits, the voxel in the low half and its right
                                      * neighbour in the high one, 16 bit ones plus 2^15 so that none is negative; floats as two,
                                      * the voxel and what its right neighbour has more */
    raster_source background;        /* only its background is used, and whether labels are drawn: the nearest voxel's */
    int32_t num_tets, num_elements, num_bricks; /* elements: tetrahedra, and after them guests */
    const int32_t *d_tets;           /* (num_tets x 4) */
    const part_guest *d_guests;      /* (num_elements - num_tets) */
    part_view parts;                 /* elements NULL: nothing is cut */
    uint8_t *d_parted;               /* (num_bricks) an element that is parted touches it; 0 between updates */
    const uint8_t *d_zone;           /* (num_elements) of a fit: 0: not drawn by its own map; NULL: all are */
    const double *d_rest;            /* (num_nodes x 3) continuous index in the scan */
    int32_t *d_fixed;                /* (num_elements x 12) fixed-point corners of the last update */
    void *d_setup;                   /* (num_elements) gpu_tet of the last update */
    int32_t *d_count;                /* (num_bricks) candidates; 0 between updates */
    int32_t *d_list;                 /* (num_bricks x capacity), in no order */
    int32_t capacity;
    uint8_t *d_dirty, *d_changed;    /* (num_bricks); dirty is 0 between updates */
    int32_t *d_longest;              /* longest list of the update: above capacity, lists were cut off and must be made again;
                                      * never goes down */
    void *d_volume;
} gpu_raster;

size_t pliant_cuda_source_bytes(pliant_encoding encoding); /* of one voxel in d_source */
size_t pliant_cuda_setup_bytes(void); /* of one tetrahedron in d_setup */

/* d_voxels (count, in the encoding of the scan) to d_source. */
pliant_status pliant_cuda_prepare_source(const gpu_raster *raster, const void *d_voxels, void *d_source, int64_t count, cudaStream_t stream);
/* The background everywhere. */
pliant_status pliant_cuda_clear_volume(const gpu_raster *raster, cudaStream_t stream);
/* all: every brick is drawn, whatever was there. d_positions: (num_nodes x 3) [m]. */
pliant_status pliant_cuda_cull(const gpu_raster *raster, const double *d_positions, bool all, cudaStream_t stream);
/* Bricks with more candidates than pliant_cuda_longest_usual() are drawn with crowded only, by another kernel. */
pliant_status pliant_cuda_rasterize(const gpu_raster *raster, bool crowded, cudaStream_t stream);
int32_t pliant_cuda_longest_usual(void);
/* In place of values, who owns every voxel: d_owner (voxels of the target), -1: nobody. Of bricks with parts. */
pliant_status pliant_cuda_find_owners(const gpu_raster *raster, int32_t *d_owner, cudaStream_t stream);

/* Elements of another body, with how they were drawn: lists as those of pliant_warp_changes. */
pliant_status pliant_cuda_carry_elements(const gpu_raster *before, const gpu_raster *now, int32_t common, const int32_t *d_from, int32_t num_anew,
                                         const int32_t *d_anew, cudaStream_t stream);
/* The bricks of elements that are gone become dirty: likewise. */
pliant_status pliant_cuda_leave_bricks(const gpu_raster *before, int32_t num_gone, const int32_t *d_gone, cudaStream_t stream);

#ifdef __cplusplus
}
#endif
#endif
