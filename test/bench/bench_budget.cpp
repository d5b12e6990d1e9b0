// Error against run time of the fine solution with a limited number of iterations. A tool moves 1 mm per frame for 30
// frames, with a turn; gravity reverses in 60 frames (frames.h).
//
// Usage:
//   bench_budget SCENE SCAN X Y Z [group/name=value ...]     the point to pull at, LPS [m]
#include "frames.h"

int main(int argc, char **argv)
{
    if (argc < 6) {
        std::fprintf(stderr, "usage: bench_budget SCENE SCAN X Y Z [group/name=value ...]\n");
        return 2;
    }
    Inputs inputs;
    pliant_scene &scene = inputs.scene;
    check(pliant_scene_read(argv[1], &scene));
    inputs.set_options(argc, argv, 6);
    inputs.read(argv[2]);
    const double at[3] = {std::atof(argv[3]), std::atof(argv[4]), std::atof(argv[5])};
    scene.grasp.radius = 0.012;
    auto build = [&](int iterations, double tolerance) {
        scene.solver.iterations = iterations;
        scene.solver.tolerance = tolerance;
        return inputs.build();
    };
    pliant_model *exact = build(1000, 1e-7);
    std::printf("%d fine tetrahedra, %d nodes\n", exact->body->fine.num_tets, exact->body->fine.num_nodes);
    std::vector<Frames> references;
    for (int kind = 0; kind < NUM_KINDS; kind++)
        references.push_back(run(exact, at, Kind(kind), kind == FORCE ? &references[DISPLACEMENT] : nullptr, false));
    std::vector<double> estimates, before; // of all frames with up to six evaluations
    for (int iterations : {2, 3, 4, 6, 8}) {
        std::printf("%d iterations\n", iterations);
        pliant_model *model = build(iterations, 1e-9);
        for (int kind = 0; kind < NUM_KINDS; kind++) {
            Frames stopped = run(model, at, Kind(kind), &references[DISPLACEMENT], true);
            Errors errors = print_errors(kind_names[kind], model, stopped, references[size_t(kind)]);
            print_estimate_ratios("told", errors.ratio);
            print_estimate_ratios("in hindsight", errors.before);
            std::printf("\n");
            if (iterations > 6) continue;
            estimates.insert(estimates.end(), errors.ratio.begin(), errors.ratio.end());
            before.insert(before.end(), errors.before.begin(), errors.before.end());
        }
        pliant_model_free(model);
    }
    std::printf("2 to 6 iterations");
    print_estimate_ratios("told", estimates);
    print_estimate_ratios("in hindsight", before);
    std::printf("\n");
    pliant_model_free(exact);
    return 0;
}
