// Tests of the lattice mesh: orientation, volume, nesting, conformity, point location, integration, faces and pieces.
#include "base/memory.h"
#include "mesh/mesh.h"

#include <gtest/gtest.h>

#include <cmath>
#include <cstring>
#include <map>
#include <random>
#include <set>
#include <vector>

namespace {

pliant_geometry geometry_of(bool flipped)
{
    pliant_geometry g{};
    const int size[3] = {24, 30, 18};
    const double spacing[3] = {0.002, 0.0015, 0.003}, origin[3] = {-0.02, 0.01, 0.3}, angle = 0.4;
    const double direction[9] = {std::cos(angle),     -std::sin(angle), 0, std::sin(angle), std::cos(angle), 0, 0, 0,
                                 flipped ? -1.0 : 1.0};
    for (int d = 0; d < 3; d++) {
        g.size[d] = size[d];
        g.spacing[d] = spacing[d];
        g.origin[d] = origin[d];
    }
    std::memcpy(g.direction, direction, sizeof direction);
    return g;
}

double volume_of(const pliant_mesh &mesh, int32_t t)
{
    double g[12];
    return pliant_mesh_gradients(&mesh, t, g);
}

class Grid : public testing::TestWithParam<bool> {
protected:
    pliant_geometry geometry = geometry_of(GetParam());
    pliant_mesh mesh{};
    void make(int a, int b, int c, const uint8_t *keep = nullptr)
    {
        const int32_t cells[3] = {a, b, c};
        pliant_mesh_free(&mesh);
        ASSERT_EQ(pliant_mesh_grid(&geometry, cells, keep, &mesh), PLIANT_OK) << pliant_last_error();
    }
    ~Grid() override { pliant_mesh_free(&mesh); }
};

TEST_P(Grid, PositiveAndFillsTheBox)
{
    make(4, 5, 3);
    double sum = 0;
    for (int32_t t = 0; t < mesh.num_tets; t++) {
        EXPECT_GT(volume_of(mesh, t), 0);
        sum += volume_of(mesh, t);
    }
    EXPECT_NEAR(sum, 24 * 30 * 18 * 0.002 * 0.0015 * 0.003, 1e-12);
    EXPECT_EQ(mesh.num_tets, 300);
    EXPECT_EQ(mesh.num_nodes, 5 * 6 * 4);
}

TEST_P(Grid, EveryInteriorFaceHasTwoSides)
{
    make(4, 5, 3);
    std::map<std::set<int32_t>, int> faces;
    for (int32_t t = 0; t < mesh.num_tets; t++)
        for (int c = 0; c < 4; c++) {
            std::set<int32_t> face;
            for (int v = 0; v < 4; v++)
                if (v != c) face.insert(mesh.tets[4 * t + v]);
            faces[face]++;
        }
    int outside = 0;
    for (const auto &face : faces) {
        EXPECT_LE(face.second, 2);
        outside += face.second == 1;
    }
    EXPECT_EQ(outside, 4 * (4 * 5 + 5 * 3 + 4 * 3)); // two triangles per square, two sides
    int32_t *triangles = nullptr, count = 0;
    ASSERT_EQ(pliant_mesh_surface(&mesh, nullptr, nullptr, &triangles, &count), PLIANT_OK);
    EXPECT_EQ(count, outside);
    // Triangles point outwards: by the divergence theorem, the surface encloses the volume of the body.
    double volume = 0;
    for (int32_t t = 0; t < count; t++) {
        const double *a = mesh.rest + 3 * triangles[3 * t], *b = mesh.rest + 3 * triangles[3 * t + 1],
                     *c = mesh.rest + 3 * triangles[3 * t + 2];
        for (int d = 0; d < 3; d++)
            volume += a[d] * (b[(d + 1) % 3] * c[(d + 2) % 3] - b[(d + 2) % 3] * c[(d + 1) % 3]) / 6;
    }
    EXPECT_NEAR(volume, 24 * 30 * 18 * 0.002 * 0.0015 * 0.003, 1e-12);
    pliant_free(triangles);
}

TEST_P(Grid, NestsAtEveryRatio)
{
    make(2, 3, 2);
    pliant_mesh coarse = mesh;
    std::memset(&mesh, 0, sizeof mesh);
    for (int ratio = 2; ratio <= 5; ratio++) {
        make(2 * ratio, 3 * ratio, 2 * ratio);
        // Every corner of a fine tetrahedron lies in the coarse tetrahedron around its centroid.
        for (int32_t t = 0; t < mesh.num_tets; t++) {
            double centre[3] = {0, 0, 0}, w[4];
            for (int v = 0; v < 4; v++)
                for (int d = 0; d < 3; d++) centre[d] += 0.25 * mesh.rest[3 * mesh.tets[4 * t + v] + d];
            int32_t holder = pliant_mesh_locate(&coarse, centre, w);
            ASSERT_GE(holder, 0);
            const int32_t *n = coarse.tets + 4 * holder;
            double g[12];
            pliant_mesh_gradients(&coarse, holder, g);
            for (int v = 0; v < 4; v++)
                for (int c = 0; c < 4; c++) {
                    double fraction = c == 0;
                    for (int d = 0; d < 3; d++)
                        fraction +=
                            g[3 * c + d] * (mesh.rest[3 * mesh.tets[4 * t + v] + d] - coarse.rest[3 * n[0] + d]);
                    ASSERT_GT(fraction, -1e-9) << "ratio " << ratio;
                }
        }
    }
    pliant_mesh_free(&coarse);
}

TEST_P(Grid, LocatesWhatItHolds)
{
    make(4, 5, 3);
    std::mt19937 random(3);
    std::uniform_real_distribution<double> uniform(0.0, 1.0);
    for (int n = 0; n < 500; n++) {
        int32_t t = static_cast<int32_t>(random() % static_cast<unsigned>(mesh.num_tets));
        double w[4], sum = 0, point[3] = {0, 0, 0}, found[4];
        for (double &x : w) sum += x = 0.01 + uniform(random);
        for (int v = 0; v < 4; v++)
            for (int d = 0; d < 3; d++) point[d] += w[v] / sum * mesh.rest[3 * mesh.tets[4 * t + v] + d];
        ASSERT_EQ(pliant_mesh_locate(&mesh, point, found), t);
        for (int v = 0; v < 4; v++) EXPECT_NEAR(found[v], w[v] / sum, 1e-9);
        ASSERT_EQ(pliant_mesh_locate_deformed(&mesh, mesh.rest, point, found), t);
    }
    const double outside[3] = {1, 1, 1}, nan[3] = {NAN, 0, 0};
    double w[4];
    EXPECT_EQ(pliant_mesh_locate(&mesh, outside, w), -1);
    EXPECT_EQ(pliant_mesh_locate(&mesh, nan, w), -1);
    EXPECT_EQ(pliant_mesh_locate_deformed(&mesh, mesh.rest, nan, w), -1);
}

TEST_P(Grid, EveryVoxelCountsOnce)
{
    const int32_t cells[3] = {4, 5, 3};
    std::vector<uint8_t> voxels(pliant_geometry_voxels(&geometry));
    for (size_t n = 0; n < voxels.size(); n++) voxels[n] = n % 3 == 0;
    std::vector<pliant_material> materials(2);
    std::memset(materials.data(), 0, sizeof(pliant_material) * 2);
    materials[0].young_modulus = 1000;
    materials[1].young_modulus = 4000;
    materials[0].density = 900;
    materials[1].density = 1800;
    materials[0].empty = true;
    pliant_material_table table{materials.data(), 2};
    std::vector<pliant_tet_material> out(300);
    ASSERT_EQ(pliant_lattice_integrate(&geometry, cells, voxels.data(), &table, out.data()), PLIANT_OK);
    size_t total = 0;
    double mass = 0, tissue = 0;
    for (const auto &tet : out) {
        total += tet.num_voxels;
        mass += tet.density * tet.num_voxels;
        tissue += tet.tissue * tet.num_voxels;
        EXPECT_NEAR(tet.mu, 0.5 * (1000 + 3000 * tet.tissue), 1e-2); // nu = 0: mu = E / 2
    }
    EXPECT_EQ(total, voxels.size());
    EXPECT_NEAR(mass / total, 900 + 900 / 3.0, 1e-6);
    EXPECT_NEAR(tissue / total, 1 / 3.0, 1e-6);
}

TEST_P(Grid, LoosePiecesAreHeld)
{
    std::vector<uint8_t> keep(300, 1);
    // a gap of cells (a = 2) cuts the box in two
    for (int cell = 0; cell < 60; cell++)
        if (cell % 4 == 2)
            for (int slot = 0; slot < 5; slot++) keep[5 * cell + slot] = 0;
    make(4, 5, 3, keep.data());
    std::vector<uint8_t> fixed(mesh.num_nodes), loose(mesh.num_tets);
    int32_t pieces = -1;
    EXPECT_EQ(pliant_mesh_fix_loose_pieces(&mesh, nullptr, 1, true, fixed.data(), loose.data(), &pieces),
              PLIANT_ERROR_SCENE);
    for (int32_t n = 0; n < mesh.num_nodes; n++) fixed[n] = mesh.lattice_of_node[n] % 5 == 0; // the plane a = 0
    std::vector<uint8_t> before = fixed;
    ASSERT_EQ(pliant_mesh_fix_loose_pieces(&mesh, nullptr, 1, true, fixed.data(), loose.data(), &pieces), PLIANT_OK)
        << pliant_last_error();
    EXPECT_EQ(pieces, 1);
    for (int32_t t = 0; t < mesh.num_tets; t++) EXPECT_EQ(loose[t], mesh.lattice_of_tet[t] / 5 % 4 == 3);
    for (int32_t n = 0; n < mesh.num_nodes; n++) EXPECT_EQ(fixed[n], before[n] || mesh.lattice_of_node[n] % 5 >= 3);
}

TEST_P(Grid, FailingAllocationsLeaveNothing)
{
    const int32_t cells[3] = {3, 3, 3};
    size_t before = pliant_memory_in_use();
    for (int n = 0;; n++) {
        pliant_mesh out{};
        pliant_memory_fail_after(n);
        pliant_status status = pliant_mesh_grid(&geometry, cells, nullptr, &out);
        pliant_memory_fail_after(-1);
        if (status == PLIANT_OK) {
            pliant_mesh_free(&out);
            break;
        }
        EXPECT_EQ(status, PLIANT_ERROR_MEMORY);
        EXPECT_EQ(out.rest, nullptr);
        EXPECT_EQ(pliant_memory_in_use(), before);
        ASSERT_LT(n, 100);
    }
    EXPECT_EQ(pliant_memory_in_use(), before);
}

INSTANTIATE_TEST_SUITE_P(RightAndLeftHanded, Grid, testing::Bool());

} // namespace
