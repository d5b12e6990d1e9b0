// Distances from rigid parts against dense samples, and the nearest points of edges and triangles.
#include "contact/shapes/shapes.h"
#include "contact/shapes/tool_shape.h"

#include <gtest/gtest.h>

#include <cmath>
#include <random>
#include <vector>

namespace {

using Point = std::vector<double>;

pliant_part sphere() { return {PLIANT_PART_SPHERE, PLIANT_FRAME_TIP, {0.01, -0.02, 0.005}, {0, 0, 0}, 0.008, false}; }
pliant_part capsule()
{
    return {PLIANT_PART_CAPSULE, PLIANT_FRAME_TIP, {0.01, -0.02, 0.005}, {-0.02, 0.01, 0.015}, 0.004, false};
}
pliant_part box()
{
    return {PLIANT_PART_BOX, PLIANT_FRAME_TIP, {-0.01, -0.02, 0.005}, {0.015, -0.005, 0.025}, 0, false};
}
pliant_part round_box()
{
    return {PLIANT_PART_BOX, PLIANT_FRAME_TIP, {-0.01, -0.02, 0.005}, {0.015, -0.005, 0.025}, 0.003, false};
}
pliant_part half_space()
{
    return {PLIANT_PART_HALF_SPACE, PLIANT_FRAME_TIP, {0.001, 0.002, 0.003}, {1, 2, -2}, 0, false};
}

struct Random {
    std::mt19937 engine{7};
    double operator()(double low, double high)
    {
        return low + (high - low) * std::uniform_real_distribution<double>()(engine);
    }
    Point point(double size) { return {(*this)(-size, size), (*this)(-size, size), (*this)(-size, size)}; }
};

double distance_of(const double *a, const double *b)
{
    return std::sqrt(std::pow(a[0] - b[0], 2) + std::pow(a[1] - b[1], 2) + std::pow(a[2] - b[2], 2));
}

// Return the distance by its definition: to samples of the part's core, minus the part's radius.
double outside_of(const pliant_part &part, const double *p)
{
    double minimum = INFINITY;
    const int n = part.kind == PLIANT_PART_CAPSULE ? 4000 : 0;
    for (int s = 0; s <= n; s++) {
        double at[3];
        for (int d = 0; d < 3; d++) {
            at[d] = part.from[d];
            if (n) at[d] += (part.to[d] - part.from[d]) * s / n;
            if (part.kind == PLIANT_PART_BOX) at[d] = std::fmin(std::fmax(p[d], part.from[d]), part.to[d]);
        }
        minimum = std::fmin(minimum, distance_of(p, at));
    }
    return minimum - part.radius;
}

TEST(Shapes, DistancesOutsideAreThoseToTheNearestPoint)
{
    Random random;
    for (const pliant_part &part : {sphere(), capsule(), box(), round_box()})
        for (int n = 0; n < 300; n++) {
            double normal[3];
            const Point p = random.point(0.05);
            const double distance = pliant_part_distance(&part, p.data(), normal);
            if (distance > 0) EXPECT_NEAR(distance, outside_of(part, p.data()), 2e-8);
            else EXPECT_LE(outside_of(part, p.data()), 2e-8);
        }
}

TEST(Shapes, TheNormalIsTheGradientAndLeadsToTheSurface)
{
    Random random;
    const double step = 1e-7;
    for (const pliant_part &part : {sphere(), capsule(), box(), round_box(), half_space()}) {
        int off = 0;
        for (int n = 0; n < 500; n++) {
            const Point p = random.point(0.03);
            double normal[3], there[3], foot[3];
            const double distance = pliant_part_distance(&part, p.data(), normal);
            EXPECT_NEAR(std::sqrt(normal[0] * normal[0] + normal[1] * normal[1] + normal[2] * normal[2]), 1, 1e-12);
            for (int d = 0; d < 3; d++) foot[d] = p[d] - distance * normal[d];
            EXPECT_NEAR(pliant_part_distance(&part, foot, there), 0, 1e-12);
            for (int d = 0; d < 3; d++) {
                Point low = p, high = p;
                low[d] -= step;
                high[d] += step;
                const double slope =
                    (pliant_part_distance(&part, high.data(), there) - pliant_part_distance(&part, low.data(), there)) /
                    (2 * step);
                off += std::fabs(slope - normal[d]) > 1e-4; // on a ridge inside a box the gradient does not exist
            }
        }
        EXPECT_LE(off, 2);
    }
}

TEST(Shapes, JawsGraspByContactByDefault)
{
    pliant_scene scene;
    pliant_scene_defaults(&scene);
    EXPECT_EQ(scene.grasp.kind, PLIANT_GRASP_AUTO);
    pliant_tool_shape jaws, rod, none{}, one_jaw{};
    ASSERT_EQ(pliant_tool_shape_find("prograsp_forceps", &jaws), PLIANT_OK);
    ASSERT_EQ(pliant_tool_shape_find("probe", &rod), PLIANT_OK);
    one_jaw.num_parts = 2;
    one_jaw.part[0] = one_jaw.part[1] = capsule();
    one_jaw.part[1].frame = PLIANT_FRAME_JAW_MINUS;
    const struct {
        const pliant_tool_shape *shape;
        bool jaws;
    } rows[] = {{&jaws, true}, {&one_jaw, true}, {&rod, false}, {&none, false}};
    for (const auto &row : rows) {
        EXPECT_EQ(pliant_tool_shape_has_jaws(row.shape), row.jaws);
        for (const char *kind : {"auto", "blob", "contact"}) {
            ASSERT_EQ(pliant_scene_set(&scene, "grasp/kind", kind), PLIANT_OK) << pliant_last_error();
            const bool holds =
                scene.grasp.kind == PLIANT_GRASP_CONTACT || (scene.grasp.kind == PLIANT_GRASP_AUTO && row.jaws);
            EXPECT_EQ(pliant_tool_shape_holds(&scene, row.shape), holds) << kind;
        }
    }
    EXPECT_EQ(pliant_scene_set(&scene, "grasp/kind", "glue"), PLIANT_ERROR_SCENE);
}

TEST(Shapes, InnerPointsLeaveAlongADirection)
{
    Random random;
    for (const pliant_part &part : {sphere(), capsule(), box(), round_box()})
        for (int n = 0, found = 0; n < 20000 && found < 50; n++) {
            Point p = random.point(0.03), direction = random.point(1);
            double normal[3], out[3],
                size =
                    std::sqrt(direction[0] * direction[0] + direction[1] * direction[1] + direction[2] * direction[2]);
            for (double &v : direction) v /= size;
            if (pliant_part_distance(&part, p.data(), normal) >= 0) continue;
            found++;
            pliant_part_exit_point(&part, p.data(), direction.data(), out);
            EXPECT_NEAR(pliant_part_distance(&part, out, normal), 0, 1e-6);
            double way = 0, off = 0;
            for (int d = 0; d < 3; d++) way += (out[d] - p[d]) * direction[d];
            for (int d = 0; d < 3; d++) off += std::fabs(out[d] - p[d] - way * direction[d]);
            EXPECT_GT(way, 0);
            EXPECT_LT(off, 1e-12);
        }
}

TEST(Shapes, TheNearestPointOfAnEdgeIsThatOfManySamples)
{
    Random random;
    for (const pliant_part &part : {sphere(), capsule(), box(), round_box(), half_space()})
        for (int n = 0; n < 400; n++) {
            const Point a = random.point(0.03), b = random.point(0.03);
            double at[2][3] = {{a[0], a[1], a[2]}, {b[0], b[1], b[2]}}, weight[2], normal[3], there[3],
                   minimum = INFINITY;
            const double found = pliant_edge_minimum(&part, at, 1, weight, normal);
            for (int s = 0; s <= 1000; s++) {
                const double w = s / 1000.0,
                             p[3] = {a[0] + w * (b[0] - a[0]), a[1] + w * (b[1] - a[1]), a[2] + w * (b[2] - a[2])};
                minimum = std::fmin(minimum, pliant_part_distance(&part, p, there));
            }
            const double size = distance_of(at[0], at[1]);
            EXPECT_LT(found, minimum + 2e-4 * size);
            EXPECT_GT(found, minimum - 1e-3 * size); // the minimum may lie between two samples
            EXPECT_NEAR(weight[0] + weight[1], 1, 1e-12);
            double p[3];
            for (int d = 0; d < 3; d++) p[d] = weight[0] * at[0][d] + weight[1] * at[1][d];
            EXPECT_NEAR(pliant_part_distance(&part, p, there), found, 1e-12);
            double along = 0; // inside an edge, the normal is perpendicular to the edge, also at the edges of a box
            for (int d = 0; d < 3; d++) along += normal[d] * (at[1][d] - at[0][d]) / size;
            if (weight[0] > 0 && weight[1] > 0 && part.kind != PLIANT_PART_HALF_SPACE) EXPECT_NEAR(along, 0, 0.02);
        }
}

TEST(Shapes, TheNearestPointOfATriangleIsThatOfManySamples)
{
    Random random;
    for (const pliant_part &part : {sphere(), capsule(), box(), round_box(), half_space()}) {
        double worst = 0;
        for (int n = 0; n < 300; n++) {
            const Point a = random.point(0.03), b = random.point(0.03), c = random.point(0.03);
            double at[3][3] = {{a[0], a[1], a[2]}, {b[0], b[1], b[2]}, {c[0], c[1], c[2]}}, weight[3], normal[3],
                   there[3], p[3], minimum = INFINITY;
            const double found = pliant_face_minimum(&part, at, 1, weight, normal);
            for (int s = 0; s <= 100; s++)
                for (int t = 0; s + t <= 100; t++) {
                    for (int d = 0; d < 3; d++) p[d] = (s * at[0][d] + t * at[1][d] + (100 - s - t) * at[2][d]) / 100;
                    minimum = std::fmin(minimum, pliant_part_distance(&part, p, there));
                }
            const double size =
                std::fmax(distance_of(at[0], at[1]), std::fmax(distance_of(at[1], at[2]), distance_of(at[2], at[0])));
            worst = std::fmax(worst, (found - minimum) / size);
            EXPECT_GT(found, minimum - 0.012 * size);
            EXPECT_GE(std::fmin(weight[0], std::fmin(weight[1], weight[2])), 0);
            for (int d = 0; d < 3; d++) p[d] = weight[0] * at[0][d] + weight[1] * at[1][d] + weight[2] * at[2][d];
            EXPECT_NEAR(pliant_part_distance(&part, p, there), found, 1e-12);
            // inside a triangle, the normal is parallel to the triangle's normal, also at the corners of a box
            for (int e = 1; e < 3; e++) {
                double along = 0;
                for (int d = 0; d < 3; d++) along += normal[d] * (at[e][d] - at[0][d]) / size;
                if (std::fmin(weight[0], std::fmin(weight[1], weight[2])) > 1e-3 && part.kind != PLIANT_PART_HALF_SPACE)
                    EXPECT_NEAR(along, 0, 1e-9);
            }
        }
        std::printf("kind %d: at most %.2e of the triangle's size above the samples' least\n", part.kind, worst);
        EXPECT_LT(worst, 2e-3);
    }
}

TEST(Shapes, ABoundIsReturnedForLargeDistances)
{
    Random random;
    const pliant_part part = capsule();
    for (int n = 0; n < 300; n++) {
        const Point a = random.point(0.1), b = random.point(0.1), c = random.point(0.1);
        double at[3][3] = {{a[0], a[1], a[2]}, {b[0], b[1], b[2]}, {c[0], c[1], c[2]}}, weight[3], normal[3];
        const double edge = pliant_edge_minimum(&part, at, 1, weight, normal),
                     face = pliant_face_minimum(&part, at, 1, weight, normal);
        const double edge_bound = pliant_edge_minimum(&part, at, 0.001, weight, normal),
                     face_bound = pliant_face_minimum(&part, at, 0.001, weight, normal);
        EXPECT_LE(edge_bound, edge);
        EXPECT_LE(face_bound, face + 1e-5);
        if (edge_bound <= 0.001) EXPECT_EQ(edge_bound, edge);
        if (face_bound <= 0.001) EXPECT_EQ(face_bound, face);
    }
}

TEST(Shapes, JawsTurnAboutTheirJointByHalfTheAngle)
{
    pliant_tool_shape shape{};
    shape.joint[2] = -0.01;
    shape.axis[0] = 2;
    const double tip[3] = {1, 2, 3}, quarter[4] = {0, 0, 1, 1}; // about z, not of length 1
    const double angle = 1, end[3] = {0, 0, 0};
    for (int sign : {1, -1}) {
        pliant_pose pose;
        pliant_part_pose(&shape, sign > 0 ? PLIANT_FRAME_JAW_PLUS : PLIANT_FRAME_JAW_MINUS, tip, quarter, angle, &pose);
        double at[3], joint[3], back[3];
        pliant_pose_to(&pose, end, at);
        pliant_pose_to(&pose, shape.joint, joint);
        // about x by half the angle: (0, 0, 0.01) from the joint -> (0, -0.01 sin, 0.01 cos); then about z by a
        // quarter: (x, y) -> (-y, x)
        EXPECT_NEAR(at[0], 1 + sign * 0.01 * std::sin(0.5), 1e-12);
        EXPECT_NEAR(at[1], 2, 1e-12);
        EXPECT_NEAR(at[2], 3 - 0.01 + 0.01 * std::cos(0.5), 1e-12);
        EXPECT_NEAR(joint[2], 2.99, 1e-12);
        pliant_pose_from(&pose, at, back);
        for (double v : back) EXPECT_NEAR(v, 0, 1e-12);
    }
}

TEST(Shapes, ABoxAroundAPartHoldsItsPoints)
{
    Random random;
    for (const pliant_part &part : {sphere(), capsule(), box(), round_box()}) {
        pliant_tool_shape shape{};
        pliant_pose pose;
        const double tip[3] = {0.1, 0.2, 0.3}, rotation[4] = {0.3, -0.5, 0.2, 0.8};
        pliant_part_pose(&shape, PLIANT_FRAME_TIP, tip, rotation, 0, &pose);
        double low[3], high[3], minimum[3] = {1, 1, 1}, maximum[3] = {-1, -1, -1};
        pliant_part_box(&part, &pose, low, high);
        for (int n = 0; n < 100000; n++) {
            const Point p = random.point(0.04);
            double normal[3], at[3], foot[3];
            const double distance = pliant_part_distance(&part, p.data(), normal);
            for (int d = 0; d < 3; d++) foot[d] = p[d] - distance * normal[d];
            pliant_pose_to(&pose, foot, at);
            for (int d = 0; d < 3; d++) {
                minimum[d] = std::fmin(minimum[d], at[d]);
                maximum[d] = std::fmax(maximum[d], at[d]);
            }
        }
        for (int d = 0; d < 3; d++) {
            EXPECT_GE(minimum[d], low[d] - 1e-12);
            EXPECT_LE(maximum[d], high[d] + 1e-12);
            EXPECT_NEAR(minimum[d], low[d], 1e-3);
            EXPECT_NEAR(maximum[d], high[d], 1e-3);
        }
    }
}

// Closed jaws lie side by side with their ends at the tip. Open jaws differ by the angle.
TEST(Shapes, InstrumentsHaveTheirTipsAtTheOrigin)
{
    for (const char *name :
         {"large_needle_driver", "prograsp_forceps", "monopolar_curved_scissors", "maryland_bipolar_forceps",
          "fenestrated_bipolar_forceps", "400049", "420194", "needle_driver", "maryland_dissector", "bowel_grasper",
          "thoracic_grasper", "small_clip_applier", "stapler_45", "permanent_cautery_hook", "permanent_cautery_spatula",
          "probe", "camera"}) {
        pliant_tool_shape shape;
        ASSERT_EQ(pliant_tool_shape_find(name, &shape), PLIANT_OK) << pliant_last_error();
        double foremost = -1, tips[3][2] = {}, minimum = 1;
        const double tip[3] = {0, 0, 0}, rotation[4] = {0, 0, 0, 1};
        for (int32_t p = 0; p < shape.num_parts; p++) {
            char reason[160];
            const pliant_part &part = shape.part[p];
            EXPECT_EQ(pliant_part_check(&part, true, reason, sizeof reason), nullptr) << reason;
            double normal[3];
            minimum = std::fmin(minimum, std::fabs(pliant_part_distance(&part, tip, normal)));
            foremost = std::fmax(foremost, std::fmax(part.from[2], part.to[2]) + part.radius);
            for (int open = 0; open < 2; open++) {
                pliant_pose pose;
                double end[3];
                pliant_part_pose(&shape, part.frame, tip, rotation, open, &pose);
                pliant_pose_to(&pose, part.to, end);
                tips[part.frame][open] = end[1];
            }
        }
        EXPECT_LT(foremost, 0.001) << name;
        EXPECT_LT(minimum, 0.002) << name;
        EXPECT_LE(tips[PLIANT_FRAME_JAW_PLUS][0], tips[PLIANT_FRAME_JAW_MINUS][0]) << name;
        if (tips[PLIANT_FRAME_JAW_PLUS][0] != 0) {
            EXPECT_NEAR(tips[1][1] - tips[1][0], tips[2][0] - tips[2][1], 1e-12) << "alike " << name;
            EXPECT_LT(tips[1][1], tips[1][0] - 0.003) << name;
        }
    }
}

// Names, aliases and codes of all instruments in share/tool/index.json of the dVRK.
TEST(Shapes, InstrumentsGoByTheirNamesAndCodes)
{
    const char *const same[][4] = {
        {"POTTS_SCISSORS", "POTTS_SCISSORS:420001", "400001", "420001"},
        {"SMALL_CLIP_APPLIER", "SMALL_CLIP_APPLIER:400003", "small_clip_applier", "400003"},
        {"LARGE_NEEDLE_DRIVER", "LARGE_NEEDLE_DRIVER:400006", "400006", "large_needle_driver_420006"},
        {"ROUND_TIP_SCISSORS", "ROUND_TIP_SCISSORS_400007", "400007", "420007"},
        {"MICRO_FORCEPS", "BLACK_DIAMOND_MICRO_FORCEPS", "400033", "420033"},
        {"ROUND_TOOTH_FORCEPS", "ROUND_TOOTH_FORCEPS:400035", "400035", "400035"},
        {"DEBAKEY_FORCEPS", "DEBAKEY_FORCEPS:420036", "400036", "420036"},
        {"LONG_TIP_FORCEPS", "LONG_TIP_FORCEPS:400048", "400048", "420048"},
        {"CADIERE_FORCEPS", "CADIERE_FORCEPS:420049", "400049", "420049"},
        {"PROGRASP_FORCEPS", "PROGRASP_FORCEPS:400093", "400093", "420093"},
        {"NEEDLE_DRIVER", "5MM_NEEDLE_DRIVER", "400117", "NEEDLE_DRIVER:420117"},
        {"NEEDLE_DRIVER_420117", "5mm_needle_driver:400117", "needle_driver", "420117"},
        {"BOWEL_GRASPER", "BOWEL_GRASPER:400127", "bowel_grasper", "400127"},
        {"MARYLAND_DISSECTOR", "5MM_MARYLAND_DISSECTOR", "MARYLAND_DISSECTOR:400143", "400143"},
        {"MARYLAND_BIPOLAR_FORCEPS", "BIPOLAR_MARYLAND_FORCEPS", "400172", "420172"},
        {"CURVED_SCISSORS", "CURVED_SCISSORS:400178", "400178", "420178"},
        {"MONOPOLAR_CURVED_SCISSORS", "MONOPOLAR_CURVED_SCISSOR:400179", "400179", "420179"},
        {"RESANO_FORCEPS", "RESANO_FORCEPS:400181", "400181", "420181"},
        {"PERMANENT_CAUTERY_HOOK", "PERMANENT_CAUTERY_HOOK:420183", "400183", "420183"},
        {"PERMANENT_CAUTERY_SPATULA", "PERMANENT_CAUTERY_SPATULA:400184", "400184", "420184"},
        {"DOUBLE_FENESTRATED_GRASPER", "DOUBLE_FENESTRATED_GRASPER:400189", "400189", "400189"},
        {"MEGA_NEEDLE_DRIVER", "MEGA_NEEDLE_DRIVER:400194", "400194", "420194"},
        {"FENESTRATED_BIPOLAR_FORCEPS", "FENESTRATED_BIPOLAR_FORCEPS:420205", "400205", "420205"},
        {"TENACULUM_FORCEPS", "TENACULUM_FORCEPS:400207", "400207", "400207"},
        {"THORACIC_GRASPER", "THORACIC_GRASPER:400208", "thoracic_grasper", "400208"},
        {"LARGE_CLIP_APPLIER", "LARGE_CLIP_APPLIER:400230", "400230", "420230"},
        {"STAPLER_45", "STAPLER_45:410298", "stapler_45_410298", "410298"},
        {"LRG_SUTURECUT_NEEDLE_DRIVER", "LARGE_SUTURECUT_NEEDLEDRIVER:420296", "400296", "420296"},
        {"MEGA_SUTURECUT_NEEDLE_DRIVER", "MEGA_SUTURECUT_NEEDLE_DRIVER:420309", "400309", "420309"},
        {"MEDIUM-LARGE_CLIP_APPLIER", "MEDIUM-LARGE_CLIP_APPLIER:420327", "420327", "420327"}};
    for (const auto &names : same) {
        pliant_tool_shape first;
        ASSERT_EQ(pliant_tool_shape_find(names[0], &first), PLIANT_OK) << pliant_last_error();
        for (const char *name : names) {
            pliant_tool_shape shape;
            ASSERT_EQ(pliant_tool_shape_find(name, &shape), PLIANT_OK) << pliant_last_error();
            ASSERT_EQ(shape.num_parts, first.num_parts) << name;
            for (int32_t p = 0; p < shape.num_parts; p++) {
                EXPECT_EQ(shape.part[p].radius, first.part[p].radius) << name;
                EXPECT_EQ(shape.part[p].from[2], first.part[p].from[2]) << name;
            }
        }
    }
    for (const char *none : {"", "A_SPOON:1", "400006x", "4000", "430006", "410006", "400298", "420298", "410999",
                             "430298", "390117", "STAPLER", "400999", "LARGE_NEEDLE_DRIVERS", "006"}) {
        pliant_tool_shape shape;
        EXPECT_EQ(pliant_tool_shape_find(none, &shape), PLIANT_ERROR_ARGUMENT) << none;
    }
}

// Lengths in the files of share/tool: D of the roll, and from the first joint of the wrist to the tip.
TEST(Shapes, ShaftsAreThoseOfTheirInstruments)
{
    const struct {
        const char *name;
        double thickness, length, behind_tip;
    } published[] = {{"400006", 0.0084, 0.4162, 0.0186},
                     {"400117", 0.0052, 0.4024, 0.0273},
                     {"400143", 0.0052, 0.4024, 0.0371},
                     {"420327", 0.0084, 0.4670, 0.0267},
                     {"410298", 0.0120, 0.4670, 0.0750}};
    for (const auto &of : published) {
        pliant_tool_shape shape;
        ASSERT_EQ(pliant_tool_shape_find(of.name, &shape), PLIANT_OK) << pliant_last_error();
        const pliant_part &shaft = shape.part[shape.num_parts - 1], &wrist = shape.part[shape.num_parts - 2];
        EXPECT_NEAR(2 * shaft.radius, of.thickness, 1e-9) << of.name;
        EXPECT_NEAR(shaft.to[2] - shaft.from[2], of.length, 1e-9) << of.name;
        EXPECT_NEAR(-shaft.to[2], of.behind_tip, 1e-9) << of.name;
        EXPECT_LT(wrist.radius, shaft.radius) << of.name;
        EXPECT_EQ(wrist.to[2], shape.joint[2]) << of.name;
    }
}

TEST(Shapes, InvalidPartsAreRefused)
{
    char reason[160];
    pliant_part part = capsule();
    EXPECT_EQ(pliant_part_check(&part, true, reason, sizeof reason), nullptr);
    part.radius = 1e-6;
    EXPECT_STREQ(pliant_part_check(&part, true, reason, sizeof reason), "it is thinner than 0.1 mm");
    part = capsule();
    part.to[1] = NAN;
    EXPECT_NE(pliant_part_check(&part, true, reason, sizeof reason), nullptr);
    part = box();
    std::swap(part.from[2], part.to[2]);
    EXPECT_STREQ(pliant_part_check(&part, true, reason, sizeof reason),
                 "axis 2: low 0.025 must not be above high 0.005");
    part = half_space();
    EXPECT_EQ(pliant_part_check(&part, false, reason, sizeof reason), nullptr);
    EXPECT_NE(pliant_part_check(&part, true, reason, sizeof reason), nullptr);
}

} // namespace
