// Forces between steps, with a simulation whose steps are delayed as in the node: poses arrive at 1 kHz, a step starts
// every 20 ms and ends 12 ms later. No ROS, no clock.
#include "../pipeline/body.h"
#include "ros/sim/wrench_predictor.h"
#include "ros/sim/pose_filter.h"

#include <algorithm>

namespace {

using pliant_ros::WrenchPredictor;

const int size[3] = {6, 6, 6};
const double box[3] = {0.12, 0.12, 0.12}, still[4] = {0, 0, 0, 1};
enum { STEP = 20, LATE = 12 /* [ms] */ };

// A stroke: position of the tip relative to the grasp.
struct TipPath {
    const char *name;
    double (*at)(int millisecond, int axis);
    int milliseconds;
};

double fast(int t, int axis) { return (axis == 2 ? 0.02 : 0.008) * std::pow(std::sin(M_PI * t / 200), 2); } // 0.3 m/s
double slow(int t, int axis) { return (axis == 2 ? 0.02 : 0.008) * std::pow(std::sin(M_PI * t / 1500), 2); }
double pushed(int t, int axis) { return (axis == 2 ? -0.01 : 0.004) * std::pow(std::sin(M_PI * t / 600), 2); }
double shaken(int t, int axis) { return slow(t, axis) + 5e-4 * std::sin(0.3 * t + axis); } // 48 Hz
// encoder noise
double noisy(int t, int axis) { return slow(t, axis) + 2e-5 * ((t * 7919 + axis * 104729) % 101 / 50.0 - 1); }
double stepped(int t, int axis) { return slow(t / 10 * 10, axis); } // poses at 100 Hz
const TipPath paths[] = {{"fast", fast, 600},      {"slow", slow, 3000},   {"pushed", pushed, 1200},
                    {"shaken", shaken, 3000}, {"noisy", noisy, 3000}, {"stepped", stepped, 3000}};

struct StrokeResult {
    double in = 0, out = 0, minimum = 0; // energy put in, energy returned, and minimum of the difference [J]
    double jump = 0, zero_order = 0;     // maximum change of the force between two answers, and between two steps [N]
    double off = 0, maximum = 0;         // maximum difference from the force of the step at its pose [N]; maximum force
};

struct Held : Body {
    int tool = -1;
    const double rest[3] = {0.06, 0.06, 0.11};

    explicit Held(pliant_solver_kind kind) : Body(size, box, {{4000, 0.45, 1000, false}})
    {
        fix_plane(0, 0, 0.041, 0, 0, 1);
        cells(6, 6, 6, 1);
        for (double &g : scene.model.gravity) g = 0;
        scene.solver.kind = kind;
        scene.solver.iterations = 4;
        scene.solver.threads = 1;
        scene.solver.step = 0.001 * STEP;
        scene.tled.damping = 60;
        EXPECT_EQ(build(), PLIANT_OK) << pliant_last_error();
        EXPECT_EQ(pliant_tool_add(model, data, "hand", &tool), PLIANT_OK);
        EXPECT_EQ(pliant_tool_set_pose(data, tool, rest, still), PLIANT_OK);
        EXPECT_EQ(pliant_tool_grasp(model, data, tool, nullptr), PLIANT_OK) << pliant_last_error();
        EXPECT_GE(pliant_step(model, data), 0);
    }

    StrokeResult stroke(const TipPath &path, double maximum = 5)
    {
        StrokeResult result;
        WrenchPredictor between(maximum);
        pliant_tool_linear linear{}, ready{};
        double now[6], before[6] = {}, last[3] = {}, answered[STEP][6] = {}, step_force[3] = {};
        EXPECT_EQ(pliant_tool_linearize(data, tool, &linear), PLIANT_OK);
        pliant_tool_linear nothing{};
        nothing.known = true;
        between.frame(-0.021, nothing, true); // before the grasp
        between.answer(-0.011, rest, still, now);
        between.frame(-0.001, linear, true);
        for (int t = 0; t <= path.milliseconds + 500; t++) {
            double tip[3], moved = 0, changed = 0;
            for (int d = 0; d < 3; d++) tip[d] = rest[d] + path.at(std::min(t, path.milliseconds), d);
            if (t % STEP == 0) {
                EXPECT_EQ(pliant_tool_set_pose(data, tool, tip, still), PLIANT_OK);
                EXPECT_GE(pliant_step(model, data), 0) << pliant_last_error();
                EXPECT_EQ(pliant_tool_linearize(data, tool, &linear), PLIANT_OK);
                ready = linear;
            }
            if (t % STEP == LATE) between.frame(0.001 * t - 0.0005, ready, true);
            between.answer(0.001 * t, tip, still, now);
            for (int d = 0; d < 3 && t > 0; d++) moved += before[d] * (tip[d] - last[d]);
            (moved > 0 ? result.in : result.out) += std::fabs(moved);
            result.minimum = std::min(result.minimum, result.in - result.out);
            for (int d = 0; d < 3 && t > 0; d++) changed += std::pow(now[d] - before[d], 2);
            result.jump = std::max(result.jump, std::sqrt(changed));
            std::copy(now, now + 6, answered[t % STEP]);
            if (t % STEP == LATE) {
                double off = 0, force = 0, jump = 0;
                for (int d = 0; d < 3; d++) {
                    off += std::pow(answered[0][d] - ready.wrench[d], 2);
                    force += std::pow(ready.wrench[d], 2);
                    jump += std::pow(ready.wrench[d] - step_force[d], 2);
                    step_force[d] = ready.wrench[d];
                }
                result.off = std::max(result.off, std::sqrt(off));
                result.maximum = std::max(result.maximum, std::sqrt(force));
                result.zero_order = std::max(result.zero_order, std::sqrt(jump));
            }
            std::copy(now, now + 6, before);
            std::copy(tip, tip + 3, last);
        }
        return result;
    }
};

TEST(WrenchPredictor, IsPassive)
{
    for (pliant_solver_kind kind : {PLIANT_COROTATIONAL, PLIANT_TLED})
        for (const TipPath &path : paths) {
            Held held(kind);
            const StrokeResult result = held.stroke(path);
            SCOPED_TRACE(path.name);
            printf("%s %s: in %.5f J, out %.5f, least left %.2g (%.3f %%); jump %.3f N of %.3f; off %.3f of %.3f\n",
                   kind == PLIANT_TLED ? "tled" : "quasi-static", path.name, result.in, result.out, result.minimum,
                   100 * result.minimum / result.in, result.jump, result.zero_order, result.off, result.maximum);
            EXPECT_GE(result.minimum, -0.01 * result.in);
            EXPECT_GT(result.in, 0.015);
            // forces of steps alone jump by 0.15 to 0.2 N
            if (path.at == slow || path.at == pushed || path.at == stepped) {
                EXPECT_LT(result.jump, 0.15 * result.maximum / 4);
                EXPECT_LT(result.off, 0.06 * result.maximum);
            }
            // and the stiffness of the tissue is preserved
            if (kind == PLIANT_COROTATIONAL) EXPECT_GT(result.out, 0.95 * result.in);
        }
}

// The force differs from the step's force by at most the bound, decays smoothly within 50 ms, and returns with a ramp.
TEST(WrenchPredictor, IsBoundedAndRises)
{
    Held held(PLIANT_COROTATIONAL);
    WrenchPredictor between(0.5);
    pliant_tool_linear linear{};
    const double pulled[3] = {0.06, 0.06, 0.12}, far[3] = {0.06, 0.06, 0.42};
    double out[6];
    for (int s = 0; s < 10; s++) {
        ASSERT_EQ(pliant_tool_set_pose(held.data, held.tool, pulled, still), PLIANT_OK);
        ASSERT_GE(pliant_step(held.model, held.data), 0);
    }
    ASSERT_EQ(pliant_tool_linearize(held.data, held.tool, &linear), PLIANT_OK);
    const double force = linear.wrench[2];
    ASSERT_GT(force, 1);
    between.frame(0, linear, true);
    double last = 0;
    for (int t = 0; t < 300; t++) {
        double tip[3] = {0.06, 0.06, std::min(0.12, 0.11 + 0.0001 * t)};
        between.answer(0.001 * t, tip, still, out);
        EXPECT_LT(std::fabs(out[2] - last), 0.03) << t;
        last = out[2];
    }
    EXPECT_NEAR(last, force, 1e-9);
    between.stop();
    between.answer(0.309, pulled, still, out);
    EXPECT_GT(out[2], 0.5 * last);
    EXPECT_LT(out[2], 0.9 * last);
    between.answer(0.33, pulled, still, out);
    for (double x : out) EXPECT_EQ(x, 0);
    between.frame(0.34, linear, true);
    for (int t = 341; t < 400; t++) {
        between.answer(0.001 * t, pulled, still, out);
        EXPECT_LT(std::fabs(out[2]), 0.4 * force) << t;
    }
    between.answer(0.7, far, still, out);
    EXPECT_LE(out[2], force + 0.5 + 1e-9);
}

// Return the force after three seconds of a spring of 500 N/m that holds a force, with poses at 1 kHz with encoder
// noise, and steps of 20 ms.
double after_a_while(double force_at(int millisecond), double outlier_at(int millisecond))
{
    WrenchPredictor between(5);
    pliant_tool_linear linear{};
    linear.known = true;
    linear.rotation[3] = 1;
    for (int i = 0; i < 3; i++) linear.stiffness[7 * i] = 500;
    double out[6] = {};
    for (int t = 0; t < 3000; t++) {
        const double now = 0.001 * t, tip[3] = {0, 0, outlier_at(t) + 2e-5 * ((t * 7919) % 101 / 50.0 - 1)};
        linear.wrench[2] = force_at(t);
        if (t % STEP == 0) between.frame(now, linear, true);
        between.answer(now, tip, still, out);
    }
    return out[2];
}

TEST(WrenchPredictor, RestoresAConstantForce)
{
    const auto straight = [](int) { return 0.0; };
    EXPECT_NEAR(after_a_while([](int) { return 5.0; }, straight), 5, 0.1) << "held again after a pause";
    EXPECT_NEAR(after_a_while([](int t) { return std::min(4.0, 0.002 * t); }, straight), 4, 0.1)
        << "another hand pulls the tissue";
    EXPECT_NEAR(after_a_while([](int) { return 5.0; }, [](int t) { return t == 1500 ? -0.03 : 0.0; }), 5, 0.1)
        << "a pose that was far off";
    EXPECT_NEAR(
        after_a_while([](int) { return 2.5; }, [](int t) { return t < 1000 ? 0.005 - 3e-4 * std::min(t, 16) : 2e-4; }),
        2.5, 0.2)
        << "back fast, then still";
}

// Without forces between steps: a sudden force starts at zero, a lost force decays, and a force that starts at zero is
// unchanged.
TEST(Ramp, BeginsAndEndsSoftly)
{
    pliant_ros::Ramp ramp;
    const auto result = [&](double now, bool acts, double force) {
        double wrench[6] = {0, 0, force, 0, 0, 0};
        ramp.apply(now, acts, wrench);
        return wrench[2];
    };
    EXPECT_EQ(result(0, true, 0), 0);
    EXPECT_EQ(result(0.02, true, 3), 3) << "from no force";
    EXPECT_NEAR(result(0.04, false, 0), 1, 1e-9) << "held still: two thirds of 30 ms on";
    EXPECT_EQ(result(0.06, false, 7), 0);
    EXPECT_EQ(result(1, true, 6), 0) << "running again";
    EXPECT_NEAR(result(1.1, true, 6), 3, 1e-9);
    EXPECT_EQ(result(1.3, true, 6), 6);
}

TEST(PoseFilter, RemovesJitterWhenEnabled)
{
    pliant_ros::PoseFilter off, on(5);
    pliant_ros::Rigid pose = pliant_ros::identity(), result;
    double shaken = 0, smooth = 0;
    for (int t = 0; t < 1000; t++) {
        const double jitter = 1e-3 * ((t * 7919) % 101 / 50.0 - 1), half = 0.5 * (0.3 + jitter);
        pose.translation[0] = 0.1 + jitter;
        // both signs are the same rotation
        pose.rotation[2] = (t % 2 ? -1 : 1) * std::sin(half), pose.rotation[3] = (t % 2 ? -1 : 1) * std::cos(half);
        const pliant_ros::Rigid same = off.next(0.01 * t, "arm", pose);
        for (int d = 0; d < 3; d++) ASSERT_EQ(same.translation[d], pose.translation[d]);
        for (int i = 0; i < 4; i++) ASSERT_EQ(same.rotation[i], pose.rotation[i]);
        result = on.next(0.01 * t, "arm", pose);
        ASSERT_NEAR(2 * std::asin(std::fabs(result.rotation[2])), 0.3, t < 100 ? 1.1e-3 : 8e-4);
        if (t < 100) continue;
        shaken += std::pow(jitter, 2);
        smooth += std::pow(result.translation[0] - 0.1, 2);
    }
    EXPECT_LT(smooth, 0.25 * shaken);
    pose.translation[0] = 0.4;
    EXPECT_EQ(on.next(11, "arm", pose).translation[0], 0.4) << "after a gap it begins anew";
    pose.translation[0] = 0.1;
    EXPECT_GT(on.next(11.01, "arm", pose).translation[0], 0.2);
    EXPECT_EQ(on.next(11.02, "camera", pose).translation[0], 0.1) << "in another frame, too";
    result = on.next(11.03, "camera", pose);
    EXPECT_EQ(result.translation[0], 0.1);
    pose.translation[0] = 0.4;
    EXPECT_EQ(on.next(11.03, "camera", pose).translation[0], 0.1) << "two of one stamp";
    EXPECT_EQ(on.next(11.01, "camera", pose).translation[0], 0.1) << "one that comes late";
    result = on.next(11.04, "camera", pose);
    EXPECT_GT(result.translation[0], 0.15);
    EXPECT_LT(result.translation[0], 0.25) << "it goes on from there";
    EXPECT_EQ(on.next(1, "camera", pose).translation[0], 0.4) << "a clock that was set back";
}

} // namespace
