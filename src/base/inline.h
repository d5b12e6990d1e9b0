/* Functions shared by CPU loops and GPU kernels. Literals have explicit types (0.0 with a double), since C++ selects
 * overloads such as fmin by type. PLIANT_UNROLL marks short loops over arrays that fit in a GPU's registers. */
#ifndef PLIANT_BASE_INLINE_H
#define PLIANT_BASE_INLINE_H

#ifdef __CUDACC__
#define PLIANT_INLINE static __device__ __forceinline__
#define PLIANT_UNROLL _Pragma("unroll")
#else
#define PLIANT_UNROLL
/* Without vectorized copies, which took two minutes to compile. */
#if defined(__SANITIZE_ADDRESS__) || defined(__SANITIZE_THREAD__)
#define PLIANT_INLINE static inline
#else
#define PLIANT_INLINE static inline __attribute__((always_inline))
#endif
#endif

#endif
