/* The thread that steps: tools in, forces out, at the rate of the scene. */
#ifndef PLIANT_ROS_SIM_SIMULATION_H
#define PLIANT_ROS_SIM_SIMULATION_H

#include "ros/sim/fast_forces.h"
#include "ros/sim/live.h"
#include "ros/sim/loaded.h"
#include "ros/sim/moment.h"
#include "ros/sim/ramp.h"
#include "ros/sim/snapshot.h"
#include "ros/sim/state.h"
#include "ros/sim/stepping.h"
#include "ros/sim/tools.h"

#include <deque>
#include <functional>
#include <future>
#include <thread>

namespace pliant_ros {

/* For diagnostics, over the last second. */
struct StepHealth {
    bool is_loaded, is_paused;
    double rate, p50, p99, period; /* steps a second; of whole steps [s]; wanted between two [s] */
    uint64_t missed;               /* steps that took longer than their period, since the start */
    uint64_t slow;                 /* steps, and what runs between two of them, that took longer than slow_after, since the start */
    double last_slow, busy_for;    /* the last one of those; the present one, which has not ended; 0: none [s] */
    uint64_t failed, not_converged;
    int32_t iterations, inverted, legs;
    double residual, proxy_error;  /* proxy_error: the largest, after the last step [m] */
    uint64_t ended_early;          /* steps that ended before proxies were at their tools, since the start */
    pliant_step_end last_end;      /* reason of the last such step; PLIANT_STEP_END_NONE: there is none */
    size_t bytes;
    uint32_t revision;   /* after the last step; 0: none was made */
    const char *backend; /* who runs the steps: cpu or cuda; NULL: nothing is loaded */
};

/* A step that takes longer than this is an error for a robot [s]. */
const double slow_after = 0.5;

class Simulation {
public:
    Simulation(ros::NodeHandle handle, const Parameters &parameters, State *state, Live *live, Tools *tools,
               FastForces *fast_forces, Snapshots *snapshots);
    ~Simulation();

    /* Put another model in at the next step boundary, at rest and with the same tools; it gets its revision. The old one
       stays until then, and is freed by the calling thread. from: Nullable; of that model, to go on from instead. Throws Failure, and
       then nothing changed. */
    void swap(std::shared_ptr<Loaded> next, const Moment *from = nullptr);
    /* Empty before the first swap. */
    std::shared_ptr<const Loaded> loaded() const;
    /* Positions now. Throws Failure when nothing is loaded. */
    Snapshot snapshot();
    /* And what else another process needs to go on. */
    Moment moment();
    /* Body 0 again. */
    void reset();
    /* Cut at once, or undo; after: the revision from then on. Throws Failure, and then nothing changed. */
    pliant_cut_report cut(const CutInput &input, uint32_t *after);
    void pause(bool paused);
    StepHealth health() const;

private:
    void run();
    void turn(Clock::time_point start);
    void report_failure(const std::exception &failed);
    /* Run by the simulation between two steps; returns when done. */
    void at_boundary(std::function<void()> work);
    void do_boundary_work();
    bool jumped_back(const ros::Time &now);
    void take_settings(Step *out) const;
    void tell_who_holds_nothing(const pliant_scene &scene) const;
    void take_tools(const ros::Time &now, bool forgotten, Step *out);
    void tell_of_missed_closing(size_t tool, bool holds_by_contact);
    bool waits_for_tools(const Step &step);
    void show(const ros::Time &now);
    void publish(const ros::Time &now);
    void publish_force(size_t tool, const pliant_tool_state &state, bool acts, const ros::Time &now);
    void publish_timing(const ros::Time &now);
    void publish_cut(const CutInput &input, const pliant_cut_report &report);
    std::vector<ToolInput> tool_inputs() const;
    bool cuts_now(size_t tool, const ToolSample &sample) const;
    uint32_t revision() const { return revision_of(*current_, pliant_data_get_body(data_.get())->revision); }
    void publish_step(pliant_status status, Step *step);
    void measure(double seconds);
    void begin_work();
    void end_work();
    StepHealth measured() const;

    const std::string frame_;
    const pliant_background_kind background_;
    State *state_;
    Live *live_;
    Tools *tools_;
    FastForces *fast_forces_;
    Snapshots *snapshots_;
    ros::Publisher timing_, steps_, cuts_;
    Rate timing_rate_, inverted_rate_;

    /* the simulation's own; others reach them by at_boundary */
    std::shared_ptr<Loaded> current_;
    Data data_;
    bool paused_ = false, broke_ = false; /* broke: the turn before this one */
    uint64_t sequence_ = 0; /* turns since load or reset */
    std::vector<CutInput> made_; /* cuts since the last turn */
    uint64_t made_count_ = 0;
    std::vector<std::string> lost_; /* tools that acted on the tissue when the process before this one ended, until they are there */
    Clock::time_point lost_until_;
    std::vector<ToolSample> samples_, acted_; /* acted: as a tool was there last */
    std::vector<Ramp> ramps_;                 /* of the forces, one a tool */
    std::vector<bool> was_open_; /* the jaw, at the step before */
    /* Of a tool's jaw, whether or not the tool is present. */
    struct JawWatch {
        Jaw last = JAW_UNKNOWN;    /* that was known */
        bool missed = false;       /* it has closed and taken nothing, for `why` */
        std::string why;           /* the tool was last absent, or its jaw unknown */
        Rate rate;
    };
    std::vector<JawWatch> jaws_;
    bool anew_ = false;          /* no turn yet of this simulation: it does not know the instruments */
    ros::Time last_time_;

    mutable std::mutex lock_; /* of what follows */
    std::condition_variable work_there_;
    std::deque<std::packaged_task<void()>> work_;
    std::shared_ptr<const Loaded> shown_;
    std::deque<std::pair<Clock::time_point, double>> durations_;
    StepHealth health_{};
    Clock::time_point busy_since_{}; /* the epoch: it waits */
    bool stopping_ = false;
    std::thread thread_;
};

} // namespace pliant_ros

#endif
