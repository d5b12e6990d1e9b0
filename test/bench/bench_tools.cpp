// Eight tools press into a block of 13,720 tetrahedra and slide over it: the share of contact in a step. The same
// block without tools, with as many evaluations, is the reference. With `self`, there are no tools. The upper half of
// the block, held at one side, rests on the lower half.
//
// Usage:
//   bench_tools [cpu|cuda [cells [self]]]     default: cpu; 14 cells along each axis
// The CPU uses one thread. With cuda, the host uses all its threads. With more than 14 cells (a multiple of 4), the
// method is averaged, with elements of 4 cells. 60 cells: 1.08 million tetrahedra.
#include "../pipeline/body.h"
#include "figure.h"
#include "sim/api/data.h"

#include <array>

namespace
{

enum { PRESS = 20, SLIDE = 60, NUM_TOOLS = 8, FINE_CELLS = 14, RATIO = 4 };
enum Kind { WHOLE, HALVES };
const double edge = 0.14, radius = 0.012;

double median(std::vector<double> values)
{
    std::sort(values.begin(), values.end());
    return values.empty() ? NAN : values[values.size() / 2];
}

// Between the two halves is a gap of one element.
struct Block : Body {
    Block(pliant_backend_choice backend, int n, int iterations, Kind kind)
        : Block(backend, n, n > FINE_CELLS ? int(RATIO) : 1, iterations, kind)
    {
    }

private:
    Block(pliant_backend_choice backend, int n, int ratio, int iterations, Kind kind)
        : Body(std::array<int, 3>{2 * n, 2 * n, 2 * (n + kind * ratio)}.data(),
               std::array<double, 3>{edge, edge, edge * (n + kind * ratio) / n}.data(),
               {{5e3, 0.45, 1000, false}, {1, 0.3, 1, true}},
               [=](int, int, int k) { return int(kind == HALVES && k / (2 * ratio) == n / ratio / 2); })
    {
        cells(n / ratio, n / ratio, n / ratio + kind, ratio);
        if (ratio > 1) scene.model.method = PLIANT_AVERAGED;
        fix_plane(0, 0, 1e-3, 0, 0, 1);
        if (kind == HALVES) fix_plane(1e-3, 0, 0, 1, 0, 0);
        scene.contact.self = kind == HALVES;
        scene.solver.backend = backend;
        scene.solver.threads = backend == PLIANT_CUDA ? 0 : 1;
        scene.solver.iterations = iterations;
        scene.solver.tolerance = 1e-12; // each step makes all its evaluations
        EXPECT_EQ(build(), PLIANT_OK) << pliant_last_error();
    }
};

void add_ball(Block &block, int number)
{
    pliant_tool_shape ball{};
    ball.num_parts = 1;
    ball.part[0].kind = PLIANT_PART_SPHERE;
    ball.part[0].radius = radius;
    int tool = -1;
    ASSERT_EQ(pliant_tool_add(block.model, block.data, ("ball" + std::to_string(number)).c_str(), &tool), PLIANT_OK);
    ASSERT_EQ(pliant_tool_set_shape(block.data, tool, &ball), PLIANT_OK);
}

double total(const pliant_statistics &statistics)
{
    double sum = 0;
    for (double seconds : statistics.seconds) sum += seconds;
    return 1e3 * sum;
}

// Move the tools: down by 4 mm, then 12 mm to the side.
void move_tools(Block &block, int step)
{
    const double depth = 0.004 * std::min(1.0, double(step) / PRESS), side = 0.012 * std::max(0, step - PRESS) / SLIDE;
    for (int t = 0; t < NUM_TOOLS; t++) {
        const double tip[3] = {0.025 + 0.03 * (t % 4) + side, 0.045 + 0.05 * (t / 4), edge + radius - depth};
        ASSERT_EQ(pliant_tool_set_pose(block.data, t, tip, nullptr), PLIANT_OK) << pliant_last_error();
    }
}

void measure(pliant_backend_choice backend, int cells, int iterations, Kind kind)
{
    Block pressed(backend, cells, iterations, kind), alone(backend, cells, iterations, WHOLE);
    for (int t = 0; kind == WHOLE && t < NUM_TOOLS; t++) add_ball(pressed, t);
    std::vector<double> with, without, stage[PLIANT_NUM_STEP_STAGES];
    int32_t points = 0, legs = 0, evaluations = 0;
    for (int step = 0; step <= PRESS + SLIDE; step++) {
        const double gravity[3] = {0.5 * (step % 2), 0, -9.81}; // so that every step has work
        ASSERT_EQ(pliant_data_set_gravity(alone.data, gravity), PLIANT_OK);
        if (kind == WHOLE) move_tools(pressed, step);
        else ASSERT_EQ(pliant_data_set_gravity(pressed.data, gravity), PLIANT_OK);
        for (Block *block : {&pressed, &alone}) ASSERT_GE(pliant_step(block->model, block->data), 0);
        if (step < PRESS) continue;
        const pliant_statistics &statistics = pressed.data->statistics;
        with.push_back(total(statistics));
        without.push_back(total(alone.data->statistics));
        for (int n = 0; n < PLIANT_NUM_STEP_STAGES; n++) stage[n].push_back(1e3 * statistics.seconds[n]);
        points = std::max(points, statistics.contacts);
        legs = std::max(legs, statistics.legs);
        evaluations = std::max(evaluations, statistics.iterations);
    }
    std::printf(
        "%s, %d tetrahedra, %d evaluations at most (%d made), up to %d contact points and %d legs: step %.3f ms, "
        "without contact %.3f ms; worst step %.3f ms; stages:",
        pliant_data_get_backend(pressed.data), pressed.data->body->fine.num_tets, iterations, evaluations, points, legs,
        median(with), median(without), *std::max_element(with.begin(), with.end()));
    for (int n = 0; n < PLIANT_NUM_STEP_STAGES; n++)
        std::printf(" %s %.3f", pliant_step_stage_name(n), median(stage[n]));
    std::printf(" ms\n");
    const std::string name =
        std::string(kind == WHOLE ? "tools/" : "self_contact/") + pliant_data_get_backend(pressed.data);
    figure(name + "/step", median(with), "ms");
    figure(name + (kind == WHOLE ? "/without_tools" : "/without_contact"), median(without), "ms");
}

} // namespace

int main(int argc, char **argv)
{
    const pliant_backend_choice backend = argc > 1 && !std::strcmp(argv[1], "cuda") ? PLIANT_CUDA : PLIANT_CPU;
    const int cells = argc > 2 ? std::atoi(argv[2]) : FINE_CELLS;
    const Kind kind = argc > 3 && !std::strcmp(argv[3], "self") ? HALVES : WHOLE;
    for (int iterations : {6, 30}) measure(backend, cells, iterations, kind);
    return 0;
}
