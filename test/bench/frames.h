// Shared code of benchmarks: a scene with its inputs, and thirty frames of a pull or sixty of reversing gravity. Their
// errors are relative to tightly converged frames. Errors are over all nodes of the fine mesh, in % of the final
// maximum displacement.
#ifndef PLIANT_BENCH_FRAMES_H
#define PLIANT_BENCH_FRAMES_H

#include "model_data/data.h"
#include "pliant/pliant.h"

#include <algorithm>
#include <chrono>
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <string>
#include <thread>
#include <vector>

enum Kind { DISPLACEMENT, FORCE, GRAVITY, NUM_KINDS };
static const char *const kind_names[] = {"displacement", "force", "gravity"};

struct Frames {
    std::vector<std::vector<double>> positions, force;
    std::vector<double> solve, residual;
    // error estimate of a step, and estimate of the previous step by the next one [m]; the last one is missing
    std::vector<double> estimates, before;
    double iterations = 0;
    int waited = 0; // number of steps until the patch was available
};

struct Errors {
    double worst = 0;          // maximum [%]
    // ratio of estimated to true error, for true errors above a micrometre; by the step itself and by the next one
    std::vector<double> ratio, before;
};

inline void check(pliant_status status)
{
    if (status >= 0) return;
    std::fprintf(stderr, "%s\n", pliant_last_error());
    std::exit(1);
}

struct Inputs {
    pliant_scene scene;
    pliant_volume scan{};
    pliant_labels labels{};
    pliant_material_table materials{};

    Inputs() { pliant_scene_defaults(&scene); }
    Inputs(const Inputs &) = delete;
    Inputs &operator=(const Inputs &) = delete;
    ~Inputs()
    {
        pliant_material_table_free(&materials);
        pliant_labels_free(&labels);
        pliant_volume_free(&scan);
    }
    void set(const char *name, const std::string &value) { check(pliant_scene_set(&scene, name, value.c_str())); }
    // Set options group/name=value, starting at argv[first].
    void set_options(int argc, char **argv, int first)
    {
        for (int a = first; a < argc; a++) {
            const std::string option = argv[a];
            const size_t equals = option.find('=');
            set(option.substr(0, equals).c_str(), equals == std::string::npos ? "" : option.substr(equals + 1));
        }
    }
    void read(const std::string &path) { check(pliant_inputs_read(&scene, path.c_str(), &scan, &labels, &materials)); }
    pliant_model *build() const
    {
        pliant_model *model = nullptr;
        check(pliant_model_build(&scene, &scan, &labels, &materials, {nullptr, nullptr}, &model));
        return model;
    }
    // Set the abdomen of the test data at 256 x 160 x 122, solved by the CPU. Return the path of its scan.
    std::string set_abdomen(const std::string &folder)
    {
        set("scan/resample", "256 160 122");
        set("material/file", PLIANT_SOURCE_DIR "/test/bench/abdomen.yaml");
        set("material/labels", folder + "/abdomen/labels_totalseg_fast.nii.gz");
        scene.mesh.keep_air = true;
        scene.grasp.radius = 0.012;
        scene.solver.backend = PLIANT_CPU;
        return folder + "/abdomen/ct.nii.gz";
    }
};

static const double liver[3] = {-0.057, -0.255, 0.392}; // front of the abdomen's liver

// Move up for 15 frames, then sideways: 1 mm per frame.
inline void offset_at(int frame, double out[3])
{
    out[0] = 0.001 * std::max(frame - 15, 0);
    out[1] = -0.001 * std::min(frame, 15);
    out[2] = 0;
}

// Run the frames.
// paced: frames start solver/step apart, as in a running simulation, so that the background has its time, and each is
// one step; otherwise a frame is stepped until it has converged, at most forty times
inline Frames run(const pliant_model *model, const double at[3], Kind kind, const Frames *driving, bool paced)
{
    pliant_data *data = nullptr;
    check(pliant_data_create(model, &data));
    int tool = -1, count = kind == GRAVITY ? 60 : 30;
    double from[3];
    Frames out;
    auto begin = std::chrono::steady_clock::now();
    auto step = [&] {
        pliant_status status = PLIANT_NOT_CONVERGED;
        for (int left = paced ? 1 : 40; left > 0 && status == PLIANT_NOT_CONVERGED; left--)
            status = pliant_step(model, data);
        check(status);
    };
    auto pace = [&] {
        begin += std::chrono::microseconds(static_cast<int64_t>(1e6 * model->scene.solver.step));
        if (paced) std::this_thread::sleep_until(begin);
        begin = std::max(begin, std::chrono::steady_clock::now() - std::chrono::milliseconds(1));
    };
    if (kind == GRAVITY) { // it hangs at rest before gravity rotates
        const double down[3] = {0, 9.81, 0};
        check(pliant_data_set_gravity(data, down));
        pliant_status status = PLIANT_NOT_CONVERGED;
        for (int s = 0; s < 100 && (paced || status == PLIANT_NOT_CONVERGED); s++) {
            check(status = pliant_step(model, data));
            if (s >= 60) pace();
        }
    } else {
        check(pliant_tool_add(model, data, "bench", &tool));
        check(pliant_tool_grasp(model, data, tool, at));
        std::memcpy(from, data->tools[tool].tip, sizeof from);
        // the patch is computed while the tool does not move
        if (model->fine_system)
            do step();
            while (out.waited++, data->statistics.patch_waiting > 0);
    }
    for (int f = 1; f <= count; f++) {
        pace();
        if (kind == GRAVITY) { // rotated by 180 degrees, from lying on the back (+y)
            double angle = M_PI * f / count, g[3] = {9.81 * std::sin(angle), 9.81 * std::cos(angle), 0};
            check(pliant_data_set_gravity(data, g));
        } else {
            double move[3], tip[3];
            offset_at(f, move);
            for (int d = 0; d < 3; d++) tip[d] = from[d] + move[d];
            check(pliant_tool_set_pose(data, tool, tip, nullptr));
            check(pliant_tool_set_drive(data, tool, kind == FORCE ? PLIANT_DRIVE_FORCE : PLIANT_DRIVE_RIGID,
                                    kind == FORCE ? driving->force[f - 1].data() : nullptr));
        }
        step();
        out.solve.push_back(data->statistics.seconds[PLIANT_STEP_solve] + data->statistics.seconds[PLIANT_STEP_patch]);
        out.residual.push_back(data->statistics.residual);
        out.estimates.push_back(data->statistics.error);
        if (f > 1) out.before.push_back(data->statistics.error_before);
        out.iterations += double(data->statistics.iterations) / count;
        out.positions.emplace_back(data->positions, data->positions + 3 * size_t(model->body->fine.num_nodes));
        if (kind != GRAVITY) out.force.emplace_back(data->tools[tool].force, data->tools[tool].force + 3);
    }
    pliant_data_free(data);
    return out;
}

inline double largest_distance(const double *a, const double *b, size_t nodes)
{
    double maximum = 0;
    for (size_t n = 0; n < 3 * nodes; n += 3)
        maximum = std::max(maximum, std::hypot(std::hypot(a[n] - b[n], a[n + 1] - b[n + 1]), a[n + 2] - b[n + 2]));
    return maximum;
}

inline double quantile(std::vector<double> values, double fraction)
{
    if (values.empty()) return NAN;
    std::sort(values.begin(), values.end());
    return values[size_t(fraction * double(values.size() - 1))];
}

inline Errors errors_of(const pliant_model *model, const Frames &run, const Frames &exact)
{
    size_t nodes = size_t(model->body->fine.num_nodes);
    double whole = largest_distance(exact.positions.back().data(), model->body->fine.rest, nodes);
    Errors out;
    for (size_t f = 0; f < exact.positions.size(); f++) {
        double error = largest_distance(run.positions[f].data(), exact.positions[f].data(), nodes);
        out.worst = std::max(out.worst, 100 * error / whole);
        if (error <= 1e-6) continue;
        out.ratio.push_back(run.estimates[f] / error);
        if (f < run.before.size() && run.before[f] > 0) out.before.push_back(run.before[f] / error);
    }
    return out;
}

// Print the fraction of error estimates within a factor of three of the true errors.
inline void print_estimate_ratios(const char *which, const std::vector<double> &ratio)
{
    const auto within = std::count_if(ratio.begin(), ratio.end(), [](double r) { return r > 1.0 / 3 && r < 3; });
    std::printf("   %s over true 5 to 95 %%: %.2f to %.2f, %.0f %% of %zu within 3", which, quantile(ratio, 0.05),
                quantile(ratio, 0.95), 100.0 * double(within) / double(std::max<size_t>(ratio.size(), 1)),
                ratio.size());
}

inline Errors print_errors(const char *name, const pliant_model *model, const Frames &run, const Frames &exact)
{
    Errors errors = errors_of(model, run, exact);
    std::printf(
        "  %-14s worst frame %7.3f %%   solve median %6.2f ms, worst %6.2f ms   iterations %4.1f   residual at most "
        "%.1e",
        name, errors.worst, 1e3 * quantile(run.solve, 0.5), 1e3 * quantile(run.solve, 1), run.iterations,
        quantile(run.residual, 1));
    return errors;
}

#endif
