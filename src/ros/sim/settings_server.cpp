#include "ros/sim/settings_server.h"

#include "pliant/ros/convert.h"

#include <dynamic_reconfigure/ConfigDescription.h>
#include <ros/master.h>
#include <ros/this_node.h>

#include <algorithm>
#include <cmath>

namespace pliant_ros {

namespace {

/* One numeric setting. option is NULL for a setting of the node instead of the scene; its parameter has the name with a
 * slash. */
struct Entry {
    const char *name;
    const char *option;
    double *(*real)(RuntimeSettings *);
    int32_t *(*whole)(RuntimeSettings *);
    const char *text; /* overrides the option's description */
};

const Entry entries[] = {
    {"gravity_x", "model/gravity", [](RuntimeSettings *s) { return &s->gravity[0]; }, nullptr, nullptr},
    {"gravity_y", "model/gravity", [](RuntimeSettings *s) { return &s->gravity[1]; }, nullptr, nullptr},
    {"gravity_z", "model/gravity", [](RuntimeSettings *s) { return &s->gravity[2]; }, nullptr, nullptr},
    {"grasp_stiffness", "grasp/stiffness", [](RuntimeSettings *s) { return &s->stiffness; }, nullptr, nullptr},
    {"grasp_damping", "grasp/damping", [](RuntimeSettings *s) { return &s->damping; }, nullptr, nullptr},
    {"solver_iterations", "solver/iterations", nullptr, [](RuntimeSettings *s) { return &s->iterations; }, nullptr},
    {"solver_tolerance", "solver/tolerance", [](RuntimeSettings *s) { return &s->tolerance; }, nullptr, nullptr},
    {"warp_rate", "warp/rate", [](RuntimeSettings *s) { return &s->warp_rate; }, nullptr, nullptr},
    {"mesh_rate", "output/mesh_rate", [](RuntimeSettings *s) { return &s->mesh_rate; }, nullptr, nullptr},
    {"slice_rate", "output/slice_rate", [](RuntimeSettings *s) { return &s->slice_rate; }, nullptr, nullptr},
    {"slice_axial", nullptr, [](RuntimeSettings *s) { return &s->slice[AXIAL]; }, nullptr,
     "where the axial slice lies: 0 at the feet, 1 at the head"},
    {"slice_coronal", nullptr, [](RuntimeSettings *s) { return &s->slice[CORONAL]; }, nullptr,
     "where the coronal slice lies: 0 in front, 1 at the back"},
    {"slice_sagittal", nullptr, [](RuntimeSettings *s) { return &s->slice[SAGITTAL]; }, nullptr,
     "where the sagittal slice lies: 0 at the right, 1 at the left of the patient"},
};

/* the only enumeration */
const char *const SCALAR = "scalar", *const SCALAR_OPTION = "output/scalar";
/* the only vector */
const char *const GRAVITY_OPTION = "model/gravity";

struct Range {
    const char *option, *unit, *text;
    double low, high;
};

/* Ranges of all options in the groups above; only entries of numeric options are used. */
const Range ranges[] = {
#define MODEL_RANGE(kind, name, value, low, high, unit, text) {"model/" #name, unit, text, low, high},
#define SOLVER_RANGE(kind, name, value, low, high, unit, text) {"solver/" #name, unit, text, low, high},
#define GRASP_RANGE(kind, name, value, low, high, unit, text) {"grasp/" #name, unit, text, low, high},
#define WARP_RANGE(kind, name, value, low, high, unit, text) {"warp/" #name, unit, text, low, high},
#define OUTPUT_RANGE(kind, name, value, low, high, unit, text) {"output/" #name, unit, text, low, high},
    PLIANT_SCENE_MODEL(MODEL_RANGE) PLIANT_SCENE_SOLVER(SOLVER_RANGE) PLIANT_SCENE_GRASP(GRASP_RANGE)
    PLIANT_SCENE_WARP(WARP_RANGE) PLIANT_SCENE_OUTPUT(OUTPUT_RANGE)
    {nullptr, "", "", 0, 1} /* fractions in [0, 1] of the node's own settings */
};

const Range &range_of(const Entry &entry)
{
    return *std::find_if(std::begin(ranges), std::end(ranges) - 1, [&](const Range &range) {
        return entry.option && std::string(entry.option) == range.option;
    });
}

double value_of(const Entry &entry, RuntimeSettings settings)
{
    return entry.real ? *entry.real(&settings) : *entry.whole(&settings);
}

void set_value(const Entry &entry, double value, RuntimeSettings *settings)
{
    const Range &range = range_of(entry);
    if (!std::isfinite(value)) return;
    value = std::min(std::max(value, range.low), range.high);
    if (entry.real) *entry.real(settings) = value;
    else *entry.whole(settings) = static_cast<int32_t>(value);
}

void append(const Entry &entry, double value, dynamic_reconfigure::Config *config)
{
    if (entry.real) {
        config->doubles.emplace_back();
        config->doubles.back().name = entry.name;
        config->doubles.back().value = value;
    } else {
        config->ints.emplace_back();
        config->ints.back().name = entry.name;
        config->ints.back().value = static_cast<int32_t>(value);
    }
}

/* Store a value on the parameter server under its option's name; a vector is one parameter. */
bool store(const std::string &path, const XmlRpc::XmlRpcValue &value)
{
    XmlRpc::XmlRpcValue request, response, payload;
    request[0] = ros::this_node::getName();
    request[1] = path;
    request[2] = value;
    return ros::master::execute("setParam", request, response, payload, false);
}

std::string path_of(const Entry &entry)
{
    std::string path = entry.option ? entry.option : entry.name;
    if (!entry.option) path[path.find('_')] = '/';
    return path;
}

/* Store only the settings with these paths. */
bool store(const std::string &name, RuntimeSettings settings, const std::set<std::string> &paths)
{
    XmlRpc::XmlRpcValue gravity;
    for (int d = 0; d < 3; ++d) gravity[d] = settings.gravity[d];
    if (paths.count(GRAVITY_OPTION) > 0 && !store(name + "/" + GRAVITY_OPTION, gravity)) return false;
    for (const Entry &entry : entries) {
        const std::string path = path_of(entry);
        if (path == GRAVITY_OPTION || paths.count(path) == 0) continue;
        const double value = value_of(entry, settings);
        if (!store(name + "/" + path,
                   entry.real ? XmlRpc::XmlRpcValue(value) : XmlRpc::XmlRpcValue(static_cast<int>(value))))
            return false;
    }
    return paths.count(SCALAR_OPTION) == 0 ||
           store(name + "/" + SCALAR_OPTION, XmlRpc::XmlRpcValue(scalar_name(settings.scalar)));
}

void append_scalar(pliant_scalar scalar, dynamic_reconfigure::Config *config)
{
    config->strs.emplace_back();
    config->strs.back().name = SCALAR;
    config->strs.back().value = scalar_name(scalar);
}

/* Describe the enumeration as rqt_reconfigure expects it: a Python dictionary as text. */
dynamic_reconfigure::ParamDescription describe_scalar()
{
    dynamic_reconfigure::ParamDescription out;
    out.name = SCALAR;
    out.type = "str";
    for (const Range &range : ranges)
        if (range.option && std::string(range.option) == SCALAR_OPTION) out.description = range.text;
    for (const char *name : {
#define SCALAR_CHOICE(value, name) #name,
             PLIANT_SCALAR_LIST(SCALAR_CHOICE)
#undef SCALAR_CHOICE
         })
        out.edit_method += std::string(out.edit_method.empty() ? "{'enum': [" : ", ") + "{'name': '" + name +
                           "', 'type': 'str', 'value': '" + name + "', 'description': ''}";
    out.edit_method += "], 'enum_description': ''}";
    return out;
}

void append_group(dynamic_reconfigure::Config *config)
{
    config->groups.emplace_back();
    config->groups.back().name = "Default";
    config->groups.back().state = true;
}

dynamic_reconfigure::ConfigDescription describe(const RuntimeSettings &settings)
{
    dynamic_reconfigure::ConfigDescription out;
    out.groups.emplace_back();
    out.groups.back().name = "Default";
    for (const Entry &entry : entries) {
        const Range &range = range_of(entry);
        dynamic_reconfigure::ParamDescription parameter;
        parameter.name = entry.name;
        parameter.type = entry.real ? "double" : "int";
        parameter.description = entry.text ? entry.text : range.text;
        if (*range.unit) parameter.description += std::string(" [") + range.unit + "]";
        out.groups.back().parameters.push_back(parameter);
        append(entry, range.low, &out.min);
        append(entry, range.high, &out.max);
        append(entry, value_of(entry, settings), &out.dflt);
    }
    out.groups.back().parameters.push_back(describe_scalar());
    for (dynamic_reconfigure::Config *config : {&out.min, &out.max, &out.dflt}) {
        append_scalar(settings.scalar, config);
        append_group(config);
    }
    return out;
}

dynamic_reconfigure::Config config_of(const RuntimeSettings &settings)
{
    dynamic_reconfigure::Config out;
    for (const Entry &entry : entries) append(entry, value_of(entry, settings), &out);
    append_scalar(settings.scalar, &out);
    append_group(&out);
    return out;
}

void take(const pliant_scene &scene, RuntimeSettings *out)
{
    std::copy(scene.model.gravity, scene.model.gravity + 3, out->gravity);
    out->stiffness = scene.grasp.stiffness;
    out->damping = scene.grasp.damping;
    out->iterations = scene.solver.iterations;
    out->tolerance = scene.solver.tolerance;
    out->warp_rate = scene.warp.rate;
    out->mesh_rate = scene.output.mesh_rate;
    out->slice_rate = scene.output.slice_rate;
    out->scalar = scene.output.scalar;
}

} // namespace

SettingsServer::SettingsServer(ros::NodeHandle handle, const Parameters &parameters) : name_(handle.getNamespace())
{
    take(parameters.scene, &settings_);
    std::copy(parameters.slice, parameters.slice + 3, settings_.slice);
    descriptions_ = handle.advertise<dynamic_reconfigure::ConfigDescription>("parameter_descriptions", 1, true);
    updates_ = handle.advertise<dynamic_reconfigure::Config>("parameter_updates", 1, true);
    descriptions_.publish(describe(settings_));
    publish();
    service_ = handle.advertiseService("set_parameters", &SettingsServer::serve, this);
    storer_ = std::thread(&SettingsServer::store_settings, this);
}

SettingsServer::~SettingsServer()
{
    service_.shutdown(); /* stop the service before the members that it uses */
    {
        std::lock_guard<std::mutex> hold(lock_);
        stopping_ = true;
    }
    changed_.notify_all();
    storer_.join();
}

void SettingsServer::store_settings()
{
    const std::chrono::seconds patience(1);
    std::unique_lock<std::mutex> hold(lock_);
    while (!stopping_) {
        changed_.wait(hold, [this] { return has_unstored_settings_ || stopping_; });
        if (stopping_) return;
        has_unstored_settings_ = false;
        const RuntimeSettings settings = settings_;
        const std::set<std::string> set = set_;
        hold.unlock();
        const bool stored = store(name_, settings, set);
        hold.lock();
        if (stored) continue;
        has_unstored_settings_ = true;
        changed_.wait_for(hold, patience, [this] { return stopping_; });
    }
}

void SettingsServer::store_all_settings()
{
    std::lock_guard<std::mutex> hold(lock_);
    has_unstored_settings_ = true;
    changed_.notify_all();
}

bool SettingsServer::serve(Reconfigure::Request &request, Reconfigure::Response &response)
{
    std::lock_guard<std::mutex> hold(lock_);
    const RuntimeSettings before = settings_;
    for (const Entry &entry : entries) {
        for (const auto &number : request.config.doubles)
            if (number.name == entry.name) set_value(entry, number.value, &settings_);
        for (const auto &number : request.config.ints)
            if (number.name == entry.name) set_value(entry, number.value, &settings_);
        if (value_of(entry, settings_) != value_of(entry, before)) set_.insert(path_of(entry));
    }
    for (const auto &choice : request.config.strs) {
        pliant_scene scene;
        pliant_scene_defaults(&scene);
        if (choice.name != SCALAR) continue;
        if (pliant_scene_set(&scene, SCALAR_OPTION, choice.value.c_str()) == PLIANT_OK)
            settings_.scalar = scene.output.scalar;
        else ROS_WARN("scalar: %s", pliant_last_error());
    }
    if (settings_.scalar != before.scalar) set_.insert(SCALAR_OPTION);
    response.config = config_of(settings_);
    publish();
    return true;
}

void SettingsServer::set_change_callback(std::function<void(const RuntimeSettings &)> print_summary)
{
    std::lock_guard<std::mutex> hold(lock_);
    change_callback_ = std::move(print_summary);
}

void SettingsServer::publish()
{
    updates_.publish(config_of(settings_));
    has_unstored_settings_ = true;
    changed_.notify_all();
    if (change_callback_) change_callback_(settings_);
}

RuntimeSettings SettingsServer::get() const
{
    std::lock_guard<std::mutex> hold(lock_);
    return settings_;
}

void SettingsServer::assign(const pliant_scene &scene)
{
    std::lock_guard<std::mutex> hold(lock_);
    take(scene, &settings_);
    publish();
}

void SettingsServer::restore_settings(const pliant_scene &start, const pliant_scene &last)
{
    std::lock_guard<std::mutex> hold(lock_);
    RuntimeSettings began = settings_, ended = settings_;
    take(start, &began);
    take(last, &ended);
    for (const Entry &entry : entries)
        if (value_of(entry, began) == value_of(entry, settings_)) set_value(entry, value_of(entry, ended), &settings_);
    if (began.scalar == settings_.scalar) settings_.scalar = ended.scalar;
    publish();
}

void SettingsServer::apply(pliant_scene *scene) const
{
    RuntimeSettings settings = get();
    std::copy(settings.gravity, settings.gravity + 3, scene->model.gravity);
    scene->grasp.stiffness = settings.stiffness;
    scene->grasp.damping = settings.damping;
    scene->solver.iterations = settings.iterations;
    scene->solver.tolerance = settings.tolerance;
    scene->warp.rate = settings.warp_rate;
    scene->output.mesh_rate = settings.mesh_rate;
    scene->output.slice_rate = settings.slice_rate;
    scene->output.scalar = settings.scalar;
}

} // namespace pliant_ros
