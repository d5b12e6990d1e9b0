// Registration of the tissue by point pairs: exact, measured and degenerate ones; and the file that stores the pose.
#include "ros/node/registration.h"

#include <gtest/gtest.h>

#include <cmath>
#include <limits>

using namespace pliant_ros;

namespace {

using Points = std::vector<geometry_msgs::Point>;

geometry_msgs::Point point(double x, double y, double z)
{
    geometry_msgs::Point out;
    out.x = x, out.y = y, out.z = z;
    return out;
}

// a unit quaternion
const Rigid there{{0.3, -0.2, 0.05}, {0.5 * std::sqrt(0.5), 0.5 * std::sqrt(0.5), -std::sqrt(0.25), std::sqrt(0.5)}};

Points moved(const Points &points, double noise = 0)
{
    Points out;
    unsigned seed = 3;
    for (const geometry_msgs::Point &each : points) {
        const double p[3] = {each.x, each.y, each.z};
        double q[3];
        rotate(there.rotation, p, q);
        for (int d = 0; d < 3; ++d) {
            seed = seed * 1664525u + 1013904223u;
            q[d] += there.translation[d] + noise * (static_cast<double>(seed) / 2147483648.0 - 1);
        }
        out.push_back(point(q[0], q[1], q[2]));
    }
    return out;
}

const Points landmarks{point(0, 0, 0), point(0.1, 0, 0.02), point(0.02, 0.15, 0), point(-0.05, 0.04, 0.12)};

void expect_there(const Rigid &pose, double metres, double radians)
{
    double dot = 0;
    for (int d = 0; d < 3; ++d) EXPECT_NEAR(pose.translation[d], there.translation[d], metres);
    for (int d = 0; d < 4; ++d) dot += pose.rotation[d] * there.rotation[d];
    EXPECT_NEAR(2 * std::acos(std::min(1.0, std::fabs(dot))), 0, radians);
}

TEST(Registration, ExactPairsGiveThePoseBack)
{
    for (size_t count : {3u, 4u}) {
        Rigid pose;
        std::vector<double> errors;
        std::string why;
        const Points some(landmarks.begin(), landmarks.begin() + static_cast<std::ptrdiff_t>(count));
        ASSERT_TRUE(fit_rigid(some, moved(some), &pose, &errors, &why)) << why;
        expect_there(pose, 1e-12, 1e-7);
        ASSERT_EQ(errors.size(), count);
        for (double error : errors) EXPECT_LT(error, 1e-12);
    }
}

TEST(Registration, ReportsTheErrorOfMeasuredPairs)
{
    Rigid pose;
    std::vector<double> errors;
    std::string why;
    ASSERT_TRUE(fit_rigid(landmarks, moved(landmarks, 1e-3), &pose, &errors, &why)) << why;
    expect_there(pose, 2e-3, 0.03);
    double maximum = 0;
    for (double error : errors) maximum = std::max(maximum, error);
    EXPECT_GT(maximum, 1e-4);
    EXPECT_LT(maximum, 2e-3);
}

TEST(Registration, NeverTurnsTheTissueInsideOut)
{
    Points mirrored = landmarks;
    for (geometry_msgs::Point &each : mirrored) each.x = -each.x;
    Rigid pose;
    std::vector<double> errors;
    std::string why;
    // still a rotation, and an error that indicates the mirror image
    ASSERT_TRUE(fit_rigid(landmarks, mirrored, &pose, &errors, &why));
    double square = 0, maximum = 0;
    for (double q : pose.rotation) square += q * q;
    for (double error : errors) maximum = std::max(maximum, error);
    EXPECT_NEAR(square, 1, 1e-12);
    EXPECT_GT(maximum, 0.01);
}

std::string refusal(const Points &tissue, const Points &room, double max_error = 0)
{
    Rigid pose;
    std::vector<double> errors;
    std::string why;
    EXPECT_TRUE(fit_rigid(tissue, room, &pose, &errors, &why)) << why;
    return refusal_of_fit(tissue, room, errors, max_error);
}

Points scaled(const Points &points, double x, double y, double z)
{
    Points out = points;
    for (geometry_msgs::Point &each : out) each.x *= x, each.y *= y, each.z *= z;
    return out;
}

void expect_words(const std::string &text, const std::vector<std::string> &words,
                  const std::vector<std::string> &others)
{
    EXPECT_NE(text.find("refused"), std::string::npos) << text;
    for (const std::string &word : words) EXPECT_NE(text.find(word), std::string::npos) << word << ": " << text;
    for (const std::string &word : others) EXPECT_EQ(text.find(word), std::string::npos) << word << ": " << text;
}

TEST(Registration, AcceptsMeasuredPairsUpToALimit)
{
    EXPECT_EQ(refusal(landmarks, moved(landmarks, 2e-3)), "");
    const Points rough = moved(landmarks, 0.02);
    expect_words(refusal(landmarks, rough), {"limit 10.0 mm", "order of the pairs"}, {"mirrored", "metres?"});
    EXPECT_EQ(refusal(landmarks, rough, 0.03), "");
    expect_words(refusal(landmarks, moved(landmarks, 2e-3), 1e-4), {"limit 0.1 mm"}, {"mirrored", "metres?"});
    for (double wrong : {-0.01, std::numeric_limits<double>::quiet_NaN()})
        EXPECT_NE(refusal(landmarks, moved(landmarks), wrong).find("max_error"), std::string::npos);
}

TEST(Registration, NamesMirroredPoints)
{
    for (int axis = 0; axis < 3; ++axis) {
        const Points mirrored = scaled(landmarks, axis == 0 ? -1 : 1, axis == 1 ? -1 : 1, axis == 2 ? -1 : 1);
        expect_words(refusal(mirrored, moved(landmarks, 1e-3)), {"mirrored?"}, {"metres?"});
    }
}

TEST(Registration, NamesOtherUnits)
{
    const Points room = moved(landmarks, 1e-3), large = scaled(landmarks, 1e3, 1e3, 1e3),
                 large_room = scaled(room, 1e3, 1e3, 1e3);
    expect_words(refusal(landmarks, large_room), {"points of the room in millimetres?"}, {"mirrored"});
    expect_words(refusal(large, room), {"points of the tissue in millimetres?"}, {"mirrored"});
    expect_words(refusal(scaled(landmarks, 100, 100, 100), room), {"points of the tissue in centimetres?"},
                 {"mirrored"});
    expect_words(refusal(scaled(landmarks, -1e3, 1e3, 1e3), room),
                 {"points of the tissue in millimetres?", "mirrored?"}, {});
    // both sets, without any error
    expect_words(refusal(large, moved(large)), {"in millimetres?"}, {"mirrored"});
}

TEST(Registration, NamesTheOutlierPair)
{
    Points room = moved(landmarks);
    room.push_back(room[1]);
    Points tissue = landmarks;
    tissue.push_back(point(0.1, 0, -0.18));
    expect_words(refusal(tissue, room), {"pair 5 of 5"}, {"mirrored", "metres?"});
}

TEST(Registration, RefusesDegeneratePairs)
{
    const double nan = std::numeric_limits<double>::quiet_NaN();
    const Points line{point(0, 0, 0), point(0.1, 0.1, 0), point(0.2, 0.2001, 0), point(0.4, 0.4, 0)},
        same(4, point(1, 2, 3));
    const std::pair<Points, Points> refused[] = {
        {{}, {}},
        {{landmarks[0], landmarks[1]}, {landmarks[0], landmarks[1]}},
        {landmarks, {landmarks[0], landmarks[1], landmarks[2]}},
        {line, moved(line)},
        {same, same},
        {landmarks, same},
        {landmarks, {point(nan, 0, 0), point(1, 0, 0), point(0, 1, 0), point(0, 0, 1)}},
    };
    for (const auto &each : refused) {
        Rigid pose;
        std::vector<double> errors;
        std::string why;
        EXPECT_FALSE(fit_rigid(each.first, each.second, &pose, &errors, &why));
        EXPECT_FALSE(why.empty());
    }
}

TEST(Registration, IsKeptInAFileOfItsFrame)
{
    Rigid pose;
    std::string why;
    const std::string text = registration_text("ECM", there);
    ASSERT_TRUE(registration_from_text(text, "ECM", &pose, &why)) << why;
    for (int d = 0; d < 3; ++d) EXPECT_EQ(pose.translation[d], there.translation[d]);
    for (int d = 0; d < 4; ++d) EXPECT_NEAR(pose.rotation[d], there.rotation[d], 1e-15);
    EXPECT_FALSE(registration_from_text(text, "PSM1_base", &pose, &why));
    EXPECT_NE(why.find("ECM"), std::string::npos);
    for (const char *bad :
         {"", "parent_frame: ECM\n", "parent_frame: ECM\ntissue_pose: 1 2 3 4\n",
          "parent_frame: ECM\ntissue_pose: 0 0 0 0 0 0 0\n", "parent_frame: ECM\ntissue_pose: 0 0 nan 0 0 0 1\n"})
        EXPECT_FALSE(registration_from_text(bad, "ECM", &pose, &why)) << bad;
}

TEST(HandEye, AFileOfTheCameraRegistrationSaysWhereAnArmsBaseLies)
{
    std::string frame, why;
    Rigid pose;
    const std::string rows =
        "[[0.0, -1.0, 0.0, 0.12], [1.0, 0.0, 0.0, -3.5e-2], [0.0, 0.0, 1.0, 0.2], [0.0, 0.0, 0.0, 1.0]]";
    ASSERT_TRUE(hand_eye_from_text(
        "{\n\"base-frame\": {\"reference-frame\": \"camera\", \"transform\": " + rows + "}\n}\n", &frame, &pose, &why))
        << why;
    EXPECT_EQ(frame, "camera");
    EXPECT_NEAR(pose.translation[0], 0.12, 1e-15);
    EXPECT_NEAR(pose.translation[1], -0.035, 1e-15);
    EXPECT_NEAR(pose.rotation[2], std::sqrt(0.5), 1e-12);
    EXPECT_NEAR(pose.rotation[3], std::sqrt(0.5), 1e-12);
    // in the format of a console's file
    EXPECT_TRUE(hand_eye_from_text("\"base-frame\": {\"transform\": " + rows + ", \"reference-frame\": \"ECM\"}",
                                   &frame, &pose, &why))
        << why;
    EXPECT_EQ(frame, "ECM");
    for (const std::string &wrong : {std::string("{\"name\": \"PSM1\"}"),
                                     std::string("{\"reference-frame\": \"camera\", \"transform\": [[1, 0, 0, 0]]}"),
                                     "{\"reference-frame\": \"\", \"transform\": " + rows + "}"}) {
        EXPECT_FALSE(hand_eye_from_text(wrong, &frame, &pose, &why)) << wrong;
        EXPECT_NE(why.find("reference-frame"), std::string::npos) << why;
    }
    std::string mirrored = "{\"reference-frame\": \"camera\", \"transform\": " + rows + "}";
    mirrored.replace(mirrored.find("-1.0"), 4, "01.0");
    EXPECT_FALSE(hand_eye_from_text(mirrored, &frame, &pose, &why));
    EXPECT_NE(why.find("not a rotation"), std::string::npos) << why;
}

} // namespace
