#include "pliant/ros/convert.h"

#include <algorithm>
#include <cmath>
#include <limits>

namespace pliant_ros {

namespace {

bool finite3(const double *v) { return std::isfinite(v[0]) && std::isfinite(v[1]) && std::isfinite(v[2]); }

bool rigid_from_numbers(const double translation[3], const double rotation[4], Rigid *out, std::string *why)
{
    double squared = 0;
    for (int i = 0; i < 4; ++i) squared += rotation[i] * rotation[i];
    if (!finite3(translation) || !std::isfinite(squared)) {
        *why = "a number of the pose is not finite";
        return false;
    }
    double length = std::sqrt(squared);
    if (std::fabs(length - 1) > 0.01) {
        *why = "the quaternion of the pose has length " + std::to_string(length) + " instead of 1";
        return false;
    }
    std::copy(translation, translation + 3, out->translation);
    for (int i = 0; i < 4; ++i) out->rotation[i] = rotation[i] / length;
    return true;
}

/* columns of a right-handed rotation matrix (row-major) -> quaternion, by its largest component */
void quaternion_from_matrix(const double m[9], double q[4])
{
    double candidates[4] = {1 + m[0] - m[4] - m[8], 1 - m[0] + m[4] - m[8], 1 - m[0] - m[4] + m[8],
                            1 + m[0] + m[4] + m[8]};
    int largest = static_cast<int>(std::max_element(candidates, candidates + 4) - candidates);
    double s = 2 * std::sqrt(candidates[largest]);
    double sums[3] = {(m[5] + m[7]) / s, (m[2] + m[6]) / s, (m[1] + m[3]) / s};        /* yz, xz, xy */
    double differences[3] = {(m[7] - m[5]) / s, (m[2] - m[6]) / s, (m[3] - m[1]) / s}; /* xw, yw, zw */
    q[largest] = s / 4;
    if (largest == 3) {
        for (int i = 0; i < 3; ++i) q[i] = differences[i];
        return;
    }
    int a = (largest + 1) % 3, b = (largest + 2) % 3;
    q[a] = sums[b];
    q[b] = sums[a];
    q[3] = differences[largest];
}

void matrix_from_quaternion(const double q[4], double m[9])
{
    for (int column = 0; column < 3; ++column) {
        double unit[3] = {0, 0, 0}, turned[3];
        unit[column] = 1;
        rotate(q, unit, turned);
        for (int row = 0; row < 3; ++row) m[3 * row + column] = turned[row];
    }
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

} // namespace

Rigid identity() { return Rigid{{0, 0, 0}, {0, 0, 0, 1}}; }

void rotate(const double q[4], const double v[3], double out[3])
{
    /* v + 2 w (u x v) + 2 u x (u x v), u the vector part */
    double c[3] = {q[1] * v[2] - q[2] * v[1], q[2] * v[0] - q[0] * v[2], q[0] * v[1] - q[1] * v[0]};
    double d[3] = {q[1] * c[2] - q[2] * c[1], q[2] * c[0] - q[0] * c[2], q[0] * c[1] - q[1] * c[0]};
    for (int i = 0; i < 3; ++i) out[i] = v[i] + 2 * (q[3] * c[i] + d[i]);
}

Rigid inverse(const Rigid &motion)
{
    Rigid out = {{0, 0, 0}, {-motion.rotation[0], -motion.rotation[1], -motion.rotation[2], motion.rotation[3]}};
    double back[3];
    rotate(out.rotation, motion.translation, back);
    for (int i = 0; i < 3; ++i) out.translation[i] = -back[i];
    return out;
}

Rigid multiply(const Rigid &outer, const Rigid &inner)
{
    Rigid out;
    rotate(outer.rotation, inner.translation, out.translation);
    for (int i = 0; i < 3; ++i) out.translation[i] += outer.translation[i];
    const double *a = outer.rotation, *b = inner.rotation;
    out.rotation[0] = a[3] * b[0] + a[0] * b[3] + a[1] * b[2] - a[2] * b[1];
    out.rotation[1] = a[3] * b[1] - a[0] * b[2] + a[1] * b[3] + a[2] * b[0];
    out.rotation[2] = a[3] * b[2] + a[0] * b[1] - a[1] * b[0] + a[2] * b[3];
    out.rotation[3] = a[3] * b[3] - a[0] * b[0] - a[1] * b[1] - a[2] * b[2];
    return out;
}

bool rigid_from_message(const geometry_msgs::Pose &pose, Rigid *out, std::string *why)
{
    const double translation[3] = {pose.position.x, pose.position.y, pose.position.z};
    const double rotation[4] = {pose.orientation.x, pose.orientation.y, pose.orientation.z, pose.orientation.w};
    return rigid_from_numbers(translation, rotation, out, why);
}

bool rigid_from_message(const geometry_msgs::Transform &transform, Rigid *out, std::string *why)
{
    const double translation[3] = {transform.translation.x, transform.translation.y, transform.translation.z};
    const double rotation[4] = {transform.rotation.x, transform.rotation.y, transform.rotation.z, transform.rotation.w};
    return rigid_from_numbers(translation, rotation, out, why);
}

geometry_msgs::Transform transform_message(const Rigid &motion)
{
    geometry_msgs::Transform out;
    out.translation.x = motion.translation[0];
    out.translation.y = motion.translation[1];
    out.translation.z = motion.translation[2];
    out.rotation.x = motion.rotation[0];
    out.rotation.y = motion.rotation[1];
    out.rotation.z = motion.rotation[2];
    out.rotation.w = motion.rotation[3];
    return out;
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

bool jaw_from_message(const sensor_msgs::JointState &message, double *angle, std::string *why)
{
    if (message.header.stamp.isZero()) *why = "stamp 0 marks the jaw as invalid";
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
    double m[9];
    std::copy(geometry.direction, geometry.direction + 9, m);
    double determinant = m[0] * (m[4] * m[8] - m[5] * m[7]) - m[1] * (m[3] * m[8] - m[5] * m[6]) +
                         m[2] * (m[3] * m[7] - m[4] * m[6]);
    *flipped = determinant < 0;
    if (*flipped)
        for (int row = 0; row < 3; ++row) m[3 * row + 2] = -m[3 * row + 2];
    double q[4];
    quaternion_from_matrix(m, q);
    origin->position.x = geometry.origin[0];
    origin->position.y = geometry.origin[1];
    origin->position.z = geometry.origin[2];
    origin->orientation.x = q[0];
    origin->orientation.y = q[1];
    origin->orientation.z = q[2];
    origin->orientation.w = q[3];
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
    matrix_from_quaternion(motion.rotation, out->direction);
    if (flipped)
        for (int row = 0; row < 3; ++row) out->direction[3 * row + 2] = -out->direction[3 * row + 2];
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

void topology_message(const pliant_body &body, MeshTopology *out)
{
    const pliant_mesh &mesh = body.fine;
    size_t nodes = static_cast<size_t>(mesh.num_nodes), tets = static_cast<size_t>(mesh.num_tets);
    append_floats(mesh.rest, 3 * nodes, &out->rest_nodes);
    out->rest_parent.resize(nodes);
    for (size_t i = 0; i < nodes; ++i) out->rest_parent[i] = body.node_parent ? static_cast<uint32_t>(body.node_parent[i]) : static_cast<uint32_t>(i);
    out->tetrahedra.assign(mesh.tets, mesh.tets + 4 * tets);
    out->triangles.assign(body.triangles, body.triangles + 3 * static_cast<size_t>(body.num_triangles));
    out->material.resize(tets);
    for (size_t i = 0; i < tets; ++i) out->material[i] = body.fine_material[i].material;
}

pliant_status mesh_state_message(const pliant_model &model, const pliant_body &body, const double *positions, MeshState *out)
{
    size_t nodes = static_cast<size_t>(body.fine.num_nodes);
    append_floats(positions, 3 * nodes, &out->nodes);
    pliant_scalar scalar = pliant_model_get_scene(&model)->output.scalar;
    out->scalar.clear();
    out->scalar_name.clear();
    if (scalar == PLIANT_SCALAR_NONE) return PLIANT_OK;
    out->scalar.resize(nodes);
    pliant_status status = pliant_data_scalar(&model, &body, positions, scalar, out->scalar.data());
    if (status < 0) out->scalar.clear();
    else name_of(scalar_names, scalar, &out->scalar_name);
    return status;
}

void wrench_message(const double force[3], const double frame_from_tissue[4], geometry_msgs::WrenchStamped *out)
{
    double turned[3] = {0, 0, 0};
    if (finite3(force)) rotate(frame_from_tissue, force, turned);
    out->wrench.force.x = turned[0];
    out->wrench.force.y = turned[1];
    out->wrench.force.z = turned[2];
    /* the force acts at the tip itself */
    out->wrench.torque = geometry_msgs::Vector3();
}

void contact_message(const pliant_tool_state &tool, double clearance, ContactState *out)
{
    out->tool = tool.name;
    out->present = tool.present;
    out->touching = tool.present && clearance <= 0;
    out->grasped = tool.holding;
    out->held_nodes = tool.holding ? static_cast<uint32_t>(tool.num_held) : 0;
    out->clearance = tool.present ? static_cast<float>(clearance) : std::numeric_limits<float>::infinity();
    out->held_point = geometry_msgs::Point();
    if (tool.holding) {
        out->held_point.x = tool.held_point[0];
        out->held_point.y = tool.held_point[1];
        out->held_point.z = tool.held_point[2];
    }
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
    out->iterations = static_cast<uint32_t>(statistics.iterations);
    out->residual = static_cast<float>(statistics.residual);
    out->error = static_cast<float>(statistics.error_before);
    out->not_converged = statistics.not_converged;
    out->failed = statistics.failed;
}

pliant_ray ray_from_message(const Pick::Request &request, const Rigid &tissue_from_frame)
{
    const double origin[3] = {request.origin.x, request.origin.y, request.origin.z};
    const double direction[3] = {request.direction.x, request.direction.y, request.direction.z};
    pliant_ray ray;
    rotate(tissue_from_frame.rotation, origin, ray.origin);
    rotate(tissue_from_frame.rotation, direction, ray.direction);
    for (int d = 0; d < 3; ++d) ray.origin[d] += tissue_from_frame.translation[d];
    ray.near = request.near;
    ray.far = request.far;
    return ray;
}

void pick_message(const pliant_picked &picked, const Rigid &frame_from_tissue, Pick::Response *out)
{
    out->success = picked.hit;
    if (!picked.hit) return;
    double point[3];
    rotate(frame_from_tissue.rotation, picked.point, point);
    out->point.x = point[0] + frame_from_tissue.translation[0];
    out->point.y = point[1] + frame_from_tissue.translation[1];
    out->point.z = point[2] + frame_from_tissue.translation[2];
    out->distance = picked.distance;
    out->tetrahedron = static_cast<uint32_t>(picked.tetrahedron);
    std::copy(picked.barycentric, picked.barycentric + 4, out->barycentric.begin());
    out->rest.x = picked.rest[0];
    out->rest.y = picked.rest[1];
    out->rest.z = picked.rest[2];
    out->intensity = picked.intensity;
}

} // namespace pliant_ros
