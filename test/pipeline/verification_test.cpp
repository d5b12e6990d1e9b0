// Hexahedra (element/kind) against closed forms, published results and CalculiX. Results: src/fem/element/NUMERICS.md.
#include "algebra.h"
#include "body.h"

#include "fem/dynamics/tled.h"
#include "fem/element/rotation.h"

#include <algorithm>
#include <array>

namespace {

using Eigen::MatrixXd;
using Eigen::VectorXd;
using algebra::Sparse;

// Boundary conditions of a node: return whether a direction is prescribed, and the displacement.
using Support = std::function<bool(const double *x, int direction, double *displacement)>;

class Solid : public Body {
public:
    Solid(const int size[3], const double box[3], const std::vector<Material> &materials,
          const std::function<int(int, int, int)> &material, const int grid[3],
          pliant_elasticity law = PLIANT_ELASTICITY_COROTATIONAL)
        : Body(size, box, materials, material)
    {
        scene.element.kind = PLIANT_HEXAHEDRA;
        scene.element.law = law;
        cells(grid[0], grid[1], grid[2], 1);
        fix_plane(0, 0, 1e-6 * box[2], 0, 0, 1); // a scene needs a fixed plane; the supports are given here
        EXPECT_EQ(build(), PLIANT_OK) << pliant_last_error();
    }
    const pliant_mesh &mesh() const { return model->body->fine; }
    const pliant_macros &elements() const { return *model->system->macros; }
    int unknowns() const { return 3 * mesh().num_nodes; }
    const double *at(int node) const { return mesh().rest + 3 * node; }

    int global(int e, int local) const { return 3 * elements().node[elements().start[e] + local / 3] + local % 3; }
    // Return the root of an element's stiffness, with a row for its pressure (element/pressures.h).
    MatrixXd stiffness_of(int e) const
    {
        const int columns = 3 * (elements().start[e + 1] - elements().start[e]);
        MatrixXd root = Eigen::Map<const Eigen::Matrix<float, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor>>(
                            elements().root[e], elements().rank[e], columns)
                            .cast<double>();
        const pliant_pressures *pressures = data->solver->pressures;
        if (!pressures || pressures->of_element[e] < 0) return root;
        const int p = pressures->of_element[e];
        root.conservativeResize(root.rows() + 1, Eigen::NoChange);
        const double scale = std::sqrt(pressures->volume[p] / pressures->compliance[p]);
        root.row(root.rows() - 1) = scale * gradient_of(e).transpose();
        return root;
    }
    VectorXd gradient_of(int e) const { return Eigen::Map<const VectorXd>(elements().gradient + 24 * e, 24); }
    // Return the rotation of an element at displacements.
    Eigen::Matrix3d rotation_of(int e, const VectorXd &u) const
    {
        Eigen::Matrix<double, 3, 3, Eigen::RowMajor> f = Eigen::Matrix3d::Identity(), r;
        const VectorXd g = gradient_of(e);
        for (int v = 0; v < 8; v++)
            for (int d = 0; d < 9; d++) f(d / 3, d % 3) += u[global(e, 3 * v + d / 3)] * g[3 * v + d % 3];
        pliant_rotation_signed_svd(f.data(), r.data());
        return r;
    }
    // Return the sum over elements of R K R'.
    Sparse stiffness(const VectorXd *u = nullptr) const
    {
        Sparse out{unknowns(), {}};
        for (int e = 0; e < elements().count; e++) {
            MatrixXd root = stiffness_of(e);
            const Eigen::Matrix3d turn = u ? rotation_of(e, *u) : Eigen::Matrix3d::Identity();
            for (int v = 0; u && 3 * v < root.cols(); v++)
                root.middleCols(3 * v, 3) = root.middleCols(3 * v, 3).lazyProduct(turn.transpose()).eval();
            const MatrixXd k = algebra::product(root.transpose(), root);
            for (int i = 0; i < k.rows(); i++)
                for (int j = 0; j < k.cols(); j++) out.entries.push_back({global(e, i), global(e, j), k(i, j)});
        }
        return out;
    }
    // Return the displacements under loads.
    VectorXd solve(const Support &support, const VectorXd &load) const
    {
        VectorXd u = VectorXd::Zero(unknowns());
        const std::vector<int> free = free_of(support, &u);
        const Sparse all = stiffness();
        const VectorXd right = load - algebra::product(all, u);
        VectorXd part(free.size());
        for (size_t i = 0; i < free.size(); i++) part[i] = right[free[i]];
        const VectorXd found = algebra::solve(reduced(all, free), part);
        for (size_t i = 0; i < free.size(); i++) u[free[i]] = found[i];
        return u;
    }
    // Return the unknowns; prescribed displacements are set.
    std::vector<int> free_of(const Support &support, VectorXd *u) const
    {
        std::vector<int> free;
        for (int i = 0; i < unknowns(); i++) {
            double to = 0;
            if (support(at(i / 3), i % 3, &to)) (*u)[i] = to;
            else free.push_back(i);
        }
        return free;
    }
    static Sparse reduced(const Sparse &k, const std::vector<int> &free)
    {
        std::vector<int> place(static_cast<size_t>(k.size), -1);
        for (size_t i = 0; i < free.size(); i++) place[free[i]] = static_cast<int>(i);
        Sparse out{static_cast<int>(free.size()), {}};
        for (const algebra::Entry &entry : k.entries)
            if (place[entry.row] >= 0 && place[entry.column] >= 0)
                out.entries.push_back({place[entry.row], place[entry.column], entry.value});
        return out;
    }
    // Return the mean volume change of an element.
    double dilatation(int e, const VectorXd &u) const
    {
        const VectorXd g = gradient_of(e);
        double sum = 0;
        for (int i = 0; i < 24; i++) sum += g[i] * u[global(e, i)];
        return sum;
    }
    // Return the strain in its centre, xx yy zz.
    std::array<double, 3> strain(int e, const VectorXd &u) const
    {
        const VectorXd g = gradient_of(e);
        std::array<double, 3> out{};
        for (int i = 0; i < 24; i++) out[i % 3] += g[i] * u[global(e, i)];
        return out;
    }
};

int whole(int, int, int) { return 0; }

// ---- no zero modes except rigid motions

// A body of 3 x 3 x 3 cubes intersected by a ball of tissue: whole cubes, partially filled ones, corners of a few
// voxels.
TEST(Verification, AFreeBodyHasSixZeroModesPartlyFilledCubesToo)
{
    const int size[3] = {12, 12, 12}, grid[3] = {3, 3, 3};
    const double box[3] = {0.06, 0.06, 0.06};
    for (double radius : {100.0, 6.3}) {
        Solid ball(size, box, {{2000, 0.49, 1000, false}, {1, 0.3, 1, true}}, [&](int i, int j, int k) {
            return std::hypot(std::hypot(i - 5.5, j - 5.5), k - 5.5) > radius;
        }, grid);
        const VectorXd values = algebra::eigenvalues(algebra::dense(ball.stiffness()));
        std::printf("ball of %g voxels: sixth, seventh eigenvalue over the largest %.1e, %.1e\n", radius,
                    values[5] / values[values.size() - 1], values[6] / values[values.size() - 1]);
        EXPECT_LT(std::fabs(values[5]), 1e-7 * values[values.size() - 1]);
        EXPECT_GT(values[6], 1e-4 * values[values.size() - 1]);
    }
}

// ---- inf-sup by the numerical test (Chapelle and Bathe, Computers & Structures 47:537, 1993)

// Inf-sup values of a cube clamped below: the minimum over pressures p of sup b(v, p) / (|v| |p|), with the H1 product
// |v|^2 = v S v.
struct InfSup {
    int spurious;    // number of pressures without any displacement response
    double cubes;    // all pressures
    double filtered; // pressures whose sign does not alternate along two or three axes within 2 x 2 x 2 cubes
    double nodes;    // all pressures, with |p| from their means at the nodes
};

// Return (pressures x pressures) sup b(v, p)^2 / |v|^2 for a unit volume of pressures.
MatrixXd answers(const Solid &cube)
{
    const int elements = cube.elements().count;
    VectorXd none = VectorXd::Zero(cube.unknowns());
    const std::vector<int> free = cube.free_of([](const double *x, int, double *) { return x[2] < 1e-9; }, &none);
    std::vector<int> place(cube.unknowns(), -1);
    for (size_t i = 0; i < free.size(); i++) place[free[i]] = static_cast<int>(i);
    // deviatoric part and the full part with a bulk modulus of 1: the H1 norm up to constants (Korn)
    Sparse s{static_cast<int>(free.size()), {}};
    MatrixXd b = MatrixXd::Zero(free.size(), elements);
    const double volume = 1.0 / elements, kappa = 3000 / (3 * (1 - 2 * 0.49)), mu = 3000 / (2 * 1.49);
    for (int e = 0; e < elements; e++) {
        const MatrixXd root = cube.stiffness_of(e);
        const VectorXd g = cube.gradient_of(e);
        const MatrixXd k = algebra::product(root.transpose(), root);
        for (int i = 0; i < 24; i++) {
            const int row = place[cube.global(e, i)];
            if (row < 0) continue;
            b(row, cube.elements().cell[e]) += std::sqrt(volume) * g[i];
            for (int j = 0; j < 24; j++)
                if (place[cube.global(e, j)] >= 0)
                    s.entries.push_back({row, place[cube.global(e, j)],
                                         (k(i, j) - volume * kappa * g[i] * g[j]) / mu + volume * g[i] * g[j]});
        }
    }
    return algebra::product(b.transpose(), algebra::solve(s, b));
}

InfSup inf_sup(int cells)
{
    const int size[3] = {cells, cells, cells}, elements = cells * cells * cells, corners = cells + 1;
    const double box[3] = {1, 1, 1};
    const MatrixXd of_pressures = answers(Solid(size, box, {{3000, 0.49, 1000, false}}, whole, size));
    MatrixXd kept = MatrixXd::Zero(elements, elements / 2),
             means = MatrixXd::Zero(corners * corners * corners, elements);
    for (int e = 0; e < elements; e++) {
        const int at[3] = {e % cells, e / cells % cells, e / cells / cells};
        const int block = at[0] / 2 + cells / 2 * (at[1] / 2 + cells / 2 * (at[2] / 2));
        kept(e, 4 * block) = std::sqrt(0.125);
        for (int d = 0; d < 3; d++) kept(e, 4 * block + 1 + d) = (at[d] % 2 ? 1 : -1) * std::sqrt(0.125);
        for (int v = 0; v < 8; v++)
            means(at[0] + (v & 1) + corners * (at[1] + (v >> 1 & 1) + corners * (at[2] + (v >> 2))), e) = 1;
    }
    // the node's share of the volume, and the mean of its surroundings
    for (Eigen::Index n = 0; n < means.rows(); n++) {
        const double around = means.row(n).sum();
        means.row(n) *= std::sqrt(around / 8) / around;
    }
    InfSup out{};
    const VectorXd all = algebra::eigenvalues(of_pressures);
    while (out.spurious < elements && all[out.spurious] < 1e-8) out.spurious++;
    out.cubes = std::sqrt(all[0]);
    const MatrixXd of_kept = algebra::product(kept.transpose(), algebra::product(of_pressures, kept)),
                   inverse = algebra::product(means, algebra::solve(of_pressures, means.transpose()));
    out.filtered = std::sqrt(algebra::eigenvalues(of_kept)[0]);
    out.nodes = 1 / std::sqrt(algebra::eigenvalues(inverse)[inverse.rows() - 1]);
    return out;
}

// Over all pressures the value decreases with mesh refinement, as for every hexahedron with one pressure, because signs
// alternate between cubes (Sani et al., Int. J. Numer. Meth. Fluids 1:17 and 171, 1981). It stays above zero without
// pressures that alternate within 2 x 2 x 2 cubes (Pitkaranta and Stenberg, in: The Mathematics of Finite Elements and
// Applications V, 1985), and for means at the nodes. If a part of the surface is free, every pressure has a response.
TEST(Verification, InfSupOfPressuresThatDoNotAlternateStaysAboveZero)
{
    for (int cells : {2, 4, 6, 8}) {
        const InfSup value = inf_sup(cells);
        std::printf("inf-sup, %d cells along an edge: %.3f; filtered %.3f, at nodes %.3f\n", cells, value.cubes,
                    value.filtered, value.nodes);
        EXPECT_EQ(value.spurious, 0);
        EXPECT_GT(value.filtered, 0.42); // its changes: 0.24, 0.05, 0.02
        EXPECT_GT(value.nodes, 0.6);
    }
}

// ---- Cook's membrane

// plane strain, 48 mm wide, 44 mm high at the clamped side, 16 mm at the side with an upward force of 1 N per
// millimetre of thickness
struct Cook { double small, large; }; // upward displacement of the end's middle [m]: for small strains; for large ones

// parts: number of load steps to large strains; 0: small strains alone
Cook cook(int cell, double poisson, int parts, pliant_elasticity law = PLIANT_ELASTICITY_COROTATIONAL)
{
    const int fine = 2, size[3] = {48 * fine, 60 * fine, fine}, grid[3] = {48 / cell, 60 / cell, 1};
    const double box[3] = {0.048, 0.060, 1e-3}, shear = 0.4225e6, young = 2 * (1 + poisson) * shear, thick = box[2];
    Solid panel(size, box, {{young, poisson, 1000, false}, {1, 0.3, 1, true}}, [&](int i, int j, int) {
        const double x = (i + 0.5) / fine, y = (j + 0.5) / fine;
        return y < 44 * x / 48 || y > 44 + 16 * x / 48;
    }, grid, law);
    VectorXd u = VectorXd::Zero(panel.unknowns()), load = u;
    const Support support = [](const double *x, int direction, double *) { return direction == 2 || x[0] < 1e-9; };
    const std::vector<int> free = panel.free_of(support, &u);
    int middle = 0;
    for (int n = 0; n < panel.mesh().num_nodes; n++) {
        const double *x = panel.at(n);
        if (x[0] < 0.048 - 1e-9 || x[1] < 0.044 - 1e-9) continue;
        if (std::fabs(x[1] - 0.052) < 1e-9) middle = 3 * n + 1;
        const bool end = x[1] < 0.044 + 1e-9 || x[1] > 0.060 - 1e-9;
        load[3 * n + 1] = 1.0 / 1e-3 * thick / 2 * cell / 16 * (end ? 0.5 : 1);
    }
    EXPECT_NEAR(load.sum(), 1.0, 1e-9);
    for (int part = 1, left = 60; part <= parts; left--) {
        std::vector<double> x(u.data(), u.data() + u.size());
        for (size_t i = 0; i < x.size(); i++) x[i] += panel.mesh().rest[i];
        const std::vector<double> force = panel.elastic_force(x);
        VectorXd residual(free.size());
        for (size_t i = 0; i < free.size(); i++) residual[i] = load[free[i]] * part / parts - force[free[i]];
        if (left == 0) ADD_FAILURE() << "not settled: " << residual.norm();
        if (residual.norm() < 1e-5 || left == 0) {
            part++;
            continue;
        }
        const VectorXd step = algebra::solve(Solid::reduced(panel.stiffness(&u), free), residual);
        for (size_t i = 0; i < free.size(); i++) u[free[i]] += step[i];
    }
    return {panel.solve(support, load)[middle], u[middle]};
}

// CalculiX, 16 x 16 quadratic hexahedra (C3D20R): 19.94 mm for small strains; with its neo-Hookean law 14.72 mm,
// published 14.74 mm. The corotational law is a different one.
TEST(Verification, CooksMembrane)
{
    const Cook lifted = cook(4, 0.3, 4);
    std::printf("Cook's membrane, cells of 4 mm: %.2f mm, for small strains %.2f mm\n", 1e3 * lifted.large,
                1e3 * lifted.small);
    EXPECT_NEAR(lifted.small, 19.94e-3, 0.05 * 19.94e-3);
    EXPECT_NEAR(lifted.large, 14.74e-3, 0.08 * 14.74e-3);
}

// Quadratic quadrilaterals with the same law (test/reference/large_strains.py cook): 14.51 mm.
TEST(Verification, CooksMembraneWithTheNeoHookeanLaw)
{
    for (int cell : {4, 2, 1}) {
        const double lifted = cook(cell, 0.3, 4, PLIANT_ELASTICITY_NEO_HOOKEAN).large;
        std::printf("Cook's membrane, neo-Hookean, cells of %d mm: %.2f mm\n", cell, 1e3 * lifted);
        EXPECT_NEAR(lifted, 14.51e-3, 0.006 * cell * 14.51e-3);
    }
}

// Taylor-Hood triangles (test/bench/taylor_hood.py cook): 14.60 mm.
TEST(Verification, CooksMembraneNearlyIncompressible)
{
    const double lifted = cook(4, 0.4999, 0).small;
    std::printf("Cook's membrane, nu 0.4999, cells of 4 mm: %.2f mm for small strains\n", 1e3 * lifted);
    EXPECT_NEAR(lifted, 14.60e-3, 0.05 * 14.60e-3);
}

// ---- pressure of a confined block

// A block in a rigid box, pressed down on half or a quarter of its top. Compute the part of the pressure that
// alternates between cubes, in a plane or in space. The result is its root mean square divided by the root mean square
// of the pressure.
struct Oscillation { double cubes, nodes; }; // of element pressures; of their means at the nodes, which are the output

double alternating(const std::vector<double> &pressure, int along)
{
    double all = 0, worst = 0;
    for (double p : pressure) all += p * p / double(pressure.size());
    for (int axes : {3, 5, 6, 7}) { // axes along which signs alternate
        double sum = 0;
        for (int at = 0; at < along * along * along; at++) {
            if (at % along + 1 >= along || at / along % along + 1 >= along || at / along / along + 1 >= along) continue;
            double part = 0;
            for (int c = 0; c < 8; c++)
                part += (__builtin_parity(c & axes) ? -1 : 1) *
                        pressure[at + (c & 1) + along * ((c >> 1 & 1) + along * (c >> 2))] / 8;
            sum += part * part;
        }
        worst = std::max(worst, std::sqrt(sum / std::pow(along - 1, 3) / all));
    }
    return worst;
}

Oscillation oscillation(double poisson, int cells, bool quarter)
{
    const int size[3] = {cells, cells, cells}, corners = cells + 1;
    const double box[3] = {0.06, 0.06, 0.06}, kappa = 3000 / (3 * (1 - 2 * poisson));
    Solid block(size, box, {{3000, poisson, 1000, false}}, whole, size);
    const VectorXd u = block.solve(
        [&](const double *x, int direction, double *to) {
            if (direction == 2 && x[2] > box[2] - 1e-9 && x[0] < 0.03 + 1e-9 && (!quarter || x[1] < 0.03 + 1e-9))
                return *to = -1e-4, true;
            return x[direction] < 1e-9 || (direction < 2 && x[direction] > box[direction] - 1e-9);
        },
        VectorXd::Zero(block.unknowns()));
    std::vector<double> pressure(block.elements().count), at_nodes(corners * corners * corners),
        around(at_nodes.size());
    for (int e = 0; e < block.elements().count; e++) {
        const int cell = block.elements().cell[e];
        pressure[cell] = -kappa * block.dilatation(e, u);
        for (int v = 0; v < 8; v++) {
            const int node =
                cell % cells + (v & 1) +
                corners * (cell / cells % cells + (v >> 1 & 1) + corners * (cell / cells / cells + (v >> 2)));
            at_nodes[node] += pressure[cell];
            around[node]++;
        }
    }
    for (size_t n = 0; n < at_nodes.size(); n++) at_nodes[n] /= around[n];
    return {alternating(pressure, cells), alternating(at_nodes, corners)};
}

// The edge of the pressed area causes the remaining oscillation. It decreases with the cube size, and equals the
// oscillation of compressible tissue.
TEST(Verification, PressureOfAConfinedBlockDoesNotOscillate)
{
    for (bool quarter : {false, true}) {
        const double compressible = oscillation(0.45, 4, quarter).cubes;
        const Oscillation coarse = oscillation(0.4999, 4, quarter), fine = oscillation(0.4999, 8, quarter);
        std::printf(
            "confined block pressed on %s of its top: pressure oscillates by %.1f %% of 4 cubes along an edge (at "
            "nodes %.1f), %.1f %% of 8 (%.1f); %.1f %% at nu 0.45\n",
            quarter ? "a quarter" : "half", 100 * coarse.cubes, 100 * coarse.nodes, 100 * fine.cubes, 100 * fine.nodes,
            100 * compressible);
        EXPECT_LT(coarse.cubes, 1.1 * compressible);
        EXPECT_LT(fine.cubes, 0.75 * coarse.cubes);
        EXPECT_LT(coarse.cubes, 0.1);
        EXPECT_LT(coarse.nodes, 0.5 * coarse.cubes);
        EXPECT_LT(fine.nodes, 0.5 * fine.cubes);
    }
}

// ---- soft next to stiff

// 1 : 10,000 in series under a force, fixed sideways: exact with the interface between cubes. A cube with both
// materials takes their mean, and is stiff.
TEST(Verification, SoftAndStiffInSeries)
{
    const double box[3] = {0.02, 0.02, 0.08};
    for (double poisson : {0.0, 0.499})
        for (int cells : {8, 16})
            for (int shift : {0, 1}) {
                const int grid[3] = {cells / 4, cells / 4, cells}, size[3] = {2 * grid[0], 2 * grid[1], 2 * cells};
                Solid bar(
                    size, box, {{1000, poisson, 1000, false}, {1e7, poisson, 1000, false}},
                    [&](int, int, int k) { return k >= cells + shift; }, grid);
                VectorXd load = VectorXd::Zero(bar.unknowns());
                for (int n = 0; n < bar.mesh().num_nodes; n++) {
                    double part = bar.at(n)[2] > box[2] - 1e-9 ? -1e-3 : 0;
                    for (int d = 0; d < 2; d++) part *= bar.at(n)[d] < 1e-9 || bar.at(n)[d] > box[d] - 1e-9 ? 0.5 : 1;
                    load[3 * n + 2] = part;
                }
                const VectorXd u = bar.solve(
                    [](const double *x, int direction, double *) { return direction < 2 || x[2] < 1e-9; }, load);
                const double modulus = 1000 * (1 - poisson) / ((1 + poisson) * (1 - 2 * poisson)),
                             soft = box[2] * (0.5 + 0.5 * shift / cells);
                const double exact = load.sum() / (box[0] * box[1] * modulus) * (soft + (box[2] - soft) / 1e4);
                const double error = u[bar.unknowns() - 1] / exact - 1, half_a_cube = 0.5 * box[2] / cells / soft;
                std::printf("series 1 : 10,000, nu %g, %d cubes, interface %s: %.2f %%\n", poisson, cells,
                            shift ? "within them" : "between them", 100 * error);
                EXPECT_NEAR(error, shift ? -half_a_cube : 0, 1e-3);
            }
}

// ---- a sphere within another material (Eshelby 1957)

// The strain inside is uniform; tested in cubes completely inside, next to cubes with both materials.
TEST(Verification, SphereAgainstEshelby)
{
    const int cells = 10, size[3] = {2 * cells, 2 * cells, 2 * cells}, grid[3] = {cells, cells, cells};
    const double box[3] = {0.04, 0.04, 0.04}, radius = 0.01, poisson = 0.45, young = 3000, far = 1e-3;
    for (double contrast : {1000.0, 1e-3}) {
        Solid octant(
            size, box, {{young, poisson, 1000, false}, {young * contrast, poisson, 1000, false}},
            [&](int i, int j, int k) {
                const double h = box[0] / size[0];
                return std::hypot(std::hypot((i + 0.5) * h, (j + 0.5) * h), (k + 0.5) * h) < radius;
            },
            grid);
        // far away stretched along z and compressed half as much across; one eighth by symmetry
        const VectorXd u = octant.solve([&](const double *x, int direction, double *to) {
            const bool outside = x[0] > box[0] - 1e-9 || x[1] > box[1] - 1e-9 || x[2] > box[2] - 1e-9;
            *to = outside ? far * (direction == 2 ? 1 : -0.5) * x[direction] : 0;
            return outside || x[direction] < 1e-9;
        }, VectorXd::Zero(octant.unknowns()));
        const double beta = 2 * (4 - 5 * poisson) / (15 * (1 - poisson)), exact = far / (1 + beta * (contrast - 1));
        double minimum = INFINITY, maximum = -INFINITY, sum = 0;
        int count = 0;
        for (int e = 0; e < octant.elements().count; e++) {
            const double *last = octant.at(octant.global(e, 21) / 3);
            if (std::hypot(std::hypot(last[0], last[1]), last[2]) > radius) continue;
            const double value = octant.strain(e, u)[2] / exact;
            minimum = std::min(minimum, value);
            maximum = std::max(maximum, value);
            sum += value;
            count++;
        }
        std::printf("sphere 1 : %g: strain inside %.2f to %.2f of Eshelby's, mean %.2f\n", contrast, minimum, maximum,
                    sum / count);
        EXPECT_NEAR(sum / count, 1, 0.2);
        EXPECT_GT(minimum, 0.7);
        EXPECT_LT(maximum, 1.4);
    }
}

// ---- one cell thin

// A load at the end of a strip with a length of 20 times its thickness.
TEST(Verification, AStripOneCellThinBends)
{
    const double maximum[2][2] = {{0.08, 0.1}, {0.04, 0.05}};
    for (int across : {1, 2})
        for (double poisson : {0.0, 0.499}) {
            const int size[3] = {across, across, 20 * across};
            const double box[3] = {0.005, 0.005, 0.1};
            Solid strip(size, box, {{1e5, poisson, 1000, false}}, whole, size);
            VectorXd load = VectorXd::Zero(strip.unknowns());
            for (int n = 0; n < strip.mesh().num_nodes; n++)
                if (strip.at(n)[2] > box[2] - 1e-9) load[3 * n + 1] = -1e-6;
            const VectorXd u = strip.solve([](const double *x, int, double *) { return x[2] < 1e-9; }, load);
            const double inertia = std::pow(box[0], 4) / 12,
                         exact = load.sum() * std::pow(box[2], 3) / (3 * 1e5 * inertia);
            const double error = u[strip.unknowns() - 2] / exact - 1;
            std::printf("strip of %d cubes across, nu %g: %.1f %%\n", across, poisson, 100 * error);
            EXPECT_LT(std::fabs(error), maximum[across - 1][poisson > 0]);
        }
}

// ---- same in explicit dynamics, which has separate hexahedra

// Return the stiffness of a cube at rest by finite differences of forces.
MatrixXd explicit_stiffness(double edge, double young, double poisson)
{
    const int size[3] = {2, 2, 2};
    const double box[3] = {edge, edge, edge}, step = 1e-3 * edge;
    Body one(size, box, {{young, poisson, 1000, false}});
    one.scene.element.kind = PLIANT_HEXAHEDRA;
    one.scene.solver.kind = PLIANT_TLED;
    one.cells(1, 1, 1, 1);
    one.fix_plane(0, 0, 1e-6, 0, 0, 1);
    EXPECT_EQ(one.build(), PLIANT_OK) << pliant_last_error();
    pliant_tled *tled = one.data->tled;
    const pliant_tled_system *system = one.model->tled;
    MatrixXd k = MatrixXd::Zero(24, 24);
    for (int j = 0; j < 24; j++)
        for (int side = -1; side <= 1; side += 2) {
            tled->u[j] = side * step;
            pliant_tled_element_forces(tled, tled->time_step);
            tled->u[j] = 0;
            for (int i = 0; i < 24; i++)
                for (int32_t c = system->corner_start[i / 3]; c < system->corner_start[i / 3 + 1]; c++)
                    k(i, j) += side * double(tled->forces[system->corner[c] + i % 3 * LANES]) / (2 * step);
        }
    MatrixXd rigid = MatrixXd::Zero(24, 6); // single precision leaves a small stiffness of rigid motions
    for (int i = 0; i < 24; i++) {
        const double x[3] = {double(i / 3 & 1), double(i / 6 & 1), double(i / 12)};
        rigid(i, i % 3) = 1;
        rigid(i, 3 + (i + 1) % 3) = x[(i + 2) % 3];
        rigid(i, 3 + (i + 2) % 3) = -x[(i + 1) % 3];
    }
    MatrixXd rest(24, 24); // projection onto the other motions
    for (int i = 0; i < 24; i++) rest.col(i) = algebra::remainder(rigid, VectorXd::Unit(24, i));
    return algebra::product(rest, algebra::product(0.5 * (k + k.transpose()), rest));
}

// Return the displacements (unknowns) of a clamped bar of 20 cubes with a prescribed or loaded end.
VectorXd explicit_bar(const MatrixXd &cube, const Support &support, double edge, double load)
{
    const int unknowns = 3 * 4 * 21;
    MatrixXd k = MatrixXd::Zero(unknowns, unknowns);
    VectorXd u = VectorXd::Zero(unknowns), right = u;
    for (int c = 0; c < 20; c++) k.block(12 * c, 12 * c, 24, 24) += cube;
    for (int v = 0; v < 4; v++) right[unknowns - 11 + 3 * v] = load / 4;
    std::vector<int> free;
    for (int i = 0; i < unknowns; i++) {
        const double x[3] = {edge * (i / 3 % 2), edge * (i / 6 % 2), edge * (i / 12)};
        double to = 0;
        if (support(x, i % 3, &to)) u[i] = to;
        else free.push_back(i);
    }
    right -= algebra::product(k, u);
    const Eigen::Index count = static_cast<Eigen::Index>(free.size());
    MatrixXd inner(count, count); // by hand, because Eigen 3.3 has no index lists
    VectorXd pull(count);
    for (Eigen::Index i = 0; i < count; i++) {
        pull[i] = right[free[i]];
        for (Eigen::Index j = 0; j < count; j++) inner(i, j) = k(free[i], free[j]);
    }
    const VectorXd found = algebra::solve(inner, pull);
    for (Eigen::Index i = 0; i < count; i++) u[free[i]] = found[i];
    return u;
}

// Beam theory, plate theory for constrained width, and Saint-Venant's torsion of a square, 0.1406 h^4 (Timoshenko and
// Goodier, Theory of Elasticity, 109).
TEST(Verification, AnExplicitBarOneCubeThinBendsAndTwists)
{
    const double edge = 0.005, length = 20 * edge, young = 1e5, load = -1e-6, turn = 1e-3;
    for (double poisson : {0.0, 0.3, 0.45, 0.499}) {
        const MatrixXd cube = explicit_stiffness(edge, young, poisson);
        const double theory = load * std::pow(length, 3) / (3 * young * std::pow(edge, 4) / 12);
        const Support clamped = [](const double *x, int, double *) { return x[2] < 1e-9; };
        const Support plane = [](const double *x, int direction, double *) { return x[2] < 1e-9 || direction == 0; };
        const Support turned = [&](const double *x, int direction, double *to) {
            const bool end = x[2] > length - 1e-9 && direction < 2;
            if (end) *to = turn * (direction == 0 ? edge / 2 - x[1] : x[0] - edge / 2);
            return end || (x[2] < 1e-9 && direction < 2) || (direction == 2 && x[2] < 1e-9 && x[0] + x[1] < 1e-9);
        };
        const double bent = explicit_bar(cube, clamped, edge, load)[250] / theory - 1;
        const double narrow = explicit_bar(cube, plane, edge, load)[250] / theory / (1 - poisson * poisson) - 1;
        const VectorXd u = explicit_bar(cube, turned, edge, 0);
        double energy = 0;
        for (int c = 0; c < 20; c++) {
            const VectorXd own = u.segment(12 * c, 24), force = algebra::product(cube, own);
            energy += 0.5 * own.dot(force);
        }
        const double stiff =
            energy / (0.5 * young / (2 + 2 * poisson) * 0.1406 * std::pow(edge, 4) * turn * turn / length) - 1;
        std::printf(
            "explicit bar one cube thin, nu %g: bends %+.1f %%, in a plane %+.1f %%, torsion stiffer by %+.1f %%\n",
            poisson, 100 * bent, 100 * narrow, 100 * stiff);
        EXPECT_LT(std::fabs(bent), 0.05);
        EXPECT_LT(std::fabs(narrow), 0.16);
        EXPECT_LT(std::fabs(stiff), 0.01);
    }
}

// ---- the same bodies with CalculiX, quadratic hexahedra (C3D20R), neo-Hookean, NLGEOM

double block_sway(int cells, double poisson, pliant_element_kind kind)
{
    const int size[3] = {16, 16, 16};
    const double box[3] = {0.04, 0.04, 0.04};
    Body block(size, box, {{3000, poisson, 1000, false}, {300e3, poisson, 1000, false}}, [](int i, int j, int k) {
        return std::min({i, j, k}) >= 4 && std::max({i, j, k}) < 12;
    });
    block.scene.element.kind = kind;
    block.cells(cells, cells, cells, 1);
    block.fix_plane(0, 0, 1e-4, 0, 0, 1);
    block.scene.model.gravity[0] = 4.905;
    EXPECT_EQ(block.build(), PLIANT_OK) << pliant_last_error();
    EXPECT_EQ(block.settle(200), PLIANT_OK) << block.data->statistics.residual;
    double sum = 0;
    const pliant_mesh &fine = block.model->body->fine;
    for (int32_t n = 0; n < fine.num_nodes; n++) {
        bool counts = fine.rest[3 * n + 2] > box[2] - 1e-9;
        for (int d = 0; d < 2; d++) counts = counts && std::fabs(std::remainder(fine.rest[3 * n + d], 0.01)) < 1e-9;
        if (counts) sum += block.data->positions[3 * n] - fine.rest[3 * n];
    }
    return sum / 25;
}

// A soft block of 40 mm around a cube of 20 mm that is 100 times as stiff. The block is clamped below, under half its
// weight sideways. Return the mean of its top at every 10 mm. With 8 / 12 elements per edge: 5.413 / 5.492 mm at nu
// 0.45, 5.149 / 5.257 mm at 0.49.
TEST(Verification, BlockWithAStiffCubeInside)
{
    const double poisson[2] = {0.45, 0.49}, reference[2] = {5.492e-3, 5.257e-3};
    for (int n = 0; n < 2; n++) {
        const double hexahedra = block_sway(8, poisson[n], PLIANT_HEXAHEDRA) / reference[n] - 1,
                     linear = block_sway(8, poisson[n], PLIANT_LINEAR) / reference[n] - 1;
        std::printf("block, cells of 5 mm, nu %g: hexahedra %.1f %%, linear tetrahedra %.1f %%\n", poisson[n],
                    100 * hexahedra, 100 * linear);
        EXPECT_LT(std::fabs(hexahedra), 0.06); // 5.2 and 5.3 %; cells of 2.5 mm 1.1 and 0.4 %
        EXPECT_LT(linear, -0.15);
    }
}

} // namespace
