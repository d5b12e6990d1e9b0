/* Ramp for the force on a hand. A force that starts suddenly rises gradually, and a lost force decays. This class uses
 * neither ROS nor a clock. */
#ifndef PLIANT_ROS_SIM_RAMP_H
#define PLIANT_ROS_SIM_RAMP_H

#include <algorithm>

namespace pliant_ros {

class Ramp {
public:
    /* Scale a wrench.
     * now: time [s]
     * wrench: input: computed wrench; output: wrench to publish */
    void apply(double now, bool acts, double wrench[6])
    {
        const bool none = std::all_of(wrench, wrench + 6, [](double x) { return x == 0; });
        if (acts && !acts_) began_ = now;
        if (acts && none) began_ = now - RISE; /* a force that starts at zero needs no ramp */
        acts_ = acts;
        if (acts) acted_at_ = now;
        const double part = acts ? std::min((now - began_) / RISE, 1.0) : std::max(1 - (now - acted_at_) / FALL, 0.0);
        for (int i = 0; i < 6; ++i) wrench[i] = part * (acts ? wrench[i] : last_[i]);
        if (acts) set_published(wrench);
    }
    /* Set a smaller published wrench, from which the force decays. */
    void set_published(const double wrench[6]) { std::copy(wrench, wrench + 6, last_); }

private:
    /* times to rise and decay [s]; the decay and a step of 20 ms end within 50 ms */
    static constexpr double RISE = 0.2, FALL = 0.03;
    bool acts_ = false;
    double began_ = 0, acted_at_ = -1e300, last_[6] = {};
};

} // namespace pliant_ros

#endif
