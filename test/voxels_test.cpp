// The owners and the connectivity of a body's voxels, against the definitions.
#include "pipeline/body.h"
#include "base/memory.h"
#include "mesh/mesh.h"
#include "voxels_joined.h"

#include <algorithm>
#include <memory>
#include <random>
#include <set>

namespace {

struct Voxels : testing::Test {
    const int size[3] = {23, 17, 21};
    const double box[3] = {0.115, 0.119, 0.126};
    std::unique_ptr<Body> body;
    const pliant_voxels *voxels = nullptr;
    std::set<uint32_t> severed; // 4 voxel + axis
    std::set<int32_t> severed_bridges;
    std::vector<uint32_t> link;
    std::vector<int32_t> bridge, none = {0};
    pliant_cuts cuts{};

    void make(int a, int b, int c, bool everything = true)
    {
        body.reset(new Body(size, box, {{4000, 0.4, 1000, false}, {1, 0.1, 1, true}}, [&](int i, int j, int k) {
            return !everything && std::hypot(std::hypot(i - 11, j - 8), k - 10) > 9;
        }));
        body->fix_plane(0, 0, 0.06, 0, 0, 1);
        body->cells(a, b, c, 1);
        body->scene.mesh.keep_air = everything;
        ASSERT_EQ(body->build(), PLIANT_OK) << pliant_last_error();
        ASSERT_EQ(pliant_voxels_create(body->model->body, &body->scan.geometry, body->model->material_of_voxel,
                                       &body->table, &voxels),
                  PLIANT_OK)
            << pliant_last_error();
    }
    void TearDown() override { pliant_voxels_release(voxels); }
    const pliant_cuts *sorted()
    {
        link.assign(severed.begin(), severed.end());
        bridge.assign(severed_bridges.begin(), severed_bridges.end());
        cuts.num_links = static_cast<int32_t>(link.size());
        cuts.link = link.data();
        cuts.num_bridges = static_cast<int32_t>(bridge.size());
        cuts.bridge = bridge.data();
        cuts.start = cuts.voxel_start = none.data();
        return &cuts;
    }

    int32_t at(const int place[3]) const { return place[0] + size[0] * (place[1] + size[1] * place[2]); }
    bool in(const int place[3]) const
    {
        for (int d = 0; d < 3; d++)
            if (place[d] < 0 || place[d] >= size[d]) return false;
        return true;
    }
    // Return whether the link between two neighbours along one axis is intact.
    bool joins(const int a[3], const int b[3]) const
    {
        for (int d = 0; d < 3; d++) {
            if (a[d] == b[d]) continue;
            return !severed.count(4 * static_cast<uint32_t>(at(a[d] < b[d] ? a : b)) + static_cast<uint32_t>(d));
        }
        return true;
    }
    // Return the connected parts of a tetrahedron's voxels by testing all pairs, with or without bridges.
    std::vector<int> parts(int32_t tet, bool bridges) const
    {
        std::vector<int32_t> all;
        for (int32_t v = 0; v < size[0] * size[1] * size[2]; v++)
            if (voxels->owner[v] == tet) all.push_back(v);
        std::vector<int> part(all.size(), -1);
        auto joined = [&](int32_t a, int32_t b) {
            int p[3] = {a % size[0], a / size[0] % size[1], a / size[0] / size[1]},
                q[3] = {b % size[0], b / size[0] % size[1], b / size[0] / size[1]};
            int apart = 0, far = 0;
            for (int d = 0; d < 3; d++) {
                apart += p[d] != q[d];
                far = std::max(far, std::abs(p[d] - q[d]));
            }
            if (far == 1 && apart == 1) return joins(p, q);
            for (int d = 0; d < 3 && far == 1 && apart == 2; d++) {
                if (p[d] == q[d]) continue;
                int middle[3] = {p[0], p[1], p[2]};
                middle[d] = q[d];
                if (voxels->owner[at(middle)] >= 0 && joins(p, middle) && joins(middle, q)) return true;
            }
            for (int32_t n = 0; bridges && n < voxels->num_bridges; n++)
                if (!severed_bridges.count(n) && ((voxels->bridge[2 * n] == a && voxels->bridge[2 * n + 1] == b) ||
                                                   (voxels->bridge[2 * n] == b && voxels->bridge[2 * n + 1] == a)))
                    return true;
            return false;
        };
        int count = 0;
        for (size_t seed = 0; seed < all.size(); seed++) {
            if (part[seed] >= 0) continue;
            std::vector<size_t> open{seed};
            part[seed] = count;
            while (!open.empty()) {
                size_t now = open.back();
                open.pop_back();
                for (size_t other = 0; other < all.size(); other++)
                    if (part[other] < 0 && joined(all[now], all[other])) {
                        part[other] = count;
                        open.push_back(other);
                    }
            }
            count++;
        }
        return part;
    }
    std::vector<int> fragments(int32_t tet)
    {
        std::vector<int32_t> out(static_cast<size_t>(voxels->start[tet + 1] - voxels->start[tet]));
        int32_t count = pliant_voxels_parts(voxels, sorted(), tet, out.data());
        EXPECT_EQ(count, out.empty() ? 0 : *std::max_element(out.begin(), out.end()) + 1);
        return std::vector<int>(out.begin(), out.end());
    }
};

TEST_F(Voxels, AreOwnedByTheTetrahedraThatHoldTheirCentres)
{
    make(6, 5, 4, false);
    const pliant_body &load = *body->model->body;
    std::vector<uint32_t> count(static_cast<size_t>(load.fine.num_tets));
    for (int32_t v = 0; v < size[0] * size[1] * size[2]; v++) {
        int32_t owner = voxels->owner[v];
        const double index[3] = {static_cast<double>(v % size[0]), static_cast<double>(v / size[0] % size[1]),
                                 static_cast<double>(v / size[0] / size[1])};
        double world[3], weights[4];
        pliant_geometry_to_world(&body->scan.geometry, index, world);
        if (owner < 0) {
            EXPECT_EQ(static_cast<const uint8_t *>(body->scan.voxels)[v], 1) << "tissue without an owner";
            continue;
        }
        count[owner]++;
        pliant_mesh_barycentric(&load.fine, owner, world, weights);
        EXPECT_GT(*std::min_element(weights, weights + 4), -1e-9);
        for (int32_t t = 0; t < load.fine.num_tets; t++) { // on a common face, the central tetrahedron is the owner
            if (t == owner || load.fine.lattice_of_tet[t] / 5 != load.fine.lattice_of_tet[owner] / 5 ||
                load.fine.lattice_of_tet[t] % 5 != 0)
                continue;
            pliant_mesh_barycentric(&load.fine, t, world, weights);
            EXPECT_LT(*std::min_element(weights, weights + 4), 1e-9);
        }
    }
    for (int32_t t = 0; t < load.fine.num_tets; t++) {
        EXPECT_EQ(count[t], load.fine_material[t].num_voxels);
        EXPECT_EQ(static_cast<uint32_t>(voxels->start[t + 1] - voxels->start[t]), count[t]);
        EXPECT_TRUE(std::is_sorted(voxels->voxel + voxels->start[t], voxels->voxel + voxels->start[t + 1]));
    }
}

TEST_F(Voxels, BridgesConnectUncutTetrahedra)
{
    make(2, 8, 8); // flat cubes: staircases of voxels at sharp edges
    int32_t apart = 0, bridged = 0;
    for (int32_t t = 0; t < voxels->num_tets; t++) {
        std::vector<int> without = parts(t, false), with = fragments(t);
        if (without.empty()) continue;
        EXPECT_EQ(*std::max_element(with.begin(), with.end()), 0) << "tetrahedron " << t;
        apart += *std::max_element(without.begin(), without.end());
        bridged += voxels->bridge_start[t + 1] - voxels->bridge_start[t];
        EXPECT_EQ(with, parts(t, true));
    }
    EXPECT_GT(apart, 0);
    EXPECT_EQ(bridged, apart); // a spanning tree
    // every inner face has a link or a bridge
    const pliant_mesh &mesh = body->model->body->fine;
    std::vector<int32_t> across(4 * static_cast<size_t>(mesh.num_tets));
    ASSERT_EQ(pliant_mesh_neighbours(&mesh, across.data()), PLIANT_OK);
    std::set<std::pair<int32_t, int32_t>> links;
    for (int32_t v = 0; v < size[0] * size[1] * size[2]; v++)
        for (int32_t w = 0; w < v; w++) {
            int far = 0, apart_along = 0;
            for (int d = 0, s = 1; d < 3; s *= size[d++]) {
                far = std::max(far, std::abs(v / s % size[d] - w / s % size[d]));
                apart_along += v / s % size[d] != w / s % size[d];
            }
            const int p[3] = {v % size[0], v / size[0] % size[1], v / size[0] / size[1]},
                      q[3] = {w % size[0], w / size[0] % size[1], w / size[0] / size[1]};
            bool way = apart_along == 1;
            for (int d = 0; d < 3 && far == 1 && apart_along == 2; d++) {
                int middle[3] = {p[0], p[1], p[2]};
                middle[d] = q[d];
                way = way || (p[d] != q[d] && voxels->owner[at(middle)] >= 0);
            }
            if (far == 1 && way) links.insert(std::minmax(voxels->owner[v], voxels->owner[w]));
        }
    for (int32_t b = 0; b < voxels->num_bridges; b++)
        links.insert(std::minmax(voxels->owner[voxels->bridge[2 * b]], voxels->owner[voxels->bridge[2 * b + 1]]));
    for (size_t f = 0; f < across.size(); f++) {
        int32_t t = static_cast<int32_t>(f / 4), u = across[f];
        if (u < 0 || voxels->start[t] == voxels->start[t + 1] || voxels->start[u] == voxels->start[u + 1]) continue;
        EXPECT_TRUE(links.count(std::minmax(t, u))) << t << " " << u;
    }
}

TEST_F(Voxels, FragmentsAreComponentsOfTheRemainingLinks)
{
    make(4, 3, 5);
    std::mt19937 random(7);
    // a plane, then random single links
    int32_t maximum = 0;
    for (int trial = 0; trial < 4; trial++) {
        const double normal[3] = {0.3 + trial, 1.0, -0.7},
                     offset = 0.5 * ((0.3 + trial) * size[0] + size[1] - 0.7 * size[2]) + 0.3;
        auto side = [&](const int p[3]) { return normal[0] * p[0] + normal[1] * p[1] + normal[2] * p[2] > offset; };
        for (int32_t v = 0; v < size[0] * size[1] * size[2]; v++)
            for (int d = 0; d < 3; d++) {
                int p[3] = {v % size[0], v / size[0] % size[1], v / size[0] / size[1]}, q[3] = {p[0], p[1], p[2]};
                q[d]++;
                if (!in(q)) continue;
                if (trial < 2 ? side(p) != side(q) : random() % 3 == 0)
                    severed.insert(4 * static_cast<uint32_t>(v) + static_cast<uint32_t>(d));
            }
        for (int32_t b = 0; b < voxels->num_bridges; b++)
            if (random() % 2) severed_bridges.insert(b);
        for (int32_t t = 0; t < voxels->num_tets; t++) {
            std::vector<int> here = fragments(t);
            ASSERT_EQ(here, parts(t, true)) << "trial " << trial << ", tetrahedron " << t;
            if (!here.empty()) maximum = std::max(maximum, *std::max_element(here.begin(), here.end()) + 1);
        }
    }
    EXPECT_GT(maximum, 3);
}

TEST_F(Voxels, AreSharedByBodiesEachWithItsCuts)
{
    make(4, 3, 5);
    const size_t before = pliant_memory_in_use();
    pliant_body *first = nullptr, *next = nullptr;
    ASSERT_EQ(pliant_body_next(body->model->body, 2, &first), PLIANT_OK);
    first->voxels = pliant_voxels_retain(voxels);
    severed = {4 * 100, 4 * 100 + 1, 4 * 2000 + 2};
    severed_bridges = {};
    ASSERT_EQ(pliant_cuts_copy(sorted(), &first->cuts), PLIANT_OK);
    ASSERT_EQ(pliant_body_next(first, 3, &next), PLIANT_OK);
    EXPECT_EQ(next->voxels, voxels);
    ASSERT_TRUE(next->cuts);
    EXPECT_NE(next->cuts->link, first->cuts->link);
    EXPECT_TRUE(pliant_body_same(first, next));
    EXPECT_FALSE(voxels_joined(voxels, next->cuts, 100, 101));
    EXPECT_FALSE(voxels_joined(voxels, next->cuts, 101, 100));
    EXPECT_FALSE(voxels_joined(voxels, next->cuts, 100, 100 + size[0]));
    EXPECT_FALSE(voxels_joined(voxels, next->cuts, 2000, 2000 + size[0] * size[1]));
    EXPECT_TRUE(voxels_joined(voxels, next->cuts, 2001, 2002));
    EXPECT_TRUE(voxels_joined(voxels, next->cuts, 101 + size[0], 101));
    EXPECT_TRUE(voxels_joined(voxels, next->cuts, 101 + size[0], 100 + size[0]));
    EXPECT_FALSE(voxels_joined(voxels, next->cuts, 100, 101 + size[0])); // both paths begin with a severed link
    EXPECT_TRUE(voxels_joined(voxels, next->cuts, 101, 100 + size[0])); // by 101 + size[0]
    EXPECT_FALSE(voxels_joined(voxels, next->cuts, 100, 102));
    next->cuts->link[0]--;
    EXPECT_FALSE(pliant_body_same(first, next));
    pliant_body_release(first);
    pliant_body_release(next);
    EXPECT_EQ(pliant_memory_in_use(), before);
}

// Two blocks that share an edge of the lattice only: they have bridges only there.
TEST_F(Voxels, HingesHaveBridges)
{
    const int many[3] = {20, 20, 10};
    const double wide[3] = {0.2, 0.2, 0.1};
    Body two(many, wide, {{4000, 0.4, 1000, false}, {1, 0.1, 1, true}},
             [](int i, int j, int) { return (i < 10) != (j < 10); });
    two.fix_plane(0, 0, 0.01, 0, 0, 1);
    two.cells(4, 4, 2, 1);
    ASSERT_EQ(two.build(), PLIANT_OK) << pliant_last_error();
    const pliant_mesh &mesh = two.model->body->fine;
    ASSERT_EQ(
        pliant_voxels_create(two.model->body, &two.scan.geometry, two.model->material_of_voxel, &two.table, &voxels),
        PLIANT_OK)
        << pliant_last_error();
    int hinges = 0;
    for (int32_t b = voxels->bridge_start[mesh.num_tets]; b < voxels->num_bridges; b++) {
        int32_t from = voxels->bridge[2 * b], to = voxels->bridge[2 * b + 1];
        bool left = from % 20 < 10, other = to % 20 < 10;
        EXPECT_NE(left, other);
        EXPECT_EQ(std::max(std::abs(from % 20 - to % 20), std::abs(from / 20 % 20 - to / 20 % 20)), 1);
        bool listed[2] = {false, false};
        for (int end = 0; end < 2; end++) {
            int32_t tet = voxels->owner[end ? to : from];
            for (int32_t e = voxels->adjacent_start[tet]; e < voxels->adjacent_start[tet + 1]; e++)
                listed[end] = listed[end] || voxels->adjacent[e] == b;
        }
        EXPECT_TRUE(listed[0] && listed[1]);
        hinges++;
    }
    EXPECT_EQ(hinges, 3); // the nodes on that edge
}

TEST_F(Voxels, WithoutMemoryNothingIsLeftBehind)
{
    make(4, 3, 5);
    const size_t before = pliant_memory_in_use();
    int64_t n = 0;
    for (pliant_status status = PLIANT_ERROR_MEMORY; status != PLIANT_OK; n++) {
        const pliant_voxels *other = nullptr;
        pliant_memory_fail_after(n);
        status = pliant_voxels_create(body->model->body, &body->scan.geometry, body->model->material_of_voxel,
                                      &body->table, &other);
        pliant_memory_fail_after(-1);
        ASSERT_TRUE(status == PLIANT_OK || status == PLIANT_ERROR_MEMORY);
        pliant_voxels_release(other);
        EXPECT_EQ(pliant_memory_in_use(), before);
    }
    EXPECT_GT(n, 10);
}

} // namespace
