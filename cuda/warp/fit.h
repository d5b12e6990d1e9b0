/* The fit (src/warp/fit.h) on the GPU: the same bits as the CPU's for the same positions. */
#ifndef PLIANT_CUDA_FIT_H
#define PLIANT_CUDA_FIT_H

#include "cuda/warp/rasterize.h"
#include "warp/fit.h"

#include <cuda_runtime_api.h>

#ifdef __cplusplus
extern "C" {
#endif

typedef struct pliant_cuda_fit pliant_cuda_fit;

/* parts, source: of the host, copied. rest: in place of that of parts, of which the next body's may still be missing. Errors: MEMORY (with figures), UNAVAILABLE. */
pliant_status pliant_cuda_fit_create(const fit_view *parts, const double *rest, const raster_source *source, cudaStream_t stream, pliant_cuda_fit **out);
void pliant_cuda_fit_free(pliant_cuda_fit *fit); /* Nullable */
/* Enqueue the map for positions on the GPU (num_nodes x 3). */
pliant_status pliant_cuda_fit_map(const pliant_cuda_fit *fit, const double *d_positions, cudaStream_t stream);
/* Elements that are drawn by their own maps (fit_view, on the GPU); NULL: nothing is cut. */
const uint8_t *pliant_cuda_fit_zone(const pliant_cuda_fit *fit);
/* Enqueue who owns the voxels near a cut, of elements that are set up. */
pliant_status pliant_cuda_fit_own(const pliant_cuda_fit *fit, const gpu_raster *raster, cudaStream_t stream);
/* Enqueue the voxels of all bricks from the map, and near a cut from the elements' own; its d_changed (bricks): 1 where a voxel is another than before, else 0. */
pliant_status pliant_cuda_fit_draw(const pliant_cuda_fit *fit, const gpu_raster *raster, cudaStream_t stream);

#ifdef __cplusplus
}
#endif
#endif
