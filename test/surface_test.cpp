// The visible surface of a cut body.
#include "base/memory.h"
#include "cuts.h"
#include "mesh/mesh.h"
#include "topology/visible_surface.h"

#include <fstream>

namespace {

struct Surface {
    pliant_surface *made = nullptr;
    explicit Surface(const pliant_body *body, const pliant_surface *before = nullptr)
    {
        EXPECT_EQ(pliant_surface_create(body, before, &made), PLIANT_OK) << pliant_last_error();
    }
    Surface(const Surface &) = delete;
    Surface &operator=(const Surface &) = delete;
    ~Surface() { pliant_surface_free(made); }
    // Return the positions of all nodes, then of all vertices.
    std::vector<double> places(const double *positions) const
    {
        const size_t nodes = static_cast<size_t>(made->body->fine.num_nodes);
        std::vector<double> out(positions, positions + 3 * nodes);
        out.resize(3 * (nodes + static_cast<size_t>(made->num_vertices)));
        pliant_surface_at_vertices(made, 3, positions, out.data() + 3 * nodes);
        return out;
    }
};

std::unique_ptr<CutState> block(
    int a, int b, int c, int cell, std::function<int(int, int, int)> material = [](int, int, int) { return 0; })
{
    const int size[3] = {a, b, c};
    const double box[3] = {0.001 * a, 0.001 * b, 0.001 * c};
    auto body = std::make_unique<Body>(
        size, box, std::vector<Material>{{3000, 0.45, 1000, false}, {9000, 0.45, 1000, false}, {1, 0, 1, true}},
        material);
    body->cells(a / cell, b / cell, c / cell, 1);
    body->scene.cut.kind = PLIANT_CUT_SEVER;
    body->fix_plane(1e-9, 0, 0, 1, 0, 0);
    EXPECT_EQ(body->build(), PLIANT_OK) << pliant_last_error();
    return std::make_unique<CutState>(std::move(body));
}

// Count edges whose two directions have different numbers of triangles.
int open_edges(const pliant_surface &surface)
{
    std::map<std::pair<int32_t, int32_t>, int> edges;
    for (int32_t t = 0; t < surface.num_triangles; t++)
        for (int v = 0; v < 3; v++) {
            const int32_t a = surface.triangle[3 * t + v], b = surface.triangle[3 * t + (v + 1) % 3];
            edges[{std::min(a, b), std::max(a, b)}] += a < b ? 1 : -1;
        }
    int open = 0;
    for (const auto &edge : edges) open += edge.second != 0;
    return open;
}

// Compute the area and the enclosed volume of the triangles from `first` on.
void measure(const pliant_surface &surface, const std::vector<double> &at, int32_t first, double *area, double *volume)
{
    *area = *volume = 0;
    for (int32_t t = first; t < surface.num_triangles; t++) {
        const double *x[3];
        for (int v = 0; v < 3; v++) x[v] = at.data() + 3 * surface.triangle[3 * t + v];
        double n[3];
        for (int d = 0; d < 3; d++) {
            const int e = (d + 1) % 3, f = (d + 2) % 3;
            n[d] = (x[1][e] - x[0][e]) * (x[2][f] - x[0][f]) - (x[1][f] - x[0][f]) * (x[2][e] - x[0][e]);
            *volume += n[d] * x[0][d] / 6;
        }
        *area += 0.5 * std::sqrt(n[0] * n[0] + n[1] * n[1] + n[2] * n[2]);
    }
}

void expect_bound(const pliant_surface &surface)
{
    for (int32_t n = 0; n < surface.num_vertices; n++) {
        double sum = 0;
        ASSERT_GE(surface.tet[n], 0);
        ASSERT_LT(surface.tet[n], surface.body->fine.num_tets);
        for (int v = 0; v < 4; v++) {
            ASSERT_GE(surface.weight[4 * n + v], 0);
            sum += surface.weight[4 * n + v];
        }
        ASSERT_NEAR(sum, 1, 1e-12);
    }
    for (int32_t v = 0; v < 3 * surface.num_triangles; v++) {
        ASSERT_GE(surface.triangle[v], 0);
        ASSERT_LT(surface.triangle[v], surface.body->fine.num_nodes + surface.num_vertices);
    }
}

void expect_same(const pliant_surface &a, const pliant_surface &b)
{
    ASSERT_EQ(a.num_vertices, b.num_vertices);
    ASSERT_EQ(a.num_triangles, b.num_triangles);
    EXPECT_EQ(a.first_cut, b.first_cut);
    const size_t vertices = static_cast<size_t>(a.num_vertices);
    if (vertices > 0) {
        EXPECT_EQ(std::memcmp(a.tet, b.tet, vertices * sizeof *a.tet), 0);
        EXPECT_EQ(std::memcmp(a.weight, b.weight, 4 * vertices * sizeof *a.weight), 0);
        EXPECT_EQ(std::memcmp(a.material, b.material, vertices * sizeof *a.material), 0);
    }
    EXPECT_EQ(std::memcmp(a.triangle, b.triangle, 3 * static_cast<size_t>(a.num_triangles) * sizeof *a.triangle), 0);
}

TEST(Surface, WithoutACutItIsThatOfTheMesh)
{
    auto bar = block(24, 16, 16, 8);
    Surface surface(bar->now);
    ASSERT_EQ(surface.made->num_triangles, bar->now->num_triangles);
    EXPECT_EQ(surface.made->first_cut, bar->now->num_triangles);
    EXPECT_EQ(surface.made->num_vertices, 0);
    EXPECT_EQ(std::memcmp(surface.made->triangle, bar->now->triangles,
                          3 * sizeof(int32_t) * static_cast<size_t>(bar->now->num_triangles)),
              0);
}

// A plane through a bar leaves two closed halves. Their cut faces have the area of the plane and lie on it.
TEST(Surface, APlaneLeavesTwoClosedHalves)
{
    const double normals[][3] = {{1, 0, 0}, {1, 0.2, 0.1}, {1, 0.5, -0.3}, {1, -0.7, 0.6}, {1, 1, 0}};
    for (const double *normal : normals) {
        auto bar = block(64, 24, 24, 8);
        const double point[3] = {0.0323, 0.012, 0.012},
                     length = std::sqrt(normal[0] * normal[0] + normal[1] * normal[1] + normal[2] * normal[2]);
        ASSERT_TRUE(bar->cut_plane(point, normal));
        ASSERT_EQ(num_pieces(*bar->now), 2);
        Surface surface(bar->now);
        expect_bound(*surface.made);
        EXPECT_EQ(open_edges(*surface.made), 0);
        const std::vector<double> rest = surface.places(bar->now->fine.rest);
        double area, volume, unused;
        measure(*surface.made, rest, surface.made->first_cut, &area, &unused);
        measure(*surface.made, rest, 0, &unused, &volume);
        const double plane = 2 * 0.024 * 0.024 * length / normal[0];
        EXPECT_NEAR(volume, 0.064 * 0.024 * 0.024, 1e-5 * 0.064 * 0.024 * 0.024);
        double worst = 0;
        for (int32_t v = 3 * surface.made->first_cut; v < 3 * surface.made->num_triangles; v++) {
            double far = 0;
            for (int d = 0; d < 3; d++)
                far += (rest[3 * surface.made->triangle[v] + d] - point[d]) * normal[d] / length;
            worst = std::max(worst, std::fabs(far));
        }
        EXPECT_NEAR(area / plane, 1, 0.05) << normal[0] << " " << normal[1] << " " << normal[2];
        EXPECT_LT(worst, 0.002) << "two voxels";
        // after the halves move apart, each one is closed
        const std::vector<int32_t> piece = mesh_pieces(*bar->now);
        std::vector<double> moved = bar->positions;
        std::vector<int32_t> of_node(static_cast<size_t>(bar->now->fine.num_nodes));
        for (int32_t t = 0; t < bar->now->fine.num_tets; t++)
            for (int v = 0; v < 4; v++) of_node[bar->now->fine.tets[4 * t + v]] = piece[t];
        for (size_t n = 0; n < of_node.size(); n++) moved[3 * n] += of_node[n] == of_node[0] ? 0 : 0.01;
        measure(*surface.made, surface.places(moved.data()), 0, &unused, &volume);
        EXPECT_NEAR(volume, 0.064 * 0.024 * 0.024, 1e-5 * 0.064 * 0.024 * 0.024)
            << "no triangle reaches from one half to the other";
    }
}

// Tetrahedra smaller than a voxel own no voxel. They separate along their faces.
TEST(Surface, PartsBetweenTetrahedraWithoutVoxels)
{
    auto all = block(4, 2, 2, 1);
    const double point[3] = {0.0021, 0.001, 0.001}, normal[3] = {1, 0, 0};
    ASSERT_TRUE(all->cut_plane(point, normal));
    Surface surface(all->now);
    EXPECT_EQ(open_edges(*surface.made), 0);
    double area, volume;
    measure(*surface.made, surface.places(all->now->fine.rest), surface.made->first_cut, &area, &volume);
    EXPECT_NEAR(area, 2 * 0.002 * 0.002, 1e-12);
    Surface load(&all->load());
    Surface again(all->now, load.made);
    expect_same(*again.made, *surface.made);
}

// Strokes from all sides: the surface is closed, it does not depend on the previous surface, and undo restores it.
TEST(Surface, FollowsFromBodyToBody)
{
    auto all = block(40, 32, 32, 8, [](int i, int j, int k) { return i + j > 62 ? 2 : k > 15; });
    std::mt19937 random(7);
    std::uniform_real_distribution<double> unit(-1, 1);
    std::vector<const pliant_body *> bodies;
    std::vector<std::unique_ptr<Surface>> surfaces;
    for (int stroke = 0; stroke < 12; stroke++) {
        double point[3], normal[3];
        for (int d = 0; d < 3; d++) {
            point[d] = 0.016 + 0.012 * unit(random);
            normal[d] = unit(random);
        }
        all->cut_plane(point, normal, stroke % 3 == 2 ? 10 : 0.008);
        bodies.push_back(pliant_body_retain(all->now));
        surfaces.push_back(std::make_unique<Surface>(all->now, surfaces.empty() ? nullptr : surfaces.back()->made));
        const pliant_surface &now = *surfaces.back()->made;
        expect_bound(now);
        ASSERT_EQ(open_edges(now), 0) << "stroke " << stroke;
        Surface rebuilt(all->now);
        expect_same(now, *rebuilt.made);
        double area, volume;
        measure(now, surfaces.back()->places(all->now->fine.rest), 0, &area, &volume);
        double whole = 0;
        for (int32_t t = 0; t < all->load().fine.num_tets; t++) {
            double gradients[12];
            whole += pliant_mesh_gradients(&all->load().fine, t, gradients);
        }
        EXPECT_NEAR(volume, whole, 2e-3 * whole)
            << "what cuts make takes nothing away, but for tips that are drawn flat where pits are not as deep";
    }
    EXPECT_GT(surfaces.back()->made->num_triangles, surfaces.back()->made->first_cut);
    for (size_t n = bodies.size(); n-- > 0;) { // back, one by one
        Surface back(bodies[n], surfaces[std::min(n + 1, bodies.size() - 1)]->made);
        expect_same(*back.made, *surfaces[n]->made);
    }
    Surface load(&all->load(), surfaces.back()->made);
    EXPECT_EQ(load.made->num_vertices, 0);
    surfaces.clear();
    for (const pliant_body *body : bodies) pliant_body_release(body);
}

TEST(Surface, ListsItsMaterials)
{
    auto bar = block(32, 16, 16, 8, [](int, int, int k) { return k >= 8; });
    const double point[3] = {0.0163, 0.008, 0.008}, normal[3] = {1, 0.1, 0.05};
    ASSERT_TRUE(bar->cut_plane(point, normal));
    Surface surface(bar->now);
    const std::vector<double> rest = surface.places(bar->now->fine.rest);
    int seen[2] = {0, 0};
    for (int32_t n = 0; n < surface.made->num_vertices; n++) {
        const double z = rest[3 * (static_cast<size_t>(bar->now->fine.num_nodes + n)) + 2];
        if (std::fabs(z - 0.008) < 0.002) continue;
        EXPECT_EQ(surface.made->material[n], z > 0.008) << "of the voxels there";
        seen[z > 0.008]++;
    }
    EXPECT_GT(seen[0], 10);
    EXPECT_GT(seen[1], 10);
}

TEST(Surface, IsWrittenAsAFile)
{
    auto bar = block(16, 16, 16, 8);
    const double point[3] = {0.0083, 0.008, 0.008}, normal[3] = {1, 0.1, 0.05};
    ASSERT_TRUE(bar->cut_plane(point, normal));
    Surface surface(bar->now);
    std::vector<double> moved = bar->positions;
    std::vector<float> values(static_cast<size_t>(bar->now->fine.num_nodes));
    for (size_t n = 0; n < values.size(); n++) {
        moved[3 * n] += 0.1;
        values[n] = static_cast<float>(2000 * bar->now->fine.rest[3 * n + 1]);
    }
    char folder[] = "/tmp/pliant_surface_XXXXXX";
    ASSERT_TRUE(mkdtemp(folder));
    const std::string path = std::string(folder) + "/a.ply";
    const char *const names[] = {"height"};
    ASSERT_EQ(pliant_surface_write(path.c_str(), surface.made, moved.data(), 1.0, 1, names, values.data()), PLIANT_OK)
        << pliant_last_error();
    EXPECT_EQ(pliant_surface_write((path + "/b").c_str(), surface.made, moved.data(), 1.0, 0, nullptr, nullptr),
              PLIANT_ERROR_FILE);
    std::ifstream file(path);
    std::string line;
    size_t rows = 0, triangles = 0, cut = 0;
    while (std::getline(file, line) && line != "end_header") {
        if (line.compare(0, 15, "element vertex ") == 0) rows = std::stoul(line.substr(15));
        if (line.compare(0, 13, "element face ") == 0) triangles = std::stoul(line.substr(13));
    }
    ASSERT_EQ(triangles, static_cast<size_t>(surface.made->num_triangles));
    for (size_t row = 0; row < rows; row++) {
        double at[3], rest[3], material, value;
        ASSERT_TRUE(file >> at[0] >> at[1] >> at[2] >> rest[0] >> rest[1] >> rest[2] >> material >> value);
        EXPECT_NEAR(at[0], rest[0] + 0.1, 1e-9);
        EXPECT_NEAR(value, 2000 * rest[1], 1e-4);
    }
    for (size_t t = 0; t < triangles; t++) {
        size_t count, corner[3], by_cut;
        ASSERT_TRUE(file >> count >> corner[0] >> corner[1] >> corner[2] >> by_cut);
        for (size_t c : corner) EXPECT_LT(c, rows);
        cut += by_cut;
    }
    EXPECT_EQ(cut, triangles - static_cast<size_t>(surface.made->first_cut));
    EXPECT_EQ(std::remove(path.c_str()) | std::remove(folder), 0);
}

TEST(Surface, EveryAllocationMayFail)
{
    auto bar = block(16, 16, 16, 8);
    const double point[3] = {0.0083, 0.008, 0.008}, normal[3] = {1, 0.1, 0.05};
    ASSERT_TRUE(bar->cut_plane(point, normal));
    const size_t before = pliant_memory_in_use();
    int calls = 0;
    for (pliant_status status = PLIANT_ERROR_MEMORY; status != PLIANT_OK; calls++) {
        pliant_surface *made = nullptr;
        pliant_memory_fail_after(calls);
        status = pliant_surface_create(bar->now, nullptr, &made);
        pliant_memory_fail_after(-1);
        ASSERT_TRUE(status == PLIANT_OK || status == PLIANT_ERROR_MEMORY);
        ASSERT_EQ(made != nullptr, status == PLIANT_OK);
        pliant_surface_free(made);
        ASSERT_EQ(pliant_memory_in_use(), before);
    }
    EXPECT_GT(calls, 20);
}

} // namespace
