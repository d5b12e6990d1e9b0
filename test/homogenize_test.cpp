// Homogenized stiffness of coarse tetrahedra: positive semidefinite, or refused with a message.
#include "fem/coarse/submesh.h"
#include "pipeline/body.h"
#include "pliant/memory.h"

#include <Eigen/Dense>

#include <algorithm>
#include <string>

namespace {

const int size[3] = {24, 24, 24};
const double box[3] = {0.12, 0.12, 0.12};
const pliant_method methods[] = {PLIANT_SCHUR, PLIANT_AVERAGED, PLIANT_CALIBRATED};

void prepare(Body &body, pliant_method method)
{
    body.scene.model.method = method;
    body.cells(3, 3, 3, 2);
    body.fix_plane(0, 0, 0, 0, 0, 1);
}

TEST(Homogenize, ElementsArePositiveSemidefinite)
{
    for (pliant_method method : methods) {
        Body body(size, box, {{5000, 0.45, 900, false}, {1e6, 0.3, 1800, false}}, [](int i, int j, int k) { return (i / 5 + j / 3 + k / 4) % 2; });
        prepare(body, method);
        ASSERT_EQ(body.build(), PLIANT_OK) << pliant_last_error();
        const pliant_system *system = body.model->system;
        for (int32_t t = 0; t < system->mesh->num_tets; t++) {
            const Eigen::Map<const Eigen::Matrix<double, 12, 12>> k(system->stiffness + 144 * static_cast<size_t>(t));
            const Eigen::SelfAdjointEigenSolver<Eigen::Matrix<double, 12, 12>> eigen(k);
            EXPECT_GT(eigen.eigenvalues()(0), -1e-9 * eigen.eigenvalues()(11)) << "method " << method << ", tetrahedron " << t;
        }
    }
}

// Fine tetrahedra or hexahedra on four or eight nodes: K_cc - K_cf K_ff^-1 K_fc, with what is fixed left out, and the field that has that energy.
TEST(Homogenize, CondensedIsTheSchurComplement)
{
    Body body(size, box, {{5000, 0.45, 900, false}, {1e5, 0.3, 1800, false}}, [](int i, int j, int k) { return (i / 5 + j / 3 + k / 4) % 2; });
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
    ASSERT_EQ(pliant_submesh_create(&fine, &coarse, fixed.data(), body.model->body->fine_material, fine.num_tets, &submesh), PLIANT_OK);
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
        typedef Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor> Matrix;
        const Eigen::Map<const Matrix> whole(submesh->stiffness, unknowns, unknowns), found(k.data(), n, n), field(shape.data(), unknowns, n);
        std::vector<int> outer, inner;
        for (int32_t c : corner)
            for (int d = 0; d < 3; d++) outer.push_back(3 * c + d);
        for (int i = 0; i < unknowns; i++)
            if (!fixed[static_cast<size_t>(submesh->node[i / 3])] && std::find(corner.begin(), corner.end(), i / 3) == corner.end()) inner.push_back(i);
        auto part = [&](const std::vector<int> &rows, const std::vector<int> &columns) {
            Matrix out(rows.size(), columns.size());
            for (size_t r = 0; r < rows.size(); r++)
                for (size_t c = 0; c < columns.size(); c++) out(r, c) = whole(rows[r], columns[c]);
            return out;
        };
        const Matrix answer = part(inner, inner).ldlt().solve(part(inner, outer)), expected = part(outer, outer) - part(outer, inner) * answer;
        EXPECT_LT((found - expected).norm(), 1e-9 * expected.norm()) << corners;
        EXPECT_LT((field.transpose() * whole * field - expected).norm(), 1e-9 * expected.norm()) << corners;
    }
    pliant_submesh_free(submesh);
    pliant_free(cubes);
}

// Tissue that gives energy away when it expands: its submeshes are no longer positive semidefinite, and what they are condensed to is not.
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
        ASSERT_EQ(pliant_system_elements(&system, none.data(), nullptr, nullptr), PLIANT_OK);
        EXPECT_EQ(pliant_homogenize(&system, &body.scene, &of->fine, of->fine_fixed, fine.data(), of->coarse_of_fine, {nullptr, nullptr}),
                  PLIANT_ERROR_NUMERIC) << "method " << method;
        const std::string message = pliant_last_error();
        EXPECT_NE(message.find("coarse tetrahedron " + std::to_string(wrong)), std::string::npos) << message;
        EXPECT_NE(message.find("positive semidefinite"), std::string::npos) << message;
        pliant_system_clear(&system);
    }
}

} // namespace
