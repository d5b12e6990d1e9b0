// Tests of tools: names, grasps and messages.
#include "pipeline/body.h"

#include "sim/build/linear_wrench.h"
#include "model_data/data.h"

#include <algorithm>
#include <cmath>
#include <string>

namespace {

const int size[3] = {6, 6, 6};
const double box[3] = {0.12, 0.12, 0.12};

struct Tool : testing::Test {
    Body body{size, box, {{4000, 0.45, 1000, false}}};
    static std::string logged;
    int tool = -1;

    void SetUp() override
    {
        body.fix_plane(0, 0, 0.041, 0, 0, 1);
        body.cells(6, 6, 6, 1);
        ASSERT_EQ(body.build(), PLIANT_OK) << pliant_last_error();
        logged.clear();
        pliant_set_log(
            [](pliant_log_level level, const char *message, void *) {
                if (level == PLIANT_LOG_WARNING) logged = message;
            },
            nullptr);
    }
    void TearDown() override { pliant_set_log(nullptr, nullptr); }
    pliant_status grasp(double x, double y, double z)
    {
        const double rest[3] = {x, y, z};
        return pliant_tool_grasp(body.model, body.data, tool, rest);
    }
};
std::string Tool::logged;

TEST_F(Tool, ANameThatIsTooLongIsRefusedAndNotAddedAgain)
{
    const std::string longest(47, 'n'), longer(48, 'n');
    int first = -1, again = -1;
    ASSERT_EQ(pliant_tool_add(body.model, body.data, longest.c_str(), &first), PLIANT_OK);
    ASSERT_EQ(pliant_tool_add(body.model, body.data, longest.c_str(), &again), PLIANT_OK);
    EXPECT_EQ(first, again);
    EXPECT_EQ(pliant_tool_add(body.model, body.data, longer.c_str(), &again), PLIANT_ERROR_ARGUMENT);
    EXPECT_NE(std::string(pliant_last_error()).find("48 characters; use at most 47"), std::string::npos)
        << pliant_last_error();
    EXPECT_EQ(body.data->num_tools, 1);
}

TEST_F(Tool, APoseNeedsARotationAndADriveIsOneOfThree)
{
    ASSERT_EQ(pliant_tool_add(body.model, body.data, "hook", &tool), PLIANT_OK);
    const double tip[3] = {0.05, 0.06, 0.09}, other[3] = {0.01, 0.02, 0.03}, turned[4] = {0, 0, 2, 0};
    ASSERT_EQ(pliant_tool_set_pose(body.data, tool, tip, turned), PLIANT_OK);
    const double wrong[3][4] = {{0, 0, 0, 0}, {1e-200, 0, 0, 0}, {1e200, 0, 0, 1}};
    for (const double *rotation : wrong) {
        EXPECT_EQ(pliant_tool_set_pose(body.data, tool, other, rotation), PLIANT_ERROR_ARGUMENT);
        EXPECT_NE(std::string(pliant_last_error()).find("rotation of tool hook"), std::string::npos)
            << pliant_last_error();
    }
    pliant_tool_state state;
    ASSERT_EQ(pliant_tool_get(body.data, tool, &state), PLIANT_OK);
    EXPECT_TRUE(std::equal(tip, tip + 3, state.tip) && std::equal(turned, turned + 4, state.rotation));
    EXPECT_EQ(pliant_tool_set_drive(body.data, tool, static_cast<pliant_drive>(3), nullptr), PLIANT_ERROR_ARGUMENT);
    EXPECT_NE(std::string(pliant_last_error()).find("spring (0), rigid (1) or force (2)"), std::string::npos)
        << pliant_last_error();
}

// The weights of a cube's tetrahedra differ between its corners of even and odd parity. Trilinear weights do not.
TEST(ToolInACube, AHexahedronIsHeldByTrilinearWeightsIfTheBallReachesACellsEdge)
{
    Body body(size, box, {{4000, 0.45, 1000, false}});
    body.cells(6, 6, 6, 1);
    body.fix_plane(0, 0, 0.001, 0, 0, 1);
    body.scene.element.kind = PLIANT_HEXAHEDRA;
    ASSERT_EQ(body.build(), PLIANT_OK) << pliant_last_error();
    int tool = -1;
    ASSERT_EQ(pliant_tool_add(body.model, body.data, "hook", &tool), PLIANT_OK);
    const double centre[3] = {0.07, 0.05, 0.09}, cell = 0.02; // of a cube
    for (const double radius : {0.99 * cell, 1.01 * cell}) {
        ASSERT_EQ(pliant_tool_set_radius(body.data, tool, radius), PLIANT_OK);
        ASSERT_EQ(pliant_tool_grasp(body.model, body.data, tool, centre), PLIANT_OK) << pliant_last_error();
        const pliant_tool &hook = body.data->tools[tool];
        double lowest = 1, highest = 0, sum = 0;
        for (int32_t h = 0; h < hook.num_held; h++) {
            const double *at = body.data->body->fine.rest + 3 * hook.held[h];
            sum += hook.weight[h];
            if (std::hypot(std::hypot(at[0] - centre[0], at[1] - centre[1]), at[2] - centre[2]) > cell) continue;
            lowest = std::min(lowest, hook.weight[h]);
            highest = std::max(highest, hook.weight[h]);
        }
        EXPECT_NEAR(sum, 1, 1e-12);
        if (radius < cell) EXPECT_GT(highest, 1.5 * lowest);
        else EXPECT_NEAR(highest, lowest, 1e-12);
    }
}

TEST_F(Tool, GraspingFixedTissueIsLogged)
{
    ASSERT_EQ(pliant_tool_add(body.model, body.data, "hook", &tool), PLIANT_OK);
    ASSERT_EQ(grasp(0.05, 0.06, 0.09), PLIANT_OK) << pliant_last_error();
    EXPECT_EQ(logged, "");
    ASSERT_EQ(grasp(0.05, 0.06, 0.02), PLIANT_OK) << pliant_last_error();
    EXPECT_NE(logged.find("tool hook: 100 % of the grasped tissue"), std::string::npos) << logged;
    EXPECT_NE(logged.find("(0.0500 0.0600 0.0200) m"), std::string::npos) << logged;
    body.data->tools[tool].radius = 0;
    ASSERT_EQ(grasp(0.05, 0.06, 0.05), PLIANT_OK) << pliant_last_error();
    EXPECT_NE(logged.find("tool hook: 50 % of the grasped tissue"), std::string::npos) << logged;
}

TEST_F(Tool, WithoutTissueTheNearestTissueIsNamed)
{
    ASSERT_EQ(pliant_tool_add(body.model, body.data, "hook", &tool), PLIANT_OK);
    EXPECT_EQ(grasp(0.2, 0.06, 0.02), PLIANT_ERROR_ARGUMENT);
    std::string message = pliant_last_error();
    EXPECT_NE(message.find("tool hook: there is no tissue at (0.2000 0.0600 0.0200) m"), std::string::npos) << message;
    EXPECT_NE(message.find("between (0.0000 0.0000 0.0000) and (0.1200 0.1200 0.1200) m"), std::string::npos)
        << message;
    EXPECT_EQ(message.find("millimetres"), std::string::npos) << message;
    EXPECT_EQ(grasp(50, 60, 90), PLIANT_ERROR_ARGUMENT);
    EXPECT_NE(std::string(pliant_last_error()).find("seems to be in millimetres"), std::string::npos)
        << pliant_last_error();
    const double tip[3] = {50, 60, 90};
    ASSERT_EQ(pliant_tool_set_pose(body.data, tool, tip, nullptr), PLIANT_OK);
    EXPECT_EQ(pliant_tool_grasp(body.model, body.data, tool, nullptr), PLIANT_ERROR_ARGUMENT);
    EXPECT_NE(std::string(pliant_last_error()).find("seems to be in millimetres"), std::string::npos)
        << pliant_last_error();
    EXPECT_FALSE(body.data->tools[tool].holding);
}

TEST_F(Tool, OverflowingLoadsNameLikelyCauses)
{
    ASSERT_EQ(pliant_tool_add(body.model, body.data, "hook", &tool), PLIANT_OK);
    ASSERT_EQ(grasp(0.05, 0.06, 0.09), PLIANT_OK) << pliant_last_error();
    const double force[3] = {0, 0, 1e200};
    ASSERT_EQ(pliant_tool_set_drive(body.data, tool, PLIANT_DRIVE_FORCE, force), PLIANT_OK);
    EXPECT_EQ(pliant_step(body.model, body.data), PLIANT_ERROR_NUMERIC);
    const std::string message = pliant_last_error();
    for (const char *word : {"model/gravity", "material table", "grasp/stiffness", "forces"})
        EXPECT_NE(message.find(word), std::string::npos) << message;
}

// The tissue below a surface point holds it, although air cells lie above. This also holds if single precision of a
// scan's header has moved the surface by 1e-7.
TEST(ToolOnAFace, APointIsHeldOnEverySide)
{
    const int voxels[3] = {20, 20, 20};
    const double cell[3] = {0.1, 0.1, 0.1};
    Body air(voxels, cell, {{4000, 0.45, 1000, false}, {1, 0.3, 1, true}},
             [](int i, int j, int k) { return i >= 4 && i < 16 && j >= 4 && j < 16 && k >= 4 && k < 16 ? 0 : 1; });
    air.cells(10, 10, 10, 1);
    air.fix_plane(0, 0, 0.02, 0, 0, 1);
    air.scene.grasp.radius = 0;
    ASSERT_EQ(air.build(), PLIANT_OK) << pliant_last_error();
    int index;
    ASSERT_EQ(pliant_tool_add(air.model, air.data, "point", &index), PLIANT_OK);
    for (int axis = 0; axis < 3; axis++)
        for (int side = 0; side < 2; side++)
            for (double off : {-2e-9, 0.0, 2e-9}) {
                double at[3] = {0.043, 0.047, 0.053};
                at[axis] = (side ? 0.08 : 0.02) + off;
                EXPECT_EQ(pliant_tool_grasp(air.model, air.data, index, at), PLIANT_OK)
                    << axis << side << off << pliant_last_error();
                for (int d = 0; d < 3; d++) EXPECT_NEAR(air.data->tools[index].held_point[d], at[d], 1e-8);
            }
    const double off[3] = {0.043, 0.047, 0.0801};
    EXPECT_EQ(pliant_tool_grasp(air.model, air.data, index, off), PLIANT_ERROR_ARGUMENT);
}

// In stiff tissue, the force of a spring grip is limited in every step, quasi-static or dynamic. The grip ends when the
// tissue has slipped out.
TEST(Slip, AGraspSlipsAtItsForceAndIsReleased)
{
    for (pliant_solver_kind kind : {PLIANT_COROTATIONAL, PLIANT_TLED}) {
        Body stiff(size, box, {{40000, 0.45, 1000, false}});
        stiff.fix_plane(0, 0, 0.041, 0, 0, 1);
        stiff.cells(6, 6, 6, 1);
        stiff.scene.solver.kind = kind;
        stiff.scene.solver.step = 0.005;
        stiff.scene.grasp.slip = 0.5;
        ASSERT_EQ(stiff.build(), PLIANT_OK) << pliant_last_error();
        int tool = -1;
        const double held[3] = {0.06, 0.06, 0.11};
        ASSERT_EQ(pliant_tool_add(stiff.model, stiff.data, "forceps", &tool), PLIANT_OK);
        ASSERT_EQ(pliant_tool_grasp(stiff.model, stiff.data, tool, held), PLIANT_OK);
        pliant_tool_state state;
        double maximum = 0;
        int steps = 0;
        for (bool holding = true; holding && steps < 200; ++steps) {
            const double tip[3] = {0.06, 0.06, 0.11 + 0.0005 * steps};
            ASSERT_EQ(pliant_tool_set_pose(stiff.data, tool, tip, nullptr), PLIANT_OK);
            ASSERT_GE(pliant_step(stiff.model, stiff.data), 0) << pliant_last_error();
            ASSERT_EQ(pliant_tool_get(stiff.data, tool, &state), PLIANT_OK);
            maximum = std::max(maximum, std::fabs(state.force[2]));
            holding = state.holding;
        }
        EXPECT_LT(maximum, 0.55); // the held point springs back slightly within a step
        EXPECT_GT(maximum, 0.3);
        EXPECT_GT(steps, 20); // 12 mm, the width of the grasped region, in steps of 0.5 mm
        EXPECT_LT(steps, 60);
        EXPECT_EQ(state.force[2], 0);

        ASSERT_EQ(pliant_tool_grasp(stiff.model, stiff.data, tool, held), PLIANT_OK);
        const double far[3] = {0.36, 0.06, 0.11}; // a sudden jump
        ASSERT_EQ(pliant_tool_set_pose(stiff.data, tool, far, nullptr), PLIANT_OK);
        ASSERT_GE(pliant_step(stiff.model, stiff.data), 0);
        ASSERT_EQ(pliant_tool_get(stiff.data, tool, &state), PLIANT_OK);
        EXPECT_FALSE(state.holding);
        EXPECT_EQ(state.force[0], 0);
    }
}

// A block held by one tool, and optionally by a second tool. The first one pulls it.
struct Pulled : Body {
    int tool = -1;
    double tip[3] = {0.06, 0.06, 0.11};
    const double turned[4] = {0, 0, std::sin(0.1), std::cos(0.1)};

    Pulled(const std::function<void(pliant_scene &)> &set, bool two = false)
        : Body(size, box, {{4000, 0.45, 1000, false}})
    {
        fix_plane(0, 0, 0.041, 0, 0, 1);
        cells(6, 6, 6, 1);
        scene.solver.threads = 1;
        for (double &g : scene.model.gravity) g = 0;
        set(scene);
        EXPECT_EQ(build(), PLIANT_OK) << pliant_last_error();
        const double other[3] = {0.04, 0.05, 0.11};
        int second;
        EXPECT_EQ(pliant_tool_add(model, data, "one", &tool), PLIANT_OK);
        EXPECT_EQ(pliant_tool_grasp(model, data, tool, tip), PLIANT_OK) << pliant_last_error();
        if (!two) return;
        EXPECT_EQ(pliant_tool_add(model, data, "two", &second), PLIANT_OK);
        EXPECT_EQ(pliant_tool_grasp(model, data, second, other), PLIANT_OK) << pliant_last_error();
    }
    // Return the wrench at this pose after it has become constant.
    void wrench_at(const double to[3], double out[6], int steps = 6)
    {
        pliant_tool_linear linear{};
        ASSERT_EQ(pliant_tool_set_pose(data, tool, to, turned), PLIANT_OK);
        for (int s = 0; s < steps; s++) ASSERT_GE(pliant_step(model, data), 0) << pliant_last_error();
        ASSERT_EQ(pliant_tool_linearize(data, tool, &linear), PLIANT_OK) << pliant_last_error();
        std::copy(linear.wrench, linear.wrench + 6, out);
    }
    // Return the largest difference between the reported and the measured stiffness, divided by the largest measured
    // entry.
    double off()
    {
        pliant_tool_linear linear{};
        double measured[36] = {}, maximum = 0, difference = 0, here[6];
        wrench_at(tip, here);
        EXPECT_EQ(pliant_tool_linearize(data, tool, &linear), PLIANT_OK);
        EXPECT_TRUE(linear.known);
        EXPECT_FALSE(linear.by_secants);
        const double step = 2e-5;
        for (int d = 0; d < 3; d++) {
            double plus[6], minus[6], to[3] = {tip[0], tip[1], tip[2]};
            to[d] += step;
            wrench_at(to, plus);
            to[d] -= 2 * step;
            wrench_at(to, minus);
            for (int a = 0; a < 6; a++) measured[6 * a + d] = (plus[a] - minus[a]) / (2 * step);
        }
        for (int m = 0; m < 36; m++) {
            maximum = std::fmax(maximum, std::fabs(measured[m]));
            difference = std::fmax(difference, std::fabs(measured[m] - linear.stiffness[m]));
            EXPECT_EQ(linear.stiffness[m], linear.stiffness[m % 6 * 6 + m / 6]);
        }
        return difference / maximum;
    }
};

TEST(Linear, StiffnessPredictsTheForceChange)
{
    const auto as_it_is = [](pliant_scene &) {};
    const auto hexahedra = [](pliant_scene &scene) { scene.element.kind = PLIANT_HEXAHEDRA; };
    const auto averaged = [](pliant_scene &scene) {
        scene.model.method = PLIANT_AVERAGED;
        scene.mesh.coarse_cells[0] = scene.mesh.coarse_cells[1] = scene.mesh.coarse_cells[2] = 3;
        scene.mesh.ratio = 2;
    };
    const auto damped = [](pliant_scene &scene) { scene.grasp.damping = 5; };
    EXPECT_LT(Pulled(as_it_is).off(), 0.005);
    EXPECT_LT(Pulled(as_it_is, true).off(), 0.005);
    EXPECT_LT(Pulled(hexahedra).off(), 0.005);
    EXPECT_LT(Pulled(averaged).off(), 0.005);
    Pulled pulled(as_it_is);
    pulled.tip[2] += 0.003;
    pulled.tip[0] += 0.0015;
    EXPECT_LT(pulled.off(), 0.1); // the factor belongs to the rest shape
    // a damper adds stiffness within a step
    Pulled with(damped), without(as_it_is);
    pliant_tool_linear stiff{}, soft{};
    double wrench[6];
    with.wrench_at(with.tip, wrench);
    without.wrench_at(without.tip, wrench);
    ASSERT_EQ(pliant_tool_linearize(with.data, with.tool, &stiff), PLIANT_OK);
    ASSERT_EQ(pliant_tool_linearize(without.data, without.tool, &soft), PLIANT_OK);
    EXPECT_GT(stiff.stiffness[0], 1.02 * soft.stiffness[0]);
}

// Return the error of the predicted next force, divided by the force's change. alone: predict by the factor, without
// secants.
double foresight(Pulled &pulled, bool by_secants, bool alone = false)
{
    pliant_tool_linear linear{};
    double late = 0, foreseen = 0;
    for (int s = 0; s < 70; s++) {
        const double to[3] = {0.06 + 0.01 * std::sin(0.1 * s), 0.06 + 0.008 * std::sin(0.13 * s),
                              0.12 + 0.02 * std::sin(0.08 * s)};
        double wrench[6], guess[6];
        pliant_tool_linear_wrench(&linear, to, pulled.turned, INFINITY, guess);
        pliant_tool_linear before = linear;
        pulled.wrench_at(to, wrench, 1);
        if (alone) linear = pliant_tool_linear{};
        EXPECT_EQ(pliant_tool_linearize(pulled.data, pulled.tool, &linear), PLIANT_OK);
        EXPECT_EQ(linear.by_secants, by_secants);
        for (int d = 0; d < 3 && s >= 20; d++) {
            late += std::pow(wrench[d] - before.wrench[d], 2);
            foreseen += std::pow(wrench[d] - guess[d], 2);
        }
    }
    return std::sqrt(foreseen / late);
}

TEST(Linear, TheNextForceIsPredicted)
{
    const auto few = [](pliant_scene &scene) { scene.solver.iterations = 4; };
    const auto cycles = [](pliant_scene &scene) {
        scene.solver.iterations = 4;
        scene.solver.preconditioner = PLIANT_MULTIGRID;
    };
    const auto explicitly = [](pliant_scene &scene) {
        scene.solver.kind = PLIANT_TLED;
        scene.tled.damping = 60;
    };
    Pulled corotational(few), factor(few), multigrid(cycles), tled(explicitly);
    EXPECT_LT(foresight(corotational, false), 0.05);
    EXPECT_LT(foresight(factor, false, true), 0.25);
    EXPECT_LT(foresight(multigrid, false), 0.05);
    EXPECT_LT(foresight(tled, true), 0.25);
}

TEST(Linear, IsBoundedAndResetByRelease)
{
    Pulled pulled([](pliant_scene &) {});
    pulled.tip[2] += 0.01;
    double wrench[6], there[6];
    pulled.wrench_at(pulled.tip, wrench);
    pliant_tool_linear linear{};
    ASSERT_EQ(pliant_tool_linearize(pulled.data, pulled.tool, &linear), PLIANT_OK);
    const double far[3] = {0.36, 0.06, 0.12};
    pliant_tool_linear_wrench(&linear, far, pulled.turned, 0.5, there);
    EXPECT_NEAR(std::sqrt(std::pow(there[0] - wrench[0], 2) + std::pow(there[1] - wrench[1], 2) +
                          std::pow(there[2] - wrench[2], 2)),
                0.5, 1e-9);
    pliant_tool_linear_wrench(&linear, pulled.tip, pulled.turned, 0.5, there);
    for (int d = 0; d < 6; d++) EXPECT_EQ(there[d], wrench[d]);
    pliant_tool_release(pulled.data, pulled.tool);
    ASSERT_GE(pliant_step(pulled.model, pulled.data), 0);
    ASSERT_EQ(pliant_tool_linearize(pulled.data, pulled.tool, &linear), PLIANT_OK);
    for (int d = 0; d < 36; d++) EXPECT_EQ(linear.stiffness[d], 0);
    for (int d = 0; d < 6; d++) EXPECT_EQ(linear.wrench[d], 0);
    EXPECT_EQ(pliant_tool_linearize(pulled.data, 7, &linear), PLIANT_ERROR_ARGUMENT);
}

} // namespace
