/* Convert the mesh to Marker and PointCloud2 messages, which rviz displays without plugins. */
#include "pliant/ros/convert.h"
#include "contact/shapes/tool_shape.h"
#include "topology/visible_surface.h"

#include <Eigen/Geometry>
#include <tf2_eigen/tf2_eigen.h>

#include <algorithm>
#include <cmath>
#include <cstring>

namespace pliant_ros {

namespace {

float displacement(const double *rest, const double *positions, size_t node)
{
    double squared = 0;
    for (size_t i = 3 * node; i < 3 * node + 3; ++i) squared += (positions[i] - rest[i]) * (positions[i] - rest[i]);
    return static_cast<float>(std::sqrt(squared));
}

/* Append the surface's vertices to an array of node values. */
std::vector<double> with_vertices(const pliant_surface &surface, int size, const double *nodes)
{
    const size_t count = static_cast<size_t>(size) * static_cast<size_t>(surface.body->fine.num_nodes);
    std::vector<double> out(nodes, nodes + count);
    out.resize(count + static_cast<size_t>(size) * static_cast<size_t>(surface.num_vertices));
    pliant_surface_at_vertices(&surface, size, nodes, out.data() + count);
    return out;
}

/* Map x to a colour: 0 is blue, 1/2 yellow, 1 red. The colour is scaled by light and translucent, so that a tool inside
 * stays visible. */
std_msgs::ColorRGBA colour(float x, float light)
{
    static const float ramp[3][3] = {{0.45f, 0.60f, 0.90f}, {0.95f, 0.90f, 0.30f}, {0.95f, 0.15f, 0.10f}};
    x = 2 * std::min(std::max(x, 0.0f), 1.0f);
    int low = x < 1 ? 0 : 1;
    float channel[3];
    for (int i = 0; i < 3; ++i) channel[i] = light * (ramp[low][i] + (x - low) * (ramp[low + 1][i] - ramp[low][i]));
    std_msgs::ColorRGBA out;
    out.r = channel[0];
    out.g = channel[1];
    out.b = channel[2];
    out.a = 0.6f;
    return out;
}

/* Return the brightness of a triangle lit from the front, the left and above. rviz does not light triangles with vertex
 * colours, so the brightness is part of the colour. */
float light_on(const double *a, const double *b, const double *c)
{
    const double from[3] = {0.36, -0.80, 0.48}, u[3] = {b[0] - a[0], b[1] - a[1], b[2] - a[2]},
                 v[3] = {c[0] - a[0], c[1] - a[1], c[2] - a[2]};
    double n[3] = {u[1] * v[2] - u[2] * v[1], u[2] * v[0] - u[0] * v[2], u[0] * v[1] - u[1] * v[0]};
    double length = std::sqrt(n[0] * n[0] + n[1] * n[1] + n[2] * n[2]);
    double along = length > 0 ? (n[0] * from[0] + n[1] * from[1] + n[2] * from[2]) / length : 0;
    return static_cast<float>(0.5 + 0.5 * std::max(along, 0.0));
}

void field(const char *name, std::vector<sensor_msgs::PointField> *fields)
{
    sensor_msgs::PointField next;
    next.name = name;
    next.offset = static_cast<uint32_t>(fields->size() * sizeof(float));
    next.datatype = sensor_msgs::PointField::FLOAT32;
    next.count = 1;
    fields->push_back(next);
}

std_msgs::ColorRGBA rgb(float r, float g, float b)
{
    std_msgs::ColorRGBA out;
    out.r = r;
    out.g = g;
    out.b = b;
    out.a = 1;
    return out;
}

geometry_msgs::Point point(const double at[3])
{
    geometry_msgs::Point out;
    out.x = at[0];
    out.y = at[1];
    out.z = at[2];
    return out;
}

} // namespace

void tool_markers_message(const pliant_tool_state &tool, double clearance, const std_msgs::Header &header,
                          visualization_msgs::MarkerArray *out)
{
    const double tip_size = 0.012, metres_per_newton = 0.005, longest = 0.2, shortest = 1e-3; /* [m], [m/N] */
    out->markers.resize(2);
    visualization_msgs::Marker &tip = out->markers[0], &arrow = out->markers[1];
    tip.header = arrow.header = header;
    tip.ns = arrow.ns = tool.name;
    tip.id = 0;
    tip.type = visualization_msgs::Marker::SPHERE;
    tip.action = tool.present && !tool.has_proxy ? visualization_msgs::Marker::ADD : visualization_msgs::Marker::DELETE;
    tip.pose.position = point(tool.tip);
    tip.pose.orientation.w = 1;
    tip.scale.x = tip.scale.y = tip.scale.z = tip_size;
    tip.color = tool.holding ? rgb(0.1f, 0.9f, 0.1f) : clearance <= 0 ? rgb(0.9f, 0.9f, 0.1f) : rgb(0.7f, 0.7f, 0.7f);
    double length = metres_per_newton * std::sqrt(tool.force[0] * tool.force[0] + tool.force[1] * tool.force[1] +
                                                  tool.force[2] * tool.force[2]);
    double scale = metres_per_newton * std::min(1.0, length > 0 ? longest / length : 1.0), end[3];
    const double *begin = tool.has_proxy ? tool.proxy_tip : tool.tip;
    for (int d = 0; d < 3; ++d) end[d] = begin[d] + scale * tool.force[d];
    arrow.id = 1;
    arrow.type = visualization_msgs::Marker::ARROW;
    arrow.action = tool.present && tool.holding && length > shortest ? visualization_msgs::Marker::ADD
                                                                     : visualization_msgs::Marker::DELETE;
    arrow.pose.orientation.w = 1;
    arrow.points = {point(begin), point(end)};
    arrow.scale.x = 0.006; /* shaft */
    arrow.scale.y = 0.014; /* head */
    arrow.color = rgb(1, 0.5f, 0);
}

namespace {

/* Return the pose of a tool part for a tip pose and a jaw angle. The jaws rotate about their joint. */
Eigen::Isometry3d part_pose(const pliant_tool_shape &shape, pliant_part_frame frame, const double tip[3],
                            const double rotation[4], double jaw)
{
    using Eigen::Vector3d;
    const Eigen::Map<const Vector3d> joint(shape.joint), axis(shape.axis);
    const double half = frame == PLIANT_FRAME_TIP ? 0 : frame == PLIANT_FRAME_JAW_PLUS ? 0.5 * jaw : -0.5 * jaw;
    const Eigen::Map<const Vector3d> place(tip);
    const Eigen::Isometry3d pose = Eigen::Translation3d(place) * Eigen::Map<const Eigen::Quaterniond>(rotation);
    if (half == 0 || !(axis.norm() > 0)) return pose;
    const Eigen::AngleAxisd turn(half, axis.normalized());
    return pose * Eigen::Translation3d(joint) * turn * Eigen::Translation3d(-joint);
}

void set_pose(const Eigen::Isometry3d &pose, visualization_msgs::Marker *out) { out->pose = tf2::toMsg(pose); }

void set_scale(double x, double y, double z, visualization_msgs::Marker *out)
{
    out->scale.x = x;
    out->scale.y = y;
    out->scale.z = z;
}

void append_solid(const pliant_part &part, const Eigen::Isometry3d &pose, visualization_msgs::Marker marker,
                  visualization_msgs::MarkerArray *out)
{
    pliant_solid_surface surface;
    pliant_solid_get_surface(part.solid, &surface);
    marker.type = visualization_msgs::Marker::TRIANGLE_LIST;
    set_scale(1, 1, 1, &marker);
    set_pose(pose * Eigen::Translation3d(Eigen::Map<const Eigen::Vector3d>(part.from)), &marker);
    for (int32_t corner = 0; corner < 3 * surface.num_triangles; ++corner)
        marker.points.push_back(point(surface.points + 3 * surface.triangles[corner]));
    out->markers.push_back(marker);
}

/* Return the rotation from z to a direction, about an axis perpendicular to both. Quaterniond::FromTwoVectors() takes
 * seven seconds to compile. */
Eigen::Quaterniond turn_from_z(const Eigen::Vector3d &along)
{
    const Eigen::Vector3d to = along.normalized();
    if (to.z() < -1 + 1e-12) return {0, 1, 0, 0}; /* every axis is perpendicular */
    return Eigen::Quaterniond(1 + to.z(), -to.y(), to.x(), 0).normalized();
}

/* Append a capsule as one cylinder and two spheres. */
void append_capsule(const pliant_part &part, const Eigen::Isometry3d &pose, visualization_msgs::Marker marker,
                    visualization_msgs::MarkerArray *out)
{
    const Eigen::Map<const Eigen::Vector3d> from(part.from), to(part.to);
    const Eigen::Vector3d along = to - from;
    const double width = 2 * part.radius;
    marker.type = visualization_msgs::Marker::CYLINDER;
    set_scale(width, width, along.norm(), &marker);
    set_pose(pose * Eigen::Translation3d(0.5 * (from + to)) * turn_from_z(along), &marker);
    out->markers.push_back(marker);
    marker.id++;
    marker.type = visualization_msgs::Marker::SPHERE_LIST;
    set_scale(width, width, width, &marker);
    set_pose(pose, &marker);
    marker.points = {point(part.from), point(part.to)};
    out->markers.push_back(marker);
}

void append_part(const pliant_part &part, const Eigen::Isometry3d &pose, visualization_msgs::Marker marker,
                 visualization_msgs::MarkerArray *out)
{
    const Eigen::Map<const Eigen::Vector3d> from(part.from), to(part.to);
    const double width = 2 * part.radius;
    switch (part.kind) {
    case PLIANT_PART_SPHERE:
        marker.type = visualization_msgs::Marker::SPHERE;
        set_scale(width, width, width, &marker);
        set_pose(pose * Eigen::Translation3d(from), &marker);
        out->markers.push_back(marker);
        break;
    case PLIANT_PART_CAPSULE: append_capsule(part, pose, marker, out); break;
    case PLIANT_PART_BOX: /* the radius rounds the box and lies outside its extents */
        marker.type = visualization_msgs::Marker::CUBE;
        set_scale(to.x() - from.x() + width, to.y() - from.y() + width, to.z() - from.z() + width, &marker);
        set_pose(pose * Eigen::Translation3d(0.5 * (from + to)), &marker);
        out->markers.push_back(marker);
        break;
    case PLIANT_PART_SOLID: append_solid(part, pose, marker, out); break;
    case PLIANT_NUM_PART_KINDS:
    case PLIANT_PART_HALF_SPACE: break; /* only obstacles are half spaces */
    }
}

} // namespace

void shape_markers_message(const pliant_tool_state &tool, const pliant_tool_shape &shape,
                           const std_msgs::Header &header, visualization_msgs::MarkerArray *out)
{
    const float ghost = 0.25f; /* opacity */
    const bool presses = std::any_of(tool.contact_force, tool.contact_force + 3, [](double x) { return x != 0; });
    if (!tool.has_proxy) return;
    for (int measured = 0; measured < 2; ++measured) {
        visualization_msgs::Marker marker;
        marker.header = header;
        marker.ns = tool.name + std::string(measured ? "/measured" : "/proxy");
        marker.action = visualization_msgs::Marker::ADD;
        marker.lifetime = ros::Duration(1);
        marker.color = tool.saturated ? rgb(0.95f, 0.2f, 0.1f)
                       : tool.holding ? rgb(0.1f, 0.9f, 0.1f)
                       : presses      ? rgb(0.9f, 0.9f, 0.1f)
                                      : rgb(0.7f, 0.7f, 0.7f);
        marker.color.a = measured ? ghost : 1;
        for (int32_t p = 0; p < shape.num_parts; ++p) {
            const pliant_part &part = shape.part[p];
            marker.id = 2 * p;
            const double *tip = measured ? tool.tip : tool.proxy_tip,
                         *rotation = measured ? tool.rotation : tool.proxy_rotation;
            append_part(part, part_pose(shape, part.frame, tip, rotation, measured ? tool.jaw : tool.proxy_jaw), marker,
                        out);
        }
    }
}

void marker_message(const pliant_surface &surface, const double *positions, const std::vector<float> &scalar,
                    visualization_msgs::Marker *out)
{
    const pliant_mesh &mesh = surface.body->fine;
    const size_t nodes = static_cast<size_t>(mesh.num_nodes), corners = 3 * static_cast<size_t>(surface.num_triangles);
    const std::vector<double> at = with_vertices(surface, 3, positions);
    std::vector<double> value;
    double low = 0, high = 1e-3;
    if (scalar.size() == nodes && nodes > 0) {
        value = with_vertices(surface, 1, std::vector<double>(scalar.begin(), scalar.end()).data());
        low = *std::min_element(value.begin(), value.end());
        high = *std::max_element(value.begin(), value.end());
    } else {
        const std::vector<double> rest = with_vertices(surface, 3, mesh.rest);
        value.resize(at.size() / 3);
        for (size_t i = 0; i < value.size(); ++i)
            high = std::max<double>(high, value[i] = displacement(rest.data(), at.data(), i));
    }
    out->ns = "surface";
    out->id = 0;
    out->type = visualization_msgs::Marker::TRIANGLE_LIST;
    out->action = visualization_msgs::Marker::ADD;
    out->pose.orientation.w = 1;
    out->scale.x = out->scale.y = out->scale.z = 1;
    out->color = colour(0.5f, 1);
    out->points.resize(corners);
    out->colors.resize(corners);
    for (size_t triangle = 0; triangle < corners; triangle += 3) {
        const int32_t *corner_of = &surface.triangle[triangle];
        float light = light_on(&at[3 * static_cast<size_t>(corner_of[0])], &at[3 * static_cast<size_t>(corner_of[1])],
                               &at[3 * static_cast<size_t>(corner_of[2])]);
        for (size_t corner = 0; corner < 3; ++corner) {
            const size_t vertex = static_cast<size_t>(corner_of[corner]);
            out->points[triangle + corner] = point(&at[3 * vertex]);
            out->colors[triangle + corner] =
                colour(high > low ? static_cast<float>((value[vertex] - low) / (high - low)) : 0.0f, light);
        }
    }
}

void displacement_message(const pliant_displacement &of, sensor_msgs::PointCloud2 *out)
{
    const size_t across = static_cast<size_t>(of.geometry.size[0]), down = static_cast<size_t>(of.geometry.size[1]);
    out->fields.clear();
    for (const char *name : {"x", "y", "z", "dx", "dy", "dz", "cut"}) field(name, &out->fields);
    out->height = 1;
    out->width = 0;
    out->is_bigendian = false;
    out->is_dense = true;
    out->point_step = static_cast<uint32_t>(out->fields.size() * sizeof(float));
    out->data.clear();
    for (size_t v = 0; v < pliant_geometry_voxels(&of.geometry); ++v) {
        if (of.mask[v] == PLIANT_MASK_NO_TISSUE) continue;
        const double index[3] = {static_cast<double>(v % across), static_cast<double>(v / across % down),
                                 static_cast<double>(v / across / down)};
        const float *vector = of.vectors + 3 * v;
        double rest[3];
        pliant_geometry_to_world(&of.geometry, index, rest);
        const float row[7] = {static_cast<float>(rest[0]),
                              static_cast<float>(rest[1]),
                              static_cast<float>(rest[2]),
                              vector[0],
                              vector[1],
                              vector[2],
                              of.mask[v] == PLIANT_MASK_CUT ? 1.0f : 0.0f};
        const uint8_t *bytes = reinterpret_cast<const uint8_t *>(row);
        out->data.insert(out->data.end(), bytes, bytes + sizeof row);
        ++out->width;
    }
    out->row_step = out->point_step * out->width;
}

void points_message(const pliant_body &body, const double *positions, const std::vector<float> &scalar,
                    sensor_msgs::PointCloud2 *out)
{
    const pliant_mesh &mesh = body.fine;
    size_t nodes = static_cast<size_t>(mesh.num_nodes);
    bool has_scalar = scalar.size() == nodes && nodes > 0;
    out->fields.clear();
    for (const char *name : {"x", "y", "z", "displacement"}) field(name, &out->fields);
    if (has_scalar) field("scalar", &out->fields);
    out->height = 1;
    out->width = static_cast<uint32_t>(nodes);
    out->is_bigendian = false;
    out->is_dense = true;
    out->point_step = static_cast<uint32_t>(out->fields.size() * sizeof(float));
    out->row_step = out->point_step * out->width;
    out->data.resize(static_cast<size_t>(out->row_step));
    for (size_t i = 0; i < nodes; ++i) {
        float row[5] = {static_cast<float>(positions[3 * i]), static_cast<float>(positions[3 * i + 1]),
                        static_cast<float>(positions[3 * i + 2]), displacement(mesh.rest, positions, i),
                        has_scalar ? scalar[i] : 0.0f};
        std::memcpy(&out->data[i * out->point_step], row, out->point_step);
    }
}

} // namespace pliant_ros
