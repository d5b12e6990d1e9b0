// Triangular solves on panels in single precision, against the product with the original factor.
#include <gtest/gtest.h>

extern "C" {
#include "fem/linear/panels.h"
}

#include <cmath>
#include <vector>

namespace {

TEST(Panels, InvertsTheProductOfTheFactorWithItsTranspose)
{
    // 41 unknowns: six columns that reach into the last thirty rows, one alone, and a dense end
    const int size = 41, first[] = {0, 6, 7, size};
    std::vector<int> row, row_start = {0}, value_start = {0};
    std::vector<double> dense(size * size, 0), value;
    for (int s = 0; s < 3; s++) {
        std::vector<int> rows;
        for (int c = first[s]; c < first[s + 1]; c++) rows.push_back(c);
        if (s == 0)
            for (int r = 11; r < size; r++) rows.push_back(r);
        if (s == 1) rows.push_back(40);
        for (int c = first[s]; c < first[s + 1]; c++)
            for (int r : rows) {
                double l = r < c ? 0 : r == c ? 2 + 0.1 * c : std::sin(3.0 * r + c) / 8;
                value.push_back(l);
                dense[static_cast<size_t>(r * size + c)] = l;
            }
        row.insert(row.end(), rows.begin(), rows.end());
        row_start.push_back(static_cast<int>(row.size()));
        value_start.push_back(static_cast<int>(value.size()));
    }
    std::vector<int> permutation(size);
    for (int i = 0; i < size; i++) permutation[static_cast<size_t>(i)] = (i * 7) % size;
    const pliant_supernodes supernodes = {
        3, first, row_start.data(), value_start.data(), row.data(), permutation.data(), value.data()};
    pliant_panels panels;
    ASSERT_EQ(pliant_panels_create(value.size(), size, &panels), PLIANT_OK);
    pliant_panels_fill(&panels, &supernodes);
    std::vector<double> expected(size), half(size, 0), right(size, 0);
    for (int i = 0; i < size; i++) expected[static_cast<size_t>(i)] = std::cos(i);
    for (int r = 0; r < size; r++)
        for (int c = 0; c < size; c++) half[c] += dense[r * size + c] * expected[permutation[r]];
    for (int r = 0; r < size; r++)
        for (int c = 0; c < size; c++) right[permutation[r]] += dense[r * size + c] * half[c];
    pliant_panels_solve(&panels, &supernodes, size, right.data(), right.data());
    for (int i = 0; i < size; i++) EXPECT_NEAR(right[i], expected[i], 1e-6) << i;
    pliant_panels_free(&panels);
    EXPECT_EQ(panels.value, nullptr);
}

} // namespace
