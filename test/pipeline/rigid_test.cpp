// One rigid body: in flight, and on walls.
#include "fem/rigid/rigid.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <cstring>
#include <vector>

namespace {

const double g = 9.81, at_rest[9] = {1, 0, 0, 0, 1, 0, 0, 0, 1};

pliant_rigid brick(double a, double b, double c)
{
    pliant_rigid body{};
    body.mass = 0.1;
    body.inertia[0] = body.mass / 12 * (b * b + c * c);
    body.inertia[4] = body.mass / 12 * (a * a + c * c);
    body.inertia[8] = body.mass / 12 * (a * a + b * b);
    std::copy(at_rest, at_rest + 9, body.rotation);
    return body;
}
// Update the inertia of the rotated body after a step.
void turn_inertia(pliant_rigid &body, std::vector<double> &arms)
{
    double half[9];
    for (int r = 0; r < 3; r++)
        for (int c = 0; c < 3; c++) {
            half[3 * r + c] = 0;
            for (int k = 0; k < 3; k++) half[3 * r + c] += body.rotation[3 * r + k] * body.inertia[3 * k + c];
        }
    for (int r = 0; r < 3; r++)
        for (int c = 0; c < 3; c++) {
            body.inertia[3 * r + c] = 0;
            for (int k = 0; k < 3; k++) body.inertia[3 * r + c] += half[3 * r + k] * body.rotation[3 * c + k];
        }
    for (size_t p = 0; p < arms.size() / 3; p++) {
        const double old[3] = {arms[3 * p], arms[3 * p + 1], arms[3 * p + 2]};
        for (int r = 0; r < 3; r++)
            arms[3 * p + r] =
                body.rotation[3 * r] * old[0] + body.rotation[3 * r + 1] * old[1] + body.rotation[3 * r + 2] * old[2];
    }
}
double energy(const pliant_rigid &body, const double gravity[3])
{
    double spin[3], sum = 0;
    pliant_rigid_spin(&body, spin);
    for (int d = 0; d < 3; d++)
        sum += 0.5 * body.mass * body.velocity[d] * body.velocity[d] + 0.5 * spin[d] * body.momentum[d] -
               body.mass * gravity[d] * body.centre[d];
    return sum;
}

TEST(Rigid, KeepsMomentumAndEnergyInFlight)
{
    const double gravity[3] = {0, 0, -g};
    pliant_rigid body = brick(0.02, 0.04, 0.1);
    body.velocity[0] = 1;
    const double momentum[3] = {1e-4, 8e-4, 2e-4}; // almost about the middle axis, so that it tumbles
    std::copy(momentum, momentum + 3, body.momentum);
    std::vector<double> arms;
    const double at_first = energy(body, gravity);
    const pliant_rigid_walls none{};
    double maximum = 0;
    for (int s = 0; s < 500; s++) {
        EXPECT_FALSE(pliant_rigid_step(&body, gravity, 0.02, 0, nullptr, &none));
        turn_inertia(body, arms);
        for (int d = 0; d < 3; d++) EXPECT_EQ(body.momentum[d], momentum[d]);
        maximum = std::fmax(maximum, std::fabs(energy(body, gravity) - at_first));
    }
    double turning = 0, spin[3];
    pliant_rigid_spin(&body, spin);
    for (int d = 0; d < 3; d++) turning += 0.5 * spin[d] * momentum[d];
    EXPECT_LT(maximum, 1e-3 * turning);
    EXPECT_NEAR(body.centre[2], -0.5 * g * 100, 1e-9);
}

// About a principal axis the angular velocity is L / J, and constant.
TEST(Rigid, TurnsAtItsMomentumOverItsInertia)
{
    const double none[3] = {0, 0, 0}, side[3] = {0.02, 0.04, 0.1}, momentum = 3e-5, time = 1e-3;
    const pliant_rigid_walls no_walls{};
    for (int axis = 0; axis < 3; axis++) {
        pliant_rigid body = brick(side[0], side[1], side[2]);
        body.momentum[axis] = momentum;
        const double a = side[(axis + 1) % 3], b = side[(axis + 2) % 3], rate = momentum / (0.1 / 12 * (a * a + b * b));
        double spin[3];
        pliant_rigid_spin(&body, spin);
        EXPECT_NEAR(spin[axis], rate, 1e-6 * rate);
        ASSERT_FALSE(pliant_rigid_step(&body, none, time, 0, nullptr, &no_walls));
        EXPECT_NEAR(body.rotation[3 * ((axis + 2) % 3) + (axis + 1) % 3], std::sin(rate * time), 1e-6 * rate * time);
    }
}

// A force F at an arm r for a short time t gives the velocity F t / m and the angular velocity J^-1 (r x F) t.
TEST(Rigid, AnImpulseTurnsItByTheLeverOverTheInertia)
{
    const double none[3] = {0, 0, 0}, time = 1e-4, force = 2;
    const pliant_rigid_walls no_walls{};
    pliant_rigid body = brick(0.02, 0.04, 0.1);
    pliant_rigid_pull pull{};
    pull.is_force = true;
    pull.arm[2] = 0.05;
    pull.force[1] = force;
    ASSERT_FALSE(pliant_rigid_step(&body, none, time, 1, &pull, &no_walls));
    const double inertia = 0.1 / 12 * (0.04 * 0.04 + 0.1 * 0.1);
    EXPECT_NEAR(body.velocity[1], force * time / 0.1, 1e-9);
    std::vector<double> no_arms;
    turn_inertia(body, no_arms);
    double spin[3];
    pliant_rigid_spin(&body, spin);
    EXPECT_NEAR(spin[0], -0.05 * force * time / inertia, 1e-3 * 0.05 * force * time / inertia);
}

// On a plane, on an edge, in a corner of walls: energy never increases, and the body comes to rest.
TEST(Rigid, EnergyNeverRisesOnWalls)
{
    for (const double restitution : {0.0, 0.5}) {
        const double gravity[3] = {1, 0, -g};
        const pliant_wall walls[2] = {{{0, 0, 1}, 0}, {{-1, 0, 0}, -0.3}};
        pliant_rigid body = brick(0.04, 0.06, 0.1);
        body.centre[2] = 0.2;
        body.momentum[0] = 5e-4;
        body.momentum[1] = 3e-4;
        std::vector<double> arms;
        for (int corner = 0; corner < 8; corner++)
            for (int d = 0; d < 3; d++)
                arms.push_back((corner >> d & 1 ? 0.5 : -0.5) * (d == 0 ? 0.04 : d == 1 ? 0.06 : 0.1));
        double before = energy(body, gravity), gained = 0, deepest = 0;
        bool is_near_wall = false;
        for (int s = 0; s < 300; s++) {
            const pliant_rigid_walls around = {walls, 2, 0.3, restitution, 8, arms.data()};
            is_near_wall |= pliant_rigid_step(&body, gravity, 0.02, 0, nullptr, &around);
            turn_inertia(body, arms);
            for (int p = 0; p < 8; p++) deepest = std::fmin(deepest, body.centre[2] + arms[3 * p + 2]);
            const double now = energy(body, gravity);
            gained = std::fmax(gained, now - before);
            before = now;
        }
        EXPECT_TRUE(is_near_wall);
        EXPECT_LT(gained, 1e-3 * body.mass * g * 0.2) << restitution;
        EXPECT_GT(deepest, -1e-3);
        double speed = 0;
        for (int d = 0; d < 3; d++) speed += std::fabs(body.velocity[d]);
        EXPECT_LT(speed, 0.03) << restitution;
        double side = 1;
        for (const double half : {0.02, 0.03, 0.05}) side = std::fmin(side, std::fabs(body.centre[2] - half));
        EXPECT_LT(side, 1e-4) << restitution; // flat on one of its sides
    }
}

} // namespace
