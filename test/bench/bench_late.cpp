// Test for late frames: time of a step relative to the median step in a running simulation. Background results are
// installed when they are ready (LIVE). The frames' errors are relative to tightly converged frames. The cost of a step
// is the CPU time of its thread. Frames run once at the rate of solver/step, then again with the same background
// results (PRESCRIBED, bitwise identical); the minimum counts.
//
// Usage:
//   bench_late [group/name=value ...]  the abdomen of the test data; mesh/ratio, solver/step, solver/preconditioner ...
#include "frames.h"

#include <time.h>

namespace {

const double liver[3] = {-0.057, -0.255, 0.392}; // at its front
enum { FRAMES = 300, FIRST = 60, AGAIN = 3 };
enum Case { SPRING, RIGID, TURN, BOTH, NUM_CASES };
const char *const case_names[] = {"spring", "rigid", "gravity", "spring, gravity"};

struct Late {
    std::vector<double> seconds, error;
    std::vector<int> evaluations;
    std::vector<uint32_t> taken;
    std::vector<std::vector<double>> positions;
    uint64_t factors = 0;
};

double thread_seconds()
{
    timespec now;
    clock_gettime(CLOCK_THREAD_CPUTIME_ID, &now);
    return double(now.tv_sec) + 1e-9 * double(now.tv_nsec);
}

// A tool circles 3 cm, and gravity rotates once per minute; tight: solved to convergence.
Late run_late(const pliant_model *model, Case which, const Late *recorded, bool tight)
{
    pliant_data *data = nullptr;
    check(pliant_data_create(model, &data));
    int tool = -1;
    if (which != TURN) {
        check(pliant_tool_add(model, data, "bench", &tool));
        check(pliant_tool_grasp(model, data, tool, liver));
        if (which == RIGID) check(pliant_tool_set_drive(data, tool, PLIANT_DRIVE_RIGID, nullptr));
    }
    Late out;
    auto begin = std::chrono::steady_clock::now();
    for (int frame = 0; frame < FRAMES; frame++) {
        const double a = 0.02 * frame,
                     tip[3] = {liver[0] + 0.03 * std::sin(a), liver[1] - 0.03 * std::pow(std::sin(0.5 * a), 2),
                               liver[2] + 0.015 * std::sin(2 * a)};
        const double gravity[3] = {9.81 * std::sin(a), 9.81 * std::cos(a), 0};
        if (which >= TURN) check(pliant_data_set_gravity(data, gravity));
        if (tool >= 0) check(pliant_tool_set_pose(data, tool, tip, nullptr));
        if (!tight)
            check(pliant_data_set_background(data, recorded ? PLIANT_BACKGROUND_PRESCRIBED : PLIANT_BACKGROUND_LIVE,
                                             recorded ? recorded->taken[size_t(frame)] : 0));
        if (!tight && !recorded) {
            begin += std::chrono::microseconds(static_cast<int64_t>(1e6 * model->scene.solver.step));
            std::this_thread::sleep_until(begin);
            begin = std::max(begin, std::chrono::steady_clock::now() - std::chrono::milliseconds(1));
        }
        const double from = thread_seconds();
        pliant_status status = PLIANT_NOT_CONVERGED;
        for (int left = tight ? 40 : 1; left > 0 && status == PLIANT_NOT_CONVERGED; left--)
            check(status = pliant_step(model, data));
        out.seconds.push_back(thread_seconds() - from);
        out.evaluations.push_back(data->statistics.iterations);
        out.taken.push_back(pliant_data_get_background_taken(data));
        if (!recorded)
            out.positions.emplace_back(data->positions, data->positions + 3 * size_t(model->body->fine.num_nodes));
    }
    out.factors = data->statistics.factors;
    pliant_data_free(data);
    return out;
}

void print_late(const pliant_model *model, Case which, const Late &run, const Late &exact)
{
    const size_t nodes = size_t(model->body->fine.num_nodes);
    std::vector<double> error, seconds(run.seconds.begin() + FIRST, run.seconds.end());
    double largest = 0;
    for (const auto &positions : exact.positions)
        largest = std::max(largest, largest_distance(positions.data(), model->body->fine.rest, nodes));
    for (size_t f = FIRST; f < FRAMES; f++)
        error.push_back(100 * largest_distance(run.positions[f].data(), exact.positions[f].data(), nodes) / largest);
    const double median = quantile(seconds, 0.5);
    std::printf(
        "  %-16s median %6.2f ms, 99 %% %4.2f x, worst %4.2f x, %ld of %zu above 2 x;  error median %.4f %%, "
        "95 %% %.4f, worst %.4f %%;  %lu factors\n",
        case_names[which], 1e3 * median, quantile(seconds, 0.99) / median, quantile(seconds, 1) / median,
        std::count_if(seconds.begin(), seconds.end(), [&](double s) { return s > 2 * median; }), seconds.size(),
        quantile(error, 0.5), quantile(error, 0.95), quantile(error, 1), static_cast<unsigned long>(run.factors));
    for (uint32_t taken = 0; taken < 16; taken++)
        for (int evaluations = 1; evaluations <= model->scene.solver.iterations; evaluations++) {
            int count = 0;
            double mean = 0, worst = 0;
            for (size_t f = FIRST; f < FRAMES; f++)
                if (run.evaluations[f] == evaluations && run.taken[f] == taken) {
                    count++;
                    mean += run.seconds[f];
                    worst = std::max(worst, run.seconds[f]);
                }
            if (count > 0)
                std::printf("    %2d evaluations, put to use %x: %3d frames, mean %6.2f ms, worst %6.2f ms\n",
                            evaluations, taken, count, 1e3 * mean / count, 1e3 * worst);
        }
    std::fflush(stdout);
}

} // namespace

int main(int argc, char **argv)
{
    pliant_scene scene;
    pliant_volume scan{};
    pliant_labels labels{};
    pliant_material_table materials{};
    pliant_scene_defaults(&scene);
    check(pliant_scene_set(&scene, "scan/resample", "256 160 122"));
    check(pliant_scene_set(&scene, "material/file", PLIANT_SOURCE_DIR "/test/bench/abdomen.yaml"));
    check(pliant_scene_set(&scene, "material/labels", PLIANT_TEST_DATA "/abdomen/labels_totalseg_fast.nii.gz"));
    check(pliant_scene_set(&scene, "grasp/stiffness", "500"));
    check(pliant_scene_set(&scene, "grasp/radius", "0.012"));
    check(pliant_scene_set(&scene, "solver/threads", "1"));
    scene.solver.backend = PLIANT_CPU;
    for (int a = 1; a < argc; a++) {
        std::string option = argv[a];
        size_t equals = option.find('=');
        check(pliant_scene_set(&scene, option.substr(0, equals).c_str(), option.substr(equals + 1).c_str()));
    }
    check(pliant_inputs_read(&scene, PLIANT_TEST_DATA "/abdomen/ct.nii.gz", &scan, &labels, &materials));
    pliant_model *model = nullptr, *exact = nullptr;
    check(pliant_model_build(&scene, &scan, &labels, &materials, {nullptr, nullptr}, &model));
    scene.solver.iterations = 50;
    scene.solver.tolerance = 1e-6;
    check(pliant_model_build(&scene, &scan, &labels, &materials, {nullptr, nullptr}, &exact));
    std::printf("%d fine tetrahedra\n", model->body->fine.num_tets);
    for (int which = 0; which < NUM_CASES; which++) {
        const Late tight = run_late(exact, Case(which), nullptr, true);
        Late live = run_late(model, Case(which), nullptr, false);
        for (int again = 0; again < AGAIN; again++) {
            const Late same = run_late(model, Case(which), &live, false);
            if (same.evaluations != live.evaluations) std::printf("  the same frames were others\n");
            for (size_t f = 0; f < FRAMES; f++) live.seconds[f] = std::min(live.seconds[f], same.seconds[f]);
        }
        print_late(model, Case(which), live, tight);
    }
    pliant_model_free(exact);
    pliant_model_free(model);
    pliant_material_table_free(&materials);
    pliant_labels_free(&labels);
    pliant_volume_free(&scan);
    return 0;
}
