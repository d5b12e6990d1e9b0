// Aggregates: everything has one, and what is hardly tied together has none in common.
#include "fem/linear/aggregate.h"
#include "fem/linear/pattern.h"
#include "pliant/memory.h"

#include <gtest/gtest.h>

#include <set>
#include <vector>

namespace {

// a lattice of nodes tied to their six neighbours, whose matrix is made of springs
struct Springs {
    int size[3];
    pliant_pattern pattern{};
    std::vector<double> blocks;

    // stiffness(a, b): of the spring between two neighbours
    template <class Stiffness> Springs(int a, int b, int c, Stiffness stiffness) : size{a, b, c}
    {
        std::vector<pliant_entry> entries;
        const int count = a * b * c, step[3] = {1, a, a * b};
        for (int n = 0; n < count; n++) {
            const int at[3] = {n % a, n / a % b, n / a / b};
            entries.push_back({n, n, 0});
            for (int d = 0; d < 3; d++)
                if (at[d] + 1 < size[d]) entries.push_back({n + step[d], n, 0});
        }
        pattern.num_columns = count;
        EXPECT_EQ(pliant_pattern_fill(&pattern, entries.data(), int32_t(entries.size())), PLIANT_OK);
        blocks.assign(9 * size_t(pattern.num_blocks), 0);
        for (int column = 0; column < count; column++)
            for (int p = pattern.start[column] + 1; p < pattern.start[column + 1]; p++) {
                const double k = stiffness(pattern.row[p], column);
                for (int m = 0; m < 9; m += 4) {
                    blocks[9 * size_t(p) + size_t(m)] = -k;
                    blocks[9 * size_t(pattern.start[column]) + size_t(m)] += k;
                    blocks[9 * size_t(pattern.start[pattern.row[p]]) + size_t(m)] += k;
                }
            }
    }
    ~Springs() { pliant_pattern_clear(&pattern); }

    std::vector<int32_t> aggregates(float least, int32_t *count)
    {
        pliant_ties ties;
        EXPECT_EQ(pliant_ties_create(&pattern, blocks.data(), 1, &ties), PLIANT_OK);
        std::vector<int32_t> of(size_t(pattern.num_columns));
        *count = pliant_aggregate(&ties, least, of.data());
        pliant_ties_free(&ties);
        return of;
    }
};

TEST(Aggregate, EveryNodeHasOneAndNoneIsEmpty)
{
    Springs springs(9, 8, 7, [](int, int) { return 2.0; });
    int32_t count;
    std::vector<int32_t> of = springs.aggregates(0.08f, &count);
    std::set<int32_t> used(of.begin(), of.end());
    EXPECT_EQ(*used.begin(), 0);
    EXPECT_EQ(*used.rbegin(), count - 1);
    EXPECT_EQ(int32_t(used.size()), count);
    EXPECT_LT(count, 9 * 8 * 7 / 5);
    EXPECT_GT(count, 9 * 8 * 7 / 20);
}

TEST(Aggregate, SoftAndStiffPart)
{
    // tissue at two layers, air elsewhere; springs between them are those of air
    auto tissue = [](int n) { return n / 8 % 8 == 3 || n / 8 % 8 == 4; };
    Springs springs(8, 8, 8, [&](int a, int b) { return tissue(a) && tissue(b) ? 4000.0 : 10.0; });
    int32_t count;
    std::vector<int32_t> of = springs.aggregates(0.08f, &count);
    std::set<int32_t> stiff, soft;
    for (int n = 0; n < 512; n++) (tissue(n) ? stiff : soft).insert(of[size_t(n)]);
    for (int32_t a : stiff) EXPECT_EQ(soft.count(a), 0u) << a;
}

TEST(Aggregate, TheTwoSidesOfACutPart)
{
    // no spring crosses the plane between 3 and 4; one block is left in the pattern, without stiffness
    auto side = [](int n) { return n % 8 < 4; };
    Springs springs(8, 6, 6, [&](int a, int b) { return side(a) == side(b) ? 1.0 : 0.0; });
    int32_t count;
    std::vector<int32_t> of = springs.aggregates(0.08f, &count);
    std::set<int32_t> left, right;
    for (int n = 0; n < 8 * 36; n++) (side(n) ? left : right).insert(of[size_t(n)]);
    for (int32_t a : left) EXPECT_EQ(right.count(a), 0u) << a;
}

TEST(Aggregate, ANodeThatNothingHoldsHasItsOwn)
{
    Springs springs(4, 1, 1, [](int a, int b) { return a + b > 2 ? 1.0 : 0.0; }); // 0 and 1 hang on nothing
    int32_t count;
    std::vector<int32_t> of = springs.aggregates(0.08f, &count);
    EXPECT_NE(of[0], of[2]);
    EXPECT_EQ(of[2], of[3]);
}

TEST(Aggregate, RunsOutOfMemoryCleanly)
{
    Springs springs(4, 4, 4, [](int, int) { return 1.0; });
    const size_t held = pliant_memory_in_use();
    for (int calls = 0; calls < 3; calls++) {
        pliant_ties ties;
        pliant_memory_fail_after(calls);
        EXPECT_EQ(pliant_ties_create(&springs.pattern, springs.blocks.data(), 1, &ties), PLIANT_ERROR_MEMORY);
        pliant_memory_fail_after(-1);
        EXPECT_EQ(pliant_memory_in_use(), held);
    }
}

} // namespace
