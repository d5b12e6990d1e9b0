// Demonstration scenes: explicit dynamics on a small phantom whose liver hangs and falls; contact of organs, tools and
// obstacles on a CT.
#include "contact/detect/update_sides.h"
#include "model_data/data.h"
#include "pliant/pliant.h"
#include "sim/step/legs.h"
#include "tool/path.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <string>
#include <sys/stat.h>

namespace
{

struct SceneRun {
    pliant_scene scene;
    pliant_volume scan{};
    pliant_labels labels{};
    pliant_material_table table{};
    pliant_model *model = nullptr;
    pliant_data *data = nullptr;

    explicit SceneRun(const std::string &name)
    {
        EXPECT_EQ(
            pliant_scene_read((std::string(PLIANT_SOURCE_DIR "/launch/scenes/") + name + ".yaml").c_str(), &scene),
            PLIANT_OK)
            << pliant_last_error();
        scene.mesh.coarse_cells[0] = 8;
        scene.mesh.coarse_cells[1] = scene.mesh.coarse_cells[2] = 6;
    }
    ~SceneRun()
    {
        pliant_data_free(data);
        pliant_model_free(model);
        pliant_material_table_free(&table);
        pliant_labels_free(&labels);
        pliant_volume_free(&scan);
    }
    pliant_status build(const char *of = "phantom:64x48x48")
    {
        pliant_status status = pliant_inputs_read(&scene, of, &scan, &labels, &table);
        if (status == PLIANT_OK)
            status = pliant_model_build(&scene, &scan, &labels, &table, {nullptr, nullptr}, &model);
        return status == PLIANT_OK ? pliant_data_create(model, &data) : status;
    }
    // lowest z, and mean z weighted by mass [m]
    void heights(double *lowest, double *mean) const
    {
        double mass = 0;
        *lowest = INFINITY;
        *mean = 0;
        for (int32_t n = 0; n < model->body->fine.num_nodes; n++) {
            *lowest = std::min(*lowest, data->positions[3 * n + 2]);
            *mean += model->body->node_mass[n] * data->positions[3 * n + 2];
            mass += model->body->node_mass[n];
        }
        *mean /= mass;
    }
};

TEST(Scenes, TheLiverHangs)
{
    SceneRun run("hang");
    ASSERT_EQ(run.build(), PLIANT_OK) << pliant_last_error();
    double lowest[2], mean[2];
    run.heights(&lowest[0], &mean[0]);
    for (int s = 0; s < 25; s++) ASSERT_EQ(pliant_step(run.model, run.data), PLIANT_OK) << pliant_last_error();
    run.heights(&lowest[1], &mean[1]);
    EXPECT_LT(mean[1], mean[0] - 0.002);
    EXPECT_GT(mean[1], mean[0] - 0.08);
}

TEST(Scenes, TheLiverFallsOnThePlane)
{
    SceneRun run("fall");
    ASSERT_EQ(run.build(), PLIANT_OK) << pliant_last_error();
    double lowest[2], mean[2];
    run.heights(&lowest[0], &mean[0]);
    double way = lowest[0] + 0.05, before = 0.9 * std::sqrt(2 * way / 9.81), t = 0;
    for (; t < before; t += run.scene.solver.step)
        ASSERT_EQ(pliant_step(run.model, run.data), PLIANT_OK) << pliant_last_error();
    run.heights(&lowest[1], &mean[1]);
    EXPECT_NEAR(mean[0] - mean[1], 0.5 * 9.81 * t * t, 0.1 * 0.5 * 9.81 * t * t); // the scene has some damping
    for (int s = 0; s < 20; s++) ASSERT_EQ(pliant_step(run.model, run.data), PLIANT_OK) << pliant_last_error();
    run.heights(&lowest[1], &mean[1]);
    EXPECT_NEAR(lowest[1], -0.05, 1e-9);
    EXPECT_GT(mean[1], -0.05 + 0.005);
}

// With the constants of [C] 6: mu 400 Pa, lambda 49000 Pa, 1000 kg/m^3.
TEST(Scenes, TheSoftLiverIsThatOfThePaper)
{
    for (const char *name : {"hang_soft", "fall_soft"}) {
        SceneRun run(name);
        ASSERT_EQ(run.build(), PLIANT_OK) << pliant_last_error();
        for (int32_t t = 0; t < run.model->body->fine.num_tets; t++) {
            const pliant_tet_material &material = run.model->body->fine_material[t];
            if (material.tissue < 1) continue;
            ASSERT_NEAR(material.mu, 400, 0.01);
            ASSERT_NEAR(material.lambda, 49000, 5);
            ASSERT_NEAR(material.density, 1000, 1e-6);
        }
    }
}

TEST(Scenes, TheSoftLiverHangsAndFalls)
{
    SceneRun hang("hang_soft"), fall("fall_soft");
    ASSERT_EQ(hang.build(), PLIANT_OK) << pliant_last_error();
    ASSERT_EQ(fall.build(), PLIANT_OK) << pliant_last_error();
    double lowest[3], mean[3];
    hang.heights(&lowest[0], &mean[0]);
    for (int s = 0; s < 20; s++) ASSERT_EQ(pliant_step(hang.model, hang.data), PLIANT_OK) << pliant_last_error();
    hang.heights(&lowest[1], &mean[1]);
    EXPECT_LT(lowest[1], lowest[0] - 0.03) << "far more than the stiffer one";
    for (int s = 0; s < 30; s++) ASSERT_EQ(pliant_step(fall.model, fall.data), PLIANT_OK) << pliant_last_error();
    fall.heights(&lowest[2], &mean[2]);
    EXPECT_NEAR(lowest[2], 0.02, 1e-9);
    EXPECT_LT(mean[2], mean[0]);
}

// Liver and stomach of the test CT, which slide along each other.
struct OrganRun : SceneRun {
    OrganRun() : SceneRun("organs_ct")
    {
        EXPECT_EQ(pliant_scene_read(PLIANT_SOURCE_DIR "/launch/scenes/organs_ct.yaml", &scene), PLIANT_OK)
            << pliant_last_error();
        EXPECT_EQ(pliant_scene_set(&scene, "material/labels", PLIANT_TEST_DATA "/abdomen/labels_totalseg_fast.nii.gz"),
                  PLIANT_OK);
        scene.solver.threads = 1;
        pliant_scene_for_shapes(&scene);
    }
    static bool has_data()
    {
        struct stat file;
        return stat(PLIANT_TEST_DATA "/abdomen/ct.nii.gz", &file) == 0;
    }
    pliant_status build() { return SceneRun::build(PLIANT_TEST_DATA "/abdomen/ct.nii.gz"); }
};

// Tissue ends within elements, and surface corners lie at its end. Where two organs would penetrate each other at rest,
// there is no contact force.
TEST(Scenes, OrgansAtRestDoNotPressThemselves)
{
    if (!OrganRun::has_data()) GTEST_SKIP() << "the shared test data is not at " PLIANT_TEST_DATA;
    for (const std::array<int, 3> cells : {std::array<int, 3>{16, 14, 15}, {13, 11, 12}, {20, 17, 18}}) {
        OrganRun run;
        std::copy(cells.begin(), cells.end(), run.scene.mesh.coarse_cells);
        run.scene.obstacles = pliant_regions{};
        ASSERT_EQ(run.build(), PLIANT_OK) << pliant_last_error();
        for (int step = 0; step < 2; step++)
            EXPECT_EQ(pliant_step(run.model, run.data), PLIANT_OK) << pliant_last_error();
        const pliant_mesh &mesh = run.data->body->fine;
        double maximum = 0;
        for (int32_t i = 0; i < 3 * mesh.num_nodes; i++)
            maximum = std::max(maximum, std::fabs(run.data->positions[i] - mesh.rest[i]));
        EXPECT_LT(maximum, 1e-9) << cells[0];
    }
}

// In steps of 0.1 s, tissue touches the probe, the box, the adjacent organ, and tissue across an initial gap.
TEST(Scenes, OrgansTouchToolsAndObstaclesAndEachOther)
{
    if (!OrganRun::has_data()) GTEST_SKIP() << "the shared test data is not at " PLIANT_TEST_DATA;
    OrganRun run;
    pliant_path path{};
    ASSERT_EQ(pliant_path_read(PLIANT_SOURCE_DIR "/launch/scenes/organs_ct_path.yaml", &path), PLIANT_OK)
        << pliant_last_error();
    run.scene.solver.step = 0.1;
    ASSERT_EQ(run.build(), PLIANT_OK) << pliant_last_error();
    int tool = -1, of_tool = 0, of_box = 0, of_cut = 0, of_outside = 0;
    ASSERT_EQ(pliant_tool_add(run.model, run.data, "probe", &tool), PLIANT_OK);
    ASSERT_EQ(pliant_tool_set_shape(run.data, tool, &path.tools[0].shape), PLIANT_OK);
    for (int step = 0; step <= std::lround(pliant_path_end(&path) / run.scene.solver.step); step++) {
        double position[3], rotation[4];
        ASSERT_TRUE(pliant_path_pose_at(path.tools, step * run.scene.solver.step, position, rotation));
        ASSERT_EQ(pliant_tool_set_pose(run.data, tool, position, rotation), PLIANT_OK);
        EXPECT_EQ(pliant_step(run.model, run.data), PLIANT_OK) << step << ": " << pliant_last_error();
        EXPECT_EQ(pliant_data_get_inverted(run.data), 0) << step;
        of_tool = of_box = of_cut = of_outside = 0;
        for (int32_t p = 0; p < run.data->contacts.count; p++) {
            const pliant_contact_point &point = run.data->contacts.point[p];
            const int kind = static_cast<int>(point.feature >> 56);
            const double pressed =
                point.force[0] * point.normal[0] + point.force[1] * point.normal[1] + point.force[2] * point.normal[2];
            if (!(pressed > 1e-6)) continue;
            of_tool += point.kind == PLIANT_OBSTACLE_TOOL;
            of_box += point.kind == PLIANT_OBSTACLE_GROUND;
            of_cut += point.kind == PLIANT_OBSTACLE_TISSUE && (kind == PLIANT_TISSUE_CUT || kind == PLIANT_TISSUE_SLID);
            of_outside +=
                point.kind == PLIANT_OBSTACLE_TISSUE && (pliant_contact_is_of_corners(&point));
        }
    }
    EXPECT_GT(of_tool, 0);
    EXPECT_GT(of_box, 0) << "the stomach on the box";
    EXPECT_GT(of_cut, 0) << "what slides";
    EXPECT_GT(of_outside, 0) << "what had a gap between";
    pliant_path_free(&path);
}

// Build the scene `grasp` with its own cells, and add an instrument with jaws. Return its number.
int start_grasp(SceneRun &run, const char *instrument)
{
    const int32_t cells[3] = {26, 18, 22};
    std::copy(cells, cells + 3, run.scene.mesh.coarse_cells);
    EXPECT_EQ(run.build("phantom"), PLIANT_OK) << pliant_last_error();
    pliant_tool_shape shape{};
    int tool = -1;
    EXPECT_EQ(pliant_tool_shape_find(instrument, &shape), PLIANT_OK) << pliant_last_error();
    EXPECT_EQ(pliant_tool_add(run.model, run.data, "PSM1", &tool), PLIANT_OK);
    EXPECT_EQ(pliant_tool_set_shape(run.data, tool, &shape), PLIANT_OK) << pliant_last_error();
    pliant_tool_shape_free(&shape);
    return tool;
}

// Make a step in which the instrument approaches the liver for 1 s, waits, and closes its jaws from 1.2 s on.
void step_towards_the_liver(SceneRun &run, int tool, double time)
{
    const double rotation[4] = {0.5, -0.5, -0.5, 0.5}, tip[3] = {0.09 - 0.04 * std::min(time, 1.0), -0.048, 0.128};
    ASSERT_EQ(pliant_tool_set_pose(run.data, tool, tip, rotation), PLIANT_OK);
    ASSERT_EQ(pliant_tool_set_jaw(run.data, tool, 1 - 0.55 * std::max(time - 1.2, 0.0)), PLIANT_OK);
    ASSERT_GE(pliant_step(run.model, run.data), 0) << pliant_last_error();
}

// Return the smallest gap of all contact points at the present positions [m].
double smallest_gap(const pliant_data *data)
{
    double smallest = INFINITY;
    for (int32_t p = 0; p < data->contacts.count; p++) {
        const pliant_contact_point &point = data->contacts.point[p];
        double gap = 0;
        for (int d = 0; d < 3; d++) {
            gap -= point.normal[d] * point.place[d];
            for (int32_t k = 0; k < point.count; k++)
                gap += point.normal[d] * point.weight[k] * data->positions[3 * point.node[k] + d];
        }
        smallest = std::min(smallest, gap);
    }
    return smallest;
}

// Jaws that poke into the liver turn while the tissue moves, and then crush it. A leg that blocks is followed by one in
// which the tissue alone moves, so no step is blocked.
TEST(Scenes, JawsThatPokeAndCrushTheLiverAreNotBlocked)
{
    SceneRun run("grasp");
    const int tool = start_grasp(run, "micro_forceps");
    int without_progress = 0;
    for (int s = 0; s * run.scene.solver.step < 3; s++) {
        ASSERT_NO_FATAL_FAILURE(step_towards_the_liver(run, tool, s * run.scene.solver.step));
        without_progress = run.data->statistics.advanced > 1e-3 ? 0 : without_progress + 1;
        ASSERT_LT(without_progress, 2) << s << ": steps whose last leg made no progress";
        ASSERT_NE(run.data->statistics.ended, PLIANT_STEP_END_BLOCKED) << s;
        ASSERT_LE(run.data->statistics.iterations, run.scene.solver.iterations) << s;
    }
    EXPECT_LT(run.data->tools[tool].proxy.jaw, 0.4) << "the jaws close";
    // The present state fulfils all contacts of a leg with held proxies, so their forces exist.
    ASSERT_EQ(pliant_legs_find(run.model, run.data, true), PLIANT_OK);
    EXPECT_GT(smallest_gap(run.data), -1e-7);
    ASSERT_EQ(pliant_legs_find(run.model, run.data, false), PLIANT_OK);
    EXPECT_LT(smallest_gap(run.data), -1e-5) << "other legs reduce penetrations";
}

// With few evaluations, legs are shortened often, and contact points vanish. The load of the coupling stays bounded.
TEST(Scenes, JawsOnTheLiverKeepTheirLimitsWithFewEvaluations)
{
    SceneRun run("grasp");
    run.scene.solver.iterations = 8;
    const int tool = start_grasp(run, "cadiere_forceps");
    const double step = run.scene.solver.step;
    double largest = 0;
    for (int s = 0; s * step < 3.2; s++) {
        ASSERT_NO_FATAL_FAILURE(step_towards_the_liver(run, tool, s * step));
        pliant_tool_state state;
        ASSERT_EQ(pliant_tool_get(run.data, tool, &state), PLIANT_OK);
        const double *f = state.contact_force, force = std::sqrt(f[0] * f[0] + f[1] * f[1] + f[2] * f[2]);
        largest = std::max(largest, force);
        ASSERT_LT(force, 1.02 * run.scene.contact.max_force) << s;
        ASSERT_LT(std::fabs(run.data->tools[tool].proxy.load.jaw), 1.0201 * run.scene.contact.grip_torque) << s;
        ASSERT_LT(run.data->statistics.proxy_error, run.scene.contact.max_proxy_error) << s;
        ASSERT_LT(run.data->contacts.count, 200) << s;
        ASSERT_EQ(pliant_data_get_inverted(run.data), 0) << s;
    }
    EXPECT_GT(largest, 0.5);
}

} // namespace
