// Contact of tissue with tissue: random scenes in which a tool presses tissue onto tissue, and crossings after each
// step.
//
// Usage:
//   bench_self [scenes [dynamic [kind]]]   default: 20 of each kind; one thread; dynamic: 1 for explicit dynamics
//
// Kinds:
//   flaps          a block with a slot that a ball presses together
//   cut            a block with a cut
//   fold           two arms; a ball pushes one of them onto the other
//
// Crossings are counted on the surface on which contact of tissue with tissue acts. Figures of each kind:
//   crossed        steps after which an edge of the surface passes through a triangle
//   edges          maximum number of such edges
//   evaluations    mean number per step
//   force          mean contact force of the ball in the last 5 steps [N]
//   time           CPU time of a step, median and maximum [ms]
#include "../pipeline/self_crossings.h"

#include <algorithm>
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <ctime>
#include <random>

namespace
{

constexpr double h = 0.005;
enum Kind { FLAPS, CUT, FOLD };
const char *const names[] = {"flaps", "cut", "fold"};

double seconds()
{
    timespec now;
    clock_gettime(CLOCK_THREAD_CPUTIME_ID, &now);
    return double(now.tv_sec) + 1e-9 * double(now.tv_nsec);
}

struct Figures {
    int steps = 0, crossed = 0, ended = 0, diverged = 0;
    int64_t evaluations = 0;
    int32_t maximum = 0;
    double force = 0;
    std::vector<double> times;
};

void run(Kind kind, int seed, bool dynamic, Figures &out)
{
    std::mt19937 random(static_cast<unsigned>(seed));
    const auto wide = [&random](double low, double high) {
        return std::uniform_real_distribution<double>(low, high)(random);
    };
    const int across = 4, along = 8, up = kind == FOLD ? 8 : 6;
    const int size[3] = {2 * along, 2 * across, 2 * up};
    const double box[3] = {along * h, across * h, up * h};
    Body body(size, box, {{10e3, 0.3, 1000, false}, {1, 0.3, 1, true}}, [kind](int i, int, int k) {
        if (kind == FLAPS) return int(i >= 4 && (k == 4 || k == 5));
        if (kind == FOLD) return int(i < 12 && k >= 4 && k < 12); // a C: two arms and their back
        return 0;
    });
    body.cells(along, across, up, 1);
    body.scene.contact.self = true;
    body.scene.contact.friction = wide(0, 0.4);
    body.scene.solver.iterations = 12;
    body.scene.solver.tolerance = 1e-3;
    body.scene.solver.threads = 1;
    body.scene.warp.margin = 1;
    body.fix_plane(0, 0, 1e-6, 0, 0, 1);
    if (kind == CUT) body.scene.cut.kind = PLIANT_CUT_SUBDIVIDE;
    if (dynamic) {
        body.scene.solver.kind = PLIANT_TLED;
        body.scene.solver.step = 0.01;
        body.scene.tled.damping = 20;
    }
    ASSERT_EQ(body.build(), PLIANT_OK) << pliant_last_error();
    if (kind == CUT) {
        const double z = wide(0.4, 0.6) * box[2], tilt = wide(-0.1, 0.1) * box[2];
        const double corners[6] = {0.3 * box[0], -0.01, z, 2 * box[0], -0.01, z + tilt}, sweep[3] = {0, 0.06, 0};
        ASSERT_EQ(pliant_data_cut(body.model, body.data, 2, corners, sweep, nullptr), PLIANT_OK) << pliant_last_error();
    }
    const double radius = wide(0.003, 0.008);
    const int tool = body.add_ball(radius);
    double from[3] = {wide(0.6, 0.95) * box[0], wide(0.2, 0.8) * box[1], box[2] + radius + 0.0005};
    const double speed = wide(0.0005, 0.003), reach = (kind == FOLD ? 4.5 : kind == FLAPS ? 2.0 : 0.8) * h + 0.003;
    const double way[3] = {wide(-0.4, 0.2), wide(-0.3, 0.3), -1};
    const int moves = static_cast<int>(std::ceil(reach / speed));
    for (int step = 0; step < moves + 8; step++) {
        double tip[3];
        for (int d = 0; d < 3; d++) tip[d] = from[d] + std::min(step, moves) * speed * way[d];
        ASSERT_EQ(pliant_tool_set_pose(body.data, tool, tip, nullptr), PLIANT_OK);
        const double start = seconds();
        const pliant_status status = pliant_step(body.model, body.data);
        out.times.push_back(1e3 * (seconds() - start));
        ASSERT_GE(status, 0) << pliant_last_error();
        const int32_t crossed = count_crossings(body);
        out.steps++;
        out.crossed += crossed > 0;
        out.maximum = std::max(out.maximum, crossed);
        out.ended += body.data->statistics.ended != PLIANT_STEP_END_NONE;
        out.diverged += status != PLIANT_OK;
        out.evaluations += body.data->statistics.iterations;
        if (step < moves + 3) continue;
        pliant_tool_state state;
        EXPECT_EQ(pliant_tool_get(body.data, tool, &state), PLIANT_OK);
        const double *force = state.contact_force;
        out.force += std::hypot(std::hypot(force[0], force[1]), force[2]) / 5;
    }
}

} // namespace

int main(int count, char **given)
{
    const int scenes = count > 1 ? std::atoi(given[1]) : 20;
    const bool dynamic = count > 2 && std::atoi(given[2]) != 0;
    for (const Kind kind : {FLAPS, CUT, FOLD}) {
        if (count > 3 && std::strcmp(given[3], names[kind]) != 0) continue;
        Figures out;
        for (int seed = 0; seed < scenes; seed++) run(kind, seed, dynamic, out);
        std::sort(out.times.begin(), out.times.end());
        std::printf("%s: %d steps, %d crossed (at most %d edges), %d ended early, %d not converged, %.1f evaluations, "
                    "force %.5f N, time %.2f / %.1f ms\n",
                    names[kind], out.steps, out.crossed, out.maximum, out.ended, out.diverged,
                    double(out.evaluations) / out.steps, out.force / scenes, out.times[out.times.size() / 2],
                    out.times.back());
        std::fflush(stdout);
    }
    return 0;
}
