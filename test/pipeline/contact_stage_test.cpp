// The stage of a step that finds where instruments touch: whatever they do, nothing passes, nothing explodes, and it costs nothing where nothing can touch.
#include "body.h"
#include "contact/shapes.h"
#include "pliant/memory.h"
#include "sim/contact.h"
#include "solids.h"

#include <cstdlib>
#include <fstream>
#include <random>

namespace {

// A sheet of 60 x 60 x 4 mm at z = 0 to 4 mm, fixed at two sides.
struct Sheet : Body {
    explicit Sheet(int threads = 2, double friction = 0.08) : Body(size, box, {{4000, 0.4, 1000, false}})
    {
        fix_plane(0.001, 0, 0, 1, 0, 0);
        fix_plane(0.059, 0, 0, -1, 0, 0);
        cells(6, 6, 1, 1);
        scene.solver.threads = threads;
        scene.solver.iterations = 30;
        scene.solver.tolerance = 1e-4;
        scene.contact.friction = friction;
        EXPECT_EQ(build(), PLIANT_OK) << pliant_last_error();
    }
    int add(const char *name, const pliant_tool_shape &shape, double x, double y, double z)
    {
        int tool = -1;
        const double tip[3] = {x, y, z};
        EXPECT_EQ(pliant_tool_add(model, data, name, &tool), PLIANT_OK);
        EXPECT_EQ(pliant_tool_set_shape(data, tool, &shape), PLIANT_OK) << pliant_last_error();
        EXPECT_EQ(pliant_tool_set_pose(data, tool, tip, nullptr), PLIANT_OK);
        return tool;
    }
    void move(int tool, double x, double y, double z, const double *rotation = nullptr)
    {
        const double tip[3] = {x, y, z};
        ASSERT_EQ(pliant_tool_set_pose(data, tool, tip, rotation), PLIANT_OK);
    }
    // of any node from where it rests; NAN: a position is none
    double farthest() const
    {
        double most = 0;
        const pliant_mesh &fine = model->body->fine;
        for (int32_t n = 0; n < 3 * fine.num_nodes; n++) {
            if (!std::isfinite(data->positions[n])) return NAN;
            most = std::fmax(most, std::fabs(data->positions[n] - fine.rest[n]));
        }
        return most;
    }
    // the deepest that a node is in a tool
    double deepest(int index) const
    {
        const pliant_tool &tool = data->tools[index];
        double least = 0;
        for (int32_t p = 0; p < tool.shape.num_parts; p++) {
            pliant_pose pose;
            pliant_part_pose(&tool.shape, tool.shape.part[p].frame, tool.tip, tool.rotation, tool.jaw, &pose);
            for (int32_t n = 0; n < model->body->fine.num_nodes; n++) {
                double local[3], normal[3];
                pliant_pose_from(&pose, data->positions + 3 * n, local);
                least = std::fmin(least, pliant_part_distance(&tool.shape.part[p], local, normal));
            }
        }
        return -least;
    }

    // the same of its triangles
    double deepest_of_surface(int index) const
    {
        enum { PARTS = 16 };
        const pliant_tool &tool = data->tools[index];
        const pliant_body *body = data->body;
        double least = 0;
        pliant_pose pose;
        pliant_part_pose(&tool.shape, PLIANT_FRAME_TIP, tool.tip, tool.rotation, 0, &pose);
        for (int32_t t = 0; t < body->num_triangles; t++)
            for (int i = 0; i <= PARTS; i++)
                for (int j = 0; i + j <= PARTS; j++) {
                    const int weight[3] = {i, j, PARTS - i - j};
                    double at[3] = {0, 0, 0}, local[3], normal[3];
                    for (int c = 0; c < 9; c++) at[c % 3] += weight[c / 3] * data->positions[3 * body->triangles[3 * t + c / 3] + c % 3] / PARTS;
                    pliant_pose_from(&pose, at, local);
                    least = std::fmin(least, pliant_part_distance(&tool.shape.part[0], local, normal));
                }
        return -least;
    }
    // points along the middle of a tool's only part that lie in tissue
    int middles_inside(int index) const
    {
        enum { POINTS = 200 };
        const pliant_tool &tool = data->tools[index];
        const pliant_part &part = tool.shape.part[0];
        const pliant_mesh &fine = data->body->fine;
        pliant_pose pose;
        pliant_part_pose(&tool.shape, PLIANT_FRAME_TIP, tool.tip, tool.rotation, 0, &pose);
        int inside = 0;
        for (int p = 0; p <= POINTS; p++) {
            double local[3], at[3];
            for (int d = 0; d < 3; d++) {
                const bool solid = part.kind == PLIANT_PART_SOLID, box = part.kind == PLIANT_PART_BOX;
                const double from = box && d < 2 ? 0.5 * (part.from[d] + part.to[d]) : part.from[d], to = box && d < 2 ? from : solid ? (d == 2 ? 0.02 : 0) : part.to[d];
                local[d] = from + (to - from) * (p + 2) / (POINTS + 4); // not in its ends
            }
            pliant_pose_to(&pose, local, at);
            for (int32_t t = 0; t < fine.num_tets; t++) {
                const int32_t *node = fine.tets + 4 * t;
                double edge[3][3], to[3];
                for (int d = 0; d < 3; d++) {
                    for (int v = 0; v < 3; v++) edge[v][d] = data->positions[3 * node[v + 1] + d] - data->positions[3 * node[0] + d];
                    to[d] = at[d] - data->positions[3 * node[0] + d];
                }
                const auto triple = [](const double *a, const double *b, const double *c) {
                    return a[0] * (b[1] * c[2] - b[2] * c[1]) + a[1] * (b[2] * c[0] - b[0] * c[2]) + a[2] * (b[0] * c[1] - b[1] * c[0]);
                };
                const double whole = triple(edge[0], edge[1], edge[2]), a = triple(to, edge[1], edge[2]) / whole, b = triple(edge[0], to, edge[2]) / whole,
                             c = triple(edge[0], edge[1], to) / whole;
                if (whole > 0 && a > 0 && b > 0 && c > 0 && a + b + c < 1) {
                    inside++;
                    break;
                }
            }
        }
        return inside;
    }

private:
    static constexpr int size[3] = {12, 12, 2};
    static constexpr double box[3] = {0.06, 0.06, 0.004};
};
constexpr int Sheet::size[3];
constexpr double Sheet::box[3];

// along y, across the sheet
pliant_tool_shape rod(double radius, double length = 0.1)
{
    pliant_tool_shape shape{};
    shape.num_parts = 1;
    shape.part[0] = {PLIANT_PART_CAPSULE, PLIANT_FRAME_TIP, {0, -0.5 * length, 0}, {0, 0.5 * length, 0}, radius, false};
    return shape;
}

pliant_tool_shape ball(double radius)
{
    pliant_tool_shape shape{};
    shape.num_parts = 1;
    shape.part[0] = {PLIANT_PART_SPHERE, PLIANT_FRAME_TIP, {0, 0, 0}, {0, 0, 0}, radius, false};
    return shape;
}

// Tissue ends half way up the highest cubes, where a plate meets it: nothing is felt before, and then what a mesh
// feels whose cubes end there.
TEST(ContactStage, HexahedraAreTouchedWhereTheirTissueEnds)
{
    const int size[3] = {16, 16, 16};
    const double box[3] = {0.08, 0.08, 0.08}, top = 0.07;
    double force[2][2]; // coarse, fine; before, pressed
    for (int fine = 0; fine < 2; fine++) {
        Body block(size, box, {{4000, 0.3, 1000, false}, {1, 0.3, 1, true}}, [](int, int, int k) { return k < 14 ? 0 : 1; });
        block.scene.element.kind = PLIANT_HEXAHEDRA;
        block.cells(fine ? 8 : 4, fine ? 8 : 4, fine ? 8 : 4, 1);
        block.fix_plane(0, 0, 1e-6, 0, 0, 1);
        block.scene.solver.iterations = 30;
        block.scene.solver.tolerance = 1e-4;
        ASSERT_EQ(block.build(), PLIANT_OK) << pliant_last_error();
        pliant_tool_shape plate{};
        plate.num_parts = 1;
        plate.part[0] = {PLIANT_PART_BOX, PLIANT_FRAME_TIP, {-0.025, -0.025, 0}, {0.025, 0.025, 0.02}, 0, false};
        int tool = -1;
        double tip[3] = {0.04, 0.04, top + 0.001}, torque[3];
        ASSERT_EQ(pliant_tool_add(block.model, block.data, "plate", &tool), PLIANT_OK);
        ASSERT_EQ(pliant_tool_set_shape(block.data, tool, &plate), PLIANT_OK) << pliant_last_error();
        for (int pressed = 0; pressed < 2; pressed++) {
            for (int s = 0; s < (pressed ? 6 : 1); s++) {
                if (pressed && s < 4) tip[2] -= 0.002;
                ASSERT_EQ(pliant_tool_set_pose(block.data, tool, tip, nullptr), PLIANT_OK);
                ASSERT_GE(pliant_step(block.model, block.data), 0) << pliant_last_error();
            }
            double felt[3];
            pliant_contact_wrench(block.data, tool, felt, torque);
            force[fine][pressed] = -felt[2];
        }
    }
    std::printf("plate 7 mm into tissue that ends within cubes: %.3f N, cubes that end with it: %.3f N; 1 mm above: %.3g N\n", force[0][1], force[1][1], force[0][0]);
    EXPECT_LT(std::fabs(force[0][0]), 1e-6);
    EXPECT_NEAR(force[0][1], force[1][1], 0.1 * force[1][1]);
}

TEST(ContactStage, CostsNothingWhereNothingCanTouch)
{
    Sheet sheet;
    int tool;
    ASSERT_EQ(pliant_tool_add(sheet.model, sheet.data, "tool", &tool), PLIANT_OK);
    sheet.move(tool, 0.03, 0.03, 0.002);
    ASSERT_GE(pliant_step(sheet.model, sheet.data), 0);
    EXPECT_EQ(sheet.data->contact_search, nullptr);
    EXPECT_EQ(sheet.data->contacts.room, 0);
}

// A tool that is swept into the sheet at 1 m/s, 20 mm a step, and stops there.
struct Swept {
    double deepest, carried; // of points of the surface in the tool; the farthest that a node has gone
    int inside;              // points of the tool's middle that lie in a tetrahedron
};

Swept sweep(const pliant_part &part, const double from[3], const double way[3], const double *rotation, double friction)
{
    Sheet sheet(1, friction);
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
TEST(ContactStage, ARodAtOneMetreASecondCarriesTheSheetAlong)
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

// Whatever it is, wherever it goes. PLIANT_SWEEPS: as many, in place of 14.
TEST(ContactStage, NothingIsSweptThroughTheSheet)
{
    const char *const asked = std::getenv("PLIANT_SWEEPS");
    const int sweeps = asked ? std::atoi(asked) : 14;
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
        const Swept swept = sweep(part, from, way, rotation, random(0.05, 0.4));
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

// Into the sheet at once, and out of it: what is more than half inside comes out on the other side or stays, as far as it was in, and no further.
TEST(ContactStage, AToolThatJumpsIntoTheTissueDoesNotExplode)
{
    for (double z : {0.006, 0.003, 0.001}) {
        Sheet sheet;
        const int tool = sheet.add("ball", ball(0.004), 0.03, 0.03, 0.1);
        ASSERT_GE(pliant_step(sheet.model, sheet.data), 0);
        sheet.move(tool, 0.0311, 0.0292, z);
        for (int step = 0; step < 8; step++) {
            ASSERT_GE(pliant_step(sheet.model, sheet.data), 0);
            EXPECT_LT(sheet.farthest(), 0.010) << z << " step " << step;
        }
        sheet.move(tool, 0.03, 0.03, 0.1);
        for (int step = 0; step < 8; step++) ASSERT_GE(pliant_step(sheet.model, sheet.data), 0);
        EXPECT_LT(sheet.farthest(), 1e-4) << z;
        EXPECT_EQ(sheet.data->contacts.count, 0);
    }
}

TEST(ContactStage, AToolInTheTissueAtLoadIsLeftAndFeltFromOutside)
{
    Sheet sheet;
    const int tool = sheet.add("needle", rod(0.001, 0.02), 0.03, 0.03, 0.002); // wholly inside
    for (int step = 0; step < 10; step++) {
        ASSERT_GE(pliant_step(sheet.model, sheet.data), 0);
        EXPECT_LT(sheet.farthest(), 0.002) << step;
    }
    sheet.move(tool, 0.03, 0.03, 0.012); // out, without hindrance
    for (int step = 0; step < 10; step++) ASSERT_GE(pliant_step(sheet.model, sheet.data), 0);
    EXPECT_LT(sheet.farthest(), 2e-4);
    sheet.move(tool, 0.03, 0.03, -0.004);
    for (int step = 0; step < 10; step++) ASSERT_GE(pliant_step(sheet.model, sheet.data), 0);
    EXPECT_GT(sheet.farthest(), 0.004) << "and pushes from now on";
}

TEST(ContactStage, ASpinningToolStaysOutOfTheTissue)
{
    Sheet sheet;
    pliant_tool_shape paddle{};
    paddle.num_parts = 1;
    paddle.part[0] = {PLIANT_PART_BOX, PLIANT_FRAME_TIP, {-0.012, -0.01, -0.001}, {0.012, 0.01, 0.001}, 0, false};
    const int tool = sheet.add("paddle", paddle, 0.03, 0.03, 0.009); // its edge reaches 7 mm below the middle of the sheet
    double most = 0;
    for (int step = 0; step < 10; step++) {
        const double half = 0.5 * 2.1 * step, rotation[4] = {0, std::sin(half), 0, std::cos(half)};
        sheet.move(tool, 0.03, 0.03, 0.009, rotation);
        ASSERT_GE(pliant_step(sheet.model, sheet.data), 0);
        ASSERT_LT(sheet.farthest(), 0.05) << step;
        most = std::fmax(most, sheet.farthest());
    }
    EXPECT_GT(most, 0.004);
}

TEST(ContactStage, WhatIsNotFiniteIsRefusedAndChangesNothing)
{
    Sheet sheet;
    const int tool = sheet.add("ball", ball(0.004), 0.03, 0.03, 0.0075);
    const double nowhere[3] = {0.03, NAN, 0.0075}, tip[3] = {0.03, 0.03, 0.0075}, turned[4] = {0, 0, INFINITY, 1};
    EXPECT_EQ(pliant_tool_set_pose(sheet.data, tool, nowhere, nullptr), PLIANT_ERROR_ARGUMENT);
    EXPECT_EQ(pliant_tool_set_pose(sheet.data, tool, tip, turned), PLIANT_ERROR_ARGUMENT);
    EXPECT_EQ(pliant_tool_set_jaw(sheet.data, tool, NAN), PLIANT_ERROR_ARGUMENT);
    pliant_tool_shape shape = ball(0.004);
    shape.part[0].from[2] = NAN;
    EXPECT_EQ(pliant_tool_set_shape(sheet.data, tool, &shape), PLIANT_ERROR_ARGUMENT);
    EXPECT_NE(std::string(pliant_last_error()).find("tool ball: part 1 of its shape"), std::string::npos) << pliant_last_error();
    shape = ball(0.004);
    shape.part[0].frame = PLIANT_FRAME_JAW_PLUS;
    EXPECT_EQ(pliant_tool_set_shape(sheet.data, tool, &shape), PLIANT_ERROR_ARGUMENT) << "no axis";
    shape.num_parts = PLIANT_MAX_PARTS + 1;
    EXPECT_EQ(pliant_tool_set_shape(sheet.data, tool, &shape), PLIANT_ERROR_ARGUMENT);
    EXPECT_EQ(pliant_tool_set_shape(sheet.data, 3, &shape), PLIANT_ERROR_ARGUMENT);
    ASSERT_GE(pliant_step(sheet.model, sheet.data), 0);
    EXPECT_GT(sheet.data->contacts.count, 0);
    EXPECT_NEAR(sheet.deepest(tool), 0, 1e-4);
}

// Eight instruments of six parts and more; the same points, in the same order, for every number of threads.
TEST(ContactStage, EightToolsTouchAlikeForEveryNumberOfThreads)
{
    std::vector<pliant_contact_point> first;
    for (int threads : {1, 2, 3}) {
        Sheet sheet(threads);
        const char *const names[] = {"large_needle_driver", "prograsp_forceps", "monopolar_curved_scissors", "maryland_bipolar_forceps",
                                     "fenestrated_bipolar_forceps", "permanent_cautery_hook", "probe", "camera"};
        const double down[4] = {1, 0, 0, 0}; // z down
        for (int t = 0; t < PLIANT_MAX_TOOLS; t++) {
            pliant_tool_shape shape;
            ASSERT_EQ(pliant_tool_shape_find(names[t], &shape), PLIANT_OK);
            const double x = 0.012 + 0.012 * (t % 4), y = t < 4 ? 0.015 : 0.045;
            const int tool = sheet.add(names[t], shape, x, y, 0.003);
            sheet.move(tool, x, y, 0.003, down);
            ASSERT_EQ(pliant_tool_set_jaw(sheet.data, tool, 0.6), PLIANT_OK);
        }
        ASSERT_EQ(pliant_contact_stage(sheet.model, sheet.data), PLIANT_OK);
        const pliant_contacts &contacts = sheet.data->contacts;
        if (first.empty()) {
            first.assign(contacts.point, contacts.point + contacts.count);
            bool seen[PLIANT_MAX_TOOLS] = {};
            for (const pliant_contact_point &point : first) seen[point.tool] = true;
            for (bool each : seen) EXPECT_TRUE(each);
        }
        ASSERT_EQ(static_cast<size_t>(contacts.count), first.size());
        for (int32_t n = 0; n < contacts.count; n++) {
            if (n > 0) EXPECT_LT(contacts.point[n - 1].feature, contacts.point[n].feature);
            EXPECT_EQ(contacts.point[n].feature, first[n].feature);
            EXPECT_EQ(std::memcmp(contacts.point[n].place, first[n].place, sizeof first[n].place), 0);
            EXPECT_EQ(std::memcmp(contacts.point[n].normal, first[n].normal, sizeof first[n].normal), 0);
        }
        for (int step = 0; step < 3; step++) ASSERT_GE(pliant_step(sheet.model, sheet.data), 0);
        EXPECT_LT(sheet.farthest(), 0.02);
    }
}

TEST(ContactStage, WhatAToolHoldsItDoesNotPush)
{
    Sheet sheet;
    const int tool = sheet.add("ball", ball(0.004), 0.03, 0.03, 0.005);
    ASSERT_EQ(pliant_contact_stage(sheet.model, sheet.data), PLIANT_OK);
    EXPECT_GT(sheet.data->contacts.count, 0);
    sheet.data->tools[tool].radius = 0.02;
    const double middle[3] = {0.03, 0.03, 0.002};
    ASSERT_EQ(pliant_tool_grasp(sheet.model, sheet.data, tool, middle), PLIANT_OK);
    ASSERT_EQ(pliant_contact_stage(sheet.model, sheet.data), PLIANT_OK);
    EXPECT_EQ(sheet.data->contacts.count, 0);
    pliant_tool_release(sheet.data, tool);
    ASSERT_EQ(pliant_contact_stage(sheet.model, sheet.data), PLIANT_OK);
    EXPECT_GT(sheet.data->contacts.count, 0);
}

// A bar that sags rests on a box, and on a plane, by its weight.
TEST(ContactStage, TissueRestsOnObstacles)
{
    const std::string file = ::testing::TempDir() + "contact_stage_test.yaml";
    for (const int kind : {0, 1, 2}) { // a box, a plane, and the box as a hull in a file
        const bool plane = kind == 1;
        Sheet sheet;
        sheet.scene.model.gravity[2] = -9.81;
        ASSERT_EQ(sheet.build(), PLIANT_OK);
        for (int step = 0; step < 12; step++) ASSERT_GE(pliant_step(sheet.model, sheet.data), 0);
        const double sag = sheet.farthest();
        ASSERT_GT(sag, 0.002);
        if (plane) sheet.scene.obstacles.planes[sheet.scene.obstacles.num_planes++] = {{0, 0, -0.001}, {0, 0, 2}};
        else if (kind == 2) {
            std::ofstream(file) << "parts: [{kind: convex, from: [0.02, -0.01, -0.02], points: [[0, 0, 0], [0.02, 0, 0], [0, 0.08, 0], [0.02, 0.08, 0], [0, 0, 0.019], "
                                   "[0.02, 0, 0.019], [0, 0.08, 0.019], [0.02, 0.08, 0.019]]}]\n";
            std::snprintf(sheet.scene.contact.obstacles, sizeof sheet.scene.contact.obstacles, "%s", file.c_str());
        } else sheet.scene.obstacles.boxes[sheet.scene.obstacles.num_boxes++] = {{0.02, -0.01, -0.02}, {0.04, 0.07, -0.001}};
        ASSERT_EQ(sheet.build(), PLIANT_OK);
        for (int step = 0; step < 12; step++) ASSERT_GE(pliant_step(sheet.model, sheet.data), 0);
        EXPECT_GT(sheet.data->contacts.count, 0);
        double lowest = 0, force = 0;
        for (int32_t n = 0; n < sheet.model->body->fine.num_nodes; n++) {
            const double *x = sheet.data->positions + 3 * n;
            if (plane || std::fabs(x[0] - 0.03) < 0.009) lowest = std::fmin(lowest, x[2]); // at its edges and beside it, the sheet hangs lower
        }
        for (int32_t n = 0; n < sheet.data->contacts.count; n++) {
            EXPECT_EQ(sheet.data->contacts.point[n].kind, PLIANT_OBSTACLE_GROUND);
            EXPECT_EQ(sheet.data->contacts.point[n].tool, -1);
            force += sheet.data->contacts.point[n].force[2];
        }
        EXPECT_GT(lowest, -0.00105) << plane;
        EXPECT_LT(lowest, -0.0009);
        EXPECT_GT(force, 0.02); // of a weight of 0.14 N; the sides carry the rest
        EXPECT_LT(force, 0.14);
    }
    std::ofstream(file) << "parts: [{kind: mesh, file: none.stl}]\n";
    Sheet sheet;
    std::snprintf(sheet.scene.contact.obstacles, sizeof sheet.scene.contact.obstacles, "%s", file.c_str());
    EXPECT_EQ(sheet.build(), PLIANT_ERROR_FORMAT);
    EXPECT_NE(std::string(pliant_last_error()).find("none.stl: cannot be opened"), std::string::npos) << pliant_last_error();
    std::remove(file.c_str());
}

// What a ball presses with, it presses with as a hull of triangles and as their field, which are up to 0.05 mm less thick.
TEST(ContactStage, SolidsPressAsTheShapeThatTheyAre)
{
    double force[3] = {0, 0, 0};
    for (int kind = 0; kind < 3; kind++) {
        pliant_solid *solid = nullptr;
        pliant_solid_options options{};
        options.convex = kind == 1;
        options.resolution = 4e-4;
        ASSERT_EQ(ball_surface(0.006).make(options, &solid), PLIANT_OK) << pliant_last_error();
        const size_t before = pliant_memory_in_use();
        {
            Sheet sheet;
            pliant_tool_shape shape{};
            shape.num_parts = 1;
            shape.part[0].kind = kind ? PLIANT_PART_SOLID : PLIANT_PART_SPHERE;
            shape.part[0].solid = kind ? solid : nullptr;
            shape.part[0].radius = kind ? 0 : 0.006;
            const int tool = sheet.add("ball", shape, 0.031, 0.029, 0.0105);
            ASSERT_EQ(pliant_tool_set_shape(sheet.data, tool, &shape), PLIANT_OK) << "again";
            for (int step = 0; step < 6; step++) {
                sheet.move(tool, 0.031, 0.029, 0.0105 - 0.0005 * (step + 1));
                ASSERT_GE(pliant_step(sheet.model, sheet.data), 0);
            }
            EXPECT_LT(sheet.deepest(tool), 2e-5);
            double torque[3], total[3];
            pliant_contact_wrench(sheet.data, tool, total, torque);
            force[kind] = -total[2];
            pliant_data *copy = nullptr;
            ASSERT_EQ(pliant_data_copy(sheet.model, sheet.data, &copy), PLIANT_OK); // holds the solid, too
            pliant_data_free(copy);
        }
        EXPECT_EQ(pliant_memory_in_use(), before);
        pliant_solid_release(solid);
    }
    EXPECT_GT(force[0], 0.01);
    EXPECT_NEAR(force[1], force[0], 0.03 * force[0]);
    EXPECT_NEAR(force[2], force[0], 0.03 * force[0]);
}

TEST(ContactStage, ForcesOfNodesAreAScalar)
{
    Sheet sheet;
    const int tool = sheet.add("ball", ball(0.006), 0.03, 0.03, 0.0085);
    ASSERT_GE(pliant_step(sheet.model, sheet.data), 0);
    sheet.move(tool, 0.03, 0.03, 0.0075);
    ASSERT_GE(pliant_step(sheet.model, sheet.data), 0);
    const size_t nodes = static_cast<size_t>(sheet.data->body->fine.num_nodes);
    std::vector<float> scalar(nodes);
    std::vector<double> force(3 * nodes);
    ASSERT_EQ(pliant_data_get_scalar(sheet.model, sheet.data, PLIANT_SCALAR_CONTACT_FORCE, scalar.data()), PLIANT_OK);
    pliant_data_get_contact_forces(sheet.data, force.data());
    double total[3], torque[3], sum = 0, largest = 0;
    pliant_contact_wrench(sheet.data, tool, total, torque);
    for (size_t n = 0; n < nodes; n++) {
        EXPECT_FLOAT_EQ(scalar[n], static_cast<float>(std::sqrt(force[3 * n] * force[3 * n] + force[3 * n + 1] * force[3 * n + 1] + force[3 * n + 2] * force[3 * n + 2])));
        sum += force[3 * n + 2];
        largest = std::fmax(largest, scalar[n]);
    }
    EXPECT_NEAR(sum, total[2], 1e-9);
    EXPECT_LT(total[2], -0.001);
    EXPECT_GT(largest, 0.1 * -total[2]);
    EXPECT_EQ(pliant_data_scalar(sheet.model, sheet.data->body, sheet.data->positions, PLIANT_SCALAR_CONTACT_FORCE, scalar.data()), PLIANT_ERROR_ARGUMENT);
}

// An allocation that fails leaves positions and points as they were; the next step goes on as if nothing had been.
TEST(ContactStage, FailingAllocationsChangeNothing)
{
    Sheet sheet, again;
    Sheet *const both[] = {&sheet, &again};
    for (Sheet *one : both) one->add("rod", rod(0.0042), 0.03, 0.03, 0.009);
    int failures = 0;
    for (int64_t calls = 0;; calls++) {
        const std::vector<double> before(sheet.data->positions, sheet.data->positions + 3 * sheet.model->body->fine.num_nodes);
        const int32_t count = sheet.data->contacts.count;
        pliant_memory_fail_after(calls);
        const pliant_status status = pliant_contact_stage(sheet.model, sheet.data);
        pliant_memory_fail_after(-1);
        if (status == PLIANT_OK) break;
        ASSERT_EQ(status, PLIANT_ERROR_MEMORY);
        failures++;
        EXPECT_EQ(sheet.data->contacts.count, count);
        EXPECT_EQ(std::memcmp(before.data(), sheet.data->positions, before.size() * sizeof before[0]), 0);
    }
    EXPECT_GT(failures, 5);
    for (int step = 0; step < 3; step++)
        for (Sheet *one : both) {
            one->move(0, 0.03, 0.03, 0.008 - 0.002 * step);
            ASSERT_GE(pliant_step(one->model, one->data), 0);
        }
    EXPECT_EQ(std::memcmp(sheet.data->positions, again.data->positions, 3 * static_cast<size_t>(sheet.model->body->fine.num_nodes) * sizeof(double)), 0);
}

// A copy goes on bit for bit, sides and motion of the tissue with it; a reset begins anew.
TEST(ContactStage, ACopyGoesOnAndAResetBeginsAnew)
{
    Sheet sheet;
    const int tool = sheet.add("rod", rod(0.002), 0.03, 0.03, 0.007);
    auto run = [&](pliant_data *data) {
        std::vector<double> out;
        for (int step = 0; step < 4; step++) {
            const double tip[3] = {0.03 + 0.001 * step, 0.03, 0.006 - 0.0015 * step};
            EXPECT_EQ(pliant_tool_set_pose(data, tool, tip, nullptr), PLIANT_OK);
            EXPECT_GE(pliant_step(sheet.model, data), 0);
        }
        for (int32_t n = 0; n < data->contacts.count; n++)
            out.insert(out.end(), data->contacts.point[n].place, data->contacts.point[n].place + 3);
        return out;
    };
    const std::vector<double> first = run(sheet.data);
    ASSERT_FALSE(first.empty());
    pliant_data *copy = nullptr;
    ASSERT_EQ(pliant_data_copy(sheet.model, sheet.data, &copy), PLIANT_OK);
    const double tip[3] = {0.034, 0.03, 0.0};
    for (pliant_data *data : {sheet.data, copy}) {
        ASSERT_EQ(pliant_tool_set_pose(data, tool, tip, nullptr), PLIANT_OK);
        ASSERT_EQ(pliant_contact_stage(sheet.model, data), PLIANT_OK);
    }
    ASSERT_EQ(copy->contacts.count, sheet.data->contacts.count);
    for (int32_t n = 0; n < copy->contacts.count; n++) {
        EXPECT_EQ(copy->contacts.point[n].feature, sheet.data->contacts.point[n].feature);
        EXPECT_EQ(std::memcmp(copy->contacts.point[n].place, sheet.data->contacts.point[n].place, 3 * sizeof(double)), 0);
    }
    pliant_data_free(copy);
    ASSERT_EQ(pliant_data_reset(sheet.model, sheet.data), PLIANT_OK);
    EXPECT_EQ(sheet.data->contacts.count, 0);
    sheet.move(tool, 0.03, 0.03, 0.007);
    const std::vector<double> second = run(sheet.data);
    ASSERT_EQ(second.size(), first.size());
}

// Of a ball, or a rod, that presses and sticks: what its forces do as it moves, against what the solver's own do.
TEST(ContactStage, StiffnessOfAToolThatPresses)
{
    for (bool is_ball : {true, false}) {
        Sheet sheet(1);
        sheet.scene.solver.tolerance = 1e-8;
        sheet.scene.contact.friction = 50;
        ASSERT_EQ(sheet.build(), PLIANT_OK);
        pliant_tool_shape shape = is_ball ? ball(0.01) : rod(0.005, 0.03);
        const double above[3] = {0, 0, is_ball ? 0.01 : 0.005};
        pliant_tool_shape_move(&shape, above); // the tip is on its lowest line
        const int tool = sheet.add("presses", shape, 0.03, 0.03, 0.006);
        pliant_tool_linear linear{};
        const auto change = [&](int axis, double step, double out[6]) {
            for (int sign = -1; sign < 2; sign += 2) {
                const double turn = axis > 2 ? sign * step : 0, rotation[4] = {std::sin(0.5 * turn), 0, 0, std::cos(0.5 * turn)};
                double to[3] = {0.03, 0.03, linear.tip[2]};
                if (axis < 3) to[axis] += sign * step;
                pliant_tool_linear there{};
                for (int s = 0; s < 30; s++) {
                    sheet.move(tool, to[0], to[1], to[2], rotation);
                    ASSERT_GE(pliant_step(sheet.model, sheet.data), 0) << pliant_last_error();
                }
                ASSERT_EQ(pliant_tool_linearize(sheet.data, tool, &there), PLIANT_OK);
                for (int a = 0; a < 6; a++) out[a] = (there.wrench[a] - (sign > 0 ? out[a] : 0)) / (sign > 0 ? 2 * step : 1);
            }
        };
        for (int s = 0; s < 40; s++) {
            sheet.move(tool, 0.03, 0.03, 0.006 - 0.0001 * std::min(s, 35));
            ASSERT_GE(pliant_step(sheet.model, sheet.data), 0);
        }
        ASSERT_EQ(pliant_tool_linearize(sheet.data, tool, &linear), PLIANT_OK);
        ASSERT_FALSE(linear.by_secants);
        sheet.move(tool, 0.03, 0.03, 0.01); // not yet: the wrench is of where it was in the step
        ASSERT_EQ(pliant_tool_linearize(sheet.data, tool, &linear), PLIANT_OK);
        EXPECT_EQ(linear.tip[2], 0.006 - 0.0001 * 35);
        ASSERT_LT(linear.wrench[2], -0.005);
        double measured[6];
        for (int axis = is_ball ? 0 : 2; axis < (is_ball ? 3 : 4); axis++) {
            change(axis, axis < 3 ? 2e-6 : 1e-4, measured);
            EXPECT_GT(linear.stiffness[7 * axis], 1e-6);
            EXPECT_NEAR(linear.stiffness[7 * axis], measured[axis], 0.15 * measured[axis]) << axis;
        }
    }
}

} // namespace
