// Successive bodies: coarse elements, undo, rejected bodies, and simulations that share a model.
#include "adapt_cases.h"

namespace {

// Return whether an element equals, in single precision, the tetrahedron of these corners in the initial mesh.
bool is_tetrahedron_of(const pliant_system &load, const pliant_macros &macros, int32_t e)
{
    const int32_t *node = macros.node + macros.start[e];
    for (int32_t t = 0; macros.start[e + 1] - macros.start[e] == 4 && t < load.mesh->num_tets; t++) {
        if (!std::equal(node, node + 4, load.mesh->tets + 4 * t)) continue;
        double k[144], gradients[12], apart = 0;
        for (int m = 0; m < 12; m++) gradients[m] = load.gradients[t / LANES][m][t % LANES];
        if (load.stiffness) std::copy_n(load.stiffness + 144 * t, 144, k);
        else
            pliant_element_stiffness(gradients, load.lame[t / LANES][0][t % LANES], load.lame[t / LANES][1][t % LANES],
                                     k);
        for (int i = 0; i < 12; i++)
            for (int j = 0; j < 12; j++) {
                double sum = 0;
                for (int32_t r = 0; r < macros.rank[e]; r++)
                    sum += double(macros.root[e][12 * r + i]) * double(macros.root[e][12 * r + j]);
                apart = std::max(apart, std::fabs(sum - k[12 * i + j]));
            }
        return apart < 1e-5 * *std::max_element(k, k + 144);
    }
    return false;
}

// A plane through coarse elements: there the fine mesh's elements are used, each on one side only. Elsewhere the
// elements are unchanged, hexahedra bitwise identical.
TEST(Adapt, FineElementsReplaceCoarseOnesNextToACut)
{
    const double x = 0.06;
    for (const Case *each : {&plain, &averaged, &averaged_hexahedra}) {
        std::unique_ptr<Body> body = make(*each), fine = make(direct);
        for (double &g : body->scene.model.gravity) g = 0;
        ASSERT_EQ(body->build(), PLIANT_OK);
        cut(*body, x);
        const pliant_system *system = body->data->discretization->system, *load = body->model->system;
        const pliant_macros *macros = system->macros;
        const int32_t coarse = system->graded->coarse_nodes;
        EXPECT_EQ(coarse, load->mesh->num_nodes);
        std::map<std::vector<int32_t>, const float *> roots; // of elements of the initial mesh
        for (int32_t e = 0; load->macros && e < load->macros->count; e++)
            roots[{load->macros->node + load->macros->start[e], load->macros->node + load->macros->start[e + 1]}] =
                load->macros->root[e];
        int32_t kept = 0, between = 0;
        for (int32_t e = 0; e < macros->count; e++) {
            const int32_t begin = macros->start[e], corners = macros->start[e + 1] - begin;
            bool sides[2] = {false, false}, of_fine = false, of_coarse = false;
            for (int32_t c = begin; c < begin + corners; c++) {
                const double *rest = system->mesh->rest + 3 * macros->node[c];
                if (std::fabs(rest[0] - x) > 1e-9) sides[rest[0] > x] = true;
                (macros->node[c] < coarse ? of_coarse : of_fine) = true;
            }
            if (macros->rank[e] > 0) EXPECT_FALSE(sides[0] && sides[1]) << each->name;
            between += of_fine && of_coarse;
            if (of_fine) continue;
            kept++;
            if (!load->macros) {
                EXPECT_TRUE(is_tetrahedron_of(*load, *macros, e)) << each->name;
                continue;
            }
            const float *was = roots.at({macros->node + begin, macros->node + begin + corners});
            EXPECT_TRUE(std::equal(was, was + 3 * corners * macros->rank[e], macros->root[e])) << each->name;
        }
        EXPECT_GT(between, 0);
        EXPECT_GT(kept, 0);
        // A pull at the right part does not affect the left one. The right part moves like the part of the fine mesh,
        // within the accuracy of coarse elements.
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
            ASSERT_EQ(pliant_data_set_limits(one->data, 200, 1e-10), PLIANT_OK);
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

// A sphere of bone with nodes moved onto its surface, next to and in cubes that a cut refines. The simulation converges
// to equilibrium.
TEST(Adapt, NodesOnBoneNextToRefinedCubes)
{
    for (const Case *each : {&averaged, &averaged_hexahedra, &coarse_hexahedra}) {
        Body body(size, box, {{4000, 0.4, 1000, false}, {4000, 0.4, 1000, false}}, [](int i, int j, int k) {
            const double x[3] = {i - 9.3, j - 7.6, k - 6.2};
            return x[0] * x[0] + x[1] * x[1] + x[2] * x[2] < 22;
        });
        body.table.materials[1].fixed = true;
        body.fix_plane(0, 0, 1e-6, 0, 0, 1);
        body.cells(8, 8, 8, 1);
        body.scene.model.gravity[0] = 2;
        each->set(body.scene);
        body.scene.mesh.bone_surface = true;
        ASSERT_EQ(body.build(), PLIANT_OK) << pliant_last_error();
        EXPECT_GT(body.model->body->fine.num_moved, 0);
        step(body, 2);
        std::vector<int8_t> sides;
        for (double z : {0.13, 0.11}) {
            const pliant_body *next = sever_plane(
                body.data->body, body.data->last_revision + 1, {{0.03, 0.08, 0.08}, {1, 0.1, 0.07}},
                [z](const double *x) { return x[2] > z; }, &sides);
            ASSERT_TRUE(next) << pliant_last_error();
            ASSERT_EQ(pliant_data_set_body(body.model, body.data, next), PLIANT_OK) << pliant_last_error();
            pliant_body_release(next);
            step(body, 3);
        }
        const pliant_system *system = body.data->discretization->system;
        int32_t grounded = 0, turn = 0;
        for (int32_t e = system->graded->num_base; e < system->macros->count; e++)
            (system->macros->grounded[e] ? grounded : turn) += system->macros->rank[e] > 0;
        std::printf("%s: of the fine elements %d turn, %d do not\n", each->name, turn, grounded);
        EXPECT_GT(turn, 0) << each->name;
        EXPECT_EQ(grounded > 0, each != &averaged) << each->name; // elements with more than eight nodes
        ASSERT_EQ(pliant_data_set_limits(body.data, 200, 1e-9), PLIANT_OK);
        step(body, 20);
        double maximum = 0;
        const pliant_mesh &mesh = body.data->body->fine;
        for (int32_t i = 0; i < 3 * mesh.num_nodes; i++)
            maximum = std::fmax(maximum, std::fabs(body.data->positions[i] - mesh.rest[i]));
        EXPECT_GT(maximum, 1e-3) << each->name;
        EXPECT_LT(maximum, 0.08) << each->name;
        EXPECT_LT(body.data->statistics.residual, 1e-6) << each->name;
    }
}

TEST(Adapt, UndoRestoresThePreviousBodyAndResetTheFirst)
{
    std::unique_ptr<Body> body = make(direct);
    grasp_at_two_points(*body);
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
    // equal to a new simulation
    std::unique_ptr<Body> fresh = make(direct);
    grasp_at_two_points(*fresh);
    grasp_at_two_points(*body);
    for (int t = 0; t < 2; t++)
        ASSERT_EQ(pliant_tool_set_pose(body->data, t, fresh->data->tools[t].tip, nullptr), PLIANT_OK);
    for (int t = 0; t < 2; t++)
        std::copy(fresh->data->tools[t].tip_offset, fresh->data->tools[t].tip_offset + 3,
                  body->data->tools[t].tip_offset);
    step(*body, 4);
    step(*fresh, 4);
    EXPECT_EQ(state(*body), state(*fresh));
}

/* Two cuts, each followed by enough steps for a new preconditioner, then undone one after the other. With the
 * preconditioner of the cut body, an undone cut would need hundreds of evaluations. */
struct CutUndo : testing::TestWithParam<Case> {};
TEST_P(CutUndo, CutsAreSolvedForAsSoonAsCuts)
{
    Body body(size, box, {{4000, 0.4, 1000, false}, {20000, 0.4, 1200, false}},
              [](int i, int, int k) { return (i < 6 || i > 9) && k > 9; });
    body.fix_plane(0, 0, 1e-6, 0, 0, 1);
    body.cells(8, 8, 8, 1);
    body.scene.model.gravity[0] = 1;
    body.scene.grasp.radius = 0.02;
    body.scene.solver.refresh_interval = body.scene.solver.refresh_delay = 2;
    body.scene.cut.kind = PLIANT_CUT_SEVER;
    GetParam().set(body.scene);
    body.scene.solver.iterations = 400;
    body.scene.solver.tolerance = 1e-8;
    ASSERT_EQ(body.build(), PLIANT_OK) << pliant_last_error();
    grasp_at_two_points(body);
    auto solve = [&](int count) {
        int maximum = 0;
        for (int s = 0; s < count; s++) {
            step(body, 1);
            maximum = std::max(maximum, body.data->statistics.iterations);
        }
        return maximum;
    };
    int cuts = solve(3), undos = 0;
    for (double x : {0.081, 0.047}) {
        const double edge[6] = {x, -0.01, 0.17, x, 0.17, 0.17}, depth[3] = {0.004, 0, -0.07};
        ASSERT_EQ(pliant_data_cut(body.model, body.data, 2, edge, depth, nullptr), PLIANT_OK) << pliant_last_error();
        cuts = std::max(cuts, solve(8));
    }
    const int32_t cut_nodes = body.data->body->fine.num_nodes;
    for (int undo = 0; undo < 2; undo++) {
        ASSERT_EQ(pliant_data_undo_cut(body.model, body.data), PLIANT_OK) << pliant_last_error();
        undos = std::max(undos, solve(8));
    }
    EXPECT_LT(body.data->body->fine.num_nodes, cut_nodes - 20);
    std::printf("%s: up to %d evaluations in a step with cuts, %d as they are undone\n", GetParam().name, cuts, undos);
    EXPECT_LT(undos, 2 * cuts + 20);
}
const Case subdivided{"subdivide", [](pliant_scene &scene) { scene.cut.kind = PLIANT_CUT_SUBDIVIDE; }};
INSTANTIATE_TEST_SUITE_P(Adapt, CutUndo,
                         testing::Values(direct, multigrid, hexahedra, averaged, coarse_hexahedra, schur, patch, octree,
                                         octree_hexahedra, subdivided),
                         [](const testing::TestParamInfo<Case> &info) { return std::string(info.param.name); });

// A cut that is undone before the next step moves nothing: positions stay bitwise identical, also if the body was cut
// before.
struct ImmediateUndo : testing::TestWithParam<Case> {};
TEST_P(ImmediateUndo, KeepsThePositionsBitwise)
{
    const std::unique_ptr<Body> body = make({GetParam().name, [](pliant_scene &scene) {
                                                 GetParam().set(scene);
                                                 if (scene.cut.kind == PLIANT_CUT_NONE)
                                                     scene.cut.kind = PLIANT_CUT_SEVER;
                                             }});
    grasp_at_two_points(*body);
    for (double x : {0.081, 0.047}) {
        step(*body, 3);
        const pliant_body *const was = pliant_body_retain(body->data->body);
        const std::vector<double> before(body->data->positions, body->data->positions + 3 * was->fine.num_nodes);
        const double edge[6] = {x, -0.01, 0.17, x, 0.17, 0.17}, depth[3] = {0.004, 0, -0.07};
        for (int time = 0; time < 2; time++) {
            pliant_cut_report report;
            ASSERT_EQ(pliant_data_cut(body->model, body->data, 2, edge, depth, &report), PLIANT_OK)
                << pliant_last_error();
            EXPECT_GT(report.area, 0.005);
            ASSERT_GT(body->data->body->fine.num_nodes, was->fine.num_nodes);
            ASSERT_EQ(pliant_data_undo_cut(body->model, body->data), PLIANT_OK) << pliant_last_error();
            EXPECT_TRUE(pliant_body_same(body->data->body, was));
            EXPECT_EQ(std::memcmp(before.data(), body->data->positions, before.size() * sizeof before[0]), 0)
                << "cut at " << x << ", time " << time;
        }
        pliant_body_release(was);
        ASSERT_EQ(pliant_data_cut(body->model, body->data, 2, edge, depth, nullptr), PLIANT_OK) << pliant_last_error();
    }
}
INSTANTIATE_TEST_SUITE_P(Adapt, ImmediateUndo,
                         testing::Values(direct, hexahedra, averaged, patch, octree, octree_hexahedra, dynamic, cubes),
                         [](const testing::TestParamInfo<Case> &info) { return std::string(info.param.name); });

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
            grasp_at_two_points(body);
            step(body, 4);
            cut(body, 0.08, 0.09);
            step(body, 4);
        };
        // the same model with other data; a view without ownership
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
