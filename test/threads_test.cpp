// Loops use the number of threads of the scene, which changes no bit of a model. Errors of a thread are passed on.
#include "base/threads.h"

#include "base/fail.h"
#include "pipeline/body.h"

#include <array>
#include <omp.h>
#include <set>
#include <string>

namespace {

// A failure that a thread can handle is a debug message, not an error. Missing memory is an error.
TEST(Fail, QuietlyNumericIsForDebuggingAlone)
{
    static std::vector<int> levels;
    levels.clear();
    pliant_set_log([](pliant_log_level level, const char *, void *) { levels.push_back(level); }, nullptr);
    pliant_fail_quietly(true);
    EXPECT_EQ(pliant_fail(PLIANT_ERROR_NUMERIC, "refused"), PLIANT_ERROR_NUMERIC);
    EXPECT_STREQ(pliant_last_error(), "refused");
    pliant_fail_memory("a factor");
    pliant_fail_quietly(false);
    pliant_fail(PLIANT_ERROR_NUMERIC, "refused");
    pliant_set_log(nullptr, nullptr);
    EXPECT_EQ(levels, (std::vector<int>{PLIANT_LOG_DEBUG, PLIANT_LOG_ERROR, PLIANT_LOG_ERROR}));
}

int threads_of_a_region()
{
    int count = 0;
#pragma omp parallel
#pragma omp single
    count = omp_get_num_threads();
    return count;
}

// A block with a fixed core that is not aligned with the lattice.
struct Block : Body {
    explicit Block(int threads)
        : Body(std::array<int, 3>{20, 16, 18}.data(), std::array<double, 3>{0.05, 0.04, 0.045}.data(),
               {{5e3, 0.45, 1000, false}, {2e4, 0.3, 1100, false}, {1e6, 0.3, 1500, false}},
               [](int i, int j, int k) {
                   const bool core = (i - 9) * (i - 9) + (j - 7) * (j - 7) + (k - 8) * (k - 8) < 20;
                   return core ? 2 : (i + 2 * j + 3 * k) / 7 % 2;
               })
    {
        scene.solver.threads = threads;
        table.materials[2].fixed = true;
    }
};

struct ThreadReports {
    std::set<int> threads;
    int maximum = 0; // number of reports before cancellation
};

bool record_threads(double, const char *, void *user)
{
    ThreadReports *reports = static_cast<ThreadReports *>(user);
    if (omp_get_level() == 0) reports->threads.insert(omp_get_max_threads());
    return reports->maximum-- != 0;
}

} // namespace

TEST(Threads, LoopsInBetweenHaveTheScenesNumber)
{
    pliant_scene scene;
    pliant_scene_defaults(&scene);
    const int machine = omp_get_max_threads();
    EXPECT_EQ(pliant_threads_or_cores(scene.solver.threads), machine);
    for (int wanted : {1, 3}) {
        scene.solver.threads = wanted;
        EXPECT_EQ(pliant_threads_or_cores(scene.solver.threads), wanted);
        const int before = pliant_threads_begin(scene.solver.threads);
        EXPECT_EQ(threads_of_a_region(), wanted);
        pliant_threads_end(before);
        EXPECT_EQ(omp_get_max_threads(), machine);
    }
}

TEST(Threads, AModelIsBuiltByTheScenesNumberAndIsTheSame)
{
    for (pliant_method method : {PLIANT_FINE, PLIANT_AVERAGED}) {
        for (bool octree : {false, true}) {
            if (octree && method != PLIANT_FINE) continue;
            std::vector<double> first;
            for (int threads : {1, 2, 5}) {
                Block block(threads);
                block.cells(4, 4, 4, 2);
                block.scene.model.method = method;
                block.scene.mesh.bone_surface = true;
                block.scene.mesh.kind = octree ? PLIANT_OCTREE : PLIANT_LATTICE;
                block.scene.mesh.depth = 2;
                const int before = omp_get_max_threads();
                ThreadReports reports;
                reports.maximum = -1;
                pliant_model *model = nullptr;
                ASSERT_EQ(pliant_model_build(&block.scene, &block.scan, nullptr, &block.table,
                                             {record_threads, &reports}, &model),
                          PLIANT_OK)
                    << pliant_last_error();
                EXPECT_EQ(reports.threads, std::set<int>{threads});
                EXPECT_EQ(omp_get_max_threads(), before);
                EXPECT_GT(model->body->fine.num_moved, 0);
                std::vector<double> now(model->body->fine.rest,
                                        model->body->fine.rest + 3 * model->body->fine.num_nodes);
                for (int32_t t = 0; t < model->body->fine.num_tets; t++) {
                    const pliant_tet_material &one = model->body->fine_material[t];
                    now.insert(now.end(), {one.lambda, one.mu, one.density, one.tissue});
                }
                now.insert(now.end(), model->material_of_voxel,
                           model->material_of_voxel + pliant_geometry_voxels(&block.scan.geometry));
                const double *stiffness = model->system->stiffness;
                if (stiffness) now.insert(now.end(), stiffness, stiffness + 144 * model->body->coarse.num_tets);
                pliant_model_free(model);
                if (threads == 1) first = now;
                EXPECT_TRUE(first == now) << threads << " threads";
            }
        }
    }
}

TEST(Threads, AScanIsReadByTheScenesNumberAndIsTheSame)
{
    pliant_scene scene;
    pliant_scene_defaults(&scene);
    std::vector<int16_t> first;
    for (int threads : {1, 3}) {
        scene.solver.threads = threads;
        pliant_volume scan{};
        pliant_labels labels{};
        pliant_material_table materials{};
        const int before = omp_get_max_threads();
        ASSERT_EQ(pliant_inputs_read(&scene, "phantom:40x32x36", &scan, &labels, &materials), PLIANT_OK)
            << pliant_last_error();
        EXPECT_EQ(omp_get_max_threads(), before);
        const auto *voxels = static_cast<const int16_t *>(scan.voxels);
        std::vector<int16_t> now(voxels, voxels + pliant_geometry_voxels(&scan.geometry));
        pliant_volume_free(&scan);
        pliant_labels_free(&labels);
        pliant_material_table_free(&materials);
        if (threads == 1) first = now;
        EXPECT_TRUE(first == now);
    }
}

TEST(Threads, ErrorsOfAThreadAreReturned)
{
    pliant_work work{};
    work.what = "counting";
    work.count = 40;
    work.interval = 1;
    work.end = 1;
#pragma omp parallel num_threads(3)
    {
        pliant_status status = PLIANT_OK;
#pragma omp for schedule(dynamic, 1)
        for (int n = 0; n < work.count; n++) {
            if (status == PLIANT_OK && n == 17) status = pliant_fail(PLIANT_ERROR_NUMERIC, "number %d is odd", n);
            if (status == PLIANT_OK) status = pliant_work_finish_item(&work);
        }
        pliant_work_finish_thread(&work, status);
    }
    EXPECT_EQ(pliant_work_result(&work), PLIANT_ERROR_NUMERIC);
    EXPECT_STREQ(pliant_last_error(), "number 17 is odd");
    EXPECT_LT(work.done, work.count);
}

TEST(Threads, HomogenizationIsCancelledWhereItsProgressIsRefused)
{
    // 5 coarse tetrahedra in each of 4 x 4 x 4 cells. After the reports of earlier stages, a report follows after each
    // 64 of them.
    for (int maximum : {6, 7}) {
        Block block(2);
        block.cells(4, 4, 4, 2);
        block.scene.model.method = PLIANT_AVERAGED;
        ThreadReports reports;
        reports.maximum = maximum;
        pliant_model *model = nullptr;
        EXPECT_EQ(
            pliant_model_build(&block.scene, &block.scan, nullptr, &block.table, {record_threads, &reports}, &model),
            PLIANT_ERROR_CANCELLED);
        EXPECT_EQ(model, nullptr);
        EXPECT_STREQ(pliant_last_error(), "homogenization was cancelled");
    }
}
