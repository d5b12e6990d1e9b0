#include "ros/output/deformed_volume.h"
#include "sim/build/model.h"
#include "warp/warp.h"

namespace pliant_ros {

namespace {

const size_t max_target_voxels = size_t(1) << 31;

pliant_geometry target_of(const LoadedModel &loaded)
{
    const pliant_mesh &mesh = pliant_model_get_body(loaded.model)->fine;
    pliant_geometry target;
    const double margin = pliant_model_get_scene(loaded.model)->warp.margin;
    check(pliant_warp_target(&loaded.scan->volume.geometry, mesh.rest, mesh.num_nodes, margin, max_target_voxels,
                             &target));
    return target;
}

} // namespace

void check_target(const LoadedModel &loaded) { target_of(loaded); }

DeformedVolume::DeformedVolume(std::shared_ptr<const LoadedModel> loaded, std::shared_ptr<const pliant_body> body)
    : loaded_(std::move(loaded)), body_(share_body(pliant_model_get_body(loaded_->model)))
{
    const pliant_model &model = *loaded_->model;
    target_ = target_of(*loaded_);
    const pliant_scene &scene = *pliant_model_get_scene(&model);
    check(pliant_warp_create(pliant_model_get_drawn(&model), &body_->fine, &target_, threads_of(scene), &warp_));
    pliant_status status = body_->cuts ? pliant_warp_set_body(warp_, body_.get()) : PLIANT_OK;
    if (status == PLIANT_OK && scene.warp.kind == PLIANT_FIT) status = pliant_warp_fit(warp_, PLIANT_FIT_STEP);
    if (status == PLIANT_OK) status = pliant_warp_backend(warp_, scene.solver.backend);
    if (status == PLIANT_OK) status = pliant_warp_set_body(warp_, body.get());
    if (status == PLIANT_OK) body_ = std::move(body);
    if (status < 0) pliant_warp_free(warp_);
    check(status);
}

void DeformedVolume::set_body(std::shared_ptr<const pliant_body> body)
{
    if (body.get() == body_.get()) return;
    check(pliant_warp_set_body(warp_, body.get()));
    body_ = std::move(body);
}

bool DeformedVolume::add_changed(std::vector<uint8_t> *bricks) const
{
    int32_t count[3];
    const uint8_t *changed;
    pliant_warp_bricks(warp_, count, &changed);
    bricks->resize(static_cast<size_t>(count[0]) * count[1] * count[2]);
    bool any = false;
    for (size_t i = 0; i < bricks->size(); ++i)
        if (changed[i]) (*bricks)[i] = any = true;
    return any;
}

std::vector<Box> DeformedVolume::boxes_of(const std::vector<uint8_t> &bricks) const
{
    int32_t count[3];
    const uint8_t *changed;
    pliant_warp_bricks(warp_, count, &changed);
    return changed_boxes(count, bricks.data(), target_.size);
}

pliant_picked DeformedVolume::pick(const std::vector<double> &positions, const pliant_ray &ray, double threshold) const
{
    pliant_picked picked{};
    check(pliant_pick_tissue(loaded_->model, warp_, positions.data(), &ray, threshold, &picked));
    return picked;
}

} // namespace pliant_ros
