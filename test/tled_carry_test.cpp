// Explicit dynamics continues with the next body: momentum, energies and relaxed stress are kept, the sub-step is
// recomputed.
#include "fem/dynamics/tled_cubes.h"
#include "backend/explicit_statistics.h"
#include "cuts.h"
#include "sim/api/data.h"

#include <array>

namespace
{

// A viscous, swinging bar along z with a fixed lower end.
struct Swinging : Body {
    explicit Swinging(
        const std::vector<Material> &materials = {{4000, 0.4, 1000, false}},
        const std::function<int(int, int, int)> &material = [](int, int, int) { return 0; }, double width = 0.04,
        int voxels = 8)
        : Body(std::array<int, 3>{voxels, voxels, 3 * voxels}.data(),
               std::array<double, 3>{width, width, 3 * width}.data(), materials, material),
          box{width, width, 3 * width}
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
        pliant_dynamics reported;
        EXPECT_EQ(pliant_data_get_dynamics(model, data, &reported), PLIANT_OK);
        return reported;
    }
    // Return the momentum, and the angular momentum about the origin.
    std::array<double, 6> momentum() const
    {
        std::array<double, 6> out{};
        const pliant_tled &tled = *data->tled;
        for (int32_t n = 0; n < tled.system->mesh->num_nodes; n++) {
            const double *rest = tled.system->mesh->rest + 3 * n, *u = tled.u + 3 * n, *moved = tled.d + 3 * n,
                         mass = tled.system->node_mass[n] / tled.time_step;
            for (int d = 0; d < 3; d++) {
                const int y = (d + 1) % 3, z = (d + 2) % 3;
                out[d] += mass * moved[d];
                out[3 + d] += mass * ((rest[y] + u[y]) * moved[z] - (rest[z] + u[z]) * moved[y]);
            }
        }
        return out;
    }
    std::vector<double> densities() const // sums over the fragments of each tetrahedron at load
    {
        const pliant_body &body = *data->body;
        std::vector<double> out(static_cast<size_t>(model->body->fine.num_tets));
        for (int32_t t = 0; t < body.fine.num_tets; t++)
            out[body.tet_parent ? body.tet_parent[t] : t] += body.fine_material[t].density;
        return out;
    }
    // Return the kinetic energy of another mesh whose nodes move with the current elements.
    double kinetic_energy_in(const pliant_body &next) const
    {
        const pliant_tled &tled = *data->tled;
        std::vector<double> velocities(3 * static_cast<size_t>(next.fine.num_nodes));
        pliant_body_map map{};
        EXPECT_EQ(pliant_body_map_create(data->body, &next, &map), PLIANT_OK) << pliant_last_error();
        pliant_body_map_vectors(&map, tled.d, velocities.data());
        pliant_body_map_free(&map);
        double sum = 0;
        for (size_t i = 0; i < velocities.size(); i++)
            sum += 0.5 * next.node_mass[i / 3] * std::pow(velocities[i] / tled.time_step, 2);
        return sum;
    }
    double relaxed() const // sum of the relaxed stress over all elements
    {
        const pliant_tled_system &system = *data->tled->system;
        const int32_t cubes = system.cubes ? system.cubes->count : 0,
                      tets = system.cubes ? system.cubes->num_tets : system.mesh->num_tets;
        double sum = 0;
        for (int32_t e = 0; e < tets + cubes; e++) {
            const int32_t place = e < tets ? e : system.num_blocks * LANES + e - tets;
            for (int m = 0; m < 6 * PLIANT_PRONY_TERMS; m++)
                sum += std::fabs(data->tled->memory[place / LANES][m][place % LANES]);
        }
        return sum;
    }
    // Cut with a random blade stroke of this half width. Return false if nothing was severed.
    bool stroke(std::mt19937 &random, double half, pliant_body **next) const
    {
        std::uniform_real_distribution<double> unit(-1, 1);
        const double normal[3] = {unit(random), unit(random), 1};
        const double point[3] = {box[0] * (0.5 + 0.5 * unit(random)), box[1] * (0.5 + 0.5 * unit(random)),
                                 box[2] * (0.55 + 0.35 * unit(random))};
        std::vector<double> from, to;
        CutState::plane(point, normal, half, from, to);
        const pliant_cut_sweep sweep{2, from.data(), to.data(), nullptr};
        EXPECT_EQ(pliant_body_cut(data->body, data->last_revision + 1, data->positions, &sweep, next, nullptr),
                  PLIANT_OK)
            << pliant_last_error();
        return *next != nullptr;
    }
    const std::array<double, 3> box;
};

void expect_same(const std::array<double, 6> &a, const std::array<double, 6> &b)
{
    for (int about = 0; about < 6; about += 3) {
        const double size = std::hypot(std::hypot(a[about], a[about + 1]), a[about + 2]);
        ASSERT_GT(size, 0);
        for (int d = about; d < about + 3; d++) EXPECT_NEAR(a[d], b[d], 1e-12 * size);
    }
}

// A slit from one side to the middle. Copied nodes share the mass of their elements.
TEST(TledCarry, ASlitTakesNoMomentumAndNoEnergy)
{
    Swinging bar;
    ASSERT_EQ(bar.build(), PLIANT_OK) << pliant_last_error();
    bar.swing(10);
    const pliant_body *body = bar.data->body;
    const pliant_mesh &mesh = body->fine;
    std::vector<int32_t> corners(mesh.tets, mesh.tets + 4 * mesh.num_tets),
        copy(static_cast<size_t>(mesh.num_nodes), -1);
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
    ASSERT_EQ(pliant_body_divide(body, bar.data->last_revision + 1, &division, &next), PLIANT_OK)
        << pliant_last_error();
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

// Halvings of an unstable sub-step are kept for the next body.
TEST(TledCarry, HalvedSubStepsStayHalved)
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

// Random blades through elements of two tissues, one 40 times as stiff per mass. Fragments share the mass, the moduli
// and the relaxed stress of their tetrahedra. The sub-step was chosen for all fragments.
struct EveryLaw : testing::TestWithParam<pliant_law> {};
TEST_P(EveryLaw, FragmentsTakeNoMomentumNoEnergyAndNoSubSteps)
{
    Swinging bar({{4000, 0.4, 1000, false}, {120000, 0.4, 750, false}},
                 [](int i, int j, int k) { return (i + j + k / 2) % 3 == 0; });
    bar.cells(2, 2, 6, 1);
    bar.scene.cut.kind = PLIANT_CUT_SEVER;
    bar.scene.tled.law = GetParam();
    ASSERT_EQ(bar.build(), PLIANT_OK) << pliant_last_error();
    bar.swing(20);
    const pliant_dynamics start = bar.dynamics();
    std::mt19937 random(3);
    int taken = 0, without_chips = 0;
    double minimum = INFINITY;
    for (int stroke = 0; stroke < 15; stroke++) {
        pliant_body *next = nullptr;
        if (!bar.stroke(random, 0.012, &next)) continue;
        const bool more = next->fine.num_tets > bar.data->body->fine.num_tets;
        taken += more;
        const pliant_dynamics before = bar.dynamics();
        const auto momentum = bar.momentum();
        const double relaxed = bar.relaxed();
        const std::vector<double> densities = bar.densities();
        bar.take(next);
        const pliant_dynamics after = bar.dynamics();
        expect_same(momentum, bar.momentum());
        EXPECT_LE(after.strain_energy + after.kinetic_energy,
                  (before.strain_energy + before.kinetic_energy) * (1 + 1e-9));
        double given = 0; // mass moved to other tetrahedra by chips
        for (size_t t = 0; t < densities.size(); t++)
            given = std::fmax(given, std::fabs(bar.densities()[t] - densities[t]));
        if (given < 1e-6) {
            EXPECT_NEAR(after.kinetic_energy, before.kinetic_energy, 1e-12 * before.kinetic_energy);
            EXPECT_NEAR(after.strain_energy, before.strain_energy, 1e-9 * before.strain_energy);
            EXPECT_NEAR(bar.relaxed(), relaxed, 1e-5 * relaxed);
            without_chips += more;
        }
        EXPECT_EQ(after.substeps, start.substeps);
        EXPECT_EQ(after.eigenvalue_bound, start.eigenvalue_bound);
        EXPECT_EQ(after.edge_bound, start.edge_bound);
        // the bound of the current elements alone
        pliant_body alone = *bar.data->body;
        alone.voxels = nullptr;
        pliant_tled_system own = *bar.data->tled->system;
        ASSERT_EQ(pliant_tled_find_bounds(&alone, &own), PLIANT_OK);
        EXPECT_GE(own.eigenvalue_bound, start.eigenvalue_bound * (1 - 1e-12));
        EXPECT_GE(own.edge_bound, start.edge_bound * (1 - 1e-12));
        minimum = std::fmin(minimum, own.eigenvalue_bound);
        bar.swing(2);
    }
    EXPECT_GT(taken, 5);
    EXPECT_GT(without_chips, 3);
    // the bound of the whole elements alone would be longer than the bound of the fragments
    pliant_body load = *bar.model->body;
    load.voxels = nullptr;
    pliant_tled_system whole = *bar.model->tled;
    ASSERT_EQ(pliant_tled_find_bounds(&load, &whole), PLIANT_OK);
    EXPECT_LT(minimum, whole.eigenvalue_bound);
}

// The same blades with subdivision. New nodes move with their edges, and smaller tetrahedra inherit the relaxed stress.
TEST_P(EveryLaw, SmallerTetrahedraTakeNoMomentumAndGiveNoEnergy)
{
    Swinging bar({{4000, 0.4, 1000, false}, {120000, 0.4, 750, false}},
                 [](int i, int j, int k) { return (i + j + k / 2) % 3 == 0; });
    bar.cells(2, 2, 6, 1);
    bar.scene.cut.kind = PLIANT_CUT_SUBDIVIDE;
    bar.scene.tled.law = GetParam();
    ASSERT_EQ(bar.build(), PLIANT_OK) << pliant_last_error();
    bar.swing(20);
    std::mt19937 random(3);
    int taken = 0;
    for (int stroke = 0; stroke < 12; stroke++) {
        pliant_body *next = nullptr;
        if (!bar.stroke(random, 0.012, &next)) continue;
        taken += next->fine.num_tets > bar.data->body->fine.num_tets;
        const pliant_dynamics before = bar.dynamics();
        const auto momentum = bar.momentum();
        ASSERT_GT(bar.relaxed(), 0);
        const double mass = total_mass(*bar.data->body), inherited = bar.kinetic_energy_in(*next);
        bar.take(next);
        const pliant_dynamics after = bar.dynamics();
        expect_same(momentum, bar.momentum());
        EXPECT_NEAR(total_mass(*bar.data->body), mass, 1e-12 * mass);
        EXPECT_LE(after.strain_energy + after.kinetic_energy,
                  (before.strain_energy + before.kinetic_energy) * (1 + 1e-9))
            << "stroke " << stroke;
        // New nodes take mass from both ends of their edges and move with the edges, which lowers kinetic energy and
        // inertia. Strain energy pays for the angular momentum that stays. The rotation that restores it takes less
        // energy than the lost inertia.
        EXPECT_GE(after.strain_energy + after.kinetic_energy,
                  before.strain_energy + before.kinetic_energy - 2 * (before.kinetic_energy - inherited) -
                      1e-9 * before.strain_energy)
            << "stroke " << stroke;
        EXPECT_GE(after.kinetic_energy, 0.97 * before.kinetic_energy) << "stroke " << stroke;
        EXPECT_LE(after.time_step, after.eigenvalue_bound);
        bar.swing(2);
    }
    EXPECT_GT(taken, 5);
}
INSTANTIATE_TEST_SUITE_P(Laws, EveryLaw,
                         testing::Values(PLIANT_LAW_NEO_HOOKEAN, PLIANT_LAW_COMPRESSIBLE,
                                         PLIANT_LAW_SAINT_VENANT_KIRCHHOFF));

// A cut takes at most this part of the kinetic energy.
const double largest_loss = 1e-3;

// A blade's strokes through a swinging bar of two tissues. Some hexahedra become tetrahedra, which are stiffer and have
// their mass elsewhere.
struct Strokes : testing::TestWithParam<std::tuple<pliant_element_kind, int, double>> {};
TEST_P(Strokes, TakeNoMomentumAndGiveNoEnergy)
{
    const pliant_element_kind kind = std::get<0>(GetParam());
    const int cells = std::get<1>(GetParam());
    Swinging bar(
        {{4000, 0.45, 1000, false}, {20000, 0.45, 1100, false}},
        [](int i, int j, int k) { return (i / 4 + j / 4 + k / 4) % 3 == 0; }, 0.08, 16);
    bar.cells(cells, cells, 3 * cells, 1);
    bar.scene.element.kind = kind;
    bar.scene.cut.kind = PLIANT_CUT_SEVER;
    bar.scene.tled.prony_share[0] = std::get<2>(GetParam());
    ASSERT_EQ(bar.build(), PLIANT_OK) << pliant_last_error();
    bar.swing(20);
    const pliant_dynamics start = bar.dynamics();
    std::mt19937 random(3);
    int taken = 0;
    for (int stroke = 0; stroke < 12; stroke++) {
        pliant_body *next = nullptr;
        if (!bar.stroke(random, 0.024, &next)) continue;
        taken += next->fine.num_tets > bar.data->body->fine.num_tets;
        const pliant_dynamics before = bar.dynamics();
        const auto momentum = bar.momentum();
        bar.take(next);
        const pliant_dynamics after = bar.dynamics();
        expect_same(momentum, bar.momentum());
        EXPECT_LE(after.strain_energy + after.kinetic_energy,
                  (before.strain_energy + before.kinetic_energy) * (1 + 1e-9))
            << "stroke " << stroke;
        EXPECT_LE(after.strain_energy, before.strain_energy * (kind == PLIANT_LINEAR ? 1.0005 : 1.002))
            << "stroke " << stroke;
        EXPECT_GE(after.kinetic_energy, (1 - largest_loss) * before.kinetic_energy) << "stroke " << stroke;
        EXPECT_EQ(after.substeps, start.substeps);
        pliant_body alone = *bar.data->body; // the bound of the current elements alone
        alone.voxels = nullptr;
        pliant_tled_system own = *bar.data->tled->system;
        ASSERT_EQ(pliant_tled_find_bounds(&alone, &own), PLIANT_OK);
        EXPECT_GE(own.eigenvalue_bound, start.eigenvalue_bound * (1 - 1e-12));
        EXPECT_GE(own.edge_bound, start.edge_bound * (1 - 1e-12));
        bar.swing(2);
    }
    EXPECT_GT(taken, 5);
    const pliant_tled_cubes *cubes = bar.data->tled->system->cubes;
    int parts = 0;
    for (int32_t c = 0; cubes && c < cubes->count; c++) parts += cubes->cube[c].part;
    EXPECT_EQ(parts > 3, kind == PLIANT_HEXAHEDRA);
}
INSTANTIATE_TEST_SUITE_P(Meshes, Strokes,
                         testing::Combine(testing::Values(PLIANT_LINEAR, PLIANT_HEXAHEDRA), testing::Values(4, 8),
                                          testing::Values(0.0, 0.3)));

// A swinging bar of two tissues, whose upper half is cut off into two pieces that fall.
struct Pieces : Swinging {
    static constexpr double lower = 0.125, upper = 0.185;
    explicit Pieces(pliant_element_kind kind, int cells_across = 4)
        : Swinging(
              {{4000, 0.45, 1000, false}, {20000, 0.45, 1100, false}},
              [](int i, int j, int k) { return (i / 4 + j / 4 + k / 4) % 3 == 0; }, 0.08, 16)
    {
        cells(cells_across, cells_across, 3 * cells_across, 1);
        scene.element.kind = kind;
        scene.cut.kind = PLIANT_CUT_SEVER;
    }
    void begin()
    {
        ASSERT_EQ(build(), PLIANT_OK) << pliant_last_error();
        swing(10);
        for (double height : {lower, upper}) {
            const double point[3] = {0.04, 0.04, height}, normal[3] = {0.1, 0, 1};
            std::vector<double> from, to;
            CutState::plane(point, normal, 1, from, to);
            const pliant_cut_sweep sweep{2, from.data(), to.data(), nullptr};
            pliant_body *next = nullptr;
            ASSERT_EQ(pliant_body_cut(data->body, data->last_revision + 1, data->positions, &sweep, &next, nullptr),
                      PLIANT_OK)
                << pliant_last_error();
            ASSERT_TRUE(next);
            take(next);
        }
        ASSERT_EQ(data->body->pieces->count, 2);
        swing(4);
    }
    // (nodes) a number for each connected component
    std::vector<int32_t> components() const
    {
        const pliant_mesh &mesh = data->body->fine;
        std::vector<int32_t> part(static_cast<size_t>(mesh.num_nodes));
        std::iota(part.begin(), part.end(), 0);
        const auto first = [&](int32_t n) {
            while (part[n] != n) n = part[n] = part[part[n]];
            return n;
        };
        for (int32_t v = 0; v < 4 * mesh.num_tets; v++) part[first(mesh.tets[v])] = first(mesh.tets[v / 4 * 4]);
        for (int32_t n = 0; n < mesh.num_nodes; n++) part[n] = first(n);
        return part;
    }
    // Return for each component: the momentum, the angular momentum about the origin, and the sums of the terms' sizes.
    std::map<int32_t, std::array<double, 8>> momenta(const std::vector<int32_t> &component) const
    {
        std::map<int32_t, std::array<double, 8>> out;
        const pliant_tled &tled = *data->tled;
        for (int32_t n = 0; n < tled.system->mesh->num_nodes; n++) {
            if (tled.inverse_mass[n] == 0) continue;
            std::array<double, 8> &sum = out[component[n]];
            const double *rest = tled.system->mesh->rest + 3 * n, *u = tled.u + 3 * n, *moved = tled.d + 3 * n,
                         mass = tled.system->node_mass[n] / tled.time_step;
            double x[3], speed = std::hypot(std::hypot(moved[0], moved[1]), moved[2]);
            for (int d = 0; d < 3; d++) x[d] = rest[d] + u[d];
            for (int d = 0; d < 3; d++) {
                sum[d] += mass * moved[d];
                sum[3 + d] += mass * (x[(d + 1) % 3] * moved[(d + 2) % 3] - x[(d + 2) % 3] * moved[(d + 1) % 3]);
            }
            sum[6] += mass * speed;
            sum[7] += mass * speed * std::hypot(std::hypot(x[0], x[1]), x[2]);
        }
        return out;
    }
};
constexpr double Pieces::lower, Pieces::upper;

TEST(TledCarry, EveryComponentKeepsItsMomentum)
{
    for (pliant_element_kind kind : {PLIANT_LINEAR, PLIANT_HEXAHEDRA}) {
        Pieces bar(kind);
        bar.begin();
        std::mt19937 random(5);
        int touched = 0;
        for (int stroke = 0; stroke < 15; stroke++) {
            pliant_body *next = nullptr;
            if (!bar.stroke(random, 0.03, &next)) continue;
            std::vector<int32_t> component = bar.components();
            const auto before = bar.momenta(component);
            const int32_t nodes = bar.data->body->fine.num_nodes;
            const pliant_dynamics was = bar.dynamics();
            bar.take(next);
            for (int32_t n = nodes; n < next->fine.num_nodes; n++)
                component.push_back(component[static_cast<size_t>(next->changes.node_source[n - nodes])]);
            touched += next->fine.num_nodes > nodes;
            const auto after = bar.momenta(component);
            ASSERT_GE(before.size(), 3u);
            for (const auto &each : before)
                for (int d = 0; d < 6; d++)
                    EXPECT_NEAR(after.at(each.first)[d], each.second[d], 1e-12 * each.second[6 + d / 3])
                        << "stroke " << stroke << ", " << d;
            const pliant_dynamics is = bar.dynamics();
            EXPECT_LE(is.strain_energy + is.kinetic_energy, (was.strain_energy + was.kinetic_energy) * (1 + 1e-9))
                << "stroke " << stroke;
            EXPECT_GE(is.kinetic_energy, (1 - largest_loss) * was.kinetic_energy) << "stroke " << stroke;
            bar.swing(2);
        }
        EXPECT_GT(touched, 8);
    }
}

// Ten cuts below falling pieces: the pieces' state is bitwise identical to the state without cuts.
TEST(TledCarry, CutsElsewhereLeaveAFallingPieceAsItIs)
{
    for (pliant_element_kind kind : {PLIANT_LINEAR, PLIANT_HEXAHEDRA}) {
        Pieces bar(kind), other(kind);
        bar.begin();
        other.begin();
        const pliant_mesh &mesh = other.data->body->fine;
        std::vector<int32_t> piece;
        const pliant_pieces &pieces = *other.data->body->pieces;
        for (int32_t i = 0; i < pieces.start[pieces.count]; i++) piece.push_back(pieces.node[i]);
        ASSERT_GT(static_cast<int>(piece.size()), mesh.num_nodes / 4);
        std::mt19937 random(4);
        std::uniform_real_distribution<double> unit(-1, 1);
        int taken = 0;
        for (int stroke = 0; stroke < 10; stroke++) {
            const double point[3] = {0.04 + 0.04 * unit(random), 0.04 + 0.04 * unit(random),
                                     0.05 + 0.03 * unit(random)},
                         normal[3] = {unit(random), unit(random), 1};
            std::vector<double> from, to;
            CutState::plane(point, normal, 0.03, from, to);
            const pliant_cut_sweep sweep{2, from.data(), to.data(), nullptr};
            pliant_body *next = nullptr;
            ASSERT_EQ(pliant_body_cut(bar.data->body, bar.data->last_revision + 1, bar.data->positions, &sweep, &next,
                                      nullptr),
                      PLIANT_OK)
                << pliant_last_error();
            if (!next) continue;
            taken++;
            bar.take(next);
            bar.swing(2);
            other.swing(2);
            for (int32_t n : piece)
                for (int d = 0; d < 3; d++) {
                    ASSERT_EQ(bar.data->tled->u[3 * n + d], other.data->tled->u[3 * n + d])
                        << "stroke " << stroke << ", node " << n;
                    ASSERT_EQ(bar.data->tled->d[3 * n + d], other.data->tled->d[3 * n + d])
                        << "stroke " << stroke << ", node " << n;
                }
        }
        EXPECT_GT(taken, 6);
    }
}

// Without motion there is no kinetic energy to take.
TEST(TledCarry, ABodyAtRestGainsNoEnergy)
{
    for (int cells : {4, 8}) {
        Pieces bar(PLIANT_HEXAHEDRA, cells);
        ASSERT_EQ(bar.build(), PLIANT_OK) << pliant_last_error();
        bar.swing(20);
        std::mt19937 random(3);
        int taken = 0;
        for (int stroke = 0; stroke < 12; stroke++) {
            pliant_body *next = nullptr;
            if (!bar.stroke(random, 0.024, &next)) continue;
            pliant_tled_stop_motion(bar.data->tled);
            const double before = bar.dynamics().strain_energy;
            const int32_t nodes = bar.data->body->fine.num_nodes;
            const std::vector<double> u(bar.data->tled->u, bar.data->tled->u + 3 * nodes);
            bar.take(next);
            EXPECT_EQ(bar.dynamics().kinetic_energy, 0);
            EXPECT_LE(bar.dynamics().strain_energy, before * (1 + 1e-9)) << "stroke " << stroke;
            double farthest = 0;
            for (int32_t n = 0; n < 3 * nodes; n++)
                farthest = std::fmax(farthest, std::fabs(bar.data->tled->u[n] - u[static_cast<size_t>(n)]));
            EXPECT_LT(farthest, 0.1 * 0.08 / cells) << "stroke " << stroke;
            taken++;
            bar.swing(10);
        }
        EXPECT_GT(taken, 5);
    }
}

} // namespace
