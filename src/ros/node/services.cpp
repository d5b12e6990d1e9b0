#include "ros/node/services.h"

#include "base/clock.h"
#include "material/material.h"
#include "ros/node/confine.h"

#include <cmath>
#include <cstdio>
#include <limits>
#include <unistd.h>

namespace pliant_ros {

namespace {

/* one thread waits for long work, one for the end of a step, and one cancels or refuses */
enum { SERVICE_THREADS = 3 };

float seconds_since(double start) { return static_cast<float>(pliant_seconds() - start); }

bool is_phantom(const std::string &path) { return path == "phantom" || path.compare(0, 8, "phantom:") == 0; }

/* Return whether a path has the extension of a mesh file. */
bool is_of_mesh(const std::string &path)
{
    const size_t dot = path.rfind('.');
    const std::string ending = dot == std::string::npos ? "" : path.substr(dot);
    return ending == ".vtu" || ending == ".vtp" || ending == ".ply";
}

std::string size_text(const pliant_model &model)
{
    const pliant_mesh &mesh = pliant_model_get_body(&model)->fine;
    return std::to_string(mesh.num_nodes) + " nodes, " + std::to_string(mesh.num_tets) + " tetrahedra";
}

} // namespace

void Recomputed::take(const RecomputeHomogenization::Request &request)
{
    const uint32_t maximum = std::numeric_limits<int32_t>::max();
    if (!request.method.empty()) method = request.method;
    for (int d = 0; d < 3; ++d)
        if (request.coarse_cells[d] > 0)
            coarse_cells[d] = static_cast<int32_t>(std::min(request.coarse_cells[d], maximum));
    if (request.ratio > 0) ratio = static_cast<int32_t>(std::min(request.ratio, maximum));
}

void Recomputed::apply(pliant_scene *scene) const
{
    if (!method.empty()) check(pliant_scene_set(scene, "model/method", method.c_str()));
    /* Options that a caller sets are not selected automatically. */
    if (!method.empty()) scene->choose.method = false;
    if (ratio > 0) scene->choose.ratio = false;
    for (int d = 0; d < 3; ++d)
        if (coarse_cells[d] > 0) {
            scene->mesh.coarse_cells[d] = coarse_cells[d];
            scene->choose.coarse_cells = false;
        }
    if (ratio > 0) scene->mesh.ratio = ratio;
}

Services::Services(ros::NodeHandle handle, const Parameters &parameters, State *state, SettingsServer *live,
                   Sessions *sessions, Simulation *simulation, MeshOutput *mesh_output, VolumeOutput *volume_output,
                   Registration *registration, std::shared_ptr<const tf2_ros::Buffer> frames)
    : parameters_(parameters), state_(state), work_(state), live_(live), sessions_(sessions), simulation_(simulation),
      mesh_output_(mesh_output), volume_output_(volume_output), registration_(registration), frames_(std::move(frames))
{
    handle.setCallbackQueue(&queue_);
    servers_.push_back(handle.advertiseService("load_scan", &Services::load_scan, this));
    servers_.push_back(handle.advertiseService("recompute_homogenization", &Services::recompute, this));
    servers_.push_back(handle.advertiseService("set_materials", &Services::set_materials, this));
    servers_.push_back(handle.advertiseService("save_volume", &Services::save_volume, this));
    servers_.push_back(handle.advertiseService<SaveVolume::Request, SaveVolume::Response>(
        "save_displacement", [this](auto &request, auto &response) {
            return save_displacement(PLIANT_DISPLACEMENT_RESAMPLE, request, response);
        }));
    servers_.push_back(handle.advertiseService<SaveVolume::Request, SaveVolume::Response>(
        "save_tissue_displacement", [this](auto &request, auto &response) {
            return save_displacement(PLIANT_DISPLACEMENT_TISSUE, request, response);
        }));
    servers_.push_back(handle.advertiseService("pick", &Services::pick, this));
    servers_.push_back(handle.advertiseService("cut", &Services::cut, this));
    servers_.push_back(handle.advertiseService("undo_cut", &Services::undo_cut, this));
    servers_.push_back(handle.advertiseService("reset", &Services::reset, this));
    servers_.push_back(handle.advertiseService("cancel", &Services::cancel, this));
    servers_.push_back(handle.advertiseService("pause", &Services::pause, this));
    spinner_.reset(new ros::AsyncSpinner(SERVICE_THREADS, &queue_));
    spinner_->start();
    first_ = std::thread(&Services::load_first, this);
}

Services::~Services()
{
    work_.stop();
    first_.join();
    spinner_->stop();
    servers_.clear();
}

std::shared_ptr<const LoadedModel> Services::current() const
{
    std::shared_ptr<const LoadedModel> loaded = simulation_->loaded();
    if (!loaded) throw Failure(PLIANT_ERROR_ARGUMENT, "nothing is loaded yet; load_scan comes first");
    return loaded;
}

void Services::install_model(const std::shared_ptr<LoadedModel> &next, bool takes_live)
{
    check_target(*next);
    work_.commit();
    simulation_->swap(next);
    if (takes_live || next->choice.made) live_->assign(*pliant_model_get_scene(next->model));
    publish_loaded_model(*next);
}

void Services::publish_loaded_model(const LoadedModel &next)
{
    sessions_->loaded(next, live_->get());
    state_->set_choice(next.choice);
    mesh_output_->publish_model(next);
}

void Services::keep(Checkpoint *out) const
{
    std::lock_guard<std::mutex> hold(lock_);
    out->start_scan = parameters_.scan;
    out->start_scene = scene_text(parameters_.scene);
    out->start_pose = pose_message(parameters_.tissue_pose);
    out->method = recomputed_.method;
    std::copy(recomputed_.coarse_cells, recomputed_.coarse_cells + 3, out->coarse_cells.begin());
    out->ratio = recomputed_.ratio;
    out->own_materials = materials_.table.num_materials > 0;
}

bool Services::has_same_start_scene(const Checkpoint &rest) const
{
    /* Parameters that may change at run time do not make a scene different. */
    pliant_scene then = scene_of(rest.start_scene);
    live_->apply(&then);
    pliant_scene now = parameters_.scene;
    live_->apply(&now);
    return rest.start_scan == parameters_.scan && scene_text(then) == scene_text(now);
}

/* Restore a checkpoint: cuts, positions, grasps, and settings. */
std::string Services::restore_checkpoint(const CheckpointContents &saved)
{
    if (!has_same_start_scene(saved.rest))
        throw Failure(PLIANT_ERROR_ARGUMENT,
                      "it belongs to a node with another scan or scene (" + saved.rest.start_scan + ")");
    const Session &session = saved.session;
    std::shared_ptr<LoadedModel> next = build_session(session, RecordedScanFinder().find(session), work_.progress());
    check_target(*next);
    const ResumableState moment = resumable_state_of(saved, next);
    pliant_scene live = *pliant_model_get_scene(next->model);
    apply_settings(session, &live);
    work_.commit();
    simulation_->swap(next, &moment); /* no state has changed before this call, so an earlier error has no effect */
    live_->restore_settings(scene_of(saved.rest.start_scene), live);
    if (saved.rest.start_pose == pose_message(parameters_.tissue_pose))
        registration_->restore_pose(saved.rest.parent_frame, saved.rest.tissue_pose);
    publish_loaded_model(*next);
    std::lock_guard<std::mutex> locked(lock_);
    recomputed_.method = saved.rest.method;
    std::copy(saved.rest.coarse_cells.begin(), saved.rest.coarse_cells.end(), recomputed_.coarse_cells);
    recomputed_.ratio = saved.rest.ratio;
    if (saved.rest.own_materials)
        check(pliant_material_table_copy(pliant_model_get_materials(next->model), &materials_.table));
    std::string text = "went on from " + parameters_.checkpoint + ", step " + std::to_string(saved.state.step) + ": " +
                       session.scan + ", " + std::to_string(saved.topology.cut_end.size()) + " cuts";
    for (const std::string &tool : saved.rest.holding) text += ", " + tool + " was holding";
    return text;
}

std::string Services::load_given()
{
    Materials materials;
    std::shared_ptr<const Scan> scan = read_scan(parameters_.scene, parameters_.scan, &materials);
    std::shared_ptr<LoadedModel> next = build_chosen(parameters_.scene, scan, materials.table, work_.progress());
    install_model(next);
    return "loaded " + parameters_.scan + ": " + size_text(*next->model);
}

void Services::load_first()
{
    std::string message;
    auto of_checkpoint = std::make_shared<bool>(false);
    bool good = work_.run("loading " + parameters_.scan, &message, [this, of_checkpoint] {
        const std::string &checkpoint = parameters_.checkpoint;
        if (checkpoint.empty() || access(checkpoint.c_str(), F_OK) != 0) return load_given();
        *of_checkpoint = true;
        std::string why;
        try {
            return restore_checkpoint(read_checkpoint_file(checkpoint));
        } catch (const Failure &failed) {
            if (failed.status == PLIANT_ERROR_CANCELLED) throw;
            why = failed.what();
        } catch (const std::exception &failed) { /* truncated or too large message */
            why = failed.what();
        }
        const std::string aside = checkpoint + ".refused";
        std::rename(checkpoint.c_str(), aside.c_str());
        ROS_ERROR("the checkpoint %s is refused, and kept as %s: %s", checkpoint.c_str(), aside.c_str(), why.c_str());
        return load_given() + "; the checkpoint " + checkpoint + " was refused, and is kept as " + aside + ": " + why;
    });
    if (!good) state_->set(SimState::FAULT, message);
    else if (*of_checkpoint) state_->note(message);
}

std::string Services::allowed(const std::string &path) const
{
    std::string resolved, why;
    if (!confine_existing(parameters_.scan_root, path, &resolved, &why)) throw Failure(PLIANT_ERROR_ARGUMENT, why);
    return resolved;
}

bool Services::load_scan(LoadScan::Request &request, LoadScan::Response &response)
{
    double start = pliant_seconds();
    const auto call = std::make_shared<LoadScan>();
    call->request = request;
    response.success = work_.run("load_scan", &response.message, [this, call] {
        const LoadScan::Request &requested = call->request;
        std::string path = is_phantom(requested.path) ? requested.path : allowed(requested.path);
        std::string labels = requested.labels.empty() ? "" : allowed(requested.labels);
        Materials materials;
        if (materials_.table.num_materials > 0) check(pliant_material_table_copy(&materials_.table, &materials.table));
        pliant_scene scene = parameters_.scene;
        live_->apply(&scene);
        recomputed_.apply(&scene);
        check(pliant_scene_set(&scene, "material/labels", labels.c_str()));
        for (const std::string &option : requested.options) {
            size_t sign = option.find('=');
            if (sign == std::string::npos) throw Failure(PLIANT_ERROR_ARGUMENT, option + ": expected group/name=value");
            std::string name = option.substr(0, sign), value = option.substr(sign + 1);
            for (const char *of_file : {"material/file", "material/labels", "mesh/file", "contact/obstacles"})
                if (name == of_file && !value.empty()) value = allowed(value);
            if (name == "material/file") pliant_material_table_free(&materials.table);
            check(pliant_scene_set(&scene, name.c_str(), value.c_str()));
        }
        check(pliant_scene_check(&scene));
        ConfinedReads confined(parameters_.scan_root, files_of(parameters_.scene));
        std::shared_ptr<const Scan> scan = read_scan(scene, path, &materials);
        std::shared_ptr<LoadedModel> next = build_chosen(scene, scan, materials.table, work_.progress());
        install_model(next, true);
        call->response.scan_id = scan->volume.id;
        return "loaded " + requested.path + ": " + size_text(*next->model);
    });
    response.scan_id = response.success ? call->response.scan_id : "";
    response.seconds = seconds_since(start);
    return true;
}

bool Services::recompute(RecomputeHomogenization::Request &request, RecomputeHomogenization::Response &response)
{
    double start = pliant_seconds();
    const auto call = std::make_shared<RecomputeHomogenization>();
    call->request = request;
    call->response.error_max = call->response.error_rms = std::numeric_limits<float>::quiet_NaN();
    choice_message(pliant_choice{}, &call->response);
    response = call->response;
    std::string message;
    const bool success = work_.run("recompute_homogenization", &message, [this, call] {
        RecomputeHomogenization::Response &answer = call->response;
        const bool probe = call->request.probe;
        std::shared_ptr<const LoadedModel> old = current();
        pliant_scene scene = old->requested;
        live_->apply(&scene);
        Recomputed requested;
        requested.take(call->request);
        requested.apply(&scene);
        check(pliant_scene_check(&scene));
        const pliant_material_table &materials = *pliant_model_get_materials(old->model);
        std::shared_ptr<LoadedModel> next =
            build_chosen(scene, old->scan, materials, work_.progress(0, probe ? 0.2 : 1));
        pliant_choice measured = next->choice;
        std::string note;
        if (probe && !measured.made) {
            try {
                measured = measure(*pliant_model_get_scene(next->model), *old->scan, materials, work_.progress(0.2, 1));
                if (!measured.made) note = "; no error could be measured";
            } catch (const Failure &failure) { /* the model remains usable without an error estimate */
                if (failure.status == PLIANT_ERROR_CANCELLED) throw;
                note = "; no error could be measured: " + std::string(failure.what());
            }
        }
        if (measured.made) {
            answer.error_max = static_cast<float>(measured.max);
            answer.error_rms = static_cast<float>(measured.rms);
        }
        choice_message(next->choice, &answer);
        install_model(next);
        {
            std::lock_guard<std::mutex> hold(lock_);
            recomputed_.take(call->request);
        }
        pliant_build_statistics statistics;
        pliant_model_get_statistics(next->model, &statistics);
        answer.condition_estimate = static_cast<float>(statistics.condition_estimate);
        return "recomputed: " + size_text(*next->model) + note;
    });
    if (success) response = call->response;
    response.success = success;
    response.message = message;
    response.seconds = seconds_since(start);
    return true;
}

bool Services::set_materials(SetMaterials::Request &request, SetMaterials::Response &response)
{
    double start = pliant_seconds();
    const std::string yaml = request.yaml;
    response.success = work_.run("set_materials", &response.message, [this, yaml] {
        std::shared_ptr<const LoadedModel> old = current();
        Materials materials;
        check(pliant_material_table_parse(yaml.c_str(), "the request", &materials.table));
        check(pliant_material_table_check(&materials.table));
        pliant_scene scene = old->requested;
        live_->apply(&scene);
        check(pliant_material_table_check_scene(&materials.table, &scene, "the request"));
        install_model(build_chosen(scene, old->scan, materials.table, work_.progress()));
        std::lock_guard<std::mutex> hold(lock_);
        std::swap(materials_.table, materials.table);
        return std::to_string(materials_.table.num_materials) + " materials are in use";
    });
    response.seconds = seconds_since(start);
    return true;
}

bool Services::save_volume(SaveVolume::Request &request, SaveVolume::Response &response)
{
    response.success = work_.run("save_volume", &response.message, [this, name = request.path] {
        std::string path, why;
        if (!confine_new(parameters_.output_root, name, &path, &why)) throw Failure(PLIANT_ERROR_ARGUMENT, why);
        Snapshot now = simulation_->snapshot();
        if (is_of_mesh(path)) {
            check(
                pliant_mesh_save(path.c_str(), now.loaded->model, now.body.get(), now.positions.data(), nullptr, 1.0));
            return "wrote " + path;
        }
        DeformedVolume warped(now.loaded, now.body);
        warped.update(now.positions);
        check(pliant_volume_write(path.c_str(), &warped.volume()));
        return "wrote " + path;
    }, false);
    return true;
}

bool Services::save_displacement(pliant_displacement_sense sense, SaveVolume::Request &request,
                                 SaveVolume::Response &response)
{
    const std::string service = sense == PLIANT_DISPLACEMENT_TISSUE ? "save_tissue_displacement" : "save_displacement";
    response.success = work_.run(service, &response.message, [this, sense, name = request.path] {
        std::string path, why;
        if (!confine_new(parameters_.output_root, name, &path, &why)) throw Failure(PLIANT_ERROR_ARGUMENT, why);
        Snapshot now = simulation_->snapshot();
        pliant_displacement field{};
        check(pliant_displacement_create(now.loaded->model, now.body.get(), now.positions.data(), sense, nullptr,
                                         &field));
        const pliant_status status = pliant_displacement_write(path.c_str(), &field);
        pliant_displacement_free(&field);
        check(status);
        return "wrote " + path;
    }, false);
    return true;
}

Rigid Services::tissue_from(const std_msgs::Header &header) const
{
    Rigid out = identity();
    std::string why;
    if (header.frame_id == parameters_.tissue_frame) return out;
    if (!rigid_from_message(frames_->lookupTransform(parameters_.tissue_frame, header.frame_id, header.stamp).transform,
                            &out, &why))
        throw Failure(PLIANT_ERROR_ARGUMENT, why);
    return out;
}

/* Pick in the displayed volume; without one, in a volume computed for this call. */
bool Services::pick(Pick::Request &request, Pick::Response &response)
{
    try {
        const Rigid to_tissue = tissue_from(request.header);
        pliant_ray ray = ray_from_message(request, to_tissue);
        pliant_picked picked{};
        auto find = [&](const DeformedVolume &warped, const Snapshot &now) {
            picked = warped.pick(now.positions, ray, request.threshold);
            if (picked.hit) response.material = pliant_model_material_at(now.loaded->model, picked.rest);
        };
        if (!volume_output_->look(find)) {
            Snapshot now = simulation_->snapshot();
            DeformedVolume warped(now.loaded, now.body);
            warped.update(now.positions);
            find(warped, now);
        }
        pick_message(picked, inverse(to_tissue), &response);
    } catch (const std::exception &failed) {
        response.message = failed.what();
    }
    return true;
}

bool Services::cut(CutLine::Request &request, CutLine::Response &response)
{
    try {
        const CutInput input = cut_from_message(request, tissue_from(request.header));
        const pliant_cut_report report = simulation_->cut(input, &response.revision);
        response.success = true;
        response.severed_area = report.area;
        response.pieces = report.pieces;
        response.message = report.num_links + report.num_bridges > 0 ? "cut" : "no tissue there";
    } catch (const std::exception &failed) {
        response.message = failed.what();
    }
    return true;
}

bool Services::undo_cut(std_srvs::Trigger::Request &, std_srvs::Trigger::Response &response)
{
    try {
        CutInput input;
        uint32_t revision;
        input.undo = true;
        simulation_->cut(input, &revision);
        response.success = true;
        response.message = "revision " + std::to_string(revision);
    } catch (const std::exception &failed) {
        response.message = failed.what();
    }
    return true;
}

bool Services::reset(std_srvs::Trigger::Request &, std_srvs::Trigger::Response &response)
{
    try {
        simulation_->reset();
        response.success = true;
        response.message = "at rest";
    } catch (const std::exception &failed) {
        response.message = failed.what();
    }
    return true;
}

bool Services::cancel(std_srvs::Trigger::Request &, std_srvs::Trigger::Response &response)
{
    response.success = work_.cancel(&response.message);
    return true;
}

bool Services::pause(std_srvs::SetBool::Request &request, std_srvs::SetBool::Response &response)
{
    try {
        simulation_->pause(request.data);
        response.success = true;
        response.message = request.data ? "paused" : "running";
    } catch (const std::exception &failed) {
        response.message = failed.what();
    }
    return true;
}

} // namespace pliant_ros
