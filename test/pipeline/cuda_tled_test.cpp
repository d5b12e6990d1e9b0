// Explicit dynamics on the GPU against the CPU: whole runs, repeated results, divergence, a failing GPU. Skipped
// without a GPU.
#include "backend/backend.h"
#include "backend/explicit_statistics.h"
#include "body.h"
#include "cuda_warps.h"
#include "fem/dynamics/tled.h"
#include "model_data/data.h"
#include "base/memory.h"

#include <array>
#include <cstdio>
#include <string>

namespace {

const double nobody = -1;

// Configuration of a run; drive -1: no tool.
struct Case {
    const char *name;
    pliant_law law;
    bool viscous, nodal, still, walls;
    double drive;
    int tools;
    double bound; // maximum difference of a node relative to the maximum displacement
    pliant_element_kind element = PLIANT_LINEAR;
    double stiffness_damping = 0;
    bool octree = false;
};

const Case cases[] = {
    {"hang", PLIANT_LAW_NEO_HOOKEAN, false, false, false, false, nobody, 0, 1e-5},
    {"hang, compressible", PLIANT_LAW_COMPRESSIBLE, false, false, false, false, nobody, 0, 1e-5},
    {"hang, saint venant kirchhoff", PLIANT_LAW_SAINT_VENANT_KIRCHHOFF, false, false, false, false, nobody, 0, 1e-5},
    {"hang, viscous", PLIANT_LAW_NEO_HOOKEAN, true, false, false, false, nobody, 0, 1e-5},
    {"hang, viscous, saint venant kirchhoff", PLIANT_LAW_SAINT_VENANT_KIRCHHOFF, true, false, false, false, nobody, 0,
     1e-5},
    {"hang, nodal pressure", PLIANT_LAW_NEO_HOOKEAN, false, true, false, false, nobody, 0, 1e-5},
    {"hang, viscous, nodal pressure, compressible", PLIANT_LAW_COMPRESSIBLE, true, true, false, false, nobody, 0, 1e-5},
    {"fall", PLIANT_LAW_NEO_HOOKEAN, false, false, false, true, nobody, 0, 1e-4},
    {"spring", PLIANT_LAW_NEO_HOOKEAN, false, false, false, false, PLIANT_DRIVE_SPRING, 1, 1e-5},
    {"three rigid tools", PLIANT_LAW_COMPRESSIBLE, false, false, false, false, PLIANT_DRIVE_RIGID, 3, 1e-5},
    {"force, with walls", PLIANT_LAW_NEO_HOOKEAN, true, false, false, true, PLIANT_DRIVE_FORCE, 2, 1e-4},
    {"relaxation", PLIANT_LAW_NEO_HOOKEAN, false, false, true, false, nobody, 0, 1e-3},
    {"damped by stiffness, spring", PLIANT_LAW_NEO_HOOKEAN, false, false, false, false, PLIANT_DRIVE_SPRING, 1, 1e-5,
     PLIANT_LINEAR, 0.002},
    {"damped by stiffness, nodal pressure", PLIANT_LAW_COMPRESSIBLE, true, true, false, false, nobody, 0, 1e-5,
     PLIANT_LINEAR, 0.002},
    {"hexahedra", PLIANT_LAW_NEO_HOOKEAN, false, false, false, false, nobody, 0, 1e-5, PLIANT_HEXAHEDRA},
    {"hexahedra, viscous, saint venant kirchhoff, tools", PLIANT_LAW_SAINT_VENANT_KIRCHHOFF, true, false, false, false,
     PLIANT_DRIVE_RIGID, 2, 1e-5, PLIANT_HEXAHEDRA},
    {"hexahedra, damped by stiffness, viscous", PLIANT_LAW_COMPRESSIBLE, true, false, false, false, nobody, 0, 1e-5,
     PLIANT_HEXAHEDRA, 0.002},
    {"hexahedra, fall", PLIANT_LAW_NEO_HOOKEAN, false, false, false, true, nobody, 0, 1e-4, PLIANT_HEXAHEDRA},
    {"hexahedra, relaxation", PLIANT_LAW_NEO_HOOKEAN, false, false, true, false, nobody, 0, 1e-3, PLIANT_HEXAHEDRA},
    {"octree of hexahedra", PLIANT_LAW_NEO_HOOKEAN, false, false, false, false, nobody, 0, 1e-5, PLIANT_HEXAHEDRA, 0,
     true},
    {"octree of hexahedra, viscous, tools", PLIANT_LAW_COMPRESSIBLE, true, false, false, false, PLIANT_DRIVE_RIGID, 2,
     1e-5, PLIANT_HEXAHEDRA, 0.002, true},
    {"octree of hexahedra, relaxation", PLIANT_LAW_NEO_HOOKEAN, false, false, true, false, nobody, 0, 1e-3,
     PLIANT_HEXAHEDRA, 0, true},
    {"relaxation, spring", PLIANT_LAW_COMPRESSIBLE, false, true, true, false, PLIANT_DRIVE_SPRING, 2, 1e-3},
};

struct Cube : Body {
    const Case &c;
    Cube(const Case &of, pliant_backend_choice backend, int n = 4)
        : Body(std::array<int, 3>{2 * n, 2 * n, 4 * n}.data(), std::array<double, 3>{0.04, 0.04, 0.08}.data(),
               {{5e3, 0.45, 1000, false}, {2e4, 0.4, 1100, false}},
               [n](int i, int, int k) { return i > n && k > n && k < 3 * n; }),
          c(of)
    {
        cells(n, n, 2 * n, 1);
        if (c.octree) { // leaves of one, two and four voxels
            scene.mesh.kind = PLIANT_OCTREE;
            scene.mesh.depth = 2;
            scene.mesh.purity = 1;
            cells(n / 2, n / 2, n, 1);
        }
        scene.solver.kind = PLIANT_TLED;
        scene.solver.backend = backend;
        scene.solver.step = 0.02;
        scene.element.kind = c.element;
        scene.tled.stiffness_damping = c.stiffness_damping;
        scene.tled.law = c.law;
        scene.tled.damping = 20;
        scene.tled.nodal_pressure = c.nodal;
        scene.tled.quasi_static = c.still;
        scene.tled.relaxation_steps = 2000;
        scene.solver.tolerance = c.still ? 1e-3 : 1e-9;
        scene.model.gravity[0] = 1;
        scene.model.gravity[2] = -3;
        if (c.viscous) {
            scene.tled.prony_share[0] = 0.3;
            scene.tled.prony_time[0] = 0.05;
            scene.tled.prony_share[2] = 0.2;
            scene.tled.prony_time[2] = 0.4;
        }
        if (c.walls) {
            scene.ground.normal[2] = 1;
            scene.ground.point[2] = -0.01;
            scene.ground.box_high[0] = 0.045;
            scene.ground.restitution = 0.2;
        } else {
            fix_plane(0, 0, 0.08 - 1e-6, 0, 0, -1);
        }
    }
    void step(int s)
    {
        for (int t = 0; t < c.tools; t++) {
            int tool;
            ASSERT_EQ(pliant_tool_add(model, data, ("t" + std::to_string(t)).c_str(), &tool), PLIANT_OK);
            const double point[3] = {0.01 + 0.01 * t, 0.02, 0.01 + 0.006 * t}, along = 0.0006 * s,
                         push[3] = {0.02, 0, 0.01 * s};
            const double tip[3] = {point[0] + along, point[1] - along * t, point[2] - along};
            if (s == 1) {
                data->tools[tool].radius = 0.01; // the tools share nodes
                ASSERT_EQ(pliant_tool_set_pose(data, tool, point, nullptr), PLIANT_OK);
                ASSERT_EQ(pliant_tool_grasp(model, data, tool, nullptr), PLIANT_OK) << pliant_last_error();
                data->tools[tool].stiffness = 50;
                data->tools[tool].damping = 0.5;
            }
            ASSERT_EQ(pliant_tool_set_pose(data, tool, tip, nullptr), PLIANT_OK);
            ASSERT_EQ(pliant_tool_set_drive(data, tool, static_cast<pliant_drive>(static_cast<int>(c.drive)), push),
                      PLIANT_OK);
        }
        ASSERT_GE(pliant_step(model, data), 0) << pliant_last_error();
    }
    std::vector<double> positions() const
    {
        return {data->positions, data->positions + 3 * model->body->fine.num_nodes};
    }
};

double max_distance(const std::vector<double> &a, const double *b)
{
    double maximum = 0;
    for (size_t n = 0; n < a.size(); n++) maximum = std::fmax(maximum, std::fabs(a[n] - b[n]));
    return maximum;
}

TEST(CudaTled, MeetsTheCpu)
{
    NEEDS_GPU();
    for (const Case &c : cases) {
        SCOPED_TRACE(c.name);
        Cube cpu(c, PLIANT_CPU), gpu(c, PLIANT_CUDA);
        ASSERT_EQ(cpu.build(), PLIANT_OK) << pliant_last_error();
        ASSERT_EQ(gpu.build(), PLIANT_OK) << pliant_last_error();
        ASSERT_STREQ(pliant_data_get_backend(gpu.data), "cuda");
        ASSERT_EQ(pliant_data_set_warp(gpu.model, gpu.data, &gpu.scan.geometry), PLIANT_OK) << pliant_last_error();
        double worst = 0, force = 0, forces_apart = 0, residuals = 0, error = 0, errors_apart = 0;
        for (int s = 1; s <= 15; s++) {
            cpu.step(s);
            gpu.step(s);
            ASSERT_STREQ(pliant_data_get_backend(gpu.data), "cuda") << pliant_last_error();
            worst = std::fmax(worst, max_distance(cpu.positions(), gpu.data->positions));
            const double a = cpu.data->statistics.residual, b = gpu.data->statistics.residual;
            if (!c.still) residuals = std::fmax(residuals, std::fabs(a - b) / a);
            error = std::fmax(error, cpu.data->statistics.error);
            errors_apart = std::fmax(errors_apart, std::fabs(cpu.data->statistics.error - gpu.data->statistics.error));
            for (int t = 0; t < c.tools; t++)
                for (int d = 0; d < 3; d++) {
                    force = std::fmax(force, std::fabs(cpu.data->tools[t].force[d]));
                    forces_apart =
                        std::fmax(forces_apart, std::fabs(cpu.data->tools[t].force[d] - gpu.data->tools[t].force[d]));
                }
        }
        const double moved = max_distance(cpu.positions(), cpu.model->body->fine.rest);
        EXPECT_GT(moved, 0.002);
        EXPECT_LT(worst, c.bound * moved);
        EXPECT_LT(forces_apart, 10 * c.bound * force + 1e-12);
        EXPECT_LT(residuals, 0.01);
        EXPECT_EQ(error > 0, !c.still);
        EXPECT_LE(errors_apart, 0.02 * error);
        pliant_dynamics here, there;
        ASSERT_EQ(pliant_data_get_dynamics(cpu.model, cpu.data, &here), PLIANT_OK);
        ASSERT_EQ(pliant_data_get_dynamics(gpu.model, gpu.data, &there), PLIANT_OK);
        EXPECT_EQ(here.substeps, there.substeps);
        EXPECT_NEAR(here.strain_energy, there.strain_energy, 100 * c.bound * here.strain_energy);
        pliant_warp *warp = nullptr;
        ASSERT_EQ(pliant_warp_create(&gpu.scan, &gpu.model->body->fine, &gpu.scan.geometry, 2, &warp), PLIANT_OK);
        ASSERT_EQ(pliant_warp_update(warp, gpu.data->positions), PLIANT_OK);
        EXPECT_EQ(std::memcmp(pliant_warp_volume(warp)->voxels, pliant_warp_volume(gpu.data->warp)->voxels,
                              pliant_geometry_voxels(&gpu.scan.geometry)),
                  0);
        pliant_warp_free(warp);
        std::printf("%-45s nodes %.1e of %4.1f mm apart, forces %.1e of %.2g N, %d sub-steps a frame\n", c.name,
                    worst / moved, 1e3 * moved, force > 0 ? forces_apart / force : 0, force, there.substeps);
    }
}

// The phantom's soft tissue hangs, falls, and is pulled by a tool.
TEST(CudaTled, ThePhantomMeetsTheCpu)
{
    NEEDS_GPU();
    const int32_t voxels[3] = {64, 48, 40};
    pliant_volume scan{};
    ASSERT_EQ(pliant_phantom(voxels, 1, &scan, nullptr), PLIANT_OK) << pliant_last_error();
    pliant_material records[2];
    std::memset(records, 0, sizeof records);
    for (int m = 0; m < 2; m++) {
        std::snprintf(records[m].name, sizeof records[m].name, "%s", m ? "tissue" : "air");
        records[m].young_modulus = 8e3;
        records[m].poisson_ratio = 0.45;
        records[m].density = 1000;
        records[m].empty = m == 0;
        records[m].num_range = 2;
        records[m].range[0] = m ? -300 : -1e5;
        records[m].range[1] = m ? 1e5 : -300;
    }
    pliant_material_table table{};
    table.materials = records;
    table.num_materials = 2;
    for (int run = 0; run < 3; run++) {
        pliant_model *model[2] = {};
        pliant_data *data[2] = {};
        double worst = 0, moved = 0;
        for (int b = 0; b < 2; b++) {
            pliant_scene scene;
            pliant_scene_defaults(&scene);
            scene.mesh.coarse_cells[0] = 12, scene.mesh.coarse_cells[1] = 9, scene.mesh.coarse_cells[2] = 8;
            scene.mesh.ratio = 1;
            scene.solver.kind = PLIANT_TLED;
            scene.solver.backend = b ? PLIANT_CUDA : PLIANT_CPU;
            scene.tled.nodal_pressure = true;
            scene.model.gravity[1] = run == 2 ? 0 : 9.81;
            if (run == 1) {
                scene.ground.normal[1] = -1;
                scene.ground.point[1] =
                    scan.geometry.origin[1] + scan.geometry.size[1] * scan.geometry.spacing[1] + 0.01;
            } else { // fix the back
                scene.fixed.num_planes = 1;
                scene.fixed.planes[0] = {
                    {0, scan.geometry.origin[1] + 0.8 * scan.geometry.size[1] * scan.geometry.spacing[1], 0},
                    {0, -1, 0}};
            }
            ASSERT_EQ(pliant_model_build(&scene, &scan, nullptr, &table, {nullptr, nullptr}, &model[b]), PLIANT_OK)
                << pliant_last_error();
            ASSERT_EQ(pliant_data_create(model[b], &data[b]), PLIANT_OK) << pliant_last_error();
        }
        ASSERT_STREQ(pliant_data_get_backend(data[1]), "cuda");
        const int32_t nodes = 3 * model[0]->body->fine.num_nodes, tets = model[0]->body->fine.num_tets;
        int32_t front = 0; // the foremost node
        for (int32_t n = 0; n < nodes / 3; n++)
            if (model[0]->body->fine.rest[3 * n + 1] < model[0]->body->fine.rest[3 * front + 1]) front = n;
        for (int s = 0; s < 12; s++)
            for (int b = 0; b < 2; b++) {
                int tool;
                double tip[3];
                std::memcpy(tip, model[b]->body->fine.rest + 3 * front, sizeof tip);
                if (run == 2 && s == 0) {
                    ASSERT_EQ(pliant_tool_add(model[b], data[b], "pull", &tool), PLIANT_OK);
                    data[b]->tools[tool].radius = 0.03;
                    ASSERT_EQ(pliant_tool_grasp(model[b], data[b], tool, tip), PLIANT_OK) << pliant_last_error();
                    std::memcpy(tip, data[b]->tools[tool].tip, sizeof tip);
                }
                if (run == 2) {
                    tip[1] -= 0.003 * (s + 1);
                    ASSERT_EQ(pliant_tool_set_pose(data[b], 0, tip, nullptr), PLIANT_OK);
                }
                ASSERT_EQ(pliant_step(model[b], data[b]), PLIANT_OK) << pliant_last_error();
            }
        for (int32_t n = 0; n < nodes; n++) {
            worst = std::fmax(worst, std::fabs(data[0]->positions[n] - data[1]->positions[n]));
            moved = std::fmax(moved, std::fabs(data[0]->positions[n] - model[0]->body->fine.rest[n]));
        }
        EXPECT_GT(moved, 0.005);
        EXPECT_LT(worst, (run == 1 ? 1e-3 : 1e-4) * moved);
        std::printf("phantom, %d tetrahedra, %-5s: %.1e of %.1f mm apart after 12 frames of %d sub-steps\n", tets,
                    run == 0   ? "hang"
                    : run == 1 ? "fall"
                               : "pull",
                    worst / moved, 1e3 * moved, data[1]->statistics.iterations);
        for (int b = 0; b < 2; b++) {
            pliant_data_free(data[b]);
            pliant_model_free(model[b]);
        }
    }
    pliant_volume_free(&scan);
}

TEST(CudaTled, SameInputSameBits)
{
    NEEDS_GPU();
    for (int number : {6, 9, 10, 12}) {
        SCOPED_TRACE(cases[number].name);
        std::vector<double> results[3];
        for (std::vector<double> &result : results) {
            Cube body(cases[number], PLIANT_CUDA);
            ASSERT_EQ(body.build(), PLIANT_OK) << pliant_last_error();
            if (&result == &results[2]) { // also after a reset
                for (int s = 1; s <= 3; s++) body.step(s);
                ASSERT_EQ(pliant_data_reset(body.model, body.data), PLIANT_OK);
            }
            for (int s = 1; s <= 8; s++) body.step(s);
            result = body.positions();
        }
        EXPECT_EQ(results[0], results[1]);
        EXPECT_EQ(results[0], results[2]);
    }
}

// More sub-steps than one graph contains: odd numbers of them, in several launches.
TEST(CudaTled, LongFramesAreShortOnes)
{
    NEEDS_GPU();
    Cube one(cases[3], PLIANT_CUDA), many(cases[3], PLIANT_CUDA);
    ASSERT_EQ(one.build(), PLIANT_OK);
    one.data->tled->substeps = 777;
    one.data->tled->time_step = 1e-4;
    ASSERT_EQ(many.build(), PLIANT_OK);
    many.data->tled->substeps = 7;
    many.data->tled->time_step = 1e-4;
    one.step(1);
    for (int s = 0; s < 111; s++) many.step(s);
    EXPECT_EQ(one.positions(), many.positions());
    EXPECT_EQ(one.data->statistics.iterations, 777);
    EXPECT_GT(max_distance(one.positions(), one.model->body->fine.rest), 1e-3);
}

TEST(CudaTled, DivergenceIsCaughtAndTheStateKept)
{
    NEEDS_GPU();
    std::vector<double> before;
    int32_t steps[2];
    for (int b = 0; b < 2; b++) {
        Cube body(cases[0], b ? PLIANT_CUDA : PLIANT_CPU);
        body.scene.tled.safety = 1.5;
        ASSERT_EQ(body.build(), PLIANT_OK) << pliant_last_error();
        pliant_status status = PLIANT_OK;
        for (int s = 0; s < 20 && status == PLIANT_OK; s++) {
            before = body.positions();
            status = pliant_step(body.model, body.data);
        }
        EXPECT_EQ(status, PLIANT_ERROR_NUMERIC);
        EXPECT_NE(std::string(pliant_last_error()).find("faster than sound"), std::string::npos) << pliant_last_error();
        EXPECT_EQ(before, body.positions());
        EXPECT_STREQ(pliant_data_get_backend(body.data), b ? "cuda" : "cpu");
        steps[b] = body.data->statistics.iterations;
        // with shorter steps it continues from the kept state
        body.data->tled->substeps *= 2;
        body.data->tled->time_step *= 0.5;
        EXPECT_EQ(pliant_step(body.model, body.data), PLIANT_OK) << pliant_last_error();
    }
    EXPECT_NEAR(steps[0], steps[1], 2);
}

TEST(CudaTled, PositionsFromOutsideAreTaken)
{
    NEEDS_GPU();
    for (int number : {0, 3, 11}) {
        Cube cpu(cases[number], PLIANT_CPU), gpu(cases[number], PLIANT_CUDA);
        for (Cube *body : {&cpu, &gpu}) {
            ASSERT_EQ(body->build(), PLIANT_OK);
            for (int s = 1; s <= 2; s++) body->step(s);
            std::vector<double> x = body->positions();
            for (size_t n = 0; n < x.size(); n += 3) x[n] += 0.02 * (0.08 - body->model->body->fine.rest[n + 2]);
            ASSERT_EQ(pliant_data_set_positions(body->model, body->data, x.data()), PLIANT_OK);
            for (int s = 3; s <= 5; s++) body->step(s);
        }
        EXPECT_LT(max_distance(cpu.positions(), gpu.data->positions), cases[number].bound * 0.01) << cases[number].name;
    }
}

// runs every kernel in a short time, for compute-sanitizer
TEST(CudaTled, EveryKernelOnce)
{
    NEEDS_GPU();
    for (int number : {2, 6, 9, 10, 11, 12, 15}) {
        Case c = cases[number];
        Cube body(c, PLIANT_CUDA, 2);
        body.scene.tled.relaxation_steps = 40;
        ASSERT_EQ(body.build(), PLIANT_OK) << pliant_last_error();
        for (int s = 1; s <= 2; s++) body.step(s);
        EXPECT_STREQ(pliant_data_get_backend(body.data), "cuda") << pliant_last_error();
    }
}

// Every call of the CUDA runtime fails once, as on a lost device. The CPU continues from the last valid state to the
// same result.
TEST(CudaTled, TheCpuContinues)
{
    NEEDS_GPU();
    const Case &c = cases[3];
    Cube good(c, PLIANT_CPU, 2), body(c, PLIANT_AUTO, 2);
    ASSERT_EQ(good.build(), PLIANT_OK);
    for (int s = 1; s <= 3; s++) good.step(s);
    ASSERT_EQ(body.build(), PLIANT_OK);
    pliant_data_free(body.data);
    body.data = nullptr;
    int given_up = 0;
    const size_t held = pliant_memory_in_use();
    for (int64_t calls = 0, left = -1; left < 0; calls += 1 + calls / 20) {
        ASSERT_LT(calls, 5000);
        pliant_cuda_fail_after(calls);
        ASSERT_EQ(pliant_data_create(body.model, &body.data), PLIANT_OK)
            << "call " << calls << ": " << pliant_last_error();
        for (int s = 1; s <= 3; s++) body.step(s);
        left = pliant_cuda_fail_after(-1);
        ASSERT_LT(max_distance(good.positions(), body.data->positions), c.bound * 0.01) << "call " << calls;
        const bool on_cpu = std::string(pliant_data_get_backend(body.data)) == "cpu";
        if (left >= 0) EXPECT_FALSE(on_cpu) << pliant_last_error();
        given_up += on_cpu;
        pliant_data_free(body.data);
        body.data = nullptr;
        EXPECT_EQ(pliant_memory_in_use(), held) << "call " << calls;
    }
    EXPECT_GT(given_up, 30);
}

TEST(CudaTled, WithoutAGpuTheReasonIsLogged)
{
    if (there_is_a_gpu()) GTEST_SKIP() << "there is a GPU";
    Cube body(cases[0], PLIANT_CUDA, 2);
    EXPECT_EQ(body.build(), PLIANT_ERROR_UNAVAILABLE);
    EXPECT_NE(std::string(pliant_last_error()).find("cuda cannot be used"), std::string::npos) << pliant_last_error();
    Cube other(cases[0], PLIANT_AUTO, 2);
    ASSERT_EQ(other.build(), PLIANT_OK);
    EXPECT_STREQ(pliant_data_get_backend(other.data), "cpu");
}

} // namespace
