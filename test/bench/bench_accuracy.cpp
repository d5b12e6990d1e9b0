// Accuracy of the fine solution within a time per frame, and of coarse models without a time limit, relative to the
// requirements. The body is the abdomen of the test data at 256 x 160 x 122, coarse cells 7 x 7 x 7. Takes some
// minutes; needs an idle machine.
//
// Usage:
//   bench_accuracy [DATA-FOLDER [ratio ...]]   default: the folder of the tests, ratios 2 and 4
//   bench_accuracy frame [DATA-FOLDER]         one frame of each pull at ratio 2, on one thread, relative to a fixed
//                                             kernel
#include "figure.h"
#include "frames.h"

namespace {

pliant_model *build(Inputs &inputs, int iterations, double tolerance, double budget)
{
    inputs.scene.solver.iterations = iterations;
    inputs.scene.solver.tolerance = tolerance;
    inputs.scene.solver.budget_ms = budget;
    if (budget > 0) inputs.scene.solver.step = 2.5e-3 * budget; // the solver has a part of a frame
    return inputs.build();
}

std::vector<Frames> references(Inputs &inputs, int kinds)
{
    std::vector<Frames> out;
    pliant_model *exact = build(inputs, 50, 1e-7, 0); // many steps, because factors are refreshed between them
    std::printf("%d fine tetrahedra, %d nodes\n", exact->body->fine.num_tets, exact->body->fine.num_nodes);
    for (int kind = 0; kind < kinds; kind++) {
        out.push_back(run(exact, liver, Kind(kind), kind == FORCE ? &out[DISPLACEMENT] : nullptr, false));
        if (quantile(out.back().residual, 1) > 2e-7)
            std::printf("  %s: solved to %.1e only\n", kind_names[kind], quantile(out.back().residual, 1));
    }
    pliant_model_free(exact);
    return out;
}

// Ratio of estimated to true error, by the step itself and by the next step.
struct EstimateRatios {
    std::vector<double> now[NUM_KINDS], before[NUM_KINDS];
};

void line(const pliant_model *model, int kind, const std::vector<Frames> &exact, double reach, bool paced,
          EstimateRatios *estimates)
{
    Frames stopped = run(model, liver, Kind(kind), &exact[DISPLACEMENT], paced);
    Errors errors = print_errors(kind_names[kind], model, stopped, exact[size_t(kind)]);
    std::printf("   reach %g %%: %s\n", reach, errors.worst <= reach ? "met" : "NOT MET");
    std::fflush(stdout);
    if (!estimates) return;
    estimates->now[kind].insert(estimates->now[kind].end(), errors.ratio.begin(), errors.ratio.end());
    estimates->before[kind].insert(estimates->before[kind].end(), errors.before.begin(), errors.before.end());
}

void fine(Inputs &inputs, const std::vector<Frames> &exact, double budget, double pulls, double gravity,
          EstimateRatios *estimates)
{
    inputs.scene.model.method = PLIANT_FINE;
    pliant_model *model = build(inputs, 1000, 1e-6, budget);
    std::printf("fine, %g ms of solver a frame\n", budget);
    for (size_t kind = 0; kind < exact.size(); kind++)
        line(model, int(kind), exact, kind == GRAVITY ? gravity : pulls, true, estimates);
    pliant_model_free(model);
}

void coarse(Inputs &inputs, const std::vector<Frames> &exact)
{
    for (double patch : {0.0, 0.05})
        for (const char *method : {"coarse", "schur", "averaged", "lod"}) {
            check(pliant_scene_set(&inputs.scene, "model/method", method));
            inputs.scene.model.patch = patch;
            pliant_model *model = build(inputs, patch > 0 ? 6 : 100, patch > 0 ? 1e-3 : 1e-4, 0);
            std::printf("%s, patch %g m\n", method, patch);
            for (int kind : {DISPLACEMENT, FORCE}) line(model, kind, exact, 5, patch > 0, nullptr);
            pliant_model_free(model);
        }
    inputs.scene.model.method = PLIANT_FINE;
    inputs.scene.model.patch = 0;
}

void let_bone_deform(Inputs &inputs, bool deform)
{
    for (int32_t m = 0; m < int32_t(inputs.materials.num_materials); m++)
        if (std::strcmp(inputs.materials.materials[m].name, "bone") == 0) inputs.materials.materials[m].fixed = !deform;
}

// Each pull is timed alternately with the kernel, three times; the minimum ratio of the median frame counts.
void bench_frame(Inputs &inputs)
{
    inputs.scene.solver.threads = 1;
    pliant_model *model = build(inputs, 100, 1e-3, 0);
    Frames pulled;
    for (int kind : {DISPLACEMENT, FORCE}) {
        double minimum = INFINITY;
        for (int round = 0; round < 3; round++) {
            const double kernel = fixed_kernel_seconds();
            Frames frames = run(model, liver, Kind(kind), &pulled, false);
            minimum = std::min(minimum, quantile(frames.solve, 0.5) / kernel);
            if (kind == DISPLACEMENT) pulled = frames;
        }
        figure(std::string("frame, abdomen, ") + kind_names[kind], minimum, "fixed kernels");
    }
    pliant_model_free(model);
}

} // namespace

int main(int argc, char **argv)
{
    const bool frame = argc > 1 && std::strcmp(argv[1], "frame") == 0;
    if (frame) argc--, argv++;
    std::vector<int> ratios;
    for (int a = 2; a < argc; a++) ratios.push_back(std::atoi(argv[a]));
    if (ratios.empty()) ratios = {2, 4};
    Inputs inputs;
    inputs.read(inputs.set_abdomen(argc > 1 ? argv[1] : PLIANT_TEST_DATA));
    if (frame) {
        bench_frame(inputs);
        return 0;
    }
    for (int ratio : ratios) {
        inputs.scene.mesh.ratio = ratio;
        const bool large = ratio > 2;
        EstimateRatios estimates;
        std::printf("ratio %d, bone fixed\n", ratio);
        std::vector<Frames> exact = references(inputs, NUM_KINDS);
        fine(inputs, exact, large ? 40 : 8, large ? 3 : 1, large ? 3 : 1, &estimates);
        if (large) fine(inputs, exact, 80, 1, 3, &estimates);
        coarse(inputs, exact);
        std::printf("ratio %d, spine fixed, other bone deforms (1e7 Pa)\n", ratio);
        let_bone_deform(inputs, true);
        fine(inputs, references(inputs, GRAVITY), large ? 80 : 16, large ? 5 : 3, 0, &estimates);
        let_bone_deform(inputs, false);
        for (int kind = 0; kind < NUM_KINDS; kind++) {
            print_estimate_ratios((kind_names[kind] + std::string(", at once")).c_str(), estimates.now[kind]);
            print_estimate_ratios("a step later", estimates.before[kind]);
            std::printf("\n");
        }
    }
    return 0;
}
