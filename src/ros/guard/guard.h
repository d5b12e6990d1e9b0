/* Between the simulation's forces and a surgeon's hand: what may pass, and how fast it may change. No ROS, no clock of its own.
 *
 * It begins in ENDING where it is enabled: one before it may have been killed, and the hand feels its last force still.
 *
 *    state   | output                        | leaves when                                    | for
 *    CLOSED  | none                          | all gates are open                             | RISING
 *            |                               | fault                                          | FAULT
 *    RISING  | the force, times 0 to 1       | `ramp` has passed                              | OPEN
 *            |                               | a gate closes, or fault                        | ENDING
 *    OPEN    | the force                     | a gate closes, or fault                        | ENDING
 *    ENDING  | zero                          | all gates are open                             | RISING
 *            |                               | `tail` has passed                              | CLOSED; after a fault FAULT
 *    FAULT   | none                          | never: no gate opens any more                  |
 *    any     | zero, once                    | shut_down                                      | CLOSED, for good
 *
 * A gate that closes makes the output zero in the same update: no ramp, no filter. "The force" is what came last, times -gain, through a
 * first-order low-pass, held back to `rate` and to `largest`. */
#ifndef PLIANT_ROS_GUARD_GUARD_H
#define PLIANT_ROS_GUARD_GUARD_H

#include <string>

namespace pliant_ros {

struct GuardSettings {
    bool enabled = false;       /* ~haptic */
    bool needs_following = true; /* of the teleoperation; false: there is none */
    double gain = 0.25;         /* of the hand's force over the tissue's */
    double largest = 2;         /* [N] */
    double rate = 20;           /* [N/s] */
    double cutoff = 30;         /* of the low-pass [Hz] */
    double ramp = 0.5;          /* [s] */
    double tail = 0.2;          /* zeros after closing [s] */
    double timeout = 0.04;      /* of forces, and of poses: a step is late now and then [s] */
    double largest_error = 0.002; /* of a step, told by `timing` [m]; infinite: whatever it is */
    double error_timeout = 0.5; /* [s] */
};

enum class GuardState { CLOSED, RISING, OPEN, ENDING, FAULT };
const char *guard_state_name(GuardState state);

class Guard {
public:
    explicit Guard(const GuardSettings &settings) : settings_(settings), state_(settings.enabled ? GuardState::ENDING : GuardState::CLOSED) {}

    /* What comes in, with the time at which it did: of one monotonic clock [s]. */
    void pose(double now, bool valid);
    void wrench(double now, const double force[3]); /* of the tool on the tissue [N] */
    void following(bool is) { following_ = is; }
    void simulation(bool runs) { runs_ = runs; }
    void error(double now, double metres); /* 0: not known */
    /* What cannot pass, such as a wrong parameter: it never opens again, and why() says this. */
    void fault(const std::string &why);

    struct Output {
        bool send;       /* there is something to send */
        double force[3]; /* on the hand [N] */
    };
    /* To be called regularly. */
    Output update(double now);
    /* The last: zero, to be sent at once. */
    Output shut_down();

    GuardState state() const { return state_; }
    /* Why it is closed: the gates that are; empty when none is. */
    std::string why(double now) const;
    unsigned long clamped() const { return clamped_; } /* updates in which `largest` or `rate` held the force back */

private:
    void go(GuardState next, double now);
    void filter(double elapsed);

    GuardSettings settings_;
    GuardState state_;
    std::string fault_;
    bool shut_ = false, following_ = false, runs_ = false, pose_valid_ = false, finite_ = false;
    double pose_at_ = -1e300, wrench_at_ = -1e300, error_at_ = -1e300, error_ = 0;
    double wanted_[3] = {0, 0, 0}, smooth_[3] = {0, 0, 0}, sent_[3] = {0, 0, 0};
    double since_ = 0, last_ = 0;
    bool began_ = false;
    unsigned long clamped_ = 0;
};

} // namespace pliant_ros

#endif
