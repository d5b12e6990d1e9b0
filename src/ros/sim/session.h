/* Convert between a simulation's inputs and a Session message, from which the same simulation can be built again. */
#ifndef PLIANT_ROS_SIM_SESSION_H
#define PLIANT_ROS_SIM_SESSION_H

#include "ros/sim/settings_server.h"
#include "ros/sim/loaded_model.h"

#include <pliant/Session.h>
#include <ros/node_handle.h>

#include <mutex>
#include <vector>

namespace pliant_ros {

using pliant::Session;

std::string scene_text(const pliant_scene &scene);
/* Throws Failure. */
pliant_scene scene_of(const std::string &text);
/* Fill in a session from the scene at load; the caller sets the header. */
void session_message(const LoadedModel &loaded, Session *out);
void settings_message(const RuntimeSettings &settings, Session *out);
/* Apply the settings of a session to a scene. */
void apply_settings(const Session &session, pliant_scene *scene);
/* Return whether both sessions describe the same model. */
bool same_model(const Session &a, const Session &b);

/* Locations at which a recorded scan is searched: the path given by the user, the recorded file name in the same
 * folder, and the recorded path. */
class RecordedScanFinder {
public:
    /* scan, labels: paths given by the user; empty: the recorded paths are valid */
    explicit RecordedScanFinder(std::string scan = "", std::string labels = "")
        : scan_(std::move(scan)), labels_(std::move(labels))
    {
    }
    /* Return the scan whose voxels and labels match a session. Throws Failure with the searched locations. */
    std::shared_ptr<const Scan> find(const Session &session);

private:
    std::vector<std::string> places(const std::string &named, const std::string &recorded) const;

    const std::string scan_, labels_;
    std::shared_ptr<const Scan> last_;
};

/* Throws Failure. */
std::shared_ptr<LoadedModel> build_session(const Session &session, std::shared_ptr<const Scan> scan,
                                           pliant_progress progress);

/* Publish the topic `session`. Thread-safe. */
class Sessions {
public:
    Sessions(ros::NodeHandle handle, const std::string &frame);
    void loaded(const LoadedModel &loaded, const RuntimeSettings &settings);
    void set(const RuntimeSettings &settings);
    /* Return the last published session. */
    Session now() const;

private:
    void publish();

    mutable std::mutex lock_;
    ros::Publisher publisher_;
    Session current_;
};

} // namespace pliant_ros

#endif
