/* A deformed volume in memory, and the grid that it lies on. */
#ifndef PLIANT_ROS_OUTPUT_WARPED_H
#define PLIANT_ROS_OUTPUT_WARPED_H

#include "ros/sim/loaded.h"
#include "pliant/ros/convert.h"

#include <memory>
#include <vector>

namespace pliant_ros {

/* Throws Failure when the deformed volume of this model, at rest, would be too large for any machine. */
void check_target(const Loaded &loaded);

/* A warp, and the model and body that it borrows from. */
class Warped {
public:
    /* Target: the scan's grid, grown to hold the mesh at rest and the scene's margin around it; a replay gets the grid that was live.
       Tissue that leaves it is cut off. Throws Failure. */
    Warped(std::shared_ptr<const Loaded> loaded, std::shared_ptr<const pliant_body> body);
    ~Warped() { pliant_warp_free(warp_); }
    Warped(const Warped &) = delete;
    /* From now on this body is drawn, one of the same load. Throws Failure, and then the one before is. */
    void set_body(std::shared_ptr<const pliant_body> body);
    void update(const std::vector<double> &positions); /* Throws Failure. */
    const Loaded *loaded() const { return loaded_.get(); }
    const pliant_body *body() const { return body_.get(); }
    const pliant_geometry &target() const { return target_; }
    /* Of the last update; from a GPU it comes now, so that two threads must not ask at a time. */
    const pliant_volume &volume() const { return *pliant_warp_volume(warp_); }
    /* In what the last update drew, where it drew it. positions: of that update. Throws Failure. */
    pliant_picked pick(const std::vector<double> &positions, const pliant_ray &ray, double threshold) const;
    /* Sets those that the last update changed. False: none. */
    bool add_changed(std::vector<uint8_t> *bricks) const;
    /* Around these bricks. */
    std::vector<Box> boxes_of(const std::vector<uint8_t> &bricks) const;

private:
    std::shared_ptr<const Loaded> loaded_;
    std::shared_ptr<const pliant_body> body_;
    pliant_warp *warp_ = nullptr;
    pliant_geometry target_;
};

} // namespace pliant_ros

#endif
