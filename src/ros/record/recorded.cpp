#include "ros/record/recorded.h"
#include "base/fail.h"
#include "cut/cut.h"

#include <algorithm>
#include <cmath>

namespace pliant_ros {

namespace {

std::string differs(const std::string &what, size_t recorded, size_t here, const std::string &advice)
{
    return "the recording has " + std::to_string(recorded) + " " + what + ", the model here " + std::to_string(here) +
           ": " + advice;
}

const std::string same_scene = "the scene must be the one of the recording (mesh, materials, labels)";

/* Return whether the cuts of a body are the first cuts of a recorded topology. */
bool begins(const pliant_body &body, const MeshTopology &recorded)
{
    const pliant_cuts *cuts = body.cuts;
    if (!cuts || cuts->num_cuts == 0) return true;
    const size_t count = static_cast<size_t>(cuts->num_cuts);
    if (count > recorded.cut_end.size()) return false;
    const auto same = [](int32_t here, uint32_t there) { return static_cast<uint32_t>(here) == there; };
    const int32_t severed = cuts->cut_end[count - 1];
    return std::equal(cuts->cut_end, cuts->cut_end + count, recorded.cut_end.begin(), same) &&
           static_cast<size_t>(severed) <= recorded.severed.size() &&
           std::equal(cuts->severed, cuts->severed + severed, recorded.severed.begin());
}

/* Apply the remaining recorded cuts to a body that has the first of them. */
bool sever(const MeshTopology &recorded, uint64_t *last_revision, std::shared_ptr<const pliant_body> *body)
{
    for (size_t cut = (*body)->cuts ? static_cast<size_t>((*body)->cuts->num_cuts) : 0; cut < recorded.cut_end.size();
         ++cut) {
        const uint32_t begin = cut > 0 ? recorded.cut_end[cut - 1] : 0, end = recorded.cut_end[cut];
        pliant_body *made = nullptr;
        if (end <= begin || end > recorded.severed.size()) {
            pliant_fail(PLIANT_ERROR_FORMAT, "its cut_end is not ascending, or exceeds the length of severed");
            return false;
        }
        if (pliant_body_sever(body->get(), ++*last_revision, static_cast<int32_t>(end - begin),
                              &recorded.severed[begin], &made) < 0)
            return false;
        body->reset(made, pliant_body_release);
    }
    return true;
}

/* Apply all recorded cuts that subdivide tetrahedra to the initial body in one operation. */
bool subdivide(const MeshTopology &recorded, uint64_t *last_revision, std::shared_ptr<const pliant_body> *body)
{
    if (recorded.between.empty()) return true;
    const pliant_body &load = **body;
    const size_t tets = static_cast<size_t>(load.fine.num_tets), all = recorded.tetrahedra.size() / 4,
                 added = recorded.between_share.size();
    bool good = load.subdivision && recorded.tetrahedra.size() % 4 == 0 && all >= tets &&
                recorded.tetrahedron_parent.size() == all - tets && recorded.between.size() == 2 * added &&
                recorded.rest_nodes.size() == 3 * (static_cast<size_t>(load.fine.num_nodes) + added);
    for (uint32_t parent : recorded.tetrahedron_parent) good = good && parent < tets;
    for (uint32_t node : recorded.tetrahedra) good = good && node < recorded.rest_nodes.size() / 3;
    if (!good) {
        pliant_fail(PLIANT_ERROR_FORMAT, "its nodes and tetrahedra do not subdivide the mesh at load");
        return false;
    }
    std::vector<int32_t> source(recorded.tetrahedron_parent.begin(), recorded.tetrahedron_parent.end());
    const std::vector<int32_t> corners(recorded.tetrahedra.begin(), recorded.tetrahedra.end());
    std::vector<pliant_tet_material> material(load.fine_material, load.fine_material + tets);
    for (int32_t parent : source) material.push_back(load.fine_material[parent]);
    std::vector<pliant_between> between(added);
    for (size_t i = 0; i < added; ++i)
        between[i] = pliant_between{
            {static_cast<int32_t>(recorded.between[2 * i]), static_cast<int32_t>(recorded.between[2 * i + 1])},
            recorded.between_share[i]};
    source.push_back(0); /* avoid null pointers of empty arrays */
    pliant_division division{};
    division.num_tets = static_cast<int32_t>(all);
    division.tet_source = source.data();
    division.corners = corners.data();
    division.material = material.data();
    division.between = between.data();
    pliant_body *made = nullptr;
    if (pliant_body_divide(&load, ++*last_revision, &division, &made) < 0) return false;
    body->reset(made, pliant_body_release);
    return true;
}

bool has_mesh(const pliant_mesh &mesh, const MeshTopology &recorded, std::string *why)
{
    size_t nodes = static_cast<size_t>(mesh.num_nodes), tets = static_cast<size_t>(mesh.num_tets);
    if (recorded.rest_nodes.size() != 3 * nodes) {
        *why = differs("nodes", recorded.rest_nodes.size() / 3, nodes, same_scene);
    } else if (recorded.tetrahedra.size() != 4 * tets) {
        *why = differs("tetrahedra", recorded.tetrahedra.size() / 4, tets, same_scene);
    } else if (!std::equal(recorded.tetrahedra.begin(), recorded.tetrahedra.end(), mesh.tets,
                           [](uint32_t a, int32_t b) { return a == static_cast<uint32_t>(b); })) {
        *why = "the tetrahedra of the recording join other nodes: " + same_scene;
    } else if (!std::equal(recorded.rest_nodes.begin(), recorded.rest_nodes.end(), mesh.rest,
                           [](float a, double b) { return a == static_cast<float>(b); })) {
        *why = "the nodes of the recording have other rest positions: " + same_scene;
    } else {
        return true;
    }
    return false;
}

} // namespace

std::shared_ptr<const pliant_body> body_of(const LoadedModel &loaded, const MeshTopology &recorded, Bodies *bodies,
                                           std::string *why)
{
    std::shared_ptr<const pliant_body> body = share_body(pliant_model_get_body(loaded.model));
    const std::shared_ptr<const pliant_body> near = bodies->newest;
    bodies->last_revision = std::max(bodies->last_revision, body->revision);
    if (near && !near->subdivision && begins(*near, recorded)) body = near;
    if (!is_id_of(recorded.scan_id, *loaded.scan)) {
        *why = "the recording is of scan \"" + recorded.scan_id + "\", but the loaded scan is \"" +
               loaded.scan->volume.id + "\": name that scan";
    } else if (recorded.scan_checksum != loaded.scan->checksum) {
        *why = "the voxels of \"" + recorded.scan_id +
               "\" differ from the voxels of the recording: the name is equal, but the scan or its size is not";
    } else if (!sever(recorded, &bodies->last_revision, &body) || !subdivide(recorded, &bodies->last_revision, &body)) {
        *why = std::string("the recording's mesh was cut, but this one cannot be: ") + pliant_last_error() + "; " +
               same_scene;
    } else if (has_mesh(body->fine, recorded, why)) {
        bodies->newest = body;
        return body;
    }
    return nullptr;
}

std::shared_ptr<const Snapshot> snapshot_of(std::shared_ptr<const LoadedModel> loaded,
                                            std::shared_ptr<const pliant_body> body, const MeshState &state)
{
    size_t wanted = 3 * static_cast<size_t>(body->fine.num_nodes);
    const std::string step = "step " + std::to_string(state.step);
    if (state.nodes.size() != wanted)
        throw Failure(PLIANT_ERROR_FORMAT, step + " has " + std::to_string(state.nodes.size() / 3) +
                                               " nodes, its topology " + std::to_string(wanted / 3));
    if (!std::all_of(state.nodes.begin(), state.nodes.end(), [](float x) { return std::isfinite(x); }))
        throw Failure(PLIANT_ERROR_FORMAT, step + " has a node whose position is not finite");
    auto out = std::make_shared<Snapshot>();
    out->loaded = std::move(loaded);
    out->body = std::move(body);
    out->positions.assign(state.nodes.begin(), state.nodes.end());
    out->revision = state.revision;
    out->step = state.step;
    out->stamp = state.header.stamp;
    return out;
}

} // namespace pliant_ros
