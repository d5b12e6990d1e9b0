// Large strains against converged quadratic elements with the same law (test/reference/large_strains.py). Results:
// src/fem/element/NUMERICS.md.
#include "algebra.h"
#include "body.h"

#include <cmath>
#include <cstdio>
#include <vector>

namespace {

struct Case {
    const char *name;
    pliant_element_kind kind;
    pliant_elasticity law;
    double lift;          // of Cook's membrane [m]
    double torque, force; // of the twisted bar [N m], [N]
};

const Case cases[] = {
    {"hexahedra, corotational", PLIANT_HEXAHEDRA, PLIANT_ELASTICITY_COROTATIONAL, 14.141e-3, 2.082e-3, 9.8e-3},
    {"tetrahedra, corotational", PLIANT_LINEAR, PLIANT_ELASTICITY_COROTATIONAL, 14.141e-3, 2.082e-3, 9.8e-3},
    {"hexahedra, neo-Hookean", PLIANT_HEXAHEDRA, PLIANT_ELASTICITY_NEO_HOOKEAN, 14.507e-3, 2.080e-3, -11.4e-3},
    {"tetrahedra, neo-Hookean", PLIANT_LINEAR, PLIANT_ELASTICITY_NEO_HOOKEAN, 14.507e-3, 2.080e-3, -11.4e-3}};

// ---- Cook's membrane

// Plane strain, cubes of `cell` [mm]. The membrane is 48 mm wide, and 44 mm high at the clamped side. The other side is
// 16 mm high. It has an upward dead load of 1 N per millimetre of thickness.
struct Membrane : Body {
    static constexpr double shear = 0.4225e6, poisson = 0.3, thick = 1e-3;
    Eigen::VectorXd load, x; // [N], [m]
    std::vector<int> free;
    int middle = -1; // unknown: vertical position of the loaded side's middle
    Membrane(const Case &of, int cell)
        : Body(std::vector<int>{96, 120, 2}.data(), std::vector<double>{0.048, 0.06, thick}.data(),
               {{2 * (1 + poisson) * shear, poisson, 1000, false}, {1, 0.3, 1, true}}, [](int i, int j, int) {
                   const double at = (i + 0.5) / 2, up = (j + 0.5) / 2;
                   return up < 44 * at / 48 || up > 44 + 16 * at / 48;
               })
    {
        scene.element.kind = of.kind;
        scene.element.law = of.law;
        cells(48 / cell, 60 / cell, 1, 1);
        fix_plane(1e-6, 0, 0, 1, 0, 0);
        EXPECT_EQ(build(), PLIANT_OK) << pliant_last_error();
        const pliant_mesh &mesh = model->body->fine;
        x = Eigen::Map<const Eigen::VectorXd>(mesh.rest, 3 * mesh.num_nodes);
        load = Eigen::VectorXd::Zero(x.size());
        for (int n = 0; n < mesh.num_nodes; n++) {
            const double *at = mesh.rest + 3 * n;
            if (at[0] > 1e-9) free.insert(free.end(), {3 * n, 3 * n + 1});
            if (at[0] < 0.048 - 1e-9 || at[1] < 0.044 - 1e-9) continue;
            if (std::fabs(at[1] - 0.052) < 1e-9) middle = 3 * n + 1;
            const bool border = at[1] < 0.044 + 1e-9 || at[1] > 0.060 - 1e-9;
            load[3 * n + 1] = 1e3 * thick / 2 * cell / 16 * (border ? 0.5 : 1);
        }
        EXPECT_NEAR(load.sum(), 1e3 * thick, 1e-9);
    }
    Eigen::VectorXd residual(double fraction) const
    {
        const std::vector<double> force = elastic_force(std::vector<double>(x.data(), x.data() + x.size()));
        Eigen::VectorXd out(free.size());
        for (size_t i = 0; i < free.size(); i++) out[i] = fraction * load[free[i]] - force[free[i]];
        return out;
    }
    Eigen::MatrixXd stiffness(double fraction) // by differences
    {
        const double by = 1e-8;
        Eigen::MatrixXd out(free.size(), free.size());
        for (size_t i = 0; i < free.size(); i++) {
            const double at = x[free[i]];
            x[free[i]] = at + by;
            const Eigen::VectorXd above = residual(fraction);
            x[free[i]] = at - by;
            out.col(i) = (residual(fraction) - above) / (2 * by);
            x[free[i]] = at;
        }
        return out;
    }
    double lift(int parts) // [m]
    {
        for (int part = 1; part <= parts; part++)
            for (int left = 20; residual(double(part) / parts).norm() > 1e-6; left--) {
                if (left == 0) return ADD_FAILURE() << "Newton's method does not converge", 0;
                const Eigen::VectorXd step =
                    algebra::solve(stiffness(double(part) / parts), residual(double(part) / parts));
                for (size_t i = 0; i < free.size(); i++) x[free[i]] += step[i];
            }
        return x[middle] - model->body->fine.rest[middle];
    }
};

TEST(LargeStrains, CooksMembrane)
{
    for (const Case &of : cases) {
        const double error = Membrane(of, 4).lift(4) / of.lift - 1;
        std::printf("Cook's membrane, %s, cells of 4 mm: %+.1f %%\n", of.name, 100 * error);
        EXPECT_NEAR(error, 0, of.kind == PLIANT_HEXAHEDRA ? 0.05 : 0.1) << of.name;
    }
}

// ---- a twisted bar

// Torque on a bar of 20 x 20 x 60 mm whose end is turned by 90 degrees about its axis, and the axial force.
struct Twist {
    double torque, force; // [N m], [N]
};

Twist twist(const Case &of, int across)
{
    const double side = 0.02, length = 0.06;
    const int size[3] = {across, across, 3 * across}, parts = 6;
    const double box[3] = {side, side, length};
    Body bar(size, box, {{10e3, 0.45, 1000, false}});
    for (double &g : bar.scene.model.gravity) g = 0;
    bar.scene.element.kind = of.kind;
    bar.scene.element.law = of.law;
    bar.scene.solver.tolerance = 1e-7;
    bar.cells(size[0], size[1], size[2], 1);
    bar.fix_plane(0, 0, 1e-6, 0, 0, 1);
    bar.fix_plane(0, 0, length - 1e-6, 0, 0, -1);
    EXPECT_EQ(bar.build(), PLIANT_OK) << pliant_last_error();
    const pliant_mesh &mesh = bar.model->body->fine;
    for (int part = 0; part < parts; part++) {
        for (int n = 0; n < mesh.num_nodes; n++) {
            double *x = bar.data->solver->now.x + 3 * n;
            const double angle = M_PI / 2 / parts * mesh.rest[3 * n + 2] / length, a = x[0] - side / 2,
                         b = x[1] - side / 2;
            x[0] = side / 2 + std::cos(angle) * a - std::sin(angle) * b;
            x[1] = side / 2 + std::sin(angle) * a + std::cos(angle) * b;
        }
        pliant_solver_reset_after_move(bar.data->solver);
        EXPECT_EQ(bar.settle(), PLIANT_OK) << of.name;
    }
    const double *x = bar.data->solver->now.x;
    const std::vector<double> force = bar.elastic_force(std::vector<double>(x, x + 3 * mesh.num_nodes));
    Twist out{0, 0};
    for (int n = 0; n < mesh.num_nodes; n++) {
        if (mesh.rest[3 * n + 2] < length - 1e-9) continue;
        out.torque += (x[3 * n] - side / 2) * force[3 * n + 1] - (x[3 * n + 1] - side / 2) * force[3 * n];
        out.force += force[3 * n + 2];
    }
    return out;
}

// Half the size of the cells leaves at most 0.4 of the error, which is a quarter with an ideal second order.
TEST(LargeStrains, TwistedBar)
{
    for (const Case &of : cases) {
        Twist error[2];
        for (int n = 0; n < 2; n++) {
            const Twist found = twist(of, n == 0 ? 4 : 8);
            error[n] = {found.torque - of.torque, found.force - of.force};
            std::printf("twisted bar, %s, %d cells across: torque %+.1f %%, axial force %.2f mN instead of %.2f mN\n",
                        of.name, n == 0 ? 4 : 8, 100 * error[n].torque / of.torque, 1e3 * found.force, 1e3 * of.force);
        }
        EXPECT_NEAR(error[1].torque, 0, (of.kind == PLIANT_HEXAHEDRA ? 0.05 : 0.1) * of.torque) << of.name;
        EXPECT_LT(std::fabs(error[1].torque), 0.4 * std::fabs(error[0].torque)) << of.name;
        EXPECT_LT(std::fabs(error[1].force), 0.4 * std::fabs(error[0].force)) << of.name;
    }
}

} // namespace
