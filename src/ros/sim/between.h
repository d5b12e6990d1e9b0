/* A tool's wrench between steps: what the last step's linearization says at the pose of now. No ROS, no clock of its own.
 *
 * At a new step the old answer and the new one differ a little; the difference goes to zero over the time that steps are apart, so that
 * nothing jumps. An answer stays until the next one, while the tool moves on: it is that of half a motion further, so that pressing in and
 * letting go take the same.
 *
 * The hand that moves the tool by dp puts energy W'dp in, where W is what was answered before; what it has put in since the tool took hold,
 * less what it was given back, may not fall below zero (time-domain passivity: Hannaford and Ryu, IEEE Trans. Robotics and Automation 18:1,
 * 2002). No motion as long as the longest of the last ones shall be able to take more than there is: |W| |dp| <= energy. */
#ifndef PLIANT_ROS_SIM_BETWEEN_H
#define PLIANT_ROS_SIM_BETWEEN_H

#include "ros/sim/ramp.h"

#include "pliant/linear.h"

namespace pliant_ros {

class Between {
public:
    /* most: that the force may differ from that of the last step [N] */
    explicit Between(double most) : most_(most) {}

    /* After a step, at a time [s]. acts false: the answer falls to zero, until it is true again; then it rises from there (ramp.h). */
    void frame(double now, const pliant_tool_linear &linear, bool acts);
    void stop() { acts_ = false; } /* until a frame says otherwise */
    /* At a pose in tissue axes: of the tool on the tissue [N, N m]. */
    void answer(double now, const double tip[3], const double rotation[4], double out[6]);

    double energy() const { return energy_; }      /* put in since it took hold, less what was given back [J] */
    unsigned long held_back() const { return held_back_; } /* answers that were made less for it */

private:
    void wanted(double now, const double tip[3], const double rotation[4], double out[6]) const;
    void move(double now, const double motion[6]);
    void keep_passive(double now, double wrench[6]);
    double credit() const;
    double elastic() const;
    bool is_free() const;

    const double most_;
    pliant_tool_linear linear_{};
    bool acts_ = false;
    double frame_at_ = 0, blend_from_ = 0, blend_for_ = 0, offset_[6] = {};
    Ramp ramp_;
    bool answered_ = false;
    pliant_tool_linear last_{}; /* pose and wrench of the last answer */
    double motion_[6] = {}, trend_[6] = {}, moved_at_ = -1, reach_ = 0; /* the last motion, the mean and the longest of the last ones */
    double rests_at_[3] = {}, rests_from_ = 0; /* the hand is where it was then */
    double energy_ = 0;
    unsigned long held_back_ = 0;
};

} // namespace pliant_ros

#endif
