// Background results are installed when they are ready; prescribed ones at the same step as before.
#include "body.h"

#include <chrono>
#include <thread>

namespace {

const int size[3] = {24, 24, 24};
const double box[3] = {0.12, 0.12, 0.12};

void prepare(Body &body, pliant_method method)
{
    body.cells(6, 6, 6, 2);
    body.scene.model.method = method;
    body.scene.model.patch = method == PLIANT_FINE ? 0 : 0.02;
    body.scene.model.patch_delay = 1;
    body.scene.solver.backend = PLIANT_CPU;
    body.scene.solver.iterations = 3;
    body.scene.solver.tolerance = 1e-8;
    body.scene.solver.refresh_interval = 1;
    body.scene.solver.refresh_delay = 1;
    body.fix_plane(0, 0, 0.001, 0, 0, 1);
}

struct Pulled {
    std::vector<uint32_t> taken;
    std::vector<double> positions;
};

// Pull with a tool, release and grasp again; wait for a patch if there is one.
// pause: random sleep between steps, so that results arrive at varying steps
Pulled pull(Body &body, int steps, pliant_background_kind kind, const std::vector<uint32_t> *prescribed, int pause)
{
    Pulled out;
    int tool;
    const double point[3] = {0.06, 0.06, 0.11};
    EXPECT_EQ(pliant_tool_add(body.model, body.data, "t", &tool), PLIANT_OK);
    EXPECT_EQ(pliant_tool_set_pose(body.data, tool, point, nullptr), PLIANT_OK);
    EXPECT_EQ(pliant_tool_grasp(body.model, body.data, tool, point), PLIANT_OK) << pliant_last_error();
    uint32_t all = 0;
    for (int s = 0; s < steps && out.taken.size() < 300;) {
        const double tip[3] = {0.06 + 0.01 * s / steps, 0.06, 0.11 + 0.02 * s / steps},
                     force[3] = {1.0 * s / steps, 0, 2.0 * s / steps};
        EXPECT_EQ(pliant_tool_set_pose(body.data, tool, tip, nullptr), PLIANT_OK);
        EXPECT_EQ(
            pliant_tool_set_drive(body.data, tool, s < steps / 3 ? PLIANT_DRIVE_FORCE : PLIANT_DRIVE_RIGID, force),
            PLIANT_OK);
        if (s == steps / 2) pliant_tool_release(body.data, tool);
        if (s == steps / 2 + 3)
            EXPECT_EQ(pliant_tool_grasp(body.model, body.data, tool, point), PLIANT_OK) << pliant_last_error();
        EXPECT_EQ(pliant_data_set_background(body.data, kind, prescribed ? prescribed->at(out.taken.size()) : 0),
                  PLIANT_OK)
            << pliant_last_error();
        EXPECT_GE(pliant_step(body.model, body.data), 0) << pliant_last_error();
        out.taken.push_back(pliant_data_get_background_taken(body.data));
        all |= out.taken.back();
        out.positions.insert(out.positions.end(), body.data->positions,
                             body.data->positions + 3 * body.data->body->fine.num_nodes);
        if (pause > 0) std::this_thread::sleep_for(std::chrono::milliseconds(s * pause % 7));
        // on a busy machine, wait until the tested result arrives
        const bool waits_for_patch = s == steps / 4 && body.data->patch && !(all & PLIANT_RESULT_PATCH);
        const bool waits_for_factor =
                       s == steps - 1 && kind != PLIANT_BACKGROUND_PLANNED && !(all & PLIANT_RESULT_FACTOR),
                   waits = waits_for_patch || waits_for_factor;
        if (waits_for_factor) body.data->solver->rules.rate = 1; // request a factor; a resting tool would not need one
        if (waits && pause > 0) std::this_thread::sleep_for(std::chrono::milliseconds(20));
        s += !waits;
    }
    return out;
}

TEST(Background, ALivePullIsRepeatedBitForBit)
{
    for (pliant_method method : {PLIANT_FINE, PLIANT_AVERAGED}) {
        SCOPED_TRACE(method);
        const int steps = 60;
        uint32_t all = 0;
        Body live(size, box, {{5000, 0.45, 1000, false}, {60000, 0.45, 1000, false}},
                  [](int i, int, int) { return i / 6 % 2; });
        Body again(size, box, {{5000, 0.45, 1000, false}, {60000, 0.45, 1000, false}},
                   [](int i, int, int) { return i / 6 % 2; });
        for (Body *body : {&live, &again}) {
            prepare(*body, method);
            ASSERT_EQ(body->build(), PLIANT_OK) << pliant_last_error();
        }
        const Pulled first = pull(live, steps, PLIANT_BACKGROUND_LIVE, nullptr, 5);
        const Pulled second = pull(again, steps, PLIANT_BACKGROUND_PRESCRIBED, &first.taken, 0);
        for (uint32_t taken : first.taken) all |= taken;
        EXPECT_EQ(second.taken, first.taken);
        EXPECT_TRUE(second.positions == first.positions);
        EXPECT_TRUE(all & PLIANT_RESULT_FACTOR);
        if (method == PLIANT_AVERAGED) EXPECT_TRUE(all & PLIANT_RESULT_PATCH);
    }
}

// The factorization takes much longer than a step. Live steps do not wait for it although it is due after one step; a
// planned step does.
TEST(Background, LiveNoStepWaits)
{
    Body body(size, box, {{5000, 0.45, 1000, false}});
    prepare(body, PLIANT_FINE);
    body.cells(8, 8, 8, 2);
    body.scene.solver.iterations = 1;
    body.scene.solver.preconditioner = PLIANT_DIRECT;
    for (pliant_background_kind kind : {PLIANT_BACKGROUND_PLANNED, PLIANT_BACKGROUND_LIVE}) {
        SCOPED_TRACE(kind);
        ASSERT_EQ(body.build(), PLIANT_OK);
        int tool, without = 0, longest = 0;
        const double point[3] = {0.06, 0.06, 0.11};
        const bool live = kind == PLIANT_BACKGROUND_LIVE;
        ASSERT_EQ(pliant_tool_add(body.model, body.data, "t", &tool), PLIANT_OK);
        ASSERT_EQ(pliant_tool_set_pose(body.data, tool, point, nullptr), PLIANT_OK);
        ASSERT_EQ(pliant_tool_grasp(body.model, body.data, tool, point), PLIANT_OK) << pliant_last_error();
        for (int s = 0; s < (live ? 300 : 8) && longest < 5; s++) {
            const double tip[3] = {0.06, 0.06, 0.11 + 0.01 * std::sin(0.1 * s)};
            body.data->solver->rules.rate = 1; // request a factor explicitly, so that its start is known
            ASSERT_EQ(pliant_tool_set_pose(body.data, tool, tip, nullptr), PLIANT_OK);
            ASSERT_EQ(pliant_data_set_background(body.data, kind, 0), PLIANT_OK) << pliant_last_error();
            ASSERT_GE(pliant_step(body.model, body.data), 0) << pliant_last_error();
            without = pliant_data_get_background_taken(body.data) ? 0 : without + 1;
            longest = std::max(longest, without);
        }
        if (live) EXPECT_GE(longest, 5);
        else EXPECT_LE(longest, 3);
    }
}

// A factor installed under a spring includes the tool's response. It equals the response that the step would compute.
// The step after the installation takes it from the background thread.
TEST(Background, AFactorBringsTheResponsesOfSprings)
{
    Body body(size, box, {{5000, 0.45, 1000, false}, {60000, 0.45, 1000, false}},
              [](int i, int, int) { return i / 6 % 2; });
    prepare(body, PLIANT_FINE);
    ASSERT_EQ(body.build(), PLIANT_OK) << pliant_last_error();
    int tool, brought = 0;
    const double point[3] = {0.06, 0.06, 0.11};
    ASSERT_EQ(pliant_tool_add(body.model, body.data, "t", &tool), PLIANT_OK);
    ASSERT_EQ(pliant_tool_set_pose(body.data, tool, point, nullptr), PLIANT_OK);
    ASSERT_EQ(pliant_tool_grasp(body.model, body.data, tool, point), PLIANT_OK) << pliant_last_error();
    pliant_solver *solver = body.data->solver;
    pliant_grasp_constraint *handle = solver->grasps + tool;
    for (int s = 0; s < 30; s++) {
        const double tip[3] = {0.06, 0.06 + 0.0005 * s, 0.11 + 0.001 * s};
        ASSERT_EQ(pliant_tool_set_pose(body.data, tool, tip, nullptr), PLIANT_OK);
        ASSERT_EQ(pliant_data_set_background(body.data, PLIANT_BACKGROUND_LIVE, 0), PLIANT_OK);
        ASSERT_GE(pliant_step(body.model, body.data), 0) << pliant_last_error();
        while (pliant_refresh_is_busy(solver)) std::this_thread::sleep_for(std::chrono::milliseconds(1));
        pliant_statistics statistics = body.data->statistics;
        const uint64_t factors = solver->factors;
        statistics.step++; // as at the beginning of the next step
        ASSERT_EQ(pliant_refresh_step(solver, &statistics), PLIANT_OK) << pliant_last_error();
        if (solver->factors == factors) continue;
        brought++;
        ASSERT_EQ(handle->response_number, solver->in_use.number);
        const std::vector<double> response(handle->response, handle->response + 3 * pliant_solver_unknowns(solver));
        handle->response_number = 0;
        ASSERT_EQ(pliant_solver_find_responses(solver), PLIANT_OK);
        EXPECT_TRUE(std::equal(response.begin(), response.end(), handle->response));
    }
    EXPECT_GT(brought, 2);
}

// After a series of short steps, a live step is at most twice as long. The next step does the remaining work. Sudden
// loads are excluded. A planned step ends when it has converged.
TEST(Background, NoLiveStepIsFarLongerThanTheOthers)
{
    const int first = pliant_get_quasistatic_settings().limit_first_steps, EASY = 2 * first, TIGHT = EASY + 8,
              SUDDEN = TIGHT + 1;
    for (pliant_background_kind kind : {PLIANT_BACKGROUND_PLANNED, PLIANT_BACKGROUND_LIVE}) {
        SCOPED_TRACE(kind);
        Body body(size, box, {{5000, 0.45, 1000, false}});
        prepare(body, PLIANT_FINE);
        body.scene.solver.refresh_interval = 0;
        ASSERT_EQ(body.build(), PLIANT_OK) << pliant_last_error();
        int easy = 0, tight = 0, sudden = 0;
        for (int s = 0; s < SUDDEN; s++) {
            const double angle = 0.01 * s, gravity[3] = {s < TIGHT ? 9.81 * std::sin(angle) : -9.81,
                                                         s < TIGHT ? 9.81 * std::cos(angle) : 0, 0};
            ASSERT_EQ(pliant_data_set_gravity(body.data, gravity), PLIANT_OK);
            ASSERT_EQ(pliant_data_set_background(body.data, kind, 0), PLIANT_OK) << pliant_last_error();
            ASSERT_EQ(pliant_data_set_limits(body.data, 20, s < EASY ? 1e-3 : 1e-9), PLIANT_OK);
            ASSERT_GE(pliant_step(body.model, body.data), 0) << pliant_last_error();
            int &maximum = s < EASY ? easy : s < TIGHT ? tight : sudden;
            if (s >= first) maximum = std::max(maximum, body.data->statistics.iterations);
        }
        if (kind == PLIANT_BACKGROUND_LIVE) EXPECT_LE(tight, 2 * easy);
        else EXPECT_GT(tight, 2 * easy);
        EXPECT_GT(sudden, 2 * easy);
    }
}

TEST(Background, UnknownBackgroundResultsAreRefused)
{
    Body body(size, box, {{5000, 0.45, 1000, false}});
    prepare(body, PLIANT_FINE);
    ASSERT_EQ(body.build(), PLIANT_OK);
    EXPECT_EQ(pliant_data_set_background(body.data, PLIANT_BACKGROUND_LIVE, PLIANT_RESULT_FACTOR),
              PLIANT_ERROR_ARGUMENT);
    EXPECT_EQ(pliant_data_set_background(body.data, PLIANT_BACKGROUND_PRESCRIBED, 1u << 20), PLIANT_ERROR_ARGUMENT);
    EXPECT_EQ(pliant_data_set_background(body.data, pliant_background_kind(7), 0), PLIANT_ERROR_ARGUMENT);
    EXPECT_EQ(pliant_data_set_background(body.data, PLIANT_BACKGROUND_PRESCRIBED, PLIANT_RESULT_FACTOR), PLIANT_OK);
    std::string logged;
    pliant_set_log(
        [](pliant_log_level, const char *message, void *user) { *static_cast<std::string *>(user) += message; },
        &logged);
    EXPECT_GE(pliant_step(body.model, body.data), 0);
    pliant_set_log(nullptr, nullptr);
    EXPECT_NE(logged.find("background results (pliant_data_set_background"), std::string::npos) << logged;
}

} // namespace
