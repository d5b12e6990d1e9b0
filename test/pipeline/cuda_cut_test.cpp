// Cuts in a simulation on the GPU against the CPU: equal topology, positions and volume from the cut on. Skipped
// without a GPU.
#include "body.h"
#include "cuda_warps.h"
#include "fragments.h"
#include "pliant/cut.h"
#include "sim/api/data.h"

#include <cstring>
#include <string>

namespace {

const int size[3] = {24, 24, 24};
const double box[3] = {0.12, 0.12, 0.12};

struct Case {
    pliant_method method;
    pliant_solver_kind kind;
    pliant_preconditioner_choice preconditioner;
    pliant_element_kind element;
    pliant_cut_kind cut = PLIANT_CUT_SEVER;
    pliant_elasticity law = PLIANT_ELASTICITY_COROTATIONAL;
    double poisson = 0.4; // of the soft tissue
};

void set(Body &body, const Case &c, pliant_backend_choice backend)
{
    body.scene.solver.backend = backend;
    body.scene.solver.kind = c.kind;
    body.scene.solver.preconditioner = c.preconditioner;
    body.scene.model.method = c.method;
    body.scene.element.kind = c.element;
    body.scene.element.law = c.law;
    body.scene.model.gravity[2] = -2;
    body.scene.solver.iterations = 200;
    body.scene.solver.tolerance = 1e-8;
    body.scene.cut.kind = c.cut;
    body.fix_plane(0, 0, 0.001, 0, 0, 1);
}

void prepare(Body &body, const Case &c, pliant_backend_choice backend)
{
    set(body, c, backend);
    body.cells(4, 4, 4, 2);
    ASSERT_EQ(body.build(), PLIANT_OK) << pliant_last_error();
    ASSERT_EQ(pliant_data_set_warp(body.model, body.data, &body.scan.geometry), PLIANT_OK) << pliant_last_error();
}

double farthest(const Body &a, const Body &b)
{
    double maximum = 0;
    for (int32_t n = 0; n < 3 * a.data->body->fine.num_nodes; n++)
        maximum = std::fmax(maximum, std::fabs(a.data->positions[n] - b.data->positions[n]));
    return maximum;
}

// Cut down from the top through two thirds of the height, along a slanted plane.
void cut(Body &body, pliant_cut_report *report)
{
    const double points[6] = {0.041, -0.02, 0.14, 0.063, 0.14, 0.14}, depth[3] = {0.004, 0, -0.09};
    ASSERT_EQ(pliant_data_cut(body.model, body.data, 2, points, depth, report), PLIANT_OK) << pliant_last_error();
}

void pull(Body &body, int step)
{
    int tool;
    const double point[3] = {0.1, 0.06, 0.11}, tip[3] = {point[0] + 0.001 * step, point[1], point[2] + 0.0005 * step};
    ASSERT_EQ(pliant_tool_add(body.model, body.data, "t", &tool), PLIANT_OK);
    if (step == 0) {
        ASSERT_EQ(pliant_tool_set_pose(body.data, tool, point, nullptr), PLIANT_OK);
        ASSERT_EQ(pliant_tool_grasp(body.model, body.data, tool, nullptr), PLIANT_OK) << pliant_last_error();
    }
    ASSERT_EQ(pliant_tool_set_pose(body.data, tool, tip, nullptr), PLIANT_OK);
    ASSERT_GE(pliant_step(body.model, body.data), 0) << pliant_last_error();
}

TEST(CudaCut, MeetsTheCpu)
{
    NEEDS_GPU();
    for (const Case &c : {Case{PLIANT_FINE, PLIANT_COROTATIONAL, PLIANT_DIRECT, PLIANT_LINEAR},
                          Case{PLIANT_FINE, PLIANT_COROTATIONAL, PLIANT_MULTIGRID, PLIANT_LINEAR},
                          Case{PLIANT_FINE, PLIANT_COROTATIONAL, PLIANT_DIRECT, PLIANT_HEXAHEDRA},
                          Case{PLIANT_AVERAGED, PLIANT_COROTATIONAL, PLIANT_DIRECT, PLIANT_LINEAR},
                          Case{PLIANT_AVERAGED, PLIANT_COROTATIONAL, PLIANT_DIRECT, PLIANT_HEXAHEDRA},
                          Case{PLIANT_SCHUR, PLIANT_COROTATIONAL, PLIANT_DIRECT, PLIANT_HEXAHEDRA},
                          Case{PLIANT_FINE, PLIANT_TLED, PLIANT_DIRECT, PLIANT_LINEAR},
                          Case{PLIANT_FINE, PLIANT_TLED, PLIANT_DIRECT, PLIANT_HEXAHEDRA},
                          Case{PLIANT_FINE, PLIANT_COROTATIONAL, PLIANT_DIRECT, PLIANT_LINEAR, PLIANT_CUT_SUBDIVIDE},
                          Case{PLIANT_FINE, PLIANT_COROTATIONAL, PLIANT_MULTIGRID, PLIANT_LINEAR, PLIANT_CUT_SUBDIVIDE},
                          Case{PLIANT_FINE, PLIANT_TLED, PLIANT_DIRECT, PLIANT_LINEAR, PLIANT_CUT_SUBDIVIDE},
                          Case{PLIANT_FINE, PLIANT_COROTATIONAL, PLIANT_DIRECT, PLIANT_LINEAR, PLIANT_CUT_SEVER,
                               PLIANT_ELASTICITY_NEO_HOOKEAN},
                          Case{PLIANT_FINE, PLIANT_COROTATIONAL, PLIANT_DIRECT, PLIANT_HEXAHEDRA, PLIANT_CUT_SEVER,
                               PLIANT_ELASTICITY_NEO_HOOKEAN},
                          Case{PLIANT_FINE, PLIANT_COROTATIONAL, PLIANT_DIRECT, PLIANT_LINEAR, PLIANT_CUT_SEVER,
                               PLIANT_ELASTICITY_COROTATIONAL, 0.4999},
                          Case{PLIANT_FINE, PLIANT_COROTATIONAL, PLIANT_DIRECT, PLIANT_LINEAR, PLIANT_CUT_SUBDIVIDE,
                               PLIANT_ELASTICITY_COROTATIONAL, 0.499},
                          Case{PLIANT_FINE, PLIANT_COROTATIONAL, PLIANT_MULTIGRID, PLIANT_HEXAHEDRA, PLIANT_CUT_SEVER,
                               PLIANT_ELASTICITY_COROTATIONAL, 0.499},
                          Case{PLIANT_FINE, PLIANT_COROTATIONAL, PLIANT_DIRECT, PLIANT_HEXAHEDRA, PLIANT_CUT_SEVER,
                               PLIANT_ELASTICITY_NEO_HOOKEAN, 0.4999}}) {
        SCOPED_TRACE(std::to_string(c.method) + " " + std::to_string(c.kind) + " " + std::to_string(c.preconditioner) +
                     " " + std::to_string(c.element) + " " + std::to_string(c.cut) + " " + std::to_string(c.law) + " " +
                     std::to_string(c.poisson));
        const std::vector<Material> two = {{5000, c.poisson, 1000, false}, {60000, 0.4, 1100, false}};
        auto inclusions = [](int i, int j, int) { return i / 6 % 2 && j / 8 % 2 ? 1 : 0; };
        Body cpu(size, box, two, inclusions), gpu(size, box, two, inclusions);
        prepare(cpu, c, PLIANT_CPU);
        prepare(gpu, c, PLIANT_CUDA);
        ASSERT_STREQ(pliant_data_get_backend(gpu.data), "cuda");
        for (Body *body : {&cpu, &gpu})
            for (int s = 0; s < 3; s++) pull(*body, s);
        pliant_cut_report of_cpu, of_gpu;
        cut(cpu, &of_cpu);
        cut(gpu, &of_gpu);
        EXPECT_GT(of_cpu.area, 0.005);
        EXPECT_NEAR(of_cpu.area, of_gpu.area, 1e-3 * of_cpu.area);
        ASSERT_EQ(cpu.data->body->fine.num_nodes, gpu.data->body->fine.num_nodes);
        ASSERT_EQ(cpu.data->body->fine.num_tets, gpu.data->body->fine.num_tets);
        ASSERT_GT(gpu.data->body->fine.num_nodes, gpu.model->body->fine.num_nodes);
        EXPECT_EQ(std::memcmp(cpu.data->body->fine.tets, gpu.data->body->fine.tets,
                              16 * static_cast<size_t>(cpu.data->body->fine.num_tets)),
                  0);
        for (int s = 3; s < 12; s++) {
            pull(cpu, s);
            pull(gpu, s);
            ASSERT_STREQ(pliant_data_get_backend(gpu.data), "cuda") << pliant_last_error();
            EXPECT_LT(farthest(cpu, gpu), (c.kind == PLIANT_TLED ? 1e-4 : 1e-5) * box[0]) << "step " << s;
        }
        // the volume that stayed on the GPU equals the CPU's volume for the same positions
        pliant_warp *warp = nullptr;
        ASSERT_EQ(pliant_warp_create(&gpu.scan, &gpu.model->body->fine, &gpu.scan.geometry, 2, &warp), PLIANT_OK);
        ASSERT_EQ(pliant_warp_set_body(warp, gpu.data->body), PLIANT_OK) << pliant_last_error();
        ASSERT_EQ(pliant_warp_update(warp, gpu.data->positions), PLIANT_OK);
        EXPECT_EQ(std::memcmp(pliant_warp_volume(warp)->voxels,
                              pliant_warp_volume(pliant_data_get_warp(gpu.data))->voxels, 24 * 24 * 24),
                  0);
        pliant_warp_free(warp);
        // undo the cut
        ASSERT_EQ(pliant_data_undo_cut(gpu.model, gpu.data), PLIANT_OK) << pliant_last_error();
        EXPECT_EQ(gpu.data->body->fine.num_nodes, gpu.model->body->fine.num_nodes);
        pull(gpu, 12);
        EXPECT_STREQ(pliant_data_get_backend(gpu.data), "cuda") << pliant_last_error();
    }
}

// Successive cuts, the next one possibly while a preconditioner of the previous body is computed. The carried-over
// preconditioner works, and background results are installed.
TEST(CudaCut, CutsOneAfterTheOther)
{
    NEEDS_GPU();
    for (const Case &c : {Case{PLIANT_FINE, PLIANT_COROTATIONAL, PLIANT_DIRECT, PLIANT_LINEAR},
                          Case{PLIANT_FINE, PLIANT_COROTATIONAL, PLIANT_MULTIGRID, PLIANT_LINEAR},
                          Case{PLIANT_AVERAGED, PLIANT_COROTATIONAL, PLIANT_DIRECT, PLIANT_LINEAR},
                          Case{PLIANT_FINE, PLIANT_COROTATIONAL, PLIANT_DIRECT, PLIANT_HEXAHEDRA},
                          Case{PLIANT_AVERAGED, PLIANT_COROTATIONAL, PLIANT_DIRECT, PLIANT_HEXAHEDRA},
                          Case{PLIANT_FINE, PLIANT_COROTATIONAL, PLIANT_DIRECT, PLIANT_LINEAR, PLIANT_CUT_SUBDIVIDE}}) {
        SCOPED_TRACE(std::to_string(c.method) + " " + std::to_string(c.preconditioner) + " " +
                     std::to_string(c.element) + " " + std::to_string(c.cut));
        Body cpu(size, box, {{20000, 0.4, 1000, false}}), gpu(size, box, {{20000, 0.4, 1000, false}});
        for (Body *body : {&cpu, &gpu}) {
            body->scene.solver.refresh_delay = 2;
            prepare(*body, c, body == &cpu ? PLIANT_CPU : PLIANT_CUDA);
            pull(*body, 0);
        }
        const uint64_t before = gpu.data->statistics.factors;
        double carried = 0, renewed = 0;
        for (int s = 1; s < 20; s++) {
            const bool cuts = s == 1 || s == 2 || s == 8 || s == 14 || s == 15;
            // thick flaps, because a thin one snaps over and has no unique equilibrium
            const double x = 0.02 + 0.003 * s + (s == 2 || s == 15 ? 0.015 : 0),
                         points[6] = {x, -0.02, 0.14, x + 0.01, 0.14, 0.14}, depth[3] = {0.004, 0, -0.02 - 0.0025 * s};
            for (Body *body : {&cpu, &gpu}) {
                if (cuts)
                    ASSERT_EQ(pliant_data_cut(body->model, body->data, 2, points, depth, nullptr), PLIANT_OK)
                        << pliant_last_error();
                pull(*body, s);
                EXPECT_LT(body->data->statistics.error, 1e-8) << (body == &cpu ? "CPU" : "GPU") << ", step " << s;
            }
            ASSERT_STREQ(pliant_data_get_backend(gpu.data), "cuda") << pliant_last_error();
            ASSERT_EQ(cpu.data->body->fine.num_nodes, gpu.data->body->fine.num_nodes);
            EXPECT_LT(farthest(cpu, gpu), 1e-5 * box[0]) << "step " << s;
            (cuts ? carried : renewed) = gpu.data->statistics.iterations;
        }
        EXPECT_GE(gpu.data->statistics.factors, before + 3); // two of the cuts occur during a factorization
        EXPECT_GT(gpu.data->body->fine.num_nodes, gpu.model->body->fine.num_nodes + 50);
        // a carried-over inverse needs some more evaluations, but not many times more
        EXPECT_LT(carried, 5 * renewed + 10);
        ASSERT_EQ(pliant_data_reset(gpu.model, gpu.data), PLIANT_OK);
        EXPECT_EQ(gpu.data->body->fine.num_nodes, gpu.model->body->fine.num_nodes);
    }
}

// As adapt_test's FirstStep: a sagging bar is cut half through in one step, and the first frame is near the new
// equilibrium.
TEST(CudaCut, TheFirstFrameAfterItIsNear)
{
    NEEDS_GPU();
    const int cells[3] = {16, 4, 4};
    const double bar[3] = {0.28, 0.07, 0.07}, end[3] = {0.27, 0.035, 0.035};
    const Plane plane{{0.078, 0.035, 0.035}, {1, 0.05, 0.02}};
    for (bool spring : {false, true}) {
        Body tight(cells, bar, {{10000, 0.4, 1000, false}}), fast(cells, bar, {{10000, 0.4, 1000, false}}),
            cycle(cells, bar, {{10000, 0.4, 1000, false}});
        double whole = 0;
        for (Body *body : {&tight, &fast, &cycle}) {
            body->fix_plane(1e-6, 0, 0, 1, 0, 0);
            body->cells(16, 4, 4, 1);
            body->scene.cut.kind = PLIANT_CUT_SEVER;
            body->scene.solver.backend = body == &tight ? PLIANT_CPU : PLIANT_CUDA;
            body->scene.solver.preconditioner = body == &cycle ? PLIANT_MULTIGRID : PLIANT_DIRECT;
            body->scene.solver.iterations = body == &tight ? 60 : 6;
            body->scene.solver.tolerance = 1e-6;
            body->scene.model.gravity[2] = -0.6;
            body->scene.grasp.stiffness = 2;
            ASSERT_EQ(body->build(), PLIANT_OK) << pliant_last_error();
            int tool = -1;
            if (spring) {
                ASSERT_EQ(pliant_tool_add(body->model, body->data, "spring", &tool), PLIANT_OK);
                ASSERT_EQ(pliant_tool_set_pose(body->data, tool, end, nullptr), PLIANT_OK);
                ASSERT_EQ(pliant_tool_grasp(body->model, body->data, tool, end), PLIANT_OK) << pliant_last_error();
                ASSERT_EQ(pliant_tool_set_drive(body->data, tool, PLIANT_DRIVE_SPRING, nullptr), PLIANT_OK);
            }
            for (int s = 0; s < 20; s++) ASSERT_GE(pliant_step(body->model, body->data), 0) << pliant_last_error();
            const pliant_body *next = sever_plane(body->data->body, body->data->body->revision + 1, plane,
                                                  [&](const double *x) { return x[2] > 0.035; });
            ASSERT_TRUE(next);
            ASSERT_EQ(pliant_data_set_body(body->model, body->data, next), PLIANT_OK) << pliant_last_error();
            pliant_body_release(next);
            for (int s = 0; s < (body == &tight ? 8 : 11); s++) {
                if (s == 0 && body != &tight) EXPECT_GT(farthest(*body, tight), 0.05 * whole);
                ASSERT_GE(pliant_step(body->model, body->data), 0) << pliant_last_error();
                if (body == &tight) continue;
                ASSERT_STREQ(pliant_data_get_backend(body->data), "cuda") << pliant_last_error();
                if (s == 0) EXPECT_LE(body->data->statistics.iterations, 9);
                if (s == 0 || s == 10)
                    EXPECT_LT(farthest(*body, tight), (s == 0 ? 0.05 : 0.01) * whole)
                        << "spring " << spring << ", V-cycle " << (body == &cycle) << ", frame " << s;
            }
            for (int32_t n = 0; body == &tight && n < 3 * body->data->body->fine.num_nodes; n++)
                whole = std::fmax(whole, std::fabs(body->data->positions[n] - body->data->body->fine.rest[n]));
        }
    }
}

// If a GPU is lost after a cut, the host's missing data are computed then.
TEST(CudaCut, TheCpuContinuesWithTheCutBody)
{
    NEEDS_GPU();
    Body cpu(size, box, {{20000, 0.4, 1000, false}}), gpu(size, box, {{20000, 0.4, 1000, false}});
    const Case c{PLIANT_FINE, PLIANT_COROTATIONAL, PLIANT_DIRECT, PLIANT_LINEAR};
    prepare(cpu, c, PLIANT_CPU);
    prepare(gpu, c, PLIANT_CUDA);
    for (int s = 0; s < 6; s++) {
        const double x = 0.03 + 0.01 * s, points[6] = {x, -0.02, 0.14, x, 0.14, 0.14}, depth[3] = {0, 0, -0.06};
        for (Body *body : {&cpu, &gpu}) {
            if (s == 1 || s == 4)
                ASSERT_EQ(pliant_data_cut(body->model, body->data, 2, points, depth, nullptr), PLIANT_OK)
                    << pliant_last_error();
            if (s == 2 && body == &gpu) pliant_cuda_fail_after(2);
            pull(*body, s);
            pliant_cuda_fail_after(-1);
        }
        EXPECT_STREQ(pliant_data_get_backend(gpu.data), s < 2 ? "cuda" : "cpu");
        EXPECT_LT(farthest(cpu, gpu), 1e-5 * box[0]) << "step " << s;
    }
}

// The host moves detached pieces, next to solvers without inertia. They stop once they are out of sight.
TEST(CudaCut, DetachedPiecesFallAsOnTheCpu)
{
    NEEDS_GPU();
    struct Engine {
        pliant_method method;
        pliant_solver_kind kind;
        bool quasi_static;
        pliant_preconditioner_choice preconditioner;
        pliant_cut_kind cut = PLIANT_CUT_SEVER;
    };
    for (const Engine &c :
         {Engine{PLIANT_FINE, PLIANT_COROTATIONAL, false, PLIANT_DIRECT},
          Engine{PLIANT_FINE, PLIANT_COROTATIONAL, false, PLIANT_MULTIGRID},
          Engine{PLIANT_AVERAGED, PLIANT_COROTATIONAL, false, PLIANT_DIRECT},
          Engine{PLIANT_FINE, PLIANT_TLED, true, PLIANT_DIRECT}, Engine{PLIANT_FINE, PLIANT_TLED, false, PLIANT_DIRECT},
          Engine{PLIANT_FINE, PLIANT_COROTATIONAL, false, PLIANT_DIRECT, PLIANT_CUT_SUBDIVIDE},
          Engine{PLIANT_FINE, PLIANT_TLED, false, PLIANT_DIRECT, PLIANT_CUT_SUBDIVIDE}}) {
        SCOPED_TRACE(std::to_string(c.method) + " " + std::to_string(c.kind) + " " + std::to_string(c.quasi_static) +
                     " " + std::to_string(c.cut));
        Body cpu(size, box, {{20000, 0.4, 1000, false}}), gpu(size, box, {{20000, 0.4, 1000, false}});
        for (Body *body : {&cpu, &gpu}) {
            body->scene.tled.quasi_static = c.quasi_static;
            body->scene.warp.margin = 0.06;
            body->scene.ground.box_high[0] = 0.2; // the ground ends next to it
            prepare(*body, Case{c.method, c.kind, c.preconditioner, PLIANT_LINEAR, c.cut},
                    body == &cpu ? PLIANT_CPU : PLIANT_CUDA);
            const double sideways[3] = {6, 0, 8}, points[6] = {-0.02, -0.02, 0.063, 0.14, -0.02, 0.071},
                         depth[3] = {0, 0.2, 0};
            ASSERT_EQ(pliant_data_set_gravity(body->data, sideways), PLIANT_OK);
            for (int s = 0; s < 3; s++) ASSERT_GE(pliant_step(body->model, body->data), 0) << pliant_last_error();
            ASSERT_EQ(pliant_data_cut(body->model, body->data, 2, points, depth, nullptr), PLIANT_OK)
                << pliant_last_error();
            ASSERT_TRUE(body->data->body->pieces);
        }
        for (int s = 0; s < 60; s++) {
            for (Body *body : {&cpu, &gpu}) ASSERT_GE(pliant_step(body->model, body->data), 0) << pliant_last_error();
            ASSERT_STREQ(pliant_data_get_backend(gpu.data), "cuda") << pliant_last_error();
            EXPECT_EQ(cpu.data->statistics.rigid_pieces, gpu.data->statistics.rigid_pieces) << "step " << s;
            if (s < 10) EXPECT_LT(farthest(cpu, gpu), (c.kind == PLIANT_TLED ? 1e-3 : 1e-5) * box[0]) << "step " << s;
            if (s != 5) continue;
            pliant_warp *warp = nullptr;
            ASSERT_EQ(pliant_warp_create(&gpu.scan, &gpu.model->body->fine, &gpu.scan.geometry, 2, &warp), PLIANT_OK);
            ASSERT_EQ(pliant_warp_set_body(warp, gpu.data->body), PLIANT_OK) << pliant_last_error();
            ASSERT_EQ(pliant_warp_update(warp, gpu.data->positions), PLIANT_OK);
            EXPECT_EQ(std::memcmp(pliant_warp_volume(warp)->voxels,
                                  pliant_warp_volume(pliant_data_get_warp(gpu.data))->voxels, 24 * 24 * 24),
                      0);
            pliant_warp_free(warp);
        }
        EXPECT_EQ(gpu.data->statistics.rigid_pieces, 0);
        const int32_t node = gpu.data->body->pieces->node[0];
        const std::vector<double> there(gpu.data->positions + 3 * node, gpu.data->positions + 3 * node + 3);
        for (int s = 0; s < 3; s++) ASSERT_GE(pliant_step(gpu.model, gpu.data), 0);
        for (int d = 0; d < 3; d++) EXPECT_EQ(gpu.data->positions[3 * node + d], there[static_cast<size_t>(d)]);
        ASSERT_EQ(pliant_data_undo_cut(gpu.model, gpu.data), PLIANT_OK) << pliant_last_error();
        ASSERT_GE(pliant_step(gpu.model, gpu.data), 0) << pliant_last_error();
        EXPECT_STREQ(pliant_data_get_backend(gpu.data), "cuda") << pliant_last_error();
    }
}

/* A slanted plane cuts a clamped beam halfway or down to a hinge. The new V-cycle of the fragments needs not many more
 * evaluations under another load than before the cut, and than on the CPU. */
TEST(CudaCut, AVCycleOnFragmentsConvergesAsBeforeTheCut)
{
    NEEDS_GPU();
    const int few[3] = {32, 16, 16};
    const double beam[3] = {0.16, 0.08, 0.08};
    for (pliant_element_kind element : {PLIANT_LINEAR, PLIANT_HEXAHEDRA})
        for (double deep : {0.045, 0.065}) {
            SCOPED_TRACE(std::to_string(element) + " " + std::to_string(deep));
            int taken[2][2] = {{0, 0}, {0, 0}}; // evaluations before and after the cut, on CPU and GPU
            std::unique_ptr<Body> bodies[2];
            for (int g = 0; g < 2; g++) {
                bodies[g].reset(new Body(few, beam, {{5000, 0.4, 1000, false}, {20000, 0.4, 1000, false}},
                                         [](int i, int j, int k) { return (i / 6 + j / 5 + k / 4) % 2; }));
                Body &body = *bodies[g];
                set(body, {PLIANT_FINE, PLIANT_COROTATIONAL, PLIANT_MULTIGRID, element}, g ? PLIANT_CUDA : PLIANT_CPU);
                body.scene.fixed.num_planes = 0;
                body.fix_plane(1e-6, 0, 0, 1, 0, 0);
                body.cells(16, 8, 8, 1);
                body.scene.solver.refresh_delay = 1;
                body.scene.model.gravity[2] = 0;
                ASSERT_EQ(body.build(), PLIANT_OK) << pliant_last_error();
                auto load = [&](double pull) {
                    const double gravity[3] = {0, 0, pull};
                    int evaluations = 0;
                    EXPECT_EQ(pliant_data_set_gravity(body.data, gravity), PLIANT_OK);
                    for (int s = 0; s < 20 && pliant_step(body.model, body.data) == PLIANT_NOT_CONVERGED; s++)
                        evaluations += body.data->statistics.iterations;
                    return evaluations + body.data->statistics.iterations;
                };
                for (double pull : {-0.3, 0.2, -0.4}) taken[0][g] += load(deep > 0.05 ? 0.1 * pull : pull);
                const double points[6] = {0.045, -0.02, 0.2, 0.06, 0.1, 0.2},
                             way[3] = {0.3 * (0.12 + deep), 0, -0.12 - deep};
                ASSERT_EQ(pliant_data_cut(body.model, body.data, 2, points, way, nullptr), PLIANT_OK)
                    << pliant_last_error();
                const uint64_t before = body.data->statistics.factors;
                for (int s = 0; s < 20 && body.data->statistics.factors == before; s++)
                    ASSERT_GE(pliant_step(body.model, body.data), 0) << pliant_last_error();
                ASSERT_GT(body.data->statistics.factors, before);
                for (double pull : {-0.3, 0.2, -0.4}) taken[1][g] += load(deep > 0.05 ? 0.1 * pull : pull);
                ASSERT_STREQ(pliant_data_get_backend(body.data), g ? "cuda" : "cpu") << pliant_last_error();
            }
            EXPECT_LT(farthest(*bodies[0], *bodies[1]), 1e-5 * beam[0]);
            std::printf(
                "%s, cut %.0f mm deep: evaluations under three loads before the cut %d, after it %d on the CPU, "
                "%d and %d on the GPU\n",
                element == PLIANT_LINEAR ? "tetrahedra" : "hexahedra", 1e3 * deep, taken[0][0], taken[1][0],
                taken[0][1], taken[1][1]);
            // up to 2.5 times if the coarser levels do not contain the cut
            EXPECT_LT(taken[1][1], 1.8 * taken[1][0] + 10);
        }
}

// A bar of 16 cubes leans under its weight. A cut half through exceeds the range of Newton's step and is undone; then
// its upper half detaches. For compute-sanitizer: runs every kernel specific to cuts in a short time.
void cut_once(const Case &c)
{
    const int few[3] = {8, 8, 16};
    const double bar[3] = {0.06, 0.06, 0.12}, end[3] = {0.03, 0.03, 0.11},
                 half[6] = {-0.2, -0.01, 0.031, 0.4, -0.01, 0.033},
                 through[6] = {-0.2, -0.01, 0.052, 0.4, -0.01, 0.053}, across[3] = {0, 0.046, 0.002},
                 all[3] = {0, 0.1, 0.002};
    SCOPED_TRACE(std::to_string(c.method) + " " + std::to_string(c.kind) + " " + std::to_string(c.preconditioner) +
                 " " + std::to_string(c.element) + " " + std::to_string(c.cut));
    const int ratio = c.method == PLIANT_FINE ? 1 : 2;
    Body body(few, bar, {{5000, 0.4, 1000, false}});
    set(body, c, PLIANT_CUDA);
    body.cells(2 / ratio, 2 / ratio, 4 / ratio, ratio);
    body.scene.solver.iterations = 6;
    body.scene.solver.refresh_delay = 1;
    body.scene.model.gravity[0] = 0.4; // a soft bar would sag out of the stroke's path
    body.scene.tled.quasi_static = false;
    ASSERT_EQ(body.build(), PLIANT_OK) << pliant_last_error();
    ASSERT_EQ(pliant_data_set_warp(body.model, body.data, &body.scan.geometry), PLIANT_OK) << pliant_last_error();
    auto steps = [&](int count) {
        for (int s = 0; s < count; s++) ASSERT_GE(pliant_step(body.model, body.data), 0) << pliant_last_error();
        ASSERT_STREQ(pliant_data_get_backend(body.data), "cuda") << pliant_last_error();
    };
    int tool;
    ASSERT_EQ(pliant_tool_add(body.model, body.data, "spring", &tool), PLIANT_OK);
    ASSERT_EQ(pliant_tool_set_pose(body.data, tool, end, nullptr), PLIANT_OK);
    ASSERT_EQ(pliant_tool_grasp(body.model, body.data, tool, end), PLIANT_OK) << pliant_last_error();
    body.data->tools[tool].stiffness = 2;
    steps(2);
    const uint64_t before = body.data->statistics.factors;
    ASSERT_EQ(pliant_data_cut(body.model, body.data, 2, half, across, nullptr), PLIANT_OK) << pliant_last_error();
    ASSERT_GT(body.data->body->fine.num_nodes, body.model->body->fine.num_nodes);
    steps(4); // the third step installs the new preconditioner
    if (c.kind == PLIANT_COROTATIONAL) EXPECT_GT(body.data->statistics.factors, before);
    ASSERT_EQ(pliant_data_undo_cut(body.model, body.data), PLIANT_OK) << pliant_last_error();
    pliant_tool_release(body.data, tool);
    steps(1);
    ASSERT_EQ(pliant_data_cut(body.model, body.data, 2, through, all, nullptr), PLIANT_OK) << pliant_last_error();
    ASSERT_TRUE(body.data->body->pieces);
    steps(2);
    EXPECT_EQ(body.data->statistics.rigid_pieces, 1);
}

TEST(CudaCut, EveryKernelOnce)
{
    NEEDS_GPU();
    for (const Case &c : {Case{PLIANT_FINE, PLIANT_COROTATIONAL, PLIANT_DIRECT, PLIANT_LINEAR},
                          Case{PLIANT_SCHUR, PLIANT_COROTATIONAL, PLIANT_DIRECT, PLIANT_HEXAHEDRA},
                          Case{PLIANT_FINE, PLIANT_TLED, PLIANT_DIRECT, PLIANT_LINEAR}})
        cut_once(c);
}

// kernels of other engines; cuda_test and the cases above cover the rest
TEST(CudaCut, EveryKernelOnceOfOtherEngines)
{
    NEEDS_GPU();
    for (const Case &c : {Case{PLIANT_FINE, PLIANT_COROTATIONAL, PLIANT_MULTIGRID, PLIANT_LINEAR},
                          Case{PLIANT_FINE, PLIANT_COROTATIONAL, PLIANT_DIRECT, PLIANT_HEXAHEDRA},
                          Case{PLIANT_AVERAGED, PLIANT_COROTATIONAL, PLIANT_DIRECT, PLIANT_LINEAR},
                          Case{PLIANT_FINE, PLIANT_COROTATIONAL, PLIANT_DIRECT, PLIANT_LINEAR, PLIANT_CUT_SUBDIVIDE}})
        cut_once(c);
}

} // namespace
