// Tests of cuts that subdivide tetrahedra (cut/kind: subdivide): the mesh, and unsupported combinations.
#include "base/memory.h"
#include "subdivided_bar.h"
#include "mesh/mesh.h"
#include "topology/visible_surface.h"
#include "warp/warp.h"
#include "model_data/model.h"

#include <array>

namespace {

// A body, its current cut body, and the positions of the nodes.
struct Split {
    std::unique_ptr<Body> body;
    const pliant_body *now;
    std::vector<double> positions;
    pliant_cut_report report{};
    explicit Split(std::unique_ptr<Body> made) : body(std::move(made)), now(pliant_body_retain(body->model->body))
    {
        positions.assign(now->fine.rest, now->fine.rest + 3 * now->fine.num_nodes);
    }
    Split(const Split &) = delete;
    ~Split() { pliant_body_release(now); }
    bool cut(const std::vector<double> &from, const std::vector<double> &to, uint32_t stroke = 0)
    {
        const pliant_cut_sweep sweep{static_cast<int32_t>(from.size() / 3), from.data(), to.data(),
                                     body->model->material_of_voxel,        0,           stroke};
        pliant_body *next = nullptr;
        EXPECT_EQ(pliant_body_cut(now, now->revision + 1, positions.data(), &sweep, &next, &report), PLIANT_OK)
            << pliant_last_error();
        if (!next) return false;
        pliant_body_map map{};
        EXPECT_EQ(pliant_body_map_create(now, next, &map), PLIANT_OK) << pliant_last_error();
        std::vector<double> moved(3 * static_cast<size_t>(next->fine.num_nodes));
        pliant_body_map_vectors(&map, positions.data(), moved.data());
        pliant_body_map_free(&map);
        positions = moved;
        pliant_body_release(now);
        now = next;
        return true;
    }
    bool cut_plane(const double point[3], const double normal[3])
    {
        std::vector<double> from, to;
        CutState::plane(point, normal, 10, from, to);
        return cut(from, to);
    }
};

TEST(Subdivide, APlaneMakesTwoPiecesThatAddUp)
{
    std::mt19937 random(1);
    std::uniform_real_distribution<double> unit(-1, 1);
    for (int plane = 0; plane < 12; plane++) {
        Split block(bar());
        const double mass = total_mass(*block.now), point[3] = {0.1 + 0.03 * unit(random), 0.05, 0.05},
                     normal[3] = {1, 0.4 * unit(random), 0.4 * unit(random)};
        const double section = 0.01 * std::sqrt(1 + normal[1] * normal[1] + normal[2] * normal[2]);
        ASSERT_TRUE(block.cut_plane(point, normal));
        EXPECT_EQ(block.report.pieces, 2);
        EXPECT_EQ(num_pieces(*block.now), 2);
        EXPECT_NEAR(block.report.area, section, 0.05 * section);
        EXPECT_NEAR(block.report.area_of[0] + block.report.area_of[1], block.report.area, 1e-12);
        EXPECT_NEAR(total_mass(*block.now), mass, 1e-12 * mass);
        expect_sound(*block.now, block.report.area);
        // Every piece lies on its side of the plane, up to the snapping distance.
        const std::vector<int32_t> pieces = mesh_pieces(*block.now);
        std::map<int32_t, std::array<double, 2>> reach;
        for (int32_t v = 0; v < 4 * block.now->fine.num_tets; v++) {
            double side = 0;
            for (int d = 0; d < 3; d++)
                side += normal[d] * (block.now->fine.rest[3 * block.now->fine.tets[v] + d] - point[d]);
            auto at = reach.insert({pieces[v / 4], {{side, side}}}).first;
            at->second = {{std::fmin(at->second[0], side), std::fmax(at->second[1], side)}};
        }
        for (const auto &one : reach)
            EXPECT_LT(std::fmin(-one.second[0], one.second[1]), 1.3 * block.now->subdivision->min_edge);
        block.cut_plane(point, normal);
        EXPECT_LT(block.report.area, 0.06 * section) << "again: nothing is left but what was snapped";
    }
}

// The reported area is the area of tissue in the section. Faces of partly filled tetrahedra have a larger area.
TEST(Subdivide, OnlyTissueCountsAsArea)
{
    const std::vector<Material> materials = {{4000, 0.4, 1000, false}, {10, 0, 1, true}};
    std::unique_ptr<Body> body(new Body(size, box, materials, [](int, int j, int) { return j < 8 ? 0 : 1; }));
    Split block(built(std::move(body), [](pliant_scene &) {}));
    const double point[3] = {0.1, 0.05, 0.05}, normal[3] = {1, 0, 0}, tissue = 0.04 * 0.1;
    ASSERT_TRUE(block.cut_plane(point, normal));
    EXPECT_NEAR(block.report.area, tissue, 0.03 * tissue) << "the faces have 0.005 m^2";
}

// In the same tetrahedra, a section has either tissue alone or none. Voxels decide, not the mean of a tetrahedron.
TEST(Subdivide, VoxelsDecideWhichAreaIsTissue)
{
    const std::vector<Material> materials = {{4000, 0.4, 1000, false}, {10, 0, 1, true}};
    for (const bool in_tissue : {true, false}) {
        std::unique_ptr<Body> body(new Body(size, box, materials, [](int, int j, int) { return j < 8 ? 0 : 1; }));
        Split block(built(std::move(body), [](pliant_scene &) {}));
        const double point[3] = {0.1, in_tissue ? 0.031 : 0.044, 0.05}, normal[3] = {0, 1, 0},
                     section = in_tissue ? 0.2 * 0.1 : 0;
        ASSERT_TRUE(block.cut_plane(point, normal));
        EXPECT_NEAR(block.report.area, section, 1e-9) << "tissue ends at y = 0.04 m";
        EXPECT_NEAR(block.report.area_of[0], section, 1e-9);
        EXPECT_EQ(block.report.area_of[1], 0);
    }
}

// A node that a cut puts on an edge is fixed if both ends of the edge are fixed. All other new nodes move.
TEST(Subdivide, NodesOnEdgesAreFixedBetweenFixedOnesAlone)
{
    Split block(uniform());
    const double point[3] = {0.01, 0.043, 0.05}, normal[3] = {0.3, 1, 0.2};
    const int32_t before = block.now->fine.num_nodes;
    ASSERT_TRUE(block.cut_plane(point, normal));
    EXPECT_EQ(block.report.pieces, 2) << "the fixed plane holds both";
    int fixed = 0, moving = 0;
    for (int32_t n = before; n < block.now->fine.num_nodes; n++) {
        const double x = block.now->fine.rest[3 * n];
        EXPECT_EQ(block.now->fine_fixed[n] == PLIANT_MOVES, x > 1e-6) << x;
        fixed += x <= 1e-6;
        moving += x > 1e-6 && x < 0.0249;
    }
    EXPECT_GT(fixed, 3);
    EXPECT_GT(moving, 3);
}

// A cut keeps nodes, edges and faces in the blade's plane. It splits only the tetrahedra that the plane passes through.
// The area is the plane's section.
TEST(Subdivide, PlanesWhereEverythingIsOnThem)
{
    const struct { double point[3], normal[3]; bool splits; } cases[] = {
        {{0.1, 0.05, 0.05}, {1, 0, 0}, false},  // faces of the lattice
        {{0.1, 0.05, 0.05}, {1, 1, 1}, false},  // faces of tetrahedra
        {{0.1, 0.05, 0.05}, {1, 1, 0}, true},   // edges and nodes
        {{0.1, 0.05, 0.05}, {1, 0.5, 0}, true}, // some of the nodes
        {{0.1, 0.1, 0.05}, {0, 1, 0}, false},   // the side of the bar
    };
    for (const auto &one : cases)
        for (double half : {10.0, 1e6}) {
            Split block(uniform());
            const int32_t tets = block.now->fine.num_tets;
            std::vector<double> from, to;
            CutState::plane(one.point, one.normal, half, from, to);
            const bool parts = one.normal[0] > 0;
            const double area =
                parts ? 0.01 * std::sqrt(1 + std::pow(one.normal[1], 2) + std::pow(one.normal[2], 2)) : 0;
            SCOPED_TRACE(std::to_string(one.normal[0]) + " " + std::to_string(one.normal[1]) + " " +
                         std::to_string(one.normal[2]) + ", " + std::to_string(half));
            EXPECT_EQ(block.cut(from, to), parts);
            EXPECT_EQ(num_pieces(*block.now), parts ? 2 : 1);
            EXPECT_EQ(block.now->fine.num_tets > tets, one.splits);
            EXPECT_NEAR(block.report.area, area, 1e-9);
            expect_sound(*block.now, area);
        }
}

// A plane far from all nodes splits a tetrahedron into four parts (one corner off) or six (two corners off).
TEST(Subdivide, TetrahedraAreSplitByTheNumberOfTheirCutEdges)
{
    Split block(bar());
    const double point[3] = {0.0875, 0.05, 0.05}, normal[3] = {1, 0, 0};
    std::vector<int> cut_edges(static_cast<size_t>(block.now->fine.num_tets)), parts(cut_edges.size(), 1);
    for (int32_t t = 0; t < block.now->fine.num_tets; t++)
        for (int a = 0; a < 4; a++)
            for (int b = 0; b < a; b++)
                cut_edges[t] += (block.now->fine.rest[3 * block.now->fine.tets[4 * t + a]] > point[0]) !=
                                (block.now->fine.rest[3 * block.now->fine.tets[4 * t + b]] > point[0]);
    ASSERT_TRUE(block.cut_plane(point, normal));
    for (int32_t t = block.body->model->body->fine.num_tets; t < block.now->fine.num_tets; t++)
        parts[block.now->tet_parent[t]]++;
    std::set<int> patterns;
    for (size_t t = 0; t < parts.size(); t++) {
        EXPECT_EQ(parts[t], cut_edges[t] == 0 ? 1 : cut_edges[t] == 3 ? 4 : 6);
        patterns.insert(cut_edges[t]);
    }
    EXPECT_EQ(patterns, (std::set<int>{0, 3, 4}));
    EXPECT_NEAR(block.report.area, 0.01, 1e-12);
}

// The transfer of the state keeps every affine map. The smaller tetrahedra have the rest shape of their sources.
TEST(Subdivide, AffineMapsPassThrough)
{
    auto body = bar([](pliant_scene &) {});
    Split block(std::move(body));
    const double a[9] = {1.1, 0.05, 0, -0.02, 0.95, 0.1, 0, 0.03, 1.02}, b[3] = {0.01, 0, 0.02};
    block.positions = affine(block.now->fine, a, b);
    std::mt19937 random(2);
    std::uniform_real_distribution<double> unit(0, 1);
    for (int stroke = 0; stroke < 8; stroke++) {
        std::vector<double> from, to;
        for (int p = 0; p < 9; p++)
            for (int d = 0; d < 3; d++) {
                from.push_back(box[d] * unit(random));
                to.push_back(box[d] * unit(random));
            }
        block.cut(from, to);
        const std::vector<double> expected = affine(block.now->fine, a, b);
        for (size_t n = 0; n < expected.size(); n++) ASSERT_NEAR(block.positions[n], expected[n], 1e-14);
    }
    ASSERT_GT(block.now->fine.num_tets, 2 * block.body->model->body->fine.num_tets);
}

TEST(Subdivide, ThePatchTestHolds)
{
    auto body = uniform();
    const double points[6] = {0.05, -0.01, 0.11, 0.12, 0.07, 0.11}, depth[3] = {0.013, 0.004, -0.07};
    ASSERT_EQ(pliant_data_cut(body->model, body->data, 2, points, depth, nullptr), PLIANT_OK) << pliant_last_error();
    const pliant_body &now = *body->data->body;
    ASSERT_GT(now.fine.num_tets, body->model->body->fine.num_tets + 50);
    const double a[9] = {1.001, 0.0005, 0, -0.0002, 0.999, 0.0001, 0, 0.0003, 1.0002}, b[3] = {0, 0, 0};
    const pliant_system *system = body->data->discretization->system;
    const std::vector<double> positions = affine(now.fine, a, b);
    std::vector<double> forces(12 * LANES * static_cast<size_t>(system->num_blocks)), sum(positions.size());
    auto blocks = reinterpret_cast<double (*)[12][LANES]>(forces.data());
    pliant_system_element_forces(system, positions.data(), blocks);
    for (int32_t t = 0; t < now.fine.num_tets; t++)
        for (int m = 0; m < 12; m++) sum[3 * now.fine.tets[4 * t + m / 3] + m % 3] += blocks[t / LANES][m][t % LANES];
    std::set<int32_t> outside(now.triangles, now.triangles + 3 * now.num_triangles);
    double maximum = 0, inside = 0;
    for (int32_t n = 0; n < now.fine.num_nodes; n++)
        for (int d = 0; d < 3; d++)
            (outside.count(n) ? maximum : inside) =
                std::fmax(outside.count(n) ? maximum : inside, std::fabs(sum[3 * n + d]));
    EXPECT_GT(maximum, 1e-4);
    EXPECT_LT(inside, 1e-5 * maximum); // single precision
}

void random_strokes(Split &block, int strokes)
{
    std::mt19937 random(7);
    std::uniform_real_distribution<double> unit(-1, 1);
    const double mass = total_mass(*block.now);
    double opened = 0;
    for (int s = 0; s < strokes; s++) {
        for (int32_t n = 0; n < block.now->fine.num_nodes; n++) { // a smooth motion of a few millimetres
            const double *x = block.now->fine.rest + 3 * n;
            for (int d = 0; d < 3; d++) block.positions[3 * n + d] = x[d] + 0.004 * std::sin(30 * x[(d + 1) % 3] + s);
        }
        double middle[3], along[3], ahead[3];
        for (int d = 0; d < 3; d++) {
            middle[d] = box[d] * (0.5 + 0.5 * unit(random));
            along[d] = 0.04 * unit(random);
            ahead[d] = 0.04 * unit(random);
        }
        std::vector<double> from, to;
        for (int p = -8; p <= 8; p++)
            for (int d = 0; d < 3; d++) {
                from.push_back(middle[d] + along[d] * p / 8 - ahead[d]);
                to.push_back(middle[d] + along[d] * p / 8 + ahead[d] + 0.004 * (p % 2));
            }
        if (!block.cut(from, to)) continue;
        opened += block.report.area;
        EXPECT_EQ(block.report.pieces, num_pieces(*block.now));
        EXPECT_NEAR(total_mass(*block.now), mass, 1e-12 * mass);
        expect_sound(*block.now, opened);
    }
}

TEST(Subdivide, FiftyRandomStrokesLeaveASoundMesh)
{
    auto small = [] { return bar([](pliant_scene &scene) { 
                      scene.mesh.coarse_cells[0] = 4;
                      scene.mesh.coarse_cells[1] = scene.mesh.coarse_cells[2] = 2;
                  }); };
    Split block(small()), again(small());
    random_strokes(block, 50);
    EXPECT_GE(shortest_edge(*block.now), 0.1 * block.now->subdivision->min_edge);
    EXPECT_GT(block.now->fine.num_tets, 1000);
    random_strokes(again, 50);
    EXPECT_TRUE(pliant_body_same(block.now, again.now)) << "the same strokes, other bits";
}

// With contact of tissue on tissue, the copies of nodes move into their sides. Nothing else differs.
TEST(Subdivide, SidesAreCreatedAKerfApart)
{
    std::mt19937 random(3);
    std::uniform_real_distribution<double> unit(-1, 1);
    for (int plane = 0; plane < 6; plane++) {
        Split block(bar()), open(bar([](pliant_scene &scene) { scene.contact.self = true; }));
        const double mass = total_mass(*open.now), point[3] = {0.1 + 0.03 * unit(random), 0.05, 0.05},
                     normal[3] = {1, 0.4 * unit(random), 0.4 * unit(random)};
        const double section = 0.01 * std::sqrt(1 + normal[1] * normal[1] + normal[2] * normal[2]);
        ASSERT_TRUE(block.cut_plane(point, normal));
        ASSERT_TRUE(open.cut_plane(point, normal));
        EXPECT_EQ(open.report.pieces, 2);
        EXPECT_EQ(open.report.area, block.report.area);
        EXPECT_NEAR(total_mass(*open.now), mass, 1e-12 * mass);
        const pliant_mesh &fine = open.now->fine;
        const pliant_subdivision &subdivision = *open.now->subdivision;
        double gradients[12], volume = 0, minimum = 1;
        for (int32_t t = 0; t < fine.num_tets; t++) {
            const double one = pliant_mesh_gradients(&fine, t, gradients);
            minimum = std::fmin(minimum, one);
            volume += one;
        }
        EXPECT_GT(minimum, 0.1 * subdivision.min_volume);
        EXPECT_NEAR(box[0] * box[1] * box[2] - volume, subdivision.kerf * section, 0.2 * subdivision.kerf * section);
        pliant_surface *seen = nullptr, *before = nullptr;
        ASSERT_EQ(pliant_surface_create(open.now, nullptr, &seen), PLIANT_OK) << pliant_last_error();
        ASSERT_EQ(pliant_surface_create(block.now, nullptr, &before), PLIANT_OK) << pliant_last_error();
        EXPECT_EQ(seen->first_cut, before->first_cut) << "outer faces remain outer faces";
        EXPECT_EQ(seen->num_triangles, before->num_triangles);
        pliant_surface_free(seen);
        pliant_surface_free(before);
    }
}

// The warp draws the scan at rest. After the detached piece moves by whole voxels, it draws the piece's own voxels and
// no others.
TEST(Subdivide, EveryVoxelIsDrawnByTheTetrahedronThatHoldsIt)
{
    Split block(bar());
    const pliant_geometry &scan = block.body->scan.geometry;
    const double point[3] = {0.1041, 0.05, 0.05}, normal[3] = {1, 0.31, -0.17};
    ASSERT_TRUE(block.cut_plane(point, normal));
    pliant_geometry target;
    const double far[3] = {0.25, 0.05, 0.05};
    ASSERT_EQ(pliant_warp_target(&scan, far, 1, 0.002, 1 << 20, &target), PLIANT_OK);
    ASSERT_EQ(target.origin[0], scan.origin[0]);
    for (int d = 1; d < 3; d++) ASSERT_EQ(target.size[d], size[d]);
    auto *voxels = static_cast<uint8_t *>(block.body->scan.voxels);
    for (int v = 0; v < 40 * 20 * 20; v++) voxels[v] = static_cast<uint8_t>(1 + (v * 7919 + v / 40 * 31) % 251);
    block.body->scan.background = 0;
    pliant_warp *warp = nullptr;
    ASSERT_EQ(pliant_warp_create(&block.body->scan, &block.body->model->body->fine, &target, 1, &warp), PLIANT_OK);
    ASSERT_EQ(pliant_warp_update(warp, block.body->model->body->fine.rest), PLIANT_OK);
    ASSERT_EQ(pliant_warp_set_body(warp, block.now), PLIANT_OK);
    ASSERT_EQ(pliant_warp_update(warp, block.now->fine.rest), PLIANT_OK);
    auto drawn = [&](int i, int j, int k) {
        return static_cast<const uint8_t *>(pliant_warp_volume(warp)->voxels)[i + target.size[0] * (j + 20 * k)];
    };
    int other = 0;
    for (int v = 0; v < 40 * 20 * 20; v++) other += drawn(v % 40, v / 40 % 20, v / 800) != voxels[v];
    EXPECT_EQ(other, 0);

    const int shift = 8;
    const std::vector<int32_t> pieces = mesh_pieces(*block.now);
    std::vector<double> moved = block.positions;
    std::set<int32_t> right;
    for (int32_t v = 0; v < 4 * block.now->fine.num_tets; v++)
        if (block.now->fine.rest[3 * block.now->fine.tets[v]] > 0.199) right.insert(pieces[v / 4]);
    ASSERT_EQ(right.size(), 1u);
    for (int32_t v = 0; v < 4 * block.now->fine.num_tets; v++)
        if (right.count(pieces[v / 4]))
            moved[3 * block.now->fine.tets[v]] = block.positions[3 * block.now->fine.tets[v]] + 0.005 * shift;
    ASSERT_EQ(pliant_warp_update(warp, moved.data()), PLIANT_OK);
    std::vector<double> at, weights(4 * 40 * 20 * 20);
    std::vector<int32_t> tet(40 * 20 * 20);
    for (int v = 0; v < 40 * 20 * 20; v++)
        at.insert(at.end(), {0.005 * (v % 40 + 0.5), 0.005 * (v / 40 % 20 + 0.5), 0.005 * (v / 800 + 0.5)});
    pliant_body_locate_points(block.now, block.now->fine.rest, 40 * 20 * 20, at.data(), tet.data(), weights.data());
    auto on_face = [&](int v) {
        return *std::min_element(weights.begin() + 4 * v, weights.begin() + 4 * v + 4) < 1e-6;
    };
    int doubled = 0, none = 0, wrong = 0;
    for (int v = 0; v < 40 * 20 * 20; v++) {
        const int i = v % 40, j = v / 40 % 20, k = v / 800, from = v - shift;
        if (on_face(v)) continue;
        const bool goes = right.count(pieces[tet[v]]) > 0;
        wrong += drawn(i + (goes ? shift : 0), j, k) != voxels[v];
        if (!goes || i < shift || on_face(from)) continue;
        // the other end of the piece now covers its old place
        if (right.count(pieces[tet[from]])) doubled += drawn(i, j, k) != voxels[from];
        else none += drawn(i, j, k) != 0;
    }
    EXPECT_EQ(wrong, 0);
    EXPECT_EQ(doubled, 0);
    EXPECT_EQ(none, 0);
    pliant_warp_free(warp);
}

TEST(Subdivide, UndoReturnsBits)
{
    auto body = uniform([](pliant_scene &scene) { scene.model.gravity[2] = -0.5; });
    body->settle(3);
    const std::vector<double> before(body->data->positions,
                                     body->data->positions + 3 * body->data->body->fine.num_nodes);
    const pliant_body *load = body->data->body;
    const double points[6] = {0.1, -0.01, 0.12, 0.12, 0.11, 0.12}, depth[3] = {0.01, 0, -0.08};
    pliant_cut_report report;
    for (int cut = 0; cut < 2; cut++) {
        ASSERT_EQ(pliant_data_cut(body->model, body->data, 2, points, depth, &report), PLIANT_OK)
            << pliant_last_error();
        EXPECT_GT(report.area, 0.002);
        ASSERT_EQ(pliant_data_undo_cut(body->model, body->data), PLIANT_OK);
        EXPECT_TRUE(pliant_body_same(body->data->body, load));
        EXPECT_EQ(std::memcmp(before.data(), body->data->positions, before.size() * sizeof(double)), 0);
    }
}

TEST(Subdivide, AnEmptySweepCutsNothing)
{
    Split block(bar());
    const double nan = std::nan("");
    EXPECT_FALSE(block.cut({0.1, 0.05, 0.05, 0.1, 0.06, 0.05}, {0.1, 0.05, 0.05, 0.1, 0.06, 0.05})) << "no area";
    EXPECT_FALSE(block.cut({nan, 0, 0, 0.1, nan, 0}, {0.1, 0.1, 0.1, 0.2, 0, 0}));
    EXPECT_FALSE(block.cut({0.5, 0, 0, 0.5, 0.1, 0}, {0.5, 0, 0.1, 0.5, 0.1, 0.1})) << "in air";
    EXPECT_FALSE(block.cut({}, {}));
    const pliant_body *before = block.now;
    EXPECT_FALSE(block.cut({0.1, 0.051, 0.051, 0.1, 0.052, 0.051}, {0.1, 0.051, 0.052, 0.1, 0.052, 0.052}))
        << "smaller than a face";
    EXPECT_EQ(block.now, before);
}

// With `ends`, the blade leaves faces that open when their edges are bisected.
TEST(Subdivide, OutOfMemoryChangesNothing)
{
    Split block(bar());
    const std::vector<double> from = {0.1, 0.042, 0.11, 0.12, 0.11, 0.11}, to = {0.1, 0.042, 0.065, 0.12, 0.11, 0.065};
    const size_t before = pliant_memory_in_use();
    for (const bool ends : {false, true}) {
        const pliant_cut_sweep sweep{2, from.data(), to.data(), block.body->model->material_of_voxel, 0, 1, ends};
        int64_t n = 0;
        for (pliant_status status = PLIANT_ERROR_MEMORY; status != PLIANT_OK; n++) {
            pliant_body *next = nullptr;
            pliant_memory_fail_after(n);
            status = pliant_body_cut(block.now, 2, block.positions.data(), &sweep, &next, nullptr);
            pliant_memory_fail_after(-1);
            ASSERT_TRUE(status == PLIANT_OK || status == PLIANT_ERROR_MEMORY);
            EXPECT_EQ(next != nullptr, status == PLIANT_OK);
            pliant_body_release(next);
            ASSERT_EQ(pliant_memory_in_use(), before) << "allocation " << n;
        }
        EXPECT_GT(n, 40);
    }
}

TEST(Subdivide, ModelsAndCopiesWithoutMemoryLeaveNothing)
{
    auto body = bar();
    const double points[6] = {0.1, 0.04, 0.12, 0.12, 0.11, 0.12}, depth[3] = {0.01, 0, -0.08};
    ASSERT_EQ(pliant_data_cut(body->model, body->data, 2, points, depth, nullptr), PLIANT_OK) << pliant_last_error();
    const size_t before = pliant_memory_in_use();
    const auto fail = [&](const std::function<pliant_status()> &make, const std::function<void()> &release) {
        int failed = 0;
        for (int64_t n = 0;; n += 1 + n / 16) {
            pliant_memory_fail_after(n);
            const pliant_status status = make();
            pliant_memory_fail_after(-1);
            if (status == PLIANT_OK) break;
            ASSERT_EQ(status, PLIANT_ERROR_MEMORY) << n << ": " << pliant_last_error();
            ASSERT_EQ(pliant_memory_in_use(), before) << "allocation " << n;
            failed++;
        }
        EXPECT_GT(failed, 10);
        release();
        EXPECT_EQ(pliant_memory_in_use(), before);
    };
    pliant_data *copy = nullptr;
    fail([&] { return pliant_data_copy(body->model, body->data, &copy); },
         [&] {
             EXPECT_EQ(copy->body->fine.num_nodes, body->data->body->fine.num_nodes);
             pliant_data_free(copy);
         });
    pliant_model *model = nullptr;
    fail([&] { return pliant_model_build(&body->scene, &body->scan, nullptr, &body->table, {}, &model); },
         [&] { pliant_model_free(model); });
}

// Two sides moved apart: rasterization and the fit draw nothing between them. No fit uses nodes of the other side.
// After undo, it is the fit of the whole body.
TEST(Subdivide, AFitDoesNotCrossACut)
{
    Split block(bar());
    pliant_volume &scan = block.body->scan;
    auto *stored = static_cast<uint8_t *>(scan.voxels);
    for (int v = 0; v < 40 * 20 * 20; v++) stored[v] = uint8_t(20 + 2 * (v % 40));
    const pliant_mesh &load = block.body->model->body->fine;
    const double point[3] = {0.097, 0.05, 0.05}, normal[3] = {1, 0.1, 0.2};
    pliant_geometry target;
    const double far[3] = {0.23, 0.1, 0.1};
    scan.background = 0;
    ASSERT_EQ(pliant_warp_target(&scan.geometry, far, 1, 0.002, 1 << 20, &target), PLIANT_OK);
    pliant_warp *warps[3] = {}; // rasterized; fitted before the cut; fitted after the cut
    for (pliant_warp *&warp : warps) ASSERT_EQ(pliant_warp_create(&scan, &load, &target, 1, &warp), PLIANT_OK);
    ASSERT_EQ(pliant_warp_fit(warps[1], 2), PLIANT_OK);
    ASSERT_EQ(pliant_warp_update(warps[1], load.rest), PLIANT_OK);
    const size_t voxels = pliant_geometry_voxels(&target);
    const auto drawn = [&](const pliant_warp *warp) {
        const auto *at = static_cast<const uint8_t *>(pliant_warp_volume(warp)->voxels);
        return std::vector<uint8_t>(at, at + voxels);
    };
    const std::vector<uint8_t> whole = drawn(warps[1]);
    ASSERT_TRUE(block.cut_plane(point, normal));
    ASSERT_EQ(block.report.pieces, 2);
    const std::vector<int32_t> pieces = mesh_pieces(*block.now);
    std::set<int32_t> right;
    for (int32_t v = 0; v < 4 * block.now->fine.num_tets; v++)
        if (block.now->fine.rest[3 * block.now->fine.tets[v]] > 0.199) right.insert(pieces[v / 4]);
    ASSERT_EQ(right.size(), 1u);
    for (int32_t v = 0; v < 4 * block.now->fine.num_tets; v++)
        if (right.count(pieces[v / 4]))
            block.positions[3 * block.now->fine.tets[v]] = block.now->fine.rest[3 * block.now->fine.tets[v]] + 0.02;
    for (pliant_warp *warp : warps) ASSERT_EQ(pliant_warp_set_body(warp, block.now), PLIANT_OK) << pliant_last_error();
    ASSERT_EQ(pliant_warp_fit(warps[2], 2), PLIANT_OK);
    for (pliant_warp *warp : warps)
        ASSERT_EQ(pliant_warp_update(warp, block.positions.data()), PLIANT_OK) << pliant_last_error();
    const std::vector<uint8_t> flat = drawn(warps[0]), fitted = drawn(warps[1]);
    EXPECT_TRUE(fitted == drawn(warps[2]));
    int apart = 0, open = 0;
    for (int k = 2; k < 18; k++)
        for (int j = 2; j < 18; j++)
            for (int i = 2; i < 42; i++) { // the hull of a fit extends one voxel further
                const size_t v = static_cast<size_t>(i) +
                                 static_cast<size_t>(target.size[0]) * static_cast<size_t>(j + target.size[1] * k);
                apart += std::abs(int(flat[v]) - int(fitted[v])) > 1;
                open += flat[v] == 0;
            }
    EXPECT_GT(open, 700);
    EXPECT_EQ(apart, 0);
    ASSERT_EQ(pliant_warp_set_body(warps[1], block.body->model->body), PLIANT_OK);
    ASSERT_EQ(pliant_warp_update(warps[1], load.rest), PLIANT_OK);
    EXPECT_TRUE(drawn(warps[1]) == whole);
    for (pliant_warp *warp : warps) pliant_warp_free(warp);
}

TEST(Subdivide, UnsupportedOptionsAreRefused)
{
    const std::function<void(pliant_scene &)> others[] = {
        [](pliant_scene &scene) {
            scene.model.method = PLIANT_AVERAGED;
            scene.mesh.ratio = 2;
        },
        [](pliant_scene &scene) { scene.model.method = PLIANT_COARSE; },
        [](pliant_scene &scene) { scene.mesh.kind = PLIANT_OCTREE; },
        [](pliant_scene &scene) { scene.element.kind = PLIANT_HEXAHEDRA; },
    };
    for (const auto &set : others) {
        Body body(size, box, {{4000, 0.4, 1000, false}});
        body.cells(8, 4, 4, 1);
        body.scene.cut.kind = PLIANT_CUT_SUBDIVIDE;
        set(body.scene);
        EXPECT_EQ(body.build(), PLIANT_ERROR_SCENE);
        EXPECT_NE(std::string(pliant_last_error()).find("cut/kind"), std::string::npos) << pliant_last_error();
    }
}

} // namespace
