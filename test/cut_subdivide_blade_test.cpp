// Tests of blades that subdivide tetrahedra during a simulation.
#include "backend/explicit_statistics.h"
#include "subdivided_bar.h"

#include <cmath>

namespace {

// Move a blade down through the bar, 2 mm per step, while the bar sags.
void stroke_through(Body &body, int tool, double x, double to)
{
    double at[3] = {x, 0.05, 0.115};
    for (bool first = true; at[2] > to; at[2] -= 0.002, first = false) {
        ASSERT_EQ(pliant_tool_set_pose(body.data, tool, at, nullptr), PLIANT_OK);
        if (first) {
            ASSERT_EQ(pliant_tool_set_cutting(body.data, tool, true), PLIANT_OK) << pliant_last_error();
        }
        ASSERT_GE(pliant_step(body.model, body.data), 0) << pliant_last_error();
        for (int32_t n = 0; n < 3 * body.data->body->fine.num_nodes; n++)
            ASSERT_TRUE(std::isfinite(body.data->positions[n]));
    }
    ASSERT_EQ(pliant_tool_set_cutting(body.data, tool, false), PLIANT_OK);
}

int add_knife(Body &body)
{
    const double from[3] = {0, -0.07, 0}, to[3] = {0, 0.07, 0};
    int tool = -1;
    EXPECT_EQ(pliant_tool_add(body.model, body.data, "knife", &tool), PLIANT_OK);
    EXPECT_EQ(pliant_tool_set_blade(body.data, tool, from, to), PLIANT_OK);
    return tool;
}

TEST(SubdivideBlade, ABladeCutsAlongItsPath)
{
    for (int cycles = 0; cycles < 2; cycles++) {
        auto body = uniform([&](pliant_scene &scene) {
            scene.solver.iterations = 8;
            scene.solver.tolerance = 1e-3;
            scene.solver.preconditioner = cycles ? PLIANT_MULTIGRID : PLIANT_DIRECT;
            scene.mesh.coarse_cells[0] = 8;
            scene.mesh.coarse_cells[1] = scene.mesh.coarse_cells[2] = 2;
            scene.model.gravity[2] = -0.5;
        });
        const int tool = add_knife(*body);
        const double mass = total_mass(*body->data->body);
        stroke_through(*body, tool, 0.112, 0.05);
        EXPECT_EQ(num_pieces(*body->data->body), 1);
        stroke_through(*body, tool, 0.162, -0.03);
        pliant_tool_state state{};
        ASSERT_EQ(pliant_tool_get(body->data, tool, &state), PLIANT_OK);
        EXPECT_EQ(num_pieces(*body->data->body), 2);
        EXPECT_EQ(state.pieces, 2);
        EXPECT_NEAR(total_mass(*body->data->body), mass, 1e-12 * mass);
        ASSERT_NE(body->data->body->pieces, nullptr) << "the end falls";
        expect_sound(*body->data->body, state.severed_area);
    }
}

// A blade whose tip stays in the tissue severs the area that it sweeps. It leaves the bar, or is switched off in the
// tissue. Cubes are 25 mm wide.
TEST(SubdivideBlade, ABladeThatEndsInTheTissueSeversWhatItSweeps)
{
    for (double depth : {0.041, 0.056, 0.07})
        for (bool through : {true, false}) {
            auto body = uniform([](pliant_scene &scene) {
                scene.fixed.num_planes = 0;
                scene.fixed.planes[scene.fixed.num_planes++] = {{0, 0, 1e-6}, {0, 0, 1}};
                scene.solver.iterations = 8;
                scene.solver.tolerance = 1e-3;
                scene.cut.resistance = 0;
            });
            const double from[3] = {0, 0, 0.12}, to[3] = {0, 0, 0}, mass = total_mass(*body->data->body);
            int tool = -1;
            ASSERT_EQ(pliant_tool_add(body->model, body->data, "knife", &tool), PLIANT_OK);
            ASSERT_EQ(pliant_tool_set_blade(body->data, tool, from, to), PLIANT_OK);
            const double end = through ? 0.21 : 0.143;
            for (double x = -0.011; x < end; x += 0.004) {
                const double tip[3] = {x, 0.043 + 0.05 * x, 0.1 - depth};
                ASSERT_EQ(pliant_tool_set_pose(body->data, tool, tip, nullptr), PLIANT_OK);
                ASSERT_EQ(pliant_tool_set_cutting(body->data, tool, true), PLIANT_OK) << pliant_last_error();
                ASSERT_GE(pliant_step(body->model, body->data), 0) << pliant_last_error();
            }
            ASSERT_EQ(pliant_tool_set_cutting(body->data, tool, false), PLIANT_OK);
            ASSERT_GE(pliant_step(body->model, body->data), 0) << pliant_last_error();
            pliant_tool_state state{};
            ASSERT_EQ(pliant_tool_get(body->data, tool, &state), PLIANT_OK);
            const double swept = depth * (through ? 0.2 : 0.141) * std::sqrt(1 + 0.05 * 0.05);
            if (std::getenv("PLIANT_FIGURES"))
                std::printf("%.0f mm deep, %s: %.3f of the swept area\n", 1e3 * depth,
                            through ? "through" : "switched off in the tissue", state.severed_area / swept);
            EXPECT_NEAR(state.severed_area, swept, 0.05 * swept) << depth << " " << through;
            EXPECT_EQ(state.pieces, 1);
            EXPECT_NEAR(total_mass(*body->data->body), mass, 1e-12 * mass);
            expect_sound(*body->data->body, state.severed_area);
        }
}

// Oblique blades cut a bar that bends by centimetres under its weight. No tissue passes through, not even at its
// surface.
TEST(SubdivideBlade, ATiltedBladeCutsMovingTissue)
{
    std::mt19937 random(11);
    std::uniform_real_distribution<double> unit(-1, 1);
    double draws[6];
    for (int run = 0; run < 16; run++) {
        for (double &draw : draws) draw = unit(random);
        if (run < 14) continue;
        auto body = uniform([](pliant_scene &scene) {
            scene.solver.iterations = 6;
            scene.solver.tolerance = 1e-3;
            scene.model.gravity[2] = -0.5;
        });
        const double from[3] = {0.02 * draws[0], -0.07, 0.02 * draws[1]},
                     to[3] = {0.02 * draws[2], 0.07, 0.02 * draws[3]};
        int tool = -1, step = 0;
        ASSERT_EQ(pliant_tool_add(body->model, body->data, "knife", &tool), PLIANT_OK);
        ASSERT_EQ(pliant_tool_set_blade(body->data, tool, from, to), PLIANT_OK);
        double at[3] = {0.13 + 0.03 * draws[4], 0.05, 0.15};
        // until the bar is cut through, at most to below its bent end
        for (; at[2] > -0.21 && num_pieces(*body->data->body) < 2; step++) {
            const double place[3] = {at[0] + 0.002 * (run % 3) * std::sin(0.7 * step), at[1], at[2]};
            ASSERT_EQ(pliant_tool_set_pose(body->data, tool, place, nullptr), PLIANT_OK);
            ASSERT_EQ(pliant_tool_set_cutting(body->data, tool, true), PLIANT_OK);
            ASSERT_GE(pliant_step(body->model, body->data), 0) << pliant_last_error();
            at[2] -= 0.003;
            at[0] += 0.0009 * draws[5];
        }
        EXPECT_GE(num_pieces(*body->data->body), 2) << run;
    }
}

TEST(SubdivideBlade, ExplicitStepsShrinkWithTheSmallestTetrahedron)
{
    auto body = uniform([](pliant_scene &scene) {
        scene.solver.kind = PLIANT_TLED;
        scene.tled.damping = 20;
        scene.model.gravity[2] = -0.5;
    });
    pliant_dynamics before{}, after{};
    ASSERT_EQ(pliant_data_get_dynamics(body->model, body->data, &before), PLIANT_OK);
    const int tool = add_knife(*body);
    stroke_through(*body, tool, 0.112, -0.04);
    EXPECT_EQ(num_pieces(*body->data->body), 2);
    ASSERT_EQ(pliant_data_get_dynamics(body->model, body->data, &after), PLIANT_OK);
    EXPECT_NEAR(after.edge_bound / before.edge_bound,
                shortest_edge(*body->data->body) / shortest_edge(*body->model->body), 1e-9);
    EXPECT_LT(after.eigenvalue_bound, 0.9 * before.eigenvalue_bound);
    EXPECT_LE(after.time_step, after.eigenvalue_bound);
}

// New nodes inherit the velocity at their position, so a uniform motion continues.
TEST(SubdivideBlade, MotionContinuesAfterACut)
{
    auto body = uniform([](pliant_scene &scene) {
        scene.solver.kind = PLIANT_TLED;
        scene.tled.damping = 0;
        scene.fixed.num_planes = 0;
        scene.ground.normal[2] = 1;
        scene.ground.point[2] = -1;
        scene.model.gravity[2] = -9.81;
    });
    for (int s = 0; s < 5; s++) ASSERT_GE(pliant_step(body->model, body->data), 0) << pliant_last_error();
    const double before = body->data->positions[2] - body->data->body->fine.rest[2];
    const double points[6] = {0.09, -0.01, 0.2, 0.12, 0.11, 0.2}, depth[3] = {0, 0, -0.4};
    ASSERT_EQ(pliant_data_cut(body->model, body->data, 2, points, depth, nullptr), PLIANT_OK) << pliant_last_error();
    EXPECT_EQ(num_pieces(*body->data->body), 2);
    for (int s = 0; s < 3; s++) ASSERT_GE(pliant_step(body->model, body->data), 0) << pliant_last_error();
    const double time = 8 * body->scene.solver.step;
    EXPECT_LT(before, 0);
    for (int32_t n = 0; n < body->data->body->fine.num_nodes; n++)
        EXPECT_NEAR(body->data->positions[3 * n + 2] - body->data->body->fine.rest[3 * n + 2],
                    -0.5 * 9.81 * time * time, 0.03 * 0.5 * 9.81 * time * time);
}

} // namespace
