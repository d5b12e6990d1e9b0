#include "ros/record/recorded.h"

#include <algorithm>
#include <cmath>

namespace pliant_ros {

namespace {

std::string differs(const std::string &what, size_t recorded, size_t here, const std::string &advice)
{
    return "the recording has " + std::to_string(recorded) + " " + what + ", the model here " + std::to_string(here) +
           ": " + advice;
}

} // namespace

bool is_same(const Loaded &loaded, const MeshTopology &recorded, std::string *why)
{
    const pliant_mesh &mesh = pliant_model_get_body(loaded.model)->fine;
    const char *id = loaded.scan->volume.id;
    size_t nodes = static_cast<size_t>(mesh.num_nodes), tets = static_cast<size_t>(mesh.num_tets);
    const std::string same_scene = "the scene must be the one of the recording (mesh, materials, labels)";
    if (recorded.scan_id != id) {
        *why = "the recording is of scan \"" + recorded.scan_id + "\", the one here is \"" + id + "\": name that scan";
    } else if (recorded.scan_checksum != loaded.scan->checksum) {
        *why = "the voxels of \"" + recorded.scan_id +
               "\" are not those of the recording: same name, but another scan or size";
    } else if (recorded.rest_nodes.size() != 3 * nodes) {
        *why = differs("nodes", recorded.rest_nodes.size() / 3, nodes, same_scene);
    } else if (recorded.tetrahedra.size() != 4 * tets) {
        *why = differs("tetrahedra", recorded.tetrahedra.size() / 4, tets, same_scene);
    } else if (!std::equal(recorded.tetrahedra.begin(), recorded.tetrahedra.end(), mesh.tets,
                           [](uint32_t a, int32_t b) { return a == static_cast<uint32_t>(b); })) {
        *why = "the tetrahedra of the recording join other nodes: " + same_scene;
    } else if (!std::equal(recorded.rest_nodes.begin(), recorded.rest_nodes.end(), mesh.rest,
                           [](float a, double b) { return a == static_cast<float>(b); })) {
        *why = "the nodes of the recording rest elsewhere: " + same_scene;
    } else {
        return true;
    }
    return false;
}

std::shared_ptr<const Snapshot> snapshot_of(std::shared_ptr<const Loaded> loaded, const MeshState &state)
{
    size_t wanted = 3 * static_cast<size_t>(pliant_model_get_body(loaded->model)->fine.num_nodes);
    const std::string step = "step " + std::to_string(state.step);
    if (state.nodes.size() != wanted)
        throw Failure(PLIANT_ERROR_FORMAT, step + " has " + std::to_string(state.nodes.size() / 3) +
                                               " nodes, its topology " + std::to_string(wanted / 3));
    if (!std::all_of(state.nodes.begin(), state.nodes.end(), [](float x) { return std::isfinite(x); }))
        throw Failure(PLIANT_ERROR_FORMAT, step + " has a node that is nowhere (not finite)");
    auto out = std::make_shared<Snapshot>();
    out->loaded = std::move(loaded);
    out->positions.assign(state.nodes.begin(), state.nodes.end());
    out->revision = state.revision;
    out->step = state.step;
    out->stamp = state.header.stamp;
    return out;
}

} // namespace pliant_ros
