#include "ros/sim/stepping.h"
#include "contact/shapes/tool_shape.h"

#include <algorithm>
#include <cstring>

namespace pliant_ros {

// messages and structs use the same numbers
static_assert(int(pliant::ToolPart::SPHERE) == PLIANT_PART_SPHERE &&
                  int(pliant::ToolPart::CAPSULE) == PLIANT_PART_CAPSULE &&
                  int(pliant::ToolPart::BOX) == PLIANT_PART_BOX && int(pliant::ToolPart::SOLID) == PLIANT_PART_SOLID &&
                  PLIANT_NUM_PART_KINDS == 5,
              "ToolPart.msg names every kind of part but half-spaces, which are obstacles");
static_assert(int(pliant::ToolPart::TIP) == PLIANT_FRAME_TIP &&
                  int(pliant::ToolPart::JAW_PLUS) == PLIANT_FRAME_JAW_PLUS &&
                  int(pliant::ToolPart::JAW_MINUS) == PLIANT_FRAME_JAW_MINUS && PLIANT_NUM_PART_FRAMES == 3,
              "ToolPart.msg names every frame of a part");

void set_shape(const pliant_tool_shape &shape, ToolInput *out)
{
    out->shape.clear();
    for (int32_t p = 0; p < shape.num_parts; ++p) {
        const pliant_part &part = shape.part[p];
        pliant::ToolPart message;
        message.kind = static_cast<uint8_t>(part.kind);
        message.moves = static_cast<uint8_t>(part.frame);
        std::copy(part.from, part.from + 3, message.begin.begin());
        std::copy(part.to, part.to + 3, message.end.begin());
        message.radius = part.radius;
        message.cuts = part.cuts;
        if (part.kind == PLIANT_PART_SOLID) {
            pliant_solid_surface surface;
            pliant_solid_get_surface(part.solid, &surface);
            message.points.assign(surface.points, surface.points + 3 * static_cast<size_t>(surface.num_points));
            message.triangles.assign(surface.triangles,
                                     surface.triangles + 3 * static_cast<size_t>(surface.num_triangles));
            message.convex = surface.convex;
            message.resolution = surface.resolution;
        }
        out->shape.push_back(message);
    }
    std::copy(shape.joint, shape.joint + 3, out->joint.begin());
    std::copy(shape.axis, shape.axis + 3, out->joint_axis.begin());
}

namespace {

struct Shape : pliant_tool_shape {
    Shape() : pliant_tool_shape{} {}
    ~Shape() { pliant_tool_shape_free(this); }
    Shape(const Shape &) = delete;
    Shape &operator=(const Shape &) = delete;
};

const pliant_solid *solid_of(const std::string &tool, const pliant::ToolPart &message)
{
    pliant_solid *solid = nullptr;
    pliant_solid_options options{};
    options.convex = message.convex;
    options.resolution = message.resolution;
    check(pliant_solid_create(static_cast<int32_t>(std::min<size_t>(message.points.size() / 3, INT32_MAX)),
                              message.points.data(),
                              static_cast<int32_t>(std::min<size_t>(message.triangles.size() / 3, INT32_MAX)),
                              message.triangles.data(), &options, tool.c_str(), &solid));
    return solid;
}

void read_shape(const ToolInput &input, Shape *out)
{
    pliant_tool_shape &shape = *out;
    if (input.shape.size() > PLIANT_MAX_PARTS)
        throw Failure(PLIANT_ERROR_ARGUMENT, "tool " + input.name + " has " + std::to_string(input.shape.size()) +
                                                 " parts; use at most " + std::to_string(PLIANT_MAX_PARTS));
    for (const pliant::ToolPart &message : input.shape) {
        const bool solid = message.kind == pliant::ToolPart::SOLID;
        if ((message.kind > pliant::ToolPart::BOX && !solid) || message.moves > pliant::ToolPart::JAW_MINUS)
            throw Failure(PLIANT_ERROR_ARGUMENT,
                          "tool " + input.name + ": a part has an unknown kind, or moves with an unknown frame");
        pliant_part &part = shape.part[shape.num_parts++];
        part.kind = static_cast<pliant_part_kind>(message.kind);
        part.frame = static_cast<pliant_part_frame>(message.moves);
        std::copy(message.begin.begin(), message.begin.end(), part.from);
        std::copy(message.end.begin(), message.end.end(), part.to);
        part.radius = message.radius;
        part.cuts = message.cuts;
        if (solid) part.solid = solid_of(input.name, message);
    }
    std::copy(input.joint.begin(), input.joint.end(), shape.joint);
    std::copy(input.joint_axis.begin(), input.joint_axis.end(), shape.axis);
}

} // namespace

void apply_shape(const ToolInput &input, pliant_data *data, int tool)
{
    Shape shape;
    read_shape(input, &shape);
    check(pliant_tool_set_shape(data, tool, &shape));
}
void add_tools(const pliant_model &model, pliant_data *data, const std::vector<ToolInput> &tools)
{
    for (const ToolInput &tool : tools) {
        int index;
        check(pliant_tool_add(&model, data, tool.name.c_str(), &index));
        check(pliant_tool_set_blade(data, index, tool.blade_from.data(), tool.blade_to.data()));
        apply_shape(tool, data, index);
    }
}

void make_cut(const pliant_model &model, pliant_data *data, const CutInput &cut, pliant_cut_report *report)
{
    if (cut.undo) {
        check(pliant_data_undo_cut(&model, data));
        return;
    }
    std::vector<double> points;
    for (const geometry_msgs::Point &point : cut.points) points.insert(points.end(), {point.x, point.y, point.z});
    const double depth[3] = {cut.depth.x, cut.depth.y, cut.depth.z};
    check(pliant_data_cut(&model, data, static_cast<int32_t>(cut.points.size()), points.data(), depth, report));
}

} // namespace pliant_ros
