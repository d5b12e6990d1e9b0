// element/law: neo_hookean in the quasi-static solver, for tetrahedra and hexahedra.
#include "body.h"
#include "fragments.h"

#include "fem/element/law.h"
#include "fem/element/rotation.h"
#include "sim/api/data.h"

#include <random>

namespace
{

const char *name_of(pliant_element_kind kind) { return kind == PLIANT_LINEAR ? "tetrahedra" : "hexahedra"; }

// Return the forces on all nodes of a simulation's present topology.
std::vector<double> forces_of(const Body &body, const std::vector<double> &x)
{
    const pliant_system *system = body.data->discretization->system;
    std::vector<double> buffer(12 * LANES * static_cast<size_t>(system->num_blocks)), out(x.size());
    auto blocks = reinterpret_cast<double(*)[12][LANES]>(buffer.data());
    pliant_system_element_forces(system, x.data(), blocks);
    const int32_t *node = pliant_element_nodes(system);
    for (int32_t c = 0; c < pliant_element_begin(system, pliant_element_count(system)); c++)
        for (int d = 0; d < 3; d++)
            out[3 * node[c] + d] += system->macros ? buffer[3 * static_cast<size_t>(c) + d]
                                                   : blocks[c / 4 / LANES][3 * (c % 4) + d][c / 4 % LANES];
    return out;
}

double norm(const std::vector<double> &v)
{
    double sum = 0;
    for (double one : v) sum += one * one;
    return std::sqrt(sum);
}

// The force on a face of a block with a homogeneous deformation is P n A, and inner nodes feel no force. A large pull
// converges, needs another force than the corotational law, and dynamic relaxation with the same law agrees.
TEST(NeoHookean, ElementsHaveItsStress)
{
    const int size[3] = {16, 16, 16};
    const double box[3] = {0.1, 0.1, 0.1}, poisson = 0.4, young = 5000, mu = young / 2 / (1 + poisson),
                 lambda = young * poisson / (1 + poisson) / (1 - 2 * poisson);
    const double point[3] = {0.05, 0.05, 0.0875}, pulled[3] = {0.05, 0.05, 0.1275};
    for (pliant_element_kind kind : {PLIANT_LINEAR, PLIANT_HEXAHEDRA}) {
        double force[3], lifted[3];
        for (int run = 0; run < 3; run++) { // corotational, neo-Hookean, dynamic relaxation
            Body body(size, box, {{young, poisson, 1000, false}});
            body.cells(4, 4, 4, 2);
            body.fix_plane(0, 0, 0, 0, 0, 1);
            body.scene.element.kind = kind;
            body.scene.grasp.radius = 0.03;
            body.scene.element.law = run == 1 ? PLIANT_ELASTICITY_NEO_HOOKEAN : PLIANT_ELASTICITY_COROTATIONAL;
            if (run == 2) body.scene.solver.kind = PLIANT_TLED;
            body.scene.tled.quasi_static = true;
            ASSERT_EQ(body.build(), PLIANT_OK) << pliant_last_error();
            const pliant_mesh &mesh = body.model->body->fine;
            if (run == 1) {
                const double f[9] = {1.1, 0.2, 0, -0.1, 0.8, 0.3, 0.1, 0, 1.4};
                std::vector<double> x(3 * static_cast<size_t>(mesh.num_nodes));
                for (int32_t n = 0; n < mesh.num_nodes; n++)
                    for (int d = 0; d < 3; d++)
                        for (int c = 0; c < 3; c++) x[3 * n + d] += f[3 * d + c] * mesh.rest[3 * n + c];
                const std::vector<double> nodal = forces_of(body, x);
                double stress[9], top[3] = {0, 0, 0};
                pliant_law_response(PLIANT_LAW_NEO_HOOKEAN, lambda, mu, f, stress);
                for (int32_t n = 0; n < mesh.num_nodes; n++) {
                    const double *at = mesh.rest + 3 * n;
                    const bool inside = *std::min_element(at, at + 3) > 1e-9 && *std::max_element(at, at + 3) < 0.0999;
                    for (int d = 0; d < 3 && at[2] > 0.0999; d++) top[d] += nodal[3 * n + d];
                    for (int d = 0; d < 3 && inside; d++) EXPECT_NEAR(nodal[3 * n + d], 0, 1e-6 * norm(nodal));
                }
                // roots of hexahedra have single precision
                for (int d = 0; d < 3; d++)
                    EXPECT_NEAR(top[d], stress[3 * d + 2] * 0.01, kind == PLIANT_LINEAR ? 1e-9 : 1e-6);
            }
            int tool;
            ASSERT_EQ(pliant_tool_add(body.model, body.data, "t", &tool), PLIANT_OK);
            ASSERT_EQ(pliant_tool_grasp(body.model, body.data, tool, point), PLIANT_OK) << pliant_last_error();
            pliant_tool_set_drive(body.data, tool, PLIANT_DRIVE_RIGID, nullptr);
            ASSERT_EQ(pliant_tool_set_pose(body.data, tool, pulled, nullptr), PLIANT_OK);
            if (run < 2) {
                ASSERT_EQ(body.settle(), PLIANT_OK);
            } else {
                for (int step = 0; step < 40; step++) ASSERT_GE(pliant_step(body.model, body.data), 0);
            }
            EXPECT_EQ(pliant_data_get_inverted(body.data), 0);
            force[run] = body.data->tools[tool].force[2];
            lifted[run] = 0;
            for (int32_t n = 0; n < mesh.num_nodes; n++)
                lifted[run] += (body.data->positions[3 * n + 2] - mesh.rest[3 * n + 2]) / mesh.num_nodes;
        }
        std::printf("%s: force %.4f N corotational, %.4f N neo-Hookean, %.4f N by relaxation; mean rise %.4f, %.4f, "
                    "%.4f mm\n",
                    name_of(kind), force[0], force[1], force[2], 1e3 * lifted[0], 1e3 * lifted[1], 1e3 * lifted[2]);
        // explicit hexahedra resist hourglass modes with another stiffness
        EXPECT_NEAR(lifted[1], lifted[2], (kind == PLIANT_LINEAR ? 2e-3 : 0.02) * lifted[2]);
        EXPECT_NEAR(force[1], force[2], (kind == PLIANT_LINEAR ? 5e-3 : 0.02) * force[2]);
        EXPECT_GT(std::fabs(force[0] - force[1]), 0.02 * force[1]);
    }
}

// In rotated tissue with small strains both laws have the same forces. The difference is of second order in the
// strain. The body has several materials in each cube, partly filled cubes, and air; the lattice and the octree are
// cut half through.
TEST(NeoHookean, SmallStrainsAreCorotational)
{
    const int size[3] = {16, 16, 16};
    const double box[3] = {0.08, 0.08, 0.08}, tilted[9] = {0.36, 0.48, -0.8, -0.8, 0.6, 0, 0.48, 0.64, 0.6};
    const Plane plane{{0.0405, 0.04, 0.04}, {1, 0.1, 0.05}};
    for (bool octree : {false, true}) {
        double apart[2], scale[2];
        for (int n = 0; n < 2; n++) {
            const double strain = n ? 1e-3 : 2e-3;
            std::vector<double> forces[2];
            for (pliant_elasticity law : {PLIANT_ELASTICITY_COROTATIONAL, PLIANT_ELASTICITY_NEO_HOOKEAN}) {
                Body body(size, box, {{2000, 0.45, 1000, false}, {2e5, 0.4999, 1500, false}, {1, 0.3, 1, true}},
                          [](int i, int j, int k) {
                              return std::hypot(std::hypot(i - 7.0, j - 8.5), k - 6.0) > 9.3
                                         ? 2
                                         : (i * 7 + j * 3 + k * 5) % 11 < 3;
                          });
                body.scene.element.kind = PLIANT_HEXAHEDRA;
                body.scene.element.law = law;
                body.scene.mesh.kind = octree ? PLIANT_OCTREE : PLIANT_LATTICE;
                body.scene.mesh.depth = 1;
                body.scene.mesh.keep_air = true;
                body.scene.cut.kind = PLIANT_CUT_SEVER;
                body.cells(octree ? 4 : 8, octree ? 4 : 8, octree ? 4 : 8, 1);
                body.fix_plane(0, 0, 1e-4, 0, 0, 1);
                ASSERT_EQ(body.build(), PLIANT_OK) << pliant_last_error();
                const pliant_body *next =
                    sever_plane(body.data->body, 2, plane, [](const double *x) { return x[2] > 0.03; });
                ASSERT_TRUE(next) << pliant_last_error();
                ASSERT_EQ(pliant_data_set_body(body.model, body.data, next), PLIANT_OK) << pliant_last_error();
                pliant_body_release(next);
                const pliant_mesh &mesh = body.data->body->fine;
                const pliant_macros &macros = *body.data->discretization->system->macros;
                int hexahedra = 0;
                for (int32_t e = 0; e < macros.count; e++) hexahedra += macros.start[e + 1] - macros.start[e] == 8;
                EXPECT_GT(hexahedra, macros.count / 8);
                EXPECT_GT(macros.count - hexahedra, 10);
                std::mt19937 random(5);
                std::uniform_real_distribution<double> uniform(-1, 1);
                double r[9];
                pliant_rotation_signed_svd(tilted, r);
                std::vector<double> x(3 * static_cast<size_t>(mesh.num_nodes));
                for (int32_t v = 0; v < mesh.num_nodes; v++) {
                    double at[3];
                    for (int d = 0; d < 3; d++) at[d] = mesh.rest[3 * v + d] + strain * 0.01 * uniform(random);
                    for (int d = 0; d < 3; d++)
                        x[3 * v + d] = 0.3 + r[3 * d] * at[0] + r[3 * d + 1] * at[1] + r[3 * d + 2] * at[2];
                }
                forces[law] = forces_of(body, x);
            }
            scale[n] = norm(forces[0]);
            for (size_t i = 0; i < forces[0].size(); i++) forces[0][i] -= forces[1][i];
            apart[n] = norm(forces[0]);
        }
        std::printf("%s: forces apart by %.1e of them, and %.1e at half the strain\n", octree ? "octree" : "lattice",
                    apart[0] / scale[0], apart[1] / scale[1]);
        EXPECT_LT(apart[0], 0.05 * scale[0]);
        EXPECT_NEAR(apart[0] / apart[1], 4, 0.1);
    }
}

// A block that is cut half through, of two materials in each cube and nearly incompressible, bends far under its
// weight. It converges, and no element inverts.
TEST(NeoHookean, ACutBlockConverges)
{
    const int size[3] = {16, 16, 16};
    const double box[3] = {0.08, 0.08, 0.08};
    const Plane plane{{0.0405, 0.04, 0.04}, {1, 0.1, 0.05}};
    for (bool octree : {false, true}) {
        Body body(size, box, {{2000, 0.4999, 1000, false}, {8000, 0.45, 1000, false}},
                  [](int i, int j, int k) { return (i * 7 + j * 3 + k * 5) % 11 < 3; });
        body.scene.element.kind = PLIANT_HEXAHEDRA;
        body.scene.element.law = PLIANT_ELASTICITY_NEO_HOOKEAN;
        body.scene.mesh.kind = octree ? PLIANT_OCTREE : PLIANT_LATTICE;
        body.scene.mesh.depth = 1;
        body.scene.cut.kind = PLIANT_CUT_SEVER;
        body.scene.model.gravity[0] = 10;
        body.cells(octree ? 4 : 8, octree ? 4 : 8, octree ? 4 : 8, 1);
        body.fix_plane(0, 0, 1e-4, 0, 0, 1);
        ASSERT_EQ(body.build(), PLIANT_OK) << pliant_last_error();
        ASSERT_EQ(body.settle(), PLIANT_OK) << body.data->statistics.residual;
        const pliant_body *next = sever_plane(body.data->body, 2, plane, [](const double *x) { return x[2] > 0.03; });
        ASSERT_TRUE(next) << pliant_last_error();
        ASSERT_EQ(pliant_data_set_body(body.model, body.data, next), PLIANT_OK) << pliant_last_error();
        pliant_body_release(next);
        ASSERT_EQ(body.settle(), PLIANT_OK) << body.data->statistics.residual;
        std::printf("%s: %d evaluations in the last step\n", octree ? "octree" : "lattice",
                    body.data->statistics.iterations);
        EXPECT_EQ(pliant_data_get_inverted(body.data), 0);
    }
}

} // namespace
