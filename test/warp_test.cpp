// The warp against a search over all tetrahedra in double, against the scan itself, and against itself.
#include "pliant/memory.h"
#include "pliant/warp.h"
#include "warp/raster.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstring>
#include <functional>
#include <limits>
#include <memory>
#include <random>
#include <vector>

namespace {

using vector3 = std::array<double, 3>;
using positions = std::vector<double>;

pliant_geometry box_geometry(int32_t x, int32_t y, int32_t z)
{
    return {{x, y, z}, {-0.02, 0.03, 0.1}, {0.001, 0.0015, 0.002}, {1, 0, 0, 0, 1, 0, 0, 0, 1}};
}

// axes turned by an angle about an oblique axis; mirrored: left-handed
void turn(pliant_geometry &geometry, double angle, bool mirrored)
{
    const double n[3] = {1 / 3.0, -2 / 3.0, 2 / 3.0}, c = std::cos(angle), s = std::sin(angle);
    const double cross[9] = {0, -n[2], n[1], n[2], 0, -n[0], -n[1], n[0], 0};
    for (int r = 0; r < 3; r++)
        for (int k = 0; k < 3; k++)
            geometry.direction[3 * r + k] =
                (c * (r == k) + s * cross[3 * r + k] + (1 - c) * n[r] * n[k]) * (mirrored && k == 1 ? -1 : 1);
}

struct volume_free { void operator()(pliant_volume *v) const { pliant_volume_free(v); delete v; } };
struct mesh_free { void operator()(pliant_mesh *m) const { pliant_mesh_free(m); delete m; } };
struct warp_free { void operator()(pliant_warp *w) const { pliant_warp_free(w); } };
using volume_ptr = std::unique_ptr<pliant_volume, volume_free>;
using mesh_ptr = std::unique_ptr<pliant_mesh, mesh_free>;
using warp_ptr = std::unique_ptr<pliant_warp, warp_free>;

double stored(const pliant_volume &volume, size_t v)
{
    switch (volume.encoding) {
    case PLIANT_UINT8: return static_cast<const uint8_t *>(volume.voxels)[v];
    case PLIANT_INT16: return static_cast<const int16_t *>(volume.voxels)[v];
    default: return static_cast<const float *>(volume.voxels)[v];
    }
}

// a smooth texture with some noise; float voxels also hold negative zeros
volume_ptr make_scan(const pliant_geometry &geometry, pliant_encoding encoding, double noise = 30)
{
    volume_ptr scan(new pliant_volume());
    EXPECT_EQ(pliant_volume_create(&geometry, encoding, scan.get()), PLIANT_OK);
    scan->background = encoding == PLIANT_UINT8 ? 7 : -1024;
    std::mt19937 random(5);
    std::uniform_real_distribution<double> uniform(-noise, noise);
    size_t v = 0;
    for (int k = 0; k < geometry.size[2]; k++)
        for (int j = 0; j < geometry.size[1]; j++)
            for (int i = 0; i < geometry.size[0]; i++, v++) {
                double value = 600 * std::sin(0.4 * i + 0.2 * j) * std::cos(0.3 * k - 0.1 * j) + uniform(random);
                if (encoding == PLIANT_UINT8)
                    static_cast<uint8_t *>(scan->voxels)[v] = uint8_t(std::lrint(128 + 0.19 * value));
                if (encoding == PLIANT_INT16) static_cast<int16_t *>(scan->voxels)[v] = int16_t(std::lrint(value));
                if (encoding == PLIANT_FLOAT32) static_cast<float *>(scan->voxels)[v] = v % 17 ? float(value) : -0.0f;
            }
    return scan;
}

mesh_ptr make_mesh(const pliant_geometry &geometry, int a, int b, int c, const std::vector<uint8_t> &keep = {})
{
    mesh_ptr mesh(new pliant_mesh());
    const int32_t cells[3] = {a, b, c};
    EXPECT_EQ(pliant_mesh_grid(&geometry, cells, keep.empty() ? nullptr : keep.data(), mesh.get()), PLIANT_OK);
    return mesh;
}

warp_ptr make_warp(const pliant_volume &scan, const pliant_mesh &mesh, const pliant_geometry &target, int threads = 2)
{
    pliant_warp *warp = nullptr;
    EXPECT_EQ(pliant_warp_create(&scan, &mesh, &target, threads, &warp), PLIANT_OK);
    return warp_ptr(warp);
}

positions rest_of(const pliant_mesh &mesh) { return positions(mesh.rest, mesh.rest + 3 * mesh.num_nodes); }

positions moved(const pliant_mesh &mesh, const std::function<vector3(const vector3 &)> &map)
{
    positions out = rest_of(mesh);
    for (size_t n = 0; n < out.size(); n += 3) {
        vector3 to = map({out[n], out[n + 1], out[n + 2]});
        std::copy(to.begin(), to.end(), out.begin() + n);
    }
    return out;
}

// waves of the given height [m]; with 4 mm and more some tetrahedra of the meshes here turn inside out
positions waves(const pliant_mesh &mesh, double height, double phase = 0)
{
    return moved(mesh, [&](const vector3 &x) {
        return vector3{x[0] + height * std::sin(150 * x[1] + 90 * x[2] + phase),
                       x[1] + height * std::cos(130 * x[0] + phase),
                       x[2] + 0.7 * height * std::sin(110 * x[0] + 140 * x[1] + 2 * phase)};
    });
}

std::vector<uint8_t> bytes_of(const pliant_volume &volume)
{
    const uint8_t *begin = static_cast<const uint8_t *>(volume.voxels);
    return {begin, begin + pliant_geometry_voxels(&volume.geometry) * pliant_encoding_size(volume.encoding)};
}

// Clamped trilinear sample, and how much it can change when each coordinate is off by up to `off`.
struct sample { double value, spread; };
sample sample_at(const pliant_volume &scan, const vector3 &at, double off)
{
    const int32_t *size = scan.geometry.size;
    auto value_at = [&](const vector3 &p) {
        int low[3];
        double t[3], sum = 0;
        for (int d = 0; d < 3; d++) {
            double x = std::min(std::max(p[d], 0.0), size[d] - 1.0);
            low[d] = std::min(int(x), std::max(size[d] - 2, 0));
            t[d] = x - low[d];
        }
        for (int c = 0; c < 8; c++) {
            double weight = 1;
            size_t v = 0, step = 1;
            for (int d = 0; d < 3; d++) {
                weight *= c >> d & 1 ? t[d] : 1 - t[d];
                v += step * size_t(std::min(low[d] + (c >> d & 1), size[d] - 1));
                step *= size_t(size[d]);
            }
            if (weight > 0) sum += weight * stored(scan, v);
        }
        return sum;
    };
    sample out = {value_at(at), 0};
    for (int c = 0; c < 8; c++) {
        vector3 p = at;
        for (int d = 0; d < 3; d++) p[d] += (c >> d & 1 ? off : -off);
        out.spread = std::max(out.spread, std::abs(value_at(p) - out.value));
    }
    return out;
}

// What a voxel may show: the source points of its owner, or of any that rounding of 1e-3 voxel could make the owner.
struct expected_voxel {
    std::vector<std::pair<int32_t, vector3>> near;
    int32_t certain = std::numeric_limits<int32_t>::max();
};

std::vector<expected_voxel> search(const pliant_volume &scan, const pliant_mesh &mesh, const pliant_geometry &target,
                                   const positions &x)
{
    const double rounding = 1e-3;
    std::vector<expected_voxel> voxels(pliant_geometry_voxels(&target));
    for (int32_t t = 0; t < mesh.num_tets; t++) {
        vector3 p[4], source[4];
        for (int v = 0; v < 4; v++) {
            int32_t n = mesh.tets[4 * t + v];
            pliant_geometry_to_index(&target, x.data() + 3 * n, p[v].data());
            pliant_geometry_to_index(&scan.geometry, mesh.rest + 3 * n, source[v].data());
        }
        double gradient[12];
        double volume =
            pliant_tet_gradients(x.data() + 3 * mesh.tets[4 * t], x.data() + 3 * mesh.tets[4 * t + 1],
                                 x.data() + 3 * mesh.tets[4 * t + 2], x.data() + 3 * mesh.tets[4 * t + 3], gradient);
        if (!(volume > 0)) continue;
        pliant_tet_gradients(p[0].data(), p[1].data(), p[2].data(), p[3].data(), gradient);
        int low[3], high[3], at[3];
        for (int d = 0; d < 3; d++) {
            auto ends = std::minmax({p[0][d], p[1][d], p[2][d], p[3][d]});
            low[d] = int(std::max(0.0, std::floor(ends.first)));
            high[d] = int(std::min(target.size[d] - 1.0, std::ceil(ends.second)));
        }
        for (at[2] = low[2]; at[2] <= high[2]; at[2]++)
            for (at[1] = low[1]; at[1] <= high[1]; at[1]++)
                for (at[0] = low[0]; at[0] <= high[0]; at[0]++) {
                    double inside = std::numeric_limits<double>::max();
                    vector3 from = {0, 0, 0};
                    for (int v = 0; v < 4; v++) {
                        const double *g = gradient + 3 * v;
                        const vector3 &q = p[(v + 1) % 4]; // on the face opposite to v
                        double b = g[0] * (at[0] - q[0]) + g[1] * (at[1] - q[1]) + g[2] * (at[2] - q[2]);
                        inside = std::min(inside, b / std::sqrt(g[0] * g[0] + g[1] * g[1] + g[2] * g[2]));
                        for (int d = 0; d < 3; d++) from[d] += b * source[v][d];
                    }
                    if (!(inside > -rounding)) continue;
                    expected_voxel &voxel =
                        voxels[size_t(at[0]) +
                               size_t(target.size[0]) * (size_t(at[1]) + size_t(target.size[1]) * size_t(at[2]))];
                    voxel.near.push_back({t, from});
                    if (inside > rounding) voxel.certain = std::min(voxel.certain, t);
                }
    }
    return voxels;
}

struct search_result { size_t tissue = 0, background = 0, doubtful = 0, wrong = 0; double worst = 0; };

search_result compare(const pliant_volume &scan, const pliant_volume &out, const pliant_mesh &mesh, const positions &x)
{
    search_result result;
    auto voxels = search(scan, mesh, out.geometry, x);
    const double whole = scan.encoding == PLIANT_FLOAT32 ? 1e-3 : 0.501;
    for (size_t v = 0; v < voxels.size(); v++) {
        const auto &voxel = voxels[v];
        bool none = voxel.certain == std::numeric_limits<int32_t>::max();
        double excess = none && stored(out, v) == scan.background ? 0 : std::numeric_limits<double>::infinity();
        for (const auto &owner : voxel.near) {
            if (owner.first > voxel.certain) continue;
            sample s = sample_at(scan, owner.second, 5e-4);
            excess = std::min(excess, std::abs(stored(out, v) - s.value) - s.spread - whole);
        }
        result.wrong += excess > 0;
        result.worst = std::max(result.worst, excess);
        result.doubtful += none && !voxel.near.empty();
        (voxel.near.empty() ? result.background : result.tissue)++;
    }
    return result;
}

pliant_geometry grown(const pliant_geometry &geometry, int voxels)
{
    pliant_geometry out = geometry;
    const double index[3] = {double(-voxels), double(-voxels), double(-voxels)};
    pliant_geometry_to_world(&geometry, index, out.origin);
    for (int d = 0; d < 3; d++) out.size[d] += 2 * voxels;
    return out;
}

const pliant_encoding encodings[3] = {PLIANT_UINT8, PLIANT_INT16, PLIANT_FLOAT32};

TEST(warp_target, is_the_scan_or_grows_by_whole_voxels)
{
    pliant_geometry scan = box_geometry(20, 30, 40), target = {};
    turn(scan, 0.3, false);
    ASSERT_EQ(pliant_warp_target(&scan, nullptr, nullptr, 24000, &target), PLIANT_OK);
    EXPECT_EQ(std::memcmp(&scan, &target, sizeof scan), 0);

    scan = box_geometry(20, 30, 40);
    const double tissue_low[3] = {-0.0205, 0.03 - 0.00075, 0.099}, tissue_high[3] = {-0.0005, 0.07425, 0.179};
    ASSERT_EQ(pliant_warp_target(&scan, tissue_low, tissue_high, 24000, &target), PLIANT_OK) << "the scan's own box";
    EXPECT_EQ(std::memcmp(&scan, &target, sizeof scan), 0);

    const double low[3] = {-0.0215, 0.035, 0.0985}, high[3] = {-0.001, 0.0758, 0.15};
    ASSERT_EQ(pliant_warp_target(&scan, low, high, 100000, &target), PLIANT_OK);
    EXPECT_EQ(target.size[0], 21);
    EXPECT_EQ(target.size[1], 32);
    EXPECT_EQ(target.size[2], 41);
    const double origin[3] = {-0.021, 0.03, 0.098};
    for (int d = 0; d < 3; d++) EXPECT_NEAR(target.origin[d], origin[d], 1e-12);
}

TEST(warp_target, refuses_what_cannot_be)
{
    pliant_geometry scan = box_geometry(20, 30, 40), target = {};
    const double low[3] = {0, 0, 0}, huge[3] = {1e30, 1, 1}, nan[3] = {std::nan(""), 1, 1}, below[3] = {-1, 1, 1};
    EXPECT_EQ(pliant_warp_target(&scan, nullptr, nullptr, 23999, &target), PLIANT_ERROR_ARGUMENT);
    EXPECT_EQ(pliant_warp_target(&scan, low, huge, SIZE_MAX, &target), PLIANT_ERROR_ARGUMENT);
    EXPECT_EQ(pliant_warp_target(&scan, low, nan, SIZE_MAX, &target), PLIANT_ERROR_ARGUMENT);
    EXPECT_EQ(pliant_warp_target(&scan, low, below, SIZE_MAX, &target), PLIANT_ERROR_ARGUMENT);
    EXPECT_EQ(pliant_warp_target(&scan, low, nullptr, SIZE_MAX, &target), PLIANT_ERROR_ARGUMENT);
    EXPECT_EQ(target.size[0], 0) << "untouched";
}

TEST(warp, at_rest_is_the_scan_bit_for_bit)
{
    for (int turned = 0; turned < 3; turned++)
        for (pliant_encoding encoding : encodings) {
            pliant_geometry geometry = box_geometry(45, 37, 30); // 45 / 6 and 30 / 4: faces through voxel centres
            if (turned) turn(geometry, 0.4, turned == 2);
            auto scan = make_scan(geometry, encoding);
            auto mesh = make_mesh(geometry, 6, 5, 4);
            auto warp = make_warp(*scan, *mesh, geometry);
            ASSERT_EQ(pliant_warp_update(warp.get(), mesh->rest), PLIANT_OK);
            EXPECT_TRUE(bytes_of(*scan) == bytes_of(*pliant_warp_volume(warp.get())))
                << "encoding " << encoding << ", axes " << turned;
        }
}

TEST(warp, keeps_what_goes_with_the_voxels)
{
    pliant_geometry geometry = box_geometry(20, 20, 20);
    auto scan = make_scan(geometry, PLIANT_INT16);
    scan->slope = 2, scan->intercept = -5;
    std::strcpy(scan->id, "the scan");
    auto mesh = make_mesh(geometry, 2, 2, 2);
    auto warp = make_warp(*scan, *mesh, geometry);
    const pliant_volume *out = pliant_warp_volume(warp.get());
    EXPECT_EQ(out->slope, 2);
    EXPECT_EQ(out->intercept, -5);
    EXPECT_EQ(out->background, scan->background);
    EXPECT_STREQ(out->id, "the scan");
    EXPECT_EQ(stored(*out, 0), -1024) << "background before the first update";
}

TEST(warp, a_shift_by_whole_voxels_is_exact)
{
    const int shift[3] = {5, -3, 2};
    for (bool mirrored : {false, true})
        for (pliant_encoding encoding : encodings) {
            pliant_geometry geometry = box_geometry(45, 37, 30);
            turn(geometry, 1.1, mirrored);
            auto scan = make_scan(geometry, encoding);
            auto mesh = make_mesh(geometry, 6, 5, 4);
            pliant_geometry target = grown(geometry, 4);
            auto warp = make_warp(*scan, *mesh, target);
            vector3 by = {0, 0, 0};
            for (int d = 0; d < 3; d++)
                for (int r = 0; r < 3; r++) by[r] += geometry.direction[3 * r + d] * geometry.spacing[d] * shift[d];
            auto x = moved(*mesh, [&](const vector3 &p) { return vector3{p[0] + by[0], p[1] + by[1], p[2] + by[2]}; });
            ASSERT_EQ(pliant_warp_update(warp.get(), x.data()), PLIANT_OK);
            const pliant_volume *out = pliant_warp_volume(warp.get());
            size_t voxel = pliant_encoding_size(encoding), wrong = 0, v = 0;
            for (int k = 0; k < target.size[2]; k++)
                for (int j = 0; j < target.size[1]; j++)
                    for (int i = 0; i < target.size[0]; i++, v++) {
                        int s[3] = {i - 4 - shift[0], j - 4 - shift[1], k - 4 - shift[2]};
                        bool inside = true;
                        for (int d = 0; d < 3; d++) inside &= s[d] >= 0 && s[d] < geometry.size[d];
                        if (!inside) {
                            wrong += stored(*out, v) != scan->background;
                            continue;
                        }
                        size_t from = size_t(s[0]) + size_t(geometry.size[0]) *
                                                         (size_t(s[1]) + size_t(geometry.size[1]) * size_t(s[2]));
                        wrong += std::memcmp(static_cast<uint8_t *>(out->voxels) + v * voxel,
                                             static_cast<uint8_t *>(scan->voxels) + from * voxel, voxel) != 0;
                    }
            EXPECT_EQ(wrong, 0u) << "encoding " << encoding << (mirrored ? ", mirrored" : "");
        }
}

TEST(warp, exchanged_and_reversed_axes_are_exact)
{
    pliant_geometry geometry = box_geometry(31, 22, 27);
    std::fill(geometry.spacing, geometry.spacing + 3, 0.001);
    pliant_geometry target = geometry; // its i runs along -k, j along i, k along j
    const double last[3] = {0, 0, 26};
    pliant_geometry_to_world(&geometry, last, target.origin);
    const int32_t size[3] = {27, 31, 22};
    const double direction[9] = {0, 1, 0, 0, 0, 1, -1, 0, 0};
    std::copy(size, size + 3, target.size);
    std::copy(direction, direction + 9, target.direction);
    for (pliant_encoding encoding : encodings) {
        auto scan = make_scan(geometry, encoding);
        auto mesh = make_mesh(geometry, 3, 2, 3);
        auto warp = make_warp(*scan, *mesh, target);
        ASSERT_EQ(pliant_warp_update(warp.get(), mesh->rest), PLIANT_OK);
        size_t wrong = 0, v = 0;
        for (int k = 0; k < 22; k++)
            for (int j = 0; j < 31; j++)
                for (int i = 0; i < 27; i++, v++)
                    wrong += stored(*pliant_warp_volume(warp.get()), v) !=
                             stored(*scan, size_t(j + 31 * (k + 22 * (26 - i))));
        EXPECT_EQ(wrong, 0u);
    }
}

TEST(warp, agrees_with_a_search_in_double)
{
    struct { double height, angle; bool mirrored; int target;
    } cases[] = {{0.0012, 0, false, 0},
                 {0.0025, 0.5, false, 1},
                 {0.0025, 0.5, true, 1},
                 {0.006, 0.2, false, 0},
                 {0.006, 0.9, true, 2}};
    for (auto &c : cases)
        for (pliant_encoding encoding : encodings) {
            pliant_geometry geometry = box_geometry(45, 37, 30);
            if (c.angle) turn(geometry, c.angle, c.mirrored);
            auto scan = make_scan(geometry, encoding);
            auto mesh = make_mesh(geometry, 4, 4, 3);
            pliant_geometry target = grown(geometry, 3);
            if (c.target) { // other axes, spacing and size
                turn(target, -0.4, c.target == 2);
                const double spacing[3] = {0.0013, 0.0011, 0.0017};
                const int32_t size[3] = {61, 50, 39};
                std::copy(spacing, spacing + 3, target.spacing);
                std::copy(size, size + 3, target.size);
                double middle[3] = {22, 18, 14.5}, centre[3], half[3] = {30, 24.5, 19}, off[3]; // about the same centre
                pliant_geometry_to_world(&geometry, middle, centre);
                pliant_geometry_to_world(&target, half, off);
                for (int d = 0; d < 3; d++) target.origin[d] += centre[d] - off[d];
            }
            auto warp = make_warp(*scan, *mesh, target);
            auto x = waves(*mesh, c.height);
            ASSERT_EQ(pliant_warp_update(warp.get(), x.data()), PLIANT_OK);
            search_result result = compare(*scan, *pliant_warp_volume(warp.get()), *mesh, x);
            EXPECT_EQ(result.wrong, 0u) << "height " << c.height << ", encoding " << encoding << ", worst by "
                                        << result.worst;
            EXPECT_GT(result.tissue, 20000u);
            EXPECT_GT(result.background, 5000u);
            EXPECT_LT(result.doubtful, result.tissue / 50) << "the search must be able to tell";
        }
}

TEST(warp, no_hole_where_faces_edges_and_nodes_meet_voxel_centres)
{
    // cells of 3 voxels whose corners are voxel centres, bent by multiples of a voxel or of a fraction of it
    pliant_geometry geometry = box_geometry(25, 25, 25);
    std::fill(geometry.spacing, geometry.spacing + 3, 0.001);
    auto scan = make_scan(geometry, PLIANT_INT16);
    std::fill_n(static_cast<int16_t *>(scan->voxels), 25 * 25 * 25, int16_t(100));
    pliant_geometry lattice = geometry;
    for (int d = 0; d < 3; d++) {
        lattice.origin[d] += 0.0005;
        lattice.size[d] = 24;
    }
    auto mesh = make_mesh(lattice, 8, 8, 8);
    auto warp = make_warp(*scan, *mesh, geometry);
    std::mt19937 random(3);
    for (int round = 0; round < 40; round++) {
        // steps of 1, 1/2, 1/3, 1/4 voxel: many exact and nearly exact coincidences; nodes of the hull stay
        std::uniform_int_distribution<int> step(-1, 1);
        double size = 0.001 / (1 + round % 4);
        positions x = rest_of(*mesh);
        for (int32_t n = 0; n < mesh->num_nodes; n++) {
            int32_t at = mesh->lattice_of_node[n], a = at % 9, b = at / 9 % 9, c = at / 81;
            for (int d = 0; d < 3; d++)
                if (a % 8 && b % 8 && c % 8) x[3 * size_t(n) + size_t(d)] += size * step(random);
        }
        ASSERT_EQ(pliant_warp_update(warp.get(), x.data()), PLIANT_OK);
        const int16_t *out = static_cast<int16_t *>(pliant_warp_volume(warp.get())->voxels);
        ASSERT_EQ(std::count(out, out + 25 * 25 * 25, 100), 25 * 25 * 25) << "round " << round;
    }
}

TEST(warp, the_lowest_index_owns_what_two_hold)
{
    // two layers pushed into each other: nodes of a mesh in two parts that share none
    pliant_geometry geometry = box_geometry(24, 24, 24);
    auto scan = make_scan(geometry, PLIANT_INT16);
    std::vector<uint8_t> keep(5 * 27, 1);
    for (int cell = 0; cell < 27; cell++)
        if (cell / 9 == 1) std::fill_n(keep.begin() + 5 * cell, 5, 0);
    auto mesh = make_mesh(geometry, 3, 3, 3, keep);
    auto warp = make_warp(*scan, *mesh, geometry);
    double middle = geometry.origin[2] + 11.5 * geometry.spacing[2];
    auto x = moved(*mesh, [&](const vector3 &p) {
        return vector3{p[0], p[1], p[2] + (p[2] < middle ? 0.012 : -0.014)};
    });
    ASSERT_EQ(pliant_warp_update(warp.get(), x.data()), PLIANT_OK);
    const pliant_volume *out = pliant_warp_volume(warp.get());
    search_result result = compare(*scan, *out, *mesh, x);
    EXPECT_EQ(result.wrong, 0u) << result.worst;
    // the lower layer, 8 voxels thick and moved up by 6, has the lower indices and covers voxels 6 to 13
    size_t wrong = 0;
    for (size_t v = 6 * 576; v < 14 * 576; v++) wrong += stored(*out, v) != stored(*scan, v - 6 * 576);
    EXPECT_EQ(wrong, 0u);
}

TEST(warp, inverted_and_flat_tetrahedra_draw_nothing)
{
    pliant_geometry geometry = box_geometry(24, 24, 24);
    for (bool mirrored : {false, true}) {
        turn(geometry, 0.7, mirrored);
        auto scan = make_scan(geometry, PLIANT_INT16);
        auto mesh = make_mesh(geometry, 3, 3, 3);
        auto warp = make_warp(*scan, *mesh, geometry);
        const pliant_volume *out = pliant_warp_volume(warp.get());
        double centre[3], index[3] = {11.5, 11.5, 11.5};
        pliant_geometry_to_world(&geometry, index, centre);
        for (double factor : {-1.0, 0.0}) {
            auto x = moved(*mesh, [&](const vector3 &p) {
                return vector3{p[0], p[1], centre[2] + factor * (p[2] - centre[2])};
            });
            ASSERT_EQ(pliant_warp_update(warp.get(), x.data()), PLIANT_OK);
            const int16_t *voxels = static_cast<int16_t *>(out->voxels);
            EXPECT_EQ(std::count(voxels, voxels + 24 * 24 * 24, -1024), 24 * 24 * 24) << "factor " << factor;
        }
    }
}

TEST(warp, all_sets_of_inner_loops_give_the_same_bits)
{
    const int32_t sizes[][3] = {{45, 37, 30}, {2, 9, 40}, {1, 20, 20}, {20, 1, 17}, {33, 16, 1}};
    for (auto &size : sizes)
        for (pliant_encoding encoding : encodings) {
            pliant_geometry geometry = box_geometry(size[0], size[1], size[2]);
            auto scan = make_scan(geometry, encoding);
            auto mesh = make_mesh(geometry, 3, 3, 3);
            pliant_geometry target = grown(geometry, 2);
            auto plain = make_warp(*scan, *mesh, target);
            ASSERT_TRUE(pliant_warp_use(plain.get(), RASTER_PORTABLE));
            for (raster_set set : {RASTER_AVX2, RASTER_AVX512}) {
                auto fast = make_warp(*scan, *mesh, target);
                if (!pliant_warp_use(fast.get(), set)) continue; // not on this machine
                for (double height : {0.0, 0.0007, 0.003, 0.02}) {
                    auto x = waves(*mesh, height);
                    ASSERT_EQ(pliant_warp_update(fast.get(), x.data()), PLIANT_OK);
                    ASSERT_EQ(pliant_warp_update(plain.get(), x.data()), PLIANT_OK);
                    EXPECT_TRUE(bytes_of(*pliant_warp_volume(fast.get())) == bytes_of(*pliant_warp_volume(plain.get())))
                        << size[0] << " x " << size[1] << " x " << size[2] << ", encoding " << encoding << ", height "
                        << height << ", set " << set;
                }
            }
        }
}

TEST(warp, does_not_depend_on_the_number_of_threads)
{
    pliant_geometry geometry = box_geometry(61, 50, 43);
    auto scan = make_scan(geometry, PLIANT_INT16);
    auto mesh = make_mesh(geometry, 5, 5, 4);
    auto x = waves(*mesh, 0.004);
    std::vector<uint8_t> first;
    for (int threads : {1, 2, 5}) {
        auto warp = make_warp(*scan, *mesh, grown(geometry, 5), threads);
        ASSERT_EQ(pliant_warp_update(warp.get(), x.data()), PLIANT_OK);
        auto bytes = bytes_of(*pliant_warp_volume(warp.get()));
        if (first.empty()) first = bytes;
        EXPECT_TRUE(first == bytes) << threads << " threads";
    }
}

// whether every voxel that differs lies in a brick reported as changed
bool reported(const pliant_warp *warp, const std::vector<uint8_t> &before, const std::vector<uint8_t> &after,
              size_t voxel)
{
    int32_t count[3];
    const uint8_t *changed;
    pliant_warp_bricks(warp, count, &changed);
    const int32_t *size = pliant_warp_volume(warp)->geometry.size;
    for (size_t byte = 0; byte < before.size(); byte++) {
        if (before[byte] == after[byte]) continue;
        size_t v = byte / voxel, i = v % size_t(size[0]), j = v / size_t(size[0]) % size_t(size[1]),
               k = v / size_t(size[0]) / size_t(size[1]);
        if (!changed[i / 16 + size_t(count[0]) * (j / 16 + size_t(count[1]) * (k / 16))]) return false;
    }
    return true;
}

size_t num_changed(const pliant_warp *warp)
{
    int32_t count[3];
    const uint8_t *changed;
    pliant_warp_bricks(warp, count, &changed);
    return size_t(std::count(changed, changed + count[0] * count[1] * count[2], 1));
}

TEST(warp, redoing_what_changed_equals_redoing_all)
{
    pliant_geometry geometry = box_geometry(80, 60, 50), target = grown(geometry, 6);
    auto scan = make_scan(geometry, PLIANT_INT16);
    auto mesh = make_mesh(geometry, 8, 6, 5);
    auto warp = make_warp(*scan, *mesh, target);
    std::mt19937 random(11);
    std::uniform_int_distribution<int32_t> some(0, mesh->num_nodes - 1), how_many(0, 12);
    std::uniform_real_distribution<double> by(-0.008, 0.008);
    positions x = rest_of(*mesh);
    ASSERT_EQ(pliant_warp_update(warp.get(), x.data()), PLIANT_OK);
    int32_t count[3];
    const uint8_t *changed;
    pliant_warp_bricks(warp.get(), count, &changed);
    EXPECT_EQ(count[0], 6);
    EXPECT_EQ(count[1], 5);
    EXPECT_EQ(count[2], 4);
    EXPECT_EQ(num_changed(warp.get()), 120u) << "the first update does all";
    size_t fewer = 0;
    for (int round = 0; round < 40; round++) {
        auto before = bytes_of(*pliant_warp_volume(warp.get()));
        for (int n = how_many(random); n >= 0; n--) {
            size_t node = size_t(some(random));
            for (size_t d = 0; d < 3; d++) x[3 * node + d] = mesh->rest[3 * node + d] + (round % 7 ? by(random) : 0);
        }
        if (round % 13 == 12) x = waves(*mesh, 0.03); // a tangle: tetrahedra across many bricks
        if (round % 13 == 0) x = rest_of(*mesh);
        ASSERT_EQ(pliant_warp_update(warp.get(), x.data()), PLIANT_OK);
        auto after = bytes_of(*pliant_warp_volume(warp.get()));
        auto fresh = make_warp(*scan, *mesh, target);
        ASSERT_EQ(pliant_warp_update(fresh.get(), x.data()), PLIANT_OK);
        ASSERT_TRUE(after == bytes_of(*pliant_warp_volume(fresh.get()))) << "round " << round;
        EXPECT_TRUE(reported(warp.get(), before, after, 2)) << "round " << round;
        fewer += num_changed(warp.get()) < 120;
    }
    EXPECT_GT(fewer, 20u);
}

TEST(warp, one_node_changes_the_bricks_around_it_and_no_other)
{
    pliant_geometry geometry = box_geometry(96, 96, 96);
    auto scan = make_scan(geometry, PLIANT_INT16);
    auto mesh = make_mesh(geometry, 12, 12, 12);
    auto warp = make_warp(*scan, *mesh, geometry);
    positions x = rest_of(*mesh);
    ASSERT_EQ(pliant_warp_update(warp.get(), x.data()), PLIANT_OK);
    ASSERT_EQ(pliant_warp_update(warp.get(), x.data()), PLIANT_OK);
    EXPECT_EQ(num_changed(warp.get()), 0u);
    size_t node = size_t(mesh->node_of_lattice[1 + 13 * (1 + 13 * 1)]); // at voxel 7.5, its cells end at 15.5
    x[3 * node] += 0.001;
    ASSERT_EQ(pliant_warp_update(warp.get(), x.data()), PLIANT_OK);
    EXPECT_EQ(num_changed(warp.get()), 1u);
}

TEST(warp, mass_is_conserved_under_a_shear)
{
    pliant_geometry geometry = box_geometry(60, 50, 40);
    auto scan = make_scan(geometry, PLIANT_INT16, 200);
    int16_t *voxels = static_cast<int16_t *>(scan->voxels);
    for (size_t v = 0; v < 60 * 50 * 40; v++) voxels[v] = int16_t(1500 + voxels[v]);
    scan->background = 0;
    auto mesh = make_mesh(geometry, 7, 6, 5);
    auto x = moved(*mesh, [&](const vector3 &p) { // three shears, one after the other
        double y = p[1] + 0.4 * (p[2] - 0.13), across = p[0] + 0.3 * (y - 0.06);
        return vector3{across, y, p[2] + 0.2 * (across + 0.01)};
    });
    double low[3] = {1e9, 1e9, 1e9}, high[3] = {-1e9, -1e9, -1e9};
    for (size_t n = 0; n < x.size(); n++) {
        low[n % 3] = std::min(low[n % 3], x[n]);
        high[n % 3] = std::max(high[n % 3], x[n]);
    }
    pliant_geometry target;
    ASSERT_EQ(pliant_warp_target(&geometry, low, high, 10000000, &target), PLIANT_OK);
    auto warp = make_warp(*scan, *mesh, target);
    ASSERT_EQ(pliant_warp_update(warp.get(), x.data()), PLIANT_OK);
    const pliant_volume *out = pliant_warp_volume(warp.get());
    double mass = 0, mass_after = 0;
    for (size_t v = 0; v < pliant_geometry_voxels(&geometry); v++) mass += stored(*scan, v);
    for (size_t v = 0; v < pliant_geometry_voxels(&target); v++) mass_after += stored(*out, v);
    EXPECT_NEAR(mass_after / mass, 1, 0.01);
}

TEST(warp, refuses_positions_that_are_not_finite)
{
    pliant_geometry geometry = box_geometry(40, 40, 40);
    auto scan = make_scan(geometry, PLIANT_INT16);
    auto mesh = make_mesh(geometry, 3, 3, 3);
    auto warp = make_warp(*scan, *mesh, geometry);
    auto x = waves(*mesh, 0.002);
    ASSERT_EQ(pliant_warp_update(warp.get(), x.data()), PLIANT_OK);
    auto before = bytes_of(*pliant_warp_volume(warp.get()));
    for (double bad : {std::nan(""), double(INFINITY), -double(INFINITY)}) {
        auto y = waves(*mesh, 0.001);
        y[100] = bad;
        EXPECT_EQ(pliant_warp_update(warp.get(), y.data()), PLIANT_ERROR_ARGUMENT);
        EXPECT_TRUE(before == bytes_of(*pliant_warp_volume(warp.get())));
        EXPECT_EQ(num_changed(warp.get()), 27u) << "flags of the last update that was done";
    }
    ASSERT_EQ(pliant_warp_update(warp.get(), x.data()), PLIANT_OK);
    EXPECT_EQ(num_changed(warp.get()), 0u);
}

TEST(warp, survives_huge_positions)
{
    pliant_geometry geometry = box_geometry(40, 40, 40);
    for (pliant_encoding encoding : encodings) {
        auto scan = make_scan(geometry, encoding);
        auto mesh = make_mesh(geometry, 3, 3, 3);
        auto warp = make_warp(*scan, *mesh, geometry), plain = make_warp(*scan, *mesh, geometry);
        ASSERT_TRUE(pliant_warp_use(plain.get(), RASTER_PORTABLE));
        std::mt19937 random(2);
        for (double huge : {0.3, 10.0, 1e30, 1e300, 1.7e308})
            for (int round = 0; round < 4; round++) {
                positions x = rest_of(*mesh);
                for (double &v : x)
                    if (random() % (round < 2 ? 10 : 2) == 0) v = (random() % 2 ? 1 : -1) * huge;
                ASSERT_EQ(pliant_warp_update(warp.get(), x.data()), PLIANT_OK);
                ASSERT_EQ(pliant_warp_update(plain.get(), x.data()), PLIANT_OK);
                ASSERT_TRUE(bytes_of(*pliant_warp_volume(warp.get())) == bytes_of(*pliant_warp_volume(plain.get())));
            }
        ASSERT_EQ(pliant_warp_update(warp.get(), mesh->rest), PLIANT_OK);
        EXPECT_TRUE(bytes_of(*scan) == bytes_of(*pliant_warp_volume(warp.get()))) << "and comes back";
    }
}

TEST(warp, a_fine_target_of_a_small_part_shows_that_part)
{
    // target voxels of a tenth: tetrahedra reach far beyond the target
    pliant_geometry geometry = box_geometry(40, 40, 40), target = geometry;
    auto scan = make_scan(geometry, PLIANT_FLOAT32);
    auto mesh = make_mesh(geometry, 2, 2, 2);
    const double corner[3] = {16, 17, 18};
    pliant_geometry_to_world(&geometry, corner, target.origin);
    for (int d = 0; d < 3; d++) {
        target.spacing[d] *= 0.1;
        target.size[d] = 30;
    }
    auto warp = make_warp(*scan, *mesh, target);
    auto x = waves(*mesh, 0.004);
    ASSERT_EQ(pliant_warp_update(warp.get(), x.data()), PLIANT_OK);
    search_result result = compare(*scan, *pliant_warp_volume(warp.get()), *mesh, x);
    EXPECT_EQ(result.wrong, 0u) << result.worst;
    EXPECT_GT(result.tissue, 26000u);
}

TEST(warp, refuses_what_it_cannot_warp)
{
    pliant_geometry geometry = box_geometry(20, 20, 20), tiny = geometry;
    auto scan = make_scan(geometry, PLIANT_INT16);
    auto mesh = make_mesh(geometry, 2, 2, 2);
    pliant_warp *warp = nullptr;
    EXPECT_EQ(pliant_warp_create(scan.get(), mesh.get(), &geometry, 0, &warp), PLIANT_ERROR_ARGUMENT);
    for (double &s : tiny.spacing) s *= 1e-5;
    EXPECT_EQ(pliant_warp_create(scan.get(), mesh.get(), &tiny, 1, &warp), PLIANT_ERROR_ARGUMENT);
    mesh->tets[17] = mesh->num_nodes;
    EXPECT_EQ(pliant_warp_create(scan.get(), mesh.get(), &geometry, 1, &warp), PLIANT_ERROR_ARGUMENT);
    EXPECT_EQ(warp, nullptr);
}

TEST(warp, running_out_of_memory_changes_nothing)
{
    pliant_geometry geometry = box_geometry(40, 40, 40);
    auto scan = make_scan(geometry, PLIANT_INT16);
    auto mesh = make_mesh(geometry, 4, 4, 4);
    size_t in_use = pliant_memory_in_use();
    // first all in the middle, where few bricks are touched; then everywhere, which takes a longer list
    auto spread = waves(*mesh, 0.002), small = moved(*mesh, [](const vector3 &p) {
        return vector3{0.2 * p[0], 0.06 + 0.2 * (p[1] - 0.06), 0.14 + 0.2 * (p[2] - 0.14)};
    }), nudged = small;
    nudged[3 * 62] += 0.003;
    int64_t calls = 0;
    int updates_failed = 0;
    for (bool done = false; !done; calls++) {
        ASSERT_LT(calls, 100);
        pliant_warp *warp = nullptr;
        pliant_memory_fail_after(calls);
        pliant_status status = pliant_warp_create(scan.get(), mesh.get(), &geometry, 2, &warp);
        if (status == PLIANT_OK) status = pliant_warp_update(warp, small.data());
        std::vector<uint8_t> before;
        std::vector<uint8_t> flags;
        int32_t count[3];
        const uint8_t *changed;
        if (status == PLIANT_OK) {
            before = bytes_of(*pliant_warp_volume(warp));
            pliant_warp_bricks(warp, count, &changed);
            flags.assign(changed, changed + count[0] * count[1] * count[2]);
            status = pliant_warp_update(warp, spread.data());
        }
        done = status == PLIANT_OK;
        pliant_memory_fail_after(-1);
        EXPECT_EQ(status, done ? PLIANT_OK : PLIANT_ERROR_MEMORY);
        if (!done && !before.empty()) {
            updates_failed++;
            EXPECT_TRUE(before == bytes_of(*pliant_warp_volume(warp)));
            pliant_warp_bricks(warp, count, &changed);
            EXPECT_EQ(std::memcmp(changed, flags.data(), flags.size()), 0);
        }
        for (const positions *x : {&nudged, &spread}) { // and it goes on from there
            if (!warp) break;
            ASSERT_EQ(pliant_warp_update(warp, x->data()), PLIANT_OK);
            auto fresh = make_warp(*scan, *mesh, geometry);
            ASSERT_EQ(pliant_warp_update(fresh.get(), x->data()), PLIANT_OK);
            EXPECT_TRUE(bytes_of(*pliant_warp_volume(warp)) == bytes_of(*pliant_warp_volume(fresh.get())));
        }
        pliant_warp_free(warp);
        EXPECT_EQ(pliant_memory_in_use(), in_use) << "leak after failing call " << calls;
    }
    EXPECT_GT(calls, 13) << "every allocation has failed once";
    EXPECT_EQ(updates_failed, 1);
    pliant_warp_free(nullptr);
}

} // namespace
