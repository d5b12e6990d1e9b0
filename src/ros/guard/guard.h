/* Decide which forces of the simulation reach a surgeon's hand, and limit their magnitude and rate. This class uses
 * neither ROS nor a clock.
 *
 * If enabled, it starts in ENDING: an earlier guard may have been killed, and the hand may still apply its last force.
 *
 *    state   | output                        | transition                                | next state
 *    CLOSED  | none                          | all gates are open                        | RISING
 *            |                               | fault                                     | FAULT
 *    RISING  | the force, times 0 to 1       | `ramp` has elapsed                        | OPEN
 *            |                               | a gate closes, or fault                   | ENDING
 *    OPEN    | the force                     | a gate closes, or fault                   | ENDING
 *    ENDING  | zero                          | all gates are open                        | RISING
 *            |                               | `tail` has elapsed                        | CLOSED; after a fault FAULT
 *    FAULT   | none                          | never                                     |
 *    any     | zero, once                    | shut_down                                 | CLOSED, permanently
 *
 * When a gate closes, the output is zero in the same update, without ramp or filter. "The force" is the last received
 * force times -gain, after a first-order low-pass, with its rate limited to `rate` and its magnitude to `largest`. */
#ifndef PLIANT_ROS_GUARD_GUARD_H
#define PLIANT_ROS_GUARD_GUARD_H

#include <string>

namespace pliant_ros {

struct GuardSettings {
    bool enabled = false;       /* parameter ~haptic */
    bool needs_following = true; /* require the teleoperation to follow the hand; false: there is no teleoperation */
    double gain = 0.25;         /* ratio of the hand's force to the tissue's force */
    double largest = 2;         /* maximum force [N] */
    double rate = 20;           /* maximum change of the force [N/s] */
    double cutoff = 30;         /* cutoff frequency of the low-pass [Hz] */
    double ramp = 0.5;          /* time in which the force rises [s] */
    double tail = 0.2;          /* time for which zeros are sent after a gate closes [s] */
    double timeout = 0.04;      /* maximum age of forces and poses, larger than a typical delay of a step [s] */
    double largest_error = 0.002; /* maximum error of a step, as `timing` reports it [m]; infinite: no limit */
    double error_timeout = 0.5; /* maximum age of the error [s] */
};

enum class GuardState { CLOSED, RISING, OPEN, ENDING, FAULT };
const char *guard_state_name(GuardState state);

class Guard {
public:
    explicit Guard(const GuardSettings &settings)
        : settings_(settings), state_(settings.enabled ? GuardState::ENDING : GuardState::CLOSED)
    {
    }

    /* Inputs, with their arrival time on one monotonic clock [s]. */
    void pose(double now, bool valid);
    void wrench(double now, const double force[3]); /* force of the tool on the tissue [N] */
    void following(bool is) { following_ = is; }
    void simulation(bool runs) { runs_ = runs; }
    void error(double now, double metres); /* 0: unknown */
    /* Close permanently, for example because of a wrong parameter; why() returns this text. */
    void fault(const std::string &why);

    struct Output {
        bool send;       /* whether there is a force to send */
        double force[3]; /* force on the hand [N] */
    };
    /* Return the force to send; call periodically. */
    Output update(double now);
    /* Return the final output: zero, to be sent immediately. */
    Output shut_down();

    GuardState state() const { return state_; }
    /* Return which gates are closed, as text; empty if all are open. */
    std::string why(double now) const;
    /* number of updates in which `largest` or `rate` limited the force */
    unsigned long clamped() const { return clamped_; }

private:
    void enter_state(GuardState next, double now);
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
