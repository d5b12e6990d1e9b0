// A sheet of tissue, and tools.
#ifndef PLIANT_TEST_SHEET_H
#define PLIANT_TEST_SHEET_H

#include "body.h"
#include "contact/shapes/shapes.h"
#include "base/vector3.h"
#include "contact/advance/advance.h"
#include "sim/step/proxy.h"

#include <algorithm>

// A sheet of 60 x 60 x 4 mm at z = 0 to 4 mm, fixed at two sides.
struct Sheet : Body {
    // also: further settings of the scene
    explicit Sheet(
        int threads = 2, double friction = 0.08, double budget_ms = 0, pliant_element_kind element = PLIANT_LINEAR,
        bool dynamic = false, const std::function<void(pliant_scene &)> &also = [](pliant_scene &) {})
        : Body(size, box, {{4000, 0.4, 1000, false}})
    {
        fix_plane(0.001, 0, 0, 1, 0, 0);
        fix_plane(0.059, 0, 0, -1, 0, 0);
        cells(6, 6, 1, 1);
        scene.solver.threads = threads;
        scene.solver.iterations = 30;
        scene.solver.tolerance = 1e-4;
        scene.solver.budget_ms = budget_ms;
        scene.contact.friction = friction;
        scene.element.kind = element;
        if (dynamic) scene.solver.kind = PLIANT_TLED;
        also(scene);
        EXPECT_EQ(build(), PLIANT_OK) << pliant_last_error();
    }
    int add(const char *name, const pliant_tool_shape &shape, double x, double y, double z)
    {
        int tool = -1;
        const double tip[3] = {x, y, z};
        EXPECT_EQ(pliant_tool_add(model, data, name, &tool), PLIANT_OK);
        EXPECT_EQ(pliant_tool_set_shape(data, tool, &shape), PLIANT_OK) << pliant_last_error();
        EXPECT_EQ(pliant_tool_set_pose(data, tool, tip, nullptr), PLIANT_OK);
        return tool;
    }
    void move(int tool, double x, double y, double z, const double *rotation = nullptr)
    {
        const double tip[3] = {x, y, z};
        ASSERT_EQ(pliant_tool_set_pose(data, tool, tip, rotation), PLIANT_OK);
    }
    // Return the maximum displacement of a node that belongs to no piece; NAN if a position is invalid.
    double farthest() const
    {
        double maximum = 0;
        const pliant_mesh &fine = data->body->fine;
        std::vector<char> off(static_cast<size_t>(fine.num_nodes));
        for (int32_t i = 0; data->body->pieces && i < data->body->pieces->start[data->body->pieces->count]; i++)
            off[data->body->pieces->node[i]] = 1;
        for (int32_t n = 0; n < 3 * fine.num_nodes; n++) {
            if (off[n / 3]) continue;
            if (!std::isfinite(data->positions[n])) return NAN;
            maximum = std::fmax(maximum, std::fabs(data->positions[n] - fine.rest[n]));
        }
        return maximum;
    }
    // Return the maximum penetration depth of a node in a tool.
    double deepest(int index) const
    {
        const pliant_tool &tool = data->tools[index];
        double minimum = 0;
        for (int32_t p = 0; p < tool.shape.num_parts; p++) {
            pliant_pose pose;
            pliant_part_pose(&tool.shape, tool.shape.part[p].frame, tool.proxy.tip, tool.proxy.rotation, tool.proxy.jaw,
                             &pose);
            for (int32_t n = 0; n < model->body->fine.num_nodes; n++) {
                double local[3], normal[3];
                pliant_pose_from(&pose, data->positions + 3 * n, local);
                minimum = std::fmin(minimum, pliant_part_distance(&tool.shape.part[p], local, normal));
            }
        }
        return -minimum;
    }

    // Return the same for the surface triangles.
    double max_surface_penetration(int index) const
    {
        enum { PARTS = 16 };
        const pliant_tool &tool = data->tools[index];
        const pliant_body *body = data->body;
        double minimum = 0;
        pliant_pose pose;
        pliant_part_pose(&tool.shape, PLIANT_FRAME_TIP, tool.proxy.tip, tool.proxy.rotation, 0, &pose);
        for (int32_t t = 0; t < body->num_triangles; t++)
            for (int i = 0; i <= PARTS; i++)
                for (int j = 0; i + j <= PARTS; j++) {
                    const int weight[3] = {i, j, PARTS - i - j};
                    double at[3] = {0, 0, 0}, local[3], normal[3];
                    for (int c = 0; c < 9; c++)
                        at[c % 3] +=
                            weight[c / 3] * data->positions[3 * body->triangles[3 * t + c / 3] + c % 3] / PARTS;
                    pliant_pose_from(&pose, at, local);
                    minimum = std::fmin(minimum, pliant_part_distance(&tool.shape.part[0], local, normal));
                }
        return -minimum;
    }
    // Return the number of inverted elements.
    int turned() const
    {
        int count = 0;
        for (int32_t t = 0; t < data->body->fine.num_tets; t++) {
            double edge[3][3], volume = 0;
            const int32_t *node = data->body->fine.tets + 4 * t;
            for (int v = 0; v < 3; v++)
                for (int d = 0; d < 3; d++)
                    edge[v][d] = data->positions[3 * node[v + 1] + d] - data->positions[3 * node[0] + d];
            for (int d = 0; d < 3; d++)
                volume += edge[0][d] *
                          (edge[1][(d + 1) % 3] * edge[2][(d + 2) % 3] - edge[1][(d + 2) % 3] * edge[2][(d + 1) % 3]);
            count += volume <= 0;
        }
        return count;
    }
    // Return whether a tool at this pose would intersect one of the two fixed sides.
    bool intersects_fixed_side(int index, const double tip[3], const double rotation[4]) const
    {
        const pliant_tool &tool = data->tools[index];
        const pliant_body *body = data->body;
        pliant_pose pose;
        pliant_part_pose(&tool.shape, PLIANT_FRAME_TIP, tip, rotation, 0, &pose);
        for (int32_t t = 0; t < body->num_triangles; t++) {
            const int32_t *node = body->triangles + 3 * t;
            double corner[3][3], weight[3], normal[3];
            if (!body->fine_fixed[node[0]] || !body->fine_fixed[node[1]] || !body->fine_fixed[node[2]]) continue;
            for (int v = 0; v < 3; v++) pliant_pose_from(&pose, body->fine.rest + 3 * node[v], corner[v]);
            if (pliant_face_minimum(&tool.shape.part[0], corner, 0, weight, normal) < 0) return true;
        }
        return false;
    }
    // Return the number of points along the axis of a tool's only part, in its core, that lie in tissue.
    int count_axis_points_inside(int index) const
    {
        enum { POINTS = 200 };
        const pliant_tool &tool = data->tools[index];
        const pliant_part &part = tool.shape.part[0];
        const pliant_mesh &fine = data->body->fine;
        pliant_pose pose;
        pliant_part_pose(&tool.shape, PLIANT_FRAME_TIP, tool.proxy.tip, tool.proxy.rotation, 0, &pose);
        const double *cell = fine.cell_size, // the error of a distance field enlarges the guard
            guard = 2 * pliant_advance_guard(&model->contact, &part, std::min({cell[0], cell[1], cell[2]}));
        int inside = 0;
        for (int p = 0; p <= POINTS; p++) {
            double local[3], at[3], normal[3];
            for (int d = 0; d < 3; d++) {
                const bool solid = part.kind == PLIANT_PART_SOLID, box = part.kind == PLIANT_PART_BOX;
                const double from = box && d < 2 ? 0.5 * (part.from[d] + part.to[d]) : part.from[d],
                             to = box && d < 2 ? from
                                  : solid      ? (d == 2 ? 0.02 : 0)
                                               : part.to[d];
                local[d] = from + (to - from) * p / POINTS;
            }
            if (pliant_part_distance(&part, local, normal) > -guard) continue;
            pliant_pose_to(&pose, local, at);
            for (int32_t t = 0; t < fine.num_tets; t++) {
                const int32_t *node = fine.tets + 4 * t;
                double edge[3][3], to[3];
                for (int d = 0; d < 3; d++) {
                    for (int v = 0; v < 3; v++)
                        edge[v][d] = data->positions[3 * node[v + 1] + d] - data->positions[3 * node[0] + d];
                    to[d] = at[d] - data->positions[3 * node[0] + d];
                }
                const auto triple = [](const double *a, const double *b, const double *c) {
                    return a[0] * (b[1] * c[2] - b[2] * c[1]) + a[1] * (b[2] * c[0] - b[0] * c[2]) +
                           a[2] * (b[0] * c[1] - b[1] * c[0]);
                };
                const double whole = triple(edge[0], edge[1], edge[2]), a = triple(to, edge[1], edge[2]) / whole,
                             b = triple(edge[0], to, edge[2]) / whole, c = triple(edge[0], edge[1], to) / whole;
                if (whole > 0 && a > 0 && b > 0 && c > 0 && a + b + c < 1) {
                    inside++;
                    break;
                }
            }
        }
        return inside;
    }

private:
    static constexpr int size[3] = {12, 12, 2};
    static constexpr double box[3] = {0.06, 0.06, 0.004};
};
constexpr int Sheet::size[3];
constexpr double Sheet::box[3];

// Return a rod along y, across the sheet.
inline pliant_tool_shape rod(double radius, double length = 0.1)
{
    pliant_tool_shape shape{};
    shape.num_parts = 1;
    shape.part[0] = {PLIANT_PART_CAPSULE, PLIANT_FRAME_TIP, {0, -0.5 * length, 0}, {0, 0.5 * length, 0}, radius, false};
    return shape;
}

inline pliant_tool_shape ball(double radius)
{
    pliant_tool_shape shape{};
    shape.num_parts = 1;
    shape.part[0] = {PLIANT_PART_SPHERE, PLIANT_FRAME_TIP, {0, 0, 0}, {0, 0, 0}, radius, false};
    return shape;
}

// Force on a ball or plate whose target presses 15 times farther than its force limit permits.
struct PressedBeyondLimit { double largest = 0, mean = 0, behind = 0; }; // relative to the limit; proxy error [m]
struct PressedWith { const char *name; bool is_dynamic, is_patched, is_wide; };
inline PressedBeyondLimit press_beyond_limit(const PressedWith &with, pliant_backend_choice backend = PLIANT_CPU)
{
    const double limit = 0.05; // [N]
    PressedBeyondLimit out;
    Sheet sheet(1, 0.08, 0, PLIANT_LINEAR, with.is_dynamic, [&](pliant_scene &scene) {
        scene.contact.max_force = limit;
        scene.solver.backend = backend;
        if (!with.is_patched) return;
        scene.model.method = PLIANT_AVERAGED;
        scene.mesh.ratio = 2;
        scene.model.patch = 0.012;
    });
    pliant_tool_shape plate{};
    plate.num_parts = 1;
    plate.part[0] = {PLIANT_PART_BOX, PLIANT_FRAME_TIP, {-0.012, -0.012, 0}, {0.012, 0.012, 0.01}, 0, false};
    const int tool = sheet.add("tool", with.is_wide ? plate : ball(0.004), 0.03, 0.03, 0.01);
    for (int step = 0; step <= 45; step++) {
        sheet.move(tool, 0.03, 0.03, 0.01 - 0.0005 * std::min(step, 30));
        EXPECT_GE(pliant_step(sheet.model, sheet.data), 0) << pliant_last_error();
        const pliant_tool_pose proxy = pliant_tool_proxy(sheet.data->tools + tool);
        pliant_proxy_load load;
        pliant_proxy_find_load(sheet.data, tool, &proxy, &load);
        out.largest = std::max(out.largest, pliant_length3(load.wrench) / limit);
        if (step > 30) out.mean += pliant_length3(load.wrench) / 15 / limit;
        out.behind = std::max(out.behind, sheet.data->statistics.proxy_error);
    }
    std::printf("%s, %s: force / limit: maximum %.4f, mean at rest %.4f; at most %.2f mm behind\n", with.name,
                with.is_wide ? "plate" : "ball", out.largest, out.mean, 1e3 * out.behind);
    EXPECT_STREQ(pliant_data_get_backend(sheet.data), backend == PLIANT_CUDA ? "cuda" : "cpu") << pliant_last_error();
    EXPECT_NEAR(out.mean, 1, 0.021);
    EXPECT_LT(out.behind, 0.01);
    return out;
}

#endif
