/* The simulation thread, and its work between steps. simulation_step.cpp has the step itself. */
#include "ros/sim/simulation.h"
#include "contact/shapes/tool_shape.h"
#include "sim/api/data.h"

#include <algorithm>

namespace pliant_ros {

namespace {

enum { STEP_QUEUE = 1024 /* a recorder that is held up misses none */ };

} // namespace

Simulation::Simulation(ros::NodeHandle handle, const Parameters &parameters, State *state, SettingsServer *live,
                       Tools *tools, FastForces *fast_forces, Snapshots *snapshots)
    : frame_(parameters.tissue_frame), background_(parameters.background), state_(state), live_(live), tools_(tools),
      fast_forces_(fast_forces), snapshots_(snapshots), samples_(tools->size()), last_present_samples_(samples_),
      ramps_(tools->size()), was_open_(tools->size(), false), jaws_(tools->size())
{
    timing_ = handle.advertise<StepTiming>("timing", 1);
    steps_ = handle.advertise<Step>("step", STEP_QUEUE);
    cuts_ = handle.advertise<Cut>("cut", STEP_QUEUE, true);
    thread_ = std::thread(&Simulation::run, this);
}

Simulation::~Simulation()
{
    {
        std::lock_guard<std::mutex> hold(lock_);
        stopping_ = true;
    }
    has_work_.notify_all();
    thread_.join();
}

void Simulation::run_between_steps(std::function<void()> work)
{
    std::future<void> done;
    {
        std::lock_guard<std::mutex> hold(lock_);
        if (stopping_) throw Failure(PLIANT_ERROR_CANCELLED, "the node is shutting down");
        work_.emplace_back(std::move(work));
        done = work_.back().get_future();
    }
    has_work_.notify_all();
    try {
        done.get();
    } catch (const std::future_error &) {
        throw Failure(PLIANT_ERROR_CANCELLED, "the node is shutting down");
    }
}

void Simulation::run_queued_functions()
{
    std::deque<std::packaged_task<void()>> work;
    {
        std::lock_guard<std::mutex> hold(lock_);
        work.swap(work_);
    }
    for (auto &task : work) task();
}

void Simulation::swap(std::shared_ptr<LoadedModel> next, const ResumableState *from)
{
    Data data = create_data(*next->model);
    add_tools(*next->model, data.get(), tool_inputs());
    if (from) restore_state(*from, *next->model, data.get());
    warn_of_tools_that_cannot_grasp(*pliant_model_get_scene(next->model));
    run_between_steps([&] {
        if (from) paused_ = from->paused;
        state_->set(paused_ ? SimState::PAUSED : SimState::READY, "");
        next->revision = current_ ? revision_of(*current_, pliant_data_get_last_revision(data_.get())) + 1
                         : from   ? from->snapshot.revision + 1
                                  : 1;
        current_.swap(next);
        data_.swap(data);
        /* the gap in the numbers shows that these steps cannot be recomputed from a load or a reset */
        sequence_ = from ? from->sequence + 1 : 0;
        made_.clear();
        made_count_ = from ? from->strokes : made_count_;
        missing_tools_ = from ? from->holding : decltype(missing_tools_)();
        if (from) missing_tools_.insert(missing_tools_.end(), from->touching.begin(), from->touching.end());
        missing_tools_until_ = Clock::now() + std::chrono::seconds(missing_tool_seconds);
        is_before_first_step_ = true;
        std::fill(was_open_.begin(), was_open_.end(), false); /* a closed jaw must open before it grasps again */
        std::lock_guard<std::mutex> hold(lock_);
        shown_ = current_;
        durations_.clear();
        health_ = StepHealth();
        health_.is_loaded = true;
        health_.is_paused = paused_;
        health_.backend = pliant_data_get_backend(data_.get());
    });
    data.reset(); /* the data refer to the model, which `next` keeps */
}

void Simulation::warn_of_tools_that_cannot_grasp(const pliant_scene &scene) const
{
    for (size_t i = 0; i < tools_->size(); ++i) {
        const ToolParameters &tool = tools_->parameters(i);
        if (tool.grasps && !tool.shape_follows && pliant_tool_shape_holds(&scene, &tool.shape) &&
            !pliant_tool_shape_has_jaws(&tool.shape))
            ROS_WARN("tool %s cannot grasp: grasp/kind is contact, but its shape (~tool/%s/shape) has no jaws",
                     tool.name.c_str(), tool.name.c_str());
    }
}

std::shared_ptr<const LoadedModel> Simulation::loaded() const
{
    std::lock_guard<std::mutex> hold(lock_);
    return shown_;
}

Snapshot Simulation::snapshot()
{
    Snapshot out;
    run_between_steps([&] {
        if (!current_) throw Failure(PLIANT_ERROR_ARGUMENT, "nothing is loaded");
        take_snapshot(current_, *data_, last_time_, live_->get().scalar, &out);
    });
    return out;
}

ResumableState Simulation::resumable_state()
{
    ResumableState out;
    run_between_steps([&] {
        if (!current_) throw Failure(PLIANT_ERROR_ARGUMENT, "nothing is loaded");
        take_snapshot(current_, *data_, last_time_, live_->get().scalar, &out.snapshot);
        out.sequence = sequence_;
        out.strokes = made_count_;
        out.paused = paused_;
        take_state(*current_->model, data_.get(), &out);
    });
    return out;
}

void Simulation::reset()
{
    run_between_steps([&] {
        if (!current_) throw Failure(PLIANT_ERROR_ARGUMENT, "nothing is loaded");
        const uint32_t before = revision();
        check(pliant_data_reset(current_->model, data_.get()));
        sequence_ = 0;
        made_.clear();
        missing_tools_.clear();
        if (revision() != before) publish_cut(CutInput(), pliant_cut_report{});
        made_.clear();
        std::fill(was_open_.begin(), was_open_.end(), false);
    });
}

void Simulation::publish_cut(const CutInput &input, const pliant_cut_report &report)
{
    Cut message;
    message.header.stamp = ros::Time::now();
    message.header.frame_id = frame_;
    message.stroke = made_count_;
    message.severed_area = report.area;
    message.pieces = report.pieces;
    message.revision = revision();
    if (!input.points.empty()) message.point = input.points.front();
    cuts_.publish(message);
}

pliant_cut_report Simulation::cut(const CutInput &input, uint32_t *after)
{
    pliant_cut_report report{};
    run_between_steps([&] {
        if (!current_) throw Failure(PLIANT_ERROR_ARGUMENT, "nothing is loaded");
        make_cut(*current_->model, data_.get(), input, &report);
        made_.push_back(input);
        ++made_count_;
        *after = revision();
        publish_cut(input, report);
    });
    return report;
}

void Simulation::pause(bool paused)
{
    run_between_steps([&] {
        if (!current_) throw Failure(PLIANT_ERROR_ARGUMENT, "nothing is loaded");
        paused_ = paused;
        state_->set(paused ? SimState::PAUSED : SimState::RUNNING, "");
        std::lock_guard<std::mutex> hold(lock_);
        health_.is_paused = paused;
    });
}

void Simulation::run()
{
    Clock::time_point next = Clock::now();
    for (;;) {
        {
            /* without a model, wait until one is set */
            std::unique_lock<std::mutex> hold(lock_);
            if (!current_) has_work_.wait(hold, [this] { return stopping_ || !work_.empty(); });
            else has_work_.wait_until(hold, next, [this] { return stopping_ || !work_.empty(); });
            if (stopping_) {
                work_.clear();
                return;
            }
        }
        begin_work();
        run_queued_functions();
        end_work();
        if (!current_ || Clock::now() < next) continue;
        begin_work();
        Clock::time_point start = Clock::now();
        std::chrono::duration<double> step_time(pliant_model_get_scene(current_->model)->solver.step);
        auto period = std::chrono::duration_cast<Clock::duration>(step_time);
        try {
            run_step(start);
            has_last_step_failed_ = false;
        } catch (const std::exception &failed) {
            has_last_step_failed_ = true;
            report_failure(failed);
        }
        end_work();
        next = std::max(next + period, Clock::now()); /* a missed deadline is not made up for */
    }
}

/* Report a failed step, for example when memory is exhausted. Forces decay, and the next step tries again. */
void Simulation::report_failure(const std::exception &failed)
{
    for (size_t i = 0; i < samples_.size(); ++i) {
        try {
            if (fast_forces_->is_on()) fast_forces_->stop(i);
            else publish_force(i, pliant_tool_state{}, false, ros::Time::now());
        } catch (const std::exception &) {
            /* the force is not published; the next force rises gradually nevertheless */
        }
    }
    try {
        state_->set(SimState::FAULT, failed.what());
        ROS_ERROR_THROTTLE(5, "a step failed: %s", failed.what());
    } catch (const std::exception &) {
        /* no memory to publish the message, so the last published state stays */
    }
}

void Simulation::begin_work()
{
    std::lock_guard<std::mutex> hold(lock_);
    busy_since_ = Clock::now();
}

void Simulation::end_work()
{
    std::lock_guard<std::mutex> hold(lock_);
    const double seconds = std::chrono::duration<double>(Clock::now() - busy_since_).count();
    busy_since_ = Clock::time_point();
    if (!(seconds > slow_step_seconds)) return;
    ++health_.slow;
    health_.last_slow = seconds;
}

StepHealth Simulation::health() const { return measured(); }

} // namespace pliant_ros
