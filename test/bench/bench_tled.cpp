// Microseconds a sub-step of explicit dynamics, by number of threads, law and options, on cubes of 5 n^3 tetrahedra.
//   bench_tled [cells along an edge = 14] [seconds a row = 0.5]
#include "../pipeline/body.h"

#include <algorithm>
#include <cstdio>
#include <cstdlib>

namespace {

struct Choice {
    const char *name;
    pliant_law law;
    bool viscous, nodal;
};

double seconds_a_step(const Choice &choice, int cells, int threads, double budget, int *tets)
{
    const int size[3] = {2 * cells, 2 * cells, 2 * cells};
    const double box[3] = {0.28, 0.28, 0.28};
    Body body(size, box, {{5e3, 0.45, 1000, false}});
    body.cells(cells, cells, cells, 1);
    body.fix_plane(0, 0, 0.001, 0, 0, 1);
    body.scene.solver.kind = PLIANT_TLED;
    body.scene.solver.threads = threads;
    body.scene.solver.step = 0.2;
    body.scene.model.gravity[0] = 3;
    body.scene.tled.law = choice.law;
    body.scene.tled.nodal_pressure = choice.nodal;
    if (choice.viscous) body.scene.tled.prony_share[0] = 0.3;
    if (body.build() != PLIANT_OK) {
        std::fprintf(stderr, "%s\n", pliant_last_error());
        std::exit(1);
    }
    pliant_dynamics dynamics;
    pliant_data_dynamics(body.model, body.data, &dynamics);
    *tets = body.model->fine.num_tets;
    double best = INFINITY, start = pliant_seconds();
    while (pliant_seconds() - start < budget) {
        double before = pliant_seconds();
        if (pliant_step(body.model, body.data) < 0) {
            std::fprintf(stderr, "%s\n", pliant_last_error());
            std::exit(1);
        }
        best = std::min(best, body.data->statistics.seconds[PLIANT_STEP_solve] / body.data->statistics.iterations);
        (void)before;
    }
    return best;
}

} // namespace

int main(int argc, char **argv)
{
    int cells = argc > 1 ? std::atoi(argv[1]) : 14;
    double budget = argc > 2 ? std::atof(argv[2]) : 0.5;
    static const Choice choices[] = {
        {"neo_hookean", PLIANT_LAW_NEO_HOOKEAN, false, false},
        {"compressible", PLIANT_LAW_COMPRESSIBLE, false, false},
        {"saint_venant_kirchhoff", PLIANT_LAW_SAINT_VENANT_KIRCHHOFF, false, false},
        {"neo_hookean, one Prony term", PLIANT_LAW_NEO_HOOKEAN, true, false},
        {"neo_hookean, nodal pressure", PLIANT_LAW_NEO_HOOKEAN, false, true},
    };
    std::printf("%-30s %10s %8s %12s %18s %8s\n", "", "tetrahedra", "threads", "us a step", "tetrahedra steps/s", "scaling");
    for (const Choice &choice : choices) {
        double one = 0;
        for (int threads = 1; threads <= 2; threads++) {
            int tets;
            double seconds = seconds_a_step(choice, cells, threads, budget, &tets);
            if (threads == 1) one = seconds;
            std::printf("%-30s %10d %8d %12.1f %18.3g %8.2f\n", choice.name, tets, threads, 1e6 * seconds, tets / seconds, one / seconds);
        }
    }
}
