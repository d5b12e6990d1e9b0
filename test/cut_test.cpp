// Cuts of a body: what a sweep severs, and the next body.
#include "cuts.h"

namespace {

const int size[3] = {40, 20, 20};
const double box[3] = {0.2, 0.1, 0.1};

std::unique_ptr<Cuttable> bar(const std::function<void(pliant_scene &)> &set = [](pliant_scene &) {})
{
    std::unique_ptr<Body> body(new Body(size, box, {{4000, 0.4, 1000, false}, {20000, 0.3, 1200, false}}, [](int i, int j, int k) { return (i / 5 + j / 4 + k / 3) % 2; }));
    body->fix_plane(1e-6, 0, 0, 1, 0, 0);
    body->cells(8, 4, 4, 1);
    body->scene.cut.kind = PLIANT_CUT_SEVER;
    set(body->scene);
    EXPECT_EQ(body->build(), PLIANT_OK) << pliant_last_error();
    return std::unique_ptr<Cuttable>(new Cuttable(std::move(body)));
}

TEST(Cut, APlaneMakesTwoPieces)
{
    auto block = bar();
    const double point[3] = {0.103, 0.05, 0.05}, normal[3] = {1, 0.2, -0.1};
    const double mass = total_mass(*block->now);
    ASSERT_TRUE(block->cut_plane(point, normal));
    EXPECT_EQ(block->report.pieces, 2);
    EXPECT_EQ(num_pieces(*block->now), 2);
    EXPECT_EQ(mismatches(*block->now), 0);
    EXPECT_NEAR(total_mass(*block->now), mass, 1e-12 * mass);
    EXPECT_NEAR(block->report.area, 0.01 * std::sqrt(1.05), 0.02 * 0.01);
    std::printf("links %d bridges %d touched %d tets %d -> %d nodes %d -> %d\n", block->report.num_links, block->report.num_bridges, block->report.touched,
                block->load().fine.num_tets, block->now->fine.num_tets, block->load().fine.num_nodes, block->now->fine.num_nodes);
}

TEST(Cut, RandomPlanesMakeTwoPieces)
{
    std::mt19937 random(5);
    std::uniform_real_distribution<double> unit(-1, 1);
    int wrong = 0, different = 0, chips = 0;
    for (int trial = 0; trial < 100; trial++) {
        auto block = bar();
        // a smooth deformation, and every third time one that turns elements inside out
        const double mass = total_mass(*block->now);
        double normal[3] = {1, 0.6 * unit(random), 0.6 * unit(random)}, point[3] = {0.1 + 0.03 * unit(random), 0.05, 0.05};
        const double wave[3] = {unit(random), unit(random), unit(random)};
        for (int32_t n = 0; n < block->now->fine.num_nodes; n++) {
            double *x = block->positions.data() + 3 * n;
            const double y = x[1];
            x[1] += 0.02 * std::sin(30 * x[0] + 3 * wave[0]);
            x[2] += 0.02 * std::sin(25 * y + 3 * wave[1]);
            x[0] *= 1 + 0.3 * wave[2];
            for (int d = 0; d < 3 && trial % 3 == 2; d++) x[d] += 0.012 * unit(random);
        }
        point[0] *= 1 + 0.3 * wave[2];
        ASSERT_TRUE(block->cut_plane(point, normal));
        EXPECT_NEAR(total_mass(*block->now), mass, 1e-12 * mass);
        wrong += trial % 3 != 2 && block->report.pieces != 2;
        wrong += trial % 3 == 2 && block->report.pieces < 2;
        different += mismatches(*block->now);
        chips += block->now->cuts->num_chips;
        if (block->report.pieces != 2 || mismatches(*block->now)) std::printf("trial %d: pieces %d, mismatches %d\n", trial, block->report.pieces, mismatches(*block->now));
    }
    EXPECT_EQ(wrong, 0);
    EXPECT_EQ(different, 0);
    std::printf("chips %d\n", chips);
}

} // namespace
