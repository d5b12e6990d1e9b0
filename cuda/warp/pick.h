/* Find the first threshold crossing of a ray in the volume on the GPU. The result is bitwise identical to the CPU's
 * (operations in src/scan/march.h). */
#ifndef PLIANT_CUDA_PICK_H
#define PLIANT_CUDA_PICK_H

#include "scan/march.h"

#include <cuda_runtime_api.h>

/* Find the first crossing at sample `first` or later; the sample before it counts as above the threshold. The voxels
 * are in device memory. */
pliant_status pliant_cuda_cross(const march_voxels *voxels, const march_ray *ray, int64_t first, march_crossing *d_out,
                                cudaStream_t stream);

#endif
