// The deformed volume of a cut body: against the scan, against each side interpolated separately, and from body to
// body.
#include "cut_cases.h"
#include "base/memory.h"
#include "tool/pick.h"
#include "warp/warp_state.h"
#include "warp/warp.h"

#include <cstring>

namespace {

using namespace warp_cases;
using cut_cases::CutBody;
using cut_cases::plane;

const vector3 normals[] = {{0.31, 0.83, -0.46}, {1, 0.02, 0.01}, {-0.4, 0.3, 0.87}, {0, 0, 1}, {0.577, 0.577, 0.578}};

// A scan, its mesh and its voxels.
struct Scene {
    pliant_geometry geometry;
    volume_ptr scan;
    mesh_ptr mesh;
    cut_cases::voxels_ptr voxels;
    vector3 middle;
    Scene(pliant_encoding encoding, int turned, int32_t a = 6, int32_t b = 5, int32_t c = 4, int32_t x = 45,
          int32_t y = 37, int32_t z = 30)
        : geometry(box_geometry(x, y, z))
    {
        if (turned) turn(geometry, 0.4, turned == 2);
        scan = make_scan(geometry, encoding);
        mesh = make_mesh(geometry, a, b, c);
        voxels = cut_cases::make_voxels(*mesh, geometry);
        middle = {0.5 * x - 0.8, 0.5 * y - 0.3, 0.5 * z - 0.6};
    }
    warp_ptr draw(const CutBody &cut, const pliant_geometry &target, const positions &x, int threads = 2,
                  int set = -1) const
    {
        warp_ptr warp = make_warp(*scan, *mesh, target, threads);
        if (set >= 0 && !pliant_warp_use(warp.get(), static_cast<raster_set>(set))) return nullptr;
        EXPECT_EQ(pliant_warp_set_body(warp.get(), &cut.body), PLIANT_OK) << pliant_last_error();
        EXPECT_EQ(pliant_warp_update(warp.get(), x.data()), PLIANT_OK) << pliant_last_error();
        return warp;
    }
};

double side_of(const vector3 &at, const vector3 &through, const vector3 &normal)
{
    return normal[0] * (at[0] - through[0]) + normal[1] * (at[1] - through[1]) + normal[2] * (at[2] - through[2]);
}

TEST(cut_warp, at_rest_is_the_scan_bit_for_bit)
{
    int carried_tets = 0, chips = 0, fragments = 0;
    for (int turned = 0; turned < 3; turned++)
        for (pliant_encoding encoding : encodings) {
            Scene scene(encoding, turned);
            for (const vector3 &normal : normals)
                for (int partly = 0; partly < 2; partly++) {
                    if (turned && partly != (encoding == PLIANT_INT16)) continue;
                    const vector3 middle = scene.middle;
                    CutBody cut(
                        *scene.mesh, *scene.voxels,
                        {plane(middle, normal, [=](const vector3 &at) { return !partly || at[1] < middle[1]; })},
                        2 * partly);
                    fragments += int(cut.fragment.size() - cut.tet.size());
                    auto warp = scene.draw(cut, scene.geometry, rest_of(cut.body.fine));
                    ASSERT_TRUE(bytes_of(*scene.scan) == bytes_of(*pliant_warp_volume(warp.get())))
                        << encoding << ", axes " << turned << ", " << normal[0];
                    carried_tets += warp->parts->num_carried_tets;
                    chips += cut.chips;
                }
        }
    EXPECT_GT(fragments, 3000); // the cases have many fragments
    EXPECT_GT(carried_tets, 1000);
    EXPECT_GT(chips, 100);
}

// The two sides of a plane, each with its own affine map.
struct Sides {
    vector3 through, normal;
    double apart, stretch; // gap along the normal [index]; stretch of each side
    // Map a rest point (index) to its deformed position.
    vector3 forward(const vector3 &rest, bool above) const
    {
        vector3 out;
        for (size_t d = 0; d < 3; d++) {
            out[d] = through[d] + (rest[d] - through[d]) * (1 + (above ? stretch : -0.5 * stretch)) +
                     (above ? 0.5 : -0.5) * apart * normal[d];
            if (above) out[d] += stretch * (rest[(d + 1) % 3] - through[(d + 1) % 3]) * 0.7;
        }
        return out;
    }
    vector3 back(const vector3 &now, bool above) const
    {
        vector3 at = now;
        for (int pass = 0; pass < 14; pass++) {
            vector3 there = forward(at, above);
            for (size_t d = 0; d < 3; d++) at[d] += now[d] - there[d];
        }
        return at;
    }
};

// Return the node positions: one map for fragments above the plane, another for all others.
positions part_sides(const CutBody &cut, const pliant_geometry &geometry, const Sides &sides)
{
    const pliant_mesh &mesh = cut.body.fine;
    std::vector<int> above(size_t(mesh.num_nodes), -1);
    auto tell = [&](int32_t tet, bool is) {
        for (int v = 0; v < 4; v++) {
            int &node = above[size_t(mesh.tets[4 * tet + v])];
            EXPECT_TRUE(node < 0 || node == int(is)) << "the plane leaks at node " << mesh.tets[4 * tet + v];
            node = is;
        }
    };
    for (int32_t v = 0; v < int32_t(pliant_geometry_voxels(&geometry)); v++)
        if (cut.body.voxels->owner[v] >= 0)
            tell(cut.fragment_of(v), side_of(cut.place(v), sides.through, sides.normal) >= 0);
    positions x = rest_of(mesh);
    for (size_t n = 0; n < above.size(); n++) {
        vector3 index, now;
        pliant_geometry_to_index(&geometry, x.data() + 3 * n, index.data());
        now = sides.forward(index, above[n] == 1);
        pliant_geometry_to_world(&geometry, now.data(), x.data() + 3 * n);
    }
    return x;
}

struct Counts { int right = 0, wrong = 0, holes = 0, ghosts = 0, doubtful = 0; };

// Compare each voxel of the target with the interpolation of one side's voxels.
Counts compare_sides(const Scene &scene, const pliant_volume &out, const Sides &sides)
{
    Counts counts;
    const int32_t *size = scene.geometry.size;
    const double doubt = 0.02;
    for (size_t v = 0; v < pliant_geometry_voxels(&out.geometry); v++) {
        const int32_t *target = out.geometry.size;
        vector3 index = {double(v % size_t(target[0])), double(v / size_t(target[0]) % size_t(target[1])),
                         double(v / size_t(target[0]) / size_t(target[1]))};
        double world[3];
        pliant_geometry_to_world(&out.geometry, index.data(), world);
        pliant_geometry_to_index(&scene.geometry, world, index.data());
        bool sure = false, possible = false, fits = false;
        for (bool above : {false, true}) {
            const vector3 at = sides.back(index, above);
            bool in = true, far_in = true;
            int32_t low[3];
            double part[3], weights = 0, sum = 0, minimum = 1e30, maximum = -1e30;
            for (int d = 0; d < 3; d++) {
                in = in && at[size_t(d)] > -0.5 - 1e-3 && at[size_t(d)] < size[d] - 0.5 + 1e-3;
                far_in = far_in && at[size_t(d)] > -0.5 + 1e-3 && at[size_t(d)] < size[d] - 0.5 - 1e-3;
                const double inside = std::min(std::max(at[size_t(d)], 0.0), size[d] - 1.0);
                low[d] = std::min(int32_t(inside), size[d] - 2);
                part[d] = inside - low[d];
            }
            if (!in) continue;
            for (int c = 0; c < 8; c++) {
                const vector3 corner = {double(low[0] + (c & 1)), double(low[1] + (c >> 1 & 1)),
                                        double(low[2] + (c >> 2))};
                double weight = 1;
                for (int d = 0; d < 3; d++) weight *= c >> d & 1 ? part[d] : 1 - part[d];
                if ((side_of(corner, sides.through, sides.normal) >= 0) != above) continue;
                const double value =
                    stored(*scene.scan, size_t(corner[0]) + size_t(size[0]) * (size_t(corner[1]) +
                                                                               size_t(size[1]) * size_t(corner[2])));
                weights += weight;
                sum += weight * value;
                minimum = std::min(minimum, value);
                maximum = std::max(maximum, value);
            }
            if (weights < 0.5 - doubt) continue;
            possible = true;
            sure = sure || (far_in && weights > 0.5 + doubt);
            fits = fits || std::abs(stored(out, v) - sum / weights) < 1.5 + 2e-4 * (maximum - minimum);
        }
        const bool none = stored(out, v) == scene.scan->background;
        if (fits || (none && !possible)) counts.right++;
        else if (none && sure) counts.holes++;
        else if (none) counts.doubtful++;
        else if (!possible) counts.ghosts++;
        else counts.wrong++;
    }
    return counts;
}

TEST(cut_warp, each_side_is_drawn_from_its_own_voxels)
{
    for (int turned : {0, 2}) {
        Scene scene(PLIANT_INT16, turned);
        const pliant_geometry target = grown(scene.geometry, 6);
        for (const vector3 &normal : normals)
            for (double apart : {0.0, 0.7, 3.3})
                for (double stretch : {0.0, 0.05}) {
                    if (stretch > 0 && apart < 3) continue; // sheared sides would pass through each other
                    const Sides sides = {scene.middle, normal, apart, stretch};
                    CutBody cut(*scene.mesh, *scene.voxels, {plane(scene.middle, normal)});
                    auto warp = scene.draw(cut, target, part_sides(cut, scene.geometry, sides));
                    const Counts counts = compare_sides(scene, *pliant_warp_volume(warp.get()), sides);
                    EXPECT_EQ(counts.wrong, 0)
                        << normal[0] << ", apart " << apart << ", stretched " << stretch << ", of " << counts.right;
                    EXPECT_EQ(counts.holes, 0) << normal[0] << ", apart " << apart << ", stretched " << stretch;
                    EXPECT_EQ(counts.ghosts, 0) << normal[0] << ", apart " << apart << ", stretched " << stretch;
                    EXPECT_GT(counts.right, 50000);
                    EXPECT_LT(counts.doubtful, 1500);
                }
    }
}

TEST(cut_warp, saved_while_it_is_open)
{
    Scene scene(PLIANT_INT16, 0);
    const Sides sides = {scene.middle, normals[0], 3.3, 0};
    CutBody cut(*scene.mesh, *scene.voxels, {plane(scene.middle, sides.normal)});
    auto warp = scene.draw(cut, grown(scene.geometry, 6), part_sides(cut, scene.geometry, sides));
    const std::string path = testing::TempDir() + "pliant_open_cut.nii.gz";
    ASSERT_EQ(pliant_volume_write(path.c_str(), pliant_warp_volume(warp.get())), PLIANT_OK) << pliant_last_error();
    pliant_volume saved{};
    ASSERT_EQ(pliant_volume_read(path.c_str(), nullptr, 0, &saved), PLIANT_OK) << pliant_last_error();
    std::remove(path.c_str());
    EXPECT_TRUE(bytes_of(saved) == bytes_of(*pliant_warp_volume(warp.get())));
    const Counts counts = compare_sides(scene, saved, sides);
    EXPECT_EQ(counts.wrong + counts.holes + counts.ghosts, 0);
    size_t gap = 0; // voxels between the sides
    for (size_t v = 0; v < pliant_geometry_voxels(&saved.geometry); v++) {
        const int32_t *size = saved.geometry.size;
        vector3 at = {double(v % size_t(size[0])), double(v / size_t(size[0]) % size_t(size[1])),
                      double(v / size_t(size[0]) / size_t(size[1]))};
        double world[3];
        pliant_geometry_to_world(&saved.geometry, at.data(), world);
        pliant_geometry_to_index(&scene.geometry, world, at.data());
        bool within = true;
        for (size_t d = 0; d < 3; d++) within = within && at[d] > 4 && at[d] < scene.geometry.size[d] - 5;
        if (!within || std::fabs(side_of(at, sides.through, sides.normal)) > 0.4) continue;
        EXPECT_EQ(stored(saved, v), scene.scan->background);
        gap++;
    }
    EXPECT_GT(gap, 200u);
    pliant_volume_free(&saved);
}

// Rays into an open cut: the picked rest point is on the same side as the picked fragment.
TEST(cut_warp, a_ray_finds_the_side_that_is_there)
{
    Scene scene(PLIANT_UINT8, 1);
    std::fill_n(static_cast<uint8_t *>(scene.scan->voxels), pliant_geometry_voxels(&scene.geometry), uint8_t(200));
    const Sides sides = {scene.middle, {0.99, 0.1, 0.1}, 5, 0};
    CutBody cut(*scene.mesh, *scene.voxels, {plane(scene.middle, sides.normal)});
    const positions x = part_sides(cut, scene.geometry, sides);
    auto warp = scene.draw(cut, grown(scene.geometry, 6), x);
    std::vector<int> above(size_t(cut.body.fine.num_tets), -1);
    for (int32_t v = 0; v < int32_t(pliant_geometry_voxels(&scene.geometry)); v++)
        if (scene.voxels->owner[v] >= 0)
            above[size_t(cut.fragment_of(v))] = side_of(cut.place(v), sides.through, sides.normal) >= 0;
    int hits[2] = {0, 0};
    for (int n = 0; n < 400; n++) {
        const vector3 from = {scene.middle[0] + 0.03 * (n - 200), scene.middle[1] + 0.04 * (n % 40 - 20), 60},
                      to = {from[0] + 0.02 * (n % 7 - 3), from[1], 0};
        pliant_ray ray{};
        double end[3];
        pliant_geometry_to_world(&scene.geometry, from.data(), ray.origin);
        pliant_geometry_to_world(&scene.geometry, to.data(), end);
        for (int d = 0; d < 3; d++) ray.direction[d] = end[d] - ray.origin[d];
        pliant_picked picked{};
        ASSERT_EQ(pliant_pick_warped(warp.get(), x.data(), &ray, 100, &picked), PLIANT_OK) << pliant_last_error();
        if (!picked.hit) continue;
        vector3 rest;
        pliant_geometry_to_index(&scene.geometry, picked.rest, rest.data());
        const int side = above[size_t(picked.tetrahedron)];
        ASSERT_GE(side, 0);
        EXPECT_GT((side ? 1 : -1) * side_of(rest, sides.through, sides.normal), -1.5) << "ray " << n;
        hits[side]++;
    }
    EXPECT_GT(hits[0], 60);
    EXPECT_GT(hits[1], 60);
}

// Each side of a bent cut has one intensity. No deformation of the pieces draws an intensity in between.
TEST(cut_warp, nothing_bleeds_across)
{
    Scene scene(PLIANT_UINT8, 1);
    const vector3 middle = scene.middle, normal = normals[0], other = normals[2];
    const std::vector<cut_cases::Blade> blades = {plane(middle, normal), plane(middle, other)};
    for (size_t v = 0; v < pliant_geometry_voxels(&scene.geometry); v++) {
        const vector3 at = {double(v % 45), double(v / 45 % 37), double(v / 45 / 37)};
        static_cast<uint8_t *>(scene.scan->voxels)[v] =
            uint8_t(50 + 60 * (side_of(at, middle, normal) >= 0) + 120 * (side_of(at, middle, other) >= 0));
    }
    CutBody cut(*scene.mesh, *scene.voxels, blades, 2);
    EXPECT_GT(cut.chips, 0);
    std::mt19937 random(7);
    std::uniform_real_distribution<double> by(-0.004, 0.004);
    for (int round = 0; round < 6; round++) {
        auto x = waves(cut.body.fine, 0.003, round);
        // each copied node moves by itself
        for (size_t n = size_t(scene.mesh->num_nodes); n < cut.node_parent.size(); n++)
            for (size_t d = 0; d < 3; d++) x[3 * n + d] += by(random);
        auto warp = scene.draw(cut, grown(scene.geometry, 5), x);
        const auto bytes = bytes_of(*pliant_warp_volume(warp.get()));
        const std::vector<uint8_t> allowed = {7, 50, 110, 170, 230};
        for (uint8_t value : allowed) EXPECT_GT(std::count(bytes.begin(), bytes.end(), value), 1000);
        EXPECT_EQ(
            std::count_if(bytes.begin(), bytes.end(),
                          [&](uint8_t b) { return std::find(allowed.begin(), allowed.end(), b) == allowed.end(); }),
            0);
    }
}

TEST(cut_warp, all_loops_and_threads_give_the_same_bits)
{
    for (pliant_encoding encoding : encodings) {
        Scene scene(encoding, 2);
        CutBody cut(*scene.mesh, *scene.voxels,
                    {plane(scene.middle, normals[0]),
                     plane(scene.middle, normals[2], [](const vector3 &at) { return at[0] > 15; })},
                    2);
        auto x = waves(cut.body.fine, 0.003);
        for (size_t n = size_t(scene.mesh->num_nodes); n < cut.node_parent.size(); n++) x[3 * n] += 0.002;
        const pliant_geometry target = grown(scene.geometry, 3);
        const auto plain = bytes_of(*pliant_warp_volume(scene.draw(cut, target, x, 1, RASTER_PORTABLE).get()));
        for (int set : {RASTER_PORTABLE, RASTER_AVX2, RASTER_AVX512})
            for (int threads : {1, 2, 3}) {
                auto warp = scene.draw(cut, target, x, threads, set);
                if (warp) {
                    EXPECT_TRUE(plain == bytes_of(*pliant_warp_volume(warp.get())))
                        << encoding << ", loops " << set << ", threads " << threads;
                }
            }
    }
}

// Check that every different voxel lies in a reported brick. Return the number of reported bricks.
size_t changed_bricks(const pliant_warp *warp, const std::vector<uint8_t> &before, const std::vector<uint8_t> &after)
{
    int32_t count[3];
    const uint8_t *changed;
    pliant_warp_bricks(warp, count, &changed);
    const size_t x = size_t(pliant_warp_volume(warp)->geometry.size[0]),
                 y = size_t(pliant_warp_volume(warp)->geometry.size[1]);
    size_t untold = 0;
    for (size_t v = 0; v < before.size(); v++)
        untold += before[v] != after[v] &&
                  !changed[v % x / 16 + size_t(count[0]) * (v / x % y / 16 + size_t(count[1]) * (v / x / y / 16))];
    EXPECT_EQ(untold, 0u);
    return size_t(std::count(changed, changed + count[0] * count[1] * count[2], 1));
}

// Two sides moved apart and bent: far from the cut the fit is drawn, and there is no leak, no hole and no voxel of the
// other side.
TEST(cut_warp, a_fit_does_not_reach_across)
{
    Scene scene(PLIANT_UINT8, 0, 12, 10, 8, 96, 80, 64);
    const pliant_geometry target = grown(scene.geometry, 6);
    const vector3 middle = scene.middle, normal = normals[0];
    for (size_t v = 0; v < pliant_geometry_voxels(&scene.geometry); v++) {
        const vector3 at = {double(v % 96), double(v / 96 % 80), double(v / 96 / 80)};
        static_cast<uint8_t *>(scene.scan->voxels)[v] = side_of(at, middle, normal) >= 0 ? 200 : 100;
    }
    CutBody cut(*scene.mesh, *scene.voxels, {plane(middle, normal)}, 2);
    const Sides sides = {middle, normal, 4, 0};
    const positions x = part_sides(cut, scene.geometry, sides);
    auto rastered = scene.draw(cut, target, x), fitted = make_warp(*scene.scan, *scene.mesh, target),
         later = make_warp(*scene.scan, *scene.mesh, target);
    ASSERT_EQ(pliant_warp_fit(fitted.get(), 4), PLIANT_OK);
    ASSERT_EQ(pliant_warp_update(fitted.get(), scene.mesh->rest), PLIANT_OK);
    ASSERT_EQ(pliant_warp_set_body(fitted.get(), &cut.body), PLIANT_OK);
    ASSERT_EQ(pliant_warp_update(fitted.get(), x.data()), PLIANT_OK);
    ASSERT_EQ(pliant_warp_set_body(later.get(), &cut.body), PLIANT_OK);
    ASSERT_EQ(pliant_warp_fit(later.get(), 4), PLIANT_OK);
    ASSERT_EQ(pliant_warp_update(later.get(), x.data()), PLIANT_OK);
    const auto one = bytes_of(*pliant_warp_volume(rastered.get())), other = bytes_of(*pliant_warp_volume(fitted.get()));
    EXPECT_TRUE(other == bytes_of(*pliant_warp_volume(later.get())));
    size_t mixed = 0, apart = 0, inner = 0;
    for (size_t v = 0; v < other.size(); v++) {
        const vector3 at = {double(v % 108), double(v / 108 % 92), double(v / 108 / 92)};
        bool inside = true; // the hull of a fit extends one voxel further
        for (size_t d = 0; d < 3; d++) inside = inside && at[d] > 10 && at[d] < target.size[d] - 11;
        mixed += other[v] != 7 && other[v] != 100 && other[v] != 200;
        if (inside) inner++, apart += one[v] != other[v];
    }
    EXPECT_EQ(mixed, 0u) << "intensities of both sides";
    EXPECT_EQ(apart, 0u) << "sides that only moved: what tetrahedra draw, of " << inner;
    int32_t count[3];
    const uint8_t *changed;
    ASSERT_EQ(pliant_warp_update(fitted.get(), x.data()), PLIANT_OK);
    pliant_warp_bricks(fitted.get(), count, &changed);
    EXPECT_EQ(std::count(changed, changed + count[0] * count[1] * count[2], 1), 0) << "nothing moved";

    // In a bent body, the blend between the elements' maps and the fit's map has no seam: a smooth scan stays smooth.
    for (size_t v = 0; v < pliant_geometry_voxels(&scene.geometry); v++)
        static_cast<uint8_t *>(scene.scan->voxels)[v] = uint8_t(20 + 2 * (v % 96));
    positions y = waves(cut.body.fine, 0.0015);
    ASSERT_EQ(pliant_warp_update(fitted.get(), y.data()), PLIANT_OK);
    rastered = scene.draw(cut, target, y);
    const auto smooth = bytes_of(*pliant_warp_volume(fitted.get())),
               flat = bytes_of(*pliant_warp_volume(rastered.get()));
    size_t differ = 0, far = 0;
    for (size_t v = 0; v < smooth.size(); v++) {
        const vector3 at = {double(v % 108), double(v / 108 % 92), double(v / 108 / 92)};
        bool inside = true;
        for (size_t d = 0; d < 3; d++) inside = inside && at[d] > 12 && at[d] < target.size[d] - 13;
        if (!inside) continue;
        differ += smooth[v] != flat[v];
        far += std::abs(int(smooth[v]) - int(flat[v])) > 4; // more than two voxels
    }
    EXPECT_EQ(far, 0u);
    EXPECT_GT(differ, 1000u) << "far from the cut it is the fit";
}

bool same_parts(const pliant_parts &a, const pliant_parts &b)
{
    auto same = [](const void *p, const void *q, size_t bytes) { return bytes == 0 || std::memcmp(p, q, bytes) == 0; };
    if (a.num_boxes != b.num_boxes || a.live != b.live || a.num_carried_tets != b.num_carried_tets ||
        a.view.num_elements != b.view.num_elements)
        return false;
    for (int32_t g = 0; g < a.num_carried_tets; g++)
        if (a.carried_tets[g].host != b.carried_tets[g].host ||
            a.carried_tets[g].carrier != b.carried_tets[g].carrier ||
            !same(a.carried_tets[g].blend, b.carried_tets[g].blend, sizeof a.carried_tets[g].blend) ||
            !same(a.carried_tets[g].rest, b.carried_tets[g].rest, sizeof a.carried_tets[g].rest))
            return false;
    for (int32_t n = 0; n < a.num_boxes; n++) { // the offset of a box's labels in the pool may differ
        const part_box &p = a.view.boxes[n], &q = b.view.boxes[n];
        if (!same(p.low, q.low, sizeof p.low) || !same(p.size, q.size, sizeof p.size) ||
            !same(a.view.labels + p.first, b.view.labels + q.first,
                  size_t(p.size[0]) * size_t(p.size[1]) * size_t(p.size[2]) * sizeof(uint16_t)))
            return false;
    }
    return same(a.host, b.host, size_t(a.num_boxes) * 4) && same(a.by_node, b.by_node, size_t(a.num_boxes)) &&
           same(a.carrier_start, b.carrier_start, size_t(a.num_boxes + 1) * 4) &&
           same(a.carrier, b.carrier, size_t(a.carrier_start[a.num_boxes]) * 4) &&
           same(a.view.elements, b.view.elements, size_t(a.view.num_elements) * sizeof(part_element));
}

TEST(cut_warp, from_body_to_body_equals_a_fresh_one)
{
    Scene scene(PLIANT_UINT8, 0, 10, 8, 6, 80, 64, 48);
    const pliant_geometry target = grown(scene.geometry, 4);
    const vector3 middle = scene.middle;
    auto upto = [=](double i) { return plane(middle, normals[0], [=](const vector3 &at) { return at[0] < i; }); };
    const auto across = plane(middle, normals[2], [](const vector3 &at) { return at[1] > 45; });
    CutBody none(*scene.mesh, *scene.voxels, {}), some(*scene.mesh, *scene.voxels, {upto(20)}),
        more(*scene.mesh, *scene.voxels, {upto(30)}), both(*scene.mesh, *scene.voxels, {upto(30), across}),
        whole(*scene.mesh, *scene.voxels, {upto(100), across}, 2);
    const CutBody *order[] = {&none, &some, &more, &both, &whole, &both, &none, &whole, &some, &some, &none, &more};
    auto warp = make_warp(*scene.scan, *scene.mesh, target);
    ASSERT_EQ(pliant_warp_update(warp.get(), scene.mesh->rest), PLIANT_OK);
    size_t fewer = 0, all = 0;
    int round = 0;
    for (const CutBody *cut : order) {
        const auto before = bytes_of(*pliant_warp_volume(warp.get()));
        // and another body right after it
        if (round % 4 == 3) { ASSERT_EQ(pliant_warp_set_body(warp.get(), &both.body), PLIANT_OK); }
        ASSERT_EQ(pliant_warp_set_body(warp.get(), &cut->body), PLIANT_OK) << pliant_last_error();
        EXPECT_TRUE(before == bytes_of(*pliant_warp_volume(warp.get()))) << "until the update";
        positions x = rest_of(cut->body.fine); // copied nodes slightly apart, as after a step
        for (size_t n = size_t(scene.mesh->num_nodes); n < cut->node_parent.size(); n++) x[3 * n + 2] += 0.004;
        if (round == 7)
            for (double &v : x) v += 0.0007;
        ASSERT_EQ(pliant_warp_update(warp.get(), x.data()), PLIANT_OK);
        const auto after = bytes_of(*pliant_warp_volume(warp.get()));
        auto fresh = scene.draw(*cut, target, x);
        EXPECT_TRUE(after == bytes_of(*pliant_warp_volume(fresh.get()))) << "round " << round;
        ASSERT_EQ(warp->parts == nullptr, fresh->parts == nullptr);
        // including the parts that were reused from the previous body
        if (fresh->parts) { EXPECT_TRUE(same_parts(*warp->parts, *fresh->parts)) << "round " << round; }
        const size_t changed = changed_bricks(warp.get(), before, after);
        int32_t count[3];
        const uint8_t *flags;
        pliant_warp_bricks(warp.get(), count, &flags);
        all = size_t(count[0] * count[1] * count[2]);
        fewer += changed < all * 2 / 3;
        if (round == 0 || round == 9) { EXPECT_EQ(changed, 0u) << "nothing differs"; }
        ASSERT_EQ(pliant_warp_update(warp.get(), x.data()), PLIANT_OK);
        EXPECT_EQ(changed_bricks(warp.get(), after, after), 0u);
        round++;
    }
    EXPECT_GT(fewer, 6u) << "of " << all;
}

TEST(cut_warp, a_body_that_cannot_be_drawn_changes_nothing)
{
    Scene scene(PLIANT_INT16, 0);
    CutBody some(*scene.mesh, *scene.voxels,
                 {plane(scene.middle, normals[0], [](const vector3 &at) { return at[0] < 20; })}, 2),
        whole(*scene.mesh, *scene.voxels, {plane(scene.middle, normals[0])}, 2);
    auto warp = scene.draw(some, scene.geometry, rest_of(some.body.fine));
    const size_t held = pliant_memory_in_use();
    int failed = 0;
    for (;; failed += 1 + failed / 10) {
        pliant_memory_fail_after(failed);
        const pliant_status status = pliant_warp_set_body(warp.get(), &whole.body);
        pliant_memory_fail_after(-1);
        if (status == PLIANT_OK) break;
        ASSERT_EQ(status, PLIANT_ERROR_MEMORY) << failed;
        ASSERT_EQ(pliant_memory_in_use(), held) << failed;
        auto x = waves(some.body.fine, 0.001, failed);
        ASSERT_EQ(pliant_warp_update(warp.get(), x.data()), PLIANT_OK);
        if (failed % 5 == 0) {
            EXPECT_TRUE(bytes_of(*pliant_warp_volume(warp.get())) ==
                        bytes_of(*pliant_warp_volume(scene.draw(some, scene.geometry, x).get())));
        }
    }
    EXPECT_GT(failed, 20);
    ASSERT_EQ(pliant_warp_update(warp.get(), whole.body.fine.rest), PLIANT_OK);
    EXPECT_TRUE(bytes_of(*scene.scan) == bytes_of(*pliant_warp_volume(warp.get())));
    auto elsewhere = make_mesh(scene.geometry, 3, 3, 3);
    pliant_body other{};
    other.fine = *elsewhere;
    EXPECT_EQ(pliant_warp_set_body(warp.get(), &other), PLIANT_ERROR_ARGUMENT);
}

// A device with its own warp that fails to follow a cut, like a lost or full GPU.
struct Device {
    pliant_warp *drawn;
    pliant_volume *volume;
    pliant_status follows;
    bool fetches;
    int freed;
    static Device *of(void *object) { return static_cast<Device *>(object); }
    static const pliant_warp_device *table()
    {
        static pliant_warp_device made{};
        made.free = [](void *object) { of(object)->freed++; };
        made.update = [](void *object, const double *at) { return pliant_warp_update(of(object)->drawn, at); };
        made.fetch = [](void *object) {
            const pliant_volume *drawn = pliant_warp_volume(of(object)->drawn);
            if (!of(object)->fetches) return PLIANT_ERROR_UNAVAILABLE;
            std::memcpy(of(object)->volume->voxels, drawn->voxels,
                        pliant_geometry_voxels(&drawn->geometry) * pliant_encoding_size(drawn->encoding));
            return PLIANT_OK;
        };
        made.prepare = [](void *object, const pliant_warp_parts *, const pliant_warp_changes *, void **) {
            return of(object)->follows;
        };
        return &made;
    }
};

TEST(cut_warp, a_device_that_cannot_follow_a_cut_leaves_the_drawing_to_the_cpu)
{
    Scene scene(PLIANT_INT16, 0);
    CutBody some(*scene.mesh, *scene.voxels,
                 {plane(scene.middle, normals[0], [](const vector3 &at) { return at[0] < 20; })}, 2);
    for (pliant_status status : {PLIANT_ERROR_UNAVAILABLE, PLIANT_ERROR_MEMORY})
        for (bool fetches : {true, false}) {
            auto warp = make_warp(*scene.scan, *scene.mesh, scene.geometry),
                 inner = make_warp(*scene.scan, *scene.mesh, scene.geometry);
            Device device{inner.get(), &warp->volume, status, fetches, 0};
            const auto blank = bytes_of(*pliant_warp_volume(warp.get()));
            warp->device = Device::table();
            warp->accelerated = &device;
            const auto x = waves(*scene.mesh, 0.001, 3);
            ASSERT_EQ(pliant_warp_update(warp.get(), x.data()), PLIANT_OK);
            ASSERT_EQ(pliant_warp_set_body(warp.get(), &some.body), PLIANT_OK) << pliant_last_error();
            EXPECT_EQ(pliant_warp_accelerated(warp.get()), nullptr);
            EXPECT_EQ(device.freed, 1);
            // until the next update, the last drawn volume stays visible if it can be fetched
            EXPECT_TRUE(bytes_of(*pliant_warp_volume(warp.get())) ==
                        (fetches ? bytes_of(*pliant_warp_volume(inner.get())) : blank));
            const auto apart = waves(some.body.fine, 0.001, 4);
            ASSERT_EQ(pliant_warp_update(warp.get(), apart.data()), PLIANT_OK);
            EXPECT_TRUE(bytes_of(*pliant_warp_volume(warp.get())) ==
                        bytes_of(*pliant_warp_volume(scene.draw(some, scene.geometry, apart).get())));
        }
}

} // namespace
