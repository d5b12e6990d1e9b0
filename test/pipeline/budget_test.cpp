// Steps with a budget of one or two evaluations, measured by a simulated clock, so that the machine's load has no
// effect.
#include "fem/quasistatic/solver.h"
#include "model_data/background.h"
#include "model_data/data.h"
#include "pliant/pliant.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <cstring>
#include <string>
#include <vector>

namespace {

// Simulated clock: an evaluation takes 3 to 8 ms, or a given time.
struct Clock {
    double from = 3, to = 8;
    const pliant_solver *solver;
    int64_t counted = 0;
    uint32_t random = 1;
    double now = 0;

    static double tell(void *user)
    {
        Clock &clock = *static_cast<Clock *>(user);
        // the count restarts with each change of the axes
        if (clock.solver->in_use.evaluations < clock.counted) clock.counted = 0;
        for (; clock.counted < clock.solver->in_use.evaluations; clock.counted++) {
            clock.random = clock.random * 1664525u + 1013904223u;
            clock.now += 1e-3 * (clock.from + (clock.to - clock.from) * (clock.random >> 8) / double(1 << 24));
        }
        return clock.now;
    }
};

const char *const scan_name = "phantom:128x80x61";
const int frames = 150;
const double liver[3] = {-0.054, -0.063, 0.063};

class Phantom {
public:
    pliant_scene scene;
    pliant_model *model = nullptr;
    pliant_data *data = nullptr;

    explicit Phantom(bool exact, const std::vector<std::string> &options = {})
    {
        EXPECT_EQ(pliant_scene_read(PLIANT_SOURCE_DIR "/launch/scenes/demo.yaml", &scene), PLIANT_OK)
            << pliant_last_error();
        EXPECT_EQ(pliant_inputs_read(&scene, scan_name, &scan, &labels, &table), PLIANT_OK) << pliant_last_error();
        scene.element.kind = PLIANT_LINEAR; // the error bounds were determined for linear tetrahedra
        scene.solver.threads = 2;
        scene.solver.backend = PLIANT_CPU;
        scene.solver.iterations = exact ? 50 : 1000;
        scene.solver.tolerance = exact ? 1e-7 : 1e-6;
        scene.solver.budget_ms = exact ? 0 : 8;
        for (size_t o = 0; o + 1 < options.size(); o += 2)
            EXPECT_EQ(pliant_scene_set(&scene, options[o].c_str(), options[o + 1].c_str()), PLIANT_OK);
        EXPECT_EQ(pliant_model_build(&scene, &scan, &labels, &table, {nullptr, nullptr}, &model), PLIANT_OK)
            << pliant_last_error();
        EXPECT_EQ(pliant_data_create(model, &data), PLIANT_OK) << pliant_last_error();
        clock.solver = data->solver;
        if (exact) return;
        data->clock.now = Clock::tell;
        data->clock.user = &clock;
    }
    Phantom(const Phantom &) = delete;
    Phantom &operator=(const Phantom &) = delete;
    ~Phantom()
    {
        pliant_data_free(data);
        pliant_model_free(model);
        pliant_material_table_free(&table);
        pliant_labels_free(&labels);
        pliant_volume_free(&scan);
    }
    std::vector<double> positions() const
    {
        return std::vector<double>(data->positions, data->positions + 3 * data->body->fine.num_nodes);
    }
    // Compute one step, or as many as are needed to converge.
    std::vector<double> solve(bool exact)
    {
        pliant_status status = PLIANT_NOT_CONVERGED;
        for (int s = exact ? 40 : 1; s > 0 && status == PLIANT_NOT_CONVERGED; s--)
            EXPECT_GE(status = pliant_step(model, data), 0) << pliant_last_error();
        return positions();
    }

    Clock clock;

private:
    pliant_volume scan{};
    pliant_labels labels{};
    pliant_material_table table{};
};

double farthest(const std::vector<double> &a, const std::vector<double> &b)
{
    double maximum = 0;
    for (size_t n = 0; n < a.size(); n += 3)
        maximum = std::fmax(maximum, std::hypot(std::hypot(a[n] - b[n], a[n + 1] - b[n + 1]), a[n + 2] - b[n + 2]));
    return maximum;
}

// Pull by a force that increases, rotates and reverses; return the positions of all frames.
std::vector<std::vector<double>> pull_by_force(Phantom &body, bool exact)
{
    int tool;
    EXPECT_EQ(pliant_tool_add(body.model, body.data, "t", &tool), PLIANT_OK);
    EXPECT_EQ(pliant_tool_set_pose(body.data, tool, liver, nullptr), PLIANT_OK);
    EXPECT_EQ(pliant_tool_grasp(body.model, body.data, tool, liver), PLIANT_OK) << pliant_last_error();
    std::vector<std::vector<double>> out;
    for (int f = 1; f <= frames; f++) {
        const double size = 12 * std::min(1.0, f / 50.0), angle = 0.03 * std::max(0, f - 50);
        const double force[3] = {size * std::sin(angle), -size * std::cos(angle), 0};
        EXPECT_EQ(pliant_tool_set_drive(body.data, tool, PLIANT_DRIVE_FORCE, force), PLIANT_OK);
        out.push_back(body.solve(exact));
    }
    return out;
}

// Maximum error of a frame relative to the maximum displacement of all, and number of frames without progress.
struct FrameErrors {
    double worst = 0;
    int frozen = 0, worst_frame = 0;
};

FrameErrors judge(const Phantom &body, const std::vector<std::vector<double>> &now,
                  const std::vector<std::vector<double>> &right, std::vector<double> before)
{
    FrameErrors out;
    double whole = 0;
    const std::vector<double> first = before;
    for (const std::vector<double> &x : right) whole = std::fmax(whole, farthest(x, first));
    for (size_t f = 0; f < now.size(); f++) {
        const double error = farthest(now[f], right[f]) / whole;
        if (error > out.worst) out.worst = error, out.worst_frame = int(f);
        out.frozen += now[f] == before;
        before = now[f];
    }
    std::printf(
        "moved %.1f mm; worst frame %.2f %% (frame %d), at the end %.2f %%; %d frames brought nothing; %llu refused\n",
        1e3 * whole, 100 * out.worst, out.worst_frame, 100 * farthest(now.back(), right.back()) / whole, out.frozen,
        (unsigned long long)body.data->statistics.rejected);
    return out;
}

TEST(Budget, NoFrameIsLostToARefusal)
{
    Phantom exact(true);
    const std::vector<std::vector<double>> right = pull_by_force(exact, true);
    for (const std::vector<std::string> &options :
         {std::vector<std::string>{}, {"solver/preconditioner", "multigrid"}, {"solver/refresh_interval", "0"}}) {
        Phantom body(false, options);
        const std::vector<double> rest = body.positions();
        const FrameErrors judged = judge(body, pull_by_force(body, false), right, rest);
        EXPECT_EQ(judged.frozen, 0);
        EXPECT_LT(judged.worst, 0.1);
    }
}

// A body lies under its weight, which then reverses. One evaluation and one step without evaluation leave at most a
// quarter of the first frame's displacement.
TEST(Budget, TheFirstFrameOfTurnedGravityMoves)
{
    std::vector<std::vector<double>> right;
    std::vector<double> lying;
    const double costs[][2] = {{0, 0}, {3, 8}, {3, 3}, {8, 8}};
    for (const double *cost : costs) {
        const bool exact = cost[1] == 0;
        Phantom body(exact);
        body.clock.from = cost[0], body.clock.to = cost[1];
        const double down[3] = {0, 9.81, 0};
        ASSERT_EQ(pliant_data_set_gravity(body.data, down), PLIANT_OK);
        std::vector<double> before;
        for (int s = 0; s < 100; s++) before = body.solve(exact);
        std::vector<std::vector<double>> found;
        for (int f = 1; f <= 60; f++) {
            const double angle = M_PI * f / 60, g[3] = {9.81 * std::sin(angle), 9.81 * std::cos(angle), 0};
            ASSERT_EQ(pliant_data_set_gravity(body.data, g), PLIANT_OK);
            found.push_back(body.solve(exact));
        }
        if (exact) {
            lying = before, right = found;
            continue;
        }
        const double first = farthest(found[0], right[0]) / farthest(lying, right[0]);
        std::printf("%g to %g ms: first frame %.1f %% of what it should move\n", cost[0], cost[1], 100 * first);
        const FrameErrors judged = judge(body, found, right, before);
        EXPECT_EQ(judged.frozen, 0);
        EXPECT_LT(first, 0.25);
    }
}

// The number of evaluations of a step depends on the times that it reads from its clock. With the same times, another
// run on a clock of another speed repeats every bit.
TEST(Budget, TheReadingsOfTheClockRepeatARun)
{
    const int FRAMES = 20;
    std::vector<std::vector<double>> readings, right;
    const auto run = [&](double cost, bool prescribes) {
        Phantom body(false);
        body.clock.from = cost, body.clock.to = 3 * cost;
        int equal = 0;
        for (int f = 0; f < FRAMES; f++) {
            const double angle = M_PI * f / FRAMES, g[3] = {9.81 * std::sin(angle), 9.81 * std::cos(angle), 0};
            EXPECT_EQ(pliant_data_set_gravity(body.data, g), PLIANT_OK);
            if (prescribes)
                EXPECT_EQ(pliant_data_prescribe_clock(body.data, readings[f].data(), int32_t(readings[f].size())),
                          PLIANT_OK);
            const std::vector<double> found = body.solve(false);
            int32_t count = 0;
            const double *now = pliant_data_get_clock(body.data, &count);
            EXPECT_GT(count, 0);
            if (int(right.size()) == f) right.push_back(found), readings.emplace_back(now, now + count);
            equal += found == right[f];
        }
        return equal;
    };
    EXPECT_EQ(run(1, false), FRAMES);
    EXPECT_EQ(run(0.3, true), FRAMES);
    EXPECT_LT(run(0.3, false), FRAMES);
}

} // namespace
