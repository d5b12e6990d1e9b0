// The error estimate of a step of explicit dynamics. The true error comes from the same step with half of its sub-step.
#include "fem/dynamics/tled.h"
#include "pipeline/body.h"

#include <algorithm>
#include <array>

namespace
{

// the last four pull with a spring
enum class Scene { SWING, DAMPED, PULL, BOTH, RELEASE, SOFT, STIFF, STIFFER, DAMPER };

// A bar along z with a fixed lower end.
struct Bar : Body {
    int tool = -1;
    Bar(Scene scene_kind, double safety, double step = 0.005)
        : Body(std::array<int, 3>{6, 6, 12}.data(), std::array<double, 3>{0.03, 0.03, 0.06}.data(),
               {{4000, 0.4, 1000, false}, {20000, 0.4, 1000, false}}, [](int, int, int k) { return k < 6 ? 0 : 1; })
    {
        cells(3, 3, 6, 1);
        fix_plane(0, 0, 1e-6, 0, 0, 1);
        scene.solver.kind = PLIANT_TLED;
        scene.solver.step = step;
        scene.solver.threads = 1;
        scene.tled.safety = safety;
        scene.tled.damping = scene_kind == Scene::DAMPED || scene_kind == Scene::PULL ? 10 : 0;
        if (scene_kind < Scene::RELEASE && scene_kind != Scene::PULL) scene.model.gravity[0] = 3;
        EXPECT_EQ(build(), PLIANT_OK) << pliant_last_error();
        if (scene_kind == Scene::SWING || scene_kind == Scene::DAMPED) return;
        const double at[3] = {0.015, 0.015, 0.055};
        EXPECT_EQ(pliant_tool_add(model, data, "tool", &tool), PLIANT_OK);
        EXPECT_EQ(pliant_tool_set_pose(data, tool, at, nullptr), PLIANT_OK);
        EXPECT_EQ(pliant_tool_grasp(model, data, tool, at), PLIANT_OK);
        const double stiffness = scene_kind == Scene::SOFT ? 50 : scene_kind == Scene::STIFFER ? 20000 : 1000;
        EXPECT_EQ(pliant_tool_set_spring(data, tool, stiffness, scene_kind == Scene::DAMPER ? 2 : 0), PLIANT_OK);
        EXPECT_EQ(pliant_tool_set_drive(data, tool,
                                        scene_kind >= Scene::SOFT ? PLIANT_DRIVE_SPRING : PLIANT_DRIVE_RIGID, nullptr),
                  PLIANT_OK);
    }
    void lead(int f, bool release)
    {
        if (tool >= 0 && release && f == 15) pliant_tool_remove_pose(data, tool);
        if (tool >= 0 && !(release && f >= 15)) {
            const double tip[3] = {0.015 + 4e-4 * std::fmin(f + 1, 20), 0.015, 0.055};
            EXPECT_EQ(pliant_tool_set_pose(data, tool, tip, nullptr), PLIANT_OK);
        }
    }
};

// Copy a state to a bar with half of the sub-step. As in central differences, the velocity lies between the last
// increment and the next.
void take(const Bar &from, const Bar &to)
{
    pliant_tled &a = *from.data->tled, &b = *to.data->tled;
    const size_t count = 3 * static_cast<size_t>(a.system->mesh->num_nodes);
    const std::vector<double> u(a.u, a.u + count), d(a.d, a.d + count),
        acceleration(a.acceleration, a.acceleration + count);
    const pliant_tled_scheme rule = pliant_tled_scheme_of(a.time_step, a.system->damping);
    std::array<std::array<double, 3>, PLIANT_MAX_TOOLS> target, previous_point, previous_target;
    std::memcpy(target.data(), a.target, sizeof a.target);
    std::memcpy(previous_point.data(), a.previous_point, sizeof a.previous_point);
    std::memcpy(previous_target.data(), a.previous_target, sizeof a.previous_target);
    std::memcpy(b.target, a.target, sizeof a.target);
    pliant_tled_element_forces(&a, a.time_step);
    for (size_t n = 0; n < count; n++) {
        if (a.inverse_mass[n / 3] == 0) continue;
        double force = a.system->node_mass[n / 3] * a.gravity[n % 3];
        for (int32_t c = a.system->corner_start[n / 3]; c < a.system->corner_start[n / 3 + 1]; c++)
            force -= a.forces[a.system->corner[c] + n % 3 * LANES];
        a.d[n] = rule.factor * a.inverse_mass[n / 3] * force + rule.kept * a.d[n];
        a.u[n] += a.d[n];
    }
    bool held = false;
    for (int t = 0; t < from.data->num_tools; t++) held = held || from.data->tools[t].attached;
    if (held) {
        pliant_tool tools[PLIANT_MAX_TOOLS];
        std::memcpy(tools, from.data->tools, sizeof(pliant_tool) * static_cast<size_t>(from.data->num_tools));
        pliant_tled_pull(&a, tools, from.data->num_tools, rule.factor, a.substeps);
    }
    for (size_t n = 0; n < count; n++) {
        b.u[n] = u[n];
        b.d[n] = 0.5 * d[n] + 0.125 * (a.d[n] - d[n]);
        a.u[n] = u[n], a.d[n] = d[n], a.acceleration[n] = acceleration[n];
    }
    std::memcpy(a.target, target.data(), sizeof a.target);
    std::memcpy(a.previous_point, previous_point.data(), sizeof a.previous_point);
    std::memcpy(a.previous_target, previous_target.data(), sizeof a.previous_target);
    b.previous_time_step = b.time_step;
    for (int t = 0; t < from.data->num_tools; t++) {
        const pliant_tool &tool = from.data->tools[t];
        for (int k = 0; k < 3; k++) {
            b.previous_target[t][k] = 0.5 * (a.target[t][k] + a.previous_target[t][k]);
            b.previous_point[t][k] = 0;
            for (int32_t h = 0; h < tool.num_held; h++) {
                const size_t n = 3 * static_cast<size_t>(tool.held[h]) + static_cast<size_t>(k);
                b.previous_point[t][k] += tool.weight[h] * (a.system->mesh->rest[n] + b.u[n] - b.d[n]);
            }
        }
    }
}

// Errors of a frame from the same state: the estimate, the estimate with half of the sub-step, and the true error. The
// true error is 4/3 of the difference of the two frames (Richardson extrapolation).
struct Errors {
    double estimate, estimate_of_half, truth;
};

std::vector<Errors> run(Scene kind, double frame, double safety)
{
    std::vector<Errors> out;
    Bar whole(kind, safety, frame), half(kind, safety, frame);
    half.data->tled->substeps = 2 * whole.data->tled->substeps;
    half.data->tled->time_step = 0.5 * whole.data->tled->time_step;
    for (int f = 0; f < 40; f++) {
        std::memcpy(whole.data->tled->gravity, whole.scene.model.gravity, sizeof whole.data->tled->gravity);
        whole.lead(f, kind == Scene::RELEASE);
        half.lead(f, kind == Scene::RELEASE);
        take(whole, half);
        EXPECT_EQ(pliant_step(whole.model, whole.data), PLIANT_OK) << pliant_last_error();
        EXPECT_EQ(pliant_step(half.model, half.data), PLIANT_OK) << pliant_last_error();
        double difference = 0;
        for (int32_t n = 0; n < whole.data->body->fine.num_nodes; n++) {
            const double *a = whole.data->tled->u + 3 * n, *b = half.data->tled->u + 3 * n;
            difference = std::fmax(difference, std::hypot(std::hypot(a[0] - b[0], a[1] - b[1]), a[2] - b[2]));
        }
        EXPECT_EQ(2 * whole.data->statistics.iterations, half.data->statistics.iterations);
        out.push_back({whole.data->statistics.error, half.data->statistics.error, 4.0 / 3 * difference});
        if (f > 0) EXPECT_EQ(whole.data->statistics.error_before, out[static_cast<size_t>(f) - 1].estimate);
    }
    return out;
}

// The frames range from much shorter than each oscillation to much longer.
TEST(TledError, IsWithinAFactorOfThree)
{
    int frames = 0, within = 0;
    for (Scene kind : {Scene::SWING, Scene::DAMPED, Scene::PULL, Scene::BOTH, Scene::RELEASE, Scene::SOFT, Scene::STIFF,
                       Scene::STIFFER, Scene::DAMPER})
        for (double frame : {0.002, 0.01, 0.033})
            for (double safety : {0.9, 0.3}) {
                int here = 0;
                std::vector<double> ratios;
                for (const Errors &error : run(kind, frame, safety)) {
                    here += error.estimate > error.truth / 3 && error.estimate < 3 * error.truth;
                    ratios.push_back(error.estimate / error.truth);
                }
                std::sort(ratios.begin(), ratios.end());
                std::printf("scene %d, frame %.3f s, safety %.1f: told / true %.2f, within 3: %d of 40\n",
                            static_cast<int>(kind), frame, safety, 0.5 * (ratios[19] + ratios[20]), here);
                EXPECT_GE(here, 28);
                const double median = 0.5 * (ratios[19] + ratios[20]);
                EXPECT_GT(median, 2.0 / 3) << "of a short frame h^2 T j / 6, of a long one a fourth of that";
                EXPECT_LT(median, 2);
                frames += 40;
                within += here;
            }
    std::printf("%d of %d frames\n", within, frames);
    EXPECT_GE(within, 0.9 * frames);
}

TEST(TledError, FallsWithTheSquareOfTheSubStep)
{
    for (Scene kind : {Scene::SWING, Scene::DAMPED, Scene::RELEASE, Scene::SOFT}) {
        double sum = 0;
        for (const Errors &error : run(kind, 0.01, 0.3)) sum += std::log2(error.estimate / error.estimate_of_half);
        EXPECT_NEAR(sum / 40, 2, 0.1) << static_cast<int>(kind);
    }
}

// The estimate is 0 at rest, for a single sub-step, and for dynamic relaxation.
TEST(TledError, IsZeroWithoutMotion)
{
    Bar still(Scene::PULL, 0.9), single(Scene::SWING, 0.9);
    ASSERT_EQ(pliant_step(still.model, still.data), PLIANT_OK);
    EXPECT_EQ(still.data->statistics.error, 0);
    single.scene.solver.step = 0.9 * single.data->tled->time_step;
    ASSERT_EQ(single.build(), PLIANT_OK) << pliant_last_error();
    for (int s = 0; s < 5; s++) ASSERT_EQ(pliant_step(single.model, single.data), PLIANT_OK);
    EXPECT_EQ(single.data->statistics.iterations, 1);
    EXPECT_EQ(single.data->statistics.error, 0);
}

} // namespace
