// Tests of cuts through few links: hinges, chips of chips, and tissue that moves.
#include "severed_bar.h"
#include "mesh/mesh.h"

#include <array>

namespace {

// Bridges connect two blocks that share only an edge of the lattice. A blade through the edge separates them.
TEST(CutLinks, AHingeIsCut)
{
    const int many[3] = {20, 20, 10};
    const double wide[3] = {0.2, 0.2, 0.1};
    std::unique_ptr<Body> two(new Body(many, wide, {{4000, 0.4, 1000, false}, {1, 0.1, 1, true}},
                                       [](int i, int j, int) { return (i < 10) != (j < 10); }));
    two->fix_plane(0, 0, 0.01, 0, 0, 1);
    two->cells(4, 4, 2, 1);
    two->scene.cut.kind = PLIANT_CUT_SEVER;
    ASSERT_EQ(two->build(), PLIANT_OK) << pliant_last_error();
    CutState blocks(std::move(two));
    EXPECT_EQ(num_pieces(*blocks.now), 1);
    const double middle[3] = {0.1, 0.1, 0.05}, elsewhere[3] = {0.05, 0.05, 0.077}, across[3] = {1, 1, 0},
                 flat[3] = {0, 0, 1};
    ASSERT_TRUE(blocks.cut_plane(elsewhere, flat, 0.03)); // a notch in one block
    EXPECT_EQ(num_pieces(*blocks.now), 1);
    EXPECT_EQ(mismatches(*blocks.now), 0);
    ASSERT_TRUE(blocks.cut_plane(middle, across, 0.08));
    EXPECT_EQ(blocks.report.num_bridges, 3);
    EXPECT_EQ(num_pieces(*blocks.now), 2);
    EXPECT_EQ(mismatches(*blocks.now), 0);
}

// Cut large parts of the bar into small pieces: chips of chips, pieces connected by one node, pieces of pieces.
std::unique_ptr<CutState> shred(unsigned seed, int strokes, const std::function<bool(const CutState &)> &goes_on)
{
    std::mt19937 random(seed);
    std::uniform_real_distribution<double> unit(-1, 1);
    auto block = bar();
    for (int s = 0; s < strokes && goes_on(*block); s++) {
        double normal[3],
            point[3] = {0.12 + 0.06 * unit(random), 0.05 + 0.05 * unit(random), 0.05 + 0.05 * unit(random)};
        for (double &n : normal) n = unit(random);
        block->cut_plane(point, normal, 0.05 + 0.03 * unit(random));
    }
    return block;
}

TEST(CutLinks, ManyCutsUntilFewLinksRemain)
{
    int max_joints = 0, max_inner = 0;
    for (unsigned seed : {1u, 3u, 11u}) {
        auto block = shred(seed, seed == 11 ? 23 : 14, [&](const CutState &now) {
            EXPECT_EQ(mismatches(*now.now), 0) << "seed " << seed;
            max_joints = std::max(max_joints, now.now->pieces ? now.now->pieces->num_joints : 0);
            max_inner = std::max(max_inner, now.now->pieces ? now.now->pieces->num_inner : 0);
            return true;
        });
        EXPECT_EQ(mismatches(*block->now), 0) << "seed " << seed;
        EXPECT_EQ(block->report.pieces, num_pieces(*block->now));
        EXPECT_GT(block->report.pieces, 5);
        EXPECT_NEAR(total_mass(*block->now), total_mass(block->load()), 1e-12 * total_mass(block->load()));
        // repeat the cuts from the log of severed links
        const pliant_cuts &cuts = *block->now->cuts;
        const pliant_body *body = pliant_body_retain(&block->load());
        for (int32_t c = 0; c < cuts.num_cuts; c++) {
            const int32_t from = c > 0 ? cuts.cut_end[c - 1] : 0;
            pliant_body *next = nullptr;
            ASSERT_EQ(pliant_body_sever(body, body->revision + 1, cuts.cut_end[c] - from, cuts.severed + from, &next),
                      PLIANT_OK)
                << pliant_last_error();
            pliant_body_release(body);
            body = next;
        }
        EXPECT_TRUE(pliant_body_same(body, block->now)) << "seed " << seed;
        pliant_body_release(body);
    }
    EXPECT_GT(max_joints, 0);
    EXPECT_GT(max_inner, 0);
}

// A cut of a piece that one or two nodes connect: all links from its voxels to others are severed, and the joint is
// gone.
TEST(CutLinks, CuttingTheHingeOfAPiece)
{
    auto hangs = [](const pliant_body &body) {
        int32_t found = -1;
        for (int32_t j = 0; body.pieces && j < body.pieces->num_joints && found < 0; j++)
            if (body.pieces->joint[2 * j] != body.pieces->joint[2 * j + 1]) found = body.pieces->joint[2 * j];
        return found;
    };
    auto block = shred(3, 30, [&](const CutState &now) { return hangs(*now.now) < 0; });
    const pliant_body &now = *block->now;
    const int32_t node = hangs(now);
    ASSERT_GE(node, 0);
    Parts parts(static_cast<size_t>(now.fine.num_nodes)); // without joints
    for (int32_t v = 0; v < 4 * now.fine.num_tets; v++) parts.join(now.fine.tets[v / 4 * 4], now.fine.tets[v]);
    auto hanging = [&](int32_t voxel) {
        return parts.find(now.fine.tets[4 * pliant_voxels_fragment(now.voxels, now.cuts, voxel)]) == parts.find(node);
    };
    const std::set<uint32_t> before(now.cuts->link, now.cuts->link + now.cuts->num_links);
    const std::set<int32_t> bridges(now.cuts->bridge, now.cuts->bridge + now.cuts->num_bridges);
    const int32_t strides[3] = {1, size[0], size[0] * size[1]};
    std::vector<uint32_t> severed;
    for (int32_t v = 0; v < size[0] * size[1] * size[2]; v++)
        for (int d = 0; d < 3; d++) {
            const bool last = v / strides[d] % size[d] == size[d] - 1;
            if (!last && hanging(v) != hanging(v + strides[d]) && !before.count(4u * v + d))
                severed.push_back(4u * v + d);
        }
    for (int32_t b = 0; b < now.voxels->num_bridges; b++)
        if (!bridges.count(b) && hanging(now.voxels->bridge[2 * b]) != hanging(now.voxels->bridge[2 * b + 1]))
            severed.push_back(4u * b + 3);
    ASSERT_FALSE(severed.empty());
    const int pieces = num_pieces(now), joints = now.pieces->num_joints;
    pliant_body *next = nullptr;
    ASSERT_EQ(pliant_body_sever(&now, now.revision + 1, static_cast<int32_t>(severed.size()), severed.data(), &next),
              PLIANT_OK)
        << pliant_last_error();
    EXPECT_EQ(num_pieces(*next), pieces + 1);
    EXPECT_EQ(next->cuts->num_pieces, pieces + 1);
    EXPECT_LT(next->pieces->num_joints, joints);
    EXPECT_EQ(mismatches(*next), 0);
    pliant_body_release(next);
}

// A bar is shaken by 4 mm per step (0.2 m/s) while a blade cuts it in 20 steps. The previous blade edge moves with the
// tissue.
// Its points are moved along with the tissue and a tenth of a voxel back.
TEST(CutLinks, ABladeThroughMovingTissueLeavesNoLink)
{
    std::mt19937 random(11);
    std::uniform_real_distribution<double> unit(-1, 1);
    int leaks = 0;
    for (int run = 0; run < 50; run++) {
        auto block = bar();
        double shake[3] = {0, 0, 0}, phase = 3 * unit(random);
        const double normal[3] = {1, 0.3 * unit(random), 0.3 * unit(random)}, at = 0.1 + 0.02 * unit(random);
        auto move = [&] { // 4 mm in a random direction, plus bending
            double way[3], length = 0;
            for (double &w : way) length += (w = unit(random)) * w;
            phase += 0.2;
            for (int d = 0; d < 3; d++) shake[d] = 0.9 * shake[d] + 0.004 * way[d] / std::sqrt(length);
            const pliant_mesh &mesh = block->now->fine;
            for (int32_t n = 0; n < mesh.num_nodes; n++)
                for (int d = 0; d < 3; d++)
                    block->positions[3 * n + d] = mesh.rest[3 * n + d] + shake[d] +
                                                  0.01 * std::sin(20 * mesh.rest[3 * n + (d + 1) % 3] + phase + d);
        };
        // The edge along y, from below the bar to above it, sampled every half voxel.
        const int points = 81, steps = 20;
        std::vector<double> from, to(3 * points), weights(4 * points);
        std::vector<int32_t> tet(points);
        auto place = [&](int step) {
            for (int p = 0; p < points; p++) {
                const double y = -0.05 + 0.2 * p / (points - 1), z = -0.05 + 0.2 * step / steps;
                const double x[3] = {at - normal[1] * (y - 0.05) - normal[2] * (z - 0.05), y, z};
                std::copy(x, x + 3, to.begin() + 3 * p);
            }
        };
        move();
        place(0);
        for (int step = 1; step <= steps; step++) {
            from = to;
            pliant_body_locate_points(block->now, block->positions.data(), points, from.data(), tet.data(),
                                      weights.data());
            const std::vector<double> was = block->positions;
            move();
            std::vector<double> by(3 * points);
            for (int p = 0; p < points; p++) // in air, points move with the nearest tissue
                if (tet[p] < 0) {
                    double minimum = INFINITY;
                    for (int32_t n = 0; n < block->now->fine.num_nodes; n++) {
                        double apart = 0;
                        for (int d = 0; d < 3; d++) apart += std::pow(was[3 * n + d] - from[3 * p + d], 2);
                        if (apart >= minimum) continue;
                        minimum = apart;
                        for (int d = 0; d < 3; d++) by[3 * p + d] = block->positions[3 * n + d] - was[3 * n + d];
                    }
                }
            for (int p = 0; p < points; p++)
                for (int v = 0; v < 4 && tet[p] >= 0; v++) {
                    const int32_t node = block->now->fine.tets[4 * tet[p] + v];
                    for (int d = 0; d < 3; d++)
                        by[3 * p + d] += weights[4 * p + v] * (block->positions[3 * node + d] - was[3 * node + d]);
                }
            place(step);
            for (int p = 0; p < points; p++) {
                double back[3], length = 0;
                for (int d = 0; d < 3; d++) {
                    from[3 * p + d] += by[3 * p + d];
                    back[d] = from[3 * p + d] - to[3 * p + d];
                    length += back[d] * back[d];
                }
                for (int d = 0; d < 3; d++) from[3 * p + d] += 0.0005 * back[d] / std::sqrt(length);
            }
            block->cut(from, to);
        }
        const int pieces = num_pieces(*block->now);
        EXPECT_EQ(mismatches(*block->now), 0);
        leaks += pieces != 2;
        EXPECT_EQ(pieces, 2) << "run " << run;
    }
    EXPECT_EQ(leaks, 0);
}

} // namespace
