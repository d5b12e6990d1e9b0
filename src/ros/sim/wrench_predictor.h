/* Compute a tool's wrench between steps from the linearization of the last step. This class uses neither ROS nor a
 * clock.
 *
 * At a new step, the old and the new prediction differ slightly. The difference decays to zero within one step period,
 * so that the wrench has no jump. The wrench stays constant until the next query, while the tool moves. It is therefore
 * evaluated half a motion ahead, so that loading and unloading exchange the same energy.
 *
 * A tool motion dp changes the energy by W'dp, where W is the last wrench. The energy put in since the contact began,
 * minus the energy returned, must stay non-negative (time-domain passivity: Hannaford and Ryu, IEEE Trans. Robotics and
 * Automation 18:1, 2002). The wrench is limited so that a motion as long as the longest recent one cannot extract more:
 * |W| |dp| <= energy. */
#ifndef PLIANT_ROS_SIM_WRENCH_PREDICTOR_H
#define PLIANT_ROS_SIM_WRENCH_PREDICTOR_H

#include "ros/sim/ramp.h"

#include "sim/build/linear_wrench.h"

namespace pliant_ros {

class WrenchPredictor {
public:
    /* max_change: maximum difference from the force of the last step [N] */
    explicit WrenchPredictor(double max_change) : max_change_(max_change) {}

    /* Set the linearization after a step.
     * now: time [s]
     * acts: false makes the wrench decay to zero until it is true again; it then rises as in ramp.h */
    void frame(double now, const pliant_tool_linear &linear, bool acts);
    void stop() { acts_ = false; } /* the wrench decays to zero until the next frame */
    /* Compute the wrench of the tool on the tissue at a pose, in tissue axes [N, N m]. */
    void answer(double now, const double tip[3], const double rotation[4], double out[6]);

    /* energy put in since the contact began minus the energy returned [J] */
    double energy() const { return energy_; }
    unsigned long num_limited_wrenches() const
    {
        return num_limited_wrenches_;
    } /* number of wrenches reduced for passivity */

private:
    void wanted(double now, const double tip[3], const double rotation[4], double out[6]) const;
    void move(double now, const double motion[6]);
    void limit_for_passivity(double now, double wrench[6]);
    double initial_energy_credit() const;
    double elastic() const;
    bool is_free() const;

    const double max_change_;
    pliant_tool_linear linear_{};
    bool acts_ = false;
    double frame_at_ = 0, blend_from_ = 0, blend_for_ = 0, offset_[6] = {};
    Ramp ramp_;
    bool has_answered_ = false;
    pliant_tool_linear last_{}; /* pose and wrench of the last query */
    /* last motion, mean motion, time of the last motion, and longest recent motion */
    double motion_[6] = {}, trend_[6] = {}, moved_at_ = -1, reach_ = 0;
    double rests_at_[3] = {}, rests_from_ = 0; /* position and time since which the hand rests */
    double energy_ = 0;
    unsigned long num_limited_wrenches_ = 0;
};

} // namespace pliant_ros

#endif
