// Time of the GPU to find overlapping tetrahedra, next to the CPU, whose pairs must be the same, for the blocks of
// bench_contact. Then the whole detection of contact points between tissue surfaces, including transfers, next to one
// thread of the CPU.
//
// Usage:
//   bench_overlaps [RUNS [small]]   small: only 13,720 tetrahedra, for compute-sanitizer
#include "../../cuda/contact/overlaps.h"
#include "../../cuda/contact/tissue.h"
#include "contact/detect/tet_grid.h"
#include "figure.h"
#include "base/memory.h"
#include "rolled.h"
#include "topology/body.h"

#include <cuda_runtime.h>

#include <algorithm>
#include <chrono>
#include <cstdio>
#include <cstdlib>

namespace {

void exit_on_error(pliant_status status)
{
    if (status >= 0) return;
    std::fprintf(stderr, "bench_overlaps: %s\n", pliant_last_error());
    std::exit(1);
}

double now()
{
    return 1e-6 * double(std::chrono::duration_cast<std::chrono::nanoseconds>(
                             std::chrono::steady_clock::now().time_since_epoch())
                             .count());
}

bool measure(int32_t cells, int runs)
{
    Rolled block(cells);
    double *d_positions = nullptr;
    cudaStream_t stream = nullptr;
    bool same = true;
    if (cudaStreamCreateWithFlags(&stream, cudaStreamNonBlocking) != cudaSuccess ||
        cudaMalloc(&d_positions, block.positions.size() * sizeof(double)) != cudaSuccess ||
        cudaMemcpy(d_positions, block.positions.data(), block.positions.size() * sizeof(double),
                   cudaMemcpyHostToDevice) != cudaSuccess)
        std::exit(1);
    for (const std::vector<int32_t> *list : {&block.surface, &block.all}) {
        gpu_overlaps *overlaps = nullptr;
        pliant_grid grid{};
        int32_t count = 0, expected = 0;
        const int32_t listed = static_cast<int32_t>(list->size());
        exit_on_error(gpu_overlaps_create(block.mesh.num_tets, block.mesh.tets, listed, list->data(),
                                          1.3 * block.mesh.cell_size[0], stream, &overlaps));
        std::vector<double> ms;
        for (int run = 0; run < runs; run++) {
            const double start = now();
            exit_on_error(gpu_overlaps_find(overlaps, d_positions, 0, stream, nullptr, nullptr, &count));
            if (run > 2) ms.push_back(now() - start);
        }
        std::sort(ms.begin(), ms.end());
        exit_on_error(pliant_grid_fill(&grid, listed, list->data(), block.mesh.tets, block.positions.data(), 0, 8));
        exit_on_error(pliant_grid_overlaps(&grid, block.mesh.tets, block.positions.data(), 8, &expected));
        std::vector<int32_t> mine(2 * static_cast<size_t>(count));
        std::vector<std::pair<int32_t, int32_t>> truth;
        exit_on_error(gpu_overlaps_get_pairs(overlaps, stream, mine.data()));
        for (const pliant_grid_pairs &found : grid.found)
            for (int32_t p = 0; p < found.count; p++) truth.emplace_back(found.pair[2 * p], found.pair[2 * p + 1]);
        std::sort(truth.begin(), truth.end());
        bool equal = count == expected;
        for (int32_t p = 0; equal && p < count; p++)
            equal = truth[p].first == mine[2 * p] && truth[p].second == mine[2 * p + 1];
        same = same && equal;
        std::printf(
            "%d tetrahedra, %d in the grid, %d pairs overlap, %s as on the CPU: "
            "%.4f ms (median of %zu with what waits for it; least %.4f)\n",
            block.mesh.num_tets, listed, count, equal ? "the same" : "NOT THE SAME", ms[ms.size() / 2], ms.size(),
            ms[0]);
        figure("overlaps, " + std::to_string(listed) + " of " + std::to_string(block.mesh.num_tets),
               1e3 * ms[ms.size() / 2], "us");
        gpu_overlaps_free(overlaps);
        pliant_grid_free(&grid);
    }
    cudaFree(d_positions);
    cudaStreamDestroy(stream);
    return same;
}

// Contact points of ends at a distance of a tenth of an element; deep penetration is handled by the host.
bool measure_stage(int32_t cells, int runs)
{
    Rolled block(cells, -0.1);
    pliant_body *body = nullptr;
    exit_on_error(pliant_body_create(1, &body));
    body->fine = block.mesh;
    block.mesh = pliant_mesh{};
    double median[2];
    int32_t points[2] = {0, 0}, tets = body->fine.num_tets;
    for (int where = 0; where < 2; where++) {
        pliant_tissue tissue{};
        pliant_contacts found{};
        std::vector<double> ms;
        const pliant_tissue_rule rule = {0.25 * body->fine.cell_size[0], 1e-3, 0.3, 0};
        exit_on_error(pliant_tissue_set_body(&tissue, body, nullptr, 1));
        pliant_tissue_set_searcher(&tissue, where ? &pliant_cuda_tissue_searcher : nullptr);
        for (int run = 0; run < (where ? runs : 7); run++) {
            const double start = now();
            found.count = 0;
            exit_on_error(pliant_tissue_find(&tissue, block.positions.data(), &rule, &found));
            if (run > 2) ms.push_back(now() - start);
        }
        std::sort(ms.begin(), ms.end());
        median[where] = ms[ms.size() / 2];
        points[where] = found.count;
        pliant_tissue_free(&tissue);
        pliant_free(found.point);
    }
    std::printf("%d tetrahedra, the whole search: %d points, %.4f ms; one thread of the CPU %d points, %.3f ms\n", tets,
                points[1], median[1], points[0], median[0]);
    figure("self-contact search, " + std::to_string(tets), 1e3 * median[1], "us");
    pliant_body_release(body);
    return points[0] == points[1];
}

} // namespace

int main(int argc, char **argv)
{
    const int runs = argc > 1 ? std::atoi(argv[1]) : 100;
    const bool small = measure(14, runs) && measure_stage(14, runs),
               large = argc > 2 || (measure(58, runs) && measure_stage(58, runs));
    return small && large ? 0 : 1;
}
