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
/** Read measured_cp of any robot. It was a TransformStamped before 2022, and still is on some robots (RAVEN's CRTK).
 *  @param frame Frame of a message without frame_id. Return false for any other type. */
bool pose_from_any_message(const topic_tools::ShapeShifter &message, const std::string &frame,
                           geometry_msgs::PoseStamped *out, std::string *why);
/** Read the opening of a jaw [rad]. Return false for stamp 0 (allowed for a setpoint), and without a finite
 *  position. */
bool jaw_from_message(const sensor_msgs::JointState &message, double *angle, std::string *why, bool setpoint = false);

/** Return the pose of voxel 0, 0, 0 with the axes of the grid. A left-handed grid has its third axis reversed and
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
/** Merge boxes until at most `maximum` are left, each time the two whose union adds the fewest voxels. More than 128
 *  boxes become one box. */
std::vector<Box> merged_boxes(std::vector<Box> boxes, size_t maximum);
/** Return the intersection of two boxes. A size of 0 along an axis: it is empty. */
Box common_box(const Box &a, const Box &b);
/** Return the voxels with centres between two corners of a box in LPS [m], at least one voxel. For a rotated grid, it
 *  is the enclosing box of voxels. */
Box region_box(const pliant_geometry &geometry, const double low[3], const double high[3]);
/** Fill a volume message. Header, scan_id, revision, sequence and since are the caller's.
 *  @param region The published region, inside the volume.
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
 *  @param contact_force (fine.num_nodes) [N], where scalar is contact_force; empty: none. Errors: as of
 *                       pliant_data_scalar. *out then has no scalar. */
pliant_status mesh_state_message(const pliant_model &model, const pliant_body &body, const double *positions,
                                 pliant_scalar scalar, const std::vector<float> &contact_force, MeshState *out);
/** As the option output/scalar calls it. */
const char *scalar_name(pliant_scalar scalar);

/** Fill the wrench of the tool on the tissue at its tip, in the axes of the frame of the tool's pose. A force that is
 *  not finite becomes zero. Header is the caller's.
 *  @param frame_from_tissue Quaternion of the rotation from tissue axes to frame axes. */
void wrench_message(const double force[3], const double torque[3], const double frame_from_tissue[4],
                    geometry_msgs::WrenchStamped *out);
/** The torque of a wrench about another point, in the same axes.
 *  @param torque about the point that the force acts at, at [m, N, N m] */
void torque_about(const double point[3], const double at[3], const double force[3], const double torque[3],
                  double out[3]);
/** Return the total force and torque of a tool on the tissue, about its tip [N, N m]. */
void tool_wrench(const pliant_tool_state &tool, double force[3], double torque[3]);
/** Header is the caller's.
 *  @param clearance of pliant_tool_clearance [m] */
void contact_message(const pliant_tool_state &tool, double clearance, const std::vector<pliant_contact> &contacts,
                     ContactState *out);
/** Fill the state of a tool's blade. Header and revision are the caller's. */
void cut_message(const pliant_tool_state &tool, Cut *out);
/** Stages, seconds and counters of the last step. Header, percentiles, missed_deadlines and inverted are the
 *  caller's. */
void timing_message(const pliant_statistics &statistics, StepTiming *out);

/** Fill the fields choice, choice_error and choice_seconds of a message. Without a choice they are empty and NaN. */
template <class Message> void choice_message(const pliant_choice &choice, Message *out)
{
    const float none = std::numeric_limits<float>::quiet_NaN();
    out->choice = choice.options;
    out->choice_error = choice.made ? static_cast<float>(choice.error) : none;
    out->choice_seconds = choice.made ? static_cast<float>(choice.seconds) : none;
}

/** Convert a ray to tissue axes, and the picked point to the caller's axes. */
pliant_ray ray_from_message(const Pick::Request &request, const Rigid &tissue_from_frame);
void pick_message(const pliant_picked &picked, const Rigid &frame_from_tissue, Pick::Response *out);

/** A line to cut along, into tissue axes. */
CutInput cut_from_message(const CutLine::Request &request, const Rigid &tissue_from_frame);

/** Fill the surface for stock rviz, with light from the front. It is coloured by the scalar (blue: smallest, red:
 *  largest), or without one by displacement (blue: 0, red: the largest, at least 1 mm). Header is the caller's.
 *  @param scalar (fine.num_nodes) or empty */
void marker_message(const pliant_surface &surface, const double *positions, const std::vector<float> &scalar,
                    visualization_msgs::Marker *out);
/** Write a tool for stock rviz: an arrow from its tip along its force on the tissue, 5 mm a newton, at most 0.2 m. A
 *  tool without a proxy has a ball at its tip, too (grey: in the air, yellow: in the tissue, green: it holds). (A
 *  Wrench display draws its arrow at the origin of the frame, not at the tip.) Both markers have the header.
 *  @param clearance of pliant_tool_clearance [m] */
void tool_markers_message(const pliant_tool_state &tool, double clearance, const std_msgs::Header &header,
                          visualization_msgs::MarkerArray *out);
/** Append the shape of a tool twice: solid at its proxy, and as a ghost where the tool is measured (namespaces
 *  NAME/proxy, NAME/measured). Grey: in the air, yellow: it presses, green: it holds, red: its force limit is reached.
 *  A tool without a proxy appends nothing. Markers vanish after one second without a message. */
void shape_markers_message(const pliant_tool_state &tool, const pliant_tool_shape &shape,
                           const std_msgs::Header &header, visualization_msgs::MarkerArray *out);
/** Convert a displacement field: a point for every voxel with tissue. Its fields are x, y, z (at rest), dx, dy, dz (the
 *  displacement) [m], and cut (1 near a cut). Header is the caller's. */
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
 *  @param aside Offset to the right [m], for the other eye. */
void camera_from_frame(const Rigid &tissue_from_frame, CameraConvention convention, double aside,
                       pliant_camera *camera);
/** Its calibration: no distortion. Header is the caller's.
 *  @param baseline of a stereo camera's right eye, else 0 [m] */
void camera_info_message(const pliant_camera &camera, double baseline, sensor_msgs::CameraInfo *out);
/** Size and pixels as a calibration has them, for pictures without distortion. Return false if it is not a valid
 *  calibration. */
bool camera_from_info(const sensor_msgs::CameraInfo &info, pliant_camera *camera);
/** A picture with one channel of 32FC1 or 8UC1, or with three of rgb8. Header is the caller's. */
void camera_image_message(const pliant_camera &camera, const std::string &encoding, const void *pixels,
                          sensor_msgs::Image *out);
/** Fill one point per pixel of a camera, in the axes of its frame: x, y, z, rgb. It is NaN without a surface. Header is
 *  the caller's. */
void camera_points_message(const pliant_camera &camera, CameraConvention convention, const uint8_t *rgb,
                           const float *depth, sensor_msgs::PointCloud2 *out);

/** Planes of the patient, looked at as radiologists do. */
enum Plane {
    AXIAL,    /**< right: patient's left, down: posterior */
    CORONAL,  /**< right: patient's left, down: inferior */
    SAGITTAL  /**< right: posterior, down: inferior */
};
/** Fill a plane through the volume's box as 32FC1 in the volume's values (CT: Hounsfield units). Interpolation is
 *  trilinear, pixels are square with the finest spacing, and the background is outside. 32FC1 needs no window: stock
 *  rviz shows it with its own minimum and maximum. Header is the caller's.
 *  @param fraction where the plane cuts the box along the patient axis: 0 at its right, anterior or inferior side, 1 at
 *                  the other */
void slice_message(const pliant_volume &volume, Plane plane, double fraction, sensor_msgs::Image *out);
/** The same with pose and spacing: a volume of one voxel's thickness (float32), whose i axis is the image's right and j
 *  its down. The caller's is as of volume_message. */
void placed_slice_message(const pliant_volume &volume, Plane plane, double fraction, Volume *out);

} // namespace pliant_ros

#endif
