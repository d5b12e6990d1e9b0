// Detached pieces fall, land, and swing on tools. They do not affect the rest of the body.
#include "hanging_bar.h"
#include "fem/rigid/rigid_pieces_data.h"
#include "base/memory.h"

#include <algorithm>
#include <memory>

namespace {

struct EveryMethod : testing::TestWithParam<Case> {};
std::string name_of(const testing::TestParamInfo<Case> &info) { return info.param.name; }

TEST_P(EveryMethod, DetachedPiecesFallFreely)
{
    std::unique_ptr<Body> body = hang(GetParam());
    step(*body, 3);
    cut(*body, 0.08);
    ASSERT_TRUE(body->data->body->pieces);
    EXPECT_EQ(body->data->body->pieces->count, 1);
    EXPECT_EQ(body->data->body->num_held_pieces, 0);
    const std::vector<int32_t> lower = nodes_below(*body->data->body, 0.08);
    EXPECT_EQ(body->data->body->pieces->start[1], static_cast<int32_t>(lower.size()));
    double narrow = 0; // narrowing caused by its weight
    for (int32_t n : lower)
        narrow = std::fmax(narrow, std::fabs(body->data->positions[3 * n] - body->data->body->fine.rest[3 * n]));
    const double start = centre_of(*body, lower)[2], moving = body->data->body->has_inertia;
    // in explicit dynamics it already has a velocity
    double before = start, speed = 0;
    if (moving) {
        step(*body, 1);
        before = centre_of(*body, lower)[2];
        speed = (before - start) / body->scene.solver.step + 0.5 * g * body->scene.solver.step;
    }
    for (int s = moving ? 2 : 1; s <= 30; s++) {
        step(*body, 1);
        EXPECT_EQ(body->data->statistics.rigid_pieces, 1);
        const double t = s * body->scene.solver.step, fallen = start - centre_of(*body, lower)[2];
        EXPECT_NEAR(fallen, 0.5 * g * t * t - speed * t, 0.01 * 0.5 * g * t * t) << s;
    }
    // without forces nothing stays stretched or rotated
    if (moving) return;
    step(*body, static_cast<int>(0.25 / body->scene.solver.step));
    const std::vector<double> centre = centre_of(*body, lower);
    double bent = 0;
    for (int32_t n : lower)
        bent = std::fmax(
            bent, std::fabs(body->data->positions[3 * n] - centre[0] - body->data->body->fine.rest[3 * n] + 0.02));
    EXPECT_LT(bent, 0.01 * narrow);
}
INSTANTIATE_TEST_SUITE_P(Methods, EveryMethod,
                         testing::Values(direct, multigrid, plain, averaged, patched, octree, hexahedra, relaxed,
                                         dynamic),
                         name_of);

// A brick of 4 x 4 x 8 cm: m / 12 (b^2 + c^2). Lumped masses at the nodes of 1 cm cubes add one sixth of a cube's
// squared edge for each axis.
TEST(Falling, APieceHasTheInertiaOfABrick)
{
    std::unique_ptr<Body> body = hang(direct);
    body->scene.model.gravity[2] = 0;
    ASSERT_EQ(body->build(), PLIANT_OK) << pliant_last_error();
    cut(*body, 0.08);
    ASSERT_TRUE(body->data->rigid_pieces);
    pliant_rigid piece;
    pliant_rigid_pieces_body(body->data->rigid_pieces, 0, &piece);
    EXPECT_NEAR(piece.mass, 0.128, 0.005 * 0.128);
    const double side[3] = {0.04, 0.04, 0.08}, cube = 0.01;
    for (int axis = 0; axis < 3; axis++) {
        const double b = side[(axis + 1) % 3], c = side[(axis + 2) % 3];
        const double expected = piece.mass / 12 * (b * b + c * c + 4 * cube * cube);
        EXPECT_NEAR(piece.inertia[4 * axis], expected, 0.02 * expected) << "axis " << axis;
    }
}

TEST_P(EveryMethod, DetachedPiecesLandAndRest)
{
    std::unique_ptr<Body> body = hang(GetParam(), -0.05);
    if (GetParam().name == dynamic.name) {
        body->scene.tled.damping = 5;
        ASSERT_EQ(body->build(), PLIANT_OK);
    }
    step(*body, 3);
    cut(*body, 0.08);
    const std::vector<int32_t> lower = nodes_below(*body->data->body, 0.08);
    const bool moving = body->data->body->has_inertia;
    double deepest = 0;
    for (int s = 0; s < (moving ? 2 : 1) / body->scene.solver.step; s++) {
        step(*body, 1);
        deepest = std::fmin(deepest, lowest(*body, lower) + 0.05);
    }
    EXPECT_GT(deepest, -1e-9);
    EXPECT_NEAR(lowest(*body, lower), -0.05, 1e-6);
    std::vector<double> before(body->data->positions, body->data->positions + 3 * body->data->body->fine.num_nodes);
    step(*body, 5);
    double moved = 0;
    for (int32_t n : lower)
        for (int d = 0; d < 3; d++)
            moved = std::fmax(moved, std::fabs(body->data->positions[3 * n + d] - before[3 * n + d]));
    EXPECT_LE(moved, moving ? 1e-3 : 0);
    if (!moving) EXPECT_EQ(body->data->statistics.rigid_pieces, 0);
}

// The remaining part does not depend on the position of the piece.
TEST_P(EveryMethod, TheRestOfTheBodyIsTheSameToTheBit)
{
    if (GetParam().name == dynamic.name) return; // in explicit dynamics, forces have a common sum and time step
    std::unique_ptr<Body> falls = hang(GetParam()), lies = hang(GetParam(), -0.02);
    for (Body *body : {falls.get(), lies.get()}) {
        int tool;
        const double at[3] = {0.02, 0.02, 0.12}, force[3] = {0.05, 0, 0};
        ASSERT_EQ(pliant_tool_add(body->model, body->data, "tool", &tool), PLIANT_OK);
        ASSERT_EQ(pliant_tool_grasp(body->model, body->data, tool, at), PLIANT_OK) << pliant_last_error();
        ASSERT_EQ(pliant_tool_set_drive(body->data, tool, PLIANT_DRIVE_FORCE, force), PLIANT_OK);
        step(*body, 3);
        cut(*body, 0.08);
    }
    const std::vector<int32_t> upper = nodes_below(*falls->data->body, 0.08, false),
                               lower = nodes_below(*falls->data->body, 0.08);
    for (int s = 0; s < 30; s++) {
        step(*falls, 1);
        step(*lies, 1);
        int others = 0;
        for (int32_t n : upper)
            for (int d = 0; d < 3; d++) others += falls->data->positions[3 * n + d] != lies->data->positions[3 * n + d];
        ASSERT_EQ(others, 0) << s;
    }
    EXPECT_LT(lowest(*falls, lower) + 0.01, lowest(*lies, lower));
}

// A tool that grasps the piece moves it.
TEST_P(EveryMethod, AToolPullsIt)
{
    for (const double stiffness : {0.0, 50.0, 1e9}) {
        std::unique_ptr<Body> body = hang(GetParam());
        const bool moving = body->model->body->has_inertia;
        if (moving && stiffness != 50) continue; // tested in tled_test.cpp
        if (moving) {
            body->scene.tled.damping = 5;
            ASSERT_EQ(body->build(), PLIANT_OK);
        }
        int tool;
        const double at[3] = {0.02, 0.02, 0.065};
        step(*body, 3);
        ASSERT_EQ(pliant_tool_add(body->model, body->data, "tool", &tool), PLIANT_OK);
        ASSERT_EQ(pliant_tool_grasp(body->model, body->data, tool, at), PLIANT_OK) << pliant_last_error();
        if (stiffness > 0) body->data->tools[0].stiffness = stiffness;
        // critical damping: the piece does not bounce on the spring
        if (stiffness == 50 && !moving) body->data->tools[0].damping = 2 * std::sqrt(stiffness * 0.128);
        if (stiffness == 0) ASSERT_EQ(pliant_tool_set_drive(body->data, tool, PLIANT_DRIVE_RIGID, nullptr), PLIANT_OK);
        step(*body, 2);
        cut(*body, 0.08);
        const std::vector<int32_t> lower = nodes_below(*body->data->body, 0.08);
        double weight = 0, maximum = 0;
        for (int32_t n : lower) weight += g * body->data->body->node_mass[n];
        for (int s = 0; s < 4 / body->scene.solver.step; s++) {
            const double shift = std::fmin(s * 5e-4, 0.05);
            const double tip[3] = {body->data->tools[0].tip_offset[0] + 0.02 + shift,
                                   body->data->tools[0].tip_offset[1] + 0.02, body->data->tools[0].tip[2]};
            ASSERT_EQ(pliant_tool_set_pose(body->data, tool, tip, nullptr), PLIANT_OK);
            step(*body, 1);
            const pliant_tool &held = body->data->tools[0];
            for (int d = 0; d < 3 && stiffness != 50 && s > 60; d++) // before that it still springs back
                maximum = std::fmax(maximum, std::fabs(held.held_point[d] - held.tip[d] + held.tip_offset[d]));
        }
        const pliant_tool &held = body->data->tools[0];
        if (!moving) EXPECT_LT(maximum, 2e-5) << stiffness;
        EXPECT_NEAR(held.held_point[0] - 0.02, 0.05, 2e-3) << stiffness;
        EXPECT_NEAR(held.force[2], weight, 0.05 * weight) << stiffness;
        if (stiffness == 50 && !moving)
            EXPECT_NEAR(held.tip[2] - held.tip_offset[2] - held.held_point[2], weight / 50, 0.05 * weight / 50);
        // it hangs below the grasped point
        EXPECT_NEAR(centre_of(*body, lower)[0], held.held_point[0], 4e-3) << stiffness;
        pliant_tool_release(body->data, tool);
        const double height = centre_of(*body, lower)[2];
        step(*body, 20);
        const double t = 20 * body->scene.solver.step;
        EXPECT_NEAR(height - centre_of(*body, lower)[2], 0.5 * g * t * t, (moving ? 0.2 : 0.01) * 0.5 * g * t * t);
    }
}

// Undo restores the whole body at the cut; reset removes all cuts.
TEST_P(EveryMethod, UndoMakesItWhole)
{
    std::unique_ptr<Body> body = hang(GetParam());
    step(*body, 10);
    const pliant_body *first = pliant_body_retain(body->data->body);
    std::vector<double> before(body->data->positions, body->data->positions + 3 * first->fine.num_nodes);
    cut(*body, 0.08);
    step(*body, 30);
    cut(*body, 0.04);
    EXPECT_EQ(body->data->body->pieces->count, 2);
    step(*body, 10);
    ASSERT_EQ(pliant_data_set_body(body->model, body->data, first), PLIANT_OK) << pliant_last_error();
    EXPECT_FALSE(body->data->rigid_pieces);
    std::vector<int32_t> lower; // the nodes on the plane belong to the upper half
    for (int32_t n : nodes_below(*first, 0.08))
        if (first->fine.rest[3 * n + 2] < 0.08 - 1e-6) lower.push_back(n);
    double maximum = 0;
    for (int32_t n : lower)
        for (int d = 0; d < 3; d++)
            maximum = std::fmax(maximum, std::fabs(body->data->positions[3 * n + d] - before[3 * n + d]));
    EXPECT_LT(maximum, 1e-12);
    step(*body, 3);
    for (int32_t n : lower)
        maximum = std::fmax(maximum, std::fabs(body->data->positions[3 * n + 2] - before[3 * n + 2]));
    EXPECT_LT(maximum, 5e-3);
    pliant_body_release(first);
    ASSERT_EQ(pliant_data_reset(body->model, body->data), PLIANT_OK);
    EXPECT_FALSE(body->data->rigid_pieces);
    EXPECT_EQ(std::memcmp(body->data->positions, body->data->body->fine.rest, 3 * sizeof(double) * lower.size()), 0);
}

// A piece that nothing stops is stopped where it is no longer drawn.
TEST_P(EveryMethod, PiecesOutsideTheDrawnVolumeStop)
{
    std::unique_ptr<Body> body = hang(GetParam());
    body->scene.warp.margin = 0.05;
    ASSERT_EQ(body->build(), PLIANT_OK);
    static int warnings;
    warnings = 0;
    pliant_set_log([](pliant_log_level level, const char *text,
                      void *) { warnings += level == PLIANT_LOG_WARNING && std::strstr(text, "warp/margin"); },
                   nullptr);
    step(*body, 2);
    cut(*body, 0.08);
    cut(*body, 0.04);
    const std::vector<int32_t> lower = nodes_below(*body->data->body, 0.08);
    step(*body, 200);
    pliant_set_log(nullptr, nullptr);
    EXPECT_EQ(warnings, 1);
    EXPECT_EQ(body->data->statistics.rigid_pieces, 0);
    const double there = lowest(*body, lower);
    EXPECT_LT(there, -0.05);
    EXPECT_GT(there, -0.3);
    step(*body, 5);
    EXPECT_EQ(lowest(*body, lower), there);
}

// ---- a piece attached to one or two nodes swings

TEST(Falling, OnOneNodeOrTwoItSwings)
{
    std::unique_ptr<Body> alone = hang(direct);
    step(*alone, 5);
    cut(*alone, 0.08);
    step(*alone, 600);
    for (int nodes : {1, 2}) {
        std::unique_ptr<Body> body = hang(direct);
        step(*body, 5);
        cut(*body, 0.08, [&](const double *x) { return x[0] < 1e-6 && x[1] < (nodes == 1 ? 1e-6 : 0.01 + 1e-6); });
        const pliant_body *now = body->data->body;
        ASSERT_TRUE(now->pieces);
        ASSERT_EQ(now->pieces->num_joints, nodes);
        const std::vector<int32_t> lower = nodes_below(*now, 0.08), upper = nodes_below(*now, 0.08, false);
        // of the first and the last 2 s
        double difference = 0, before = centre_of(*body, lower)[0], minimum = before, swing[2] = {0, 0};
        for (int s = 0; s < 600; s++) {
            step(*body, 1);
            for (int j = 0; j < nodes && s > 40; j++) // before that it also springs back
                for (int d = 0; d < 3; d++)
                    difference =
                        std::fmax(difference, std::fabs(body->data->positions[3 * now->pieces->joint[2 * j] + d] -
                                                        body->data->positions[3 * now->pieces->joint[2 * j + 1] + d]));
            minimum = std::fmin(minimum, centre_of(*body, lower)[0]);
            if (s < 200 || s >= 400)
                swing[s >= 400] = std::fmax(swing[s >= 400], std::fabs(centre_of(*body, lower)[0]));
        }
        EXPECT_LT(difference, nodes == 1 ? 1e-4 : 1e-3);
        EXPECT_LT(minimum, -0.01) << nodes;            // swings to the other side
        EXPECT_LT(swing[1], 1.02 * swing[0]) << nodes; // no energy is added
        EXPECT_GT(swing[1], 0.9 * swing[0]) << nodes;  // and there is no air resistance
        // the remaining part moves as if it had no such nodes
        int others = 0;
        for (int32_t n : upper) others += body->data->positions[3 * n + 2] != alone->data->positions[3 * n + 2];
        EXPECT_EQ(others, 0);
    }
}

// Also in the initial mesh: two cubes with a common edge, one of them fixed. With a fixed position the other one would
// be inverted.
TEST(Falling, TissueHeldByAnEdgeAtLoadSwingsInExplicitDynamics)
{
    const int size[3] = {8, 8, 4};
    const double box[3] = {0.02, 0.02, 0.01};
    Body body(size, box, {{4000, 0.4, 1000, false}, {10, 0, 1, true}},
              [](int i, int j, int) { return (i < 4) != (j < 4); });
    body.fix_plane(0, 1e-6, 0, 0, 1, 0);
    body.cells(2, 2, 1, 1);
    body.scene.solver.kind = PLIANT_TLED;
    body.scene.solver.step = 0.01;
    body.scene.tled.damping = 5;
    body.scene.model.gravity[0] = 9.81;
    body.scene.model.gravity[1] = -3;
    ASSERT_EQ(body.build(), PLIANT_OK) << pliant_last_error();
    EXPECT_EQ(body.data->body->num_held_pieces, 0);
    for (int s = 0; s < 60; s++) {
        ASSERT_GE(pliant_step(body.model, body.data), 0);
        ASSERT_EQ(pliant_data_get_inverted(body.data), 0) << s;
    }
    const pliant_mesh &mesh = body.data->body->fine;
    double maximum = 0;
    for (int32_t n = 0; n < mesh.num_nodes; n++)
        if (mesh.rest[3 * n + 1] > 0.019)
            maximum = std::fmax(maximum, std::fabs(body.data->positions[3 * n] - mesh.rest[3 * n]));
    EXPECT_GT(maximum, 1e-3);
}

// nothing remains to be solved
TEST_P(EveryMethod, TheWholeBodyMayDetach)
{
    std::unique_ptr<Body> body = hang(GetParam());
    body->fix_plane(0, 0, 0.14 - 1e-6, 0, 0, -1);
    ASSERT_EQ(body->build(), PLIANT_OK) << pliant_last_error();
    step(*body, 3);
    cut(*body, 0.14);
    ASSERT_TRUE(body->data->body->pieces);
    const std::vector<int32_t> lower = nodes_below(*body->data->body, 0.14);
    const double start = centre_of(*body, lower)[2];
    step(*body, 10);
    EXPECT_LT(centre_of(*body, lower)[2], start - 5e-3);
    for (double x :
         std::vector<double>(body->data->positions, body->data->positions + 3 * body->data->body->fine.num_nodes))
        ASSERT_TRUE(std::isfinite(x));
    ASSERT_EQ(pliant_data_reset(body->model, body->data), PLIANT_OK) << pliant_last_error();
    step(*body, 3);
}

TEST(Falling, APieceOfAPieceKeepsItsVelocity)
{
    std::unique_ptr<Body> body = hang(direct), whole = hang(direct);
    for (Body *each : {body.get(), whole.get()}) {
        step(*each, 3);
        cut(*each, 0.08);
        step(*each, 10);
    }
    cut(*body, 0.04);
    EXPECT_EQ(body->data->body->pieces->count, 2);
    step(*body, 10);
    step(*whole, 10);
    const std::vector<int32_t> part = nodes_below(*body->data->body, 0.04);
    const std::vector<int32_t> same = nodes_below(*whole->data->body, 0.04);
    EXPECT_NEAR(lowest(*body, part), lowest(*whole, same), 1e-4); // each part springs back separately
}

// Expect the same pieces as a search of the whole body.
void expect_as_searched(const pliant_body &body)
{
    pliant_division none{};
    none.num_tets = body.fine.num_tets;
    none.corners = body.fine.tets;
    pliant_body *searched = nullptr;
    ASSERT_EQ(pliant_body_divide(&body, body.revision + 1, &none, &searched), PLIANT_OK) << pliant_last_error();
    const pliant_pieces &is = *body.pieces, &found = *searched->pieces;
    ASSERT_EQ(searched->fine.num_nodes, body.fine.num_nodes);
    ASSERT_EQ(is.count, found.count);
    ASSERT_EQ(is.num_joints, found.num_joints);
    ASSERT_EQ(is.num_inner, found.num_inner);
    EXPECT_EQ(std::memcmp(is.start, found.start, (size_t(is.count) + 1) * sizeof *is.start), 0);
    EXPECT_EQ(std::memcmp(is.node, found.node, size_t(is.start[is.count]) * sizeof *is.node), 0);
    EXPECT_EQ(std::memcmp(is.joint, found.joint, 2 * size_t(is.num_joints + is.num_inner) * sizeof *is.joint), 0);
    EXPECT_EQ(std::memcmp(body.fine_fixed, searched->fine_fixed, size_t(body.fine.num_nodes)), 0);
    pliant_body_release(searched);
}

TEST(Falling, CutsElsewhereLeavePiecesAsTheyAre)
{
    const Case severed{"sever", [](pliant_scene &scene) { scene.cut.kind = PLIANT_CUT_SEVER; }};
    std::unique_ptr<Body> body = hang(severed, -0.05);
    step(*body, 3);
    // detach a piece, then cut slits into both parts, by height; the last cuts detach more
    const double heights[] = {0.07, 0.11, 0.13, 0.03, 0.12, 0.05, 0.10, 0.02, 0.14},
                 through[] = {0.1, 0.04, 0.035, 0.04, 0.045, 0.03, 0.1, 0.1, 0.04};
    int maximum = 0, stayed = 0;
    for (int c = 0; c < 9; c++) {
        const double points[6] = {-0.01, -0.02, heights[c] + 0.004, 0.05, -0.02, heights[c] - 0.003},
                     depth[3] = {0, through[c], 0};
        pliant_cut_report report;
        ASSERT_EQ(pliant_data_cut(body->model, body->data, 2, points, depth, &report), PLIANT_OK)
            << pliant_last_error();
        ASSERT_GT(report.num_links, 0) << c;
        const pliant_body *now = body->data->body;
        ASSERT_TRUE(now->pieces) << c;
        expect_as_searched(*now);
        stayed += now->pieces->count == maximum;
        maximum = now->pieces->count;
    }
    EXPECT_GE(stayed, 4);
    EXPECT_GE(maximum, 2);
}

TEST(Falling, OutOfMemoryKeepsThePreviousBody)
{
    const Case alone{"alone", [](pliant_scene &scene) {
                         scene.solver.refresh_interval = 0;
                         scene.solver.refresh_delay = 1;
                     }}; // nothing remains in the background after some steps
    std::unique_ptr<Body> body = hang(alone), other = hang(alone);
    step(*body, 3);
    step(*other, 3);
    cut(*body, 0.08);
    cut(*other, 0.08);
    step(*body, 8);
    step(*other, 8);
    const pliant_body *next = divided(*body->data->body, 3, 0.04);
    const size_t before = pliant_memory_in_use();
    int failed = 0;
    for (int64_t n = 0;; n += n < 60 ? 1 : 1 + n / 8, failed++) {
        pliant_memory_fail_after(n);
        pliant_status status = pliant_data_set_body(body->model, body->data, next);
        pliant_memory_fail_after(-1);
        if (status == PLIANT_OK) break;
        ASSERT_EQ(status, PLIANT_ERROR_MEMORY);
        ASSERT_EQ(pliant_memory_in_use(), before) << n;
        ASSERT_EQ(std::memcmp(body->data->positions, other->data->positions,
                              3 * sizeof(double) * static_cast<size_t>(body->data->body->fine.num_nodes)),
                  0)
            << n;
    }
    EXPECT_GT(failed, 40);
    pliant_body_release(next);
    // including the computation of the body
    const size_t held = pliant_memory_in_use();
    for (int64_t n = 0;; n++) {
        pliant_division division{};
        division.num_tets = other->data->body->fine.num_tets;
        division.corners = other->data->body->fine.tets;
        pliant_body *made = nullptr;
        pliant_memory_fail_after(n);
        pliant_status status = pliant_body_divide(other->data->body, 3, &division, &made);
        pliant_memory_fail_after(-1);
        if (status == PLIANT_OK) {
            EXPECT_EQ(made->pieces->count, 1);
            pliant_body_release(made);
            break;
        }
        ASSERT_EQ(status, PLIANT_ERROR_MEMORY);
        ASSERT_EQ(pliant_memory_in_use(), held) << n;
    }
}

// ---- cuts by a blade: fragments instead of a plane of element faces

TEST_P(EveryMethod, APieceThatABladeDetachesFalls)
{
    const Case severed{GetParam().name, [&](pliant_scene &scene) {
                           GetParam().set(scene);
                           scene.cut.kind = PLIANT_CUT_SEVER;
                       }};
    std::unique_ptr<Body> body = hang(severed, -0.05);
    step(*body, 3);
    double sag = 0, count_there = 0; // where the blade will be
    for (int32_t n = 0; n < body->model->body->fine.num_nodes; n++) {
        const double z = body->data->positions[3 * n + 2];
        if (z < 0.06 || z > 0.08) continue;
        sag += body->model->body->fine.rest[3 * n + 2] - z;
        count_there++;
    }
    const double height = 0.069 + sag / count_there;
    const double points[6] = {-0.01, -0.02, 0.077, 0.05, -0.02, 0.061}, depth[3] = {0, 0.1, 0}; // slanted
    pliant_cut_report report;
    ASSERT_EQ(pliant_data_cut(body->model, body->data, 2, points, depth, &report), PLIANT_OK) << pliant_last_error();
    EXPECT_EQ(report.pieces, 2);
    ASSERT_TRUE(body->data->body->pieces);
    ASSERT_EQ(body->data->body->pieces->count, 1);
    const pliant_pieces &pieces = *body->data->body->pieces;
    const std::vector<int32_t> lower(pieces.node, pieces.node + pieces.start[1]);
    double mass = 0;
    for (int32_t n : lower) mass += body->data->body->node_mass[n];
    EXPECT_NEAR(mass, 1000 * 0.04 * 0.04 * height, 0.02 * 1000 * 0.04 * 0.04 * height);
    const double start = centre_of(*body, lower)[2];
    const int count = static_cast<int>(0.08 / body->scene.solver.step + 0.5);
    step(*body, count);
    if (!body->data->body->has_inertia)
        EXPECT_NEAR(start - centre_of(*body, lower)[2], 0.5 * g * 0.08 * 0.08, 0.01 * 0.5 * g * 0.08 * 0.08);
    step(*body, static_cast<int>(1 / body->scene.solver.step));
    EXPECT_GT(lowest(*body, lower), -0.05 - 1e-9);
    EXPECT_LT(lowest(*body, lower), -0.04);
    ASSERT_EQ(pliant_data_undo_cut(body->model, body->data), PLIANT_OK) << pliant_last_error();
    EXPECT_FALSE(body->data->rigid_pieces);
    step(*body, 3);
    std::vector<int32_t> all(static_cast<size_t>(body->data->body->fine.num_nodes));
    for (size_t n = 0; n < all.size(); n++) all[n] = static_cast<int32_t>(n);
    EXPECT_GT(lowest(*body, all), -0.03);
}

} // namespace
