// Explicit dynamics: no tool tunnels through tissue at 1 m/s, with any shape and path. Frames in several parts are
// undone, copied and replayed like others.
#include "sweeps.h"

#include "fem/dynamics/tled.h"
#include "base/memory.h"

#include <vector>

namespace {

constexpr Mode dynamic = {0, PLIANT_BACKGROUND_PLANNED, PLIANT_LINEAR, true};

std::vector<double> positions_of(const Sheet &sheet, const pliant_data *data)
{
    return {data->positions, data->positions + 3 * sheet.model->body->fine.num_nodes};
}

// These sweeps include all that tunnel if points are detected once per frame. PLIANT_SWEEPS, PLIANT_SWEEPS_FIRST: as in
// swept_test.
TEST(SweptDynamics, NothingIsSweptThroughTheSheet)
{
    EXPECT_EQ(count_tunneled_sweeps(140, dynamic), 0);
}

// Regression sweeps among the first 10,000, in which the tool rests and tissue slides off its end.
TEST(SweptDynamics, FormerlyTunnelingSweepsDoNotTunnel)
{
    for (const int number : {2615, 2741, 2930, 3013, 8915, 8918, 8929, 9641}) {
        Sweeps sweeps;
        const SweepPath on = sweeps.at(number);
        EXPECT_FALSE(has_tunneled(sweep(on, dynamic), on)) << number;
    }
}

// A sheet that a tool enters at 1 m/s, as in one of the random sweeps.
struct Dip {
    explicit Dip(int number)
        : on(Sweeps().at(number)), sheet(1, on.friction, 0, PLIANT_LINEAR, true),
          tool(sheet.add("tool", shape_of(on.part), on.from[0], on.from[1], on.from[2]))
    {
    }
    int steps() const { return on.steps() + 4; }
    pliant_status step(pliant_data *data, int number)
    {
        const double fraction = std::min(1.0, static_cast<double>(number) / on.steps());
        const double tip[3] = {on.from[0] + fraction * on.motion[0], on.from[1] + fraction * on.motion[1],
                               on.from[2] + fraction * on.motion[2]};
        EXPECT_EQ(pliant_tool_set_pose(data, tool, tip, on.rotation), PLIANT_OK);
        return pliant_step(sheet.model, data);
    }
    SweepPath on;
    Sheet sheet;
    int tool;
};

// Return the state from which a simulation continues: positions, velocities, tool force, contact points.
std::vector<double> state_of(const Dip &run, const pliant_data *data)
{
    std::vector<double> out = positions_of(run.sheet, data);
    out.insert(out.end(), data->tled->d, data->tled->d + out.size());
    for (int32_t p = 0; p < data->contacts.count; p++) {
        const pliant_contact_point &point = data->contacts.point[p];
        out.push_back(static_cast<double>(point.feature));
        for (int d = 0; d < 3; d++) out.insert(out.end(), {point.normal[d], point.place[d], point.force[d]});
    }
    out.insert(out.end(), data->tools[run.tool].tip, data->tools[run.tool].tip + 3);
    return out;
}

// If memory is exhausted anywhere in a frame with several parts, the frame is completed, or the state before it is
// restored. In the latter case the next attempt is bitwise identical to an undisturbed run.
void is_undone(int number)
{
    Dip whole(number);
    std::vector<std::vector<double>> expected;
    for (int step = 0; step < whole.steps(); step++) {
        ASSERT_EQ(whole.step(whole.sheet.data, step), PLIANT_OK);
        expected.push_back(state_of(whole, whole.sheet.data));
    }
    ASSERT_GT(whole.sheet.data->statistics.step, 4u);
    Dip run(number);
    for (int step = 0; step < run.on.steps(); step++) ASSERT_EQ(run.step(run.sheet.data, step), PLIANT_OK);
    int failed = 0;
    for (int64_t calls = 0; calls < 120; calls += calls < 12 ? 1 : 6) {
        int at = run.on.steps();
        pliant_data *data = nullptr;
        ASSERT_EQ(pliant_data_copy(run.sheet.model, run.sheet.data, &data), PLIANT_OK);
        pliant_memory_fail_after(calls);
        const pliant_status status = run.step(data, at);
        pliant_memory_fail_after(-1);
        if (status != PLIANT_OK) {
            failed++;
            ASSERT_EQ(status, PLIANT_ERROR_MEMORY);
            EXPECT_EQ(positions_of(run.sheet, data),
                      std::vector<double>(expected[at - 1].begin(),
                                          expected[at - 1].begin() + 3 * run.sheet.model->body->fine.num_nodes))
                << calls;
            for (int d = 0; d < 3; d++)
                EXPECT_DOUBLE_EQ(data->tools[run.tool].tip[d], run.on.from[d] + run.on.motion[d]) << calls;
            for (; at < run.on.steps() + 2; at++) {
                ASSERT_EQ(run.step(data, at), PLIANT_OK);
                EXPECT_EQ(state_of(run, data), expected[at]) << "after " << calls << " allocations, step " << at;
            }
        }
        pliant_data_free(data);
    }
    EXPECT_GT(failed, 15);
}

TEST(SweptDynamics, AFrameInPartsThatFailsIsUndone)
{
    is_undone(0);
    is_undone(9641); // some of its parts are repeated
}

// The same poses give bitwise identical results, also from a copy made in between, whether or not the initial state is
// kept.
TEST(SweptDynamics, ACopyGoesOnToTheBit)
{
    for (const int number : {0, 3, 4, 9641}) {
        Dip run(number);
        pliant_data *copy = nullptr;
        int at = 0;
        for (; at < run.on.steps(); at++) ASSERT_EQ(run.step(run.sheet.data, at), PLIANT_OK);
        ASSERT_EQ(pliant_data_copy(run.sheet.model, run.sheet.data, &copy), PLIANT_OK);
        for (; at < run.steps(); at++) {
            ASSERT_EQ(run.step(run.sheet.data, at), PLIANT_OK);
            ASSERT_EQ(run.step(copy, at), PLIANT_OK);
            EXPECT_EQ(state_of(run, run.sheet.data), state_of(run, copy)) << number << ", step " << at;
        }
        EXPECT_GT(run.sheet.farthest(), 0.004);
        pliant_data_free(copy);
    }
}

// Two plates crush a strip of tissue up to their cores. Meanwhile a ball far away presses and slides. It is in another
// island, so it is as fast as without the plates.
TEST(SweptDynamics, JammedToolsDoNotHoldAnotherTool)
{
    enum { WAIT = 20, STEPS = 40 };
    const int size[3] = {32, 12, 4};
    const double box[3] = {0.16, 0.06, 0.004};
    pliant_tool_shape plate{};
    plate.num_parts = 1;
    plate.part[0] = {PLIANT_PART_BOX, PLIANT_FRAME_TIP, {-0.006, -0.006, -0.001}, {0.006, 0.006, 0.001}, 0, false};
    Body strip(size, box, {{4000, 0.4, 1000, false}});
    strip.fix_plane(0, 0.001, 0, 0, 1, 0);
    strip.fix_plane(0, 0.059, 0, 0, -1, 0);
    strip.cells(16, 6, 1, 1);
    strip.scene.solver.kind = PLIANT_TLED;
    strip.scene.solver.threads = 1;
    ASSERT_EQ(strip.build(), PLIANT_OK) << pliant_last_error();
    const int free = strip.add_ball(0.006);
    int plates[2];
    for (int p = 0; p < 2; p++) {
        ASSERT_EQ(pliant_tool_add(strip.model, strip.data, p ? "below" : "above", plates + p), PLIANT_OK);
        ASSERT_EQ(pliant_tool_set_shape(strip.data, plates[p], &plate), PLIANT_OK);
    }
    double shortened = 1, behind = 0, farthest = 0, pressed = 0;
    for (int step = 1; step <= STEPS; step++) {
        const double close = 0.0095 * std::min(1.0, double(step) / WAIT), slide = 0.001 * std::max(0, step - 30),
                     tips[3][3] = {{0.03, 0.03, 0.01 - close},
                                   {0.03, 0.03, -0.006 + close},
                                   {0.12 + slide, 0.03, 0.0105 - std::min(0.01, 0.001 * std::max(0, step - WAIT))}};
        for (int p = 0; p < 2; p++) ASSERT_EQ(pliant_tool_set_pose(strip.data, plates[p], tips[p], nullptr), PLIANT_OK);
        ASSERT_EQ(pliant_tool_set_pose(strip.data, free, tips[2], nullptr), PLIANT_OK);
        ASSERT_EQ(pliant_step(strip.model, strip.data), PLIANT_OK) << pliant_last_error();
        const pliant_tool &ball = strip.data->tools[free], &above = strip.data->tools[plates[0]];
        behind = std::max(behind, pliant_distance3(ball.tip, ball.proxy.tip));
        farthest = std::max(farthest, pliant_distance3(above.tip, above.proxy.tip));
        for (int32_t p = 0; p < strip.data->contacts.count; p++)
            if (strip.data->contacts.point[p].tool == free)
                pressed = std::max(pressed, std::fabs(strip.data->contacts.point[p].force[2]));
        if (step > WAIT) shortened = std::min(shortened, strip.data->statistics.advanced);
    }
    EXPECT_LT(shortened, 1);    // the plates' legs are shortened while the ball moves,
    EXPECT_GT(farthest, 0.002); // so the plates stay behind
    EXPECT_LT(behind, 2e-4);    // and the ball does not
    EXPECT_GT(pressed, 0.01);   // although it presses the tissue
}

// A slow press is computed in one part.
TEST(SweptDynamics, ASlowToolPaysNothing)
{
    Sheet sheet(1, 0.2, 0, PLIANT_LINEAR, true);
    const int tool = sheet.add("ball", ball(0.006), 0.03, 0.03, 0.0105);
    for (int step = 0; step < 30; step++) {
        sheet.move(tool, 0.03, 0.03, 0.0105 - 0.0002 * step); // 10 mm/s
        ASSERT_EQ(pliant_step(sheet.model, sheet.data), PLIANT_OK);
        EXPECT_EQ(sheet.data->statistics.legs, 1);
        EXPECT_EQ(static_cast<int32_t>(sheet.data->statistics.iterations), sheet.data->tled->substeps);
    }
    EXPECT_GT(sheet.data->statistics.contacts, 0);
}

// A thin tool that moves through air at 0.25 m/s needs no parts either; near the sheet, frames are divided.
TEST(SweptDynamics, AToolInTheAirPaysNothing)
{
    Sheet sheet(1, 0.2, 0, PLIANT_LINEAR, true);
    const int tool = sheet.add("probe", ball(0.001), 0.03, 0.03, 0.08);
    int32_t parts = 1;
    for (int step = 1; step <= 17; step++) {
        const double z = 0.08 - 0.005 * step;
        sheet.move(tool, 0.03, 0.03, z);
        ASSERT_EQ(pliant_step(sheet.model, sheet.data), PLIANT_OK);
        if (z > 0.03) EXPECT_EQ(sheet.data->statistics.legs, 1) << z;
        if (std::fabs(z - 0.004) < 0.006) EXPECT_GT(sheet.data->statistics.legs, 5) << z;
        parts = std::max(parts, sheet.data->statistics.legs);
    }
    EXPECT_GT(parts, 5);
    EXPECT_GT(sheet.farthest(), 0.002);
}

// A frame has its number of sub-steps in any number of parts. Forces are means: the momentum of the pushed tissue
// equals the tool's impulse.
TEST(SweptDynamics, ForcesAreTheChangeOfMomentum)
{
    const int size[3] = {4, 4, 4};
    const double box[3] = {0.04, 0.04, 0.04}, mass = 1000 * box[0] * box[1] * box[2], from[3] = {0.0213, 0.0187, 0.06},
                 speed[3] = {0.2, -0.1, -0.9};
    Body cube(size, box, {{5000, 0.3, 1000, false}});
    cube.cells(4, 4, 4, 1);
    cube.scene.solver.kind = PLIANT_TLED;
    cube.scene.solver.threads = 1;
    cube.scene.tled.damping = 0;
    cube.scene.contact.friction = 0.3;
    cube.scene.ground.normal[2] = 1;
    cube.scene.ground.point[2] = -10; // falling is permitted
    ASSERT_EQ(cube.build(), PLIANT_OK) << pliant_last_error();
    const int tool = cube.add_ball(0.004);
    double before[3] = {0, 0, 0}, pushed = 0;
    int32_t parts = 1;
    for (int step = 0; step < 8; step++) {
        double tip[3], now[3] = {0, 0, 0}, force[3] = {0, 0, 0};
        for (int d = 0; d < 3; d++) tip[d] = from[d] + step * cube.scene.solver.step * speed[d];
        ASSERT_EQ(pliant_tool_set_pose(cube.data, tool, tip, nullptr), PLIANT_OK);
        const int32_t halvings = cube.data->tled->halvings;
        ASSERT_EQ(pliant_step(cube.model, cube.data), PLIANT_OK) << pliant_last_error();
        // halved in between: fewer
        if (cube.data->tled->halvings == halvings)
            EXPECT_EQ(static_cast<int32_t>(cube.data->statistics.iterations), cube.data->tled->substeps);
        parts = std::max(parts, cube.data->statistics.legs);
        const pliant_tled *tled = cube.data->tled;
        for (int32_t i = 0; i < 3 * cube.model->body->fine.num_nodes; i++)
            now[i % 3] += tled->system->node_mass[i / 3] * tled->d[i] / tled->time_step;
        for (int32_t p = 0; p < cube.data->contacts.count; p++)
            for (int d = 0; d < 3; d++) force[d] += cube.data->contacts.point[p].force[d];
        for (int d = 0; d < 3; d++) {
            EXPECT_NEAR(now[d] - before[d], force[d] * cube.scene.solver.step, 1e-6 * mass) << step;
            before[d] = now[d];
        }
        pushed = std::fmin(pushed, now[2] / mass);
    }
    EXPECT_GT(parts, 1);
    EXPECT_LT(pushed, -0.3); // m/s
}

// Unreasonable input of eight tools: seven tools jump into tissue and out of it, spin, or start inside. One tool grasps
// and jumps. Positions stay finite, and a failed step is reported.
TEST(SweptDynamics, HostileTools)
{
    Sheet sheet(1, 0.3, 0, PLIANT_LINEAR, true);
    std::vector<int> tools;
    for (int t = 0; t < PLIANT_MAX_TOOLS - 1; t++)
        tools.push_back(sheet.add(("t" + std::to_string(t)).c_str(), t % 2 ? ball(0.002) : rod(0.0008),
                                  0.012 + 0.005 * t, 0.03, t < 2 ? 0.002 : 0.02));
    const double held[3] = {0.03, 0.03, 0.004};
    const int holds = sheet.add("forceps", pliant_tool_shape{}, held[0], held[1], held[2]);
    ASSERT_EQ(pliant_tool_grasp(sheet.model, sheet.data, holds, held), PLIANT_OK) << pliant_last_error();
    std::mt19937 engine(3);
    const auto random = [&](double low, double high) {
        return low + (high - low) * std::uniform_real_distribution<double>()(engine);
    };
    int done = 0;
    for (int step = 0; step < 24; step++) {
        for (size_t t = 0; t < tools.size(); t++) {
            const double fast = 0.02 * step, x = 0.012 + 0.005 * t, turn = 1.3 * step + t;
            const double rotation[4] = {0, std::sin(turn), 0, std::cos(turn)}, nowhere[3] = {NAN, 0, 0};
            if (step % 5 == 0)
                EXPECT_EQ(pliant_tool_set_pose(sheet.data, tools[t], nowhere, nullptr), PLIANT_ERROR_ARGUMENT);
            switch (t % 4) {
            case 0: sheet.move(tools[t], x, 0.03, random(-0.03, 0.03)); break;            // jumps
            case 1: sheet.move(tools[t], x, 0.03, 0.02 * std::cos(fast / 0.02)); break;   // moves through and back
            case 2: sheet.move(tools[t], x, 0.03, 0.003, rotation); break;                // spins
            default: sheet.move(tools[t], x + 0.01 * std::sin(step), 0.03, 0.005); break; // sweeps along the sheet
            }
        }
        // jumps with the grasped tissue
        sheet.move(holds, 0.03, 0.03, step % 10 == 9 ? 0.06 : 0.004 + 0.0005 * (step % 10));
        const std::vector<double> before = positions_of(sheet, sheet.data);
        const pliant_status status = pliant_step(sheet.model, sheet.data);
        if (status < 0) EXPECT_EQ(before, positions_of(sheet, sheet.data)) << step << ": " << pliant_last_error();
        done += status >= 0;
        ASSERT_LT(sheet.farthest(), 1) << step; // and is finite
    }
    EXPECT_GT(done, 12);
}

} // namespace
