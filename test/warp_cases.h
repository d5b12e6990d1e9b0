// Scans, meshes and deformations for the tests of the warp.
#ifndef PLIANT_TEST_WARP_CASES_H
#define PLIANT_TEST_WARP_CASES_H

#include "mesh/mesh.h"
#include "pliant/warp.h"
#include "scan/volume.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <functional>
#include <memory>
#include <random>
#include <vector>

namespace warp_cases {

using vector3 = std::array<double, 3>;
using positions = std::vector<double>;

inline pliant_geometry box_geometry(int32_t x, int32_t y, int32_t z)
{
    return {{x, y, z}, {-0.02, 0.03, 0.1}, {0.001, 0.0015, 0.002}, {1, 0, 0, 0, 1, 0, 0, 0, 1}};
}

// Rotate the axes by an angle about an oblique axis. mirrored: left-handed.
inline void turn(pliant_geometry &geometry, double angle, bool mirrored)
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

inline double stored(const pliant_volume &volume, size_t v)
{
    switch (volume.encoding) {
    case PLIANT_UINT8: return static_cast<const uint8_t *>(volume.voxels)[v];
    case PLIANT_INT16: return static_cast<const int16_t *>(volume.voxels)[v];
    default: return static_cast<const float *>(volume.voxels)[v];
    }
}

// A smooth texture with some noise. Float voxels also contain negative zeros.
inline volume_ptr make_scan(const pliant_geometry &geometry, pliant_encoding encoding, double noise = 30)
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

inline mesh_ptr make_mesh(const pliant_geometry &geometry, int a, int b, int c, const std::vector<uint8_t> &keep = {})
{
    mesh_ptr mesh(new pliant_mesh());
    const int32_t cells[3] = {a, b, c};
    EXPECT_EQ(pliant_mesh_grid(&geometry, cells, keep.empty() ? nullptr : keep.data(), mesh.get()), PLIANT_OK);
    return mesh;
}

inline warp_ptr make_warp(const pliant_volume &scan, const pliant_mesh &mesh, const pliant_geometry &target,
                          int threads = 2)
{
    pliant_warp *warp = nullptr;
    EXPECT_EQ(pliant_warp_create(&scan, &mesh, &target, threads, &warp), PLIANT_OK);
    return warp_ptr(warp);
}

inline positions rest_of(const pliant_mesh &mesh) { return positions(mesh.rest, mesh.rest + 3 * mesh.num_nodes); }

inline positions moved(const pliant_mesh &mesh, const std::function<vector3(const vector3 &)> &map)
{
    positions out = rest_of(mesh);
    for (size_t n = 0; n < out.size(); n += 3) {
        vector3 to = map({out[n], out[n + 1], out[n + 2]});
        std::copy(to.begin(), to.end(), out.begin() + n);
    }
    return out;
}

// Waves of the given height [m]. From 4 mm on, some tetrahedra of these meshes are inverted.
inline positions waves(const pliant_mesh &mesh, double height, double phase = 0)
{
    return moved(mesh, [&](const vector3 &x) {
        return vector3{x[0] + height * std::sin(150 * x[1] + 90 * x[2] + phase),
                       x[1] + height * std::cos(130 * x[0] + phase),
                       x[2] + 0.7 * height * std::sin(110 * x[0] + 140 * x[1] + 2 * phase)};
    });
}

inline std::vector<uint8_t> bytes_of(const pliant_volume &volume)
{
    const uint8_t *begin = static_cast<const uint8_t *>(volume.voxels);
    return {begin, begin + pliant_geometry_voxels(&volume.geometry) * pliant_encoding_size(volume.encoding)};
}

inline pliant_geometry grown(const pliant_geometry &geometry, int voxels)
{
    pliant_geometry out = geometry;
    const double index[3] = {double(-voxels), double(-voxels), double(-voxels)};
    pliant_geometry_to_world(&geometry, index, out.origin);
    for (int d = 0; d < 3; d++) out.size[d] += 2 * voxels;
    return out;
}

const pliant_encoding encodings[3] = {PLIANT_UINT8, PLIANT_INT16, PLIANT_FLOAT32};

} // namespace warp_cases

#endif
