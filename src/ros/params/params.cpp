#include "ros/params/params.h"

#include "scene/scene.h"

#include <XmlRpcException.h>

#include <algorithm>
#include <cctype>
#include <cmath>
#include <cstdio>
#include <cstring>
#include <sstream>
#include <stdexcept>

namespace pliant_ros {

namespace {

using XmlRpc::XmlRpcValue;

const char *const node_names[] = {
    "scene",          "scan",        "scan/path",        "scan_root",         "output_root",        "parent_frame",
    "tissue_frame",   "tissue_pose", "registration",     "hand_eye",          "checkpoint",         "checkpoint_period",
    "background",     "tools",       "tool_max_age",     "tool_hold",         "tool_max_pause",     "jaw_close",
    "jaw_release",    "pose_filter", "wrench_rate",      "wrench_bound",      "slice/axial",        "slice/coronal",
    "slice/sagittal", "cameras",     "volume_threshold", "volume_region/low", "volume_region/high", "preview_step",
    "respawn"};

[[noreturn]] void refuse(const std::string &message) { throw std::invalid_argument(message); }

bool is_number(const XmlRpcValue &value)
{
    return value.getType() == XmlRpcValue::TypeDouble || value.getType() == XmlRpcValue::TypeInt;
}

double number(const std::string &name, XmlRpcValue &value, double low, double high)
{
    if (!is_number(value)) refuse("~" + name + " must be a number");
    double x = value.getType() == XmlRpcValue::TypeInt ? static_cast<int>(value) : static_cast<double>(value);
    if (!(x >= low && x <= high))
        refuse("~" + name + " is " + std::to_string(x) + "; it must be from " + std::to_string(low) + " to " +
               std::to_string(high));
    return x;
}

/* 0: no limit */
double read_rate(const std::string &name, XmlRpcValue &value)
{
    const double rate = number(name, value, 0, 10000);
    if (rate > 0 && rate < 1) refuse("~" + name + " is " + std::to_string(rate) + "; it must be 0 or from 1 to 10000");
    return rate;
}

std::string text(const std::string &name, XmlRpcValue &value)
{
    if (value.getType() != XmlRpcValue::TypeString) refuse("~" + name + " must be text");
    return value;
}

/* Return an option value as text for pliant_scene_set. */
std::string option_text(const std::string &name, XmlRpcValue &value)
{
    char digits[40];
    switch (value.getType()) {
    case XmlRpcValue::TypeBoolean: return static_cast<bool>(value) ? "true" : "false";
    case XmlRpcValue::TypeInt: return std::to_string(static_cast<int>(value));
    case XmlRpcValue::TypeDouble:
        std::snprintf(digits, sizeof digits, "%.17g", static_cast<double>(value));
        return digits;
    case XmlRpcValue::TypeString: return value;
    case XmlRpcValue::TypeArray: {
        std::string list;
        for (int i = 0; i < value.size(); ++i) {
            if (!is_number(value[i])) refuse("~" + name + " must be a list of numbers");
            list += (i ? " " : "") + option_text(name, value[i]);
        }
        return list;
    }
    default: refuse("~" + name + " has a type that no option has");
    }
}

size_t edit_distance(const std::string &a, const std::string &b)
{
    std::vector<size_t> row(b.size() + 1);
    for (size_t j = 0; j <= b.size(); ++j) row[j] = j;
    for (size_t i = 1; i <= a.size(); ++i) {
        size_t diagonal = row[0];
        row[0] = i;
        for (size_t j = 1; j <= b.size(); ++j) {
            size_t above = row[j];
            row[j] = std::min({above + 1, row[j - 1] + 1, diagonal + (a[i - 1] != b[j - 1])});
            diagonal = above;
        }
    }
    return row[b.size()];
}

std::string nearest(const std::string &name)
{
    std::vector<std::string> known(std::begin(node_names), std::end(node_names));
    size_t count;
    const pliant_option_info *options = pliant_scene_options(&count);
    for (size_t i = 0; i < count; ++i) known.push_back(std::string(options[i].group) + "/" + options[i].name);
    return *std::min_element(known.begin(), known.end(), [&](const std::string &a, const std::string &b) {
        return edit_distance(name, a) < edit_distance(name, b);
    });
}

bool is_option(const std::string &name)
{
    size_t count;
    const pliant_option_info *options = pliant_scene_options(&count);
    return std::any_of(options, options + count, [&](const pliant_option_info &option) {
        return name == std::string(option.group) + "/" + option.name;
    });
}

/* Check a ROS graph name without slashes, which becomes part of topic names. */
void check_name(const std::string &of, const std::string &what, const std::string &name)
{
    bool good = !name.empty() && name.size() < sizeof(pliant_tool_state::name) &&
                std::isalpha(static_cast<unsigned char>(name[0])) &&
                std::all_of(name.begin(), name.end(), [](unsigned char c) { return std::isalnum(c) || c == '_'; });
    if (!good)
        refuse("~" + of + ": \"" + name + "\" is not a valid name of a " + what +
               ": use at most 47 letters, digits and _, with a letter first");
}

/* Read a list, or text such as "PSM1 PSM2" from a launch argument. */
std::vector<std::string> read_names(const std::string &of, XmlRpcValue &value)
{
    std::vector<std::string> names;
    if (value.getType() == XmlRpcValue::TypeString) {
        std::string all = value, name;
        for (char c : all + " ") {
            if (c != ' ' && c != ',') name += c;
            else if (!name.empty()) names.push_back(name), name.clear();
        }
    } else if (value.getType() == XmlRpcValue::TypeArray) {
        for (int i = 0; i < value.size(); ++i) names.push_back(text(of, value[i]));
    } else refuse("~" + of + " must be a list of names");
    return names;
}

void read_tools(XmlRpcValue &value, Parameters *out)
{
    const std::vector<std::string> names = read_names("tools", value);
    if (names.size() > PLIANT_MAX_TOOLS) refuse("~tools: at most " + std::to_string(PLIANT_MAX_TOOLS) + " tools");
    out->tools.clear();
    for (const std::string &name : names) {
        check_name("tools", "tool", name);
        for (const ToolParameters &other : out->tools)
            if (other.name == name) refuse("~tools: " + name + " is named twice");
        out->tools.push_back(ToolParameters{name, true, "", false, {}, {}, {}, {}, false});
    }
}

void read_point(const std::string &name, XmlRpcValue &value, double out[3], double maximum = 1)
{
    if (value.getType() != XmlRpcValue::TypeArray || value.size() != 3)
        refuse("~" + name + " must be three numbers [m]");
    for (int d = 0; d < 3; ++d) out[d] = number(name, value[d], -maximum, maximum);
}

/* Read a blade's name, or its edge {from: [x, y, z], to: [x, y, z]}. */
void read_blade(const std::string &name, XmlRpcValue &value, ToolParameters *tool)
{
    if (value.getType() == XmlRpcValue::TypeString) {
        if (pliant_blade_find(text(name, value).c_str(), tool->blade_from, tool->blade_to) < 0)
            refuse("~" + name + ": " + pliant_last_error());
        return;
    }
    if (value.getType() != XmlRpcValue::TypeStruct || value.size() != 2 || !value.hasMember("from") ||
        !value.hasMember("to"))
        refuse("~" + name +
               " must be the name of a blade, or {from: [x, y, z], to: [x, y, z]}, its edge in the tool's frame [m]");
    read_point(name + "/from", value["from"], tool->blade_from);
    read_point(name + "/to", value["to"], tool->blade_to);
    if (!tool->has_blade()) refuse("~" + name + ": from and to are the same point: no edge");
}

/* Read a tool shape: a name, a YAML file, or "tool_type" to follow the topic tool_type. */
void read_shape(const std::string &name, XmlRpcValue &value, ToolParameters *tool)
{
    const std::string what = text(name, value);
    if ((tool->shape_follows = what == "tool_type")) return;
    const bool file = what.find('/') != std::string::npos || what.find(".yaml") != std::string::npos ||
                      what.find(".yml") != std::string::npos;
    const pliant_status status =
        file ? pliant_tool_shape_read(what.c_str(), &tool->shape) : pliant_tool_shape_find(what.c_str(), &tool->shape);
    if (status < 0) refuse("~" + name + ": " + pliant_last_error());
    tool->solids = std::shared_ptr<pliant_tool_shape>(new pliant_tool_shape(tool->shape), [](pliant_tool_shape *shape) {
        pliant_tool_shape_free(shape);
        delete shape;
    });
}

void read_tool(const std::string &name, XmlRpcValue &value, Parameters *out)
{
    for (ToolParameters &tool : out->tools) {
        if (tool.name != name) continue;
        if (value.getType() != XmlRpcValue::TypeStruct)
            refuse("~tool/" + name + " must hold mode, blade, frame or jaw");
        for (auto &entry : value) {
            std::string path = "tool/" + name + "/" + entry.first;
            if (entry.first == "blade") {
                read_blade(path, entry.second, &tool);
                continue;
            }
            if (entry.first == "shape") {
                read_shape(path, entry.second, &tool);
                continue;
            }
            if (entry.first == "frame") {
                tool.frame = text(path, entry.second);
                continue;
            }
            if (entry.first == "jaw") {
                const std::string kind = text(path, entry.second);
                if (kind != "measured" && kind != "setpoint")
                    refuse("~" + path + " is " + kind + "; it must be measured or setpoint");
                tool.jaw_setpoint = kind == "setpoint";
                continue;
            }
            if (entry.first != "mode") refuse("~" + path + " is unknown; did you mean ~tool/" + name + "/mode?");
            std::string mode = text(path, entry.second);
            if (mode != "probe" && mode != "grasp") refuse("~" + path + " is " + mode + "; it must be probe or grasp");
            tool.grasps = mode == "grasp";
        }
        /* a cutting tool grasps only if `mode` requests it */
        if (tool.has_blade() && !value.hasMember("mode")) tool.grasps = false;
        return;
    }
    refuse("~tool/" + name + ": no tool of this name is in ~tools");
}

void read_cameras(XmlRpcValue &value, Parameters *out)
{
    for (const std::string &name : read_names("cameras", value)) {
        check_name("cameras", "camera", name);
        for (const CameraParameters &other : out->cameras)
            if (other.name == name) refuse("~cameras: " + name + " is named twice");
        CameraParameters camera;
        camera.name = camera.frame = name;
        out->cameras.push_back(camera);
    }
}

void read_camera_entry(const std::string &path, const std::string &name, XmlRpcValue &value, CameraParameters *camera)
{
    const int max_pixels = 8192;
    if (name == "frame") camera->frame = text(path, value);
    else if (name == "info_url") camera->info_url = text(path, value);
    else if (name == "width") camera->width = static_cast<int>(number(path, value, 1, max_pixels));
    else if (name == "height") camera->height = static_cast<int>(number(path, value, 1, max_pixels));
    else if (name == "field_of_view") camera->field_of_view = number(path, value, 0.1, 170);
    else if (name == "rate") camera->rate = number(path, value, 0.01, 1000);
    else if (name == "near") camera->near = number(path, value, 0, 1e3);
    else if (name == "far") camera->far = number(path, value, 0, 1e3);
    else if (name == "baseline") camera->baseline = number(path, value, 0, 1);
    else if (name == "threshold") camera->threshold = number(path, value, -1e9, 1e9);
    else if (name == "shown") camera->shown = read_names(path, value);
    else if (name == "convention") {
        const std::string kind = text(path, value);
        if (kind != "optical" && kind != "ambf") refuse("~" + path + " is " + kind + "; it must be optical or ambf");
        camera->ambf = kind == "ambf";
    } else
        refuse(
            "~" + path +
            " is unknown: a camera has frame, convention, width, height, field_of_view, rate, near, far, baseline, "
            "threshold, shown, info_url");
}

void read_camera(const std::string &name, XmlRpcValue &value, Parameters *out)
{
    for (CameraParameters &camera : out->cameras) {
        if (camera.name != name) continue;
        if (value.getType() != XmlRpcValue::TypeStruct)
            refuse("~camera/" + name + " must hold parameters such as frame, width, height or field_of_view");
        for (auto &entry : value)
            read_camera_entry("camera/" + name + "/" + entry.first, entry.first, entry.second, &camera);
        if (camera.far > 0 && camera.far <= camera.near)
            refuse("~camera/" + name + ": far must be more than near, or 0");
        if (camera.frame.empty() || camera.frame[0] == '/')
            refuse("~camera/" + name + "/frame: tf2 does not accept a leading slash; remove it");
        return;
    }
    refuse("~camera/" + name + ": no camera of this name is in ~cameras");
}

/* Read "x y z qx qy qz qw" or a list of the seven numbers. */
Rigid read_pose(const std::string &name, XmlRpcValue &value)
{
    std::string list = option_text(name, value);
    double n[7];
    int end = 0;
    bool good = std::sscanf(list.c_str(), "%lf %lf %lf %lf %lf %lf %lf %n", &n[0], &n[1], &n[2], &n[3], &n[4], &n[5],
                            &n[6], &end) == 7 &&
                static_cast<size_t>(end) == list.size();
    geometry_msgs::Pose pose;
    Rigid out;
    std::string why = "it must be seven numbers: x y z qx qy qz qw";
    if (good) {
        pose.position.x = n[0], pose.position.y = n[1], pose.position.z = n[2];
        pose.orientation.x = n[3], pose.orientation.y = n[4], pose.orientation.z = n[5], pose.orientation.w = n[6];
        good = rigid_from_message(pose, &out, &why);
    }
    if (!good) refuse("~" + name + ": " + why);
    return out;
}

pliant_background_kind read_background(XmlRpcValue &value)
{
    std::string kind = text("background", value);
    if (kind != "live" && kind != "planned") refuse("~background is " + kind + "; it must be live or planned");
    return kind == "live" ? PLIANT_BACKGROUND_LIVE : PLIANT_BACKGROUND_PLANNED;
}

/* Read "FRAME=FILE ...". The files are opened later. */
std::string read_hand_eye(const std::string &name, XmlRpcValue &value)
{
    const std::string out = text(name, value);
    std::istringstream words(out);
    for (std::string word; words >> word;) {
        const size_t sign = word.find('=');
        if (sign == std::string::npos || sign == 0 || sign + 1 == word.size())
            refuse("~" + name + ": " + word +
                   ": expected FRAME=FILE, such as PSM1_base=/data/PSM1-registration-open-cv.json");
    }
    return out;
}

bool read_node_parameter(const std::string &name, XmlRpcValue &value, Parameters *out)
{
    static const char *const planes[] = {"slice/axial", "slice/coronal", "slice/sagittal"};
    /* ~scan is a path or the group of the scan's options */
    bool is_group = value.getType() == XmlRpcValue::TypeStruct;
    if ((name == "scan" && !is_group) || name == "scan/path") out->scan = text(name, value);
    else if (name == "scan_root") out->scan_root = text(name, value);
    else if (name == "output_root") out->output_root = text(name, value);
    else if (name == "parent_frame") out->parent_frame = text(name, value);
    else if (name == "tissue_frame") out->tissue_frame = text(name, value);
    else if (name == "tissue_pose") out->tissue_pose = read_pose(name, value);
    else if (name == "registration") out->registration = text(name, value);
    else if (name == "hand_eye") out->hand_eye = read_hand_eye(name, value);
    else if (name == "checkpoint") out->checkpoint = text(name, value);
    else if (name == "checkpoint_period") out->checkpoint_period = number(name, value, 0.05, 3600);
    else if (name == "background") out->background = read_background(value);
    else if (name == "tool_max_age") out->tool_max_age = number(name, value, 1e-3, 10);
    else if (name == "tool_hold") out->tool_hold = number(name, value, 0, 10);
    else if (name == "tool_max_pause") out->tool_max_pause = number(name, value, 1e-3, 3600);
    else if (name == "jaw_close") out->jaw_close = number(name, value, -M_PI, M_PI);
    else if (name == "jaw_release") out->jaw_release = number(name, value, -M_PI, M_PI);
    else if (name == "pose_filter") out->pose_filter = number(name, value, 0, 1000);
    else if (name == "wrench_rate") out->wrench_rate = read_rate(name, value);
    else if (name == "wrench_bound") out->wrench_bound = number(name, value, 1e-3, 1000);
    else if (name == "volume_threshold") out->volume_threshold = number(name, value, 0, 1e9);
    else if (name == "volume_region/low") read_point(name, value, out->volume_low, 100);
    else if (name == "volume_region/high") read_point(name, value, out->volume_high, 100);
    else if (name == "preview_step") out->preview_step = static_cast<int>(number(name, value, 2, 8));
    else if (name == "scene" || name == "tools" || name == "cameras") return true; /* read before all others */
    else if (name == "respawn") { /* used by the program, not by the node */
        if (value.getType() != XmlRpcValue::TypeBoolean) refuse("~respawn must be true or false");
    }
    else {
        for (int plane = 0; plane < 3; ++plane)
            if (name == planes[plane]) {
                out->slice[plane] = number(name, value, 0, 1);
                return true;
            }
        return false;
    }
    return true;
}

void read_one(const std::string &name, XmlRpcValue &value, Parameters *out)
{
    if (read_node_parameter(name, value, out)) return;
    if (value.getType() == XmlRpcValue::TypeStruct && !is_option(name) && name.find('/') == std::string::npos) {
        for (auto &entry : value) {
            if (name == "tool") read_tool(entry.first, entry.second, out);
            else if (name == "camera") read_camera(entry.first, entry.second, out);
            else read_one(name + "/" + entry.first, entry.second, out);
        }
        return;
    }
    if (const char *removed = pliant_scene_removed_option(name.c_str())) refuse("~" + name + ": " + removed);
    if (!is_option(name)) refuse("~" + name + " is unknown; did you mean ~" + nearest(name) + "?");
    if (pliant_scene_set(&out->scene, name.c_str(), option_text(name, value).c_str()) < 0)
        refuse("~" + name + ": " + pliant_last_error());
}

void set_defaults(Parameters *out)
{
    pliant_scene_defaults(&out->scene);
    out->scan = "phantom";
    out->tissue_frame = "tissue";
    out->tissue_pose = identity();
    out->background = PLIANT_BACKGROUND_LIVE;
    out->checkpoint_period = 1;
    out->tool_max_age = 0.05;
    out->tool_hold = 0.1;
    out->tool_max_pause = 1;
    out->jaw_close = 0.05;
    out->jaw_release = 0.20;
    out->pose_filter = 0;
    out->wrench_rate = 0;
    out->wrench_bound = 5;
    std::fill(out->slice, out->slice + 3, 0.5);
    out->volume_threshold = NAN;
    std::fill(out->volume_low, out->volume_low + 3, -INFINITY);
    std::fill(out->volume_high, out->volume_high + 3, INFINITY);
    out->preview_step = 4;
}

void check_region(const Parameters &parameters)
{
    for (int d = 0; d < 3; ++d)
        if (!(parameters.volume_low[d] < parameters.volume_high[d]))
            refuse("~volume_region: low must be below high along every axis");
}

void check_frames(const Parameters &parameters)
{
    for (const std::string *frame : {&parameters.tissue_frame, &parameters.parent_frame})
        if (!frame->empty() && (*frame)[0] == '/')
            refuse("frame " + *frame + ": tf2 does not accept a leading slash; remove it");
    if (parameters.tissue_frame.empty()) refuse("~tissue_frame is empty");
    if (parameters.parent_frame == parameters.tissue_frame)
        refuse("~parent_frame and ~tissue_frame are the same; use two names");
}

} // namespace

bool read_parameters(XmlRpcValue tree, Parameters *out, std::string *why)
{
    try {
        Parameters read;
        set_defaults(&read);
        if (tree.getType() == XmlRpcValue::TypeStruct) {
            if (tree.hasMember("scene")) {
                std::string file = text("scene", tree["scene"]);
                if (!file.empty() && pliant_scene_read(file.c_str(), &read.scene) < 0)
                    refuse(std::string("~scene: ") + pliant_last_error());
            }
            if (tree.hasMember("tools")) read_tools(tree["tools"], &read);
            if (tree.hasMember("cameras")) read_cameras(tree["cameras"], &read);
            for (auto &entry : tree) read_one(entry.first, entry.second, &read);
        }
        for (const ToolParameters &tool : read.tools)
            if (tool.shape.num_parts > 0 || tool.shape_follows) pliant_scene_for_shapes(&read.scene);
        if (pliant_scene_check(&read.scene) < 0) refuse(pliant_last_error());
        if (!(read.jaw_close < read.jaw_release)) refuse("~jaw_close must be less than ~jaw_release");
        check_frames(read);
        check_region(read);
        *out = read;
        return true;
    } catch (const std::invalid_argument &refused) {
        *why = refused.what();
    } catch (const XmlRpc::XmlRpcException &broken) {
        *why = "parameters: " + broken.getMessage();
    }
    return false;
}

} // namespace pliant_ros
