// Time of an update and error of the inverse map relative to a known smooth map, for both ways to draw a deformed
// volume.
// Usage:
//   bench_fit [voxels: 256 160 122] [cells along an edge = 14]   on the CPU
//   bench_fit cuda                                               on the GPU, times only: 256 x 160 x 122, 16-bit voxels
#include "figure.h"
#include "mesh/mesh.h"
#include "pliant/pliant.h"
#include "warp/warp.h"

#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <vector>

namespace {

// Compute the rest position of the tissue at x: waves of 15 mm over about 0.25 m.
void inverse(const double *x, double *out)
{
    out[0] = x[0] + 0.015 * std::sin(25 * x[1]);
    out[1] = x[1] + 0.015 * std::sin(22 * x[2] + 1);
    out[2] = x[2] + 0.015 * std::cos(24 * x[0]);
}

int bench_gpu()
{
    const int32_t size[3] = {256, 160, 122}, cells[3] = {14, 14, 14};
    pliant_volume phantom{};
    pliant_mesh mesh{};
    if (pliant_phantom(size, 1, &phantom, nullptr) != PLIANT_OK ||
        pliant_mesh_grid(&phantom.geometry, cells, nullptr, &mesh) != PLIANT_OK)
        return 1;
    std::printf(
        "%d x %d x %d voxels, %d tetrahedra, the fastest of 30 updates, by the GPU's clock\n%-12s %12s %12s %12s\n",
        size[0], size[1], size[2], mesh.num_tets, "", "map [ms]", "voxels [ms]", "both [ms]");
    for (int step : {8, 4, 3, 2, 1}) {
        pliant_warp *warp = nullptr;
        double best[3] = {1, 1, 1};
        if (pliant_warp_create(&phantom, &mesh, &phantom.geometry, 2, &warp) != PLIANT_OK ||
            pliant_warp_fit(warp, step) != PLIANT_OK || pliant_warp_backend(warp, PLIANT_CUDA) != PLIANT_OK) {
            std::fprintf(stderr, "%s\n", pliant_last_error());
            return 1;
        }
        for (int run = 0; run < 30; run++) {
            std::vector<double> positions(mesh.rest, mesh.rest + 3 * size_t(mesh.num_nodes));
            for (size_t n = 0; n < positions.size(); n += 3)
                positions[n] += 0.01 * std::sin(20 * positions[n + 1] + run);
            double map, voxels;
            if (pliant_warp_update(warp, positions.data()) != PLIANT_OK) return 1;
            pliant_warp_seconds(warp, &map, &voxels);
            best[0] = std::fmin(best[0], map);
            best[1] = std::fmin(best[1], voxels);
            best[2] = std::fmin(best[2], map + voxels);
        }
        std::printf("fit, step %d  %12.4f %12.4f %12.4f\n", step, 1e3 * best[0], 1e3 * best[1], 1e3 * best[2]);
        figure("fit, step " + std::to_string(step), 1e6 * best[2], "us");
        pliant_warp_free(warp);
    }
    pliant_mesh_free(&mesh);
    pliant_volume_free(&phantom);
    return 0;
}

} // namespace

int main(int argc, char **argv)
{
    if (argc > 1 && std::strcmp(argv[1], "cuda") == 0) return bench_gpu();
    const int32_t size[3] = {argc > 3 ? std::atoi(argv[1]) : 256, argc > 3 ? std::atoi(argv[2]) : 160,
                             argc > 3 ? std::atoi(argv[3]) : 122};
    const int cells = argc > 4 ? std::atoi(argv[4]) : 14;
    const int32_t lattice[3] = {cells, cells, cells};
    // each scan coordinate is a separate volume, so that the drawn value is the inverse map
    pliant_volume phantom{}, coordinate[3]{};
    pliant_mesh mesh{};
    if (pliant_phantom(size, 1, &phantom, nullptr) != PLIANT_OK) return 1;
    const pliant_geometry &g = phantom.geometry;
    size_t voxels = pliant_geometry_voxels(&g);
    for (int d = 0; d < 3; d++) {
        if (pliant_volume_create(&g, PLIANT_FLOAT32, &coordinate[d]) != PLIANT_OK) return 1;
        coordinate[d].slope = 1;
        coordinate[d].background = NAN;
        size_t stride = d == 0 ? 1 : d == 1 ? size_t(g.size[0]) : size_t(g.size[0]) * g.size[1];
        for (size_t v = 0; v < voxels; v++)
            static_cast<float *>(coordinate[d].voxels)[v] = float(v / stride % size_t(g.size[d]));
    }
    if (pliant_mesh_grid(&g, lattice, nullptr, &mesh) != PLIANT_OK) return 1;
    std::vector<double> positions(3 * size_t(mesh.num_nodes));
    for (int32_t n = 0; n < mesh.num_nodes; n++) {
        const double *target = mesh.rest + 3 * n;
        double x[3] = {target[0], target[1], target[2]}, mapped[3];
        for (int pass = 0; pass < 200; pass++) {
            inverse(x, mapped);
            for (int d = 0; d < 3; d++) x[d] += 0.7 * (target[d] - mapped[d]);
        }
        for (int d = 0; d < 3; d++) positions[3 * size_t(n) + d] = x[d];
    }
    std::printf("%d x %d x %d voxels, %d tetrahedra, 2 threads\n%-12s %12s %12s %14s %14s\n", size[0], size[1], size[2],
                mesh.num_tets, "", "map [s]", "voxels [s]", "rms [voxels]", "max [voxels]");
    for (int step : {0, 16, 8, 4, 2, 1}) {
        double squares = 0, maximum = 0, seconds[2] = {0, 0};
        size_t count = 0;
        std::vector<float> drawn[3];
        for (int d = 0; d < 3; d++) {
            pliant_warp *warp = nullptr;
            if (pliant_warp_create(&coordinate[d], &mesh, &g, 2, &warp) != PLIANT_OK ||
                (step > 0 && pliant_warp_fit(warp, step) != PLIANT_OK) ||
                pliant_warp_update(warp, positions.data()) != PLIANT_OK) {
                std::fprintf(stderr, "%s\n", pliant_last_error());
                return 1;
            }
            pliant_warp_seconds(warp, &seconds[0], &seconds[1]);
            auto *values = static_cast<const float *>(pliant_warp_volume(warp)->voxels);
            drawn[d].assign(values, values + voxels);
            pliant_warp_free(warp);
        }
        for (size_t v = 0; v < voxels; v += 7) {
            double at[3] = {double(v % size_t(g.size[0])), double(v / size_t(g.size[0]) % size_t(g.size[1])),
                            double(v / size_t(g.size[0]) / size_t(g.size[1]))};
            double world[3], rest[3], index[3], square = 0;
            bool inner = true;
            pliant_geometry_to_world(&g, at, world);
            inverse(world, rest);
            pliant_geometry_to_index(&g, rest, index);
            // away from the box, where both ways end
            for (int d = 0; d < 3; d++)
                inner = inner && at[d] > 0.1 * g.size[d] && at[d] < 0.9 * g.size[d] && index[d] > 2 &&
                        index[d] < g.size[d] - 3;
            if (!inner) continue;
            for (int d = 0; d < 3; d++) square += std::pow(drawn[d][v] - index[d], 2);
            squares += square;
            maximum = std::fmax(maximum, square);
            count++;
        }
        char name[32];
        std::snprintf(name, sizeof name, step ? "fit, step %d" : "rasterize", step);
        std::printf("%-12s %12.4f %12.4f %14.4f %14.4f\n", name, seconds[0], seconds[1],
                    std::sqrt(squares / double(count)), std::sqrt(maximum));
    }
}
