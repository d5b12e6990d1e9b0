// Jaws take hold of tissue by contact alone, in a whole step: what they close on goes with them, slips out of a weak grip, and comes back whole.
#include "body.h"
#include "contact/shapes.h"

#include <algorithm>
#include <cstdio>
#include <string>

namespace {

// A tongue of 30 x 6 x 24 mm that stands on a plate, and a prograsp above it that comes straight down.
struct Tongue : Body {
    int tool = -1;
    static constexpr int size[3] = {10, 4, 12};
    static constexpr double box[3] = {0.03, 0.006, 0.024}, deep = 0.012; // the tip below the top

    explicit Tongue(double friction) : Body(size, box, {{5000, 0.4, 1000, false}})
    {
        cells(10, 3, 8, 1);
        fix_plane(0, 0, 1e-4, 0, 0, 1);
        scene.solver.threads = 1;
        scene.solver.iterations = 30;
        scene.solver.tolerance = 1e-3;
        scene.contact.friction = friction;
        EXPECT_EQ(build(), PLIANT_OK) << pliant_last_error();
        pliant_tool_shape shape;
        EXPECT_EQ(pliant_tool_shape_find("prograsp_forceps", &shape), PLIANT_OK);
        EXPECT_EQ(pliant_tool_add(model, data, "prograsp", &tool), PLIANT_OK);
        EXPECT_EQ(pliant_tool_set_shape(data, tool, &shape), PLIANT_OK);
    }
    // how far the tip is up from where it takes hold
    void go(double up, double jaw)
    {
        const double tip[3] = {0.0151, 0.0031, box[2] - deep + up}, down[4] = {1, 0, 0, 0};
        ASSERT_EQ(pliant_tool_set_pose(data, tool, tip, down), PLIANT_OK);
        ASSERT_EQ(pliant_tool_set_jaw(data, tool, jaw), PLIANT_OK);
        ASSERT_GE(pliant_step(model, data), 0) << pliant_last_error();
        for (int32_t n = 0; n < 3 * data->body->fine.num_nodes; n++) ASSERT_TRUE(std::isfinite(data->positions[n]));
    }
    // least volume of an element over that at rest
    double least_volume() const
    {
        const pliant_mesh &mesh = data->body->fine;
        double least = INFINITY;
        for (int32_t t = 0; t < mesh.num_tets; t++) {
            double volume[2];
            for (int k = 0; k < 2; k++) {
                const double *x = k ? data->positions : mesh.rest;
                double e[3][3];
                for (int v = 0; v < 3; v++)
                    for (int d = 0; d < 3; d++) e[v][d] = x[3 * mesh.tets[4 * t + v + 1] + d] - x[3 * mesh.tets[4 * t] + d];
                volume[k] = e[0][0] * (e[1][1] * e[2][2] - e[1][2] * e[2][1]) + e[0][1] * (e[1][2] * e[2][0] - e[1][0] * e[2][2]) +
                            e[0][2] * (e[1][0] * e[2][1] - e[1][1] * e[2][0]);
            }
            least = std::fmin(least, volume[1] / volume[0]);
        }
        return least;
    }
    // how far the top's middle has come up, and the farthest that any node is from rest
    double lifted() const
    {
        double most = -1;
        for (int32_t n = 0; n < data->body->fine.num_nodes; n++) most = std::fmax(most, data->positions[3 * n + 2] - data->body->fine.rest[3 * n + 2]);
        return most;
    }
    double farthest() const
    {
        double most = 0;
        for (int32_t n = 0; n < 3 * data->body->fine.num_nodes; n++) most = std::fmax(most, std::fabs(data->positions[n] - data->body->fine.rest[n]));
        return most;
    }
    double force() const
    {
        pliant_tool_state state;
        EXPECT_EQ(pliant_tool_get(data, tool, &state), PLIANT_OK);
        return state.contact_force[2];
    }
    // nodes that lie in a part of the tool
    double deepest() const
    {
        const pliant_tool &of = data->tools[tool];
        double least = 0;
        for (int32_t p = 0; p < of.shape.num_parts; p++) {
            pliant_pose pose;
            pliant_part_pose(&of.shape, of.shape.part[p].frame, of.tip, of.rotation, of.jaw, &pose);
            for (int32_t n = 0; n < data->body->fine.num_nodes; n++) {
                double local[3], normal[3];
                pliant_pose_from(&pose, data->positions + 3 * n, local);
                least = std::fmin(least, pliant_part_distance(&of.shape.part[p], local, normal));
            }
        }
        return -least;
    }
};
constexpr int Tongue::size[3];
constexpr double Tongue::box[3], Tongue::deep;

// closed to an angle, then pulled up 30 mm, 1 mm a step; opened, and away
struct Pulled {
    double squeezed = 1, least = 1, lifted = 0, force = 0, deepest = 0, last_force = 0, left = 0;
    int32_t held = 0; // points that press while it is pulled by 4 mm
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
    out.squeezed = tongue.least_volume();
    for (int s = 1; s <= 30; s++) {
        tongue.go(0.001 * s, jaw);
        out.least = std::fmin(out.least, tongue.least_volume());
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
        std::printf("squeezed to %.3f, least volume %.3f, lifted %.2f mm with %.3f N, %d points, %.3f mm deep, at last %.4f N, %.2g mm left\n", each->squeezed, each->least,
                    1e3 * each->lifted, each->force, each->held, 1e3 * each->deepest, each->last_force, 1e3 * each->left);
        EXPECT_GT(each->least, 0) << "an element is inside out";
        EXPECT_LT(each->deepest, 2e-4) << "a node is left in a jaw";
        EXPECT_GT(each->held, 2);
        EXPECT_LT(each->left, 1e-4) << "it is where it was";
    }
    EXPECT_GT(strong.lifted, 0.002);
    EXPECT_GT(strong.force, 4 * weak.force);
    EXPECT_LT(weak.lifted, 0.002);
    EXPECT_NEAR(weak.last_force, 0, 1e-6) << "it has slipped out";
}

// The same ball pressed into a block of two materials by every method: nodes stay outside with all, and forces are what a coarse element of 50 mm makes of the
// tissue under a ball of 60 mm: with model/patch they are the fine ones (grab_patch_test).
TEST(Press, EveryMethodPressesBesideFine)
{
    const int size[3] = {24, 24, 24};
    const double side = 0.2, box[3] = {side, side, side}, radius = 0.03;
    const struct { pliant_method method; const char *name; double low, high; } rows[] = {
        {PLIANT_FINE, "fine", 1, 1}, {PLIANT_COARSE, "coarse", 1.8, 2.2}, {PLIANT_AVERAGED, "averaged", 1.4, 1.7},
        {PLIANT_CALIBRATED, "calibrated", 1.4, 1.8}, {PLIANT_SCHUR, "schur", 0.3, 0.5}, {PLIANT_LOD, "lod", 1.8, 2.2}};
    double fine = 0;
    for (const auto &row : rows) {
        Body block(size, box, {{4000, 0.45, 1000, false}, {30000, 0.3, 1000, false}}, [](int i, int j, int k) { return (i / 6 + j / 5 + k / 7) % 2; });
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
        for (int32_t n = 0; n < block.model->body->fine.num_nodes; n++) {
            const double *x = block.data->positions + 3 * n;
            deepest = std::fmax(deepest, radius - std::sqrt((x[0] - tip[0]) * (x[0] - tip[0]) + (x[1] - tip[1]) * (x[1] - tip[1]) + (x[2] - tip[2]) * (x[2] - tip[2])));
        }
        for (int32_t p = 0; p < block.data->contacts.count; p++)
            for (int d = 0; d < 3; d++) force[d] += block.data->contacts.point[p].force[d];
        if (row.method == PLIANT_FINE) fine = -force[2];
        std::printf("%-10s %7.3f N, %.3f of fine, points %.2g mm deep, nodes %.2g mm\n", row.name, -force[2], -force[2] / fine, 1e3 * block.data->statistics.penetration, 1e3 * deepest);
        EXPECT_LT(block.data->statistics.penetration, 1e-5) << row.name;
        EXPECT_LT(deepest, 1e-4) << row.name;
        EXPECT_GE(-force[2], row.low * fine) << row.name;
        EXPECT_LE(-force[2], row.high * fine) << row.name;
    }
}

} // namespace
