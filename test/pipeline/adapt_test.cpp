// Successive bodies of a running simulation: derived data are carried over to the next body.
#include "adapt_cases.h"
#include "base/memory.h"
#include "mesh/mesh.h"

namespace {

struct EveryMethod : testing::TestWithParam<Case> {};
std::string name_of(const testing::TestParamInfo<Case> &info) { return info.param.name; }

// ---- nothing changes

TEST_P(EveryMethod, ARevisionOfTheSameTopologyChangesNoBits)
{
    std::unique_ptr<Body> one = make(GetParam()), other = make(GetParam());
    grasp_at_two_points(*one);
    grasp_at_two_points(*other);
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
    // back to the initial body
    ASSERT_EQ(pliant_data_reset(other->model, other->data), PLIANT_OK);
    EXPECT_EQ(other->data->body, other->model->body);
    ASSERT_EQ(pliant_data_reset(one->model, one->data), PLIANT_OK);
    step(*one, 2);
    step(*other, 2);
    EXPECT_EQ(state(*one), state(*other));
}
INSTANTIATE_TEST_SUITE_P(Methods, EveryMethod,
                         testing::Values(direct, multigrid, hexahedra, averaged_hexahedra, coarse_hexahedra, plain,
                                         schur, averaged, lod, patch, octree, dynamic, cubes, relaxed),
                         name_of);

// ---- a real change

struct EveryDivisible : testing::TestWithParam<Case> {};

// Wait until no other thread allocates memory. In these tests an allocation would fail on purpose.
void wait_for_background(const Body &body)
{
    while (body.data->solver && pliant_refresh_is_busy(body.data->solver))
        std::this_thread::sleep_for(std::chrono::milliseconds(1));
}

// Without memory for the next body, the previous body continues with bitwise identical results.
TEST_P(EveryDivisible, OutOfMemoryKeepsThePreviousBody)
{
    std::unique_ptr<Body> one = make(GetParam()), other = make(GetParam());
    grasp_at_two_points(*one);
    grasp_at_two_points(*other);
    step(*one, 4);
    step(*other, 4);
    const pliant_body *next = divide(other->data->body, 2, split(*other->data->body, 0.08, 0.09));
    ASSERT_TRUE(next);
    std::vector<int64_t> failed;
    wait_for_background(*one);
    wait_for_background(*other);
    const size_t before = pliant_memory_in_use();
    // fail every early allocation, then only some, because preparing takes long
    for (int64_t n = 0;; n += n < 24 ? 1 : 1 + n / 4) {
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
    // the body was set in the end
    ASSERT_EQ(pliant_data_set_body(other->model, other->data, other->model->body), PLIANT_OK);
    pliant_body_release(next);

    std::unique_ptr<Body> third = make(GetParam());
    grasp_at_two_points(*third);
    step(*third, 4);
    wait_for_background(*third);
    next = divide(third->data->body, 2, split(*third->data->body, 0.08, 0.09));
    for (int64_t n : failed) {
        if (2 * n > failed.back()) break; // the number of allocations varies slightly with the schedule of the threads
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

// A body at rest has no history. Cut there, it moves as a body that was divided from the start.
TEST_P(EveryDivisible, ACutBodyMovesLikeTwoSeparateBodies)
{
    std::unique_ptr<Body> apart = make(GetParam()), whole = make(GetParam());
    // the divided body is the initial body of the second model
    const pliant_body *next = divide(apart->model->body, 2, split(*apart->model->body, 0.08, 0.05));
    ASSERT_TRUE(next);
    ASSERT_EQ(pliant_data_set_body(apart->model, apart->data, next), PLIANT_OK) << pliant_last_error();
    pliant_body_release(next);
    for (Body *body : {apart.get(), whole.get()}) {
        grasp_at_two_points(*body);
        ASSERT_EQ(pliant_data_set_limits(body->data, 200, 1e-9), PLIANT_OK);
    }
    step(*whole, 3);
    for (int t = 0; t < 2; t++) // move the tools of the divided body to the same positions
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
            for (int32_t i = 0; i < 3 * mesh.num_nodes; i++)
                moved = std::fmax(moved, std::fabs(body.data->positions[i] - before[i]));
            std::copy(body.data->positions, body.data->positions + 3 * mesh.num_nodes, before.begin());
        }
        return before;
    };
    std::vector<double> x = rest(*whole), y = rest(*apart);
    double maximum = 0, max_opening = 0;
    for (int32_t i = 0; i < 3 * mesh.num_nodes; i++) maximum = std::fmax(maximum, std::fabs(x[i] - y[i]));
    for (int32_t n = whole->model->body->fine.num_nodes; n < mesh.num_nodes; n++) {
        int32_t source = whole->data->body->node_parent[n];
        max_opening = std::fmax(max_opening, std::fabs(x[3 * n + 1] - x[3 * source + 1]));
    }
    EXPECT_LT(maximum, 2e-6);
    EXPECT_GT(max_opening, 1e-3); // the tools shear the halves along y, and the cut permits it
}
// ---- copied data away from a cut are bitwise identical to recomputed data

template <class T> void expect_same(const T *a, const T *b, size_t count, const char *what)
{
    ASSERT_EQ(a == nullptr, b == nullptr) << what;
    if (a) EXPECT_EQ(std::memcmp(a, b, count * sizeof *a), 0) << what;
}

void expect_same(const pliant_macros &a, const pliant_macros &b)
{
    ASSERT_EQ(a.count, b.count);
    const size_t count = static_cast<size_t>(a.count);
    expect_same(a.start, b.start, count + 1, "corners");
    const size_t corners = static_cast<size_t>(a.start[count]);
    expect_same(a.node, b.node, corners, "elements' nodes");
    expect_same(a.held, b.held, corners, "held corners");
    expect_same(a.grounded, b.grounded, count, "grounded elements");
    expect_same(a.own, b.own, 8 * count, "own nodes");
    expect_same(a.gradient, b.gradient, 24 * count, "elements' gradients");
    expect_same(a.shear, b.shear, count, "elements' weights");
    expect_same(a.cell, b.cell, count, "cells");
    expect_same(a.rank, b.rank, count, "ranks");
    for (size_t e = 0; e < count; e++)
        expect_same(a.root[e], b.root[e], static_cast<size_t>(3 * a.rank[e] * (a.start[e + 1] - a.start[e])), "roots");
}

void expect_same(const pliant_system &a, const pliant_system &b)
{
    ASSERT_EQ(a.num_free, b.num_free);
    ASSERT_EQ(a.macros == nullptr, b.macros == nullptr);
    if (a.macros) expect_same(*a.macros, *b.macros);
    const size_t blocks = static_cast<size_t>(a.num_blocks), tets = static_cast<size_t>(a.mesh->num_tets),
                 fine = static_cast<size_t>(a.fine->num_nodes);
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
    if (a.upsample->node) expect_same(a.upsample->node, b.upsample->node, corners * fine, "followed nodes");
    if (a.upsample->weights) expect_same(a.upsample->weights, b.upsample->weights, corners * fine, "weights");
    expect_same(a.upsample->start, b.upsample->start, fine + 1, "entries");
    if (!a.upsample->start) return;
    const size_t entries = static_cast<size_t>(a.upsample->start[fine]);
    expect_same(a.upsample->entry_element, b.upsample->entry_element, entries, "entries' elements");
    expect_same(a.upsample->entry_weight, b.upsample->entry_weight, entries, "shares");
    expect_same(a.upsample->entry_shape, b.upsample->entry_shape, 9 * corners * entries, "shapes");
}

const Plane slanted{{0.075, 0.08, 0.08}, {0.95, 0.2, 0.24}};
std::function<bool(const double *)> above(double z)
{
    return [z](const double *x) { return x[2] > z; };
}

struct EveryFragment : testing::TestWithParam<Case> {};
TEST_P(EveryFragment, IncrementalUpdateEqualsRebuild)
{
    std::unique_ptr<Body> body = make(GetParam());
    std::vector<int8_t> sides;
    std::vector<const pliant_body *> bodies = {pliant_body_retain(body->model->body)};
    auto compare = [&](const pliant_body *next) {
        ASSERT_EQ(pliant_data_set_body(body->model, body->data, next), PLIANT_OK) << pliant_last_error();
        const pliant_discretization *rebuilt = nullptr, *made = body->data->discretization;
        ASSERT_EQ(pliant_discretization_create(&body->scene, next, &rebuilt), PLIANT_OK) << pliant_last_error();
        if (!made->tled) expect_same(*made->system, *rebuilt->system);
        pliant_discretization_release(rebuilt);
    };
    for (double z : {0.11, 0.06}) { // two strokes through fragments of fine tetrahedra
        const pliant_body *before = bodies.back(),
                          *next = sever_plane(before, before->revision + 1, slanted, above(z), &sides);
        ASSERT_TRUE(next) << pliant_last_error();
        bodies.push_back(next);
        EXPECT_GT(next->fine.num_tets, before->fine.num_tets);
        EXPECT_LT(next->changes.num_touched, before->fine.num_tets / 2);
        compare(next);
    }
    compare(bodies[1]); // back to an earlier body
    compare(bodies[2]);
    ASSERT_EQ(pliant_data_set_body(body->model, body->data, body->model->body), PLIANT_OK) << pliant_last_error();
    EXPECT_EQ(body->data->discretization, body->model->discretization);
    for (const pliant_body *each : bodies) pliant_body_release(each);
}

// With steps between strokes and pulling tools, the simulation stays valid. It converges to the same state as a body
// that was cut at rest.
struct EveryStroke : testing::TestWithParam<Case> {};
TEST_P(EveryStroke, WhileItMoves)
{
    std::unique_ptr<Body> moving = make(GetParam()), resting = make(GetParam());
    std::vector<int8_t> sides, other;
    for (Body *body : {moving.get(), resting.get()}) grasp_at_two_points(*body);
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
    for (int t = 0; t < 2; t++)
        ASSERT_EQ(pliant_tool_set_pose(resting->data, t, moving->data->tools[t].tip, nullptr), PLIANT_OK);
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
    double maximum = 0, moved = 0;
    for (size_t i = 0; i < count; i++) {
        maximum = std::fmax(maximum, std::fabs(moving->data->positions[i] - resting->data->positions[i]));
        moved = std::fmax(moved, std::fabs(moving->data->positions[i] - moving->data->body->fine.rest[i]));
    }
    EXPECT_GT(moved, 5e-3);
    EXPECT_LT(maximum, 1e-3 * moved);
}
INSTANTIATE_TEST_SUITE_P(Methods, EveryFragment,
                         testing::Values(direct, multigrid, hexahedra, averaged_hexahedra, coarse_hexahedra, plain,
                                         schur, averaged, patch, dynamic, cubes, relaxed),
                         name_of);

// A sagging bar is cut half through in one step. The first step after the cut must be near the equilibrium, which is
// computed with a third more evaluations than a step has. Other loads contribute too.
struct First {
    const char *name;
    double within; // relative to the maximum displacement
    void (*set)(Body &body);
};
void hold_by_spring(Body &body)
{
    const double end[3] = {0.27, 0.035, 0.035};
    int tool = -1;
    ASSERT_EQ(pliant_tool_add(body.model, body.data, "spring", &tool), PLIANT_OK);
    ASSERT_EQ(pliant_tool_set_pose(body.data, tool, end, nullptr), PLIANT_OK);
    ASSERT_EQ(pliant_tool_grasp(body.model, body.data, tool, end), PLIANT_OK) << pliant_last_error();
    ASSERT_EQ(pliant_tool_set_drive(body.data, tool, PLIANT_DRIVE_SPRING, nullptr), PLIANT_OK);
}
void push_aside(Body &body)
{
    const double at[3] = {0.2, -0.01, 0};
    pliant_tool_shape rod{};
    rod.num_parts = 1;
    rod.part[0] = {PLIANT_PART_CAPSULE, PLIANT_FRAME_TIP, {0, 0, -0.3}, {0, 0, 0.3}, 0.015, false};
    int tool = -1;
    ASSERT_EQ(pliant_tool_add(body.model, body.data, "rod", &tool), PLIANT_OK);
    ASSERT_EQ(pliant_tool_set_shape(body.data, tool, &rod), PLIANT_OK) << pliant_last_error();
    ASSERT_EQ(pliant_tool_set_pose(body.data, tool, at, nullptr), PLIANT_OK);
}
double ticks(void *user) { return *static_cast<double *>(user) += 1e-5; }
double clock_of_test = 0;
void give_time(Body &body)
{
    body.data->clock.budget = 1;
    body.data->clock.now = ticks;
    body.data->clock.user = &clock_of_test;
}
struct FirstStep : testing::TestWithParam<First> {};
TEST_P(FirstStep, FirstStepRotatesTheHangingPart)
{
    const int cells[3] = {16, 4, 4};
    const double bar[3] = {0.28, 0.07, 0.07};
    const Plane plane{{0.078, 0.035, 0.035}, {1, 0.05, 0.02}};
    Body tight(cells, bar, {{10000, 0.4, 1000, false}}), fast(cells, bar, {{10000, 0.4, 1000, false}}),
        cycle(cells, bar, {{10000, 0.4, 1000, false}});
    double whole = 0;
    for (Body *body : {&tight, &fast, &cycle}) {
        body->fix_plane(1e-6, 0, 0, 1, 0, 0);
        body->cells(16, 4, 4, 1);
        body->scene.solver.preconditioner = body == &cycle ? PLIANT_MULTIGRID : PLIANT_DIRECT;
        body->scene.solver.iterations = body == &tight ? 60 : 6;
        body->scene.solver.tolerance = body == &tight ? 1e-6 : 1e-7;
        body->scene.model.gravity[2] = -0.6;
        body->scene.grasp.stiffness = 2;
        ASSERT_EQ(body->build(), PLIANT_OK) << pliant_last_error();
        GetParam().set(*body);
        for (int s = 0; s < 20; s++) ASSERT_GE(pliant_step(body->model, body->data), 0) << pliant_last_error();
        const pliant_body *next =
            sever_plane(body->data->body, 2, plane, [&](const double *x) { return x[2] > 0.035; });
        ASSERT_TRUE(next);
        ASSERT_EQ(pliant_data_set_body(body->model, body->data, next), PLIANT_OK) << pliant_last_error();
        pliant_body_release(next);
        const size_t nodes = static_cast<size_t>(body->data->body->fine.num_nodes);
        const auto apart = [&](const double *a, const double *b) {
            double maximum = 0;
            for (size_t n = 0; n < 3 * nodes; n += 3)
                maximum =
                    std::fmax(maximum, std::hypot(std::hypot(a[n] - b[n], a[n + 1] - b[n + 1]), a[n + 2] - b[n + 2]));
            return maximum;
        };
        if (body == &tight) {
            for (int s = 0; s < 8; s++) ASSERT_GE(pliant_step(body->model, body->data), 0) << pliant_last_error();
            whole = apart(tight.data->positions, tight.data->body->fine.rest);
            continue;
        }
        EXPECT_GT(apart(body->data->positions, tight.data->positions), 0.1 * whole);
        ASSERT_GE(pliant_step(body->model, body->data), 0) << pliant_last_error();
        EXPECT_LE(body->data->statistics.iterations, 8);
        EXPECT_LT(apart(body->data->positions, tight.data->positions), GetParam().within * whole);
    }
}
INSTANTIATE_TEST_SUITE_P(Pulled, FirstStep,
                         testing::Values(First{"ByWeight", 0.02, [](Body &) {}},
                                         First{"BySpring", 0.02, hold_by_spring}, First{"AndPushed", 0.05, push_aside},
                                         First{"InTime", 0.02, give_time}),
                         [](const auto &info) { return info.param.name; });

// Without memory, the state is the state before the step, and the next step starts from it.
TEST(FirstStepAfterACut, WithoutMemoryLeavesTheStateBefore)
{
    const int cells[3] = {8, 2, 2};
    const double bar[3] = {0.28, 0.07, 0.07};
    const Plane plane{{0.078, 0.035, 0.035}, {1, 0.05, 0.02}};
    Body body(cells, bar, {{10000, 0.4, 1000, false}});
    body.fix_plane(1e-6, 0, 0, 1, 0, 0);
    body.cells(8, 2, 2, 1);
    body.scene.solver.iterations = 6;
    body.scene.solver.refresh_interval = 0;
    body.scene.model.gravity[2] = -0.6;
    ASSERT_EQ(body.build(), PLIANT_OK) << pliant_last_error();
    push_aside(body);
    hold_by_spring(body);
    for (int s = 0; s < 20; s++) ASSERT_GE(pliant_step(body.model, body.data), 0) << pliant_last_error();
    const pliant_body *next = sever_plane(body.data->body, 2, plane, [&](const double *x) { return x[2] > 0.035; });
    ASSERT_TRUE(next);
    ASSERT_EQ(pliant_data_set_body(body.model, body.data, next), PLIANT_OK) << pliant_last_error();
    pliant_body_release(next);
    // allocates the buffers that are kept between steps
    ASSERT_GE(pliant_step(body.model, body.data), 0) << pliant_last_error();
    wait_for_background(body); // until the factor of the cut body is computed, so that no other thread allocates memory
    pliant_solver *solver = body.data->solver;
    const size_t count = 3 * static_cast<size_t>(solver->system->mesh->num_nodes);
    const std::vector<double> before(solver->now.x, solver->now.x + count);
    solver->is_after_cut = true;
    int failed = 0;
    for (int64_t n = 0;; n++) {
        pliant_memory_fail_after(n);
        const pliant_status status = pliant_step(body.model, body.data);
        pliant_memory_fail_after(-1);
        if (status >= 0) break;
        ASSERT_EQ(status, PLIANT_ERROR_MEMORY) << "allocation " << n << ": " << pliant_last_error();
        ASSERT_TRUE(std::equal(before.begin(), before.end(), solver->now.x)) << "allocation " << n;
        ASSERT_TRUE(solver->is_after_cut) << "allocation " << n;
        failed++;
    }
    EXPECT_GT(failed, 3);
    EXPECT_FALSE(solver->is_after_cut);
}

// The background results that a live run used while it was cut give bitwise identical results in a replay.
struct EveryReplay : testing::TestWithParam<Case> {};
TEST_P(EveryReplay, OfALiveRunThatIsCut)
{
    std::unique_ptr<Body> live = make(GetParam()), again = make(GetParam());
    std::vector<int8_t> sides[2];
    for (Body *body : {live.get(), again.get()}) grasp_at_two_points(*body);
    ASSERT_EQ(pliant_data_set_background(live->data, PLIANT_BACKGROUND_LIVE, 0), PLIANT_OK);
    uint32_t all = 0;
    for (int s = 0; s < 40; s++) {
        for (int b = 0; b < 2; b++) {
            Body &body = b ? *again : *live;
            if (s % 3 == 2 && s < 16) {
                const pliant_body *next = sever_plane(body.data->body, body.data->last_revision + 1, slanted,
                                                      above(0.14 - 0.005 * s), sides + b);
                ASSERT_TRUE(next) << pliant_last_error();
                ASSERT_EQ(pliant_data_set_body(body.model, body.data, next), PLIANT_OK) << pliant_last_error();
                pliant_body_release(next);
            }
            if (b) {
                ASSERT_EQ(pliant_data_set_background(body.data, PLIANT_BACKGROUND_PRESCRIBED,
                                                     pliant_data_get_background_taken(live->data)),
                          PLIANT_OK);
                all |= pliant_data_get_background_taken(live->data);
            }
            step(body, 1);
        }
        ASSERT_EQ(pliant_data_get_background_taken(live->data), pliant_data_get_background_taken(again->data))
            << "step " << s;
        ASSERT_EQ(state(*live), state(*again)) << "step " << s;
        std::this_thread::sleep_for(std::chrono::milliseconds(3));
    }
    EXPECT_TRUE(all & PLIANT_RESULT_FACTOR);
    EXPECT_GT(live->data->statistics.factors, 0u);
}
INSTANTIATE_TEST_SUITE_P(Methods, EveryReplay, testing::Values(direct, multigrid, hexahedra, averaged, patch), name_of);
INSTANTIATE_TEST_SUITE_P(Methods, EveryStroke,
                         testing::Values(direct, multigrid, hexahedra, averaged_hexahedra, plain, schur, averaged,
                                         relaxed),
                         name_of);
INSTANTIATE_TEST_SUITE_P(Methods, EveryDivisible,
                         testing::Values(direct, multigrid, hexahedra, averaged_hexahedra, coarse_hexahedra, plain,
                                         schur, schur_hexahedra, averaged, patch, patch_hexahedra, octree,
                                         octree_hexahedra, dynamic, cubes, relaxed),
                         name_of);

// ---- independent check: the left half of a divided body equals a body of half the width

struct EveryHalf : testing::TestWithParam<Case> {};
TEST_P(EveryHalf, OfABodyInTwoIsABodyOfItsOwn)
{
    std::unique_ptr<Body> whole = make(GetParam());
    const int half_size[3] = {8, 16, 16};
    const double half_box[3] = {0.08, 0.16, 0.16};
    Body half(half_size, half_box, {{4000, 0.4, 1000, false}, {20000, 0.4, 1200, false}},
              [](int i, int, int k) { return (i < 6 || i > 9) && k > 9; });
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
    double maximum = 0, moved = 0;
    for (int32_t n = 0; n < mesh.num_nodes; n++) {
        double barycentric[4], inside[3];
        for (int d = 0; d < 3; d++)
            inside[d] = mesh.rest[3 * n + d] + 1e-7 * ((d ? 0.08 : 0.04) - mesh.rest[3 * n + d]);
        int32_t tet = pliant_mesh_locate(&all, inside, barycentric);
        ASSERT_GE(tet, 0);
        for (int v = 0; v < 4; v++) {
            int32_t node = all.tets[4 * tet + v];
            if (barycentric[v] < 0.99) continue;
            for (int d = 0; d < 3; d++) {
                maximum = std::fmax(maximum,
                                    std::fabs(whole->data->positions[3 * node + d] - half.data->positions[3 * n + d]));
                moved = std::fmax(moved, std::fabs(half.data->positions[3 * n + d] - mesh.rest[3 * n + d]));
            }
        }
    }
    EXPECT_GT(moved, 1e-3);
    EXPECT_LT(maximum, 1e-5 * moved + 1e-8);
}
// coarse methods use fine elements next to the cut
INSTANTIATE_TEST_SUITE_P(Methods, EveryHalf, testing::Values(direct, multigrid, hexahedra, octree, relaxed), name_of);

} // namespace
