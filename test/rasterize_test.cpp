// The deformed volume against a search over all tetrahedra in double precision, and against the scan itself.
#include "warp/raster.h"
#include "warp_cases.h"

#include <cstring>
#include <limits>
#include <utility>

namespace {

using namespace warp_cases;

// A clamped trilinear sample, and its largest change when each coordinate is off by up to `off`.
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

// The allowed source points of a voxel: from its owner, and from every tetrahedron that a rounding error of 1e-3 voxel
// could make the owner.
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

TEST(rasterize, at_rest_is_the_scan_bit_for_bit)
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

TEST(rasterize, a_shift_by_whole_voxels_is_exact)
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

TEST(rasterize, exchanged_and_reversed_axes_are_exact)
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

TEST(rasterize, agrees_with_a_search_in_double)
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

TEST(rasterize, no_hole_where_faces_edges_and_nodes_meet_voxel_centres)
{
    // Cells of 3 voxels whose corners are voxel centres, displaced by multiples of a voxel or of a fraction of it.
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
        // Steps of 1, 1/2, 1/3, 1/4 voxel give many exact and nearly exact coincidences. Nodes of the hull stay.
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

TEST(rasterize, the_lowest_index_owns_what_two_hold)
{
    // Two overlapping layers of one mesh that share no nodes.
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

TEST(rasterize, inverted_and_flat_tetrahedra_draw_nothing)
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

TEST(rasterize, all_sets_of_inner_loops_give_the_same_bits)
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
                if (!pliant_warp_use(fast.get(), set)) continue; // not available on this machine
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

TEST(rasterize, mass_is_conserved_under_a_shear)
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
    pliant_geometry target;
    ASSERT_EQ(pliant_warp_target(&geometry, x.data(), mesh->num_nodes, 0, 10000000, &target), PLIANT_OK);
    auto warp = make_warp(*scan, *mesh, target);
    ASSERT_EQ(pliant_warp_update(warp.get(), x.data()), PLIANT_OK);
    const pliant_volume *out = pliant_warp_volume(warp.get());
    double mass = 0, mass_after = 0;
    for (size_t v = 0; v < pliant_geometry_voxels(&geometry); v++) mass += stored(*scan, v);
    for (size_t v = 0; v < pliant_geometry_voxels(&target); v++) mass_after += stored(*out, v);
    EXPECT_NEAR(mass_after / mass, 1, 0.01);
}

TEST(rasterize, survives_huge_positions)
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

TEST(rasterize, a_fine_target_of_a_small_part_shows_that_part)
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

} // namespace
