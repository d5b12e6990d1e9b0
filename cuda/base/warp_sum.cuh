/* Reductions over the lanes of a warp. */
#ifndef PLIANT_CUDA_WARP_SUM_CUH
#define PLIANT_CUDA_WARP_SUM_CUH

/* Sum over a warp in a fixed order. All lanes get the result. */
template <class T> static __device__ __forceinline__ T warp_sum(T value)
{
    for (int half = 16; half > 0; half /= 2) value += __shfl_xor_sync(0xffffffff, value, half);
    return value;
}

static __device__ __forceinline__ double warp_largest(double value)
{
    for (int half = 16; half > 0; half /= 2) value = fmax(value, __shfl_xor_sync(0xffffffff, value, half));
    return value;
}

#endif
