// Strain energies and elements of explicit dynamics against closed forms.
#include "fem/element/scalar.h"
#include "mesh/mesh.h"
#include "tled_bars.h"

namespace {

INSTANTIATE_TEST_SUITE_P(Kinds, EveryKind, testing::Values(PLIANT_LINEAR, PLIANT_HEXAHEDRA));

TEST(Law, StressIsTheDerivativeOfTheEnergy)
{
    Matrix shapes[4];
    shapes[0] << 1.1, 0.2, -0.1, 0.05, 0.9, 0.15, -0.2, 0.1, 1.2;
    shapes[1] << 0.5, 0.1, 0, 0, 0.6, 0.1, 0.1, 0, 0.7; // J 0.21: below the range of the exact 1 / J
    shapes[2] << -0.8, 0.1, 0, 0.1, 1, 0.2, 0, 0.1, 0.9; // inverted
    shapes[3] = 3 * shapes[0];
    for (pliant_law law : laws)
        for (const Matrix &f : shapes) {
            double stress[9];
            pliant_law_response(law, 2e4, 3e3, f.data(), stress);
            for (int m = 0; m < 9; m++) {
                Matrix up = f, down = f;
                const double step = 1e-5;
                up.data()[m] += step;
                down.data()[m] -= step;
                double slope = (pliant_law_response(law, 2e4, 3e3, up.data(), nullptr) -
                                pliant_law_response(law, 2e4, 3e3, down.data(), nullptr)) /
                               (2 * step);
                EXPECT_NEAR(stress[m], slope, 1e-3 + 2e-6 * std::fabs(slope)) << law << " " << m;
            }
        }
}

TEST(Law, IsHookesAtSmallStrainsAndFreeOfStressWhenTurned)
{
    Moduli m = moduli(5e3, 0.4);
    for (pliant_law law : laws) {
        Matrix strain;
        strain << 2e-6, 1e-6, -1e-6, 1e-6, -3e-6, 2e-6, -1e-6, 2e-6, 1e-6;
        Matrix f = Matrix::Identity() + strain,
               hooke = 2 * m.mu * strain + m.lambda * strain.trace() * Matrix::Identity(), p;
        pliant_law_response(law, m.lambda, m.mu, f.data(), p.data());
        EXPECT_LT((p - hooke).norm(), 2e-5 * hooke.norm());
        Matrix turned = Eigen::AngleAxisd(1.3, Eigen::Vector3d(1, 2, 3).normalized()).toRotationMatrix();
        double energy = pliant_law_response(law, m.lambda, m.mu, turned.data(), p.data());
        EXPECT_LT(p.norm(), 1e-9 * m.mu);
        EXPECT_NEAR(energy, 0, 1e-9 * m.mu);
    }
}

// [C] 10, as printed, for a stretch a along z and b across
double paper_stress(const Moduli &m, double a, double b, bool along)
{
    double j = a * b * b, inverse = along ? 1 / (a * a) : 1 / (b * b);
    return m.mu * (1 - inverse) + m.lambda * j * (j - 1) * inverse;
}

// In homogeneous strain, inner nodes have no force, and outer nodes have P N A. So the sum of f X' is V P.
void check_faces(const Body &body, const Matrix &f, const Matrix &stress, double edge)
{
    put(body, f);
    std::vector<double> force = nodal_forces(body);
    const pliant_mesh &mesh = body.model->body->fine;
    Matrix moment = Matrix::Zero();
    double scale = f.norm() * stress.norm();
    for (int32_t n = 0; n < mesh.num_nodes; n++) {
        Eigen::Map<const Eigen::Vector3d> x(mesh.rest + 3 * n), one(force.data() + 3 * n);
        bool inner = (x.array() > 1e-6).all() && (x.array() < edge - 1e-6).all();
        if (inner) EXPECT_LT(one.norm(), 1e-5 * scale * edge * edge / 16);
        moment += one * x.transpose();
    }
    EXPECT_LT((moment / (edge * edge * edge) - stress).norm(), 1e-5 * scale);
}

TEST_P(EveryKind, UniaxialBiaxialAndShearStressesHaveTheirClosedForms)
{
    const double edge = 0.04;
    const int size[3] = {8, 8, 8};
    const double box[3] = {edge, edge, edge};
    Moduli m = moduli(5e3, 0.45);
    for (pliant_law law : laws) {
        Body body(size, box, {{5e3, 0.45, 1000, false}});
        body.cells(4, 4, 4, 1);
        body.fix_plane(0, 0, 1e-6, 0, 0, 1);
        body.scene.element.kind = kind_of_bars;
        body.scene.solver.kind = PLIANT_TLED;
        body.scene.tled.law = law;
        ASSERT_EQ(body.build(), PLIANT_OK) << pliant_last_error();
        for (double stretch : {0.7, 1.4}) {
            // Find the lateral stretch without lateral stress: the secant method on the closed form.
            double b = 1, old = 1.01, p[9];
            auto side = [&](double across) {
                Matrix f = Eigen::Vector3d(across, across, stretch).asDiagonal();
                pliant_law_response(law, m.lambda, m.mu, f.data(), p);
                return p[0];
            };
            for (int pass = 0; pass < 60 && std::fabs(b - old) > 1e-14; pass++) {
                double slope = (side(b) - side(old)) / (b - old);
                old = b;
                b -= side(b) / slope;
            }
            if (law == PLIANT_LAW_NEO_HOOKEAN) {
                ASSERT_NEAR(paper_stress(m, stretch, b, false), 0, 1e-6);
            }
            Matrix f = Eigen::Vector3d(b, b, stretch).asDiagonal(), stress = Matrix::Zero();
            double axial =
                law == PLIANT_LAW_NEO_HOOKEAN ? stretch * paper_stress(m, stretch, b, true) : (side(b), p[8]);
            stress(2, 2) = axial;
            check_faces(body, f, stress, edge);
        }
        Matrix biaxial = Eigen::Vector3d(1.2, 1.2, 0.75).asDiagonal(), shear = Matrix::Identity(), stress;
        shear(0, 2) = 0.5;
        for (const Matrix &f : {biaxial, shear}) {
            pliant_law_response(law, m.lambda, m.mu, f.data(), stress.data());
            check_faces(body, f, stress, edge);
        }
        if (law == PLIANT_LAW_NEO_HOOKEAN) { // simple shear of [C] 10: P = mu (F - F^-T), so mu times the angle
            EXPECT_NEAR(stress(0, 2), 0.5 * m.mu, 1e-9);
            EXPECT_NEAR(stress(2, 0), 0.5 * m.mu, 1e-9);
        }
    }
}

TEST(Tled, ScalarsAreThoseOfTheLaw)
{
    Bar bar(2, 2, 0.02, {5e3, 0.3, 1000, false});
    ASSERT_EQ(bar.build(), PLIANT_OK);
    const double stretch = 1.2, a[9] = {1, 0, 0, 0, 1, 0, 0, 0, stretch}, b[3] = {0, 0, 0};
    std::vector<double> x = affine(bar.model->body->fine, a, b);
    std::vector<float> out(static_cast<size_t>(bar.model->body->fine.num_nodes));
    Moduli m = moduli(5e3, 0.3);
    // [C] 10: S = mu (1 - 1 / l^2) + lambda l (l - 1) / l^2 along, lambda l (l - 1) across; Cauchy F S F' / J
    double across = m.lambda * (stretch - 1), along = m.mu * (stretch - 1 / stretch) + m.lambda * (stretch - 1);
    auto all = [&](pliant_scalar scalar, double value) {
        ASSERT_EQ(pliant_data_scalar(bar.model, bar.data->body, x.data(), scalar, out.data()), PLIANT_OK);
        for (float v : out) EXPECT_NEAR(v, value, 1e-5 * std::fabs(value)) << scalar;
    };
    all(PLIANT_SCALAR_PRINCIPAL_STRESS, along);
    all(PLIANT_SCALAR_VON_MISES, along - across);
    all(PLIANT_SCALAR_VOLUME_RATIO, stretch);
    double energy = 0.5 * m.mu * (stretch * stretch - 1) - m.mu * std::log(stretch) +
                    0.5 * m.lambda * (stretch - 1) * (stretch - 1);
    all(PLIANT_SCALAR_STRAIN_ENERGY, energy);
    ASSERT_EQ(pliant_data_scalar(bar.model, bar.data->body, x.data(), PLIANT_SCALAR_MASS_CHANGE, out.data()),
              PLIANT_OK);
    const double cell = 1e-6; // of 0.01 m: a third in the central tetrahedron, a sixth in each other
    for (float v : out) {
        EXPECT_GT(v, cell / 6 / stretch * 0.9999);
        EXPECT_LT(v, cell / 3 / stretch * 1.0001);
    }
}

TEST(Tled, LargestEigenvalueOfAnElement)
{
    const double corners[12] = {0, 0, 0, 0.011, 0.001, -0.002, 0.002, 0.013, 0.001, 0.003, -0.002, 0.007};
    double g[12], volume = pliant_tet_gradients(corners, corners + 3, corners + 6, corners + 9, g);
    for (double poisson : {0.0, 0.3, 0.49}) {
        Moduli m = moduli(4e3, poisson);
        Eigen::Matrix<double, 12, 12, Eigen::RowMajor> k;
        pliant_element_stiffness(g, volume * m.lambda, volume * m.mu, k.data());
        double largest = Eigen::SelfAdjointEigenSolver<decltype(k)>(k).eigenvalues().maxCoeff();
        EXPECT_NEAR(volume * pliant_element_largest_eigenvalue(g, m.lambda, m.mu), largest, 1e-9 * largest);
    }
}

} // namespace
