/* Simulation thread: reads tools, computes steps, and publishes forces at the rate of the scene. */
#ifndef PLIANT_ROS_SIM_SIMULATION_H
#define PLIANT_ROS_SIM_SIMULATION_H

#include "ros/sim/fast_forces.h"
#include "ros/sim/settings_server.h"
#include "ros/sim/loaded_model.h"
#include "ros/sim/resumable_state.h"
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

/* Statistics of the last second, for diagnostics. */
struct StepHealth {
    bool is_loaded, is_paused;
    /* rate [steps/s]; median and 99th percentile of the step time [s]; target period [s] */
    double rate, p50, p99, period;
    uint64_t missed;               /* number of steps since the start that took longer than their period */
    /* number of steps and tasks between steps since the start that took longer than slow_step_seconds */
    uint64_t slow;
    /* duration of the last such step; time since the start of the running step, 0: none [s] */
    double last_slow, busy_for;
    uint64_t failed, not_converged;
    int32_t iterations, inverted, legs;
    double residual, proxy_error;  /* proxy_error: maximum over the tools after the last step [m] */
    /* number of steps since the start that ended before all proxies reached their tools */
    uint64_t ended_early;
    pliant_step_end last_end;      /* reason of the last such step; PLIANT_STEP_END_NONE: none */
    size_t bytes;
    uint32_t revision;   /* revision after the last step; 0: no step was computed */
    const char *backend; /* cpu or cuda; NULL: nothing is loaded */
};

/* A step longer than this is unacceptable for a robot [s]. */
const double slow_step_seconds = 0.5;

/* Time in which a restored state waits for tools that are missing [s]. */
const int missing_tool_seconds = 2;

class Simulation {
public:
    Simulation(ros::NodeHandle handle, const Parameters &parameters, State *state, SettingsServer *live, Tools *tools,
               FastForces *fast_forces, Snapshots *snapshots);
    ~Simulation();

    /* Replace the model between two steps. The new model starts at rest with the same tools and gets a revision. The
     * old model stays until then; the calling thread frees it.
     * from: Nullable; state of the new model to start from
     * Throws Failure; then nothing has changed. */
    void swap(std::shared_ptr<LoadedModel> next, const ResumableState *from = nullptr);
    /* Empty before the first swap. */
    std::shared_ptr<const LoadedModel> loaded() const;
    /* Return the current positions. Throws Failure if nothing is loaded. */
    Snapshot snapshot();
    /* Return the positions and everything that another process needs to continue. Throws Failure. */
    ResumableState resumable_state();
    /* Restore the initial body and the state at rest. */
    void reset();
    /* Cut immediately, or undo a cut.
     * after: revision after the cut
     * Throws Failure; then nothing has changed. */
    pliant_cut_report cut(const CutInput &input, uint32_t *after);
    void pause(bool paused);
    StepHealth health() const;

private:
    void run();
    void run_step(Clock::time_point start);
    void report_failure(const std::exception &failed);
    /* Run a function in the simulation thread between two steps, and wait for its end. */
    void run_between_steps(std::function<void()> work);
    void run_queued_functions();
    bool has_time_jumped_back(const ros::Time &now);
    void take_settings(Step *out) const;
    void warn_of_tools_that_cannot_grasp(const pliant_scene &scene) const;
    void take_tools(const ros::Time &now, bool forgotten, Step *out);
    void log_missed_grasp(size_t tool, bool holds_by_contact);
    bool waits_for_tools(const Step &step);
    void show(const ros::Time &now);
    void publish(const ros::Time &now);
    void publish_force(size_t tool, const pliant_tool_state &state, bool acts, const ros::Time &now);
    void publish_timing(const ros::Time &now);
    void publish_cut(const CutInput &input, const pliant_cut_report &report);
    std::vector<ToolInput> tool_inputs() const;
    bool is_cutting_now(size_t tool, const ToolSample &sample) const;
    uint32_t revision() const { return revision_of(*current_, pliant_data_get_body(data_.get())->revision); }
    void publish_step(pliant_status status, Step *step);
    void measure(double seconds);
    void begin_work();
    void end_work();
    StepHealth measured() const;

    const std::string frame_;
    const pliant_background_kind background_;
    State *state_;
    SettingsServer *live_;
    Tools *tools_;
    FastForces *fast_forces_;
    Snapshots *snapshots_;
    ros::Publisher timing_, steps_, cuts_;
    Rate timing_rate_, inverted_rate_;

    /* used only by the simulation thread; other threads use run_between_steps */
    std::shared_ptr<LoadedModel> current_;
    Data data_;
    bool paused_ = false, has_last_step_failed_ = false; /* has_last_step_failed_: the previous step failed */
    uint64_t sequence_ = 0; /* number of steps since load or reset */
    std::vector<CutInput> made_; /* cuts since the last step */
    uint64_t made_count_ = 0;
    std::vector<std::string>
        missing_tools_; /* missing tools that acted on the tissue when the previous process ended */
    Clock::time_point missing_tools_until_;
    std::vector<ToolSample> samples_,
        last_present_samples_;                /* last_present_samples_: each tool when it was last present */
    std::vector<Ramp> ramps_;                 /* one force ramp per tool */
    std::vector<bool> was_open_; /* whether the jaw was open in the previous step */
    /* Observed jaw of a tool, whether or not the tool is present. */
    struct JawWatch {
        Jaw last = JAW_UNKNOWN;    /* last known jaw */
        bool missed = false;       /* the jaw has closed without a grasp, for the reason `why` */
        std::string why;           /* empty, or: the tool was absent or its jaw was unknown */
        Rate rate;
    };
    std::vector<JawWatch> jaws_;
    bool is_before_first_step_ =
        false; /* no step since the simulation was created, so its instruments are not set yet */
    ros::Time last_time_;

    mutable std::mutex lock_; /* guards the members below */
    std::condition_variable has_work_;
    std::deque<std::packaged_task<void()>> work_;
    std::shared_ptr<const LoadedModel> shown_;
    std::deque<std::pair<Clock::time_point, double>> durations_;
    StepHealth health_{};
    Clock::time_point busy_since_{}; /* start of the running step; the epoch: none */
    bool stopping_ = false;
    std::thread thread_;
};

} // namespace pliant_ros

#endif
