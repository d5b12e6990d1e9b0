// Contact between tissue surfaces in the quasi-static solver: a cut bar carries pressure like a whole one and opens
// under tension; layers slide.
#include "self_crossings.h"
#include "contact/detect/tissue.h"
#include "contact/detect/update_sides.h"
#include "base/memory.h"
#include "base/vector3.h"

#include <set>

namespace {

// A column of 20 x 20 x 80 mm between two plates, with zero Poisson's ratio; the upper half has a different density.
struct Column : Body {
    Column(double upper, double gravity, bool cut, pliant_cut_kind kind = PLIANT_CUT_SEVER)
        : Body(size, box, {{10e3, 0, 1000, false}, {10e3, 0, 1000 * upper, false}},
               [](int, int, int k) { return k >= 16; })
    {
        cells(2, 2, 8, 1);
        fix_plane(0, 0, 1e-4, 0, 0, 1);
        fix_plane(0, 0, box[2] - 1e-4, 0, 0, -1);
        scene.model.gravity[2] = -gravity;
        scene.cut.kind = kind;
        scene.contact.self = cut;
        EXPECT_EQ(build(), PLIANT_OK) << pliant_last_error();
        const double corners[6] = {-0.01, -0.01, at, 0.03, -0.01, at}, across[3] = {0, 0.04, 0};
        if (cut) EXPECT_EQ(pliant_data_cut(model, data, 2, corners, across, nullptr), PLIANT_OK) << pliant_last_error();
        EXPECT_GE(settle(200), PLIANT_OK) << pliant_last_error();
    }
    // Return the upward displacement of the axis node at a height, on the side of the upper or the lower plate.
    double moved(double height, bool upper) const
    {
        const pliant_mesh &fine = data->body->fine;
        double out = upper ? -1 : 1;
        for (int32_t n = 0; n < fine.num_nodes; n++) {
            const double *x = fine.rest + 3 * n;
            if (std::fabs(x[2] - height) > 1e-9 || std::fabs(x[0] - 0.01) > 1e-9 || std::fabs(x[1] - 0.01) > 1e-9)
                continue;
            const double up = data->positions[3 * n + 2] - x[2];
            out = upper ? std::fmax(out, up) : std::fmin(out, up);
        }
        return out;
    }
    double pressure() const
    {
        std::vector<pliant_contact> contacts(10000);
        const int32_t count = pliant_data_get_contacts(data, 10000, contacts.data());
        double force = 0;
        for (int32_t c = 0; c < count; c++) {
            EXPECT_TRUE(contacts[c].tissue);
            force += std::fabs(contacts[c].force[2]);
        }
        return force / (box[0] * box[1]);
    }
    static constexpr int size[3] = {8, 8, 32};
    static constexpr double box[3] = {0.02, 0.02, 0.08}, at = 0.04;
};
constexpr int Column::size[3];
constexpr double Column::box[3], Column::at;

TEST(SelfContact, ACutBarThatIsPressedTogetherCarriesWhatAWholeOneDoes)
{
    const Column whole(3, 9.81, false);
    const double largest = std::fabs(whole.moved(0.04, true));
    for (const pliant_cut_kind kind : {PLIANT_CUT_SEVER, PLIANT_CUT_SUBDIVIDE}) {
        const Column cut(3, 9.81, true, kind);
        ASSERT_TRUE(kind == PLIANT_CUT_SUBDIVIDE || cut.data->body->cuts->num_pieces > 1);
        EXPECT_GT(cut.data->statistics.contacts, 3);
        EXPECT_NEAR(cut.moved(0.03, false), whole.moved(0.03, false), 0.01 * largest) << kind;
        EXPECT_NEAR(cut.moved(0.05, true), whole.moved(0.05, true), 0.01 * largest) << kind;
        // half of the weight difference between the halves passes through the middle, divided by the area: (3 - 1) rho
        // g L / 8
        EXPECT_NEAR(cut.pressure(), 2 * 1000 * 9.81 * 0.08 / 8, 0.02 * 2 * 1000 * 9.81 * 0.08 / 8) << kind;
    }
}

TEST(SelfContact, ACutBarOpensUnderTension)
{
    const Column cut(1.0 / 3, 9.81, true);
    EXPECT_EQ(cut.data->statistics.contacts, 0);
    EXPECT_EQ(cut.pressure(), 0);
    // the lower half sinks by rho g L^2 / 8 E, the upper half by a third of this value
    const double sinks = 1000 * 9.81 * 0.08 * 0.08 / (8 * 10e3);
    EXPECT_NEAR(cut.moved(0.04, false), -sinks, 0.05 * sinks);
    EXPECT_NEAR(cut.moved(0.04, true), -sinks / 3, 0.05 * sinks);
}

// Two layers of 10 mm: the lower one stands on a plate, the upper one is fixed at one end.
struct Layers : Body {
    explicit Layers(const char *slides, bool below = true)
        : Body(size, box, {{10e3, 0.3, 1000, !below}, {10e3, 0.3, 1000, false}}, [](int, int, int k) { return k >= 4; })
    {
        cells(8, 2, 2, 1);
        scene.cut.kind = PLIANT_CUT_SEVER;
        EXPECT_EQ(pliant_scene_set(&scene, "material/slides", slides), PLIANT_OK);
        if (below) fix_plane(0, 0, 1e-4, 0, 0, 1);
        scene.fixed.boxes[scene.fixed.num_boxes++] = {{-1, -1, 0.0099}, {1e-4, 1, 1}};
        scene.contact.friction = 0;
    }
    void load(double along, double down)
    {
        scene.model.gravity[0] = along;
        scene.model.gravity[2] = -down;
        EXPECT_EQ(build(), PLIANT_OK) << pliant_last_error();
        EXPECT_GE(settle(200), PLIANT_OK) << pliant_last_error();
    }
    // Return the displacement of the far end's upper border.
    double moved(int axis) const
    {
        const pliant_mesh &fine = data->body->fine;
        double sum = 0, count = 0;
        for (int32_t n = 0; n < fine.num_nodes; n++)
            if (fine.rest[3 * n] > box[0] - 1e-9 && fine.rest[3 * n + 2] > box[2] - 1e-9) {
                sum += data->positions[3 * n + axis] - fine.rest[3 * n + axis];
                count++;
            }
        return sum / count;
    }
    static constexpr int size[3] = {32, 8, 8};
    static constexpr double box[3] = {0.08, 0.02, 0.02};
};
constexpr int Layers::size[3];
constexpr double Layers::box[3];

TEST(SelfContact, LayersThatSlideDoSoFreelyAndPress)
{
    Layers slides("m1"), glued(""), alone("", false);
    for (Layers *layers : {&slides, &glued, &alone}) layers->load(3, 0);
    EXPECT_NEAR(slides.moved(0), alone.moved(0), 0.05 * alone.moved(0)) << "along the other layer as without it";
    EXPECT_LT(glued.moved(0), 0.3 * alone.moved(0));
    for (Layers *layers : {&slides, &glued, &alone}) layers->load(0, 3);
    EXPECT_LT(alone.moved(2), 5 * slides.moved(2)) << "the other layer bears it";
    EXPECT_LT(std::fabs(slides.moved(2)), 3 * std::fabs(glued.moved(2)));
    EXPECT_GT(slides.data->statistics.contacts, 8);
    EXPECT_LT(slides.data->statistics.penetration, 0.01 * 0.01) << "a hundredth of an element";
    pliant_data_reset(slides.model, slides.data);
    EXPECT_EQ(slides.data->body->revision, slides.model->body->revision);
}

TEST(SelfContact, SlidingContactNeedsAnOppositeSide)
{
    Layers wrong("m1, liver");
    EXPECT_EQ(wrong.build(), PLIANT_ERROR_SCENE);
    EXPECT_NE(std::strstr(pliant_last_error(), "\"liver\""), nullptr) << pliant_last_error();
    Layers whole("m1");
    whole.scene.cut.kind = PLIANT_CUT_NONE;
    EXPECT_EQ(whole.build(), PLIANT_ERROR_SCENE);
    EXPECT_NE(std::strstr(pliant_last_error(), "cut/kind"), nullptr) << pliant_last_error();
}

// A block of 20 mm stands on a plate, another one hangs 10 mm above it from a plate. A piece cut off the upper one
// falls onto the lower one.
struct Drop : Body {
    explicit Drop(pliant_cut_kind kind, double friction = 0.3, pliant_method method = PLIANT_FINE, int ratio = 1)
        : Body(std::vector<int>{6 * ratio, 6 * ratio, 24 * ratio}.data(), box,
               {{10e3, 0.3, 1000, false}, {1, 0.3, 1, true}},
               [ratio](int, int, int k) { return k >= 8 * ratio && k < 12 * ratio; })
    {
        cells(3, 3, 12, ratio);
        scene.model.method = method;
        scene.solver.threads = 1;
        fix_plane(0, 0, 1e-4, 0, 0, 1);
        fix_plane(0, 0, box[2] - 1e-4, 0, 0, -1);
        scene.model.gravity[2] = -9.81;
        scene.cut.kind = kind;
        scene.contact.self = true;
        scene.contact.friction = friction;
        scene.warp.margin = 1;
        scene.solver.iterations = 30;
        scene.solver.tolerance = 1e-5;
        EXPECT_EQ(build(), PLIANT_OK) << pliant_last_error();
    }
    void cut(double z)
    {
        const double corners[6] = {-0.01, -0.01, z, 0.03, -0.01, z}, across[3] = {0, 0.04, 0};
        ASSERT_EQ(pliant_data_cut(model, data, 2, corners, across, nullptr), PLIANT_OK) << pliant_last_error();
    }
    void run(int steps)
    {
        for (int s = 0; s < steps; s++) ASSERT_GE(pliant_step(model, data), 0) << pliant_last_error();
    }
    // Return the mass of a piece.
    double mass(int p) const
    {
        double sum = 0;
        const pliant_pieces *pieces = data->body->pieces;
        for (int32_t i = pieces->start[p]; i < pieces->start[p + 1]; i++) sum += data->body->node_mass[pieces->node[i]];
        return sum;
    }
    double lowest(int p, int axis = 2) const
    {
        double minimum = INFINITY;
        const pliant_pieces *pieces = data->body->pieces;
        for (int32_t i = pieces->start[p]; i < pieces->start[p + 1]; i++)
            minimum = std::fmin(minimum, data->positions[3 * pieces->node[i] + axis]);
        return minimum;
    }
    // Return the contact force on a piece, or on the tissue that does not fall (-1).
    double force(int p, int axis = 2) const
    {
        std::vector<double> all(3 * static_cast<size_t>(data->body->fine.num_nodes));
        pliant_data_get_contact_forces(data, all.data());
        double sum = 0;
        for (size_t n = 0; n < all.size() / 3; n++) {
            int32_t of = -1;
            const pliant_pieces *pieces = data->body->pieces;
            for (int32_t i = 0; i < pieces->start[pieces->count]; i++)
                if (pieces->node[i] == static_cast<int32_t>(n))
                    for (of = 0; pieces->start[of + 1] <= i;) of++;
            if (of == p) sum += all[3 * n + static_cast<size_t>(axis)];
        }
        return sum;
    }
    static constexpr double box[3] = {0.015, 0.015, 0.06};
};
constexpr double Drop::box[3];

TEST(SelfContact, DetachedPiecesComeToRestOnTheTissueBelow)
{
    for (pliant_cut_kind kind : {PLIANT_CUT_SUBDIVIDE, PLIANT_CUT_SEVER}) {
        Drop drop(kind);
        drop.cut(0.0437);
        ASSERT_TRUE(drop.data->body->pieces);
        ASSERT_EQ(drop.data->body->pieces->count, 1);
        drop.run(30);
        EXPECT_NEAR(drop.force(0), drop.mass(0) * 9.81, 0.001 * drop.mass(0) * 9.81);
        EXPECT_NEAR(drop.force(-1), -drop.force(0), 1e-9);
        EXPECT_LT(drop.data->statistics.penetration, 1e-4);
        EXPECT_GT(drop.lowest(0), 0.019) << "the lower block gives way";
        EXPECT_LT(drop.lowest(0), 0.020);
    }
}

// On a block of any coarse method, the piece comes to rest as on the fine mesh, and the block carries its weight.
TEST(SelfContact, WhatIsCutOffLandsOnCoarseMeshesToo)
{
    double of_fine = 0;
    for (pliant_method method : {PLIANT_FINE, PLIANT_COARSE, PLIANT_AVERAGED}) {
        Drop drop(PLIANT_CUT_SEVER, 0.3, method, 2);
        drop.cut(0.0437);
        ASSERT_TRUE(drop.data->body->pieces) << method;
        ASSERT_EQ(drop.data->body->pieces->count, 1) << method;
        drop.run(15);
        const double weight = drop.mass(0) * 9.81, deep = drop.data->statistics.penetration;
        std::printf("method %d: piece at %.5f mm, %.3g mm deep, force %.6f of its weight\n", method,
                    1e3 * drop.lowest(0), 1e3 * deep, drop.force(0) / weight);
        if (method == PLIANT_FINE) of_fine = deep;
        EXPECT_NEAR(drop.force(0), weight, 0.001 * weight) << method;
        for (int axis = 0; axis < 3; axis++) EXPECT_NEAR(drop.force(-1, axis), -drop.force(0, axis), 1e-9) << method;
        EXPECT_LE(deep, 1.5 * std::fmax(of_fine, 1e-7)) << method;
        EXPECT_GT(drop.lowest(0), 0.019) << method;
        EXPECT_LT(drop.lowest(0), 0.020) << method;
    }
}

// slopes with a tangent below and above the friction coefficient
TEST(SelfContact, ADetachedSlabStaysOrSlidesByFriction)
{
    for (pliant_cut_kind kind : {PLIANT_CUT_SUBDIVIDE, PLIANT_CUT_SEVER})
        for (double slope : {0.1, 0.35}) {
            Drop drop(kind);
            drop.cut(0.0117);
            ASSERT_EQ(drop.data->body->pieces->count, 1);
            const double weight = drop.mass(0) * 9.81, gravity[3] = {9.81 * slope, 0, -9.81};
            drop.run(8);
            EXPECT_NEAR(drop.force(0), weight, 0.005 * weight);
            ASSERT_EQ(pliant_data_set_gravity(drop.data, gravity), PLIANT_OK);
            drop.run(slope < 0.3 ? 20 : 3); // the block below oscillates at first
            const double x = drop.lowest(0, 0);
            drop.run(3);
            EXPECT_NEAR(drop.force(-1, 0), -drop.force(0, 0), 1e-9);
            EXPECT_NEAR(drop.force(0), weight, 0.02 * weight);
            EXPECT_GT(drop.lowest(0), 0.0092);
            if (slope < 0.3) {
                EXPECT_NEAR(drop.force(0, 0), -slope * weight, 0.01 * slope * weight);
                EXPECT_NEAR(drop.lowest(0, 0), x, 1e-5);
            } else {
                EXPECT_GT(drop.lowest(0, 0), x + 1e-3);
                EXPECT_LE(-drop.force(0, 0), 0.3 * 1.001 * weight);
                EXPECT_GT(-drop.force(0, 0), 0.1 * weight);
            }
        }
}

// The sliding distance exceeds an element, so that other voxels become opposite and carry the slab.
TEST(SelfContact, ASlabThatSlidesOffDoesNotSink)
{
    Drop drop(PLIANT_CUT_SEVER);
    drop.cut(0.0117);
    ASSERT_EQ(drop.data->body->pieces->count, 1);
    drop.run(8);
    const double gravity[3] = {0.4 * 9.81, 0, -9.81}, z = drop.lowest(0), x = drop.lowest(0, 0),
                 weight = drop.mass(0) * 9.81;
    ASSERT_EQ(pliant_data_set_gravity(drop.data, gravity), PLIANT_OK);
    for (int s = 0; s < 30 && drop.lowest(0, 0) - x < 0.0055; s++) {
        drop.run(1);
        EXPECT_NEAR(drop.lowest(0), z, 7e-4) << s << " at " << drop.lowest(0, 0) - x;
    }
    EXPECT_GT(drop.lowest(0, 0) - x, 0.0055);
    EXPECT_NEAR(drop.force(0), weight, 0.03 * weight);
    drop.run(1); // faces are opposite new ones by now, and each pair has one contact point
    std::set<std::pair<uint64_t, uint64_t>> slid;
    for (int32_t c = 0; c < drop.data->contacts.count; c++) {
        const uint64_t feature = drop.data->contacts.point[c].feature, side = (uint64_t{1} << 28) - 1;
        if (feature >> 56 == PLIANT_TISSUE_SLID) slid.emplace(feature >> 28 & side, feature & side);
    }
    std::set<uint64_t> opposite, looked;
    for (const auto &pair : slid) {
        EXPECT_EQ(opposite.count(pair.first), 0u) << "it has a point as what another is opposite";
        opposite.insert(pair.second);
        looked.insert(pair.first);
    }
    EXPECT_GT(looked.size(), 10u);
    EXPECT_EQ(looked.size(), slid.size());
}

TEST(SelfContact, PiecesLieOnEachOther)
{
    Drop drop(PLIANT_CUT_SUBDIVIDE);
    drop.cut(0.0117);
    drop.cut(0.0437);
    ASSERT_EQ(drop.data->body->pieces->count, 2);
    drop.run(20);
    const double both = (drop.mass(0) + drop.mass(1)) * 9.81;
    const int upper = drop.lowest(0) > drop.lowest(1) ? 0 : 1;
    EXPECT_NEAR(drop.force(-1), -both, 0.01 * both);
    EXPECT_NEAR(drop.force(upper), drop.mass(upper) * 9.81, 0.01 * both);
    EXPECT_NEAR(drop.lowest(upper), 0.02, 5e-4);
    EXPECT_NEAR(drop.lowest(1 - upper), 0.0117, 5e-4);
}

// The piece lies on the ground, which carries the pressing force. The piece yields where it is pressed, and neither the
// ground nor the tool penetrates it.
TEST(SelfContact, APieceBetweenAToolAndTheGroundCarriesTheForce)
{
    Drop drop(PLIANT_CUT_SUBDIVIDE);
    drop.scene.ground.normal[2] = 1;
    drop.scene.ground.point[2] = 0.022;
    ASSERT_EQ(drop.build(), PLIANT_OK);
    drop.cut(0.0437);
    drop.run(40);
    ASSERT_NEAR(drop.lowest(0), 0.022, 1e-6);
    const int tool = drop.add_ball(0.004);
    for (int s = 0; s < 30; s++) {
        const double tip[3] = {0.0078, 0.0073, 0.040 - 0.0002 * std::min(s, 20)}; // its top is at 0.0357
        ASSERT_EQ(pliant_tool_set_pose(drop.data, tool, tip, nullptr), PLIANT_OK);
        drop.run(1);
    }
    double ground = 0, tip = 0;
    for (int32_t c = 0; c < drop.data->contacts.count; c++) {
        const pliant_contact_point &point = drop.data->contacts.point[c];
        if (point.kind == PLIANT_OBSTACLE_GROUND) ground += point.force[2];
        // without the force on the remaining block above the ground
        else if (point.kind == PLIANT_OBSTACLE_TOOL && point.normal[2] < 0) tip += point.force[2];
    }
    EXPECT_LT(tip, -0.05);
    EXPECT_NEAR(ground, drop.mass(0) * 9.81 - tip, 0.01 * ground);
    EXPECT_NEAR(drop.lowest(0), 0.022, 1e-6);
}

// In one step a ball pushes the piece farther than it would have fallen, and the ground stops it in the same step.
TEST(SelfContact, APieceThatIsPushedFarIsStoppedByTheGround)
{
    Drop drop(PLIANT_CUT_SUBDIVIDE);
    drop.scene.model.gravity[2] = -0.1;
    drop.scene.ground.normal[2] = 1;
    drop.scene.ground.point[2] = 0.024;
    ASSERT_EQ(drop.build(), PLIANT_OK);
    drop.cut(0.0437);
    // where there is space above it
    std::vector<double> aside(drop.data->positions, drop.data->positions + 3 * drop.data->body->fine.num_nodes);
    const pliant_pieces *pieces = drop.data->body->pieces;
    for (int32_t i = 0; i < pieces->start[1]; i++) aside[3 * static_cast<size_t>(pieces->node[i])] += 0.03;
    ASSERT_EQ(pliant_data_set_positions(drop.model, drop.data, aside.data()), PLIANT_OK);
    const int tool = drop.add_ball(0.004);
    double ground = 0, pushes = 0;
    for (int s = 0; s < 2; s++) {
        // 7.5 mm into it; the ground is 6 mm below it
        const double tip[3] = {0.0378, 0.0073, 0.0437 + 0.0045 - 0.008 * s};
        ASSERT_EQ(pliant_tool_set_pose(drop.data, tool, tip, nullptr), PLIANT_OK);
        drop.run(1);
    }
    for (int32_t c = 0; c < drop.data->contacts.count; c++) {
        const pliant_contact_point &point = drop.data->contacts.point[c];
        if (point.kind == PLIANT_OBSTACLE_GROUND) ground += point.force[2];
        else if (point.kind == PLIANT_OBSTACLE_TOOL) pushes -= point.force[2];
    }
    EXPECT_GT(pushes, 0.01);
    EXPECT_GT(ground, 0.01);
    EXPECT_NEAR(drop.lowest(0), 0.024, 1e-3);
}

// Switched off, it costs and changes nothing; switched on, it changes nothing without contact.
TEST(SelfContact, IsOffByDefault)
{
    std::vector<double> positions[2];
    for (bool on : {false, true}) {
        Layers layers("");
        layers.scene.contact.self = on;
        layers.load(3, 3);
        EXPECT_EQ(layers.data->contacts.count, 0);
        EXPECT_EQ(layers.data->contact_search != nullptr, on);
        positions[on].assign(layers.data->positions, layers.data->positions + 3 * layers.data->body->fine.num_nodes);
    }
    EXPECT_EQ(positions[0], positions[1]);
}

// Where tissue ends within sliding elements, the corners of its surface are points of other elements
// (contact_surface.h). The sides of a cut stay the sides of the fragments, and touch at rest.
TEST(SelfContact, LayersThatEndWithinElementsMeetAtRest)
{
    const int size[3] = {16, 16, 16};
    const double box[3] = {0.08, 0.08, 0.08};
    for (const pliant_element_kind kind : {PLIANT_LINEAR, PLIANT_HEXAHEDRA}) {
        Body body(size, box, {{10e3, 0.3, 1000, false}, {10e3, 0.3, 1000, false}, {1, 0, 1, true}},
                  [](int i, int j, int k) { return 2 * i + j + 3 * k > 66 ? 2 : i + k / 2 + j / 4 >= 11; });
        body.cells(4, 4, 4, 1);
        body.fix_plane(0, 0, 1e-4, 0, 0, 1);
        body.scene.element.kind = kind;
        body.scene.cut.kind = PLIANT_CUT_SEVER;
        body.scene.contact.friction = 0;
        ASSERT_EQ(pliant_scene_set(&body.scene, "material/slides", "m1"), PLIANT_OK);
        ASSERT_EQ(body.build(), PLIANT_OK) << pliant_last_error();
        for (int step = 0; step < 3; step++)
            ASSERT_EQ(pliant_step(body.model, body.data), PLIANT_OK) << pliant_last_error();
        const pliant_mesh &fine = body.data->body->fine;
        int sides = 0;
        double maximum = 0;
        for (int32_t p = 0; p < body.data->contacts.count; p++) {
            const pliant_contact_point &point = body.data->contacts.point[p];
            const bool side = point.feature >> 56 == PLIANT_TISSUE_CUT;
            double gap = 0;
            ASSERT_LE(point.count, side ? 8 : static_cast<int>(PLIANT_CONTACT_NODES));
            for (int32_t k = 0; k < point.count; k++)
                for (int d = 0; d < 3; d++) gap += point.weight[k] * point.normal[d] * fine.rest[3 * point.node[k] + d];
            if (side) EXPECT_NEAR(gap, 0, 1e-12);
            sides += side;
        }
        for (int32_t n = 0; n < 3 * fine.num_nodes; n++)
            maximum = std::fmax(maximum, std::fabs(body.data->positions[n] - fine.rest[n]));
        EXPECT_GT(sides, 20);
        EXPECT_LT(maximum, 1e-9);
    }
}

void hold_floor_with_self_contact(Body &body, bool dynamic)
{
    body.scene.contact.self = true;
    body.scene.solver.iterations = 12;
    body.scene.solver.tolerance = 1e-3;
    body.scene.solver.threads = 1;
    body.scene.warp.margin = 1;
    body.fix_plane(0, 0, 1e-6, 0, 0, 1);
    if (!dynamic) return;
    body.scene.solver.kind = PLIANT_TLED;
    body.scene.solver.step = 0.01;
    body.scene.tled.damping = 20;
}

// A ball pushes the upper arm of a C onto the lower arm, and through it if it could.
void press_a_fold(bool dynamic)
{
    SCOPED_TRACE(dynamic ? "explicit dynamics" : "quasi-static");
    const double h = 0.005, box[3] = {6 * h, 2 * h, 6 * h};
    Body body(std::vector<int>{12, 4, 12}.data(), box, {{10e3, 0.3, 1000, false}, {1, 0.3, 1, true}},
              [](int i, int, int k) { return int(i < 8 && k >= 4 && k < 8); }); // whole cells
    body.cells(6, 2, 6, 1);
    hold_floor_with_self_contact(body, dynamic);
    ASSERT_EQ(body.build(), PLIANT_OK) << pliant_last_error();
    const int tool = body.add_ball(0.005);
    int touching = 0;
    for (int step = 0; step < 15; step++) {
        const double tip[3] = {0.4 * box[0] - 1e-4 * step, 0.45 * box[1], box[2] + 0.0055 - 0.0015 * step};
        ASSERT_EQ(pliant_tool_set_pose(body.data, tool, tip, nullptr), PLIANT_OK);
        ASSERT_GE(pliant_step(body.model, body.data), 0) << pliant_last_error();
        ASSERT_EQ(count_crossings(body), 0) << "step " << step;
        for (int32_t c = 0; c < body.data->contacts.count; c++) {
            const pliant_contact_point &point = body.data->contacts.point[c];
            touching += point.kind == PLIANT_OBSTACLE_TISSUE && std::fabs(point.force[2]) > 1e-3;
        }
    }
    EXPECT_GT(touching, 20);
}

TEST(SelfContact, TissueDoesNotPassThroughTissue)
{
    press_a_fold(false);
    press_a_fold(true);
}

// A ball closes an open cut and presses its sides together.
void press_a_cut(bool dynamic)
{
    SCOPED_TRACE(dynamic ? "explicit dynamics" : "quasi-static");
    const double h = 0.005, box[3] = {5 * h, 2 * h, 4 * h};
    Body body(std::vector<int>{10, 4, 8}.data(), box, {{10e3, 0.3, 1000, false}});
    body.cells(5, 2, 4, 1);
    body.scene.cut.kind = PLIANT_CUT_SUBDIVIDE;
    hold_floor_with_self_contact(body, dynamic);
    ASSERT_EQ(body.build(), PLIANT_OK) << pliant_last_error();
    const double corners[6] = {0.3 * box[0], -0.01, 0.5 * box[2], 2 * box[0], -0.01, 0.55 * box[2]},
                 sweep[3] = {0, 0.06, 0};
    ASSERT_EQ(pliant_data_cut(body.model, body.data, 2, corners, sweep, nullptr), PLIANT_OK) << pliant_last_error();
    EXPECT_EQ(count_crossings(body), 0) << "a cut leaves a kerf";
    const int tool = body.add_ball(0.005);
    double force = 0;
    for (int step = 0; step < 9; step++) {
        const double tip[3] = {0.8 * box[0] - 2e-4 * step, 0.45 * box[1], box[2] + 0.0055 - 0.0008 * step};
        ASSERT_EQ(pliant_tool_set_pose(body.data, tool, tip, nullptr), PLIANT_OK);
        ASSERT_GE(pliant_step(body.model, body.data), 0) << pliant_last_error();
        EXPECT_EQ(count_crossings(body), 0) << "step " << step;
        force = 0;
        for (int32_t c = 0; c < body.data->contacts.count; c++) {
            const pliant_contact_point &point = body.data->contacts.point[c];
            if (point.kind == PLIANT_OBSTACLE_TISSUE) force += std::fabs(point.force[2]);
        }
        EXPECT_LT(body.data->statistics.proxy_error, 1.5e-3) << "step " << step; // with the dimple of the ball
    }
    EXPECT_GT(force, 0.05);
}

TEST(SelfContact, SidesOfACutDoNotPassThroughEachOther)
{
    press_a_cut(false);
    press_a_cut(true);
}

// Return the smallest distance of two sides of a severed cut along their normal, at the middle of their links [m].
double smallest_opening(const Body &body)
{
    pliant_cut_face *faces = nullptr;
    int32_t count = 0;
    EXPECT_EQ(pliant_cut_faces(body.data->body, &faces, &count), PLIANT_OK);
    EXPECT_GT(count, 0);
    const auto position = [&](int32_t tet, const double *weight) {
        std::array<double, 3> out{};
        for (int v = 0; v < 4; v++)
            for (int d = 0; d < 3; d++)
                out[d] += weight[v] * body.data->positions[3 * body.data->body->fine.tets[4 * tet + v] + d];
        return out;
    };
    double smallest = INFINITY;
    for (int32_t f = 0; f < count; f++) {
        double sum[3] = {0, 0, 0}, gap = 0;
        for (int side = 0; side < 2; side++) {
            const auto a = position(faces[f].tet[side], faces[f].along[side][0]),
                       b = position(faces[f].tet[side], faces[f].along[side][1]);
            double normal[3];
            pliant_cross3(a.data(), b.data(), normal);
            pliant_normalize3(normal);
            for (int d = 0; d < 3; d++) sum[d] += normal[d];
        }
        pliant_normalize3(sum);
        const auto first = position(faces[f].tet[0], faces[f].at[0]),
                   second = position(faces[f].tet[1], faces[f].at[1]);
        for (int d = 0; d < 3; d++) gap += sum[d] * (first[d] - second[d]);
        smallest = std::min(smallest, gap);
    }
    pliant_free(faces);
    return smallest;
}

// A ball closes an open cut through voxels and presses its sides together. They may overlap by the smallest distance
// that legs keep, here 0.0125 mm, and by less than 5 % more where their area shrinks.
void press_a_severed_cut(bool dynamic, int iterations, double motion)
{
    SCOPED_TRACE(dynamic ? "explicit dynamics" : "quasi-static");
    const double h = 0.005, box[3] = {5 * h, 2 * h, 4 * h};
    Body body(std::vector<int>{10, 4, 8}.data(), box, {{10e3, 0.3, 1000, false}});
    body.cells(5, 2, 4, 1);
    body.scene.cut.kind = PLIANT_CUT_SEVER;
    hold_floor_with_self_contact(body, dynamic);
    body.scene.solver.iterations = iterations;
    ASSERT_EQ(body.build(), PLIANT_OK) << pliant_last_error();
    const pliant_contact_settings &settings = body.model->contact;
    const double corners[6] = {0.3 * box[0], -0.01, 0.5 * box[2], 2 * box[0], -0.01, 0.55 * box[2]},
                 sweep[3] = {0, 0.06, 0},
                 smallest = settings.advance_keep * settings.advance_stop * settings.self_thickness * h;
    ASSERT_EQ(pliant_data_cut(body.model, body.data, 2, corners, sweep, nullptr), PLIANT_OK) << pliant_last_error();
    const int tool = body.add_ball(0.005);
    double force = 0;
    for (double z = 0.0055; z > -0.004; z -= motion) {
        const double tip[3] = {0.8 * box[0], 0.45 * box[1], box[2] + z};
        ASSERT_EQ(pliant_tool_set_pose(body.data, tool, tip, nullptr), PLIANT_OK);
        ASSERT_GE(pliant_step(body.model, body.data), 0) << pliant_last_error();
        EXPECT_GT(smallest_opening(body), -1.05 * smallest) << "ball at " << z;
        for (int32_t c = 0; c < body.data->contacts.count; c++)
            if (body.data->contacts.point[c].feature >> 56 == PLIANT_TISSUE_CUT)
                force = std::max(force, std::fabs(body.data->contacts.point[c].force[2]));
    }
    EXPECT_GT(force, 0) << "the cut did not close";
    EXPECT_LT(body.data->statistics.proxy_error, 3e-3); // with the dimple of the ball
}

TEST(SelfContact, SidesOfASeveredCutDoNotOverlap)
{
    for (bool dynamic : {false, true})
        for (int iterations : {2, 200})
            for (double motion : {0.0008, 0.003}) press_a_severed_cut(dynamic, iterations, motion);
}

} // namespace
