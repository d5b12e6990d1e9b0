// Tests of motion legs of whole surfaces: chains of legs, tissue that moves with a part, released and held tissue,
// self-contact of tissue, and the guarantees for callers.
#include "advances.h"
#include "base/rotate.h"
#include "contact/shapes/shapes.h"
#include "base/memory.h"
extern "C" {
#include "contact/advance/advance_workspace.h"
}

#include <algorithm>
#include <functional>
#include <vector>

namespace
{

const double identity[4] = {0, 0, 0, 1};

// A sheet in the plane z = 0 around the origin.
struct Sheet {
    std::vector<double> from, to;
    std::vector<int32_t> triangles;

    explicit Sheet(int across = 12, double width = 0.06) { add(across, width, 0); }
    void add(int across, double width, double z)
    {
        const int32_t first = num_nodes();
        for (int j = 0; j <= across; j++)
            for (int i = 0; i <= across; i++)
                from.insert(from.end(), {width * (i / double(across) - 0.5), width * (j / double(across) - 0.5), z});
        for (int j = 0; j < across; j++)
            for (int i = 0; i < across; i++) {
                const int32_t a = first + j * (across + 1) + i, b = a + 1, c = a + across + 1, d = c + 1;
                triangles.insert(triangles.end(), {a, b, d, a, d, c});
            }
        to = from;
    }
    int32_t num_nodes() const { return static_cast<int32_t>(from.size() / 3); }
    int32_t num_triangles() const { return static_cast<int32_t>(triangles.size() / 3); }
    void move(const std::function<void(double x[3])> &how)
    {
        to = from;
        for (int32_t n = 0; n < num_nodes(); n++) how(to.data() + 3 * n);
    }
    void advance(double t)
    {
        for (size_t n = 0; n < from.size(); n++) from[n] += t * (to[n] - from[n]);
        to = from;
    }
};

bool is_same_pair(const pliant_advance_pair &a, const pliant_advance_pair &b)
{
    return a.part == b.part && a.triangle == b.triangle && a.iterations == b.iterations && a.t == b.t;
}

// Tools and the sheet.
struct Scene {
    Sheet sheet;
    Advance with;
    std::vector<pliant_tool_shape> shapes;
    std::vector<pliant_advance_part> parts;

    void add(const pliant_tool_shape &shape, const Vector &tip)
    {
        shapes.reserve(8);
        shapes.push_back(shape);
        for (int32_t p = 0; p < shape.num_parts; p++) {
            pliant_advance_part part{};
            part.part = &shapes.back().part[p];
            part.shape = &shapes.back();
            part.guard = 2e-4;
            std::copy(tip.begin(), tip.end(), part.from.tip);
            std::copy(identity, identity + 4, part.from.rotation);
            part.to = part.from;
            parts.push_back(part);
        }
    }
    // listed: as in pliant_advance_find_self
    double find(int threads = 1, double listed = 0)
    {
        double fraction = -1;
        EXPECT_EQ(pliant_advance_find(with.advance, sheet.num_triangles(), sheet.triangles.data(), sheet.from.data(),
                                      sheet.to.data(), static_cast<int32_t>(parts.size()), parts.data(), threads, false,
                                      &fraction),
                  PLIANT_OK);
        return fraction;
    }
    std::vector<pliant_advance_pair> pairs() const
    {
        return {with.advance->pair, with.advance->pair + with.advance->num_pairs};
    }
    pliant_advance_audit_result audit()
    {
        pliant_advance_audit_result out{};
        EXPECT_EQ(pliant_advance_audit(with.advance, sheet.num_triangles(), sheet.triangles.data(), sheet.from.data(),
                                       static_cast<int32_t>(parts.size()), parts.data(), 1, &out),
                  PLIANT_OK);
        return out;
    }
    void advance(double t)
    {
        sheet.advance(t);
        for (auto &part : parts) {
            part.from = pliant_tool_pose_between(&part.from, &part.to, t);
            part.to = part.from;
        }
    }
};

pliant_tool_shape ball(double radius, double x = 0)
{
    pliant_tool_shape shape{};
    shape.num_parts = 1;
    shape.part[0].kind = PLIANT_PART_SPHERE;
    shape.part[0].from[0] = x;
    shape.part[0].radius = radius;
    return shape;
}

pliant_tool_shape rod(double length, double radius)
{
    pliant_tool_shape shape{};
    shape.num_parts = 1;
    shape.part[0].kind = PLIANT_PART_CAPSULE;
    shape.part[0].from[0] = -0.5 * length;
    shape.part[0].to[0] = 0.5 * length;
    shape.part[0].radius = radius;
    return shape;
}

pliant_tool_shape blade()
{
    pliant_tool_shape shape{};
    shape.num_parts = 1;
    shape.part[0].kind = PLIANT_PART_BOX;
    const double low[3] = {-0.01, -5e-4, 0}, high[3] = {0.01, 5e-4, 0.04};
    std::copy(low, low + 3, shape.part[0].from);
    std::copy(high, high + 3, shape.part[0].to);
    return shape;
}

pliant_tool_shape driver()
{
    pliant_tool_shape shape{};
    EXPECT_EQ(pliant_tool_shape_find("large_needle_driver", &shape), PLIANT_OK);
    return shape;
}

// No leg of a chain makes parts and tissue overlap, for random motions.
TEST(AdvanceSurface, NoLegSequenceLetsACorePenetrate)
{
    Random random(5);
    int moved = 0, blocked = 0;
    for (int scene = 0; scene < 20; scene++) {
        Scene on;
        on.add(scene % 4 == 0   ? ball(2e-3)
               : scene % 4 == 1 ? rod(0.03, 1e-3)
               : scene % 4 == 2 ? blade()
                                : driver(),
               {0, 0, 0.012});
        if (scene % 4 == 3) // the shaft comes from above
            for (auto &part : on.parts) turn({1, 0, 0}, M_PI, part.from.rotation);
        for (int n = 0; n < 50; n++) {
            const double angle = random.happens(0.5) ? 0 : random.wide(1e-3, 3),
                         jaw = random.happens(0.5) ? 0 : random(-1, 1), way = random.wide(1e-4, 0.02);
            const Vector about = random.direction(), towards = random.direction();
            double by[4];
            turn(about, angle, by);
            for (auto &part : on.parts) {
                part.to = part.from;
                multiply(by, part.from.rotation, part.to.rotation);
                for (int d = 0; d < 3; d++)
                    part.to.tip[d] +=
                        way * towards[d] - (d == 2 ? 0.3 * way + 0.2 * part.from.tip[2] : 0.1 * part.from.tip[d]);
                part.to.jaw += jaw;
            }
            const Vector wave = random.direction(), phase = random.direction();
            const double size = random.wide(1e-5, 5e-3);
            on.sheet.move([&](double x[3]) {
                const double along = 100 * (wave[0] * x[0] + wave[1] * x[1]);
                for (int d = 0; d < 3; d++) x[d] += size * std::sin(along + 3 * phase[d]) - (d == 2 ? 0.2 * x[2] : 0);
            });
            const double fraction = on.find();
            on.advance(fraction);
            const pliant_advance_audit_result audit = on.audit();
            ASSERT_EQ(audit.crossings, 0) << "scene " << scene << " leg " << n;
            ASSERT_GT(audit.minimum, 0.005 * 2e-4 * 0.999) << "scene " << scene << " leg " << n;
            moved += fraction > 1e-3;
            blocked += fraction < 1;
        }
    }
    std::printf("1000 legs: %d blocked, %d moved\n", blocked, moved);
    EXPECT_GT(blocked, 200);
    EXPECT_GT(moved, 500);
}

// A part that presses on tissue, 0.1 mm above its core, moves with the tissue.
TEST(AdvanceSurface, PartsThatMoveWithTheTissueAreNotSlowed)
{
    for (const auto &shape : {ball(2e-3), rod(0.03, 1e-3), blade()}) {
        Scene on;
        const double rest = shape.part[0].kind == PLIANT_PART_BOX ? 0 : shape.part[0].radius;
        on.add(shape, {0, 0, rest - 1e-4});
        ASSERT_NEAR(on.audit().minimum, 1e-4, 1e-9);
        const double by[3] = {0.02, -0.03, 0.05};
        double turned[4];
        turn({0.6, 0, 0.8}, 0.06, turned);
        on.sheet.move([&](double x[3]) {
            double apart[3] = {x[0], x[1], x[2] - on.parts[0].from.tip[2]}, out[3];
            pliant_rotate(turned, apart, out);
            for (int d = 0; d < 3; d++) x[d] = on.parts[0].from.tip[d] + out[d] + by[d];
        });
        on.parts[0].to = on.parts[0].from;
        for (int d = 0; d < 3; d++) on.parts[0].to.tip[d] += by[d];
        std::copy(turned, turned + 4, on.parts[0].to.rotation);
        EXPECT_EQ(on.find(), 1) << "kind " << shape.part[0].kind;
        on.advance(1);
        EXPECT_NEAR(on.audit().minimum, 1e-4, 2e-6);
    }
}

TEST(AdvanceSurface, SlidingIsNotSlowed)
{
    for (const auto &shape : {ball(2e-3), rod(0.03, 1e-3), blade()}) {
        Scene on;
        const double rest = shape.part[0].kind == PLIANT_PART_BOX ? 0 : shape.part[0].radius;
        on.add(shape, {-0.01, 0, rest - 5e-5});
        on.parts[0].to.tip[0] += 0.02;
        turn({0, 0, 1}, 0.8, on.parts[0].to.rotation);
        EXPECT_EQ(on.find(), 1) << "kind " << shape.part[0].kind;
        size_t iterations = 0;
        for (const pliant_advance_pair &pair : on.pairs()) iterations += static_cast<size_t>(pair.iterations);
        EXPECT_LT(iterations, 10 * (on.pairs().size() + 1));
        on.advance(1);
        EXPECT_GT(on.audit().minimum, 1.5e-4 - 1e-9);
    }
}

TEST(AdvanceSurface, APartStopsAboveTheTissue)
{
    Scene on;
    on.add(ball(2e-3), {0.001, 0.002, 0.01});
    on.parts[0].to.tip[2] = -0.01;
    const double fraction = on.find(), height = 0.01 - 0.02 * fraction - (2e-3 - 2e-4); // height of the core
    EXPECT_NEAR(height, 0.5 * 2e-4, 0.02 * 2e-4);
    EXPECT_GT(height, 0.5 * 2e-4);
    on.advance(fraction);
    EXPECT_NEAR(on.audit().minimum, height, 1e-9);
}

TEST(AdvanceSurface, OverlapsStopTheLegUnlessReleased)
{
    Scene on;
    on.add(ball(2e-3), {0, 0, 0});
    on.parts[0].to.tip[2] = 0.003;
    EXPECT_LT(on.audit().minimum, 0);
    EXPECT_GT(on.audit().crossings, 0);
    EXPECT_EQ(on.find(), 0);
    on.parts[0].released = true;
    EXPECT_GT(on.find(),
              0.4); // it leaves the tissue, until adjacent triangles block it or the leg ends
    EXPECT_EQ(on.audit().crossings, 0);
    // a released part must not enter triangles that it does not overlap yet
    on.parts[0].to = on.parts[0].from;
    on.parts[0].to.tip[0] = 0.02;
    EXPECT_LT(on.find(), 0.5);
}

TEST(AdvanceSurface, HeldTissueIsExempt)
{
    Scene on;
    on.add(ball(2e-3), {0, 0, 0.004});
    on.parts[0].to.tip[2] = 0;
    EXPECT_LT(on.find(), 1);
    std::vector<int32_t> held;
    for (int32_t n = 0; n < on.sheet.num_nodes(); n++)
        if (std::hypot(on.sheet.from[3 * n], on.sheet.from[3 * n + 1]) < 0.008) held.push_back(n);
    on.parts[0].num_held = static_cast<int32_t>(held.size());
    on.parts[0].held = held.data();
    EXPECT_EQ(on.find(), 1);
}

TEST(AdvanceSurface, AHalfSpaceStopsFallingTissue)
{
    Scene on;
    pliant_part floor{};
    floor.kind = PLIANT_PART_HALF_SPACE;
    floor.from[2] = -0.005;
    floor.to[2] = 2;
    pliant_advance_part part{};
    part.part = &floor;
    part.guard = 2e-4;
    on.parts.push_back(part);
    on.sheet.move([](double x[3]) { x[2] -= 0.01 + x[0] * 0.01; });
    const double lowest = -(0.01 + 0.03 * 0.01) * on.find();
    EXPECT_NEAR(lowest, -0.005 - 2e-4 + 1e-4, 3e-6);
}

TEST(AdvanceSurface, ThreadsDoNotChangeTheResult)
{
    Random random(3);
    for (int n = 0; n < 20; n++) {
        Scene on;
        for (int k = 0; k < 4; k++) on.add(driver(), {random(-0.02, 0.02), random(-0.02, 0.02), 0.004});
        for (auto &part : on.parts) {
            turn({1, 0, 0}, M_PI, part.from.rotation);
            part.to = part.from;
            turn({1, 0, 0}, M_PI + 0.3, part.to.rotation);
            part.to.tip[2] -= 0.01;
        }
        on.sheet.move([&](double x[3]) { x[2] += 0.001 * std::sin(200 * x[0] + n); });
        const double fraction = on.find(1);
        const std::vector<pliant_advance_pair> pairs = on.pairs();
        EXPECT_EQ(on.find(2), fraction);
        const std::vector<pliant_advance_pair> again = on.pairs();
        EXPECT_TRUE(std::equal(pairs.begin(), pairs.end(), again.begin(), again.end(), is_same_pair));
    }
}

// ---- self-contact of tissue

struct Layers {
    Sheet sheet;
    Advance with;
    pliant_advance_self self{};
    Layers() { self.thickness = 1e-4; }
    // listed: as in pliant_advance_find_self
    double find(int threads = 1, double listed = 0)
    {
        double fraction = -1;
        EXPECT_EQ(pliant_advance_find_self(with.advance, sheet.num_triangles(), sheet.triangles.data(),
                                           sheet.from.data(), sheet.to.data(), &self, listed, threads,
                                           &fraction),
                  PLIANT_OK);
        return fraction;
    }
    // The same from pairs that an audit has listed at the start.
    double find_listed()
    {
        const double thickness = self.thickness,
                     reach = pliant_advance_relative_motion(static_cast<int32_t>(sheet.from.size() / 3), nullptr,
                                                            sheet.from.data(), sheet.to.data()) +
                             pliant_advance_self_margin(&with.advance->settings, thickness);
        self.thickness = reach;
        crossings();
        self.thickness = thickness;
        return find(1, reach);
    }
    int32_t crossings()
    {
        int32_t crossings = -1;
        EXPECT_EQ(pliant_advance_audit_self(with.advance, sheet.num_triangles(), sheet.triangles.data(),
                                            sheet.from.data(), &self, nullptr, &crossings),
                  PLIANT_OK);
        return crossings;
    }
    double minimum() const // distance of the pairs that crossings() has listed
    {
        double minimum = INFINITY;
        for (int32_t n = 0; n < with.advance->num_self; n++)
            minimum = std::fmin(minimum, pliant_advance_self_distance(with.advance->self + n, sheet.from.data()));
        return minimum;
    }
};

TEST(AdvanceSelf, LayersStopBeforeEachOther)
{
    Layers on;
    on.sheet.add(9, 0.05, -0.003);
    std::vector<double> heights;
    on.sheet.move([](double x[3]) { x[2] = x[2] < -0.001 ? x[2] + 0.004 : x[2] - 0.002; });
    const double fraction = on.find();
    EXPECT_NEAR(0.003 - 0.006 * fraction, 0.5 * 1e-4, 1e-6);
    on.sheet.advance(fraction);
    EXPECT_EQ(on.crossings(), 0);
    EXPECT_NEAR(on.minimum(), 0.5 * 1e-4, 1e-6);
    on.sheet.move([](double x[3]) { // move both sheets together, and also relative to each other
        x[0] += x[2] < -0.002 ? 0.1 : 0.09;
        x[2] += 0.05;
    });
    EXPECT_EQ(on.find(), 1);
}

// Left out are pairs with an exempt node on both sides, pairs within a rigid piece, and pairs that start together.
TEST(AdvanceSelf, ExemptNodesPiecesAndPairsThatStartTogetherPass)
{
    Layers on;
    const auto below = static_cast<size_t>(on.sheet.num_nodes());
    on.sheet.add(9, 0.05, -0.001);
    const auto nodes = static_cast<size_t>(on.sheet.num_nodes());
    on.sheet.move([](double x[3]) { x[2] += x[2] < -5e-4 ? 0.003 : 0; });
    EXPECT_LT(on.find(), 1);
    std::vector<uint8_t> exempt(nodes, 0);
    std::fill(exempt.begin(), exempt.begin() + static_cast<std::ptrdiff_t>(below), uint8_t{1});
    on.self.exempt = exempt.data();
    EXPECT_LT(on.find(), 1) << "one side is not exempt";
    std::fill(exempt.begin(), exempt.end(), uint8_t{1});
    EXPECT_EQ(on.find(), 1);
    on.self.exempt = nullptr;
    std::vector<int32_t> piece(nodes, -1);
    on.self.piece = piece.data();
    EXPECT_LT(on.find(), 1) << "no pieces";
    std::fill(piece.begin(), piece.end(), 2);
    EXPECT_EQ(on.find(), 1);
    on.self.piece = nullptr;
    on.sheet.add(9, 0.05, -0.001 + 0.4 * 0.005 * on.self.thickness);
    on.sheet.move([&](double x[3]) { x[2] += x[2] < -0.001 + 1e-9 ? 0.0005 : 0; });
    EXPECT_EQ(on.find(), 1);
    on.sheet.advance(1);
    EXPECT_EQ(on.crossings(), 0);
}

// Surfaces that are nearer at rest than the thickness keep that distance.
TEST(AdvanceSelf, ThicknessIsAtMostTheDistanceAtRest)
{
    for (double at_rest : {2e-5, 1e-3}) {
        Layers on;
        on.sheet.add(9, 0.05, -0.001);
        std::vector<double> rest = on.sheet.from;
        for (size_t n = 2; n < rest.size(); n += 3) rest[n] = rest[n] < -5e-4 ? -at_rest : rest[n];
        on.self.rest = rest.data();
        on.sheet.move([](double x[3]) { x[2] += x[2] < -5e-4 ? 0.003 : 0; });
        on.sheet.advance(on.find());
        const double thickness = std::fmin(at_rest, on.self.thickness);
        EXPECT_EQ(on.crossings(), 0);
        EXPECT_NEAR(on.minimum(), 0.5 * thickness, 0.01 * thickness) << at_rest;
    }
}

// Randomly crumpled sheets: in no leg does an edge pass through a triangle.
TEST(AdvanceSelf, ACrumpledSheetNeverPassesThroughItself)
{
    Random random(17);
    int blocked = 0, moved = 0;
    for (int scene = 0; scene < 3; scene++) {
        Layers on;
        on.sheet.add(7, 0.04, 0.004);
        for (int n = 0; n < 40; n++) {
            const Vector wave = random.direction(), push = random.direction(), phase = random.direction();
            const double size = random.wide(1e-4, 0.01), own = random.wide(1e-6, 1e-3);
            on.sheet.move([&](double x[3]) {
                const double along = 150 * (wave[0] * x[0] + wave[1] * x[1] + wave[2] * x[2]);
                for (int d = 0; d < 3; d++)
                    x[d] += size * push[d] * std::sin(along + 3 * phase[d]) - 0.1 * x[d] + own * random(-1, 1);
            });
            const double fraction = on.find();
            EXPECT_EQ(on.find(2), fraction);
            EXPECT_EQ(on.find_listed(), fraction);
            on.sheet.advance(fraction);
            ASSERT_EQ(on.crossings(), 0) << "scene " << scene << " leg " << n;
            ASSERT_GT(on.minimum(), 0.005 * 1e-4 * 0.999) << "scene " << scene << " leg " << n;
            blocked += fraction < 1;
            moved += fraction > 1e-3;
        }
    }
    std::printf("120 legs: %d blocked, %d moved\n", blocked, moved);
    EXPECT_GT(blocked, 50);
    EXPECT_GT(moved, 50);
}

TEST(AdvanceSelf, AnAuditFindsCrossings)
{
    Layers on;
    on.sheet.add(3, 0.02, 0.001);
    on.sheet.move([](double x[3]) { x[2] -= x[2] > 0 ? 0.002 * (x[0] > 0) : 0; });
    on.sheet.advance(1);
    EXPECT_GT(on.crossings(), 0);
}

TEST(AdvanceSurface, EveryAllocationMayFail)
{
    for (bool self : {false, true})
        for (int n = 0; n < 40; n++) {
            pliant_advance *advance = nullptr;
            Sheet sheet;
            sheet.add(9, 0.05, -3e-5);
            if (self) sheet.add(9, 0.05, -7e-5); // near pairs, whose list grows
            const pliant_tool_shape shape = ball(2e-3);
            pliant_advance_part part{};
            part.part = &shape.part[0];
            part.shape = &shape;
            part.guard = 2e-4;
            std::copy(identity, identity + 4, part.from.rotation);
            part.from.tip[2] = 1.85e-3;
            part.to = part.from;
            pliant_advance_self how{};
            how.thickness = 1e-4;
            double fraction = -5, of_self = -5;
            pliant_memory_fail_after(n);
            pliant_status status = pliant_advance_create(nullptr, &advance);
            if (status == PLIANT_OK && !self)
                status = pliant_advance_find(advance, sheet.num_triangles(), sheet.triangles.data(), sheet.from.data(),
                                             sheet.to.data(), 1, &part, 1, false, &fraction);
            if (status == PLIANT_OK && self)
                status = pliant_advance_find_self(advance, sheet.num_triangles(), sheet.triangles.data(),
                                                  sheet.from.data(), sheet.to.data(), &how, 0, 1, &of_self);
            pliant_memory_fail_after(-1);
            const int32_t pairs = status == PLIANT_OK && self ? advance->num_self : -1;
            if (status != PLIANT_OK) {
                EXPECT_EQ(status, PLIANT_ERROR_MEMORY);
                EXPECT_EQ(fraction, -5);
                EXPECT_EQ(of_self, -5);
            }
            if (advance) { // it works again after the failure
                EXPECT_EQ(pliant_advance_find(advance, sheet.num_triangles(), sheet.triangles.data(), sheet.from.data(),
                                              sheet.to.data(), 1, &part, 1, false, &fraction),
                          PLIANT_OK);
                EXPECT_EQ(pliant_advance_find_self(advance, sheet.num_triangles(), sheet.triangles.data(),
                                                   sheet.from.data(), sheet.to.data(), &how, 0, 1, &of_self),
                          PLIANT_OK);
                EXPECT_EQ(fraction, 1);
                EXPECT_EQ(of_self, 1);
            }
            if (pairs >= 0) EXPECT_EQ(pairs, advance->num_self) << "a failure loses pairs";
            if (pairs >= 0) EXPECT_GT(pairs, 100);
            pliant_advance_free(advance);
            if (status == PLIANT_OK) {
                EXPECT_GT(n, self ? 7 : 4);
                break;
            }
            ASSERT_LT(n, 39);
        }
}

} // namespace
