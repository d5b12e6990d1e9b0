/* Pose of the tissue in the parent frame, from parameters, from the file of an earlier registration, or from point
 * pairs. */
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

/* Fit the rigid motion that maps one point set to the other with the minimum sum of squared errors (Arun, Huang and
 * Blostein, IEEE PAMI 9:698, 1987; Umeyama, IEEE PAMI 13:376, 1991). Return false for fewer than three pairs,
 * non-finite points, or collinear points.
 * errors: residual distance of each pair [m] */
bool fit_rigid(const std::vector<geometry_msgs::Point> &from, const std::vector<geometry_msgs::Point> &to, Rigid *out,
               std::vector<double> *errors, std::string *why);

/* Return why a fit of these pairs is refused, or an empty text. A fit is refused if the root mean square of its errors
 * exceeds max_error [m; 0: 10 mm], or if the points span metres. The text reports whether mirrored points or other
 * units explain the errors.
 * errors: residual distances that fit_rigid has returned for these pairs [m] */
std::string refusal_of_fit(const std::vector<geometry_msgs::Point> &tissue,
                           const std::vector<geometry_msgs::Point> &room, const std::vector<double> &errors,
                           double max_error);
double root_mean_square(const std::vector<double> &values);

geometry_msgs::Pose pose_message(const Rigid &pose);

/* Convert between a pose with its parent frame and the text of a registration file. */
std::string registration_text(const std::string &parent_frame, const Rigid &pose);
bool registration_from_text(const std::string &text, const std::string &parent_frame, Rigid *out, std::string *why);

/* Read the pose of an arm's base and its reference frame from a dVRK camera registration file. The file is
 * NAME-registration-open-cv.json (dVRK 2.4) or a console's file with the same entries: "base-frame":
 * {"reference-frame": NAME, "transform": 4 x 4}. */
bool hand_eye_from_text(const std::string &text, std::string *frame, Rigid *out, std::string *why);

class Registration {
public:
    /* Publish the pose of the tissue and of the arm bases that ~hand_eye names. Throw std::runtime_error if a file
     * cannot be read or uses another frame. */
    Registration(ros::NodeHandle handle, const Parameters &parameters, std::shared_ptr<tf2_ros::Buffer> frames);

    /* Return the pose of the tissue in the parent frame. Thread-safe. */
    geometry_msgs::Pose pose_message() const;
    /* Set the pose that an earlier process stored in a checkpoint, unless a registration file gives the pose. */
    void restore_pose(const std::string &parent_frame, const geometry_msgs::Pose &pose);

private:
    bool by_points(pliant::Register::Request &request, pliant::Register::Response &response);
    void place(const Rigid &pose);
    void send(const geometry_msgs::TransformStamped &transform);
    void place_arms();
    std::string store(const Rigid &pose) const;

    const Parameters parameters_;
    std::shared_ptr<tf2_ros::Buffer> frames_;
    mutable std::mutex lock_; /* guards pose_ */
    Rigid pose_ = identity();
    bool stored_ = false; /* whether a file gives the pose */
    tf2_ros::StaticTransformBroadcaster broadcaster_;
    ros::ServiceServer server_;
};

} // namespace pliant_ros

#endif
