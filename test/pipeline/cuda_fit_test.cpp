// The moving-least-squares fit on the GPU: voxels bitwise identical to the CPU's. Skipped without a GPU.
#include "body.h"
#include "cuda_warps.h"
#include "cut_cases.h"
#include "warp/warp_state.h"
#include "warp/warp.h"

#include <string>

namespace {

struct Fits : Warps {
    Fits(pliant_encoding encoding, const pliant_geometry &geometry, const int32_t cells[3],
         const pliant_geometry &target, int32_t step)
        : Warps(encoding, geometry, cells, target)
    {
        EXPECT_EQ(pliant_warp_fit(cpu, step), PLIANT_OK) << pliant_last_error();
        EXPECT_EQ(pliant_warp_fit(gpu, step), PLIANT_OK);
        EXPECT_EQ(pliant_warp_backend(gpu, PLIANT_CUDA), PLIANT_OK) << pliant_last_error();
    }
};

TEST(CudaFit, EqualsTheCpuBitForBit)
{
    NEEDS_GPU();
    for (pliant_encoding encoding : {PLIANT_UINT8, PLIANT_INT16, PLIANT_FLOAT32})
        for (int32_t step : {1, 4, 7}) {
            SCOPED_TRACE(encoding);
            SCOPED_TRACE(step);
            const int32_t cells[3] = {6, 5, 4};
            pliant_geometry geometry = geometry_of(45, 37, 30);
            Fits fits(encoding, geometry, cells, geometry, step);
            fits.update_and_compare(fits.rest(), "at rest");
            fits.update_and_compare(fits.wave(0.003, 0, 1), "wave");
            fits.update_and_compare(fits.wave(0.003, 0, 1), "nothing moved");
            fits.update_and_compare(fits.wave(0.02, 0.01, 3), "folded over");
            std::vector<double> x = fits.rest();
            x[3 * 40] += 3;
            fits.update_and_compare(x, "one node flew away");
            for (size_t n = 0; n < x.size(); n++) x[n] = fits.mesh.corner[n % 3];
            fits.update_and_compare(x, "all in one point");
            fits.update_and_compare(fits.rest(), "at rest again");
        }
}

TEST(CudaFit, OtherTargetsEqualToo)
{
    NEEDS_GPU();
    const int32_t cells[3] = {5, 4, 4};
    pliant_geometry geometry = geometry_of(40, 36, 33), oblique = geometry, large = geometry,
                    flat = geometry_of(40, 36, 1);
    const double c = std::cos(0.4), s = std::sin(0.4);
    const double turned[9] = {c, -s, 0, s, c, 0, 0, 0, 1};
    std::memcpy(oblique.direction, turned, sizeof turned);
    for (int d = 0; d < 3; d++) {
        oblique.spacing[d] *= 0.7;
        large.size[d] += 17;
        large.origin[d] -= 8 * large.spacing[d];
    }
    int number = 0;
    for (const pliant_geometry &target : {oblique, large, flat}) {
        SCOPED_TRACE(number++);
        Fits fits(PLIANT_INT16, geometry, cells, target, 3);
        fits.update_and_compare(fits.rest(), "at rest");
        fits.update_and_compare(fits.wave(0.005, 0.0005, 4), "wave");
    }
}

// Near a cut, elements are drawn by their own maps; elsewhere by the fit.
// crowded: a brick has more elements than the usual kernel can index
TEST(CudaFit, WhatIsCutEqualsToo)
{
    NEEDS_GPU();
    for (bool crowded : {false, true})
        for (pliant_encoding encoding : {PLIANT_UINT8, PLIANT_INT16, PLIANT_FLOAT32}) {
            if (crowded && encoding != PLIANT_INT16) continue;
            SCOPED_TRACE(encoding);
            const int32_t few[3] = {14, 12, 6}, many[3] = {20, 20, 16};
            pliant_geometry geometry = crowded ? geometry_of(48, 48, 40) : geometry_of(75, 61, 50), target = geometry;
            for (int d = 0; d < 3; d++) target.size[d] += 9, target.origin[d] -= 4.5 * target.spacing[d];
            Fits fits(encoding, geometry, crowded ? many : few, target, 4);
            const auto voxels = cut_cases::make_voxels(fits.mesh, geometry);
            const cut_cases::vector3 middle = {12.3, 0.5 * geometry.size[1] + 0.2, 0.5 * geometry.size[2] - 0.6};
            auto upto = [=](double i) {
                return cut_cases::plane(middle, {0.83, 0.31, -0.26},
                                        [=](const cut_cases::vector3 &at) { return at[1] < i; });
            };
            const cut_cases::CutBody none(fits.mesh, *voxels, {}), some(fits.mesh, *voxels, {upto(20)}),
                whole(fits.mesh, *voxels, {upto(100)}, 2);
            fits.update_and_compare(fits.rest(), "before");
            for (double opening : {0.0, 0.004}) {
                set_and_compare(fits, some, opening, "a cut");
                set_and_compare(fits, whole, opening, "is whole");
                set_and_compare(fits, some, opening, "undone");
                set_and_compare(fits, none, opening, "healed");
                set_and_compare(fits, whole, opening, "again");
            }
            if (!crowded) { // some are drawn by their own maps, some are blended, some use the fit alone
                const fit_view *view = pliant_fit_parts(fits.cpu->fit);
                int by[5] = {0, 0, 0, 0, 0};
                for (int32_t e = 0; e < view->num_elements; e++) by[view->zone[e]]++;
                EXPECT_TRUE(by[0] > 100 && by[4] > 100 && by[1] + by[2] + by[3] > 100) << by[0] << " " << by[4];
            }
        }
}

void fit_once(pliant_encoding encoding)
{
    SCOPED_TRACE(encoding);
    for (int32_t n : {2, 4}) { // with 4, a brick has more elements than the usual kernel can index
        SCOPED_TRACE(n);
        const int32_t cells[3] = {n, n, n};
        const pliant_geometry geometry = geometry_of(16, 15, 14), target = geometry_of(19, 15, 14);
        Fits fits(encoding, geometry, cells, target, 4);
        const auto voxels = cut_cases::make_voxels(fits.mesh, geometry);
        const cut_cases::CutBody some(fits.mesh, *voxels,
                                      {cut_cases::plane({4.3, 7.2, 6.4}, {0.83, 0.31, -0.26},
                                                        [](const cut_cases::vector3 &at) { return at[1] < 8; })});
        fits.update_and_compare(fits.wave(0.002, 0.0003, 6), "wave");
        set_and_compare(fits, some, 0.002, "a cut");
    }
}

// runs every kernel in a short time, for compute-sanitizer
TEST(CudaFit, EveryKernelOnce)
{
    NEEDS_GPU();
    fit_once(PLIANT_UINT8);
}

TEST(CudaFit, EveryKernelOnceOfOtherEncodings)
{
    NEEDS_GPU();
    for (pliant_encoding encoding : {PLIANT_INT16, PLIANT_FLOAT32}) fit_once(encoding);
}

// In a scene with explicit dynamics, positions stay on the GPU.
TEST(CudaFit, AStepDrawsIt)
{
    NEEDS_GPU();
    for (pliant_solver_kind kind : {PLIANT_TLED, PLIANT_COROTATIONAL}) {
        const int size[3] = {16, 16, 32};
        const double box[3] = {0.04, 0.04, 0.08};
        Body body(size, box, {{5e3, 0.3, 1000, false}, {2e4, 0.3, 1000, false}},
                  [](int i, int, int k) { return i < 6 && k < 10; });
        body.cells(4, 4, 8, 1);
        body.fix_plane(0, 0, 1e-6, 0, 0, 1);
        body.scene.model.gravity[0] = 3;
        body.scene.solver.kind = kind;
        body.scene.solver.backend = PLIANT_CUDA;
        body.scene.warp.kind = PLIANT_FIT;
        ASSERT_EQ(body.build(), PLIANT_OK) << pliant_last_error();
        ASSERT_EQ(pliant_data_set_warp(body.model, body.data, &body.scan.geometry), PLIANT_OK) << pliant_last_error();
        for (int s = 0; s < 5; s++) ASSERT_GE(pliant_step(body.model, body.data), 0) << pliant_last_error();
        ASSERT_STREQ(pliant_data_get_backend(body.data), "cuda");
        pliant_warp *warp = nullptr;
        ASSERT_EQ(pliant_warp_create(&body.scan, &body.model->body->fine, &body.scan.geometry, 2, &warp), PLIANT_OK);
        ASSERT_EQ(pliant_warp_fit(warp, PLIANT_FIT_STEP), PLIANT_OK);
        ASSERT_EQ(pliant_warp_update(warp, body.data->positions), PLIANT_OK);
        EXPECT_EQ(
            std::memcmp(pliant_warp_volume(warp)->voxels, pliant_warp_volume(body.data->warp)->voxels, 16 * 16 * 32),
            0);
        pliant_warp_free(warp);
    }
}

// Every call of the CUDA runtime fails once; the CPU draws the same volume.
TEST(CudaFit, TheCpuContinues)
{
    NEEDS_GPU();
    const int32_t cells[3] = {3, 3, 3};
    const pliant_geometry geometry = geometry_of(20, 18, 17);
    Fits fits(PLIANT_INT16, geometry, cells, geometry, 4);
    int given_up = 0;
    for (int64_t calls = 0, left = -1; left < 0; calls++) {
        ASSERT_LT(calls, 5000);
        ASSERT_EQ(pliant_warp_fit(fits.gpu, 4), PLIANT_OK);
        pliant_cuda_fail_after(calls);
        ASSERT_EQ(pliant_warp_backend(fits.gpu, PLIANT_AUTO), PLIANT_OK) << pliant_last_error();
        const std::vector<double> x = fits.wave(0.002, 0, static_cast<unsigned>(calls));
        ASSERT_EQ(pliant_warp_update(fits.gpu, x.data()), PLIANT_OK) << "call " << calls;
        left = pliant_cuda_fail_after(-1);
        ASSERT_EQ(pliant_warp_update(fits.cpu, x.data()), PLIANT_OK);
        if (left >= 0) EXPECT_TRUE(pliant_warp_accelerated(fits.gpu)) << pliant_last_error();
        given_up += !pliant_warp_accelerated(fits.gpu);
        const size_t bytes = pliant_geometry_voxels(&geometry) * sizeof(int16_t);
        EXPECT_EQ(std::memcmp(pliant_warp_volume(fits.cpu)->voxels, pliant_warp_volume(fits.gpu)->voxels, bytes), 0)
            << "call " << calls;
    }
    EXPECT_GT(given_up, 20);
}

} // namespace
