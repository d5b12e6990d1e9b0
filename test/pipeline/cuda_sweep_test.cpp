// Fast tools on the GPU against the CPU: sweeps, jumps, and turns. Skipped without a GPU.
#include "cuda_contacts.h"
#include "sheet.h"

#include <cstdio>

namespace {

using namespace cuda_contacts;

// A rod of 1 mm at 1 m/s (20 mm per step) pushes a sheet of 4 mm, without exceeding the maximum number of evaluations
// per step. With a V-cycle, elements are half as wide.
TEST(CudaSweep, AThinRodAtOneMetreASecondCarriesASheetAlong)
{
    NEEDS_GPU();
    struct Run {
        pliant_backend_choice backend;
        pliant_preconditioner_choice preconditioner;
        int finer;
        std::vector<double> at;
    };
    const int iterations = 30;
    for (const Run &run : {Run{PLIANT_CPU, PLIANT_DIRECT, 1, {0.0275, 0.0297, 0.0319}},
                           Run{PLIANT_CUDA, PLIANT_DIRECT, 1, {0.0275, 0.0297, 0.0319}},
                           Run{PLIANT_CUDA, PLIANT_MULTIGRID, 2, {0.0275}}}) {
        int maximum = 0;
        for (const double x : run.at) {
            SCOPED_TRACE(x);
            RodSheet sheet(run.backend, run.preconditioner, run.finer, iterations);
            ASSERT_EQ(sheet.begin(), PLIANT_OK) << pliant_last_error();
            for (int s = 0; s < 6; s++) {
                ASSERT_GE(sheet.step(s, x), 0) << pliant_last_error();
                maximum = std::max(maximum, static_cast<int>(sheet.data->statistics.iterations));
            }
            const double carried =
                farthest(sheet.data->positions, sheet.model->body->fine.rest, sheet.model->body->fine.num_nodes);
            std::printf("%s, at %g: carried by %.2f mm, up to %d evaluations in a step\n",
                        pliant_data_get_backend(sheet.data), x, 1e3 * carried, maximum);
            EXPECT_STREQ(pliant_data_get_backend(sheet.data), run.backend == PLIANT_CPU ? "cpu" : "cuda")
                << pliant_last_error();
            EXPECT_GT(carried, 0.024);
        }
        EXPECT_LE(maximum, iterations);
    }
}

// Same next to a detached piece, and while a patch serves a ball that presses a corner. The host does its part of the
// step before contact detection.
TEST(CudaSweep, AThinRodCarriesASheetAlongBesideAPieceAndAPatch)
{
    for (pliant_backend_choice backend : {PLIANT_CPU, PLIANT_CUDA})
        for (const bool patch : {false, true}) {
            if (backend == PLIANT_CUDA && !there_is_a_gpu()) continue;
            SCOPED_TRACE(patch ? "a patch" : "a piece");
            RodSheet sheet(backend, PLIANT_DIRECT, 1, 30);
            sheet.expect(patch);
            ASSERT_EQ(sheet.begin(), PLIANT_OK) << pliant_last_error();
            ASSERT_NO_FATAL_FAILURE(patch ? sheet.press_a_corner() : sheet.cut_off());
            int served = 0;
            for (int s = 0; s < 6; s++) {
                ASSERT_GE(sheet.step(s, 0.0319), 0) << pliant_last_error();
                served += s > 0 && sheet.data->statistics.patched > 0;
            }
            const double carried = sheet.carried();
            std::printf("%s, beside a %s: carried by %.2f mm\n", pliant_data_get_backend(sheet.data),
                        patch ? "patch" : "piece", 1e3 * carried);
            EXPECT_STREQ(pliant_data_get_backend(sheet.data), backend == PLIANT_CPU ? "cpu" : "cuda")
                << pliant_last_error();
            EXPECT_EQ(sheet.data->rigid_pieces != nullptr, !patch);
            EXPECT_EQ(served > 0, patch);
            EXPECT_GT(carried, 0.024);
        }
}

// A sweep pushes the sheet with any budget; remaining motion is left to the next step. The simulated clock stands
// still, so that no budget ends a step.
TEST(CudaSweep, ASweepIsCarriedAlongWithAnyBudget)
{
    for (pliant_backend_choice backend : {PLIANT_CPU, PLIANT_CUDA}) {
        if (backend == PLIANT_CUDA && !there_is_a_gpu()) continue;
        double carried[2] = {0, 0};
        for (bool enough : {false, true}) {
            RodSheet sheet(backend, PLIANT_DIRECT, 1, 30);
            sheet.scene.solver.budget_ms = enough ? 1e6 : 1e-6;
            sheet.scene.solver.refresh_interval = 0;
            ASSERT_EQ(sheet.begin(), PLIANT_OK) << pliant_last_error();
            sheet.data->clock.now = [](void *) { return 0.0; };
            for (int s = 0; s < 6; s++) ASSERT_GE(sheet.step(s, 0.0275), 0) << pliant_last_error();
            EXPECT_STREQ(pliant_data_get_backend(sheet.data), backend == PLIANT_CPU ? "cpu" : "cuda")
                << pliant_last_error();
            carried[enough] =
                farthest(sheet.data->positions, sheet.model->body->fine.rest, sheet.model->body->fine.num_nodes);
        }
        std::printf("%s: carried by %.2f mm with the least budget, by %.2f mm with the largest\n",
                    backend == PLIANT_CPU ? "CPU" : "GPU", 1e3 * carried[0], 1e3 * carried[1]);
        EXPECT_GT(carried[0], 0.024);
        EXPECT_GT(carried[1], 0.024);
    }
}

// A tool that jumps skips the tissue in between. Other tools are followed as if it did not exist, however it rotates.
TEST(CudaSweep, AJumpOfOneToolDoesNotAffectOthers)
{
    NEEDS_GPU();
    std::vector<double> ended[2];
    for (int run = 0; run < 2; run++) {
        RodSheet sheet(PLIANT_CUDA, PLIANT_DIRECT, 1, 30);
        ASSERT_EQ(sheet.begin(), PLIANT_OK) << pliant_last_error();
        int arm = -1;
        if (run > 0) ASSERT_EQ(pliant_tool_add(sheet.model, sheet.data, "arm", &arm), PLIANT_OK);
        for (int s = 0; s < 6; s++) {
            const double half = 0.75 * std::min(s, 1), rotation[4] = {0, std::sin(half), 0, std::cos(half)},
                         tip[3] = {0.03 + 0.06 * std::min(s, 1), 0.03, 0.3};
            if (run > 0) ASSERT_EQ(pliant_tool_set_pose(sheet.data, arm, tip, rotation), PLIANT_OK);
            ASSERT_GE(sheet.step(s, 0.0297), 0) << pliant_last_error();
        }
        EXPECT_STREQ(pliant_data_get_backend(sheet.data), "cuda") << pliant_last_error();
        EXPECT_GT(farthest(sheet.data->positions, sheet.model->body->fine.rest, sheet.model->body->fine.num_nodes),
                  0.02);
        ended[run].assign(sheet.data->positions, sheet.data->positions + 3 * sheet.model->body->fine.num_nodes);
    }
    EXPECT_EQ(ended[0], ended[1]);
}

// A rod rotates about its end from above the sheet into it, by more than one step can follow. The second part begins
// where the first one has ended.
TEST(CudaSweep, ATurnOfMoreThanOneRadianIsTakenInParts)
{
    for (pliant_backend_choice backend : {PLIANT_CPU, PLIANT_CUDA}) {
        if (backend == PLIANT_CUDA && !there_is_a_gpu()) continue;
        RodSheet sheet(backend, PLIANT_DIRECT, 1, 30);
        int tool = -1;
        pliant_tool_shape rod{};
        rod.num_parts = 1;
        rod.part[0] = {PLIANT_PART_CAPSULE, PLIANT_FRAME_TIP, {0, 0, 0}, {0.02, 0, 0}, 0.001, false};
        ASSERT_EQ(sheet.build(), PLIANT_OK) << pliant_last_error();
        ASSERT_EQ(pliant_tool_add(sheet.model, sheet.data, "rod", &tool), PLIANT_OK);
        ASSERT_EQ(pliant_tool_set_shape(sheet.data, tool, &rod), PLIANT_OK) << pliant_last_error();
        for (int s = 0; s < 6; s++) {
            const double half = 0.5 * (s == 0 ? -0.5 : 1.5), rotation[4] = {0, std::sin(half), 0, std::cos(half)},
                         tip[3] = {0.027, 0.031, 0.011};
            ASSERT_EQ(pliant_tool_set_pose(sheet.data, tool, tip, rotation), PLIANT_OK);
            ASSERT_GE(pliant_step(sheet.model, sheet.data), 0) << pliant_last_error();
            if (s == 1) EXPECT_GE(sheet.data->statistics.legs, 2);
        }
        const double carried =
            farthest(sheet.data->positions, sheet.model->body->fine.rest, sheet.model->body->fine.num_nodes);
        std::printf("%s: carried by %.2f mm\n", pliant_data_get_backend(sheet.data), 1e3 * carried);
        EXPECT_STREQ(pliant_data_get_backend(sheet.data), backend == PLIANT_CPU ? "cpu" : "cuda")
            << pliant_last_error();
        EXPECT_GT(carried, 0.008);
    }
}

} // namespace
