// A detached piece against closed forms of a rigid body: slopes, a carried weight, a pendulum.
#include "fem/rigid/rigid_pieces_data.h"
#include "hanging_bar.h"

#include <cstdio>

namespace {

double weight_of(const Body &body, const std::vector<int32_t> &nodes)
{
    double weight = 0;
    for (int32_t n : nodes) weight += g * body.data->body->node_mass[n];
    return weight;
}

// A piece that lies on a plane at z = -0.002. obstacle: the plane is an obstacle; otherwise it is the ground.
struct PieceOnPlane {
    std::unique_ptr<Body> body;
    std::vector<int32_t> nodes;

    PieceOnPlane(bool obstacle, double friction)
    {
        body = hang(direct, obstacle ? 1 : -0.002, friction);
        body->scene.contact.friction = friction;
        body->scene.warp.margin = 10;
        if (obstacle) body->scene.obstacles.planes[body->scene.obstacles.num_planes++] = {{0, 0, -0.002}, {0, 0, 1}};
        EXPECT_EQ(body->build(), PLIANT_OK) << pliant_last_error();
        cut(*body, 0.03);
        nodes = nodes_below(*body->data->body, 0.03);
        step(*body, 60);
    }
    void tilt(double angle) const
    {
        const double gravity[3] = {g * std::sin(angle), 0, -g * std::cos(angle)};
        ASSERT_EQ(pliant_data_set_gravity(body->data, gravity), PLIANT_OK);
    }
    double along() const { return centre_of(*body, nodes)[0]; }
};

// v = g (sin - mu cos) t and x = v t / 2
TEST(PieceTheory, APieceSlidesDownASlopeByCoulombsLaw)
{
    const double friction = 0.2, angle = M_PI / 6, faster = g * (std::sin(angle) - friction * std::cos(angle));
    for (bool obstacle : {false, true}) {
        PieceOnPlane lying(obstacle, friction);
        const double start = lying.along(), h = lying.body->scene.solver.step;
        lying.tilt(angle);
        const int steps = 100;
        double before = start, now = start;
        for (int s = 0; s < steps; s++) {
            step(*lying.body, 1);
            before = now;
            now = lying.along();
        }
        const double time = steps * h, speed = (now - before) / h;
        std::printf("%s: speed %.4f of %.4f m/s, way %.4f of %.4f m, velocity %.4f\n", obstacle ? "obstacle" : "ground",
                    speed, faster * (time - h / 2), now - start, faster * time * time / 2,
                    lying.body->data->rigid_pieces->pieces[0].velocity[0]);
        EXPECT_NEAR(speed, faster * (time - h / 2), 0.01 * faster * time);
        EXPECT_NEAR(now - start, faster * time * time / 2, 0.01 * faster * time * time / 2);
    }
}

TEST(PieceTheory, APieceAtRestStays)
{
    for (bool obstacle : {false, true})
        for (double slope : {0.0, 0.9}) {
            const double friction = 0.3;
            PieceOnPlane lying(obstacle, friction);
            lying.tilt(std::atan(slope * friction));
            step(*lying.body, 50);
            const std::vector<double> before(lying.body->data->positions,
                                             lying.body->data->positions + 3 * lying.body->data->body->fine.num_nodes);
            step(*lying.body, 500);
            double moved = 0;
            for (int32_t n : lying.nodes)
                for (int d = 0; d < 3; d++)
                    moved = std::fmax(moved, std::fabs(lying.body->data->positions[3 * n + d] - before[3 * n + d]));
            std::printf("%s, slope %g: moved %g m in 5 s\n", obstacle ? "obstacle" : "ground", slope, moved);
            EXPECT_LT(moved, 1e-6);
        }
}

// A piece that a tool grasps.
// lead(time): distance of the tool from the grasp position
struct Carried {
    std::unique_ptr<Body> body;
    std::vector<int32_t> nodes;
    int tool = -1;
    double from[3], time = 0;

    explicit Carried(double stiffness)
    {
        body = hang(direct);
        body->scene.warp.margin = 10;
        EXPECT_EQ(body->build(), PLIANT_OK) << pliant_last_error();
        const double at[3] = {0.02, 0.02, 0.065};
        EXPECT_EQ(pliant_tool_add(body->model, body->data, "tool", &tool), PLIANT_OK);
        EXPECT_EQ(pliant_tool_grasp(body->model, body->data, tool, at), PLIANT_OK) << pliant_last_error();
        if (stiffness > 0) body->data->tools[0].stiffness = stiffness;
        else EXPECT_EQ(pliant_tool_set_drive(body->data, tool, PLIANT_DRIVE_RIGID, nullptr), PLIANT_OK);
        cut(*body, 0.08);
        nodes = nodes_below(*body->data->body, 0.08);
        for (int d = 0; d < 3; d++) from[d] = body->data->tools[0].tip[d];
    }
    void go(double x, double z)
    {
        const double tip[3] = {from[0] + x, from[1], from[2] + z};
        ASSERT_EQ(pliant_tool_set_pose(body->data, tool, tip, nullptr), PLIANT_OK);
        step(*body, 1);
        time += body->scene.solver.step;
    }
    const double *force() const { return body->data->tools[0].force; }
};

TEST(PieceTheory, AToolFeelsTheWeightAndTheInertiaOfWhatItCarries)
{
    for (double stiffness : {0.0, 1e3, 1e9}) {
        Carried carried(stiffness);
        const double weight = weight_of(*carried.body, carried.nodes), h = carried.body->scene.solver.step;
        double z = 0, mean[3] = {0, 0, 0};
        for (int s = 0; s < 100; s++) carried.go(0, 0);
        for (int s = 1; s <= 100; s++) carried.go(0, z = 0.2 * s * h);
        for (int s = 1; s <= 100; s++) {
            carried.go(0, z += 0.2 * h);
            for (int d = 0; d < 3; d++) mean[d] += carried.force()[d] / 100;
        }
        std::printf("stiffness %g: constant speed: force %.6f %.6f %.6f of weight %.6f\n", stiffness, mean[0], mean[1],
                    mean[2], weight);
        EXPECT_NEAR(mean[2], weight, 1e-3 * weight);
        const double a = 2, from = z;
        for (int d = 0; d < 3; d++) mean[d] = 0;
        for (int s = 1; s <= 100; s++) {
            const double t = s * h;
            carried.go(0, z = from + 0.2 * t + a * t * t / 2);
            if (s > 50)
                for (int d = 0; d < 3; d++) mean[d] += carried.force()[d] / 50;
        }
        std::printf("stiffness %g: acceleration: force %.6f %.6f %.6f of %.6f\n", stiffness, mean[0], mean[1], mean[2],
                    weight * (1 + a / g));
        EXPECT_NEAR(mean[2], weight * (1 + a / g), 1e-3 * weight);
    }
}

TEST(PieceTheory, APendulumKeepsItsEnergy)
{
    for (double stiffness : {0.0, 1e9, 1e3}) {
        Carried carried(stiffness);
        for (int s = 0; s < 50; s++) carried.go(0, 0);
        pliant_rigid piece;
        const auto energy = [&] {
            pliant_rigid_pieces_body(carried.body->data->rigid_pieces, 0, &piece);
            double spin[3], sum = 0;
            pliant_rigid_spin(&piece, spin);
            for (int d = 0; d < 3; d++)
                sum += 0.5 * piece.mass * piece.velocity[d] * piece.velocity[d] + 0.5 * spin[d] * piece.momentum[d];
            return sum + piece.mass * g * piece.centre[2];
        };
        const double lowest = energy();
        const double gravity[3] = {g, 0, -g}, down[3] = {0, 0, -g};
        ASSERT_EQ(pliant_data_set_gravity(carried.body->data, gravity), PLIANT_OK);
        for (int s = 0; s < 15; s++) carried.go(0, 0);
        ASSERT_EQ(pliant_data_set_gravity(carried.body->data, down), PLIANT_OK);
        carried.go(0, 0);
        const double first = energy() - lowest;
        double low = INFINITY, high = 0;
        for (int s = 0; s < 400; s++) {
            carried.go(0, 0);
            low = std::fmin(low, (energy() - lowest) / first);
            high = std::fmax(high, (energy() - lowest) / first);
        }
        std::printf("stiffness %g: energy of 10 swings over the first: %.4f to %.4f\n", stiffness, low, high);
        EXPECT_GT(low, stiffness == 1e3 ? 0.75 : 0.97); // implicit Euler damps the soft spring itself
        EXPECT_LT(high, 1.02);
    }
}

// A plate presses a piece on the ground, next to the tissue from which it was cut. The footprint of the piece is 4 cm x
// 4 cm. The areas of its contact points on the ground sum to this footprint.
TEST(PieceTheory, AreasOfContactPointsAddUpToTheFootprint)
{
    const double footprint = 0.04 * 0.04;
    PieceOnPlane lying(false, 0.3);
    Body &body = *lying.body;
    std::vector<double> aside(body.data->positions, body.data->positions + 3 * body.data->body->fine.num_nodes);
    for (int32_t node : lying.nodes) aside[3 * static_cast<size_t>(node)] += 0.1;
    ASSERT_EQ(pliant_data_set_positions(body.model, body.data, aside.data()), PLIANT_OK);
    pliant_tool_shape shape{};
    int tool;
    shape.num_parts = 1;
    shape.part[0] = {PLIANT_PART_BOX, PLIANT_FRAME_TIP, {-0.03, -0.03, 0}, {0.03, 0.03, 0.01}, 0, false, nullptr};
    ASSERT_EQ(pliant_tool_add(body.model, body.data, "plate", &tool), PLIANT_OK);
    ASSERT_EQ(pliant_tool_set_shape(body.data, tool, &shape), PLIANT_OK) << pliant_last_error();
    for (int s = 0; s < 30; s++) {
        const double tip[3] = {0.12, 0.02, 0.0281 - 2e-5 * s};
        ASSERT_EQ(pliant_tool_set_pose(body.data, tool, tip, nullptr), PLIANT_OK);
        step(body, 1);
    }
    std::vector<pliant_contact> points(static_cast<size_t>(pliant_data_get_contacts(body.data, 0, nullptr)));
    pliant_data_get_contacts(body.data, static_cast<int32_t>(points.size()), points.data());
    double area = 0;
    for (const pliant_contact &point : points) area += point.tool < 0 ? point.area : 0;
    EXPECT_NEAR(area, footprint, 0.01 * footprint);
}

// Two plates squeeze a piece and lift it: friction holds it, and it does not creep.
TEST(PieceTheory, APieceThatPlatesSqueezeStaysBetweenThem)
{
    for (bool obstacle : {false, true}) {
        PieceOnPlane lying(obstacle, 0.5);
        Body &body = *lying.body;
        const std::vector<double> centre = centre_of(body, lying.nodes);
        int tool[2];
        for (int side = 0; side < 2; side++) {
            pliant_tool_shape shape{};
            shape.num_parts = 1;
            shape.part[0] = {PLIANT_PART_BOX,
                             PLIANT_FRAME_TIP,
                             {side ? 0.0 : -0.01, -0.015, -0.008},
                             {side ? 0.01 : 0.0, 0.015, 0.008},
                             0,
                             false,
                             nullptr};
            ASSERT_EQ(pliant_tool_add(body.model, body.data, side ? "right" : "left", tool + side), PLIANT_OK);
            ASSERT_EQ(pliant_tool_set_shape(body.data, tool[side], &shape), PLIANT_OK) << pliant_last_error();
        }
        const auto place = [&](double apart, double high) {
            for (int side = 0; side < 2; side++) {
                const double tip[3] = {centre[0] + (side ? 1 : -1) * (0.02 + apart), centre[1], centre[2] + high};
                ASSERT_EQ(pliant_tool_set_pose(body.data, tool[side], tip, nullptr), PLIANT_OK);
            }
            step(body, 1);
        };
        for (int s = 0; s < 20; s++) place(0.002 - 0.000225 * s, 0);
        for (int s = 0; s < 100; s++) place(-0.0025, 0.00008 * s); // up to the tissue from which it was cut
        for (int s = 0; s < 50; s++) place(-0.0025, 0.008);
        const std::vector<double> before = centre_of(body, lying.nodes);
        for (int s = 0; s < 300; s++) place(-0.0025, 0.008);
        const std::vector<double> after = centre_of(body, lying.nodes);
        std::printf("lifted by %g mm, moved by %g %g %g mm in 3 s, speed %g\n", 1e3 * (after[2] - centre[2]),
                    1e3 * (after[0] - before[0]), 1e3 * (after[1] - before[1]), 1e3 * (after[2] - before[2]),
                    body.data->rigid_pieces->pieces[0].velocity[2]);
        EXPECT_NEAR(after[2] - centre[2], 0.008, 1e-3);
        for (int d = 0; d < 3; d++) EXPECT_NEAR(after[d], before[d], 1e-5);
    }
}

} // namespace
