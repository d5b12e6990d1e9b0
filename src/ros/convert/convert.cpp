#include "pliant/ros/convert.h"
#include "fem/element/scalar.h"
#include "sim/api/data.h"
#include "topology/body.h"
#include "topology/visible_surface.h"

#include <Eigen/Geometry>
#include <tf2_eigen/tf2_eigen.h>

#include <algorithm>
#include <cmath>
#include <limits>

namespace pliant_ros {

namespace {

using Eigen::Map;
using Eigen::Quaterniond;
using Eigen::Vector3d;
using RowMajor = Eigen::Matrix<double, 3, 3, Eigen::RowMajor>;

Eigen::Isometry3d isometry(const Rigid &motion)
{
    return Eigen::Translation3d(Map<const Vector3d>(motion.translation)) * Map<const Quaterniond>(motion.rotation);
}

bool rigid_from(const Vector3d &translation, const Quaterniond &rotation, Rigid *out, std::string *why)
{
    const double length = rotation.norm();
    if (!translation.allFinite() || !std::isfinite(length)) {
        *why = "a number of the pose is not finite";
        return false;
    }
    if (std::fabs(length - 1) > 0.01) {
        *why = "the quaternion of the pose has length " + std::to_string(length) + " instead of 1";
        return false;
    }
    Map<Vector3d>(out->translation) = translation;
    Map<Quaterniond>(out->rotation) = rotation.normalized();
    return true;
}

void append_floats(const double *values, size_t count, std::vector<float> *out)
{
    out->resize(count);
    for (size_t i = 0; i < count; ++i) (*out)[i] = static_cast<float>(values[i]);
}

template <class List, class Value> void name_of(const List &list, Value value, std::string *out)
{
    for (const auto &entry : list)
        if (entry.value == value) *out = entry.name;
}

struct MethodName { pliant_method value; const char *name; };
const MethodName method_names[] = {
#define METHOD_NAME(value, name) {value, #name},
    PLIANT_METHOD_LIST(METHOD_NAME)
#undef METHOD_NAME
};
struct ScalarName { pliant_scalar value; const char *name; };
const ScalarName scalar_names[] = {
#define SCALAR_NAME(value, name) {value, #name},
    PLIANT_SCALAR_LIST(SCALAR_NAME)
#undef SCALAR_NAME
};

void proxy_message(const pliant_tool_state &tool, ContactState *out)
{
    const Map<const Quaterniond> measured(tool.rotation), proxy(tool.proxy_rotation);
    out->proxy.position = tf2::toMsg(Vector3d(Map<const Vector3d>(tool.proxy_tip)));
    out->proxy.orientation = tf2::toMsg(Quaterniond(proxy));
    tf2::toMsg(Vector3d(Map<const Vector3d>(tool.proxy_error)), out->proxy_error);
    out->proxy_angle = static_cast<float>(measured.angularDistance(proxy));
    out->jaw_error = static_cast<float>(tool.jaw_error);
    out->saturated = tool.saturated;
}

#define SAME_END(name, text)                                               \
    static_assert(static_cast<int>(StepTiming::name) == PLIANT_STEP_END_##name, \
                  "StepTiming.msg has another order than PLIANT_STEP_END_LIST");
PLIANT_STEP_END_LIST(SAME_END)
#undef SAME_END

} // namespace

Rigid identity() { return Rigid{{0, 0, 0}, {0, 0, 0, 1}}; }

void rotate(const double rotation[4], const double vector[3], double out[3])
{
    Map<Vector3d>{out} = Map<const Quaterniond>(rotation) * Vector3d(Map<const Vector3d>(vector));
}

Rigid inverse(const Rigid &motion)
{
    Rigid out;
    const Quaterniond back = Map<const Quaterniond>(motion.rotation).conjugate();
    Map<Quaterniond>(out.rotation) = back;
    Map<Vector3d>(out.translation) = -(back * Map<const Vector3d>(motion.translation));
    return out;
}

Rigid multiply(const Rigid &outer, const Rigid &inner)
{
    Rigid out;
    Map<Vector3d>(out.translation) = isometry(outer) * Map<const Vector3d>(inner.translation);
    Map<Quaterniond>(out.rotation) = Map<const Quaterniond>(outer.rotation) * Map<const Quaterniond>(inner.rotation);
    return out;
}

bool rigid_from_message(const geometry_msgs::Pose &pose, Rigid *out, std::string *why)
{
    Vector3d translation;
    Quaterniond rotation;
    tf2::fromMsg(pose.position, translation);
    tf2::fromMsg(pose.orientation, rotation);
    return rigid_from(translation, rotation, out, why);
}

bool rigid_from_message(const geometry_msgs::Transform &transform, Rigid *out, std::string *why)
{
    Vector3d translation;
    Quaterniond rotation;
    tf2::fromMsg(transform.translation, translation);
    tf2::fromMsg(transform.rotation, rotation);
    return rigid_from(translation, rotation, out, why);
}

geometry_msgs::Transform transform_message(const Rigid &motion)
{
    return tf2::eigenToTransform(isometry(motion)).transform;
}

bool pose_from_any_message(const topic_tools::ShapeShifter &message, const std::string &frame,
                           geometry_msgs::PoseStamped *out, std::string *why)
try {
    const std::string type = message.getDataType();
    if (type == "geometry_msgs/PoseStamped") {
        *out = *message.instantiate<geometry_msgs::PoseStamped>();
    } else if (type == "geometry_msgs/TransformStamped") {
        const geometry_msgs::TransformStampedConstPtr sent = message.instantiate<geometry_msgs::TransformStamped>();
        out->header = sent->header;
        out->pose.position.x = sent->transform.translation.x;
        out->pose.position.y = sent->transform.translation.y;
        out->pose.position.z = sent->transform.translation.z;
        out->pose.orientation = sent->transform.rotation;
    } else {
        *why = "it is a " + type + "; it must be a geometry_msgs/PoseStamped or TransformStamped";
        return false;
    }
    /* older versions of tf prefix a slash */
    if (!out->header.frame_id.empty() && out->header.frame_id[0] == '/') out->header.frame_id.erase(0, 1);
    if (out->header.frame_id.empty()) out->header.frame_id = frame;
    return true;
} catch (const std::exception &broken) { /* the serialized data do not match the message definition */
    *why = std::string("it cannot be read: ") + broken.what();
    return false;
}

bool tool_pose_from_message(const geometry_msgs::PoseStamped &message, Rigid *out, std::string *why)
{
    if (message.header.stamp.isZero()) {
        *why = "stamp 0 marks the pose as invalid";
        return false;
    }
    if (message.header.frame_id.empty()) {
        *why = "the pose has no frame_id";
        return false;
    }
    return rigid_from_message(message.pose, out, why);
}

bool jaw_from_message(const sensor_msgs::JointState &message, double *angle, std::string *why, bool setpoint)
{
    if (!setpoint && message.header.stamp.isZero()) *why = "stamp 0 marks the jaw as invalid";
    else if (message.position.empty()) *why = "the jaw has no position";
    else if (!std::isfinite(message.position[0])) *why = "the position of the jaw is not finite";
    else {
        *angle = message.position[0];
        return true;
    }
    return false;
}

void geometry_to_message(const pliant_geometry &geometry, geometry_msgs::Pose *origin, bool *flipped,
                         geometry_msgs::Vector3 *spacing)
{
    RowMajor axes = Map<const RowMajor>(geometry.direction);
    *flipped = axes.determinant() < 0;
    if (*flipped) axes.col(2) = -axes.col(2);
    origin->position = tf2::toMsg(Vector3d(Map<const Vector3d>(geometry.origin)));
    origin->orientation = tf2::toMsg(Quaterniond(Eigen::Matrix3d(axes)));
    spacing->x = geometry.spacing[0];
    spacing->y = geometry.spacing[1];
    spacing->z = geometry.spacing[2];
}

bool geometry_from_message(const uint32_t size[3], const geometry_msgs::Pose &origin, bool flipped,
                           const geometry_msgs::Vector3 &spacing, pliant_geometry *out, std::string *why)
{
    Rigid motion;
    if (!rigid_from_message(origin, &motion, why)) return false;
    const double steps[3] = {spacing.x, spacing.y, spacing.z};
    for (int d = 0; d < 3; ++d)
        if (!(steps[d] > 0) || !std::isfinite(steps[d]) || size[d] == 0 || size[d] > INT32_MAX) {
            *why = "size and spacing must be positive";
            return false;
        }
    for (int d = 0; d < 3; ++d) {
        out->size[d] = static_cast<int32_t>(size[d]);
        out->origin[d] = motion.translation[d];
        out->spacing[d] = steps[d];
    }
    RowMajor axes = isometry(motion).linear();
    if (flipped) axes.col(2) = -axes.col(2);
    Map<RowMajor>(out->direction) = axes;
    return true;
}

void scan_info_message(const pliant_model &model, float low, float high, ScanInfo *out)
{
    const pliant_volume &scan = *pliant_model_get_scan(&model);
    const pliant_body &body = *pliant_model_get_body(&model);
    const pliant_material_table &materials = *pliant_model_get_materials(&model);
    pliant_build_statistics statistics;
    pliant_model_get_statistics(&model, &statistics);
    for (int d = 0; d < 3; ++d) out->size[d] = static_cast<uint32_t>(scan.geometry.size[d]);
    bool flipped;
    geometry_to_message(scan.geometry, &out->origin, &flipped, &out->spacing);
    out->flipped = flipped;
    out->encoding = static_cast<uint8_t>(scan.encoding);
    out->slope = scan.slope;
    out->intercept = scan.intercept;
    out->low = low;
    out->high = high;
    name_of(method_names, pliant_model_get_scene(&model)->model.method, &out->method);
    out->fine_tetrahedra = static_cast<uint32_t>(body.fine.num_tets);
    out->coarse_tetrahedra = static_cast<uint32_t>(body.coarse.num_tets);
    out->nodes = static_cast<uint32_t>(body.fine.num_nodes);
    out->material_names.clear();
    for (uint32_t i = 0; i < materials.num_materials; ++i)
        out->material_names.push_back(materials.materials[i].name);
    double seconds = 0;
    for (double stage : statistics.seconds) seconds += stage;
    out->build_seconds = static_cast<float>(seconds);
    out->condition_estimate = static_cast<float>(statistics.condition_estimate);
}

void topology_message(const pliant_surface &surface, MeshTopology *out)
{
    const pliant_body &body = *surface.body;
    const pliant_mesh &mesh = body.fine;
    size_t nodes = static_cast<size_t>(mesh.num_nodes), tets = static_cast<size_t>(mesh.num_tets);
    append_floats(mesh.rest, 3 * nodes, &out->rest_nodes);
    out->rest_parent.resize(nodes);
    for (size_t i = 0; i < nodes; ++i)
        out->rest_parent[i] = body.node_parent ? static_cast<uint32_t>(body.node_parent[i]) : static_cast<uint32_t>(i);
    out->tetrahedra.assign(mesh.tets, mesh.tets + 4 * tets);
    out->triangles.assign(surface.triangle, surface.triangle + 3 * static_cast<size_t>(surface.num_triangles));
    out->first_cut = static_cast<uint32_t>(surface.first_cut);
    const size_t vertices = static_cast<size_t>(surface.num_vertices);
    out->vertex_tetrahedron.assign(surface.tet, surface.tet + vertices);
    append_floats(surface.weight, 4 * vertices, &out->vertex_weight);
    out->vertex_material.assign(surface.material, surface.material + vertices);
    out->material.resize(tets);
    for (size_t i = 0; i < tets; ++i) out->material[i] = body.fine_material[i].material;
    out->cut_end.clear();
    out->severed.clear();
    out->tetrahedron_parent.clear();
    out->between.clear();
    out->between_share.clear();
    if (body.subdivision && body.subdivision->between) {
        const size_t added = nodes - static_cast<size_t>(body.subdivision->load_nodes);
        for (size_t i = 0; i < added; ++i) {
            const pliant_between &between = body.subdivision->between[i];
            for (int32_t end : between.end) out->between.push_back(static_cast<uint32_t>(end));
            out->between_share.push_back(between.fraction);
        }
        for (size_t i = 0; body.tet_parent && i < tets; ++i) /* tetrahedra of the initial mesh are their own parents */
            if (static_cast<size_t>(body.tet_parent[i]) != i)
                out->tetrahedron_parent.push_back(static_cast<uint32_t>(body.tet_parent[i]));
    }
    const pliant_cuts *cuts = body.cuts;
    if (!cuts || cuts->num_cuts == 0) return;
    out->cut_end.assign(cuts->cut_end, cuts->cut_end + cuts->num_cuts);
    out->severed.assign(cuts->severed, cuts->severed + cuts->cut_end[cuts->num_cuts - 1]);
}

pliant_status mesh_state_message(const pliant_model &model, const pliant_body &body, const double *positions,
                                 pliant_scalar scalar, const std::vector<float> &contact_force, MeshState *out)
{
    size_t nodes = static_cast<size_t>(body.fine.num_nodes);
    append_floats(positions, 3 * nodes, &out->nodes);
    out->scalar.clear();
    out->scalar_name.clear();
    if (scalar == PLIANT_SCALAR_NONE) return PLIANT_OK;
    out->scalar.resize(nodes);
    pliant_status status = PLIANT_OK;
    if (scalar != PLIANT_SCALAR_CONTACT_FORCE)
        status = pliant_data_scalar(&model, &body, positions, scalar, out->scalar.data());
    else if (contact_force.size() == nodes) out->scalar.assign(contact_force.begin(), contact_force.end());
    if (status < 0) out->scalar.clear();
    else out->scalar_name = scalar_name(scalar);
    return status;
}

const char *scalar_name(pliant_scalar scalar)
{
    for (const ScalarName &each : scalar_names)
        if (each.value == scalar) return each.name;
    return "none";
}

void wrench_message(const double force[3], const double torque[3], const double frame_from_tissue[4],
                    geometry_msgs::WrenchStamped *out)
{
    const Map<const Vector3d> given(force), about(torque);
    const Map<const Quaterniond> turn(frame_from_tissue);
    const bool finite = given.allFinite() && about.allFinite();
    tf2::toMsg(finite ? Vector3d(turn * Vector3d(given)) : Vector3d::Zero(), out->wrench.force);
    tf2::toMsg(finite ? Vector3d(turn * Vector3d(about)) : Vector3d::Zero(), out->wrench.torque);
}

void torque_about(const double point[3], const double at[3], const double force[3], const double torque[3],
                  double out[3])
{
    const Vector3d arm = Map<const Vector3d>(at) - Map<const Vector3d>(point);
    Map<Vector3d>{out} = Map<const Vector3d>(torque) + arm.cross(Vector3d(Map<const Vector3d>(force)));
}

void tool_wrench(const pliant_tool_state &tool, double force[3], double torque[3])
{
    const bool grips = tool.holding || tool.cutting;
    for (int d = 0; d < 3; ++d) {
        /* the grasp force acts at the tip and has no torque about it */
        force[d] = (grips ? tool.force[d] : 0) + tool.contact_force[d];
        torque[d] = tool.contact_torque[d];
    }
}

void contact_message(const pliant_tool_state &tool, double clearance, const std::vector<pliant_contact> &contacts,
                     ContactState *out)
{
    out->points.clear();
    out->normals.clear();
    out->forces.clear();
    out->areas.clear();
    for (const pliant_contact &contact : contacts) {
        out->points.emplace_back();
        out->normals.emplace_back();
        out->forces.emplace_back();
        out->points.back().x = contact.place[0];
        out->points.back().y = contact.place[1];
        out->points.back().z = contact.place[2];
        tf2::toMsg(Vector3d(Map<const Vector3d>(contact.normal)), out->normals.back());
        tf2::toMsg(Vector3d(Map<const Vector3d>(contact.force)), out->forces.back());
        out->areas.push_back(static_cast<float>(contact.area));
    }
    out->tool = tool.name;
    out->present = tool.present;
    out->touching = tool.present && (clearance <= 0 || !contacts.empty());
    out->grasped = tool.holding;
    out->held_nodes = tool.holding ? static_cast<uint32_t>(tool.num_held) : 0;
    out->clearance = tool.present ? static_cast<float>(clearance) : std::numeric_limits<float>::infinity();
    out->held_point = geometry_msgs::Point();
    if (tool.holding) {
        out->held_point.x = tool.held_point[0];
        out->held_point.y = tool.held_point[1];
        out->held_point.z = tool.held_point[2];
    }
    out->contact_force_error = static_cast<float>(tool.contact_force_error);
    proxy_message(tool, out);
}

void cut_message(const pliant_tool_state &tool, Cut *out)
{
    out->tool = tool.name;
    out->cutting = tool.cutting;
    out->engaged = tool.engaged;
    out->stroke = tool.stroke;
    out->severed_area = tool.severed_area;
    out->pieces = tool.pieces;
    out->point.x = tool.proxy_tip[0];
    out->point.y = tool.proxy_tip[1];
    out->point.z = tool.proxy_tip[2];
}

void timing_message(const pliant_statistics &statistics, StepTiming *out)
{
    out->step = statistics.step;
    out->stage.clear();
    out->seconds.clear();
    for (int stage = 0; stage < PLIANT_NUM_STEP_STAGES; ++stage) {
        out->stage.push_back(pliant_step_stage_name(stage));
        out->seconds.push_back(static_cast<float>(statistics.seconds[stage]));
    }
    out->evaluations = static_cast<uint32_t>(statistics.iterations);
    out->legs = static_cast<uint32_t>(statistics.legs);
    out->advanced = static_cast<float>(statistics.advanced);
    out->max_proxy_error = static_cast<float>(statistics.proxy_error);
    out->ended = static_cast<uint8_t>(statistics.ended);
    out->residual = static_cast<float>(statistics.residual);
    out->error = static_cast<float>(statistics.error);
    out->not_converged = statistics.not_converged;
    out->failed = statistics.failed;
}

pliant_ray ray_from_message(const Pick::Request &request, const Rigid &tissue_from_frame)
{
    const Eigen::Isometry3d to_tissue = isometry(tissue_from_frame);
    Vector3d origin, direction;
    tf2::fromMsg(request.origin, origin);
    tf2::fromMsg(request.direction, direction);
    pliant_ray ray;
    Map<Vector3d>(ray.origin) = to_tissue * origin;
    Map<Vector3d>(ray.direction) = to_tissue.linear() * direction;
    ray.near = request.near;
    ray.far = request.far;
    return ray;
}

CutInput cut_from_message(const CutLine::Request &request, const Rigid &tissue_from_frame)
{
    const Eigen::Isometry3d to_tissue = isometry(tissue_from_frame);
    CutInput out;
    for (const geometry_msgs::Point &point : request.points) {
        Vector3d place;
        tf2::fromMsg(point, place);
        out.points.push_back(tf2::toMsg(Vector3d(to_tissue * place)));
    }
    Vector3d depth;
    tf2::fromMsg(request.depth, depth);
    tf2::toMsg(Vector3d(to_tissue.linear() * depth), out.depth);
    return out;
}

void pick_message(const pliant_picked &picked, const Rigid &frame_from_tissue, Pick::Response *out)
{
    out->success = picked.hit;
    out->message = picked.reason ? picked.reason : "";
    if (!picked.hit) return;
    out->point = tf2::toMsg(Vector3d(isometry(frame_from_tissue) * Map<const Vector3d>(picked.point)));
    out->distance = picked.distance;
    out->tetrahedron = static_cast<uint32_t>(picked.tetrahedron);
    std::copy(picked.barycentric, picked.barycentric + 4, out->barycentric.begin());
    out->rest.x = picked.rest[0];
    out->rest.y = picked.rest[1];
    out->rest.z = picked.rest[2];
    out->intensity = picked.intensity;
}

} // namespace pliant_ros
