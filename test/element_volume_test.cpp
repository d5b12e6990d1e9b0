// No leg makes an element smaller than its least volume: random motions of a mesh against samples of the same motions.
#include "contact/volume/volume_bound.h"
#include "contact/detect/part_contacts.h"
#include "base/memory.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <random>
#include <vector>

namespace
{

// A lattice of nodes, five tetrahedra per cube, and where a leg takes the nodes.
struct Leg {
    std::vector<double> rest, from, to;
    std::vector<int32_t> tets;
    pliant_mesh mesh{};

    explicit Leg(int cells)
    {
        const int nodes = cells + 1;
        for (int k = 0; k < nodes; k++)
            for (int j = 0; j < nodes; j++)
                for (int i = 0; i < nodes; i++) rest.insert(rest.end(), {0.01 * i, 0.01 * j, 0.01 * k});
        const int even[5][4] = {{0, 1, 2, 4}, {3, 1, 7, 2}, {5, 1, 4, 7}, {6, 2, 7, 4}, {1, 2, 4, 7}};
        for (int cell = 0; cell < cells * cells * cells; cell++) {
            const int at[3] = {cell % cells, cell / cells % cells, cell / cells / cells};
            const bool odd = (at[0] + at[1] + at[2]) % 2;
            for (const auto &tet : even)
                for (const int corner : tet) {
                    const int c = odd ? corner ^ 1 : corner;
                    tets.push_back(at[0] + (c & 1) + nodes * (at[1] + (c >> 1 & 1) + nodes * (at[2] + (c >> 2))));
                }
        }
        from = to = rest;
        mesh.num_nodes = nodes * nodes * nodes;
        mesh.num_tets = static_cast<int32_t>(tets.size() / 4);
        mesh.rest = rest.data();
        mesh.tets = tets.data();
        for (int32_t t = 0; t < mesh.num_tets; t++)
            if (ratio(t, rest) < 0) std::swap(tets[4 * t], tets[4 * t + 1]);
    }
    double volume(int32_t t, const std::vector<double> &x) const
    {
        double e[3][3];
        for (int k = 0; k < 3; k++)
            for (int d = 0; d < 3; d++) e[k][d] = x[3 * tets[4 * t + k + 1] + d] - x[3 * tets[4 * t] + d];
        return (e[0][0] * (e[1][1] * e[2][2] - e[1][2] * e[2][1]) - e[0][1] * (e[1][0] * e[2][2] - e[1][2] * e[2][0]) +
                e[0][2] * (e[1][0] * e[2][1] - e[1][1] * e[2][0])) /
               6;
    }
    double ratio(int32_t t, const std::vector<double> &x) const { return volume(t, x) / std::fabs(volume(t, rest)); }
    // where nodes are after a fraction of the leg, each of which goes its share of its way
    std::vector<double> at(double time, const std::vector<double> &fraction) const
    {
        std::vector<double> x = from;
        for (size_t i = 0; i < x.size(); i++) x[i] += time * fraction[i / 3] * (to[i] - from[i]);
        return x;
    }
    void shake(std::mt19937 &random, std::vector<double> &x, double maximum) const
    {
        std::uniform_real_distribution<double> of(-maximum, maximum);
        for (double &value : x) value += of(random);
    }
};

void expect_kept(const Leg &leg, const std::vector<double> &fraction, int number)
{
    const pliant_contact_settings settings = pliant_contact_settings_default();
    for (int n = 0; n <= 40; n++) {
        const std::vector<double> x = leg.at(n / 40.0, fraction);
        for (int32_t t = 0; t < leg.mesh.num_tets; t++) {
            const double begin = leg.ratio(t, leg.from);
            if (begin > 0)
                ASSERT_GE(leg.ratio(t, x), std::min(0.5 * settings.volume_stop, begin) * (1 - 1e-9))
                    << number << ": " << t << " at " << n / 40.0;
        }
    }
}

TEST(Volume, NoElementInvertsInALeg)
{
    std::mt19937 random(1);
    const pliant_contact_settings settings = pliant_contact_settings_default();
    int limited = 0;
    for (int number = 0; number < 200; number++) {
        Leg leg(2);
        leg.shake(random, leg.from, 0.003);
        leg.to = leg.from;
        leg.shake(random, leg.to, number % 2 ? 0.02 : 0.004);
        std::vector<double> fraction(leg.mesh.num_nodes);
        const int32_t count = pliant_volume_bound_motion(&settings, &leg.mesh, leg.from.data(), leg.to.data(), nullptr,
                                                         2, fraction.data());
        limited += count > 0;
        EXPECT_EQ(count == 0, *std::min_element(fraction.begin(), fraction.end()) == 1);
        expect_kept(leg, fraction, number);
        const double time = pliant_volume_advance(&settings, &leg.mesh, leg.from.data(), leg.to.data(), nullptr, 2);
        expect_kept(leg, std::vector<double>(leg.mesh.num_nodes, time), number);
        EXPECT_EQ(count == 0, time == 1);
    }
    EXPECT_GT(limited, 100);
}

TEST(Volume, ALegThatMovesEverythingTogetherIsNotShortened)
{
    const pliant_contact_settings settings = pliant_contact_settings_default();
    Leg leg(2);
    for (size_t i = 0; i < leg.to.size(); i++) leg.to[i] += 0.3;
    std::vector<double> fraction(leg.mesh.num_nodes);
    EXPECT_EQ(
        pliant_volume_bound_motion(&settings, &leg.mesh, leg.from.data(), leg.to.data(), nullptr, 2, fraction.data()),
        0);
    EXPECT_EQ(pliant_volume_advance(&settings, &leg.mesh, leg.from.data(), leg.to.data(), nullptr, 2), 1);
}

TEST(Volume, ElementsOfPiecesAndInvertedOnesAreExempt)
{
    const pliant_contact_settings settings = pliant_contact_settings_default();
    Leg leg(1);
    for (double &value : leg.to) value = 0.005;
    const std::vector<int32_t> piece(leg.mesh.num_nodes, 0);
    EXPECT_LT(pliant_volume_advance(&settings, &leg.mesh, leg.from.data(), leg.to.data(), nullptr, 2), 1);
    EXPECT_EQ(pliant_volume_advance(&settings, &leg.mesh, leg.from.data(), leg.to.data(), piece.data(), 2), 1);
    for (size_t i = 0; i < leg.from.size(); i += 3) leg.from[i] = -leg.from[i]; // a mirror image
    EXPECT_EQ(pliant_volume_advance(&settings, &leg.mesh, leg.from.data(), leg.to.data(), nullptr, 2), 1);
}

// The gap is 3 V / A less the height to keep, and its gradient that of finite differences.
TEST(Volume, PointsOfSmallElementsHaveTheGradientOfTheVolume)
{
    std::mt19937 random(2);
    const pliant_contact_settings settings = pliant_contact_settings_default();
    int found = 0;
    for (int number = 0; number < 50; number++) {
        Leg leg(1);
        leg.shake(random, leg.from, 0.006);
        pliant_contacts points{};
        ASSERT_EQ(pliant_volume_find(&settings, &leg.mesh, leg.from.data(), nullptr, true, 1, &points), PLIANT_OK);
        int small = 0;
        for (int32_t t = 0; t < leg.mesh.num_tets; t++) small += leg.ratio(t, leg.from) < settings.volume_near;
        ASSERT_EQ(points.count, small);
        for (int32_t p = 0; p < points.count; p++) {
            const pliant_contact_point &point = points.point[p];
            const int32_t t = static_cast<int32_t>(point.feature >> 2 & 0xffffffff);
            double gradient[4][3], gap = 0, area = 0;
            pliant_volume_gradient(&point, leg.from.data(), gradient);
            for (int d = 0; d < 3; d++) {
                double x = -point.place[d];
                for (int k = 0; k < 4; k++) x += point.weight[k] * leg.from[3 * point.node[k] + d];
                gap += point.normal[d] * x;
            }
            // dV at the node that presses: a third of the face's area
            const double step = 1e-8;
            for (int k = 0; k < 4; k++)
                for (int d = 0; d < 3; d++) {
                    std::vector<double> a = leg.from, b = leg.from;
                    a[3 * point.node[k] + d] += step;
                    b[3 * point.node[k] + d] -= step;
                    const double slope = (leg.volume(t, a) - leg.volume(t, b)) / (2 * step);
                    if (k == 0) area += 3 * slope * point.normal[d];
                    if (k > 0) EXPECT_NEAR(3 * slope / area, gradient[k][d], 1e-5);
                }
            EXPECT_NEAR(
                gap, 3 * (leg.volume(t, leg.from) - settings.volume_stop * std::fabs(leg.volume(t, leg.rest))) / area,
                1e-8);
            if (p > 0) EXPECT_LT(points.point[p - 1].feature, point.feature);
            found++;
        }
        pliant_free(points.point);
    }
    EXPECT_GT(found, 50);
}

} // namespace
