// The error of a mesh, estimated from three resolutions, against the true error of a beam with known converged sag.
#include "pipeline/beam.h"

#include "report/report.h"

#include <string>

namespace {

// u = 1 + h^p at one point, for three values of h
TEST(Truth, ExtrapolatesWithTheMeanOfObservedAndTheoreticalOrder)
{
    const uint8_t use[2] = {1, 0};
    for (double order : {1.0, 2.0}) {
        double u[3][6], out[6];
        for (int l = 0; l < 3; l++)
            for (int n = 0; n < 6; n++) u[l][n] = n < 3 ? 1 + std::pow(0.5, order * l) : 3 * l;
        EXPECT_NEAR(pliant_extrapolate(2, use, u[0], u[1], u[2], out), order, 1e-12);
        const double mean = 0.5 * (order + 2), next = u[2][0] + (u[2][0] - u[1][0]) / (std::exp2(mean) - 1);
        EXPECT_NEAR(out[0], next, 1e-12);
        if (order == 2) { EXPECT_NEAR(out[0], 1, 1e-12); }
        EXPECT_NEAR(out[5], 6 + 3 / (std::exp2(mean) - 1), 1e-12) << "a point that is not used is extrapolated alike";
    }
}

struct ReportedBeam : Beam {
    pliant_report_input input;
    pliant_sweep sweep;
    pliant_report_tables tables{};
    ReportedBeam(pliant_element_kind kind, double poisson, int across) : Beam(kind, poisson, across)
    {
        input = {&scene, &scan, nullptr, &table};
        pliant_sweep_defaults(&scene, &sweep);
        sweep.cases = 1u << 4; // the beam's own gravity
        EXPECT_EQ(pliant_report_open(nullptr, &tables), PLIANT_OK);
    }
    ~ReportedBeam() { pliant_report_close(&tables); }
    std::string cell(const char *name, size_t row = 0)
    {
        return pliant_results_cell(tables.truth, row, pliant_results_column(tables.truth, name));
    }
};

// The converged sag of quadratic neo-Hookean hexahedra is 6.87 mm at nu 0.45, and 6.75 mm at 0.499. Corotational
// elements converge to a larger sag at 0.499. There, hexahedra of 2.5 mm give 6.757 mm, which is 0.07 mm more than
// hexahedra of 5 mm. The extrapolated value is 6.80 mm. The tip has the largest motion and the largest error.
TEST(Truth, ErrorOfABeamsMeshIsEstimatedWithinAFactorOfOnePointThree)
{
    const double poisson[2] = {0.45, 0.499}, converged[2] = {6.87e-3, 6.80e-3};
    for (pliant_element_kind kind : {PLIANT_LINEAR, PLIANT_HEXAHEDRA})
        for (int n = 0; n < 2; n++) {
            // each kind with both values of nu, each with one size
            const int across = (kind == PLIANT_LINEAR) == (n == 0) ? 6 : 3;
            ReportedBeam beam(kind, poisson[n], across);
            pliant_truth worst;
            ASSERT_EQ(pliant_truth_run(&beam.input, &beam.sweep, &beam.tables, {nullptr, nullptr}, &worst), PLIANT_OK)
                << pliant_last_error();
            const double truth = converged[n] - beam.sag();
            std::printf(
                "%s, cells of %d mm, nu %.3f: sag off by %.3f mm, estimated %.3f mm, order %.2f, solver %.4f mm\n",
                kind == PLIANT_LINEAR ? "linear" : "hexahedra", 30 / across, poisson[n], 1e3 * truth,
                1e3 * worst.mesh.max, worst.order, 1e3 * worst.solver.max);
            EXPECT_LT(worst.mesh.max, 1.3 * std::fabs(truth));
            EXPECT_GT(worst.mesh.max, std::fabs(truth) / 1.3);
            EXPECT_EQ(beam.cell("larger"), "mesh");
            EXPECT_NE(beam.cell("advice").find("mesh/ratio"), std::string::npos);
        }
}

// A bar hangs by its end. With nu 0, the stress P follows from the weight below. P is E (s - 1) for the corotational
// law, and E / 2 (s - 1 / s) for the neo-Hookean law. With p = P / E, the stretch s is 1 + p, or p + sqrt(p^2 + 1).
TEST(Truth, BothLawsDifferAsTheirStretchesOfAHangingBar)
{
    const int steps = 1000;
    const double length = 0.1, young = 20e3, weight = 1070 * 100 * length / young; // P / E at the upper end
    double off = 0;
    for (int s = 0; s < steps; s++) {
        const double p = weight * (s + 0.5) / steps;
        off += (p + std::sqrt(p * p + 1) - (1 + p)) * length / steps;
    }
    const struct { pliant_element_kind kind; pliant_elasticity law; } cases[] = {
        {PLIANT_LINEAR, PLIANT_ELASTICITY_COROTATIONAL},
        {PLIANT_LINEAR, PLIANT_ELASTICITY_NEO_HOOKEAN},
        {PLIANT_HEXAHEDRA, PLIANT_ELASTICITY_NEO_HOOKEAN}};
    for (const auto &one : cases) {
        const pliant_elasticity law = one.law;
        ReportedBeam beam(one.kind, 0, 3);
        beam.table.materials[0].young_modulus = young;
        beam.scene.element.law = law;
        beam.scene.model.gravity[1] = 0;
        beam.scene.model.gravity[2] = 100; // it is fixed at z = 0
        pliant_truth worst;
        ASSERT_EQ(pliant_truth_run(&beam.input, &beam.sweep, &beam.tables, {nullptr, nullptr}, &worst), PLIANT_OK)
            << pliant_last_error();
        std::printf("laws apart by %.4f mm, exact %.4f mm\n", 1e3 * worst.laws.max, 1e3 * off);
        EXPECT_NEAR(worst.laws.max, off, 0.01 * off);
        ASSERT_EQ(pliant_results_rows(beam.tables.truth), 2u);
        const bool is_neo_hookean = law == PLIANT_ELASTICITY_NEO_HOOKEAN;
        EXPECT_EQ(beam.cell("law"), is_neo_hookean ? "neo_hookean" : "corotational") << "the scene's law first";
        EXPECT_EQ(beam.cell("law", 1), is_neo_hookean ? "corotational" : "neo_hookean");
        EXPECT_EQ(beam.cell("law_distance_max_mm"), "");
        EXPECT_NEAR(std::stod(beam.cell("law_distance_max_mm", 1)), 1e3 * worst.laws.max, 1e-4 * 1e3 * worst.laws.max);
    }
}

TEST(Truth, CoarseMethodsHaveOneLaw)
{
    ReportedBeam beam(PLIANT_LINEAR, 0.45, 3);
    beam.scene.model.method = PLIANT_AVERAGED;
    beam.cells(2, 2, 6, 2);
    pliant_truth worst;
    ASSERT_EQ(pliant_truth_run(&beam.input, &beam.sweep, &beam.tables, {nullptr, nullptr}, &worst), PLIANT_OK)
        << pliant_last_error();
    EXPECT_EQ(pliant_results_rows(beam.tables.truth), 1u);
    EXPECT_EQ(beam.cell("law"), "corotational");
    EXPECT_EQ(worst.laws.max, 0);
}

TEST(Truth, ReportsALargerSolverError)
{
    ReportedBeam beam(PLIANT_HEXAHEDRA, 0.45, 3);
    beam.scene.solver.iterations = 1;
    beam.scene.solver.refresh_interval = 0;
    beam.scene.model.gravity[1] = -60;
    beam.sweep.frames = 3;
    pliant_truth worst;
    ASSERT_EQ(pliant_truth_run(&beam.input, &beam.sweep, &beam.tables, {nullptr, nullptr}, &worst), PLIANT_OK)
        << pliant_last_error();
    EXPECT_GT(worst.solver.p95, worst.mesh.p95);
    EXPECT_EQ(beam.cell("larger"), "solver");
    EXPECT_NE(beam.cell("advice").find("solver/iterations"), std::string::npos);
}

TEST(Truth, RefusesWhatItCannotEstimate)
{
    ReportedBeam beam(PLIANT_LINEAR, 0.45, 3);
    pliant_truth worst;
    beam.sweep.max_refined_tets = 0; // three cells cannot be halved
    EXPECT_EQ(pliant_truth_run(&beam.input, &beam.sweep, &beam.tables, {nullptr, nullptr}, &worst), PLIANT_ERROR_SCENE);
    EXPECT_NE(std::string(pliant_last_error()).find("three resolutions"), std::string::npos) << pliant_last_error();
    beam.scene.solver.kind = PLIANT_TLED;
    EXPECT_EQ(pliant_truth_run(&beam.input, &beam.sweep, &beam.tables, {nullptr, nullptr}, &worst), PLIANT_ERROR_SCENE);
    EXPECT_EQ(pliant_results_rows(beam.tables.truth), 0u);
}

} // namespace
