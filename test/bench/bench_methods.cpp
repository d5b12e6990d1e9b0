// Error of the coarse methods relative to the fine solution, and time and memory of building and stepping, on a real
// scan.
//
// Usage:
//   bench_methods SCENE SCAN [METHOD ...] [gravity] [LABELS-TO-PULL-AT ...]
// Example:
//   bench_methods test/bench/spine.yaml ct.nii.gz 5 20 2
//
// The named methods (schur_face: with touch face), or all of them, are compared with fine. gravity: 9.81 m/s^2 along y.
// For each label, its front (the most anterior voxel near its centroid) is pulled 3 cm forward and slightly up over 30
// steps. The grasped point is prescribed (displacement), or the force of the fine solution is applied (force).
// Errors refer to the last step, in % of the fine solution's maximum displacement. They are given over the nodes of the
// body (tetrahedra with at least half tissue), and over all nodes (including air).
#include "model_data/data.h"
#include "base/clock.h"
#include "base/memory.h"
#include "pliant/pliant.h"
#include "sim/build/model.h"

#include <algorithm>
#include <cctype>
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <string>
#include <vector>

namespace {

const int steps = 30;
const double pull[3] = {0.004, -0.029, 0.006}; // 3 cm

struct Run {
    std::vector<double> positions;
    double force[3];
    std::vector<double> solve, upsample, frame;
    double iterations;
    int unconverged;
};

void check(pliant_status status)
{
    if (status >= 0) return;
    std::fprintf(stderr, "bench_methods: %s\n", pliant_last_error());
    std::exit(1);
}

// at: grasped point; NULL: no tool, gravity increases instead
Run run(const pliant_model *model, const double *at, pliant_drive drive, const double *force)
{
    pliant_data *data = nullptr;
    check(pliant_data_create(model, &data));
    int tool = -1;
    double from[3] = {0, 0, 0};
    if (at) {
        check(pliant_tool_add(model, data, "bench", &tool));
        check(pliant_tool_grasp(model, data, tool, at));
        std::memcpy(from, data->tools[tool].tip, sizeof from);
    }
    Run out{};
    for (int s = 1; s <= steps; s++) {
        double tip[3], part[3] = {0, 0, 0}, gravity[3] = {0, 9.81 * s / steps, 0};
        for (int d = 0; d < 3; d++) {
            tip[d] = from[d] + pull[d] * s / steps;
            if (force) part[d] = force[d] * s / steps;
        }
        if (at) {
            check(pliant_tool_set_drive(data, tool, drive, part));
            check(pliant_tool_set_pose(data, tool, tip, nullptr));
        } else {
            check(pliant_data_set_gravity(data, gravity));
        }
        double start = pliant_seconds();
        pliant_status status = pliant_step(model, data);
        check(status);
        out.unconverged += status == PLIANT_NOT_CONVERGED;
        out.frame.push_back(pliant_seconds() - start);
        out.solve.push_back(data->statistics.seconds[PLIANT_STEP_solve]);
        out.upsample.push_back(data->statistics.seconds[PLIANT_STEP_upsample]);
        out.iterations += double(data->statistics.iterations) / steps;
    }
    out.positions.assign(data->positions, data->positions + 3 * size_t(model->body->fine.num_nodes));
    if (at) std::memcpy(out.force, data->tools[tool].force, sizeof out.force);
    pliant_data_free(data);
    return out;
}

double median(std::vector<double> v)
{
    std::nth_element(v.begin(), v.begin() + v.size() / 2, v.end());
    return v[v.size() / 2];
}

// Find the front of a label: its most anterior voxel within 10 mm of the centroid's column, moved 12 mm inside.
bool front_of(const pliant_labels &labels, int label, double out[3])
{
    const int32_t *size = labels.geometry.size;
    double centre[3] = {0, 0, 0}, count = 0;
    auto each = [&](auto &&visit) {
        for (int k = 0; k < size[2]; k++)
            for (int j = 0; j < size[1]; j++)
                for (int i = 0; i < size[0]; i++)
                    if (labels.voxels[i + size_t(size[0]) * (j + size_t(size[1]) * k)] == label) {
                        double index[3] = {double(i), double(j), double(k)}, world[3];
                        pliant_geometry_to_world(&labels.geometry, index, world);
                        visit(world);
                    }
    };
    each([&](const double *w) {
        for (int d = 0; d < 3; d++) centre[d] += w[d];
        count++;
    });
    if (count == 0) return false;
    for (double &c : centre) c /= count;
    double best = 1e9;
    each([&](const double *w) {
        if (std::hypot(w[0] - centre[0], w[2] - centre[2]) > 0.01 || w[1] > best) return;
        best = w[1];
        std::memcpy(out, w, 3 * sizeof *out);
    });
    out[1] += 0.006;
    return best < 1e9;
}

void compare(const char *name, const pliant_model *model, const Run &run, const Run &fine)
{
    size_t nodes = fine.positions.size() / 3, count[2] = {0, 0};
    double largest = 0, maximum[2] = {0, 0}, squares[2] = {0, 0};
    std::vector<char> body(nodes, 0);
    for (int32_t v = 0; v < 4 * model->body->fine.num_tets; v++)
        if (model->body->fine_material[v / 4].tissue >= 0.5) body[size_t(model->body->fine.tets[v])] = 1;
    for (size_t n = 0; n < nodes; n++) {
        double u = 0, e = 0;
        for (size_t d = 0; d < 3; d++) {
            u += std::pow(fine.positions[3 * n + d] - model->body->fine.rest[3 * n + d], 2);
            e += std::pow(fine.positions[3 * n + d] - run.positions[3 * n + d], 2);
        }
        largest = std::max(largest, std::sqrt(u));
        for (int all = body[n] ? 0 : 1; all < 2; all++) {
            maximum[all] = std::max(maximum[all], std::sqrt(e));
            squares[all] += e;
            count[all]++;
        }
    }
    std::printf(
        "%-26s body max %6.1f %%  rms %6.2f %%; all max %6.1f %%  rms %6.2f %%  (largest %.1f mm)  |F| %6.2f N  "
        "solve %6.2f ms, upsample %5.2f ms  %4.1f iterations  %d unconverged\n",
        name, 100 * maximum[0] / largest, 100 * std::sqrt(squares[0] / double(count[0])) / largest,
        100 * maximum[1] / largest, 100 * std::sqrt(squares[1] / double(count[1])) / largest, 1e3 * largest,
        std::sqrt(run.force[0] * run.force[0] + run.force[1] * run.force[1] + run.force[2] * run.force[2]),
        1e3 * median(run.solve), 1e3 * median(run.upsample), run.iterations, run.unconverged);
}

void report_build(const char *name, const pliant_model *model)
{
    double seconds = 0;
    std::printf("%s: %d nodes, %d fine and %d coarse tetrahedra, %d held pieces, condition %.1e; build", name,
                model->body->fine.num_nodes, model->body->fine.num_tets, model->body->coarse.num_tets,
                model->body->num_held_pieces, model->condition_estimate);
    for (int s = 0; s < PLIANT_NUM_BUILD_STAGES; s++) {
        std::printf(" %s %.0f ms", pliant_build_stage_name(s), 1e3 * model->build_seconds[s]);
        seconds += model->build_seconds[s];
    }
    size_t held = 0;
    for (size_t bytes : model->build_bytes) held += bytes;
    std::printf(", all %.2f s; holds %.0f MiB, peak of the process %.0f MiB\n", seconds, double(held) / 1048576,
                double(pliant_memory_peak()) / 1048576);
}

} // namespace

int main(int argc, char **argv)
{
    if (argc < 4) {
        std::fprintf(stderr, "usage: bench_methods SCENE SCAN [METHOD...] [gravity] [LABEL...]\n");
        return 2;
    }
    pliant_scene scene;
    pliant_volume scan{};
    pliant_labels labels{};
    pliant_material_table materials{};
    check(pliant_scene_read(argv[1], &scene));
    double start = pliant_seconds();
    check(pliant_inputs_read(&scene, argv[2], &scan, &labels, &materials));
    std::printf("scan and labels read in %.2f s: %d x %d x %d\n", pliant_seconds() - start, scan.geometry.size[0],
                scan.geometry.size[1], scan.geometry.size[2]);
    // accuracy first: solve every method to the tolerance
    scene.solver.iterations = 100;
    scene.solver.tolerance = 1e-4;
    scene.grasp.radius = 0.012;
    struct {
        const char *name;
        pliant_method method;
        pliant_submesh_extent submesh;
        bool wanted;
        pliant_model *model;
    } methods[] = {{"fine", PLIANT_FINE, PLIANT_SUBMESH_OVERLAP, true, nullptr},
                   {"coarse", PLIANT_COARSE, PLIANT_SUBMESH_OVERLAP, false, nullptr},
                   {"schur", PLIANT_SCHUR, PLIANT_SUBMESH_OVERLAP, false, nullptr},
                   {"schur_face", PLIANT_SCHUR, PLIANT_SUBMESH_FACE, false, nullptr},
                   {"averaged", PLIANT_AVERAGED, PLIANT_SUBMESH_OVERLAP, false, nullptr},
                   {"lod", PLIANT_LOD, PLIANT_SUBMESH_OVERLAP, false, nullptr}};
    bool named = false;
    for (auto &m : methods)
        for (int a = 3; a < argc; a++)
            if (std::strcmp(argv[a], m.name) == 0) named = m.wanted = true;
    for (auto &m : methods) {
        if (named && !m.wanted) continue;
        scene.model.method = m.method;
        scene.model.submesh = m.submesh;
        check(pliant_model_build(&scene, &scan, &labels, &materials, {nullptr, nullptr}, &m.model));
        report_build(m.name, m.model);
    }
    const pliant_model *exact = methods[0].model;
    for (int a = 3; a < argc; a++) {
        double at[3];
        const bool gravity = std::strcmp(argv[a], "gravity") == 0;
        if (!gravity && !std::isdigit(argv[a][0])) continue;
        if (!gravity && !front_of(labels, std::atoi(argv[a]), at)) {
            std::printf("label %s does not occur\n", argv[a]);
            continue;
        }
        if (gravity) std::printf("gravity\n");
        else std::printf("label %s, pulled at (%.3f %.3f %.3f) m\n", argv[a], at[0], at[1], at[2]);
        Run fine = run(exact, gravity ? nullptr : at, PLIANT_DRIVE_RIGID, nullptr);
        Run by_force = gravity ? fine : run(exact, at, PLIANT_DRIVE_FORCE, fine.force);
        for (const auto &m : methods) {
            if (!m.model) continue;
            if (m.model->body->fine.num_nodes != exact->body->fine.num_nodes) {
                std::printf("%s keeps other nodes: compare with mesh/keep_air\n", m.name);
                continue;
            }
            if (gravity) {
                compare(m.name, m.model, run(m.model, nullptr, PLIANT_DRIVE_RIGID, nullptr), fine);
                continue;
            }
            compare((std::string(m.name) + ", displacement").c_str(), m.model,
                    run(m.model, at, PLIANT_DRIVE_RIGID, nullptr), fine);
            compare((std::string(m.name) + ", force").c_str(), m.model,
                    run(m.model, at, PLIANT_DRIVE_FORCE, fine.force), by_force);
        }
    }
    for (const auto &m : methods) pliant_model_free(m.model);
    pliant_material_table_free(&materials);
    pliant_labels_free(&labels);
    pliant_volume_free(&scan);
    return 0;
}
