// Tests of cuts of a body: the severed links and the next body.
#include "severed_bar.h"
#include "cut/cut_stages.h"
#include "mesh/mesh.h"

#include <array>

namespace {

// Check that the fragments of each tetrahedron sum to its stiffness and density. Chips count by volume for the
// tetrahedron that carries them.
void expect_shares(const pliant_body &load, const pliant_body &now)
{
    std::vector<double> lambda(static_cast<size_t>(load.fine.num_tets)), mu(lambda.size()), density(lambda.size());
    std::set<int32_t> with_chips;
    for (int32_t c = 0; c < now.cuts->num_chips; c++) {
        const int32_t tet = now.cuts->chip[2 * c + 1];
        with_chips.insert(now.cuts->chip[2 * c]);
        with_chips.insert(now.tet_parent ? now.tet_parent[tet] : tet);
    }
    for (int32_t t = 0; t < now.fine.num_tets; t++) {
        const int32_t parent = now.tet_parent ? now.tet_parent[t] : t;
        lambda[parent] += now.fine_material[t].lambda;
        mu[parent] += now.fine_material[t].mu;
        density[parent] += now.fine_material[t].density;
        EXPECT_GE(now.fine_material[t].mu, 0);
    }
    for (int32_t t = 0; t < load.fine.num_tets; t++) {
        if (with_chips.count(t)) continue;
        EXPECT_NEAR(lambda[t], load.fine_material[t].lambda, 1e-12 * load.fine_material[t].lambda);
        EXPECT_NEAR(mu[t], load.fine_material[t].mu, 1e-12 * load.fine_material[t].mu);
        EXPECT_NEAR(density[t], load.fine_material[t].density, 1e-12 * load.fine_material[t].density);
    }
}

// Compare each modulus of a fragment with its voxels' part of the tetrahedron's modulus: lambda by lambda, mu by mu.
// Return the number of compared fragments.
int expect_voxels_moduli(const pliant_body &now)
{
    const pliant_voxels &voxels = *now.voxels;
    const pliant_cuts &cuts = *now.cuts;
    std::set<int32_t> with_chips;
    for (int32_t c = 0; c < cuts.num_chips; c++) {
        const int32_t tet = cuts.chip[2 * c + 1];
        with_chips.insert(cuts.chip[2 * c]);
        with_chips.insert(now.tet_parent ? now.tet_parent[tet] : tet);
    }
    int compared = 0;
    for (int32_t i = 0; i < cuts.num_tets; i++) {
        const int32_t tet = cuts.tet[i], count = voxels.start[tet + 1] - voxels.start[tet];
        if (with_chips.count(tet) || cuts.start[i + 1] - cuts.start[i] < 2) continue;
        double all[3] = {0, 0, 0};
        std::map<int32_t, std::array<double, 3>> part;
        for (int32_t v = 0; v < count; v++) {
            const pliant_tet_material &one = voxels.of_material[voxels.material[voxels.start[tet] + v]];
            const double its[3] = {one.lambda, one.mu, one.density};
            for (int m = 0; m < 3; m++) {
                all[m] += its[m];
                part[cuts.voxel_fragment[cuts.voxel_start[i] + v]][static_cast<size_t>(m)] += its[m];
            }
        }
        const pliant_tet_material &load = voxels.load[tet];
        for (const auto &each : part) {
            const pliant_tet_material &fragment = now.fine_material[each.first];
            EXPECT_NEAR(fragment.lambda, load.lambda * each.second[0] / all[0], 1e-9 * load.lambda)
                << "tetrahedron " << tet;
            EXPECT_NEAR(fragment.mu, load.mu * each.second[1] / all[1], 1e-9 * load.mu) << "tetrahedron " << tet;
            EXPECT_NEAR(fragment.density, load.density * each.second[2] / all[2], 1e-9 * load.density)
                << "tetrahedron " << tet;
            compared++;
        }
    }
    return compared;
}

// At a corner of the body, a single voxel keeps its links, but three voxels in a row are cut off.
TEST(Cut, ThreeVoxelsDetachAndOneDoesNot)
{
    for (int voxels : {1, 3}) {
        auto block = bar();
        const double side = 0.005, end = 0.2 - voxels * side, beyond = 0.3;
        const std::vector<double> from{beyond, side, -0.1, beyond, side, side, beyond, -0.1, side};
        std::vector<double> to = from;
        for (size_t p = 0; p < 3; p++) to[3 * p] = end - 0.0004;
        ASSERT_TRUE(block->cut(from, to));
        EXPECT_EQ(num_pieces(*block->now), 1);
        block->cut({end, -0.1, -0.1, end, side + 0.0004, -0.1},
                   {end, -0.1, side + 0.0004, end, side + 0.0004, side + 0.0004});
        EXPECT_EQ(num_pieces(*block->now), voxels == 3 ? 2 : 1) << voxels;
    }
}

TEST(Cut, APlaneMakesTwoPiecesThatAddUp)
{
    auto block = bar();
    const double point[3] = {0.103, 0.05, 0.05}, normal[3] = {1, 0.2, -0.1};
    const double mass = total_mass(*block->now);
    ASSERT_TRUE(block->cut_plane(point, normal));
    EXPECT_EQ(block->report.pieces, 2);
    EXPECT_EQ(num_pieces(*block->now), 2);
    EXPECT_EQ(mismatches(*block->now), 0);
    EXPECT_NEAR(total_mass(*block->now), mass, 1e-12 * mass);
    EXPECT_NEAR(block->report.area, 0.01 * std::sqrt(1.05), 0.02 * 0.01);
    EXPECT_NEAR(block->report.area_of[0] + block->report.area_of[1], block->report.area, 1e-12);
    expect_shares(block->load(), *block->now);
    EXPECT_GT(expect_voxels_moduli(*block->now), 50);
    EXPECT_FALSE(block->cut_plane(point, normal)) << "again: nothing is left to be severed";
    EXPECT_EQ(block->report.num_links, 0);
    // voxels on one side of the plane belong to one piece
    const std::vector<int32_t> pieces = voxel_pieces(*block->now);
    std::map<int32_t, std::set<bool>> sides;
    for (int32_t v = 0; v < size[0] * size[1] * size[2]; v++) {
        const double x[3] = {0.005 * (v % 40 + 0.5), 0.005 * (v / 40 % 20 + 0.5), 0.005 * (v / 800 + 0.5)};
        double side = 0;
        for (int d = 0; d < 3; d++) side += normal[d] * (x[d] - point[d]);
        sides[pieces[v]].insert(side > 0);
    }
    for (const auto &piece : sides) EXPECT_EQ(piece.second.size(), 1u);
}

// The search returns every tetrahedron near a blade: at load, adjacent to a cut, and fragments, for any deformation.
TEST(Cut, AllTetrahedraNearABladeAreCandidates)
{
    auto block = bar();
    const double point[3] = {0.103, 0.05, 0.05}, normal[3] = {1, 0.2, -0.1};
    ASSERT_TRUE(block->cut_plane(point, normal));
    const pliant_mesh &mesh = block->now->fine;
    std::mt19937 random(2);
    std::uniform_real_distribution<double> unit(-1, 1);
    int32_t near = 0, left_out = 0;
    for (int round = 0; round < 40; round++) {
        std::vector<double> positions(block->positions);
        const double far = round % 4 == 0 ? 0 : 0.01 * round / 10;
        for (double &x : positions) x += far * unit(random);
        cut_strip strip{};
        for (int d = 0; d < 3; d++) {
            strip.low[d] = box[d] * (0.5 + 0.7 * unit(random));
            strip.high[d] = strip.low[d] + 0.01 * std::fabs(unit(random));
        }
        const double reach = 0.3 * (1 + unit(random)), slack = 1e-6;
        uint8_t *may = nullptr;
        ASSERT_EQ(pliant_cut_find_near_tets(block->now, positions.data(), &strip, reach, slack, &may), PLIANT_OK);
        for (int32_t t = 0; t < mesh.num_tets; t++) {
            bool is = true;
            for (int d = 0; d < 3; d++) {
                double low = INFINITY, high = -INFINITY;
                for (int v = 0; v < 4; v++) {
                    low = std::fmin(low, positions[3 * mesh.tets[4 * t + v] + d]);
                    high = std::fmax(high, positions[3 * mesh.tets[4 * t + v] + d]);
                }
                const double more = reach * (high - low) + slack;
                is = is && low - more <= strip.high[d] && high + more >= strip.low[d];
            }
            near += is;
            EXPECT_TRUE(may[t] || !is) << "tetrahedron " << t;
            left_out += !may[t];
        }
        pliant_free(may);
    }
    EXPECT_GT(near, 100);
    EXPECT_GT(left_out, 1000);
}

// On a plane of the lattice no tetrahedron is cut: each half is the mesh of half the bar, with the same bits.
TEST(Cut, OnALatticePlaneTheHalvesAreSeparateMeshes)
{
    auto block = bar();
    const double point[3] = {0.1, 0.05, 0.05}, normal[3] = {1, 0, 0};
    ASSERT_TRUE(block->cut_plane(point, normal));
    EXPECT_EQ(block->now->fine.num_tets, block->load().fine.num_tets);
    EXPECT_EQ(block->now->fine.num_nodes, block->load().fine.num_nodes + 25);
    EXPECT_EQ(block->report.num_links, 400);
    EXPECT_NEAR(block->report.area, 0.01, 1e-12);
    const int half_size[3] = {20, 20, 20};
    const double half_box[3] = {0.1, 0.1, 0.1};
    Body half(half_size, half_box, {{4000, 0.4, 1000, false}, {20000, 0.3, 1200, false}},
              [](int i, int j, int k) { return (i / 5 + j / 4 + k / 3) % 2; });
    half.fix_plane(1e-6, 0, 0, 1, 0, 0);
    half.cells(4, 4, 4, 1);
    ASSERT_EQ(half.build(), PLIANT_OK) << pliant_last_error();
    const pliant_body &alone = *half.model->body, &now = *block->now;
    for (int32_t t = 0; t < alone.fine.num_tets; t++) {
        const int32_t cell = alone.fine.lattice_of_tet[t] / 5, slot = alone.fine.lattice_of_tet[t] % 5;
        const int32_t tet = block->load().fine.tet_of_lattice[5 * (cell % 4 + 8 * (cell / 4)) + slot];
        EXPECT_EQ(std::memcmp(alone.fine_material + t, now.fine_material + tet, sizeof *now.fine_material), 0);
        for (int v = 0; v < 4; v++) {
            const int32_t a = alone.fine.tets[4 * t + v], b = now.fine.tets[4 * tet + v];
            for (int d = 0; d < 3; d++) EXPECT_EQ(alone.fine.rest[3 * a + d], now.fine.rest[3 * b + d]);
            EXPECT_NEAR(alone.node_mass[a], now.node_mass[b], 1e-15);
        }
    }
}

TEST(Cut, RandomPlanesMakeTwoPieces)
{
    std::mt19937 random(5);
    std::uniform_real_distribution<double> unit(-1, 1);
    int inverted = 0;
    for (int trial = 0; trial < 100; trial++) {
        auto block = bar();
        const double mass = total_mass(*block->now);
        double normal[3] = {1, 0.6 * unit(random), 0.6 * unit(random)},
               point[3] = {0.1 + 0.03 * unit(random), 0.05, 0.05};
        const double wave[3] = {unit(random), unit(random), unit(random)};
        // smooth large deformations; every third trial has inverted elements
        for (int32_t n = 0; n < block->now->fine.num_nodes; n++) {
            double *x = block->positions.data() + 3 * n;
            const double y = x[1];
            x[1] += 0.02 * std::sin(30 * x[0] + 3 * wave[0]);
            x[2] += 0.02 * std::sin(25 * y + 3 * wave[1]);
            x[0] *= 1 + 0.3 * wave[2];
            for (int d = 0; d < 3 && trial % 3 == 2; d++) x[d] += 0.012 * unit(random);
        }
        for (int32_t t = 0; t < block->now->fine.num_tets; t++) {
            const int32_t *nodes = block->now->fine.tets + 4 * t;
            const double *x = block->positions.data();
            double gradients[12];
            inverted += pliant_tet_gradients(x + 3 * nodes[0], x + 3 * nodes[1], x + 3 * nodes[2], x + 3 * nodes[3],
                                             gradients) < 0;
        }
        point[0] *= 1 + 0.3 * wave[2];
        ASSERT_TRUE(block->cut_plane(point, normal));
        EXPECT_EQ(block->report.pieces, 2) << "trial " << trial;
        EXPECT_EQ(mismatches(*block->now), 0) << "trial " << trial;
        EXPECT_NEAR(total_mass(*block->now), mass, 1e-12 * mass);
    }
    EXPECT_GT(inverted, 100);
}

TEST(Cut, PlanesWhereEverythingIsOnThem)
{
    struct { double point[3], normal[3]; int pieces; } cases[] = {
        {{0.1025, 0.05, 0.05}, {1, 0, 0}, 2},  // centres of voxels
        {{0.1, 0.05, 0.05}, {1, 0, 0}, 2},     // faces of the lattice and of voxels
        {{0.1, 0.05, 0.05}, {1, 1, 0}, 2},     // edges and nodes
        {{0.1, 0.05, 0.05}, {1, 1, 1}, 2},     // faces of tetrahedra
        {{0.1025, 0.0525, 0.0525}, {1, -1, 0}, 2}, // diagonals of voxels
        {{0.1, 0.0975, 0.05}, {0, 1, 0}, 2},   // along the bar, through the last layer of voxels
        {{0.1, 0.1, 0.05}, {0, 1, 0}, 1},      // the side of the bar
    };
    for (const auto &one : cases)
        for (double size : {10.0, 1e6}) {
            auto block = bar();
            std::vector<double> from, to;
            CutState::plane(one.point, one.normal, size, from, to);
            EXPECT_EQ(block->cut(from, to), one.pieces == 2)
                << one.normal[0] << one.normal[1] << one.normal[2] << " " << one.point[0];
            EXPECT_EQ(num_pieces(*block->now), one.pieces)
                << one.normal[0] << one.normal[1] << one.normal[2] << " " << one.point[0];
            EXPECT_EQ(mismatches(*block->now), 0);
        }
}

// The reported area is the area of the section at rest, although the tissue is turned and sheared during the cut.
TEST(Cut, AreaIsOfTheTissueAtRest)
{
    const double move[9] = {0.7, -0.9, 0.2, 0.8, 0.6, -0.4, 0.1, 0.3, 1.1}; // determinant 1.41
    const double inverse[9] = {0.78, 1.05, 0.24, -0.92, 0.75, 0.44, 0.18, -0.3, 1.14}; // times that determinant
    const double rest[3] = {0.103, 0.05, 0.05}, normal[3] = {1, 0.2, -0.1};
    auto block = bar();
    for (int32_t n = 0; n < block->now->fine.num_nodes; n++)
        for (int r = 0; r < 3; r++) {
            const double *x = block->now->fine.rest + 3 * n;
            block->positions[3 * n + r] = move[3 * r] * x[0] + move[3 * r + 1] * x[1] + move[3 * r + 2] * x[2];
        }
    double point[3], moved[3]; // the inverse transpose moves normals
    for (int r = 0; r < 3; r++) {
        point[r] = move[3 * r] * rest[0] + move[3 * r + 1] * rest[1] + move[3 * r + 2] * rest[2];
        moved[r] = inverse[r] * normal[0] + inverse[3 + r] * normal[1] + inverse[6 + r] * normal[2];
    }
    ASSERT_TRUE(block->cut_plane(point, moved));
    EXPECT_EQ(block->report.pieces, 2);
    EXPECT_NEAR(block->report.area, 0.01 * std::sqrt(1.05), 0.01 * 0.01);
}

// A cut between two materials gives half of its area to each. A cut within one material gives it all of the area.
TEST(Cut, AreaIsDividedBetweenTheMaterialsOnBothSides)
{
    for (double at : {0.1, 0.05, 0.15}) {
        const std::vector<Material> materials = {{4000, 0.4, 1000, false}, {20000, 0.3, 1200, false}};
        std::unique_ptr<Body> body(new Body(size, box, materials, [](int i, int, int) { return i < 20 ? 0 : 1; }));
        body->fix_plane(1e-6, 0, 0, 1, 0, 0);
        body->cells(8, 4, 4, 1);
        body->scene.cut.kind = PLIANT_CUT_SEVER;
        ASSERT_EQ(body->build(), PLIANT_OK) << pliant_last_error();
        CutState block(std::move(body));
        const double point[3] = {at, 0.05, 0.05}, normal[3] = {1, 0, 0};
        ASSERT_TRUE(block.cut_plane(point, normal, 1));
        EXPECT_NEAR(block.report.area_of[0], at < 0.1 ? 0.01 : at > 0.1 ? 0 : 0.005, 1e-9) << at;
        EXPECT_NEAR(block.report.area_of[1], at < 0.1 ? 0 : at > 0.1 ? 0.01 : 0.005, 1e-9) << at;
    }
}

// Through centres of voxels, a cut severs one flat layer of links, even with position errors of a solver's tolerance.
TEST(Cut, ThroughCentresOfVoxelsItIsFlat)
{
    std::mt19937 random(2);
    std::uniform_real_distribution<double> unit(-1, 1);
    for (double noise : {0., 1e-12, 1e-9, 1e-6})
        for (int d = 0; d < 3; d++)
            for (double side : {1., -1.}) {
                auto block = bar();
                for (double &x : block->positions) x += noise * unit(random);
                double normal[3] = {0, 0, 0}, point[3] = {0.1025, 0.0525, 0.0525};
                normal[d] = side;
                ASSERT_TRUE(block->cut_plane(point, normal, 1));
                const double area = d == 0 ? 0.01 : 0.02;
                EXPECT_EQ(block->report.num_links, d == 0 ? 400 : 800) << noise;
                EXPECT_NEAR(block->report.area, area, 1e-3 * area) << noise;
                EXPECT_EQ(num_pieces(*block->now), 2);
                std::set<int32_t> layers;
                for (int32_t l = 0; l < block->now->cuts->num_links; l++) {
                    const int32_t voxel = static_cast<int32_t>(block->now->cuts->link[l] / 4),
                                  at[3] = {voxel % 40, voxel / 40 % 20, voxel / 800};
                    EXPECT_EQ(static_cast<int>(block->now->cuts->link[l] % 4), d);
                    layers.insert(at[d]);
                }
                EXPECT_EQ(layers.size(), 1u) << noise;
            }
    // in tissue bent by a tenth of a voxel the links form steps, but the reported area is that of the plane
    auto block = bar();
    for (int32_t n = 0; n < block->now->fine.num_nodes; n++)
        block->positions[3 * n] +=
            5e-4 * std::sin(200 * block->positions[3 * n + 1]) * std::cos(170 * block->positions[3 * n + 2]);
    const double point[3] = {0.1025, 0.05, 0.05}, normal[3] = {1, 0, 0};
    ASSERT_TRUE(block->cut_plane(point, normal, 1));
    EXPECT_GT(block->report.num_links, 450);
    EXPECT_NEAR(block->report.area, 0.01, 0.03 * 0.01);
}

TEST(Cut, EmptySweepsSeverNothing)
{
    auto block = bar();
    const double nan = std::nan(""), inf = INFINITY;
    const pliant_body *before = block->now;
    EXPECT_FALSE(block->cut({}, {}));
    EXPECT_FALSE(block->cut({0.1, 0.05, 0.05}, {0.1, 0.05, 0.2}));                                         // a point
    EXPECT_FALSE(block->cut({0.1, 0, 0.05, 0.1, 0.1, 0.05}, {0.1, 0, 0.05, 0.1, 0.1, 0.05}));              // no motion
    // a motion along its own line
    EXPECT_FALSE(block->cut({0.1, 0, 0.05, 0.1, 0.1, 0.05}, {0.1, 0.01, 0.05, 0.1, 0.11, 0.05}));
    EXPECT_FALSE(block->cut({0.1, 0, nan, 0.1, 0.1, nan}, {0.1, 0, 0.1, 0.1, 0.1, 0.1}));
    EXPECT_FALSE(block->cut({0.1, 0, 0, 0.1, 0.1, 0}, {0.1, 0, inf, 0.1, 0.1, inf}));
    // next to the body
    EXPECT_FALSE(block->cut({0.1, 0.2, 0, 0.1, 0.3, 0}, {0.1, 0.2, 0.1, 0.1, 0.3, 0.1}));
    EXPECT_FALSE(block->cut({1, 0, 0, 1, 1, 0}, {1, 0, 1, 1, 1, 1}));                                      // far away
    EXPECT_EQ(block->now, before);
    block->positions[3 * 40] = nan; // tissue with a NaN position does not stop the cut elsewhere
    EXPECT_TRUE(block->cut({0.15, -1, -1, 0.15, 1, -1}, {0.15, -1, 1, 0.15, 1, 1}));
    Body plain(size, box, {{4000, 0.4, 1000, false}});
    plain.fix_plane(1e-6, 0, 0, 1, 0, 0);
    plain.cells(8, 4, 4, 1);
    ASSERT_EQ(plain.build(), PLIANT_OK);
    pliant_body *out = nullptr;
    const double from[6] = {0.1, 0, 0, 0.1, 0.1, 0}, to[6] = {0.1, 0, 0.1, 0.1, 0.1, 0.1};
    const pliant_cut_sweep sweep{2, from, to, nullptr};
    EXPECT_EQ(pliant_body_cut(plain.model->body, 2, plain.data->positions, &sweep, &out, nullptr),
              PLIANT_ERROR_ARGUMENT);
}

TEST(Cut, CrossingPlanesAndACurvedBlade)
{
    auto block = bar();
    const double mass = total_mass(*block->now), middle[3] = {0.11, 0.05, 0.05},
                 normals[3][3] = {{1, 0.1, 0.2}, {0.1, 1, -0.1}, {0.2, 0, 1}};
    for (int n = 0; n < 3; n++) {
        ASSERT_TRUE(block->cut_plane(middle, normals[n]));
        EXPECT_EQ(block->report.pieces, 2 << n);
        EXPECT_EQ(mismatches(*block->now), 0);
        expect_shares(block->load(), *block->now);
    }
    EXPECT_NEAR(total_mass(*block->now), mass, 1e-12 * mass);
    // A cylindrical blade cuts a core out.
    auto other = bar();
    std::vector<double> from, to;
    for (int p = 0; p <= 40; p++) {
        const double angle = 2 * M_PI * (p % 40) / 40;
        for (double z : {-0.01, 0.11}) {
            std::vector<double> &out = z < 0 ? from : to;
            out.push_back(0.12 + 0.03 * std::cos(angle));
            out.push_back(0.05 + 0.03 * std::sin(angle));
            out.push_back(z);
        }
    }
    ASSERT_TRUE(other->cut(from, to));
    EXPECT_EQ(other->report.pieces, 2);
    EXPECT_EQ(mismatches(*other->now), 0);
    EXPECT_NEAR(other->report.area, 2 * M_PI * 0.03 * 0.1, 0.03 * 2 * M_PI * 0.03 * 0.1);
}

TEST(Cut, TetrahedraAwayFromTheCutAreUnchanged)
{
    auto block = bar();
    const double left[3] = {0.06, 0.05, 0.05}, right[3] = {0.15, 0.05, 0.05}, normal[3] = {1, 0.3, 0.2};
    ASSERT_TRUE(block->cut_plane(left, normal));
    const pliant_body *before = pliant_body_retain(block->now);
    ASSERT_TRUE(block->cut_plane(right, normal));
    const pliant_body &now = *block->now;
    const std::set<int32_t> touched(now.changes.touched, now.changes.touched + now.changes.num_touched);
    EXPECT_LT(touched.size(), 200u);
    int kept = 0;
    for (int32_t t = 0; t < before->fine.num_tets; t++) {
        if (touched.count(t)) continue;
        kept++;
        EXPECT_EQ(std::memcmp(before->fine.tets + 4 * t, now.fine.tets + 4 * t, 4 * sizeof(int32_t)), 0);
        EXPECT_EQ(std::memcmp(before->fine_material + t, now.fine_material + t, sizeof *now.fine_material), 0);
        for (int v = 0; v < 4; v++) {
            const int32_t node = now.fine.tets[4 * t + v];
            if (now.fine.rest[3 * node] > 0.08) continue;
            EXPECT_EQ(before->node_mass[node], now.node_mass[node]);
            EXPECT_EQ(before->fine_fixed[node], now.fine_fixed[node]);
        }
    }
    EXPECT_GT(kept, 400);
    EXPECT_EQ(
        std::memcmp(before->fine.rest, now.fine.rest, 3 * sizeof(double) * static_cast<size_t>(before->fine.num_nodes)),
        0);
    for (int32_t v = 0; v < size[0] * size[1] * size[2]; v++)
        if (v % size[0] < 18)
            EXPECT_EQ(pliant_voxels_fragment(now.voxels, before->cuts, v),
                      pliant_voxels_fragment(now.voxels, now.cuts, v));
    pliant_body_release(before);
}

void expect_same(const pliant_body &a, const pliant_body &b)
{
    EXPECT_TRUE(pliant_body_same(&a, &b) || a.voxels != b.voxels);
    ASSERT_EQ(a.fine.num_tets, b.fine.num_tets);
    ASSERT_EQ(a.fine.num_nodes, b.fine.num_nodes);
    EXPECT_EQ(std::memcmp(a.fine.tets, b.fine.tets, 4 * sizeof(int32_t) * static_cast<size_t>(a.fine.num_tets)), 0);
    EXPECT_EQ(
        std::memcmp(a.fine_material, b.fine_material, sizeof *a.fine_material * static_cast<size_t>(a.fine.num_tets)),
        0);
    EXPECT_EQ(std::memcmp(a.node_mass, b.node_mass, sizeof(double) * static_cast<size_t>(a.fine.num_nodes)), 0);
    ASSERT_EQ(a.cuts->num_links, b.cuts->num_links);
    EXPECT_EQ(std::memcmp(a.cuts->link, b.cuts->link, sizeof *a.cuts->link * static_cast<size_t>(a.cuts->num_links)),
              0);
    ASSERT_EQ(a.cuts->num_joins, b.cuts->num_joins);
    EXPECT_EQ(std::memcmp(a.cuts->join, b.cuts->join, 2 * sizeof(int32_t) * static_cast<size_t>(a.cuts->num_joins)), 0);
}

TEST(Cut, TheSameBitsAgainWithOneThreadOrTwo)
{
    const double point[3] = {0.1, 0.05, 0.05}, normals[2][3] = {{1, 0.3, 0.2}, {0.2, 1, 0.1}};
    std::unique_ptr<CutState> one = bar([](pliant_scene &scene) { scene.solver.threads = 1; }),
                              two = bar([](pliant_scene &scene) { scene.solver.threads = 2; });
    for (CutState *each : {one.get(), two.get()})
        for (const auto &normal : normals) ASSERT_TRUE(each->cut_plane(point, normal));
    expect_same(*one->now, *two->now);
    // undo and redo
    auto third = bar();
    ASSERT_TRUE(third->cut_plane(point, normals[0]));
    const pliant_body *first = pliant_body_retain(third->now);
    const std::vector<double> positions = third->positions;
    ASSERT_TRUE(third->cut_plane(point, normals[1]));
    expect_same(*third->now, *one->now);
    pliant_body_release(third->now);
    third->now = first;
    third->positions = positions;
    ASSERT_TRUE(third->cut_plane(point, normals[1]));
    expect_same(*third->now, *one->now);
}

TEST(Cut, OutOfMemoryKeepsThePreviousBody)
{
    auto block = bar();
    const double point[3] = {0.1, 0.05, 0.05}, normals[2][3] = {{1, 0.3, 0.2}, {0.2, 1, 0.1}};
    ASSERT_TRUE(block->cut_plane(point, normals[0]));
    std::vector<double> from, to;
    CutState::plane(point, normals[1], 10, from, to);
    const pliant_cut_sweep sweep{2, from.data(), to.data(), nullptr};
    const size_t before = pliant_memory_in_use();
    int64_t n = 0;
    for (pliant_status status = PLIANT_ERROR_MEMORY; status != PLIANT_OK; n++) {
        pliant_body *next = nullptr;
        pliant_cut_report report{};
        pliant_memory_fail_after(n);
        status = pliant_body_cut(block->now, 3, block->positions.data(), &sweep, &next, &report);
        pliant_memory_fail_after(-1);
        ASSERT_TRUE(status == PLIANT_OK || status == PLIANT_ERROR_MEMORY);
        if (status != PLIANT_OK) {
            EXPECT_EQ(next, nullptr);
            EXPECT_EQ(report.num_links, 0);
        }
        pliant_body_release(next);
        ASSERT_EQ(pliant_memory_in_use(), before) << "allocation " << n;
    }
    EXPECT_GT(n, 40);
}

// Locate points in a body whose halves are moved apart and into each other.
TEST(Cut, PointsAreLocatedInTheirFragment)
{
    auto block = bar();
    const double point[3] = {0.103, 0.05, 0.05}, normal[3] = {1, 0.2, -0.1};
    ASSERT_TRUE(block->cut_plane(point, normal));
    const pliant_body &now = *block->now;
    const std::vector<int32_t> pieces = mesh_pieces(now);
    const pliant_voxels &voxels = *now.voxels;
    std::vector<double> by(static_cast<size_t>(now.fine.num_nodes)); // the right piece moves 3 cm
    for (int32_t t = 0; t < now.fine.num_tets; t++)
        for (int v = 0; v < 4; v++)
            by[now.fine.tets[4 * t + v]] = pieces[t] == pieces[pliant_voxels_fragment(&voxels, now.cuts, 0)] ? 0 : 0.03;
    for (int32_t n = 0; n < now.fine.num_nodes; n++) block->positions[3 * n] += by[n];
    int near = 0;
    std::vector<double> points;
    std::vector<int32_t> own, found;
    for (int32_t v = 0; v < size[0] * size[1] * size[2]; v++) {
        const int32_t tet = pliant_voxels_fragment(&voxels, now.cuts, v);
        const bool right = by[now.fine.tets[4 * tet]] > 0;
        // a chip may lie outside of the tetrahedron that carries it
        if (now.tet_parent && now.tet_parent[tet] != voxels.owner[v]) continue;
        const double x[3] = {0.005 * (v % 40 + 0.5) + (right ? 0.03 : 0), 0.005 * (v / 40 % 20 + 0.5),
                             0.005 * (v / 800 + 0.5)};
        points.insert(points.end(), x, x + 3);
        own.push_back(tet);
        near += now.cuts->num_tets > 0 &&
                std::binary_search(now.cuts->tet, now.cuts->tet + now.cuts->num_tets, voxels.owner[v]);
    }
    found.resize(own.size());
    std::vector<double> weights(4 * own.size());
    pliant_body_locate_points(&now, block->positions.data(), static_cast<int32_t>(own.size()), points.data(),
                              found.data(), weights.data());
    EXPECT_GT(near, 1000);
    int wrong = 0;
    for (size_t p = 0; p < own.size(); p++) {
        ASSERT_GE(found[p], 0);
        if (found[p] == own[p]) continue;
        // the point is on a face: the adjacent tetrahedron moves with it
        EXPECT_LT(*std::min_element(weights.begin() + 4 * static_cast<long>(p),
                                    weights.begin() + 4 * static_cast<long>(p) + 4),
                  1e-6);
        EXPECT_EQ(pieces[found[p]], pieces[own[p]]);
        wrong++;
    }
    EXPECT_LT(wrong, static_cast<int>(own.size() / 4));
    int32_t tet;
    double one[4];
    const double gap[3] = {0.118, 0.05, 0.05}, nowhere[3] = {1, 0, 0};
    EXPECT_FALSE(pliant_body_locate(&now, block->positions.data(), gap, &tet, one));
    EXPECT_FALSE(pliant_body_locate(&now, block->positions.data(), nowhere, &tet, one));
    EXPECT_TRUE(pliant_body_locate(&now, block->positions.data(), points.data(), &tet, one));
    EXPECT_EQ(tet, found[0]);
}

} // namespace
