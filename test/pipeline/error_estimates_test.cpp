// The error estimate of a step is within a factor of three of the true error in 95 % of frames. The bodies were not
// used for tuning. bench_error_estimates runs all frames. This test runs a few, so one or two more may be outside.
#include "error_estimates.h"

namespace {

void expect_within(double fraction, const char *name, std::vector<size_t> loads,
                   std::vector<pliant_preconditioner_choice> choices, int iterations)
{
    error_estimates::Counts counts;
    for (const error_estimates::Scene &scene : error_estimates::scenes()) {
        if (std::string(scene.name) != name) continue;
        for (size_t load : loads) {
            const std::vector<std::vector<double>> right = error_estimates::solve_tightly(scene, load, {});
            for (pliant_preconditioner_choice choice : choices)
                counts.add(error_estimates::run(scene, load, choice, iterations, {}, right, true));
        }
    }
    std::printf("%s: %d of %d, a step later %d of %d\n", name, counts.within, counts.counted, counts.within_next,
                counts.judged);
    EXPECT_GT(counts.counted, 15);
    EXPECT_GE(counts.within, fraction * counts.counted);
}

// Under springs that stretch the body, and weight, with a factor or a V-cycle that is never recomputed.
TEST(Error, WithAFactorOfRest) { expect_within(0.95, "parity", {0, 1, 2, 3}, {PLIANT_DIRECT, PLIANT_MULTIGRID}, 2); }

// The V-cycle's lattices glue both sides of a cut, which causes slowly converging errors.
TEST(Error, AfterACut) { expect_within(0.9, "cut", {1, 3}, {PLIANT_DIRECT, PLIANT_MULTIGRID}, 3); }

TEST(Error, OfHexahedra) { expect_within(0.95, "hexahedra", {1}, {PLIANT_DIRECT, PLIANT_MULTIGRID}, 2); }

// The end of a step is evaluated within its time, also if loads change.
TEST(Error, WithinABudget) { expect_within(0.9, "budget", {0, 3}, {PLIANT_DIRECT}, 3); }

// The evaluation around a patch at the end of a step cannot be reused by the next step, but is done nevertheless.
TEST(Error, AroundAPatch) { expect_within(0.9, "patch", {0}, {PLIANT_DIRECT}, 2); }

} // namespace
