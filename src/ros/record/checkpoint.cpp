#include "ros/record/checkpoint.h"

#include "ros/record/message.h"
#include "ros/record/recorded.h"

#include <rosbag/bag.h>
#include <rosbag/view.h>

#include <cerrno>
#include <cstdio>
#include <cstring>
#include <fcntl.h>
#include <memory>
#include <sys/statvfs.h>
#include <unistd.h>

namespace pliant_ros {

namespace {

Failure no_file(const std::string &path, const char *what)
{
    return Failure(PLIANT_ERROR_FILE, path + ": " + what + ": " + std::strerror(errno));
}

/* Write a file to disk (fsync). */
void flush_file(const std::string &path)
{
    const int file = open(path.c_str(), O_RDONLY);
    if (file < 0) throw no_file(path, "cannot be opened");
    const int failed = fsync(file);
    close(file);
    if (failed) throw no_file(path, "cannot be written");
}

template <class Message> Message only(rosbag::View *view, const std::string &path)
{
    const std::string type = ros::message_traits::datatype<Message>();
    for (const rosbag::MessageInstance &recorded : *view) {
        if (recorded.getDataType() != type) continue;
        try {
            return *read_message<Message>(recorded);
        } catch (const Failure &failed) {
            throw Failure(failed.status, path + ": " + failed.what());
        }
    }
    throw Failure(PLIANT_ERROR_FORMAT, path + ": it has no message of type " + type + ", so it is not a checkpoint");
}

} // namespace

void make_checkpoint_contents(const ResumableState &moment, const std::string &frame,
                              std::shared_ptr<const pliant_surface> *surface, CheckpointContents *out)
{
    const Snapshot &now = moment.snapshot;
    std_msgs::Header header;
    header.stamp = now.stamp;
    header.frame_id = frame;
    out->topology = MeshTopology();
    out->topology.header = out->state.header = out->rest.header = header;
    out->topology.scan_id = now.loaded->scan->volume.id;
    out->topology.scan_checksum = now.loaded->scan->checksum;
    out->topology.revision = out->state.revision = now.revision;
    *surface = surface_of(*now.body, *surface);
    topology_message(**surface, &out->topology);
    out->state.step = now.step;
    out->state.nodes.assign(now.positions.begin(), now.positions.end());
    out->rest.sequence = moment.sequence;
    out->rest.strokes = moment.strokes;
    out->rest.paused = moment.paused;
    out->rest.holding = moment.holding;
    out->rest.touching = moment.touching;
    out->rest.state = moment.state;
}

/* Check the free disk space before the file is opened, so that no incomplete bag is written. */
static void check_disk_space(const std::string &path, const CheckpointContents &saved)
{
    using ros::serialization::serializationLength;
    const double needed = 65536.0 + serializationLength(saved.session) + serializationLength(saved.topology) +
                          serializationLength(saved.state) + serializationLength(saved.rest);
    const size_t slash = path.rfind('/');
    struct statvfs file_system;
    /* opening the file gives a better error message */
    if (statvfs(slash == std::string::npos ? "." : path.substr(0, slash + 1).c_str(), &file_system) != 0) return;
    if (static_cast<double>(file_system.f_bavail) * static_cast<double>(file_system.f_frsize) < needed)
        throw Failure(PLIANT_ERROR_FILE, path + ": the disk is full");
}

void write_checkpoint_file(const std::string &path, const std::string &name, const CheckpointContents &saved)
{
    const std::string next = path + ".new";
    check_disk_space(path, saved);
    std::unique_ptr<rosbag::Bag> bag;
    try {
        const ros::Time now(ros::WallTime::now().toSec()); /* /clock may be 0, which is no valid bag time */
        bag.reset(new rosbag::Bag(next, rosbag::bagmode::Write));
        bag->setCompression(rosbag::compression::LZ4);
        bag->write(name + "session", now, saved.session);
        bag->write(name + "mesh/topology", now, saved.topology);
        bag->write(name + "mesh/state", now, saved.state);
        bag->write(name + "checkpoint", now, saved.rest);
        bag->close();
        flush_file(next);
    } catch (const std::exception &failed) {
        bag.release(); /* the destructor would write again and throw, which would end the process */
        std::remove(next.c_str());
        throw Failure(PLIANT_ERROR_FILE, next + ": " + failed.what());
    }
    if (std::rename(next.c_str(), path.c_str()) != 0) throw no_file(path, "cannot be replaced");
}

CheckpointContents read_checkpoint_file(const std::string &path)
{
    try {
        rosbag::Bag bag(path, rosbag::bagmode::Read);
        rosbag::View view(bag);
        return CheckpointContents{only<Session>(&view, path), only<MeshTopology>(&view, path),
                                  only<MeshState>(&view, path), only<Checkpoint>(&view, path)};
    } catch (const rosbag::BagException &failed) {
        throw Failure(PLIANT_ERROR_FORMAT, path + ": " + failed.what());
    }
}

ResumableState resumable_state_of(const CheckpointContents &saved, std::shared_ptr<const LoadedModel> loaded)
{
    std::string why;
    Bodies bodies;
    std::shared_ptr<const pliant_body> body = body_of(*loaded, saved.topology, &bodies, &why);
    if (!body) throw Failure(PLIANT_ERROR_FORMAT, why);
    ResumableState out;
    out.snapshot = *snapshot_of(std::move(loaded), body, saved.state);
    out.sequence = saved.rest.sequence;
    out.strokes = saved.rest.strokes;
    out.paused = saved.rest.paused;
    out.holding = saved.rest.holding;
    out.touching = saved.rest.touching;
    out.state = saved.rest.state;
    return out;
}

} // namespace pliant_ros
