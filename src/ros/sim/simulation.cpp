#include "ros/sim/simulation.h"
#include "contact/shapes/tool_shape.h"
#include "sim/api/data.h"

#include <algorithm>
#include <cmath>
#include <limits>

namespace pliant_ros {

namespace {

enum {
    TIMING_RATE = 10 /* [Hz] */,
    HOLD_SECONDS = 2 /* that tools have to come back */,
    STEP_QUEUE = 1024 /* a recorder that is held up misses none */
};

/* sorted: ascending values */
double percentile(const std::vector<double> &sorted, double fraction)
{
    if (sorted.empty()) return 0;
    size_t index = static_cast<size_t>(std::ceil(fraction * sorted.size()));
    return sorted[std::min(std::max<size_t>(index, 1), sorted.size()) - 1];
}

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
        missing_tools_until_ = Clock::now() + std::chrono::seconds(HOLD_SECONDS);
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

/* Compute one step. */
void Simulation::run_step(Clock::time_point start)
{
    ros::Time now = ros::Time::now();
    Step step;
    step.header.stamp = now;
    step.header.frame_id = frame_;
    step.sequence = ++sequence_;
    step.paused = paused_;
    step.cuts.swap(made_);
    take_settings(&step);
    take_tools(now, has_time_jumped_back(now), &step);
    const bool waits = waits_for_tools(step);
    step.paused = waits || paused_;
    const pliant_status status = waits ? PLIANT_OK : make_step(*current_->model, data_.get(), background_, step);
    if (status < 0) state_->set(SimState::FAULT, pliant_last_error());
    /* after a failed step, the state is RUNNING only after a complete step */
    else if (!has_last_step_failed_ && !step.paused) state_->set(SimState::RUNNING, "");
    show(now);
    publish(now);
    publish_step(status, &step);
    measure(std::chrono::duration<double>(Clock::now() - start).count());
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

/* Return whether time has jumped back (a restarted bag, a simulator reset), which makes all earlier stamps invalid. All
 * tools are absent in this step. */
bool Simulation::has_time_jumped_back(const ros::Time &now)
{
    const bool jumped = now < last_time_;
    if (jumped) {
        ROS_WARN("time jumped back by %.3f s: the poses of all tools are discarded", seconds_between(now, last_time_));
        tools_->clear();
    }
    last_time_ = now;
    return jumped;
}

void Simulation::take_settings(Step *out) const
{
    const RuntimeSettings settings = live_->get();
    std::copy(settings.gravity, settings.gravity + 3, out->gravity.begin());
    out->iterations = settings.iterations;
    out->tolerance = settings.tolerance;
    out->stiffness = settings.stiffness;
    out->damping = settings.damping;
}

void Simulation::take_tools(const ros::Time &now, bool forgotten, Step *out)
{
    out->tools = tool_inputs();
    for (size_t i = 0; i < samples_.size(); ++i) {
        ToolSample &sample = samples_[i];
        sample = tools_->sample(i, now);
        sample.present = sample.present && !forgotten;
        const bool loses = !sample.present || (sample.jaw == JAW_UNKNOWN && tools_->parameters(i).grasps);
        const bool is_awaited =
            std::find(missing_tools_.begin(), missing_tools_.end(), tools_->name(i)) != missing_tools_.end();
        if (loses && !is_awaited && tool_state(*data_, static_cast<int>(i)).holding)
            ROS_WARN("tool %s releases its grasp: %s", tools_->name(i).c_str(),
                     forgotten ? "time jumped back" : sample.why.c_str());
        ToolInput &input = out->tools[i];
        input.present = sample.present;
        input.jaw = sample.angle;
        std::copy(sample.in_tissue.translation, sample.in_tissue.translation + 3, input.tip.begin());
        std::copy(sample.in_tissue.rotation, sample.in_tissue.rotation + 4, input.rotation.begin());
        pliant_tool_shape shape = tools_->parameters(i).shape;
        const bool news = tools_->take_exchanged_shape(i, &shape);
        if (tools_->parameters(i).shape_follows) set_shape(shape, &input);
        input.exchanged = tools_->parameters(i).shape_follows && (news || is_before_first_step_);
        /* A jaw grasps when it closes. A tool that arrives closed pushes the tissue, and a tool that holds by contact
         * needs no grasp constraint. */
        input.closed = sample.present && sample.jaw == JAW_CLOSED && tools_->parameters(i).grasps;
        const bool holds_by_contact = pliant_tool_shape_holds(pliant_model_get_scene(current_->model), &shape);
        input.closes = input.closed && was_open_[i] && !holds_by_contact;
        log_missed_grasp(i, holds_by_contact);
        input.cuts = sample.present && is_cutting_now(i, sample);
        was_open_[i] = sample.present && sample.jaw == JAW_OPEN;
    }
    is_before_first_step_ = false;
}

/* Log once a second that jaws have closed without a grasp, until they open. */
void Simulation::log_missed_grasp(size_t tool, bool holds_by_contact)
{
    if (!tools_->parameters(tool).grasps) return;
    JawWatch &jaw = jaws_[tool];
    const ToolSample &sample = samples_[tool];
    if (!sample.why.empty()) jaw.why = sample.why;
    if (sample.jaw == JAW_CLOSED && jaw.last == JAW_OPEN) jaw.missed = !sample.present || !was_open_[tool];
    if (sample.jaw == JAW_OPEN || (holds_by_contact && sample.present)) jaw.missed = false;
    if (sample.jaw != JAW_UNKNOWN) jaw.last = sample.jaw;
    if (jaw.missed && jaw.rate.due(1))
        ROS_WARN("tool %s has closed its jaws and takes nothing: %s (~tool_max_age); open them and close them again",
                 tools_->name(tool).c_str(), jaw.why.c_str());
}

/* Return true while a restored state waits for the tools that held or touched tissue in the previous process. Until
 * they are present with a known jaw angle, the simulation does not step. */
bool Simulation::waits_for_tools(const Step &step)
{
    const bool is_late = Clock::now() >= missing_tools_until_;
    for (size_t i = 0; i < step.tools.size() && !missing_tools_.empty(); ++i) {
        const ToolInput &tool = step.tools[i];
        const auto lost = std::find(missing_tools_.begin(), missing_tools_.end(), tool.name);
        if (lost == missing_tools_.end() || !tool.present) continue;
        const bool is_holding = tool_state(*data_, static_cast<int>(i)).holding,
                   is_unknown = samples_[i].jaw == JAW_UNKNOWN;
        if (is_holding && is_unknown && !is_late) continue;
        if (is_holding)
            ROS_WARN("tool %s %s", tool.name.c_str(),
                     tool.closed ? "is back and holds its grasp" : "is back with open jaws: its grasp is released");
        missing_tools_.erase(lost);
    }
    if (missing_tools_.empty() || !is_late) return !missing_tools_.empty();
    for (const std::string &name : missing_tools_)
        ROS_WARN("tool %s is not back after %d s: its grasp is released", name.c_str(), HOLD_SECONDS);
    missing_tools_.clear();
    return false;
}

/* Return the tools at rest, with their names, blades and shapes. */
std::vector<ToolInput> Simulation::tool_inputs() const
{
    std::vector<ToolInput> out(tools_->size());
    for (size_t i = 0; i < out.size(); ++i) {
        const ToolParameters &parameters = tools_->parameters(i);
        out[i].name = parameters.name;
        std::copy(parameters.blade_from, parameters.blade_from + 3, out[i].blade_from.begin());
        std::copy(parameters.blade_to, parameters.blade_to + 3, out[i].blade_to.begin());
        set_shape(parameters.shape, &out[i]);
    }
    return out;
}

bool Simulation::is_cutting_now(size_t tool, const ToolSample &sample) const
{
    const pliant_scene &scene = *pliant_model_get_scene(current_->model);
    if (scene.cut.kind == PLIANT_CUT_NONE || !tools_->parameters(tool).has_blade()) return false;
    switch (scene.cut.trigger) {
    case PLIANT_TRIGGER_ALWAYS: return true;
    case PLIANT_TRIGGER_JAW: return sample.jaw == JAW_CLOSED;
    case PLIANT_TRIGGER_ENERGY: return sample.energy || sample.blade;
    case PLIANT_TRIGGER_SERVICE: return sample.blade;
    }
    return false;
}

void Simulation::show(const ros::Time &now)
{
    if (!snapshots_->wanted()) return;
    auto snapshot = std::make_shared<Snapshot>();
    take_snapshot(current_, *data_, now, live_->get().scalar, snapshot.get());
    snapshots_->put(snapshot);
}

void Simulation::publish(const ros::Time &now)
{
    bool acts = !paused_ && state_->state() == SimState::RUNNING;
    for (size_t i = 0; i < samples_.size(); ++i) {
        const pliant_tool_state tool = tool_state(*data_, static_cast<int>(i));
        if (fast_forces_->is_on()) fast_forces_->frame(i, *data_, samples_[i], acts);
        else publish_force(i, tool, acts && samples_[i].present, now);
        tools_->publish_cut(i, *data_, revision(), now);
        tools_->store_proxy_state(i, tool);
        tools_->publish_contact(i, *current_->model, *data_, now);
    }
    publish_timing(now);
}

void Simulation::publish_force(size_t tool, const pliant_tool_state &state, bool acts, const ros::Time &now)
{
    double wrench[6];
    tool_wrench(state, wrench, wrench + 3);
    ramps_[tool].apply(std::chrono::duration<double>(Clock::now().time_since_epoch()).count(), acts, wrench);
    if (acts) last_present_samples_[tool] = samples_[tool];
    /* for an absent tool, the decaying force stays at the tool's last position */
    const bool falls = !acts && std::any_of(wrench, wrench + 6, [](double x) { return x != 0; });
    tools_->publish_force(tool, falls ? last_present_samples_[tool] : samples_[tool], wrench, wrench + 3, now);
}

void Simulation::publish_timing(const ros::Time &now)
{
    if (timing_.getNumSubscribers() == 0 || !timing_rate_.due(TIMING_RATE)) return;
    StepHealth health = measured();
    StepTiming message;
    message.header.stamp = now;
    message.header.frame_id = frame_;
    timing_message(*pliant_data_get_statistics(data_.get()), &message);
    message.solve_p50 = static_cast<float>(health.p50);
    message.solve_p99 = static_cast<float>(health.p99);
    message.missed_deadlines = health.missed;
    choice_message(current_->choice, &message);
    message.inverted = static_cast<uint32_t>(pliant_data_get_inverted(data_.get()));
    publish_with_priority(timing_, message);
}

void Simulation::publish_step(pliant_status status, Step *step)
{
    if (steps_.getNumSubscribers() == 0) return;
    step->load = current_->revision;
    step->revision = revision();
    set_step_outcome(status, *data_, step);
    publish_with_priority(steps_, *step);
}

void Simulation::measure(double seconds)
{
    Clock::time_point now = Clock::now();
    bool count_inverted = inverted_rate_.due(1);
    int32_t inverted = count_inverted ? pliant_data_get_inverted(data_.get()) : 0;
    std::lock_guard<std::mutex> hold(lock_);
    const pliant_statistics &statistics = *pliant_data_get_statistics(data_.get());
    health_.period = pliant_model_get_scene(current_->model)->solver.step;
    health_.missed += seconds > health_.period;
    health_.failed = statistics.failed;
    health_.not_converged = statistics.not_converged;
    health_.iterations = statistics.iterations;
    if (count_inverted) health_.inverted = inverted;
    health_.residual = statistics.residual;
    health_.legs = statistics.legs;
    health_.proxy_error = statistics.proxy_error;
    if (!paused_ && statistics.ended != PLIANT_STEP_END_NONE) {
        health_.last_end = static_cast<pliant_step_end>(statistics.ended);
        ++health_.ended_early;
    }
    health_.bytes = statistics.bytes;
    health_.backend = pliant_data_get_backend(data_.get());
    health_.revision = revision();
    durations_.emplace_back(now, seconds);
    while (now - durations_.front().first > std::chrono::seconds(1)) durations_.pop_front();
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

StepHealth Simulation::measured() const
{
    std::lock_guard<std::mutex> hold(lock_);
    StepHealth out = health_;
    std::vector<double> sorted;
    for (const auto &each : durations_) sorted.push_back(each.second);
    std::sort(sorted.begin(), sorted.end());
    out.p50 = percentile(sorted, 0.50);
    out.p99 = percentile(sorted, 0.99);
    out.rate = static_cast<double>(sorted.size());
    out.busy_for =
        busy_since_ == Clock::time_point() ? 0 : std::chrono::duration<double>(Clock::now() - busy_since_).count();
    return out;
}

StepHealth Simulation::health() const { return measured(); }

} // namespace pliant_ros
