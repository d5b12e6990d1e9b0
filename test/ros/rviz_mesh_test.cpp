// Drawn mesh: checks, matching of states, faces of a cut.
#include "rviz/mesh_shape.h"

#include "pliant/scene.h"

#include <gtest/gtest.h>

#include <cmath>
#include <limits>

using namespace pliant_rviz;

namespace {

// Cubes in a row along x, five tetrahedra each; corner 0 is central in even ones.
Topology row(uint32_t cubes)
{
    Topology topology;
    topology.scan_id = "row";
    topology.revision = 3;
    for (uint32_t i = 0; i <= cubes; i++)
        for (uint32_t n = 0; n < 4; n++) {
            topology.rest.insert(topology.rest.end(), {float(i), float(n & 1), float(n >> 1)});
            topology.rest_parent.push_back(4 * i + n);
        }
    const int even[5][4] = {{0, 3, 5, 6}, {1, 0, 3, 5}, {2, 3, 0, 6}, {4, 5, 0, 6}, {7, 3, 5, 6}};
    const int odd[5][4] = {{1, 2, 4, 7}, {0, 1, 2, 4}, {3, 2, 1, 7}, {5, 1, 4, 7}, {6, 4, 2, 7}};
    for (uint32_t c = 0; c < cubes; c++)
        for (const auto &corners : c % 2 ? odd : even) {
            std::array<uint32_t, 4> tet;
            // bits of a corner: 0: x, 1: y, 2: z
            for (size_t v = 0; v < 4; v++)
                tet[v] =
                    4 * (c + uint32_t(corners[v] & 1)) + uint32_t(corners[v] >> 1 & 1) + 2 * uint32_t(corners[v] >> 2);
            const float *x[4];
            for (size_t v = 0; v < 4; v++) x[v] = &topology.rest[3 * tet[v]];
            double a[3][3], det = 0;
            for (size_t v = 0; v < 3; v++)
                for (size_t d = 0; d < 3; d++) a[v][d] = x[v + 1][d] - x[0][d];
            for (size_t d = 0; d < 3; d++)
                det += a[0][d] * (a[1][(d + 1) % 3] * a[2][(d + 2) % 3] - a[1][(d + 2) % 3] * a[2][(d + 1) % 3]);
            if (det < 0) std::swap(tet[0], tet[1]);
            topology.tetrahedra.insert(topology.tetrahedra.end(), tet.begin(), tet.end());
            topology.material.push_back(uint16_t(c));
        }
    return topology;
}

// Return the surface integral of x . n / 3: the enclosed volume if the faces are closed and oriented outwards.
double volume_inside(const Shape &shape)
{
    double sum = 0;
    for (size_t n = 0; n < shape.triangles.size(); n += 3) {
        const float *a = &shape.vertices[3 * shape.triangles[n]], *b = &shape.vertices[3 * shape.triangles[n + 1]],
                    *c = &shape.vertices[3 * shape.triangles[n + 2]];
        for (size_t d = 0; d < 3; d++)
            sum += a[d] * (b[(d + 1) % 3] * c[(d + 2) % 3] - b[(d + 2) % 3] * c[(d + 1) % 3]) / 6.0;
    }
    return sum;
}

TEST(TopologyCheck, NamesTheProblem)
{
    Topology good = row(2);
    EXPECT_EQ(check(good), "");
    auto broken = [&](void (*breaks)(Topology &), const char *word) {
        Topology topology = good;
        breaks(topology);
        EXPECT_NE(check(topology).find(word), std::string::npos) << word << ": " << check(topology);
    };
    broken([](Topology &t) { t.rest.clear(); }, "rest_nodes");
    broken([](Topology &t) { t.rest.pop_back(); }, "rest_nodes");
    broken([](Topology &t) { t.rest[4] = std::numeric_limits<float>::quiet_NaN(); }, "NaN");
    broken([](Topology &t) { t.tetrahedra.pop_back(); }, "multiple of 4");
    broken([](Topology &t) { t.tetrahedra[2] = 12; }, "there are 12");
    broken([](Topology &t) { t.triangles = {0, 1}; }, "multiple of 3");
    broken([](Topology &t) { t.triangles = {0, 1, 4000000000u}; }, "triangles");
    broken([](Topology &t) { t.rest_parent.pop_back(); }, "rest_parent");
    broken([](Topology &t) { t.rest_parent[0] = 99; }, "rest_parent");
    broken([](Topology &t) { t.material.pop_back(); }, "material");
    broken([](Topology &t) { t.vertex_tetrahedron = {10}; }, "vertex_tetrahedron");
    broken([](Topology &t) { t.vertex_tetrahedron = {0}; }, "vertex_weight");
    broken([](Topology &t) { t.vertex_tetrahedron = {0}, t.vertex_weight = {1, 0, 0, 0}; }, "vertex_material");
    broken([](Topology &t) { t.triangles = {0, 1, 12}; }, "there are 12");
}

TEST(MeshShape, StatesThatDoNotMatchAreDropped)
{
    MeshShape mesh;
    Topology topology = row(2);
    std::vector<float> moved = topology.rest, short_one(33, 0.0f), bad = topology.rest;
    for (float &x : moved) x += 1;
    bad[5] = std::numeric_limits<float>::infinity();
    EXPECT_EQ(mesh.put(3, moved, {}), MeshShape::NO_TOPOLOGY);
    mesh.start(topology);
    EXPECT_EQ(mesh.put(2, moved, {}), MeshShape::OTHER_REVISION);
    EXPECT_EQ(mesh.put(3, short_one, {}), MeshShape::WRONG_SIZE);
    EXPECT_EQ(mesh.put(3, moved, {1, 2, 3}), MeshShape::WRONG_SIZE);
    EXPECT_EQ(mesh.put(3, bad, {}), MeshShape::NOT_FINITE);
    EXPECT_EQ(mesh.nodes(), topology.rest) << "dropped states change nothing";
    EXPECT_EQ(mesh.put(3, moved, {}), MeshShape::SHOWN);
    EXPECT_EQ(mesh.nodes(), moved);
}

TEST(MeshShape, NodesStayWhereTheirParentsWereAfterACut)
{
    MeshShape mesh;
    Topology topology = row(1);
    mesh.start(topology);
    std::vector<float> moved = topology.rest;
    for (float &x : moved) x *= 2;
    mesh.put(3, moved, {});
    // node 5 is split: the new node 8 is at its position
    Topology cut = topology;
    cut.revision = 4;
    cut.rest.insert(cut.rest.end(), topology.rest.begin() + 15, topology.rest.begin() + 18);
    cut.rest_parent.push_back(5);
    mesh.start(cut);
    ASSERT_EQ(mesh.nodes().size(), 27u);
    for (size_t n = 0; n < 24; n++) EXPECT_EQ(mesh.nodes()[n], moved[n]);
    for (size_t d = 0; d < 3; d++) EXPECT_EQ(mesh.nodes()[24 + d], moved[15 + d]);
    // the copy has moved; the next cut keeps its position
    moved = mesh.nodes();
    for (size_t d = 0; d < 3; d++) moved[24 + d] += 1;
    std::vector<float> scalar(9, 2);
    scalar[8] = 5;
    mesh.put(4, moved, scalar);
    Topology next = cut;
    next.revision = 5;
    next.rest.insert(next.rest.end(), topology.rest.begin(), topology.rest.begin() + 3);
    next.rest_parent.push_back(0);
    mesh.start(next);
    for (size_t d = 0; d < 3; d++) EXPECT_EQ(mesh.nodes()[24 + d], moved[24 + d]);
    ASSERT_EQ(mesh.scalar().size(), 10u) << "colours stay, too";
    EXPECT_EQ(mesh.scalar()[8], 5);
    EXPECT_EQ(mesh.scalar()[9], mesh.scalar()[0]);
    Topology other = row(1);
    other.scan_id = "another scan";
    mesh.start(other);
    EXPECT_EQ(mesh.nodes(), other.rest);
}

TEST(MeshShape, AClippedMeshShowsTheCutFaces)
{
    MeshShape mesh;
    mesh.start(row(4));
    // everything: the outer faces of the box, 18 squares of 2 triangles
    Shape all = mesh.cut({{{1, 0, 0}}, -1});
    EXPECT_EQ(all.triangles.size(), 3u * 2 * 18);
    EXPECT_NEAR(volume_inside(all), 4, 1e-6);
    // the last two cubes: five squares of one, four of the other, and the inner square between them
    Shape half = mesh.cut({{{1, 0, 0}}, 2});
    EXPECT_EQ(half.triangles.size(), 3u * 2 * 10);
    EXPECT_NEAR(volume_inside(half), 2, 1e-6);
    Shape other = mesh.cut({{{-1, 0, 0}}, -2});
    EXPECT_NEAR(volume_inside(other), 2, 1e-6);
    for (uint16_t material : half.material) EXPECT_GE(material, 2);
    EXPECT_TRUE(mesh.cut({{{1, 0, 0}}, 9}).triangles.empty());
    // normals: outwards, of length 1
    for (size_t n = 0; n < half.nodes.size(); n++) {
        const float *v = &half.normals[3 * n];
        EXPECT_NEAR(v[0] * v[0] + v[1] * v[1] + v[2] * v[2], 1, 1e-6);
    }
}

TEST(MeshShape, SurfaceNormalsPointOutwards)
{
    MeshShape mesh;
    Topology topology = row(3);
    MeshShape faces;
    faces.start(topology);
    Shape closed = faces.cut({{{1, 0, 0}}, -1});
    for (uint32_t vertex : closed.triangles) topology.triangles.push_back(closed.nodes[vertex]);
    mesh.start(topology);
    Shape surface = mesh.surface();
    EXPECT_EQ(surface.nodes.size(), 16u);
    EXPECT_NEAR(volume_inside(surface), 3, 1e-6);
    for (size_t n = 0; n < surface.nodes.size(); n++) {
        double outwards = 0;
        const double middle[3] = {1.5, 0.5, 0.5};
        for (size_t d = 0; d < 3; d++)
            outwards += surface.normals[3 * n + d] * (surface.vertices[3 * n + d] - middle[d]);
        EXPECT_GT(outwards, 0);
    }
    // each edge once: Euler's formula for a closed surface, V - E + F = 2
    EXPECT_EQ(int(surface.nodes.size()) - int(surface.edges.size() / 2) + int(surface.triangles.size() / 3), 2);
}

// A surface that ends at a cut: additional vertices move with their tetrahedra, and its rim is sharp.
TEST(MeshShape, VerticesOfASurfaceMoveWithTheirTetrahedra)
{
    MeshShape mesh;
    Topology topology = row(1);
    const std::array<uint32_t, 4> first{
        {topology.tetrahedra[0], topology.tetrahedra[1], topology.tetrahedra[2], topology.tetrahedra[3]}};
    topology.vertex_tetrahedron = {0};
    topology.vertex_weight = {0.5f, 0.25f, 0.25f, 0};
    topology.vertex_material = {9};
    topology.triangles = {first[0], first[1], 8, first[1], first[0], first[2], 8, first[0], first[2]};
    topology.first_cut = 2;
    ASSERT_EQ(check(topology), "");
    mesh.start(topology);
    std::vector<float> moved = topology.rest, scalar(8, 0.0f);
    for (size_t n = 0; n < 8; n++)
        for (size_t d = 0; d < 3; d++) moved[3 * n + d] += 0.1f * float(n);
    for (size_t n = 0; n < 8; n++) scalar[n] = float(n);
    ASSERT_EQ(mesh.put(3, moved, scalar), MeshShape::SHOWN);
    EXPECT_FLOAT_EQ(mesh.scalar_of(8), 0.5f * float(first[0]) + 0.25f * float(first[1]) + 0.25f * float(first[2]));
    EXPECT_EQ(mesh.scalar_of(3), 3);
    const Shape shape = mesh.surface();
    ASSERT_EQ(shape.nodes.size(), 7u) << "four outside, three of the face of a cut";
    int own = 0;
    for (size_t n = 0; n < shape.nodes.size(); n++) {
        if (shape.nodes[n] != 8) continue;
        own++;
        EXPECT_EQ(shape.material[n], 9);
        for (size_t d = 0; d < 3; d++)
            EXPECT_NEAR(shape.vertices[3 * n + d],
                        0.5f * moved[3 * first[0] + d] + 0.25f * moved[3 * first[1] + d] +
                            0.25f * moved[3 * first[2] + d],
                        1e-6);
    }
    EXPECT_EQ(own, 2);
    // three edges between nodes, on the rim or not, and the rim edge that ends at the vertex
    EXPECT_EQ(shape.edges.size() / 2, 4u);
}

TEST(MeshShape, TheRangeIgnoresNotANumber)
{
    MeshShape mesh;
    Topology topology = row(1);
    mesh.start(topology);
    float low = 0, high = 0;
    EXPECT_FALSE(mesh.scalar_range(&low, &high));
    std::vector<float> scalar(8, 2.0f);
    scalar[1] = -3;
    scalar[2] = std::numeric_limits<float>::quiet_NaN();
    scalar[3] = std::numeric_limits<float>::infinity();
    ASSERT_EQ(mesh.put(3, topology.rest, scalar), MeshShape::SHOWN);
    ASSERT_TRUE(mesh.scalar_range(&low, &high));
    EXPECT_EQ(low, -3);
    EXPECT_EQ(high, 2);
}

TEST(Colours, StayInTheirRange)
{
    for (double t : {-1.0, 0.0, 0.3, 0.5, 1.0, 7.0})
        for (const Rgb &colour :
             {sequential_colour(t), diverging_colour(t), material_colour(uint16_t(std::fabs(t * 100)))})
            for (double x : colour) {
                EXPECT_GE(x, 0);
                EXPECT_LE(x, 1);
            }
    EXPECT_EQ(diverging_colour(0.5), (Rgb{{0.92, 0.92, 0.92}}));
    EXPECT_NE(material_colour(1), material_colour(2));
}

TEST(Scalars, HaveUnits)
{
#define UNIT_OF(value, name) \
    if (std::string(#name) != "none" && std::string(#name) != "volume_ratio") { \
        EXPECT_STRNE(scalar_unit(#name), "") << #name; \
    }
    PLIANT_SCALAR_LIST(UNIT_OF)
#undef UNIT_OF
    EXPECT_STREQ(scalar_unit("von_mises"), "Pa");
    EXPECT_STREQ(scalar_unit("displacement"), "m");
    EXPECT_STREQ(scalar_unit("volume_ratio"), "");
}

TEST(Scalars, DisplacementsAreDistancesFromRest)
{
    EXPECT_EQ(displacements({0, 0, 0, 1, 1, 1}, {3, 4, 0, 1, 1, 1}), (std::vector<float>{5, 0}));
}

} // namespace
