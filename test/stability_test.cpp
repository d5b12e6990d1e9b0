// Extreme cases: each one gets a verdict, no simulation fails, and the body returns to rest.
#include "report/report.h"
#include "base/memory.h"

#include <algorithm>
#include <cstdlib>
#include <gtest/gtest.h>
#include <string>
#include <unistd.h>
#include <vector>

namespace {

class Stability : public testing::TestWithParam<const char *> {
protected:
    void SetUp() override
    {
        ASSERT_NE(mkdtemp(folder), nullptr);
        ASSERT_EQ(pliant_report_open(folder, &tables), PLIANT_OK) << pliant_last_error();
        pliant_stability_defaults(&options);
        options.long_steps = 600;
        options.settle_steps = 100;
        options.methods = 1u << PLIANT_FINE | 1u << PLIANT_AVERAGED;
        in_use = pliant_memory_in_use();
    }
    void TearDown() override
    {
        pliant_report_close(&tables);
        EXPECT_LE(pliant_memory_in_use(), in_use);
        EXPECT_EQ(std::system(("rm -r " + std::string(folder)).c_str()), 0);
    }
    pliant_verdict run(const char *name)
    {
        pliant_verdict worst = PLIANT_VERDICT_BROKEN;
        options.only = name;
        EXPECT_EQ(pliant_stability_run(nullptr, &options, &tables, {nullptr, nullptr}, &worst), PLIANT_OK)
            << pliant_last_error();
        return worst;
    }
    size_t rows() const { return pliant_results_rows(tables.stability); }
    // Run a case, and check what every case must fulfil.
    pliant_verdict run_unbroken(const char *name)
    {
        const size_t first = rows();
        const pliant_verdict worst = run(name);
        EXPECT_GT(rows(), first);
        EXPECT_NE(worst, PLIANT_VERDICT_BROKEN);
        for (size_t r = first; r < rows(); r++) {
            const std::string verdict = cell(r, "verdict");
            EXPECT_NE(verdict, "broken") << cell(r, "parameter") << ": " << cell(r, "message");
            if (verdict == "refused" || verdict == "degraded") EXPECT_NE(cell(r, "message"), "");
            EXPECT_EQ(cell(r, "growth_bytes"), "0");
        }
        return worst;
    }
    std::string cell(size_t row, const char *column) const
    {
        return pliant_results_cell(tables.stability, row, pliant_results_column(tables.stability, column));
    }
    pliant_report_tables tables{};
    pliant_stability options;
    size_t in_use = 0;
    char folder[40] = "/tmp/pliant_stability_XXXXXX";
};

const std::vector<const char *> loads{"contrast",   "poisson", "anisotropic", "thin",    "empty",  "single_tetrahedron",
                                      "pieces",     "pull",    "teleport",    "gravity", "spring", "half_turn",
                                      "not_finite", "long_run"},
    collapses{"flat", "inverted", "scrambled", "plane", "point"}, limits{"time_step", "energy"},
    dynamics{"dynamic_teleport",     "dynamic_spring", "dynamic_octree",
             "dynamic_bone_surface", "dynamic_fit",    "dynamic_not_finite"};

std::string name_of(const testing::TestParamInfo<const char *> &info) { return info.param; }

TEST_P(Stability, IsNeverBroken)
{
    // A pull to ten times the body's size has not settled after 100 steps either.
    if (GetParam() == std::string("pull")) options.settle_steps = 20;
    run_unbroken(GetParam());
}

INSTANTIATE_TEST_SUITE_P(Cases, Stability, testing::ValuesIn(loads), name_of);

TEST_F(Stability, EveryCaseIsTested)
{
    size_t count = 0;
    while (const char *name = pliant_stability_case(static_cast<int>(count))) {
        int lists = 0;
        for (const auto *list : {&loads, &collapses, &limits, &dynamics})
            lists += std::count(list->begin(), list->end(), std::string(name));
        EXPECT_EQ(lists, 1) << name;
        count++;
    }
    EXPECT_EQ(count, loads.size() + collapses.size() + limits.size() + dynamics.size());
}

class Collapsed : public Stability
{
};

TEST_P(Collapsed, ComesBackToRest)
{
    run_unbroken(GetParam());
    size_t fine = 0;
    for (size_t r = 0; r < rows(); r++) {
        if (cell(r, "method") != "fine") continue;
        EXPECT_EQ(cell(r, "verdict"), "converged");
        EXPECT_EQ(cell(r, "inverted_end"), "0");
        EXPECT_LT(std::atof(cell(r, "off_rest_mm").c_str()), 1);
        EXPECT_GT(std::atoi(cell(r, "inverted_max").c_str()) + std::atoi(cell(r, "steps").c_str()), 1);
        fine++;
    }
    EXPECT_GT(fine, 0u);
}

INSTANTIATE_TEST_SUITE_P(Cases, Collapsed, testing::ValuesIn(collapses), name_of);

TEST_F(Stability, ExplicitDynamicsIsTriedByRelaxation)
{
    pliant_scene scene;
    pliant_scene_defaults(&scene);
    scene.solver.kind = PLIANT_TLED;
    options.scene = &scene;
    options.settle_steps = 40;
    for (const char *name : {"contrast", "pull", "not_finite", "single_tetrahedron"})
        EXPECT_NE(run(name), PLIANT_VERDICT_BROKEN) << name;
    for (size_t r = 0; r < rows(); r++) {
        EXPECT_EQ(cell(r, "method"), "fine");
        EXPECT_EQ(cell(r, "growth_bytes"), "0");
        if (cell(r, "parameter") == "0.1 x the body, rigid" || cell(r, "parameter") == "1")
            EXPECT_EQ(cell(r, "verdict"), "converged");
    }
}

TEST_F(Stability, TheTimeStepHasABoundAndEnergyIsKept)
{
    options.long_steps = 20000;
    for (const char *name : limits) run_unbroken(name);
    ASSERT_EQ(rows(), 3u);
    EXPECT_EQ(cell(0, "verdict"), "converged");
    EXPECT_EQ(cell(1, "verdict"), "refused");
    EXPECT_NE(cell(1, "message").find("faster than sound"), std::string::npos);
    EXPECT_EQ(cell(2, "verdict"), "converged") << cell(2, "message");
}

class Dynamics : public Stability
{
};

TEST_P(Dynamics, ReturnToRest)
{
    const bool refused = GetParam() == std::string("dynamic_not_finite");
    EXPECT_EQ(run_unbroken(GetParam()), refused ? PLIANT_VERDICT_REFUSED : PLIANT_VERDICT_CONVERGED);
    for (size_t r = 0; r < rows(); r++) {
        EXPECT_LT(std::atof(cell(r, "off_rest_mm").c_str()), 1);
        if (refused) {
            EXPECT_EQ(cell(r, "figure"), "10 of 10 calls refused");
            continue;
        }
        EXPECT_EQ(cell(r, "method"), "fine");
        EXPECT_EQ(cell(r, "message"), "") << cell(r, "parameter");
        if (cell(r, "parameter") != "0.001 N/m") EXPECT_GT(std::atof(cell(r, "largest_mm").c_str()), 1);
        EXPECT_GT(std::atoi(cell(r, "iterations").c_str()), 10 * std::atoi(cell(r, "steps").c_str())) << "sub-steps";
    }
}

INSTANTIATE_TEST_SUITE_P(Cases, Dynamics, testing::ValuesIn(dynamics), name_of);

TEST_F(Stability, EmptyScansAreRefusedWithAMessage)
{
    EXPECT_EQ(run("empty"), PLIANT_VERDICT_REFUSED);
    for (size_t r = 0; r < rows(); r++)
        if (cell(r, "parameter") == "all air")
            EXPECT_NE(cell(r, "message").find("the mesh has no tetrahedra"), std::string::npos);
}

TEST_F(Stability, StoredRowsAreNotRecomputed)
{
    run("single_tetrahedron");
    const size_t before = rows();
    run("single_tetrahedron");
    EXPECT_EQ(rows(), before);
    pliant_verdict worst;
    options.only = "no such case";
    EXPECT_EQ(pliant_stability_run(nullptr, &options, &tables, {nullptr, nullptr}, &worst), PLIANT_ERROR_ARGUMENT);
}

} // namespace
