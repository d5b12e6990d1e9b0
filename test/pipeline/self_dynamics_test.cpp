// Blocks in explicit dynamics that fall onto one another, rest in a stack, and collide in flight.
#include "backend/explicit_statistics.h"
#include "body.h"
#include "self_crossings.h"
#include "fem/dynamics/tled.h"
#include "fem/dynamics/substep_contact.h"

#include <algorithm>
#include <array>
#include <numeric>
#include <random>

namespace {

constexpr double h = 0.01; // element size

// Blocks of 3 x 3 x 2 elements one above the other, separated by one empty element.
struct Pile : Body {
    static std::vector<int> size_of(int blocks) { return {6, 6, 2 * (3 * blocks - 1)}; }
    static std::vector<double> box_of(int blocks) { return {3 * h, 3 * h, (3 * blocks - 1) * h}; }
    int blocks;

    explicit Pile(int count)
        : Body(size_of(count).data(), box_of(count).data(), {{20e3, 0.3, 1000, false}, {1, 0.3, 1, true}},
               [](int, int, int k) { return k / 2 % 3 == 2; }),
          blocks(count)
    {
        cells(3, 3, 3 * count - 1, 1);
        scene.solver.kind = PLIANT_TLED;
        scene.element.kind = PLIANT_LINEAR;
        scene.solver.step = 0.01;
        scene.contact.self = true;
        scene.contact.friction = 0.2;
        scene.ground.normal[2] = 1;
        scene.tled.damping = 20;
        scene.model.gravity[2] = -9.81;
    }
    int block_of(int32_t node) const { return static_cast<int>(data->body->fine.rest[3 * node + 2] / (3 * h) + 1e-6); }
    // Return the lowest or highest point of a block.
    double end(int block, bool top) const
    {
        double out = top ? -1 : 1;
        for (int32_t n = 0; n < data->body->fine.num_nodes; n++)
            if (block_of(n) == block)
                out = top ? std::max(out, data->positions[3 * n + 2]) : std::min(out, data->positions[3 * n + 2]);
        return out;
    }
    void run(int steps)
    {
        for (int s = 0; s < steps; s++) ASSERT_EQ(pliant_step(model, data), PLIANT_OK) << pliant_last_error();
    }
    // Return the maximum difference between the distance of the two sides of pressed points and the thickness.
    double worst_gap() const
    {
        const bool paper = scene.contact.response == PLIANT_RESPONSE_PAPER;
        const double thickness = paper ? 0 : model->contact.self_thickness * h;
        double worst = 0;
        for (int32_t c = 0; c < data->contacts.count; c++) {
            const pliant_contact_point &point = data->contacts.point[c];
            double gap = 0;
            for (int32_t k = 0; k < point.count; k++)
                for (int d = 0; d < 3; d++)
                    gap += point.weight[k] * point.normal[d] * data->positions[3 * point.node[k] + d];
            if (point.force[2] != 0) worst = std::max(worst, std::fabs(gap - thickness));
        }
        return worst;
    }
    double kinetic() const
    {
        pliant_dynamics dynamics;
        EXPECT_EQ(pliant_data_get_dynamics(model, data, &dynamics), PLIANT_OK);
        return dynamics.kinetic_energy;
    }
};

TEST(SelfDynamics, TwoDroppedBlocksRestOnEachOther)
{
    Pile pile(2);
    ASSERT_EQ(pile.build(), PLIANT_OK) << pliant_last_error();
    pile.run(60);
    EXPECT_LT(pile.worst_gap(), 0.01 * h);
    EXPECT_LT(pile.data->statistics.penetration, 0.01 * h);
    EXPECT_LT(pile.kinetic(), 1e-8);
    double force[3] = {0, 0, 0};
    std::vector<pliant_contact> contacts(1000);
    const int32_t count = pliant_data_get_contacts(pile.data, 1000, contacts.data());
    for (int32_t c = 0; c < count; c++)
        for (int d = 0; d < 3; d++)
            force[d] += contacts[c].tissue ? contacts[c].force[d] * (contacts[c].normal[2] > 0 ? 1 : -1) : 0;
    const double weight = 9 * 2 * h * h * h * 1000 * 9.81, thickness = pile.model->contact.self_thickness * h;
    EXPECT_NEAR(pile.end(1, false) - pile.end(0, true), thickness, 0.2 * thickness) << "they rest a thickness apart";
    EXPECT_NEAR(force[2], weight, 0.02 * weight) << "the upper one's";
}

TEST(SelfDynamics, AStackOfFiveStays)
{
    Pile pile(5);
    pile.scene.tled.damping = 40;
    ASSERT_EQ(pile.build(), PLIANT_OK) << pliant_last_error();
    pile.run(80);
    const double top = pile.end(4, true);
    std::vector<double> before(pile.data->positions, pile.data->positions + 3 * pile.data->body->fine.num_nodes);
    pile.run(25);
    double maximum = 0;
    for (size_t i = 0; i < before.size(); i++)
        maximum = std::max(maximum, std::fabs(pile.data->positions[i] - before[i]));
    EXPECT_LT(pile.worst_gap(), 0.01 * h);
    EXPECT_LT(maximum, 0.01 * h);
    EXPECT_GT(top, 0.9 * 10 * h);
}

// Two blocks in flight that collide off-centre and rotate.
struct Flight : Pile {
    double substep = 0;

    explicit Flight(double friction, double safety = 0.9, const pliant_regions &obstacles = {}) : Pile(2)
    {
        scene.obstacles = obstacles;
        scene.tled.damping = 0;
        scene.tled.safety = safety;
        scene.model.gravity[2] = 0;
        scene.ground.point[2] = -1;
        scene.contact.friction = friction;
        EXPECT_EQ(build(), PLIANT_OK) << pliant_last_error();
        substep = data->tled->time_step;
        const double speed = 0.3;
        for (int32_t n = 0; n < data->body->fine.num_nodes; n++) {
            data->tled->u[3 * n] += block_of(n) ? 1.3 * h : 0;
            data->tled->d[3 * n + 2] = (block_of(n) ? -speed : speed) * substep;
            data->tled->d[3 * n] = (block_of(n) ? -0.2 : 0.2) * speed * substep;
        }
    }
    // Return linear and angular momentum [N s, N m s], half a sub-step earlier.
    void momenta(double out[6]) const
    {
        std::fill(out, out + 6, 0);
        const pliant_tled *tled = data->tled;
        for (int32_t n = 0; n < data->body->fine.num_nodes; n++) {
            const double m = data->body->node_mass[n] / tled->time_step, *d = tled->d + 3 * n;
            double x[3];
            for (int k = 0; k < 3; k++) x[k] = data->body->fine.rest[3 * n + k] + tled->u[3 * n + k] - 0.5 * d[k];
            for (int k = 0; k < 3; k++) {
                out[k] += m * d[k];
                out[3 + k] += m * (x[(k + 1) % 3] * d[(k + 2) % 3] - x[(k + 2) % 3] * d[(k + 1) % 3]);
            }
        }
    }
    double energy() const
    {
        pliant_dynamics dynamics;
        EXPECT_EQ(pliant_data_get_dynamics(model, data, &dynamics), PLIANT_OK);
        return dynamics.kept_energy;
    }
};

TEST(SelfDynamics, CollisionsKeepMomentum)
{
    for (double friction : {0.0, 0.5}) {
        Flight flight(friction);
        double first[6], now[6], scale = 0, arm = 0, maximum = 0, in_contact = 0, energy = flight.energy(),
                                 start = energy, max_increase = 0;
        flight.momenta(first);
        for (int32_t n = 0; n < flight.data->body->fine.num_nodes; n++) scale += flight.data->body->node_mass[n] * 0.3;
        arm = scale * 3 * h;
        double turned = 0, lost = 0;
        for (int s = 0; s < 15; s++) {
            flight.run(1);
            flight.momenta(now);
            for (int k = 0; k < 3; k++) lost = std::max(lost, std::fabs(now[k] - first[k]) / scale);
            for (int k = 0; k < 3; k++) turned = std::max(turned, std::fabs(now[3 + k] - first[3 + k]) / arm);
            in_contact += flight.data->statistics.contacts;
            const double e = flight.energy();
            max_increase = std::max(max_increase, (e - energy) / start);
            maximum = std::max(maximum, e / start);
            energy = e;
        }
        EXPECT_GT(in_contact, 10);
        EXPECT_LT(lost, 1e-7) << "elements' forces are floats: 5e-9";
        EXPECT_LT(turned, 2e-7);
        EXPECT_LT(maximum, 1 + 1e-6);
        EXPECT_LT(max_increase, 0.005);
    }
}

// Blocks that meet at 2 m/s come nearer in a sub-step than their contact points foresee. Impacts keep momentum, and
// nothing crosses.
TEST(SelfDynamics, FastBlocksDoNotPassThroughEachOther)
{
    Flight flight(0.2, 0.3);
    double first[6], now[6], scale = 0;
    for (int32_t n = 0; n < flight.data->body->fine.num_nodes; n++) {
        flight.data->tled->d[3 * n + 2] = (flight.block_of(n) ? -1 : 1) * flight.substep;
        flight.data->tled->d[3 * n + 1] = (flight.block_of(n) ? -0.5 : 0.5) * flight.substep;
        scale += flight.data->body->node_mass[n];
    }
    flight.momenta(first);
    const double start = flight.energy();
    int in_contact = 0;
    for (int s = 0; s < 6; s++) {
        flight.run(1);
        flight.momenta(now);
        for (int k = 0; k < 3; k++) EXPECT_NEAR(now[k], first[k], 1e-6 * scale) << s;
        EXPECT_LT(flight.energy(), 1.001 * start) << s;
        EXPECT_EQ(count_crossings(flight), 0) << s;
        in_contact += flight.data->statistics.contacts;
    }
    EXPECT_GT(in_contact, 10);
}

// Results of throwing the blocks: maximum energy, and maximum increase per frame,
// relative to the initial energy.
struct Thrown {
    double maximum = 0, max_increase = 0;
    int met = 0, deep = 0;

    // Set a speed, and an angular velocity [rad/s] about the common centre, of the upper block or the lower one.
    static void set(Flight *flight, bool upper, const double speed[3], const double spin[3])
    {
        const double middle[3] = {1.5 * h, 1.5 * h, (upper ? 4 : 1) * h};
        for (int32_t n = 0; n < flight->data->body->fine.num_nodes; n++)
            for (int k = 0; k < 3 && (flight->block_of(n) == 1) == upper; k++) {
                const int a = (k + 1) % 3, b = (k + 2) % 3;
                const double *rest = flight->data->body->fine.rest + 3 * n,
                             turn = spin[a] * (rest[b] - middle[b]) - spin[b] * (rest[a] - middle[a]);
                flight->data->tled->d[3 * n + k] = (speed[k] + turn) * flight->substep;
            }
    }
    static void move(Flight *flight, bool upper, const double to[3])
    {
        for (int32_t n = 0; n < flight->data->body->fine.num_nodes; n++)
            for (int k = 0; k < 3 && (flight->block_of(n) == 1) == upper; k++) flight->data->tled->u[3 * n + k] = to[k];
    }
    void run(Flight *flight)
    {
        const double start = flight->energy();
        double energy = start;
        int in_contact = 0;
        for (int s = 0; s < 30; s++) {
            flight->run(1);
            const double now = flight->energy();
            max_increase = std::max(max_increase, (now - energy) / start);
            maximum = std::max(maximum, now / start);
            energy = now;
            in_contact += flight->data->statistics.contacts;
            for (int32_t c = 0; c < flight->data->contacts.count; c++)
                deep += flight->data->tled->contact[c].initial_depth > 1e-6;
        }
        met += in_contact > 0;
    }
};

// Edges penetrate deeply before detection, and their correction must not accelerate them. Sub-steps of a third make the
// error of central differences smaller than the tested effect.
TEST(SelfDynamics, CollisionsOfAnyKindGainNothing)
{
    std::mt19937 random(5);
    std::uniform_real_distribution<double> any(-1, 1);
    Thrown thrown;
    for (int run = 0; run < 60; run++) {
        Flight flight(run % 2 ? 0.3 : 0, 0.3);
        const double off[3] = {1.5 * h * any(random), 1.5 * h * any(random), 0},
                     speed[3] = {0.1 * any(random), 0.1 * any(random), -0.15 + 0.1 * any(random)};
        const double spin[3] = {6 * any(random), 6 * any(random), 6 * any(random)},
                     against[3] = {-speed[0], -speed[1], -speed[2]}, none[3] = {0, 0, 0};
        Thrown::move(&flight, true, off);
        Thrown::set(&flight, true, speed, spin);
        Thrown::set(&flight, false, against, none);
        thrown.run(&flight);
    }
    EXPECT_GT(thrown.met, 30);
    EXPECT_GT(thrown.deep, 30) << "some are";
    EXPECT_LT(thrown.maximum, 1 + 1e-3);
    EXPECT_LT(thrown.max_increase, 0.01);
}

TEST(SelfDynamics, WhatIsThrownAtABoxGainsNothing)
{
    std::mt19937 random(5);
    std::uniform_real_distribution<double> any(-1, 1);
    Thrown thrown;
    for (int run = 0; run < 60; run++) {
        const double middle[2] = {1.5 * h + 2 * h * any(random), 1.5 * h + 2 * h * any(random)},
                     away[3] = {0, 0, 10 * h}, none[3] = {0, 0, 0};
        pliant_regions box{};
        box.num_boxes = 1;
        box.boxes[0] = {{middle[0] - h, middle[1] - h, -3 * h}, {middle[0] + h, middle[1] + h, -0.5 * h}};
        Flight flight(run % 2 ? 0.3 : 0, 0.3, box);
        const double speed[3] = {0.1 * any(random), 0.1 * any(random), -0.2 + 0.1 * any(random)},
                     spin[3] = {12 * any(random), 12 * any(random), 12 * any(random)};
        Thrown::move(&flight, true, away);
        Thrown::set(&flight, true, none, none);
        Thrown::set(&flight, false, speed, spin);
        thrown.run(&flight);
    }
    EXPECT_GT(thrown.met, 50);
    EXPECT_GT(thrown.deep, 30) << "some are";
    EXPECT_LT(thrown.maximum, 1.001);
    EXPECT_LT(thrown.max_increase, 0.03);
}

// A node and a triangle, or two edges, of any masses, meeting at any speed and angle: many sub-steps of contact without
// element forces.
struct FourNodes {
    double rest[12] = {0.3, 0.3, 1e-4, 0, 0, 0, 1, 0, 0, 0, 1, 0}, u[12], d[12], acceleration[12] = {}, inverse_mass[4];
    pliant_contact_point point = {};
    pliant_tled_contact contact = {};

    FourNodes(std::mt19937 &random, bool edges)
    {
        std::uniform_real_distribution<double> any(-1, 1);
        const double crossed[12] = {-0.5, 0.1, 1e-4, 0.6, 0, 1e-4, 0, -0.6, 0, 0, 0.5, 0};
        if (edges) std::copy(crossed, crossed + 12, rest);
        for (int i = 0; i < 12; i++) {
            u[i] = 0.01 * any(random);
            d[i] = 1e-3 * any(random) - (i % 3 == 2 && i < (edges ? 6 : 3) ? 4e-3 : 0);
        }
        for (double &m : inverse_mass) m = 1.5 + any(random);
        point.feature = static_cast<uint64_t>(edges ? PLIANT_TISSUE_EDGE : PLIANT_TISSUE_NODE) << 56;
        point.kind = PLIANT_OBSTACLE_TISSUE;
        point.count = 4;
        point.normal[2] = 1;
        for (int k = 0; k < 4; k++) point.node[k] = k;
        contact.weighted_inverse_mass = 1;
        contact.energy = 1;
    }
    void step(int s, int steps)
    {
        const pliant_tled_contact_nodes of = {rest, inverse_mass, u, d, acceleration};
        for (int i = 0; i < 12; i++) u[i] += d[i];
        const pliant_tled_contact_timing time = pliant_tled_contact_time(false, 1, steps, s);
        pliant_tled_contact_prepare(&of, &time, &point, &contact);
        pliant_tled_contact_start(&of, &time, &point, &contact);
        for (int pass = 0; pass < 2 && pliant_tled_contact_push(&of, &time, &point, &contact); pass++) {}
        pliant_tled_contact_finish(&of, &time, &point, &contact);
    }
    std::array<double, 6> momenta() const
    {
        std::array<double, 6> out = {};
        for (int n = 0; n < 4; n++)
            for (int k = 0; k < 3; k++) {
                const int a = 3 * n + (k + 1) % 3, b = 3 * n + (k + 2) % 3;
                out[k] += d[3 * n + k] / inverse_mass[n];
                out[3 + k] += ((rest[a] + u[a]) * d[b] - (rest[b] + u[b]) * d[a]) / inverse_mass[n];
            }
        return out;
    }
};

TEST(SelfDynamics, APointAddsNoForceAndNoTorque)
{
    std::mt19937 random(5);
    constexpr int steps = 200;
    int pressed = 0, shifted = 0;
    for (int trial = 0; trial < 100; trial++) {
        FourNodes four(random, trial % 2);
        four.point.friction = trial % 3 * 0.4;
        four.contact.initial_depth = trial % 5 * 1e-3;
        const std::array<double, 6> first = four.momenta();
        for (int s = 0; s < steps; s++) {
            four.step(s, steps);
            const std::array<double, 6> now = four.momenta();
            for (int k = 0; k < 6; k++)
                ASSERT_NEAR(now[k], first[k], 1e-14) << trial << " " << s << " " << k << ", of some 1e-2";
            pressed += four.contact.is_pressed;
            shifted += four.contact.separation_impulse[0] != 0;
        }
        EXPECT_EQ(four.contact.separation_impulse[2], 0) << "a frame owes the next one nothing";
    }
    EXPECT_GT(pressed, 1000);
    EXPECT_GT(shifted, 100);
}

// [C] 5.2: nodes of overlapping tetrahedra are pushed against their own motion, one cycle later or immediately; nodes
// at rest stay.
struct Slowed : Flight {
    explicit Slowed(bool delay, double speed, double apart, double overlap_damping = 0.5) : Flight(0)
    {
        scene.contact.response = PLIANT_RESPONSE_PAPER;
        scene.contact.delay = delay;
        scene.contact.overlap_damping = overlap_damping;
        EXPECT_EQ(build(), PLIANT_OK) << pliant_last_error();
        for (int32_t n = 0; n < data->body->fine.num_nodes; n++) {
            data->tled->u[3 * n + 2] = block_of(n) ? apart - h : 0;
            data->tled->d[3 * n + 2] = block_of(n) ? -speed * data->tled->time_step : 0;
            for (int d = 0; d < 3; d++)
                data->positions[3 * n + d] = data->body->fine.rest[3 * n + d] + data->tled->u[3 * n + d];
        }
    }
    double momentum() const
    {
        double out[6];
        momenta(out);
        return out[2];
    }
};

TEST(SelfDynamics, ThePapersResponseSlowsOverlappingNodes)
{
    for (const bool delay : {true, false}) {
        Slowed pile(delay, 0.5, 0.1 * h);
        const double start = pile.momentum();
        pile.run(1); // it moves by 5 mm, and starts separated
        EXPECT_EQ(pile.data->statistics.contacts > 0, !delay);
        EXPECT_EQ(std::fabs(pile.momentum() - start) > 0.02 * std::fabs(start), !delay);
        const double before = pile.momentum();
        pile.run(1);
        EXPECT_GT(pile.data->statistics.contacts, 0);
        EXPECT_LT(std::fabs(pile.momentum()), 0.9 * std::fabs(before)) << delay;
        int against = 0, pressed = 0;
        for (int32_t c = 0; c < pile.data->contacts.count; c++) {
            const pliant_contact_point &point = pile.data->contacts.point[c];
            ASSERT_EQ(point.count, 1);
            pressed += point.force[2] != 0;
            against += point.force[2] > 0 && pile.block_of(point.node[0]) == 1;
        }
        EXPECT_GT(against, 5);
        EXPECT_GE(pressed, against);
    }
    Slowed still(true, 0, -0.2 * h), free(true, 0, -0.2 * h, 0);
    still.run(3);
    free.run(3);
    EXPECT_GT(still.data->contacts.count, 0);
    for (int32_t c = 0; c < still.data->contacts.count; c++)
        for (double force : still.data->contacts.point[c].force) EXPECT_EQ(force, 0) << "at rest it does nothing";
    EXPECT_LT(still.worst_gap(), 1e-12);
}

TEST(SelfDynamics, ThePapersResponseIsOfExplicitDynamics)
{
    Pile pile(2);
    pile.scene.contact.response = PLIANT_RESPONSE_PAPER;
    pile.scene.solver.kind = PLIANT_COROTATIONAL;
    EXPECT_EQ(pile.build(), PLIANT_ERROR_SCENE);
    EXPECT_NE(std::string(pliant_last_error()).find("contact/response: paper needs explicit dynamics"),
              std::string::npos)
        << pliant_last_error();
}

} // namespace
