// A complete sweep over a tiny body.
#include "backend/explicit_statistics.h"
#include "pipeline/body.h"
#include "report/report.h"

#include <cstdlib>
#include <map>
#include <string>
#include <unistd.h>

namespace {

const int size[3] = {12, 12, 12};
const double box[3] = {0.12, 0.12, 0.12};

class Sweep : public testing::Test {
protected:
    Sweep() : body(size, box, {{5e3, 0.45, 1000, false}, {5e4, 0.45, 1000, false}, {10, 0, 1, true}},
                   [](int i, int j, int k) { return j < 2 ? 2 : i < 8 && j < 8 && k < 8 ? 1 : 0; })
    {
        body.cells(3, 3, 3, 2);
        body.scene.solver.threads = 1;
        body.scene.solver.iterations = 6;
        body.scene.solver.tolerance = 1e-4;
        body.fix_plane(0, 0.11, 0, 0, -1, 0);
        input = {&body.scene, &body.scan, nullptr, &body.table};
        pliant_sweep_defaults(&body.scene, &sweep);
        sweep.num_iterations = 0;
        sweep.iterations[sweep.num_iterations++] = 2;
        sweep.iterations[sweep.num_iterations++] = 0;
        sweep.frames = 4;
        for (double &p : sweep.pull) p /= 3; // 1 cm
        sweep.num_points = pliant_pull_points(&input, nullptr, 0, 1, sweep.points);
    }
    void SetUp() override
    {
        ASSERT_NE(mkdtemp(folder), nullptr);
        ASSERT_EQ(pliant_report_open(folder, &tables), PLIANT_OK) << pliant_last_error();
    }
    void TearDown() override
    {
        pliant_report_close(&tables);
        EXPECT_EQ(std::system(("rm -r " + std::string(folder)).c_str()), 0);
    }
    pliant_status run(pliant_progress progress = {nullptr, nullptr})
    {
        return pliant_sweep_run(&input, &sweep, folder, &tables, progress);
    }
    const char *cell(size_t row, const char *column) const
    {
        return pliant_results_cell(tables.sweep, row, pliant_results_column(tables.sweep, column));
    }
    double number(size_t row, const char *column) const { return std::atof(cell(row, column)); }

    Body body;
    pliant_report_input input;
    pliant_sweep sweep;
    pliant_report_tables tables{};
    char folder[32] = "/tmp/pliant_sweep_XXXXXX";
};

TEST_F(Sweep, FindsTheFrontOfSoftTissue)
{
    ASSERT_EQ(sweep.num_points, 1);
    const double *at = sweep.points[0].rest;
    EXPECT_NEAR(at[0], 0.06, 0.011);
    EXPECT_NEAR(at[2], 0.06, 0.011);
    EXPECT_GT(at[1], 0.02); // behind the air, and slightly inside
    EXPECT_LT(at[1], 0.04);
    pliant_pull_point many[PLIANT_MAX_PULLS];
    int found = pliant_pull_points(&input, nullptr, 0, 3, many);
    ASSERT_EQ(found, 3);
    for (int a = 0; a < 3; a++)
        for (int b = 0; b < a; b++)
            EXPECT_GT(std::hypot(many[a].rest[0] - many[b].rest[0], many[a].rest[2] - many[b].rest[2]), 0.02);
}

TEST_F(Sweep, EveryMethodCaseAndBudgetHasARowAndFineIsTheMostAccurate)
{
    ASSERT_EQ(run(), PLIANT_OK) << pliant_last_error();
    size_t rows = pliant_results_rows(tables.sweep), models = pliant_results_rows(tables.builds);
    EXPECT_EQ(rows, models * 4 * 2); // cases, budgets
    std::map<std::string, double> worst;
    for (size_t r = 0; r < rows; r++) {
        std::string method = cell(r, "method");
        ASSERT_STREQ(cell(r, "message"), "") << method;
        EXPECT_GT(number(r, "solver_median_ms"), 0);
        EXPECT_GE(number(r, "frame_median_ms"), number(r, "warp_median_ms"));
        EXPECT_GT(number(r, "largest_mm"), 0.1);
        EXPECT_GE(number(r, "max_mm"), number(r, "p95_mm"));
        EXPECT_NEAR(number(r, "max_percent"), 100 * number(r, "max_mm") / number(r, "largest_mm"),
                    1e-3 * number(r, "max_percent") + 1e-9);
        EXPECT_GT(number(r, "refined_max_mm"), 0);
        EXPECT_EQ(number(r, "frames"), std::string(cell(r, "case")) == "gravity" ? 8 : 4);
        if (std::string(cell(r, "budget")) != "converged") continue;
        EXPECT_GT(number(r, "voxels"), 1000);
        EXPECT_LE(number(r, "voxel_rms_mm"), number(r, "voxel_max_mm"));
        worst[method] = std::fmax(worst[method], number(r, "max_percent"));
    }
    EXPECT_LT(worst["fine"], 0.2);
    for (const auto &method : worst)
        if (method.first == "coarse" || method.first == "averaged") EXPECT_GT(method.second, 1) << method.first;
    EXPECT_EQ(pliant_results_rows(tables.frames), models * 2 * (3 * 4 + 8));
    EXPECT_EQ(pliant_results_rows(tables.histogram), models * 4 * 40);

    // a second run adds nothing
    ASSERT_EQ(run(), PLIANT_OK);
    EXPECT_EQ(pliant_results_rows(tables.sweep), rows);
}

// The fine reference solutions are on disk. A resumed sweep computes none of them again, and its errors are the same.
TEST_F(Sweep, ReferencesAreKept)
{
    sweep.methods = 1u << PLIANT_FINE | 1u << PLIANT_COARSE;
    sweep.cases = 3; // displacement, force
    sweep.warp = false;
    ASSERT_EQ(run(), PLIANT_OK) << pliant_last_error();
    std::vector<std::string> errors;
    for (int again = 0; again < 3; again++) {
        if (again == 2) { // a truncated file is computed again
            std::string files = "for f in " + std::string(folder) + "/reference_*.bin; do truncate -s -8 $f; done";
            ASSERT_EQ(std::system(files.c_str()), 0);
        }
        if (again > 0) {
            pliant_report_close(&tables);
            ASSERT_EQ(std::system(("rm " + std::string(folder) + "/sweep.csv").c_str()), 0);
            ASSERT_EQ(pliant_report_open(folder, &tables), PLIANT_OK);
            int solved = 0;
            auto count = [](double, const char *stage, void *user) {
                const std::string text = stage;
                *static_cast<int *>(user) += text.find("reference, ") != std::string::npos ||
                                             text.find("twice the resolution, ") != std::string::npos;
                return true;
            };
            ASSERT_EQ(run({count, &solved}), PLIANT_OK) << pliant_last_error();
            EXPECT_EQ(solved > 0, again == 2);
        }
        std::vector<std::string> now;
        for (size_t r = 0; r < pliant_results_rows(tables.sweep); r++)
            for (const char *column : {"max_mm", "rms_mm", "refined_max_mm", "force_n"}) now.push_back(cell(r, column));
        ASSERT_EQ(now.size(), 4u * 2 * 2 * 2);
        if (again == 0) errors = now;
        EXPECT_EQ(now, errors);
    }
}

TEST_F(Sweep, StopsOnCancellationAndContinuesThere)
{
    sweep.methods = 1u << PLIANT_FINE | 1u << PLIANT_COARSE;
    sweep.max_refined_tets = 0;
    sweep.warp = false;
    pliant_results *table = tables.sweep;
    auto three_rows = [](double, const char *, void *user) {
        return pliant_results_rows(static_cast<pliant_results *>(user)) < 3;
    };
    ASSERT_EQ(run({three_rows, table}), PLIANT_ERROR_CANCELLED);
    EXPECT_EQ(pliant_results_rows(tables.sweep), 3u);
    std::string kept = cell(2, "solver_median_ms");
    pliant_report_close(&tables);
    ASSERT_EQ(pliant_report_open(folder, &tables), PLIANT_OK);
    ASSERT_EQ(run(), PLIANT_OK) << pliant_last_error();
    EXPECT_EQ(pliant_results_rows(tables.sweep), 2u * 4 * 2);
    EXPECT_EQ(cell(2, "solver_median_ms"), kept);
}

TEST_F(Sweep, EachStageIsOmittedAndMeasured)
{
    ASSERT_EQ(pliant_ablation_run(&input, &sweep, &tables, {nullptr, nullptr}), PLIANT_OK) << pliant_last_error();
    size_t rows = pliant_results_rows(tables.stages);
    EXPECT_EQ(rows, 8u);
    int held = pliant_results_column(tables.stages, "held_mb"),
        frame = pliant_results_column(tables.stages, "frame_median_ms");
    auto value = [&](size_t row, int column) { return std::atof(pliant_results_cell(tables.stages, row, column)); };
    EXPECT_STREQ(pliant_results_cell(tables.stages, 0, 1), "nothing");
    EXPECT_STREQ(pliant_results_cell(tables.stages, rows - 1, 1), "everything");
    EXPECT_LT(value(rows - 1, held), value(0, held));
    EXPECT_LT(value(rows - 1, frame), value(0, frame));
}

TEST_F(Sweep, ExplicitDynamicsComesToTheCorotationalAnswerWhereStrainsAreSmall)
{
    body.scene.solver.kind = PLIANT_TLED;
    pliant_pull_point at = sweep.points[0];
    pliant_sweep_defaults(&body.scene, &sweep);
    EXPECT_EQ(sweep.methods, 1u << PLIANT_FINE);
    sweep.points[sweep.num_points++] = at;
    sweep.frames = 3;
    sweep.num_iterations = 0;
    sweep.iterations[sweep.num_iterations++] = 20;
    sweep.iterations[sweep.num_iterations++] = 0;
    sweep.max_refined_tets = 0;
    sweep.warp = false;
    ASSERT_EQ(run(), PLIANT_OK) << pliant_last_error();
    ASSERT_EQ(pliant_results_rows(tables.sweep), 8u);
    for (size_t r = 0; r < 6; r += 2) { // the pulls, by their budgets
        EXPECT_EQ(number(r, "iterations_mean"), 20);
        EXPECT_GT(number(r + 1, "iterations_mean"), 20);
        EXPECT_LT(number(r + 1, "max_percent"), 3) << r;
        EXPECT_LT(number(r + 1, "rms_percent"), 1) << r;
        EXPECT_LT(number(r + 1, "rms_mm"), number(r, "rms_mm"));
    }
    ASSERT_EQ(pliant_ablation_run(&input, &sweep, &tables, {nullptr, nullptr}), PLIANT_OK) << pliant_last_error();
    EXPECT_EQ(pliant_results_rows(tables.stages), 8u);
    ASSERT_EQ(pliant_dynamics_run(&input, &sweep, &tables, {nullptr, nullptr}), PLIANT_OK) << pliant_last_error();
    ASSERT_EQ(pliant_results_rows(tables.dynamics), 1u);
    auto told = [&](const char *name) {
        return std::atof(pliant_results_cell(tables.dynamics, 0, pliant_results_column(tables.dynamics, name)));
    };
    EXPECT_NEAR(told("steps_a_frame") * told("time_step_us"), 1e6 * body.scene.solver.step, 1);
    EXPECT_LE(told("time_step_us"), 0.9 * std::fmin(told("edge_bound_us"), told("eigenvalue_bound_us")) + 1e-3);
    EXPECT_LT(told("energy_drift_percent"), 0.1);
    EXPECT_GT(told("energy_drift_percent"), 0); // because of single precision

    body.scene.ground.normal[1] = -1;
    EXPECT_EQ(run(), PLIANT_ERROR_SCENE);
    EXPECT_NE(std::string(pliant_last_error()).find("ground"), std::string::npos) << pliant_last_error();
    body.scene.solver.kind = PLIANT_COROTATIONAL;
    EXPECT_EQ(pliant_dynamics_run(&input, &sweep, &tables, {nullptr, nullptr}), PLIANT_ERROR_SCENE);
}

// Compare with the same pull with sub-steps of an eighth.
TEST_F(Sweep, TheErrorOfTimeIntegrationIsWhatMuchShorterSubStepsShow)
{
    body.scene.solver.kind = PLIANT_TLED;
    body.scene.solver.step = 0.01;
    body.scene.tled.damping = 20;
    sweep.frames = 6;
    ASSERT_EQ(pliant_dynamics_run(&input, &sweep, &tables, {nullptr, nullptr}), PLIANT_OK) << pliant_last_error();
    auto told = [&](const char *name) {
        return std::atof(pliant_results_cell(tables.dynamics, 0, pliant_results_column(tables.dynamics, name)));
    };
    ASSERT_GT(told("time_error_mm"), 0);

    const double *at = sweep.points[0].rest;
    const int substeps = static_cast<int>(told("steps_a_frame"));
    std::vector<double> positions[2];
    double largest = 0;
    for (int finer = 0; finer < 2; finer++) {
        body.scene.tled.safety = finer ? 0.9 / 8 : 0.9;
        ASSERT_EQ(body.build(), PLIANT_OK) << pliant_last_error();
        const pliant_mesh &mesh = body.data->body->fine;
        pliant_dynamics dynamics;
        ASSERT_EQ(pliant_data_get_dynamics(body.model, body.data, &dynamics), PLIANT_OK);
        ASSERT_GE(dynamics.substeps, finer ? 7 * substeps : substeps);
        int tool;
        ASSERT_EQ(pliant_tool_add(body.model, body.data, "test", &tool), PLIANT_OK);
        ASSERT_EQ(pliant_tool_set_pose(body.data, tool, at, nullptr), PLIANT_OK);
        ASSERT_EQ(pliant_tool_grasp(body.model, body.data, tool, at), PLIANT_OK);
        ASSERT_EQ(pliant_tool_set_drive(body.data, tool, PLIANT_DRIVE_RIGID, nullptr), PLIANT_OK);
        const std::vector<double> from(body.data->tools[tool].tip, body.data->tools[tool].tip + 3);
        for (int frame = 0; frame < 12; frame++) {
            double tip[3];
            for (int d = 0; d < 3; d++) tip[d] = from[d] + sweep.pull[d] * (frame + 1) / 6;
            if (frame < 6) ASSERT_EQ(pliant_tool_set_pose(body.data, tool, tip, nullptr), PLIANT_OK);
            if (frame == 6) pliant_tool_remove_pose(body.data, tool);
            ASSERT_EQ(pliant_step(body.model, body.data), PLIANT_OK);
            positions[finer].insert(positions[finer].end(), body.data->positions,
                                    body.data->positions + 3 * mesh.num_nodes);
        }
        for (size_t i = 0; i < positions[finer].size(); i += 3) {
            double moved = 0;
            for (size_t d = 0; d < 3; d++)
                moved += std::pow(
                    positions[finer][i + d] - mesh.rest[(i + d) % (3 * static_cast<size_t>(mesh.num_nodes))], 2);
            largest = std::fmax(largest, std::sqrt(moved));
        }
    }
    double error = 0;
    for (size_t i = 0; i < positions[0].size(); i += 3)
        error = std::fmax(
            error, std::hypot(std::hypot(positions[0][i] - positions[1][i], positions[0][i + 1] - positions[1][i + 1]),
                              positions[0][i + 2] - positions[1][i + 2]));
    EXPECT_GT(told("time_error_mm"), 0.5e3 * error);
    EXPECT_LT(told("time_error_mm"), 2e3 * error);
    EXPECT_NEAR(told("time_error_percent"), 0.1 * told("time_error_mm") / largest, 0.1 * told("time_error_percent"));
}

TEST_F(Sweep, AnOctreeIsMeasuredAgainstOneOfTwiceTheCells)
{
    body.scene.mesh.kind = PLIANT_OCTREE;
    body.scene.mesh.depth = 1;
    pliant_pull_point at = sweep.points[0];
    pliant_sweep_defaults(&body.scene, &sweep);
    sweep.points[sweep.num_points++] = at;
    for (double &p : sweep.pull) p /= 10;
    sweep.frames = 2;
    sweep.num_iterations = 1;
    sweep.iterations[0] = 0;
    sweep.cases = 1; // displacement
    body.scene.warp.kind = PLIANT_FIT; // its voxels are not compared
    ASSERT_EQ(run(), PLIANT_OK) << pliant_last_error();
    ASSERT_EQ(pliant_results_rows(tables.sweep), 1u);
    EXPECT_GT(number(0, "refined_tetrahedra"), 1.5 * number(0, "fine_tetrahedra"));
    EXPECT_GT(number(0, "refined_rms_mm"), number(0, "rms_mm"));
    EXPECT_STREQ(cell(0, "voxels"), "");
    EXPECT_GT(number(0, "warp_median_ms"), 0);
}

TEST_F(Sweep, VariesOneMoreOption)
{
    sweep.methods = 1u << PLIANT_FINE;
    sweep.max_refined_tets = 0;
    sweep.num_iterations = 1;
    std::snprintf(sweep.option, sizeof sweep.option, "solver/history");
    std::snprintf(sweep.values[sweep.num_values++], sizeof sweep.values[0], "0");
    std::snprintf(sweep.values[sweep.num_values++], sizeof sweep.values[0], "6");
    ASSERT_EQ(run(), PLIANT_OK) << pliant_last_error();
    EXPECT_EQ(pliant_results_rows(tables.sweep), 8u);
    EXPECT_STREQ(cell(0, "variant"), "solver/history=0");
    EXPECT_STREQ(cell(7, "variant"), "solver/history=6");
    std::snprintf(sweep.option, sizeof sweep.option, "solver/nothing");
    EXPECT_EQ(run(), PLIANT_ERROR_SCENE);
}

} // namespace
