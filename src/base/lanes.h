/* Elements are processed LANES at a time, lane innermost, so that the compiler vectorizes plain loops. */
#ifndef PLIANT_BASE_LANES_H
#define PLIANT_BASE_LANES_H

enum { LANES = 8 };

/* Vector code for the present machine, selected at program start. Machines with fused multiply-add round
 * differently. */
#if defined(__x86_64__) && defined(__GNUC__) && !defined(__clang__) && !defined(__SANITIZE_ADDRESS__) && \
    !defined(__SANITIZE_THREAD__)
#define PLIANT_VECTORIZED __attribute__((target_clones("avx512f", "avx2", "default"), optimize("O3")))
#else
#define PLIANT_VECTORIZED
#endif

#endif
