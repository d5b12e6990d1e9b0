// Tests of the overlap search in a deformed mesh, against a test of all pairs.
#include "contact/detect/tet_grid.h"
#include "contact/detect/overlap.h"
#include "base/memory.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <random>
#include <set>
#include <vector>

namespace {

using Pairs = std::vector<std::pair<int32_t, int32_t>>;

struct Soup {
    std::vector<int32_t> tets, all;
    std::vector<double> positions;

    // Tetrahedra in a unit box. Some are far larger than the others. A third of them share nodes with the previous one.
    explicit Soup(int count)
    {
        std::mt19937 random(7);
        std::uniform_real_distribution<double> unit(0, 1);
        for (int t = 0; t < count; t++) {
            const double size = t % 50 == 0 ? 0.8 : 0.1, at[3] = {unit(random), unit(random), unit(random)};
            for (int v = 0; v < 4; v++) {
                if (t % 3 == 1 && v < 2) {
                    tets.push_back(tets[tets.size() - 4]);
                    continue;
                }
                tets.push_back(static_cast<int32_t>(positions.size() / 3));
                for (double x : at) positions.push_back(x + size * (unit(random) - 0.5));
            }
            all.push_back(t);
        }
    }
    bool overlap(int32_t a, int32_t b) const
    {
        double x[3][4], y[3][4];
        for (int v = 0; v < 4; v++)
            for (int w = 0; w < 4; w++)
                if (tets[4 * a + v] == tets[4 * b + w]) return false;
        for (int v = 0; v < 4; v++)
            for (int d = 0; d < 3; d++) {
                x[d][v] = positions[3 * tets[4 * a + v] + d];
                y[d][v] = positions[3 * tets[4 * b + v] + d];
            }
        return pliant_tets_overlap(x, y) != 0;
    }
    Pairs truth(const std::vector<int32_t> &among) const
    {
        Pairs out;
        for (size_t i = 0; i < among.size(); i++)
            for (size_t j = i + 1; j < among.size(); j++)
                if (overlap(among[i], among[j])) out.emplace_back(among[i], among[j]);
        return out;
    }
};

Pairs pairs_of(pliant_grid &grid, const Soup &soup, const std::vector<int32_t> &among, double margin, int threads)
{
    Pairs out;
    int32_t count = -1;
    EXPECT_EQ(pliant_grid_fill(&grid, static_cast<int32_t>(among.size()), among.data(), soup.tets.data(),
                               soup.positions.data(), margin, threads),
              PLIANT_OK);
    EXPECT_EQ(pliant_grid_overlaps(&grid, soup.tets.data(), soup.positions.data(), threads, &count), PLIANT_OK);
    for (const pliant_grid_pairs &found : grid.found)
        for (int32_t p = 0; p < found.count; p++) out.emplace_back(found.pair[2 * p], found.pair[2 * p + 1]);
    EXPECT_EQ(count, static_cast<int32_t>(out.size()));
    return out;
}

TEST(ContactGrid, FindsEveryPairOnce)
{
    const Soup soup(1500);
    pliant_grid grid{};
    for (double margin : {0.0, 0.05}) {
        Pairs found = pairs_of(grid, soup, soup.all, margin, 1);
        std::sort(found.begin(), found.end());
        EXPECT_EQ(found, soup.truth(soup.all));
        EXPECT_GT(found.size(), 1000u);
    }
    std::vector<int32_t> odd;
    for (int32_t t = 1; t < 1500; t += 2) odd.push_back(t);
    Pairs found = pairs_of(grid, soup, odd, 0, 1);
    std::sort(found.begin(), found.end());
    EXPECT_EQ(found, soup.truth(odd));
    pliant_grid_free(&grid);
}

TEST(ContactGrid, IsTheSameForAnyNumberOfThreads)
{
    const Soup soup(3000);
    pliant_grid grid{};
    const Pairs one = pairs_of(grid, soup, soup.all, 0, 1);
    for (int threads : {2, 3, 5}) {
        EXPECT_EQ(pairs_of(grid, soup, soup.all, 0, threads), one);
        pliant_grid_free(&grid);
    }
}

TEST(ContactGrid, HoldsNothingOrNumbersThatAreNone)
{
    Soup soup(60);
    pliant_grid grid{};
    EXPECT_TRUE(pairs_of(grid, soup, {}, 0, 2).empty());
    const double middle[3] = {0.5, 0.5, 0.5};
    EXPECT_EQ(pliant_grid_cell(&grid, middle), -1);
    for (double bad : {std::numeric_limits<double>::quiet_NaN(), std::numeric_limits<double>::infinity()}) {
        for (int v = 0; v < 4; v++) soup.positions[3 * soup.tets[4 * 7 + v]] = bad;
        std::vector<int32_t> others = soup.all;
        others.erase(others.begin() + 6, others.begin() + 9); // remove it with the two that share its nodes
        Pairs found = pairs_of(grid, soup, soup.all, 0, 2), kept;
        for (const auto &pair : found)
            if (pair.first < 6 || pair.first > 8) (pair.second < 6 || pair.second > 8) ? kept.push_back(pair) : void();
        std::sort(kept.begin(), kept.end());
        EXPECT_EQ(kept, soup.truth(others));
        for (const auto &pair : found) EXPECT_TRUE(pair.first != 7 && pair.second != 7);
    }
    // With a few nodes far away, the number of cells stays near the number of tetrahedra.
    for (int v = 0; v < 4; v++) soup.positions[3 * soup.tets[4 * 7 + v]] = 1e9;
    pairs_of(grid, soup, soup.all, 0, 2);
    EXPECT_LE(static_cast<int64_t>(grid.cells[0]) * grid.cells[1] * grid.cells[2], 8 * 60 + 64);
    pliant_grid_free(&grid);
}

TEST(ContactGrid, FailsWithoutMemory)
{
    const Soup soup(300);
    const size_t before = pliant_memory_in_use();
    bool done = false;
    for (int64_t calls = 0; !done; calls++) {
        pliant_grid grid{};
        int32_t count = 0;
        pliant_memory_fail_after(calls);
        pliant_status status =
            pliant_grid_fill(&grid, 300, soup.all.data(), soup.tets.data(), soup.positions.data(), 0, 1);
        if (status == PLIANT_OK)
            status = pliant_grid_overlaps(&grid, soup.tets.data(), soup.positions.data(), 1, &count);
        pliant_memory_fail_after(-1);
        done = status == PLIANT_OK;
        if (!done) EXPECT_EQ(status, PLIANT_ERROR_MEMORY);
        pliant_grid_free(&grid);
        EXPECT_EQ(pliant_memory_in_use(), before);
        ASSERT_LT(calls, 1000);
    }
}

} // namespace
