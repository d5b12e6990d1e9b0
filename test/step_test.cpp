// Failures of a step: the resulting state, and whether the backend is replaced.
#include "pipeline/body.h"

#include "backend/backend.h"
#include "model_data/data.h"
#include "base/memory.h"

namespace {

const int size[3] = {6, 6, 6};
const double box[3] = {0.12, 0.12, 0.12}, top[3] = {0.05, 0.06, 0.11};

// A backend with its own state, like a GPU.
bool lost;
pliant_backend other()
{
    pliant_backend backend = pliant_cpu_backend;
    backend.name = "other";
    backend.state_is_on_host = false;
    backend.free = [](pliant_data *) {};
    backend.solve = [](const pliant_model *model, pliant_data *data) {
        return lost ? PLIANT_ERROR_UNAVAILABLE : pliant_cpu_backend.solve(model, data);
    };
    return backend;
}

struct Step : testing::Test {
    Body body{size, box, {{4000, 0.45, 1000, false}}};
    const pliant_backend backend = other();
    int tool = -1;

    void SetUp() override
    {
        body.fix_plane(0, 0, 0, 0, 0, 1);
        body.cells(3, 3, 3, 1);
        ASSERT_EQ(body.build(), PLIANT_OK) << pliant_last_error();
        body.data->backend = &backend;
        lost = false;
        ASSERT_EQ(pliant_step(body.model, body.data), PLIANT_OK);
        ASSERT_EQ(pliant_tool_add(body.model, body.data, "tool", &tool), PLIANT_OK);
        ASSERT_EQ(pliant_tool_grasp(body.model, body.data, tool, top), PLIANT_OK) << pliant_last_error();
        ASSERT_EQ(pliant_tool_set_drive(body.data, tool, PLIANT_DRIVE_RIGID, nullptr), PLIANT_OK);
        const double tip[3] = {top[0], top[1], top[2] + 0.01};
        ASSERT_EQ(pliant_tool_set_pose(body.data, tool, tip, nullptr), PLIANT_OK);
    }
    void TearDown() override { pliant_memory_fail_after(-1); }
};

// The grasp constraint of a tool is on the host. Without memory for it the step fails, but the backend stays.
TEST_F(Step, OutOfMemoryForAGraspKeepsTheBackend)
{
    const uint64_t before = body.data->statistics.step;
    pliant_memory_fail_after(0);
    EXPECT_EQ(pliant_step(body.model, body.data), PLIANT_ERROR_MEMORY);
    pliant_memory_fail_after(-1);
    EXPECT_STREQ(pliant_data_get_backend(body.data), "other");
    EXPECT_EQ(body.data->statistics.step, before);
    EXPECT_EQ(body.data->statistics.failed, 1u);
    EXPECT_EQ(body.settle(), PLIANT_OK) << pliant_last_error();
    EXPECT_STREQ(pliant_data_get_backend(body.data), "other");
    EXPECT_GT(body.data->tools[tool].force[2], 0.01);
}

TEST_F(Step, TheCpuContinuesAfterALostBackend)
{
    lost = true;
    EXPECT_GE(pliant_step(body.model, body.data), 0) << pliant_last_error();
    EXPECT_STREQ(pliant_data_get_backend(body.data), "cpu");
    EXPECT_EQ(body.settle(), PLIANT_OK) << pliant_last_error();
    EXPECT_GT(body.data->tools[tool].force[2], 0.01);
}

// If drawing fails after a dynamic step, the step is not run a second time.
TEST(StepOfDynamics, AFailedPictureIsNoSecondFrame)
{
    static bool fails;
    pliant_backend backend = pliant_tled_backend;
    backend.state_is_on_host = false;
    backend.solves_on_host = true;
    backend.free = [](pliant_data *) {};
    backend.warp = [](const pliant_model *, pliant_data *) { return fails ? PLIANT_ERROR_UNAVAILABLE : PLIANT_OK; };
    std::vector<double> ends[2];
    for (int failing = 0; failing < 2; failing++) {
        Body body(size, box, {{4000, 0.45, 1000, false}});
        body.fix_plane(0, 0, 0, 0, 0, 1);
        body.cells(3, 3, 3, 1);
        body.scene.solver.kind = PLIANT_TLED;
        body.scene.model.gravity[1] = 9.81;
        ASSERT_EQ(body.build(), PLIANT_OK) << pliant_last_error();
        body.data->backend = &backend;
        for (int s = 0; s < 4; s++) {
            fails = failing && s == 2;
            ASSERT_EQ(pliant_step(body.model, body.data), PLIANT_OK) << pliant_last_error();
        }
        EXPECT_EQ(body.data->backend == &backend, !failing);
        ends[failing] = {body.data->positions, body.data->positions + 3 * body.model->body->fine.num_nodes};
    }
    EXPECT_EQ(ends[0], ends[1]);
}

// For any failing allocation, the step either ends normally, or it restores the state and the next step continues.
TEST(StepWithoutMemory, LeavesTheStateBeforeOrAfterTheStep)
{
    int failed = 0;
    for (pliant_solver_kind kind : {PLIANT_COROTATIONAL, PLIANT_TLED})
        for (pliant_warp_kind warp : {PLIANT_RASTERIZE, PLIANT_FIT})
            for (double patch : {0.0, 0.05}) {
                if (patch > 0 && (kind == PLIANT_TLED || warp == PLIANT_FIT)) continue;
                for (int64_t calls = 0; calls < 25; calls++) {
                    Body body(size, box, {{4000, 0.45, 1000, false}});
                    body.fix_plane(0, 0, 0, 0, 0, 1);
                    body.cells(3, 3, 3, patch > 0 ? 2 : 1);
                    body.scene.solver.kind = kind;
                    body.scene.warp.kind = warp;
                    body.scene.model.gravity[1] = 9.81;
                    if (patch > 0) {
                        body.scene.model.method = PLIANT_AVERAGED;
                        body.scene.model.patch = patch;
                        body.scene.model.patch_delay = 1;
                    }
                    ASSERT_EQ(body.build(), PLIANT_OK) << pliant_last_error();
                    ASSERT_EQ(pliant_data_set_warp(body.model, body.data, &body.scan.geometry), PLIANT_OK);
                    int tool;
                    const double tip[3] = {top[0], top[1], top[2] + 0.004};
                    ASSERT_EQ(pliant_tool_add(body.model, body.data, "tool", &tool), PLIANT_OK);
                    ASSERT_EQ(pliant_tool_grasp(body.model, body.data, tool, top), PLIANT_OK) << pliant_last_error();
                    ASSERT_EQ(pliant_tool_set_drive(body.data, tool, PLIANT_DRIVE_RIGID, nullptr), PLIANT_OK);
                    ASSERT_EQ(pliant_tool_set_pose(body.data, tool, tip, nullptr), PLIANT_OK);
                    for (int s = 0; s < 2; s++) {
                        const size_t count = 3 * size_t(body.data->body->fine.num_nodes);
                        const std::vector<double> before(body.data->positions, body.data->positions + count);
                        const uint64_t steps = body.data->statistics.step;
                        pliant_memory_fail_after(calls);
                        pliant_status status = pliant_step(body.model, body.data);
                        pliant_memory_fail_after(-1);
                        const std::vector<double> after(body.data->positions, body.data->positions + count);
                        if (status < 0) {
                            failed++;
                            EXPECT_EQ(status, PLIANT_ERROR_MEMORY);
                            EXPECT_EQ(before, after)
                                << kind << warp << patch << ": " << calls << " " << pliant_last_error();
                            EXPECT_EQ(body.data->statistics.step, steps);
                        } else {
                            EXPECT_EQ(body.data->statistics.step, steps + 1);
                        }
                        EXPECT_GE(pliant_step(body.model, body.data), 0) << pliant_last_error();
                    }
                }
            }
    EXPECT_GT(failed, 3);
}

} // namespace
