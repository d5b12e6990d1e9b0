/* Find the first threshold crossing along a ray. Each thread of a block takes one sample, one block of samples after
 * another; the lowest crossing is refined. */
#include "cuda/base/check.h"
#include "cuda/warp/pick.h"

enum { SAMPLES = 512 };

/* was_above[n]: whether the sample before thread n's sample is above the threshold */
static __global__ void __launch_bounds__(SAMPLES)
    cross_kernel(march_voxels voxels, march_ray ray, int64_t first, march_crossing *d_out)
{
    __shared__ bool was_above[SAMPLES + 1];
    __shared__ int lowest;
    const int thread = (int)threadIdx.x;
    if (thread == 0) {
        was_above[0] = first > 0;
        lowest = SAMPLES;
        d_out->sample = -1;
    }
    for (int64_t begin = first; march_has(&ray, begin); begin += SAMPLES) {
        const int64_t sample = begin + thread;
        const bool above = march_has(&ray, sample) && march_above(&voxels, &ray, march_at(&ray, sample));
        was_above[thread + 1] = above;
        __syncthreads();
        if (above && !was_above[thread]) atomicMin(&lowest, thread);
        __syncthreads();
        if (lowest < SAMPLES) {
            if (thread == lowest) *d_out = march_refine(&voxels, &ray, sample);
            return;
        }
        if (thread == 0) was_above[0] = was_above[SAMPLES];
        __syncthreads(); /* the next iteration overwrites it */
    }
}

pliant_status pliant_cuda_cross(const march_voxels *voxels, const march_ray *ray, int64_t first, march_crossing *d_out,
                                cudaStream_t stream)
{
    cross_kernel<<<1, SAMPLES, 0, stream>>>(*voxels, *ray, first, d_out);
    return CUDA_LAUNCHED("pick");
}
