/* A ray through the deformed volume where the GPU has drawn it, to its first crossing of a threshold. The crossing equals the
 * CPU's, bit for bit (src/scan/march.h has the operations). */
#ifndef PLIANT_CUDA_PICK_H
#define PLIANT_CUDA_PICK_H

#include "scan/march.h"

#include <cuda_runtime_api.h>

#ifdef __cplusplus
extern "C" {
#endif

/* The first crossing at this sample or after it; the sample before it counts as above. Voxels are of the device. */
pliant_status pliant_cuda_cross(const march_voxels *voxels, const march_ray *ray, int64_t first, march_crossing *d_out, cudaStream_t stream);

#ifdef __cplusplus
}
#endif
#endif
