// No tool tunnels through tissue at 1 m/s, with any shape and path; it pushes the tissue along.
#include "sweeps.h"

#include "base/memory.h"
#include "base/vector3.h"
#include "sim/step/proxy.h"

#include <algorithm>
#include <array>
#include <vector>

namespace {

// A thin and a thick rod push the sheet that they would jump over, at any position relative to its nodes, and with
// little friction.
TEST(Swept, ARodAtOneMetreASecondCarriesTheSheetAlong)
{
    for (const double radius : {0.0042, 0.0005})
        for (int place = 0; place < (radius < 0.001 ? 11 : 2); place++) {
            const double side = place % 2 ? -1 : 1,
                         from[3] = {0.0253 + 0.001 * place, 0.03, side > 0 ? 0.016 + radius : -0.012 - radius},
                         motion[3] = {0, 0, -0.04 * side};
            const Swept swept = sweep({rod(radius).part[0],
                                       {from[0], from[1], from[2]},
                                       {motion[0], motion[1], motion[2]},
                                       {0, 0, 0, 1},
                                       place % 3 ? 0.08 : 0.3,
                                       0});
            EXPECT_GT(swept.carried, 0.024) << radius << " at " << from[0];
            EXPECT_LT(swept.deepest, 1e-4) << radius << " at " << from[0];
            EXPECT_EQ(swept.inside, 0) << radius << " at " << from[0];
        }
}

// Random sweeps. Environment variables:
//   PLIANT_SWEEPS            number of the last sweep, default 1000
//   PLIANT_SWEEPS_FIRST      number of the first sweep, so that several processes can share the work (0 and 625,
//                            625 and 1250, ...)
//   PLIANT_SWEEPS_BUDGET     budget of a step [ms]
//   PLIANT_SWEEPS_LIVE       use live steps
//   PLIANT_SWEEPS_SPEED      maximum speed [m/s], up to 2
//   PLIANT_SWEEPS_HEXAHEDRA  use hexahedra instead of tetrahedra
Mode mode_from_environment()
{
    return {static_cast<double>(number_from("PLIANT_SWEEPS_BUDGET", 0)),
            number_from("PLIANT_SWEEPS_LIVE", 0) ? PLIANT_BACKGROUND_LIVE : PLIANT_BACKGROUND_PLANNED,
            number_from("PLIANT_SWEEPS_HEXAHEDRA", 0) ? PLIANT_HEXAHEDRA : PLIANT_LINEAR};
}
TEST(Swept, NothingIsSweptThroughTheSheet) { EXPECT_EQ(count_tunneled_sweeps(1000, mode_from_environment()), 0); }

// The same, at 1 to 2 m/s, of tools that turn by up to 3 rad, in one step or in several. The variables are the same,
// except PLIANT_SWEEPS_SPEED.
TEST(Swept, NoTurningToolIsSweptThrough)
{
    EXPECT_EQ(count_tunneled_sweeps(40, mode_from_environment(), true), 0);
}

std::array<double, 3> at_end(const SweepPath &on)
{
    return {on.from[0] + on.motion[0], on.from[1] + on.motion[1], on.from[2] + on.motion[2]};
}
Mode coarse(SweepExtra extra) { return {0, PLIANT_BACKGROUND_PLANNED, PLIANT_LINEAR, false, PLIANT_AVERAGED, extra}; }
Mode cut() { return {0, PLIANT_BACKGROUND_PLANNED, PLIANT_LINEAR, false, PLIANT_FINE, SweepExtra::Piece}; }

// With a homogenized method, next to a patch, and next to a detached piece: the first sweeps, and regression cases.
// More sweeps (PLIANT_SWEEPS; PLIANT_SWEEPS_BESIDE: 0, 1 or 2 for nothing, a piece, a patch only):
// src/contact/NUMERICS.md.
TEST(Swept, NothingIsSweptThroughACoarseSheetNorBesidePatchesAndPieces)
{
    for (const Mode &mode : {coarse(SweepExtra::Nothing), coarse(SweepExtra::Patch), cut()}) {
        const int only = number_from("PLIANT_SWEEPS_BESIDE", -1); // only this one of the three
        if (only >= 0 && static_cast<int>(mode.extra) != only) continue;
        SCOPED_TRACE(testing::Message() << "method " << mode.method << ", beside " << static_cast<int>(mode.extra));
        EXPECT_EQ(count_tunneled_sweeps(2, mode), 0);
    }
    Sweeps beside_a_patch, beside_a_piece;
    for (const int n : {0, 23, 51, 56}) {
        const SweepPath on = beside_a_patch.at(n);
        EXPECT_FALSE(has_tunneled(sweep(on, coarse(SweepExtra::Patch)), on)) << n;
    }
    for (const auto &crushing : {std::make_pair(53, SweepExtra::Nothing), std::make_pair(11, SweepExtra::Patch)}) {
        Sweeps sweeps;
        EXPECT_EQ(sweep(sweeps.at(crushing.first), coarse(crushing.second)).turned, 0) << crushing.first;
    }
    for (const int n : {11, 14, 42, 68}) {
        const SweepPath on = beside_a_piece.at(n);
        EXPECT_FALSE(has_tunneled(sweep(on, cut()), on)) << n;
    }
}

// The first 28 sweeps at 2 m/s, the maximum speed for following tools, and sweeps through a sheet of hexahedra.
TEST(Swept, TheFirstAreNotSweptThroughAtTwoMetresASecondNorThroughHexahedra)
{
    Sweeps sweeps;
    for (int n = 0; n < 28; n++) {
        SweepPath on = sweeps.next();
        const Swept hexahedra = sweep(on, {0, PLIANT_BACKGROUND_PLANNED, PLIANT_HEXAHEDRA});
        on.speed = 2;
        const Swept fast = sweep(on);
        EXPECT_FALSE(has_tunneled(fast, on)) << n << ": carried " << fast.carried << ", " << fast.inside
                                           << " points inside, " << fast.deepest << " deep";
        EXPECT_EQ(hexahedra.turned, 0) << n;
        EXPECT_FALSE(has_tunneled(hexahedra, on)) << n << ": carried " << hexahedra.carried << ", " << hexahedra.inside
                                                << " points inside, " << hexahedra.deepest << " deep";
    }
}

// Regression cases that require steps in several parts; otherwise tools tunnel or elements stay inverted.
TEST(Swept, AStepThatWouldTunnelIsDividedIntoLegs)
{
    Sweeps sweeps;
    for (const int n : {232, 534, 1964}) {
        const SweepPath on = sweeps.at(n);
        for (const Mode mode : {Mode{}, Mode{0, PLIANT_BACKGROUND_PRESCRIBED}, Mode{10000}}) {
            const Swept swept = sweep(on, mode);
            EXPECT_FALSE(has_tunneled(swept, on))
                << n << ": carried " << swept.carried << ", " << swept.inside << " points inside";
            EXPECT_EQ(swept.turned, 0) << n;
            EXPECT_LT(swept.deepest, 2e-4) << n;
        }
    }
}

// Regression cases for diverged solves and for normals at triangle borders. PLIANT_SWEEPS_LIVE: use live steps, which
// depend on the machine, instead of equally even steps without background results.
TEST(Swept, FormerlyTunnelingSweepsDoNotTunnel)
{
    const pliant_background_kind even =
        number_from("PLIANT_SWEEPS_LIVE", 0) ? PLIANT_BACKGROUND_LIVE : PLIANT_BACKGROUND_PRESCRIBED;
    Sweeps sweeps;
    for (const int n : {207, 378, 450, 529, 2230, 3993, 4922, 7070, 7249, 7264, 9216}) {
        const SweepPath on = sweeps.at(n);
        for (const pliant_background_kind background : {PLIANT_BACKGROUND_PLANNED, even}) {
            const Swept swept = sweep(on, {0, background});
            EXPECT_FALSE(has_tunneled(swept, on)) << n << ": carried " << swept.carried << ", " << swept.inside
                                                << " points inside, " << swept.deepest << " deep";
        }
    }
}

// Regression cases of numbers 10,000 to 50,000. Inactive points must give way to points on another side, with up to
// twelve solves per step. Inaccurate results need a division into parts. On the CPU only: these solves are sensitive,
// so a GPU ends in different states.
TEST(Swept, FormerlyTunnelingSweepsOfOtherSeedsDoNotTunnel)
{
    Sweeps sweeps;
    for (const int n : {19751, 22362, 41286, 41292, 48166}) {
        const SweepPath on = sweeps.at(n);
        for (const pliant_background_kind background : {PLIANT_BACKGROUND_PLANNED, PLIANT_BACKGROUND_PRESCRIBED}) {
            Mode mode{0, background};
            mode.backend = PLIANT_CPU;
            const Swept swept = sweep(on, mode);
            EXPECT_FALSE(has_tunneled(swept, on)) << n << ": carried " << swept.carried << ", " << swept.inside
                                                << " points inside, " << swept.deepest << " deep";
        }
    }
}

// A coupling at its force limit, in an inaccurate solution of hexahedra, must not move the proxy by metres.
TEST(Swept, ALoadedProxyMovesByAtMostOneCellInALeg)
{
    Sweeps sweeps;
    const SweepPath on = sweeps.at(582);
    const Swept swept = sweep(on, {0, PLIANT_BACKGROUND_PLANNED, PLIANT_HEXAHEDRA});
    EXPECT_FALSE(has_tunneled(swept, on)) << "carried " << swept.carried;
    EXPECT_LT(swept.carried, 0.03);
}

// When the tools' motion is blocked, a leg moves the tissue alone. Otherwise the same leg would repeat forever, 4.4 mm
// before the target.
TEST(Swept, ABlockedToolCatchesUp)
{
    Sweeps sweeps;
    const Swept swept = sweep(sweeps.at(719), {0, PLIANT_BACKGROUND_PLANNED});
    EXPECT_LT(swept.proxy_error, 2e-4);
}

// A rod that rotates about its end from above the sheet into it, by more than one step can follow.
TEST(Swept, ATurnOfMoreThanOneRadianIsTakenInParts)
{
    for (const double radius : {0.0005, 0.001, 0.003})
        for (const double angle : {1.6, 2.0, 2.6, 3.0})
            for (const double end : {1.5, 1.9}) {
                Sheet sheet(1);
                const int tool = sheet.add(
                    "tool", shape_of({PLIANT_PART_CAPSULE, PLIANT_FRAME_TIP, {0, 0, 0}, {0.02, 0, 0}, radius, false}),
                    0.027, 0.031, 0.01 + radius);
                for (int step = 0; step < 6; step++) {
                    const double half = 0.5 * (step == 0 ? end - angle : end),
                                 rotation[4] = {0, std::sin(half), 0, std::cos(half)};
                    sheet.move(tool, 0.027, 0.031, 0.01 + radius, rotation);
                    ASSERT_GE(pliant_step(sheet.model, sheet.data), 0);
                }
                EXPECT_EQ(sheet.count_axis_points_inside(tool), 0) << radius << ' ' << angle << ' ' << end;
                EXPECT_LT(sheet.max_surface_penetration(tool), 0.9 * radius) << radius << ' ' << angle << ' ' << end;
                EXPECT_GT(sheet.farthest(), 0.008) << radius << ' ' << angle << ' ' << end;
                EXPECT_EQ(sheet.turned(), 0) << radius << ' ' << angle << ' ' << end;
            }
}

// A tool that jumps skips the tissue in between. Other tools are followed as if it did not exist, however it rotates,
// and whether or not it has a shape.
TEST(Swept, AJumpOfOneToolDoesNotAffectOthers)
{
    for (const double x : {0.0253, 0.0297, 0.0341}) {
        std::vector<double> ended[3];
        for (int run = 0; run < 3; run++) { // alone, next to an arm without a shape, next to one with a shape
            Sheet sheet(1);
            const int tool = sheet.add("tool", rod(0.0005), x, 0.03, 0.0165);
            const int arm =
                run > 0 ? sheet.add("arm", run > 1 ? rod(0.0005) : pliant_tool_shape{}, 0.03, 0.03, 0.3) : -1;
            for (int step = 0; step < 5; step++) {
                const double half = 0.75 * std::min(step, 1), rotation[4] = {0, std::sin(half), 0, std::cos(half)};
                sheet.move(tool, x, 0.03, 0.0165 - 0.02 * std::min(step, 2));
                if (arm >= 0) sheet.move(arm, 0.03 + 0.06 * std::min(step, 1), 0.03, 0.3, rotation);
                ASSERT_GE(pliant_step(sheet.model, sheet.data), 0);
            }
            ended[run].assign(sheet.data->positions, sheet.data->positions + 3 * sheet.data->body->fine.num_nodes);
            EXPECT_LT(sheet.max_surface_penetration(tool), 2e-4);
            EXPECT_GT(sheet.farthest(), 0.02);
        }
        EXPECT_EQ(ended[0], ended[1]) << x;
        EXPECT_EQ(ended[0], ended[2]) << x;
    }
}

// A target that moves slowly but is far ahead of its proxy has not jumped. The tissue resists with the maximum force of
// the coupling, and holds the proxy.
TEST(Swept, ASlowTargetOnTheOtherSideHasNotJumped)
{
    Sheet sheet(1, 0.08, 0, PLIANT_LINEAR, false, [](pliant_scene &scene) { scene.contact.max_force = 0.004; });
    const int tool = sheet.add("tool", rod(0.002), 0.03, 0.03, 0.02);
    const pliant_tool &state = sheet.data->tools[tool];
    for (int step = 0; step < 30; step++) {
        sheet.move(tool, 0.03, 0.03, std::fmax(0.02 - 0.005 * step, -0.037));
        ASSERT_GE(pliant_step(sheet.model, sheet.data), 0);
    }
    EXPECT_GT(pliant_distance3(state.tip, state.proxy.tip), 0.0405); // 2 m/s x 0.02 s = 0.04 m
    EXPECT_TRUE(state.proxy.saturated);
}

// A tool whose target presses with more than its force limit stops, with every solver. Explicit dynamics: the tissue is
// not damped, so that the force varies about the limit.
TEST(Swept, AForceLimitHoldsWithEverySolver)
{
    const struct {
        const char *name;
        bool is_dynamic, is_patched;
        double above; // maximum force / limit
    } runs[] = {{"fine", false, false, 1.001}, {"patch", false, true, 1.021}, {"explicit", true, false, 1.15}};
    for (const auto &run : runs)
        for (const bool is_wide : {false, true})
            EXPECT_LT(press_beyond_limit({run.name, run.is_dynamic, run.is_patched, is_wide}).largest, run.above);
}

// A ball presses the sheet on a plane to a quarter of its thickness in one step. The volume bound ends that step, and
// the step reports it. The next step completes the motion.
TEST(Swept, AStepThatTheVolumeBoundEndsReportsIt)
{
    Sheet sheet(1, 0.3, 0, PLIANT_LINEAR, false, [&](pliant_scene &scene) {
        scene.obstacles.num_planes = 1;
        scene.obstacles.planes[0] = {{0, 0, -0.0002}, {0, 0, 1}};
    });
    const int tool = sheet.add("tool", ball(0.004), 0.0312, 0.0287, 0.012);
    for (int step = 0; step < 3; step++) {
        sheet.move(tool, 0.0312, 0.0287, step == 0 ? 0.012 : 0.005);
        ASSERT_GE(pliant_step(sheet.model, sheet.data), 0) << pliant_last_error();
        EXPECT_EQ(sheet.data->statistics.ended, step == 1 ? PLIANT_STEP_END_ELEMENTS : PLIANT_STEP_END_NONE) << step;
        EXPECT_EQ(sheet.turned(), 0);
    }
    EXPECT_STREQ(pliant_step_end_text(PLIANT_STEP_END_ELEMENTS), "the rest of the motion would invert an element");
}

// If memory is exhausted anywhere in a step with several parts, the step is completed or the previous state is
// restored. The next step continues. Also next to patches and pieces.
TEST(Swept, AStepInPartsThatFailsIsUndone)
{
    struct {
        Mode mode;
        int number, stride;
    } runs[] = {{Mode{}, 534, 8}, {coarse(SweepExtra::Patch), 56, 24}, {cut(), 11, 24}};
    for (const auto &run : runs) {
        SCOPED_TRACE(run.number);
        const SweepPath on = Sweeps().at(run.number);
        int failed = 0;
        const std::unique_ptr<Sheet> sheet = sheet_for(on, run.mode);
        const int tool = sheet->add("tool", shape_of(on.part), on.from[0], on.from[1], on.from[2]);
        for (int step = 0; step < on.steps(); step++) {
            move(*sheet, tool, on, step);
            ASSERT_GE(pliant_step(sheet->model, sheet->data), 0);
        }
        const std::vector<double> before(sheet->data->positions,
                                         sheet->data->positions + 3 * sheet->data->body->fine.num_nodes);
        for (int64_t calls = 0; calls < 240; calls += run.stride) {
            pliant_data *data = nullptr;
            ASSERT_EQ(pliant_data_copy(sheet->model, sheet->data, &data), PLIANT_OK);
            ASSERT_EQ(pliant_tool_set_pose(data, tool, at_end(on).data(), on.rotation), PLIANT_OK);
            pliant_memory_fail_after(calls);
            const pliant_status status = pliant_step(sheet->model, data);
            pliant_memory_fail_after(-1);
            if (status < 0) {
                failed++;
                EXPECT_EQ(status, PLIANT_ERROR_MEMORY);
                EXPECT_EQ(before, std::vector<double>(data->positions, data->positions + before.size()))
                    << "after " << calls << " allocations";
                double tip = 0;
                for (int d = 0; d < 3; d++) tip += std::fabs(data->tools[tool].tip[d] - on.from[d] - on.motion[d]);
                EXPECT_LT(tip, 1e-12);
            }
            EXPECT_GE(pliant_step(sheet->model, data), 0) << "after " << calls << " allocations";
            pliant_data_free(data);
        }
        EXPECT_GT(failed, 0);
    }
}

// A ball slides along the sheet with friction. A needle comes up next to it, so that a step has several legs.
struct Slide {
    Slide(double offset)
        : offset(offset), ball_at(sheet.add("ball", ball(0.006), 0.02, 0.03, 0.0105)),
          needle(sheet.add("needle", rod(0.0005), 0.036 + offset, 0.03, -0.012))
    {
        EXPECT_EQ(pliant_data_set_limits(sheet.data, 300, 1e-7), PLIANT_OK);
        for (int step = 0; step < 10; step++)
            EXPECT_GE(go(sheet.data, 0.02 + 0.0015 * step, 0.0105 - 0.001 * std::min(step, 4), -0.012), 0);
    }
    pliant_status go(pliant_data *data, double x, double z, double needle_z)
    {
        const double tip[3] = {x, 0.03, z}, other[3] = {0.036 + offset, 0.03, needle_z};
        EXPECT_EQ(pliant_tool_set_pose(data, ball_at, tip, nullptr), PLIANT_OK);
        EXPECT_EQ(pliant_tool_set_pose(data, needle, other, nullptr), PLIANT_OK);
        return pliant_step(sheet.model, data);
    }
    pliant_status come_up(pliant_data *data) { return go(data, 0.0375, 0.0065, 0.008); }
    Sheet sheet{1, 0.2};
    double offset;
    int ball_at, needle;
};

// Friction forces are in their cones, also in a step of several legs, and on the cone where all points slide.
TEST(Swept, AStepInLegsSlidesByCoulombsLaw)
{
    for (const double offset : {-0.012, -0.014}) { // nearer, the two tools pinch the sheet
        Slide run(offset);
        ASSERT_GE(run.come_up(run.sheet.data), 0);
        EXPECT_GT(run.sheet.data->statistics.legs, 1) << offset;
        for (int slid = 0; slid < 2; slid++) {
            double presses = 0, slides = 0;
            for (int32_t p = 0; p < run.sheet.data->contacts.count; p++) {
                const pliant_contact_point &point = run.sheet.data->contacts.point[p];
                double normal = 0, all = 0;
                for (int d = 0; d < 3; d++) {
                    normal += point.force[d] * point.normal[d];
                    all += point.force[d] * point.force[d];
                }
                if (point.tool != run.ball_at) continue;
                const double along = std::sqrt(std::fmax(0, all - normal * normal));
                EXPECT_LE(along, 0.2 * normal * (1 + 1e-6) + 1e-9) << offset;
                presses += normal;
                slides += along;
            }
            EXPECT_GT(presses, 0.1);
            if (slid == 1) EXPECT_NEAR(slides / presses, 0.2, 0.2e-3) << offset;
            ASSERT_GE(run.go(run.sheet.data, 0.0390, 0.0065, 0.008), 0);
        }
    }
}

std::vector<double> points_of(const pliant_data *data)
{
    std::vector<double> out;
    for (int32_t p = 0; p < data->contacts.count; p++) {
        const pliant_contact_point &point = data->contacts.point[p];
        out.push_back(static_cast<double>(point.feature));
        out.push_back(point.was_pressed);
        for (int d = 0; d < 3; d++) out.insert(out.end(), {point.place[d], point.force[d], point.anchor[d]});
    }
    return out;
}

// If memory is exhausted anywhere in a step with several legs, the step is completed, or the initial state and its
// points are restored.
TEST(Swept, AStepInLegsWithoutMemoryIsWhole)
{
    Slide run(-0.012);
    const size_t in_use = pliant_memory_in_use();
    int failed = 0, done = 0;
    std::vector<std::vector<double>> ends;
    for (int64_t calls = 0; calls < 200; calls += calls < 16 ? 1 : 4) {
        pliant_data *data = nullptr;
        ASSERT_EQ(pliant_data_copy(run.sheet.model, run.sheet.data, &data), PLIANT_OK);
        const std::vector<double> points = points_of(data),
                                  before(data->positions, data->positions + 3 * data->body->fine.num_nodes);
        pliant_memory_fail_after(calls);
        const pliant_status status = run.come_up(data);
        pliant_memory_fail_after(-1);
        const std::vector<double> after(data->positions, data->positions + before.size());
        if (status < 0) {
            failed++;
            EXPECT_EQ(status, PLIANT_ERROR_MEMORY);
            EXPECT_EQ(points_of(data), points) << "after " << calls << " allocations";
            EXPECT_EQ(after, before) << "after " << calls << " allocations";
        } else {
            done++;
            int32_t begun = 0;
            for (int32_t p = 0; p < data->contacts.count; p++) {
                begun += data->contacts.point[p].was_pressed;
                if (p > 0) EXPECT_LT(data->contacts.point[p - 1].feature, data->contacts.point[p].feature);
            }
            EXPECT_EQ(begun, data->statistics.contacts) << "after " << calls << " allocations";
            if (std::find(ends.begin(), ends.end(), after) == ends.end()) ends.push_back(after);
        }
        EXPECT_GE(run.go(data, 0.0375, 0.0065, 0.008), 0) << "after " << calls << " allocations";
        pliant_data_free(data);
    }
    EXPECT_EQ(pliant_memory_in_use(), in_use);
    EXPECT_GT(failed, 0);
    EXPECT_GT(done, 0);
    EXPECT_EQ(ends.size(), 1u);
}

// The parts follow from the recorded poses and background results of live steps.
TEST(Swept, AStepInPartsIsPlayedBackToTheBit)
{
    struct { Mode mode; int number; } runs[] = {{Mode{}, 534}, {coarse(SweepExtra::Patch), 56}, {cut(), 11}};
    int32_t parts = 1;
    for (const auto &run : runs) {
        const SweepPath on = Sweeps().at(run.number);
        std::vector<uint32_t> taken;
        std::vector<double> ended[2];
        for (int played = 0; played < 2; played++) { // live, and replayed
            const std::unique_ptr<Sheet> sheet = sheet_for(on, run.mode);
            const int tool = sheet->add("tool", shape_of(on.part), on.from[0], on.from[1], on.from[2]);
            for (int step = 0; step < on.steps() + 4; step++) {
                move(*sheet, tool, on, step);
                ASSERT_EQ(pliant_data_set_background(sheet->data,
                                                     played ? PLIANT_BACKGROUND_PRESCRIBED : PLIANT_BACKGROUND_LIVE,
                                                     played ? taken[step] : 0),
                          PLIANT_OK);
                ASSERT_GE(pliant_step(sheet->model, sheet->data), 0);
                if (!played) taken.push_back(pliant_data_get_background_taken(sheet->data));
                parts = std::max(parts, sheet->data->statistics.legs);
            }
            ended[played].assign(sheet->data->positions,
                                 sheet->data->positions + 3 * sheet->data->body->fine.num_nodes);
        }
        EXPECT_EQ(ended[0], ended[1]) << run.number;
    }
    EXPECT_GT(parts, 1);
}

} // namespace
