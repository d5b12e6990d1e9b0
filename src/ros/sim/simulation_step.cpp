/* One step of the node: take the newest poses of the tools, make the step (sim/step/step.c), and hand over a snapshot
 * of the positions to the threads that draw and publish. */
#include "ros/sim/simulation.h"

#include "contact/shapes/tool_shape.h"
#include "sim/api/data.h"

#include <algorithm>
#include <cmath>
#include <cstring>

namespace pliant_ros {

namespace {

enum { TIMING_RATE = 10 /* [Hz] */ };

/* sorted: ascending values */
double percentile(const std::vector<double> &sorted, double fraction)
{
    if (sorted.empty()) return 0;
    size_t index = static_cast<size_t>(std::ceil(fraction * sorted.size()));
    return sorted[std::min(std::max<size_t>(index, 1), sorted.size()) - 1];
}

void apply_settings(const Step &step, pliant_data *data)
{
    pliant_data_set_limits(data, step.iterations, step.tolerance);
    double gravity[3];
    pliant_data_get_gravity(data, gravity);
    if (!std::equal(gravity, gravity + 3, step.gravity.begin())) pliant_data_set_gravity(data, step.gravity.data());
    for (int tool = 0; tool < pliant_data_get_num_tools(data); ++tool)
        pliant_tool_set_spring(data, tool, step.stiffness, step.damping);
}

void apply_tool(const pliant_model &model, const ToolInput &input, pliant_data *data, int tool)
{
    if (!input.present || pliant_tool_set_pose(data, tool, input.tip.data(), input.rotation.data()) < 0) {
        if (tool_state(*data, tool).present) pliant_tool_remove_pose(data, tool);
        return;
    }
    pliant_tool_set_jaw(data, tool, input.jaw);
    if (input.closes) pliant_tool_grasp(&model, data, tool, nullptr);
    if (!input.closed && tool_state(*data, tool).holding) pliant_tool_release(data, tool);
    if (input.cuts != tool_state(*data, tool).cutting) pliant_tool_set_cutting(data, tool, input.cuts);
}

/* Compute FNV-1a over 64-bit words. */
uint64_t checksum(const double *values, size_t count)
{
    uint64_t sum = 0xcbf29ce484222325u, bits;
    for (size_t i = 0; i < count; ++i) {
        std::memcpy(&bits, values + i, sizeof bits);
        sum = (sum ^ bits) * 0x100000001b3u;
    }
    return sum;
}

} // namespace

pliant_status make_step(const pliant_model &model, pliant_data *data, pliant_background_kind kind, const Step &step)
{
    if (static_cast<int>(step.tools.size()) != pliant_data_get_num_tools(data))
        throw Failure(PLIANT_ERROR_ARGUMENT, "the step has " + std::to_string(step.tools.size()) +
                                                 " tools, but the simulation has " +
                                                 std::to_string(pliant_data_get_num_tools(data)));
    apply_settings(step, data);
    for (size_t i = 0; i < step.tools.size(); ++i) {
        if (step.tools[i].exchanged) apply_shape(step.tools[i], data, static_cast<int>(i));
        apply_tool(model, step.tools[i], data, static_cast<int>(i));
    }
    if (step.paused) return PLIANT_OK;
    const bool replays = kind == PLIANT_BACKGROUND_PRESCRIBED;
    check(pliant_data_set_background(data, kind, replays ? step.background : 0));
    check(pliant_data_prescribe_clock(data, step.clock.data(), replays ? static_cast<int32_t>(step.clock.size()) : 0));
    return pliant_step(&model, data);
}

void set_step_outcome(pliant_status status, const pliant_data &data, Step *out)
{
    const pliant_statistics &statistics = *pliant_data_get_statistics(&data);
    out->status = status;
    out->step = statistics.step;
    out->background = out->paused ? 0 : pliant_data_get_background_taken(&data);
    out->checksum = checksum(pliant_data_get_positions(&data, nullptr),
                             3 * static_cast<size_t>(pliant_data_get_body(&data)->fine.num_nodes));
    out->evaluations = static_cast<uint32_t>(statistics.iterations);
    out->legs = static_cast<uint32_t>(statistics.legs);
    int32_t readings = 0;
    const double *clock = pliant_data_get_clock(&data, &readings);
    out->clock.assign(clock, clock + (out->paused ? 0 : readings));
    out->seconds.assign(statistics.seconds, statistics.seconds + PLIANT_NUM_STEP_STAGES);
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
        ROS_WARN("tool %s is not back after %d s: its grasp is released", name.c_str(), missing_tool_seconds);
    missing_tools_.clear();
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

} // namespace pliant_ros
