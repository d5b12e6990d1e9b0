// Cores never enter the surface. Legs of random pairs are compared with samples of the same motion. Independent code
// computes the sampled distances.
#include "advances.h"
#include "contact/advance/field_bound.h"
#include "contact/shapes/shapes.h"
#include "contact/shapes/tool_shape.h"
#include "solids.h"

#include <cstdlib>
#include <memory>

namespace
{

// One triangle and one part during a leg.
struct Leg {
    pliant_part part{};
    pliant_tool_shape shape{};
    pliant_advance_part leg{};
    Corners from{}, to{};

    void finish(bool has_shape = true)
    {
        leg.part = &part;
        leg.shape = has_shape ? &shape : nullptr;
        pliant_solid_surface surface{};
        if (part.solid) pliant_solid_get_surface(part.solid, &surface);
        error = surface.error;
        is_convex = !part.solid || surface.convex;
    }
    pliant_pose pose(double t) const
    {
        pliant_pose out;
        if (!leg.shape) {
            const double rest[4] = {0, 0, 0, 1}, origin[3] = {0, 0, 0};
            pliant_part_pose(&shape, PLIANT_FRAME_TIP, origin, rest, 0, &out);
            return out;
        }
        // interpolates the joint angles without the tested function
        double inverse[4], between[4], rotation[4], tip[3], w = 0;
        for (int d = 0; d < 4; d++) inverse[d] = d < 3 ? -leg.from.rotation[d] : leg.from.rotation[d];
        multiply(leg.to.rotation, inverse, between);
        for (int d = 0; d < 3; d++) w += between[d] * between[d];
        w = std::sqrt(w);
        const double sign = between[3] < 0 ? -1 : 1, angle = 2 * std::atan2(w, sign * between[3]);
        turn(w > 0 ? Vector{sign * between[0] / w, sign * between[1] / w, sign * between[2] / w} : Vector{0, 0, 0},
             t * angle, between);
        multiply(between, leg.from.rotation, rotation);
        for (int d = 0; d < 3; d++) tip[d] = (1 - t) * leg.from.tip[d] + t * leg.to.tip[d];
        pliant_part_pose(&shape, part.frame, tip, rotation, (1 - t) * leg.from.jaw + t * leg.to.jaw, &out);
        return out;
    }
    Corners corners(double t) const
    {
        Corners out;
        for (int c = 0; c < 3; c++)
            for (int d = 0; d < 3; d++) out[c][d] = from[c][d] + t * (to[c][d] - from[c][d]);
        return out;
    }
    double error = 0; // of the solid's distance field
    bool is_convex = true;
    // distance of a point (in the part's frame) from the core
    double point_distance(const double p[3]) const
    {
        const double g = leg.guard;
        double normal[3], beyond[3], outside = 0, inside = -INFINITY;
        if (part.kind != PLIANT_PART_BOX || part.radius >= g) return pliant_part_distance(&part, p, normal) + g - error;
        for (int d = 0; d < 3; d++) {
            const double inset = g - part.radius, low = part.from[d] + inset, high = part.to[d] - inset;
            beyond[d] = std::max(low - p[d], p[d] - high);
            outside += std::pow(std::max(beyond[d], 0.0), 2);
            inside = std::max(inside, beyond[d]);
        }
        return inside > 0 ? std::sqrt(outside) : inside;
    }
    // refine samples of the triangle around the minimum: the distance is convex
    double distance(double t) const
    {
        const pliant_pose at = pose(t);
        const Corners world = corners(t);
        double local[3][3], best[2] = {1.0 / 3, 1.0 / 3}, minimum = INFINITY;
        for (int c = 0; c < 3; c++) pliant_pose_from(&at, world[c].data(), local[c]);
        const auto look = [&](double u, double v) {
            double p[3];
            u = std::min(std::max(u, 0.0), 1.0);
            v = std::min(std::max(v, 0.0), 1.0);
            const double over = std::max(u + v, 1.0);
            u /= over;
            v /= over;
            for (int d = 0; d < 3; d++) p[d] = (1 - u - v) * local[0][d] + u * local[1][d] + v * local[2][d];
            const double one = point_distance(p);
            if (!(one < minimum)) return;
            minimum = one;
            best[0] = u;
            best[1] = v;
        };
        const int first =
            // sample all of the triangle: a part that is not convex may have several local minima
            part.solid && !is_convex ? 24 : 0;
        for (int i = 0; i <= first; i++)
            for (int j = 0; i + j <= first && first > 0; j++)
                look(static_cast<double>(i) / first, static_cast<double>(j) / first);
        for (double size = first > 0 ? 1.0 / first : 0.5; size > 1e-5; size *= 0.6) {
            const double middle[2] = {best[0], best[1]};
            for (int i = -2; i <= 2; i++)
                for (int j = -2; j <= 2; j++) look(middle[0] + 0.5 * i * size, middle[1] + 0.5 * j * size);
        }
        return minimum;
    }
    // the same by two nested ternary searches: slow, but accurate along edges of the part
    double sharp_distance(double t) const
    {
        const pliant_pose at = pose(t);
        const Corners world = corners(t);
        double local[3][3];
        for (int c = 0; c < 3; c++) pliant_pose_from(&at, world[c].data(), local[c]);
        return lowest([&](double u) {
            return lowest([&](double v) {
                double p[3];
                for (int d = 0; d < 3; d++)
                    p[d] = (1 - u) * local[0][d] + u * ((1 - v) * local[1][d] + v * local[2][d]);
                return point_distance(p);
            });
        });
    }
    template <typename Function> static double lowest(const Function &of)
    {
        double low = 0, high = 1, minimum = std::min(of(0), of(1));
        for (int round = 0; round < 50; round++) {
            const double a = low + (high - low) / 3, b = high - (high - low) / 3, at_a = of(a), at_b = of(b);
            minimum = std::min(minimum, std::min(at_a, at_b));
            (at_a < at_b ? high : low) = at_a < at_b ? b : a;
        }
        return minimum;
    }
    double find(const Advance &with) const
    {
        static const int32_t triangle[3] = {0, 1, 2};
        double fraction = -1;
        EXPECT_EQ(
            pliant_advance_find(with.advance, 1, triangle, from[0].data(), to[0].data(), 1, &leg, 1, false, &fraction),
            PLIANT_OK);
        return fraction;
    }
    double minimum(const Advance &with) const // core distance at the start of the leg
    {
        static const int32_t triangle[3] = {0, 1, 2};
        pliant_advance_audit_result found{};
        EXPECT_EQ(pliant_advance_audit(with.advance, 1, triangle, from[0].data(), 1, &leg, 1, &found), PLIANT_OK);
        return found.minimum;
    }
    double limit(double d) const { return std::max(std::min(0.1 * d, 0.5 * leg.guard), below(0.05 * leg.guard, d)); }
    static double below(double floor, double d)
    {
        return std::min(floor, std::max(0.9 * d, std::min(0.1 * floor, d - 1e-12)));
    }
};

pliant_solid *bracket() // an L-shaped solid, which is not convex
{
    static std::unique_ptr<pliant_solid, void (*)(const pliant_solid *)> made(nullptr, pliant_solid_release);
    if (!made) {
        pliant_solid_options options{};
        options.resolution = 5e-4;
        pliant_solid *solid = nullptr;
        EXPECT_EQ(corner().make(options, &solid), PLIANT_OK) << pliant_last_error();
        made.reset(solid);
    }
    return made.get();
}

pliant_solid *hull()
{
    static std::unique_ptr<pliant_solid, void (*)(const pliant_solid *)> made(nullptr, pliant_solid_release);
    if (!made) {
        Random random(7);
        Surface points;
        for (int n = 0; n < 12; n++) {
            const Vector v = random.direction();
            points.add(4e-3 * v[0], 2e-3 * v[1], 8e-3 * v[2]);
        }
        pliant_solid_options options{};
        options.convex = true;
        pliant_solid *solid = nullptr;
        EXPECT_EQ(points.make(options, &solid), PLIANT_OK) << pliant_last_error();
        made.reset(solid);
    }
    return made.get();
}

void choose_part(pliant_part_kind kind, const pliant_solid *solid, Random &random, pliant_part &part)
{
    part.kind = kind;
    part.frame = static_cast<pliant_part_frame>(static_cast<int>(random(0, 3)));
    const double far = random.happens(0.3) ? 0.1 : 0.01;
    for (int d = 0; d < 3; d++) part.from[d] = random(-far, far);
    part.radius = random.wide(2e-4, 5e-3);
    const Vector along = random.direction();
    const double length = random.wide(1e-4, 0.1);
    for (int d = 0; d < 3; d++) {
        part.to[d] = part.from[d] + length * along[d];
        if (kind == PLIANT_PART_BOX) part.to[d] = part.from[d] + random.wide(5e-4, 0.02);
        if (kind == PLIANT_PART_HALF_SPACE) part.to[d] = along[d];
    }
    if (kind == PLIANT_PART_BOX || kind == PLIANT_PART_SOLID)
        part.radius = random.happens(0.5) ? 0 : random.wide(2e-5, 1e-3);
    part.solid = solid;
}

void choose_motion(Random &random, Leg &out)
{
    const double way = random.happens(0.2) ? 0 : random.wide(1e-5, 0.03),
                 angle = random.happens(0.3) ? 0 : random.wide(1e-4, 3);
    const Vector to = random.direction(), about = random.direction(), first = random.direction(),
                 axis = random.direction();
    double by[4];
    for (int d = 0; d < 3; d++) {
        out.leg.from.tip[d] = random(-0.3, 0.3);
        out.leg.to.tip[d] = out.leg.from.tip[d] + way * to[d];
        out.shape.joint[d] = random(-0.01, 0.01);
        out.shape.axis[d] = random(1, 2) * axis[d];
    }
    turn(first, random(0, 6), out.leg.from.rotation);
    turn(about, angle, by);
    multiply(by, out.leg.from.rotation, out.leg.to.rotation);
    const double sign = random.happens(0.5) ? 1 : -1; // q and -q are the same rotation
    for (double &each : out.leg.to.rotation) each *= sign;
    out.leg.from.jaw = random(-0.3, 1);
    out.leg.to.jaw = out.leg.from.jaw + (random.happens(0.5) ? 0 : random(-3, 3));
}

void choose_triangle(Random &random, Leg &out)
{
    const double size = random.wide(1e-4, 1e-2);
    const pliant_pose start = out.pose(0), end = out.pose(1);
    double local[3], middle[3];
    pliant_part_centre(&out.part, local);
    if (out.part.kind == PLIANT_PART_HALF_SPACE) std::copy(out.part.from, out.part.from + 3, local);
    if (out.part.kind == PLIANT_PART_CAPSULE) {
        const double fraction = random(-0.1, 1.1);
        for (int d = 0; d < 3; d++) local[d] = out.part.from[d] + fraction * (out.part.to[d] - out.part.from[d]);
    }
    pliant_pose_to(&start, local, middle);
    for (auto &corner : out.from) {
        const Vector v = random.direction();
        for (int d = 0; d < 3; d++) corner[d] = middle[d] + size * v[d];
    }
    if (random.happens(0.05)) out.from[1] = out.from[0];
    if (random.happens(0.02)) out.from[2] = out.from[0];
    if (random.happens(0.05)) // degenerate: three corners on one line
        for (int d = 0; d < 3; d++) out.from[2][d] = out.from[0][d] + random(-1, 2) * (out.from[1][d] - out.from[0][d]);
    // Move the triangle away from the part until their distance has the chosen value.
    const double wanted = random.wide(1e-6, 1e-2);
    Vector away = random.direction();
    if (out.part.kind == PLIANT_PART_HALF_SPACE)
        for (int d = 0; d < 3; d++) away[d] = out.part.to[d];
    const Corners first = out.from;
    double near = 0, far = 0.3;
    for (int round = 0; round < 60; round++) {
        const double put = 0.5 * (near + far);
        for (int c = 0; c < 3; c++)
            for (int d = 0; d < 3; d++) out.from[c][d] = first[c][d] + put * away[d];
        (out.distance(0) < wanted ? near : far) = put;
    }
    // The triangle moves with the part or not, towards its earlier position, and each corner moves by itself.
    const bool follows = random.happens(0.3);
    const double way = random.happens(0.2) ? 0 : random.wide(1e-5, 0.03),
                 own = random.happens(0.3) ? 0 : random.wide(1e-6, 0.01);
    const Vector aside = random.direction();
    for (int c = 0; c < 3; c++) {
        const Vector by_itself = random.direction();
        pliant_pose_from(&start, out.from[c].data(), local);
        pliant_pose_to(&end, local, middle);
        for (int d = 0; d < 3; d++)
            out.to[c][d] =
                (follows ? middle[d] : out.from[c][d]) - way * away[d] + 0.5 * way * aside[d] + own * by_itself[d];
    }
}

int count_of(int usual)
{
    const char *wanted = std::getenv("PLIANT_ADVANCE_LEGS"); // set 1000000 for the complete test
    return wanted ? std::atoi(wanted) : usual;
}

struct Outcome {
    int legs = 0, blocked = 0, early = 0;
};

// Check legs of one kind of part: no sample is nearer than the limit, and no leg stops early without a reason.
Outcome try_legs(pliant_part_kind kind, const pliant_solid *solid, int count, uint64_t seed)
{
    enum { SAMPLES = 200 };
    Random random(seed);
    Advance advance;
    Outcome outcome;
    for (int n = 0; n < count && !testing::Test::HasFailure(); n++) {
        Leg leg;
        choose_part(kind, solid, random, leg.part);
        choose_motion(random, leg);
        leg.leg.guard = pliant_advance_guard(&settings, &leg.part, random.wide(1e-3, 0.1));
        leg.finish(kind != PLIANT_PART_HALF_SPACE);
        choose_triangle(random, leg);
        const double first = leg.is_convex ? leg.sharp_distance(0) : 0.9 * leg.distance(0), limit = leg.limit(first);
        const double fraction = leg.find(advance);
        if (first <= 0) {
            EXPECT_EQ(fraction, 0) << "leg " << n;
            continue;
        }
        double blocked = INFINITY; // time before the first sample that is nearer than the limit
        for (int s = 0; s <= SAMPLES; s++) {
            const double t = static_cast<double>(s) / SAMPLES, distance = leg.distance(t);
            if (t <= fraction) {
                EXPECT_GT(distance, 0.999 * limit - 1e-9)
                    << "leg " << n << " at " << t << " of " << fraction << " from " << first;
                EXPECT_GT(distance, 0);
            }
            if (distance < limit && blocked == INFINITY) blocked = static_cast<double>(s - 1) / SAMPLES;
        }
        EXPECT_GT(leg.distance(fraction), 0.999 * limit - 1e-9) << "leg " << n;
        outcome.legs++;
        outcome.blocked += fraction < 1;
        const bool at_limit = leg.distance(fraction) < 1.05 * limit + 1e-8; // the limit lies between two samples
        if (!at_limit && fraction < 0.98 * std::min(blocked, 1.0) - 1.0 / SAMPLES) outcome.early++;
    }
    return outcome;
}

class AdvanceKind : public testing::TestWithParam<pliant_part_kind>
{
};

TEST_P(AdvanceKind, KeepsTheLimitDistanceWithoutStoppingEarly)
{
    const Outcome outcome = try_legs(GetParam(), GetParam() == PLIANT_PART_SOLID ? hull() : nullptr,
                                     count_of(GetParam() == PLIANT_PART_SOLID ? 40 : 200), 11 + GetParam());
    std::printf("kind %d: %d legs, %d blocked, %d early\n", GetParam(), outcome.legs, outcome.blocked, outcome.early);
    EXPECT_GT(outcome.blocked, outcome.legs / 10);
    EXPECT_LT(outcome.blocked, outcome.legs);
    EXPECT_LE(outcome.early, 1 + outcome.legs / 300);
}

// The lower bounds of the distance are tight. A bound that is too low would stop legs without an obstacle.
TEST_P(AdvanceKind, FindsTheSmallestDistance)
{
    Random random(31 + GetParam());
    Advance advance;
    int near = 0;
    for (int n = 0; n < (GetParam() == PLIANT_PART_SOLID ? 150 : 500); n++) {
        Leg leg;
        choose_part(GetParam(), GetParam() == PLIANT_PART_SOLID ? hull() : nullptr, random, leg.part);
        choose_motion(random, leg);
        leg.leg.guard = pliant_advance_guard(&settings, &leg.part, 0.1);
        leg.finish(GetParam() != PLIANT_PART_HALF_SPACE);
        choose_triangle(random, leg);
        const double minimum = leg.minimum(advance), first = leg.sharp_distance(0);
        if (!std::isfinite(minimum) || first <= 0) continue;
        near++;
        EXPECT_LT(minimum, first * (1 + 1e-6) + 1e-12) << "triangle " << n;
        EXPECT_GT(minimum, std::min(first, leg.distance(0)) * 0.998 - 1e-10) << "triangle " << n;
    }
    EXPECT_GT(near, GetParam() == PLIANT_PART_SOLID ? 20 : 100);
}

INSTANTIATE_TEST_SUITE_P(Convex, AdvanceKind,
                         testing::Values(PLIANT_PART_SPHERE, PLIANT_PART_CAPSULE, PLIANT_PART_BOX,
                                         PLIANT_PART_HALF_SPACE, PLIANT_PART_SOLID));

TEST(Advance, NeverEntersASolidThatIsNotConvex)
{
    const Outcome outcome = try_legs(PLIANT_PART_SOLID, bracket(), count_of(60), 23);
    std::printf("field: %d legs, %d blocked, %d early\n", outcome.legs, outcome.blocked, outcome.early);
    EXPECT_GT(outcome.blocked, outcome.legs / 10);
    EXPECT_LT(outcome.blocked, outcome.legs);
    EXPECT_LE(outcome.early, 1 + outcome.legs / 50);
}

// Set the position of a triangle across a direction. Its core distance is nearly the smallest that legs leave.
void place_at_floor(const Leg &leg, const Vector &out, const Corners &shape, Corners &at)
{
    const pliant_part core = [&leg] {
        pliant_part made = leg.part;
        made.radius += leg.error - leg.leg.guard;
        return made;
    }();
    double low = -0.03, high = 0.03;
    for (int step = 0; step < 40; step++) {
        const double middle = 0.5 * (low + high);
        for (int c = 0; c < 3; c++)
            for (int d = 0; d < 3; d++) at[c][d] = shape[c][d] + middle * out[d];
        double local[3][3];
        for (int c = 0; c < 3; c++) std::copy(at[c].begin(), at[c].end(), local[c]);
        (pliant_field_minimum(&core, local, 1) < 0.05 * leg.leg.guard ? low : high) = middle;
    }
}

// The rod's rim crosses borders of the field's cells, where the gradient changes. A leg away from it is never stopped.
TEST(Advance, ATriangleThatLeavesTheRimOfAFieldIsNotStopped)
{
    pliant_solid_options options{};
    options.resolution = 3e-4;
    pliant_solid *solid = nullptr;
    ASSERT_EQ(rod_surface(0.0008, 0.02).make(options, &solid), PLIANT_OK) << pliant_last_error();
    Random random(7);
    const Advance advance;
    int stopped = 0;
    for (int n = 0; n < 40; n++) {
        Leg leg;
        leg.part.kind = PLIANT_PART_SOLID;
        leg.part.solid = solid;
        leg.finish();
        leg.leg.guard = 2.4e-4;
        const double tilt = random(0.2, 1.4), about = random(0, 2 * M_PI), along = random(0, 2 * M_PI);
        const Vector out = {std::sin(tilt) * std::cos(about), std::sin(tilt) * std::sin(about), -std::cos(tilt)},
                     side = {-std::sin(about), std::cos(about), 0},
                     up = {out[1] * side[2] - out[2] * side[1], out[2] * side[0] - out[0] * side[2],
                           out[0] * side[1] - out[1] * side[0]};
        Corners shape;
        for (int c = 0; c < 3; c++)
            for (int d = 0; d < 3; d++)
                shape[c][d] =
                    0.005 * (std::cos(along + 2 * M_PI * c / 3) * side[d] + std::sin(along + 2 * M_PI * c / 3) * up[d]);
        place_at_floor(leg, out, shape, leg.from);
        for (int c = 0; c < 3; c++)
            for (int d = 0; d < 3; d++) leg.to[c][d] = leg.from[c][d] + 1e-4 * out[d];
        stopped += leg.find(advance) < 1;
    }
    pliant_solid_release(solid);
    EXPECT_EQ(stopped, 0);
}

} // namespace
