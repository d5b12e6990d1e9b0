/* Elements are taken LANES at a time, lane innermost, so that the compiler makes vector code of plain loops. */
#ifndef PLIANT_BASE_LANES_H
#define PLIANT_BASE_LANES_H

enum { LANES = 8 };

/* Vector code for the machine at hand, chosen when the program starts. Machines that fuse products and sums round
 * otherwise. */
#if defined(__x86_64__) && defined(__GNUC__) && !defined(__clang__) && !defined(__SANITIZE_ADDRESS__) && \
    !defined(__SANITIZE_THREAD__)
#define PLIANT_VECTORIZED __attribute__((target_clones("avx512f", "avx2", "default"), optimize("O3")))
#else
#define PLIANT_VECTORIZED
#endif

#endif
