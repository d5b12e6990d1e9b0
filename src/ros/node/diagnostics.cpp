#include "ros/node/diagnostics.h"
#include "base/memory.h"

#include <unistd.h>

#include <cmath>

namespace pliant_ros {

namespace {

using diagnostic_msgs::DiagnosticStatus;

const double far_proxy = 2e-3; /* distance between a proxy and a tool at rest above which a warning is published [m] */
const double slow_tool = 50; /* rate of poses below which forces feel rough [Hz]; robots send 100 or more */

std::string host_name()
{
    char name[256] = "";
    gethostname(name, sizeof name - 1);
    return name;
}

} // namespace

Diagnostics::Diagnostics(ros::NodeHandle handle, ros::NodeHandle private_handle, State *state, Simulation *simulation,
                         Tools *tools, const MeshOutput *mesh_output, const VolumeOutput *volume_output,
                         const CameraOutput *camera_output, const DisplacementOutput *displacement_output,
                         const CheckpointWriter *checkpoint_writer, const RosMasterMonitor *master)
    : state_(state), simulation_(simulation), tools_(tools), mesh_output_(mesh_output), volume_output_(volume_output),
      camera_output_(camera_output), displacement_output_(displacement_output), checkpoint_writer_(checkpoint_writer),
      master_(master), updater_(handle, private_handle, private_handle.getNamespace())
{
    updater_.setHardwareID(host_name());
    updater_.add("solver", this, &Diagnostics::solver);
    updater_.add("backend", this, &Diagnostics::backend);
    updater_.add("output", this, &Diagnostics::output);
    updater_.add("master", this, &Diagnostics::master);
    for (size_t i = 0; i < tools->size(); ++i)
        updater_.add("tool " + tools->name(i),
                     [this, i](diagnostic_updater::DiagnosticStatusWrapper &status) { tool(i, status); });
    timer_ = handle.createWallTimer(ros::WallDuration(1), [this](const ros::WallTimerEvent &) { update(); });
}

void Diagnostics::update()
{
    tool_health_ = tools_->health(ros::Time::now());
    updater_.force_update();
}

void Diagnostics::solver(diagnostic_updater::DiagnosticStatusWrapper &status)
{
    StepHealth health = simulation_->health();
    uint64_t missed = health.missed >= missed_before_ ? health.missed - missed_before_ : health.missed;
    missed_before_ = health.missed;
    /* the counter restarts when a scan is loaded */
    const uint64_t counted = health.ended_early >= ended_before_ ? ended_before_ : 0;
    const uint64_t ended_early = health.ended_early - counted;
    ended_before_ = health.ended_early;
    const bool was_slow = health.slow > 0 && health.slow != slow_before_;
    slow_before_ = health.slow;
    const double slowest = health.busy_for > slow_step_seconds ? health.busy_for : was_slow ? health.last_slow : 0;
    uint8_t state = state_->state();
    bool failed = state == SimState::FAULT;
    if (!health.is_loaded)
        status.summary(DiagnosticStatus::WARN, failed ? "loading failed" : "loading");
    else if (failed) status.summary(DiagnosticStatus::ERROR, "the last step failed; see the topic state");
    else if (slowest > 0)
        status.summaryf(DiagnosticStatus::ERROR, "a step takes %.1f s, more than %.1f s; forces do not change", slowest,
                        slow_step_seconds);
    else if (health.is_paused) status.summary(DiagnosticStatus::OK, "paused");
    else if (health.inverted > 0)
        status.summary(DiagnosticStatus::WARN, "tetrahedra are inverted");
    else if (missed > 0) status.summary(DiagnosticStatus::WARN, "deadlines missed in the last second");
    else status.summary(DiagnosticStatus::OK, "running");
    status.add("steps in the last second", health.rate);
    status.add("requested period [ms]", 1e3 * health.period);
    status.add("p50 [ms]", 1e3 * health.p50);
    status.add("p99 [ms]", 1e3 * health.p99);
    status.add("missed deadlines in the last second", missed);
    status.add("steps above 500 ms", health.slow);
    status.add("current step [ms]", 1e3 * health.busy_for);
    status.add("missed deadlines", health.missed);
    status.add("inverted elements", health.inverted);
    status.add("iterations", health.iterations);
    status.add("legs", health.legs);
    status.add("largest proxy error [mm]", 1e3 * health.proxy_error);
    status.add("steps in the last second that ended early", ended_early);
    const char *reason = ended_early > 0 ? pliant_step_end_text(health.last_end) : "none";
    status.add("reason of the last step that ended early", reason);
    status.add("residual", health.residual);
    status.add("steps not converged", health.not_converged);
    status.add("steps failed", health.failed);
}

void Diagnostics::tool(size_t index, diagnostic_updater::DiagnosticStatusWrapper &status)
{
    if (index >= tool_health_.size()) return;
    const ToolHealth &tool = tool_health_[index];
    if (!tool.present) status.summary(DiagnosticStatus::WARN, "no tool: " + tool.why);
    else if (tool.saturated)
        status.summaryf(DiagnosticStatus::WARN,
                        "it presses with its force limit (contact/max_force, jaws: contact/grip_torque); "
                        "its proxy is %.1f mm behind, its jaws %.2f rad",
                        1e3 * tool.proxy_error, std::fabs(tool.jaw_error));
    else if (tool.rests && tool.proxy_error > far_proxy)
        status.summaryf(DiagnosticStatus::WARN,
                        "its proxy is %.1f mm behind while the tool rests: tissue stops it; move the tool back",
                        1e3 * tool.proxy_error);
    else if (tool.rate < slow_tool) status.summary(DiagnosticStatus::OK, "slow: fewer than 50 poses a second");
    else status.summary(DiagnosticStatus::OK, "tracked");
    status.add("rate [Hz]", tool.rate);
    status.add("proxy error [mm]", 1e3 * tool.proxy_error);
    status.add("jaw error [rad]", tool.jaw_error);
    status.add("force limit reached", tool.saturated);
    status.add("age [ms]", std::isfinite(tool.age) ? std::to_string(1e3 * tool.age) : "no pose");
}

void Diagnostics::backend(diagnostic_updater::DiagnosticStatusWrapper &status)
{
    const char *name = simulation_->health().backend;
    status.summary(DiagnosticStatus::OK, name ? name : "nothing is loaded");
    status.add("memory in use [MB]", 1e-6 * pliant_memory_in_use());
    status.add("peak [MB]", 1e-6 * pliant_memory_peak());
    if (std::shared_ptr<const LoadedModel> loaded = simulation_->loaded()) {
        status.add("threads", threads_of(*pliant_model_get_scene(loaded->model)));
        status.add("scan", loaded->scan->volume.id);
        status.add("elements", pliant_model_get_scene(loaded->model)->element.kind == PLIANT_HEXAHEDRA ? "hexahedra"
                                                                                                       : "tetrahedra");
        status.add("nodes", pliant_model_get_body(loaded->model)->fine.num_nodes);
        status.add("tetrahedra", pliant_model_get_body(loaded->model)->fine.num_tets);
        if (loaded->choice.made) {
            status.add("chosen", loaded->choice.options);
            status.add("error of that on the probe load [%]", 100 * loaded->choice.error);
        }
    }
}

void Diagnostics::master(diagnostic_updater::DiagnosticStatusWrapper &status)
{
    const std::string problem = master_->problem();
    if (problem.empty()) status.summary(DiagnosticStatus::OK, "known there");
    else status.summary(DiagnosticStatus::WARN, problem);
    status.add("registered again", master_->num_reregistrations());
}

void Diagnostics::output(diagnostic_updater::DiagnosticStatusWrapper &status)
{
    status.summary(DiagnosticStatus::OK, "the subscribed outputs are published");
    for (const std::string &problem : {mesh_output_->problem(), volume_output_->problem(), camera_output_->problem(),
                                       displacement_output_->problem(), checkpoint_writer_->problem()})
        if (!problem.empty()) status.mergeSummary(DiagnosticStatus::ERROR, problem);
    status.add("volumes held for slow subscribers [MB]",
               1e-6 * static_cast<double>(volume_output_->stream().held_bytes()));
    status.add("largest error of sent volumes in motion [values of the scan]", volume_output_->stream().bound());
    if (camera_output_->any()) status.add("pictures", camera_output_->drawn());
}

} // namespace pliant_ros
