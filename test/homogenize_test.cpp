// Homogenized stiffness of coarse tetrahedra: positive semidefinite, or refused with a message.
#include "pipeline/body.h"

#include <Eigen/Dense>

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
        EXPECT_EQ(pliant_homogenize(&system, &body.scene, &of->fine, of->fine_fixed, fine.data(), of->coarse_of_fine, nullptr, {nullptr, nullptr}),
                  PLIANT_ERROR_NUMERIC) << "method " << method;
        const std::string message = pliant_last_error();
        EXPECT_NE(message.find("coarse tetrahedron " + std::to_string(wrong)), std::string::npos) << message;
        EXPECT_NE(message.find("positive semidefinite"), std::string::npos) << message;
        pliant_system_clear(&system);
    }
}

} // namespace
