// Explicit dynamics against published results: Cook's membrane, and the measured Truth Cube.
#include "algebra.h"
#include "body.h"
#include "fem/dynamics/tled.h"
#include "mesh/mesh.h"

#include <cstdio>
#include <fstream>
#include <sstream>
#include <string>

namespace {

// Recompute all data that depend on the rest positions, which were moved.
void remake(Body &body)
{
    auto *made = const_cast<pliant_discretization *>(body.model->discretization);
    pliant_tled_free(body.data->tled);
    pliant_tled_system_free(made->tled);
    body.data->tled = nullptr;
    made->tled = nullptr;
    ASSERT_EQ(pliant_tled_system_create(&body.scene, body.model->body, nullptr, &made->tled), PLIANT_OK)
        << pliant_last_error();
    body.model->tled = made->tled;
    ASSERT_EQ(pliant_tled_create(&body.scene, made->tled, &body.data->tled), PLIANT_OK) << pliant_last_error();
}

// Cook's membrane as in the deal.II code gallery (Pelteret and McBride 2016): corners (0, 0), (48, 44), (48, 60), (0,
// 44) mm, 1 mm thick, left side fixed, 1 N upwards distributed over the right side. Compressible neo-Hookean, shear
// modulus 422.5 kPa, Poisson's ratio 0.3. Two tip displacements are published, and both are reproduced here, each with
// its set-up:
//   14.74 mm, in the later editions: plane strain, and the tip is the middle of the right side, (48, 52) mm, as in
//             Miehe (1994).
//   14.33 mm, in the earlier ones: the tip is the upper corner, (48, 60) mm, and the body is free to thicken to one
//             side.
// The earlier code selected front and back by x instead of z; here one of them is fixed, so the body stays flat. With
// plane strain the corner rises by 13.77 mm. Return the upward displacement of the right side at its upper corner and
// its middle [mm].
struct Rise {
    double corner, middle;
};
Rise cook(int n, bool plane_strain)
{
    const int size[3] = {2 * n, 2 * n, 2};
    const double box[3] = {1, 1, 1e-3};
    Body body(size, box, {{2 * 422.5e3 * 1.3, 0.3, 1000, false}});
    body.cells(n, n, 1, 1);
    body.fix_plane(1e-9, 0, 0, 1, 0, 0);
    body.scene.solver.kind = PLIANT_TLED;
    body.scene.tled.law = PLIANT_LAW_COMPRESSIBLE;
    body.scene.tled.quasi_static = true;
    body.scene.tled.relaxation_steps = 1;
    EXPECT_EQ(body.build(), PLIANT_OK) << pliant_last_error();
    double *rest = body.model->body->fine.rest;
    int32_t nodes = body.model->body->fine.num_nodes, corner = -1, middle = -1;
    std::vector<int32_t> right, held;
    std::vector<double> fraction;
    for (int32_t v = 0; v < nodes; v++) {
        double s = rest[3 * v], t = rest[3 * v + 1];
        rest[3 * v] = 0.048 * s;
        rest[3 * v + 1] = 0.044 * s + t * (0.044 - 0.028 * s);
        if (plane_strain || rest[3 * v + 2] < 1e-9) held.push_back(v);
        if (s < 1 - 1e-9) continue;
        right.push_back(v);
        fraction.push_back((t < 1e-9 || t > 1 - 1e-9 ? 0.25 : 0.5) / n);
        if (t > 1 - 1e-9) corner = v;
        if (std::fabs(t - 0.5) < 1e-9) middle = v;
    }
    remake(body);
    pliant_tool tool{};
    tool.holding = true;
    tool.drive = PLIANT_DRIVE_FORCE;
    tool.driving_force[1] = 1;
    tool.num_held = static_cast<int32_t>(right.size());
    tool.held = right.data();
    tool.weight = fraction.data();
    pliant_tled *tled = body.data->tled;
    double last = -1;
    // the test fixes sides in z, so their reaction stays in the residual; at rest nothing moves any more
    for (int step = 1; step < 60000; step++) {
        pliant_tled_step(tled, &tool, 1, &body.data->statistics);
        for (int32_t v : held) tled->u[3 * v + 2] = tled->d[3 * v + 2] = 0;
        if (step % 500) continue;
        double now = tled->u[3 * corner + 1];
        if (std::fabs(now - last) < 1e-5 * std::fabs(now)) return {1e3 * now, 1e3 * tled->u[3 * middle + 1]};
        last = now;
    }
    ADD_FAILURE() << "it does not come to rest";
    return {0, 0};
}

TEST(Reference, CooksMembraneConvergesToBothPublishedDisplacements)
{
    const int cells[3] = {12, 24, 48};
    Rise strain[3], thickens[3];
    for (int n = 0; n < 3; n++) {
        strain[n] = cook(cells[n], true);
        thickens[n] = cook(cells[n], false);
        std::printf(
            "Cook's membrane, %d cells an edge: plane strain %.2f mm (middle), %.2f (corner); "
            "free to thicken %.2f (corner)\n",
            cells[n], strain[n].middle, strain[n].corner, thickens[n].corner);
    }
    for (int n = 1; n < 3; n++) { // from below, as expected of elements that are too stiff
        EXPECT_GT(strain[n].middle, strain[n - 1].middle);
        EXPECT_GT(thickens[n].corner, thickens[n - 1].corner);
    }
    EXPECT_LT(strain[2].middle, 14.74);
    EXPECT_LT(thickens[2].corner, 14.33);
    EXPECT_NEAR(strain[2].middle, 14.74, 0.06);
    EXPECT_NEAR(thickens[2].corner, 14.33, 0.06);
    EXPECT_NEAR(strain[2].corner, 13.77, 0.06);
}

struct Bead {
    Eigen::Vector3d at[4]; // positions [m]
};

std::vector<Bead> read_beads(const std::string &path)
{
    std::vector<Bead> beads;
    std::ifstream file(path);
    std::string line;
    while (std::getline(file, line)) {
        std::stringstream words(line);
        double number[15];
        int count = 0;
        char comma;
        while (count < 15 && words >> number[count]) {
            count++;
            words >> comma;
        }
        if (count < 15) continue;
        Bead bead;
        for (int m = 0; m < 12; m++) bead.at[m / 3][m % 3] = 1e-3 * number[3 + m];
        beads.push_back(bead);
    }
    return beads;
}

// Beads in a silicone cube of 80 mm compressed along z between plates (Kerdok et al. 2003): root mean square distance
// from the measured positions. The plates stick to the faces. The pose of the scanner relative to them is unknown, so a
// small rigid motion is removed.
TEST(Reference, TruthCubeBeadsLieWhereTheyWereMeasured)
{
    std::vector<Bead> beads = read_beads(PLIANT_TEST_DATA "/reference/truthcube_uniaxial_positions.csv");
    if (beads.empty()) GTEST_SKIP() << "reference/truthcube_uniaxial_positions.csv is not there";
    ASSERT_EQ(beads.size(), 343u);
    // maxima on this coarse mesh; 0.50, 0.65, 0.79 mm with cells of 5 mm
    const double edge = 0.08, strains[4] = {0, 0.05, 0.125, 0.1825}, maximum[4] = {0, 0.6e-3, 0.8e-3, 1.1e-3};
    Eigen::Vector3d centre = Eigen::Vector3d::Zero();
    for (const Bead &bead : beads) centre += bead.at[0] / 343;
    const int size[3] = {8, 8, 8};
    const double box[3] = {edge, edge, edge};
    Body body(size, box, {{15.3e3, 0.499, 980, false}});
    body.cells(8, 8, 8, 1);
    body.fix_plane(0, 0, 1e-6, 0, 0, 1);
    body.fix_plane(0, 0, edge - 1e-6, 0, 0, -1);
    body.scene.solver.kind = PLIANT_TLED;
    body.scene.tled.quasi_static = true;
    body.scene.tled.nodal_pressure = true;
    body.scene.tled.relaxation_steps = 400;
    ASSERT_EQ(body.build(), PLIANT_OK) << pliant_last_error();
    pliant_tled *tled = body.data->tled;
    const pliant_mesh &mesh = body.model->body->fine;
    for (int state = 1; state < 4; state++) {
        for (int part = 1; part <= 4; part++) {
            double strain = strains[state - 1] + 0.25 * part * (strains[state] - strains[state - 1]);
            // move all nodes at once; then the fixed faces stay and the inner nodes settle
            for (int32_t n = 0; n < mesh.num_nodes; n++)
                tled->u[3 * n + 2] += (edge - mesh.rest[3 * n + 2]) * 0.25 * (strains[state] - strains[state - 1]);
            for (int32_t n = 0; n < mesh.num_nodes; n++)
                if (body.model->body->fine_fixed[n])
                    tled->u[3 * n + 2] = mesh.rest[3 * n + 2] > 0.04 ? 0 : strain * edge;
            ASSERT_GE(pliant_step(body.model, body.data), 0) << pliant_last_error();
        }
        Eigen::MatrixXd rigid(3 * 343, 6); // small translations and rotations
        Eigen::VectorXd apart(3 * 343), moved(3 * 343);
        int row = 0;
        for (const Bead &bead : beads) {
            Eigen::Vector3d rest = bead.at[0] - centre + Eigen::Vector3d::Constant(0.5 * edge),
                            u = Eigen::Vector3d::Zero();
            double weights[4];
            int32_t tet = pliant_mesh_locate(&mesh, rest.data(), weights);
            ASSERT_GE(tet, 0);
            for (int v = 0; v < 4; v++)
                for (int d = 0; d < 3; d++) u[d] += weights[v] * tled->u[3 * mesh.tets[4 * tet + v] + d];
            moved.segment<3>(row) = bead.at[state] - bead.at[0];
            apart.segment<3>(row) = u - moved.segment<3>(row);
            Eigen::Vector3d r = bead.at[0] - centre;
            rigid.middleRows<3>(row) << 1, 0, 0, 0, r[2], -r[1], 0, 1, 0, -r[2], 0, r[0], 0, 0, 1, r[1], -r[0], 0;
            row += 3;
        }
        auto rms = [&](const Eigen::VectorXd &v) {
            return std::sqrt(algebra::remainder(rigid, v).squaredNorm() / 343);
        };
        std::printf("Truth Cube, %.2f %%: rms %.2f mm, of beads that move by rms %.2f mm\n", 100 * strains[state],
                    1e3 * rms(apart), 1e3 * rms(moved));
        EXPECT_LT(rms(apart), maximum[state]);
    }
}

} // namespace
