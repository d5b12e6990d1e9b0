// A bar that hangs from its top, and a piece that a cut detaches.
#ifndef PLIANT_TEST_HANGING_BAR_H
#define PLIANT_TEST_HANGING_BAR_H

#include "body.h"
#include "sim/api/data.h"
#include "model_data/data.h"

#include <cmath>
#include <functional>
#include <memory>
#include <vector>

const double g = 9.81, at_rest[9] = {1, 0, 0, 0, 1, 0, 0, 0, 1};

struct Case {
    const char *name;
    std::function<void(pliant_scene &)> set;
};
inline void PrintTo(const Case &each, std::ostream *out) { *out << each.name; }
inline void coarse(pliant_scene &scene, pliant_method method)
{
    scene.model.method = method;
    scene.mesh.ratio = 2;
    for (int32_t &cells : scene.mesh.coarse_cells) cells /= 2;
}
inline void explicit_dynamics(pliant_scene &scene, bool quasi_static)
{
    scene.solver.kind = PLIANT_TLED;
    scene.tled.quasi_static = quasi_static;
    scene.tled.relaxation_steps = 100;
    scene.tled.damping = 0;
    scene.solver.step = 0.005;
}
const Case direct{"direct", [](pliant_scene &scene) { scene.solver.preconditioner = PLIANT_DIRECT; }};
const Case multigrid{"multigrid", [](pliant_scene &scene) { scene.solver.preconditioner = PLIANT_MULTIGRID; }};
const Case plain{"coarse", [](pliant_scene &scene) { coarse(scene, PLIANT_COARSE); }};
const Case averaged{"averaged", [](pliant_scene &scene) { coarse(scene, PLIANT_AVERAGED); }};
const Case patched{"patch", [](pliant_scene &scene) {
                       coarse(scene, PLIANT_AVERAGED);
                       scene.model.patch = 0.02;
                       scene.model.patch_delay = 2;
                   }};
const Case octree{"octree", [](pliant_scene &scene) {
                      scene.mesh.kind = PLIANT_OCTREE;
                      scene.mesh.depth = 1;
                      for (int32_t &cells : scene.mesh.coarse_cells) cells /= 2;
                  }};
const Case hexahedra{"hexahedra", [](pliant_scene &scene) { scene.element.kind = PLIANT_HEXAHEDRA; }};
const Case relaxed{"relaxation", [](pliant_scene &scene) { explicit_dynamics(scene, true); }};
const Case dynamic{"tled", [](pliant_scene &scene) { explicit_dynamics(scene, false); }};

// Create a bar that hangs from its top at z = 0.16.
// ground: height of a plane below it, if requested
inline std::unique_ptr<Body> hang(const Case &each, double ground = 1, double friction = 0.3)
{
    const int size[3] = {8, 8, 32};
    const double box[3] = {0.04, 0.04, 0.16};
    std::unique_ptr<Body> body(new Body(size, box, {{20000, 0.4, 1000, false}}));
    body->fix_plane(0, 0, 0.16 - 1e-6, 0, 0, -1);
    body->cells(4, 4, 16, 1);
    body->scene.solver.iterations = 10;
    body->scene.solver.tolerance = 1e-6;
    body->scene.model.gravity[2] = -g;
    body->scene.grasp.radius = 0.005;
    body->scene.warp.margin = 2;
    body->scene.solver.step = 0.01;
    if (ground < 1) {
        body->scene.ground.normal[2] = 1;
        body->scene.ground.point[2] = ground;
        body->scene.ground.friction = friction;
    }
    each.set(body->scene);
    EXPECT_EQ(body->build(), PLIANT_OK) << pliant_last_error();
    return body;
}

// Copy the nodes on a plane z for the tetrahedra on its far side.
// keep(node): exclude these nodes
inline const pliant_body *divided(
    const pliant_body &body, uint64_t revision, double z,
    const std::function<bool(const double *)> &keep = [](const double *) { return false; }, double low = -1)
{
    const pliant_mesh &mesh = body.fine;
    std::vector<int32_t> corners(mesh.tets, mesh.tets + 4 * mesh.num_tets),
        copy(static_cast<size_t>(mesh.num_nodes), -1);
    int32_t nodes = mesh.num_nodes;
    for (int32_t t = 0; t < mesh.num_tets; t++) {
        double centre = 0;
        for (int v = 0; v < 4; v++) centre += mesh.rest[3 * mesh.tets[4 * t + v] + 2] / 4;
        for (int v = 0; v < 4 && centre < z && centre > low; v++) {
            int32_t node = mesh.tets[4 * t + v];
            if (std::fabs(mesh.rest[3 * node + 2] - z) > 1e-6 || keep(mesh.rest + 3 * node)) continue;
            if (copy[node] < 0) copy[node] = nodes++;
            corners[4 * t + v] = copy[node];
        }
    }
    pliant_division division{};
    division.num_tets = mesh.num_tets;
    division.corners = corners.data();
    const std::vector<uint8_t> moves(static_cast<size_t>(nodes - mesh.num_nodes) + 1, PLIANT_MOVES);
    division.copy_fixed = moves.data();
    pliant_body *next = nullptr;
    EXPECT_EQ(pliant_body_divide(&body, revision, &division, &next), PLIANT_OK) << pliant_last_error();
    return next;
}

inline void cut(
    Body &body, double z, const std::function<bool(const double *)> &keep = [](const double *) { return false; })
{
    const pliant_body *next = divided(*body.data->body, body.data->last_revision + 1, z, keep);
    ASSERT_TRUE(next);
    ASSERT_EQ(pliant_data_set_body(body.model, body.data, next), PLIANT_OK) << pliant_last_error();
    pliant_body_release(next);
}

inline void step(Body &body, int count = 1)
{
    for (int s = 0; s < count; s++) ASSERT_GE(pliant_step(body.model, body.data), 0) << pliant_last_error();
}

// Return the nodes whose tetrahedra are below (or above) z at rest.
inline std::vector<int32_t> nodes_below(const pliant_body &body, double z, bool below = true)
{
    std::vector<char> in(static_cast<size_t>(body.fine.num_nodes));
    for (int32_t t = 0; t < body.fine.num_tets; t++) {
        double centre = 0;
        for (int v = 0; v < 4; v++) centre += body.fine.rest[3 * body.fine.tets[4 * t + v] + 2] / 4;
        if ((centre < z) == below)
            for (int v = 0; v < 4; v++) in[body.fine.tets[4 * t + v]] = 1;
    }
    std::vector<int32_t> out;
    for (int32_t n = 0; n < body.fine.num_nodes; n++)
        if (in[n]) out.push_back(n);
    return out;
}
inline std::vector<double> centre_of(const Body &body, const std::vector<int32_t> &nodes)
{
    std::vector<double> sum(3);
    double mass = 0;
    for (int32_t n : nodes) {
        const double m = body.data->body->node_mass[n];
        mass += m;
        for (int d = 0; d < 3; d++) sum[d] += m * body.data->positions[3 * n + d];
    }
    for (double &s : sum) s /= mass;
    return sum;
}
inline double lowest(const Body &body, const std::vector<int32_t> &nodes)
{
    double minimum = INFINITY;
    for (int32_t n : nodes) minimum = std::fmin(minimum, body.data->positions[3 * n + 2]);
    return minimum;
}

#endif
