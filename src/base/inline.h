/* Functions that loops of the CPU and kernels of the GPU share: both compile the same lines. Literals are typed (0.0
 * beside a double), since C++ chooses overloads of fmin and the like by them. PLIANT_UNROLL stands before short loops
 * over arrays that fit into a GPU's registers. */
#ifndef PLIANT_BASE_INLINE_H
#define PLIANT_BASE_INLINE_H

#ifdef __CUDACC__
#define PLIANT_INLINE static __device__ __forceinline__
#define PLIANT_UNROLL _Pragma("unroll")
#else
#define PLIANT_UNROLL
#if defined(__SANITIZE_ADDRESS__) || defined(__SANITIZE_THREAD__) /* make no vector code of copies, which took two minutes to compile */
#define PLIANT_INLINE static inline
#else
#define PLIANT_INLINE static inline __attribute__((always_inline))
#endif
#endif

#endif
