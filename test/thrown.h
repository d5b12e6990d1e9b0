// Cubes of tissue in explicit dynamics without damping, thrown at obstacles or at each other, and their energy.
#ifndef PLIANT_TEST_THROWN_H
#define PLIANT_TEST_THROWN_H

#include "backend/explicit_statistics.h"
#include "fem/dynamics/tled.h"
#include "pipeline/body.h"

#include <fstream>
#include <random>
#include <string>

enum class Target { Ground, Plane, Box, Ball, Cube, Tool };

struct Throw {
    Target target;
    double friction, restitution, slope /* [rad] of ground and plane */, young;
    unsigned seed; // 0: straight down
    double safety = 0.9; // fraction of the stable sub-step
    double poisson = 0.3;
};

inline std::string name_of(const Throw &with)
{
    const char *targets[] = {"ground", "plane", "box", "ball", "cube", "moving tool"};
    char text[160];
    std::snprintf(text, sizeof text, "%s, friction %g, restitution %g, slope %g, %g Pa",
                  targets[static_cast<int>(with.target)], with.friction, with.restitution, with.slope, with.young);
    return text;
}

// A cube of 3 cm above its target, or two cubes without gravity.
struct ThrownCube : Body {
    static constexpr double h = 0.01;
    const Throw with;
    const double normal[3] = {-std::sin(with.slope), 0, std::cos(with.slope)}; // of ground and plane

    static int layers(const Throw &with) { return with.target == Target::Cube ? 7 : 3; }
    explicit ThrownCube(const Throw &thrown)
        : Body(std::vector<int>{3, 3, layers(thrown)}.data(),
               std::vector<double>{3 * h, 3 * h, layers(thrown) * h}.data(),
               {{thrown.young, thrown.poisson, 1000, false}, {1, 0.3, 1, true}},
               [](int, int, int k) { return k == 3; }),
          with(thrown)
    {
        cells(3, 3, layers(with), 1);
        scene.solver.kind = PLIANT_TLED;
        scene.solver.threads = 1;
        scene.solver.step = 0.01;
        scene.tled.damping = 0;
        scene.tled.safety = with.safety;
        scene.contact.friction = scene.ground.friction = with.friction;
        scene.ground.restitution = with.restitution;
        scene.warp.margin = 10;
        scene.ground.normal[2] = 1;
        scene.ground.point[2] = -5;
        scene.model.gravity[2] = with.target == Target::Cube ? 0 : -9.81;
        add_target();
        EXPECT_EQ(build(), PLIANT_OK) << pliant_last_error();
        start();
        if (with.target == Target::Tool) tool = add_ball(h);
        move_tool(0);
    }
    // Make a step. Return the work of the tool on the tissue [J].
    double step(int number)
    {
        pliant_dynamics dynamics;
        move_tool(number);
        EXPECT_GE(pliant_step(model, data), 0) << pliant_last_error();
        EXPECT_EQ(pliant_data_get_dynamics(model, data, &dynamics), PLIANT_OK);
        return dynamics.tool_work;
    }
    // Return the sum of kinetic, elastic and gravity energy, half a sub-step earlier [J].
    double energy() const
    {
        pliant_dynamics dynamics;
        EXPECT_EQ(pliant_data_get_dynamics(model, data, &dynamics), PLIANT_OK);
        double sum = dynamics.kept_energy;
        for (int32_t i = 0; i < 3 * data->body->fine.num_nodes; i++)
            sum -= data->body->node_mass[i / 3] * data->gravity[i % 3] *
                   (data->body->fine.rest[i] + data->tled->u[i] - 0.5 * data->tled->d[i]);
        return sum;
    }

private:
    int tool = -1;

    // A ball below the cube moves up and down and to the side, at up to 0.3 m/s.
    void move_tool(int step)
    {
        if (with.target != Target::Tool) return;
        const double time = scene.solver.step * step, speed = 0.3, rate = 25,
                     tip[3] = {0.014 + 0.3 * speed / rate * std::sin(0.7 * rate * time),
                               0.016 + 0.3 * speed / rate * std::sin(0.4 * rate * time),
                               -0.01 - speed / rate + speed / rate * (1 - std::cos(rate * time))};
        ASSERT_EQ(pliant_tool_set_pose(data, tool, tip, nullptr), PLIANT_OK);
    }
    void add_target()
    {
        if (with.target == Target::Ground) {
            std::copy(normal, normal + 3, scene.ground.normal);
            scene.ground.point[2] = 0;
        }
        if (with.target == Target::Plane) {
            pliant_fixed_plane &plane = scene.obstacles.planes[scene.obstacles.num_planes++];
            std::copy(normal, normal + 3, plane.normal);
        }
        if (with.target == Target::Box)
            scene.obstacles.boxes[scene.obstacles.num_boxes++] = {{0.004, 0.004, -0.05}, {0.021, 0.022, 0}};
        if (with.target == Target::Ball) {
            const std::string file = ::testing::TempDir() + "thrown_ball.yaml";
            std::ofstream(file) << "parts: [{kind: sphere, from: [0.014, 0.016, -0.01], radius: 0.01}]\n";
            std::snprintf(scene.contact.obstacles, sizeof scene.contact.obstacles, "%s", file.c_str());
        }
        scene.contact.self = with.target == Target::Cube;
    }
    bool is_upper(int32_t node) const
    {
        return with.target == Target::Cube && data->body->fine.rest[3 * node + 2] > 3.5 * h;
    }
    // Turn and move a cube as a rigid body, and set its velocity.
    void place(bool upper, const double turn[3], const double shift[3], const double speed[3], const double spin[3])
    {
        const double angle = std::sqrt(turn[0] * turn[0] + turn[1] * turn[1] + turn[2] * turn[2]),
                     middle[3] = {1.5 * h, 1.5 * h, (upper ? 5.5 : 1.5) * h};
        for (int32_t n = 0; n < data->body->fine.num_nodes; n++) {
            double arm[3], axis[3], r[3], along = 0;
            if (is_upper(n) != upper) continue;
            for (int d = 0; d < 3; d++) {
                arm[d] = data->body->fine.rest[3 * n + d] - middle[d];
                axis[d] = angle > 0 ? turn[d] / angle : 0;
                along += axis[d] * arm[d];
            }
            for (int d = 0; d < 3; d++) { // Rodrigues
                const int a = (d + 1) % 3, b = (d + 2) % 3;
                r[d] = arm[d] * std::cos(angle) + (axis[a] * arm[b] - axis[b] * arm[a]) * std::sin(angle) +
                       axis[d] * along * (1 - std::cos(angle));
            }
            for (int d = 0; d < 3; d++) {
                const int a = (d + 1) % 3, b = (d + 2) % 3;
                data->positions[3 * n + d] = middle[d] + r[d] + shift[d];
                data->tled->u[3 * n + d] = data->positions[3 * n + d] - data->body->fine.rest[3 * n + d];
                data->tled->d[3 * n + d] = data->tled->time_step * (speed[d] + spin[a] * r[b] - spin[b] * r[a]);
            }
        }
    }
    double lowest() const
    {
        double out = INFINITY;
        for (int32_t n = 0; n < data->body->fine.num_nodes; n++) {
            const double *x = data->positions + 3 * n;
            out = std::fmin(out, normal[0] * x[0] + normal[1] * x[1] + normal[2] * x[2]);
        }
        return out;
    }
    void start()
    {
        std::mt19937 random(with.seed + 1);
        std::uniform_real_distribution<double> any(-1, 1);
        const auto draw = [&](double size, double out[3]) {
            for (int d = 0; d < 3; d++) out[d] = with.seed == 0 ? 0 : size * any(random);
        };
        const bool two = with.target == Target::Cube;
        for (int upper = 0; upper < (two ? 2 : 1); upper++) {
            double turn[3], shift[3], speed[3], spin[3];
            draw(1.5, turn);
            draw(0.5 * h, shift);
            draw(0.2, speed);
            draw(6, spin);
            speed[2] += upper ? -0.3 : two ? 0.3 : -0.4;
            shift[2] += upper ? 2 * h : 0;
            place(upper, turn, shift, speed, spin);
            if (two) continue;
            const double gap = 0.005 - lowest();
            for (int d = 0; d < 3; d++) shift[d] += gap * normal[d];
            place(upper, turn, shift, speed, spin);
        }
    }
};

// Run 40 steps. Return the maximum energy without the work of the tool, divided by the initial energy.
inline double energy_ratio(const Throw &with)
{
    ThrownCube cube(with);
    const double first = cube.energy();
    double maximum = 1, work = 0;
    for (int s = 0; s < 40; s++) {
        work += cube.step(s + 1);
        maximum = std::fmax(maximum, (cube.energy() - work) / first);
    }
    return maximum;
}

// Return all kinds of throws, with this many seeds for each.
inline std::vector<Throw> all_throws(unsigned seeds, const std::vector<double> &young)
{
    std::vector<Throw> out;
    for (const double modulus : young)
        for (const Target target :
             {Target::Ground, Target::Plane, Target::Box, Target::Ball, Target::Cube, Target::Tool})
            for (const double slope : {0.0, 0.4})
                for (const double friction : {0.0, 0.3})
                    for (const double restitution : {0.0, 0.5})
                        for (unsigned seed = 0; seed < seeds; seed++) {
                            const bool flat = target != Target::Ground && target != Target::Plane;
                            if ((flat && slope > 0) || (target != Target::Ground && restitution > 0)) continue;
                            out.push_back({target, friction, restitution, slope, modulus, seed});
                        }
    return out;
}

#endif
