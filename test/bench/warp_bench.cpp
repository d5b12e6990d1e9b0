// Time of the warp relative to ITK's WarpImageFilter with a dense displacement field: the same volume, threads, and
// run.
//
// Usage: warp_bench [RUNS]     (default 15; every figure is the median of these runs)
//
// Lower bound for 16 bits per voxel: 2 bytes read and 2 written are 20 MB for 5.0 M voxels, 1 to 2 ms from memory. But
// each voxel needs 8 neighbours. 32 bits contain a voxel and its right neighbour: 4 loads per voxel, 20 M loads for 5.0
// M voxels, two at a time. "gathers alone" measures this: 4 gather instructions for 8 voxels, all lanes active, along
// straight rows. The remaining time of the warp is the search for owners (a third), the map, and the interpolation.
//
// Columns: wall time by stage, and CPU time of all threads, each also as a fraction of ITK's.
#include "base/clock.h"
#include "displacement.h"
#include "mesh/mesh.h"
#include "warp/warp.h"

#include <itkImage.h>
#include <itkVector.h>
#include <itkWarpImageFilter.h>

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <ctime>
#include <functional>
#include <random>
#include <vector>

#if defined(__x86_64__)
#include <immintrin.h>
#endif

namespace {

double median(std::vector<double> values)
{
    std::nth_element(values.begin(), values.begin() + long(values.size() / 2), values.end());
    return values[values.size() / 2];
}

// CPU time of all threads of this program [s], which other programs hardly affect
double cpu_seconds()
{
    timespec now;
    clock_gettime(CLOCK_PROCESS_CPUTIME_ID, &now);
    return double(now.tv_sec) + 1e-9 * double(now.tv_nsec);
}

struct times {
    std::vector<double> wall, cpu; // [ms]
    void run(const std::function<void()> &work)
    {
        double start = pliant_seconds(), cpu_start = cpu_seconds();
        work();
        wall.push_back(1e3 * (pliant_seconds() - start));
        cpu.push_back(1e3 * (cpu_seconds() - cpu_start));
    }
};

void exit_on_error(pliant_status status)
{
    if (status >= 0) return;
    std::fprintf(stderr, "warp_bench: %s\n", pliant_last_error());
    std::exit(1);
}

struct setup {
    pliant_volume scan;
    pliant_mesh mesh;
    double extent[3];
    std::vector<double> rest, shifted, moved, moved_more, tenth;
};

setup make_setup(const int32_t size[3], const int32_t cells[3])
{
    setup s = {};
    pliant_geometry geometry = {
        {size[0], size[1], size[2]}, {0, 0, 0}, {0.0015, 0.0015, 0.002}, {1, 0, 0, 0, 1, 0, 0, 0, 1}};
    exit_on_error(pliant_volume_create(&geometry, PLIANT_INT16, &s.scan));
    std::mt19937 random(1);
    for (size_t v = 0; v < pliant_geometry_voxels(&geometry); v++)
        static_cast<int16_t *>(s.scan.voxels)[v] = int16_t(int(random() % 2000) - 1000);
    s.scan.background = -1024;
    exit_on_error(pliant_mesh_grid(&geometry, cells, nullptr, &s.mesh));
    for (int d = 0; d < 3; d++) s.extent[d] = size[d] * geometry.spacing[d];
    s.rest.assign(s.mesh.rest, s.mesh.rest + 3 * s.mesh.num_nodes);
    s.shifted = s.moved = s.moved_more = s.tenth = s.rest;
    for (size_t n = 0; n < s.rest.size(); n += 3) {
        double by[3];
        displacement(&s.rest[n], s.extent, 1, by);
        bool inside = true; // a part of the box with a tenth of its nodes
        for (int d = 0; d < 3; d++) inside &= s.rest[n + size_t(d)] < 0.464 * s.extent[d];
        s.shifted[n] += geometry.spacing[0];
        for (size_t d = 0; d < 3; d++) {
            s.moved[n + d] += by[d];
            s.moved_more[n + d] += 0.97 * by[d];
            s.tenth[n + d] = s.moved[n + d] + (inside ? 0.002 : 0);
        }
    }
    return s;
}

// A warp that alternates between two states, and its times.
struct timed_warp {
    const char *name;
    const std::vector<double> &a, &b;
    pliant_warp *warp;
    std::vector<double> cull, rasterize;
    times total;

    timed_warp(const char *what, const setup &s, int threads, const std::vector<double> &from,
               const std::vector<double> &to)
        : name(what), a(from), b(to), warp(nullptr)
    {
        exit_on_error(pliant_warp_create(&s.scan, &s.mesh, &s.scan.geometry, threads, &warp));
        exit_on_error(pliant_warp_update(warp, a.data()));
    }
    timed_warp(const timed_warp &) = delete;
    ~timed_warp() { pliant_warp_free(warp); }

    void run()
    {
        const double *to = (total.wall.size() % 2 ? a : b).data();
        total.run([&] { exit_on_error(pliant_warp_update(warp, to)); });
        double c, r;
        pliant_warp_seconds(warp, &c, &r);
        cull.push_back(1e3 * c);
        rasterize.push_back(1e3 * r);
    }
};

using image = itk::Image<short, 3>;
using field = itk::Image<itk::Vector<float, 3>, 3>;
using itk_warp = itk::WarpImageFilter<image, image, field>;

itk_warp::Pointer make_itk(const setup &s, int threads)
{
    image::SizeType size;
    image::SpacingType spacing;
    for (unsigned d = 0; d < 3; d++) {
        size[d] = itk::SizeValueType(s.scan.geometry.size[d]);
        spacing[d] = s.scan.geometry.spacing[d];
    }
    auto scan = image::New();
    scan->SetRegions(size);
    scan->SetSpacing(spacing);
    scan->Allocate();
    std::copy_n(static_cast<int16_t *>(s.scan.voxels), pliant_geometry_voxels(&s.scan.geometry),
                scan->GetBufferPointer());
    auto by = field::New();
    by->SetRegions(size);
    by->SetSpacing(spacing);
    by->Allocate();
    auto *vector = by->GetBufferPointer();
    for (size_t k = 0; k < size[2]; k++)
        for (size_t j = 0; j < size[1]; j++)
            for (size_t i = 0; i < size[0]; i++, vector++) {
                double x[3] = {double(i) * spacing[0], double(j) * spacing[1], double(k) * spacing[2]}, u[3];
                displacement(x, s.extent, -1, u);
                for (unsigned d = 0; d < 3; d++) (*vector)[d] = float(u[d]);
            }
    auto filter = itk_warp::New();
    filter->SetInput(scan);
    filter->SetDisplacementField(by);
    filter->SetOutputParametersFromImage(scan);
    filter->SetEdgePaddingValue(-1024);
#if ITK_VERSION_MAJOR >= 5
    filter->GetMultiThreader()->SetMaximumNumberOfThreads(unsigned(threads));
    filter->SetNumberOfWorkUnits(unsigned(threads));
#else
    filter->SetNumberOfThreads(unsigned(threads));
#endif
    filter->Update();
    return filter;
}

#if defined(__x86_64__)
__attribute__((target("avx2"))) int gather_rows(const setup &s, int threads)
{
    const int32_t *size = s.scan.geometry.size;
    const int16_t *voxels = static_cast<int16_t *>(s.scan.voxels);
    int step[2] = {size[0], size[0] * size[1]}, sum = 0;
#pragma omp parallel for num_threads(threads) reduction(+ : sum)
    for (int k = 0; k < size[2] - 1; k++) {
        __m256i total = _mm256_setzero_si256();
        for (int j = 0; j < size[1] - 1; j++)
            for (int i = 0; i < size[0] - 8; i += 8) {
                __m256i at = _mm256_add_epi32(_mm256_set1_epi32(i + j * step[0] + k * step[1]),
                                              _mm256_setr_epi32(0, 1, 2, 3, 4, 5, 6, 7));
                for (int c = 0; c < 4; c++)
                    total = _mm256_add_epi32(
                        total,
                        _mm256_i32gather_epi32(
                            reinterpret_cast<const int *>(voxels + (c & 1) * step[0] + (c >> 1) * step[1]), at, 2));
            }
        sum += _mm256_extract_epi32(total, 0) + _mm256_extract_epi32(total, 5);
    }
    return sum;
}

void time_gathers(const setup &s, int threads, times *out)
{
    volatile int keep = 0;
    if (__builtin_cpu_supports("avx2")) out->run([&] { keep = gather_rows(s, threads); });
}
#else
void time_gathers(const setup &, int, times *) {}
#endif

void table(const int32_t size[3], const int32_t cells[3], int runs)
{
    setup s = make_setup(size, cells);
    double voxels = double(pliant_geometry_voxels(&s.scan.geometry));
    std::printf("\n%d x %d x %d voxels (%.2f M), 16 bits; %d x %d x %d cubes, %d tetrahedra; medians of %d runs\n",
                size[0], size[1], size[2], 1e-6 * voxels, cells[0], cells[1], cells[2], s.mesh.num_tets, runs);
    std::printf("  %-14s %8s %9s %8s %9s %7s %8s %7s\n", "moved", "cull ms", "raster ms", "total ms", "ns/voxel",
                "/ ITK", "CPU ms", "/ ITK");
    for (int threads = 1; threads <= 2; threads++) {
        auto filter = make_itk(s, threads);
        timed_warp all("all", s, threads, s.moved, s.moved_more), tenth("one tenth", s, threads, s.moved, s.tenth),
            none("none", s, threads, s.moved, s.moved), shift("all, one voxel", s, threads, s.rest, s.shifted);
        times itk, gathers;
        for (int run = 0; run < runs; run++) { // alternately, so that all have the same conditions
            itk.run([&] {
                filter->Modified();
                filter->Update();
            });
            time_gathers(s, threads, &gathers);
            for (timed_warp *warp : {&all, &tenth, &none, &shift}) warp->run();
        }
        std::printf("%d thread%s: ITK %.1f ms (CPU time %.1f), gathers alone %.2f ms\n", threads,
                    threads > 1 ? "s" : "", median(itk.wall), median(itk.cpu),
                    gathers.wall.empty() ? NAN : median(gathers.wall));
        for (timed_warp *warp : {&all, &tenth, &none, &shift}) {
            double total = median(warp->total.wall), cpu = median(warp->total.cpu);
            std::printf("  %-14s %8.3f %9.3f %8.3f %9.3f %7.4f %8.3f %7.4f\n", warp->name, median(warp->cull),
                        median(warp->rasterize), total, 1e6 * total / voxels, total / median(itk.wall), cpu,
                        cpu / median(itk.cpu));
        }
    }
    pliant_mesh_free(&s.mesh);
    pliant_volume_free(&s.scan);
}

} // namespace

int main(int count, char **arguments)
{
    int runs = count > 1 ? std::max(1, std::atoi(arguments[1])) : 15;
    const int32_t abdomen[3] = {256, 160, 122}, abdomen_cells[3] = {14, 14, 14};
    const int32_t phantom[3] = {524, 176, 144}, phantom_cells[3] = {36, 18, 18};
    table(abdomen, abdomen_cells, runs);
    table(phantom, phantom_cells, runs);
    return 0;
}
