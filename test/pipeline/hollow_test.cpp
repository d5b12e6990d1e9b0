// A cavity in a block closes under compression.
#include "body.h"

#include <algorithm>
#include <cstdlib>

namespace {

constexpr double h = 0.005;

// A block of 40 x 10 x 30 mm with a tunnel of 20 x 10 mm.
struct Hollow : Body {
    int tool = -1;
    double tip[3] = {4 * h, h, 6 * h};

    explicit Hollow(bool dynamic, bool self = true, pliant_method method = PLIANT_FINE, int ratio = 1)
        : Body(std::vector<int>{16, 4, 12}.data(), std::vector<double>{8 * h, 2 * h, 6 * h}.data(),
               {{10e3, 0.3, 1000, false}, {1, 0.3, 1, true}},
               [](int i, int, int k) { return i >= 4 && i < 12 && k >= 4 && k < 8; })
    {
        fix_plane(0, 0, 1e-6, 0, 0, 1);
        cells(8, 2, 6, ratio);
        scene.model.method = method;
        scene.contact.self = self;
        scene.contact.friction = 0.2;
        if (dynamic) {
            scene.solver.kind = PLIANT_TLED;
            scene.solver.step = 0.01;
            scene.tled.damping = 40;
        }
        EXPECT_EQ(build(), PLIANT_OK) << pliant_last_error();
        pliant_tool_shape plate{};
        plate.num_parts = 1;
        plate.part[0] = {PLIANT_PART_BOX, PLIANT_FRAME_TIP, {-0.03, -0.03, 0}, {0.03, 0.03, 0.01}, 0, false};
        EXPECT_EQ(pliant_tool_add(model, data, "plate", &tool), PLIANT_OK);
        EXPECT_EQ(pliant_tool_set_shape(data, tool, &plate), PLIANT_OK) << pliant_last_error();
        EXPECT_EQ(pliant_tool_set_pose(data, tool, tip, nullptr), PLIANT_OK);
    }
    void squeeze(double by)
    {
        tip[2] -= by;
        EXPECT_EQ(pliant_tool_set_pose(data, tool, tip, nullptr), PLIANT_OK);
        EXPECT_GE(pliant_step(model, data), PLIANT_OK) << pliant_last_error();
    }
    // Return the number of tetrahedra that contain a point.
    int holders(const double p[3]) const
    {
        const pliant_mesh &mesh = data->body->fine;
        int count = 0;
        for (int32_t t = 0; t < mesh.num_tets; t++) {
            const double *x[4];
            bool in = true;
            for (int v = 0; v < 4; v++) x[v] = data->positions + 3 * mesh.tets[4 * t + v];
            for (int d = 0; d < 3 && in; d++)
                in = std::max({x[0][d], x[1][d], x[2][d], x[3][d]}) >= p[d] &&
                     std::min({x[0][d], x[1][d], x[2][d], x[3][d]}) <= p[d];
            for (int v = 0; v < 4 && in; v++) {
                double e[3][3], side[2] = {0, 0};
                for (int d = 0; d < 3; d++) {
                    e[0][d] = x[(v + 2) % 4][d] - x[(v + 1) % 4][d];
                    e[1][d] = x[(v + 3) % 4][d] - x[(v + 1) % 4][d];
                }
                for (int d = 0; d < 3; d++) {
                    e[2][d] = e[0][(d + 1) % 3] * e[1][(d + 2) % 3] - e[0][(d + 2) % 3] * e[1][(d + 1) % 3];
                    side[0] += e[2][d] * (x[v][d] - x[(v + 1) % 4][d]);
                    side[1] += e[2][d] * (p[d] - x[(v + 1) % 4][d]);
                }
                in = side[0] * side[1] > 0;
            }
            count += in;
        }
        return count;
    }
    // Estimate volumes from random points in the initial cavity.
    // open: fraction that is still open; twice: volume covered by tissue twice
    void volumes(double *open, double *twice) const
    {
        const int points = 6000;
        const double low[3] = {2 * h, 0, 0}, high[3] = {6 * h, 2 * h, 4 * h};
        const double part = (high[0] - low[0]) * (high[1] - low[1]) * (high[2] - low[2]) / (16 * h * h * h * points);
        std::srand(3);
        *open = *twice = 0;
        for (int n = 0; n < points; n++) {
            double p[3];
            for (int d = 0; d < 3; d++) p[d] = low[d] + (high[d] - low[d]) * std::rand() / RAND_MAX;
            const int in = p[2] < tip[2] ? holders(p) : 1;
            *open += in == 0 ? part : 0;
            *twice += in > 1 ? part : 0;
        }
    }
};

TEST(Hollow, ClosesWithoutInterpenetration)
{
    for (const bool dynamic : {false, true}) {
        Hollow hollow(dynamic);
        double open, twice;
        for (int s = 0; s < 26; s++) {
            hollow.squeeze(5e-4);
            if (s == 10) {
                hollow.volumes(&open, &twice);
                EXPECT_GT(open, 0.4);
                EXPECT_EQ(twice, 0);
            } else if (s > 19) {
                hollow.volumes(&open, &twice);
                EXPECT_LT(twice, 0.005) << s;
            }
            EXPECT_LT(hollow.data->statistics.penetration, 0.01 * h) << s;
        }
        EXPECT_LT(open, 0.1) << "corners are left";
    }
}

TEST(Hollow, GoesIntoItselfWithoutSelfContact)
{
    Hollow hollow(false, false);
    double open, twice;
    for (int s = 0; s < 26; s++) hollow.squeeze(5e-4);
    hollow.volumes(&open, &twice);
    EXPECT_GT(twice, 0.05);
}

// With coarse methods, tissue overlaps at most 1.5 times as much as with the fine mesh. The two sides of a contact
// point get opposite forces. They act at the same position, up to the penetration depth and the sliding distance of the
// step. Corners of the surface meet here, and no step may be blocked.
TEST(Hollow, ClosesByCoarseMethodsAsByTheFineMesh)
{
    double of_fine = 0, force_of_fine = 0;
    for (const pliant_method method : {PLIANT_FINE, PLIANT_COARSE, PLIANT_AVERAGED}) {
        Hollow hollow(false, true, method, 2);
        double open = 0, twice = 0, maximum = 0, force[3] = {0, 0, 0}, moment[3] = {0, 0, 0}, size = 0;
        double slid = 0; // sum of force times sliding distance [N m]
        int points = 0;
        std::vector<double> before;
        for (int s = 0; s < 26; s++) {
            before.assign(hollow.data->positions,
                          hollow.data->positions + 3 * size_t(hollow.data->body->fine.num_nodes));
            hollow.squeeze(5e-4);
            EXPECT_LT(hollow.data->statistics.penetration, 0.001 * h) << method << ", " << s;
            EXPECT_NE(hollow.data->statistics.ended, PLIANT_STEP_END_BLOCKED) << method << ", " << s;
            if (s % 3 != 1 || s < 19) continue;
            hollow.volumes(&open, &twice);
            maximum = std::fmax(maximum, twice);
        }
        for (int32_t p = 0; p < hollow.data->contacts.count; p++) {
            const pliant_contact_point &point = hollow.data->contacts.point[p];
            if (point.kind != PLIANT_OBSTACLE_TISSUE) continue;
            points++;
            double slip[3] = {0, 0, 0};
            for (int32_t k = 0; k < point.count; k++) {
                const double *x = hollow.data->positions + 3 * point.node[k];
                for (int d = 0; d < 3; d++) {
                    slip[d] += point.weight[k] * (x[d] - before[3 * size_t(point.node[k]) + size_t(d)]);
                    force[d] += point.weight[k] * point.force[d];
                    size += std::fabs(point.weight[k] * point.force[d]);
                    moment[d] += point.weight[k] * (x[(d + 1) % 3] * point.force[(d + 2) % 3] -
                                                    x[(d + 2) % 3] * point.force[(d + 1) % 3]);
                }
            }
            slid += std::sqrt(
                (slip[0] * slip[0] + slip[1] * slip[1] + slip[2] * slip[2]) *
                (point.force[0] * point.force[0] + point.force[1] * point.force[1] + point.force[2] * point.force[2]));
        }
        std::printf("method %d: %.4f open, %.4f twice, %d points, %.3g N\n", method, open, maximum, points, size);
        if (method == PLIANT_FINE) {
            of_fine = maximum;
            force_of_fine = size;
        }
        EXPECT_LE(maximum, 1.5 * of_fine) << method;
        EXPECT_LT(maximum, 0.008) << method;
        EXPECT_LT(open, 0.1) << method;
        EXPECT_GT(points, 20) << method;
        EXPECT_NEAR(size, force_of_fine, 0.3 * force_of_fine) << method;
        for (int d = 0; d < 3; d++) {
            EXPECT_LT(std::fabs(force[d]), 1e-12 * size) << method;
            EXPECT_LT(std::fabs(moment[d]), 2e-3 * h * size + slid) << method;
        }
    }
}

} // namespace
