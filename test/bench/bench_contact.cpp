// What it takes to find the tetrahedra that overlap ([C] table 1, collision handling), by CPU time and by the clock: of a block of 13,720 and of one
// of a million that is rolled up until its ends meet, those at the surface alone, as a step does, and all of them.
//
//   bench_contact [threads]
#include "contact/grid.h"
#include "pliant/mesh.h"
#include "pliant/pliant.h"

#include <algorithm>
#include <cmath>
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

// along x to a ring whose ends overlap by so many metres
void roll(double length, double overlap, const double x[3], double out[3])
{
    const double radius = (length - overlap) / (2 * M_PI), angle = x[0] / radius, at = radius + 0.5 * (x[1] - 0.5 * length);
    out[0] = at * std::cos(angle);
    out[1] = at * std::sin(angle);
    out[2] = x[2];
}

void measure(int32_t cells, int threads)
{
    pliant_geometry geometry{};
    for (int d = 0; d < 3; d++) {
        geometry.size[d] = cells;
        geometry.spacing[d] = 0.14 / cells;
        geometry.origin[d] = 0.5 * geometry.spacing[d];
        geometry.direction[4 * d] = 1;
    }
    const int32_t cube[3] = {cells, cells, cells};
    pliant_mesh mesh{};
    if (pliant_mesh_grid(&geometry, cube, nullptr, &mesh) != PLIANT_OK) std::exit(1);
    std::vector<double> positions(3 * static_cast<size_t>(mesh.num_nodes));
    for (int32_t n = 0; n < mesh.num_nodes; n++) roll(0.14, 0.5 * geometry.spacing[0], mesh.rest + 3 * n, positions.data() + 3 * n);
    std::vector<int32_t> across(4 * static_cast<size_t>(mesh.num_tets)), list[2];
    if (pliant_mesh_neighbours(&mesh, across.data()) != PLIANT_OK) std::exit(1);
    for (int32_t t = 0; t < mesh.num_tets; t++) {
        list[1].push_back(t);
        if (*std::min_element(across.begin() + 4 * t, across.begin() + 4 * t + 4) < 0) list[0].push_back(t);
    }
    for (int all = 0; all < 2; all++) {
        pliant_grid grid{};
        double wall = 1e30, cpu = 1e30, fill = 1e30;
        int32_t pairs = 0;
        for (int repeat = 0; repeat < 20; repeat++) {
            const double t0 = now(CLOCK_MONOTONIC), c0 = now(CLOCK_PROCESS_CPUTIME_ID);
            if (pliant_grid_fill(&grid, int32_t(list[all].size()), list[all].data(), mesh.tets, positions.data(), 0, threads) != PLIANT_OK) std::exit(1);
            fill = std::min(fill, now(CLOCK_MONOTONIC) - t0);
            if (pliant_grid_overlaps(&grid, mesh.tets, positions.data(), threads, &pairs) != PLIANT_OK) std::exit(1);
            wall = std::min(wall, now(CLOCK_MONOTONIC) - t0);
            cpu = std::min(cpu, now(CLOCK_PROCESS_CPUTIME_ID) - c0);
        }
        std::printf("%d tetrahedra, %s %zu in the grid, %d pairs overlap: %.3f ms, of which grid %.3f; CPU time %.3f ms\n", mesh.num_tets,
                    all ? "all" : "at the surface", list[all].size(), pairs, wall, fill, cpu);
        pliant_grid_free(&grid);
    }
    pliant_mesh_free(&mesh);
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
