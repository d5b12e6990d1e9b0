// Time to find overlapping tetrahedra ([C] table 1, collision handling), in CPU time and wall time. The bodies are a
// block of 13,720 tetrahedra and one of a million, rolled up until their ends touch. Surface tetrahedra alone, as in a
// step, and all tetrahedra.
//
// Usage:
//   bench_contact [threads]
#include "contact/detect/tet_grid.h"
#include "rolled.h"

#include <cstdio>
#include <cstdlib>
#include <ctime>
#include <vector>

namespace {

double now(clockid_t clock)
{
    timespec t;
    clock_gettime(clock, &t);
    return 1e3 * (double(t.tv_sec) + 1e-9 * double(t.tv_nsec));
}

void measure(int32_t cells, int threads)
{
    const Rolled block(cells);
    for (const std::vector<int32_t> *list : {&block.surface, &block.all}) {
        const int32_t count = static_cast<int32_t>(list->size());
        pliant_grid grid{};
        double wall = 1e30, cpu = 1e30, fill = 1e30;
        int32_t pairs = 0;
        for (int repeat = 0; repeat < 20; repeat++) {
            const double t0 = now(CLOCK_MONOTONIC), c0 = now(CLOCK_PROCESS_CPUTIME_ID);
            if (pliant_grid_fill(&grid, count, list->data(), block.mesh.tets, block.positions.data(), 0, threads) !=
                PLIANT_OK)
                std::exit(1);
            fill = std::min(fill, now(CLOCK_MONOTONIC) - t0);
            if (pliant_grid_overlaps(&grid, block.mesh.tets, block.positions.data(), threads, &pairs) != PLIANT_OK)
                std::exit(1);
            wall = std::min(wall, now(CLOCK_MONOTONIC) - t0);
            cpu = std::min(cpu, now(CLOCK_PROCESS_CPUTIME_ID) - c0);
        }
        std::printf("%d tetrahedra, %d in the grid, %d pairs overlap: %.3f ms, of which grid %.3f; CPU time %.3f ms\n",
                    block.mesh.num_tets, count, pairs, wall, fill, cpu);
        pliant_grid_free(&grid);
    }
}

} // namespace

int main(int argc, char **argv)
{
    const int threads = argc > 1 ? std::atoi(argv[1]) : 2;
    std::printf("least of 20 runs with %d threads\n", threads);
    measure(14, threads);
    measure(58, threads);
    return 0;
}
