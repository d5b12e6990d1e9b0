// Tests of the fitted warp: exact for quadratic polynomials, close to rasterization on a smooth map, and complete in
// drawing.
#include "mesh/mesh.h"
#include "pipeline/body.h"
#include "warp/fit.h"
#include "warp/fit_point.h"
#include "warp/warp.h"

#include <array>

namespace {

struct Fixture {
    pliant_volume scan{};
    pliant_mesh mesh{};
    Fixture(int n, int cells)
    {
        pliant_geometry g{{n, n, n}, {0, 0, 0}, {0.001, 0.001, 0.0012}, {1, 0, 0, 0, 1, 0, 0, 0, 1}};
        EXPECT_EQ(pliant_volume_create(&g, PLIANT_INT16, &scan), PLIANT_OK);
        scan.slope = 1;
        scan.background = -1000;
        for (int v = 0; v < n * n * n; v++)
            static_cast<int16_t *>(scan.voxels)[v] = static_cast<int16_t>(
                300 * std::sin(0.3 * (v % n)) + 200 * std::cos(0.25 * (v / n % n)) + 5 * (v / n / n));
        const int32_t c[3] = {cells, cells, cells};
        EXPECT_EQ(pliant_mesh_grid(&g, c, nullptr, &mesh), PLIANT_OK);
    }
    ~Fixture()
    {
        pliant_volume_free(&scan);
        pliant_mesh_free(&mesh);
    }
    std::vector<double> rest_index() const
    {
        std::vector<double> out(3 * static_cast<size_t>(mesh.num_nodes));
        for (int32_t n = 0; n < mesh.num_nodes; n++)
            pliant_geometry_to_index(&scan.geometry, mesh.rest + 3 * n, out.data() + 3 * n);
        return out;
    }
};

TEST(Fit, MeetsPolynomialsOfSecondOrderExactly)
{
    Fixture body(24, 6);
    std::vector<double> rest = body.rest_index(), positions(rest.size());
    // Nodes are displaced slightly from the lattice. Their rest positions are a polynomial of the displaced positions.
    auto polynomial = [](const double *x, double *out) {
        double a = x[0] * 1e3, b = x[1] * 1e3, c = x[2] * 1e3;
        out[0] = 1 + 0.9 * a + 0.1 * b - 0.004 * a * a + 0.006 * b * c;
        out[1] = -2 + 1.1 * b + 0.05 * c + 0.005 * a * b - 0.003 * c * c;
        out[2] = 0.8 * c - 0.1 * a + 0.004 * a * c + 0.002 * b * b;
    };
    for (int32_t n = 0; n < body.mesh.num_nodes; n++)
        for (int d = 0; d < 3; d++) positions[3 * n + d] = body.mesh.rest[3 * n + d] + 0.0004 * std::sin(5.0 * n + d);
    for (int32_t n = 0; n < body.mesh.num_nodes; n++) polynomial(positions.data() + 3 * n, rest.data() + 3 * n);
    pliant_fit *fit = nullptr;
    ASSERT_EQ(pliant_fit_create(&body.mesh, &body.scan.geometry, rest.data(), &body.scan.geometry, 1, 2, &fit),
              PLIANT_OK);
    pliant_fit_map(fit, positions.data());
    for (int v = 0; v < 24 * 24 * 24; v++) {
        double at[3] = {1.0 * (v % 24), 1.0 * (v / 24 % 24), 1.0 * (v / 576)}, world[3], expected[3], found[3];
        pliant_geometry_to_world(&body.scan.geometry, at, world);
        polynomial(world, expected);
        ASSERT_TRUE(fit_map_at(pliant_fit_parts(fit), at, found));
        // the map is stored in single precision
        for (int d = 0; d < 3; d++) ASSERT_NEAR(found[d], expected[d], 2e-5) << v;
    }
    pliant_fit_free(fit);
}

// X = x + d(x): a known inverse map. Fixed-point iteration gives the deformed position of a node.
void smooth(const double *x, double *out)
{
    out[0] = x[0] + 0.003 * std::sin(120 * x[1]);
    out[1] = x[1] + 0.003 * std::sin(110 * x[2] + 1);
    out[2] = x[2] + 0.003 * std::cos(130 * x[0]);
}

TEST(Fit, IsCloserToASmoothMapThanTetrahedraAre)
{
    Fixture body(40, 8);
    std::vector<double> rest = body.rest_index(), positions(rest.size());
    for (int32_t n = 0; n < body.mesh.num_nodes; n++) {
        const double *target = body.mesh.rest + 3 * n;
        double x[3] = {target[0], target[1], target[2]}, mapped[3];
        for (int pass = 0; pass < 100; pass++) {
            smooth(x, mapped);
            for (int d = 0; d < 3; d++) x[d] += target[d] - mapped[d];
        }
        for (int d = 0; d < 3; d++) positions[3 * n + d] = x[d];
    }
    double error[3] = {0, 0, 0};
    int count = 0;
    pliant_fit *fits[2] = {nullptr, nullptr};
    for (int f = 0; f < 2; f++) {
        ASSERT_EQ(pliant_fit_create(&body.mesh, &body.scan.geometry, rest.data(), &body.scan.geometry, f ? 4 : 1, 2,
                                    &fits[f]),
                  PLIANT_OK);
        pliant_fit_map(fits[f], positions.data());
    }
    for (int k = 8; k < 32; k += 3)
        for (int j = 8; j < 32; j += 3)
            for (int i = 8; i < 32; i += 3) {
                double at[3] = {i + 0.0, j + 0.0, k + 0.0}, world[3], truth[3], expected[3], weights[4],
                       linear[3] = {0, 0, 0}, found[3];
                pliant_geometry_to_world(&body.scan.geometry, at, world);
                smooth(world, truth);
                pliant_geometry_to_index(&body.scan.geometry, truth, expected);
                int32_t tet = pliant_mesh_locate_deformed(&body.mesh, positions.data(), world, weights);
                ASSERT_GE(tet, 0);
                for (int v = 0; v < 4; v++)
                    for (int d = 0; d < 3; d++) linear[d] += weights[v] * rest[3 * body.mesh.tets[4 * tet + v] + d];
                for (int d = 0; d < 3; d++) error[0] += std::pow(linear[d] - expected[d], 2);
                for (int f = 0; f < 2; f++) {
                    ASSERT_TRUE(fit_map_at(pliant_fit_parts(fits[f]), at, found));
                    for (int d = 0; d < 3; d++) error[f + 1] += std::pow(found[d] - expected[d], 2);
                }
                count++;
            }
    for (double &e : error) e = std::sqrt(e / count);
    RecordProperty("tetrahedra", std::to_string(error[0]));
    RecordProperty("fit", std::to_string(error[1]));
    RecordProperty("fit_every_4", std::to_string(error[2]));
    EXPECT_LT(error[1], 0.7 * error[0]) << error[0];
    EXPECT_LT(error[2], error[0]);
    for (pliant_fit *fit : fits) pliant_fit_free(fit);
}

TEST(Fit, DrawsTheScanAtRestAndBackgroundBesideIt)
{
    Fixture body(32, 8);
    pliant_geometry target;
    const double box[6] = {-0.01, -0.01, -0.01, 0.04, 0.04, 0.045};
    ASSERT_EQ(pliant_warp_target(&body.scan.geometry, box, 2, 0, SIZE_MAX, &target), PLIANT_OK);
    pliant_warp *warp = nullptr;
    ASSERT_EQ(pliant_warp_create(&body.scan, &body.mesh, &target, 2, &warp), PLIANT_OK);
    EXPECT_EQ(pliant_warp_fit(warp, 0), PLIANT_ERROR_ARGUMENT);
    ASSERT_EQ(pliant_warp_fit(warp, 4), PLIANT_OK);
    ASSERT_EQ(pliant_warp_update(warp, body.mesh.rest), PLIANT_OK);
    const pliant_volume *drawn = pliant_warp_volume(warp);
    int inside = 0;
    for (size_t v = 0; v < pliant_geometry_voxels(&target); v++) {
        double at[3] = {double(v % size_t(target.size[0])), double(v / size_t(target.size[0]) % size_t(target.size[1])),
                        double(v / size_t(target.size[0]) / size_t(target.size[1]))};
        double world[3], index[3];
        pliant_geometry_to_world(&target, at, world);
        pliant_geometry_to_index(&body.scan.geometry, world, index);
        int x = int(std::lround(index[0])), y = int(std::lround(index[1])), z = int(std::lround(index[2]));
        int16_t value = static_cast<const int16_t *>(drawn->voxels)[v];
        if (x < 0 || y < 0 || z < 0 || x > 31 || y > 31 || z > 31) {
            ASSERT_EQ(value, -1000);
        } else {
            ASSERT_NEAR(value, static_cast<int16_t *>(body.scan.voxels)[x + 32 * (y + 32 * z)], 1);
            inside++;
        }
    }
    EXPECT_EQ(inside, 32 * 32 * 32);
    int32_t count[3];
    const uint8_t *changed;
    ASSERT_EQ(pliant_warp_update(warp, body.mesh.rest), PLIANT_OK);
    pliant_warp_bricks(warp, count, &changed);
    for (int b = 0; b < count[0] * count[1] * count[2]; b++) EXPECT_EQ(changed[b], 0);
    pliant_warp_free(warp);
}

// Outside of the tissue, polynomials may turn back into it. The fit draws nothing there, and it draws every voxel that
// rasterization draws.
TEST(Fit, DrawsNoTissueBesideTheBody)
{
    Fixture body(32, 8);
    pliant_geometry target;
    const double box[6] = {-0.03, -0.03, -0.03, 0.06, 0.06, 0.07};
    ASSERT_EQ(pliant_warp_target(&body.scan.geometry, box, 2, 0, SIZE_MAX, &target), PLIANT_OK);
    for (size_t v = 0; v < pliant_geometry_voxels(&body.scan.geometry); v++)
        static_cast<int16_t *>(body.scan.voxels)[v] = 100;
    std::vector<double> positions(body.mesh.rest, body.mesh.rest + 3 * body.mesh.num_nodes);
    for (size_t n = 0; n < positions.size(); n += 3) { // a dent into one side, a bulge out of another
        const double y = positions[n + 1] - 0.016, z = positions[n + 2] - 0.019, x = positions[n];
        positions[n] += 0.006 * std::exp(-(y * y + z * z) / 4e-5) * (1 - x / 0.032);
        positions[n + 2] += 0.005 * std::exp(-(y * y + (x - 0.016) * (x - 0.016)) / 3e-5) * z / 0.019;
    }
    for (int step : {4, 9}) {
        std::vector<int16_t> drawn[2];
        for (int fitted = 0; fitted < 2; fitted++) {
            pliant_warp *warp = nullptr;
            ASSERT_EQ(pliant_warp_create(&body.scan, &body.mesh, &target, 2, &warp), PLIANT_OK);
            if (fitted) { ASSERT_EQ(pliant_warp_fit(warp, step), PLIANT_OK); }
            ASSERT_EQ(pliant_warp_update(warp, positions.data()), PLIANT_OK);
            auto *voxels = static_cast<const int16_t *>(pliant_warp_volume(warp)->voxels);
            drawn[fitted].assign(voxels, voxels + pliant_geometry_voxels(&target));
            pliant_warp_free(warp);
        }
        const int *n = target.size;
        int extra = 0, missing = 0, inside = 0;
        for (int k = 2; k < n[2] - 2; k++)
            for (int j = 2; j < n[1] - 2; j++)
                for (int i = 2; i < n[0] - 2; i++) {
                    bool any = false, all = true;
                    for (int a = 0; a < 125; a++) {
                        bool is =
                            drawn[0][size_t(i + a % 5 - 2 + n[0] * (j + a / 5 % 5 - 2 + n[1] * (k + a / 25 - 2)))] ==
                            100;
                        any |= is;
                        all &= is;
                    }
                    bool is = drawn[1][size_t(i + n[0] * (j + n[1] * k))] == 100;
                    extra += is && !any;
                    missing += !is && all;
                    inside += all;
                }
        EXPECT_EQ(extra, 0) << step;
        EXPECT_EQ(missing, 0) << step << ", of " << inside;
    }
}

// Near a cut, the rest position of a voxel is blended between the map of its element and the map of the fit. The weight
// of the element's map is the sum of the barycentric coordinates of the nodes near the cut.
TEST(Fit, NearACutMapsAreBlendedByBarycentricCoordinates)
{
    const double rest[12] = {3, 4, 5, 7.5, 4.5, 4, 2, 9, 6.5, 4, 3, 11};
    const int32_t tet[4] = {0, 1, 2, 3};
    float fitted[3] = {50, -20, 30}; // one lattice point: the same everywhere
    fit_view view{};
    for (int d = 0; d < 3; d++) view.target.size[d] = view.size[d] = 1;
    view.step = 1;
    view.tets = tet;
    view.rest = rest;
    view.map = fitted;
    const double weight[4] = {0.15, 0.4, 0.35, 0.1}, voxel[3] = {0, 0, 0};
    for (int chosen = 1; chosen < 16; chosen++) {
        uint8_t near[4], zone = 0;
        double own[3] = {0, 0, 0}, index[3], part = 0;
        for (int v = 0; v < 4; v++) {
            near[v] = static_cast<uint8_t>(chosen >> v & 1);
            zone = static_cast<uint8_t>(zone + near[v]);
            part += near[v] * weight[v];
            for (int d = 0; d < 3; d++) own[d] += weight[v] * rest[3 * v + d];
        }
        view.zone = &zone;
        view.near = near;
        std::copy(own, own + 3, index);
        fit_blend(&view, 0, voxel, index);
        for (int d = 0; d < 3; d++) {
            const double fit = double(fitted[d]);
            EXPECT_NEAR(index[d], fit + part * (own[d] - fit), 1e-9) << chosen;
        }
    }
}

// One node moves far away. At any distance of this node, the fit is the fit of the other nodes.
TEST(Fit, ADistantNodeHasNoEffect)
{
    Fixture body(24, 6);
    std::vector<double> rest = body.rest_index(), positions(body.mesh.rest, body.mesh.rest + rest.size());
    std::vector<float> first;
    for (double away : {1.0, -1e6, 1e300, -1e308}) {
        pliant_fit *fit = nullptr;
        ASSERT_EQ(pliant_fit_create(&body.mesh, &body.scan.geometry, rest.data(), &body.scan.geometry, 2, 2, &fit),
                  PLIANT_OK);
        for (int d = 0; d < 3; d++) positions[d] = d == 1 ? -away : away;
        pliant_fit_map(fit, positions.data());
        std::vector<float> map;
        for (int v = 0; v < 24 * 24 * 24; v++) {
            const double at[3] = {1.0 * (v % 24), 1.0 * (v / 24 % 24), 1.0 * (v / 576)};
            double found[3];
            ASSERT_TRUE(fit_map_at(pliant_fit_parts(fit), at, found)) << v;
            map.insert(map.end(), found, found + 3);
        }
        if (first.empty()) first = map;
        float difference = 0; // the bins have another origin, so sums run in another order
        for (size_t i = 0; i < map.size(); i++) difference = std::max(difference, std::fabs(map[i] - first[i]));
        EXPECT_LT(difference, 1e-6F) << away;
        pliant_fit_free(fit);
    }
}

TEST(Fit, IsSelectedByTheScene)
{
    const int size[3] = {16, 16, 32};
    const double box[3] = {0.04, 0.04, 0.08};
    std::vector<int16_t> pictures[2];
    for (int fitted = 0; fitted < 2; fitted++) {
        Body body(size, box, {{5e3, 0.3, 1000, false}, {2e4, 0.3, 1000, false}},
                  [](int i, int, int k) { return i < 6 && k < 10; });
        body.cells(4, 4, 8, 1);
        body.fix_plane(0, 0, 1e-6, 0, 0, 1);
        body.scene.model.gravity[0] = 3;
        body.scene.warp.kind = fitted ? PLIANT_FIT : PLIANT_RASTERIZE;
        ASSERT_EQ(body.build(), PLIANT_OK);
        ASSERT_EQ(pliant_data_set_warp(body.model, body.data, &body.scan.geometry), PLIANT_OK);
        body.settle();
        const pliant_volume *drawn = pliant_warp_volume(body.data->warp);
        auto *voxels = static_cast<const uint8_t *>(drawn->voxels);
        pictures[fitted].assign(voxels, voxels + 16 * 16 * 32);
    }
    int other = 0;
    for (size_t v = 0; v < pictures[0].size(); v++) other += pictures[0][v] != pictures[1][v];
    EXPECT_LT(other, 16 * 16 * 32 / 20);
    EXPECT_GT(other, 0);
}

} // namespace
