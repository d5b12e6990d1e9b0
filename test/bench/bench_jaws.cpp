// Each instrument with jaws closes on the tip of the phantom's liver (launch/scenes/grasp.yaml), and lifts it by 10 mm.
// The jaws move from 1.0 to -0.3 rad in 2 s, at 50 Hz. Scissors do so without and with their blade.
//
// Usage:
//   bench_jaws [instrument ...]     default: all; set OMP_NUM_THREADS=1 for CPU times of one thread
//
// The table shows, for each instrument: worst and median CPU time of steps while the jaws touch tissue; most
// evaluations of a step; inverted elements, maximum; largest torque about the jaws' joint over contact/grip_torque;
// height by which the liver's tip is lifted.
#include "figure.h"
#include "model_data/data.h"
#include "pliant/pliant.h"
#include "sim/api/data.h"

#include <array>
#include <cmath>
#include <cstdlib>
#include <ctime>

namespace
{

const char *const instruments[] = {"potts_scissors",
                                   "small_clip_applier",
                                   "large_needle_driver",
                                   "round_tip_scissors",
                                   "micro_forceps",
                                   "round_tooth_forceps",
                                   "debakey_forceps",
                                   "long_tip_forceps",
                                   "cadiere_forceps",
                                   "prograsp_forceps",
                                   "needle_driver",
                                   "bowel_grasper",
                                   "maryland_dissector",
                                   "maryland_bipolar_forceps",
                                   "curved_scissors",
                                   "monopolar_curved_scissors",
                                   "resano_forceps",
                                   "double_fenestrated_grasper",
                                   "mega_needle_driver",
                                   "fenestrated_bipolar_forceps",
                                   "tenaculum_forceps",
                                   "thoracic_grasper",
                                   "large_clip_applier",
                                   "lrg_suturecut_needle_driver",
                                   "mega_suturecut_needle_driver",
                                   "medium-large_clip_applier",
                                   "stapler_45"};

void exit_on_error(pliant_status status)
{
    if (status >= 0) return;
    std::fprintf(stderr, "bench_jaws: %s\n", pliant_last_error());
    std::exit(1);
}

// CPU time of this thread; other threads do background work
double cpu()
{
    timespec now;
    clock_gettime(CLOCK_THREAD_CPUTIME_ID, &now);
    return double(now.tv_sec) + 1e-9 * double(now.tv_nsec);
}

// Pose at a time [s]: approach, wait, close, lift.
struct Pose {
    double tip[3], jaw;
};
Pose pose_at(double time)
{
    const auto between = [time](double from, double to) {
        return std::fmin(std::fmax((time - from) / (to - from), 0), 1);
    };
    return {{0.09 - 0.04 * between(0, 1), -0.048 - 0.01 * between(3.2, 4.2), 0.128}, 1.0 - 1.3 * between(1.2, 3.2)};
}

struct Outcome {
    double worst = 0, median = 0, detection = 0, solve = 0, torque = 0, lifted = 0;
    int32_t evaluations = 0, inverted = 0, not_converged = 0;
};

Outcome close_jaws(const pliant_model *model, const char *name, bool with_blade)
{
    const double rotation[4] = {0.5, -0.5, -0.5, 0.5}, step = pliant_model_get_scene(model)->solver.step;
    pliant_data *data = nullptr;
    pliant_tool_shape shape{};
    int tool = -1;
    exit_on_error(pliant_data_create(model, &data));
    exit_on_error(pliant_tool_shape_find(name, &shape));
    exit_on_error(pliant_tool_add(model, data, "PSM1", &tool));
    exit_on_error(pliant_tool_set_shape(data, tool, &shape));
    if (with_blade) {
        double from[3], to[3];
        exit_on_error(pliant_blade_find("scissors", from, to));
        exit_on_error(pliant_tool_set_blade(data, tool, from, to));
    }
    Outcome out;
    std::vector<double> times;
    const double tip[3] = {0.05, -0.048, 0.128};
    int32_t nearest = 0;
    const pliant_mesh &mesh = data->body->fine;
    const auto distance = [&](int32_t n) {
        return std::hypot(std::hypot(mesh.rest[3 * n] - tip[0], mesh.rest[3 * n + 1] - tip[1]),
                          mesh.rest[3 * n + 2] - tip[2]);
    };
    for (int32_t n = 1; n < mesh.num_nodes; n++)
        if (distance(n) < distance(nearest)) nearest = n;
    const double height = mesh.rest[3 * nearest + 1];
    for (int n = 0; n * step <= 4.4; n++) {
        const Pose pose = pose_at(n * step);
        exit_on_error(pliant_tool_set_pose(data, tool, pose.tip, rotation));
        exit_on_error(pliant_tool_set_jaw(data, tool, pose.jaw));
        if (with_blade) exit_on_error(pliant_tool_set_cutting(data, tool, n * step > 1.2 && n * step < 3.2));
        const double start = cpu();
        const pliant_status status = pliant_step(model, data);
        exit_on_error(status);
        const pliant_statistics &statistics = data->statistics;
        if (data->contacts.count > 0) {
            times.push_back(cpu() - start);
            out.detection += statistics.seconds[PLIANT_STEP_contact];
            out.solve += statistics.seconds[PLIANT_STEP_solve];
        }
        out.evaluations = std::max(out.evaluations, statistics.iterations);
        out.inverted = std::max(out.inverted, pliant_data_get_inverted(data));
        out.not_converged += status == PLIANT_NOT_CONVERGED;
        out.torque = std::fmax(out.torque, std::fabs(data->tools[tool].proxy.load.jaw));
    }
    if (!with_blade) out.lifted = height - data->positions[3 * nearest + 1];
    std::sort(times.begin(), times.end());
    out.detection /= static_cast<double>(std::max<size_t>(times.size(), 1));
    out.solve /= static_cast<double>(std::max<size_t>(times.size(), 1));
    out.worst = times.empty() ? 0 : times.back();
    out.median = times.empty() ? 0 : times[times.size() / 2];
    pliant_data_free(data);
    pliant_tool_shape_free(&shape);
    return out;
}

const pliant_model *make_model(bool with_blade)
{
    static pliant_volume scan[2]; // a model needs its scan and its labels
    static pliant_labels labels[2];
    pliant_scene scene;
    pliant_material_table table{};
    pliant_model *model = nullptr;
    exit_on_error(pliant_scene_read(PLIANT_SOURCE_DIR "/launch/scenes/grasp.yaml", &scene));
    if (with_blade) scene.cut.kind = PLIANT_CUT_SEVER;
    exit_on_error(pliant_inputs_read(&scene, "phantom", scan + with_blade, labels + with_blade, &table));
    exit_on_error(
        pliant_model_build(&scene, scan + with_blade, labels + with_blade, &table, {nullptr, nullptr}, &model));
    return model;
}

} // namespace

int main(int argc, char **argv)
{
    std::vector<std::string> names(argv + 1, argv + argc);
    if (names.empty()) names.assign(std::begin(instruments), std::end(instruments));
    double ratio = 0, torque = 0;
    int32_t inverted = 0;
    std::printf("%-36s %9s %9s %6s %9s %9s %6s %9s %9s %8s %8s\n", "instrument", "worst ms", "median", "ratio",
                "contact", "solve", "evals", "not conv.", "inverted", "torque", "lift mm");
    for (const bool with_blade : {false, true}) {
        const pliant_model *model = make_model(with_blade);
        const double limit = pliant_model_get_scene(model)->contact.grip_torque;
        for (const std::string &name : names) {
            if (with_blade && name.find("scissors") == std::string::npos) continue;
            const Outcome of = close_jaws(model, name.c_str(), with_blade);
            std::printf("%-36s %9.1f %9.1f %6.1f %9.1f %9.1f %6d %9d %9d %8.2f %8.1f\n",
                        (name + (with_blade ? " with its blade" : "")).c_str(), 1e3 * of.worst, 1e3 * of.median,
                        of.worst / of.median, 1e3 * of.detection, 1e3 * of.solve, of.evaluations, of.not_converged,
                        of.inverted, of.torque / limit, 1e3 * of.lifted);
            std::fflush(stdout);
            ratio = std::fmax(ratio, of.worst / of.median);
            torque = std::fmax(torque, of.torque / limit);
            inverted = std::max(inverted, of.inverted);
        }
    }
    figure("jaws/worst step over the median", ratio, "");
    figure("jaws/inverted elements, most", inverted, "");
    figure("jaws/torque over the limit, most", torque, "");
    return 0;
}
