/* Functions that loops of the CPU and kernels of the GPU share: both compile the same lines. Literals are typed (0.0 beside a double),
 * since C++ chooses overloads of fmin and the like by them. */
#ifndef PLIANT_CORE_INLINE_H
#define PLIANT_CORE_INLINE_H

#ifdef __CUDACC__
#define PLIANT_INLINE static __device__ __forceinline__
#else
#define PLIANT_INLINE static inline __attribute__((always_inline))
#endif

#endif
