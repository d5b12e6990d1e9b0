// Tests of contact in explicit dynamics: conserved quantities, dissipation and static friction.
#include "contacts.h"

#include "backend/explicit_statistics.h"
#include "fem/dynamics/tled.h"
#include "thrown.h"

namespace {

const double young = 5000;

struct Cube : Body {
    static constexpr double edge = 0.04, mass = 1000 * edge * edge * edge;
    explicit Cube(double poisson = 0.3)
        : Body(std::vector<int>{4, 4, 4}.data(), std::vector<double>{edge, edge, edge}.data(),
               {{young, poisson, 1000, false}})
    {
        cells(4, 4, 4, 1);
        scene.solver.kind = PLIANT_TLED;
        scene.solver.threads = 1;
        scene.tled.damping = 0;
        scene.ground.normal[2] = 1;
        scene.ground.point[2] = -10; // far below, so that the cube may fall
        for (double &g : scene.model.gravity) g = 0;
    }
    // Return the mean x of the lowest nodes.
    double foot() const
    {
        double sum = 0;
        int count = 0;
        for (int32_t n = 0; n < body().num_nodes; n++)
            if (body().rest[3 * n + 2] < 1e-9) {
                sum += data->positions[3 * n];
                count++;
            }
        return sum / count;
    }
    // The momentum half a sub-step earlier.
    void momentum(double out[3]) const
    {
        out[0] = out[1] = out[2] = 0;
        for (int32_t i = 0; i < 3 * body().num_nodes; i++)
            out[i % 3] += data->tled->system->node_mass[i / 3] * data->tled->d[i] / data->tled->time_step;
    }
    double energy() const
    {
        pliant_dynamics reported;
        EXPECT_EQ(pliant_data_get_dynamics(model, data, &reported), PLIANT_OK);
        return reported.kept_energy;
    }
    const pliant_mesh &body() const { return model->body->fine; }
};
constexpr double Cube::edge, Cube::mass;

Obstacle floor_of(double friction) { return {Obstacle::HALF_SPACE, {0, 0, 0}, {0, 0, 1}, 0, friction, {0, 0, 0}, -1}; }

// On a slope the block sticks if tan(slope) < mu. On a steeper slope it slides with g (sin - mu cos).
TEST(ContactTled, ABlockOnASlope)
{
    const double friction = 0.4;
    for (double slope : {0.3, 0.6}) {
        Cube cube;
        const double down = 9.81 * slope / std::sqrt(1 + slope * slope), press = 9.81 / std::sqrt(1 + slope * slope);
        cube.scene.tled.stiffness_damping = 0.005;
        cube.scene.model.gravity[2] = -press;
        ASSERT_EQ(cube.build(), PLIANT_OK) << pliant_last_error();
        NodeContacts toucher(cube.data->body);
        toucher.obstacles.push_back(floor_of(friction));
        auto run = [&](double time) {
            for (double t = 0; t < time; t += cube.scene.solver.step)
                ASSERT_GE(toucher.step(cube.model, cube.data), 0) << pliant_last_error();
        };
        run(1);
        const double gravity[3] = {0.9 * std::fmin(down, friction * press), 0, -press};
        ASSERT_EQ(pliant_data_set_gravity(cube.data, gravity), PLIANT_OK);
        run(1); // it leans on the friction
        double force[3], start[3], end[3];
        const double whole[3] = {down, 0, -press};
        ASSERT_EQ(pliant_data_set_gravity(cube.data, whole), PLIANT_OK);
        run(0.5);
        const double from = cube.foot();
        cube.momentum(start);
        const uint64_t first = cube.data->statistics.step;
        run(0.5);
        cube.momentum(end);
        NodeContacts::force(cube.data, force);
        const double time = (cube.data->statistics.step - first) * cube.scene.solver.step;
        if (slope < friction) { EXPECT_NEAR(cube.foot(), from, 1e-6);
        } else
            EXPECT_NEAR((end[0] - start[0]) / Cube::mass / time, down - friction * press,
                        0.01 * (down - friction * press));
        EXPECT_NEAR(force[2], Cube::mass * press, 0.02 * Cube::mass * press);
    }
}

// A cube thrown at the floor and at a sphere, with friction. No step increases the energy. The momentum changes by the
// force's impulse.
TEST(ContactTled, EnergyNeverGrowsAndForceIsTheChangeOfMomentum)
{
    Cube cube;
    ASSERT_EQ(cube.build(), PLIANT_OK) << pliant_last_error();
    NodeContacts toucher(cube.data->body);
    toucher.obstacles.push_back(floor_of(0.5));
    toucher.obstacles.push_back({Obstacle::SPHERE, {0.06, 0.02, 0.02}, {0, 0, 0}, 0.01, 0.5, {0, 0, 0}, 0});
    toucher.obstacles[0].place[2] = -0.005;
    for (int32_t n = 0; n < cube.body().num_nodes; n++) {
        const double speed[3] = {0.3, 0.02, -0.4};
        for (int d = 0; d < 3; d++) cube.data->tled->d[3 * n + d] = speed[d] * cube.data->tled->time_step;
    }
    double energy = cube.energy(), begun = energy, maximum = 0;
    for (int s = 0; s < 60; s++) {
        double before[3], after[3], force[3];
        cube.momentum(before);
        ASSERT_GE(toucher.step(cube.model, cube.data), 0) << pliant_last_error();
        cube.momentum(after);
        NodeContacts::force(cube.data, force);
        maximum = std::fmax(maximum, force[2]);
        for (int d = 0; d < 3; d++)
            EXPECT_NEAR(after[d] - before[d], force[d] * cube.scene.solver.step, 1e-4 * Cube::mass);
        const double now = cube.energy();
        EXPECT_LE(now, energy + 1e-3 * begun) << s;
        energy = now;
    }
    EXPECT_LT(energy, 0.85 * begun);
    EXPECT_GT(maximum, 0.1);
}

TEST(ContactTled, ThrownCubesGainNoEnergy)
{
    for (const Throw &with : all_throws(4, {10e3}))
        EXPECT_LT(energy_ratio(with), 1.001) << name_of(with) << ", throw " << with.seed;
}

// Waves of this tissue travel at 2 m/s, and the tool moves at up to 0.3 m/s.
TEST(ContactTled, SoftCubesThrownAtAMovingToolGainNoEnergy)
{
    for (const Throw &with : all_throws(17, {3e3}))
        if (with.target == Target::Tool)
            EXPECT_LT(energy_ratio(with), 1.001) << name_of(with) << ", throw " << with.seed;
}

// Impacts at a third of the speed of waves, and cubes that interlock.
TEST(ContactTled, CubesThrownAtEachOtherGainNoEnergy)
{
    const std::pair<double, unsigned> throws[] = {{3e3, 25}, {3e3, 50}, {3e3, 174}, {10e3, 94}, {10e3, 136}};
    for (const auto &one : throws) {
        const Throw with = {Target::Cube, 0, 0, 0, one.first, one.second};
        EXPECT_LT(energy_ratio(with), 1.001) << name_of(with) << ", throw " << with.seed;
    }
}

// A ball presses soft tissue at 0.5 m/s and leaves. Sub-steps are shorter from before the contact until the tissue has
// come to rest.
TEST(ContactTled, AFastToolShortensTheSubStepsForAWhile)
{
    const double h = 0.01, radius = 0.015;
    Body body(std::vector<int>{6, 6, 4}.data(), std::vector<double>{6 * h, 6 * h, 4 * h}.data(),
              {{3e3, 0.3, 1000, false}});
    body.fix_plane(0, 0, 1e-6, 0, 0, 1);
    body.cells(6, 6, 4, 1);
    body.scene.solver.kind = PLIANT_TLED;
    body.scene.solver.step = 0.01;
    ASSERT_EQ(body.build(), PLIANT_OK) << pliant_last_error();
    const int tool = body.add_ball(radius);
    const pliant_tled &tled = *body.data->tled;
    const double time_step = tled.time_step;
    const int32_t substeps = tled.substeps;
    bool touched = false;
    for (int s = 0; s < 400; s++) {
        const double tip[3] = {0.033, 0.031, 4 * h + radius - 0.003 + 0.5 * body.scene.solver.step * std::abs(s - 10)};
        const bool before = !touched;
        ASSERT_EQ(pliant_tool_set_pose(body.data, tool, tip, nullptr), PLIANT_OK);
        ASSERT_GE(pliant_step(body.model, body.data), 0) << pliant_last_error();
        touched = touched || body.data->statistics.contacts > 0;
        if (before && touched) EXPECT_GT(tled.halvings, 0) << s;
        EXPECT_EQ(tled.substeps, substeps << tled.halvings);
    }
    EXPECT_TRUE(touched);
    EXPECT_EQ(tled.halvings, 0);
    EXPECT_EQ(tled.time_step, time_step);
}

// A ball presses tissue and stands still. The tissue comes to rest at the default damping.
TEST(ContactTled, TissueUnderAHeldToolComesToRest)
{
    const double h = 0.01, radius = 0.015, depth = 0.006;
    Body body(std::vector<int>{6, 6, 4}.data(), std::vector<double>{6 * h, 6 * h, 4 * h}.data(),
              {{10e3, 0.3, 1000, false}});
    body.fix_plane(0, 0, 1e-6, 0, 0, 1);
    body.cells(6, 6, 4, 1);
    body.scene.solver.kind = PLIANT_TLED;
    body.scene.solver.step = 0.01;
    ASSERT_EQ(body.build(), PLIANT_OK) << pliant_last_error();
    const int tool = body.add_ball(radius);
    double sum = 0, squares = 0;
    const int first = 100, last = 400;
    for (int s = 0; s < last; s++) {
        const double tip[3] = {0.033, 0.031, 4 * h + radius - std::fmin(5e-4 * s - 1e-3, depth)};
        ASSERT_EQ(pliant_tool_set_pose(body.data, tool, tip, nullptr), PLIANT_OK);
        ASSERT_GE(pliant_step(body.model, body.data), 0) << pliant_last_error();
        double force[3];
        NodeContacts::force(body.data, force);
        sum += s < first ? 0 : force[2];
        squares += s < first ? 0 : force[2] * force[2];
    }
    const double mean = sum / (last - first), deviation = std::sqrt(squares / (last - first) - mean * mean);
    std::printf("force %.3f N, standard deviation %.3f N\n", -mean, deviation);
    EXPECT_LT(mean, -0.5);
    EXPECT_LT(deviation, -0.2 * mean);
}

// Dynamic relaxation under a plate converges to the analytic force of a bar. Without the plate the cube returns to
// rest.
TEST(ContactTled, RelaxesUnderAPlate)
{
    const double depth = 0.0002;
    Cube cube(0);
    cube.scene.tled.quasi_static = true;
    cube.scene.tled.relaxation_steps = 2000;
    cube.scene.solver.tolerance = 1e-5;
    cube.fix_plane(0, 0, 1e-4, 0, 0, 1);
    ASSERT_EQ(cube.build(), PLIANT_OK) << pliant_last_error();
    NodeContacts toucher(cube.data->body);
    toucher.obstacles.push_back({Obstacle::HALF_SPACE, {0, 0, Cube::edge}, {0, 0, -1}, 0, 0.2, {0, 0, 0}, 0});
    toucher.obstacles[0].move(0, 0, -depth);
    ASSERT_EQ(toucher.settle(cube.model, cube.data), PLIANT_OK);
    double force[3];
    NodeContacts::force(cube.data, force);
    EXPECT_NEAR(-force[2], young * Cube::edge * depth, 0.01 * young * Cube::edge * depth);
    EXPECT_LT(std::hypot(force[0], force[1]), 1e-3 * -force[2]);
    toucher.obstacles[0].move(0, 0, 2 * depth);
    ASSERT_EQ(toucher.settle(cube.model, cube.data), PLIANT_OK);
    EXPECT_EQ(cube.data->statistics.contacts, 0);
    for (int32_t i = 0; i < 3 * cube.body().num_nodes; i++)
        EXPECT_NEAR(cube.data->positions[i], cube.body().rest[i], 1e-5);
}

} // namespace
