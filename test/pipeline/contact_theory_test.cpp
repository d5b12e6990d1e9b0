// Instrument shapes with the step's own collision detection, against closed forms: Hertz, Sneddon, Coulomb.
// contact_solver_test tests the same with given contact points.
#include "half_space.h"
#include "../solids.h"

#include <algorithm>
#include <array>
#include <cstdio>

namespace {

const pliant_element_kind kinds[] = {PLIANT_LINEAR, PLIANT_HEXAHEDRA};

int add_tool(Body &body, const char *name, const pliant_part &part)
{
    pliant_tool_shape shape{};
    int tool = -1;
    shape.num_parts = 1;
    shape.part[0] = part;
    EXPECT_EQ(pliant_tool_add(body.model, body.data, name, &tool), PLIANT_OK);
    EXPECT_EQ(pliant_tool_set_shape(body.data, tool, &shape), PLIANT_OK) << pliant_last_error();
    return tool;
}

pliant_part box(double x0, double y0, double z0, double x1, double y1, double z1)
{
    return {PLIANT_PART_BOX, PLIANT_FRAME_TIP, {x0, y0, z0}, {x1, y1, z1}, 0, false, nullptr};
}

struct Force {
    double by[3];           // total force
    double presses, slides; // sums over the points, along their normals and tangentially
};

// Return the force of a tool on the tissue, or of an obstacle (-1).
Force contact_force_of(const Body &body, int tool)
{
    Force out{};
    std::vector<pliant_contact> points(static_cast<size_t>(pliant_data_get_contacts(body.data, 0, nullptr)));
    pliant_data_get_contacts(body.data, static_cast<int32_t>(points.size()), points.data());
    for (const pliant_contact &point : points) {
        if (point.tool != tool || point.tissue) continue;
        for (int d = 0; d < 3; d++) out.by[d] += point.force[d];
        double n = 0;
        for (int d = 0; d < 3; d++) n += point.normal[d] * point.force[d];
        out.presses += n;
        out.slides += std::sqrt(std::fmax(0, point.force[0] * point.force[0] + point.force[1] * point.force[1] +
                                                 point.force[2] * point.force[2] - n * n));
    }
    return out;
}

// Return the mean of the last two steps with tools at rest, because points at the border of a flat tool alternate
// between steps.
Force press(Body &body, int tool, int steps = 8)
{
    Force last{}, now{};
    for (int s = 0; s < steps; s++) {
        EXPECT_GE(pliant_step(body.model, body.data), 0) << pliant_last_error();
        last = now;
        now = contact_force_of(body, tool);
    }
    for (int d = 0; d < 3; d++) now.by[d] = 0.5 * (now.by[d] + last.by[d]);
    return now;
}

void place(Body &body, int tool, double x, double y, double z)
{
    const double tip[3] = {x, y, z};
    ASSERT_EQ(pliant_tool_set_pose(body.data, tool, tip, nullptr), PLIANT_OK);
}

// Hertz (Johnson, Contact Mechanics, 4.22 to 4.24): F = 4/3 E* sqrt(R) d^1.5, E* = E / (1 - nu^2), contact radius a =
// sqrt(R d). Nodes come into contact ring by ring, so that the force error of a mesh oscillates. Its amplitude is 0.06
// to 0.1 of h / a, measured with 2.2 to 7.2 elements of size h in a. The mean over four radii between two rings
// is 0.7 % with both sizes (tetrahedra), whose coupling adds the missing compliance, and -2.1 and -0.2 % (hexahedra).
TEST(ContactTheory, ABallOnAHalfSpaceAsHertz)
{
    const double radius = 1;
    for (pliant_element_kind kind : kinds) {
        double mean[2] = {0, 0};
        for (int fine = 0; fine < 2; fine++) {
            HalfSpace block(fine ? 24 : 12, kind);
            const int tool = block.add_ball(radius);
            for (double a : {0.015, 0.018, 0.021, 0.024}) {
                const double depth = a * a / radius, hertz = 4.0 / 3 * young / (1 - block.nu * block.nu) *
                                                             std::sqrt(radius) * std::pow(depth, 1.5);
                const double size = block.edge / (fine ? 24 : 12);
                block.move_far(1.5, hertz, a);
                place(block, tool, block.edge / 2, block.edge / 2, block.height + radius - depth);
                const Force force = press(block, tool, 4);
                EXPECT_NEAR(-force.by[2], hertz, 0.11 * size / a * hertz) << "elements " << kind << ", a " << a;
                EXPECT_LT(std::hypot(force.by[0], force.by[1]), 1e-5 * hertz);
                EXPECT_LT(block.data->statistics.penetration, 1e-8 * depth);
                mean[fine] += 0.25 * (-force.by[2] / hertz - 1);
            }
        }
        std::printf("elements %d: force of a ball over that of Hertz - 1, 12 and 24 elements along: %.4f, %.4f\n", kind,
                    mean[0], mean[1]);
        EXPECT_LT(std::fabs(mean[0]), 0.03);
        EXPECT_LT(std::fabs(mean[1]), 0.01);
    }
}

// A ball rests deep in coarse cells, away from their nodes. The triangles turn under the force, but the contact points
// settle. Points that follow the nearest point at once alternate between two states, whose forces differ by 8 %. Points
// that do not stay below the sag settle slower on hexahedra: the forces of eight steps differ by 0.5 %.
TEST(ContactTheory, PointsSettleOnCoarseCells)
{
    const double edge = 0.12, height = 0.06;
    for (int n = 0; n < 4; n++) {
        const bool hexahedra = n >= 2;
        const double friction = n % 2 ? 0.3 : 0, depth = hexahedra ? 0.004 : 0.008;
        Body block(std::vector<int>{12, 12, 6}.data(), std::vector<double>{edge, edge, height}.data(),
                   {{10e3, 0.45, 1000, false}});
        for (double &g : block.scene.model.gravity) g = 0;
        block.cells(12, 12, 6, 1);
        block.fix_plane(0, 0, 1e-4, 0, 0, 1);
        block.scene.element.kind = hexahedra ? PLIANT_HEXAHEDRA : PLIANT_LINEAR;
        block.scene.contact.friction = friction;
        block.scene.solver.tolerance = 1e-5;
        ASSERT_EQ(block.build(), PLIANT_OK) << pliant_last_error();
        for (const auto &aside : {std::array<double, 2>{0.0047, 0.0021}, std::array<double, 2>{0.0033, 0.0047}}) {
            ASSERT_EQ(pliant_data_reset(block.model, block.data), PLIANT_OK);
            const int tool = block.add_ball(0.02);
            double low = INFINITY, high = 0;
            for (int s = 0; s <= 24; s++) {
                place(block, tool, edge / 2 + aside[0], edge / 2 + aside[1],
                      height + 0.02 - depth * std::fmin(1, s / 8.0));
                ASSERT_GE(pliant_step(block.model, block.data), 0) << pliant_last_error();
                const double force = -contact_force_of(block, tool).by[2];
                if (s < 17) continue;
                low = std::fmin(low, force), high = std::fmax(high, force);
            }
            std::printf("%s, friction %g, %g mm aside: resting force %.4f to %.4f N\n",
                        hexahedra ? "hexahedra" : "tetrahedra", friction, 1e3 * aside[0], low, high);
            EXPECT_LT(high - low, 1e-3 * high);
        }
    }
}

// A soft coupling that stays far behind its target pulls with its stiffness times the distance, although the distance
// is several legs long. At rest a step has one leg.
TEST(ContactTheory, ASoftCouplingPullsByItsDistance)
{
    const double edge = 0.12, height = 0.06, stiffness = 50, depth = 0.04;
    Body block(std::vector<int>{12, 12, 6}.data(), std::vector<double>{edge, edge, height}.data(),
               {{10e3, 0.45, 1000, false}});
    for (double &g : block.scene.model.gravity) g = 0;
    block.cells(12, 12, 6, 1);
    block.fix_plane(0, 0, 1e-4, 0, 0, 1);
    block.scene.solver.tolerance = 1e-5;
    block.scene.solver.iterations = 30;
    block.scene.contact.coupling_stiffness = stiffness;
    ASSERT_EQ(block.build(), PLIANT_OK) << pliant_last_error();
    block.model->without_missing_compliance = true;
    const int tool = add_tool(
        block, "probe", {PLIANT_PART_SPHERE, PLIANT_FRAME_TIP, {0, 0, 0.02}, {0, 0, 0}, 0.02, false, nullptr});
    pliant_tool_state state{};
    for (int s = 0; s <= 40; s++) {
        place(block, tool, edge / 2, edge / 2, height + 0.002 - std::fmin(s * 0.004, 0.002 + depth));
        ASSERT_GE(pliant_step(block.model, block.data), 0) << pliant_last_error();
        ASSERT_EQ(pliant_tool_get(block.data, tool, &state), PLIANT_OK);
    }
    const double behind = std::fabs(state.proxy_error[2]), force = -state.contact_force[2];
    EXPECT_GT(behind, 0.02);
    EXPECT_NEAR(force, stiffness * behind, 1e-3 * force);
    EXPECT_EQ(block.data->statistics.legs, 1);
}

// The error of a force on coarse cells, against the converged force. It is a standard deviation: the coupling adds the
// missing compliance, so the errors that are left have both signs. The references are the axisymmetric solutions of
// test/reference/indentation.py for a sphere of 20 mm and a punch of 15 mm; bench_force has more cases. A block without
// contact has no error. Each instrument has one warning when its contact is narrow, and one if its shape is small.
TEST(ContactTheory, TheErrorOfAForceIsWithinAFactorOfThree)
{
    struct Case { double depth, force; bool is_punch; double x, y; };
    const Case cases[] = {{0.002, 0.2134, false, 0, 0},           {0.002, 0.2134, false, 0.0047, 0.0021},
                          {0.004, 0.5964, false, 0, 0},           {0.008, 1.6094, false, 0, 0},
                          {0.008, 1.6094, false, 0.0033, 0.0047}, {0.001, 0.462, true, 0, 0}};
    const double edge = 0.12, height = 0.06;
    std::string said;
    pliant_set_log(
        [](pliant_log_level level, const char *text, void *user) {
            if (level == PLIANT_LOG_WARNING) *static_cast<std::string *>(user) += std::string(text) + "\n";
        },
        &said);
    Body block(std::vector<int>{12, 12, 6}.data(), std::vector<double>{edge, edge, height}.data(),
               {{10e3, 0.45, 1000, false}});
    for (double &g : block.scene.model.gravity) g = 0;
    block.cells(12, 12, 6, 1);
    block.fix_plane(0, 0, 1e-4, 0, 0, 1);
    block.scene.solver.tolerance = 1e-4;
    ASSERT_EQ(block.build(), PLIANT_OK) << pliant_last_error();
    pliant_solid *solid = nullptr;
    pliant_solid_options options{};
    options.convex = true;
    ASSERT_EQ(rod_surface(0.015, 0.02, 48).make(options, &solid), PLIANT_OK) << pliant_last_error();
    double errors = 0, estimates = 0; // sums of squares, relative to the forces
    for (const Case &of : cases) {
        ASSERT_EQ(pliant_data_reset(block.model, block.data), PLIANT_OK);
        pliant_part part = {PLIANT_PART_SOLID, PLIANT_FRAME_TIP, {0, 0, 0}, {0, 0, 0}, 0, false, solid};
        if (!of.is_punch) part = {PLIANT_PART_SPHERE, PLIANT_FRAME_TIP, {0, 0, 0.02}, {0, 0, 0}, 0.02, false, nullptr};
        const int tool = add_tool(block, "probe", part);
        pliant_tool_state state{};
        double force = 0, before = 0; // mean of the last two steps, because contact points alternate between steps
        for (int s = -1; s <= 7; s++) {
            place(block, tool, edge / 2 + of.x, edge / 2 + of.y, height - of.depth * std::fmin(1, 0.5 * s));
            ASSERT_GE(pliant_step(block.model, block.data), 0) << pliant_last_error();
            ASSERT_EQ(pliant_tool_get(block.data, tool, &state), PLIANT_OK);
            if (s < 0) EXPECT_EQ(state.contact_force_error, 0);
            force = -0.5 * (state.contact_force[2] + before);
            before = state.contact_force[2];
        }
        EXPECT_NEAR(force, of.force, 0.1 * of.force) << of.depth << ", " << of.x;
        EXPECT_LT(std::fabs(force - of.force), 3 * state.contact_force_error) << of.depth << ", " << of.x;
        errors += std::pow(force / of.force - 1, 2);
        estimates += std::pow(state.contact_force_error / of.force, 2);
    }
    std::printf("root mean square of the forces' errors %.3f, of the estimates %.3f\n", std::sqrt(errors / 6),
                std::sqrt(estimates / 6));
    EXPECT_LT(std::sqrt(estimates), 3 * std::sqrt(errors));
    pliant_solid_release(solid);
    const std::string live = "tool probe: its contact has a radius of ",
                      at_load = "tool probe: its contacts have a radius of at most 5 mm, below two cells";
    size_t warnings = 0;
    for (size_t at = said.find(live); at != std::string::npos; at = said.find(live, at + 1)) warnings++;
    EXPECT_EQ(warnings, sizeof cases / sizeof *cases) << said;
    said.clear();
    for (const double radius : {0.025, 0.005})
        add_tool(block, "probe", {PLIANT_PART_SPHERE, PLIANT_FRAME_TIP, {0, 0, 0}, {0, 0, 0}, radius, false, nullptr});
    EXPECT_EQ(said.find(at_load), 0u) << said;
    EXPECT_EQ(said.find("at most"), said.rfind("at most")) << said;
    said.clear();
    const pliant_part wide = {PLIANT_PART_BOX, PLIANT_FRAME_TIP, {0, 0, 0}, {0.05, 0.05, 0.001}, 0, false, nullptr};
    add_tool(block, "probe", wide);
    EXPECT_EQ(said, "");
    pliant_part blade = wide;
    blade.to[1] = 0.002;
    add_tool(block, "probe", blade);
    EXPECT_EQ(said.find("tool probe: its contacts have a radius of at most 1 mm, below two cells"), 0u) << said;
    pliant_set_log(nullptr, nullptr);
}

// F = 2 E* a d (Sneddon, Int. J. Engng Sci. 3:47, 1965; Johnson, 3.36). The pressure is infinite at the punch's border,
// which lies within elements. Surface edges across the border do not enter the punch, so they are pressed flat out to
// their next node. The effective radius is therefore at most one element size h larger, and the force at most h / a.
TEST(ContactTheory, APunchOnAHalfSpaceAsSneddon)
{
    const double depth = 2e-4, middle = 0.02;
    const int borders = 6;
    for (pliant_element_kind kind : kinds) {
        double mean[2] = {0, 0};
        for (int fine = 0; fine < 2; fine++) {
            HalfSpace block(fine ? 24 : 12, kind);
            const double size = block.edge / (fine ? 24 : 12);
            block.scene.contact.friction = 0;
            ASSERT_EQ(block.build(), PLIANT_OK) << pliant_last_error();
            for (int b = 0; b < borders; b++) {
                const double radius = middle + ((b + 0.5) / borders - 0.5) * size,
                             sneddon = 2 * young / (1 - block.nu * block.nu) * radius * depth;
                pliant_solid *solid = nullptr;
                pliant_solid_options options{};
                options.convex = true;
                ASSERT_EQ(rod_surface(radius, 0.02, 96).make(options, &solid), PLIANT_OK) << pliant_last_error();
                ASSERT_EQ(pliant_data_reset(block.model, block.data), PLIANT_OK);
                const int tool = add_tool(block, "punch",
                                          {PLIANT_PART_SOLID, PLIANT_FRAME_TIP, {0, 0, 0}, {0, 0, 0}, 0, false, solid});
                pliant_solid_release(solid);
                block.move_far(0.5, sneddon, radius);
                place(block, tool, block.edge / 2, block.edge / 2, block.height - depth);
                const double ratio = -press(block, tool).by[2] / sneddon;
                EXPECT_NEAR(ratio, 1, size / radius) << "elements " << kind << ", radius " << radius;
                mean[fine] += (ratio - 1) / borders;
            }
            EXPECT_NEAR(mean[fine], 0, size / middle) << "elements " << kind;
        }
        std::printf("elements %d: force of a punch over that of Sneddon - 1, 12 and 24 elements along: %.4f, %.4f\n",
                    kind, mean[0], mean[1]);
        EXPECT_LT(std::fabs(mean[1]), std::fabs(mean[0]));
    }
}

// A flat box presses and moves aside. While it sticks, the force is proportional to the displacement: the second
// millimetre adds as much as the first, up to the effect of rotation. Then all points slide, and by Coulomb's law the
// force is mu N up to rounding on any mesh.
TEST(ContactTheory, AFlatToolSticksAndSlidesAtMu)
{
    const double friction = 0.3;
    for (pliant_element_kind kind : kinds) {
        Block block(4, 4, 0.3);
        block.scene.element.kind = kind;
        block.scene.contact.friction = friction;
        block.fix_below();
        ASSERT_EQ(block.build(), PLIANT_OK) << pliant_last_error();
        const int tool = add_tool(block, "plate", box(-0.12, -0.12, 0, 0.12, 0.12, 0.05));
        double pulled[16], z = block.height;
        for (int s = 1; s <= 6; s++) {
            place(block, tool, block.edge / 2, block.edge / 2, z - 0.001 * s);
            press(block, tool, 2);
        }
        for (int s = 0; s < 16; s++) {
            place(block, tool, block.edge / 2 + 0.001 * (s + 1), block.edge / 2, z - 0.006);
            const Force force = press(block, tool, 3);
            pulled[s] = force.by[0] / -force.by[2];
            for (int32_t p = 0; p < block.data->contacts.count; p++) {
                const double *f = block.data->contacts.point[p].force;
                EXPECT_LE(std::hypot(f[0], f[1]), friction * -f[2] * (1 + 1e-9));
            }
        }
        EXPECT_LT(pulled[0], 0.5 * friction);
        EXPECT_NEAR(pulled[1] / pulled[0], 2, 0.1);
        EXPECT_NEAR(pulled[14], friction, 1e-3 * friction);
        EXPECT_NEAR(pulled[15], friction, 1e-3 * friction);
    }
}

// A shaft lies on tissue and is moved along its own axis. Its surface does not change, but the tissue must slide along
// it. The force is mu N, where N is the sum along the points' normals around the shaft.
TEST(ContactTheory, AShaftThatIsDrawnAlongItsAxisFeelsMuN)
{
    for (const double friction : {0.1, 0.3}) {
        Block block(6, 4, 0.3);
        block.scene.contact.friction = friction;
        block.fix_below();
        ASSERT_EQ(block.build(), PLIANT_OK) << pliant_last_error();
        const double radius = 0.02;
        const int tool = add_tool(
            block, "shaft", {PLIANT_PART_CAPSULE, PLIANT_FRAME_TIP, {-0.2, 0, 0}, {0.2, 0, 0}, radius, false, nullptr});
        for (int s = 1; s <= 4; s++) {
            place(block, tool, block.edge / 2, 0.0553, block.height + radius - 0.002 * s);
            press(block, tool, 2);
        }
        EXPECT_LT(std::fabs(contact_force_of(block, tool).by[0]),
                  0.02 * contact_force_of(block, tool).presses); // not moved yet
        Force force{};
        double first = 0;
        for (int s = 0; s < 12; s++) {
            place(block, tool, block.edge / 2 + 0.002 * (s + 1), 0.0553, block.height + radius - 0.008);
            force = press(block, tool, 2);
            if (s == 0) first = force.by[0] / force.presses;
        }
        EXPECT_GT(force.presses, 1);
        EXPECT_GT(first, 0.1 * friction);
        EXPECT_NEAR(force.by[0] / force.presses, friction, 2e-3 * friction);
        place(block, tool, block.edge / 2 + 0.002 * 13, 0.0553, block.height + radius - 0.008);
        force = press(block, tool, 1); // while the shaft rests, some points may stick
        EXPECT_NEAR(force.slides / force.presses, friction, 1e-6);
    }
}

// A detached piece lies on a plane, and gravity tilts. Below tan = mu the piece stays, after the friction springs have
// yielded by 0.02 mm. Above, it accelerates by g (sin - mu cos).
TEST(ContactTheory, ARigidBodySlidesDownAPlaneAboveTanMu)
{
    const double friction = 0.3, g = 9.81, high = 0.03, box[3] = {0.015, 0.015, high};
    const int size[3] = {6, 6, 12};
    for (pliant_element_kind kind : kinds)
        for (double slope : {0.95 * friction, 1.05 * friction}) {
            Body bar(size, box, {{10e3, 0.3, 1000, false}});
            bar.cells(3, 3, 6, 1);
            bar.fix_plane(0, 0, high - 1e-4, 0, 0, -1);
            bar.scene.element.kind = kind;
            bar.scene.cut.kind = PLIANT_CUT_SEVER;
            bar.scene.contact.friction = friction;
            bar.scene.model.gravity[2] = -g;
            bar.scene.warp.margin = 1;
            bar.scene.solver.threads = 1;
            bar.scene.obstacles.planes[bar.scene.obstacles.num_planes++] = {{0, 0, -0.002}, {0, 0, 1}};
            ASSERT_EQ(bar.build(), PLIANT_OK) << pliant_last_error();
            const double line[6] = {-0.01, -0.01, 0.0142, 0.03, -0.01, 0.0142}, across[3] = {0, 0.04, 0};
            ASSERT_EQ(pliant_data_cut(bar.model, bar.data, 2, line, across, nullptr), PLIANT_OK) << pliant_last_error();
            ASSERT_TRUE(bar.data->body->pieces);
            ASSERT_EQ(bar.data->body->pieces->count, 1);
            const pliant_pieces *pieces = bar.data->body->pieces;
            double weight = 0, at[3], force[3];
            for (int32_t i = 0; i < pieces->start[1]; i++) weight += g * bar.data->body->node_mass[pieces->node[i]];
            const int32_t node = pieces->node[0];
            press(bar, -1, 30);
            const double from = bar.data->positions[3 * node], gravity[3] = {g * slope, 0, -g},
                         step = bar.scene.solver.step;
            ASSERT_EQ(pliant_data_set_gravity(bar.data, gravity), PLIANT_OK);
            press(bar, -1, 20);
            for (int s = 0; s < 3; s++) {
                ASSERT_GE(pliant_step(bar.model, bar.data), 0) << pliant_last_error();
                std::copy_n(contact_force_of(bar, -1).by, 3, force);
                at[s] = bar.data->positions[3 * node];
                EXPECT_NEAR(force[2], weight, 1e-4 * weight);
                EXPECT_NEAR(force[0], -std::fmin(slope, friction) * weight, 1e-4 * friction * weight);
            }
            const double faster = (at[2] - 2 * at[1] + at[0]) / (step * step),
                         expected = std::fmax(0, g * (slope - friction));
            EXPECT_NEAR(faster, expected, 1e-3 * 0.05 * friction * g);
            if (slope < friction) { EXPECT_LT(at[2] - from, 3e-5); }
        }
}

// Same in explicit dynamics for a soft cube. It leans, but its centre moves according to the total friction. The
// remaining oscillation is a thousandth of this motion.
TEST(ContactTheory, ASoftCubeSlidesDownFromTanMuOn)
{
    const double friction = 0.4, edge = 0.04, g = 9.81, mass = 1000 * edge * edge * edge;
    for (pliant_element_kind kind : kinds)
        for (double slope : {0.9 * friction, 1.1 * friction}) {
            Body cube(std::vector<int>{4, 4, 4}.data(), std::vector<double>{edge, edge, edge}.data(),
                      {{young, 0.3, 1000, false}});
            cube.cells(4, 4, 4, 1);
            cube.scene.element.kind = kind;
            cube.scene.solver.kind = PLIANT_TLED;
            cube.scene.solver.threads = 1;
            cube.scene.tled.damping = 0;
            cube.scene.tled.stiffness_damping = 0.005;
            cube.scene.contact.friction = friction;
            cube.scene.model.gravity[2] = -g;
            cube.scene.ground.normal[2] = 1;
            cube.scene.ground.point[2] = -10; // falling is permitted
            cube.scene.obstacles.planes[cube.scene.obstacles.num_planes++] = {{0, 0, 0}, {0, 0, 1}};
            ASSERT_EQ(cube.build(), PLIANT_OK) << pliant_last_error();
            press(cube, -1, 50);
            for (int s = 1; s <= 50; s++) { /* tilt gradually */
                const double gravity[3] = {0.9 * friction * g * s / 50, 0, -g};
                ASSERT_EQ(pliant_data_set_gravity(cube.data, gravity), PLIANT_OK);
                press(cube, -1, 1);
            }
            const double gravity[3] = {slope * g, 0, -g};
            ASSERT_EQ(pliant_data_set_gravity(cube.data, gravity), PLIANT_OK);
            const int apart = 10;
            double at[3], force[3] = {0, 0, 0};
            press(cube, -1, 25);
            for (int s = 0; s < 3; s++) { /* position of the centre at three times */
                at[s] = 0;
                for (int32_t n = 0; n < cube.model->body->fine.num_nodes; n++)
                    at[s] += cube.data->body->node_mass[n] * cube.data->positions[3 * n] / mass;
                for (int k = 0; k < apart && s < 2; k++) {
                    ASSERT_GE(pliant_step(cube.model, cube.data), 0) << pliant_last_error();
                    const Force of = contact_force_of(cube, -1);
                    for (int d = 0; d < 3; d++) force[d] += of.by[d] / (2 * apart);
                }
            }
            const double time = apart * cube.scene.solver.step, faster = (at[2] - 2 * at[1] + at[0]) / time / time;
            EXPECT_NEAR(faster, std::fmax(0, g * (slope - friction)), 1e-3 * 0.1 * friction * g);
            EXPECT_NEAR(force[2], mass * g, 1e-3 * mass * g);
            EXPECT_NEAR(force[0], -std::fmin(slope, friction) * mass * g, 1e-3 * friction * mass * g);
        }
}

// Two boxes hold a block on a soft foot by friction, and lift it until the foot pulls with 2 mu N; then it slips.
// Forces are resolved along and across each point's normal, because the block bulges around the boxes' borders. While
// it sticks, it follows the boxes except for the shear of its sides, 1 to 2 %.
TEST(ContactTheory, TwoToolsLiftByFrictionAndSlip)
{
    const double friction = 0.4;
    for (pliant_element_kind kind : kinds) {
        Block block(4, 8, 0.02, {{young, 0.3, 1000, false}, {young / 10, 0.3, 1000, false}},
                    [](int, int, int k) { return k < 2 ? 1 : 0; });
        block.scene.element.kind = kind;
        block.scene.contact.friction = friction;
        block.fix_below();
        ASSERT_EQ(block.build(), PLIANT_OK) << pliant_last_error();
        const int left = add_tool(block, "left", box(-0.01, -0.012, -0.012, 0, 0.012, 0.012)),
                  right = add_tool(block, "right", box(0, -0.012, -0.012, 0.01, 0.012, 0.012));
        auto hold = [&](double closed, double up, int steps = 3) {
            place(block, left, closed, block.edge / 2, 0.03 + up);
            place(block, right, block.edge - closed, block.edge / 2, 0.03 + up);
            press(block, left, steps);
        };
        auto top = [&] {
            double sum = 0;
            int count = 0;
            for (int32_t n = 0; n < block.model->body->fine.num_nodes; n++)
                if (block.model->body->fine.rest[3 * n + 2] > block.height - 1e-9)
                    sum += block.data->positions[3 * n + 2] - block.height, count++;
            return sum / count;
        };
        for (int s = 1; s <= 5; s++) hold(1e-4 * s, 0);
        const double first = top(), step = 0.00025;
        double last = first;
        int s = 1;
        for (; s <= 24 && (s < 2 || top() > last); s++) {
            last = top();
            hold(5e-4, step * s);
            const Force by_left = contact_force_of(block, left), by_right = contact_force_of(block, right);
            double held[3];
            block.reaction(held);
            EXPECT_NEAR(held[2], -by_left.by[2] - by_right.by[2], 1e-3 * std::fabs(by_left.by[0]));
            EXPECT_LE(by_left.slides, friction * by_left.presses * (1 + 1e-9));
            EXPECT_LE(by_right.slides, friction * by_right.presses * (1 + 1e-9));
            if (s < 10) { EXPECT_NEAR(top() - first, step * s, 0.03 * step * s); }
        }
        ASSERT_LT(s, 24) << "it slips";
        // measured while all points slide; at rest the force distribution changes and they stick
        hold(5e-4, step * (s + 4), 1);
        for (const Force &force : {contact_force_of(block, left), contact_force_of(block, right)})
            EXPECT_NEAR(force.slides, friction * force.presses, 1e-3 * friction * force.presses);
    }
}

// Two boxes squeeze a block with the same force limit, and lift it. Both couplings then carry the same load, so that
// each limit depends on the other tool. Each step converges, and no force exceeds its limit.
TEST(ContactTheory, TwoToolsKeepTheirForceLimits)
{
    Block block(4, 8, 0.02, {{young, 0.3, 1000, false}, {young / 10, 0.3, 1000, false}},
                [](int, int, int k) { return k < 2 ? 1 : 0; });
    const double limit = 0.05;
    block.scene.contact.friction = 0.4;
    block.scene.contact.max_force = limit;
    block.scene.solver.tolerance = 1e-3;
    block.fix_below();
    ASSERT_EQ(block.build(), PLIANT_OK) << pliant_last_error();
    const int left = add_tool(block, "left", box(-0.01, -0.012, -0.012, 0, 0.012, 0.012)),
              right = add_tool(block, "right", box(0, -0.012, -0.012, 0.01, 0.012, 0.012));
    double largest = 0, last = 0;
    for (int s = 1; s <= 24; s++) {
        const double closed = 1e-4 * std::min(s, 10), up = 2e-5 * std::max(s - 10, 0);
        place(block, left, closed, block.edge / 2, 0.03 + up);
        place(block, right, block.edge - closed, block.edge / 2, 0.03 + up);
        EXPECT_EQ(pliant_step(block.model, block.data), PLIANT_OK) << "step " << s;
        for (int tool : {left, right}) {
            const Force force = contact_force_of(block, tool);
            last = std::sqrt(force.by[0] * force.by[0] + force.by[1] * force.by[1] + force.by[2] * force.by[2]);
            largest = std::max(largest, last);
        }
    }
    std::printf("largest force / limit %.5f, last %.5f\n", largest / limit, last / limit);
    EXPECT_LT(largest, 1.0005 * limit);
    EXPECT_NEAR(last, limit, 0.0005 * limit);
}

} // namespace
