// Tests of the octree mesh over random label fields: faces, volumes, orientation, quality, balance, point location and
// materials.
#include "base/memory.h"
#include "mesh/mesh.h"
#include "mesh/octree.h"
#include "pipeline/body.h"

#include <algorithm>
#include <array>
#include <map>
#include <set>
#include <random>

namespace {

// Return the lattice node of a corner, middle or centre of a cube. halves: in steps of half its size.
int32_t lattice_node(const int32_t cells[3], const int32_t origin[3], int32_t size, const int32_t halves[3])
{
    int32_t at[3];
    for (int d = 0; d < 3; d++) at[d] = origin[d] + halves[d] * size / 2;
    return pliant_octree_node(cells, at);
}

struct Field {
    pliant_geometry geometry{};
    std::vector<uint8_t> material;
    std::vector<pliant_material> records;
    pliant_material_table table{};
    pliant_mesh mesh{};
    pliant_tet_material *materials = nullptr;

    Field(std::array<int, 3> size, bool left_handed = false)
    {
        for (int d = 0; d < 3; d++) {
            geometry.size[d] = size[static_cast<size_t>(d)];
            geometry.spacing[d] = 0.001 * (d + 1);
            geometry.direction[4 * d] = d == 2 && left_handed ? -1 : 1;
        }
        material.assign(static_cast<size_t>(size[0] * size[1] * size[2]), 1);
        for (int m = 0; m < 4; m++) {
            pliant_material record{};
            record.young_modulus = 1000 * (m + 1);
            record.poisson_ratio = 0.3;
            record.density = 900 + 100 * m;
            record.empty = m == 0;
            records.push_back(record);
        }
        table.materials = records.data();
        table.num_materials = 4;
    }
    ~Field()
    {
        pliant_mesh_free(&mesh);
        pliant_free(materials);
    }
    bool hexahedra = false;
    pliant_status build(std::array<int32_t, 3> roots, int depth, double purity = 1, bool keep_air = false)
    {
        pliant_mesh_free(&mesh);
        pliant_free(materials);
        materials = nullptr;
        return pliant_mesh_octree(&geometry, roots.data(), depth, purity, keep_air, hexahedra, material.data(), &table,
                                  &mesh, &materials);
    }
    // Scatter balls and single voxels of random materials.
    void scatter(unsigned seed)
    {
        std::mt19937 random(seed);
        const int32_t *s = geometry.size;
        for (int ball = 0; ball < 5; ball++) {
            int at[3], radius = 1 + static_cast<int>(random() % 6), which = static_cast<int>(random() % 4);
            for (int d = 0; d < 3; d++) at[d] = static_cast<int>(random() % static_cast<unsigned>(s[d]));
            for (int v = 0; v < s[0] * s[1] * s[2]; v++) {
                int x = v % s[0] - at[0], y = v / s[0] % s[1] - at[1], z = v / s[0] / s[1] - at[2];
                if (x * x + y * y + z * z < radius * radius)
                    material[static_cast<size_t>(v)] = static_cast<uint8_t>(which);
            }
        }
        for (int voxel = 0; voxel < 3; voxel++)
            material[random() % material.size()] = static_cast<uint8_t>(random() % 4);
    }
};

double volume_of(const pliant_mesh &mesh, int32_t t)
{
    double g[12];
    return pliant_mesh_gradients(&mesh, t, g);
}

// Quality 12 (3 V)^(2/3) / (sum of squared edges), which is 1 for a regular tetrahedron (Liu and Joe 1994).
double quality_of(const pliant_mesh &mesh, int32_t t)
{
    const int32_t *n = mesh.tets + 4 * t;
    double sum = 0;
    for (int a = 0; a < 4; a++)
        for (int b = 0; b < a; b++)
            for (int d = 0; d < 3; d++) sum += std::pow(mesh.rest[3 * n[a] + d] - mesh.rest[3 * n[b] + d], 2);
    return 12 * std::pow(3 * volume_of(mesh, t), 2.0 / 3) / sum;
}

using Face = std::array<int32_t, 3>;

// Return all faces with the number of their tetrahedra.
std::map<Face, int> faces_of(const pliant_mesh &mesh)
{
    std::map<Face, int> faces;
    for (int32_t t = 0; t < mesh.num_tets; t++)
        for (int c = 0; c < 4; c++) {
            Face face;
            for (int v = 0, n = 0; v < 4; v++)
                if (v != c) face[static_cast<size_t>(n++)] = mesh.tets[4 * t + v];
            std::sort(face.begin(), face.end());
            faces[face]++;
        }
    return faces;
}

TEST(Octree, IsConformingOverRandomFields)
{
    for (unsigned seed = 0; seed < 24; seed++) {
        Field field({32, 24, 16}, seed % 2 == 1);
        for (int d = 0; d < 3; d++) field.geometry.spacing[d] = 0.001; // cubes
        field.scatter(seed);
        int depth = 1 + static_cast<int>(seed % 3);
        std::array<int32_t, 3> roots{4, 3, 2};
        ASSERT_EQ(field.build(roots, depth, 1, true), PLIANT_OK) << pliant_last_error();
        // Two tetrahedra share each inner face. A face of one tetrahedron lies on the box, so there are no hanging
        // nodes.
        double volume = 0, box = 0.032 * 0.024 * 0.016, worst = 1;
        const double low[3] = {-0.0005, -0.0005, seed % 2 ? -0.0155 : -0.0005},
                     high[3] = {0.0315, 0.0235, seed % 2 ? 0.0005 : 0.0155};
        for (int32_t t = 0; t < field.mesh.num_tets; t++) {
            ASSERT_GT(volume_of(field.mesh, t), 0);
            volume += volume_of(field.mesh, t);
            worst = std::fmin(worst, quality_of(field.mesh, t));
        }
        EXPECT_NEAR(volume, box, 1e-12 * box);
        EXPECT_GT(worst, 0.45) << seed;
        for (const auto &face : faces_of(field.mesh)) {
            ASSERT_LE(face.second, 2);
            if (face.second == 2) continue;
            bool outside = false;
            for (int d = 0; d < 3; d++) {
                bool lower = true, upper = true;
                for (int32_t n : face.first) {
                    lower = lower && std::fabs(field.mesh.rest[3 * n + d] - low[d]) < 1e-9;
                    upper = upper && std::fabs(field.mesh.rest[3 * n + d] - high[d]) < 1e-9;
                }
                outside = outside || lower || upper;
            }
            ASSERT_TRUE(outside) << "seed " << seed << ": a face inside belongs to one tetrahedron only";
        }
    }
}

TEST(Octree, WithoutAirNothingOverlapsAndTheSurfaceIsClosed)
{
    for (unsigned seed = 100; seed < 112; seed++) {
        Field field({32, 24, 16});
        field.scatter(seed);
        ASSERT_EQ(field.build({4, 3, 2}, 2), PLIANT_OK) << pliant_last_error();
        // With a hanging node, some edges of the surface would have an odd number of faces.
        std::map<std::array<int32_t, 2>, int> edges;
        for (const auto &face : faces_of(field.mesh)) {
            ASSERT_LE(face.second, 2);
            if (face.second == 2) continue;
            for (int e = 0; e < 3; e++) {
                int32_t a = face.first[static_cast<size_t>(e)], b = face.first[static_cast<size_t>((e + 1) % 3)];
                edges[{std::min(a, b), std::max(a, b)}]++;
            }
        }
        for (const auto &edge : edges) ASSERT_EQ(edge.second % 2, 0) << seed;
        for (int32_t t = 0; t < field.mesh.num_tets; t++) ASSERT_GT(volume_of(field.mesh, t), 0);
    }
}

TEST(Octree, NeighboursDifferByOneLevelAtMost)
{
    Field field({64, 64, 64});
    field.material[32 + 64 * (32 + 64 * 32)] = 2; // one voxel in the middle
    const int32_t roots[3] = {2, 2, 2};
    pliant_octree tree{};
    ASSERT_EQ(pliant_octree_create(roots, 5, 1, &field.geometry, field.material.data(), &tree), PLIANT_OK);
    int smallest = 0;
    for (int32_t leaf = 0; leaf < tree.num_leaves; leaf++) smallest += tree.level[leaf] == 5;
    EXPECT_EQ(smallest, 8); // the voxel's cell and its seven siblings
    const int32_t *cells = tree.cells[5];
    for (int32_t c = 0; c < cells[2]; c++)
        for (int32_t b = 0; b < cells[1]; b++)
            for (int32_t a = 0; a < cells[0]; a++)
                for (int n = 0; n < 27; n++) {
                    int32_t step[3] = {n % 3 - 1, n / 3 % 3 - 1, n / 9 - 1}, at[3] = {a, b, c}, adjacent[3];
                    bool inside = true;
                    for (int d = 0; d < 3; d++) {
                        adjacent[d] = at[d] + step[d];
                        inside = inside && adjacent[d] >= 0 && adjacent[d] < cells[d];
                    }
                    if (!inside || (step[0] && step[1] && step[2])) continue;
                    int own = tree.level[tree.leaf_of_cell[pliant_octree_flat(&tree, 5, at)]];
                    int other = tree.level[tree.leaf_of_cell[pliant_octree_flat(&tree, 5, adjacent)]];
                    ASSERT_LE(std::abs(own - other), 1);
                }
    pliant_octree_free(&tree);
}

// For hexahedra: a node in the middle of a larger leaf's edge or face is constrained to its corners.
// None of these corners is constrained itself.
TEST(Octree, NoNodeFollowsOneThatFollows)
{
    size_t followers = 0;
    for (unsigned seed = 0; seed < 12; seed++) {
        Field field({32, 32, 32});
        field.scatter(seed);
        const int32_t roots[3] = {2, 2, 2};
        pliant_octree tree{};
        ASSERT_EQ(pliant_octree_create(roots, 4, 1, &field.geometry, field.material.data(), &tree), PLIANT_OK);
        const int32_t *cells = tree.cells[4];
        std::map<int32_t, std::set<int32_t>> follows;
        std::set<int32_t> corners;
        for (int pass = 0; pass < 2; pass++)
            for (int32_t leaf = 0; leaf < tree.num_leaves; leaf++) {
                const int32_t size = 1 << (4 - tree.level[leaf]);
                for (int i = 0; i < 27; i++) {
                    const int32_t halves[3] = {i % 3, i / 3 % 3, i / 9},
                                  middles = (halves[0] == 1) + (halves[1] == 1) + (halves[2] == 1);
                    if (size == 1 ? middles > 0 : middles == 3) continue;
                    const int32_t node = lattice_node(cells, tree.origin[leaf], size, halves);
                    if (pass == 0 && middles == 0) corners.insert(node);
                    if (pass == 0 || middles == 0 || !corners.count(node)) continue;
                    for (int v = 0; v < 8; v++) {
                        int32_t end[3];
                        for (int d = 0; d < 3; d++) end[d] = halves[d] == 1 ? 2 * (v >> d & 1) : halves[d];
                        follows[node].insert(lattice_node(cells, tree.origin[leaf], size, end));
                    }
                }
            }
        for (const auto &one : follows) {
            followers++;
            ASSERT_TRUE(one.second.size() == 2 || one.second.size() == 4);
            for (int32_t other : one.second) ASSERT_EQ(follows.count(other), 0u) << seed;
        }
        pliant_octree_free(&tree);
    }
    EXPECT_GT(followers, 1000u);
}

TEST(Octree, DepthZeroIsTheLattice)
{
    Field field({20, 15, 10});
    field.scatter(5);
    const int32_t cells[3] = {5, 4, 3};
    ASSERT_EQ(field.build({5, 4, 3}, 0, 1, true), PLIANT_OK);
    pliant_mesh lattice{};
    ASSERT_EQ(pliant_mesh_grid(&field.geometry, cells, nullptr, &lattice), PLIANT_OK);
    ASSERT_EQ(field.mesh.num_tets, lattice.num_tets);
    ASSERT_EQ(field.mesh.num_nodes, lattice.num_nodes);
    EXPECT_TRUE(std::equal(lattice.tets, lattice.tets + 4 * lattice.num_tets, field.mesh.tets));
    EXPECT_TRUE(std::equal(lattice.rest, lattice.rest + 3 * lattice.num_nodes, field.mesh.rest));
    pliant_mesh_free(&lattice);
}

TEST(Octree, LeavesHoldTheirMaterialAndPointsTheirLeaf)
{
    Field field({32, 32, 32});
    for (int v = 0; v < 32 * 32 * 32; v++)
        field.material[static_cast<size_t>(v)] = v % 32 < 8 ? 2 : v % 32 < 21 ? 3 : 1;
    ASSERT_EQ(field.build({4, 4, 4}, 2), PLIANT_OK);
    std::mt19937 random(1);
    std::uniform_real_distribution<double> part(0, 1);
    int found[4] = {0, 0, 0, 0};
    for (int n = 0; n < 2000; n++) {
        double point[3], weights[4], sum = 0;
        for (int d = 0; d < 3; d++) point[d] = 0.001 * (d + 1) * (32 * part(random) - 0.5);
        int32_t tet = pliant_mesh_locate(&field.mesh, point, weights);
        ASSERT_GE(tet, 0);
        for (int d = 0; d < 3; d++) {
            sum = 0;
            for (int v = 0; v < 4; v++) sum += weights[v] * field.mesh.rest[3 * field.mesh.tets[4 * tet + v] + d];
            EXPECT_NEAR(sum, point[d], 1e-12);
        }
        int voxel = static_cast<int>(point[0] / 0.001 + 0.5), expected = voxel < 8 ? 2 : voxel < 21 ? 3 : 1;
        if (voxel == 20 || voxel == 21) continue; // the boundary cuts a smallest cell
        EXPECT_EQ(field.materials[tet].material, expected);
        EXPECT_NEAR(field.materials[tet].density, 900 + 100 * expected, 1e-9);
        found[expected]++;
    }
    EXPECT_GT(found[1] * found[2] * found[3], 0);
}

TEST(Octree, RefusesAndRunsOutOfMemoryCleanly)
{
    Field field({16, 16, 16});
    field.scatter(9);
    EXPECT_EQ(field.build({4, 4, 4}, 7), PLIANT_ERROR_ARGUMENT);
    EXPECT_EQ(field.build({0, 4, 4}, 1), PLIANT_ERROR_ARGUMENT);
    EXPECT_EQ(field.build({256, 256, 256}, 2), PLIANT_ERROR_SCENE);
    size_t held = pliant_memory_in_use();
    for (int calls = 0;; calls++) {
        ASSERT_LT(calls, 100);
        pliant_memory_fail_after(calls);
        pliant_status status = field.build({4, 4, 4}, 2);
        pliant_memory_fail_after(-1);
        if (status == PLIANT_OK) break;
        ASSERT_EQ(status, PLIANT_ERROR_MEMORY);
        ASSERT_EQ(pliant_memory_in_use(), held) << calls;
    }
    std::fill(field.material.begin(), field.material.end(), 0);
    EXPECT_EQ(field.build({4, 4, 4}, 2), PLIANT_ERROR_SCENE);
}

// The whole simulation on an octree mesh, with both solvers, and a patch test.
TEST(Octree, BendsLikeTheLatticeOfItsSmallestCells)
{
    const int size[3] = {16, 16, 32};
    const double box[3] = {0.04, 0.04, 0.08};
    double deflection[3];
    for (int way = 0; way < 3; way++) {
        Body body(size, box, {{5e3, 0.3, 1000, false}, {2e4, 0.3, 1000, false}},
                  [](int i, int, int k) { return i < 6 && k < 10; });
        body.fix_plane(0, 0, 1e-6, 0, 0, 1);
        body.scene.model.gravity[0] = 1;
        body.scene.solver.iterations = 20;
        if (way == 0) {
            body.cells(8, 8, 16, 1);
        } else {
            body.cells(2, 2, 4, 1);
            body.scene.mesh.kind = PLIANT_OCTREE;
            body.scene.mesh.depth = 2;
        }
        if (way == 2) {
            body.scene.solver.kind = PLIANT_TLED;
            body.scene.tled.quasi_static = true;
            body.scene.tled.relaxation_steps = 4000;
            body.scene.solver.tolerance = 1e-3;
        } else {
            body.scene.solver.tolerance = 1e-6;
        }
        ASSERT_EQ(body.build(), PLIANT_OK) << pliant_last_error();
        ASSERT_EQ(body.settle(), PLIANT_OK) << body.data->statistics.residual;
        double weights[4];
        const double tip[3] = {0.0201, 0.0202, 0.0799};
        int32_t tet = pliant_mesh_locate(&body.model->body->fine, tip, weights);
        ASSERT_GE(tet, 0);
        deflection[way] = -tip[0];
        for (int v = 0; v < 4; v++)
            deflection[way] += weights[v] * body.data->positions[3 * body.model->body->fine.tets[4 * tet + v]];
    }
    EXPECT_NEAR(deflection[1], deflection[0], 0.25 * deflection[0]); // large cells bend less
    EXPECT_NEAR(deflection[2], deflection[1], 0.05 * deflection[1]); // another strain energy
    Body body(size, box, {{5e3, 0.3, 1000, false}});
    body.scene.mesh.kind = PLIANT_OCTREE;
    body.scene.model.method = PLIANT_AVERAGED;
    EXPECT_EQ(body.build(), PLIANT_ERROR_SCENE);
}

} // namespace
