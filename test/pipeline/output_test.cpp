// Output quantities: stress, energy, volume, inversion, clearance, upsampled positions.
#include "algebra.h"
#include "body.h"
#include "fem/element/scalar.h"

namespace {

const int size[3] = {16, 16, 16};
const double box[3] = {0.08, 0.08, 0.08};

struct Output : testing::Test {
    Body body{size, box, {{6000, 0.2, 1000, false}}};
    std::vector<double> moved;
    void build(const double a[9])
    {
        body.cells(2, 2, 2, 2);
        body.fix_plane(0, 0, 0, 0, 0, 1);
        ASSERT_EQ(body.build(), PLIANT_OK) << pliant_last_error();
        const double b[3] = {0.1, -0.2, 0.3};
        moved = affine(body.model->body->fine, a, b);
    }
    std::vector<float> scalar(pliant_scalar which)
    {
        std::vector<float> out(body.model->body->fine.num_nodes);
        EXPECT_EQ(pliant_data_scalar(body.model, body.data->body, moved.data(), which, out.data()), PLIANT_OK);
        return out;
    }
};

// Uniaxial strain s along z with a rotation: lambda and mu from E = 6000, nu = 0.2: 1666.7 and 2500 Pa. The von Mises
// stress of diag(lambda s, lambda s, (lambda + 2 mu) s) is 2 mu s; the energy density is (lambda + 2 mu) s^2 / 2.
TEST_F(Output, UniaxialStrainUnderATurn)
{
    const double s = 0.05, lambda = 6000 * 0.2 / (1.2 * 0.6), mu = 2500;
    Eigen::Matrix3d stretch = Eigen::Vector3d(1, 1, 1 + s).asDiagonal(),
                    turn = algebra::rotation(1.1, {1, 2, 3});
    Eigen::Matrix<double, 3, 3, Eigen::RowMajor> a = turn * stretch;
    build(a.data());
    for (float v : scalar(PLIANT_SCALAR_VON_MISES)) EXPECT_NEAR(v, 2 * mu * s, 1e-3);
    for (float v : scalar(PLIANT_SCALAR_STRAIN_ENERGY)) EXPECT_NEAR(v, 0.5 * (lambda + 2 * mu) * s * s, 1e-4);
    for (float v : scalar(PLIANT_SCALAR_VOLUME_RATIO)) EXPECT_NEAR(v, 1 + s, 1e-6);
    EXPECT_EQ(pliant_mesh_inverted(&body.model->body->fine, moved.data()), 0);
}

TEST_F(Output, InvertedElementsAreCounted)
{
    const double mirror[9] = {1, 0, 0, 0, 1, 0, 0, 0, -1};
    build(mirror);
    EXPECT_EQ(pliant_mesh_inverted(&body.model->body->fine, moved.data()), body.model->body->fine.num_tets);
}

TEST_F(Output, ClearanceOfABox)
{
    const double identity[9] = {1, 0, 0, 0, 1, 0, 0, 0, 1};
    build(identity);
    int tool;
    ASSERT_EQ(pliant_tool_add(body.model, body.data, "t", &tool), PLIANT_OK);
    EXPECT_TRUE(std::isinf(pliant_tool_clearance(body.model, body.data, tool)));
    const double cases[5][4] = {{0.04, 0.04, 0.1, 0.02},
                                {0.04, 0.04, 0.07, -0.01},
                                {0.11, 0.12, 0.04, 0.05},
                                {0.09, 0.09, 0.09, 0.01 * std::sqrt(3.0)},
                                {0.04, 0.04, 0.04, -0.04}};
    for (const auto &c : cases) {
        ASSERT_EQ(pliant_tool_set_pose(body.data, tool, c, nullptr), PLIANT_OK);
        EXPECT_NEAR(pliant_tool_clearance(body.model, body.data, tool), c[3], 1e-9);
    }
}

// The skin ends within elements. Clearance is the distance to the skin, which contact uses, not to the border of the
// elements.
TEST(Clearance, EqualsTheDistanceToTheSurfaceWithinElements)
{
    const int voxels[3] = {20, 20, 20};
    const double edge[3] = {0.1, 0.1, 0.1};
    for (pliant_element_kind kind : {PLIANT_LINEAR, PLIANT_HEXAHEDRA})
        for (pliant_cut_kind cut : {PLIANT_CUT_NONE, PLIANT_CUT_SEVER})
            for (int layers : {12, 13, 14}) {
                Body body(voxels, edge, {{5000, 0.3, 1000, false}, {10, 0, 1, true}},
                          [&](int, int, int k) { return k < layers ? 0 : 1; });
                body.cells(4, 4, 4, 1);
                body.scene.element.kind = kind;
                body.scene.cut.kind = cut;
                body.fix_plane(0, 0, 1e-4, 0, 0, 1);
                ASSERT_EQ(body.build(), PLIANT_OK) << pliant_last_error();
                int tool;
                ASSERT_EQ(pliant_tool_add(body.model, body.data, "t", &tool), PLIANT_OK);
                const double skin = 0.005 * layers;
                for (double height : {0.01, 0.0002, -0.0002, -0.01}) {
                    const double tip[3] = {0.052, 0.047, skin + height};
                    ASSERT_EQ(pliant_tool_set_pose(body.data, tool, tip, nullptr), PLIANT_OK);
                    EXPECT_NEAR(pliant_tool_clearance(body.model, body.data, tool), height, 1e-9)
                        << layers << " layers";
                }
                // the skin follows a stretch of ten percent along z
                for (int32_t n = 0; n < body.data->body->fine.num_nodes; n++) body.data->positions[3 * n + 2] *= 1.1;
                const double tip[3] = {0.052, 0.047, 1.1 * skin + 0.01};
                ASSERT_EQ(pliant_tool_set_pose(body.data, tool, tip, nullptr), PLIANT_OK);
                EXPECT_NEAR(pliant_tool_clearance(body.model, body.data, tool), 0.01, 1e-9) << layers << " layers";
            }
}

// A ball of 35 mm in elements of 5 mm and voxels of 1 mm. Surface corners stay at their nodes if the skin is farther
// away than the shortest edge of a cube. The error is below one element on either side.
TEST(Clearance, OfABallIsTheDistanceToItsSurface)
{
    const int voxels[3] = {100, 100, 100};
    const double edge[3] = {0.1, 0.1, 0.1}, radius = 0.035;
    Body body(voxels, edge, {{5000, 0.3, 1000, false}, {10, 0, 1, true}}, [&](int i, int j, int k) {
        return std::hypot(std::hypot(0.001 * i - 0.0495, 0.001 * j - 0.0495), 0.001 * k - 0.0495) < radius ? 0 : 1;
    });
    body.cells(20, 20, 20, 1);
    body.fix_plane(0, 0, 0.03, 0, 0, 1);
    ASSERT_EQ(body.build(), PLIANT_OK) << pliant_last_error();
    int tool;
    ASSERT_EQ(pliant_tool_add(body.model, body.data, "t", &tool), PLIANT_OK);
    double worst = 0;
    for (int n = 0; n < 100; n++) {
        const double z = (n + 0.5) / 50 - 1, turn = 2.4 * n, flat = std::sqrt(1 - z * z),
                     out[3] = {flat * std::cos(turn), flat * std::sin(turn), z};
        for (double height : {0.01, -0.01}) {
            double tip[3];
            for (int d = 0; d < 3; d++) tip[d] = 0.05 + (radius + height) * out[d];
            ASSERT_EQ(pliant_tool_set_pose(body.data, tool, tip, nullptr), PLIANT_OK);
            worst = std::fmax(worst, std::fabs(pliant_tool_clearance(body.model, body.data, tool) - height));
        }
    }
    std::printf("clearance of a ball: error up to %.3f mm\n", 1e3 * worst);
    EXPECT_LT(worst, 0.005);
}

// A fixed region between coarse nodes fixes the coarse mesh too, through the nearest nodes.
TEST(CoarseMesh, IsHeldByFixedTissueBetweenItsNodes)
{
    Body body(size, box, {{6000, 0.2, 1000, false}});
    body.scene.model.method = PLIANT_COARSE;
    body.cells(2, 2, 2, 4);
    pliant_fixed_box &fixed = body.scene.fixed.boxes[body.scene.fixed.num_boxes++];
    fixed = {{0.005, 0.005, 0.005}, {0.035, 0.035, 0.035}}; // coarse nodes are at multiples of 0.04
    ASSERT_EQ(body.build(), PLIANT_OK) << pliant_last_error();
    body.data->gravity[2] = -1;
    EXPECT_EQ(body.settle(), PLIANT_OK);
}

// An affine map of the coarse positions gives the same map of every free fine node, for every upsampling method.
TEST_F(Output, UpsamplingKeepsRigidMotion)
{
    Eigen::Matrix<double, 3, 3, Eigen::RowMajor> a = algebra::rotation(0.8, {0, 1, 0});
    const double b[3] = {0.02, 0.03, -0.01};
    for (pliant_method method : {PLIANT_COARSE, PLIANT_AVERAGED, PLIANT_SCHUR, PLIANT_LOD}) {
        Body coarse(size, box, {{6000, 0.2, 1000, false}});
        coarse.scene.model.method = method;
        coarse.cells(3, 3, 3, 3);
        coarse.fix_plane(0, 0, 0, 0, 0, 1);
        ASSERT_EQ(coarse.build(), PLIANT_OK);
        const pliant_mesh &fine = coarse.model->body->fine;
        std::vector<double> up(3 * fine.num_nodes), expected = affine(fine, a.data(), b);
        pliant_upsample_positions(coarse.model->system, affine(coarse.model->body->coarse, a.data(), b).data(),
                                  up.data());
        for (int32_t n = 0; n < fine.num_nodes; n++)
            if (fine.rest[3 * n + 2] > 0.03) // grounded elements do not rotate
                for (int d = 0; d < 3; d++)
                    EXPECT_NEAR(up[3 * n + d], expected[3 * n + d], 1e-9) << "method " << method;
    }
}

} // namespace
