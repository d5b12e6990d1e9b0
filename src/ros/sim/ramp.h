/* What acts on a hand begins and ends softly: it rises where nothing acted before, and falls where what acted is lost or held still. No ROS,
 * no clock of its own. */
#ifndef PLIANT_ROS_SIM_RAMP_H
#define PLIANT_ROS_SIM_RAMP_H

#include <algorithm>

namespace pliant_ros {

class Ramp {
public:
    /* wrench: as it is wanted, at a time [s]; becomes what is to be told. */
    void apply(double now, bool acts, double wrench[6])
    {
        const bool none = std::all_of(wrench, wrench + 6, [](double x) { return x == 0; });
        if (acts && !acts_) began_ = now;
        if (acts && none) began_ = now - RISE; /* a force that begins at zero needs no ramp */
        acts_ = acts;
        if (acts) acted_at_ = now;
        const double part = acts ? std::min((now - began_) / RISE, 1.0) : std::max(1 - (now - acted_at_) / FALL, 0.0);
        for (int i = 0; i < 6; ++i) wrench[i] = part * (acts ? wrench[i] : last_[i]);
        if (acts) told(wrench);
    }
    /* Less than it said: it falls from there. */
    void told(const double wrench[6]) { std::copy(wrench, wrench + 6, last_); }

private:
    static constexpr double RISE = 0.2, FALL = 0.03; /* [s]; zero well within 50 ms, after a step of 20 ms */
    bool acts_ = false;
    double began_ = 0, acted_at_ = -1e300, last_[6] = {};
};

} // namespace pliant_ros

#endif
