// Tests of the rules of Anderson acceleration, which both backends use.
#include "fem/quasistatic/anderson.h"

#include <gtest/gtest.h>

#include <cmath>
#include <limits>

namespace
{

TEST(Anderson, EnergyBelowZeroIsNoMerit)
{
    EXPECT_DOUBLE_EQ(pliant_anderson_merit(4, 10), 2);
    EXPECT_EQ(pliant_anderson_merit(0, 10), 0);
    EXPECT_EQ(pliant_anderson_merit(-1e-12 * 100, 10), 0) << "rounding";
    EXPECT_EQ(pliant_anderson_merit(-1e-6, 10), INFINITY);
    EXPECT_EQ(pliant_anderson_merit(-4, 10), INFINITY);
    for (double bad : {std::numeric_limits<double>::infinity(), -std::numeric_limits<double>::infinity(),
                       std::numeric_limits<double>::quiet_NaN()}) {
        EXPECT_EQ(pliant_anderson_merit(bad, 10), INFINITY);
        EXPECT_EQ(pliant_anderson_merit(4, bad), INFINITY);
    }
}

// A solver step with prescribed merits, one for each evaluated state.
struct Rules : pliant_anderson {
    Rules() : pliant_anderson()
    {
        max_evaluations = 100;
        depth = 6;
        capacity = PLIANT_MAX_HISTORY;
        limits_secants = 1;
        tolerance = 1e-3;
        smallest_displacement = 0.1;
        pliant_anderson_reset(this);
        pliant_anderson_begin(this);
    }
    void evaluate(double state_merit, bool mixed = true, bool time = true, double made = 1, double slope = 0)
    {
        pliant_anderson_judge(this, state_merit, slope, time ? INT32_MAX : 0);
        if (next != PLIANT_NEXT_PREVIOUS && next != PLIANT_NEXT_REST && next != PLIANT_NEXT_DESCENT)
            pliant_anderson_finish_proposal(this, mixed, 1, made, 1);
    }
};

TEST(Anderson, RejectionsLeadToUnmixedAndShorterSteps)
{
    Rules rules;
    rules.evaluate(1);
    EXPECT_EQ(rules.next, PLIANT_NEXT_TRIAL);
    rules.evaluate(2);
    EXPECT_TRUE(rules.uses_secants && rules.secant_slot >= 0 && !rules.accepts_state);
    rules.evaluate(2);
    EXPECT_TRUE(rules.omits_large_secants && rules.uses_secants) << "without large secants";
    EXPECT_LT(rules.largest_secant, INFINITY);
    rules.evaluate(2);
    EXPECT_FALSE(rules.uses_secants) << "the plain step";
    EXPECT_EQ(rules.damping, 1);
    EXPECT_EQ(pliant_anderson_secants(&rules), 0);
    rules.evaluate(2);
    EXPECT_EQ(rules.damping, 0.5);
    for (int n = 0; n < 9; n++) rules.evaluate(2);
    EXPECT_EQ(rules.next, PLIANT_NEXT_REST);
    rules.evaluate(0.5);
    EXPECT_TRUE(rules.accepts_state && rules.next == PLIANT_NEXT_DONE);
}

// A step without progress may evaluate the rest state, or a step that lowers the potential energy. Both are within the
// limit of evaluations. If a step has none left for them, the next step evaluates them.
TEST(Anderson, AttemptsWithoutProgressAreWithinTheLimitOfEvaluations)
{
    int tried = 0, descents = 0;
    for (int run = 0; run < 40; run++) {
        const int limit = 1 + run % 20;
        Rules rules;
        rules.max_evaluations = limit;
        for (int step = 0; step < 40; step++) {
            pliant_anderson_begin(&rules);
            do {
                rules.evaluate(2, true, true, 1, run < 20 ? 0 : 1); // the first is accepted, all others are refused
                tried += rules.next == PLIANT_NEXT_REST;
                descents += rules.next == PLIANT_NEXT_DESCENT;
            } while (rules.next != PLIANT_NEXT_DONE && rules.next != PLIANT_NEXT_BLIND);
            ASSERT_LE(rules.evaluations - rules.last, limit) << step;
        }
    }
    EXPECT_GT(tried, 20);
    EXPECT_GT(descents, 20);
}

TEST(Anderson, WithoutTimeAfterARejectionTheNextStepIsNotEvaluated)
{
    Rules rules;
    rules.evaluate(1);
    rules.evaluate(2, true, false);
    EXPECT_EQ(rules.next, PLIANT_NEXT_BLIND);
    pliant_anderson_begin(&rules);
    rules.evaluate(5, true, false);
    EXPECT_EQ(rules.next, PLIANT_NEXT_PREVIOUS) << "far above what it began with";
    rules.evaluate(1, true, false);
    EXPECT_TRUE(rules.accepts_state);
    EXPECT_EQ(rules.next, PLIANT_NEXT_BLIND);
    EXPECT_FALSE(rules.uses_secants) << "as the refusals have come so far";
    pliant_anderson_begin(&rules);
    rules.evaluate(0.9, true, false);
    EXPECT_EQ(rules.next, PLIANT_NEXT_BLIND);
    EXPECT_TRUE(rules.uses_secants) << "that was good";
}

// In weakly connected tissue a plain step can be metres long.
TEST(Anderson, StepsWithoutEvaluationAreBounded)
{
    const double tenth = pliant_get_quasistatic_settings().max_doubtful_step * 0.1;
    for (double made : {0.99 * tenth, 1.01 * tenth, static_cast<double>(INFINITY)}) {
        Rules rules;
        rules.evaluate(1);
        rules.evaluate(2, true, false, made);
        EXPECT_EQ(rules.next, made < tenth ? PLIANT_NEXT_BLIND : PLIANT_NEXT_DONE);
        EXPECT_EQ(rules.follows_blind_step, made < tenth);
        EXPECT_EQ(rules.refused, 2) << "what was refused stays so";
    }
    for (double made : {1.01 * tenth, 1.01 * 0.1 * pliant_get_quasistatic_settings().max_displacement}) {
        Rules rules;
        rules.evaluate(1);
        rules.evaluate(0.4, true, false, made);
        EXPECT_EQ(rules.next, made < 2 * tenth ? PLIANT_NEXT_BLIND : PLIANT_NEXT_DONE) << "after what went well";
    }
}

TEST(Anderson, UselessSecantsAreDropped)
{
    Rules rules;
    rules.evaluate(1);
    for (double merit : {0.5, 0.25, 0.12}) rules.evaluate(merit);
    EXPECT_EQ(pliant_anderson_secants(&rules), 3);
    rules.evaluate(0.06, false); // the matrix of products of secants is no longer positive definite
    EXPECT_EQ(pliant_anderson_secants(&rules), 0);
    EXPECT_EQ(rules.next, PLIANT_NEXT_TRIAL);
}

TEST(Anderson, TheOldestSecantsAreReplaced)
{
    Rules rules;
    rules.last_evaluations = 6;
    for (int n = 0; n < 30; n++) EXPECT_LT(pliant_anderson_free_slot(&rules), 9);
    EXPECT_EQ(pliant_anderson_secants(&rules), 9);
    rules.last_evaluations = 2;
    pliant_anderson_free_slot(&rules);
    EXPECT_EQ(pliant_anderson_secants(&rules), 6);
    for (uint64_t number : rules.number) EXPECT_TRUE(number == 0 || number > 25) << number;
}

} // namespace
