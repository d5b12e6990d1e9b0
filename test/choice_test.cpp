// Tests of the choice of settings by measurement, on a tiny body with very short steps.
#include "pipeline/body.h"

#include "model_data/data.h"
#include "base/memory.h"
#include "report/choice.h"

#include <algorithm>
#include <chrono>
#include <csignal>
#include <cstdlib>
#include <ctime>
#include <map>
#include <string>
#include <sys/time.h>
#include <thread>

namespace {

const int size[3] = {12, 12, 12};
const double box[3] = {0.12, 0.12, 0.12};

class Choice : public testing::Test {
protected:
    Choice() : body(size, box, {{5e3, 0.45, 1000, false}, {5e4, 0.45, 1000, false}, {10, 0, 1, true}},
                    [](int i, int j, int k) { return j < 2 ? 2 : i < 8 && j < 8 && k < 8 ? 1 : 0; })
    {
        body.cells(2, 2, 2, 2);
        body.scene.solver.threads = 1;
        body.scene.solver.iterations = 6;
        body.scene.solver.tolerance = 1e-4;
        body.scene.solver.step = 1e-4; // [s] steps need not wait for the next frame
        body.scene.solver.backend = PLIANT_CPU;
        body.scene.choose.budget_ms = 1e6;
        body.fix_plane(0, 0.11, 0, 0, -1, 0);
        input = {&body.scene, &body.scan, nullptr, &body.table};
    }
    void SetUp() override { ASSERT_EQ(pliant_report_open(nullptr, &tables), PLIANT_OK) << pliant_last_error(); }
    void TearDown() override
    {
        pliant_set_log(nullptr, nullptr);
        pliant_report_close(&tables);
    }
    pliant_status choose(pliant_progress progress = {nullptr, nullptr})
    {
        return pliant_choose(&input, &tables, progress, &choice);
    }
    void vary(bool method, bool cells, bool ratio, bool iterations)
    {
        body.scene.choose.method = method;
        body.scene.choose.coarse_cells = cells;
        body.scene.choose.ratio = ratio;
        body.scene.choose.iterations = iterations;
    }
    void listen()
    {
        pliant_set_log([](pliant_log_level level, const char *message, void *user) {
            if (level == PLIANT_LOG_WARNING) *static_cast<std::string *>(user) += std::string(message) + "\n";
        }, &warnings);
    }
    std::string cell(size_t row, const char *column) const
    {
        return pliant_results_cell(tables.sweep, row, pliant_results_column(tables.sweep, column));
    }
    // Return the p95 error [%] of each tried method, mesh and budget. With two cases it is the larger one.
    std::map<std::string, double> errors() const
    {
        std::map<std::string, std::map<std::string, double>> found;
        for (size_t r = 0; r < pliant_results_rows(tables.sweep); r++) {
            std::string key;
            for (const char *column : {"method", "submesh", "ratio", "variant", "budget"}) key += cell(r, column) + "|";
            found[key][cell(r, "case")] = std::atof(cell(r, "p95_percent").c_str());
        }
        std::map<std::string, double> out;
        for (const auto &each : found)
            if (each.second.size() == 2)
                out[each.first] = std::max(each.second.at("displacement"), each.second.at("force"));
        return out;
    }

    Body body;
    pliant_report_input input;
    pliant_report_tables tables{};
    pliant_choice choice{};
    std::string warnings;
};

TEST_F(Choice, CostsNothingWithoutABudget)
{
    body.scene.choose.budget_ms = 0;
    pliant_memory_reset_peak();
    size_t before = pliant_memory_peak();
    ASSERT_EQ(choose(), PLIANT_OK);
    EXPECT_EQ(pliant_memory_peak(), before);
    EXPECT_FALSE(choice.made);
    EXPECT_STREQ(choice.options, "");
    EXPECT_EQ(std::memcmp(&choice.scene, &body.scene, sizeof body.scene), 0);
}

TEST_F(Choice, SelectsTheMostAccurateCandidate)
{
    ASSERT_EQ(choose(), PLIANT_OK) << pliant_last_error();
    ASSERT_TRUE(choice.made);
    EXPECT_TRUE(choice.within_budget);
    EXPECT_GE(choice.tried, 15);
    std::map<std::string, double> all = errors();
    double minimum = INFINITY, maximum = 0;
    for (const auto &each : all) {
        minimum = std::fmin(minimum, each.second);
        maximum = std::fmax(maximum, each.second);
    }
    EXPECT_GT(maximum, 10 * minimum);
    EXPECT_GT(choice.reference_error, 0);
    EXPECT_LE(100 * (choice.error + choice.reference_error), 1.05 * (minimum + 100 * choice.reference_error) + 1e-6);
    EXPECT_EQ(choice.mesh, choice.reference_error) << "the finest that was tried";
    EXPECT_STREQ(pliant_results_cell(tables.choice, 0, pliant_results_column(tables.choice, "larger")), "mesh");
    EXPECT_EQ(choice.error, choice.p95);
    EXPECT_LE(choice.rms, choice.max);
    // the fine method on the finest mesh has the smallest error
    EXPECT_EQ(choice.scene.model.method, PLIANT_FINE);
    EXPECT_EQ(choice.scene.mesh.ratio, 4);
    EXPECT_GT(choice.reference_tetrahedra, 5 * 4 * 4 * 4);
    EXPECT_NE(
        std::string(choice.options).find("model/method=fine mesh/coarse_cells=2,2,2 mesh/ratio=4 solver/iterations="),
        std::string::npos);

    // The tables report the choice, and its options reproduce its scene.
    ASSERT_EQ(pliant_results_rows(tables.choice), 1u);
    EXPECT_STREQ(pliant_results_cell(tables.choice, 0, pliant_results_column(tables.choice, "options")),
                 choice.options);
    pliant_scene scene = body.scene;
    std::string options = std::string(choice.options) + " ";
    for (size_t at = 0, end; (end = options.find(' ', at)) != std::string::npos; at = end + 1) {
        size_t equals = options.find('=', at);
        ASSERT_EQ(pliant_scene_set(&scene, options.substr(at, equals - at).c_str(),
                                   options.substr(equals + 1, end - equals - 1).c_str()),
                  PLIANT_OK);
    }
    EXPECT_EQ(std::memcmp(&scene, &choice.scene, sizeof scene), 0);
}

TEST_F(Choice, KeepsOptionsThatMayNotVary)
{
    vary(false, false, false, false);
    ASSERT_EQ(choose(), PLIANT_OK) << pliant_last_error();
    EXPECT_EQ(choice.tried, 1);
    EXPECT_EQ(std::memcmp(&choice.scene, &body.scene, sizeof body.scene), 0);
    EXPECT_LT(choice.max, 0.02) << "against the fine solution on its own mesh";
    EXPECT_LE(choice.reference_tetrahedra, 5 * 4 * 4 * 4);

    body.scene.model.method = PLIANT_COARSE;
    vary(false, true, false, true);
    pliant_report_close(&tables);
    ASSERT_EQ(pliant_report_open(nullptr, &tables), PLIANT_OK);
    ASSERT_EQ(choose(), PLIANT_OK) << pliant_last_error();
    EXPECT_EQ(choice.tried, 2);
    EXPECT_EQ(choice.scene.model.method, PLIANT_COARSE);
    EXPECT_EQ(choice.scene.mesh.ratio, 2);
    EXPECT_EQ(choice.scene.mesh.coarse_cells[0], 4);
}

TEST_F(Choice, AScenesPatchAppliesToItsMethodOnly)
{
    body.scene.model.method = PLIANT_AVERAGED;
    body.scene.model.patch = 0.05;
    body.scene.choose.measure = PLIANT_MEASURE_MAX;
    vary(false, false, false, false);
    ASSERT_EQ(choose(), PLIANT_OK) << pliant_last_error();
    EXPECT_EQ(choice.tried, 1);
    EXPECT_EQ(std::memcmp(&choice.scene, &body.scene, sizeof body.scene), 0);
    const double patched = choice.settled_error;

    vary(true, false, false, false);
    ASSERT_EQ(choose(), PLIANT_OK) << pliant_last_error();
    EXPECT_EQ(choice.scene.model.method, PLIANT_FINE);
    EXPECT_EQ(choice.scene.model.patch, 0);
    body.scene.model.patch = 0;
    body.scene.model.method = PLIANT_AVERAGED;
    vary(false, false, false, false);
    ASSERT_EQ(choose(), PLIANT_OK) << pliant_last_error();
    EXPECT_GT(choice.max, 1.5 * patched);
}

// Until the patch exists, the tool pulls the coarse model.
TEST_F(Choice, PullsBeforeThePatchIsReadyCount)
{
    vary(false, false, false, false);
    body.scene.model.method = PLIANT_AVERAGED;
    ASSERT_EQ(choose(), PLIANT_OK) << pliant_last_error();
    const double without = choice.p95;
    EXPECT_EQ(choice.settled_error, choice.error);

    body.scene.model.patch = 0.05;
    body.scene.model.patch_delay = 40;
    body.scene.choose.max_error = 0.9 * without;
    listen();
    pliant_report_close(&tables);
    ASSERT_EQ(pliant_report_open(nullptr, &tables), PLIANT_OK);
    ASSERT_EQ(choose(), PLIANT_OK) << pliant_last_error();
    EXPECT_NEAR(choice.p95, without, 1e-3 * without);
    EXPECT_LT(choice.settled_error, 0.6 * without);
    EXPECT_NE(warnings.find("before its patch is there"), std::string::npos) << warnings;
    EXPECT_NE(warnings.find("% later on"), std::string::npos) << warnings;
}

// The error includes the motion under the scene's gravity from the first frame on, with the iterations of the settings.
TEST_F(Choice, GravityCountsFromTheFirstFrame)
{
    vary(false, false, false, false);
    const double gravity[3] = {0, 9.81, 15};
    std::memcpy(body.scene.model.gravity, gravity, sizeof gravity);
    body.scene.solver.iterations = 1;
    ASSERT_EQ(choose(), PLIANT_OK) << pliant_last_error();

    ASSERT_EQ(body.build(), PLIANT_OK);
    ASSERT_EQ(pliant_data_set_limits(body.data, 200, 1e-8), PLIANT_OK);
    ASSERT_EQ(body.settle(), PLIANT_OK);
    const pliant_mesh &mesh = body.model->body->fine;
    std::vector<double> rest(body.data->positions, body.data->positions + 3 * mesh.num_nodes);
    ASSERT_EQ(pliant_data_reset(body.model, body.data), PLIANT_OK);
    ASSERT_EQ(pliant_data_set_limits(body.data, 1, body.scene.solver.tolerance), PLIANT_OK);
    double worst = 0;
    for (int frame = 0; frame < 10; frame++) {
        ASSERT_GE(pliant_step(body.model, body.data), 0);
        pliant_error error;
        ASSERT_EQ(pliant_error_between(mesh.num_nodes, nullptr, mesh.rest, rest.data(), body.data->positions, &error),
                  PLIANT_OK);
        worst = std::fmax(worst, error.max / error.largest);
    }
    ASSERT_GT(worst, 0.02);
    EXPECT_NEAR(choice.max, worst, 0.02 * worst);
    EXPECT_LT(choice.settled_error, choice.error);
}

TEST_F(Choice, ReachingTheTimeLimitIsNoError)
{
    std::string errors;
    pliant_set_log([](pliant_log_level level, const char *message, void *user) {
        if (level == PLIANT_LOG_ERROR) *static_cast<std::string *>(user) += std::string(message) + "\n";
    }, &errors);
    for (const char *when : {"displacement", "force"}) { // before the first point of the first candidate, and after it
        struct { const char *when; bool waited; } seen = {when, false};
        auto wait = [](double, const char *stage, void *user) { // wait until the time limit, in the middle of a run
            auto *at = static_cast<decltype(seen) *>(user);
            const std::string text = stage;
            if (at->waited || text.find(at->when) == std::string::npos || text.find("budget 2") == std::string::npos)
                return true;
            at->waited = true;
            std::this_thread::sleep_for(std::chrono::seconds(4));
            return true;
        };
        body.scene.choose.seconds = 4;
        pliant_choice taken;
        ASSERT_EQ(pliant_choose(&input, nullptr, {wait, &seen}, &taken), PLIANT_OK);
        ASSERT_TRUE(seen.waited);
        EXPECT_EQ(taken.made, std::string(when) == "force");
        EXPECT_EQ(errors, "");
    }
}

// Simulate a busy machine: after each short run, the program stands still for ten times as long.
TEST_F(Choice, TimeOfOtherProgramsDoesNotCount)
{
    vary(false, false, false, false);
    body.cells(4, 4, 4, 2);
    ASSERT_EQ(choose(), PLIANT_OK) << pliant_last_error();
    const double quiet = choice.seconds;
    pliant_report_close(&tables);
    ASSERT_EQ(pliant_report_open(nullptr, &tables), PLIANT_OK);

    struct sigaction stand_still{};
    stand_still.sa_flags = SA_RESTART;
    stand_still.sa_handler = [](int) {
        const timespec rest = {0, 2000000};
        nanosleep(&rest, nullptr);
        const itimerval again = {{0, 0}, {0, 200}};
        setitimer(ITIMER_REAL, &again, nullptr);
    };
    ASSERT_EQ(sigaction(SIGALRM, &stand_still, nullptr), 0);
    raise(SIGALRM);
    const pliant_status status = choose();
    const itimerval never{};
    setitimer(ITIMER_REAL, &never, nullptr);
    std::signal(SIGALRM, SIG_IGN); // another thread may still be in the handler and start the timer again
    ASSERT_EQ(status, PLIANT_OK) << pliant_last_error();
    ASSERT_TRUE(choice.made);
    EXPECT_LT(choice.seconds, 4 * quiet);
}

// ---- the choice among points

choice_point point_of(double error, double settled_error, double milliseconds, double evaluations, int32_t tetrahedra)
{
    choice_point point{};
    point.candidate.by.method = PLIANT_FINE;
    for (int m = 0; m < NUM_MEASURES; m++) {
        point.error[m] = error;
        point.settled_error[m] = settled_error;
    }
    point.seconds = 1e-3 * milliseconds;
    point.evaluations = evaluations;
    point.solved_tetrahedra = point.fine_tetrahedra = tetrahedra;
    point.on_host = true;
    return point;
}

TEST(ChoiceOfPoints, NoPointIsSelectedThatLessWorkImproves)
{
    // The second point needs less work and has a smaller error, but other programs delayed it.
    const choice_point points[] = {point_of(0.58, 0.58, 6, 30, 5000), point_of(0.004, 0.004, 40, 2, 4000),
                                   point_of(0.001, 0.001, 50, 31, 4000)};
    EXPECT_EQ(choice_best(points, 3, PLIANT_MEASURE_P95, 0, 8e-3), points + 1);
    EXPECT_DOUBLE_EQ(choice_seconds(points, 3, points + 1), 6e-3);
    EXPECT_DOUBLE_EQ(choice_seconds(points, 3, points + 2), 50e-3) << "one evaluation more";
    // But a point stays where it may be slower: with more evaluations on the smaller mesh, with a patch, or on the GPU.
    choice_point others[] = {points[0], point_of(0.004, 0.004, 40, 31, 4000), point_of(0.003, 0.003, 40, 2, 4000),
                             point_of(0.002, 0.002, 40, 2, 4000)};
    others[2].candidate.by = {PLIANT_AVERAGED, PLIANT_SUBMESH_OVERLAP, 0.05};
    others[3].on_host = false;
    EXPECT_EQ(choice_best(others, 4, PLIANT_MEASURE_P95, 0, 8e-3), others);
    EXPECT_EQ(choice_fastest(others, 4), others);
}

TEST(ChoiceOfPoints, RanksByWorstFrameThenSettledErrorThenTime)
{
    const choice_point patched = point_of(0.40, 0.03, 5, 3, 1000), coarse = point_of(0.30, 0.30, 1, 3, 500),
                       fine = point_of(0.02, 0.02, 20, 2, 9000);
    const choice_point all[] = {patched, coarse, fine};
    EXPECT_EQ(choice_best(all, 3, PLIANT_MEASURE_MAX, 0, 0.1), all + 2);
    EXPECT_EQ(choice_best(all, 3, PLIANT_MEASURE_MAX, 0, 0.01), all) << "worst frames are alike";
    EXPECT_EQ(choice_best(all, 3, PLIANT_MEASURE_MAX, 0, 2e-3), all + 1);
    EXPECT_EQ(choice_best(all, 3, PLIANT_MEASURE_MAX, 0, 1e-4), nullptr);
    const choice_point same[] = {point_of(0.1, 0.1, 9, 4, 10), point_of(0.1, 0.103, 8, 3, 10),
                                 point_of(0.1, 0.11, 7, 2, 10)};
    EXPECT_EQ(choice_best(same, 3, PLIANT_MEASURE_MAX, 0, 1), same + 1);
}

// Errors u + C h^p on meshes of one, two and four times the resolution. The finest one is the reference.
TEST(ChoiceOfPoints, IterationsEndAtTheErrorOfTheMesh)
{
    auto fine_of = [](int32_t ratio, double error, double milliseconds, double evaluations) {
        choice_point point = point_of(error, error, milliseconds, evaluations, 1000 * ratio);
        point.candidate = {{PLIANT_FINE, PLIANT_SUBMESH_OVERLAP, 0}, {1, ratio}};
        return point;
    };
    for (double order : {1.0, 2.0}) {
        const double reference_error = 0.01, half = reference_error * (std::exp2(order) - 1),
                     quarter = reference_error * (std::exp2(2 * order) - 1);
        const choice_point points[] = {fine_of(4, 0.006, 4, 2), fine_of(4, 0.0001, 9, 6), fine_of(2, half, 2, 6),
                                       fine_of(2, half + 0.02, 1, 1), fine_of(1, quarter, 1, 6)};
        const double estimate = choice_reference_error(points, 5, 4, PLIANT_MEASURE_P95);
        EXPECT_NEAR(estimate, half / (std::exp2(0.5 * (order + 2)) - 1), 1e-12);
        if (order == 2) { EXPECT_NEAR(estimate, reference_error, 1e-12); }
        EXPECT_EQ(choice_reference_error(points, 4, 4, PLIANT_MEASURE_P95), 0) << "two resolutions tell no order";
        EXPECT_EQ(choice_mesh_error(points, 5, 2, PLIANT_MEASURE_P95), half);
        EXPECT_EQ(choice_best(points, 5, PLIANT_MEASURE_P95, 0, 0.1), points + 1);
        EXPECT_EQ(choice_best(points, 5, PLIANT_MEASURE_P95, 0.2, 0.1), points + (order == 1 ? 2 : 0))
            << "the quickest of those that the mesh makes alike";
    }
}

TEST_F(Choice, UsesTheErrorMeasureOfTheScene)
{
    vary(false, false, false, true);
    body.scene.choose.measure = PLIANT_MEASURE_MAX;
    ASSERT_EQ(choose(), PLIANT_OK) << pliant_last_error();
    EXPECT_EQ(choice.error, choice.max);
    EXPECT_GT(choice.max, choice.p95);
}

TEST_F(Choice, WarnsWithBothFiguresIfNoCandidateIsWithinTheBudget)
{
    vary(true, false, false, true);
    body.scene.choose.max_error = 1e-9;
    listen();
    ASSERT_EQ(choose(), PLIANT_OK);
    ASSERT_TRUE(choice.made);
    EXPECT_NE(
        warnings.find("choose/max_error: nothing within 1e+06 ms is as accurate as 1e-07 %; the best has an error of"),
        std::string::npos)
        << warnings;
    EXPECT_NE(warnings.find("(in a pull)"), std::string::npos) << warnings;

    body.scene.choose.budget_ms = 1e-6;
    warnings.clear();
    pliant_choice quickest;
    ASSERT_EQ(pliant_choose(&input, nullptr, {nullptr, nullptr}, &quickest), PLIANT_OK);
    ASSERT_TRUE(quickest.made);
    EXPECT_FALSE(quickest.within_budget);
    EXPECT_GT(quickest.error, choice.error);
    EXPECT_EQ(quickest.scene.solver.iterations, 1);
    EXPECT_NE(warnings.find("choose/budget_ms: no candidate takes at most 1e-06 ms"), std::string::npos) << warnings;
}

TEST_F(Choice, ALoadThatIsCancelledChoosesNothing)
{
    size_t before = pliant_memory_in_use();
    struct { int calls; } count = {0};
    auto stop = [](double fraction, const char *stage, void *user) {
        EXPECT_GE(fraction, 0);
        EXPECT_LE(fraction, 1);
        EXPECT_EQ(std::string(stage).find("choosing settings"), 0u);
        return ++static_cast<decltype(count) *>(user)->calls < 100;
    };
    choice.tried = -7;
    EXPECT_EQ(pliant_choose(&input, nullptr, {stop, &count}, &choice), PLIANT_ERROR_CANCELLED);
    EXPECT_EQ(choice.tried, -7);
    EXPECT_EQ(count.calls, 100);
    EXPECT_EQ(pliant_memory_in_use(), before);
}

// After a callback has cancelled, a call from another thread does not continue the choice.
TEST_F(Choice, OneCancellationEndsTheChoice)
{
    vary(false, false, false, false);
    body.scene.model.method = PLIANT_LOD; // each cube calls back
    body.cells(3, 3, 3, 2);
    body.scene.solver.threads = 2;
    struct { int calls; } asked = {0};
    auto stop = [](double, const char *stage, void *user) {
        if (std::string(stage).find("building lod") == std::string::npos) return true;
        std::this_thread::sleep_for(std::chrono::milliseconds(3)); // so that the other thread waits for its call
        return ++static_cast<decltype(asked) *>(user)->calls != 9;
    };
    EXPECT_EQ(pliant_choose(&input, nullptr, {stop, &asked}, &choice), PLIANT_ERROR_CANCELLED);
    EXPECT_EQ(asked.calls, 9);
}

// The fine method ignores the patch: each mesh has one fine candidate.
TEST_F(Choice, AFineScenesPatchIsNoOtherMethod)
{
    vary(true, false, false, false);
    body.scene.solver.iterations = 1;
    ASSERT_EQ(choose(), PLIANT_OK) << pliant_last_error();
    const int tried = choice.tried;
    body.scene.model.patch = 0.05;
    pliant_report_close(&tables);
    ASSERT_EQ(pliant_report_open(nullptr, &tables), PLIANT_OK);
    ASSERT_EQ(choose(), PLIANT_OK) << pliant_last_error();
    EXPECT_EQ(choice.tried, tried);
}

TEST_F(Choice, WithoutTimeTheSceneIsUnchanged)
{
    body.scene.choose.seconds = 0;
    listen();
    ASSERT_EQ(choose(), PLIANT_OK);
    EXPECT_FALSE(choice.made);
    EXPECT_EQ(std::memcmp(&choice.scene, &body.scene, sizeof body.scene), 0);
    EXPECT_NE(warnings.find("choose/seconds ended before"), std::string::npos) << warnings;
}

TEST_F(Choice, RefusesWhatItCannotMeasure)
{
    body.scene.solver.kind = PLIANT_TLED;
    EXPECT_EQ(choose(), PLIANT_ERROR_SCENE);
    EXPECT_NE(std::string(pliant_last_error()).find("choose/budget_ms"), std::string::npos);
    body.scene.solver.kind = PLIANT_COROTATIONAL;
    body.scene.mesh.kind = PLIANT_OCTREE;
    EXPECT_EQ(choose(), PLIANT_ERROR_SCENE);
}

TEST_F(Choice, AFailingAllocationDropsACandidateOrTheChoiceButNotTheLoad)
{
    vary(true, false, false, false);
    size_t before = pliant_memory_in_use();
    int made = 0, dropped = 0;
    for (int64_t n = 0; n < 20000; n = n * 3 / 2 + 1) {
        pliant_choice tried{};
        pliant_memory_fail_after(n);
        pliant_status status = pliant_choose(&input, nullptr, {nullptr, nullptr}, &tried);
        pliant_memory_fail_after(-1);
        ASSERT_EQ(pliant_memory_in_use(), before) << n;
        if (status == PLIANT_ERROR_MEMORY) continue; // too little memory even for the tables
        ASSERT_EQ(status, PLIANT_OK) << n << ": " << pliant_last_error();
        ASSERT_EQ(pliant_scene_check(&tried.scene), PLIANT_OK) << n;
        made += tried.made;
        dropped += tried.made && tried.dropped > 0;
    }
    EXPECT_GT(made, 3);
    EXPECT_GT(dropped, 0);
}

} // namespace
