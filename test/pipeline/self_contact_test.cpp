// Tissue on tissue in the quasi-static solver: a bar that was cut carries pressure as a whole one does and opens under tension; layers that slide.
#include "body.h"

namespace {

// 20 x 20 x 80 mm between two plates, without Poisson's effect; the upper half is as much denser
struct Column : Body {
    Column(double upper, double gravity, bool cut)
        : Body(size, box, {{10e3, 0, 1000, false}, {10e3, 0, 1000 * upper, false}}, [](int, int, int k) { return k >= 16; })
    {
        cells(2, 2, 8, 1);
        fix_plane(0, 0, 1e-4, 0, 0, 1);
        fix_plane(0, 0, box[2] - 1e-4, 0, 0, -1);
        scene.model.gravity[2] = -gravity;
        scene.cut.kind = PLIANT_CUT_SEVER;
        scene.contact.self = cut;
        EXPECT_EQ(build(), PLIANT_OK) << pliant_last_error();
        const double corners[6] = {-0.01, -0.01, at, 0.03, -0.01, at}, across[3] = {0, 0.04, 0};
        if (cut) EXPECT_EQ(pliant_data_cut(model, data, 2, corners, across, nullptr), PLIANT_OK) << pliant_last_error();
        EXPECT_GE(settle(200), PLIANT_OK) << pliant_last_error();
    }
    // how far the node on the axis at a height has moved up: of the side that hangs from the upper plate, or stands on the lower one
    double moved(double height, bool upper) const
    {
        const pliant_mesh &fine = data->body->fine;
        double out = upper ? -1 : 1;
        for (int32_t n = 0; n < fine.num_nodes; n++) {
            const double *x = fine.rest + 3 * n;
            if (std::fabs(x[2] - height) > 1e-9 || std::fabs(x[0] - 0.01) > 1e-9 || std::fabs(x[1] - 0.01) > 1e-9) continue;
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
    const Column whole(3, 9.81, false), cut(3, 9.81, true);
    ASSERT_GT(cut.data->body->cuts->num_pieces, 1);
    EXPECT_GT(cut.data->statistics.contacts, 3);
    const double largest = std::fabs(whole.moved(0.04, true));
    EXPECT_NEAR(cut.moved(0.03, false), whole.moved(0.03, false), 0.01 * largest);
    EXPECT_NEAR(cut.moved(0.05, true), whole.moved(0.05, true), 0.01 * largest);
    // half of the difference of the halves' weights goes through the middle, over the area: (3 - 1) rho g L / 8
    EXPECT_NEAR(cut.pressure(), 2 * 1000 * 9.81 * 0.08 / 8, 0.02 * 2 * 1000 * 9.81 * 0.08 / 8);
}

TEST(SelfContact, ACutBarOpensUnderTension)
{
    const Column cut(1.0 / 3, 9.81, true);
    EXPECT_EQ(cut.data->statistics.contacts, 0);
    EXPECT_EQ(cut.pressure(), 0);
    // the lower half sinks by rho g L^2 / 8 E, the upper one a third of that
    const double sinks = 1000 * 9.81 * 0.08 * 0.08 / (8 * 10e3);
    EXPECT_NEAR(cut.moved(0.04, false), -sinks, 0.05 * sinks);
    EXPECT_NEAR(cut.moved(0.04, true), -sinks / 3, 0.05 * sinks);
}

// Two layers of 10 mm: the lower one stands on a plate, the upper one is held at one end.
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
    // of the far end's upper border
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

TEST(SelfContact, WhatSlidesMustBeThere)
{
    Layers wrong("m1, liver");
    EXPECT_EQ(wrong.build(), PLIANT_ERROR_SCENE);
    EXPECT_NE(std::strstr(pliant_last_error(), "\"liver\""), nullptr) << pliant_last_error();
    Layers whole("m1");
    whole.scene.cut.kind = PLIANT_CUT_NONE;
    EXPECT_EQ(whole.build(), PLIANT_ERROR_SCENE);
    EXPECT_NE(std::strstr(pliant_last_error(), "cut/kind"), nullptr) << pliant_last_error();
}

// off, it costs nothing and changes nothing; on, it changes nothing where nothing touches
TEST(SelfContact, IsOffUnlessItIsAskedFor)
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

} // namespace
