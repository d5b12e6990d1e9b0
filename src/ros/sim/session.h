/* What a simulation was made from, as a message, and the same simulation made of it again. */
#ifndef PLIANT_ROS_SIM_SESSION_H
#define PLIANT_ROS_SIM_SESSION_H

#include "ros/sim/live.h"
#include "ros/sim/loaded.h"

#include <pliant/Session.h>
#include <ros/node_handle.h>

#include <mutex>
#include <vector>

namespace pliant_ros {

using pliant::Session;

std::string scene_text(const pliant_scene &scene);
/* Throws Failure. */
pliant_scene scene_of(const std::string &text);
/* Into what a scene says at load; the header is the caller's. */
void session_message(const Loaded &loaded, Session *out);
void settings_message(const LiveSettings &settings, Session *out);
/* The settings of a session, in a scene. */
void apply_settings(const Session &session, pliant_scene *scene);
/* Whether the same model is made of both. */
bool same_model(const Session &a, const Session &b);

/* Where scans are looked for: as somebody names one here, beside that by its name, and where it was. */
class Shelf {
public:
    /* named: empty where recorded paths are true */
    explicit Shelf(std::string scan = "", std::string labels = "") : scan_(std::move(scan)), labels_(std::move(labels)) {}
    /* With the voxels and labels of a session. Throws Failure, which tells where it has looked. */
    std::shared_ptr<const Scan> find(const Session &session);

private:
    std::vector<std::string> places(const std::string &named, const std::string &recorded) const;

    const std::string scan_, labels_;
    std::shared_ptr<const Scan> last_;
};

/* Throws Failure. */
std::shared_ptr<Loaded> build_session(const Session &session, std::shared_ptr<const Scan> scan, pliant_progress progress);

/* The topic `session`. Any thread may tell it. */
class Sessions {
public:
    Sessions(ros::NodeHandle handle, const std::string &frame);
    void loaded(const Loaded &loaded, const LiveSettings &settings);
    void set(const LiveSettings &settings);
    /* As it was published last. */
    Session now() const;

private:
    void publish();

    mutable std::mutex lock_;
    ros::Publisher publisher_;
    Session current_;
};

} // namespace pliant_ros

#endif
