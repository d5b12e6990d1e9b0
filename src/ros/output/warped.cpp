#include "ros/output/warped.h"

#include <algorithm>
#include <cmath>

namespace pliant_ros {

namespace {

const size_t max_target_voxels = size_t(1) << 31;

struct WorldBox {
    double low[3] = {INFINITY, INFINITY, INFINITY}, high[3] = {-INFINITY, -INFINITY, -INFINITY};

    void hold(const double *point)
    {
        for (int d = 0; d < 3; ++d) {
            low[d] = std::min(low[d], point[d]);
            high[d] = std::max(high[d], point[d]);
        }
    }
};

/* how far a side is moved out: by one margin, and by as many more as reach a node that lies outside */
double outwards(double beyond, double margin) { return margin * std::max(1.0, std::ceil(beyond / margin)); }

WorldBox box_of(const pliant_mesh &mesh, const std::vector<double> &positions, double margin)
{
    WorldBox rest, now;
    for (int32_t node = 0; node < mesh.num_nodes; ++node) rest.hold(&mesh.rest[3 * node]);
    for (size_t node = 0; node < positions.size(); node += 3) now.hold(&positions[node]);
    for (int d = 0; d < 3; ++d) {
        rest.low[d] -= outwards(rest.low[d] - now.low[d], margin);
        rest.high[d] += outwards(now.high[d] - rest.high[d], margin);
    }
    return rest;
}

pliant_geometry target_of(const Loaded &loaded, const std::vector<double> &positions, double margin)
{
    const pliant_geometry &scan = loaded.scan->volume.geometry;
    pliant_geometry target;
    if (margin > 0) {
        WorldBox box = box_of(pliant_model_get_body(loaded.model)->fine, positions, margin);
        check(pliant_warp_target(&scan, box.low, box.high, max_target_voxels, &target));
    } else {
        check(pliant_warp_target(&scan, nullptr, nullptr, max_target_voxels, &target));
    }
    return target;
}

} // namespace

void check_target(const Loaded &loaded)
{
    const pliant_mesh &mesh = pliant_model_get_body(loaded.model)->fine;
    std::vector<double> rest(mesh.rest, mesh.rest + 3 * static_cast<size_t>(mesh.num_nodes));
    target_of(loaded, rest, pliant_model_get_scene(loaded.model)->warp.margin);
}

Warped::Warped(std::shared_ptr<const Loaded> loaded, const std::vector<double> &positions, double margin)
    : loaded_(std::move(loaded)), margin_(margin)
{
    const pliant_model &model = *loaded_->model;
    target_ = target_of(*loaded_, positions, margin);
    const pliant_scene &scene = *pliant_model_get_scene(&model);
    check(pliant_warp_create(&loaded_->scan->volume, &pliant_model_get_body(&model)->fine, &target_, threads_of(scene), &warp_));
    pliant_status status = scene.warp.kind == PLIANT_FIT ? pliant_warp_fit(warp_, scene.warp.fit_step) : PLIANT_OK;
    if (status == PLIANT_OK) status = pliant_warp_backend(warp_, scene.solver.backend);
    if (status < 0) pliant_warp_free(warp_);
    check(status);
}

bool Warped::fits(const std::vector<double> &positions) const
{
    /* targets differ by whole voxels, or not at all */
    pliant_geometry target = target_of(*loaded_, positions, margin_);
    return pliant_geometry_equal(&target, &target_);
}

void Warped::update(const std::vector<double> &positions) { check(pliant_warp_update(warp_, positions.data())); }

std::vector<Box> Warped::changed() const
{
    int32_t count[3];
    const uint8_t *changed;
    pliant_warp_bricks(warp_, count, &changed);
    return changed_boxes(count, changed, target_.size);
}

pliant_picked Warped::pick(const std::vector<double> &positions, const pliant_ray &ray, double threshold) const
{
    pliant_picked picked{};
    check(pliant_pick_warped(warp_, positions.data(), &ray, threshold, &picked));
    return picked;
}

} // namespace pliant_ros
