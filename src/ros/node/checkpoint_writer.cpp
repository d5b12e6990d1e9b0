#include "ros/node/checkpoint_writer.h"

namespace pliant_ros {

namespace {

enum { CHECK_MILLISECONDS = 20 /* interval of checks for new cuts */ };

} // namespace

CheckpointWriter::CheckpointWriter(ros::NodeHandle handle, const Parameters &parameters, Simulation *simulation,
                                   const Sessions *sessions, const Services *services, const Registration *registration)
    : parameters_(parameters), name_(handle.getNamespace() == "/" ? "/" : handle.getNamespace() + "/"),
      simulation_(simulation), sessions_(sessions), services_(services), registration_(registration)
{
    if (!parameters.checkpoint.empty()) thread_ = std::thread(&CheckpointWriter::run, this);
}

CheckpointWriter::~CheckpointWriter()
{
    if (!thread_.joinable()) return;
    {
        std::lock_guard<std::mutex> hold(lock_);
        stopping_ = true;
    }
    ends_.notify_all();
    thread_.join();
}

bool CheckpointWriter::due() const
{
    const StepHealth health = simulation_->health();
    if (!health.is_loaded || health.revision == 0) return false;
    return health.revision != written_revision_ ||
           Clock::now() - written_at_ >= std::chrono::duration<double>(parameters_.checkpoint_period);
}

void CheckpointWriter::run()
{
    std::unique_lock<std::mutex> hold(lock_);
    while (!ends_.wait_for(hold, std::chrono::milliseconds(CHECK_MILLISECONDS), [this] { return stopping_; })) {
        hold.unlock();
        try {
            if (due()) write();
        } catch (const std::exception &failed) {
            written_at_ = Clock::now(); /* A failed write is retried after the same period as a successful one. */
            problem_.set(std::string("no checkpoint: ") + failed.what());
            ROS_ERROR_THROTTLE(5, "no checkpoint: %s", failed.what());
        }
        hold.lock();
    }
}

void CheckpointWriter::write()
{
    const ResumableState moment = simulation_->resumable_state();
    CheckpointContents saved;
    saved.session = sessions_->now();
    /* A model that is being replaced is not saved. */
    if (saved.session.load != moment.snapshot.loaded->revision) return;
    make_checkpoint_contents(moment, parameters_.tissue_frame, &surface_, &saved);
    services_->keep(&saved.rest);
    saved.rest.parent_frame = parameters_.parent_frame;
    saved.rest.tissue_pose = registration_->pose_message();
    write_checkpoint_file(parameters_.checkpoint, name_, saved);
    written_at_ = Clock::now();
    written_revision_ = moment.snapshot.revision;
    problem_.set("");
}

} // namespace pliant_ros
