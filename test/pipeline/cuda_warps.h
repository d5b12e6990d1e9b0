// For tests of the CUDA backend: detect a GPU; the same warp on the CPU and on the GPU.
#ifndef PLIANT_TEST_CUDA_WARPS_H
#define PLIANT_TEST_CUDA_WARPS_H

#include "backend/backend.h"
#include "warp/device.h"

#include "mesh/mesh.h"
#include "scan/volume.h"
#include "model_data/data.h"
#include <gtest/gtest.h>

#include <cmath>
#include <cstring>
#include <random>
#include <vector>

#ifdef PLIANT_WITH_CUDA
extern "C" int64_t pliant_cuda_fail_after(int64_t calls);
extern "C" pliant_status pliant_cuda_allocate(size_t bytes, const char *what, void **out);
extern "C" void pliant_cuda_release(void *d_block);
#else
static int64_t pliant_cuda_fail_after(int64_t) { return 0; }
static pliant_status pliant_cuda_allocate(size_t, const char *, void **) { return PLIANT_ERROR_UNAVAILABLE; }
static void pliant_cuda_release(void *) {}
#endif

inline bool there_is_a_gpu()
{
    const pliant_backend *cuda = pliant_corotational.cuda;
    char text[PLIANT_BACKEND_TEXT];
    bool use = false;
    return pliant_gpu_choose(PLIANT_AUTO, cuda ? cuda->probe : nullptr, text, &use) == PLIANT_OK && use;
}

#define NEEDS_GPU() \
    if (!there_is_a_gpu()) GTEST_SKIP() << "no GPU can be used"

struct Warps {
    pliant_volume scan{};
    pliant_mesh mesh{};
    pliant_warp *cpu = nullptr, *gpu = nullptr;

    Warps(pliant_encoding encoding, const pliant_geometry &geometry, const int32_t cells[3],
          const pliant_geometry &target)
    {
        EXPECT_EQ(pliant_volume_create(&geometry, encoding, &scan), PLIANT_OK);
        scan.background = encoding == PLIANT_UINT8 ? 3 : -1024;
        scan.slope = encoding == PLIANT_UINT8 ? 7.3f : 1;
        scan.intercept = encoding == PLIANT_UINT8 ? -1000 : 0;
        std::mt19937 random(7);
        for (size_t v = 0; v < pliant_geometry_voxels(&geometry); v++) {
            if (encoding == PLIANT_UINT8) static_cast<uint8_t *>(scan.voxels)[v] = static_cast<uint8_t>(random());
            if (encoding == PLIANT_INT16) static_cast<int16_t *>(scan.voxels)[v] = static_cast<int16_t>(random());
            if (encoding == PLIANT_FLOAT32)
                static_cast<float *>(scan.voxels)[v] = v % 17 ? static_cast<float>(random()) * 1e-6f - 2e3f : -0.0f;
        }
        EXPECT_EQ(pliant_mesh_grid(&geometry, cells, nullptr, &mesh), PLIANT_OK);
        EXPECT_EQ(pliant_warp_create(&scan, &mesh, &target, 2, &cpu), PLIANT_OK) << pliant_last_error();
        EXPECT_EQ(pliant_warp_create(&scan, &mesh, &target, 2, &gpu), PLIANT_OK);
        EXPECT_EQ(pliant_warp_backend(gpu, PLIANT_CUDA), PLIANT_OK) << pliant_last_error();
    }
    ~Warps()
    {
        pliant_warp_free(cpu);
        pliant_warp_free(gpu);
        pliant_mesh_free(&mesh);
        pliant_volume_free(&scan);
    }
    std::vector<double> rest() const { return {mesh.rest, mesh.rest + 3 * mesh.num_nodes}; }
    // Return positions displaced by a smooth wave and noise; amplitudes in metres.
    std::vector<double> wave(double amount, double noise, unsigned seed) const
    {
        std::vector<double> x = rest();
        std::mt19937 random(seed);
        std::uniform_real_distribution<double> uniform(-noise, noise);
        for (size_t n = 0; n < x.size(); n += 3) {
            double a = 70 * x[n] + seed, b = 60 * x[n + 1], c = 50 * x[n + 2];
            double by[3] = {std::sin(b + c), std::cos(a - c), std::sin(a + 0.5 * b)};
            for (size_t d = 0; d < 3; d++) x[n + d] += amount * by[d] + uniform(random);
        }
        return x;
    }
    void update_and_compare(const std::vector<double> &x, const char *what)
    {
        ASSERT_EQ(pliant_warp_update(cpu, x.data()), PLIANT_OK) << what;
        ASSERT_EQ(pliant_warp_update(gpu, x.data()), PLIANT_OK) << what;
        ASSERT_NE(pliant_warp_accelerated(gpu), nullptr) << what;
        const pliant_volume *a = pliant_warp_volume(cpu), *b = pliant_warp_volume(gpu);
        size_t bytes = pliant_encoding_size(scan.encoding), different = 0,
               voxels = pliant_geometry_voxels(&a->geometry);
        for (size_t v = 0; v < voxels; v++)
            different += std::memcmp(static_cast<char *>(a->voxels) + bytes * v,
                                     static_cast<char *>(b->voxels) + bytes * v, bytes) != 0;
        EXPECT_EQ(different, 0u) << what << ", of " << voxels << " voxels";
        int32_t count[3];
        const uint8_t *here, *there;
        pliant_warp_bricks(cpu, count, &here);
        pliant_warp_bricks(gpu, count, &there);
        int only_here = 0, only_there = 0, all_there = 1; // if the lists of a brick overflow, a GPU redraws everything
        for (size_t b = 0; b < static_cast<size_t>(count[0]) * count[1] * count[2]; b++) {
            only_here += here[b] && !there[b];
            only_there += there[b] && !here[b];
            all_there = all_there && there[b];
        }
        EXPECT_EQ(only_here, 0) << what << ": bricks that changed on the CPU alone";
        EXPECT_EQ(all_there ? 0 : only_there, 0) << what << ": bricks that changed on the GPU alone";
    }
};

// Set the same body in both warps; copied nodes are moved slightly apart.
template <class CutBody> void set_and_compare(Warps &warps, const CutBody &cut, double opening, const char *what)
{
    ASSERT_EQ(pliant_warp_set_body(warps.cpu, &cut.body), PLIANT_OK) << pliant_last_error();
    ASSERT_EQ(pliant_warp_set_body(warps.gpu, &cut.body), PLIANT_OK) << pliant_last_error();
    std::vector<double> x(cut.body.fine.rest, cut.body.fine.rest + 3 * cut.body.fine.num_nodes);
    for (size_t n = 0; n < cut.node_parent.size(); n++) {
        if (int32_t(n) >= warps.mesh.num_nodes) x[3 * n] += opening, x[3 * n + 2] += 0.6 * opening;
        x[3 * n + 1] += 0.3 * opening * std::sin(90 * x[3 * n + 2]);
    }
    warps.update_and_compare(x, what);
    warps.update_and_compare(x, "nothing moved");
    for (double &v : x) v += 0.0003;
    warps.update_and_compare(x, "all moved");
}

inline pliant_geometry geometry_of(int i, int j, int k)
{
    return {{i, j, k}, {-0.02, 0.03, 0.1}, {0.001, 0.0015, 0.002}, {1, 0, 0, 0, 1, 0, 0, 0, 1}};
}

#endif
