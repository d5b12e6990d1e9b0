// Warp and picking on the GPU, bitwise identical to the CPU, and behaviour when the GPU fails or its memory is full.
// Skipped without a GPU.
#include "backend/backend.h"
#include "cuda_warps.h"
#include "cut_cases.h"
#include "pliant/pliant.h"
#include "tool/pick.h"

#include <random>
#include <string>
#include <vector>

namespace {

/* ---- the warp */

TEST(CudaWarp, EqualsTheCpuBitForBit)
{
    NEEDS_GPU();
    for (pliant_encoding encoding : {PLIANT_UINT8, PLIANT_INT16, PLIANT_FLOAT32}) {
        SCOPED_TRACE(encoding);
        const int32_t cells[3] = {6, 5, 4};
        pliant_geometry geometry = geometry_of(75, 61, 50);
        Warps warps(encoding, geometry, cells, geometry);
        warps.update_and_compare(warps.rest(), "at rest");
        warps.update_and_compare(warps.wave(0.004, 0, 1), "wave");
        warps.update_and_compare(warps.wave(0.004, 0, 1), "nothing moved");
        warps.update_and_compare(warps.wave(0.003, 0.002, 2), "rough");
        warps.update_and_compare(warps.wave(0.02, 0.01, 3), "folded over and inside out");
        std::vector<double> x = warps.rest();
        for (size_t n = 0; n < x.size(); n += 3) x[n] += 0.003, x[n + 2] -= 0.004;
        warps.update_and_compare(x, "moved by whole voxels");
        x[3 * 40] += 0.002;
        warps.update_and_compare(x, "one node moved");
        for (size_t n = 0; n < x.size(); n++) x[n] *= 30;
        warps.update_and_compare(x, "blown up");
        warps.update_and_compare(warps.rest(), "at rest again");
    }
}

TEST(CudaWarp, OtherTargetsEqualToo)
{
    NEEDS_GPU();
    const int32_t cells[3] = {4, 4, 4};
    pliant_geometry geometry = geometry_of(40, 36, 33), oblique = geometry, mirrored = geometry, large = geometry,
                    flat = geometry_of(40, 36, 1);
    const double c = std::cos(0.4), s = std::sin(0.4);
    const double turned[9] = {c, -s, 0, s, c, 0, 0, 0, 1};
    std::memcpy(oblique.direction, turned, sizeof turned);
    for (int d = 0; d < 3; d++) oblique.spacing[d] *= 0.7;
    mirrored.direction[4] = -1;
    mirrored.origin[1] += 35 * mirrored.spacing[1];
    for (int d = 0; d < 3; d++) large.size[d] += 17, large.origin[d] -= 8 * large.spacing[d];
    int number = 0;
    for (const pliant_geometry &target : {oblique, mirrored, large, flat}) {
        SCOPED_TRACE(number++);
        Warps warps(PLIANT_INT16, geometry, cells, target);
        warps.update_and_compare(warps.rest(), "at rest");
        warps.update_and_compare(warps.wave(0.005, 0.0005, 4), "wave");
    }
    const int32_t few[3] = {3, 2, 1};
    Warps thin(PLIANT_INT16, geometry_of(1, 30, 2), few, geometry_of(1, 30, 2));
    thin.update_and_compare(thin.wave(0.001, 0, 5), "a scan of one voxel across");
}

TEST(CudaWarp, CrowdedBricksEqualToo)
{
    NEEDS_GPU();
    const int32_t cells[3] = {20, 20, 16};
    pliant_geometry geometry = geometry_of(48, 48, 40);
    // about 2000 tetrahedra per brick: longer lists than the initial capacity, and the slow path
    Warps warps(PLIANT_INT16, geometry, cells, geometry);
    warps.update_and_compare(warps.rest(), "at rest");
    warps.update_and_compare(warps.wave(0.002, 0.0003, 6), "wave");
    std::vector<double> x = warps.rest();
    for (size_t n = 0; n < x.size(); n++) x[n] = warps.mesh.corner[n % 3] + 0.2 * (x[n] - warps.mesh.corner[n % 3]);
    warps.update_and_compare(x, "all pressed together");
}

TEST(CudaWarp, WhatIsCutEqualsToo)
{
    NEEDS_GPU();
    for (bool crowded : {false, true})
        for (pliant_encoding encoding : {PLIANT_UINT8, PLIANT_INT16, PLIANT_FLOAT32}) {
            if (crowded && encoding != PLIANT_INT16) continue;
            SCOPED_TRACE(encoding);
            const int32_t few[3] = {6, 5, 4}, many[3] = {16, 16, 12};
            pliant_geometry geometry = crowded ? geometry_of(48, 48, 40) : geometry_of(75, 61, 50), target = geometry;
            for (int d = 0; d < 3; d++) target.size[d] += 9, target.origin[d] -= 4.5 * target.spacing[d];
            Warps warps(encoding, geometry, crowded ? many : few, target);
            const auto voxels = cut_cases::make_voxels(warps.mesh, geometry);
            const cut_cases::vector3 middle = {0.5 * geometry.size[0] - 0.3, 0.5 * geometry.size[1] + 0.2,
                                               0.5 * geometry.size[2] - 0.6};
            auto upto = [=](double i) {
                return cut_cases::plane(middle, {0.31, 0.83, -0.46},
                                        [=](const cut_cases::vector3 &at) { return at[0] < i; });
            };
            const auto across =
                cut_cases::plane(middle, {-0.4, 0.3, 0.87}, [](const cut_cases::vector3 &at) { return at[1] > 25; });
            const cut_cases::CutBody none(warps.mesh, *voxels, {}), some(warps.mesh, *voxels, {upto(20)}),
                more(warps.mesh, *voxels, {upto(30), across}), whole(warps.mesh, *voxels, {upto(100), across}, 2);
            ASSERT_GT(whole.chips, 0);
            warps.update_and_compare(warps.rest(), "before");
            for (double opening : {0.0, 0.004}) {
                set_and_compare(warps, some, opening, "a cut");
                set_and_compare(warps, more, opening, "goes on");
                set_and_compare(warps, whole, opening, "is whole");
                set_and_compare(warps, some, opening, "undone");
                set_and_compare(warps, none, opening, "healed");
                // and another body immediately
                for (pliant_warp *warp : {warps.cpu, warps.gpu})
                    ASSERT_EQ(pliant_warp_set_body(warp, &more.body), PLIANT_OK);
                set_and_compare(warps, whole, opening, "at once");
            }
            Warps fresh(encoding, geometry, crowded ? many : few, target);
            ASSERT_EQ(pliant_warp_set_body(fresh.cpu, &more.body), PLIANT_OK);
            ASSERT_EQ(pliant_warp_backend(fresh.gpu, PLIANT_CPU), PLIANT_OK);
            ASSERT_EQ(pliant_warp_set_body(fresh.gpu, &more.body), PLIANT_OK);
            ASSERT_EQ(pliant_warp_backend(fresh.gpu, PLIANT_CUDA), PLIANT_OK) << pliant_last_error();
            fresh.update_and_compare({more.body.fine.rest, more.body.fine.rest + 3 * more.body.fine.num_nodes},
                                     "cut before the GPU draws");
        }
}

/* ---- picks */

bool equal(const pliant_picked &a, const pliant_picked &b)
{
    return a.hit == b.hit && a.distance == b.distance && a.intensity == b.intensity && a.tetrahedron == b.tetrahedron &&
           std::memcmp(a.point, b.point, sizeof a.point) == 0 && std::memcmp(a.rest, b.rest, sizeof a.rest) == 0;
}

// Compare picks from all sides and from inside, at the body, past it, and with limited length.
// positions: positions at which tissue is located
void compare_picks(const Warps &warps, const std::vector<double> &positions, int rays, int *hits, int *misses,
                   int *at_once)
{
    const pliant_volume *volume = pliant_warp_volume(warps.cpu);
    const pliant_geometry &geometry = volume->geometry;
    std::mt19937 random(3);
    std::uniform_real_distribution<double> uniform(-0.7, 0.7);
    for (int n = 0; n < rays; n++) {
        pliant_ray ray{};
        const double away = n % 4 == 0 ? 0.5 : 3;
        double from[3], to[3], origin[3], target[3];
        for (int d = 0; d < 3; d++) {
            from[d] = (0.5 + away * uniform(random)) * geometry.size[d];
            to[d] = (0.5 + uniform(random)) * geometry.size[d];
        }
        pliant_geometry_to_world(&geometry, from, origin);
        pliant_geometry_to_world(&geometry, to, target);
        for (int d = 0; d < 3; d++) ray.origin[d] = origin[d], ray.direction[d] = target[d] - origin[d];
        if (n % 5 == 0) ray.near = 0.02, ray.far = 0.2;
        for (double threshold : {-300.0, 100.0}) {
            pliant_picked here{}, there{};
            ASSERT_EQ(pliant_pick(volume, &warps.mesh, positions.data(), &ray, threshold, &here), PLIANT_OK);
            ASSERT_EQ(pliant_pick_warped(warps.gpu, positions.data(), &ray, threshold, &there), PLIANT_OK);
            EXPECT_TRUE(equal(here, there))
                << "ray " << n << " above " << threshold << ": " << here.distance << " and " << there.distance;
            ++*(!here.hit ? misses : here.distance > ray.near ? hits : at_once);
        }
    }
}

TEST(CudaPick, EqualsTheCpuBitForBit)
{
    NEEDS_GPU();
    const int32_t cells[3] = {4, 4, 4}, voxels[3] = {48, 40, 36};
    pliant_volume phantom{};
    ASSERT_EQ(pliant_phantom(voxels, 1, &phantom, nullptr), PLIANT_OK) << pliant_last_error();
    pliant_geometry large = phantom.geometry;
    for (int d = 0; d < 3; d++) large.size[d] += 9;
    Warps body(phantom.encoding, phantom.geometry, cells, large),
        bytes(PLIANT_UINT8, geometry_of(31, 30, 29), cells, geometry_of(31, 30, 29)),
        floats(PLIANT_FLOAT32, geometry_of(31, 30, 29), cells, geometry_of(31, 30, 29));
    std::memcpy(body.scan.voxels, phantom.voxels,
                pliant_geometry_voxels(&phantom.geometry) * pliant_encoding_size(phantom.encoding));
    ASSERT_EQ(pliant_warp_backend(body.gpu, PLIANT_CPU), PLIANT_OK);
    ASSERT_EQ(pliant_warp_backend(body.gpu, PLIANT_CUDA), PLIANT_OK); // uploads the scan again
    for (Warps *warps : {&body, &bytes, &floats}) {
        int hits = 0, misses = 0, at_once = 0;
        for (const std::vector<double> &x : {warps->rest(), warps->wave(0.004, 0.0005, 4)}) {
            warps->update_and_compare(x, "the volume");
            compare_picks(*warps, x, warps == &body ? 150 : 40, &hits, &misses, &at_once);
            std::vector<double> elsewhere = x; // crossings without tissue are skipped
            for (size_t n = 0; n < x.size(); n += 3)
                elsewhere[n] += 0.5 * warps->scan.geometry.size[0] * warps->scan.geometry.spacing[0];
            compare_picks(*warps, elsewhere, 40, &hits, &misses, &at_once);
        }
        EXPECT_GT(hits, 20);
        EXPECT_GT(misses, 20);
        EXPECT_GT(at_once, 5);
    }
    pliant_volume_free(&phantom);
}

// A ray with at most one crossing needs four calls of the CUDA runtime. If one fails, the CPU picks the same point.
TEST(CudaPick, TheCpuContinues)
{
    NEEDS_GPU();
    const int32_t cells[3] = {4, 4, 4};
    const pliant_geometry geometry = geometry_of(31, 30, 29);
    Warps warps(PLIANT_INT16, geometry, cells, geometry);
    const pliant_ray ray = {{-0.1, 0.05, 0.12}, {1, 0, 0.1}, 0, 0};
    for (int calls = 0; calls <= 4; calls++) {
        const std::vector<double> x = warps.wave(0.002, 0, static_cast<unsigned>(calls));
        ASSERT_EQ(pliant_warp_update(warps.cpu, x.data()), PLIANT_OK);
        ASSERT_EQ(pliant_warp_update(warps.gpu, x.data()), PLIANT_OK);
        const march_ray along = {{31, 30, 29}, {0, 15, 14}, {1000, 0, 0}, 0, 0.03, 0.0005, 100, 200};
        march_crossing found{};
        EXPECT_FALSE(pliant_warp_cross(warps.cpu, &along, 0, &found));
        pliant_cuda_fail_after(calls);
        EXPECT_EQ(pliant_warp_cross(warps.gpu, &along, 0, &found), calls == 4) << calls;
        pliant_picked here{}, there{};
        pliant_cuda_fail_after(calls);
        ASSERT_EQ(pliant_pick_warped(warps.gpu, x.data(), &ray, 100, &there), PLIANT_OK) << calls;
        pliant_cuda_fail_after(-1);
        ASSERT_EQ(pliant_pick(pliant_warp_volume(warps.cpu), &warps.mesh, x.data(), &ray, 100, &here), PLIANT_OK);
        EXPECT_TRUE(here.hit && equal(here, there)) << calls;
    }
}

// If another program uses all of the GPU's memory, a volume that does not fit is rejected with the sizes, or drawn by
// the CPU.
TEST(CudaFailure, AFullGpuIsLoggedWithFigures)
{
    NEEDS_GPU();
    const int32_t cells[3] = {4, 4, 4};
    pliant_geometry geometry = geometry_of(128, 128, 128);
    Warps warps(PLIANT_INT16, geometry, cells, geometry);
    warps.update_and_compare(warps.rest(), "before");
    std::vector<void *> taken;
    void *block, *for_the_probe; /* leaves too little memory for a volume */
    ASSERT_EQ(pliant_cuda_allocate(size_t(1) << 22, "a test", &for_the_probe), PLIANT_OK);
    for (size_t bytes = size_t(1) << 36; bytes > 1 << 20; bytes /= 2)
        while (pliant_cuda_allocate(bytes, "a test", &block) == PLIANT_OK) taken.push_back(block);
    pliant_cuda_release(for_the_probe);
    pliant_warp *other = nullptr;
    ASSERT_EQ(pliant_warp_create(&warps.scan, &warps.mesh, &geometry, 2, &other), PLIANT_OK);
    EXPECT_EQ(pliant_warp_backend(other, PLIANT_CUDA), PLIANT_ERROR_MEMORY);
    EXPECT_NE(std::string(pliant_last_error()).find("MB needed"), std::string::npos) << pliant_last_error();
    EXPECT_EQ(pliant_warp_backend(other, PLIANT_AUTO), PLIANT_OK) << pliant_last_error();
    EXPECT_EQ(pliant_warp_accelerated(other), nullptr);
    warps.update_and_compare(warps.wave(0.004, 0, 1), "what was made before goes on");
    for (void *each : taken) pliant_cuda_release(each);
    pliant_warp_free(other);
}

/* ---- images */

// Compare camera images and radiographs of a volume and labels drawn on the GPU with the CPU, bitwise; after a failure
// the CPU continues.
// cells: of the mesh along each axis, 0: default
void compare_pictures(const int32_t size[3], int32_t cells, int width, int height, int minimum)
{
    const size_t pixels = static_cast<size_t>(width) * static_cast<size_t>(height);
    pliant_scene scene;
    pliant_volume scan{};
    pliant_material_table materials{};
    pliant_scene_defaults(&scene);
    scene.element.kind = PLIANT_LINEAR;
    scene.cut.kind = PLIANT_CUT_SEVER;
    if (cells > 0) { // too coarse for bone, so the back is fixed instead
        scene.mesh.ratio = 1;
        scene.fixed.planes[scene.fixed.num_planes++] = {{0, 0.03, 0}, {0, -1, 0}};
        for (int d = 0; d < 3; d++) scene.mesh.coarse_cells[d] = cells;
    }
    ASSERT_EQ(pliant_phantom(size, 3, &scan, nullptr), PLIANT_OK);
    ASSERT_EQ(pliant_material_table_default(&materials), PLIANT_OK);
    std::vector<uint8_t> rgb[3], label[3];
    std::vector<float> depth[3], line[3];
    pliant_camera camera;
    const double from[3] = {0.1, -0.5, 0.2}, at[3] = {0, 0, 0}, up[3] = {0, 0, 1};
    pliant_camera_of_view(width, height, 0.7, &camera);
    ASSERT_EQ(pliant_camera_look_at(&camera, from, at, up), PLIANT_OK);
    for (int run = 0; run < 3; run++) { // the CPU, the GPU, and a failing GPU
        scene.solver.backend = run == 0 ? PLIANT_CPU : PLIANT_CUDA;
        pliant_model *model = nullptr;
        pliant_data *data = nullptr;
        pliant_view *view = nullptr;
        ASSERT_EQ(pliant_model_build(&scene, &scan, nullptr, &materials, pliant_progress{}, &model), PLIANT_OK)
            << pliant_last_error();
        ASSERT_EQ(pliant_data_create(model, &data), PLIANT_OK) << pliant_last_error();
        const double points[6] = {-0.15, -0.2, 0.01, 0.15, -0.2, 0.01}, deep[3] = {0, 0.15, 0};
        ASSERT_EQ(pliant_data_cut(model, data, 2, points, deep, nullptr), PLIANT_OK) << pliant_last_error();
        const pliant_body *body = pliant_data_get_body(data);
        std::vector<double> x(body->fine.rest, body->fine.rest + 3 * body->fine.num_nodes);
        for (size_t n = 0; n < x.size(); n += 3)
            x[n + 1] += 0.006 * std::sin(30 * x[n] + 20 * x[n + 2] + 0.001 * double(n));
        ASSERT_EQ(pliant_view_create(model, nullptr, &view), PLIANT_OK) << pliant_last_error();
        ASSERT_EQ(pliant_view_set(view, body, x.data(), nullptr), PLIANT_OK);
        for (int by_label = 0; by_label < 2; by_label++) {
            pliant_style style;
            ASSERT_EQ(pliant_style_defaults(&scan, &style), PLIANT_OK);
            style.by_label = by_label;
            if (by_label) style.shown[2] = style.shown[3] = 0;
            std::vector<uint8_t> one(3 * pixels), tissue(pixels);
            std::vector<float> far(pixels);
            const pliant_image image = {one.data(), far.data(), tissue.data()};
            if (run == 2) ASSERT_EQ(pliant_view_render(view, &camera, &style, &image), PLIANT_OK);
            if (run == 2) pliant_cuda_fail_after(1);
            EXPECT_EQ(pliant_view_render(view, &camera, &style, &image), PLIANT_OK) << pliant_last_error();
            pliant_cuda_fail_after(-1);
            rgb[run].insert(rgb[run].end(), one.begin(), one.end());
            label[run].insert(label[run].end(), tissue.begin(), tissue.end());
            depth[run].insert(depth[run].end(), far.begin(), far.end());
        }
        line[run].resize(pixels);
        EXPECT_EQ(pliant_view_radiograph(view, &camera, PLIANT_WATER_ATTENUATION, line[run].data()), PLIANT_OK)
            << pliant_last_error();
        EXPECT_EQ(rgb[run], rgb[0]) << run;
        EXPECT_EQ(label[run], label[0]) << run;
        EXPECT_EQ(std::memcmp(depth[run].data(), depth[0].data(), depth[0].size() * sizeof(float)), 0) << run;
        EXPECT_EQ(line[run], line[0]) << run;
        pliant_view_free(view);
        pliant_data_free(data);
        pliant_model_free(model);
    }
    EXPECT_GT(std::count_if(depth[0].begin(), depth[0].end(), [](float z) { return z > 0; }), minimum);
    pliant_material_table_free(&materials);
    pliant_volume_free(&scan);
}

TEST(CudaWarp, PicturesHaveTheBitsOfTheCpu)
{
    NEEDS_GPU();
    const int32_t size[3] = {64, 47, 51};
    compare_pictures(size, 0, 150, 110, 5000);
}

// runs every kernel of the warp and of images in a short time, for compute-sanitizer
TEST(CudaWarp, EveryKernelOnce)
{
    NEEDS_GPU();
    const int32_t cells[3] = {4, 4, 4}, size[3] = {20, 18, 17};
    // all elements in one brick: more than the usual kernel can index
    for (pliant_encoding encoding : {PLIANT_UINT8, PLIANT_INT16, PLIANT_FLOAT32}) {
        SCOPED_TRACE(encoding);
        const pliant_geometry geometry = geometry_of(16, 15, 14), target = geometry_of(19, 15, 14);
        Warps warps(encoding, geometry, cells, target);
        const auto voxels = cut_cases::make_voxels(warps.mesh, geometry);
        const cut_cases::CutBody some(warps.mesh, *voxels,
                                      {cut_cases::plane({7.7, 7.2, 6.4}, {0.31, 0.83, -0.46},
                                                        [](const cut_cases::vector3 &at) { return at[0] < 9; })}),
            none(warps.mesh, *voxels, {});
        warps.update_and_compare(warps.rest(), "at rest");
        warps.update_and_compare(warps.wave(0.002, 0.0003, 6), "wave");
        set_and_compare(warps, some, 0.002, "a cut");
        std::vector<double> x(some.body.fine.rest, some.body.fine.rest + 3 * some.body.fine.num_nodes);
        for (size_t n = 0; n < x.size(); n++) x[n] = warps.mesh.corner[n % 3] + 0.2 * (x[n] - warps.mesh.corner[n % 3]);
        warps.update_and_compare(x, "all pressed together");
        set_and_compare(warps, none, 0, "healed");
        const std::vector<double> pressed(x.begin(), x.begin() + 3 * warps.mesh.num_nodes);
        warps.update_and_compare(pressed, "all pressed together, and whole");
    }
    const int32_t two[3] = {2, 2, 2};
    Warps few(PLIANT_INT16, geometry_of(20, 18, 17), two, geometry_of(20, 18, 17)); // drawn by the usual kernel
    few.update_and_compare(few.wave(0.002, 0, 6), "a wave of few");
    compare_pictures(size, 4, 24, 20, 10);
}

} // namespace
