// The body that the CUDA backend is compared on, and how it is pulled.
#ifndef PLIANT_TEST_CUDA_BODIES_H
#define PLIANT_TEST_CUDA_BODIES_H

#include "body.h"

#include <cmath>
#include <string>
#include <vector>

static const int size[3] = {24, 24, 24};
static const double box[3] = {0.12, 0.12, 0.12};
static const std::vector<Material> three = {
    {5000, 0.45, 1000, false}, {60000, 0.45, 1100, false}, {1000, 0.3, 1, true}};
inline int inclusions(int i, int j, int k) { return i / 6 % 2 && j / 8 % 2 ? 1 : k > 20 && i < 6 ? 2 : 0; }

struct Case {
    pliant_method method;
    pliant_drive drive;
    double gravity, damping;
    int tools;
    pliant_preconditioner_choice preconditioner;
    pliant_element_kind element = PLIANT_LINEAR;
    pliant_elasticity law = PLIANT_ELASTICITY_COROTATIONAL;
    double poisson = 0.45; // of the soft tissue; the stiff inclusions keep theirs
};

inline std::vector<Material> materials_of(const Case &c)
{
    std::vector<Material> materials = three;
    materials[0].poisson = c.poisson;
    return materials;
}

inline void prepare(Body &body, const Case &c, pliant_backend_choice backend)
{
    body.scene.solver.backend = backend;
    body.scene.solver.preconditioner = c.preconditioner;
    body.scene.model.method = c.method;
    body.scene.element.kind = c.element;
    body.scene.element.law = c.law;
    body.scene.model.gravity[0] = c.gravity;
    body.scene.grasp.damping = c.damping;
    body.scene.solver.iterations = 100;
    body.scene.solver.tolerance = 1e-8;
    body.cells(4, 4, 4, 2);
    body.fix_plane(0, 0, 0.001, 0, 0, 1);
}

inline void step(Body &body, const Case &c, int s, int steps)
{
    for (int t = 0; t < c.tools; t++) {
        int tool;
        const std::string name = "t" + std::to_string(t);
        ASSERT_EQ(pliant_tool_add(body.model, body.data, name.c_str(), &tool), PLIANT_OK);
        const double point[3] = {0.04 + 0.04 * t, 0.06, 0.11 - 0.02 * t}, along = 0.02 * s / steps;
        const double tip[3] = {point[0] + along, point[1] - along * t, point[2] + along},
                     force[3] = {0.5 * s / steps, 0, 1.0 * s / steps};
        if (s == 1) {
            ASSERT_EQ(pliant_tool_set_pose(body.data, tool, point, nullptr), PLIANT_OK);
            ASSERT_EQ(pliant_tool_grasp(body.model, body.data, tool, nullptr), PLIANT_OK) << pliant_last_error();
        }
        ASSERT_EQ(pliant_tool_set_pose(body.data, tool, tip, nullptr), PLIANT_OK);
        ASSERT_EQ(pliant_tool_set_drive(body.data, tool, c.drive, force), PLIANT_OK);
    }
    ASSERT_GE(pliant_step(body.model, body.data), 0) << pliant_last_error();
}

inline double farthest(const double *a, const double *b, int32_t nodes)
{
    double maximum = 0;
    for (int32_t n = 0; n < 3 * nodes; n++) maximum = std::fmax(maximum, std::fabs(a[n] - b[n]));
    return maximum;
}

inline double farthest(const Body &a, const Body &b)
{
    return farthest(a.data->positions, b.data->positions, a.model->body->fine.num_nodes);
}

#endif
