/* Drag a tool in rviz. An interactive marker with a menu (grasp, release) publishes the topics of a robot's tool.
 *
 * Private parameters: tool (name, default grasper), frame (default tissue), rate [Hz, 100], size of the marker [m,
 * 0.08], start ([x, y, z] in the frame [m]; default: in front of the centre of the mesh). */
#include "ros/programs/tool_sender.h"

#include <interactive_markers/interactive_marker_server.h>
#include <interactive_markers/menu_handler.h>
#include <pliant/MeshTopology.h>
#include <ros/ros.h>

#include <algorithm>
#include <cmath>
#include <vector>

namespace {

using interactive_markers::InteractiveMarkerServer;
using interactive_markers::MenuHandler;
using visualization_msgs::InteractiveMarkerControl;
using visualization_msgs::InteractiveMarkerFeedback;
using visualization_msgs::InteractiveMarkerFeedbackConstPtr;
using visualization_msgs::Marker;

class MarkerTool {
public:
    MarkerTool(ros::NodeHandle handle, const ros::NodeHandle &own)
        : name_(own.param<std::string>("tool", "grasper")), frame_(own.param<std::string>("frame", "tissue")),
          size_(own.param("size", 0.08)), sender_(handle, name_, frame_), server_(name_ + "/drag")
    {
        hold_ = menu_.insert("take hold", [this](const InteractiveMarkerFeedbackConstPtr &) { close(true); });
        release_ = menu_.insert("let go", [this](const InteractiveMarkerFeedbackConstPtr &) { close(false); });
        menu_.setVisible(release_, false);
        std::vector<double> start;
        if (own.getParam("start", start) && start.size() == 3) show(start[0], start[1], start[2]);
        else
            topology_ = handle.subscribe("mesh/topology", 1, &MarkerTool::show_in_front_of, this);
    }

    void send()
    {
        if (shown_) sender_.send(tip_, closed_, ros::Time::now());
    }

private:
    /* Show the marker at the foremost node (minimum y: anterior) near the centre of the mesh, seen from the front. */
    void show_in_front_of(const pliant::MeshTopologyConstPtr &message)
    {
        const pliant::MeshTopology &mesh = *message;
        topology_.shutdown();
        double low[3] = {1e9, 1e9, 1e9}, high[3] = {-1e9, -1e9, -1e9};
        for (size_t i = 0; i < mesh.rest_nodes.size(); ++i) {
            low[i % 3] = std::min<double>(low[i % 3], mesh.rest_nodes[i]);
            high[i % 3] = std::max<double>(high[i % 3], mesh.rest_nodes[i]);
        }
        double best = 1e9, x = 0, y = 0, z = 0;
        for (size_t i = 0; i + 2 < mesh.rest_nodes.size(); i += 3) {
            const float *node = &mesh.rest_nodes[i];
            double aside = std::fabs(node[0] - 0.5 * (low[0] + high[0]));
            double along = std::fabs(node[2] - 0.5 * (low[2] + high[2]));
            double cost = node[1] + aside + along;
            if (cost >= best) continue;
            best = cost;
            x = node[0], y = node[1] + 0.002, z = node[2]; /* 2 mm below the surface */
        }
        if (best < 1e9) show(x, y, z);
    }

    void show(double x, double y, double z)
    {
        tip_.position.x = x;
        tip_.position.y = y;
        tip_.position.z = z;
        tip_.orientation.w = 1;
        shown_ = true;
        visualization_msgs::InteractiveMarker marker;
        marker.header.frame_id = frame_;
        marker.name = name_;
        marker.description = name_;
        marker.scale = static_cast<float>(size_);
        marker.pose = tip_;
        marker.controls.push_back(body());
        static const char *const names[] = {"x", "y", "z"};
        for (int axis = 0; axis < 3; ++axis)
            for (bool turns : {false, true}) {
                InteractiveMarkerControl control;
                /* x for the first axis; z and y by half a turn about the other axes */
                control.orientation.w = control.orientation.x = axis == 0 ? M_SQRT1_2 : 0;
                if (axis > 0) control.orientation.w = M_SQRT1_2;
                if (axis == 1) control.orientation.z = M_SQRT1_2;
                if (axis == 2) control.orientation.y = M_SQRT1_2;
                control.name = std::string(turns ? "turn_" : "move_") + names[axis];
                control.interaction_mode =
                    turns ? InteractiveMarkerControl::ROTATE_AXIS : InteractiveMarkerControl::MOVE_AXIS;
                marker.controls.push_back(control);
            }
        server_.insert(marker, [this](const InteractiveMarkerFeedbackConstPtr &feedback) { drag(*feedback); });
        menu_.apply(server_, name_);
        server_.applyChanges();
    }

    /* Return a sphere at the tip. Dragging it moves the tool in the screen plane; a click opens the menu. */
    InteractiveMarkerControl body() const
    {
        Marker ball;
        ball.type = Marker::SPHERE;
        ball.scale.x = ball.scale.y = ball.scale.z = 0.2 * size_;
        ball.color.r = ball.color.g = 0.9f;
        ball.color.b = closed_ ? 0.1f : 0.9f;
        ball.color.a = 1;
        InteractiveMarkerControl control;
        control.name = "tip";
        control.always_visible = true;
        control.interaction_mode = InteractiveMarkerControl::MOVE_3D;
        control.markers.push_back(ball);
        return control;
    }

    void drag(const InteractiveMarkerFeedback &feedback)
    {
        if (feedback.event_type == InteractiveMarkerFeedback::POSE_UPDATE) tip_ = feedback.pose;
    }

    void close(bool closed)
    {
        closed_ = closed;
        menu_.setVisible(hold_, !closed);
        menu_.setVisible(release_, closed);
        visualization_msgs::InteractiveMarker marker;
        if (server_.get(name_, marker)) {
            marker.pose = tip_;
            marker.controls.front() = body();
            server_.insert(marker);
        }
        menu_.reApply(server_);
        server_.applyChanges();
    }

    std::string name_, frame_;
    double size_;
    pliant_ros::ToolSender sender_;
    InteractiveMarkerServer server_;
    MenuHandler menu_;
    MenuHandler::EntryHandle hold_, release_;
    ros::Subscriber topology_;
    geometry_msgs::Pose tip_;
    bool shown_ = false, closed_ = false;
};

} // namespace

int main(int argc, char **argv)
{
    ros::init(argc, argv, "marker_tool");
    ros::NodeHandle handle, own("~");
    MarkerTool tool(handle, own);
    ros::WallRate rate(std::min(std::max(own.param("rate", 100.0), 1.0), 1000.0));
    while (ros::ok()) {
        ros::spinOnce();
        tool.send();
        rate.sleep();
    }
    return 0;
}
