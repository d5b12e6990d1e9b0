// The error estimate of a step (statistics.error) against the true error, on bodies and loads that were not used for
// tuning. Frames with few evaluations are compared with tightly converged frames, by the maximum node distance.
#ifndef PLIANT_TEST_ERROR_ESTIMATES_H
#define PLIANT_TEST_ERROR_ESTIMATES_H

#include "body.h"

#include <algorithm>
#include <cstdio>
#include <cstdlib>
#include <functional>
#include <string>
#include <vector>

namespace error_estimates {

using Moves = std::function<void(Body &, int, int)>; // changes before step s of steps

const int size[3] = {24, 24, 24};
const double box[3] = {0.12, 0.12, 0.12};

// Exit the program on an error.
inline bool good(pliant_status status)
{
    if (status >= 0) return true;
    std::fprintf(stderr, "%s\n", pliant_last_error());
    std::exit(1);
}

inline void pull(Body &body, int number, const double from[3], const double by[3], pliant_drive drive,
                 const double force[3])
{
    int tool;
    good(pliant_tool_add(body.model, body.data, ("t" + std::to_string(number)).c_str(), &tool));
    if (!pliant_tool_grips(body.data->tools + tool)) {
        good(pliant_tool_set_pose(body.data, tool, from, nullptr));
        good(pliant_tool_grasp(body.model, body.data, tool, nullptr));
    }
    const double tip[3] = {from[0] + by[0], from[1] + by[1], from[2] + by[2]};
    good(pliant_tool_set_pose(body.data, tool, tip, nullptr));
    good(pliant_tool_set_drive(body.data, tool, drive, force));
}

inline void gravity(Body &body, double x, double y, double z)
{
    const double g[3] = {x, y, z};
    good(pliant_data_set_gravity(body.data, g));
}

inline Moves pulled(pliant_drive drive, int tools, double size = 0.02)
{
    return [=](Body &body, int s, int steps) {
        gravity(body, 2, 0, 0);
        for (int t = 0; t < tools; t++) {
            const double from[3] = {0.04 + 0.04 * t, 0.06, 0.11 - 0.02 * t}, a = size * s / steps,
                         by[3] = {a, -a * t, a};
            const double force[3] = {0.5 * s / steps, 0, 1.0 * s / steps};
            pull(body, t, from, by, drive, force);
        }
    };
}

// Move back and forth, and in circles.
inline Moves stirred(pliant_drive drive, double size)
{
    return [=](Body &body, int s, int steps) {
        const double turn = 2 * M_PI * s / steps, from[3] = {0.06, 0.06, 0.11};
        const double by[3] = {size * std::sin(turn), size * (1 - std::cos(turn)), 0.5 * size * std::sin(2 * turn)};
        const double force[3] = {100 * by[0], 100 * by[1], 100 * by[2]};
        pull(body, 0, from, by, drive, force);
    };
}

inline void turned(Body &body, int s, int steps)
{
    const double angle = M_PI * s / steps;
    gravity(body, 4 * std::sin(angle), 0, -4 * std::cos(angle));
}

// same as cuda_test's ErrorsMeetTheCpuAndTheTruth
inline void tilted(Body &body, int s, int steps) { gravity(body, 2, 4.0 * s / steps, 0); }

inline void turned_and_pulled(Body &body, int s, int steps)
{
    turned(body, s, steps);
    const double from[3] = {0.06, 0.06, 0.11}, by[3] = {0, 0.015 * s / steps, 0};
    pull(body, 0, from, by, PLIANT_DRIVE_SPRING, nullptr);
}

struct Scene {
    const char *name;
    std::vector<Material> materials;
    std::function<int(int, int, int)> material;
    std::function<void(Body &)> set;
    std::vector<Moves> moves;
    std::function<void(Body &)> before; // before the first step; may be empty
};

inline int inclusions(int i, int j, int k) { return i / 6 % 2 && j / 8 % 2 ? 1 : k > 20 && i < 6 ? 2 : 0; }
inline int one(int, int, int) { return 0; }
inline int layers(int, int, int k) { return k / 6 % 2; }
inline int ball(int i, int j, int k) { return (i - 12) * (i - 12) + (j - 12) * (j - 12) + (k - 12) * (k - 12) < 49; }

const std::vector<Material> three = {{5000, 0.45, 1000, false}, {60000, 0.45, 1100, false}, {1000, 0.3, 1, true}};
const std::vector<Material> soft_hard = {{2000, 0.45, 1000, false}, {1e6, 0.4, 1100, false}};
const std::vector<Material> watery = {{4000, 0.49, 1000, false}};
const std::vector<Material> plain = {{10000, 0.3, 1000, false}};

inline void floor_fixed(Body &body)
{
    body.cells(4, 4, 4, 2);
    body.fix_plane(0, 0, 0.001, 0, 0, 1);
}

inline void bar(Body &body) // extends from a wall
{
    body.cells(6, 2, 2, 2);
    body.fix_plane(0.001, 0, 0, 1, 0, 0);
}

inline void cut_half(Body &body)
{
    const double strip[] = {0.06, -0.01, 0.13, 0.06, 0.07, 0.13};
    const double depth[3] = {0, 0, -0.09};
    pliant_cut_report report{};
    good(pliant_data_cut(body.model, body.data, 2, strip, depth, &report));
}

// Keep the tools at rest until their patches are available.
inline void hold(Body &body, int tools)
{
    const double still[3] = {0, 0, 0};
    for (int t = 0; t < tools; t++) {
        const double from[3] = {0.04 + 0.04 * t, 0.06, 0.11 - 0.02 * t};
        pull(body, t, from, still, PLIANT_DRIVE_RIGID, still);
    }
    do good(pliant_step(body.model, body.data));
    while (body.data->statistics.patch_waiting > 0);
}

inline void patched(Body &body)
{
    floor_fixed(body);
    body.scene.model.method = PLIANT_AVERAGED;
    body.scene.model.patch = 0.03;
    body.scene.model.patch_delay = 3;
}

inline std::vector<Scene> scenes()
{
    const Moves rigid = pulled(PLIANT_DRIVE_RIGID, 2), spring = pulled(PLIANT_DRIVE_SPRING, 2),
                force = pulled(PLIANT_DRIVE_FORCE, 2);
    const std::vector<Moves> all = {rigid, spring, force, turned};
    auto with = [](std::function<void(Body &)> set, std::function<void(Body &)> more) {
        return [=](Body &body) { set(body), more(body); };
    };
    return {
        {"parity",
         three,
         inclusions,
         with(floor_fixed, [](Body &b) { b.scene.solver.refresh_interval = 0; }),
         {pulled(PLIANT_DRIVE_RIGID, 1), pulled(PLIANT_DRIVE_SPRING, 1), pulled(PLIANT_DRIVE_FORCE, 1), tilted},
         {}},
        {"three", three, inclusions, floor_fixed, all, {}},
        {"contrast", soft_hard, ball, floor_fixed, all, {}},
        {"layers", soft_hard, layers, floor_fixed, all, {}},
        {"watery", watery, one, floor_fixed, all, {}},
        {"stirred",
         three,
         inclusions,
         floor_fixed,
         {stirred(PLIANT_DRIVE_RIGID, 0.01), stirred(PLIANT_DRIVE_SPRING, 0.01), stirred(PLIANT_DRIVE_FORCE, 0.01)},
         {}},
        {"stiff",
         three,
         inclusions,
         with(floor_fixed, [](Body &b) { b.scene.grasp.stiffness = 1e5; }),
         {spring, stirred(PLIANT_DRIVE_SPRING, 0.01), turned_and_pulled},
         {}},
        {"weak",
         three,
         inclusions,
         with(floor_fixed, [](Body &b) { b.scene.grasp.stiffness = 20; }),
         {spring, stirred(PLIANT_DRIVE_SPRING, 0.03), turned_and_pulled},
         {}},
        {"damped",
         three,
         inclusions,
         with(floor_fixed, [](Body &b) { b.scene.grasp.damping = 20; }),
         {spring, stirred(PLIANT_DRIVE_SPRING, 0.01)},
         {}},
        {"hexahedra",
         three,
         inclusions,
         with(floor_fixed, [](Body &b) { b.scene.element.kind = PLIANT_HEXAHEDRA; }),
         all,
         {}},
        {"averaged",
         soft_hard,
         ball,
         with(floor_fixed, [](Body &b) { b.scene.model.method = PLIANT_AVERAGED; }),
         all,
         {}},
        {"octree",
         soft_hard,
         ball,
         with(floor_fixed,
              [](Body &b) {
                  b.scene.mesh.kind = PLIANT_OCTREE;
                  b.scene.mesh.ratio = 1;
              }),
         all,
         {}},
        {"bar", plain, one, bar, {turned, pulled(PLIANT_DRIVE_FORCE, 1), stirred(PLIANT_DRIVE_RIGID, 0.03)}, {}},
        {"cut", three, inclusions, with(floor_fixed, [](Body &b) { b.scene.cut.kind = PLIANT_CUT_SEVER; }), all,
         cut_half},
        {"patch", three, inclusions, patched, {rigid, spring, force}, [](Body &b) { hold(b, 2); }},
        {"budget",
         three,
         inclusions,
         with(floor_fixed, [](Body &b) { b.scene.solver.budget_ms = 1; }),
         {rigid, spring, force, turned, turned_and_pulled},
         {}},
        {"budgets",
         watery,
         one,
         with(floor_fixed, [](Body &b) { b.scene.solver.budget_ms = 1; }),
         {rigid, spring, force, turned, turned_and_pulled},
         {}},
        {"quick",
         three,
         inclusions,
         floor_fixed,
         {pulled(PLIANT_DRIVE_RIGID, 1, 0.06), stirred(PLIANT_DRIVE_SPRING, 0.04)},
         {}},
    };
}

inline std::vector<double> positions(const Body &body)
{
    return std::vector<double>(body.data->positions, body.data->positions + 3 * body.data->body->fine.num_nodes);
}

inline double max_distance(const std::vector<double> &a, const std::vector<double> &b)
{
    double maximum = 0;
    for (size_t n = 0; n < a.size(); n += 3)
        maximum = std::fmax(maximum, std::hypot(std::hypot(a[n] - b[n], a[n + 1] - b[n + 1]), a[n + 2] - b[n + 2]));
    return maximum;
}

// Simulated clock: all evaluations take the same time within a quarter.
struct Clock {
    const pliant_solver *solver;
    double each;
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
            clock.now += clock.each * (0.75 + 0.5 * (clock.random >> 8) / double(1 << 24));
        }
        return clock.now;
    }
};

struct Counts {
    int counted = 0, within = 0, judged = 0, within_next = 0;
    void add(const Counts &more)
    {
        counted += more.counted, within += more.within;
        judged += more.judged, within_next += more.within_next;
    }
};

inline bool near(double estimate, double error) { return estimate > error / 3 && estimate < 3 * error; }

const int steps = 20;

inline std::vector<std::vector<double>> solve_tightly(const Scene &scene, size_t move,
                                                      const std::vector<std::string> &options)
{
    Body body(size, box, scene.materials, scene.material);
    std::vector<std::vector<double>> out;
    for (size_t o = 0; o + 1 < options.size(); o += 2)
        good(pliant_scene_set(&body.scene, options[o].c_str(), options[o + 1].c_str()));
    body.scene.solver.backend = PLIANT_CPU;
    scene.set(body);
    body.scene.solver.budget_ms = 0;
    body.scene.solver.iterations = 200;
    body.scene.solver.tolerance = 1e-10;
    good(body.build());
    if (scene.before) scene.before(body);
    for (int s = 1; s <= steps; s++) {
        scene.moves[move](body, s, steps);
        for (int again = 0; again < 12; again++) {
            good(pliant_step(body.model, body.data));
            if (body.data->statistics.error <= 1e-11) break;
        }
        out.push_back(positions(body));
    }
    return out;
}

inline Counts run(const Scene &scene, size_t move, pliant_preconditioner_choice choice, int iterations,
                  const std::vector<std::string> &options, const std::vector<std::vector<double>> &right, bool verbose)
{
    Body body(size, box, scene.materials, scene.material);
    Counts counts;
    for (size_t o = 0; o + 1 < options.size(); o += 2)
        good(pliant_scene_set(&body.scene, options[o].c_str(), options[o + 1].c_str()));
    scene.set(body);
    body.scene.solver.preconditioner = choice;
    // this number of evaluations in the budget, by the trial's own clock
    const bool timed = body.scene.solver.budget_ms > 0;
    body.scene.solver.iterations = timed ? 1000 : iterations;
    body.scene.solver.tolerance = 1e-10;
    good(body.build());
    Clock clock{body.data->solver, 1e-3 / (iterations + 0.5)};
    if (timed) body.data->clock.now = Clock::tell, body.data->clock.user = &clock;
    if (scene.before) scene.before(body);
    const double minimum = body.scene.model.patch > 0 ? 2e-6 : 1e-7; // accuracy of the responses of a patch
    double last = 0;
    for (int s = 1; s <= steps; s++) {
        scene.moves[move](body, s, steps);
        good(pliant_step(body.model, body.data));
        const pliant_statistics &statistics = body.data->statistics;
        const double error = max_distance(positions(body), right[size_t(s - 1)]);
        if (last > minimum) counts.judged++, counts.within_next += near(statistics.error_before, last);
        last = error;
        if (error <= minimum) continue;
        counts.counted++;
        counts.within += near(statistics.error, error);
        if (verbose && !near(statistics.error, error))
            std::printf("    %s, load %zu, %s, %d evaluations, step %d: told %.2e of %.2e (x %.2f)\n", scene.name, move,
                        choice == PLIANT_DIRECT ? "direct" : "V-cycle", iterations, s, statistics.error, error,
                        statistics.error / error);
    }
    return counts;
}

} // namespace told

#endif
