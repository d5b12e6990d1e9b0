// The barrier against inversion (fem/element/volume_barrier.h), and pulls in which it keeps elements from inverting.
#include "pipeline/body.h"

#include "fem/element/volume_barrier.h"
#include "fem/system.h"
#include "model_data/data.h"

#include <cmath>
#include <random>
#include <string>

namespace {

TEST(VolumeBarrier, HasTheDerivativesOfItsEnergyAndStartsSmoothly)
{
    const double limit = PLIANT_BARRIER_LIMIT, step = 1e-6;
    for (double ratio = -0.5; ratio < limit - 1e-3; ratio += 0.0107) {
        const pliant_barrier at = pliant_barrier_at(ratio), before = pliant_barrier_at(ratio - step),
                             after = pliant_barrier_at(ratio + step);
        EXPECT_NEAR((after.energy - before.energy) / (2 * step), at.slope, 1e-5 * (1 + std::fabs(at.slope))) << ratio;
        EXPECT_NEAR((after.slope - before.slope) / (2 * step), at.stiffness, 1e-4 * at.stiffness) << ratio;
        EXPECT_LT(at.slope, 0) << ratio;
    }
    for (const double ratio : {limit, 0.9, 1.0, 3.0}) {
        const pliant_barrier at = pliant_barrier_at(ratio);
        EXPECT_TRUE(at.energy == 0 && at.slope == 0 && at.stiffness == 0) << ratio;
    }
    EXPECT_LT(pliant_barrier_at(limit - 1e-6).stiffness, 1e-3);
}

struct Cube {
    double rest[24], x[24];
    int32_t node[8] = {0, 1, 2, 3, 4, 5, 6, 7};

    explicit Cube(unsigned seed)
    {
        std::mt19937 random(seed);
        std::uniform_real_distribution<double> noise(-0.25, 0.25);
        for (int m = 0; m < 24; m++) {
            rest[m] = 0.01 * ((m / 3 >> m % 3 & 1) + 0.2 * noise(random));
            x[m] = rest[m] * (m % 3 == 2 ? 0.3 : 1.1) + 0.01 * noise(random);
        }
    }
    double energy(int corners) const
    {
        double sum = 0, gradient[3];
        for (int n = 0; n < pliant_barrier_count(corners); n++) {
            const int tet = pliant_barrier_tet(n);
            sum += pliant_barrier_fraction(corners, tet) *
                   pliant_barrier_at(pliant_barrier_ratio_at(corners, node, n % 8, tet, x, rest, gradient)).energy;
        }
        return sum;
    }
};

TEST(VolumeBarrier, ExertsTheGradientOfTheEnergyOfAnElementsTetrahedra)
{
    for (unsigned seed = 0; seed < 20; seed++)
        for (const int corners : {4, 8}) {
            Cube cube(seed);
            cube.node[3] = corners == 4 ? 4 : 3;
            for (int v = 0; v < corners; v++) {
                double force[3] = {0, 0, 0};
                pliant_barrier_add_force(corners, cube.node, v, 1, cube.x, cube.rest, force);
                for (int d = 0; d < 3; d++) {
                    double *at = cube.x + 3 * cube.node[v] + d, kept = *at, step = 1e-8;
                    *at = kept + step;
                    const double after = cube.energy(corners);
                    *at = kept - step;
                    const double before = cube.energy(corners);
                    *at = kept;
                    EXPECT_NEAR((after - before) / (2 * step), force[d], 1e-4 * (1 + std::fabs(force[d]))) << seed;
                }
            }
        }
}

// In a flattened block, the stiffness of an element contains the barrier's, and the product uses the same stiffness.
TEST(VolumeBarrier, IsPartOfTheStiffness)
{
    const int size[3] = {3, 3, 3};
    const double box[3] = {0.03, 0.03, 0.03};
    for (const pliant_element_kind kind : {PLIANT_LINEAR, PLIANT_HEXAHEDRA}) {
        Body body(size, box, {{4000, 0.3, 1000, false}});
        body.cells(3, 3, 3, 1);
        body.fix_plane(0, 0, 0.001, 0, 0, 1);
        body.scene.element.kind = kind;
        ASSERT_EQ(body.build(), PLIANT_OK) << pliant_last_error();
        const pliant_system *system = body.model->system;
        std::vector<double> x(system->mesh->rest, system->mesh->rest + 3 * system->mesh->num_nodes), y(x.size()), v(y),
            expected(y);
        std::vector<pliant_tangent> rest(static_cast<size_t>(system->num_blocks)), flat = rest;
        pliant_system_tangents(system, x.data(), PLIANT_TWIST_POSITIVE, rest.data());
        for (size_t i = 2; i < x.size(); i += 3) x[i] *= 0.2;
        pliant_system_tangents(system, x.data(), PLIANT_TWIST_POSITIVE, flat.data());
        for (size_t i = 0; i < v.size(); i++) v[i] = std::sin(static_cast<double>(7 * i));
        const int32_t *nodes = pliant_element_nodes(system);
        for (int32_t e = 0; e < pliant_element_count(system); e++) {
            const int32_t begin = pliant_element_begin(system, e),
                          n = 3 * (pliant_element_begin(system, e + 1) - begin);
            std::vector<double> k(static_cast<size_t>(n * n)), at_rest = k;
            pliant_system_element(system, flat.data(), e, k.data());
            pliant_system_element(system, rest.data(), e, at_rest.data());
            double trace = 0, trace_at_rest = 0;
            for (int32_t i = 0; i < n; i++) {
                trace += k[n * i + i];
                trace_at_rest += at_rest[n * i + i];
                for (int32_t j = 0; j < n; j++) {
                    EXPECT_NEAR(k[n * i + j], k[n * j + i], 1e-9 * std::fabs(k[n * i + i]));
                    expected[3 * nodes[begin + i / 3] + i % 3] += k[n * i + j] * v[3 * nodes[begin + j / 3] + j % 3];
                }
            }
            EXPECT_GT(trace, 2 * trace_at_rest);
        }
        if (!system->macros) continue;
        pliant_macro_multiply(system, flat.data(), v.data(), y.data());
        for (size_t i = 0; i < y.size(); i++) EXPECT_NEAR(y[i], expected[i], 1e-6);
    }
}

// A grasp at the top of a block of 12 cm jumps by 7 or 12 cm in one step. No step ends with an inverted element. The
// steps with the longer jump are shortened and report it.
TEST(VolumeBarrier, AStepThatWouldInvertAnElementIsShortened)
{
    const int size[3] = {6, 6, 6};
    const double box[3] = {0.12, 0.12, 0.12}, top[3] = {0.06, 0.06, 0.1};
    for (const pliant_element_kind kind : {PLIANT_LINEAR, PLIANT_HEXAHEDRA})
        for (const double jump : {0.07, 0.12}) {
            Body body(size, box, {{4000, 0.45, 1000, false}});
            body.cells(6, 6, 6, 1);
            body.fix_plane(0, 0, 0.001, 0, 0, 1);
            body.scene.element.kind = kind;
            ASSERT_EQ(body.build(), PLIANT_OK) << pliant_last_error();
            int tool = -1, shortened = 0;
            ASSERT_EQ(pliant_tool_add(body.model, body.data, "hook", &tool), PLIANT_OK);
            ASSERT_EQ(pliant_tool_grasp(body.model, body.data, tool, top), PLIANT_OK) << pliant_last_error();
            ASSERT_EQ(pliant_tool_set_drive(body.data, tool, PLIANT_DRIVE_RIGID, nullptr), PLIANT_OK);
            const double target[3] = {top[0], top[1], top[2] + jump};
            ASSERT_EQ(pliant_tool_set_pose(body.data, tool, target, nullptr), PLIANT_OK);
            for (int step = 0; step < 20; step++) {
                ASSERT_GE(pliant_step(body.model, body.data), 0) << pliant_last_error();
                ASSERT_EQ(pliant_data_get_inverted(body.data), 0) << step;
                shortened += body.data->statistics.ended == PLIANT_STEP_END_ELEMENTS;
            }
            pliant_tool_state state;
            ASSERT_EQ(pliant_tool_get(body.data, tool, &state), PLIANT_OK);
            EXPECT_EQ(shortened > 0, jump > 0.1);
            EXPECT_NEAR(state.held_point[2], target[2], 1e-3);
        }
}

// The pull of launch/scenes/demo_pull.yaml: 3 cm at the phantom's liver, within a second. The tissue then follows.
void expect_none_inverted(pliant_element_kind kind, int ratio)
{
    pliant_scene scene;
    pliant_volume scan{};
    pliant_labels labels{};
    pliant_material_table table{};
    pliant_model *model = nullptr;
    pliant_data *data = nullptr;
    ASSERT_EQ(pliant_scene_read(PLIANT_SOURCE_DIR "/launch/scenes/demo.yaml", &scene), PLIANT_OK);
    ASSERT_EQ(pliant_inputs_read(&scene, "phantom", &scan, &labels, &table), PLIANT_OK) << pliant_last_error();
    scene.element.kind = kind;
    scene.mesh.ratio = ratio;
    scene.solver.backend = PLIANT_CPU;
    ASSERT_EQ(pliant_model_build(&scene, &scan, &labels, &table, {nullptr, nullptr}, &model), PLIANT_OK)
        << pliant_last_error();
    ASSERT_EQ(pliant_data_create(model, &data), PLIANT_OK) << pliant_last_error();
    const double liver[3] = {-0.054, -0.063, 0.063};
    int tool = -1, converged = 0;
    EXPECT_EQ(pliant_tool_add(model, data, "grasper", &tool), PLIANT_OK);
    EXPECT_EQ(pliant_tool_grasp(model, data, tool, liver), PLIANT_OK) << pliant_last_error();
    EXPECT_EQ(pliant_tool_set_drive(data, tool, PLIANT_DRIVE_RIGID, nullptr), PLIANT_OK);
    for (int s = 1; s <= 70 && converged < 2; s++) {
        const double target[3] = {liver[0], liver[1] - 0.03 * std::min(s, 50) / 50, liver[2]};
        EXPECT_EQ(pliant_tool_set_pose(data, tool, target, nullptr), PLIANT_OK);
        const pliant_status status = pliant_step(model, data);
        EXPECT_GE(status, 0) << pliant_last_error();
        EXPECT_EQ(pliant_data_get_inverted(data), 0) << s;
        converged = s > 50 && status == PLIANT_OK ? converged + 1 : 0;
    }
    pliant_tool_state state;
    EXPECT_EQ(pliant_tool_get(data, tool, &state), PLIANT_OK);
    EXPECT_EQ(converged, 2);
    EXPECT_NEAR(state.held_point[1], liver[1] - 0.03, 1e-4);
    pliant_data_free(data);
    pliant_model_free(model);
    pliant_material_table_free(&table);
    pliant_volume_free(&scan);
    pliant_labels_free(&labels);
}

TEST(PullOfThreeCentimetres, InvertsNoHexahedronOf21Millimetres) { expect_none_inverted(PLIANT_HEXAHEDRA, 2); }
TEST(PullOfThreeCentimetres, InvertsNoHexahedronOf14Millimetres) { expect_none_inverted(PLIANT_HEXAHEDRA, 3); }
TEST(PullOfThreeCentimetres, InvertsNoHexahedronOf10Millimetres) { expect_none_inverted(PLIANT_HEXAHEDRA, 4); }
TEST(PullOfThreeCentimetres, InvertsNoTetrahedronOf14Millimetres) { expect_none_inverted(PLIANT_LINEAR, 3); }

} // namespace
