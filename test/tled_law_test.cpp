// Strain energies, elements and damping of explicit dynamics against closed forms.
#include "fem/dynamics/loss_factor.h"
#include "fem/element/scalar.h"
#include "mesh/mesh.h"
#include "tled_bars.h"

#include <complex>

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
        Matrix turned = algebra::rotation(1.3, {1, 2, 3});
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
        double largest = algebra::eigenvalues(k)[11];
        EXPECT_NEAR(volume * pliant_element_largest_eigenvalue(g, m.lambda, m.mu), largest, 1e-9 * largest);
    }
}

TEST(Tled, SmallStrainsGiveTheCorotationalAnswer)
{
    Bar quiet(3, 6, 0.06, {5e3, 0.4, 1000, false}), corotational(3, 6, 0.06, {5e3, 0.4, 1000, false});
    for (Bar *bar : {&quiet, &corotational}) {
        bar->scene.model.gravity[0] = 0.02;
        bar->scene.model.gravity[2] = -0.02;
    }
    corotational.scene.solver.kind = PLIANT_COROTATIONAL;
    quiet.scene.tled.quasi_static = true;
    quiet.scene.tled.relaxation_steps = 2000;
    quiet.scene.solver.tolerance = 1e-4; // at so small a load, single precision leaves 3e-5
    ASSERT_EQ(quiet.build(), PLIANT_OK) << pliant_last_error();
    ASSERT_EQ(corotational.build(), PLIANT_OK);
    ASSERT_EQ(quiet.settle(), PLIANT_OK) << quiet.data->statistics.residual;
    ASSERT_EQ(corotational.settle(), PLIANT_OK);
    double maximum = 0, difference = 0;
    for (int32_t n = 0; n < 3 * quiet.model->body->fine.num_nodes; n++) {
        maximum =
            std::fmax(maximum, std::fabs(corotational.data->positions[n] - corotational.model->body->fine.rest[n]));
        difference = std::fmax(difference, std::fabs(corotational.data->positions[n] - quiet.data->positions[n]));
    }
    EXPECT_LT(difference, 2e-3 * maximum);
}

TEST_P(EveryKind, ShearStressRelaxesAsThePronySeriesSays)
{
    Bar bar(2, 2, 0.02, {5e3, 0.3, 1000, false});
    bar.scene.tled.prony_share[0] = 0.4;
    bar.scene.tled.prony_time[0] = 0.05;
    bar.scene.tled.prony_share[2] = 0.2;
    bar.scene.tled.prony_time[2] = 0.5;
    ASSERT_EQ(bar.build(), PLIANT_OK) << pliant_last_error();
    Matrix shear = Matrix::Identity();
    shear(0, 2) = 0.01;
    put(bar, shear);
    const double mu = moduli(5e3, 0.3).mu, dt = 1e-4, force_at_once = mu * 0.01 * 0.02 * 0.02;
    bar.data->tled->time_step = dt;
    for (int s = 1; s <= 6000; s++) {
        std::vector<double> force = nodal_forces(bar);
        if (s % 250) continue;
        double t = s * dt, part = 1 - 0.4 * (1 - std::exp(-t / 0.05)) - 0.2 * (1 - std::exp(-t / 0.5)), sum = 0;
        for (int32_t n = 0; n < bar.model->body->fine.num_nodes; n++)
            if (bar.model->body->fine.rest[3 * n + 2] > 0.02 - 1e-6) sum += force[3 * n];
        EXPECT_NEAR(sum, part * force_at_once, 1e-3 * force_at_once) << t;
    }
}

// The hourglass mode has +-1 in all three axes, with amplitude a along one axis. The deviatoric energy of the trilinear
// field, averaged over the axes, is V mu a^2 20/81 (1/h_x^2 + 1/h_y^2 + 1/h_z^2). A corner's force is the derivative of
// this energy, divided among the eight corners.
TEST(Tled, AHexahedronsTwistCostsTheDeviatoricEnergyOfItsTrilinearField)
{
    const int size[3] = {2, 2, 2};
    const double box[3] = {0.01, 0.012, 0.008}, amplitude = 1e-6;
    Body one(size, box, {{3000, 0.45, 1000, false}});
    one.scene.element.kind = PLIANT_HEXAHEDRA;
    one.scene.solver.kind = PLIANT_TLED;
    one.cells(1, 1, 1, 1);
    one.fix_plane(0, 0, 1e-6, 0, 0, 1);
    ASSERT_EQ(one.build(), PLIANT_OK) << pliant_last_error();
    const pliant_mesh &mesh = one.model->body->fine;
    ASSERT_EQ(mesh.num_nodes, 8);
    double volume = 1, squares = 0;
    for (int d = 0; d < 3; d++) {
        volume *= mesh.cell_size[d];
        squares += 1 / (mesh.cell_size[d] * mesh.cell_size[d]);
    }
    const double expected = volume * moduli(3000, 0.45).mu * amplitude * 40.0 / 81 * squares / 8;
    std::vector<double> sign(8, 1);
    for (int32_t n = 0; n < 8; n++)
        for (int d = 0; d < 3; d++)
            sign[static_cast<size_t>(n)] *= mesh.rest[3 * n + d] > mesh.corner[d] + 0.5 * mesh.cell_size[d] ? 1 : -1;
    for (int along = 0; along < 3; along++) {
        for (int32_t n = 0; n < 8; n++) one.data->tled->u[3 * n + along] = amplitude * sign[static_cast<size_t>(n)];
        const std::vector<double> force = nodal_forces(one);
        for (int32_t n = 0; n < 8; n++) {
            one.data->tled->u[3 * n + along] = 0;
            EXPECT_NEAR(force[3 * static_cast<size_t>(n) + static_cast<size_t>(along)],
                        sign[static_cast<size_t>(n)] * expected, 1e-3 * expected)
                << n;
        }
    }
}

double deflection(double poisson, bool nodal)
{
    Bar bar(3, 12, 0.08, {5e3, poisson, 1000, false});
    bar.scene.model.gravity[0] = 0.3;
    bar.scene.tled.nodal_pressure = nodal;
    bar.scene.tled.quasi_static = true;
    bar.scene.tled.relaxation_steps = 4000;
    bar.scene.solver.tolerance = 1e-2; // single precision leaves 1e-7 of lambda in the pressures
    EXPECT_EQ(bar.build(), PLIANT_OK) << pliant_last_error();
    EXPECT_EQ(bar.settle(30), PLIANT_OK) << bar.data->statistics.residual;
    double sum = 0;
    for (int32_t n = 0; n < bar.model->body->fine.num_nodes; n++)
        if (bar.model->body->fine.rest[3 * n + 2] > 0.08 - 1e-6)
            sum += (bar.data->positions[3 * n] - bar.model->body->fine.rest[3 * n]) / 16;
    return sum;
}

// A uniaxial stretch e of a homogeneous bar has the stress (lambda + 2 mu) e, with nodal pressures and with element
// pressures.
TEST(Tled, NodalPressureOfAUniformStretchIsThatOfTheMaterial)
{
    for (double poisson : {0.3, 0.49}) {
        Bar bar(2, 4, 0.04, {5e3, poisson, 1000, false});
        bar.scene.tled.nodal_pressure = true;
        ASSERT_EQ(bar.build(), PLIANT_OK) << pliant_last_error();
        const double stretch = 1e-4;
        Matrix f = Matrix::Identity();
        f(2, 2) += stretch;
        put(bar, f);
        const std::vector<double> force = nodal_forces(bar);
        double sum = 0;
        for (int32_t n = 0; n < bar.model->body->fine.num_nodes; n++)
            if (bar.model->body->fine.rest[3 * n + 2] > 0.04 - 1e-6) sum += force[3 * static_cast<size_t>(n) + 2];
        const Moduli m = moduli(5e3, poisson);
        const double expected = (m.lambda + 2 * m.mu) * stretch * 0.02 * 0.02;
        EXPECT_NEAR(sum, expected, 2e-3 * expected) << "nu " << poisson;
    }
}

TEST(Tled, NodalPressureUnlocks)
{
    // The deflection of a slender bar depends on its Young's modulus only, so the loss towards 0.499 is locking. On so
    // coarse a mesh, nodal pressures recover a third of the loss.
    double plain = deflection(0.3, false), locked = deflection(0.499, false), nodal = deflection(0.499, true);
    RecordProperty("locked", std::to_string(locked / plain));
    RecordProperty("nodal", std::to_string(nodal / plain));
    EXPECT_LT(locked, 0.75 * plain);
    EXPECT_GT(nodal, 0.78 * plain);
}

// A clamped beam that gravity sets swinging, with or without a weight at its tip, from the turning points of the tip.
struct Swing { double frequency, ratio, sag; };

Swing swing_of_beam(double poisson, double mass, double by_mass, double by_stiffness, double loss = 0)
{
    const double step = 0.002, at[3] = {0.015, 0.015, 0.095}, none[3] = {0, 0, 0};
    Beam body(PLIANT_LINEAR, poisson, 3, 0.5);
    body.scene.solver.kind = PLIANT_TLED;
    body.scene.solver.step = step;
    body.scene.tled.damping = by_mass;
    body.scene.tled.stiffness_damping = by_stiffness;
    body.scene.tled.loss_factor = loss;
    body.scene.grasp.radius = 0.012;
    EXPECT_EQ(body.build(), PLIANT_OK) << pliant_last_error();
    int tool;
    EXPECT_EQ(pliant_tool_add(body.model, body.data, "weight", &tool), PLIANT_OK);
    EXPECT_EQ(pliant_tool_grasp(body.model, body.data, tool, at), PLIANT_OK);
    EXPECT_EQ(pliant_tool_set_drive(body.data, tool, PLIANT_DRIVE_FORCE, none), PLIANT_OK);
    EXPECT_EQ(pliant_tool_set_mass(body.data, tool, mass), PLIANT_OK);
    std::vector<double> y{0, 0, 0}, times, values;
    for (int s = 0; s < 500 && times.size() < 8; s++) {
        EXPECT_EQ(pliant_step(body.model, body.data), PLIANT_OK) << pliant_last_error();
        y = {y[1], y[2], body.data->tools[tool].held_point[1]};
        if (s < 2 || (y[1] - y[0]) * (y[2] - y[1]) >= 0) continue;
        const double bend = 0.5 * (y[2] + y[0]) - y[1], slope = 0.5 * (y[2] - y[0]); // a parabola
        times.push_back(step * (s - slope / (2 * bend)));
        values.push_back(y[1] - slope * slope / (4 * bend));
    }
    EXPECT_EQ(times.size(), 8u);
    double fall = std::log(std::fabs((values[0] - values[1]) / (values[6] - values[7]))) / 6;
    return {3 / (times[7] - times[1]), fall / std::sqrt(M_PI * M_PI + fall * fall),
            0.015 - 0.25 * (values[5] + 2 * values[6] + values[7])};
}

// Without volumetric stiffness, all stiffness contributes to the damping.
TEST(Tled, DampingOfShearIsProportionalToTheFrequency)
{
    const double seconds = 2e-3;
    const Swing shear = swing_of_beam(0, 0, 0, seconds);
    EXPECT_NEAR(shear.ratio, M_PI * shear.frequency * seconds, 0.02 * shear.ratio);
}

// Damping proportional to stiffness, fitted to the beam alone, is also right with a weight: its ratio is proportional
// to the frequency. Damping proportional to mass has the inverse relation. The weight has the inertia of its mass. By
// Dunkerley, 1 / w^2 is the sum of the beam's value and of mass over stiffness. The latter is the sag divided by
// gravity.
TEST(Tled, DampingAndMassTransferFromTheBeamAloneToOneWithAWeight)
{
    const double seconds = 2e-3, weight = 0.05;
    Swing alone = swing_of_beam(0.45, 0, 0, seconds), hung = swing_of_beam(0.45, weight, 0, seconds);
    std::printf("beam alone %.2f Hz, ratio %.4f; with 50 g %.2f Hz, ratio %.4f\n", alone.frequency, alone.ratio,
                hung.frequency, hung.ratio);
    // the rest is volumetric stiffness of tetrahedra that lock
    EXPECT_NEAR(alone.ratio, 0.9 * M_PI * alone.frequency * seconds, 0.05 * alone.ratio);
    EXPECT_NEAR(hung.ratio / alone.ratio, hung.frequency / alone.frequency, 0.02);
    EXPECT_LT(hung.frequency, 0.7 * alone.frequency);
    auto period = [](const Swing &swing) { return 1 / (4 * M_PI * M_PI * swing.frequency * swing.frequency); };
    EXPECT_NEAR(period(hung), period(alone) + (hung.sag - alone.sag) / 0.5, 0.03 * period(hung));
    Swing by_mass = swing_of_beam(0.45, 0, 5, 0), by_mass_hung = swing_of_beam(0.45, weight, 5, 0);
    EXPECT_NEAR(by_mass.ratio, 5 / (4 * M_PI * by_mass.frequency), 0.02 * by_mass.ratio);
    EXPECT_GT(by_mass.frequency, by_mass_hung.frequency);
}

// The Prony series of a loss factor against the closed form of its complex modulus, over the band.
TEST(Tled, PronyTermsHaveTheirLossFactorOverTheBand)
{
    const double bands[][2] = {{1, 100}, {2, 20}, {0.5, 10}, {7, 9}, {5, 5}};
    for (const auto &band : bands)
        for (double factor : {0.02, 0.1, 0.3}) {
            double fraction[PLIANT_PRONY_TERMS], time[PLIANT_PRONY_TERMS], sum = 0;
            const int count = pliant_loss_terms(factor, band[0], band[1], fraction, time);
            ASSERT_GE(count, 2);
            for (int i = 0; i < count; i++) sum += fraction[i];
            ASSERT_LT(sum, 1);
            for (int f = 0; f <= 50; f++) {
                const double w = 2 * M_PI * band[0] * std::pow(band[1] / band[0], f / 50.0);
                std::complex<double> modulus = 1;
                for (int i = 0; i < count; i++) modulus -= fraction[i] / std::complex<double>(1, w * time[i]);
                EXPECT_NEAR(modulus.imag() / modulus.real(), factor, 0.08 * factor) << w / (2 * M_PI) << " Hz";
            }
        }
}

// A loss factor gives the same damping ratio, half of it, at the frequencies of a beam without and with a weight.
// Stiffness-proportional damping would give a ratio proportional to the frequency. The static modulus
// determines the sag.
TEST(Tled, ALossFactorTransfersFromTheBeamAloneToOneWithAWeight)
{
    const double loss = 0.106, weight = 0.1;
    const Swing alone = swing_of_beam(0, 0, 0, 0, loss), hung = swing_of_beam(0, weight, 0, 0, loss),
                elastic = swing_of_beam(0, 0, 0, 0);
    std::printf("alone %.2f Hz, ratio %.4f; with %g g %.2f Hz, ratio %.4f; elastic %.2f Hz\n", alone.frequency,
                alone.ratio, 1e3 * weight, hung.frequency, hung.ratio, elastic.frequency);
    EXPECT_LT(hung.frequency, 0.6 * alone.frequency);
    for (const Swing &swing : {alone, hung}) // the fit is good to 8 %; creep adds to the first turning points
        EXPECT_NEAR(swing.ratio, 0.5 * loss, 0.1 * 0.5 * loss);
    EXPECT_NEAR(alone.sag, elastic.sag, 0.03 * elastic.sag);
}

// Nearly incompressible tissue under ten times gravity has very different stiff and soft modes. It converges in a tenth
// of 300,000 sub-steps. With damping by Rayleigh's quotient alone, 300,000 sub-steps do not converge. The hexahedra
// rotate by 45 degrees, where volume changes in single precision have an error of four times the tolerance.
TEST(Tled, RelaxesNearlyIncompressibleTissueUnderALargeLoad)
{
    for (int which = 0; which < 3; which++) {
        const bool nodal = which == 1;
        Beam beam(which == 2 ? PLIANT_HEXAHEDRA : PLIANT_LINEAR, 0.499, 3, 98.1);
        beam.scene.solver.kind = PLIANT_TLED;
        beam.scene.solver.tolerance = 1e-3;
        beam.scene.tled.quasi_static = true;
        beam.scene.tled.nodal_pressure = nodal;
        beam.scene.tled.relaxation_steps = 40000;
        ASSERT_EQ(beam.build(), PLIANT_OK) << pliant_last_error();
        EXPECT_EQ(pliant_step(beam.model, beam.data), PLIANT_OK) << beam.data->statistics.residual;
        EXPECT_LT(beam.data->positions[3 * (beam.model->body->fine.num_nodes - 1) + 1], 0);
    }
}

} // namespace
