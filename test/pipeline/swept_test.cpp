// Nothing passes through tissue at 1 m/s, whatever it is and wherever it goes: it carries the tissue along.
#include "sheet.h"
#include "solids.h"

#include <cstdlib>
#include <random>

namespace {

// A tool that is swept into the sheet at 1 m/s, 20 mm a step, and stops there.
struct Swept {
    double deepest, carried; // of points of the surface in the tool; the farthest that a node has gone
    int inside;              // points of the tool's middle that lie in a tetrahedron
};

Swept sweep(const pliant_part &part, const double from[3], const double way[3], const double *rotation, double friction, double budget_ms = 0)
{
    Sheet sheet(1, friction, budget_ms);
    pliant_tool_shape shape{};
    shape.num_parts = 1;
    shape.part[0] = part;
    const int tool = sheet.add("tool", shape, from[0], from[1], from[2]);
    const int steps = static_cast<int>(std::ceil(std::sqrt(way[0] * way[0] + way[1] * way[1] + way[2] * way[2]) / 0.02));
    for (int step = 0; step < steps + 4; step++) {
        const double share = std::min(1.0, static_cast<double>(step) / steps);
        sheet.move(tool, from[0] + share * way[0], from[1] + share * way[1], from[2] + share * way[2], rotation);
        EXPECT_GE(pliant_step(sheet.model, sheet.data), 0);
    }
    return {sheet.deepest_of_surface(tool), sheet.farthest(), sheet.middles_inside(tool)};
}

// A thin and a thick rod carry the sheet along that they would jump over, wherever between its nodes they meet it, and however little holds it on them.
TEST(Swept, ARodAtOneMetreASecondCarriesTheSheetAlong)
{
    for (const double radius : {0.0042, 0.0005})
        for (int place = 0; place < (radius < 0.001 ? 11 : 2); place++) {
            const double side = place % 2 ? -1 : 1, from[3] = {0.0253 + 0.001 * place, 0.03, side > 0 ? 0.016 + radius : -0.012 - radius}, way[3] = {0, 0, -0.04 * side};
            const Swept swept = sweep(rod(radius).part[0], from, way, nullptr, place % 3 ? 0.08 : 0.3);
            EXPECT_GT(swept.carried, 0.024) << radius << " at " << from[0];
            EXPECT_LT(swept.deepest, 1e-4) << radius << " at " << from[0];
            EXPECT_EQ(swept.inside, 0) << radius << " at " << from[0];
        }
}

int number_from(const char *name, int otherwise)
{
    const char *const asked = std::getenv(name);
    return asked ? std::atoi(asked) : otherwise;
}

// Whatever it is, wherever it goes. PLIANT_SWEEPS: as many, in place of 14; PLIANT_SWEEPS_FIRST: without as many at first; PLIANT_SWEEPS_BUDGET: steps have a budget of so many ms.
TEST(Swept, NothingIsSweptThroughTheSheet)
{
    const int sweeps = number_from("PLIANT_SWEEPS", 14), first = number_from("PLIANT_SWEEPS_FIRST", 0), budget = number_from("PLIANT_SWEEPS_BUDGET", 0);
    pliant_solid *solid[2];
    for (const bool convex : {false, true}) {
        pliant_solid_options options{};
        options.convex = convex;
        options.resolution = 3e-4;
        ASSERT_EQ(rod_surface(0.0008, 0.02).make(options, &solid[convex]), PLIANT_OK) << pliant_last_error();
    }
    const pliant_part parts[] = {
        {PLIANT_PART_CAPSULE, PLIANT_FRAME_TIP, {0, 0, 0}, {0, 0, 0.1}, 0.0005, false}, {PLIANT_PART_CAPSULE, PLIANT_FRAME_TIP, {0, 0, 0}, {0, 0, 0.1}, 0.0042, false},
        {PLIANT_PART_CAPSULE, PLIANT_FRAME_TIP, {0, -0.05, 0}, {0, 0.05, 0}, 0.0005, false}, {PLIANT_PART_SPHERE, PLIANT_FRAME_TIP, {0, 0, 0}, {0, 0, 0}, 0.002, false},
        {PLIANT_PART_BOX, PLIANT_FRAME_TIP, {-0.01, -0.0005, 0}, {0.01, 0.0005, 0.05}, 0, false},
        {PLIANT_PART_SOLID, PLIANT_FRAME_TIP, {0, 0, 0}, {0, 0, 0}, 0, false, solid[0]}, {PLIANT_PART_SOLID, PLIANT_FRAME_TIP, {0, 0, 0}, {0, 0, 0}, 0, false, solid[1]},
    };
    std::mt19937 engine(5);
    auto random = [&](double low, double high) { return low + (high - low) * std::uniform_real_distribution<double>()(engine); };
    int through = 0;
    double deepest = 0;
    for (int n = 0; n < sweeps; n++) {
        const pliant_part &part = parts[n % 7];
        const double side = random(0, 1) < 0.5 ? -1 : 1, tilt = random(0, M_PI / 3), about = random(0, 2 * M_PI), half = 0.5 * (side > 0 ? tilt : M_PI - tilt);
        const double across = 0.15 * std::cos(about); // of a rod along the sheet's free way: what is fixed is not swept
        const double rotation[4] = {std::sin(n % 7 == 2 ? across : half) * (n % 7 == 2 ? 1 : std::cos(about)), n % 7 == 2 ? 0 : std::sin(half) * std::sin(about), 0,
                                    std::cos(n % 7 == 2 ? across : half)};
        const double beyond = random(0.004, 0.024), clear = random(0.001, 0.012) + (n % 7 == 2 ? 0.05 : 0.012);
        const double from[3] = {random(0.025, 0.035), random(0.025, 0.035), 0.002 + side * (0.002 + clear)};
        const double way[3] = {random(-0.005, 0.005), random(-0.005, 0.005), -side * (clear + beyond)};
        const double friction = random(0.05, 0.4);
        if (n < first) continue;
        const Swept swept = sweep(part, from, way, rotation, friction, budget);
        const bool is_through = swept.inside > 0 || swept.carried < 0.5 * beyond || !(swept.carried < 0.1);
        if (is_through || swept.deepest > 2e-4)
            std::printf("sweep %d: kind %d, %g mm beyond, tilt %g: carried %g mm, %d points inside, %g mm deep\n", n, n % 7, 1e3 * beyond, tilt, 1e3 * swept.carried, swept.inside, 1e3 * swept.deepest);
        through += is_through;
        deepest = std::fmax(deepest, swept.deepest);
    }
    std::printf("%d sweeps, %d through, deepest %.3f mm\n", sweeps, through, 1e3 * deepest);
    EXPECT_EQ(through, 0);
    for (const pliant_solid *each : solid) pliant_solid_release(each);
}

} // namespace
