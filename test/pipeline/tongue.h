// Jaws and the tissue that they grip.
#ifndef PLIANT_TEST_TONGUE_H
#define PLIANT_TEST_TONGUE_H

#include "body.h"
#include "contact/shapes/shapes.h"
#include "sim/step/proxy.h"

#include <algorithm>

// A tongue of 30 x 6 x 24 mm on a plate, and prograsp forceps above it that come straight down.
struct Tongue : Body {
    int tool = -1;
    static constexpr int size[3] = {10, 4, 12};
    static constexpr double box[3] = {0.03, 0.006, 0.024}, deep = 0.012; // depth of the tip below the top

    // also: further settings of the scene
    explicit Tongue(
        double friction, const std::function<void(pliant_scene &)> &also = [](pliant_scene &) {})
        : Body(size, box, {{5000, 0.4, 1000, false}})
    {
        cells(10, 3, 8, 1);
        fix_plane(0, 0, 1e-4, 0, 0, 1);
        scene.solver.threads = 1;
        scene.solver.iterations = 30;
        scene.solver.tolerance = 1e-3;
        scene.contact.friction = friction;
        also(scene);
        EXPECT_EQ(build(), PLIANT_OK) << pliant_last_error();
        pliant_tool_shape shape;
        EXPECT_EQ(pliant_tool_shape_find("prograsp_forceps", &shape), PLIANT_OK);
        EXPECT_EQ(pliant_tool_add(model, data, "prograsp", &tool), PLIANT_OK);
        EXPECT_EQ(pliant_tool_set_shape(data, tool, &shape), PLIANT_OK);
    }
    // Move the tip to a height above the grip position.
    void go(double up, double jaw)
    {
        const double tip[3] = {0.0151, 0.0031, box[2] - deep + up}, down[4] = {1, 0, 0, 0};
        ASSERT_EQ(pliant_tool_set_pose(data, tool, tip, down), PLIANT_OK);
        ASSERT_EQ(pliant_tool_set_jaw(data, tool, jaw), PLIANT_OK);
        ASSERT_GE(pliant_step(model, data), 0) << pliant_last_error();
        for (int32_t n = 0; n < 3 * data->body->fine.num_nodes; n++) ASSERT_TRUE(std::isfinite(data->positions[n]));
    }
    // Return the minimum ratio of an element's volume to its rest volume.
    double min_volume() const
    {
        const pliant_mesh &mesh = data->body->fine;
        double minimum = INFINITY;
        for (int32_t t = 0; t < mesh.num_tets; t++) {
            double volume[2];
            for (int k = 0; k < 2; k++) {
                const double *x = k ? data->positions : mesh.rest;
                double e[3][3];
                for (int v = 0; v < 3; v++)
                    for (int d = 0; d < 3; d++)
                        e[v][d] = x[3 * mesh.tets[4 * t + v + 1] + d] - x[3 * mesh.tets[4 * t] + d];
                volume[k] = e[0][0] * (e[1][1] * e[2][2] - e[1][2] * e[2][1]) +
                            e[0][1] * (e[1][2] * e[2][0] - e[1][0] * e[2][2]) +
                            e[0][2] * (e[1][0] * e[2][1] - e[1][1] * e[2][0]);
            }
            minimum = std::fmin(minimum, volume[1] / volume[0]);
        }
        return minimum;
    }
    // Return the maximum upward displacement of a node.
    double lifted() const
    {
        double maximum = -1;
        for (int32_t n = 0; n < data->body->fine.num_nodes; n++)
            maximum = std::fmax(maximum, data->positions[3 * n + 2] - data->body->fine.rest[3 * n + 2]);
        return maximum;
    }
    double farthest() const
    {
        double maximum = 0;
        for (int32_t n = 0; n < 3 * data->body->fine.num_nodes; n++)
            maximum = std::fmax(maximum, std::fabs(data->positions[n] - data->body->fine.rest[n]));
        return maximum;
    }
    double force() const
    {
        pliant_tool_state state;
        EXPECT_EQ(pliant_tool_get(data, tool, &state), PLIANT_OK);
        return state.contact_force[2];
    }
    // Return the maximum penetration depth of a node in a part of the tool.
    double deepest() const
    {
        const pliant_tool &of = data->tools[tool];
        const pliant_tool_pose proxy = pliant_tool_proxy(&of);
        double minimum = 0;
        for (int32_t p = 0; p < of.shape.num_parts; p++) {
            pliant_pose pose;
            pliant_part_pose(&of.shape, of.shape.part[p].frame, proxy.tip, proxy.rotation, proxy.jaw, &pose);
            for (int32_t n = 0; n < data->body->fine.num_nodes; n++) {
                double local[3], normal[3];
                pliant_pose_from(&pose, data->positions + 3 * n, local);
                minimum = std::fmin(minimum, pliant_part_distance(&of.shape.part[p], local, normal));
            }
        }
        return -minimum;
    }
};
constexpr int Tongue::size[3];
constexpr double Tongue::box[3], Tongue::deep;

// Jaws close on tissue with a small grip torque, and lift it. They stop where the tissue resists with this torque.
// @param above, near bounds of the largest and of the last torque, relative to the limit
inline void close_with_grip_torque(bool is_dynamic, double above, double near,
                                   pliant_backend_choice backend = PLIANT_CPU)
{
    const double limit = 0.004; // [N m]
    Tongue tongue(0.5, [&](pliant_scene &scene) {
        scene.contact.grip_torque = limit;
        scene.solver.backend = backend;
        if (is_dynamic) scene.solver.kind = PLIANT_TLED;
        if (is_dynamic) scene.tled.damping = 20;
    });
    double largest = 0, last = 0;
    int saturated = 0;
    tongue.go(0.03, 0.7);
    for (int s = 0; s < 4; s++) tongue.go(0.0225 - 0.0075 * s, 0.7);
    for (int s = 1; s <= 14; s++) {
        tongue.go(s > 10 ? 0.0002 * (s - 10) : 0, std::fmax(0.7 - 0.1 * s, -0.1));
        const pliant_tool_pose proxy = pliant_tool_proxy(tongue.data->tools + tongue.tool);
        pliant_proxy_load load;
        pliant_proxy_find_load(tongue.data, tongue.tool, &proxy, &load);
        last = std::fabs(load.jaw);
        largest = std::fmax(largest, last);
        saturated += tongue.data->tools[tongue.tool].proxy.saturated;
        EXPECT_GT(tongue.min_volume(), 0) << "step " << s;
    }
    std::printf("%s: largest torque / limit %.4f, last %.4f, %d steps at the limit\n",
                is_dynamic ? "explicit" : "quasi-static", largest / limit, last / limit, saturated);
    EXPECT_STREQ(pliant_data_get_backend(tongue.data), backend == PLIANT_CUDA ? "cuda" : "cpu") << pliant_last_error();
    EXPECT_LT(largest, (1 + above) * limit);
    EXPECT_NEAR(last, limit, near * limit);
    EXPECT_GT(saturated, 4);
}

#endif
