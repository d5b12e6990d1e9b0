// Bodies that follow one another while a simulation runs: what is derived from a body goes over to the next one.
#include "body.h"
#include "fragments.h"
#include "sim/discretization.h"
#include "state/data.h"
#include "pliant/memory.h"
#include "warp/raster.h"

#include <algorithm>
#include <chrono>
#include <memory>
#include <thread>

namespace {

const int size[3] = {16, 16, 16};
const double box[3] = {0.16, 0.16, 0.16};

struct Case {
    const char *name;
    std::function<void(pliant_scene &)> set;
};

void coarse(pliant_scene &scene, pliant_method method)
{
    scene.model.method = method;
    scene.mesh.coarse_cells[0] = scene.mesh.coarse_cells[1] = scene.mesh.coarse_cells[2] = 4;
    scene.mesh.ratio = 2;
}

void explicit_dynamics(pliant_scene &scene, bool quasi_static)
{
    scene.solver.kind = PLIANT_TLED;
    scene.tled.quasi_static = quasi_static;
    scene.tled.relaxation_steps = 60;
    scene.tled.prony_share[0] = quasi_static ? 0 : 0.3;
    scene.tled.prony_time[0] = 0.1;
    scene.solver.step = 0.01;
    scene.tled.damping = 20; // it comes to rest soon
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
const Case calibrated{"calibrated", [](pliant_scene &scene) { coarse(scene, PLIANT_CALIBRATED); }};
const Case lod{"lod", [](pliant_scene &scene) { coarse(scene, PLIANT_LOD); }};
const Case patch{"patch", [](pliant_scene &scene) {
                     coarse(scene, PLIANT_AVERAGED);
                     scene.model.patch = 0.04;
                     scene.model.patch_delay = 3;
                 }};
const Case octree{"octree", [](pliant_scene &scene) {
                      scene.mesh.kind = PLIANT_OCTREE;
                      scene.mesh.depth = 1;
                      scene.mesh.coarse_cells[0] = scene.mesh.coarse_cells[1] = scene.mesh.coarse_cells[2] = 4;
                  }};
const Case cubes{"tled_hexahedra", [](pliant_scene &scene) {
                     explicit_dynamics(scene, false);
                     scene.element.kind = PLIANT_HEXAHEDRA;
                 }};
const Case dynamic{"tled", [](pliant_scene &scene) { explicit_dynamics(scene, false); }};
const Case relaxed{"relaxation", [](pliant_scene &scene) { explicit_dynamics(scene, true); }};

// A block that hangs from its floor at z = 0 under gravity along x, two tools, a warp; few iterations, so that history and factors count.
std::unique_ptr<Body> make(const Case &each)
{
    std::unique_ptr<Body> body(new Body(size, box, {{4000, 0.4, 1000, false}, {20000, 0.4, 1200, false}}, [](int i, int, int k) { return (i < 6 || i > 9) && k > 9; }));
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

void take_hold(Body &body)
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

void step(Body &body, int count)
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

// everything that a step leaves where others see it
std::vector<uint8_t> state(const Body &body)
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
    const double told[] = {data.statistics.residual, data.statistics.error, data.statistics.error_before, data.statistics.residual_force,
                           static_cast<double>(data.statistics.iterations), static_cast<double>(data.statistics.patched),
                           static_cast<double>(data.statistics.factors)};
    add(told, sizeof told);
    if (!data.warp) return out;
    const pliant_volume *volume = pliant_warp_volume(data.warp);
    add(volume->voxels, pliant_geometry_voxels(&volume->geometry) * pliant_encoding_size(volume->encoding));
    return out;
}

// the same topology again, under the next revision
void renew(Body &body)
{
    pliant_body *next = nullptr;
    ASSERT_EQ(pliant_body_next(body.data->body, body.data->last_revision + 1, &next), PLIANT_OK) << pliant_last_error();
    ASSERT_EQ(pliant_data_set_body(body.model, body.data, next), PLIANT_OK) << pliant_last_error();
    EXPECT_EQ(body.data->body, next);
    pliant_body_release(next);
}

// Corners on the far side of a plane of element faces get copies of its nodes. up: only where z is above.
std::vector<int32_t> split(const pliant_body &body, double x, double up = -1)
{
    const pliant_mesh &mesh = body.fine;
    std::vector<int32_t> corners(mesh.tets, mesh.tets + 4 * mesh.num_tets), copy(static_cast<size_t>(mesh.num_nodes), -1);
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

const pliant_body *divide(const pliant_body *body, uint64_t revision, const std::vector<int32_t> &corners)
{
    pliant_division division{};
    division.num_tets = body->fine.num_tets;
    division.corners = corners.data();
    pliant_body *next = nullptr;
    EXPECT_EQ(pliant_body_divide(body, revision, &division, &next), PLIANT_OK) << pliant_last_error();
    return next;
}

void cut(Body &body, double x, double up = -1)
{
    const pliant_body *next = divide(body.data->body, body.data->last_revision + 1, split(*body.data->body, x, up));
    ASSERT_TRUE(next);
    ASSERT_EQ(pliant_data_set_body(body.model, body.data, next), PLIANT_OK) << pliant_last_error();
    pliant_body_release(next);
}

struct EveryMethod : testing::TestWithParam<Case> {};
std::string name_of(const testing::TestParamInfo<Case> &info) { return info.param.name; }

// ---- nothing changes

TEST_P(EveryMethod, ARevisionOfTheSameTopologyChangesNoBits)
{
    std::unique_ptr<Body> one = make(GetParam()), other = make(GetParam());
    take_hold(*one);
    take_hold(*other);
    const pliant_solver *solver = other->data->solver;
    for (int s = 0; s < 12; s++) {
        step(*one, 1);
        step(*other, 1);
        ASSERT_EQ(state(*one), state(*other)) << "step " << s;
        if (s % 3 == 1) renew(*other);
    }
    EXPECT_EQ(other->data->body->revision, 5u);
    EXPECT_EQ(other->data->solver, solver);
    EXPECT_NE(other->data->body, other->model->body);
    // and back to load
    ASSERT_EQ(pliant_data_reset(other->model, other->data), PLIANT_OK);
    EXPECT_EQ(other->data->body, other->model->body);
    ASSERT_EQ(pliant_data_reset(one->model, one->data), PLIANT_OK);
    step(*one, 2);
    step(*other, 2);
    EXPECT_EQ(state(*one), state(*other));
}
INSTANTIATE_TEST_SUITE_P(Methods, EveryMethod,
                         testing::Values(direct, multigrid, hexahedra, averaged_hexahedra, coarse_hexahedra, plain, schur, averaged, calibrated, lod, patch, octree, dynamic, cubes, relaxed), name_of);

// ---- a real change

struct EveryDivisible : testing::TestWithParam<Case> {};

// until no thread takes memory, or an allocation that is meant to fail
void wait_for_background(const Body &body)
{
    while (body.data->solver && pliant_refresh_is_busy(body.data->solver)) std::this_thread::sleep_for(std::chrono::milliseconds(1));
}

// no memory for any of it: the body before goes on with the same bits
TEST_P(EveryDivisible, WithoutMemoryTheBodyBeforeGoesOn)
{
    std::unique_ptr<Body> one = make(GetParam()), other = make(GetParam());
    take_hold(*one);
    take_hold(*other);
    step(*one, 4);
    step(*other, 4);
    const pliant_body *next = divide(other->data->body, 2, split(*other->data->body, 0.08, 0.09));
    ASSERT_TRUE(next);
    std::vector<int64_t> failed;
    wait_for_background(*one);
    wait_for_background(*other);
    const size_t before = pliant_memory_in_use();
    // every allocation where there are few, then some of them: preparing takes a while
    for (int64_t n = 0;; n += n < 40 ? 1 : 1 + n / 8) {
        pliant_memory_fail_after(n);
        pliant_status status = pliant_data_set_body(other->model, other->data, next);
        pliant_memory_fail_after(-1);
        if (status == PLIANT_OK) break;
        ASSERT_EQ(status, PLIANT_ERROR_MEMORY) << "allocation " << n << ": " << pliant_last_error();
        ASSERT_EQ(other->data->body, other->model->body);
        ASSERT_EQ(pliant_memory_in_use(), before) << "allocation " << n;
        failed.push_back(n);
    }
    EXPECT_GT(failed.size(), 20u);
    EXPECT_EQ(other->data->body, next);
    ASSERT_EQ(pliant_data_set_body(other->model, other->data, other->model->body), PLIANT_OK); // it was taken in the end
    pliant_body_release(next);

    std::unique_ptr<Body> third = make(GetParam());
    take_hold(*third);
    step(*third, 4);
    wait_for_background(*third);
    next = divide(third->data->body, 2, split(*third->data->body, 0.08, 0.09));
    for (int64_t n : failed) {
        if (2 * n > failed.back()) break; // how many there are depends a little on which thread does what
        pliant_memory_fail_after(n);
        pliant_status status = pliant_data_set_body(third->model, third->data, next);
        pliant_memory_fail_after(-1);
        ASSERT_EQ(status, PLIANT_ERROR_MEMORY) << n;
    }
    pliant_body_release(next);
    for (int s = 0; s < 5; s++) {
        step(*one, 1);
        step(*third, 1);
        ASSERT_EQ(state(*one), state(*third)) << "step " << s;
    }
}

// at rest nothing has a history: cut there, the body moves as one that was in two from the start
TEST_P(EveryDivisible, ACutBodyMovesAsOneThatWasMadeApart)
{
    std::unique_ptr<Body> apart = make(GetParam()), whole = make(GetParam());
    // made apart: the model's own body is the divided one
    const pliant_body *next = divide(apart->model->body, 2, split(*apart->model->body, 0.08, 0.05));
    ASSERT_TRUE(next);
    ASSERT_EQ(pliant_data_set_body(apart->model, apart->data, next), PLIANT_OK) << pliant_last_error();
    pliant_body_release(next);
    for (Body *body : {apart.get(), whole.get()}) {
        take_hold(*body);
        ASSERT_EQ(pliant_data_set_limits(body->data, 200, 1e-9), PLIANT_OK);
    }
    step(*whole, 3);
    for (int t = 0; t < 2; t++) // the tools pull the halves apart, to where they are in the other one
        ASSERT_EQ(pliant_tool_set_pose(apart->data, t, whole->data->tools[t].tip, nullptr), PLIANT_OK);
    cut(*whole, 0.08, 0.05);
    const pliant_mesh &mesh = whole->data->body->fine;
    ASSERT_EQ(mesh.num_nodes, apart->data->body->fine.num_nodes);
    EXPECT_GT(mesh.num_nodes, whole->model->body->fine.num_nodes);
    auto rest = [&](Body &body) {
        double moved = 1;
        std::vector<double> before(body.data->positions, body.data->positions + 3 * mesh.num_nodes);
        for (int s = 0; s < 400 && moved > 2e-8; s++) {
            EXPECT_GE(pliant_step(body.model, body.data), 0) << pliant_last_error();
            moved = 0;
            for (int32_t i = 0; i < 3 * mesh.num_nodes; i++) moved = std::fmax(moved, std::fabs(body.data->positions[i] - before[i]));
            std::copy(body.data->positions, body.data->positions + 3 * mesh.num_nodes, before.begin());
        }
        return before;
    };
    std::vector<double> x = rest(*whole), y = rest(*apart);
    double most = 0, opened = 0;
    for (int32_t i = 0; i < 3 * mesh.num_nodes; i++) most = std::fmax(most, std::fabs(x[i] - y[i]));
    for (int32_t n = whole->model->body->fine.num_nodes; n < mesh.num_nodes; n++) {
        int32_t source = whole->data->body->node_parent[n];
        opened = std::fmax(opened, std::fabs(x[3 * n + 1] - x[3 * source + 1]));
    }
    EXPECT_LT(most, 2e-6);
    EXPECT_GT(opened, 1e-3); // the tools shear the halves along y, and the cut lets them
}
// ---- what a cut has not touched is copied: the same bits as making all anew

template <class T> void expect_same(const T *a, const T *b, size_t count, const char *what)
{
    ASSERT_EQ(a == nullptr, b == nullptr) << what;
    if (a) EXPECT_EQ(std::memcmp(a, b, count * sizeof *a), 0) << what;
}

void expect_same(const pliant_system &a, const pliant_system &b)
{
    ASSERT_EQ(a.num_free, b.num_free);
    const size_t blocks = static_cast<size_t>(a.num_blocks), tets = static_cast<size_t>(a.mesh->num_tets), fine = static_cast<size_t>(a.fine->num_nodes);
    ASSERT_EQ(a.num_blocks, b.num_blocks);
    expect_same(a.gradients, b.gradients, blocks, "gradients");
    expect_same(a.lame, b.lame, blocks, "lame");
    expect_same(a.stiffness, b.stiffness, 144 * tets, "stiffness");
    expect_same(a.grounded, b.grounded, LANES * blocks, "grounded");
    expect_same(a.free_of_node, b.free_of_node, static_cast<size_t>(a.mesh->num_nodes), "unknowns");
    expect_same(a.gravity_mass, b.gravity_mass, 9 * static_cast<size_t>(a.num_free), "gravity");
    EXPECT_EQ(a.mean_diagonal, b.mean_diagonal);
    ASSERT_EQ(a.upsample == nullptr, b.upsample == nullptr);
    if (!a.upsample) return;
    const size_t corners = static_cast<size_t>(a.upsample->corners);
    ASSERT_EQ(a.upsample->corners, b.upsample->corners);
    expect_same(a.upsample->node, b.upsample->node, corners * fine, "followed nodes");
    expect_same(a.upsample->weights, b.upsample->weights, corners * fine, "weights");
    expect_same(a.upsample->start, b.upsample->start, fine + 1, "entries");
    if (!a.upsample->start) return;
    const size_t entries = static_cast<size_t>(a.upsample->start[fine]);
    expect_same(a.upsample->entry_tet, b.upsample->entry_tet, entries, "entries' tetrahedra");
    expect_same(a.upsample->entry_share, b.upsample->entry_share, entries, "shares");
    expect_same(a.upsample->entry_shape, b.upsample->entry_shape, 36 * entries, "shapes");
}

const Plane slanted{{0.075, 0.08, 0.08}, {0.95, 0.2, 0.24}};
std::function<bool(const double *)> above(double z)
{
    return [z](const double *x) { return x[2] > z; };
}

struct EveryFragment : testing::TestWithParam<Case> {};
TEST_P(EveryFragment, IncrementallyAsAnew)
{
    std::unique_ptr<Body> body = make(GetParam());
    std::vector<int8_t> sides;
    const pliant_body *before = pliant_body_retain(body->model->body);
    for (double z : {0.11, 0.06}) { // two strokes, fragments of fine tetrahedra
        const pliant_body *next = sever_plane(before, before->revision + 1, slanted, above(z), &sides);
        ASSERT_TRUE(next) << pliant_last_error();
        EXPECT_GT(next->fine.num_tets, before->fine.num_tets);
        EXPECT_LT(next->changes.num_touched, before->fine.num_tets / 2);
        ASSERT_EQ(pliant_data_set_body(body->model, body->data, next), PLIANT_OK) << pliant_last_error();
        const pliant_discretization *anew = nullptr, *made = body->data->discretization;
        ASSERT_EQ(pliant_discretization_create(&body->scene, next, &anew), PLIANT_OK) << pliant_last_error();
        if (!made->tled) expect_same(*made->system, *anew->system);
        pliant_discretization_release(anew);
        pliant_body_release(before);
        before = next;
    }
    ASSERT_EQ(pliant_data_set_body(body->model, body->data, body->model->body), PLIANT_OK) << pliant_last_error();
    EXPECT_EQ(body->data->discretization, body->model->discretization);
    pliant_body_release(before);
}

// steps between strokes, the tools pulling: it stays a state, and settles where a body that was cut at rest does
struct EveryStroke : testing::TestWithParam<Case> {};
TEST_P(EveryStroke, WhileItMoves)
{
    std::unique_ptr<Body> moving = make(GetParam()), resting = make(GetParam());
    std::vector<int8_t> sides, other;
    for (Body *body : {moving.get(), resting.get()}) take_hold(*body);
    auto stroke = [&](Body &body, double z, std::vector<int8_t> &of) {
        const pliant_body *next = sever_plane(body.data->body, body.data->last_revision + 1, slanted, above(z), &of);
        ASSERT_TRUE(next) << pliant_last_error();
        ASSERT_EQ(pliant_data_set_body(body.model, body.data, next), PLIANT_OK) << pliant_last_error();
        pliant_body_release(next);
    };
    for (double z : {0.13, 0.11, 0.09, 0.07}) stroke(*resting, z, other);
    for (double z : {0.13, 0.11, 0.09, 0.07}) {
        step(*moving, 1);
        stroke(*moving, z, sides);
    }
    step(*moving, 3);
    for (int t = 0; t < 2; t++) ASSERT_EQ(pliant_tool_set_pose(resting->data, t, moving->data->tools[t].tip, nullptr), PLIANT_OK);
    const size_t count = 3 * static_cast<size_t>(moving->data->body->fine.num_nodes);
    ASSERT_EQ(moving->data->body->fine.num_nodes, resting->data->body->fine.num_nodes);
    for (Body *body : {moving.get(), resting.get()}) {
        ASSERT_EQ(pliant_data_set_limits(body->data, 200, 1e-9), PLIANT_OK);
        double apart = 1;
        for (int s = 0; s < 400 && apart > 1e-8; s++) {
            const std::vector<double> at(body->data->positions, body->data->positions + count);
            ASSERT_GE(pliant_step(body->model, body->data), 0) << pliant_last_error();
            apart = 0;
            for (size_t i = 0; i < count; i++) apart = std::fmax(apart, std::fabs(body->data->positions[i] - at[i]));
        }
    }
    double most = 0, moved = 0;
    for (size_t i = 0; i < count; i++) {
        most = std::fmax(most, std::fabs(moving->data->positions[i] - resting->data->positions[i]));
        moved = std::fmax(moved, std::fabs(moving->data->positions[i] - moving->data->body->fine.rest[i]));
    }
    EXPECT_GT(moved, 5e-3);
    EXPECT_LT(most, 1e-3 * moved);
}
INSTANTIATE_TEST_SUITE_P(Methods, EveryFragment, testing::Values(direct, multigrid, hexahedra, averaged_hexahedra, coarse_hexahedra, plain, schur, averaged, calibrated, patch, dynamic, cubes, relaxed), name_of);

// what a live run took of what was made in the background, while it was cut, makes the same bits again
struct EveryReplay : testing::TestWithParam<Case> {};
TEST_P(EveryReplay, OfALiveRunThatIsCut)
{
    std::unique_ptr<Body> live = make(GetParam()), again = make(GetParam());
    std::vector<int8_t> sides[2];
    for (Body *body : {live.get(), again.get()}) take_hold(*body);
    ASSERT_EQ(pliant_data_set_background(live->data, PLIANT_BACKGROUND_LIVE, 0), PLIANT_OK);
    uint32_t all = 0;
    for (int s = 0; s < 40; s++) {
        for (int b = 0; b < 2; b++) {
            Body &body = b ? *again : *live;
            if (s % 3 == 2 && s < 16) {
                const pliant_body *next = sever_plane(body.data->body, body.data->last_revision + 1, slanted, above(0.14 - 0.005 * s), sides + b);
                ASSERT_TRUE(next) << pliant_last_error();
                ASSERT_EQ(pliant_data_set_body(body.model, body.data, next), PLIANT_OK) << pliant_last_error();
                pliant_body_release(next);
            }
            if (b) {
                ASSERT_EQ(pliant_data_set_background(body.data, PLIANT_BACKGROUND_PRESCRIBED, pliant_data_get_background_taken(live->data)), PLIANT_OK);
                all |= pliant_data_get_background_taken(live->data);
            }
            step(body, 1);
        }
        ASSERT_EQ(pliant_data_get_background_taken(live->data), pliant_data_get_background_taken(again->data)) << "step " << s;
        ASSERT_EQ(state(*live), state(*again)) << "step " << s;
        std::this_thread::sleep_for(std::chrono::milliseconds(3));
    }
    EXPECT_TRUE(all & PLIANT_TAKES_FACTOR);
    EXPECT_GT(live->data->statistics.factors, 0u);
}
INSTANTIATE_TEST_SUITE_P(Methods, EveryReplay, testing::Values(direct, multigrid, averaged, patch), name_of);
INSTANTIATE_TEST_SUITE_P(Methods, EveryStroke, testing::Values(direct, multigrid, hexahedra, averaged_hexahedra, plain, schur, averaged, calibrated, relaxed), name_of);
INSTANTIATE_TEST_SUITE_P(Methods, EveryDivisible, testing::Values(direct, multigrid, hexahedra, averaged_hexahedra, plain, schur, averaged, calibrated, patch, octree, dynamic, cubes, relaxed), name_of);

// ---- what no part of all this had a hand in: the left half of a body in two is the body of half the width

struct EveryHalf : testing::TestWithParam<Case> {};
TEST_P(EveryHalf, OfABodyInTwoIsABodyOfItsOwn)
{
    std::unique_ptr<Body> whole = make(GetParam());
    const int half_size[3] = {8, 16, 16};
    const double half_box[3] = {0.08, 0.16, 0.16};
    Body half(half_size, half_box, {{4000, 0.4, 1000, false}, {20000, 0.4, 1200, false}}, [](int i, int, int k) { return (i < 6 || i > 9) && k > 9; });
    half.scene = whole->scene;
    half.scene.mesh.coarse_cells[0] /= 2;
    ASSERT_EQ(half.build(), PLIANT_OK) << pliant_last_error();
    step(*whole, 2);
    cut(*whole, 0.08);
    for (Body *body : {whole.get(), &half}) {
        ASSERT_EQ(pliant_data_set_limits(body->data, 200, 1e-9), PLIANT_OK);
        for (int s = 0; s < 60; s++) ASSERT_GE(pliant_step(body->model, body->data), 0) << pliant_last_error();
    }
    const pliant_mesh &mesh = half.model->body->fine, &all = whole->data->body->fine;
    double most = 0, moved = 0;
    for (int32_t n = 0; n < mesh.num_nodes; n++) {
        double barycentric[4], inside[3];
        for (int d = 0; d < 3; d++) inside[d] = mesh.rest[3 * n + d] + 1e-7 * ((d ? 0.08 : 0.04) - mesh.rest[3 * n + d]);
        int32_t tet = pliant_mesh_locate(&all, inside, barycentric);
        ASSERT_GE(tet, 0);
        for (int v = 0; v < 4; v++) {
            int32_t node = all.tets[4 * tet + v];
            if (barycentric[v] < 0.99) continue;
            for (int d = 0; d < 3; d++) {
                most = std::fmax(most, std::fabs(whole->data->positions[3 * node + d] - half.data->positions[3 * n + d]));
                moved = std::fmax(moved, std::fabs(half.data->positions[3 * n + d] - mesh.rest[3 * n + d]));
            }
        }
    }
    EXPECT_GT(moved, 1e-3);
    EXPECT_LT(most, 1e-5 * moved + 1e-8);
}
INSTANTIATE_TEST_SUITE_P(Methods, EveryHalf, testing::Values(direct, multigrid, hexahedra, averaged_hexahedra, coarse_hexahedra, plain, averaged, octree, relaxed), name_of);

// A plane through coarse tetrahedra: they fall into fragments, which hang together as the fine mesh does.
TEST(Adapt, FragmentsOfCoarseTetrahedraNest)
{
    const double x = 0.06;
    for (const Case *each : {&plain, &averaged}) {
        std::unique_ptr<Body> body = make(*each), fine = make(direct);
        for (double &g : body->scene.model.gravity) g = 0;
        ASSERT_EQ(body->build(), PLIANT_OK);
        cut(*body, x);
        const pliant_body *now = body->data->body, *load = body->model->body;
        EXPECT_GT(now->coarse.num_tets, load->coarse.num_tets);
        EXPECT_EQ(now->coarse.num_tets - load->coarse.num_tets, std::count_if(now->changes.touched_coarse, now->changes.touched_coarse + now->changes.num_touched_coarse, [&](int32_t t) {
            bool left = false, right = false;
            for (int v = 0; v < 4; v++) (load->coarse.rest[3 * load->coarse.tets[4 * t + v]] < x ? left : right) = true;
            return left && right;
        }));
        // no node, fine or coarse, is of both sides
        for (int c = 0; c < 2; c++) {
            const pliant_mesh &mesh = c ? now->coarse : now->fine;
            std::vector<int> sides(static_cast<size_t>(mesh.num_nodes));
            for (int32_t t = 0; t < now->fine.num_tets; t++) {
                double centre = 0;
                for (int v = 0; v < 4; v++) centre += now->fine.rest[3 * now->fine.tets[4 * t + v]] / 4;
                for (int v = 0; v < 4; v++) sides[mesh.tets[4 * (c ? now->coarse_of_fine[t] : t) + v]] |= centre < x ? 1 : 2;
            }
            EXPECT_EQ(std::count(sides.begin(), sides.end(), 3), 0);
            EXPECT_EQ(std::count(sides.begin(), sides.end(), 0), 0);
        }
        for (int32_t n = 0; n < now->coarse.num_nodes; n++) {
            int32_t node = now->fine_of_coarse[n];
            for (int d = 0; d < 3 && node >= 0; d++) EXPECT_NEAR(now->fine.rest[3 * node + d], now->coarse.rest[3 * n + d], 1e-12);
        }
        // a pull at the right part does not reach the left one, and moves its own as far as on the fine mesh, as far as coarse elements can
        double moved[2] = {0, 0};
        for (Body *one : {body.get(), fine.get()}) {
            int tool;
            const double at[3] = {0.13, 0.08, 0.15};
            for (double &g : one->data->gravity) g = 0;
            if (one == fine.get()) cut(*one, x);
            ASSERT_EQ(pliant_tool_add(one->model, one->data, "tool", &tool), PLIANT_OK);
            ASSERT_EQ(pliant_tool_grasp(one->model, one->data, tool, at), PLIANT_OK);
            const double force[3] = {0, 0.2, 0};
            ASSERT_EQ(pliant_tool_set_drive(one->data, tool, PLIANT_DRIVE_FORCE, force), PLIANT_OK);
            ASSERT_EQ(pliant_data_set_limits(one->data, 200, 1e-9), PLIANT_OK);
            for (int s = 0; s < 30; s++) ASSERT_GE(pliant_step(one->model, one->data), 0);
            const pliant_mesh &mesh = one->data->body->fine;
            double left = 0;
            for (int32_t t = 0; t < mesh.num_tets; t++)
                for (int v = 0; v < 4; v++) {
                    double centre = 0;
                    for (int w = 0; w < 4; w++) centre += mesh.rest[3 * mesh.tets[4 * t + w]] / 4;
                    int32_t i = 3 * mesh.tets[4 * t + v] + 1;
                    double by = std::fabs(one->data->positions[i] - mesh.rest[i]);
                    if (centre < x) left = std::fmax(left, by);
                    else moved[one == fine.get()] = std::fmax(moved[one == fine.get()], by);
                }
            EXPECT_LT(left, 1e-12) << each->name;
        }
        EXPECT_GT(moved[1], 2e-3);
        EXPECT_NEAR(moved[0] / moved[1], 1, 0.4) << each->name;
    }
}

TEST(Adapt, UndoTakesTheBodyBeforeAndResetTheFirst)
{
    std::unique_ptr<Body> body = make(direct);
    take_hold(*body);
    step(*body, 3);
    cut(*body, 0.08, 0.05);
    const pliant_body *first = pliant_body_retain(body->data->body);
    step(*body, 3);
    cut(*body, 0.04, 0.05);
    EXPECT_EQ(body->data->body->revision, 3u);
    EXPECT_EQ(body->data->body->changes.since, 2u);
    step(*body, 3);
    ASSERT_EQ(pliant_data_set_body(body->model, body->data, first), PLIANT_OK) << pliant_last_error(); // undo
    EXPECT_EQ(body->data->body->revision, 2u);
    pliant_body_release(first);
    step(*body, 3);
    EXPECT_EQ(body->data->last_revision, 3u);
    ASSERT_EQ(pliant_data_reset(body->model, body->data), PLIANT_OK) << pliant_last_error();
    EXPECT_EQ(body->data->body, body->model->body);
    // as if it had just been made
    std::unique_ptr<Body> fresh = make(direct);
    take_hold(*fresh);
    take_hold(*body);
    for (int t = 0; t < 2; t++) ASSERT_EQ(pliant_tool_set_pose(body->data, t, fresh->data->tools[t].tip, nullptr), PLIANT_OK);
    for (int t = 0; t < 2; t++) std::copy(fresh->data->tools[t].grip, fresh->data->tools[t].grip + 3, body->data->tools[t].grip);
    step(*body, 4);
    step(*fresh, 4);
    EXPECT_EQ(state(*body), state(*fresh));
}

TEST(Adapt, LodRefusesWhatItCannotDivide)
{
    std::unique_ptr<Body> body = make(lod), other = make(lod);
    step(*body, 2);
    step(*other, 2);
    const pliant_body *next = divide(body->data->body, 2, split(*body->data->body, 0.08, 0.05));
    ASSERT_TRUE(next);
    EXPECT_EQ(pliant_data_set_body(body->model, body->data, next), PLIANT_ERROR_SCENE);
    pliant_body_release(next);
    step(*body, 2);
    step(*other, 2);
    EXPECT_EQ(state(*body), state(*other));
}

// ---- a model is shared

TEST(Adapt, TwoSimulationsOfOneModelOnTwoThreads)
{
    for (const Case *each : {&direct, &multigrid, &averaged, &patch, &dynamic}) {
        std::unique_ptr<Body> one = make(*each);
        pliant_data *second = nullptr;
        ASSERT_EQ(pliant_data_create(one->model, &second), PLIANT_OK);
        auto run = [](Body &body) {
            take_hold(body);
            step(body, 4);
            cut(body, 0.08, 0.09);
            step(body, 4);
        };
        // the same model under another data; a view that owns nothing
        std::unique_ptr<Body> alone = make(*each);
        run(*alone);
        Body view(size, box, {{4000, 0.4, 1000, false}});
        view.scene = one->scene;
        view.model = one->model;
        view.data = second;
        std::thread other([&] { run(view); });
        run(*one);
        other.join();
        EXPECT_EQ(state(*one), state(*alone)) << each->name;
        EXPECT_EQ(state(view), state(*alone)) << each->name;
        pliant_data_free(second);
        view.data = nullptr;
        view.model = nullptr;
    }
}

} // namespace
