// A body's log of cuts reproduces the body from the body at load.
#include "base/memory.h"
#include "cuts.h"

namespace {

const int size[3] = {30, 20, 20};
const double box[3] = {0.15, 0.1, 0.1};

std::unique_ptr<CutState> cut_block(int cuts)
{
    std::unique_ptr<Body> body(new Body(size, box, {{4000, 0.4, 1000, false}, {20000, 0.3, 1200, false}},
                                        [](int i, int j, int k) { return (i / 5 + j / 4 + k / 3) % 2; }));
    body->fix_plane(1e-6, 0, 0, 1, 0, 0);
    body->cells(13, 9, 11, 1);
    body->scene.cut.kind = PLIANT_CUT_SEVER;
    EXPECT_EQ(body->build(), PLIANT_OK) << pliant_last_error();
    std::unique_ptr<CutState> block(new CutState(std::move(body)));
    std::mt19937 random(7);
    std::uniform_real_distribution<double> unit(-1, 1);
    const pliant_voxels &voxels = *block->now->voxels;
    for (int c = 0; c < cuts; c++) {
        for (double &x : block->positions) x += 0.002 * unit(random);
        const double normal[3] = {unit(random), unit(random), unit(random)};
        double point[3] = {0.075 + 0.06 * unit(random), 0.05 + 0.04 * unit(random), 0.05 + 0.04 * unit(random)};
        // every second cut passes near a bridge
        const int32_t voxel = voxels.num_bridges > 0 ? voxels.bridge[2 * (c * 37 % voxels.num_bridges)] : -1;
        const int32_t at[3] = {voxel % size[0], voxel / size[0] % size[1], voxel / size[0] / size[1]};
        for (int d = 0; d < 3 && voxel >= 0 && c % 2; d++)
            point[d] = box[d] * (at[d] + 0.5 + 0.3 * unit(random)) / size[d];
        block->cut_plane(point, normal, 0.03);
    }
    return block;
}

pliant_status sever_all(const pliant_body &load, const pliant_cuts &cuts, std::shared_ptr<const pliant_body> *out)
{
    std::shared_ptr<const pliant_body> now(pliant_body_retain(&load), pliant_body_release);
    for (int32_t c = 0; c < cuts.num_cuts; c++) {
        const int32_t begin = c > 0 ? cuts.cut_end[c - 1] : 0;
        pliant_body *next = nullptr;
        const pliant_status status =
            pliant_body_sever(now.get(), now->revision + 1, cuts.cut_end[c] - begin, cuts.severed + begin, &next);
        if (status != PLIANT_OK) return status;
        now.reset(next, pliant_body_release);
    }
    *out = now;
    return PLIANT_OK;
}

TEST(cut_log, makes_the_same_body_bit_for_bit)
{
    auto block = cut_block(12);
    const pliant_cuts *cuts = block->now->cuts;
    ASSERT_TRUE(cuts);
    ASSERT_GT(cuts->num_cuts, 6);
    EXPECT_GT(cuts->num_bridges, 0) << "of " << block->now->voxels->num_bridges;
    EXPECT_EQ(cuts->cut_end[cuts->num_cuts - 1], cuts->num_links + cuts->num_bridges);
    std::shared_ptr<const pliant_body> again;
    ASSERT_EQ(sever_all(block->load(), *cuts, &again), PLIANT_OK) << pliant_last_error();
    EXPECT_TRUE(pliant_body_same(again.get(), block->now));
    EXPECT_EQ(again->revision, block->now->revision);
    ASSERT_EQ(again->fine.num_nodes, block->now->fine.num_nodes);
    EXPECT_TRUE(std::equal(again->node_mass, again->node_mass + again->fine.num_nodes, block->now->node_mass));
    ASSERT_EQ(again->cuts->num_cuts, cuts->num_cuts);
    EXPECT_TRUE(std::equal(cuts->severed, cuts->severed + cuts->cut_end[cuts->num_cuts - 1], again->cuts->severed));
}

// One cut with all links leaves the same voxels joined, but it numbers the new nodes in another order.
TEST(cut_log, the_order_of_cuts_counts)
{
    auto block = cut_block(6);
    const pliant_cuts &cuts = *block->now->cuts;
    ASSERT_GT(cuts.num_cuts, 2);
    std::vector<uint32_t> links;
    for (int32_t i = 0; i < cuts.num_links; i++) links.push_back(cuts.link[i]);
    for (int32_t i = 0; i < cuts.num_bridges; i++) links.push_back(4 * uint32_t(cuts.bridge[i]) + 3);
    pliant_body *once = nullptr;
    ASSERT_EQ(pliant_body_sever(&block->load(), 2, int32_t(links.size()), links.data(), &once), PLIANT_OK)
        << pliant_last_error();
    EXPECT_EQ(once->cuts->num_links, cuts.num_links);
    EXPECT_EQ(once->cuts->num_tets, cuts.num_tets);
    EXPECT_FALSE(pliant_body_same(once, block->now));
    pliant_body_release(once);
}

TEST(cut_log, refuses_what_is_not_there)
{
    auto block = cut_block(3);
    const pliant_body *now = block->now;
    const pliant_voxels &voxels = *now->voxels;
    const uint32_t voxel_count = 30 * 20 * 20, last_of_a_row = 29;
    const uint32_t before = now->cuts->link[0], free_one = [&] {
        for (uint32_t v = 0;; v++)
            if (voxels.owner[v] >= 0 && voxels.owner[v + 1] >= 0 && v % 30 < 29 &&
                !std::binary_search(now->cuts->link, now->cuts->link + now->cuts->num_links, 4 * v))
                return 4 * v;
    }();
    const std::vector<std::vector<uint32_t>> wrong = {{},
                                                      {4 * voxel_count},
                                                      {4 * last_of_a_row},
                                                      {before},
                                                      {free_one, free_one},
                                                      {free_one + 8, free_one},
                                                      {4 * uint32_t(voxels.num_bridges) + 3},
                                                      {0xffffffffu}};
    for (const auto &severed : wrong) {
        pliant_body *next = nullptr;
        EXPECT_EQ(pliant_body_sever(now, now->revision + 1, int32_t(severed.size()), severed.data(), &next),
                  PLIANT_ERROR_ARGUMENT)
            << (severed.empty() ? 0 : severed.back());
        EXPECT_EQ(next, nullptr);
    }
    pliant_body *next = nullptr;
    EXPECT_EQ(pliant_body_sever(now, now->revision + 1, 1, &free_one, &next), PLIANT_OK) << pliant_last_error();
    pliant_body_release(next);
}

TEST(cut_log, no_memory_changes_nothing)
{
    auto block = cut_block(2);
    const pliant_cuts &cuts = *block->now->cuts;
    const size_t held = pliant_memory_in_use();
    bool done = false;
    for (int calls = 0; !done; calls++) {
        ASSERT_LT(calls, 100000);
        std::shared_ptr<const pliant_body> again;
        pliant_memory_fail_after(calls);
        const pliant_status status = sever_all(block->load(), cuts, &again);
        pliant_memory_fail_after(-1);
        done = status == PLIANT_OK;
        if (!done) EXPECT_EQ(status, PLIANT_ERROR_MEMORY) << calls;
        again.reset();
        ASSERT_EQ(pliant_memory_in_use(), held) << calls;
    }
}

} // namespace
