// Silicone beam for the verification of elements: 30 x 30 x 100 mm, E = 263.8 kPa, clamped at one end, with its weight
// across.
#ifndef PLIANT_TEST_BEAM_H
#define PLIANT_TEST_BEAM_H

#include "body.h"

struct Beam : Body {
    // across: number of cells along 30 mm
    Beam(pliant_element_kind kind, double poisson, int across, double gravity = 9.81)
        : Body(size, box, {{263.8e3, poisson, 1070, false}})
    {
        scene.element.kind = kind;
        cells(across, across, 10 * across / 3, 1);
        fix_plane(0, 0, 1e-4, 0, 0, 1);
        scene.model.gravity[1] = -gravity;
    }
    // Build and settle; return the mean sag of the free end [m].
    double sag(int steps = 200)
    {
        EXPECT_EQ(build(), PLIANT_OK) << pliant_last_error();
        EXPECT_EQ(settle(steps), PLIANT_OK) << data->statistics.residual;
        return tip_sag();
    }
    double tip_sag() const
    {
        double sum = 0;
        int count = 0;
        const pliant_mesh &fine = model->body->fine;
        for (int32_t n = 0; n < fine.num_nodes; n++)
            if (fine.rest[3 * n + 2] > box[2] - 1e-9) {
                sum += fine.rest[3 * n + 1] - data->positions[3 * n + 1];
                count++;
            }
        return sum / count;
    }

private:
    static constexpr int size[3] = {12, 12, 40};
    static constexpr double box[3] = {0.03, 0.03, 0.1};
};
constexpr int Beam::size[3];
constexpr double Beam::box[3];

#endif
