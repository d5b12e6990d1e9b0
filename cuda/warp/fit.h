/* Moving-least-squares fit (src/warp/fit.h) on the GPU. The result is bitwise identical to the CPU's for the same
 * positions. */
#ifndef PLIANT_CUDA_FIT_H
#define PLIANT_CUDA_FIT_H

#include "cuda/warp/rasterize.h"
#include "warp/fit.h"

#include <cuda_runtime_api.h>

typedef struct pliant_cuda_fit pliant_cuda_fit;

/* Create the fit on the GPU.
 * parts, source: host data, copied
 * rest: used instead of parts->rest, which may be incomplete for the next body
 * Errors: MEMORY (with figures), UNAVAILABLE. */
pliant_status pliant_cuda_fit_create(const fit_view *parts, const double *rest, const raster_source *source,
                                     cudaStream_t stream, pliant_cuda_fit **out);
void pliant_cuda_fit_free(pliant_cuda_fit *fit); /* Nullable */
/* Enqueue the computation of the map for device positions (num_nodes x 3). */
pliant_status pliant_cuda_fit_map(const pliant_cuda_fit *fit, const double *d_positions, cudaStream_t stream);
/* Return the elements that are drawn by their own maps (fit_view, on the GPU); NULL: no cuts. */
const uint8_t *pliant_cuda_fit_zone(const pliant_cuda_fit *fit);
/* Enqueue the search for the owners of the voxels near a cut. The elements must be set up. */
pliant_status pliant_cuda_fit_own(const pliant_cuda_fit *fit, const gpu_raster *raster, cudaStream_t stream);
/* Enqueue the voxels of all bricks: from the fitted map, and near a cut from the elements' own maps. Sets d_changed
 * (bricks) to 1 if a voxel has changed, otherwise 0. */
pliant_status pliant_cuda_fit_draw(const pliant_cuda_fit *fit, const gpu_raster *raster, cudaStream_t stream);

#endif
