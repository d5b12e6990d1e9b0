// Collision detection between moving parts and the surface of the tissue. Contact points stop the tissue in front of a
// part, and carry the contact area.
#include "contact/detect/part_contacts.h"
#include "pipeline/body.h"
#include "base/memory.h"
#include "solids.h"

#include <cstdlib>
#include <random>

namespace {

struct Found {
    pliant_contacts contacts{};
    Found() = default;
    Found(const Found &) = delete;
    Found &operator=(const Found &) = delete;
    ~Found() { pliant_free(contacts.point); }
};

// A part that moves from one pose to another.
struct Moving {
    pliant_part part;
    pliant_tool_shape shape{};
    pliant_moving_part moving{};

    Moving(const pliant_part &what, const double from[3], const double to[3], const double rotation[4] = nullptr)
        : part(what)
    {
        const double identity[4] = {0, 0, 0, 1};
        double way = 0;
        for (pliant_tool_pose *pose : {&moving.from, &moving.to}) {
            std::copy_n(pose == &moving.from ? from : to, 3, pose->tip);
            std::copy_n(rotation ? rotation : identity, 4, pose->rotation);
            pliant_part_pose(&shape, PLIANT_FRAME_TIP, pose->tip, pose->rotation, 0,
                             pose == &moving.from ? &moving.begin : &moving.end);
        }
        for (int d = 0; d < 3; d++) way += std::pow(to[d] - from[d], 2);
        moving.max_motion = std::sqrt(way);
        moving.kind = PLIANT_OBSTACLE_TOOL;
        moving.friction = 0.2;
        const pliant_contact_settings settings = pliant_contact_settings_default();
        moving.guard = pliant_advance_guard(&settings, &part, 0.005);
        moving.margin = 1e-3;
        moving.recovery = 2e-3;
    }
    const pliant_moving_part *get()
    {
        moving.part = &part;
        moving.shape = &shape;
        return &moving;
    }
};

// A sheet of one layer of 10 mm cubes, 2 mm thick, at z = 0 to 2 mm.
struct Sheet : Body {
    Sheet(int across = 10) : Body(size, box, {{4000, 0.45, 1000, false}})
    {
        fix_plane(0.001, 0, 0, 1, 0, 0);
        cells(across, across, 1, 1);
        EXPECT_EQ(build(), PLIANT_OK) << pliant_last_error();
        EXPECT_EQ(pliant_contact_detector_create(nullptr, &detector), PLIANT_OK);
    }
    ~Sheet() { pliant_contact_detector_free(detector); }
    pliant_status find(const pliant_moving_part *part, Found &found, int count = 1)
    {
        found.contacts.count = 0;
        return pliant_contact_find(detector, data->body, data->positions, nullptr, false, count, part, 1,
                                   &found.contacts);
    }
    pliant_contact_detector *detector = nullptr;

private:
    static constexpr int size[3] = {20, 20, 2};
    static constexpr double box[3] = {0.1, 0.1, 0.002};
};
constexpr int Sheet::size[3];
constexpr double Sheet::box[3];

pliant_part ball(double radius) { return {PLIANT_PART_SPHERE, PLIANT_FRAME_TIP, {0, 0, 0}, {0, 0, 0}, radius, false}; }
pliant_part rod(double radius, double length)
{
    return {PLIANT_PART_CAPSULE, PLIANT_FRAME_TIP, {0, 0, 0}, {0, 0, length}, radius, false};
}

double gap_of(const Sheet &sheet, const pliant_contact_point &point)
{
    double gap = 0;
    for (int d = 0; d < 3; d++) {
        double at = -point.place[d];
        for (int k = 0; k < point.count; k++) at += point.weight[k] * sheet.data->positions[3 * point.node[k] + d];
        gap += point.normal[d] * at;
    }
    return gap;
}

void check(const Sheet &sheet, const pliant_contacts &contacts)
{
    for (int32_t n = 0; n < contacts.count; n++) {
        const pliant_contact_point &point = contacts.point[n];
        if (n > 0) ASSERT_LT(contacts.point[n - 1].feature, point.feature);
        double sum = 0, size = 0;
        for (int k = 0; k < point.count; k++) sum += point.weight[k];
        for (double v : point.normal) size += v * v;
        ASSERT_NEAR(sum, 1, 1e-12);
        ASSERT_NEAR(size, 1, 1e-9);
        ASSERT_TRUE(std::isfinite(gap_of(sheet, point)));
        ASSERT_GT(point.area, 0);
    }
}

TEST(Find, ABallAboveTheSheetTouchesTheTriangleUnderItAlone)
{
    Sheet sheet;
    Found found;
    const double at[3] = {0.0533, 0.0522, 0.002 + 0.0009}; // a needle's tip between nodes
    Moving needle(ball(0.0005), at, at);
    ASSERT_EQ(sheet.find(needle.get(), found), PLIANT_OK);
    check(sheet, found.contacts);
    ASSERT_EQ(found.contacts.count, 1);
    const pliant_contact_point &point = found.contacts.point[0];
    EXPECT_EQ(point.count, 3);
    EXPECT_NEAR(point.normal[2], -1, 1e-6);
    EXPECT_NEAR(gap_of(sheet, point), 0.0004, 1e-9);
    EXPECT_NEAR(point.place[2], 0.0024, 1e-9);
}

// No sweep tunnels: a contact point keeps the tissue in front of the part along its whole motion.
TEST(Find, NoneOfManySweepsPassesUndetected)
{
    Sheet sheet;
    Found found;
    std::mt19937 engine(1);
    auto random = [&](double low, double high) {
        return low + (high - low) * std::uniform_real_distribution<double>()(engine);
    };
    int missed = 0, behind = 0;
    for (int n = 0; n < 6000; n++) {
        const bool needle = n % 2;
        const pliant_part part = rod(needle ? 0.0005 : 0.0042, needle ? 0.05 : 0.2);
        const double side = n % 4 < 2 ? 1 : -1; // from above and from below
        const double from[3] = {random(0.03, 0.07), random(0.03, 0.07),
                                side > 0 ? 0.002 + part.radius + random(1e-4, 0.008)
                                         : -part.radius - random(1e-4, 0.008)};
        const double to[3] = {from[0] + random(-0.005, 0.005), from[1] + random(-0.005, 0.005),
                              side > 0 ? -random(0, 0.01) : 0.002 + random(0, 0.01)};
        // the rod points away from the sheet, at an angle of up to 60 degrees
        const double tilt = random(0, M_PI / 3), about = random(0, 2 * M_PI),
                     half = 0.5 * (side > 0 ? tilt : M_PI - tilt);
        const double rotation[4] = {std::sin(half) * std::cos(about), std::sin(half) * std::sin(about), 0,
                                    std::cos(half)};
        Moving moving(part, from, to, rotation);
        ASSERT_EQ(sheet.find(moving.get(), found), PLIANT_OK);
        check(sheet, found.contacts);
        double deepest = 0;
        for (int32_t p = 0; p < found.contacts.count; p++)
            if (found.contacts.point[p].normal[2] * side < 0)
                deepest = std::fmin(deepest, gap_of(sheet, found.contacts.point[p]));
        missed += found.contacts.count == 0;
        // the contact must push the tissue by at least half of the tip's penetration depth
        const double beyond = side > 0 ? 0.002 - (to[2] - part.radius) : to[2] + part.radius;
        behind += deepest > -0.5 * beyond;
    }
    EXPECT_EQ(missed, 0);
    EXPECT_EQ(behind, 0);
}

// No solid tunnels: a rod with a flat end, by its distance field and as a hull. PLIANT_SWEEPS sets the number of sweeps
// (default 400).
TEST(Find, NoSolidPassesUndetected)
{
    Sheet sheet;
    Found found;
    std::mt19937 engine(2);
    const char *const asked = std::getenv("PLIANT_SWEEPS");
    const int sweeps = asked ? std::max(std::atoi(asked) / 4, 1) : 100;
    auto random = [&](double low, double high) {
        return low + (high - low) * std::uniform_real_distribution<double>()(engine);
    };
    for (const bool convex : {false, true})
        for (const double radius : {0.0006, 0.003}) {
            pliant_solid *solid = nullptr;
            pliant_solid_options options{};
            options.convex = convex;
            options.resolution = 0.4 * radius;
            ASSERT_EQ(rod_surface(radius, 0.015).make(options, &solid), PLIANT_OK) << pliant_last_error();
            pliant_part part{};
            part.kind = PLIANT_PART_SOLID;
            part.solid = solid;
            int missed = 0, behind = 0;
            for (int n = 0; n < sweeps; n++) {
                const double from[3] = {random(0.03, 0.07), random(0.03, 0.07), 0.002 + radius + random(1e-4, 0.008)};
                const double to[3] = {from[0] + random(-0.005, 0.005), from[1] + random(-0.005, 0.005),
                                      -random(0, 0.01)};
                const double tilt = random(0, M_PI / 3), about = random(0, 2 * M_PI), half = 0.5 * tilt;
                const double rotation[4] = {std::sin(half) * std::cos(about), std::sin(half) * std::sin(about), 0,
                                            std::cos(half)};
                Moving moving(part, from, to, rotation);
                        ASSERT_EQ(sheet.find(moving.get(), found), PLIANT_OK);
                check(sheet, found.contacts);
                double deepest = 0;
                for (int32_t p = 0; p < found.contacts.count; p++)
                    if (found.contacts.point[p].normal[2] < 0)
                        deepest = std::fmin(deepest, gap_of(sheet, found.contacts.point[p]));
                missed += found.contacts.count == 0;
                behind += deepest > -0.1 * (0.002 - to[2]); // at the middle of its end; an oblique side pushes less
            }
            EXPECT_EQ(missed, 0) << convex << radius;
            EXPECT_EQ(behind, 0) << convex << radius;
            pliant_solid_release(solid);
        }
}

} // namespace
