/** @file convert.h
 *  Between ROS messages and the structs of Pliant. Pure functions: no master, no publishers, no clock.
 *
 *  Messages are metres, newtons, seconds; positions are in the tissue frame, whose axes are the scan's LPS axes.
 *  A function that reads a message returns false and says why when the message must not be used.
 */
#ifndef PLIANT_ROS_CONVERT_H
#define PLIANT_ROS_CONVERT_H

#include "pliant/pliant.h"

#include <geometry_msgs/PoseStamped.h>
#include <geometry_msgs/Transform.h>
#include <geometry_msgs/TransformStamped.h>
#include <geometry_msgs/WrenchStamped.h>
#include <pliant/ContactState.h>
#include <pliant/Cut.h>
#include <pliant/CutInput.h>
#include <pliant/CutLine.h>
#include <pliant/MeshState.h>
#include <pliant/MeshTopology.h>
#include <pliant/Pick.h>
#include <pliant/ScanInfo.h>
#include <pliant/StepTiming.h>
#include <pliant/Volume.h>
#include <sensor_msgs/CameraInfo.h>
#include <sensor_msgs/Image.h>
#include <sensor_msgs/JointState.h>
#include <sensor_msgs/PointCloud2.h>
#include <topic_tools/shape_shifter.h>
#include <visualization_msgs/Marker.h>
#include <visualization_msgs/MarkerArray.h>

#include <limits>
#include <string>
#include <vector>

struct pliant_surface; // opaque: the surface of a cut body

namespace pliant_ros {

using pliant::ContactState;
using pliant::Cut;
using pliant::CutInput;
using pliant::CutLine;
using pliant::MeshState;
using pliant::MeshTopology;
using pliant::Pick;
using pliant::ScanInfo;
using pliant::StepTiming;
using pliant::Volume;

/** A rigid motion: x -> rotation x + translation. Quaternion x y z w, of length 1. */
struct Rigid {
    double translation[3]; /**< [m] */
    double rotation[4];
};
Rigid identity();
Rigid inverse(const Rigid &motion);
Rigid multiply(const Rigid &outer, const Rigid &inner);
void rotate(const double rotation[4], const double vector[3], double out[3]);
/** False when something is not finite or the quaternion is more than 1 % from length 1; it is normalized. */
bool rigid_from_message(const geometry_msgs::Pose &pose, Rigid *out, std::string *why);
bool rigid_from_message(const geometry_msgs::Transform &transform, Rigid *out, std::string *why);
geometry_msgs::Transform transform_message(const Rigid &motion);

/** CRTK: stamp 0 marks invalid data. False for it, for what rigid_from_message refuses and without frame_id. */
bool tool_pose_from_message(const geometry_msgs::PoseStamped &message, Rigid *out, std::string *why);
/** measured_cp of any robot: a TransformStamped before 2022, and still on some (RAVEN's CRTK). @param frame of one that names none. False for
 *  any other type. */
bool pose_from_any_message(const topic_tools::ShapeShifter &message, const std::string &frame, geometry_msgs::PoseStamped *out, std::string *why);
/** Opening of a jaw [rad]. False for stamp 0, which a setpoint may have, no position, or one that is not finite. */
bool jaw_from_message(const sensor_msgs::JointState &message, double *angle, std::string *why, bool setpoint = false);

/** Pose of voxel 0, 0, 0 whose axes are those of the grid; a left-handed grid has its third axis turned over and
 *  *flipped set. */
void geometry_to_message(const pliant_geometry &geometry, geometry_msgs::Pose *origin, bool *flipped,
                         geometry_msgs::Vector3 *spacing);
/** The same back. False when numbers are not finite, the spacing or a size is not positive, or the quaternion is
 *  not one. */
bool geometry_from_message(const uint32_t size[3], const geometry_msgs::Pose &origin, bool flipped,
                           const geometry_msgs::Vector3 &spacing, pliant_geometry *out, std::string *why);

/** Voxels [offset, offset + size) of a grid. */
struct Box {
    uint32_t offset[3], size[3];
};
/** The smallest boxes (in voxels of the volume) around each connected group of changed bricks; one box where
 *  several would hold more voxels. Empty when nothing changed. */
std::vector<Box> changed_boxes(const int32_t count[3], const uint8_t *changed, const int32_t size[3]);
/** At most so many boxes that hold the same voxels: those whose union adds the fewest others become one. Of more than 128 boxes: the one that holds all. */
std::vector<Box> merged_boxes(std::vector<Box> boxes, size_t most);
/** What two boxes share; a size of 0 along an axis: nothing. */
Box common_box(const Box &a, const Box &b);
/** The voxels whose centres lie between two corners of a box in LPS [m], those of a turned grid in the box around it. At least one voxel. */
Box region_box(const pliant_geometry &geometry, const double low[3], const double high[3]);
/** Header, scan_id, revision, sequence and since are the caller's.
 *  @param region what is the whole; must lie inside the volume
 *  @param box    must lie inside the region */
void volume_message(const pliant_volume &volume, const Box &region, const Box &box, Volume *out);
/** Every step-th voxel of a region along each axis, from its first one on. The caller's is the same. */
void preview_message(const pliant_volume &volume, const Box &region, uint32_t step, Volume *out);

/** Names, sizes and statistics of a model. Header and scan_id are the caller's.
 *  @param low,high smallest and largest value of the scan */
void scan_info_message(const pliant_model &model, float low, float high, ScanInfo *out);
/** Header, scan_id and revision are the caller's. */
void topology_message(const pliant_surface &surface, MeshTopology *out);
/** Header, revision and step are the caller's.
 *  @param positions (fine.num_nodes x 3) [m]
 *  @param contact_force (fine.num_nodes) [N], where scalar is contact_force; empty: none. Errors: those of pliant_data_scalar; then *out holds no scalar. */
pliant_status mesh_state_message(const pliant_model &model, const pliant_body &body, const double *positions, pliant_scalar scalar,
                                 const std::vector<float> &contact_force, MeshState *out);
/** As the option output/scalar calls it. */
const char *scalar_name(pliant_scalar scalar);

/** Of the tool on the tissue, at its tip, in the axes of the frame the tool's pose came in. Never NaN: a force that
 *  is not finite becomes zero. Header is the caller's.
 *  @param frame_from_tissue quaternion that turns tissue axes into those of the frame */
void wrench_message(const double force[3], const double torque[3], const double frame_from_tissue[4], geometry_msgs::WrenchStamped *out);
/** The torque of a wrench about another point, in the same axes.
 *  @param torque about the point that the force acts at, at [m, N, N m] */
void torque_about(const double point[3], const double at[3], const double force[3], const double torque[3], double out[3]);
/* what a tool does to the tissue by all that it has, about its tip [N, N m] */
void tool_wrench(const pliant_tool_state &tool, double force[3], double torque[3]);
/** Header is the caller's.
 *  @param clearance of pliant_tool_clearance [m] */
void contact_message(const pliant_tool_state &tool, double clearance, const std::vector<pliant_contact> &contacts, ContactState *out);
/** What a tool's blade does. Header and revision are the caller's. */
void cut_message(const pliant_tool_state &tool, Cut *out);
/** Stages, seconds and counters of the last step. Header, percentiles, missed_deadlines and inverted are the
 *  caller's. */
void timing_message(const pliant_statistics &statistics, StepTiming *out);

/** What was chosen, for every message that has the fields choice, choice_error and choice_seconds: empty and NaN when
 *  nothing was. */
template <class Message> void choice_message(const pliant_choice &choice, Message *out)
{
    const float none = std::numeric_limits<float>::quiet_NaN();
    out->choice = choice.options;
    out->choice_error = choice.made ? static_cast<float>(choice.error) : none;
    out->choice_seconds = choice.made ? static_cast<float>(choice.seconds) : none;
}

/** A ray into tissue axes, and what it met back into those of the caller. */
pliant_ray ray_from_message(const Pick::Request &request, const Rigid &tissue_from_frame);
void pick_message(const pliant_picked &picked, const Rigid &frame_from_tissue, Pick::Response *out);

/** A line to cut along, into tissue axes. */
CutInput cut_from_message(const CutLine::Request &request, const Rigid &tissue_from_frame);

/** The surface for stock rviz, coloured by displacement from rest (blue 0, red the largest, at least 1 mm) or, where
 *  given, by the scalar (blue its smallest, red its largest), with light from the front. Header is the caller's.
 *  @param scalar (fine.num_nodes) or empty */
void marker_message(const pliant_surface &surface, const double *positions, const std::vector<float> &scalar,
                    visualization_msgs::Marker *out);
/** Write a tool for stock rviz: an arrow from its tip along its force on the tissue, 5 mm a newton, at most 0.2 m. A tool without a proxy
 *  has a ball at its tip, too (grey: in the air, yellow: in the tissue, green: it holds). (A Wrench display draws its arrow at the
 *  origin of the frame, not at the tip.) Header is that of both markers.
 *  @param clearance of pliant_tool_clearance [m] */
void tool_markers_message(const pliant_tool_state &tool, double clearance, const std_msgs::Header &header,
                          visualization_msgs::MarkerArray *out);
/** Append the shape of a tool twice: solid at its proxy, and as a ghost where the tool is measured (namespaces NAME/proxy, NAME/measured).
 *  Grey: in the air, yellow: it presses, green: it holds, red: its force limit is reached. A tool without a proxy appends nothing.
 *  Markers vanish after one second without a message. */
void shape_markers_message(const pliant_tool_state &tool, const pliant_tool_shape &shape, const std_msgs::Header &header,
                           visualization_msgs::MarkerArray *out);
/** Convert a displacement field: a point for every voxel with tissue. Its fields are x, y, z (at rest), dx, dy, dz (the displacement) [m], and cut
 *  (1 near a cut). Header is the caller's. */
void displacement_message(const pliant_displacement &field, sensor_msgs::PointCloud2 *out);
/** Nodes with fields x, y, z, displacement [m] and, where given, scalar. Header is the caller's. */
void points_message(const pliant_body &body, const double *positions, const std::vector<float> &scalar,
                    sensor_msgs::PointCloud2 *out);

/** Whose axes a camera's frame has. */
enum CameraConvention {
    OPTICAL, /**< z forward, x right, y down (REP 103) */
    AMBF     /**< x backwards, y right, z up */
};
/** Where a camera is, from where its frame is in the tissue.
 *  @param aside how far it is to the right of that [m]: the other eye */
void camera_from_frame(const Rigid &tissue_from_frame, CameraConvention convention, double aside, pliant_camera *camera);
/** Its calibration: no distortion. Header is the caller's.
 *  @param baseline of a stereo camera's right eye, else 0 [m] */
void camera_info_message(const pliant_camera &camera, double baseline, sensor_msgs::CameraInfo *out);
/** Size and pixels as a calibration has them, for pictures without distortion. False where it is none. */
bool camera_from_info(const sensor_msgs::CameraInfo &info, pliant_camera *camera);
/** A picture with one channel of 32FC1 or 8UC1, or with three of rgb8. Header is the caller's. */
void camera_image_message(const pliant_camera &camera, const std::string &encoding, const void *pixels, sensor_msgs::Image *out);
/** What a camera sees as points, in the axes of its frame: x, y, z, rgb, a point a pixel; NaN where nothing is seen. Header is the caller's. */
void camera_points_message(const pliant_camera &camera, CameraConvention convention, const uint8_t *rgb, const float *depth,
                           sensor_msgs::PointCloud2 *out);

/** Planes of the patient, looked at as radiologists do. */
enum Plane {
    AXIAL,    /**< right: patient's left, down: posterior */
    CORONAL,  /**< right: patient's left, down: inferior */
    SAGITTAL  /**< right: posterior, down: inferior */
};
/** A plane through the volume as 32FC1 in the volume's values (CT: Hounsfield units), trilinear, square pixels as
 *  wide as the finest spacing, covering the volume's box; outside it the background. 32FC1 because it needs no
 *  window: stock rviz shows it with its own minimum and maximum, and the values stay readable. Header is the caller's.
 *  @param fraction where the plane cuts the box along the patient axis: 0 at its right, anterior or inferior side, 1 at
 *                  the other */
void slice_message(const pliant_volume &volume, Plane plane, double fraction, sensor_msgs::Image *out);
/** The same with pose and spacing: a volume of one voxel's thickness (float32), whose i axis is the image's right and j its down.
 *  The caller's is as of volume_message. */
void placed_slice_message(const pliant_volume &volume, Plane plane, double fraction, Volume *out);

} // namespace pliant_ros

#endif
