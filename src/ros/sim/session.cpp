#include "ros/sim/session.h"

#include "material/material.h"
#include "pliant/ros/convert.h"
#include "scene/scene.h"

#include <algorithm>
#include <unistd.h>

namespace pliant_ros {

namespace {

pliant_scene with_threads(const pliant_scene &scene)
{
    pliant_scene out = scene;
    out.solver.threads = threads_of(scene);
    return out;
}

std::string materials_text(const pliant_material_table &table)
{
    std::string text(pliant_material_table_text(&table, 0, nullptr), '\0');
    pliant_material_table_text(&table, text.size() + 1, &text[0]);
    return text;
}

bool is_there(const std::string &path) { return path.compare(0, 7, "phantom") == 0 || access(path.c_str(), R_OK) == 0; }

std::string folder_with_slash(const std::string &path) { return path.substr(0, path.find_last_of('/') + 1); }
std::string name_of(const std::string &path) { return path.substr(path.find_last_of('/') + 1); }

bool fits(const Scan &scan, const Session &session)
{
    return scan.checksum == session.scan_checksum && scan.labels_checksum == session.labels_checksum &&
           is_id_of(session.scan_id, scan);
}

} // namespace

std::string scene_text(const pliant_scene &scene)
{
    std::string text(pliant_scene_text(&scene, 0, nullptr), '\0');
    pliant_scene_text(&scene, text.size() + 1, &text[0]);
    return text;
}

pliant_scene scene_of(const std::string &text)
{
    pliant_scene scene;
    check(pliant_scene_parse(text.c_str(), "the recorded scene", nullptr, &scene));
    return scene;
}

void session_message(const LoadedModel &loaded, Session *out)
{
    out->load = loaded.revision;
    out->scan = loaded.scan->path;
    out->scan_id = loaded.scan->volume.id;
    out->scan_checksum = loaded.scan->checksum;
    out->labels = loaded.requested.material.labels;
    out->labels_checksum = loaded.scan->labels_checksum;
    out->scene = scene_text(with_threads(*pliant_model_get_scene(loaded.model)));
    out->requested_scene = scene_text(loaded.requested);
    out->materials = materials_text(*pliant_model_get_materials(loaded.model));
}

void settings_message(const RuntimeSettings &settings, Session *out)
{
    std::copy(settings.gravity, settings.gravity + 3, out->gravity.begin());
    out->iterations = settings.iterations;
    out->tolerance = settings.tolerance;
    out->stiffness = settings.stiffness;
    out->damping = settings.damping;
    out->warp_rate = settings.warp_rate;
    out->mesh_rate = settings.mesh_rate;
    out->slice_rate = settings.slice_rate;
    out->scalar = scalar_name(settings.scalar);
}

void apply_settings(const Session &session, pliant_scene *scene)
{
    std::copy(session.gravity.begin(), session.gravity.end(), scene->model.gravity);
    scene->solver.iterations = session.iterations;
    scene->solver.tolerance = session.tolerance;
    scene->grasp.stiffness = session.stiffness;
    scene->grasp.damping = session.damping;
    scene->warp.rate = session.warp_rate;
    scene->output.mesh_rate = session.mesh_rate;
    scene->output.slice_rate = session.slice_rate;
    if (!session.scalar.empty()) check(pliant_scene_set(scene, "output/scalar", session.scalar.c_str()));
}

bool same_model(const Session &a, const Session &b)
{
    return a.scene == b.scene && a.materials == b.materials && a.scan_checksum == b.scan_checksum &&
           a.labels_checksum == b.labels_checksum;
}

std::vector<std::string> RecordedScanFinder::places(const std::string &named, const std::string &recorded) const
{
    std::vector<std::string> out;
    const std::string near = folder_with_slash(named.empty() ? scan_ : named) + name_of(recorded);
    for (const std::string &place : {named, near, recorded})
        if (!place.empty() && is_there(place) && std::find(out.begin(), out.end(), place) == out.end())
            out.push_back(place);
    return out;
}

std::shared_ptr<const Scan> RecordedScanFinder::find(const Session &session)
{
    if (last_ && fits(*last_, session)) return last_;
    last_.reset();
    pliant_scene scene = scene_of(session.scene);
    const std::vector<std::string> scans = places(scan_, session.scan);
    std::vector<std::string> maps{""};
    if (!session.labels.empty() && (maps = places(labels_, session.labels)).empty())
        throw Failure(PLIANT_ERROR_FILE,
                      "the label map of the recording, " + session.labels + ", was not found: give its path");
    std::string candidates;
    for (const std::string &path : scans)
        for (const std::string &map : maps) {
            Materials materials;
            check(pliant_material_table_parse(session.materials.c_str(), "the recorded materials", &materials.table));
            check(pliant_scene_set(&scene, "material/labels", map.c_str()));
            std::shared_ptr<const Scan> scan = read_scan(scene, path, &materials);
            if (fits(*scan, session)) return last_ = scan;
            candidates += (candidates.empty() ? "" : ", ") + path +
                    (scan->checksum == session.scan_checksum ? " with labels " + map : "");
        }
    const std::string recorded = "\"" + session.scan_id + "\" (" + session.scan + ")";
    if (candidates.empty())
        throw Failure(PLIANT_ERROR_FILE, "the scan of the recording, " + recorded + ", was not found: give its path");
    throw Failure(PLIANT_ERROR_FORMAT, "the voxels of " + candidates +
                                           " differ from the voxels of the recording, which uses " + recorded +
                                           ": give the path of the recorded scan");
}

std::shared_ptr<LoadedModel> build_session(const Session &session, std::shared_ptr<const Scan> scan,
                                           pliant_progress progress)
{
    Materials materials;
    check(pliant_material_table_parse(session.materials.c_str(), "the recorded materials", &materials.table));
    std::shared_ptr<LoadedModel> loaded = build(scene_of(session.scene), std::move(scan), materials.table, progress);
    loaded->requested = scene_of(session.requested_scene);
    return loaded;
}

Sessions::Sessions(ros::NodeHandle handle, const std::string &frame)
{
    publisher_ = handle.advertise<Session>("session", 64, true);
    current_.header.frame_id = frame;
}

void Sessions::loaded(const LoadedModel &loaded, const RuntimeSettings &settings)
{
    std::lock_guard<std::mutex> hold(lock_);
    session_message(loaded, &current_);
    settings_message(settings, &current_);
    publish();
}

void Sessions::set(const RuntimeSettings &settings)
{
    std::lock_guard<std::mutex> hold(lock_);
    settings_message(settings, &current_);
    if (current_.load > 0) publish();
}

void Sessions::publish()
{
    current_.header.stamp = ros::Time::now();
    publisher_.publish(current_);
}

Session Sessions::now() const
{
    std::lock_guard<std::mutex> hold(lock_);
    return current_;
}

} // namespace pliant_ros
