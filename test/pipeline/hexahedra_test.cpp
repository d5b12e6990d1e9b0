// Trilinear hexahedra (element/kind): not too stiff in bending, nor for nearly incompressible tissue.
#include "beam.h"
#include "fragments.h"

#include "base/memory.h"
#include "fem/dynamics/tled_cubes.h"
#include "fem/element/rotation.h"
#include "base/dense.h"
#include "fem/element/scalar.h"
#include "mesh/mesh.h"
#include "sim/api/data.h"

#include <algorithm>
#include <array>
#include <map>
#include <string>

namespace {

// Converged sags of quadratic hexahedra, neo-Hookean: 6.87, 6.79, 6.75 mm; with CalculiX 6.88, 6.80, 6.80 mm.
TEST(Hexahedra, BeamSagsAsTheConvergedOne)
{
    const double poisson[3] = {0.45, 0.49, 0.499}, converged[3] = {6.87e-3, 6.79e-3, 6.75e-3};
    for (int n = 0; n < 3; n++) {
        double coarse = Beam(PLIANT_HEXAHEDRA, poisson[n], 3).sag() / converged[n] - 1,
               fine = Beam(PLIANT_HEXAHEDRA, poisson[n], 6).sag() / converged[n] - 1;
        double linear = Beam(PLIANT_LINEAR, poisson[n], 3).sag() / converged[n] - 1;
        std::printf("beam, nu %.3f: cells of 10 mm %.1f %%, of 5 mm %.1f %%; linear tetrahedra of 10 mm %.1f %%\n",
                    poisson[n], 100 * coarse, 100 * fine, 100 * linear);
        EXPECT_LT(std::fabs(coarse), 0.05);
        EXPECT_LT(std::fabs(fine), 0.02);
        EXPECT_LT(linear, -0.2);
    }
}

double coarse_sag(pliant_method method, double poisson, int ratio)
{
    Beam beam(PLIANT_HEXAHEDRA, poisson, 3);
    beam.scene.model.method = method;
    beam.scene.mesh.ratio = ratio;
    return beam.sag();
}

// A beam of one material (other bodies: held_edges_test).
TEST(Hexahedra, CoarseBeamSagsAsTheConvergedOne)
{
    const double poisson[3] = {0.45, 0.49, 0.499}, converged[3] = {6.87e-3, 6.79e-3, 6.75e-3};
    for (int n = 0; n < 3; n++)
        for (int ratio = 2; ratio <= 4; ratio += 2) {
            double averaged = coarse_sag(PLIANT_AVERAGED, poisson[n], ratio) / converged[n] - 1;
            double coarse = coarse_sag(PLIANT_COARSE, poisson[n], ratio) / converged[n] - 1;
            std::printf("beam, nu %.3f, coarse cubes of 10 mm, ratio %d: averaged %.1f %%, coarse %.1f %%\n",
                        poisson[n], ratio, 100 * averaged, 100 * coarse);
            EXPECT_LT(std::fabs(averaged), 0.02);
            EXPECT_LT(std::fabs(coarse), 0.02);
        }
    // at least as soft as the fine hexahedra, because only its corners carry load (src/fem/coarse/NUMERICS.md)
    for (int n = 0; n < 3; n++) {
        const double schur = coarse_sag(PLIANT_SCHUR, poisson[n], 2) / converged[n],
                     fine = Beam(PLIANT_HEXAHEDRA, poisson[n], 6).sag() / converged[n];
        std::printf("beam, nu %.3f, ratio 2: schur %.2f times the sag, fine hexahedra %.3f\n", poisson[n], schur, fine);
        EXPECT_GT(schur, fine);
    }
    for (int n = 1; n < 3; n++) {
        const double lod = coarse_sag(PLIANT_LOD, poisson[n], 2) / converged[n] - 1;
        std::printf("beam, nu %.3f, ratio 2: lod %.1f %%\n", poisson[n], 100 * lod);
        EXPECT_LT(std::fabs(lod), 0.02); // 6.2 % at 0.499 with the full bulk modulus in the fine cubes
    }
}

// Scalars of a nearly incompressible beam: one volume change per cube, small everywhere, although the cube's five
// tetrahedra have opposite changes.
TEST(Hexahedra, ScalarsAreOfCubes)
{
    Beam beam(PLIANT_HEXAHEDRA, 0.499, 3);
    beam.sag();
    const pliant_body *body = beam.model->body;
    std::vector<float> ratio(static_cast<size_t>(body->fine.num_tets)), stress(ratio.size());
    pliant_data_tet_scalar(beam.model, body, beam.data->positions, PLIANT_SCALAR_VOLUME_RATIO, ratio.data());
    pliant_data_tet_scalar(beam.model, body, beam.data->positions, PLIANT_SCALAR_VON_MISES, stress.data());
    float maximum = 0;
    for (size_t t = 0; t < ratio.size(); t++) {
        const auto first = static_cast<size_t>(body->fine.tet_of_lattice[body->fine.lattice_of_tet[t] / 5 * 5]);
        EXPECT_EQ(ratio[t], ratio[first]);
        EXPECT_EQ(stress[t], stress[first]);
        maximum = std::fmax(maximum, std::fabs(ratio[t] - 1));
    }
    EXPECT_LT(maximum, 0.01f);
}

// Return the sag of the same beam in explicit dynamics, relaxed: one integration point per cube, with hourglass control
// (tled_cubes.h).
double relaxed_sag(pliant_element_kind kind, double poisson)
{
    Beam beam(kind, poisson, 3);
    beam.scene.solver.kind = PLIANT_TLED;
    beam.scene.tled.quasi_static = true;
    beam.scene.tled.relaxation_steps = 2000;
    beam.scene.solver.tolerance = 1e-3;
    return beam.sag(40);
}

TEST(Hexahedra, BeamRelaxesToTheConvergedSag)
{
    const double poisson[3] = {0.45, 0.49, 0.499}, converged[3] = {6.87e-3, 6.79e-3, 6.75e-3};
    for (int n = 0; n < 3; n++) {
        double error = relaxed_sag(PLIANT_HEXAHEDRA, poisson[n]) / converged[n] - 1;
        std::printf("explicit, nu %.3f, cells of 10 mm: %.1f %%\n", poisson[n], 100 * error);
        EXPECT_LT(std::fabs(error), 0.05);
    }
    EXPECT_LT(relaxed_sag(PLIANT_LINEAR, 0.45) / converged[0] - 1, -0.2);
}

// Stiffness of a free cube at rest by finite differences of forces. It has exactly six zero modes, the rigid motions.
// Its largest eigenvalue is the bound used for the time step.
TEST(Hexahedra, AFreeExplicitCubeHasSixZeroModes)
{
    const int size[3] = {2, 2, 2};
    const double box[3] = {0.01, 0.012, 0.008};
    Body one(size, box, {{3000, 0.45, 1000, false}});
    one.scene.element.kind = PLIANT_HEXAHEDRA;
    one.scene.solver.kind = PLIANT_TLED;
    one.cells(1, 1, 1, 1);
    one.fix_plane(0, 0, 1e-6, 0, 0, 1);
    ASSERT_EQ(one.build(), PLIANT_OK) << pliant_last_error();
    pliant_tled *tled = one.data->tled;
    const pliant_tled_system *system = one.model->tled;
    std::vector<double> k(24 * 24), values(24), vectors(24 * 24);
    for (int j = 0; j < 24; j++)
        for (int side = -1; side <= 1; side += 2) {
            const double step = 1e-5;
            tled->u[j] = side * step;
            pliant_tled_element_forces(tled, tled->time_step);
            tled->u[j] = 0;
            for (int i = 0; i < 24; i++)
                for (int32_t c = system->corner_start[i / 3]; c < system->corner_start[i / 3 + 1]; c++)
                    k[24 * i + j] += side * double(tled->forces[system->corner[c] + i % 3 * LANES]) / (2 * step);
        }
    for (int i = 0; i < 24; i++)
        for (int j = 0; j < i; j++) k[24 * i + j] = k[24 * j + i] = 0.5 * (k[24 * i + j] + k[24 * j + i]);
    pliant_dense_symmetric_eigen(24, k.data(), values.data(), vectors.data());
    std::sort(values.begin(), values.end());
    EXPECT_LT(values[5], 1e-4 * values[23]);
    const double lambda = 3000 * 0.45 / 1.45 / 0.1, mu = 3000 / 2.9, volume = box[0] * box[1] * box[2];
    // the softest twisting mode
    EXPECT_NEAR(values[6], volume * mu * 8 * double(system->cubes->bending.minimum), 1e-2 * values[6]);
    EXPECT_GT(values[6], 1e-3 * values[23]); // no other zero mode
    EXPECT_NEAR(values[23], volume * pliant_cube_largest_eigenvalue(box, lambda, mu), 1e-3 * values[23]);
    const double mass = 1000 * volume / 8; // mass of a corner; central differences are stable up to 2 / w
    EXPECT_NEAR(system->eigenvalue_bound, 2 * std::sqrt(mass / values[23]), 1e-3 * system->eigenvalue_bound);
}

class Block : public ::testing::Test {
protected:
    const int size[3] = {12, 12, 12};
    const double box[3] = {0.06, 0.06, 0.06};
    // stiff and soft voxels, so that every cube has several materials
    Body body{size,
              box,
              {{2000, 0.45, 1000, false}, {2e6, 0.3, 1500, false}, {1, 0.3, 1, true}},
              [](int i, int j, int k) { return (i * 7 + j * 3 + k * 5) % 11 < 3 ? 1 : 0; }};
    void SetUp() override
    {
        body.scene.element.kind = PLIANT_HEXAHEDRA;
        body.cells(3, 3, 3, 1);
        body.fix_plane(0, 0, 1e-4, 0, 0, 1);
    }
};

TEST_F(Block, TurnedRigidlyItFeelsNothing)
{
    for (pliant_method method : {PLIANT_FINE, PLIANT_AVERAGED, PLIANT_COARSE}) {
        body.scene.model.method = method;
        body.cells(3, 3, 3, method == PLIANT_FINE ? 1 : 2);
        ASSERT_EQ(body.build(), PLIANT_OK) << pliant_last_error();
        const pliant_system *system = body.model->system;
        double r[9], f[9] = {0.36, 0.48, -0.8, -0.8, 0.6, 0, 0.48, 0.64, 0.6}, shift[3] = {0.3, -0.2, 0.1};
        pliant_rotation_signed_svd(f, r);
        std::vector<double> turned = affine(*system->mesh, r, shift), force = body.elastic_force(turned);
        double stretch[9] = {1.1, 0, 0, 0, 0.95, 0, 0, 0, 1}, zero[3] = {0, 0, 0};
        EXPECT_LT(largest(force), 1e-7 * largest(body.elastic_force(affine(*system->mesh, stretch, zero))));
        if (method == PLIANT_FINE) continue;
        const pliant_mesh &fine = body.model->body->fine; // fine nodes follow the coarse ones, except fixed ones
        std::vector<double> follows(3 * static_cast<size_t>(fine.num_nodes)), whole = affine(fine, r, shift);
        pliant_upsample_positions(system, turned.data(), follows.data());
        for (int32_t n = 0; n < 3 * fine.num_nodes; n++)
            if (method == PLIANT_COARSE || !body.model->body->fine_fixed[n / 3])
                ASSERT_NEAR(follows[n], whole[n], 1e-12);
        pliant_upsample_positions(system, system->mesh->rest, follows.data());
        EXPECT_EQ(std::memcmp(follows.data(), fine.rest, follows.size() * sizeof(double)), 0);
    }
}

// For one material, a linear displacement causes no internal force.
TEST(Hexahedra, PatchTest)
{
    const int size[3] = {12, 12, 12};
    const double box[3] = {0.06, 0.05, 0.07};
    Body body(size, box, {{2000, 0.49, 1000, false}});
    body.scene.element.kind = PLIANT_HEXAHEDRA;
    body.cells(3, 3, 3, 1);
    body.fix_plane(0, 0, 1e-4, 0, 0, 1);
    ASSERT_EQ(body.build(), PLIANT_OK) << pliant_last_error();
    const pliant_mesh &fine = body.model->body->fine;
    double a[9] = {1.02, 0.01, 0, 0.01, 0.97, 0.02, 0, 0.02, 1.01}, b[3] = {0, 0, 0};
    std::vector<double> force = body.elastic_force(affine(fine, a, b));
    double inside = 0;
    for (int32_t n = 0; n < fine.num_nodes; n++) {
        bool edge = false;
        for (int d = 0; d < 3; d++) edge = edge || fine.rest[3 * n + d] < 1e-9 || fine.rest[3 * n + d] > box[d] - 1e-9;
        for (int d = 0; d < 3 && !edge; d++) inside = std::fmax(inside, std::fabs(force[3 * n + d]));
    }
    EXPECT_LT(inside, 1e-6 * largest(force));
}

// Gravity of cubes: each corner gets the weight by the shape functions, an eighth for one material. The sum is the
// weight of the tissue.
TEST_F(Block, WeighsAtItsCornersByTheShapeFunctions)
{
    ASSERT_EQ(body.build(), PLIANT_OK) << pliant_last_error();
    const pliant_mesh &fine = body.model->body->fine;
    std::vector<double> mass(static_cast<size_t>(fine.num_nodes)), plain(mass.size());
    ASSERT_EQ(pliant_hexahedra_masses(&fine, body.model->body->fine_material, mass.data()), PLIANT_OK);
    double sum = 0, whole = 0, moment[2] = {0, 0};
    for (size_t n = 0; n < mass.size(); n++) {
        sum += mass[n];
        whole += body.model->body->node_mass[n];
        // trilinear functions include linear ones, so hexahedra have the centres of mass of tetrahedra
        moment[0] += mass[n] * fine.rest[3 * n];
        moment[1] += body.model->body->node_mass[n] * fine.rest[3 * n];
    }
    EXPECT_NEAR(sum, whole, 1e-12 * whole);
    EXPECT_NEAR(moment[0], moment[1], 1e-12 * whole);
    const pliant_system &system = *body.model->system;
    for (int32_t f = 0; f < system.num_free; f++)
        EXPECT_EQ(system.gravity_mass[9 * f], mass[static_cast<size_t>(system.node_of_free[f])]);
    std::vector<pliant_tet_material> one(static_cast<size_t>(fine.num_tets), body.model->body->fine_material[0]);
    for (pliant_tet_material &material : one) material.density = 27;
    ASSERT_EQ(pliant_hexahedra_masses(&fine, one.data(), plain.data()), PLIANT_OK);
    for (int32_t n = 0; n < fine.num_nodes; n++) {
        int cubes = 1;
        for (int d = 0; d < 3; d++)
            cubes *= fine.rest[3 * n + d] > 1e-9 && fine.rest[3 * n + d] < box[d] - 1e-9 ? 2 : 1;
        EXPECT_NEAR(plain[static_cast<size_t>(n)], cubes * 27 * 8e-6 / 8, 1e-15);
    }
}

// Eigenvalues of a free cube, fine or composed of eight cubes: only the six rigid motions have zero stiffness. This is
// also true for a cube with one voxel of tissue.
TEST_F(Block, NoSpuriousZeroModes)
{
    for (bool almost_empty : {false, true}) for (int ratio = 1; ratio <= 2; ratio++) {
            Body one(size, box, {{2000, 0.45, 1000, false}, {1, 0.3, 1, true}},
                     [&](int i, int j, int k) { return almost_empty && i + j + k > 0; });
            one.scene.element.kind = PLIANT_HEXAHEDRA;
            one.scene.model.method = ratio == 1 ? PLIANT_FINE : PLIANT_AVERAGED;
            one.cells(1, 1, 1, ratio);
            one.fix_plane(0, 0, 1e-4, 0, 0, 1);
            if (almost_empty && ratio > 1) one.scene.mesh.keep_air = true;
            ASSERT_EQ(one.build(), PLIANT_OK) << pliant_last_error();
            const pliant_macros &macros = *one.model->system->macros;
            ASSERT_EQ(macros.count, 1);
            ASSERT_EQ(macros.start[1], 8);
            EXPECT_EQ(macros.rank[0], 18);
            std::vector<double> k(24 * 24), values(24), vectors(24 * 24);
            for (int m = 0; m < macros.rank[0]; m++)
                for (int i = 0; i < 24; i++)
                    for (int j = 0; j < 24; j++)
                        k[24 * i + j] += double(macros.root[0][24 * m + i]) * double(macros.root[0][24 * m + j]);
            pliant_dense_symmetric_eigen(24, k.data(), values.data(), vectors.data());
            std::sort(values.begin(), values.end());
            EXPECT_LT(values[5], 1e-6 * values[23]);
            EXPECT_GT(values[6], (almost_empty ? 1e-5 : 1e-2) * values[23]);
    }
}

// Contrast 1 : 1000, nearly incompressible next to compressible, and a load with large rotations: it converges.
TEST_F(Block, SettlesBetweenSoftAndStiff)
{
    body.scene.model.gravity[0] = 40;
    ASSERT_EQ(body.build(), PLIANT_OK) << pliant_last_error();
    EXPECT_EQ(body.settle(), PLIANT_OK) << body.data->statistics.residual;
    EXPECT_EQ(pliant_data_get_inverted(body.data), 0);
}

// The default is hexahedra, or tetrahedra if another feature requires them; the model reports which.
TEST_F(Block, TheDefaultIsHexahedraIfSupported)
{
    pliant_scene defaults;
    pliant_scene_defaults(&defaults);
    for (bool pressure : {false, true}) {
        body.scene.element.kind = defaults.element.kind;
        body.scene.solver.kind = pressure ? PLIANT_TLED : PLIANT_COROTATIONAL;
        body.scene.tled.nodal_pressure = pressure;
        std::string logged;
        pliant_set_log(
            [](pliant_log_level, const char *message, void *user) {
                if (std::strstr(message, "element/kind")) *static_cast<std::string *>(user) += message;
            },
            &logged);
        const pliant_status status = body.build();
        pliant_set_log(nullptr, nullptr);
        ASSERT_EQ(status, PLIANT_OK) << pliant_last_error();
        EXPECT_EQ(pliant_model_get_scene(body.model)->element.kind, pressure ? PLIANT_LINEAR : PLIANT_HEXAHEDRA);
        EXPECT_NE(logged.find(pressure ? "linear here; tled/nodal_pressure" : "hexahedra here"), std::string::npos)
            << logged;
        if (!pressure) EXPECT_NE(body.model->system->macros, nullptr);
    }
}

TEST_F(Block, RefusesUnsupportedOptions)
{
    body.scene.cut.kind = PLIANT_CUT_SUBDIVIDE;
    EXPECT_EQ(body.build(), PLIANT_ERROR_SCENE);
    EXPECT_NE(std::string(pliant_last_error()).find("element/kind"), std::string::npos);
}

// An octree whose labels in balls and specks refine it locally, so that there are hanging nodes at all faces of cubes.
struct Octree : Body {
    static std::vector<Material> materials(double contrast)
    {
        return {{2000, 0.45, 1000, false}, {2000 * contrast, 0.45, 1000, false}};
    }
    explicit Octree(double contrast, double height = 0.08)
        : Body(std::array<int, 3>{16, 16, static_cast<int>(200 * height)}.data(),
               std::array<double, 3>{0.08, 0.08, height}.data(), materials(contrast), [](int i, int j, int k) {
                   double dx = i - 4.2, dy = j - 5.1, dz = k - 9.7;
                   return dx * dx + dy * dy + dz * dz < 6 || (i == 12 && j == 11 && k == 4) ||
                                  (i == 15 && j == 0 && k > 13)
                              ? 1
                              : 0;
               })
    {
        scene.element.kind = PLIANT_HEXAHEDRA;
        scene.mesh.kind = PLIANT_OCTREE;
        scene.mesh.depth = 2;
        scene.mesh.purity = 1;
        cells(2, 2, static_cast<int>(25 * height), 1);
        fix_plane(0, 0, 1e-4, 0, 0, 1);
    }
};

TEST(OctreeHexahedra, PassThePatchTestAndTurn)
{
    Octree body(1);
    ASSERT_EQ(body.build(), PLIANT_OK) << pliant_last_error();
    const pliant_mesh &fine = body.model->body->fine;
    const pliant_upsample &upsample = *body.model->system->upsample;
    double a[9] = {1.02, 0.01, 0, 0.01, 0.97, 0.02, 0, 0.02, 1.01}, b[3] = {0.01, 0, 0};
    std::vector<double> stretched = affine(fine, a, b), force = body.elastic_force(stretched),
                        follows(stretched.size());
    double inside = 0;
    int hanging = 0;
    for (int32_t n = 0; n < fine.num_nodes; n++) {
        bool edge = false;
        for (int d = 0; d < 3; d++) edge = edge || fine.rest[3 * n + d] < 1e-9 || fine.rest[3 * n + d] > 0.08 - 1e-9;
        for (int d = 0; d < 3 && !edge; d++) inside = std::fmax(inside, std::fabs(force[3 * n + d]));
        hanging += upsample.node[8 * n] != n;
    }
    EXPECT_GT(hanging, 30);
    EXPECT_LT(inside, 1e-6 * largest(force));
    pliant_upsample_positions(body.model->system, stretched.data(), follows.data());
    for (int32_t n = 0; n < 3 * fine.num_nodes; n++)
        if (!body.model->body->fine_fixed[n / 3]) ASSERT_NEAR(follows[n], stretched[n], 1e-12);
    pliant_upsample_positions(body.model->system, fine.rest, follows.data());
    EXPECT_EQ(std::memcmp(follows.data(), fine.rest, follows.size() * sizeof(double)), 0);
    double r[9], f[9] = {0.36, 0.48, -0.8, -0.8, 0.6, 0, 0.48, 0.64, 0.6}, shift[3] = {0.3, -0.2, 0.1};
    pliant_rotation_signed_svd(f, r);
    EXPECT_LT(largest(body.elastic_force(affine(fine, r, shift))), 1e-6 * largest(force));
}

// Octree leaves have the scalars of hexahedra, also large leaves next to small ones: one value each, and the mean at
// nodes.
TEST(OctreeHexahedra, ScalarsAreOfLeaves)
{
    for (pliant_solver_kind kind : {PLIANT_COROTATIONAL, PLIANT_TLED}) {
        Octree body(1);
        body.scene.solver.kind = kind;
        ASSERT_EQ(body.build(), PLIANT_OK) << pliant_last_error();
        const pliant_mesh &fine = body.model->body->fine;
        std::vector<double> bent(fine.rest, fine.rest + 3 * fine.num_nodes),
            sum(2 * static_cast<size_t>(fine.num_nodes));
        for (int32_t n = 0; n < fine.num_nodes; n++)
            bent[3 * n] += 2 * fine.rest[3 * n] * fine.rest[3 * n + 1] * fine.rest[3 * n + 2];
        std::vector<float> energy(static_cast<size_t>(fine.num_tets)), of_node(static_cast<size_t>(fine.num_nodes));
        const size_t before = pliant_memory_in_use();
        pliant_status status = PLIANT_ERROR_MEMORY;
        for (int n = 0; status != PLIANT_OK; n++) {
            pliant_memory_fail_after(n);
            status = pliant_data_tet_scalar(body.model, body.model->body, bent.data(), PLIANT_SCALAR_STRAIN_ENERGY,
                                            energy.data());
            pliant_memory_fail_after(-1);
            ASSERT_EQ(pliant_memory_in_use(), before) << "allocation " << n;
            ASSERT_TRUE(status == PLIANT_OK ? n > 3 : status == PLIANT_ERROR_MEMORY);
        }
        int alike[2] = {0, 0}, apart = 0;
        for (int32_t leaf = 0; leaf < fine.num_leaves; leaf++) {
            const int32_t begin = fine.leaf_start[leaf], end = fine.leaf_start[leaf + 1];
            bool same = true;
            for (int32_t t = begin; t < end; t++) same = same && energy[t] == energy[begin];
            if (end > begin) (same ? alike[end - begin > 5] : apart)++;
        }
        EXPECT_GT(alike[0], 50);
        // in explicit dynamics, leaves next to smaller ones are tetrahedra
        EXPECT_EQ(alike[1] > 5, kind == PLIANT_COROTATIONAL);
        EXPECT_EQ(apart > 5, kind == PLIANT_TLED);
        ASSERT_EQ(
            pliant_data_scalar(body.model, body.model->body, bent.data(), PLIANT_SCALAR_STRAIN_ENERGY, of_node.data()),
            PLIANT_OK);
        for (int32_t v = 0; v < 4 * fine.num_tets; v++) {
            double gradients[12];
            const double volume = pliant_mesh_gradients(&fine, v / 4, gradients);
            sum[2 * fine.tets[v]] += volume * energy[v / 4];
            sum[2 * fine.tets[v] + 1] += volume;
        }
        for (int32_t n = 0; n < fine.num_nodes; n++)
            EXPECT_NEAR(of_node[n], sum[2 * n] / sum[2 * n + 1], 1e-5 * of_node[n]);
    }
}

// A cut half through between large and small leaves. The remaining hexahedra pass the patch test, no tetrahedron has a
// hanging node, and nodes that no longer hang start from their positions. It sags more than tetrahedra, and no more
// than the fine lattice with the same cut.
TEST(OctreeHexahedra, AreCut)
{
    const Plane plane{{0.0405, 0.04, 0.04}, {1, 0.1, 0.05}};
    double tip[3];
    for (int which = 0; which < 3; which++) { // fine lattice, octree, octree of tetrahedra
        Octree body(1);
        body.scene.cut.kind = PLIANT_CUT_SEVER;
        body.scene.model.gravity[0] = -1;
        body.scene.solver.tolerance = 1e-5;
        if (which == 0) {
            body.scene.mesh.kind = PLIANT_LATTICE;
            body.cells(8, 8, 8, 1);
        }
        if (which == 2) body.scene.element.kind = PLIANT_LINEAR;
        ASSERT_EQ(body.build(), PLIANT_OK) << pliant_last_error();
        // hanging nodes are at their interpolated positions, also after they become free
        ASSERT_GE(body.settle(), PLIANT_OK);
        const pliant_body *next = sever_plane(body.data->body, 2, plane, [](const double *x) { return x[2] > 0.03; });
        ASSERT_TRUE(next) << pliant_last_error();
        const std::vector<double> before(body.data->positions,
                                         body.data->positions + 3 * body.data->body->fine.num_nodes);
        ASSERT_EQ(pliant_data_set_body(body.model, body.data, next), PLIANT_OK) << pliant_last_error();
        pliant_body_release(next);
        const pliant_mesh &fine = body.data->body->fine;
        const pliant_system *system = body.data->discretization->system;
        if (which == 1) {
            const pliant_macros &macros = *system->macros;
            int tets = 0, hexahedra = 0, freed = 0;
            std::vector<bool> adjacent(static_cast<size_t>(fine.num_nodes));
            for (int32_t e = 0; e < macros.count; e++) {
                (macros.start[e + 1] - macros.start[e] == 8 ? hexahedra : tets)++;
                for (int32_t c = macros.start[e]; c < macros.start[e + 1]; c++) {
                    ASSERT_EQ(system->upsample->node[8 * macros.node[c]], macros.node[c]);
                    if (macros.start[e + 1] - macros.start[e] == 4) adjacent[macros.node[c]] = true;
                }
            }
            EXPECT_GT(tets, 50);
            EXPECT_GT(hexahedra, 50);
            for (size_t n = 0; n < before.size() / 3; n++) {
                if (body.model->system->free_of_node[n] >= 0 || system->free_of_node[n] < 0) continue;
                freed++;
                for (int d = 0; d < 3; d++) EXPECT_NEAR(body.data->solver->now.x[3 * n + d], before[3 * n + d], 1e-12);
            }
            EXPECT_GT(freed, 0);
            double a[9] = {1.02, 0.01, 0, 0.01, 0.97, 0.02, 0, 0.02, 1.01}, b[3] = {0.01, 0, 0}, inside = 0;
            std::vector<double> stretched = affine(fine, a, b), force(3 * static_cast<size_t>(system->num_free));
            std::vector<double> buffer(static_cast<size_t>(system->num_blocks) * 12 * LANES);
            pliant_system_element_forces(system, stretched.data(),
                                         reinterpret_cast<double(*)[12][LANES]>(buffer.data()));
            pliant_system_gather(system, reinterpret_cast<double (*)[12][LANES]>(buffer.data()), force.data());
            for (int32_t f = 0; f < system->num_free; f++) {
                const int32_t n = system->node_of_free[f];
                bool edge = adjacent[n]; // a tetrahedron distributes the forces of a face differently to its corners
                for (int d = 0; d < 3; d++)
                    edge = edge || fine.rest[3 * n + d] < 1e-9 || fine.rest[3 * n + d] > 0.08 - 1e-9;
                for (int d = 0; d < 3 && !edge; d++) inside = std::fmax(inside, std::fabs(force[3 * f + d]));
            }
            EXPECT_LT(inside, 1e-5 * largest(force));
        }
        ASSERT_EQ(body.settle(), PLIANT_OK) << body.data->statistics.residual;
        tip[which] = 0;
        for (int32_t n = 0; n < body.model->body->fine.num_nodes; n++)
            if (fine.rest[3 * n + 2] > 0.0799)
                tip[which] = std::fmax(tip[which], fine.rest[3 * n] - body.data->positions[3 * n]);
    }
    std::printf(
        "cut half through, largest way of the top: octree of hexahedra %.3f, "
        "of tetrahedra %.3f of the fine lattice's\n",
        tip[1] / tip[0], tip[2] / tip[0]);
    EXPECT_LT(tip[1], 1.02 * tip[0]);
    EXPECT_GT(tip[1], 1.05 * tip[2]);
}

// Explicit dynamics of an octree: leaves of every size have the forces of an affine displacement. The relaxed result is
// nearer to the fine lattice than tetrahedra.
TEST(OctreeHexahedra, AreExplicitToo)
{
    double tip[3];
    for (int which = 0; which < 3; which++) { // fine lattice, octree, octree of tetrahedra
        Octree body(1);
        body.scene.solver.kind = PLIANT_TLED;
        body.scene.tled.quasi_static = true;
        body.scene.tled.relaxation_steps = 600;
        body.scene.solver.tolerance = 1e-3;
        body.scene.model.gravity[0] = -0.5;
        if (which == 0) {
            body.scene.mesh.kind = PLIANT_LATTICE;
            body.cells(8, 8, 8, 1);
        }
        if (which == 2) body.scene.element.kind = PLIANT_LINEAR;
        ASSERT_EQ(body.build(), PLIANT_OK) << pliant_last_error();
        const pliant_mesh &fine = body.model->body->fine;
        const pliant_tled_system *system = body.model->tled;
        pliant_tled *tled = body.data->tled;
        if (which == 1) {
            std::vector<bool> adjacent(static_cast<size_t>(fine.num_nodes));
            int sizes[9] = {0};
            for (int32_t c = 0; c < system->cubes->count; c++) sizes[system->cubes->size[c]]++;
            for (int32_t t = 0; t < system->cubes->num_tets; t++)
                for (int v = 0; v < 4; v++) adjacent[fine.tets[4 * system->cubes->tet[t] + v]] = true;
            EXPECT_GT(sizes[1], 50);
            EXPECT_GT(sizes[2] + sizes[4], 5);
            const double a[9] = {0.02, 0.01, 0, 0.01, -0.03, 0.02, 0, 0.02, 0.01};
            for (int32_t n = 0; n < 3 * fine.num_nodes; n++)
                for (int d = 0; d < 3; d++) tled->u[n] += a[3 * (n % 3) + d] * fine.rest[n - n % 3 + d];
            pliant_tled_element_forces(tled, tled->time_step);
            double inside = 0, all = 0;
            for (int32_t n = 0; n < fine.num_nodes; n++) {
                double force[3] = {0, 0, 0};
                bool edge = adjacent[n];
                for (int32_t c = system->corner_start[n]; c < system->corner_start[n + 1]; c++)
                    for (int d = 0; d < 3; d++) force[d] += tled->forces[system->corner[c] + d * LANES];
                for (int d = 0; d < 3; d++)
                    edge = edge || fine.rest[3 * n + d] < 1e-9 || fine.rest[3 * n + d] > 0.08 - 1e-9;
                for (int d = 0; d < 3; d++) (edge ? all : inside) = std::fmax(edge ? all : inside, std::fabs(force[d]));
            }
            EXPECT_LT(inside, 1e-4 * all);
            pliant_tled_reset(tled);
        }
        ASSERT_EQ(body.settle(), PLIANT_OK) << body.data->statistics.residual;
        tip[which] = 0;
        for (int32_t n = 0; n < fine.num_nodes; n++)
            if (fine.rest[3 * n + 2] > 0.0799)
                tip[which] = std::fmax(tip[which], fine.rest[3 * n] - body.data->positions[3 * n]);
    }
    std::printf(
        "explicit, largest way of the top: octree of hexahedra %.3f, of tetrahedra %.3f of the fine lattice's\n",
        tip[1] / tip[0], tip[2] / tip[0]);
    EXPECT_LT(tip[1], 1.02 * tip[0]);
    EXPECT_GT(tip[1], 1.05 * tip[2]);
}

// A ball is a hundred times as stiff as the rest. The octree's displacement is near the displacement of a lattice with
// its smallest cell size, and nearer than an octree of tetrahedra.
TEST(OctreeHexahedra, FollowTheFineLattice)
{
    double sum[3], maximum = 0;
    std::map<int32_t, std::array<double, 3>> reference;
    for (int which = 0; which < 3; which++) { // fine lattice, octree, octree of tetrahedra
        Octree body(100);
        body.scene.model.gravity[1] = -0.5;
        body.scene.solver.tolerance = 1e-5;
        if (which == 0) {
            body.scene.mesh.kind = PLIANT_LATTICE;
            body.cells(8, 8, 8, 1);
        }
        if (which == 2) body.scene.element.kind = PLIANT_LINEAR;
        ASSERT_EQ(body.build(), PLIANT_OK) << pliant_last_error();
        ASSERT_EQ(body.settle(), PLIANT_OK) << body.data->statistics.residual;
        const pliant_mesh &fine = body.model->body->fine;
        sum[which] = 0;
        for (int32_t n = 0; n < fine.num_nodes; n++) {
            const double *x = body.data->positions + 3 * n;
            if (which == 0) {
                reference[fine.lattice_of_node[n]] = {{x[0], x[1], x[2]}};
                maximum = std::fmax(maximum, std::fabs(x[1] - fine.rest[3 * n + 1]));
                continue;
            }
            const std::array<double, 3> &at = reference[fine.lattice_of_node[n]];
            sum[which] += std::hypot(std::hypot(x[0] - at[0], x[1] - at[1]), x[2] - at[2]) / fine.num_nodes;
        }
    }
    std::printf(
        "mean error against the fine lattice of hexahedra, of the largest way: octree of hexahedra %.2f %%, "
        "of tetrahedra %.2f %%\n",
        100 * sum[1] / maximum, 100 * sum[2] / maximum);
    EXPECT_LT(sum[1], 0.05 * maximum);
    EXPECT_LT(sum[1], 0.5 * sum[2]);
}

// Return the positions of the fine nodes of a body of three materials, one a thin sheet, under its weight.
std::vector<double> sagged(pliant_element_kind kind, pliant_method method)
{
    const int size[3] = {16, 16, 16};
    const double box[3] = {0.08, 0.08, 0.08};
    Body body(size, box, {{3000, 0.45, 1000, false}, {30000, 0.45, 1000, false}, {30000, 0.3, 1000, false}},
              [](int i, int j, int k) {
                  double dx = i - 5.1, dy = j - 6, dz = k - 9.8;
                  if (dx * dx + dy * dy + dz * dz < 10) return 1;
                  return std::fabs(i - 8 + 0.3 * (k - 8)) < 0.6 && k > 2 && k < 14 && j > 2 && j < 13 ? 2 : 0;
              });
    body.scene.element.kind = kind;
    body.scene.model.method = method;
    body.scene.solver.tolerance = 1e-4;
    body.cells(4, 4, 4, 2);
    body.fix_plane(0, 0, 1e-4, 0, 0, 1);
    body.scene.model.gravity[1] = -2;
    EXPECT_EQ(body.build(), PLIANT_OK) << pliant_last_error();
    EXPECT_EQ(body.settle(), PLIANT_OK) << body.data->statistics.residual;
    const pliant_mesh &fine = body.model->body->fine;
    return std::vector<double>(body.data->positions, body.data->positions + 3 * fine.num_nodes);
}

double mean_error(const std::vector<double> &a, const std::vector<double> &b)
{
    double sum = 0;
    for (size_t n = 0; n < a.size(); n += 3)
        sum += std::hypot(std::hypot(a[n] - b[n], a[n + 1] - b[n + 1]), a[n + 2] - b[n + 2]);
    return sum / (a.size() / 3.0);
}

TEST(Hexahedra, CoarseOnesAreNearerToTheFineOnes)
{
    const std::vector<double> linear = sagged(PLIANT_LINEAR, PLIANT_FINE), fine = sagged(PLIANT_HEXAHEDRA, PLIANT_FINE);
    double tetrahedra = mean_error(sagged(PLIANT_LINEAR, PLIANT_AVERAGED), linear),
           averaged = mean_error(sagged(PLIANT_HEXAHEDRA, PLIANT_AVERAGED), fine);
    double coarse = mean_error(sagged(PLIANT_HEXAHEDRA, PLIANT_COARSE), fine);
    std::printf("mean error against the own fine mesh: tetrahedra averaged %.3f mm; hexahedra averaged %.3f, coarse "
                "%.3f mm\n",
                1e3 * tetrahedra, 1e3 * averaged, 1e3 * coarse);
    EXPECT_LT(averaged, 0.5 * tetrahedra);
    EXPECT_LT(averaged, 0.5 * coarse);
}

} // namespace
