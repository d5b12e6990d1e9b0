/* Where the tissue lies in the room: as the parameters say, as a file does that an earlier registration has left, or by points. */
#ifndef PLIANT_ROS_NODE_REGISTRATION_H
#define PLIANT_ROS_NODE_REGISTRATION_H

#include "ros/params/params.h"

#include <pliant/Register.h>
#include <ros/node_handle.h>
#include <tf2_ros/buffer.h>
#include <tf2_ros/static_transform_broadcaster.h>

#include <memory>
#include <mutex>

namespace pliant_ros {

/* The rigid motion that takes the points of one set to those of the other with the least sum of squares (Arun, Huang and Blostein, IEEE PAMI
 * 9:698, 1987; Umeyama, IEEE PAMI 13:376, 1991). False for less than three pairs, points that are not finite, or that lie on a line.
 * errors: what is left of every pair [m] */
bool fit_rigid(const std::vector<geometry_msgs::Point> &from, const std::vector<geometry_msgs::Point> &to, Rigid *out, std::vector<double> *errors,
               std::string *why);

/* Return why a fit of these pairs is refused, or an empty text. A fit is refused if the root mean square of its errors exceeds max_error
 * [m; 0: 10 mm], or if the points span metres. The text says whether mirrored points or other units explain the errors.
 * errors: what fit_rigid has returned for these pairs [m] */
std::string refusal_of_fit(const std::vector<geometry_msgs::Point> &tissue, const std::vector<geometry_msgs::Point> &room,
                           const std::vector<double> &errors, double max_error);
double root_mean_square(const std::vector<double> &values);

geometry_msgs::Pose pose_message(const Rigid &pose);

/* Text of a file with a pose and the frame that it is in, and back. */
std::string registration_text(const std::string &parent_frame, const Rigid &pose);
bool registration_from_text(const std::string &text, const std::string &parent_frame, Rigid *out, std::string *why);

/* The pose of an arm's base, and the frame that it is in, from a file of dVRK's camera registration (2.4, for consoles that are not told of
 * it: NAME-registration-open-cv.json, or what was copied to a console's file): "base-frame": {"reference-frame": NAME, "transform": 4 x 4}. */
bool hand_eye_from_text(const std::string &text, std::string *frame, Rigid *out, std::string *why);

class Registration {
public:
    /* Places the tissue, and the bases of arms that ~hand_eye names; throws std::runtime_error where a file cannot be read, or is of another
       frame. */
    Registration(ros::NodeHandle handle, const Parameters &parameters, std::shared_ptr<tf2_ros::Buffer> frames);

    /* Of the tissue in the parent frame, now. Any thread may ask. */
    geometry_msgs::Pose pose_message() const;
    /* Where a process before this one had it, unless a file says where it lies. */
    void go_on(const std::string &parent_frame, const geometry_msgs::Pose &pose);

private:
    bool by_points(pliant::Register::Request &request, pliant::Register::Response &response);
    void place(const Rigid &pose);
    void send(const geometry_msgs::TransformStamped &transform);
    void place_arms();
    std::string store(const Rigid &pose) const;

    const Parameters parameters_;
    std::shared_ptr<tf2_ros::Buffer> frames_;
    mutable std::mutex lock_; /* of the pose */
    Rigid pose_ = identity();
    bool stored_ = false; /* a file says where it lies */
    tf2_ros::StaticTransformBroadcaster broadcaster_;
    ros::ServiceServer server_;
};

} // namespace pliant_ros

#endif
