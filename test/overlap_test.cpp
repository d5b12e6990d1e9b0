// The overlap test of two tetrahedra, against separating axes in integer arithmetic.
#include "../cuda/contact/overlaps_side.h"
#include "contact/detect/overlap.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <limits>
#include <random>

namespace {

__extension__ typedef __int128 Whole;
using Vector = std::array<Whole, 3>;
using Tetrahedron = std::array<Vector, 4>;

Vector minus(const Vector &a, const Vector &b) { return {a[0] - b[0], a[1] - b[1], a[2] - b[2]}; }
Whole dot(const Vector &a, const Vector &b) { return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]; }
Vector cross(const Vector &a, const Vector &b)
{
    return {a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]};
}

bool is_flat(const Tetrahedron &a) { return dot(cross(minus(a[1], a[0]), minus(a[2], a[0])), minus(a[3], a[0])) == 0; }

bool separates(const Vector &axis, const Tetrahedron &a, const Tetrahedron &b)
{
    if (axis == Vector{0, 0, 0}) return false;
    Whole low[2], high[2];
    for (int t = 0; t < 2; t++)
        for (int v = 0; v < 4; v++) {
            const Whole at = dot(axis, (t ? b : a)[v]);
            low[t] = v ? std::min(low[t], at) : at;
            high[t] = v ? std::max(high[t], at) : at;
        }
    return high[0] <= low[1] || high[1] <= low[0];
}

// Test all axes of two convex bodies: the normals of faces and the cross products of edges.
bool overlap_exactly(const Tetrahedron &a, const Tetrahedron &b)
{
    if (is_flat(a) || is_flat(b)) return false;
    std::array<std::array<Vector, 6>, 2> edges;
    for (int t = 0; t < 2; t++) {
        const Tetrahedron &one = t ? b : a;
        int count = 0;
        for (int v = 0; v < 4; v++)
            for (int w = v + 1; w < 4; w++) edges[t][count++] = minus(one[w], one[v]);
        for (int i = 0; i < 6; i++)
            for (int j = 0; j < i; j++)
                // some are no face normals, which does no harm
                if (separates(cross(edges[t][i], edges[t][j]), a, b)) return false;
    }
    for (const Vector &e : edges[0])
        for (const Vector &f : edges[1])
            if (separates(cross(e, f), a, b)) return false;
    return true;
}

bool overlap(const Tetrahedron &a, const Tetrahedron &b, double unit = 1)
{
    double x[3][4], y[3][4];
    for (int v = 0; v < 4; v++)
        for (int d = 0; d < 3; d++) {
            x[d][v] = unit * double(a[v][d]);
            y[d][v] = unit * double(b[v][d]);
        }
    return pliant_tets_overlap(x, y) != 0;
}

Tetrahedron any(std::mt19937 &random, int size)
{
    std::uniform_int_distribution<int> number(0, size);
    Tetrahedron out;
    for (Vector &corner : out)
        for (Whole &x : corner) x = number(random);
    return out;
}

struct Counts {
    int overlapping = 0, apart = 0;
};

Counts compare(int size, int count, unsigned seed)
{
    std::mt19937 random(seed);
    Counts counts;
    for (int n = 0; n < count; n++) {
        const Tetrahedron a = any(random, size), b = any(random, size);
        const bool truth = overlap_exactly(a, b);
        (truth ? counts.overlapping : counts.apart)++;
        EXPECT_EQ(overlap(a, b), truth) << "pair " << n << " of size " << size;
        EXPECT_EQ(overlap(b, a), truth) << "pair " << n << " of size " << size << ", turned around";
        if (testing::Test::HasFailure()) break;
    }
    return counts;
}

// Few coordinates: corners, edges and faces coincide, and a fifth of the tetrahedra are flat.
TEST(Overlap, OfTouchingAndFlatOnes)
{
    for (int size : {1, 2, 3}) {
        const Counts counts = compare(size, 60000, static_cast<unsigned>(size));
        EXPECT_GT(counts.overlapping, 100);
        EXPECT_GT(counts.apart, 1000);
    }
}

TEST(Overlap, OfRandomOnes)
{
    for (int size : {12, 127, 1 << 20}) {
        const Counts counts = compare(size, 30000, static_cast<unsigned>(size));
        EXPECT_GT(counts.overlapping, 5000);
        EXPECT_GT(counts.apart, 5000);
    }
}

Tetrahedron moved(const Tetrahedron &a, const Vector &by)
{
    Tetrahedron out = a;
    for (Vector &corner : out)
        for (int d = 0; d < 3; d++) corner[d] += by[d];
    return out;
}

// Tetrahedra in contact do not overlap. They overlap after a motion of one unit.
TEST(Overlap, BeginsWhereTheyTouch)
{
    const Tetrahedron a = {{{0, 0, 0}, {60, 0, 0}, {0, 60, 0}, {0, 0, 60}}};
    const Tetrahedron face = {{{-40, 10, 10}, {0, 10, 10}, {0, 30, 10}, {0, 10, 30}}};
    EXPECT_FALSE(overlap(a, face));
    EXPECT_TRUE(overlap(a, moved(face, {1, 0, 0})));
    const Tetrahedron corner = {{{-30, -30, -30}, {0, 0, 0}, {-30, 0, 0}, {0, -30, 0}}};
    EXPECT_FALSE(overlap(a, corner));
    EXPECT_TRUE(overlap(a, moved(corner, {1, 1, 1})));
    // Two edges cross: one along x at y = z = 0, and one along (0, 1, -1). No corner lies in the other tetrahedron.
    const Tetrahedron edge = {{{20, 10, -10}, {20, -10, 10}, {10, -30, -30}, {30, -30, -30}}};
    EXPECT_FALSE(overlap(a, edge));
    EXPECT_TRUE(overlap(a, moved(edge, {0, 1, 1})));
    EXPECT_TRUE(overlap(a, a));
    Tetrahedron turned = a;
    std::swap(turned[0], turned[1]);
    EXPECT_TRUE(overlap(a, turned));
    EXPECT_FALSE(overlap(turned, face));
    EXPECT_TRUE(overlap(turned, moved(face, {1, 0, 0})));
    const Tetrahedron within = {{{10, 10, 10}, {12, 10, 10}, {10, 12, 10}, {10, 10, 12}}};
    EXPECT_TRUE(overlap(a, within));
    EXPECT_TRUE(overlap(within, a));
}

// Scale to metres: powers of two are exact too.
TEST(Overlap, DoesNotDependOnTheUnit)
{
    std::mt19937 random(4);
    for (int n = 0; n < 20000; n++) {
        const Tetrahedron a = any(random, 20), b = any(random, 20);
        ASSERT_EQ(overlap(a, b, 1.0 / 4096), overlap(a, b)) << n;
    }
}

TEST(Overlap, OfNotANumber)
{
    const double none = std::numeric_limits<double>::quiet_NaN();
    double a[3][4] = {{0, 1, 0, 0}, {0, 0, 1, 0}, {0, 0, 0, 1}};
    double b[3][4] = {{none, none, none, none}, {none, none, none, none}, {none, none, none, none}};
    EXPECT_FALSE(pliant_tets_overlap(a, b));
    EXPECT_FALSE(pliant_tets_overlap(b, a));
}

// The cells of the grid return to the requested width as soon as wider cells are not needed.
TEST(Overlap, CellsAreWideNoLongerThanTheyHaveToBe)
{
    gpu_cells cells = {0.01, 1, 1};
    EXPECT_EQ(gpu_cells_max(&cells), 16u);
    EXPECT_FALSE(gpu_cells_update(&cells, 16, 900, 1000));
    EXPECT_EQ(gpu_cells_coarser(&cells), 1);
    EXPECT_TRUE(gpu_cells_update(&cells, 4000, 900, 1000)); // a node moves far away
    EXPECT_GE(gpu_cells_max(&cells), 4000u);
    EXPECT_FALSE(gpu_cells_update(&cells, 4000, 10, 1000));
    EXPECT_FALSE(gpu_cells_update(&cells, 5000, 10, 1000)) << "it may go on a little";
    EXPECT_FALSE(gpu_cells_update(&cells, 0, 10, 1000)); // and returns
    EXPECT_EQ(gpu_cells_coarser(&cells), 1);
    EXPECT_TRUE(gpu_cells_update(&cells, 0, 5000, 1000)); // the whole mesh grows
    EXPECT_TRUE(gpu_cells_update(&cells, 0, 1200, 1000));
    EXPECT_FALSE(gpu_cells_update(&cells, 0, 300, 1000));
    EXPECT_EQ(gpu_cells_coarser(&cells), 4);
    EXPECT_FALSE(gpu_cells_update(&cells, 0, 60, 1000)); // and shrinks again
    EXPECT_EQ(gpu_cells_coarser(&cells), 2);
    EXPECT_FALSE(gpu_cells_update(&cells, 0, 60, 1000));
    EXPECT_EQ(gpu_cells_coarser(&cells), 1);
    EXPECT_TRUE(gpu_cells_update(&cells, std::numeric_limits<unsigned long long>::max(), 0, 1000));
    // the counter has this upper limit
    EXPECT_FALSE(gpu_cells_update(&cells, static_cast<unsigned long long>(GPU_MAX_FINE_CELLS), 10, 1000));
}

} // namespace
