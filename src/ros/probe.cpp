#include "probe.h"

#include <algorithm>
#include <cmath>
#include <vector>

namespace pliant_ros {

namespace {

enum { MAX_PROBE_STEPS = 200 };
const double pull_distance = 0.02; /* [m] */

double squared_distance(const double *a, const double *b)
{
    double sum = 0;
    for (int d = 0; d < 3; ++d) sum += (a[d] - b[d]) * (a[d] - b[d]);
    return sum;
}

struct Pull {
    double from[3], to[3];
};

/* Of the nodes of a surface, so that the pull leads out of the tissue and into no bone. */
Pull choose_pull(const pliant_model &model)
{
    const pliant_mesh &mesh = model.fine;
    std::vector<int32_t> fixed;
    double centre[3] = {0, 0, 0};
    for (int32_t node = 0; node < mesh.num_nodes; ++node) {
        if (model.fine_fixed[node]) fixed.push_back(node);
        for (int d = 0; d < 3; ++d) centre[d] += mesh.rest[3 * node + d] / mesh.num_nodes;
    }
    double farthest = -1;
    Pull pull;
    std::vector<int32_t> surface(model.triangles, model.triangles + 3 * static_cast<size_t>(model.num_triangles));
    std::sort(surface.begin(), surface.end());
    surface.erase(std::unique(surface.begin(), surface.end()), surface.end());
    for (int32_t node : surface) {
        if (model.fine_fixed[node]) continue;
        double nearest = INFINITY;
        const double *at = &mesh.rest[3 * node];
        for (int32_t other : fixed) nearest = std::min(nearest, squared_distance(at, &mesh.rest[3 * other]));
        if (nearest <= farthest) continue;
        farthest = nearest;
        double length = std::sqrt(squared_distance(at, centre));
        for (int d = 0; d < 3; ++d) {
            double outward = length > 0 ? (at[d] - centre[d]) / length : (d == 1 ? -1 : 0);
            /* a little inside, where there surely is tissue */
            pull.from[d] = at[d] - 1e-4 * outward;
            pull.to[d] = pull.from[d] + pull_distance * outward;
        }
    }
    if (farthest < 0) throw Failure(PLIANT_ERROR_SCENE, "no node of the surface is free: nothing to probe");
    return pull;
}

/* stage: what is solved; done: fraction of the work before it */
std::vector<double> solve(const pliant_model &model, const Pull &pull, pliant_progress progress, double done,
                          const char *stage)
{
    Data data = create_data(model);
    int tool;
    check(pliant_tool_add(&model, data.get(), "probe", &tool));
    check(pliant_tool_pose(data.get(), tool, pull.from, nullptr));
    check(pliant_tool_grasp(&model, data.get(), tool, pull.from));
    check(pliant_tool_drive(data.get(), tool, PLIANT_DRIVE_RIGID, nullptr));
    check(pliant_tool_pose(data.get(), tool, pull.to, nullptr));
    pliant_status status = PLIANT_NOT_CONVERGED;
    for (int i = 0; status == PLIANT_NOT_CONVERGED && i < MAX_PROBE_STEPS; ++i) {
        if (progress.function && !progress.function(done + 0.25 * i / MAX_PROBE_STEPS, stage, progress.user))
            throw Failure(PLIANT_ERROR_CANCELLED, "cancelled");
        status = pliant_step(&model, data.get());
        check(status);
    }
    if (status != PLIANT_OK) throw Failure(status, std::string("the probe of the ") + stage + " does not converge");
    return std::vector<double>(data->positions, data->positions + 3 * static_cast<size_t>(model.fine.num_nodes));
}

} // namespace

ProbeError probe(const Loaded &loaded, pliant_progress progress)
{
    pliant_scene scene = loaded.model->scene;
    scene.model.method = PLIANT_FINE;
    const pliant_progress silent = {nullptr, nullptr};
    std::shared_ptr<Loaded> fine = build(scene, loaded.scan, loaded.model->materials, 0, silent);
    Pull pull = choose_pull(*fine->model);
    std::vector<double> reference = solve(*fine->model, pull, progress, 0.5, "fine model");
    std::vector<double> found = solve(*loaded.model, pull, progress, 0.75, "homogenized model");
    /* schur keeps more tetrahedra than the fine model, so that nodes are paired by their place in the lattice */
    const pliant_mesh &mesh = fine->model->fine, &other = loaded.model->fine;
    double largest = 0, error = 0, sum = 0;
    int32_t pairs = 0;
    for (int32_t node = 0; node < mesh.num_nodes; ++node) {
        int32_t same = pliant_mesh_node_in(&other, &mesh, node);
        if (same < 0) continue;
        double squared = squared_distance(&reference[3 * static_cast<size_t>(node)], &found[3 * static_cast<size_t>(same)]);
        largest = std::max(largest, squared_distance(&reference[3 * static_cast<size_t>(node)], &mesh.rest[3 * node]));
        error = std::max(error, squared);
        sum += squared;
        ++pairs;
    }
    if (!(largest > 0)) throw Failure(PLIANT_ERROR_NUMERIC, "the probe load moves nothing");
    return ProbeError{std::sqrt(error / largest), std::sqrt(sum / pairs / largest)};
}

} // namespace pliant_ros
