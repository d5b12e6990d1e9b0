/* Prefix sum over a block. */
#ifndef PLIANT_CUDA_BASE_PREFIX_SUM_CUH
#define PLIANT_CUDA_BASE_PREFIX_SUM_CUH

#include <cstdint>

/* Return the sum of the counts of all preceding threads. Call it from all THREADS threads of a block. sums: (THREADS)
 * out: sums including each thread's own count. */
template <int THREADS> static __device__ __forceinline__ int32_t sum_before(int32_t count, int32_t *sums)
{
    sums[threadIdx.x] = count;
    __syncthreads();
    for (int step = 1; step < THREADS; step *= 2) {
        const int32_t before = (int)threadIdx.x >= step ? sums[threadIdx.x - step] : 0;
        __syncthreads();
        sums[threadIdx.x] += before;
        __syncthreads();
    }
    return sums[threadIdx.x] - count;
}

#endif
