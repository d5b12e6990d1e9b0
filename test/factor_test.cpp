// Tests of direct factors: the ordering, refused matrices, operation counts and partial solves.
#include "fem/linear/half_solve.h"
#include "fem/system.h"
#include "pliant/pliant.h"

#include <gtest/gtest.h>

#include <cmath>
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
        pattern.num_values =
            9 * static_cast<int64_t>(pattern.num_blocks) - 3 * static_cast<int64_t>(pattern.num_columns);
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

// The grid is large enough for nested dissection.
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

// CHOLMOD factors small matrices without supernodes, and large ones with supernodes. Both refuse these matrices.
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
            EXPECT_EQ(pliant_factor_numeric(factor, values.data()), last > 0 ? PLIANT_OK : PLIANT_ERROR_NUMERIC)
                << side;
            pliant_factor_free(factor);
        }
    }
}

// The analysis counts the operations of a factor. A clone with the same ordering has the same count.
TEST(Factor, ACopyTakesAsManyOperations)
{
    for (int side : {2, 9}) {
        const Grid grid(side);
        pliant_factor *factor = nullptr, *copy = nullptr;
        ASSERT_EQ(pliant_factor_analyze(&grid.pattern, &factor), PLIANT_OK) << pliant_last_error();
        ASSERT_EQ(pliant_factor_clone(factor, &copy), PLIANT_OK) << pliant_last_error();
        EXPECT_GT(pliant_factor_operations(factor), pliant_factor_values(factor));
        EXPECT_EQ(pliant_factor_operations(copy), pliant_factor_operations(factor));
        pliant_factor_free(factor);
        pliant_factor_free(copy);
    }
}

// A solve in two parts equals the whole solve, even if the right-hand side changes at some nodes in between.
// The half solves return columns of the inverse.
TEST(Factor, SolvesInTwoParts)
{
    const Grid grid(10);
    const pliant_pattern &pattern = grid.pattern;
    const size_t size = 3 * static_cast<size_t>(pattern.num_columns);
    std::vector<double> values(static_cast<size_t>(pattern.num_values));
    for (int32_t column = 0, next = 0; column < pattern.num_columns; column++)
        for (int c = 0; c < 3; c++)
            for (int32_t n = pattern.start[column]; n < pattern.start[column + 1]; n++)
                for (int r = n == pattern.start[column] ? c : 0; r < 3; r++) // diagonally dominant
                    values[static_cast<size_t>(next++)] =
                        pattern.row[n] == column && r == c ? 90 : -1 + 0.2 * std::sin(next);
    pliant_factor *factor = nullptr;
    ASSERT_EQ(pliant_factor_analyze(&pattern, &factor), PLIANT_OK) << pliant_last_error();
    ASSERT_EQ(pliant_factor_numeric(factor, values.data()), PLIANT_OK) << pliant_last_error();
    const std::vector<int32_t> nodes = {3, 517, 40, 999, 500};
    bool possible = false;
    ASSERT_EQ(pliant_factor_reach(factor, static_cast<int32_t>(nodes.size()), nodes.data(), &possible), PLIANT_OK);
    ASSERT_TRUE(possible);
    std::vector<double> right(size), more(size), both(size), whole(size), sum(size), part(size), out(size);
    for (size_t i = 0; i < size; i++) right[i] = std::cos(static_cast<double>(i));
    for (int32_t n : nodes)
        for (int d = 0; d < 3; d++) more[static_cast<size_t>(3 * n + d)] = 10 + n + d;
    for (size_t i = 0; i < size; i++) both[i] = right[i] + more[i];
    ASSERT_EQ(pliant_factor_solve(factor, 1, right.data(), whole.data()), PLIANT_OK);
    ASSERT_EQ(pliant_factor_solve(factor, 1, both.data(), sum.data()), PLIANT_OK);
    pliant_factor_begin(factor, right.data(), part.data());
    std::vector<pliant_half_solve> halves(nodes.size());
    // half solves do not change the partial solve
    for (size_t n = 0; n < nodes.size(); n++) ASSERT_EQ(pliant_factor_half(factor, nodes[n], &halves[n]), PLIANT_OK);
    pliant_factor_end(factor, more.data(), out.data());
    for (int32_t n : nodes)
        for (int d = 0; d < 3; d++)
            EXPECT_NEAR(part[static_cast<size_t>(3 * n + d)], whole[static_cast<size_t>(3 * n + d)], 1e-13);
    for (size_t i = 0; i < size; i++) ASSERT_NEAR(out[i], sum[i], 1e-10) << i;
    pliant_factor_begin(factor, right.data(), part.data());
    pliant_factor_end(factor, nullptr, out.data());
    for (size_t i = 0; i < size; i++) ASSERT_EQ(out[i], whole[i]) << i;
    // the same with stored half solves
    pliant_factor_begin_half(factor, right.data());
    for (size_t n = 0; n < nodes.size(); n++) {
        double moved[3];
        pliant_factor_half_answer(factor, &halves[n], moved);
        for (int d = 0; d < 3; d++) EXPECT_NEAR(moved[d], whole[static_cast<size_t>(3 * nodes[n] + d)], 1e-13);
    }
    for (size_t n = 0; n < nodes.size(); n++)
        pliant_factor_half_add(factor, &halves[n], &more[static_cast<size_t>(3 * nodes[n])]);
    pliant_factor_end_half(factor, out.data());
    for (size_t i = 0; i < size; i++) ASSERT_NEAR(out[i], sum[i], 1e-10) << i;
    for (int d = 0; d < 3; d++) {
        std::vector<double> unit(size), inverse(size);
        unit[static_cast<size_t>(3 * nodes[1] + d)] = 1;
        ASSERT_EQ(pliant_factor_solve(factor, 1, unit.data(), inverse.data()), PLIANT_OK);
        for (size_t n = 0; n < nodes.size(); n++) {
            double block[9];
            pliant_factor_half_product(factor, &halves[n], &halves[1], block);
            for (int r = 0; r < 3; r++)
                EXPECT_NEAR(block[3 * r + d], inverse[static_cast<size_t>(3 * nodes[n] + r)], 1e-15);
        }
    }
    for (pliant_half_solve &half : halves) pliant_half_solve_free(&half);
    pliant_factor_free(factor);
}

} // namespace
