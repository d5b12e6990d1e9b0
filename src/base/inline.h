/* Functions shared by CPU loops and GPU kernels. Literals have explicit types (0.0 with a double), since C++ selects
 * overloads such as fmin by type. PLIANT_UNROLL marks short loops over arrays that fit in a GPU's registers.
 * PLIANT_INDEPENDENT marks loops whose passes do not depend on each other, so that a CPU vectorizes them. */
#ifndef PLIANT_BASE_INLINE_H
#define PLIANT_BASE_INLINE_H

#ifdef __CUDACC__
#define PLIANT_INLINE static __device__ __forceinline__
#define PLIANT_UNROLL _Pragma("unroll")
#define PLIANT_INDEPENDENT
#else
#define PLIANT_UNROLL
#ifdef __clang__
#define PLIANT_INDEPENDENT
#else
#define PLIANT_INDEPENDENT _Pragma("GCC ivdep")
#endif
/* Without vectorized copies, which took two minutes to compile. */
#if defined(__SANITIZE_ADDRESS__) || defined(__SANITIZE_THREAD__)
#define PLIANT_INLINE static inline
#else
#define PLIANT_INLINE static inline __attribute__((always_inline))
#endif
#endif

#endif
