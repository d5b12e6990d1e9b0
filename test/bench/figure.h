// Print the figures of a benchmark as lines that test/bench/compare reads; a fixed kernel as a reference for CPU times.
#ifndef PLIANT_BENCH_FIGURE_H
#define PLIANT_BENCH_FIGURE_H

#include <algorithm>
#include <chrono>
#include <cstdio>
#include <string>
#include <vector>

// Print a figure. Smaller values are better, independently of the unit.
inline void figure(const std::string &name, double value, const char *unit)
{
    std::printf("figure | %s | %.4g | %s\n", name.c_str(), value, unit);
    std::fflush(stdout);
}

// Return the time of a constant kernel on one thread [s]: multiply-adds in the first-level cache, then a triad through
// memory (96 MB); minimum of five runs. A benchmark divides its time by this, so that figures of different machines, or
// of one machine under different loads, are comparable.
inline double fixed_kernel_seconds()
{
    const size_t small = 4096, large = size_t(8) << 20;
    static std::vector<float> a(large, 1.0f), b(large, 0.5f), c(large, 0.25f);
    double minimum = 1e30;
    for (int run = 0; run < 5; run++) {
        const auto start = std::chrono::steady_clock::now();
        for (int repeat = 0; repeat < 4000; repeat++)
            for (size_t i = 0; i < small; i++) a[i] = 0.999f * a[i] + b[i] * c[i];
        for (size_t i = 0; i < large; i++) a[i] = b[i] + 0.5f * c[i];
        volatile float keep = a[large / 2];
        (void)keep;
        minimum = std::min(minimum, std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count());
    }
    return minimum;
}

#endif
