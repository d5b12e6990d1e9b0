/* How much comes before a thread, over a block. */
#ifndef PLIANT_CUDA_SCAN_CUH
#define PLIANT_CUDA_SCAN_CUH

#include <cstdint>

/* By all threads of a block of so many: the sum of the counts of the threads before; all sums to sums (THREADS), this
 * thread's own included. */
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
