// Explicit dynamics that goes on in the next body: momentum, energies and what has relaxed go over, the sub-step is found anew.
#include "fem/dynamics/tled.h"
#include "cuts.h"

#include <array>

namespace
{

// a bar along z that swings, viscous, its lower end fixed
struct Swinging : Body {
    explicit Swinging(const std::vector<Material> &materials = {{4000, 0.4, 1000, false}},
                      const std::function<int(int, int, int)> &material = [](int, int, int) { return 0; })
        : Body(std::array<int, 3>{8, 8, 24}.data(), std::array<double, 3>{0.04, 0.04, 0.12}.data(), materials, material)
    {
        cells(4, 4, 12, 1);
        fix_plane(0, 0, 1e-6, 0, 0, 1);
        scene.solver.kind = PLIANT_TLED;
        scene.solver.step = 0.005;
        scene.tled.damping = 1;
        scene.tled.prony_share[0] = 0.3;
        scene.tled.prony_time[0] = 0.05;
        scene.model.gravity[0] = 5;
    }
    void swing(int frames)
    {
        for (int f = 0; f < frames; f++) ASSERT_EQ(pliant_step(model, data), PLIANT_OK) << pliant_last_error();
    }
    void take(pliant_body *next)
    {
        ASSERT_EQ(pliant_data_set_body(model, data, next), PLIANT_OK) << pliant_last_error();
        pliant_body_release(next);
    }
    pliant_dynamics dynamics() const
    {
        pliant_dynamics told;
        EXPECT_EQ(pliant_data_get_dynamics(model, data, &told), PLIANT_OK);
        return told;
    }
    std::array<double, 3> momentum() const
    {
        std::array<double, 3> out{};
        const pliant_tled &tled = *data->tled;
        for (int32_t n = 0; n < 3 * data->body->fine.num_nodes; n++)
            out[n % 3] += data->body->node_mass[n / 3] * tled.d[n] / tled.time_step;
        return out;
    }
    std::vector<double> densities() const // of fragments together, by tetrahedron at load
    {
        const pliant_body &body = *data->body;
        std::vector<double> out(static_cast<size_t>(model->body->fine.num_tets));
        for (int32_t t = 0; t < body.fine.num_tets; t++) out[body.tet_parent ? body.tet_parent[t] : t] += body.fine_material[t].density;
        return out;
    }
    double relaxed() const // a sum over all elements of what has
    {
        double sum = 0;
        for (int32_t t = 0; t < data->body->fine.num_tets; t++)
            for (int m = 0; m < 6 * PLIANT_PRONY_TERMS; m++) sum += std::fabs(data->tled->memory[t / LANES][m][t % LANES]);
        return sum;
    }
};

void expect_same(const std::array<double, 3> &a, const std::array<double, 3> &b)
{
    const double size = std::hypot(std::hypot(a[0], a[1]), a[2]);
    ASSERT_GT(size, 0);
    for (int d = 0; d < 3; d++) EXPECT_NEAR(a[d], b[d], 1e-12 * size);
}

// from one side, half-way through: copies of nodes share the mass of their elements
TEST(TledCarry, ASlitTakesNoMomentumAndNoEnergy)
{
    Swinging bar;
    ASSERT_EQ(bar.build(), PLIANT_OK) << pliant_last_error();
    bar.swing(10);
    const pliant_body *body = bar.data->body;
    const pliant_mesh &mesh = body->fine;
    std::vector<int32_t> corners(mesh.tets, mesh.tets + 4 * mesh.num_tets), copy(static_cast<size_t>(mesh.num_nodes), -1);
    int32_t nodes = mesh.num_nodes;
    for (int32_t t = 0; t < mesh.num_tets; t++) {
        double height = 0;
        for (int v = 0; v < 4; v++) height += mesh.rest[3 * mesh.tets[4 * t + v] + 2] / 4;
        for (int v = 0; v < 4 && height > 0.06; v++) {
            const double *at = mesh.rest + 3 * mesh.tets[4 * t + v];
            if (std::fabs(at[2] - 0.06) > 1e-6 || at[0] > 0.015) continue;
            int32_t &other = copy[static_cast<size_t>(mesh.tets[4 * t + v])];
            if (other < 0) other = nodes++;
            corners[4 * t + v] = other;
        }
    }
    ASSERT_GT(nodes, mesh.num_nodes + 5);
    const pliant_dynamics before = bar.dynamics();
    const auto momentum = bar.momentum();
    const double relaxed = bar.relaxed();
    ASSERT_GT(relaxed, 0);
    pliant_division division{};
    division.num_tets = mesh.num_tets;
    division.corners = corners.data();
    pliant_body *next = nullptr;
    ASSERT_EQ(pliant_body_divide(body, bar.data->last_revision + 1, &division, &next), PLIANT_OK) << pliant_last_error();
    bar.take(next);
    ASSERT_EQ(bar.data->body->fine.num_nodes, nodes);
    const pliant_dynamics after = bar.dynamics();
    expect_same(momentum, bar.momentum());
    EXPECT_NEAR(after.kinetic_energy, before.kinetic_energy, 1e-12 * before.kinetic_energy);
    EXPECT_NEAR(after.strain_energy, before.strain_energy, 1e-12 * before.strain_energy);
    EXPECT_EQ(bar.relaxed(), relaxed);
    EXPECT_EQ(after.substeps, before.substeps);
    bar.swing(20);
}

// elements of sixteen times the modulus carry sound four times as fast
TEST(TledCarry, TheSubStepFollowsTheBody)
{
    Swinging bar;
    ASSERT_EQ(bar.build(), PLIANT_OK) << pliant_last_error();
    bar.swing(10);
    const pliant_dynamics before = bar.dynamics();
    const auto momentum = bar.momentum();
    pliant_body *next = nullptr;
    ASSERT_EQ(pliant_body_next(bar.data->body, bar.data->last_revision + 1, &next), PLIANT_OK);
    for (int32_t t = 0; t < next->fine.num_tets; t++) {
        next->fine_material[t].lambda *= 16;
        next->fine_material[t].mu *= 16;
    }
    bar.take(next);
    const pliant_dynamics after = bar.dynamics();
    EXPECT_NEAR(after.eigenvalue_bound, before.eigenvalue_bound / 4, 1e-3 * before.eigenvalue_bound);
    EXPECT_LE(after.time_step, 0.9 * std::fmin(after.edge_bound, after.eigenvalue_bound) * (1 + 1e-9));
    EXPECT_GT(after.substeps, 3 * before.substeps);
    expect_same(momentum, bar.momentum());
    EXPECT_NEAR(after.kinetic_energy, before.kinetic_energy, 1e-12 * before.kinetic_energy);
    bar.swing(40);

    // and back
    ASSERT_EQ(pliant_data_reset(bar.model, bar.data), PLIANT_OK) << pliant_last_error();
    EXPECT_EQ(bar.dynamics().substeps, before.substeps);
    bar.swing(5);
}

// a sub-step that was found too long for what moves stays halved, whatever body comes
TEST(TledCarry, WhatWasHalvedStaysSo)
{
    Swinging bar;
    ASSERT_EQ(bar.build(), PLIANT_OK) << pliant_last_error();
    const int32_t substeps = bar.data->tled->substeps;
    const double swift[3] = {3e2, 0, 0};
    ASSERT_EQ(pliant_data_set_gravity(bar.data, swift), PLIANT_OK);
    for (int f = 0; f < 20 && bar.data->tled->halvings == 0; f++) pliant_step(bar.model, bar.data);
    const int32_t halvings = bar.data->tled->halvings;
    ASSERT_GT(halvings, 0);
    pliant_body *next = nullptr;
    ASSERT_EQ(pliant_body_next(bar.data->body, bar.data->last_revision + 1, &next), PLIANT_OK);
    next->fine_material[0].mu *= 0.999;
    const auto momentum = bar.momentum();
    bar.take(next);
    EXPECT_EQ(bar.data->tled->halvings, halvings);
    EXPECT_EQ(bar.data->tled->substeps, substeps << halvings);
    EXPECT_NEAR(bar.data->tled->time_step * bar.data->tled->substeps, bar.scene.solver.step, 1e-12);
    expect_same(momentum, bar.momentum());
}

// blades through elements of two tissues, one 40 times as stiff for its mass, at random: fragments share mass, moduli and what has relaxed of their
// tetrahedra; the sub-step was found for all of them
struct EveryLaw : testing::TestWithParam<pliant_law> {};
TEST_P(EveryLaw, FragmentsTakeNoMomentumNoEnergyAndNoSubSteps)
{
    Swinging bar({{4000, 0.4, 1000, false}, {120000, 0.4, 750, false}}, [](int i, int j, int k) { return (i + j + k / 2) % 3 == 0; });
    bar.cells(2, 2, 6, 1);
    bar.scene.cut.kind = PLIANT_CUT_SEVER;
    bar.scene.tled.law = GetParam();
    ASSERT_EQ(bar.build(), PLIANT_OK) << pliant_last_error();
    bar.swing(20);
    const pliant_dynamics start = bar.dynamics();
    std::mt19937 random(3);
    std::uniform_real_distribution<double> unit(-1, 1);
    int taken = 0, without_chips = 0;
    double least = INFINITY;
    for (int stroke = 0; stroke < 15; stroke++) {
        const double normal[3] = {unit(random), unit(random), 1}, point[3] = {0.02 + 0.02 * unit(random), 0.02 + 0.02 * unit(random), 0.07 + 0.04 * unit(random)};
        std::vector<double> from, to;
        Cuttable::plane(point, normal, 0.012, from, to);
        const pliant_cut_sweep sweep{2, from.data(), to.data(), nullptr};
        pliant_body *next = nullptr;
        ASSERT_EQ(pliant_body_cut(bar.data->body, bar.data->last_revision + 1, bar.data->positions, &sweep, &next, nullptr), PLIANT_OK) << pliant_last_error();
        if (!next) continue;
        const bool more = next->fine.num_tets > bar.data->body->fine.num_tets;
        taken += more;
        const pliant_dynamics before = bar.dynamics();
        const auto momentum = bar.momentum();
        const double relaxed = bar.relaxed();
        const std::vector<double> densities = bar.densities();
        bar.take(next);
        const pliant_dynamics after = bar.dynamics();
        double given = 0; // by chips, which move as another tetrahedron does from now on
        for (size_t t = 0; t < densities.size(); t++) given = std::fmax(given, std::fabs(bar.densities()[t] - densities[t]));
        if (given < 1e-6) {
            expect_same(momentum, bar.momentum());
            EXPECT_NEAR(after.kinetic_energy, before.kinetic_energy, 1e-12 * before.kinetic_energy);
            EXPECT_NEAR(after.strain_energy, before.strain_energy, 1e-9 * before.strain_energy);
            EXPECT_NEAR(bar.relaxed(), relaxed, 1e-5 * relaxed);
            without_chips += more;
        }
        EXPECT_EQ(after.substeps, start.substeps);
        EXPECT_EQ(after.eigenvalue_bound, start.eigenvalue_bound);
        EXPECT_EQ(after.edge_bound, start.edge_bound);
        // what its elements themselves allow
        pliant_body alone = *bar.data->body;
        alone.voxels = nullptr;
        pliant_tled_system own = *bar.data->tled->system;
        ASSERT_EQ(pliant_tled_find_bounds(&alone, &own), PLIANT_OK);
        EXPECT_GE(own.eigenvalue_bound, start.eigenvalue_bound * (1 - 1e-12));
        EXPECT_GE(own.edge_bound, start.edge_bound * (1 - 1e-12));
        least = std::fmin(least, own.eigenvalue_bound);
        bar.swing(2);
    }
    EXPECT_GT(taken, 5);
    EXPECT_GT(without_chips, 3);
    pliant_body load = *bar.model->body; // of whole elements alone it would have been longer than what came
    load.voxels = nullptr;
    pliant_tled_system whole = *bar.model->tled;
    ASSERT_EQ(pliant_tled_find_bounds(&load, &whole), PLIANT_OK);
    EXPECT_LT(least, whole.eigenvalue_bound);
}
INSTANTIATE_TEST_SUITE_P(Laws, EveryLaw, testing::Values(PLIANT_LAW_NEO_HOOKEAN, PLIANT_LAW_COMPRESSIBLE, PLIANT_LAW_SAINT_VENANT_KIRCHHOFF));

} // namespace
