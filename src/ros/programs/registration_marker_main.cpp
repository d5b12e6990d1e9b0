/* Register the tissue by dragging it in rviz. An interactive marker at the tissue's centre sends its pose to the
 * service `register` as point pairs, and the node stores it in its file. The marker follows registrations by other
 * clients.
 *
 * Private parameters: parent_frame, tissue_frame (default world, tissue), rate [Hz, 10] at which a dragged marker
 * registers. */
#include <interactive_markers/interactive_marker_server.h>
#include <pliant/Register.h>
#include <pliant/ScanInfo.h>
#include <ros/ros.h>
#include <tf2_eigen/tf2_eigen.h>
#include <tf2_ros/transform_listener.h>

#include <Eigen/Geometry>

#include <algorithm>
#include <cmath>

namespace {

using interactive_markers::InteractiveMarkerServer;
using visualization_msgs::InteractiveMarkerControl;
using visualization_msgs::InteractiveMarkerFeedback;
using visualization_msgs::InteractiveMarkerFeedbackConstPtr;

const char *const NAME = "tissue";
/* smaller pose differences do not move the marker [m, and quaternion components] */
const double SAME = 1e-5;

class RegistrationMarker {
public:
    RegistrationMarker(ros::NodeHandle handle, const ros::NodeHandle &own)
        : parent_(own.param<std::string>("parent_frame", "world")),
          tissue_(own.param<std::string>("tissue_frame", "tissue")), listener_(frames_), server_("registration"),
          service_(handle.serviceClient<pliant::Register>("register")),
          scan_(handle.subscribe("scan_info", 1, &RegistrationMarker::take_scan, this))
    {
    }

    /* Register a dragged marker. Otherwise move the marker to the tissue. */
    void turn()
    {
        if (size_ <= 0) return;
        if (dragged_) {
            dragged_ = false;
            register_pose();
        } else if (!held_) {
            follow();
        }
    }

private:
    /* Show the marker at the centre of the scan, along the patient's axes. */
    void take_scan(const pliant::ScanInfoConstPtr &scan)
    {
        Eigen::Isometry3d origin;
        Eigen::Vector3d half, spacing(scan->spacing.x, scan->spacing.y, scan->spacing.z);
        tf2::fromMsg(scan->origin, origin);
        for (int d = 0; d < 3; ++d) half[d] = 0.5 * (scan->size[static_cast<size_t>(d)] - 1) * spacing[d];
        if (scan->flipped) half[2] = -half[2];
        middle_ = origin * half;
        size_ = 2 * half.norm();
        is_shown_ = false;
    }

    void follow()
    {
        Eigen::Isometry3d now;
        try {
            now = tf2::transformToEigen(frames_.lookupTransform(parent_, tissue_, ros::Time(0))) *
                  Eigen::Translation3d(middle_);
        } catch (const tf2::TransformException &) { /* the tissue has no pose yet */
            return;
        }
        if (is_shown_ && now.isApprox(pose_, SAME)) return;
        pose_ = now;
        if (is_shown_) server_.setPose(NAME, tf2::toMsg(pose_));
        else show();
        server_.applyChanges();
    }

    void show()
    {
        visualization_msgs::InteractiveMarker marker;
        marker.header.frame_id = parent_;
        marker.name = NAME;
        marker.description = "registration";
        marker.scale = static_cast<float>(0.6 * size_);
        marker.pose = tf2::toMsg(pose_);
        for (int axis = 0; axis < 3; ++axis)
            for (bool turns : {false, true}) {
                InteractiveMarkerControl control;
                const Eigen::Vector3d along = Eigen::Vector3d::Unit(axis); /* rotate from x */
                const Eigen::Quaterniond turn(1 + along.x(), 0, -along.z(), along.y());
                control.orientation = tf2::toMsg(turn.normalized());
                control.name = std::string(turns ? "turn_" : "move_") + "xyz"[axis];
                control.interaction_mode =
                    turns ? InteractiveMarkerControl::ROTATE_AXIS : InteractiveMarkerControl::MOVE_AXIS;
                marker.controls.push_back(control);
            }
        server_.insert(marker, [this](const InteractiveMarkerFeedbackConstPtr &feedback) { drag(*feedback); });
        is_shown_ = true;
    }

    void drag(const InteractiveMarkerFeedback &feedback)
    {
        if (feedback.event_type == InteractiveMarkerFeedback::MOUSE_DOWN) held_ = true;
        if (feedback.event_type == InteractiveMarkerFeedback::MOUSE_UP) held_ = false;
        if (feedback.event_type != InteractiveMarkerFeedback::POSE_UPDATE || feedback.header.frame_id != parent_)
            return;
        tf2::fromMsg(feedback.pose, pose_);
        dragged_ = true;
    }

    /* Register the pose by the centre and three points at a distance of the scan's size. */
    void register_pose()
    {
        pliant::Register call;
        call.request.header.frame_id = parent_;
        for (int point = 0; point < 4; ++point) {
            const Eigen::Vector3d offset = point > 0 ? Eigen::Vector3d(size_ * Eigen::Vector3d::Unit(point - 1))
                                                     : Eigen::Vector3d(Eigen::Vector3d::Zero());
            call.request.tissue.push_back(tf2::toMsg(Eigen::Vector3d(middle_ + offset)));
            call.request.room.push_back(tf2::toMsg(Eigen::Vector3d(pose_ * offset)));
        }
        if (!service_.call(call))
            ROS_WARN("registration marker: the service %s does not answer", service_.getService().c_str());
        else if (!call.response.success) ROS_WARN("registration marker: %s", call.response.message.c_str());
    }

    const std::string parent_, tissue_;
    tf2_ros::Buffer frames_;
    tf2_ros::TransformListener listener_;
    InteractiveMarkerServer server_;
    ros::ServiceClient service_;
    ros::Subscriber scan_;
    Eigen::Vector3d middle_ = Eigen::Vector3d::Zero(); /* centre of the scan in its axes [m] */
    double size_ = 0;                                  /* diagonal of the scan; 0: no scan is loaded */
    Eigen::Isometry3d pose_ = Eigen::Isometry3d::Identity(); /* pose of the marker in the parent frame */
    bool is_shown_ = false, held_ = false, dragged_ = false;
};

} // namespace

int main(int argc, char **argv)
{
    ros::init(argc, argv, "registration_marker");
    ros::NodeHandle handle, own("~");
    RegistrationMarker marker(handle, own);
    ros::WallRate rate(std::min(std::max(own.param("rate", 10.0), 1.0), 100.0));
    while (ros::ok()) {
        ros::spinOnce();
        marker.turn();
        rate.sleep();
    }
    return 0;
}
