// Blades of tools with a shape: the blade acts at the proxy, however far the measured tool is beyond it.
#include "body.h"
#include "pliant/state.h"

#include <cstdio>
#include <cstdlib>
#include <string>

namespace {

constexpr double width = 0.024, top = 0.032, speed = 0.05, toughness = 200;

struct Kind {
    const char *name;
    std::function<void(pliant_scene &)> set;
};
const Kind fine{"fine", [](pliant_scene &) {}};
const Kind dynamic{"tled", [](pliant_scene &scene) {
                       scene.solver.kind = PLIANT_TLED;
                       scene.tled.damping = 20;
                   }};
const Kind subdivided{"subdivide", [](pliant_scene &scene) { scene.cut.kind = PLIANT_CUT_SUBDIVIDE; }};

// A slab on a fixed base. The knife has a ball as its handle and an edge across the slab, 12 mm below the ball.
struct Slab : Body {
    enum Shape { NONE, BALL, CUTTING_BALL };
    static constexpr double radius = 0.0165, below = 0.0285; // of the ball; from the tip to the edge [m]
    static constexpr double touching = top + radius;         // height of the tip at which the ball touches [m]
    int tool = -1;
    double z = 0;       // measured height of the tip [m]
    std::string logged; // warnings of the blade
    Slab(const Kind &kind, Shape shape, double resistance, double max_force, double max_proxy_error)
        : Body(std::vector<int>{40, 12, 16}.data(), std::vector<double>{0.08, width, top}.data(),
               {{20000, 0.45, 1060, false}})
    {
        table.materials[0].toughness = toughness;
        cells(10, 3, 4, 1);
        scene.solver.iterations = 30;
        scene.solver.tolerance = 1e-4;
        scene.cut.kind = PLIANT_CUT_SEVER;
        scene.cut.resistance = resistance;
        scene.contact.max_force = max_force;
        scene.contact.max_proxy_error = max_proxy_error;
        for (double &g : scene.model.gravity) g = 0;
        fix_plane(0, 0, 1e-6, 0, 0, 1);
        kind.set(scene);
        EXPECT_EQ(build(), PLIANT_OK) << pliant_last_error();
        const double from[3] = {0, -0.02, -below}, to[3] = {0, 0.02, -below};
        tool = add_ball(radius);
        EXPECT_EQ(pliant_tool_set_blade(data, tool, from, to), PLIANT_OK);
        pliant_tool_shape ball = data->tools[tool].shape;
        ball.num_parts = shape != NONE;
        ball.part[0].cuts = shape == CUTTING_BALL;
        EXPECT_EQ(pliant_tool_set_shape(data, tool, &ball), PLIANT_OK) << pliant_last_error();
        pliant_set_log(
            [](pliant_log_level level, const char *message, void *user) {
                if (level == PLIANT_LOG_WARNING && std::strstr(message, "blade"))
                    static_cast<Slab *>(user)->logged += std::string(message) + "\n";
            },
            this);
    }
    ~Slab() { pliant_set_log(nullptr, nullptr); }
    void step(double to)
    {
        const double tip[3] = {0.0405, 0.5 * width, z = to};
        ASSERT_EQ(pliant_tool_set_pose(data, tool, tip, nullptr), PLIANT_OK);
        ASSERT_EQ(pliant_tool_set_cutting(data, tool, true), PLIANT_OK) << pliant_last_error();
        ASSERT_GE(pliant_step(model, data), 0) << pliant_last_error();
    }
    // Move the tip down to a height.
    void go_down(double to)
    {
        while (z > to + 1e-9 && !HasFatalFailure()) step(std::max(z - speed * scene.solver.step, to));
    }
    static bool HasFatalFailure() { return testing::Test::HasFatalFailure(); }
    pliant_tool_state state() const
    {
        pliant_tool_state out{};
        EXPECT_EQ(pliant_tool_get(data, tool, &out), PLIANT_OK);
        return out;
    }
};

struct EveryKind : testing::TestWithParam<Kind> {
};
std::string name_of(const testing::TestParamInfo<Kind> &info) { return info.param.name; }
INSTANTIATE_TEST_SUITE_P(Engines, EveryKind, testing::Values(fine, dynamic, subdivided), name_of);

// The handle presses on the slab with at most 0.5 N, and the measured blade goes through all of the slab.
TEST_P(EveryKind, ABlockedBladeCutsWhereItsProxyIs)
{
    Slab slab(GetParam(), Slab::BALL, 0, 0.5, 0.05);
    slab.step(Slab::touching + 0.0145);
    slab.go_down(Slab::touching - 0.032);
    for (int s = 0; s < 10 && !slab.HasFatalFailure(); s++) slab.step(Slab::touching - 0.032);
    const pliant_tool_state tool = slab.state();
    const double depth = top - (tool.proxy_tip[2] - Slab::below), measured = top;
    if (std::getenv("PLIANT_FIGURES"))
        std::printf("blade of the proxy %.2f mm deep, measured through %.0f mm; severed %.2f mm times the width\n",
                    1e3 * depth, 1e3 * measured, 1e3 * tool.severed_area / width);
    EXPECT_TRUE(tool.saturated);
    ASSERT_GT(tool.proxy_error[2], -0.035);
    ASSERT_LT(tool.proxy_error[2], -0.02);
    EXPECT_EQ(tool.pieces, 1);
    // the tissue under the handle gives way, and cuts end at whole voxels, or at tetrahedra of 8 mm
    EXPECT_GT(tool.severed_area, width * (depth - (slab.scene.cut.kind == PLIANT_CUT_SUBDIVIDE ? 0.008 : 0.0025)));
    EXPECT_LT(tool.severed_area, width * (depth + 0.002));
    EXPECT_EQ(slab.logged, "");
}

// A shape that touches nothing changes nothing, except that the blade acts one step later.
TEST_P(EveryKind, AFreeBladeCutsOneStepLater)
{
    Slab shaped(GetParam(), Slab::CUTTING_BALL, 1, 20, 0.05), plain(GetParam(), Slab::NONE, 1, 20, 0.05);
    std::vector<double> forces[2];
    double work[2] = {0, 0};
    shaped.step(Slab::touching + 0.0145);
    shaped.step(Slab::touching + 0.0145); // its proxy is known after the first step
    plain.step(Slab::touching + 0.0145);
    for (double z = Slab::touching + 0.014; z > Slab::below - 0.005 && !Slab::HasFatalFailure(); z -= 0.0005) {
        shaped.step(z);
        plain.step(z);
        forces[0].push_back(-shaped.state().force[2]);
        forces[1].push_back(-plain.state().force[2]);
    }
    double largest = 0, off = 0;
    for (size_t n = 1; n < forces[0].size(); n++) {
        largest = std::max(largest, forces[1][n]);
        off = std::max(off, std::fabs(forces[0][n] - forces[1][n - 1]));
        for (int k = 0; k < 2; k++) work[k] += 0.5 * (forces[k][n - 1] + forces[k][n]) * 0.0005;
    }
    const double area = shaped.state().severed_area;
    if (std::getenv("PLIANT_FIGURES"))
        std::printf(
            "largest force %.3f N, differences up to %.2g N; area %.6f and %.6f of the section's, work %.4f and %.4f\n",
            largest, off, area / (width * top), plain.state().severed_area / (width * top),
            work[0] / (toughness * area), work[1] / (toughness * plain.state().severed_area));
    EXPECT_GT(largest, 1.5 * toughness * width);
    if (shaped.data->solver) EXPECT_EQ(off, 0); // with contact, explicit dynamics chooses other sub-steps
    EXPECT_EQ(shaped.state().pieces, 2);
    EXPECT_NEAR(area, width * top, 0.05 * width * top);
    EXPECT_NEAR(work[0], toughness * area, 0.05 * toughness * area);
    EXPECT_EQ(shaped.logged + plain.logged, "");
}

// The measured tool leaves the slab on its other side. The proxy jumps there, by less than a tool can move in a step.
TEST(ShapedBlade, AJumpOfTheProxyCutsNothing)
{
    Slab slab(fine, Slab::BALL, 0, 0.5, 0.0385);
    slab.step(Slab::touching + 0.0145);
    slab.go_down(Slab::touching - 0.034);
    const double area = slab.state().severed_area;
    ASSERT_LT(slab.state().proxy_error[2], -0.03);
    EXPECT_EQ(slab.logged, "");
    for (int s = 0; s < 6 && !slab.HasFatalFailure(); s++) slab.step(-0.0175 - 0.0005 * s);
    EXPECT_NEAR(slab.state().proxy_error[2], 0, 1e-9);
    EXPECT_NE(slab.logged.find("tool ball: its proxy has jumped"), std::string::npos) << slab.logged;
    EXPECT_EQ(slab.state().pieces, 1);
    EXPECT_LT(slab.state().severed_area, area + 0.002 * width);
}

// A saved state contains the blade's last pose and the proxy, so the same poses give the same cut again.
TEST_P(EveryKind, ARestoredStateCutsTheSameAgain)
{
    Slab slab(GetParam(), Slab::BALL, 1, 0.5, 0.05);
    slab.step(Slab::touching + 0.0145);
    slab.go_down(Slab::touching - 0.008);
    pliant_state *saved = nullptr;
    ASSERT_EQ(pliant_state_create(&saved), PLIANT_OK);
    ASSERT_EQ(pliant_state_save(slab.model, slab.data, saved), PLIANT_OK) << pliant_last_error();
    double area[2];
    std::vector<double> positions[2];
    for (int run = 0; run < 2; run++) {
        ASSERT_EQ(pliant_state_restore(slab.model, slab.data, saved), PLIANT_OK) << pliant_last_error();
        slab.z = Slab::touching - 0.008;
        slab.go_down(Slab::touching - 0.018);
        area[run] = slab.state().severed_area;
        positions[run].assign(slab.data->positions, slab.data->positions + 3 * slab.data->body->fine.num_nodes);
    }
    pliant_state_free(saved);
    EXPECT_GT(area[0], 0);
    EXPECT_EQ(area[0], area[1]);
    EXPECT_EQ(positions[0], positions[1]);
}

} // namespace
