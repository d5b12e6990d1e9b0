// Voxels that contain tissue and air are displayed as tissue. Lung, thin organs and labels stay unchanged.
#include "material/partial_volume.h"
#include "pipeline/body.h"
#include "sim/build/model.h"

#include <array>
#include <algorithm>
#include <cstdio>
#include <cstdlib>
#include <fstream>
#include <gtest/gtest.h>
#include <string>
#include <vector>

namespace {

enum { AIR, LUNG, FAT, MUSCLE };

struct Table {
    std::array<pliant_material, 4> materials{};
    pliant_material_table table{};
    Table()
    {
        const double density[] = {1.2, 260, 950, 1060};
        for (size_t m = 0; m < materials.size(); m++) materials[m].density = density[m];
        materials[AIR].empty = true;
        table.materials = materials.data();
        table.num_materials = 4;
    }
    // Return the displayed materials of a row of voxels along an axis. All rows are equal.
    std::vector<int> shown(const std::vector<int> &row, int axis = 0) const
    {
        int32_t size[3] = {9, 9, 9}, at[3] = {4, 4, 4};
        size[axis] = static_cast<int32_t>(row.size());
        std::vector<uint8_t> voxels;
        for (int k = 0; k < size[2]; k++)
            for (int j = 0; j < size[1]; j++)
                for (int i = 0; i < size[0]; i++)
                    voxels.push_back(static_cast<uint8_t>(row[static_cast<size_t>(axis == 0 ? i : axis == 1 ? j : k)]));
        std::vector<int> out;
        for (at[axis] = 0; at[axis] < size[axis]; at[axis]++)
            out.push_back(pliant_material_for_display(&table, size, voxels.data(), at));
        return out;
    }
};

TEST(PartialVolume, AThinLayerBetweenTissueAndAirIsTissue)
{
    const Table of;
    using Row = std::vector<int>;
    for (int axis = 0; axis < 3; axis++) {
        EXPECT_EQ(of.shown({AIR, AIR, AIR, LUNG, FAT, MUSCLE}, axis), (Row{AIR, AIR, AIR, FAT, FAT, MUSCLE})) << axis;
        EXPECT_EQ(of.shown({MUSCLE, MUSCLE, LUNG, AIR, AIR}, axis), (Row{MUSCLE, MUSCLE, MUSCLE, AIR, AIR})) << axis;
        EXPECT_EQ(of.shown({AIR, AIR, LUNG, LUNG, MUSCLE, FAT}, axis), (Row{AIR, AIR, MUSCLE, MUSCLE, MUSCLE, FAT}))
            << axis;
        EXPECT_EQ(of.shown({AIR, AIR, LUNG, LUNG, LUNG, MUSCLE}, axis)[3], MUSCLE) << "in the middle of three";
    }
}

TEST(PartialVolume, VoxelsAwayFromBordersAreUnchanged)
{
    const Table of;
    for (const std::vector<int> &row : {std::vector<int>{AIR, AIR, LUNG, LUNG, LUNG, LUNG, LUNG, LUNG, LUNG, LUNG},
                                        {MUSCLE, LUNG, LUNG, LUNG, LUNG, LUNG, MUSCLE},
                                        {AIR, AIR, FAT, MUSCLE, MUSCLE},
                                        {AIR, AIR, MUSCLE, FAT},
                                        {AIR, AIR, AIR},
                                        {AIR, AIR, LUNG, AIR, AIR},
                                        {MUSCLE, LUNG, AIR, LUNG, LUNG, LUNG},
                                        {LUNG, MUSCLE, LUNG}})
        EXPECT_EQ(of.shown(row), row);
    EXPECT_EQ(of.shown({AIR, AIR, LUNG, LUNG, LUNG, LUNG, LUNG, MUSCLE}),
              (std::vector<int>{AIR, AIR, LUNG, LUNG, LUNG, LUNG, LUNG, MUSCLE}))
        << "five voxels are lung";
}

TEST(PartialVolume, ACornerIsShownAsItsTissue)
{
    const Table of;
    const int32_t size[3] = {7, 7, 7};
    std::vector<uint8_t> voxels;
    for (int k = 0; k < 7; k++)
        for (int j = 0; j < 7; j++)
            for (int i = 0; i < 7; i++)
                voxels.push_back(std::min({i, j, k}) >= 4 ? MUSCLE : std::min({i, j, k}) == 3 ? LUNG : AIR);
    for (int n = 3; n < 7; n++)
        for (const std::array<int32_t, 3> &at : {std::array<int32_t, 3>{3, 3, 3}, {3, 3, 5}, {3, 5, 5}, {5, 3, 3}})
            EXPECT_EQ(pliant_material_for_display(&of.table, size, voxels.data(), at.data()), MUSCLE)
                << at[0] << at[1] << at[2];
}

// Pictures and point queries of a model agree. Stiffness and mass use the voxels' own materials.
TEST(PartialVolume, PicturesAndPointsOfAModelAgree)
{
    const int size[3] = {20, 20, 20};
    const double box[3] = {0.04, 0.04, 0.04};
    Body body(size, box, {{10, 0, 1.2, true}, {1000, 0.3, 260, false}, {10e3, 0.4, 1000, false}}, [](int, int j, int) {
        return j < 5 ? 0 : j < 6 ? 1 : 2;
    });
    body.cells(4, 4, 4, 1);
    body.fix_plane(0, 0.038, 0, 0, -1, 0);
    ASSERT_EQ(body.build(), PLIANT_OK) << pliant_last_error();
    const double skin[3] = {0.02, 0.011, 0.02}, inside[3] = {0.02, 0.03, 0.02}, air[3] = {0.02, 0.001, 0.02},
                 far[3] = {0.02, 5, 0.02};
    EXPECT_EQ(pliant_model_material_at(body.model, skin), 2);
    EXPECT_EQ(pliant_model_material_at(body.model, inside), 2);
    EXPECT_EQ(pliant_model_material_at(body.model, air), 0);
    EXPECT_EQ(pliant_model_material_at(body.model, far), 2);
    EXPECT_EQ(pliant_model_get_voxel_materials(body.model)[10 + 20 * (5 + 20 * 10)], 1) << "the mechanics' own";
    pliant_view *view = nullptr;
    ASSERT_EQ(pliant_view_create(body.model, nullptr, &view), PLIANT_OK) << pliant_last_error();
    pliant_camera camera{};
    const double from[3] = {0.02, -0.2, 0.02}, at[3] = {0.02, 0.02, 0.02}, up[3] = {0, 0, 1};
    pliant_camera_of_view(64, 64, 0.3, &camera);
    ASSERT_EQ(pliant_camera_look_at(&camera, from, at, up), PLIANT_OK) << pliant_last_error();
    std::vector<uint8_t> rgb(3 * 64 * 64), label(64 * 64);
    std::vector<float> depth(64 * 64);
    pliant_style style{};
    ASSERT_EQ(pliant_style_defaults(&body.scan, &style), PLIANT_OK);
    style.threshold = 0.5f;
    const pliant_image image{rgb.data(), depth.data(), label.data()};
    ASSERT_EQ(pliant_view_render(view, &camera, &style, &image), PLIANT_OK) << pliant_last_error();
    EXPECT_EQ(label[32 + 64 * 32], 2 + 1);
    for (uint8_t one : label) EXPECT_NE(one, 1 + 1);
    pliant_view_free(view);
}

// The skin of an abdominal CT with the built-in table, from the front and the sides. The mattress and table behind the
// body are as light as lung.
TEST(PartialVolume, TheSkinOfACtIsNoLung)
{
    pliant_volume scan{};
    if (pliant_volume_read(PLIANT_TEST_DATA "/abdomen/ct.nii.gz", "", SIZE_MAX, &scan) < 0)
        GTEST_SKIP() << "no scan in " PLIANT_TEST_DATA;
    pliant_material_table table{};
    pliant_scene scene;
    pliant_model *model = nullptr;
    pliant_view *view = nullptr;
    pliant_scene_defaults(&scene);
    ASSERT_EQ(pliant_material_table_default(&table), PLIANT_OK);
    ASSERT_EQ(pliant_model_build(&scene, &scan, nullptr, &table, {nullptr, nullptr}, &model), PLIANT_OK)
        << pliant_last_error();
    ASSERT_EQ(pliant_view_create(model, nullptr, &view), PLIANT_OK) << pliant_last_error();
    const int32_t side = 200;
    const double *spacing = scan.geometry.spacing,
                 middle[3] = {0.5 * scan.geometry.size[0], 0.5 * scan.geometry.size[1], 0.5 * scan.geometry.size[2]};
    double at[3];
    pliant_geometry_to_world(&scan.geometry, middle, at);
    std::vector<uint8_t> rgb(size_t(3 * side * side)), label(size_t(side * side));
    std::vector<float> depth(label.size());
    const pliant_image image{rgb.data(), depth.data(), label.data()};
    int seen = 0, lung = 0, by_voxel = 0;
    for (int turn = -1; turn <= 1; turn++) {
        pliant_camera camera{};
        const double angle = 0.785398 * turn, up[3] = {0, 0, 1},
                     from[3] = {at[0] + 0.6 * std::sin(angle), at[1] - 0.6 * std::cos(angle), at[2] + 0.05};
        pliant_camera_of_view(side, side, 0.6, &camera);
        ASSERT_EQ(pliant_camera_look_at(&camera, from, at, up), PLIANT_OK);
        ASSERT_EQ(pliant_view_render(view, &camera, nullptr, &image), PLIANT_OK) << pliant_last_error();
        if (const char *folder = std::getenv("PLIANT_FIGURES")) {
            std::ofstream file(std::string(folder) + "/labels_" + std::to_string(turn + 1) + ".ppm", std::ios::binary);
            file << "P6 " << side << " " << side << " 255\n";
            for (uint8_t one : label)
                file.put(char(one == 2 ? 255 : one * 40))
                    .put(char(one == 2 ? 0 : one * 40))
                    .put(char(one == 2 ? 0 : one * 40));
        }
        for (size_t p = 0; p < label.size(); p++) {
            if (!label[p]) continue;
            const double z = depth[p], x[3] = {(double(p % side) - camera.cx) / camera.fx * z,
                                               (double(p / side) - camera.cy) / camera.fy * z, z};
            double point[3], index[3];
            size_t voxel = 0, pitch = 1;
            for (int d = 0; d < 3; d++)
                point[d] = camera.pose[4 * d] * x[0] + camera.pose[4 * d + 1] * x[1] + camera.pose[4 * d + 2] * x[2] +
                           camera.pose[4 * d + 3];
            pliant_geometry_to_index(&scan.geometry, point, index);
            for (int d = 0; d < 3; d++) {
                voxel += pitch * size_t(std::lround(std::min(std::max(index[d], 0.0), scan.geometry.size[d] - 1.0)));
                pitch *= size_t(scan.geometry.size[d]);
            }
            seen++;
            lung += label[p] == 2;
            by_voxel += pliant_model_get_voxel_materials(model)[voxel] == 1;
        }
    }
    std::printf("of %d pixels with tissue %.1f %% are lung in the pictures, %.1f %% by their voxels (spacing %g mm)\n",
                seen, 100.0 * lung / seen, 100.0 * by_voxel / seen, 1e3 * spacing[0]);
    EXPECT_GT(by_voxel, 0.2 * seen);
    EXPECT_LT(lung, 0.005 * seen);
    pliant_view_free(view);
    pliant_model_free(model);
    pliant_material_table_free(&table);
    pliant_volume_free(&scan);
}

} // namespace
