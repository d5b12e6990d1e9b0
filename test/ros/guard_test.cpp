// The gate between the simulation's forces and a hand: every edge of its table, and what it never lets through.
#include "ros/guard/guard.h"

#include <gtest/gtest.h>

#include <cmath>
#include <functional>
#include <limits>

using namespace pliant_ros;

namespace {

const double nan = std::numeric_limits<double>::quiet_NaN(), tick = 0.005;

struct Bench {
    GuardSettings settings;
    Guard guard;
    double now = 10, push[3] = {-4, 0, 0};
    bool poses = true, forces = true, errors = true;

    explicit Bench(const std::function<void(GuardSettings &)> &set = [](GuardSettings &) {}) : settings(make(set)), guard(settings)
    {
        guard.following(true);
        guard.simulation(true);
    }
    static GuardSettings make(const std::function<void(GuardSettings &)> &set)
    {
        GuardSettings settings;
        settings.enabled = true;
        set(settings);
        return settings;
    }
    Guard::Output turn()
    {
        now += tick;
        if (poses) guard.pose(now, true);
        if (forces) guard.wrench(now, push);
        if (errors) guard.error(now, 1e-4);
        return guard.update(now);
    }
    Guard::Output turns(double seconds)
    {
        Guard::Output out{};
        for (double end = now + seconds - tick / 2; now < end;) out = turn();
        return out;
    }
    void open()
    {
        turns(1);
        ASSERT_EQ(guard.state(), GuardState::OPEN) << guard.why(now);
    }
};

double size_of(const Guard::Output &out) { return std::sqrt(out.force[0] * out.force[0] + out.force[1] * out.force[1] + out.force[2] * out.force[2]); }

TEST(Guard, RisesFromZeroAndThenHandsOnAPartOfTheForceAgainstTheHand)
{
    Bench bench;
    Guard::Output out = bench.guard.update(bench.now); // nothing has come
    EXPECT_EQ(bench.guard.state(), GuardState::ENDING);
    EXPECT_TRUE(out.send);
    EXPECT_EQ(size_of(out), 0);
    out = bench.turn();
    EXPECT_EQ(bench.guard.state(), GuardState::RISING);
    EXPECT_TRUE(out.send);
    EXPECT_EQ(size_of(out), 0);
    double before = 0;
    while (bench.guard.state() == GuardState::RISING) {
        out = bench.turn();
        EXPECT_GE(out.force[0], before - 1e-12); // the tissue is pushed to -x, so the hand is pushed to +x
        before = out.force[0];
    }
    EXPECT_NEAR(bench.now - 10, bench.settings.ramp, 3 * tick);
    EXPECT_NEAR(bench.turns(0.5).force[0], 0.25 * 4, 1e-6);
    EXPECT_EQ(bench.guard.state(), GuardState::OPEN);
}

// one before it may have been killed: the hand feels its last force still
TEST(Guard, BeginsWithZerosWhateverElseIsThere)
{
    Bench bench;
    bench.guard.following(false);
    bench.now += 50; // since it was made: nobody listened
    for (double end = bench.now + bench.settings.tail - 2 * tick; bench.now < end;) {
        const Guard::Output out = bench.turn();
        ASSERT_TRUE(out.send);
        ASSERT_EQ(size_of(out), 0);
    }
    bench.turns(0.1);
    EXPECT_EQ(bench.guard.state(), GuardState::CLOSED);
    EXPECT_FALSE(bench.turn().send);
}

struct Closing {
    const char *name;
    std::function<void(Bench &)> happens;
    const char *why;
};

class EveryGate : public testing::TestWithParam<Closing> {};

TEST_P(EveryGate, EndsInZerosWithinFiftyMillisecondsAndThenInSilence)
{
    for (bool while_rising : {false, true}) {
        Bench bench;
        if (while_rising) bench.turns(0.25);
        else bench.open();
        EXPECT_GT(size_of(bench.turn()), 0.1);
        GetParam().happens(bench);
        const double at = bench.now;
        Guard::Output out = bench.turn();
        while (size_of(out) > 0 && bench.now - at < 1) out = bench.turn();
        EXPECT_LE(bench.now - at, 0.05);
        EXPECT_EQ(bench.guard.state(), GuardState::ENDING);
        EXPECT_NE(bench.guard.why(bench.now).find(GetParam().why), std::string::npos) << bench.guard.why(bench.now);
        const double ended = bench.now;
        for (int zeros = 0; bench.guard.state() == GuardState::ENDING; ++zeros) {
            EXPECT_TRUE(out.send);
            EXPECT_EQ(size_of(out), 0);
            ASSERT_LT(zeros, 1000);
            out = bench.turn();
        }
        EXPECT_NEAR(bench.now - ended, bench.settings.tail, 2 * tick);
        EXPECT_EQ(bench.guard.state(), GuardState::CLOSED);
        EXPECT_FALSE(out.send);
        EXPECT_FALSE(bench.turns(1).send);
    }
}

const Closing closings[] = {
    {"Following", [](Bench &bench) { bench.guard.following(false); }, "follow"},
    {"Simulation", [](Bench &bench) { bench.guard.simulation(false); }, "does not run"},
    {"Poses", [](Bench &bench) { bench.poses = false; }, "pose"},
    {"InvalidPose", [](Bench &bench) { bench.poses = false, bench.guard.pose(bench.now, false); }, "pose"},
    {"Forces", [](Bench &bench) { bench.forces = false; }, "no force"},
    {"NoNumber", [](Bench &bench) { bench.push[1] = nan; }, "finite"},
    {"Infinite", [](Bench &bench) { bench.push[2] = INFINITY; }, "finite"},
    {"Error", [](Bench &bench) { bench.errors = false, bench.guard.error(bench.now, 0.01); }, "error is too large"},
    {"ErrorNotKnown", [](Bench &bench) { bench.errors = false, bench.guard.error(bench.now, 0); }, "does not tell"},
    {"ErrorNoNumber", [](Bench &bench) { bench.errors = false, bench.guard.error(bench.now, nan); }, "error is too large"},
};
INSTANTIATE_TEST_SUITE_P(Every, EveryGate, testing::ValuesIn(closings), [](const testing::TestParamInfo<Closing> &each) { return each.param.name; });

TEST(Guard, IsClosedWhereTheErrorIsNoLongerTold)
{
    Bench bench;
    bench.open();
    bench.errors = false;
    EXPECT_EQ(size_of(bench.turns(bench.settings.error_timeout + 2 * tick)), 0);
    EXPECT_NE(bench.guard.why(bench.now).find("does not tell"), std::string::npos);
}

TEST(Guard, DoesNotAskForAnErrorWhereAnyWillDo)
{
    Bench bench([](GuardSettings &settings) { settings.largest_error = INFINITY; });
    bench.errors = false;
    bench.open();
}

TEST(Guard, OpensAgainFromZeroWhileItEnds)
{
    Bench bench;
    bench.open();
    bench.guard.following(false);
    bench.turns(0.1);
    ASSERT_EQ(bench.guard.state(), GuardState::ENDING);
    bench.guard.following(true);
    EXPECT_EQ(size_of(bench.turn()), 0);
    EXPECT_EQ(bench.guard.state(), GuardState::RISING);
    EXPECT_LT(size_of(bench.turn()), 0.02);
    EXPECT_NEAR(bench.turns(1).force[0], 1, 1e-6);
}

TEST(Guard, NeverExceedsItsBoundsWhateverComesIn)
{
    Bench bench;
    bench.open();
    unsigned seed = 7;
    double last[3] = {1, 0, 0};
    for (int i = 0; i < 4000; ++i) {
        for (double &p : bench.push) {
            seed = seed * 1664525u + 1013904223u;
            p = (static_cast<double>(seed) / 2147483648.0 - 1) * (i % 7 ? 50 : 1e9);
        }
        const Guard::Output out = bench.turn();
        double way = 0;
        for (int d = 0; d < 3; ++d) way += (out.force[d] - last[d]) * (out.force[d] - last[d]), last[d] = out.force[d];
        ASSERT_LE(size_of(out), bench.settings.largest + 1e-9);
        ASSERT_LE(std::sqrt(way), bench.settings.rate * tick + 1e-9);
    }
    EXPECT_GT(bench.guard.clamped(), 1000u);
}

TEST(Guard, LetsSlowForcesThroughAndDampsFastOnes)
{
    for (double frequency : {1.0, 80.0}) {
        Bench bench([](GuardSettings &settings) { settings.rate = 1e6, settings.largest = 1e6, settings.ramp = 0; });
        double largest = 0;
        for (int i = 0; i < 2000; ++i) {
            bench.push[0] = -4 * std::sin(2 * M_PI * frequency * bench.now);
            const Guard::Output out = bench.turn();
            if (i > 1000) largest = std::max(largest, std::fabs(out.force[0]));
        }
        if (frequency < 30) EXPECT_NEAR(largest, 1, 0.01);
        else EXPECT_LT(largest, 0.6);
    }
}

TEST(Guard, IsOffUnlessAskedFor)
{
    Bench bench([](GuardSettings &settings) { settings.enabled = false; });
    EXPECT_FALSE(bench.turns(2).send);
    EXPECT_NE(bench.guard.why(bench.now).find("haptic"), std::string::npos);
    EXPECT_FALSE(GuardSettings().enabled);
}

TEST(Guard, NeedsNoFollowingWhereThereIsNoTeleoperation)
{
    Bench bench([](GuardSettings &settings) { settings.needs_following = false; });
    bench.guard.following(false);
    bench.open();
}

TEST(Guard, ShutDownIsAZeroAndThenNothingForGood)
{
    Bench bench;
    bench.open();
    const Guard::Output out = bench.guard.shut_down();
    EXPECT_TRUE(out.send);
    EXPECT_EQ(size_of(out), 0);
    EXPECT_FALSE(bench.turns(2).send);
    EXPECT_EQ(bench.guard.state(), GuardState::CLOSED);
}

TEST(Guard, AClockThatStandsOrJumpsMovesNothing)
{
    Bench bench;
    bench.open();
    const Guard::Output before = bench.turn(), same = bench.guard.update(bench.now);
    for (int d = 0; d < 3; ++d) EXPECT_EQ(before.force[d], same.force[d]);
    bench.push[0] = 4;
    bench.now += 100;
    EXPECT_EQ(size_of(bench.guard.update(bench.now)), 0); // all that it has is old by then
}

} // namespace
