// Every call of the CUDA runtime fails once, as on a lost device. The run continues, on the CPU if necessary, to the
// same result, and logs this once. Skipped without a GPU.
#include "cuda_bodies.h"
#include "cuda_contacts.h"
#include "cuda_warps.h"
#include "base/memory.h"

#include <string>

namespace {

// Log messages about a GPU that a simulation no longer uses.
struct GpuLossLog {
    int count = 0;
    std::string last;
    GpuLossLog()
    {
        pliant_set_log([](pliant_log_level level, const char *message, void *user) {
            GpuLossLog *log = static_cast<GpuLossLog *>(user);
            if (level < PLIANT_LOG_INFO || !std::strstr(message, "backend: ") || std::strstr(message, "backend: cuda"))
                return;
            log->count++;
            log->last = message;
        }, this);
    }
    ~GpuLossLog() { pliant_set_log(nullptr, nullptr); }
};

bool is_on_cpu(const Body &body) { return std::strcmp(pliant_data_get_backend(body.data), "cpu") == 0; }

bool draws_same_as_cpu(const Body &body)
{
    pliant_warp *warp = nullptr;
    EXPECT_EQ(pliant_warp_create(&body.scan, &body.model->body->fine, &body.scan.geometry, 2, &warp), PLIANT_OK);
    EXPECT_EQ(pliant_warp_set_body(warp, body.data->body), PLIANT_OK) << pliant_last_error();
    EXPECT_EQ(pliant_warp_update(warp, body.data->positions), PLIANT_OK);
    const size_t voxels = pliant_geometry_voxels(&body.scan.geometry);
    const bool same =
        std::memcmp(pliant_warp_volume(warp)->voxels, pliant_warp_volume(body.data->warp)->voxels, voxels) == 0;
    pliant_warp_free(warp);
    return same;
}

void drop_data(Body &body)
{
    pliant_data_free(body.data);
    body.data = nullptr;
}

// Among many similar later calls, only some fail.
int64_t next_failing_call(int64_t call, int stride) { return call + stride + call / 40; }

/* ---- whole runs; patch: radius, or 0 */

void fail_every_call(const Case &c, double patch, int stride)
{
    const int steps = 3;
    Body good(size, box, materials_of(c), inclusions), body(size, box, materials_of(c), inclusions);
    for (Body *each : {&good, &body}) {
        prepare(*each, c, each == &good ? PLIANT_CPU : PLIANT_AUTO);
        each->cells(2, 2, 2, 2);
        each->scene.model.patch = patch;
        each->scene.model.patch_delay = 1;
    }
    ASSERT_EQ(good.build(), PLIANT_OK);
    for (int s = 1; s <= steps; s++) step(good, c, s, steps);
    ASSERT_EQ(good.data->statistics.patched, patch > 0);
    ASSERT_EQ(body.build(), PLIANT_OK);
    drop_data(body);
    GpuLossLog log;
    int given_up = 0;
    for (int64_t calls = 0, left = -1; left < 0; calls = next_failing_call(calls, stride)) {
        ASSERT_LT(calls, 5000);
        SCOPED_TRACE(calls);
        log.count = 0;
        pliant_cuda_fail_after(calls);
        ASSERT_EQ(pliant_data_create(body.model, &body.data), PLIANT_OK) << pliant_last_error();
        ASSERT_EQ(pliant_data_set_warp(body.model, body.data, &body.scan.geometry), PLIANT_OK);
        for (int s = 1; s <= steps; s++) step(body, c, s, steps);
        pliant_warp_volume(body.data->warp);
        left = pliant_cuda_fail_after(-1);
        ASSERT_LT(farthest(good, body), 1e-5 * box[0]);
        EXPECT_EQ(log.count, is_on_cpu(body)) << log.last;
        given_up += is_on_cpu(body) || !pliant_warp_accelerated(body.data->warp);
        if (left >= 0)
            EXPECT_TRUE(!is_on_cpu(body) && pliant_warp_accelerated(body.data->warp) && draws_same_as_cpu(body))
                << log.last;
        drop_data(body);
    }
    EXPECT_GT(given_up, 30 / stride);
    ::testing::Test::RecordProperty("given_up", std::to_string(given_up).c_str());
}

TEST(CudaFailure, TheCpuContinues)
{
    NEEDS_GPU();
    fail_every_call({PLIANT_FINE, PLIANT_DRIVE_SPRING, 0, 0, 1, PLIANT_DIRECT}, 0, 1);
}

TEST(CudaFailure, TheCpuContinuesWithPressures)
{
    NEEDS_GPU();
    fail_every_call({PLIANT_FINE, PLIANT_DRIVE_SPRING, 2, 0, 1, PLIANT_DIRECT, PLIANT_HEXAHEDRA,
                     PLIANT_ELASTICITY_COROTATIONAL, 0.4999},
                    0, 3);
}

TEST(CudaFailure, TheCpuContinuesWithPatches)
{
    NEEDS_GPU();
    fail_every_call({PLIANT_AVERAGED, PLIANT_DRIVE_SPRING, 0, 0, 1, PLIANT_DIRECT}, 0.03, 3);
}

/* ---- during a cut, its background work, and its undo */

const double bar_box[3] = {0.06, 0.06, 0.12};
enum { CUT = 2, UNDO = 7, STEPS = 9 };

// A bar of 16 cubes, or two coarse ones.
struct Bar : Body {
    Bar(pliant_method method, pliant_preconditioner_choice preconditioner, double poisson,
        pliant_backend_choice backend)
        : Body(std::vector<int>{8, 8, 16}.data(), bar_box, {{20000, poisson, 1000, false}, {60000, 0.4, 1100, false}},
               [](int i, int, int k) { return i < 4 && k > 5; })
    {
        const int ratio = method == PLIANT_FINE ? 1 : 2;
        scene.solver.backend = backend;
        scene.solver.preconditioner = preconditioner;
        scene.solver.tolerance = 1e-8;
        scene.solver.refresh_delay = 1;
        scene.model.method = method;
        scene.model.gravity[0] = 1;
        scene.cut.kind = PLIANT_CUT_SEVER;
        cells(2 / ratio, 2 / ratio, 4 / ratio, ratio);
        fix_plane(0, 0, 0.001, 0, 0, 1);
    }
    void step(int s)
    {
        int tool;
        const double from[3] = {0.03, 0.03, 0.11}, tip[3] = {from[0] + 0.0005 * s, from[1], from[2] + 0.00025 * s};
        // a deeper cut has no unique solution after the undo
        const double edge[6] = {-0.02, -0.01, 0.043, 0.08, -0.01, 0.047}, depth[3] = {0, 0.035, 0.002};
        ASSERT_EQ(pliant_tool_add(model, data, "t", &tool), PLIANT_OK);
        if (s == 0) {
            ASSERT_EQ(pliant_tool_set_pose(data, tool, from, nullptr), PLIANT_OK);
            ASSERT_EQ(pliant_tool_grasp(model, data, tool, nullptr), PLIANT_OK) << pliant_last_error();
        }
        if (s == CUT)
            ASSERT_EQ(pliant_data_cut(model, data, 2, edge, depth, nullptr), PLIANT_OK) << pliant_last_error();
        if (s == UNDO) ASSERT_EQ(pliant_data_undo_cut(model, data), PLIANT_OK) << pliant_last_error();
        ASSERT_EQ(pliant_tool_set_pose(data, tool, tip, nullptr), PLIANT_OK);
        ASSERT_GE(pliant_step(model, data), 0) << pliant_last_error();
    }
};

TEST(CudaFailure, FailureDuringACut)
{
    NEEDS_GPU();
    struct { pliant_method method; pliant_preconditioner_choice preconditioner; int stride; double poisson; } runs[] = {
        {PLIANT_FINE, PLIANT_DIRECT, 1, 0.4},
        {PLIANT_FINE, PLIANT_MULTIGRID, 7, 0.4},
        {PLIANT_AVERAGED, PLIANT_DIRECT, 5, 0.4},
        {PLIANT_FINE, PLIANT_DIRECT, 7, 0.499}};
    for (const auto &run : runs) {
        SCOPED_TRACE(std::to_string(run.method) + " " + std::to_string(run.preconditioner) + " " +
                     std::to_string(run.poisson));
        Bar good(run.method, run.preconditioner, run.poisson, PLIANT_CPU),
            body(run.method, run.preconditioner, run.poisson, PLIANT_AUTO);
        std::vector<double> there[STEPS];
        ASSERT_EQ(good.build(), PLIANT_OK) << pliant_last_error();
        for (int s = 0; s < STEPS; s++) {
            good.step(s);
            there[s].assign(good.data->positions, good.data->positions + 3 * good.data->body->fine.num_nodes);
        }
        ASSERT_GT(there[CUT].size(), there[0].size());
        ASSERT_EQ(body.build(), PLIANT_OK) << pliant_last_error();
        drop_data(body);
        GpuLossLog log;
        int given_up = 0;
        for (int64_t calls = 0, left = -1; left < 0; calls = next_failing_call(calls, run.stride)) {
            ASSERT_LT(calls, 10000);
            SCOPED_TRACE(calls);
            ASSERT_EQ(pliant_data_create(body.model, &body.data), PLIANT_OK) << pliant_last_error();
            ASSERT_EQ(pliant_data_set_warp(body.model, body.data, &body.scan.geometry), PLIANT_OK);
            uint64_t factors = 0;
            for (int s = 0; s < STEPS; s++) {
                if (s == CUT) {
                    ASSERT_FALSE(is_on_cpu(body)) << log.last;
                    log.count = 0;
                    pliant_cuda_fail_after(calls);
                }
                body.step(s);
                if (s == UNDO - 1) factors = body.data->statistics.factors;
                ASSERT_EQ(3 * static_cast<size_t>(body.data->body->fine.num_nodes), there[s].size());
                ASSERT_LT(farthest(there[s].data(), body.data->positions, body.data->body->fine.num_nodes),
                          1e-5 * bar_box[2])
                    << "step " << s << ": " << log.last;
            }
            left = pliant_cuda_fail_after(-1);
            EXPECT_EQ(log.count, is_on_cpu(body)) << log.last;
            EXPECT_TRUE(draws_same_as_cpu(body)) << log.last;
            given_up += is_on_cpu(body);
            if (left >= 0) { // without a failure, the background result is installed
                EXPECT_FALSE(is_on_cpu(body)) << log.last;
                EXPECT_GT(factors, 0u);
            }
            drop_data(body);
        }
        EXPECT_GT(given_up, 30 / run.stride);
    }
}

/* ---- during contact */

TEST(CudaFailure, FailureDuringContact)
{
    NEEDS_GPU();
    // without friction the solution is unique
    const cuda_contacts::Case cases[] = {
        {"inverse", PLIANT_FINE, 1, PLIANT_DIRECT, true, false, 0, PLIANT_LINEAR, 0},
        {"V-cycle", PLIANT_FINE, 1, PLIANT_MULTIGRID, false, false, 0, PLIANT_LINEAR, 0}};
    for (const cuda_contacts::Case &c : cases) {
        SCOPED_TRACE(c.name);
        cuda_contacts::Block body(c, PLIANT_AUTO, true);
        ASSERT_EQ(body.build(), PLIANT_OK) << pliant_last_error();
        body.model->without_missing_compliance = true; // it amplifies rounding
        drop_data(body);
        GpuLossLog log;
        std::vector<double> there[2]; // result of the CPU if it runs from the first call on
        // in the second step, detection of an edge is sensitive: 1e-9 m in a node's position changes the CPU's result
        // by 2e-7 m
        const double bound[2] = {1e-5 * 12 * cuda_contacts::h, 1e-4 * 12 * cuda_contacts::h};
        int given_up = 0;
        for (int64_t calls = 0, left = -1; left < 0; calls = next_failing_call(calls, c.spring ? 1 : 3)) {
            ASSERT_LT(calls, 50000);
            SCOPED_TRACE(calls);
            ASSERT_EQ(pliant_data_create(body.model, &body.data), PLIANT_OK) << pliant_last_error();
            ASSERT_EQ(body.place(), PLIANT_OK) << pliant_last_error();
            for (int s = 1; s <= 3; s++) ASSERT_GE(body.step(s), 0) << pliant_last_error();
            ASSERT_FALSE(is_on_cpu(body)) << log.last;
            log.count = 0;
            pliant_cuda_fail_after(calls);
            for (int s = 0; s < 2; s++) {
                ASSERT_GE(body.step(4 + s), 0) << pliant_last_error();
                if (calls == 0)
                    there[s].assign(body.data->positions, body.data->positions + 3 * body.data->body->fine.num_nodes);
                ASSERT_LT(farthest(there[s].data(), body.data->positions, body.data->body->fine.num_nodes), bound[s])
                    << "step " << s << ": " << log.last;
            }
            left = pliant_cuda_fail_after(-1);
            EXPECT_GT(body.data->statistics.contacts, 3);
            EXPECT_EQ(log.count, is_on_cpu(body)) << log.last;
            if (left >= 0) EXPECT_FALSE(is_on_cpu(body)) << log.last;
            given_up += is_on_cpu(body);
            drop_data(body);
        }
        EXPECT_GT(given_up, 20);
    }
}

// Steps with several legs. After a failure of any call, the CPU continues the leg. The rod pushes the sheet as in a run
// on the CPU from the first call on.
TEST(CudaFailure, FailureDuringLegsOfASweep)
{
    NEEDS_GPU();
    for (pliant_preconditioner_choice preconditioner : {PLIANT_DIRECT, PLIANT_MULTIGRID}) {
        SCOPED_TRACE(preconditioner);
        cuda_contacts::RodSheet sheet(PLIANT_AUTO, preconditioner, preconditioner == PLIANT_DIRECT ? 1 : 2, 30);
        int given_up = 0;
        ASSERT_EQ(sheet.build(), PLIANT_OK) << pliant_last_error();
        drop_data(sheet);
        GpuLossLog log;
        for (int64_t calls = 0, left = -1; left < 0; calls = next_failing_call(calls, 11)) {
            ASSERT_LT(calls, 50000);
            SCOPED_TRACE(calls);
            ASSERT_EQ(pliant_data_create(sheet.model, &sheet.data), PLIANT_OK) << pliant_last_error();
            ASSERT_EQ(sheet.place(), PLIANT_OK) << pliant_last_error();
            ASSERT_GE(sheet.step(0, 0.0275), 0) << pliant_last_error();
            log.count = 0;
            pliant_cuda_fail_after(calls);
            for (int s = 1; s < 4; s++) ASSERT_GE(sheet.step(s, 0.0275), 0) << pliant_last_error();
            left = pliant_cuda_fail_after(-1);
            for (int s = 4; s < 6; s++) ASSERT_GE(sheet.step(s, 0.0275), 0) << pliant_last_error();
            EXPECT_EQ(log.count, is_on_cpu(sheet)) << log.last;
            EXPECT_GT(sheet.data->statistics.contacts, 0);
            const int32_t nodes = sheet.data->body->fine.num_nodes;
            EXPECT_GT(farthest(sheet.data->positions, sheet.model->body->fine.rest, nodes), 0.024) << log.last;
            EXPECT_LT(farthest(sheet.data->positions, sheet.model->body->fine.rest, nodes), 0.032) << log.last;
            given_up += is_on_cpu(sheet);
            drop_data(sheet);
        }
        EXPECT_GT(given_up, 5);
    }
}

/* ---- during creation */

TEST(CudaFailure, AnExplicitlySelectedGpuIsAnError)
{
    NEEDS_GPU();
    const Case c = {PLIANT_FINE, PLIANT_DRIVE_SPRING, 0, 0, 1, PLIANT_DIRECT, PLIANT_LINEAR,
                    PLIANT_ELASTICITY_COROTATIONAL, 0.499};
    Body body(size, box, materials_of(c), inclusions);
    prepare(body, c, PLIANT_CUDA);
    pliant_cuda_fail_after(0);
    EXPECT_EQ(body.build(), PLIANT_ERROR_UNAVAILABLE);
    pliant_cuda_fail_after(-1);
    EXPECT_NE(std::string(pliant_last_error()).find("solver/backend"), std::string::npos) << pliant_last_error();
    size_t before = pliant_memory_in_use();
    for (int calls = 1; calls < 200; calls++) { // incomplete states are freed
        pliant_data *data = nullptr;
        pliant_cuda_fail_after(calls);
        if (pliant_data_create(body.model, &data) == PLIANT_OK) pliant_data_free(data);
        pliant_cuda_fail_after(-1);
        EXPECT_EQ(pliant_memory_in_use(), before) << "call " << calls;
    }
}

TEST(CudaFailure, WithoutAGpuTheReasonIsLogged)
{
    if (there_is_a_gpu()) GTEST_SKIP() << "there is a GPU";
    Body body(size, box, three, inclusions);
    const Case c = {PLIANT_FINE, PLIANT_DRIVE_SPRING, 0, 0, 1, PLIANT_DIRECT};
    prepare(body, c, PLIANT_CUDA);
    EXPECT_EQ(body.build(), PLIANT_ERROR_UNAVAILABLE);
    EXPECT_NE(std::string(pliant_last_error()).find("cuda cannot be used"), std::string::npos) << pliant_last_error();
    prepare(body, c, PLIANT_AUTO);
    ASSERT_EQ(body.build(), PLIANT_OK);
    EXPECT_STREQ(pliant_data_get_backend(body.data), "cpu");
}

} // namespace
