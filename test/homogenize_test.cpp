// Tests of the homogenized stiffness of coarse tetrahedra: positive semidefinite, or refused with a message.
#include "algebra.h"
#include "fem/coarse/shape_interpolation.h"
#include "fem/coarse/submesh.h"
#include "pipeline/body.h"
#include "base/memory.h"

#include <algorithm>
#include <random>
#include <string>

namespace {

const int size[3] = {24, 24, 24};
const double box[3] = {0.12, 0.12, 0.12};
const pliant_method methods[] = {PLIANT_SCHUR, PLIANT_AVERAGED};

void prepare(Body &body, pliant_method method)
{
    body.scene.model.method = method;
    body.cells(3, 3, 3, 2);
    body.fix_plane(0, 0, 0, 0, 0, 1);
}

TEST(Homogenize, ElementsArePositiveSemidefinite)
{
    for (pliant_method method : methods) {
        Body body(size, box, {{5000, 0.45, 900, false}, {1e6, 0.3, 1800, false}},
                  [](int i, int j, int k) { return (i / 5 + j / 3 + k / 4) % 2; });
        prepare(body, method);
        ASSERT_EQ(body.build(), PLIANT_OK) << pliant_last_error();
        const pliant_system *system = body.model->system;
        for (int32_t t = 0; t < system->mesh->num_tets; t++) {
            const Eigen::Map<const Eigen::MatrixXd> k(system->stiffness + 144 * static_cast<size_t>(t), 12, 12);
            const Eigen::VectorXd values = algebra::eigenvalues(k);
            EXPECT_GT(values[0], -1e-9 * values[11])
                << "method " << method << ", tetrahedron " << t;
        }
    }
}

// Condense fine tetrahedra or hexahedra to four or eight nodes. The result is K_cc - K_cf K_ff^-1 K_fc without fixed
// nodes, and the field has the energy of this matrix.
TEST(Homogenize, CondensedIsTheSchurComplement)
{
    Body body(size, box, {{5000, 0.45, 900, false}, {1e5, 0.3, 1800, false}},
              [](int i, int j, int k) { return (i / 5 + j / 3 + k / 4) % 2; });
    body.scene.element.kind = PLIANT_HEXAHEDRA;
    body.scene.model.method = PLIANT_AVERAGED;
    body.cells(1, 1, 1, 2);
    body.fix_plane(0, 0, 0, 0, 0, 1);
    ASSERT_EQ(body.build(), PLIANT_OK) << pliant_last_error();
    const pliant_mesh &fine = body.model->body->fine, &coarse = body.model->body->coarse;
    std::vector<int32_t> all(static_cast<size_t>(fine.num_tets)), cube_of_tet(all.size());
    std::vector<uint8_t> fixed(static_cast<size_t>(fine.num_nodes));
    fixed[static_cast<size_t>(fine.node_of_lattice[1 + 3 * (1 + 3 * 2)])] = 1; // in the middle of the top
    pliant_cube *cubes = nullptr;
    std::vector<pliant_cube_shape> shapes(2);
    int32_t count = 0;
    ASSERT_EQ(pliant_cubes_find(&fine, false, &cubes, &count), PLIANT_OK);
    ASSERT_EQ(count, 8);
    for (size_t t = 0; t < all.size(); t++) all[t] = static_cast<int32_t>(t);
    for (int32_t c = 0; c < count; c++) {
        const int parity = pliant_cell_parity(&fine, fine.lattice_of_tet[cubes[c].tet[0]] / 5);
        pliant_cube_integrate(&fine, cubes + c, parity, &shapes[static_cast<size_t>(parity)]);
        for (int32_t tet : cubes[c].tet) cube_of_tet[static_cast<size_t>(tet)] = c;
    }
    pliant_submesh *submesh = nullptr;
    ASSERT_EQ(
        pliant_submesh_create(&fine, &coarse, fixed.data(), body.model->body->fine_material, fine.num_tets, &submesh),
        PLIANT_OK);
    for (int corners : {4, 8}) {
        submesh->cubes = corners == 8 ? cubes : nullptr;
        submesh->cube_of_tet = cube_of_tet.data();
        submesh->shapes = shapes.data();
        ASSERT_EQ(pliant_submesh_load(submesh, fine.num_tets, all.data()), PLIANT_OK);
        const int n = 3 * corners, unknowns = 3 * submesh->num_nodes;
        std::vector<int32_t> corner(static_cast<size_t>(corners));
        for (int v = 0; v < corners; v++) corner[v] = pliant_submesh_corner(submesh, corners == 8 ? v : coarse.tets[v]);
        std::vector<double> k(static_cast<size_t>(n * n)), shape(static_cast<size_t>(unknowns * n));
        ASSERT_TRUE(pliant_submesh_condense(submesh, corners, corner.data(), k.data(), shape.data()));
        using Matrix = Eigen::MatrixXd;
        using Rows = Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor>;
        const Matrix whole = Eigen::Map<const Rows>(submesh->stiffness, unknowns, unknowns),
                     found = Eigen::Map<const Rows>(k.data(), n, n),
                     field = Eigen::Map<const Rows>(shape.data(), unknowns, n);
        std::vector<int> outer, inner;
        for (int32_t c : corner)
            for (int d = 0; d < 3; d++) outer.push_back(3 * c + d);
        for (int i = 0; i < unknowns; i++)
            if (!fixed[static_cast<size_t>(submesh->node[i / 3])] &&
                std::find(corner.begin(), corner.end(), i / 3) == corner.end())
                inner.push_back(i);
        auto part = [&](const std::vector<int> &rows, const std::vector<int> &columns) {
            Matrix out(rows.size(), columns.size());
            for (size_t r = 0; r < rows.size(); r++)
                for (size_t c = 0; c < columns.size(); c++) out(r, c) = whole(rows[r], columns[c]);
            return out;
        };
        const Matrix answer = algebra::solve(part(inner, inner), part(inner, outer)),
                     expected = part(outer, outer) - algebra::product(part(outer, inner), answer),
                     energy = algebra::product(field.transpose(), algebra::product(whole, field));
        EXPECT_LT((found - expected).norm(), 1e-9 * expected.norm()) << corners;
        EXPECT_LT((energy - expected).norm(), 1e-9 * expected.norm()) << corners;
    }
    pliant_submesh_free(submesh);
    pliant_free(cubes);
}

// A material with negative energy for expansion. Its submeshes and their condensed matrices are not positive
// semidefinite.
TEST(Homogenize, AnIndefiniteElementIsRefused)
{
    for (pliant_method method : methods) {
        Body body(size, box, {{5000, 0.45, 900, false}});
        prepare(body, method);
        ASSERT_EQ(body.build(), PLIANT_OK) << pliant_last_error();
        const pliant_body *of = body.model->body;
        std::vector<pliant_tet_material> fine(of->fine_material, of->fine_material + of->fine.num_tets);
        const std::vector<pliant_tet_material> none(static_cast<size_t>(of->coarse.num_tets));
        const int32_t wrong = of->coarse.num_tets - 1;
        for (int32_t t = 0; t < of->fine.num_tets; t++)
            if (of->coarse_of_fine[t] == wrong) fine[t].lambda = -0.75 * fine[t].mu;
        pliant_system system{};
        system.mesh = &of->coarse;
        system.fine = &of->fine;
        system.num_threads = 1;
        ASSERT_EQ(pliant_system_build_tetrahedra(&system, none.data(), nullptr, nullptr), PLIANT_OK);
        EXPECT_EQ(pliant_homogenize(&system, &body.scene, &of->fine, of->fine_fixed, fine.data(), of->coarse_of_fine,
                                    {nullptr, nullptr}),
                  PLIANT_ERROR_NUMERIC)
            << "method " << method;
        const std::string message = pliant_last_error();
        EXPECT_NE(message.find("coarse tetrahedron " + std::to_string(wrong)), std::string::npos) << message;
        EXPECT_NE(message.find("positive semidefinite"), std::string::npos) << message;
        pliant_system_clear(&system);
    }
}

// [H] 11: the derivative of a fine node's position with respect to a corner, at constant rotation, is R N_v R'.
TEST(Homogenize, TheWeightOfACornerIsTheDerivativeOfAPosition)
{
    std::mt19937 random(11);
    std::uniform_real_distribution<double> unit(-1, 1);
    // it keeps rigid motions: the corner blocks sum to the identity
    Eigen::Matrix<double, 3, 12, Eigen::RowMajor> shape;
    shape.setZero();
    for (int v = 0; v < 4; v++)
        for (int m = 0; m < 9 && v < 3; m++) shape(m / 3, 3 * v + m % 3) = unit(random);
    shape.block<3, 3>(0, 9) =
        Eigen::Matrix3d::Identity() - shape.block<3, 3>(0, 0) - shape.block<3, 3>(0, 3) - shape.block<3, 3>(0, 6);
    const Eigen::Matrix<double, 3, 3, Eigen::RowMajor> turn =
        algebra::rotation(0.8, {1, 2, -3});
    double x[12], rest[12], gradients[12] = {}, f[9];
    const double node[3] = {0.2, -0.4, 0.7};
    for (int m = 0; m < 12; m++) rest[m] = unit(random), x[m] = unit(random);
    const auto position = [&] {
        pliant_shaped_frame frame;
        pliant_shaped_find_frame(x, rest, gradients, f, &frame);
        std::copy(turn.data(), turn.data() + 9, frame.rotation);
        Eigen::Vector3d out;
        pliant_shaped_position(&frame, x, rest, shape.data(), node, out.data());
        return out;
    };
    const double step = 1e-3; // positions are linear in the corners
    for (int v = 0; v < 4; v++) {
        double weight[9];
        pliant_shaped_weight(turn.data(), shape.data(), 4, v, weight);
        for (int d = 0; d < 3; d++) {
            const Eigen::Vector3d before = position();
            x[3 * v + d] += step;
            const Eigen::Vector3d slope = (position() - before) / step;
            x[3 * v + d] -= step;
            for (int r = 0; r < 3; r++) EXPECT_NEAR(weight[3 * r + d], slope[r], 1e-10) << "corner " << v;
        }
    }
}

// [H] 2.3: the weights of several elements at a fine node are inversely proportional to the distances from their
// centres.
TEST(Homogenize, SharesAreInverseDistances)
{
    Body body(size, box, {{5000, 0.45, 900, false}, {1e5, 0.3, 1800, false}},
              [](int i, int j, int k) { return (i / 5 + j / 3 + k / 4) % 2; });
    prepare(body, PLIANT_SCHUR);
    ASSERT_EQ(body.build(), PLIANT_OK) << pliant_last_error();
    const pliant_system &system = *body.model->system;
    ASSERT_TRUE(system.upsample && system.upsample->start);
    const pliant_upsample &upsample = *system.upsample;
    const pliant_mesh &fine = body.model->body->fine;
    int shared = 0;
    for (int32_t n = 0; n < fine.num_nodes; n++) {
        std::vector<double> distance;
        double sum = 0, whole = 0;
        for (int32_t e = upsample.start[n]; e < upsample.start[n + 1]; e++) {
            double center[3] = {0, 0, 0};
            for (int v = 0; v < 12; v++)
                center[v % 3] +=
                    system.mesh->rest[3 * system.mesh->tets[4 * upsample.entry_element[e] + v / 3] + v % 3] / 4;
            const double apart = std::hypot(std::hypot(fine.rest[3 * n] - center[0], fine.rest[3 * n + 1] - center[1]),
                                            fine.rest[3 * n + 2] - center[2]);
            distance.push_back(std::fmax(apart, 1e-3 * fine.cell_size[0])); // a node may be at a centre
            sum += 1 / distance.back();
            whole += upsample.entry_weight[e];
        }
        if (distance.empty()) continue;
        EXPECT_NEAR(whole, 1, 1e-12);
        for (size_t e = 0; e < distance.size(); e++) {
            EXPECT_NEAR(upsample.entry_weight[static_cast<size_t>(upsample.start[n]) + e], 1 / distance[e] / sum, 1e-12)
                << "node " << n;
            shared += std::fabs(distance[e] - distance[0]) > 1e-3;
        }
    }
    EXPECT_GT(shared, 50);
}

} // namespace
