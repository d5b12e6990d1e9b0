// Bodies of every method that are cut while tools grasp them, for tests of the change from one body to the next.
#ifndef PLIANT_TEST_ADAPT_CASES_H
#define PLIANT_TEST_ADAPT_CASES_H

#include "body.h"
#include "fragments.h"
#include "scan/volume.h"
#include "sim/api/data.h"
#include "sim/build/discretization.h"
#include "model_data/data.h"
#include "warp/raster.h"

#include <algorithm>
#include <chrono>
#include <memory>
#include <thread>

const int size[3] = {16, 16, 16};
const double box[3] = {0.16, 0.16, 0.16};

struct Case {
    const char *name;
    std::function<void(pliant_scene &)> set;
    double poisson = 0.4; // of the soft tissue
};

inline void coarse(pliant_scene &scene, pliant_method method)
{
    scene.model.method = method;
    scene.mesh.coarse_cells[0] = scene.mesh.coarse_cells[1] = scene.mesh.coarse_cells[2] = 4;
    scene.mesh.ratio = 2;
}

inline void explicit_dynamics(pliant_scene &scene, bool quasi_static)
{
    scene.solver.kind = PLIANT_TLED;
    scene.tled.quasi_static = quasi_static;
    scene.tled.relaxation_steps = 60;
    scene.tled.prony_share[0] = quasi_static ? 0 : 0.3;
    scene.tled.prony_time[0] = 0.1;
    scene.solver.step = 0.01;
    scene.tled.damping = 20; // strong damping, so that it comes to rest soon
}

const Case direct{"direct", [](pliant_scene &scene) { scene.solver.preconditioner = PLIANT_DIRECT; }};
const Case multigrid{"multigrid", [](pliant_scene &scene) { scene.solver.preconditioner = PLIANT_MULTIGRID; }};
const Case hexahedra{"hexahedra", [](pliant_scene &scene) {
                         scene.element.kind = PLIANT_HEXAHEDRA;
                         scene.solver.preconditioner = PLIANT_MULTIGRID;
                     }};
const Case averaged{"averaged", [](pliant_scene &scene) { coarse(scene, PLIANT_AVERAGED); }};
const Case averaged_hexahedra{"averaged_hexahedra", [](pliant_scene &scene) {
                                  coarse(scene, PLIANT_AVERAGED);
                                  scene.element.kind = PLIANT_HEXAHEDRA;
                              }};
const Case coarse_hexahedra{"coarse_hexahedra", [](pliant_scene &scene) {
                                coarse(scene, PLIANT_COARSE);
                                scene.element.kind = PLIANT_HEXAHEDRA;
                                scene.solver.preconditioner = PLIANT_MULTIGRID;
                            }};
const Case plain{"coarse", [](pliant_scene &scene) { coarse(scene, PLIANT_COARSE); }};
const Case schur{"schur", [](pliant_scene &scene) { coarse(scene, PLIANT_SCHUR); }};
const Case schur_hexahedra{"schur_hexahedra", [](pliant_scene &scene) {
                               coarse(scene, PLIANT_SCHUR);
                               scene.element.kind = PLIANT_HEXAHEDRA;
                           }};
const Case lod{"lod", [](pliant_scene &scene) { coarse(scene, PLIANT_LOD); }};
const Case patch{"patch", [](pliant_scene &scene) {
                     coarse(scene, PLIANT_AVERAGED);
                     scene.model.patch = 0.04;
                     scene.model.patch_delay = 3;
                 }};
const Case patch_hexahedra{"patch_hexahedra", [](pliant_scene &scene) {
                               patch.set(scene);
                               scene.element.kind = PLIANT_HEXAHEDRA;
                           }};
const Case octree{"octree", [](pliant_scene &scene) {
                      scene.mesh.kind = PLIANT_OCTREE;
                      scene.mesh.depth = 1;
                      scene.mesh.coarse_cells[0] = scene.mesh.coarse_cells[1] = scene.mesh.coarse_cells[2] = 4;
                  }};
const Case octree_hexahedra{"octree_hexahedra", [](pliant_scene &scene) {
                                octree.set(scene);
                                scene.element.kind = PLIANT_HEXAHEDRA;
                            }};
const Case cubes{"tled_hexahedra", [](pliant_scene &scene) {
                     explicit_dynamics(scene, false);
                     scene.element.kind = PLIANT_HEXAHEDRA;
                 }};
const Case dynamic{"tled", [](pliant_scene &scene) { explicit_dynamics(scene, false); }};
const Case relaxed{"relaxation", [](pliant_scene &scene) { explicit_dynamics(scene, true); }};

// Create a block that hangs from its floor at z = 0 under gravity along x, with two tools and a warp. Few iterations
// are allowed, so that history and factors matter.
inline std::unique_ptr<Body> make(const Case &each)
{
    std::unique_ptr<Body> body(new Body(size, box, {{4000, each.poisson, 1000, false}, {20000, 0.4, 1200, false}},
                                        [](int i, int, int k) { return (i < 6 || i > 9) && k > 9; }));
    body->fix_plane(0, 0, 1e-6, 0, 0, 1);
    body->cells(8, 8, 8, 1);
    body->scene.solver.iterations = 3;
    body->scene.solver.tolerance = 1e-6;
    body->scene.solver.refresh_interval = 2;
    body->scene.solver.refresh_delay = 2;
    body->scene.model.gravity[0] = 2;
    body->scene.grasp.radius = 0.02;
    each.set(body->scene);
    EXPECT_EQ(body->build(), PLIANT_OK) << pliant_last_error();
    return body;
}

inline void grasp_at_two_points(Body &body)
{
    const double points[2][3] = {{0.03, 0.08, 0.15}, {0.13, 0.08, 0.15}};
    for (int t = 0; t < 2; t++) {
        int tool;
        ASSERT_EQ(pliant_tool_add(body.model, body.data, t ? "right" : "left", &tool), PLIANT_OK);
        ASSERT_EQ(pliant_tool_grasp(body.model, body.data, tool, points[t]), PLIANT_OK) << pliant_last_error();
    }
    ASSERT_EQ(pliant_tool_set_drive(body.data, 1, PLIANT_DRIVE_RIGID, nullptr), PLIANT_OK);
    ASSERT_EQ(pliant_data_set_warp(body.model, body.data, &body.scan.geometry), PLIANT_OK) << pliant_last_error();
}

inline void step(Body &body, int count)
{
    for (int s = 0; s < count; s++) {
        for (int t = 0; t < body.data->num_tools; t++) {
            const pliant_tool &tool = body.data->tools[t];
            const double tip[3] = {tool.tip[0], tool.tip[1] + (t ? 1e-3 : -1e-3), tool.tip[2] + 5e-4};
            ASSERT_EQ(pliant_tool_set_pose(body.data, t, tip, nullptr), PLIANT_OK);
        }
        ASSERT_GE(pliant_step(body.model, body.data), 0) << pliant_last_error();
    }
}

// Return all visible results of a step.
inline std::vector<uint8_t> state(const Body &body)
{
    const pliant_data &data = *body.data;
    std::vector<uint8_t> out;
    auto add = [&](const void *from, size_t bytes) {
        const uint8_t *at = static_cast<const uint8_t *>(from);
        out.insert(out.end(), at, at + bytes);
    };
    add(data.positions, 3 * sizeof(double) * static_cast<size_t>(data.body->fine.num_nodes));
    for (int t = 0; t < data.num_tools; t++) {
        add(data.tools[t].force, sizeof data.tools[t].force);
        add(data.tools[t].held_point, sizeof data.tools[t].held_point);
    }
    const double told[] = {data.statistics.residual,
                           data.statistics.error,
                           data.statistics.error_before,
                           data.statistics.residual_force,
                           static_cast<double>(data.statistics.iterations),
                           static_cast<double>(data.statistics.patched),
                           static_cast<double>(data.statistics.factors)};
    add(told, sizeof told);
    if (!data.warp) return out;
    const pliant_volume *volume = pliant_warp_volume(data.warp);
    add(volume->voxels, pliant_geometry_voxels(&volume->geometry) * pliant_encoding_size(volume->encoding));
    return out;
}

// Set the same topology with the next revision.
inline void renew(Body &body)
{
    pliant_body *next = nullptr;
    ASSERT_EQ(pliant_body_next(body.data->body, body.data->last_revision + 1, &next), PLIANT_OK) << pliant_last_error();
    ASSERT_EQ(pliant_data_set_body(body.model, body.data, next), PLIANT_OK) << pliant_last_error();
    EXPECT_EQ(body.data->body, next);
    pliant_body_release(next);
}

// Copy the nodes on a plane of element faces for the corners on its far side.
// up: only nodes with larger z
inline std::vector<int32_t> split(const pliant_body &body, double x, double up = -1)
{
    const pliant_mesh &mesh = body.fine;
    std::vector<int32_t> corners(mesh.tets, mesh.tets + 4 * mesh.num_tets),
        copy(static_cast<size_t>(mesh.num_nodes), -1);
    int32_t nodes = mesh.num_nodes;
    for (int32_t t = 0; t < mesh.num_tets; t++) {
        double centre = 0;
        for (int v = 0; v < 4; v++) centre += mesh.rest[3 * mesh.tets[4 * t + v]] / 4;
        for (int v = 0; v < 4 && centre > x; v++) {
            int32_t node = mesh.tets[4 * t + v];
            if (std::fabs(mesh.rest[3 * node] - x) > 1e-6 || mesh.rest[3 * node + 2] < up) continue;
            if (copy[node] < 0) copy[node] = nodes++;
            corners[4 * t + v] = copy[node];
        }
    }
    return corners;
}

inline const pliant_body *divide(const pliant_body *body, uint64_t revision, const std::vector<int32_t> &corners)
{
    pliant_division division{};
    division.num_tets = body->fine.num_tets;
    division.corners = corners.data();
    pliant_body *next = nullptr;
    EXPECT_EQ(pliant_body_divide(body, revision, &division, &next), PLIANT_OK) << pliant_last_error();
    return next;
}

inline void cut(Body &body, double x, double up = -1)
{
    const pliant_body *next = divide(body.data->body, body.data->last_revision + 1, split(*body.data->body, x, up));
    ASSERT_TRUE(next);
    ASSERT_EQ(pliant_data_set_body(body.model, body.data, next), PLIANT_OK) << pliant_last_error();
    pliant_body_release(next);
}

#endif
