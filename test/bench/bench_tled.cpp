// Time of a sub-step of explicit dynamics [us], by material law and options.
// Usage:
//   bench_tled [cells along an edge = 14] [seconds per row = 0.5]  on the CPU, by threads, cubes of 5 n^3 tetrahedra
//   bench_tled cuda [seconds per row = 0.5]                        on the GPU, by size; without and with a pulling tool
//   bench_tled frame                                               on one thread, 13,720 tetrahedra, relative to a
//                                                                  fixed kernel
#include "../pipeline/body.h"
#include "base/clock.h"
#include "figure.h"

#include <algorithm>
#include <cstdio>
#include <cstdlib>
#include <string>

namespace {

struct Choice {
    const char *name;
    pliant_law law;
    bool viscous, nodal, still, pulled, cubes, wall, incompressible;
};

struct Setting {
    int cells[3], threads;
    pliant_backend_choice backend;
    double step; // [s]
};

void exit_on_error(pliant_status status)
{
    if (status >= 0) return;
    std::fprintf(stderr, "%s\n", pliant_last_error());
    std::exit(1);
}

double seconds_a_step(const Choice &choice, const Setting &setting, double budget, int *tets, int *substeps)
{
    int size[3];
    double box[3];
    for (int d = 0; d < 3; d++) {
        size[d] = 2 * setting.cells[d];
        box[d] = 0.02 * setting.cells[d];
    }
    Body body(size, box, {{5e3, choice.incompressible ? 0.4999 : 0.45, 1000, false}});
    body.cells(setting.cells[0], setting.cells[1], setting.cells[2], 1);
    body.fix_plane(0, 0, 0.001, 0, 0, 1);
    body.scene.solver.kind = PLIANT_TLED;
    if (choice.cubes) body.scene.element.kind = PLIANT_HEXAHEDRA;
    if (choice.wall) { // far below
        body.scene.ground.normal[2] = 1;
        body.scene.ground.point[2] = -1;
    }
    body.scene.solver.backend = setting.backend;
    body.scene.solver.threads = setting.threads;
    body.scene.solver.step = setting.step;
    body.scene.solver.tolerance = 1e-12;
    body.scene.model.gravity[0] = 0.3;
    body.scene.tled.law = choice.law;
    body.scene.tled.nodal_pressure = choice.nodal;
    body.scene.tled.quasi_static = choice.still;
    if (choice.viscous) body.scene.tled.prony_share[0] = 0.3;
    exit_on_error(body.build());
    if (choice.pulled) {
        int tool;
        const double at[3] = {0.5 * box[0], 0.5 * box[1], box[2] - 0.01};
        exit_on_error(pliant_tool_add(body.model, body.data, "pull", &tool));
        exit_on_error(pliant_tool_grasp(body.model, body.data, tool, at));
    }
    *tets = body.model->body->fine.num_tets;
    double best = INFINITY, start = pliant_seconds();
    while (pliant_seconds() - start < budget) {
        exit_on_error(pliant_step(body.model, body.data));
        best = std::min(best, body.data->statistics.seconds[PLIANT_STEP_solve] / body.data->statistics.iterations);
    }
    *substeps = body.data->statistics.iterations;
    if (setting.backend == PLIANT_CUDA && std::string(pliant_data_get_backend(body.data)) != "cuda")
        std::printf("NOT ON THE GPU\n");
    return best;
}

const Choice choices[] = {
    {"neo_hookean", PLIANT_LAW_NEO_HOOKEAN, false, false, false, false, false, false},
    {"compressible", PLIANT_LAW_COMPRESSIBLE, false, false, false, false, false, false},
    {"saint_venant_kirchhoff", PLIANT_LAW_SAINT_VENANT_KIRCHHOFF, false, false, false, false, false, false},
    {"neo_hookean, one Prony term", PLIANT_LAW_NEO_HOOKEAN, true, false, false, false, false, false},
    {"neo_hookean, nodal pressure", PLIANT_LAW_NEO_HOOKEAN, false, true, false, false, false, false},
    {"neo_hookean, a tool", PLIANT_LAW_NEO_HOOKEAN, false, false, false, true, false, false},
    {"neo_hookean, relaxation", PLIANT_LAW_NEO_HOOKEAN, false, false, true, false, false, false},
    {"neo_hookean, a wall", PLIANT_LAW_NEO_HOOKEAN, false, false, false, false, false, true},
    {"neo_hookean, hexahedra", PLIANT_LAW_NEO_HOOKEAN, false, false, false, false, true, false, false},
    {"neo_hookean, nu 0.4999", PLIANT_LAW_NEO_HOOKEAN, false, false, false, false, false, false, true},
    {"neo_hookean, hexahedra, nu 0.4999", PLIANT_LAW_NEO_HOOKEAN, false, false, false, false, true, false, true},
};

// Whole frames divided by their sub-steps, including transfers.
void bench_gpu(double budget)
{
    // 10,000; 19,125 instead of 18,954, which is not a product; 100,000; 1,000,000 tetrahedra
    const int sizes[][3] = {{20, 10, 10}, {17, 15, 15}, {40, 25, 20}, {100, 50, 40}};
    std::printf("%-30s %10s %9s %12s %18s\n", "", "tetrahedra", "sub-steps", "us a step", "tetrahedra steps/s");
    for (const auto &size : sizes)
        for (const Choice &choice : choices)
            for (double step : {0.02, 1.0}) {
                if ((choice.still && step < 1) || choice.incompressible) continue;
                int tets, substeps;
                double seconds = seconds_a_step(choice, {{size[0], size[1], size[2]}, 2, PLIANT_CUDA, step}, budget,
                                                &tets, &substeps);
                std::printf("%-30s %10d %9d %12.2f %18.3g\n", choice.name, tets, substeps, 1e6 * seconds,
                            tets / seconds);
                std::fflush(stdout);
                if (step == 1.0)
                    figure(std::string("sub-step, ") + choice.name + ", " + std::to_string(tets), 1e6 * seconds, "us");
            }
}

// Each law's sub-step is timed alternately with the kernel, three times; the minimum ratio counts.
void bench_frame()
{
    for (const Choice &choice : choices) {
        double minimum = INFINITY;
        if (choice.incompressible) continue;
        for (int round = 0; round < 3; round++) {
            int tets, substeps;
            const double kernel = fixed_kernel_seconds();
            minimum = std::min(
                minimum, seconds_a_step(choice, {{14, 14, 14}, 1, PLIANT_CPU, 0.2}, 0.3, &tets, &substeps) / kernel);
        }
        figure(std::string("sub-step, ") + choice.name, minimum, "fixed kernels");
    }
}

} // namespace

int main(int argc, char **argv)
{
    if (argc > 1 && std::string(argv[1]) == "cuda") {
        bench_gpu(argc > 2 ? std::atof(argv[2]) : 0.5);
        return 0;
    }
    if (argc > 1 && std::string(argv[1]) == "frame") {
        bench_frame();
        return 0;
    }
    int cells = argc > 1 ? std::atoi(argv[1]) : 14;
    double budget = argc > 2 ? std::atof(argv[2]) : 0.5;
    std::printf("%-30s %10s %8s %12s %18s %8s\n", "", "tetrahedra", "threads", "us a step", "tetrahedra steps/s",
                "scaling");
    for (const Choice &choice : choices) {
        double one = 0;
        for (int threads = 1; threads <= 2; threads++) {
            int tets, substeps;
            double seconds =
                seconds_a_step(choice, {{cells, cells, cells}, threads, PLIANT_CPU, 0.2}, budget, &tets, &substeps);
            if (threads == 1) one = seconds;
            std::printf("%-30s %10d %8d %12.1f %18.3g %8.2f\n", choice.name, tets, threads, 1e6 * seconds,
                        tets / seconds, one / seconds);
        }
    }
}
