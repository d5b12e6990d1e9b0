#include "ros/sim/stepping.h"
#include "contact/shapes/tool_shape.h"

#include <algorithm>
#include <cstring>

namespace pliant_ros {

namespace {

void apply_settings(const Step &step, pliant_data *data)
{
    pliant_data_set_limits(data, step.iterations, step.tolerance);
    double gravity[3];
    pliant_data_get_gravity(data, gravity);
    if (!std::equal(gravity, gravity + 3, step.gravity.begin())) pliant_data_set_gravity(data, step.gravity.data());
    for (int tool = 0; tool < pliant_data_get_num_tools(data); ++tool)
        pliant_tool_set_spring(data, tool, step.stiffness, step.damping);
}

void apply_tool(const pliant_model &model, const ToolInput &input, pliant_data *data, int tool)
{
    if (!input.present || pliant_tool_set_pose(data, tool, input.tip.data(), input.rotation.data()) < 0) {
        if (tool_state(*data, tool).present) pliant_tool_remove_pose(data, tool);
        return;
    }
    pliant_tool_set_jaw(data, tool, input.jaw);
    if (input.closes) pliant_tool_grasp(&model, data, tool, nullptr);
    if (!input.closed && tool_state(*data, tool).holding) pliant_tool_release(data, tool);
    if (input.cuts != tool_state(*data, tool).cutting) pliant_tool_set_cutting(data, tool, input.cuts);
}

/* Compute FNV-1a over 64-bit words. */
uint64_t checksum(const double *values, size_t count)
{
    uint64_t sum = 0xcbf29ce484222325u, bits;
    for (size_t i = 0; i < count; ++i) {
        std::memcpy(&bits, values + i, sizeof bits);
        sum = (sum ^ bits) * 0x100000001b3u;
    }
    return sum;
}

} // namespace

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

void apply_shape(const ToolInput &input, pliant_data *data, int tool)
{
    Shape shape;
    read_shape(input, &shape);
    check(pliant_tool_set_shape(data, tool, &shape));
}

} // namespace

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

pliant_status make_step(const pliant_model &model, pliant_data *data, pliant_background_kind kind, const Step &step)
{
    if (static_cast<int>(step.tools.size()) != pliant_data_get_num_tools(data))
        throw Failure(PLIANT_ERROR_ARGUMENT, "the step has " + std::to_string(step.tools.size()) +
                                                 " tools, but the simulation has " +
                                                 std::to_string(pliant_data_get_num_tools(data)));
    apply_settings(step, data);
    for (size_t i = 0; i < step.tools.size(); ++i) {
        if (step.tools[i].exchanged) apply_shape(step.tools[i], data, static_cast<int>(i));
        apply_tool(model, step.tools[i], data, static_cast<int>(i));
    }
    if (step.paused) return PLIANT_OK;
    check(pliant_data_set_background(data, kind, kind == PLIANT_BACKGROUND_PRESCRIBED ? step.background : 0));
    return pliant_step(&model, data);
}

void set_step_outcome(pliant_status status, const pliant_data &data, Step *out)
{
    const pliant_statistics &statistics = *pliant_data_get_statistics(&data);
    out->status = status;
    out->step = statistics.step;
    out->background = out->paused ? 0 : pliant_data_get_background_taken(&data);
    out->checksum = checksum(pliant_data_get_positions(&data, nullptr),
                             3 * static_cast<size_t>(pliant_data_get_body(&data)->fine.num_nodes));
    out->evaluations = static_cast<uint32_t>(statistics.iterations);
    out->legs = static_cast<uint32_t>(statistics.legs);
    out->seconds.assign(statistics.seconds, statistics.seconds + PLIANT_NUM_STEP_STAGES);
}

} // namespace pliant_ros
