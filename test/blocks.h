// Products with a symmetric matrix, stored as the blocks of its lower half.
#ifndef PLIANT_TEST_BLOCKS_H
#define PLIANT_TEST_BLOCKS_H

#include "fem/system.h"

#include <vector>

// values: in the order of pliant_system_assemble()
inline std::vector<double> multiply_blocks(const pliant_pattern &pattern, const std::vector<double> &values,
                                           const std::vector<double> &x)
{
    std::vector<double> y(x.size());
    const double *at = values.data();
    for (int32_t column = 0; column < pattern.num_columns; column++)
        for (int c = 0; c < 3; c++)
            for (int32_t b = pattern.start[column]; b < pattern.start[column + 1]; b++)
                for (int r = b == pattern.start[column] ? c : 0; r < 3; r++) {
                    const size_t i = 3 * static_cast<size_t>(pattern.row[b]) + static_cast<size_t>(r),
                                 j = 3 * static_cast<size_t>(column) + static_cast<size_t>(c);
                    y[i] += *at * x[j];
                    if (i != j) y[j] += *at * x[i];
                    at++;
                }
    return y;
}

#endif
