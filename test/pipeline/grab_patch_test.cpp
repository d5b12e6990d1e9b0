// Patches around grasps (model/patch), against the fine solution.
#include "body.h"
#include "pliant/contact.h"

#include "model_data/data.h"
#include "base/memory.h"

#include <array>
#include <string>

namespace {

const double side = 0.2;
const double top[3] = {0.11, 0.1, 0.19}, aside[3] = {0.19, 0.06, 0.12};

class Patched {
public:
    const int size[3] = {24, 24, 24};
    const double box[3] = {side, side, side};
    Body body{size, box, {{4000, 0.45, 1000, false}, {30000, 0.3, 1000, false}},
              [](int i, int j, int k) { return (i / 6 + j / 5 + k / 7) % 2; }};

    explicit Patched(pliant_method method, double patch, int ratio = 2, pliant_element_kind kind = PLIANT_LINEAR)
    {
        body.scene.element.kind = kind;
        body.fix_plane(0, 0, 0, 0, 0, 1);
        body.cells(4, 4, 4, ratio);
        body.scene.model.method = method;
        body.scene.model.patch = patch;
        body.scene.grasp.radius = 0.012;
        EXPECT_EQ(body.build(), PLIANT_OK) << pliant_last_error();
    }
    int take(const char *name, const double at[3])
    {
        int tool = -1;
        EXPECT_EQ(pliant_tool_add(body.model, body.data, name, &tool), PLIANT_OK);
        EXPECT_EQ(pliant_tool_grasp(body.model, body.data, tool, at), PLIANT_OK) << pliant_last_error();
        return tool;
    }
    // Step until this number of tools uses the patch.
    void wait(int tools)
    {
        if (body.scene.model.patch == 0) return;
        for (int s = 0; body.data->statistics.patched != tools && s < 50; s++)
            ASSERT_GE(pliant_step(body.model, body.data), 0);
        ASSERT_EQ(body.data->statistics.patched, tools);
        ASSERT_EQ(body.data->statistics.patch_waiting, 0);
    }
    void pull(int tool, const double from[3], double x, double y, double z)
    {
        const double tip[3] = {from[0] + x, from[1] + y, from[2] + z};
        ASSERT_EQ(pliant_tool_set_drive(body.data, tool, PLIANT_DRIVE_RIGID, nullptr), PLIANT_OK);
        ASSERT_EQ(pliant_tool_set_pose(body.data, tool, tip, nullptr), PLIANT_OK);
    }
    std::vector<double> positions() const
    {
        return {body.data->positions, body.data->positions + 3 * body.model->body->fine.num_nodes};
    }
    std::vector<double> rest() const
    {
        return {body.model->body->fine.rest, body.model->body->fine.rest + 3 * body.model->body->fine.num_nodes};
    }
};

double max_distance(const std::vector<double> &a, const std::vector<double> &b)
{
    EXPECT_EQ(a.size(), b.size());
    double maximum = 0;
    for (size_t n = 0; n < a.size(); n += 3)
        maximum = std::fmax(maximum, std::hypot(std::hypot(a[n] - b[n], a[n + 1] - b[n + 1]), a[n + 2] - b[n + 2]));
    return maximum;
}

// Pull by a vector and solve; also return the force in newtons.
std::vector<double> pulled(Patched &patched, const double by[3], double force[3])
{
    int tool = patched.take("tool", top);
    double from[3];
    std::memcpy(from, patched.body.data->tools[tool].tip, sizeof from);
    patched.wait(1);
    for (int s = 1; s <= 10; s++) {
        patched.pull(tool, from, by[0] * s / 10, by[1] * s / 10, by[2] * s / 10);
        EXPECT_GE(pliant_step(patched.body.model, patched.body.data), 0) << pliant_last_error();
    }
    EXPECT_EQ(patched.body.settle(), PLIANT_OK);
    std::memcpy(force, patched.body.data->tools[tool].force, 3 * sizeof *force);
    return patched.positions();
}

TEST(GrabPatch, SmallPullsAreTheFineSolutionWhateverTheMethod)
{
    const double by[3] = {1e-5, -2e-5, 3e-5};
    double force[3], found[3];
    for (pliant_element_kind kind : {PLIANT_LINEAR, PLIANT_HEXAHEDRA}) {
        Patched fine(PLIANT_FINE, 0, 2, kind);
        const std::vector<double> exact = pulled(fine, by, force);
        const double moved = max_distance(exact, fine.rest());
        for (pliant_method method : {PLIANT_COARSE, PLIANT_SCHUR, PLIANT_AVERAGED, PLIANT_LOD}) {
            if (kind == PLIANT_HEXAHEDRA && method == PLIANT_SCHUR) continue;
            Patched patched(method, 0.04, 2, kind), bare(method, 0, 2, kind);
            EXPECT_LT(max_distance(pulled(patched, by, found), exact), 2e-3 * moved) << method;
            for (int d = 0; d < 3; d++) EXPECT_NEAR(found[d], force[d], 2e-3 * std::fabs(force[2])) << method;
            EXPECT_GT(max_distance(pulled(bare, by, found), exact), 0.1 * moved) << method;
            EXPECT_GT(patched.body.data->statistics.patch_iterations, 0);
            EXPECT_LE(patched.body.data->statistics.patch_residual, patched.body.scene.solver.tolerance);
            EXPECT_NEAR(patched.body.data->statistics.patch_moved, moved, 0.01 * moved);
        }
    }
}

TEST(GrabPatch, LargePullsAreNearTheFineSolution)
{
    const double by[3] = {0.012, -0.015, 0.025};
    double force[3], found[3];
    for (pliant_element_kind kind : {PLIANT_LINEAR, PLIANT_HEXAHEDRA}) {
        Patched fine(PLIANT_FINE, 0, 2, kind), patched(PLIANT_AVERAGED, 0.05, 2, kind);
        const std::vector<double> exact = pulled(fine, by, force), near = pulled(patched, by, found);
        const double off = max_distance(near, exact) / max_distance(exact, fine.rest());
        std::printf("%s: %.2f %% of the way, %.2f %% of the force\n",
                    kind == PLIANT_LINEAR ? "tetrahedra" : "hexahedra", 100 * off, 100 * (found[2] / force[2] - 1));
        EXPECT_LT(off, 0.05);
        for (int d = 0; d < 3; d++) EXPECT_NEAR(found[d], force[d], 0.05 * std::fabs(force[2]));
        // same with that force
        Patched by_force(PLIANT_AVERAGED, 0.05, 2, kind);
        int tool = by_force.take("tool", top);
        by_force.wait(1);
        ASSERT_EQ(pliant_tool_set_drive(by_force.body.data, tool, PLIANT_DRIVE_FORCE, found), PLIANT_OK);
        EXPECT_EQ(by_force.body.settle(), PLIANT_OK);
        EXPECT_LT(max_distance(by_force.positions(), near), 1e-4 * max_distance(near, patched.rest()));
    }
}

TEST(GrabPatch, NothingHeldIsTheSameBits)
{
    Patched with(PLIANT_AVERAGED, 0.04), without(PLIANT_AVERAGED, 0);
    const double gravity[3] = {1, 2, -5};
    for (Patched *each : {&with, &without}) {
        ASSERT_EQ(pliant_data_set_gravity(each->body.data, gravity), PLIANT_OK);
        for (int s = 0; s < 6; s++) ASSERT_GE(pliant_step(each->body.model, each->body.data), 0);
    }
    EXPECT_EQ(with.positions(), without.positions());
    EXPECT_EQ(with.body.data->statistics.patched, 0);
}

TEST(GrabPatch, HoldingStillMovesNothingAndReleaseFreesAll)
{
    Patched patched(PLIANT_AVERAGED, 0.04);
    const double gravity[3] = {1, 2, -5};
    ASSERT_EQ(pliant_data_set_gravity(patched.body.data, gravity), PLIANT_OK);
    ASSERT_EQ(patched.body.settle(), PLIANT_OK);
    ASSERT_EQ(pliant_step(patched.body.model, patched.body.data), PLIANT_OK);
    const std::vector<double> before = patched.positions();
    for (int round = 0; round < 2; round++) {
        size_t bytes = pliant_memory_in_use();
        int tool = patched.take("tool", round ? aside : top);
        double from[3];
        std::memcpy(from, patched.body.data->tools[tool].tip, sizeof from);
        patched.wait(1);
        EXPECT_LT(max_distance(patched.positions(), before), 1e-8);
        patched.pull(tool, from, 0.01, 0, 0.01);
        ASSERT_GE(pliant_step(patched.body.model, patched.body.data), 0);
        EXPECT_GT(max_distance(patched.positions(), before), 0.01);
        pliant_tool_release(patched.body.data, tool);
        for (int s = 0; s < 3; s++) ASSERT_GE(pliant_step(patched.body.model, patched.body.data), 0);
        EXPECT_LT(max_distance(patched.positions(), before), 1e-8);
        EXPECT_EQ(patched.body.data->statistics.patched, 0);
        if (round > 0) EXPECT_LE(pliant_memory_in_use(), bytes); // the factor for responses stays after the first round
    }
    ASSERT_EQ(pliant_data_reset(patched.body.model, patched.body.data), PLIANT_OK);
    EXPECT_EQ(patched.positions(), patched.rest());
}

TEST(GrabPatch, HoldingStillMovesNothingWhileOtherToolsGraspAndRelease)
{
    Patched patched(PLIANT_AVERAGED, 0.04);
    const double gravity[3] = {0, -0.5, 0};
    ASSERT_EQ(pliant_data_set_gravity(patched.body.data, gravity), PLIANT_OK);
    ASSERT_EQ(patched.body.settle(), PLIANT_OK);
    const std::vector<double> before = patched.positions();
    ASSERT_GT(max_distance(before, patched.rest()), 1e-3);
    patched.take("first", top);
    patched.wait(1);
    int second = patched.take("second", aside);
    patched.wait(2);
    ASSERT_EQ(patched.body.settle(), PLIANT_OK);
    EXPECT_LT(max_distance(patched.positions(), before), 1e-8);
    pliant_tool_release(patched.body.data, second);
    ASSERT_GE(pliant_step(patched.body.model, patched.body.data), 0);
    second = patched.take("second", aside);
    patched.wait(2);
    ASSERT_EQ(patched.body.settle(), PLIANT_OK);
    EXPECT_LT(max_distance(patched.positions(), before), 1e-8);
}

TEST(GrabPatch, AnotherToolThatReturnsDoesNotReleaseThePull)
{
    Patched patched(PLIANT_AVERAGED, 0.04);
    int first = patched.take("first", top), second = patched.take("second", aside);
    double from[3];
    std::memcpy(from, patched.body.data->tools[first].tip, sizeof from);
    patched.wait(2);
    for (int s = 1; s <= 10; s++) {
        patched.pull(first, from, 0, 0, 0.002 * s);
        ASSERT_GE(pliant_step(patched.body.model, patched.body.data), 0);
    }
    ASSERT_EQ(patched.body.settle(), PLIANT_OK);
    pliant_tool_release(patched.body.data, second);
    ASSERT_GE(pliant_step(patched.body.model, patched.body.data), 0);
    ASSERT_EQ(patched.body.settle(), PLIANT_OK);
    const std::vector<double> before = patched.positions();
    patched.take("second", aside); // grasps the tissue at its position
    // one evaluation alone does not move anything
    ASSERT_EQ(pliant_data_set_limits(patched.body.data, 1, 1e-3), PLIANT_OK);
    patched.wait(2);
    EXPECT_LT(max_distance(patched.positions(), before), 0.02 * 0.02);
}

// A cube with two coarse cells per edge, with a patch.
struct Small : Body {
    Small()
        : Body(std::array<int, 3>{{8, 8, 8}}.data(), std::array<double, 3>{{side, side, side}}.data(),
               {{4000, 0.45, 1000, false}})
    {
        fix_plane(0, 0, 0, 0, 0, 1);
        cells(2, 2, 2, 2);
        scene.model.method = PLIANT_AVERAGED;
        scene.model.patch = 0.05;
    }
};

TEST(GrabPatch, AFailedPatchDoesNotAffectExistingPatches)
{
    Small body;
    body.scene.solver.tolerance = 1e-6;
    body.scene.solver.refresh_interval = 0;
    ASSERT_EQ(body.build(), PLIANT_OK) << pliant_last_error();
    int refused = 0;
    for (int64_t calls = 8; calls < 60; calls += 4) {
        pliant_data *data = nullptr;
        int first, second;
        ASSERT_EQ(pliant_data_create(body.model, &data), PLIANT_OK);
        auto steps = [&](int count) {
            for (int s = 0; s < count; s++) ASSERT_GE(pliant_step(body.model, data), 0) << pliant_last_error();
        };
        ASSERT_EQ(pliant_tool_add(body.model, data, "first", &first), PLIANT_OK);
        ASSERT_EQ(pliant_tool_grasp(body.model, data, first, top), PLIANT_OK);
        double tip[3];
        std::memcpy(tip, data->tools[first].tip, sizeof tip);
        for (int s = 0; s < 20 && data->statistics.patched != 1; s++) steps(1);
        ASSERT_EQ(pliant_tool_set_drive(data, first, PLIANT_DRIVE_RIGID, nullptr), PLIANT_OK);
        tip[2] += 0.005;
        ASSERT_EQ(pliant_tool_set_pose(data, first, tip, nullptr), PLIANT_OK);
        steps(3);
        const double force = data->tools[first].force[2];
        ASSERT_GT(force, 0.01);
        ASSERT_EQ(pliant_tool_add(body.model, data, "second", &second), PLIANT_OK);
        ASSERT_EQ(pliant_tool_grasp(body.model, data, second, aside), PLIANT_OK);
        pliant_memory_fail_after(calls);
        bool began = pliant_step(body.model, data) >= 0;
        for (int s = 0; began && s < 5 && data->statistics.patch_waiting > 0; s++)
            began = pliant_step(body.model, data) >= 0;
        pliant_memory_fail_after(-1);
        // no patch for the second tool: both continue, the second one with the coarse model
        if (began && data->statistics.patched == 1) {
            refused++;
            steps(5);
            EXPECT_EQ(data->statistics.patch_waiting, 0) << calls;
            EXPECT_NEAR(data->tools[first].force[2], force, 0.2 * force) << calls;
            pliant_tool_release(data, second);
            steps(1);
            ASSERT_EQ(pliant_tool_grasp(body.model, data, second, aside), PLIANT_OK);
            for (int s = 0; s < 20 && data->statistics.patched != 2; s++) steps(1);
            EXPECT_EQ(data->statistics.patched, 2) << calls;
            EXPECT_NEAR(data->tools[first].force[2], force, 0.2 * force) << calls;
            EXPECT_NEAR(data->tools[first].held_point[2], tip[2] - data->tools[first].tip_offset[2], 1e-5) << calls;
        }
        pliant_data_free(data);
    }
    EXPECT_GT(refused, 3);
}

TEST(GrabPatch, AFailedStepIsUndone)
{
    Patched patched(PLIANT_AVERAGED, 0.04), smooth(PLIANT_AVERAGED, 0.04);
    std::vector<double> ends[2];
    for (Patched *each : {&patched, &smooth}) {
        pliant_data *data = each->body.data;
        int tool = each->take("tool", top);
        const double pull[3] = {0, 0, 0.1}, more[3] = {0.05, 0, 0.15}, far_too_much[3] = {1e300, 0, 1e300},
                     gravity[3] = {0.2, 0, -0.3};
        each->wait(1);
        ASSERT_EQ(pliant_tool_set_drive(data, tool, PLIANT_DRIVE_FORCE, pull), PLIANT_OK);
        ASSERT_EQ(each->body.settle(), PLIANT_OK);
        ASSERT_EQ(pliant_data_set_gravity(data, gravity), PLIANT_OK); // so that the coarse model also has a load
        if (each == &patched) {
            const std::vector<double> before = each->positions(),
                                      held(data->tools[tool].held_point, data->tools[tool].held_point + 3);
            const size_t coarse = 3 * static_cast<size_t>(data->solver->system->mesh->num_nodes);
            const std::vector<double> solved(data->solver->now.x, data->solver->now.x + coarse);
            ASSERT_EQ(pliant_tool_set_drive(data, tool, PLIANT_DRIVE_FORCE, far_too_much), PLIANT_OK);
            for (int s = 0; s < 2; s++) {
                ASSERT_EQ(pliant_step(each->body.model, data), PLIANT_ERROR_NUMERIC);
                EXPECT_EQ(each->positions(), before);
                EXPECT_EQ(std::vector<double>(data->solver->now.x, data->solver->now.x + coarse), solved);
                EXPECT_EQ(std::vector<double>(data->tools[tool].held_point, data->tools[tool].held_point + 3), held);
                EXPECT_EQ(data->tools[tool].force[2], pull[2]);
            }
            EXPECT_EQ(data->statistics.failed, 2);
        }
        ASSERT_EQ(pliant_tool_set_drive(data, tool, PLIANT_DRIVE_FORCE, more), PLIANT_OK);
        ASSERT_EQ(each->body.settle(), PLIANT_OK) << pliant_last_error();
        ends[each == &smooth] = each->positions();
    }
    EXPECT_LT(max_distance(ends[0], ends[1]), 1e-8);
}

TEST(GrabPatch, ReleasingAllDoesNotWaitForThePatch)
{
    Patched patched(PLIANT_AVERAGED, 0.04);
    patched.body.scene.model.patch_delay = 100000; // never due in this test
    ASSERT_EQ(patched.body.build(), PLIANT_OK);
    const std::vector<double> before = patched.positions();
    size_t bytes = 0;
    for (int round = 0; round < 20; round++) { // jobs are stopped at arbitrary points
        patched.take("tool", round % 2 ? top : aside);
        for (int s = 0; s < 1 + round % 3; s++) ASSERT_GE(pliant_step(patched.body.model, patched.body.data), 0);
        EXPECT_EQ(patched.body.data->statistics.patch_waiting, 1);
        ASSERT_EQ(pliant_data_reset(patched.body.model, patched.body.data), PLIANT_OK);
        EXPECT_EQ(patched.positions(), before);
        if (round == 9) bytes = pliant_memory_in_use();
    }
    EXPECT_LE(pliant_memory_in_use(), bytes);
    patched.body.scene.model.patch_delay = 0;
    ASSERT_EQ(patched.body.build(), PLIANT_OK);
    patched.take("tool", top);
    ASSERT_GE(pliant_step(patched.body.model, patched.body.data), 0);
    ASSERT_EQ(pliant_data_reset(patched.body.model, patched.body.data), PLIANT_OK);
    patched.take("tool", top); // a stop does not affect the next job
    patched.wait(1);
}

// A patch without any remaining grasp is discarded immediately, so that the next grasp's patch starts immediately.
TEST(GrabPatch, AGraspDoesNotWaitForThePatchOfAReleasedOne)
{
    const uint64_t delay = 20;
    Patched patched(PLIANT_AVERAGED, 0.04);
    patched.body.scene.model.patch_delay = delay;
    ASSERT_EQ(patched.body.build(), PLIANT_OK);
    const pliant_statistics *statistics = &patched.body.data->statistics;
    auto steps = [&](int count) {
        for (int s = 0; s < count; s++)
            ASSERT_GE(pliant_step(patched.body.model, patched.body.data), 0) << pliant_last_error();
    };
    int tool = patched.take("tool", top);
    steps(2);
    pliant_tool_release(patched.body.data, tool);
    steps(1);
    EXPECT_EQ(statistics->patch_waiting, 0);
    patched.take("tool", aside);
    const uint64_t taken = statistics->step;
    while (statistics->patched == 0 && statistics->step < 3 * delay) steps(1);
    EXPECT_EQ(statistics->step, taken + delay + 1);
    // a continuing second tool does not wait either
    int other = patched.take("other", top);
    steps(1);
    pliant_tool_release(patched.body.data, tool);
    const uint64_t left = statistics->step;
    while (statistics->patch_waiting == 1 && statistics->step < left + 2 * delay) steps(1);
    EXPECT_EQ(statistics->step, left + delay);
    EXPECT_EQ(statistics->patched, 1);
    // without any grasp, no patch is installed when it would have been due
    pliant_tool_release(patched.body.data, other);
    steps(1);
    const size_t bytes = pliant_memory_in_use();
    patched.take("tool", aside);
    steps(1);
    pliant_tool_release(patched.body.data, tool);
    steps(int(delay) + 1);
    EXPECT_EQ(pliant_memory_in_use(), bytes);
}

// The tolerance refers to the work of the tools, independently of the body's weight.
TEST(GrabPatch, GravityDoesNotLoosenTheTolerance)
{
    double residual[2];
    for (int heavy = 0; heavy < 2; heavy++) {
        Patched patched(PLIANT_AVERAGED, 0.04);
        const double gravity[3] = {0, -2.0 * heavy, 0};
        ASSERT_EQ(pliant_data_set_gravity(patched.body.data, gravity), PLIANT_OK);
        ASSERT_EQ(patched.body.settle(), PLIANT_OK);
        int tool = patched.take("tool", top);
        double from[3];
        std::memcpy(from, patched.body.data->tools[tool].tip, sizeof from);
        patched.wait(1);
        ASSERT_EQ(patched.body.settle(), PLIANT_OK);
        ASSERT_EQ(pliant_data_set_limits(patched.body.data, 3, 1e-9), PLIANT_OK);
        patched.pull(tool, from, 0, -1e-3, 0);
        ASSERT_GE(pliant_step(patched.body.model, patched.body.data), 0);
        residual[heavy] = patched.body.data->statistics.patch_residual;
    }
    EXPECT_GT(residual[0], 1e-9); // far above rounding
    EXPECT_NEAR(residual[1], residual[0], 0.2 * residual[0]); // 0.6 of it if the weight counted
}

TEST(GrabPatch, SeveralToolsOneAfterTheOther)
{
    std::vector<std::vector<double>> states[2];
    for (pliant_method method : {PLIANT_FINE, PLIANT_AVERAGED}) {
        Patched run(method, 0.04);
        double from[3], from_beside[3];
        int first = run.take("first", top);
        std::memcpy(from, run.body.data->tools[first].tip, sizeof from);
        if (method != PLIANT_FINE) run.wait(1);
        run.pull(first, from, 1e-4, 0, 2e-4);
        ASSERT_EQ(run.body.settle(), PLIANT_OK);
        states[method == PLIANT_FINE].push_back(run.positions());
        int second = run.take("second", aside); // while the first one pulls
        std::memcpy(from_beside, run.body.data->tools[second].tip, sizeof from_beside);
        if (method != PLIANT_FINE) run.wait(2);
        run.pull(second, from_beside, 2e-4, 1e-4, 0);
        ASSERT_EQ(run.body.settle(), PLIANT_OK);
        states[method == PLIANT_FINE].push_back(run.positions());
        pliant_tool_release(run.body.data, first);
        ASSERT_GE(pliant_step(run.body.model, run.body.data), 0);
        ASSERT_EQ(run.body.settle(), PLIANT_OK);
        states[method == PLIANT_FINE].push_back(run.positions());
        if (method != PLIANT_FINE) EXPECT_EQ(run.body.data->statistics.patched, 1);
        first = run.take("first", top); // grasp again while the second one continues
        if (method != PLIANT_FINE) run.wait(2);
        ASSERT_EQ(run.body.settle(), PLIANT_OK);
        states[method == PLIANT_FINE].push_back(run.positions());
        if (method != PLIANT_FINE) continue;
        for (const std::vector<double> &state : states[1]) EXPECT_GT(max_distance(state, run.rest()), 1e-4);
    }
    for (size_t s = 0; s < states[0].size(); s++)
        EXPECT_LT(max_distance(states[0][s], states[1][s]), 0.02 * 2.5e-4) << s;
}

TEST(GrabPatch, TheSameBitsWithAnyNumberOfThreads)
{
    std::vector<double> ends[2];
    for (int run = 0; run < 2; run++) {
        Patched patched(PLIANT_COARSE, 0.04);
        patched.body.scene.solver.threads = run ? 1 : 2;
        patched.body.scene.solver.iterations = 4;
        ASSERT_EQ(patched.body.build(), PLIANT_OK);
        int tool = patched.take("tool", top);
        for (int s = 1; s <= 12; s++) { // pull before and after the patch is available
            patched.pull(tool, top, 0, 0.001 * s, 0.002 * s);
            ASSERT_GE(pliant_step(patched.body.model, patched.body.data), 0);
        }
        EXPECT_EQ(patched.body.data->statistics.patched, 1);
        ends[run] = patched.positions();
    }
    EXPECT_EQ(ends[0], ends[1]);
}

TEST(GrabPatch, ExtremePullsEndAndReturn)
{
    Patched patched(PLIANT_AVERAGED, 0.04);
    int tool = patched.take("tool", top);
    double from[3];
    std::memcpy(from, patched.body.data->tools[tool].tip, sizeof from);
    patched.wait(1);
    ASSERT_EQ(pliant_data_set_limits(patched.body.data, 6, 1e-3), PLIANT_OK);
    for (double far : {0.3, 2.0, -2.0})
        for (int s = 0; s < 5; s++) {
            patched.pull(tool, from, far, 0.3 * far, far);
            ASSERT_GE(pliant_step(patched.body.model, patched.body.data), 0) << pliant_last_error();
            for (double x : patched.positions()) ASSERT_TRUE(std::isfinite(x));
        }
    patched.pull(tool, from, 0, 0, 0);
    EXPECT_EQ(patched.body.settle(200), PLIANT_OK);
    EXPECT_LT(max_distance(patched.positions(), patched.rest()), 1e-3 * side);
}

TEST(GrabPatch, SurvivesEveryFailureOfAllocation)
{
    Small body;
    body.scene.solver.iterations = 6;
    body.scene.solver.tolerance = 1e-3;
    body.scene.solver.refresh_interval = 0;
    ASSERT_EQ(body.build(), PLIANT_OK) << pliant_last_error();
    size_t before = pliant_memory_in_use();
    int failed = 0, refused = 0;
    bool whole = false;
    for (int64_t calls = 0; calls < 2000 && !whole; calls++) {
        pliant_data *data = nullptr;
        int tool;
        ASSERT_EQ(pliant_data_create(body.model, &data), PLIANT_OK);
        ASSERT_EQ(pliant_tool_add(body.model, data, "tool", &tool), PLIANT_OK);
        ASSERT_EQ(pliant_tool_grasp(body.model, data, tool, top), PLIANT_OK);
        ASSERT_EQ(pliant_tool_set_drive(data, tool, PLIANT_DRIVE_RIGID, nullptr), PLIANT_OK);
        const double tip[3] = {top[0], top[1], top[2] + 0.01};
        ASSERT_EQ(pliant_tool_set_pose(data, tool, tip, nullptr), PLIANT_OK);
        pliant_memory_fail_after(calls);
        int errors = 0;
        for (int s = 0; s < 8; s++) {
            pliant_status status = pliant_step(body.model, data);
            ASSERT_TRUE(status >= 0 || status == PLIANT_ERROR_MEMORY) << pliant_last_error();
            errors += status < 0;
            for (int32_t n = 0; n < 3 * body.model->body->fine.num_nodes; n++)
                ASSERT_TRUE(std::isfinite(data->positions[n]));
        }
        pliant_memory_fail_after(-1);
        failed += errors > 0;
        refused += errors == 0 && data->statistics.patched == 0;
        whole = errors == 0 && data->statistics.patched == 1;
        pliant_data_free(data);
        ASSERT_EQ(pliant_memory_in_use(), before) << calls;
    }
    EXPECT_TRUE(whole);
    EXPECT_GT(failed, 5);
    EXPECT_GT(refused, 20);
}

// A ball is pressed into the top: force and positions equal the fine mesh's, without a grasp. At the next contact,
// another patch is computed.
TEST(GrabPatch, ABallThatPressesAPatchEqualsTheFineMesh)
{
    double force[3];
    std::vector<double> x[3];
    for (int kind = 0; kind < 3; kind++) {
        Patched block(kind == 0 ? PLIANT_FINE : PLIANT_AVERAGED, kind == 2 ? 0.07 : 0);
        Body &body = block.body;
        const int tool = body.add_ball(0.03);
        for (int place = 0; place < (kind == 2 ? 2 : 1); place++) {
            const double to = place ? 0.06 : 0.13;
            for (int s = 0; s < 36; s++) {
                const double tip[3] = {to, 0.1, side + 0.03 - 0.001 * std::min(s, 12)};
                ASSERT_EQ(pliant_tool_set_pose(body.data, tool, tip, nullptr), PLIANT_OK);
                ASSERT_GE(pliant_step(body.model, body.data), 0) << pliant_last_error();
            }
            if (kind == 2) EXPECT_EQ(body.data->statistics.patched, 1) << place;
            if (place > 0) continue;
            force[kind] = 0;
            for (int32_t p = 0; p < body.data->contacts.count; p++)
                force[kind] -= body.data->contacts.point[p].force[2];
            x[kind] = block.positions();
        }
    }
    EXPECT_GT(force[1], 1.05 * force[0]) << "without it";
    EXPECT_NEAR(force[2], force[0], 0.02 * force[0]);
    EXPECT_LT(max_distance(x[2], x[0]), 0.1 * max_distance(x[1], x[0]));
}

} // namespace
