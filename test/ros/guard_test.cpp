// The guard between the simulation's forces and a hand: every transition of its table, and input that must never pass.
#include "ros/guard/guard_parameters.h"

#include <gtest/gtest.h>

#include <cmath>
#include <functional>
#include <limits>
#include <string>
#include <utility>

using namespace pliant_ros;

namespace {

const double nan = std::numeric_limits<double>::quiet_NaN(), tick = 0.005;

struct Bench {
    GuardSettings settings;
    Guard guard;
    double now = 10, push[3] = {-4, 0, 0};
    bool poses = true, forces = true, errors = true;

    explicit Bench(const std::function<void(GuardSettings &)> &set = [](GuardSettings &) {})
        : settings(make(set)), guard(settings)
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

double size_of(const Guard::Output &out)
{
    return std::sqrt(out.force[0] * out.force[0] + out.force[1] * out.force[1] + out.force[2] * out.force[2]);
}

TEST(Guard, RampsUpFromZeroAndScalesTheForce)
{
    Bench bench;
    Guard::Output out = bench.guard.update(bench.now); // without any input
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

// An earlier guard may have been killed, and the hand may still apply its last force.
TEST(Guard, StartsWithZeros)
{
    Bench bench;
    bench.guard.following(false);
    bench.now += 50; // after its creation there was no subscriber
    for (double end = bench.now + bench.settings.tail - 2 * tick; bench.now < end;) {
        const Guard::Output out = bench.turn();
        ASSERT_TRUE(out.send);
        ASSERT_EQ(size_of(out), 0);
    }
    bench.turns(0.1);
    EXPECT_EQ(bench.guard.state(), GuardState::CLOSED);
    EXPECT_FALSE(bench.turn().send);
}

enum Event { GATES_OPEN, A_GATE_CLOSES, RAMP_PASSES, TAIL_PASSES, A_FAULT, A_SHUTDOWN };

struct Edge {
    GuardState from;
    Event event;
    GuardState to; // the same state if there is no transition
};

class EveryEdge : public testing::TestWithParam<Edge> {};

void bring(Bench &bench, GuardState state)
{
    bench.guard.following(state == GuardState::RISING || state == GuardState::OPEN);
    if (state == GuardState::FAULT) bench.guard.fault("a parameter");
    bench.turn();
    if (state == GuardState::CLOSED || state == GuardState::FAULT) bench.turns(bench.settings.tail + 2 * tick);
    if (state == GuardState::OPEN) bench.turns(bench.settings.ramp + 2 * tick);
    ASSERT_EQ(bench.guard.state(), state);
}

// Every line of the table in guard.h; combinations without a line leave the state unchanged.
TEST_P(EveryEdge, ChangesStateByTheTable)
{
    Bench bench;
    bring(bench, GetParam().from);
    if (testing::Test::HasFatalFailure()) return;
    Guard::Output out{};
    switch (GetParam().event) {
    case GATES_OPEN: bench.guard.following(true), out = bench.turn(); break;
    case A_GATE_CLOSES: bench.guard.simulation(false), out = bench.turn(); break;
    case RAMP_PASSES: out = bench.turns(bench.settings.ramp + 2 * tick); break;
    case TAIL_PASSES: out = bench.turns(bench.settings.tail + 2 * tick); break;
    case A_FAULT: bench.guard.fault("~gain is -1"), out = bench.turn(); break;
    case A_SHUTDOWN: out = bench.guard.shut_down(); break;
    }
    const GuardState to = GetParam().to;
    EXPECT_STREQ(guard_state_name(bench.guard.state()), guard_state_name(to));
    EXPECT_EQ(out.send, GetParam().event == A_SHUTDOWN || (to != GuardState::CLOSED && to != GuardState::FAULT));
    if (to != GuardState::RISING && to != GuardState::OPEN) EXPECT_EQ(size_of(out), 0);
    if (to == GuardState::OPEN) EXPECT_GT(size_of(out), 0.1);
    if (GetParam().event == A_FAULT) {
        EXPECT_EQ(bench.guard.why(bench.now), "~gain is -1");
        bench.guard.simulation(true), bench.guard.following(true);
        EXPECT_FALSE(bench.turns(2).send) << "for good";
        EXPECT_EQ(bench.guard.state(), GuardState::FAULT);
    }
    if (GetParam().event == A_SHUTDOWN) {
        bench.guard.simulation(true), bench.guard.following(true);
        EXPECT_FALSE(bench.turns(2).send) << "for good";
        EXPECT_EQ(bench.guard.state(), GuardState::CLOSED);
    }
}

const GuardState C = GuardState::CLOSED, R = GuardState::RISING, O = GuardState::OPEN, E = GuardState::ENDING,
                 F = GuardState::FAULT;
const Edge edges[] = {
    {C, GATES_OPEN, R},    {C, A_GATE_CLOSES, C}, {C, RAMP_PASSES, C},   {C, TAIL_PASSES, C},   {C, A_FAULT, F},
    {C, A_SHUTDOWN, C},    {R, GATES_OPEN, R},    {R, A_GATE_CLOSES, E}, {R, RAMP_PASSES, O},   {R, TAIL_PASSES, R},
    {R, A_FAULT, E},       {R, A_SHUTDOWN, C},    {O, GATES_OPEN, O},    {O, A_GATE_CLOSES, E}, {O, RAMP_PASSES, O},
    {O, TAIL_PASSES, O},   {O, A_FAULT, E},       {O, A_SHUTDOWN, C},    {E, GATES_OPEN, R},    {E, A_GATE_CLOSES, E},
    {E, RAMP_PASSES, C},   {E, TAIL_PASSES, C},   {E, A_FAULT, E},       {E, A_SHUTDOWN, C},    {F, GATES_OPEN, F},
    {F, A_GATE_CLOSES, F}, {F, RAMP_PASSES, F},   {F, TAIL_PASSES, F},   {F, A_FAULT, F},       {F, A_SHUTDOWN, C}};
std::string edge_name(const testing::TestParamInfo<Edge> &each)
{
    static const char *const events[] = {"GatesOpen", "AGateCloses", "RampPasses", "TailPasses", "AFault", "AShutdown"};
    return std::string(guard_state_name(each.param.from)) + events[each.param.event];
}
INSTANTIATE_TEST_SUITE_P(Table, EveryEdge, testing::ValuesIn(edges), edge_name);

struct Closing {
    const char *name;
    std::function<void(Bench &)> happens;
    const char *why;
};

class EveryGate : public testing::TestWithParam<Closing> {};

TEST_P(EveryGate, EndsInZerosWithinFiftyMillisecondsAndThenStops)
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
    {"ErrorNotKnown", [](Bench &bench) { bench.errors = false, bench.guard.error(bench.now, 0); }, "does not report"},
    {"ErrorNoNumber", [](Bench &bench) { bench.errors = false, bench.guard.error(bench.now, nan); },
     "error is too large"},
};
INSTANTIATE_TEST_SUITE_P(Every, EveryGate, testing::ValuesIn(closings),
                         [](const testing::TestParamInfo<Closing> &each) { return each.param.name; });

TEST(Guard, IsClosedWithoutRecentErrors)
{
    Bench bench;
    bench.open();
    bench.errors = false;
    EXPECT_EQ(size_of(bench.turns(bench.settings.error_timeout + 2 * tick)), 0);
    EXPECT_NE(bench.guard.why(bench.now).find("does not report"), std::string::npos);
}

TEST(Guard, NeedsNoErrorWithoutALimit)
{
    Bench bench([](GuardSettings &settings) { settings.largest_error = INFINITY; });
    bench.errors = false;
    bench.open();
}

TEST(Guard, ReopensFromZeroWhileEnding)
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

TEST(Guard, NeverExceedsItsBounds)
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

TEST(Guard, IsALowPassFilter)
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

TEST(Guard, IsDisabledByDefault)
{
    Bench bench([](GuardSettings &settings) { settings.enabled = false; });
    EXPECT_FALSE(bench.turns(2).send);
    EXPECT_NE(bench.guard.why(bench.now).find("haptic"), std::string::npos);
    EXPECT_FALSE(GuardSettings().enabled);
}

TEST(Guard, NeedsNoFollowingWithoutTeleoperation)
{
    Bench bench([](GuardSettings &settings) { settings.needs_following = false; });
    bench.guard.following(false);
    bench.open();
}

TEST(Guard, ShutDownSendsAZeroAndThenNothing)
{
    Bench bench;
    bench.open();
    const Guard::Output out = bench.guard.shut_down();
    EXPECT_TRUE(out.send);
    EXPECT_EQ(size_of(out), 0);
    EXPECT_FALSE(bench.turns(2).send);
    EXPECT_EQ(bench.guard.state(), GuardState::CLOSED);
}

// The guard does not exit, because it would be restarted endlessly while the hand keeps its last force.
TEST(Guard, WithAWrongParameterItSendsOnlyZeros)
{
    Bench bench;
    bench.guard.fault("~gain is -1; it must be from 1e-06 to 100");
    for (double end = bench.now + bench.settings.tail - 2 * tick; bench.now < end;) {
        const Guard::Output out = bench.turn();
        ASSERT_TRUE(out.send);
        ASSERT_EQ(size_of(out), 0);
    }
    EXPECT_FALSE(bench.turns(3).send);
    EXPECT_EQ(bench.guard.state(), GuardState::FAULT);
    EXPECT_NE(bench.guard.why(bench.now).find("~gain"), std::string::npos);
    Bench off([](GuardSettings &settings) { settings.enabled = false; });
    off.guard.fault("~tool");
    EXPECT_EQ(off.guard.state(), GuardState::FAULT);
    EXPECT_FALSE(off.turns(1).send);
}

XmlRpc::XmlRpcValue parameters(const char *name, const XmlRpc::XmlRpcValue &value)
{
    XmlRpc::XmlRpcValue tree;
    tree["tool"] = "PSM1";
    tree["haptic"] = true;
    tree[name] = value;
    return tree;
}

TEST(GuardParameters, AreReadAndTheOthersHaveDefaults)
{
    GuardParameters read;
    std::string why;
    XmlRpc::XmlRpcValue tree = parameters("gain", 0.1);
    tree["max_force"] = 1; // integers as from YAML
    tree["max_error"] = -1;
    tree["diagnostic_period"] = 0.5;
    ASSERT_TRUE(read_guard_parameters(tree, &read, &why)) << why;
    EXPECT_EQ(read.tool, "PSM1");
    EXPECT_TRUE(read.settings.enabled);
    EXPECT_EQ(read.settings.gain, 0.1);
    EXPECT_EQ(read.settings.largest, 1);
    EXPECT_TRUE(std::isinf(read.settings.largest_error));
    EXPECT_EQ(read.settings.rate, GuardSettings().rate);
    EXPECT_EQ(read.rate, 200);
}

TEST(GuardParameters, WrongOnesAreNamedAndZerosAreSent)
{
    const std::pair<const char *, XmlRpc::XmlRpcValue> wrong[] = {
        {"gain", -1.0},       {"gain", "much"},       {"max_force", 0},  {"max_force", nan}, {"max_rate", -20},
        {"cutoff", 0.0},      {"ramp", 0.0},          {"tail", -1.0},    {"timeout", 0.6},   {"max_error", nan},
        {"max_error", "any"}, {"rate", 1e9},          {"rate", 1},       {"tool", ""},       {"tool", 7},
        {"tool", "PSM 1"},    {"needs_following", 1}, {"max_forse", 1.0}};
    for (const auto &each : wrong) {
        GuardParameters read;
        std::string why;
        EXPECT_FALSE(read_guard_parameters(parameters(each.first, each.second), &read, &why)) << each.first;
        EXPECT_EQ(why.find("~" + std::string(each.first)), 0u) << why;
        EXPECT_TRUE(read.settings.enabled) << each.first;
        EXPECT_EQ(read.settings.gain, GuardSettings().gain);
    }
    GuardParameters read;
    std::string why;
    for (const XmlRpc::XmlRpcValue &haptic : {XmlRpc::XmlRpcValue("yes"), XmlRpc::XmlRpcValue(1)}) {
        EXPECT_FALSE(read_guard_parameters(parameters("haptic", haptic), &read, &why));
        EXPECT_EQ(why.find("~haptic"), 0u) << why;
        EXPECT_TRUE(read.settings.enabled) << "somebody wanted it: zeros go out";
    }
    EXPECT_TRUE(read_guard_parameters(parameters("haptic", false), &read, &why)) << why;
    EXPECT_FALSE(read.settings.enabled);
    EXPECT_FALSE(read_guard_parameters(XmlRpc::XmlRpcValue(), &read, &why));
    EXPECT_EQ(why.find("~tool"), 0u) << why;
}

TEST(Guard, AClockThatStandsOrJumpsMovesNothing)
{
    Bench bench;
    bench.open();
    const Guard::Output before = bench.turn(), same = bench.guard.update(bench.now);
    for (int d = 0; d < 3; ++d) EXPECT_EQ(before.force[d], same.force[d]);
    bench.push[0] = 4;
    bench.now += 100;
    EXPECT_EQ(size_of(bench.guard.update(bench.now)), 0); // all inputs are too old by then
}

} // namespace
