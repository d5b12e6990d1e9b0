// Random sweeps of tools through a sheet of tissue, and their results.
#ifndef PLIANT_TEST_SWEEPS_H
#define PLIANT_TEST_SWEEPS_H

#include "sheet.h"
#include "base/rotate.h"
#include "solids.h"

#include <array>
#include <cstdio>
#include <cstdlib>
#include <memory>
#include <random>
#include <vector>

// Additional feature of the scene.
enum class SweepExtra { Nothing, Piece /* has come off */, Patch /* serves a ball that presses a corner */ };

// Modes of steps: until convergence, within a budget, or with even duration as live ones; element kind; explicit
// dynamics; or a coarse method with elements twice as wide.
struct Mode {
    double budget_ms = 0;
    // prescribed: as in a live run without background results, which is reproducible on every machine
    pliant_background_kind background = PLIANT_BACKGROUND_PLANNED;
    pliant_element_kind element = PLIANT_LINEAR;
    bool dynamic = false;
    pliant_method method = PLIANT_FINE;
    SweepExtra extra = SweepExtra::Nothing;
    pliant_backend_choice backend = PLIANT_AUTO;
};

// A tool and its path into the sheet.
struct SweepPath {
    pliant_part part;
    double from[3], motion[3], rotation[4], friction;
    double beyond; // distance of its end beyond the sheet's middle [m]
    double speed = 1; // maximum speed of the tip [m/s]
    double turn[3] = {0, 0, 0}; // rotation vector of the whole path [rad]
    double stride() const { return 0.02 * speed; }
    int steps() const { return std::max(1, static_cast<int>(std::ceil(pliant_length3(motion) / stride()))); }
    // Return the rotation at a fraction of the path.
    std::array<double, 4> rotation_at(double fraction) const
    {
        const double angle = pliant_length3(turn);
        if (angle == 0) return {rotation[0], rotation[1], rotation[2], rotation[3]};
        const double half = 0.5 * fraction * angle, by = std::sin(half) / angle, w = std::cos(half),
                     x = by * turn[0], y = by * turn[1], z = by * turn[2], *const q = rotation;
        return {w * q[0] + x * q[3] + y * q[2] - z * q[1], w * q[1] - x * q[2] + y * q[3] + z * q[0],
                w * q[2] + x * q[1] - y * q[0] + z * q[3], w * q[3] - x * q[0] - y * q[1] - z * q[2]};
    }
};

// Results of a sweep (20 mm per step at 1 m/s) and four steps of rest.
struct Swept {
    double deepest, carried; // maximum penetration depth of surface points; maximum displacement of a node
    int inside;              // number of points on the tool's axis that lie in a tetrahedron
    int turned;              // maximum number of inverted elements in a step
    double proxy_error;      // of the tool, at the end [m]
    int32_t evaluations, legs; // maximum over the steps
    bool path_meets_fixed_side;         // the path intersects a fixed side of the sheet, where tissue cannot yield
};

inline void move(Sheet &sheet, int tool, const SweepPath &on, int step)
{
    const double fraction = std::min(1.0, static_cast<double>(step) / on.steps());
    sheet.move(tool, on.from[0] + fraction * on.motion[0], on.from[1] + fraction * on.motion[1],
               on.from[2] + fraction * on.motion[2], on.rotation_at(fraction).data());
}

inline pliant_tool_shape shape_of(const pliant_part &part)
{
    pliant_tool_shape shape{};
    shape.num_parts = 1;
    shape.part[0] = part;
    return shape;
}

// Check the path of a step in increments of a quarter of the tool's thickness. A fixed side of 4 mm may lie between the
// poses of two steps.
inline bool path_crosses_fixed_side(const Sheet &sheet, int tool, const SweepPath &on, int step)
{
    const double reach = 0.025; // of a tool that turns, see next_that_turns [m]
    const double motion = on.stride() + reach * pliant_length3(on.turn) / on.steps();
    const int poses = static_cast<int>(std::ceil(motion / (0.25 * pliant_part_depth(&on.part))));
    for (int n = 0; n <= poses; n++) {
        const double fraction = std::min(1.0, std::max(0.0, step - 1 + static_cast<double>(n) / poses) / on.steps());
        double tip[3];
        for (int d = 0; d < 3; d++) tip[d] = on.from[d] + fraction * on.motion[d];
        if (sheet.intersects_fixed_side(tool, tip, on.rotation_at(fraction).data())) return true;
    }
    return false;
}

// Cut off a part of the sheet's free side, far from the sweep.
inline void cut_off(Sheet &sheet)
{
    const double points[12] = {0.0213, -0.01, 0.01, 0.0213, 0.0063, 0.01, 0.0387, 0.0063, 0.01, 0.0387, -0.01, 0.01},
                 down[3] = {0, 0, -0.02};
    ASSERT_EQ(pliant_data_cut(sheet.model, sheet.data, 4, points, down, nullptr), PLIANT_OK) << pliant_last_error();
    const pliant_body *body = sheet.data->body;
    ASSERT_TRUE(body->pieces);
    std::vector<double> positions(sheet.data->positions, sheet.data->positions + 3 * body->fine.num_nodes);
    for (int32_t i = 0; i < body->pieces->start[body->pieces->count]; i++)
        positions[3 * body->pieces->node[i] + 1] -= 0.2;
    ASSERT_EQ(pliant_data_set_positions(sheet.model, sheet.data, positions.data()), PLIANT_OK) << pliant_last_error();
}

// Press a corner of the sheet with a ball until a patch serves it.
inline void press_a_corner(Sheet &sheet)
{
    const int tool = sheet.add("press", ball(0.004), 0.012, 0.008, 0.009);
    for (int step = 0; step < 30 && sheet.data->statistics.patched == 0; step++) {
        sheet.move(tool, 0.012, 0.008, 0.009 - 0.0005 * std::min(step, 4));
        ASSERT_GE(pliant_step(sheet.model, sheet.data), 0) << pliant_last_error();
    }
    ASSERT_EQ(sheet.data->statistics.patched, 1);
}

inline std::unique_ptr<Sheet> sheet_for(const SweepPath &on, const Mode &mode)
{
    auto made = std::make_unique<Sheet>(
        1, on.friction, mode.budget_ms, mode.element, mode.dynamic, [&mode](pliant_scene &scene) {
            scene.model.method = mode.method;
            scene.solver.backend = mode.backend;
            scene.mesh.ratio = mode.method == PLIANT_FINE ? 1 : 2;
            if (mode.extra == SweepExtra::Piece)
                scene.cut.kind = mode.method == PLIANT_FINE ? PLIANT_CUT_SUBDIVIDE : PLIANT_CUT_SEVER;
            if (mode.extra == SweepExtra::Patch) scene.model.patch = 0.012;
            if (mode.extra == SweepExtra::Piece) scene.warp.margin = 1;
        });
    if (mode.extra == SweepExtra::Patch) press_a_corner(*made);
    if (mode.extra == SweepExtra::Piece) cut_off(*made);
    return made;
}

inline Swept sweep(const SweepPath &on, Mode mode = {})
{
    const std::unique_ptr<Sheet> made = sheet_for(on, mode);
    Sheet &sheet = *made;
    const int tool = sheet.add("tool", shape_of(on.part), on.from[0], on.from[1], on.from[2]);
    bool path_meets_fixed_side = false;
    int32_t evaluations = 0, legs = 0;
    int turned = 0;
    EXPECT_EQ(pliant_data_set_background(sheet.data, mode.background, 0), PLIANT_OK);
    for (int step = 0; step < on.steps() + 4; step++) {
        move(sheet, tool, on, step);
        path_meets_fixed_side = path_meets_fixed_side || path_crosses_fixed_side(sheet, tool, on, step);
        EXPECT_GE(pliant_step(sheet.model, sheet.data), 0);
        evaluations = std::max(evaluations, sheet.data->statistics.iterations);
        legs = std::max(legs, sheet.data->statistics.legs);
        turned = std::max(turned, sheet.turned());
        if (std::getenv("PLIANT_SWEEPS_STEPS"))
            std::printf(
                "  step %d: %d evaluations, %d legs, advanced %g, %g mm behind, ended %d, %d contacts, %d turned\n",
                step, sheet.data->statistics.iterations, sheet.data->statistics.legs, sheet.data->statistics.advanced,
                1e3 * sheet.data->statistics.proxy_error, sheet.data->statistics.ended, sheet.data->statistics.contacts,
                sheet.turned());
    }
    return {sheet.max_surface_penetration(tool),
            sheet.farthest(),
            sheet.count_axis_points_inside(tool),
            turned,
            sheet.data->statistics.proxy_error,
            evaluations,
            legs,
            path_meets_fixed_side};
}

inline int number_from(const char *name, int otherwise)
{
    const char *const asked = std::getenv(name);
    return asked ? std::atoi(asked) : otherwise;
}

// Random needles, rods, balls, blades, and rods with flat ends, as distance fields and as hulls.
class Sweeps {
public:
    Sweeps()
    {
        for (const bool convex : {false, true}) {
            pliant_solid_options options{};
            options.convex = convex;
            options.resolution = 3e-4;
            EXPECT_EQ(rod_surface(0.0008, 0.02).make(options, &solid[convex]), PLIANT_OK) << pliant_last_error();
        }
    }
    ~Sweeps()
    {
        for (const pliant_solid *each : solid) pliant_solid_release(each);
    }
    SweepPath next()
    {
        const pliant_part parts[] = {
            {PLIANT_PART_CAPSULE, PLIANT_FRAME_TIP, {0, 0, 0}, {0, 0, 0.1}, 0.0005, false},
            {PLIANT_PART_CAPSULE, PLIANT_FRAME_TIP, {0, 0, 0}, {0, 0, 0.1}, 0.0042, false},
            {PLIANT_PART_CAPSULE, PLIANT_FRAME_TIP, {0, -0.05, 0}, {0, 0.05, 0}, 0.0005, false},
            {PLIANT_PART_SPHERE, PLIANT_FRAME_TIP, {0, 0, 0}, {0, 0, 0}, 0.002, false},
            {PLIANT_PART_BOX, PLIANT_FRAME_TIP, {-0.01, -0.0005, 0}, {0.01, 0.0005, 0.05}, 0, false},
            {PLIANT_PART_SOLID, PLIANT_FRAME_TIP, {0, 0, 0}, {0, 0, 0}, 0, false, solid[0]},
            {PLIANT_PART_SOLID, PLIANT_FRAME_TIP, {0, 0, 0}, {0, 0, 0}, 0, false, solid[1]},
        };
        const bool lies = number++ % 7 == 2;
        const double side = random(0, 1) < 0.5 ? -1 : 1, tilt = random(0, M_PI / 3), about = random(0, 2 * M_PI),
                     half = 0.5 * (side > 0 ? tilt : M_PI - tilt);
        // of a rod along the sheet's free direction, because the fixed sides are not swept
        const double across = 0.15 * std::cos(about);
        const double beyond = random(0.004, 0.024), clear = random(0.001, 0.012) + (lies ? 0.05 : 0.012);
        SweepPath out = {parts[(number - 1) % 7],
                   {random(0.025, 0.035), random(0.025, 0.035), 0.002 + side * (0.002 + clear)},
                   {},
                   {},
                   0,
                   beyond};
        out.motion[0] = random(-0.005, 0.005);
        out.motion[1] = random(-0.005, 0.005);
        out.motion[2] = -side * (clear + beyond);
        out.rotation[0] = std::sin(lies ? across : half) * (lies ? 1 : std::cos(about));
        out.rotation[1] = lies ? 0 : std::sin(half) * std::sin(about);
        out.rotation[3] = std::cos(lies ? across : half);
        out.friction = random(0.05, 0.4);
        return out;
    }
    // Return a random sweep at 1 to 2 m/s of a tool of 20 mm that turns by up to 3 rad on its way.
    SweepPath next_that_turns()
    {
        const pliant_part parts[] = {
            {PLIANT_PART_CAPSULE, PLIANT_FRAME_TIP, {0, 0, 0}, {0, 0, 0.02}, 0.0005, false},
            {PLIANT_PART_CAPSULE, PLIANT_FRAME_TIP, {0, 0, 0}, {0, 0, 0.02}, 0.0042, false},
            {PLIANT_PART_CAPSULE, PLIANT_FRAME_TIP, {0, -0.01, 0}, {0, 0.01, 0}, 0.0005, false},
            {PLIANT_PART_SPHERE, PLIANT_FRAME_TIP, {0, 0, 0.02}, {0, 0, 0.02}, 0.002, false},
            {PLIANT_PART_BOX, PLIANT_FRAME_TIP, {-0.01, -0.0005, 0}, {0.01, 0.0005, 0.02}, 0, false},
            {PLIANT_PART_SOLID, PLIANT_FRAME_TIP, {0, 0, 0}, {0, 0, 0}, 0, false, solid[0]},
            {PLIANT_PART_SOLID, PLIANT_FRAME_TIP, {0, 0, 0}, {0, 0, 0}, 0, false, solid[1]},
        };
        const double side = random(0, 1) < 0.5 ? -1 : 1, tilt = random(0, M_PI / 3), about = random(0, 2 * M_PI),
                     half = 0.5 * (side > 0 ? tilt : M_PI - tilt), gap = random(0.001, 0.012);
        SweepPath out = {parts[number++ % 7],
                         {random(0.025, 0.035), random(0.025, 0.035), 0},
                         {random(-0.005, 0.005), random(-0.005, 0.005), 0},
                         {std::sin(half) * std::cos(about), std::sin(half) * std::sin(about), 0, std::cos(half)},
                         random(0.05, 0.4),
                         random(0.004, 0.024),
                         random(1, 2)};
        // the axis is uniform on the sphere
        const double angle = random(0, 3), along = random(-1, 1), azimuth = random(0, 2 * M_PI);
        out.turn[0] = angle * std::sqrt(1 - along * along) * std::cos(azimuth);
        out.turn[1] = angle * std::sqrt(1 - along * along) * std::sin(azimuth);
        out.turn[2] = angle * along;
        out.from[2] = 0.002 + side * (0.002 + gap + depth_below_tip(out, 0, side));
        out.motion[2] = 0.002 + side * (depth_below_tip(out, 1, side) - out.beyond) - out.from[2];
        return out;
    }
    SweepPath at(int n)
    {
        while (number < n) next();
        return next();
    }

private:
    // Return the part's depth below its tip, towards the other side of the sheet, at a fraction of its path [m].
    static double depth_below_tip(const SweepPath &on, double fraction, double side)
    {
        const bool is_solid = on.part.kind == PLIANT_PART_SOLID; // a rod of 20 mm, radius 0.8 mm
        double deepest = -INFINITY;
        for (int n = 0; n < 8; n++) {
            const double corner[3] = {n & 1 ? on.part.to[0] : on.part.from[0], n & 2 ? on.part.to[1] : on.part.from[1],
                                      n & 4 ? is_solid ? 0.02 : on.part.to[2] : on.part.from[2]};
            double at[3];
            pliant_rotate(on.rotation_at(fraction).data(), corner, at);
            deepest = std::fmax(deepest, -side * at[2]);
        }
        return deepest + (is_solid ? 0.0008 : on.part.radius);
    }
    double random(double low, double high)
    {
        return low + (high - low) * std::uniform_real_distribution<double>()(engine);
    }
    std::mt19937 engine{5};
    pliant_solid *solid[2] = {};
    int number = 0;
};

// Return whether the tool has tunneled or the result is invalid. These cases are: the tool is in tissue, the surface
// reaches its axis, the sheet has moved less than the tool's proxy, or it has moved too far.
inline bool has_tunneled(const Swept &swept, const SweepPath &on)
{
    return swept.inside > 0 || swept.deepest > 0.9 * pliant_part_depth(&on.part) ||
           swept.carried < 0.5 * (on.beyond - swept.proxy_error) || !(swept.carried < 0.1);
}

// Run PLIANT_SWEEPS sweeps (default: `otherwise`) starting at PLIANT_SWEEPS_FIRST, at PLIANT_SWEEPS_SPEED m/s. With
// `turns`, the tools turn, at their own speeds. Print a line for each sweep that tunnels, inverts elements or ends deep
// in tissue, and one at the end. Sweeps into a fixed side do not count. Return the number of tunneling sweeps.
inline int count_tunneled_sweeps(int otherwise, Mode mode, bool turns = false)
{
    const int count = number_from("PLIANT_SWEEPS", otherwise), first = number_from("PLIANT_SWEEPS_FIRST", 0);
    EXPECT_LT(first, count) << "PLIANT_SWEEPS is the number of the last sweep";
    Sweeps sweeps;
    int through = 0, turned = 0, held = 0;
    double deepest = 0;
    for (int n = 0; n < count; n++) {
        SweepPath on = turns ? sweeps.next_that_turns() : sweeps.next();
        if (n < first) continue;
        if (!turns) on.speed = number_from("PLIANT_SWEEPS_SPEED", 1);
        const Swept swept = sweep(on, mode);
        const bool passes = has_tunneled(swept, on);
        if (passes || swept.deepest > 2e-4 || swept.turned > 0 || swept.proxy_error > 2e-4)
            std::printf(
                "sweep %d: kind %d, %g mm beyond: carried %g mm, %d points inside, %g mm deep, %d elements inside out, "
                "%g mm behind, %d evaluations, %d legs%s%s\n",
                n, n % 7, 1e3 * on.beyond, 1e3 * swept.carried, swept.inside, 1e3 * swept.deepest, swept.turned,
                1e3 * swept.proxy_error, swept.evaluations, swept.legs, passes ? ", through" : "",
                swept.path_meets_fixed_side ? ", in what is held" : "");
        std::fflush(stdout);
        held += swept.path_meets_fixed_side;
        if (swept.path_meets_fixed_side) continue;
        through += passes;
        turned += swept.turned > 0;
        deepest = std::fmax(deepest, swept.deepest);
    }
    std::printf(
        "from %d to %d: %d sweeps, %d more into what is held, %d through, %d with elements inside out, "
        "deepest %.3f mm\n",
        first, count, count - first - held, held, through, turned, 1e3 * deepest);
    std::fflush(stdout);
    if (!mode.dynamic) EXPECT_EQ(turned, 0);
    return through;
}

#endif
