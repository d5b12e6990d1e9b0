// Direct factors: what their ordering may depend on.
#include "fem/system.h"
#include "pliant/pliant.h"

#include <gtest/gtest.h>

#include <csignal>
#include <set>
#include <thread>
#include <vector>

namespace {

// nodes of a grid, each joined with the 26 around it
struct Grid {
    std::vector<int32_t> start{0}, row;
    pliant_pattern pattern{};

    explicit Grid(int side)
    {
        for (int n = 0; n < side * side * side; n++) {
            for (int k = -1; k <= 1; k++)
                for (int j = -1; j <= 1; j++)
                    for (int i = -1; i <= 1; i++) {
                        int at[3] = {n % side + i, n / side % side + j, n / side / side + k};
                        int other = at[0] + side * (at[1] + side * at[2]);
                        bool inside = true;
                        for (int a : at) inside = inside && a >= 0 && a < side;
                        if (inside && other >= n) row.push_back(other);
                    }
            start.push_back(static_cast<int32_t>(row.size()));
        }
        pattern.num_columns = side * side * side;
        pattern.num_blocks = start.back();
        pattern.start = start.data();
        pattern.row = row.data();
        pattern.num_values = 9 * static_cast<int64_t>(pattern.num_blocks) - 3 * static_cast<int64_t>(pattern.num_columns);
    }
};

double numbers_of(const pliant_pattern &pattern)
{
    pliant_factor *factor = nullptr;
    EXPECT_EQ(pliant_factor_analyze(&pattern, &factor), PLIANT_OK) << pliant_last_error();
    double numbers = pliant_factor_values(factor);
    pliant_factor_free(factor);
    return numbers;
}

// large enough for nested dissection
TEST(Factor, OrderingIsTheSameWhateverOtherThreadsDo)
{
    const Grid grid(14);
    const double alone = numbers_of(grid.pattern);
    EXPECT_GT(alone, 5.0 * static_cast<double>(grid.pattern.num_values));
    struct sigaction before, after;
    ASSERT_EQ(sigaction(SIGTERM, nullptr, &before), 0);
    std::set<double> found[3];
    std::vector<std::thread> threads;
    for (std::set<double> &mine : found)
        threads.emplace_back([&] {
            for (int n = 0; n < 3; n++) mine.insert(numbers_of(grid.pattern));
        });
    for (std::thread &thread : threads) thread.join();
    for (const std::set<double> &each : found) EXPECT_EQ(each, std::set<double>{alone});
    ASSERT_EQ(sigaction(SIGTERM, nullptr, &after), 0);
    EXPECT_EQ(after.sa_handler, before.sa_handler) << "the process is left with somebody else's handler";
}

// Small matrices, which CHOLMOD factors without supernodes, as large ones.
TEST(Factor, IsRefusedWhereAPivotIsNotPositive)
{
    for (int side : {2, 9}) {
        const Grid grid(side);
        const int32_t columns = grid.pattern.num_columns;
        for (double last : {60.0, -60.0}) {
            std::vector<double> values(static_cast<size_t>(grid.pattern.num_values), -0.1);
            for (int32_t column = 0; column < columns; column++) {
                const int32_t first = grid.start[column], height = grid.start[column + 1] - first;
                const size_t at = static_cast<size_t>(9 * first - 3 * column);
                values[at] = values[at + 3 * height] = 60;
                values[at + 6 * height - 1] = column + 1 < columns ? 60 : last;
            }
            pliant_factor *factor = nullptr;
            ASSERT_EQ(pliant_factor_analyze(&grid.pattern, &factor), PLIANT_OK) << pliant_last_error();
            EXPECT_EQ(pliant_factor_numeric(factor, values.data()), last > 0 ? PLIANT_OK : PLIANT_ERROR_NUMERIC) << side;
            pliant_factor_free(factor);
        }
    }
}

} // namespace
