// Error against run time of the fine solution stopped early: a tool moves 1 mm a frame for 30 frames, with a turn, and every
// frame may take so many iterations and no more. Errors are of the worst frame, over all nodes of the fine mesh, in % of the
// final largest displacement, against the same frames solved to 1e-7.
//
//   bench_budget SCENE SCAN X Y Z [group/name=value ...]     the point to pull at, LPS [m]
#include "pliant/pliant.h"

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <string>
#include <vector>

namespace {

const int frames = 30;

struct Frames {
    std::vector<std::vector<double>> positions;
    std::vector<std::vector<double>> force;
    std::vector<double> solve, residual;
    double iterations = 0;
};

void check(pliant_status status)
{
    if (status >= 0) return;
    std::fprintf(stderr, "bench_budget: %s\n", pliant_last_error());
    std::exit(1);
}

// up for 15 frames, then sideways: 1 mm a frame
void offset_at(int frame, double out[3])
{
    double up = std::min(frame, 15), across = std::max(frame - 15, 0);
    out[0] = 0.001 * across;
    out[1] = -0.001 * up;
    out[2] = 0;
}

Frames run(const pliant_model *model, const double at[3], const Frames *driving, int gravity)
{
    pliant_data *data = nullptr;
    check(pliant_data_create(model, &data));
    int tool = -1;
    double from[3];
    if (!gravity) {
        check(pliant_tool_add(model, data, "bench", &tool));
        check(pliant_tool_grasp(model, data, tool, at));
        std::memcpy(from, data->tools[tool].tip, sizeof from);
    }
    Frames out;
    int count = gravity ? 60 : frames;
    if (gravity) { // it hangs at rest before it is turned
        const double down[3] = {0, 9.81, 0};
        check(pliant_data_gravity(data, down));
        for (int s = 0; s < 200; s++)
            if (pliant_step(model, data) == PLIANT_OK) break;
    }
    for (int f = 1; f <= count; f++) {
        if (gravity) { // turned through 180 degrees, from lying on the back (+y)
            double angle = M_PI * f / count, g[3] = {9.81 * std::sin(angle), 9.81 * std::cos(angle), 0};
            check(pliant_data_gravity(data, g));
        } else {
            double move[3], tip[3];
            offset_at(f, move);
            for (int d = 0; d < 3; d++) tip[d] = from[d] + move[d];
            check(pliant_tool_pose(data, tool, tip, nullptr));
            check(pliant_tool_drive(data, tool, driving ? PLIANT_DRIVE_FORCE : PLIANT_DRIVE_RIGID, driving ? driving->force[f - 1].data() : nullptr));
        }
        check(pliant_step(model, data));
        out.solve.push_back(data->statistics.seconds[PLIANT_STEP_solve]);
        out.residual.push_back(data->statistics.residual);
        out.iterations += double(data->statistics.iterations) / count;
        out.positions.emplace_back(data->positions, data->positions + 3 * size_t(model->fine.num_nodes));
        if (!gravity) out.force.emplace_back(data->tools[tool].force, data->tools[tool].force + 3);
    }
    pliant_data_free(data);
    return out;
}

double largest_apart(const double *a, const double *b, size_t nodes)
{
    double most = 0;
    for (size_t n = 0; n < nodes; n++)
        most = std::max(most, std::sqrt(std::pow(a[3 * n] - b[3 * n], 2) + std::pow(a[3 * n + 1] - b[3 * n + 1], 2) + std::pow(a[3 * n + 2] - b[3 * n + 2], 2)));
    return most;
}

void compare(const char *name, const pliant_model *model, const Frames &run, const Frames &exact)
{
    size_t nodes = size_t(model->fine.num_nodes);
    double whole = largest_apart(exact.positions.back().data(), model->fine.rest, nodes), worst = 0;
    for (size_t f = 0; f < exact.positions.size(); f++)
        worst = std::max(worst, largest_apart(run.positions[f].data(), exact.positions[f].data(), nodes));
    std::vector<double> sorted = run.solve;
    std::sort(sorted.begin(), sorted.end());
    std::printf("  %-14s worst frame %7.3f %%   solve median %6.2f ms, worst %6.2f ms   iterations %4.1f   residual at most %.1e\n", name,
                100 * worst / whole, 1e3 * sorted[sorted.size() / 2], 1e3 * sorted.back(), run.iterations,
                *std::max_element(run.residual.begin(), run.residual.end()));
}

} // namespace

int main(int argc, char **argv)
{
    if (argc < 6) {
        std::fprintf(stderr, "usage: bench_budget SCENE SCAN X Y Z [group/name=value ...]\n");
        return 2;
    }
    pliant_scene scene;
    pliant_volume scan{};
    pliant_labels labels{};
    pliant_material_table materials{};
    check(pliant_scene_read(argv[1], &scene));
    for (int a = 6; a < argc; a++) {
        std::string option = argv[a];
        size_t equals = option.find('=');
        check(pliant_scene_set(&scene, option.substr(0, equals).c_str(), option.substr(equals + 1).c_str()));
    }
    check(pliant_inputs_read(&scene, argv[2], &scan, &labels, &materials));
    const double at[3] = {std::atof(argv[3]), std::atof(argv[4]), std::atof(argv[5])};
    scene.grasp.radius = 0.012;
    auto build = [&](int iterations, double tolerance) {
        scene.solver.iterations = iterations;
        scene.solver.tolerance = tolerance;
        pliant_model *model = nullptr;
        check(pliant_model_build(&scene, &scan, &labels, &materials, {nullptr, nullptr}, &model));
        return model;
    };
    pliant_model *exact = build(300, 1e-7);
    std::printf("%d fine tetrahedra, %d nodes\n", exact->fine.num_tets, exact->fine.num_nodes);
    Frames moved = run(exact, at, nullptr, 0), forced = run(exact, at, &moved, 0), hung = run(exact, at, nullptr, 1);
    const Frames *references[3] = {&moved, &forced, &hung};
    const char *names[3] = {"displacement", "force", "gravity"};
    std::printf("solved to 1e-7\n");
    for (int kind = 0; kind < 3; kind++) compare(names[kind], exact, *references[kind], *references[kind]);
    for (int iterations : {2, 3, 4, 6, 8}) {
        std::printf("%d iterations\n", iterations);
        pliant_model *model = build(iterations, 1e-9);
        for (int kind = 0; kind < 3; kind++)
            compare(names[kind], model, run(model, at, kind == 1 ? &moved : nullptr, kind == 2), *references[kind]);
        pliant_model_free(model);
    }
    pliant_model_free(exact);
    pliant_material_table_free(&materials);
    pliant_labels_free(&labels);
    pliant_volume_free(&scan);
    return 0;
}
