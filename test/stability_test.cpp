// Extreme cases: each one gets a verdict, no simulation fails, and the body returns to rest.
#include "report/report.h"
#include "base/memory.h"

#include <cstdlib>
#include <gtest/gtest.h>
#include <string>
#include <unistd.h>

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
    }
    void TearDown() override
    {
        pliant_report_close(&tables);
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
    std::string cell(size_t row, const char *column) const
    {
        return pliant_results_cell(tables.stability, row, pliant_results_column(tables.stability, column));
    }
    pliant_report_tables tables{};
    pliant_stability options;
    char folder[40] = "/tmp/pliant_stability_XXXXXX";
};

TEST_P(Stability, IsNeverBroken)
{
    size_t before = pliant_memory_in_use();
    pliant_verdict worst = run(GetParam());
    size_t rows = pliant_results_rows(tables.stability);
    EXPECT_GE(rows, 1u);
    EXPECT_NE(worst, PLIANT_VERDICT_BROKEN);
    for (size_t r = 0; r < rows; r++) {
        std::string verdict = cell(r, "verdict");
        EXPECT_NE(verdict, "broken") << cell(r, "parameter") << ": " << cell(r, "message");
        if (verdict == "refused" || verdict == "degraded") EXPECT_NE(cell(r, "message"), "");
        EXPECT_EQ(cell(r, "growth_bytes"), "0");
    }
    pliant_report_close(&tables);
    EXPECT_LE(pliant_memory_in_use(), before);
    ASSERT_EQ(pliant_report_open(folder, &tables), PLIANT_OK);
}

std::string name_of(const testing::TestParamInfo<const char *> &info) { return info.param; }

INSTANTIATE_TEST_SUITE_P(Cases, Stability,
                         testing::Values("contrast", "poisson", "anisotropic", "thin", "empty", "single_tetrahedron",
                                         "pieces", "pull", "teleport", "gravity", "spring", "half_turn", "not_finite",
                                         "flat", "inverted", "scrambled", "plane", "point", "long_run", "time_step",
                                         "energy", "dynamic_teleport", "dynamic_not_finite", "dynamic_spring",
                                         "dynamic_octree", "dynamic_bone_surface", "dynamic_fit"),
                         name_of);

TEST_F(Stability, EveryCaseIsTested)
{
    int count = 0;
    while (pliant_stability_case(count)) count++;
    EXPECT_EQ(count, 27);
}

TEST_F(Stability, CollapsedBodiesComeBackToRest)
{
    options.methods = 1u << PLIANT_FINE;
    for (const char *name : {"flat", "inverted", "scrambled", "plane", "point"})
        EXPECT_EQ(run(name), PLIANT_VERDICT_CONVERGED) << name;
    for (size_t r = 0; r < pliant_results_rows(tables.stability); r++) {
        EXPECT_EQ(cell(r, "inverted_end"), "0");
        EXPECT_LT(std::atof(cell(r, "off_rest_mm").c_str()), 1);
        EXPECT_GT(std::atoi(cell(r, "inverted_max").c_str()) + std::atoi(cell(r, "steps").c_str()), 1);
    }
}

TEST_F(Stability, ExplicitDynamicsIsTriedByRelaxation)
{
    pliant_scene scene;
    pliant_scene_defaults(&scene);
    scene.solver.kind = PLIANT_TLED;
    options.scene = &scene;
    options.settle_steps = 40;
    for (const char *name : {"contrast", "pull", "not_finite", "single_tetrahedron"})
        EXPECT_NE(run(name), PLIANT_VERDICT_BROKEN) << name;
    for (size_t r = 0; r < pliant_results_rows(tables.stability); r++) {
        EXPECT_EQ(cell(r, "method"), "fine");
        EXPECT_EQ(cell(r, "growth_bytes"), "0");
        if (cell(r, "parameter") == "0.1 x the body, rigid" || cell(r, "parameter") == "1")
            EXPECT_EQ(cell(r, "verdict"), "converged");
    }
}

TEST_F(Stability, TheTimeStepHasABoundAndEnergyIsKept)
{
    options.long_steps = 20000;
    run("time_step");
    run("energy");
    ASSERT_EQ(pliant_results_rows(tables.stability), 3u);
    EXPECT_EQ(cell(0, "verdict"), "converged");
    EXPECT_EQ(cell(1, "verdict"), "refused");
    EXPECT_NE(cell(1, "message").find("faster than sound"), std::string::npos);
    EXPECT_EQ(cell(2, "verdict"), "converged") << cell(2, "message");
}

TEST_F(Stability, ExplicitDynamicsReturnsToRest)
{
    for (const char *name :
         {"dynamic_teleport", "dynamic_spring", "dynamic_octree", "dynamic_bone_surface", "dynamic_fit"})
        EXPECT_EQ(run(name), PLIANT_VERDICT_CONVERGED) << name;
    for (size_t r = 0; r < pliant_results_rows(tables.stability); r++) {
        EXPECT_EQ(cell(r, "method"), "fine");
        EXPECT_EQ(cell(r, "message"), "") << cell(r, "case") << " " << cell(r, "parameter");
        EXPECT_LT(std::atof(cell(r, "off_rest_mm").c_str()), 1) << cell(r, "case");
        if (cell(r, "parameter") != "0.001 N/m")
            EXPECT_GT(std::atof(cell(r, "largest_mm").c_str()), 1) << cell(r, "case");
        EXPECT_GT(std::atoi(cell(r, "iterations").c_str()), 10 * std::atoi(cell(r, "steps").c_str())) << "sub-steps";
    }
    EXPECT_EQ(run("dynamic_not_finite"), PLIANT_VERDICT_REFUSED);
    const size_t last = pliant_results_rows(tables.stability) - 1;
    EXPECT_EQ(cell(last, "figure"), "10 of 10 calls refused");
    EXPECT_LT(std::atof(cell(last, "off_rest_mm").c_str()), 1);
}

TEST_F(Stability, EmptyScansAreRefusedWithAMessage)
{
    EXPECT_EQ(run("empty"), PLIANT_VERDICT_REFUSED);
    for (size_t r = 0; r < pliant_results_rows(tables.stability); r++)
        if (cell(r, "parameter") == "all air")
            EXPECT_NE(cell(r, "message").find("the mesh has no tetrahedra"), std::string::npos);
}

TEST_F(Stability, StoredRowsAreNotRecomputed)
{
    run("single_tetrahedron");
    size_t rows = pliant_results_rows(tables.stability);
    run("single_tetrahedron");
    EXPECT_EQ(pliant_results_rows(tables.stability), rows);
    pliant_verdict worst;
    options.only = "no such case";
    EXPECT_EQ(pliant_stability_run(nullptr, &options, &tables, {nullptr, nullptr}, &worst), PLIANT_ERROR_ARGUMENT);
}

} // namespace
