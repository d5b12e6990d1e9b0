// Updates of a warp, against a new warp and against itself.
#include "base/memory.h"
#include "warp_cases.h"

#include <cstring>

namespace {

using namespace warp_cases;

TEST(warp, keeps_the_attributes_of_the_voxels)
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

// Return whether every different voxel lies in a brick that was reported as changed.
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

TEST(warp, partial_update_equals_full_update)
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
        if (round % 13 == 12) x = waves(*mesh, 0.03); // random inversions: tetrahedra across many bricks
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

TEST(warp, without_memory_for_its_lists_draws_in_parts)
{
    pliant_geometry geometry = box_geometry(40, 40, 40);
    auto scan = make_scan(geometry, PLIANT_INT16);
    auto mesh = make_mesh(geometry, 4, 4, 4);
    size_t in_use = pliant_memory_in_use();
    // First, all tissue is in the middle and touches few bricks. Then it is everywhere, which needs a longer list.
    auto spread = waves(*mesh, 0.002), small = moved(*mesh, [](const vector3 &p) {
        return vector3{0.2 * p[0], 0.06 + 0.2 * (p[1] - 0.06), 0.14 + 0.2 * (p[2] - 0.14)};
    }), nudged = small;
    nudged[3 * 62] += 0.003;
    // Without memory, the creation of a warp fails. A created warp draws every update.
    int made = 0, not_made = 0;
    for (int64_t calls = 0; calls < 24; calls++) {
        pliant_warp *warp = nullptr;
        pliant_memory_fail_after(calls);
        pliant_status status = pliant_warp_create(scan.get(), mesh.get(), &geometry, 2, &warp);
        (status == PLIANT_OK ? made : not_made)++;
        EXPECT_EQ(status, warp ? PLIANT_OK : PLIANT_ERROR_MEMORY);
        for (const positions *x : {&small, &spread, &nudged, &spread}) {
            if (!warp) break;
            EXPECT_EQ(pliant_warp_update(warp, x->data()), PLIANT_OK) << calls;
            auto drawn = bytes_of(*pliant_warp_volume(warp));
            pliant_memory_fail_after(-1);
            auto fresh = make_warp(*scan, *mesh, geometry);
            ASSERT_EQ(pliant_warp_update(fresh.get(), x->data()), PLIANT_OK);
            EXPECT_TRUE(drawn == bytes_of(*pliant_warp_volume(fresh.get()))) << calls;
            pliant_memory_fail_after(0);
        }
        pliant_memory_fail_after(-1);
        pliant_warp_free(warp);
        EXPECT_EQ(pliant_memory_in_use(), in_use) << "leak after failing call " << calls;
    }
    EXPECT_GT(not_made, 12) << "every allocation has failed once";
    EXPECT_GT(made, 3);
    pliant_warp_free(nullptr);
}

} // namespace
