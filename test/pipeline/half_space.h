// Pressed blocks of soft tissue, and a part of a half-space with boundary displacements from theory.
#ifndef PLIANT_TEST_HALF_SPACE_H
#define PLIANT_TEST_HALF_SPACE_H

#include "body.h"

const double young = 5000;

// n x n x h cells
struct Block : Body {
    const double edge, height;
    Block(int n, int h, double poisson, double along = 0.12)
        : Block(n, h, along, {{young, poisson, 1000, false}}, [](int, int, int) { return 0; })
    {
    }
    Block(int n, int h, double along, const std::vector<Material> &materials,
          const std::function<int(int, int, int)> &material)
        : Body(std::vector<int>{n, n, h}.data(), std::vector<double>{along, along, along * h / n}.data(), materials,
               material),
          edge(along), height(along * h / n)
    {
        for (double &g : scene.model.gravity) g = 0;
        cells(n, n, h, 1);
        scene.solver.tolerance = 1e-7;
        scene.solver.refresh_interval = 0;
        scene.solver.threads = 1;
    }
    void fix_below() { fix_plane(0, 0, 1e-4, 0, 0, 1); }
    // Return the reaction of the fixed nodes on the tissue.
    void reaction(double out[3]) const
    {
        const int32_t nodes = model->system->mesh->num_nodes;
        const std::vector<double> elastic =
            elastic_force(std::vector<double>(data->solver->now.x, data->solver->now.x + 3 * nodes));
        out[0] = out[1] = out[2] = 0;
        for (int32_t n = 0; n < nodes; n++)
            for (int d = 0; d < 3; d++)
                if (model->system->free_of_node[n] < 0) out[d] += elastic[3 * n + d];
    }
};

// Return the displacement by a pressure on a circle from Boussinesq's point loads (Johnson, Contact Mechanics, 3.18); z
// points down. The fraction of the force within r is 1 - (1 - (r/a)^2)^power: 3/2 for a sphere (4.2), 1/2 for a flat
// punch (3.34).
inline void circle_moves(double power, double force, double a, double nu, const double x[3], double u[3])
{
    const int rings = 6, around = 12;
    const double shear = young / 2 / (1 + nu);
    u[0] = u[1] = u[2] = 0;
    for (int i = 0; i < rings; i++)
        for (int k = 0; k < around; k++) { /* all with the same force */
            const double part = (i + 0.5) / rings, at = a * std::sqrt(1 - std::pow(1 - part, 1 / power)),
                         turn = 2 * M_PI * (k + 0.5 * i) / around;
            const double from[2] = {x[0] - at * std::cos(turn), x[1] - at * std::sin(turn)}, z = x[2];
            const double r = std::hypot(std::hypot(from[0], from[1]), z),
                         fraction = force / rings / around / (4 * M_PI * shear * r);
            for (int d = 0; d < 2; d++) u[d] += fraction * from[d] * (z / r / r - (1 - 2 * nu) / (r + z));
            u[2] += fraction * (2 * (1 - nu) + z * z / r / r);
        }
}

// A part of a half-space: its sides and bottom have the displacements of the pressed half-space.
struct HalfSpace : Block {
    explicit HalfSpace(int n, pliant_element_kind kind = PLIANT_HEXAHEDRA) : Block(n, n / 2, nu, 0.08)
    {
        const double eps = 1e-4;
        scene.element.kind = kind;
        fix_below();
        fix_plane(eps, 0, 0, 1, 0, 0);
        fix_plane(edge - eps, 0, 0, -1, 0, 0);
        fix_plane(0, eps, 0, 0, 1, 0);
        fix_plane(0, edge - eps, 0, 0, -1, 0);
        EXPECT_EQ(build(), PLIANT_OK) << pliant_last_error();
    }
    void move_far(double power, double force, double a)
    {
        const pliant_mesh &mesh = model->body->fine;
        for (int32_t i = 0; i < mesh.num_nodes; i++) {
            if (model->system->free_of_node[i] >= 0) continue;
            const double *rest = mesh.rest + 3 * i, x[3] = {rest[0] - edge / 2, rest[1] - edge / 2, height - rest[2]};
            double u[3];
            circle_moves(power, force, a, nu, x, u);
            for (int d = 0; d < 3; d++) data->solver->now.x[3 * i + d] = rest[d] + (d < 2 ? u[d] : -u[d]);
        }
        pliant_solver_reset_after_move(data->solver);
    }
    static constexpr double nu = 0.3;
};

#endif
