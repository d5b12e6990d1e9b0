#include "grids.h"
#include "model_data/data.h"
#include "pliant/ros/convert.h"
#include "topology/visible_surface.h"

#include <Eigen/Geometry>
#include <gtest/gtest.h>
#include <tf2_eigen/tf2_eigen.h>

#include <cmath>
#include <cstring>
#include <limits>
#include <set>

using namespace pliant_ros;

namespace {

geometry_msgs::PoseStamped pose(double x, double y, double z)
{
    geometry_msgs::PoseStamped out;
    out.header.stamp = ros::Time(10);
    out.header.frame_id = "base";
    out.pose.position.x = x;
    out.pose.position.y = y;
    out.pose.position.z = z;
    out.pose.orientation.w = 1;
    return out;
}

TEST(Convert, RotationAgreesWithRodrigues)
{
    const double axis[3] = {2.0 / 7, 3.0 / 7, 6.0 / 7}, v[3] = {0.3, -1.2, 2.5};
    for (double angle : {0.0, 0.4, 2.0, 3.1, -1.0}) {
        double s = std::sin(angle / 2), q[4] = {s * axis[0], s * axis[1], s * axis[2], std::cos(angle / 2)};
        double m[9], turned[3];
        rodrigues(axis, angle, m);
        rotate(q, v, turned);
        for (int i = 0; i < 3; ++i)
            EXPECT_NEAR(turned[i], m[3 * i] * v[0] + m[3 * i + 1] * v[1] + m[3 * i + 2] * v[2], 1e-12);
    }
}

TEST(Convert, InverseUndoesAMotion)
{
    Rigid motion = {{1, -2, 3}, {0.5, -0.5, 0.5, 0.5}};
    Rigid both = multiply(motion, inverse(motion));
    for (int i = 0; i < 3; ++i) EXPECT_NEAR(both.translation[i], 0, 1e-15);
    EXPECT_NEAR(std::fabs(both.rotation[3]), 1, 1e-15);
}

TEST(Convert, ToolPose)
{
    Rigid out;
    std::string why;
    ASSERT_TRUE(tool_pose_from_message(pose(1, 2, 3), &out, &why));
    EXPECT_DOUBLE_EQ(out.translation[2], 3);
}

TEST(Convert, InvalidToolPosesAreRefusedWithAReason)
{
    Rigid out;
    geometry_msgs::PoseStamped stamp = pose(0, 0, 0), number = pose(0, nan_value, 0), turn = pose(0, 0, 0);
    geometry_msgs::PoseStamped frame = pose(0, 0, 0);
    stamp.header.stamp = ros::Time();
    turn.pose.orientation.w = 0;
    frame.header.frame_id = "";
    geometry_msgs::PoseStamped infinite = pose(0, 0, 0);
    infinite.pose.orientation.x = std::numeric_limits<double>::infinity();
    for (const auto &message : {stamp, number, turn, frame, infinite}) {
        std::string why;
        EXPECT_FALSE(tool_pose_from_message(message, &out, &why));
        EXPECT_FALSE(why.empty());
    }
}

TEST(Convert, Jaw)
{
    sensor_msgs::JointState message;
    double angle = 7;
    std::string why;
    EXPECT_FALSE(jaw_from_message(message, &angle, &why));
    message.header.stamp = ros::Time(1);
    EXPECT_FALSE(jaw_from_message(message, &angle, &why));
    message.position.push_back(nan_value);
    EXPECT_FALSE(jaw_from_message(message, &angle, &why));
    EXPECT_DOUBLE_EQ(angle, 7);
    message.position[0] = 0.3;
    EXPECT_TRUE(jaw_from_message(message, &angle, &why));
    EXPECT_DOUBLE_EQ(angle, 0.3);
}

TEST(Convert, GeometryThereAndBack)
{
    const double axis[3] = {2.0 / 7, 3.0 / 7, 6.0 / 7};
    for (double angle : {0.0, 0.3, M_PI / 2, 3.0, M_PI, -2.0})
        for (bool left_handed : {false, true}) {
            double direction[9];
            rodrigues(axis, angle, direction);
            if (left_handed)
                for (int row = 0; row < 3; ++row) direction[3 * row + 2] = -direction[3 * row + 2];
            pliant_geometry in = geometry(direction), out{};
            geometry_msgs::Pose origin;
            geometry_msgs::Vector3 spacing;
            bool flipped;
            std::string why;
            geometry_to_message(in, &origin, &flipped, &spacing);
            EXPECT_EQ(flipped, left_handed);
            const uint32_t size[3] = {4, 5, 6};
            ASSERT_TRUE(geometry_from_message(size, origin, flipped, spacing, &out, &why)) << why;
            for (int i = 0; i < 9; ++i) EXPECT_NEAR(out.direction[i], in.direction[i], 1e-9);
            for (int i = 0; i < 3; ++i) {
                EXPECT_EQ(out.size[i], in.size[i]);
                EXPECT_DOUBLE_EQ(out.origin[i], in.origin[i]);
                EXPECT_DOUBLE_EQ(out.spacing[i], in.spacing[i]);
            }
        }
}

TEST(Convert, BrokenGeometryIsRefused)
{
    geometry_msgs::Pose origin;
    geometry_msgs::Vector3 spacing;
    spacing.x = spacing.y = spacing.z = 0.001;
    const uint32_t size[3] = {4, 5, 6}, flat[3] = {4, 0, 6};
    pliant_geometry out;
    std::string why;
    EXPECT_FALSE(geometry_from_message(size, origin, false, spacing, &out, &why)) << "no quaternion";
    origin.orientation.w = 1;
    EXPECT_TRUE(geometry_from_message(size, origin, false, spacing, &out, &why));
    EXPECT_FALSE(geometry_from_message(flat, origin, false, spacing, &out, &why));
    spacing.y = nan_value;
    EXPECT_FALSE(geometry_from_message(size, origin, false, spacing, &out, &why));
}

class ConvertModel : public ::testing::Test {
protected:
    void SetUp() override
    {
        body.fine.num_nodes = 4;
        body.fine.num_tets = 1;
        body.fine.rest = rest;
        body.fine.tets = tets;
        surface.body = &body;
        surface.triangle = triangles;
        surface.num_triangles = surface.first_cut = 4;
        body.fine_material = &material;
        model.body = &body;
        material.material = 7;
    }
    double rest[12] = {0, 0, 0, 0.1, 0, 0, 0, 0.1, 0, 0, 0, 0.1};
    int32_t tets[4] = {0, 1, 2, 3}, triangles[12] = {0, 2, 1, 0, 1, 3, 0, 3, 2, 1, 2, 3};
    pliant_tet_material material{};
    pliant_body body{};
    pliant_surface surface{};
    pliant_model model{};
};

TEST_F(ConvertModel, Topology)
{
    MeshTopology message;
    topology_message(surface, &message);
    EXPECT_EQ(message.rest_nodes.size(), 12u);
    EXPECT_FLOAT_EQ(message.rest_nodes[11], 0.1f);
    EXPECT_EQ(message.tetrahedra, (std::vector<uint32_t>{0, 1, 2, 3}));
    EXPECT_EQ(message.triangles.size(), 12u);
    EXPECT_EQ(message.material, std::vector<uint16_t>(1, 7));
    EXPECT_EQ(message.rest_parent, (std::vector<uint32_t>{0, 1, 2, 3}));
}

TEST_F(ConvertModel, StateWithoutScalar)
{
    MeshState message;
    EXPECT_EQ(mesh_state_message(model, body, rest, pliant_model_get_scene(&model)->output.scalar, {}, &message),
              PLIANT_OK);
    EXPECT_EQ(message.nodes.size(), 12u);
    EXPECT_TRUE(message.scalar.empty());
    EXPECT_TRUE(message.scalar_name.empty());
}

TEST_F(ConvertModel, MarkerIsColouredByDisplacement)
{
    double moved[12];
    std::memcpy(moved, rest, sizeof rest);
    moved[9] += 0.02; /* node 3 along x */
    visualization_msgs::Marker marker;
    marker_message(surface, moved, {}, &marker);
    ASSERT_EQ(marker.points.size(), 12u);
    ASSERT_EQ(marker.colors.size(), 12u);
    EXPECT_DOUBLE_EQ(marker.points[5].x, 0.02);
    EXPECT_GT(marker.colors[5].r, 4 * marker.colors[5].b) << "moved most: red";
    EXPECT_GT(marker.colors[0].b, 1.5f * marker.colors[0].r) << "at rest: blue";
}

TEST_F(ConvertModel, MarkerIsLightInFrontAndDarkBehind)
{
    visualization_msgs::Marker marker;
    marker_message(surface, rest, {}, &marker);
    EXPECT_GT(marker.colors[3].b, marker.colors[0].b) << "the second triangle faces -y, the first -z";
    EXPECT_GT(marker.colors[0].b, 0);
}

TEST_F(ConvertModel, PointsCarryDisplacementAndScalar)
{
    sensor_msgs::PointCloud2 cloud;
    points_message(body, rest, {1, 2, 3, 4}, &cloud);
    ASSERT_EQ(cloud.fields.size(), 5u);
    EXPECT_EQ(cloud.width, 4u);
    ASSERT_EQ(cloud.data.size(), 4u * 20);
    float row[5];
    std::memcpy(row, &cloud.data[20], 20);
    EXPECT_FLOAT_EQ(row[0], 0.1f);
    EXPECT_FLOAT_EQ(row[3], 0);
    EXPECT_FLOAT_EQ(row[4], 2);
}

TEST(Convert, DisplacementsOfTissueAreACloud)
{
    float vectors[9] = {0, 0, 0, 0.1f, 0.2f, 0.3f, -0.1f, 0, 0};
    uint8_t mask[3] = {PLIANT_MASK_NO_TISSUE, PLIANT_MASK_TISSUE, PLIANT_MASK_CUT};
    pliant_displacement field = {{{1, 1, 3}, {1, 2, 3}, {0.1, 0.1, 0.5}, {1, 0, 0, 0, 1, 0, 0, 0, 1}}, vectors, mask};
    sensor_msgs::PointCloud2 cloud;
    displacement_message(field, &cloud);
    ASSERT_EQ(cloud.fields.size(), 7u);
    EXPECT_EQ(cloud.fields[5].name, "dz");
    EXPECT_EQ(cloud.fields[6].offset, 24u);
    ASSERT_EQ(cloud.width, 2u);
    ASSERT_EQ(cloud.data.size(), 2u * 28);
    EXPECT_EQ(cloud.row_step, 56u);
    float row[14];
    std::memcpy(row, cloud.data.data(), 56);
    const float wanted[14] = {1, 2, 3.5f, 0.1f, 0.2f, 0.3f, 0, 1, 2, 4, -0.1f, 0, 0, 1};
    for (int n = 0; n < 14; ++n) EXPECT_FLOAT_EQ(row[n], wanted[n]) << n;
}

TEST(Convert, WrenchIsTurnedIntoTheFrameOfThePose)
{
    /* the frame is rotated by a quarter turn about z: the tissue's x is its y */
    const double frame_from_tissue[4] = {0, 0, M_SQRT1_2, M_SQRT1_2}, force[3] = {2, 0, 1}, torque[3] = {0, 3, 0};
    geometry_msgs::WrenchStamped message;
    wrench_message(force, torque, frame_from_tissue, &message);
    EXPECT_NEAR(message.wrench.force.x, 0, 1e-15);
    EXPECT_NEAR(message.wrench.force.y, 2, 1e-15);
    EXPECT_NEAR(message.wrench.force.z, 1, 1e-15);
    EXPECT_NEAR(message.wrench.torque.x, -3, 1e-15);
    EXPECT_NEAR(message.wrench.torque.y, 0, 1e-15);
}

TEST(Convert, AForceThatIsNotFiniteBecomesZero)
{
    const double turn[4] = {0, 0, 0, 1}, force[3] = {1, nan_value, 0};
    geometry_msgs::WrenchStamped message;
    wrench_message(force, turn, turn, &message);
    EXPECT_EQ(message.wrench.force.x, 0);
    EXPECT_EQ(message.wrench.force.y, 0);
    EXPECT_EQ(message.wrench.torque.x, 0);
}

TEST(Convert, ContactOfAMissingTool)
{
    pliant_tool_state tool{};
    std::strcpy(tool.name, "grasper");
    ContactState message;
    contact_message(tool, std::numeric_limits<double>::infinity(), {}, &message);
    EXPECT_EQ(message.tool, "grasper");
    EXPECT_FALSE(message.present);
    EXPECT_FALSE(message.touching);
    EXPECT_TRUE(std::isinf(message.clearance));
    tool.present = tool.holding = true;
    tool.num_held = 3;
    pliant_contact pressed{};
    pressed.place[0] = 0.1;
    pressed.normal[1] = -1;
    pressed.force[1] = -2;
    pressed.area = 0.25;
    contact_message(tool, -0.01, {pressed}, &message);
    EXPECT_TRUE(message.touching);
    EXPECT_TRUE(message.grasped);
    EXPECT_EQ(message.held_nodes, 3u);
    ASSERT_EQ(message.points.size(), 1u);
    EXPECT_EQ(message.points[0].x, 0.1);
    EXPECT_EQ(message.normals[0].y, -1);
    EXPECT_EQ(message.forces[0].y, -2);
    EXPECT_EQ(message.areas[0], 0.25f);
    contact_message(tool, -0.01, {}, &message);
    EXPECT_TRUE(message.points.empty());
    contact_message(tool, 0.002, {pressed}, &message);
    EXPECT_TRUE(message.touching) << "the tip stays outside where the shape presses";
}

TEST(Convert, ContactHasTheProxyOfATool)
{
    const double half = std::sqrt(0.5);
    pliant_tool_state tool{};
    std::strcpy(tool.name, "probe");
    tool.present = tool.has_proxy = tool.saturated = true;
    const double turned[4] = {half, 0, 0, half}, measured[4] = {0, 0, 0, 1};
    std::copy(turned, turned + 4, tool.proxy_rotation);
    std::copy(measured, measured + 4, tool.rotation);
    for (int d = 0; d < 3; ++d) {
        tool.tip[d] = 0.1 * (d + 1);
        tool.proxy_error[d] = 0.001 * (d + 1);
        tool.proxy_tip[d] = tool.tip[d] - tool.proxy_error[d];
    }
    tool.jaw_error = -0.25;
    tool.contact_force_error = 0.125;
    ContactState message;
    contact_message(tool, 1, {}, &message);
    EXPECT_DOUBLE_EQ(message.proxy.position.x, 0.099);
    EXPECT_DOUBLE_EQ(message.proxy.position.z, 0.297);
    EXPECT_DOUBLE_EQ(message.proxy.orientation.x, half);
    EXPECT_DOUBLE_EQ(message.proxy.orientation.y, 0);
    EXPECT_DOUBLE_EQ(message.proxy.orientation.w, half);
    EXPECT_DOUBLE_EQ(message.proxy_error.x, 0.001);
    EXPECT_DOUBLE_EQ(message.proxy_error.y, 0.002);
    EXPECT_DOUBLE_EQ(message.proxy_error.z, 0.003);
    EXPECT_NEAR(message.proxy_angle, std::acos(-1) / 2, 1e-6);
    EXPECT_FLOAT_EQ(message.jaw_error, -0.25f);
    EXPECT_FLOAT_EQ(message.contact_force_error, 0.125f);
    EXPECT_TRUE(message.saturated);
    tool.saturated = false;
    for (double &each : tool.proxy_rotation) each = -each; // the same rotation
    std::copy(tool.proxy_rotation, tool.proxy_rotation + 4, tool.rotation);
    contact_message(tool, 1, {}, &message);
    EXPECT_NEAR(message.proxy_angle, 0, 1e-6);
    EXPECT_FALSE(message.saturated);
}

TEST(Convert, TimingHasLegsAndProxies)
{
    pliant_statistics statistics{};
    statistics.iterations = 6;
    statistics.legs = 3;
    statistics.advanced = 0.25;
    statistics.proxy_error = 0.004;
    StepTiming message;
    timing_message(statistics, &message);
    EXPECT_EQ(message.evaluations, 6u);
    EXPECT_EQ(message.legs, 3u);
    EXPECT_EQ(message.advanced, 0.25f);
    EXPECT_EQ(message.max_proxy_error, 0.004f);
    for (const auto &end : {std::make_pair(PLIANT_STEP_END_NONE, +StepTiming::NONE),
                            std::make_pair(PLIANT_STEP_END_BLOCKED, +StepTiming::BLOCKED),
                            std::make_pair(PLIANT_STEP_END_FORCE_LIMIT, +StepTiming::FORCE_LIMIT),
                            std::make_pair(PLIANT_STEP_END_ELEMENTS, +StepTiming::ELEMENTS)}) {
        statistics.ended = end.first;
        timing_message(statistics, &message);
        EXPECT_EQ(message.ended, end.second);
    }
}

TEST(Convert, ContactHasTheGraspedPoint)
{
    pliant_tool_state tool{};
    ContactState message;
    tool.present = tool.holding = true;
    for (int d = 0; d < 3; ++d) {
        tool.tip[d] = 1 + d;
        tool.held_point[d] = 0.1 * (1 + d); /* behind the tip, so that the spring between them is stretched */
    }
    contact_message(tool, 0, {}, &message);
    EXPECT_TRUE(message.touching) << "the surface is reached at 0";
    EXPECT_EQ(message.held_point.x, tool.held_point[0]);
    EXPECT_EQ(message.held_point.y, tool.held_point[1]);
    EXPECT_EQ(message.held_point.z, tool.held_point[2]);
    tool.holding = false;
    contact_message(tool, 1e-6, {}, &message);
    EXPECT_FALSE(message.touching);
    EXPECT_EQ(message.held_nodes, 0u);
    EXPECT_EQ(message.held_point.x, 0);
}

TEST(Convert, CutIsTurnedIntoTheTissueFrame)
{
    CutLine::Request request;
    request.points.resize(2);
    request.points[1].x = 1;
    request.depth.x = 0.02;
    const CutInput cut = cut_from_message(request, {{0, 0, 5}, {0, 0, M_SQRT1_2, M_SQRT1_2}}); /* x becomes y */
    ASSERT_EQ(cut.points.size(), 2u);
    const double expected[2][3] = {{0, 0, 5}, {0, 1, 5}};
    for (size_t p = 0; p < 2; ++p) {
        EXPECT_NEAR(cut.points[p].x, expected[p][0], 1e-15);
        EXPECT_NEAR(cut.points[p].y, expected[p][1], 1e-15);
        EXPECT_NEAR(cut.points[p].z, expected[p][2], 1e-15);
    }
    EXPECT_NEAR(cut.depth.x, 0, 1e-15) << "a way is turned, not moved";
    EXPECT_NEAR(cut.depth.y, 0.02, 1e-15);
    EXPECT_NEAR(cut.depth.z, 0, 1e-15);
}

TEST(Convert, APickIsReturnedInTheFrameOfTheRequest)
{
    pliant_picked picked{};
    Pick::Response response;
    picked.hit = true;
    picked.distance = 0.25;
    picked.tetrahedron = 7;
    picked.intensity = 42;
    for (int d = 0; d < 3; ++d) picked.point[d] = 1 + d, picked.rest[d] = 10 + d;
    for (int v = 0; v < 4; ++v) picked.barycentric[v] = 0.1 * (v + 1);
    pick_message(picked, {{0, 0, 5}, {0, 0, M_SQRT1_2, M_SQRT1_2}}, &response); /* x becomes y, y becomes -x */
    EXPECT_TRUE(response.success);
    EXPECT_NEAR(response.point.x, -2, 1e-12);
    EXPECT_NEAR(response.point.y, 1, 1e-12);
    EXPECT_NEAR(response.point.z, 8, 1e-12);
    EXPECT_EQ(response.rest.y, 11) << "rest is of the tissue";
    EXPECT_EQ(response.distance, 0.25);
    EXPECT_EQ(response.tetrahedron, 7u);
    EXPECT_EQ(response.intensity, 42);
    for (size_t v = 0; v < 4; ++v) EXPECT_EQ(response.barycentric[v], picked.barycentric[v]);
}

// Moved to the origin of the frame: the torque changes by r x f, and the power of a motion is preserved.
TEST(Convert, TorqueIsAboutAnotherPoint)
{
    const double origin[3] = {0.1, 0.2, 0.3}, tip[3] = {0.1, 0.7, 0.3}, force[3] = {0, 0, 2}, torque[3] = {0.5, 0, 0};
    double about[3];
    torque_about(origin, tip, force, torque, about);
    EXPECT_NEAR(about[0], 1.5, 1e-12);
    EXPECT_NEAR(about[1], 0, 1e-12);
    EXPECT_NEAR(about[2], 0, 1e-12);
}

TEST(Convert, WrenchOfAToolIsThatOfGraspAndContact)
{
    pliant_tool_state tool{};
    double force[3], torque[3];
    tool.force[0] = 1;
    tool.contact_force[0] = 2;
    tool.contact_torque[2] = 3;
    tool_wrench(tool, force, torque);
    EXPECT_EQ(force[0], 2);
    EXPECT_EQ(torque[2], 3);
    for (bool pliant_tool_state::*acts : {&pliant_tool_state::holding, &pliant_tool_state::cutting}) {
        tool.*acts = true; // grasped tissue pulls the tool, and cut tissue resists it
        tool_wrench(tool, force, torque);
        EXPECT_EQ(force[0], 3);
        EXPECT_EQ(torque[2], 3);
        tool.*acts = false;
    }
    tool_wrench(tool, force, torque);
    EXPECT_EQ(force[0], 2);
}

TEST(Convert, ForceArrowStartsAtTheTip)
{
    pliant_tool_state tool{};
    std::strcpy(tool.name, "grasper");
    tool.present = tool.holding = true;
    tool.tip[0] = 0.1;
    tool.force[1] = -4;
    visualization_msgs::MarkerArray markers;
    tool_markers_message(tool, -0.01, std_msgs::Header(), &markers);
    ASSERT_EQ(markers.markers.size(), 2u);
    const visualization_msgs::Marker &arrow = markers.markers[1];
    ASSERT_EQ(arrow.points.size(), 2u);
    EXPECT_EQ(arrow.action, visualization_msgs::Marker::ADD);
    EXPECT_DOUBLE_EQ(arrow.points[0].x, 0.1);
    EXPECT_NEAR(arrow.points[1].y, -0.02, 1e-12);
    tool.force[1] = -1000;
    tool_markers_message(tool, -0.01, std_msgs::Header(), &markers);
    EXPECT_NEAR(markers.markers[1].points[1].y, -0.2, 1e-12);
    tool.holding = false;
    tool_markers_message(tool, -0.01, std_msgs::Header(), &markers);
    EXPECT_EQ(markers.markers[1].action, visualization_msgs::Marker::DELETE);
}

// A capsule along y that opens by half the jaw angle, and a ball at the tip.
TEST(Convert, AShapeIsDrawnAtItsProxyAndAsAGhostWhereItIsMeasured)
{
    pliant_tool_shape shape{};
    shape.num_parts = 3;
    shape.axis[2] = 2; // about z, of any length
    shape.joint[0] = 0.01;
    shape.part[0].kind = PLIANT_PART_CAPSULE;
    shape.part[0].frame = PLIANT_FRAME_JAW_PLUS;
    shape.part[0].radius = 0.002;
    shape.part[0].from[0] = shape.part[0].to[0] = 0.01;
    shape.part[0].to[1] = 0.03;
    shape.part[1].kind = PLIANT_PART_SPHERE;
    shape.part[1].radius = 0.005;
    shape.part[2].kind = PLIANT_PART_BOX;
    shape.part[2].radius = 0.001;
    for (int d = 0; d < 3; ++d) shape.part[2].to[d] = 0.01 * (d + 1);
    pliant_tool_state tool{};
    std::strcpy(tool.name, "forceps");
    tool.present = tool.has_proxy = true;
    tool.tip[2] = 0.1;
    tool.proxy_tip[2] = 0.3;
    tool.rotation[3] = tool.proxy_rotation[3] = 1;
    tool.jaw = std::acos(-1); // half of it rotates the capsule to -x
    std_msgs::Header header;
    header.frame_id = "tissue";
    visualization_msgs::MarkerArray markers;
    shape_markers_message(tool, shape, header, &markers);
    ASSERT_EQ(markers.markers.size(), 8u); // a capsule has two end markers
    std::set<std::pair<std::string, int>> names;
    for (const visualization_msgs::Marker &marker : markers.markers) {
        names.insert({marker.ns, marker.id});
        EXPECT_EQ(marker.header.frame_id, "tissue");
        EXPECT_EQ(marker.color.a, marker.ns == "forceps/measured" ? 0.25f : 1.0f);
        EXPECT_NEAR(marker.lifetime.toSec(), 1, 1e-9);
    }
    EXPECT_EQ(names.size(), 8u);
    const visualization_msgs::Marker &closed = markers.markers[0], &ball = markers.markers[2],
                                     &box = markers.markers[3], &open = markers.markers[4];
    EXPECT_EQ(closed.ns, "forceps/proxy"); // with closed jaws
    EXPECT_EQ(closed.type, visualization_msgs::Marker::CYLINDER);
    EXPECT_NEAR(closed.pose.position.x, 0.01, 1e-12);
    EXPECT_NEAR(closed.pose.position.y, 0.015, 1e-12);
    EXPECT_NEAR(closed.pose.position.z, 0.3, 1e-12);
    EXPECT_NEAR(closed.scale.x, 0.004, 1e-12);
    EXPECT_NEAR(closed.scale.z, 0.03, 1e-12);
    Eigen::Isometry3d pose;
    tf2::fromMsg(closed.pose, pose);
    // a cylinder's own axis is z
    EXPECT_TRUE(Eigen::Vector3d(pose.linear().col(2)).isApprox(Eigen::Vector3d::UnitY(), 1e-12));
    EXPECT_NEAR(ball.scale.x, 0.01, 1e-12);
    EXPECT_NEAR(box.scale.y, 0.022, 1e-12);
    EXPECT_NEAR(box.pose.position.y, 0.01, 1e-12);
    EXPECT_NEAR(open.pose.position.x, 0.01 - 0.015, 1e-12);
    EXPECT_NEAR(open.pose.position.y, 0, 1e-12);
    EXPECT_NEAR(open.pose.position.z, 0.1, 1e-12);
    // a tool without a shape has the tip sphere instead; a tool without a proxy has no such markers
    tool_markers_message(tool, 1, header, &markers);
    EXPECT_EQ(markers.markers[0].action, visualization_msgs::Marker::DELETE);
    tool.has_proxy = false;
    tool_markers_message(tool, 1, header, &markers);
    EXPECT_EQ(markers.markers[0].action, visualization_msgs::Marker::ADD);
    shape_markers_message(tool, shape, header, &markers);
    EXPECT_EQ(markers.markers.size(), 2u);
}

TEST(Convert, RayIsTurnedIntoTheTissueFrame)
{
    Pick::Request request;
    request.origin.x = 1;
    request.direction.x = 1;
    request.far = 2;
    Rigid tissue_from_frame = {{0, 0, 5}, {0, 0, M_SQRT1_2, M_SQRT1_2}};
    pliant_ray ray = ray_from_message(request, tissue_from_frame);
    EXPECT_NEAR(ray.origin[1], 1, 1e-15);
    EXPECT_NEAR(ray.origin[2], 5, 1e-15);
    EXPECT_NEAR(ray.direction[1], 1, 1e-15);
    EXPECT_NEAR(ray.direction[2], 0, 1e-15);
}

TEST(Convert, CamerasLookAlongTheirConvention)
{
    const Rigid frame = {{1, 2, 3}, {0, 0, M_SQRT1_2, M_SQRT1_2}}; // a quarter turn about z: x to y, y to -x
    pliant_camera camera{};
    pliant_camera_of_view(4, 2, 1.0, &camera);
    camera_from_frame(frame, OPTICAL, 0.5, &camera);
    const double optical[12] = {0, -1, 0, 1, 1, 0, 0, 2.5, 0, 0, 1, 3},
                 ambf[12] = {-1, 0, 0, 1, 0, 0, -1, 2, 0, -1, 0, 3};
    for (int n = 0; n < 12; ++n) EXPECT_NEAR(camera.pose[n], optical[n], 1e-15) << n;
    camera_from_frame(frame, AMBF, 0, &camera);
    for (int n = 0; n < 12; ++n) EXPECT_NEAR(camera.pose[n], ambf[n], 1e-15) << n;

    sensor_msgs::CameraInfo info;
    pliant_camera again{};
    EXPECT_FALSE(camera_from_info(info, &again));
    camera_info_message(camera, 0.004, &info);
    EXPECT_DOUBLE_EQ(info.P[3], -0.004 * camera.fx);
    ASSERT_TRUE(camera_from_info(info, &again));
    EXPECT_EQ(again.width, 4);
    EXPECT_DOUBLE_EQ(again.cy, camera.cy);

    const float depth[8] = {1, 1, 1, 2, 1, 1, 1, std::nanf("")};
    const uint8_t rgb[24] = {1, 2, 3};
    sensor_msgs::PointCloud2 cloud;
    camera_points_message(camera, AMBF, rgb, depth, &cloud);
    float point[4];
    std::memcpy(point, &cloud.data[3 * cloud.point_step], sizeof point);
    EXPECT_FLOAT_EQ(point[0], -2);
    EXPECT_FLOAT_EQ(point[1], float(1.5 / camera.fx * 2));
    EXPECT_FLOAT_EQ(point[2], float(0.5 / camera.fx * 2));
    std::memcpy(point, &cloud.data[7 * cloud.point_step], sizeof point);
    EXPECT_TRUE(std::isnan(point[0]));
    EXPECT_EQ(cloud.data[14], 1);
    EXPECT_EQ(cloud.data[12], 3);
}

} // namespace
