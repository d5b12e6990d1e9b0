/* A deformed volume in memory and its grid. */
#ifndef PLIANT_ROS_OUTPUT_DEFORMED_VOLUME_H
#define PLIANT_ROS_OUTPUT_DEFORMED_VOLUME_H

#include "ros/sim/loaded_model.h"
#include "pliant/ros/convert.h"

#include <memory>
#include <vector>

namespace pliant_ros {

/* Throw Failure if the deformed volume of this model at rest is too large for the memory of a typical machine. */
void check_target(const LoadedModel &loaded);

/* A warp with the model and body that it refers to. */
class DeformedVolume {
public:
    /* Create the volume on the scan's grid, extended to contain the mesh at rest and the scene's margin. A replay uses
     * the grid of the recording. Tissue outside the grid is clipped. Throws Failure. */
    DeformedVolume(std::shared_ptr<const LoadedModel> loaded, std::shared_ptr<const pliant_body> body);
    ~DeformedVolume() { pliant_warp_free(warp_); }
    DeformedVolume(const DeformedVolume &) = delete;
    /* Render this body, which belongs to the same loaded model. Throws Failure; the previous body then stays in use. */
    void set_body(std::shared_ptr<const pliant_body> body);
    /* Draw the bricks that have changed at these positions. Throws Failure. */
    void update(const std::vector<double> &positions) { check(pliant_warp_update(warp_, positions.data())); }
    const LoadedModel *loaded() const { return loaded_.get(); }
    const pliant_body *body() const { return body_.get(); }
    const pliant_geometry &target() const { return target_; }
    /* Return the volume of the last update. With a GPU, this call downloads it; do not call from two threads at
     * once. */
    const pliant_volume &volume() const { return *pliant_warp_volume(warp_); }
    /* Pick a point in the volume of the last update.
     * positions: node positions of that update
     * Throws Failure. */
    pliant_picked pick(const std::vector<double> &positions, const pliant_ray &ray, double threshold) const;
    /* Mark the bricks that the last update changed. Return false if no brick changed. */
    bool add_changed(std::vector<uint8_t> *bricks) const;
    /* Return boxes that cover these bricks. */
    std::vector<Box> boxes_of(const std::vector<uint8_t> &bricks) const;

private:
    std::shared_ptr<const LoadedModel> loaded_;
    std::shared_ptr<const pliant_body> body_;
    pliant_warp *warp_ = nullptr;
    pliant_geometry target_;
};

} // namespace pliant_ros

#endif
