// Contact of fast tools: random sweeps through a sheet (test/pipeline/sweeps.h), then rest, and jaws that jam and open.
//
// Usage:
//   bench_sweeps [sweeps [first]]     default: 200 from number 0; one thread
//
// Figures, over the sweeps whose path does not meet a fixed side:
//   tunneled; inverted     sweeps in which tissue passes a tool, or an element is inverted after any step
//   behind after 3, 25     fraction with a proxy error of at least 0.2 mm so many steps after the target stopped
//   resting spread         (largest - smallest) / mean force over steps 30 to 40 of rest, median and 95th percentile
//   step time              worst step of each sweep over the time of a step with all evaluations and no contact
//   jam                    steps until the proxies of two plates that had crushed the sheet are at their open targets
#include "../pipeline/sweeps.h"
#include "figure.h"

namespace {

enum { REST = 40 };

double seconds()
{
    timespec now;
    clock_gettime(CLOCK_THREAD_CPUTIME_ID, &now);
    return double(now.tv_sec) + 1e-9 * double(now.tv_nsec);
}

double at_fraction(std::vector<double> values, double fraction)
{
    if (values.empty()) return NAN;
    std::sort(values.begin(), values.end());
    return values[static_cast<size_t>(fraction * static_cast<double>(values.size() - 1))];
}

double timed_step(Sheet &sheet)
{
    const double start = seconds();
    EXPECT_GE(pliant_step(sheet.model, sheet.data), 0) << pliant_last_error();
    return seconds() - start;
}

// Return the magnitude of the contact force on the tissue [N].
double force_of(const Sheet &sheet)
{
    double sum[3] = {0, 0, 0};
    std::vector<pliant_contact> contacts(static_cast<size_t>(pliant_data_get_contacts(sheet.data, 0, nullptr)));
    pliant_data_get_contacts(sheet.data, static_cast<int32_t>(contacts.size()), contacts.data());
    for (const pliant_contact &contact : contacts)
        for (int d = 0; d < 3; d++) sum[d] += contact.force[d];
    return std::hypot(std::hypot(sum[0], sum[1]), sum[2]);
}

// Return the time of a step that makes all its evaluations and has no contact: gravity turns, and no tolerance is met.
double full_step()
{
    Sheet sheet(1, 0.08, 0, PLIANT_LINEAR, false, [](pliant_scene &scene) { scene.solver.tolerance = 1e-12; });
    std::vector<double> times;
    for (int step = 0; step < 20; step++) {
        const double gravity[3] = {step % 2 ? 9.81 : -9.81, 0, -9.81};
        EXPECT_EQ(pliant_data_set_gravity(sheet.data, gravity), PLIANT_OK);
        const double time = timed_step(sheet);
        if (sheet.data->statistics.iterations >= 30) times.push_back(time);
    }
    return at_fraction(times, 0.5);
}

struct Outcome {
    int count = 0, tunneled = 0, inverted = 0;
    std::vector<double> after3, after25, spread, worst, usual;
    int32_t evaluations = 0;
};

void sweep_and_rest(const SweepPath &on, Outcome &out)
{
    const std::unique_ptr<Sheet> made = sheet_for(on, {});
    Sheet &sheet = *made;
    const int tool = sheet.add("tool", shape_of(on.part), on.from[0], on.from[1], on.from[2]);
    bool path_meets_fixed_side = false;
    int inverted = 0;
    double worst = 0, after3 = 0, after25 = 0, low = 1e9, high = 0, sum = 0;
    std::vector<double> times;
    for (int step = 0; step <= on.steps() + REST; step++) {
        const int rest = step - on.steps();
        move(sheet, tool, on, step);
        path_meets_fixed_side = path_meets_fixed_side || path_crosses_fixed_side(sheet, tool, on, step);
        const double time = timed_step(sheet);
        inverted = std::max(inverted, sheet.turned());
        out.evaluations = std::max(out.evaluations, sheet.data->statistics.iterations);
        if (rest <= 0) times.push_back(time), worst = std::max(worst, time);
        if (rest == 3) after3 = sheet.data->statistics.proxy_error;
        if (rest == 25) after25 = sheet.data->statistics.proxy_error;
        if (rest < 30) continue;
        const double force = force_of(sheet);
        low = std::min(low, force), high = std::max(high, force), sum += force / (REST - 29);
    }
    if (path_meets_fixed_side) return;
    const Swept swept = {sheet.max_surface_penetration(tool),
                         sheet.farthest(),
                         sheet.count_axis_points_inside(tool),
                         inverted,
                         sheet.data->statistics.proxy_error,
                         0,
                         0,
                         false};
    out.count++;
    out.tunneled += has_tunneled(swept, on);
    out.inverted += inverted > 0;
    out.after3.push_back(after3), out.after25.push_back(after25);
    if (sum > 1e-4) out.spread.push_back((high - low) / sum);
    out.worst.push_back(worst), out.usual.push_back(at_fraction(times, 0.5));
}

double fraction_above(const std::vector<double> &values, double limit)
{
    return static_cast<double>(std::count_if(values.begin(), values.end(), [limit](double v) { return v >= limit; })) /
           static_cast<double>(values.size());
}

// Return the steps that two plates need to follow their targets apart, after they have crushed the sheet by `depth`.
int open_after(double depth, double friction)
{
    Sheet sheet(1, friction);
    pliant_tool_shape plate{};
    plate.num_parts = 1;
    plate.part[0] = {PLIANT_PART_BOX, PLIANT_FRAME_TIP, {-0.006, -0.006, -0.001}, {0.006, 0.006, 0.001}, 0, false};
    const int above = sheet.add("above", plate, 0.03, 0.03, 0.01),
              below = sheet.add("below", plate, 0.03, 0.03, -0.006);
    for (int step = 1; step <= 30; step++) {
        const double close = std::min(1.0, step / 20.0) * (0.005 + 0.5 * depth);
        sheet.move(above, 0.03, 0.03, 0.01 - close);
        sheet.move(below, 0.03, 0.03, -0.006 + close);
        timed_step(sheet);
    }
    for (int step = 1; step <= 100; step++) {
        sheet.move(above, 0.03, 0.03, 0.014);
        sheet.move(below, 0.03, 0.03, -0.01);
        timed_step(sheet);
        if (sheet.data->statistics.proxy_error < 2e-4) return step;
    }
    return 101;
}

} // namespace

int main(int argc, char **argv)
{
    const int first = argc > 2 ? std::atoi(argv[2]) : 0, count = first + (argc > 1 ? std::atoi(argv[1]) : 200);
    Sweeps sweeps;
    Outcome out;
    for (int n = 0; n < count; n++) {
        const SweepPath on = sweeps.next();
        if (n >= first) sweep_and_rest(on, out);
    }
    const double full = full_step();
    figure("sweeps", out.count, "");
    figure("tunneled", out.tunneled, "");
    figure("with inverted elements", out.inverted, "");
    figure("evaluations of a step, most", out.evaluations, "");
    figure("behind after 3 steps", fraction_above(out.after3, 2e-4), "of sweeps");
    figure("behind after 25 steps", fraction_above(out.after25, 2e-4), "of sweeps");
    figure("largest error after 25 steps", 1e3 * at_fraction(out.after25, 1), "mm");
    figure("spread of the resting force, median", at_fraction(out.spread, 0.5), "");
    figure("spread of the resting force, 95 %", at_fraction(out.spread, 0.95), "");
    figure("spread of the resting force, worst", at_fraction(out.spread, 1), "");
    figure("worst step of a sweep, median", at_fraction(out.worst, 0.5) / full, "steps without contact");
    figure("worst step of all sweeps", at_fraction(out.worst, 1) / full, "steps without contact");
    for (const double depth : {0.0, 0.002, 0.003, 0.005, 0.01})
        for (const double friction : {0.08, 0.5}) {
            char name[80];
            std::snprintf(name, sizeof name, "steps until plates are open, closed to %g mm, friction %g",
                          4 - 1e3 * depth, friction);
            figure(name, open_after(depth, friction), "steps");
        }
    return testing::UnitTest::GetInstance()->failed_test_count() > 0;
}
