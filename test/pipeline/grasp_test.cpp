// Jaws hold tissue by contact alone, in complete steps. The held tissue follows the jaws, slips out of a weak grip, and
// returns undamaged.
#include "sim/step/proxy.h"
#include "tongue.h"

#include <cstdio>
#include <string>

namespace {

// Close the jaws to an angle, pull up by 30 mm with 1 mm per step, open, and move away.
struct Pulled {
    double squeezed = 1, minimum = 1, lifted = 0, force = 0, deepest = 0, last_force = 0, left = 0;
    int32_t held = 0; // number of pressed points after a pull of 4 mm
};

Pulled pull(double jaw, double friction)
{
    Pulled out;
    Tongue tongue(friction);
    const uint64_t revision = tongue.data->body->revision;
    tongue.go(0.03, 0.7);
    for (int s = 0; s < 4; s++) tongue.go(0.0225 - 0.0075 * s, 0.7);
    for (int s = 1; s <= 12; s++) tongue.go(0, 0.7 + (jaw - 0.7) * s / 12);
    for (int s = 0; s < 3; s++) tongue.go(0, jaw);
    out.squeezed = tongue.min_volume();
    for (int s = 1; s <= 30; s++) {
        tongue.go(0.001 * s, jaw);
        out.minimum = std::fmin(out.minimum, tongue.min_volume());
        out.lifted = std::fmax(out.lifted, tongue.lifted());
        out.force = std::fmax(out.force, tongue.force());
        out.deepest = std::fmax(out.deepest, tongue.deepest());
        if (s == 4) out.held = tongue.data->statistics.contacts;
    }
    out.last_force = tongue.force();
    for (int s = 0; s < 3; s++) tongue.go(0.03, 0.7);
    for (int s = 0; s < 4; s++) tongue.go(0.05, 0.7);
    for (int s = 0; s < 10; s++) tongue.go(0.1, 0.7);
    out.left = tongue.farthest();
    EXPECT_EQ(tongue.data->body->revision, revision);
    EXPECT_EQ(tongue.data->statistics.contacts, 0);
    return out;
}

TEST(Grasp, AStrongGripPullsAWeakOneSlips)
{
    const Pulled strong = pull(0.2, 0.5), weak = pull(0.3, 0.08);
    for (const Pulled *each : {&strong, &weak}) {
        std::printf(
            "squeezed to %.3f, least volume %.3f, lifted %.2f mm with %.3f N, %d points, %.3f mm deep, at last %.4f N, "
            "%.2g mm left\n",
            each->squeezed, each->minimum, 1e3 * each->lifted, each->force, each->held, 1e3 * each->deepest,
            each->last_force, 1e3 * each->left);
        EXPECT_GT(each->minimum, 0) << "an element is inside out";
        EXPECT_LT(each->deepest, 2e-4) << "a node is left in a jaw";
        EXPECT_GT(each->held, 2);
        EXPECT_LT(each->left, 1e-4) << "it is where it was";
    }
    EXPECT_GT(strong.lifted, 0.002);
    EXPECT_GT(strong.force, 4 * weak.force);
    EXPECT_LT(weak.lifted, 0.002);
    EXPECT_NEAR(weak.last_force, 0, 1e-6) << "it has slipped out";
}

// Jaws that close on tissue with a small grip torque stop where the tissue resists with this torque. The torque stays
// the same while the jaws lift the tissue. In explicit dynamics, the torque varies about the limit.
TEST(Grasp, JawsCloseWithTheGripTorque)
{
    close_with_grip_torque(false, 0.005, 0.005);
    close_with_grip_torque(true, 0.12, 0.03);
}

// Same in explicit dynamics with a pull of 12 mm. Strong jaws hold the tissue, and it slips out of a weak grip. No
// element is inverted.
TEST(Grasp, JawsGripInExplicitDynamics)
{
    double lifted[2], force[2];
    for (const bool strong : {false, true}) {
        Tongue tongue(strong ? 0.5 : 0.05, [](pliant_scene &scene) {
            scene.solver.kind = PLIANT_TLED;
            scene.tled.damping = 20;
        });
        const double jaw = strong ? 0.2 : 0.32;
        double minimum = 1, deepest = 0;
        lifted[strong] = force[strong] = 0;
        tongue.go(0.03, 0.7);
        for (int s = 0; s < 4; s++) tongue.go(0.0225 - 0.0075 * s, 0.7);
        for (int s = 1; s <= 12; s++) tongue.go(0, 0.7 + (jaw - 0.7) * s / 12);
        for (int s = 1; s <= 12; s++) {
            tongue.go(0.001 * s, jaw);
            minimum = std::fmin(minimum, tongue.min_volume());
            deepest = std::fmax(deepest, tongue.deepest());
            if (s <= 4)
                lifted[strong] = std::fmax(lifted[strong], tongue.lifted()),
                force[strong] = std::fmax(force[strong], tongue.force());
        }
        std::printf(
            "tled, %s: lifted %.2f mm with %.3f N, at last %.2f mm and %.4f N, least volume %.3f, %.3f mm deep\n",
            strong ? "strong" : "weak", 1e3 * lifted[strong], force[strong], 1e3 * tongue.lifted(), tongue.force(),
            minimum, 1e3 * deepest);
        EXPECT_GT(minimum, 0) << "an element is inside out";
        EXPECT_LT(deepest, 5e-4);
    }
    EXPECT_GT(lifted[1], 0.002);
    EXPECT_LT(lifted[0], 0.002);
    EXPECT_GT(force[1], 3 * force[0]);
}

// A ball is pressed into a block of two materials with every method. All methods keep nodes outside. The forces reflect
// a coarse element of 50 mm under a ball of 60 mm; with model/patch they equal the fine ones (grab_patch_test).
TEST(Press, EveryMethodComparesItsContactForceToFine)
{
    const int size[3] = {24, 24, 24};
    const double side = 0.2, box[3] = {side, side, side}, radius = 0.03;
    const struct { pliant_method method; const char *name; double low, high; } rows[] = {
        {PLIANT_FINE, "fine", 1, 1}, {PLIANT_COARSE, "coarse", 1.1, 1.5}, {PLIANT_AVERAGED, "averaged", 1, 1.3},
        {PLIANT_SCHUR, "schur", 0.4, 0.7}, {PLIANT_LOD, "lod", 1.1, 1.5}};
    double fine = 0;
    for (const auto &row : rows) {
        Body block(size, box, {{4000, 0.45, 1000, false}, {30000, 0.3, 1000, false}},
                   [](int i, int j, int k) { return (i / 6 + j / 5 + k / 7) % 2; });
        block.fix_plane(0, 0, 0, 0, 0, 1);
        block.cells(4, 4, 4, 2);
        block.scene.model.method = row.method;
        ASSERT_EQ(block.build(), PLIANT_OK) << row.name << ": " << pliant_last_error();
        pliant_tool_shape ball{};
        ball.num_parts = 1;
        ball.part[0].kind = PLIANT_PART_SPHERE;
        ball.part[0].radius = radius;
        int tool;
        ASSERT_EQ(pliant_tool_add(block.model, block.data, "ball", &tool), PLIANT_OK);
        ASSERT_EQ(pliant_tool_set_shape(block.data, tool, &ball), PLIANT_OK);
        const double tip[3] = {0.13, 0.1, side + radius - 0.012};
        for (int s = 0; s < 18; s++) {
            const double at[3] = {tip[0], tip[1], side + radius - 0.001 * std::min(s, 12)};
            ASSERT_EQ(pliant_tool_set_pose(block.data, tool, at, nullptr), PLIANT_OK);
            ASSERT_GE(pliant_step(block.model, block.data), 0) << row.name << ": " << pliant_last_error();
        }
        double deepest = 0, force[3] = {0, 0, 0};
        const double *at = block.data->tools[tool].proxy.tip;
        for (int32_t n = 0; n < block.model->body->fine.num_nodes; n++) {
            const double *x = block.data->positions + 3 * n;
            deepest = std::fmax(deepest, radius - std::sqrt((x[0] - at[0]) * (x[0] - at[0]) +
                                                            (x[1] - at[1]) * (x[1] - at[1]) +
                                                            (x[2] - at[2]) * (x[2] - at[2])));
        }
        for (int32_t p = 0; p < block.data->contacts.count; p++)
            for (int d = 0; d < 3; d++) force[d] += block.data->contacts.point[p].force[d];
        if (row.method == PLIANT_FINE) fine = -force[2];
        std::printf("%-10s %7.3f N, %.3f of fine, points %.2g mm deep, nodes %.2g mm\n", row.name, -force[2],
                    -force[2] / fine, 1e3 * block.data->statistics.penetration, 1e3 * deepest);
        EXPECT_LT(block.data->statistics.penetration, 1e-5) << row.name;
        EXPECT_LT(deepest, 1e-4) << row.name;
        EXPECT_GE(-force[2], row.low * fine) << row.name;
        EXPECT_LE(-force[2], row.high * fine) << row.name;
    }
}

} // namespace
