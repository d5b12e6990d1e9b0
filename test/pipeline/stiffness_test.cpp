// Stiffness after random strokes: of every element, and of a whole detached piece.
#include "../elements.h"
#include "sim/build/discretization.h"

namespace {

struct Kind {
    const char *name;
    pliant_method method;
    pliant_element_kind element;
};
void PrintTo(const Kind &kind, std::ostream *out) { *out << kind.name; }

struct EveryElement : testing::TestWithParam<Kind> {};

TEST_P(EveryElement, IsPositiveSemidefiniteWithItsRigidModes)
{
    const int size[3] = {16, 16, 48};
    const double box[3] = {0.04, 0.04, 0.12};
    Body body(size, box, {{4000, 0.45, 1000, false}, {40000, 0.3, 1000, false}},
              [](int i, int j, int k) { return (i / 3 + j / 5 + k / 4) % 3 == 0; });
    const bool fine = GetParam().method == PLIANT_FINE;
    body.cells(fine ? 4 : 2, fine ? 4 : 2, fine ? 12 : 6, fine ? 1 : 2);
    body.fix_plane(0, 0, 1e-6, 0, 0, 1);
    body.scene.model.method = GetParam().method;
    body.scene.element.kind = GetParam().element;
    body.scene.cut.kind = PLIANT_CUT_SEVER;
    body.scene.model.gravity[0] = 4;
    body.scene.solver.iterations = 5;
    ASSERT_EQ(body.build(), PLIANT_OK) << pliant_last_error();
    std::mt19937 random(5);
    std::uniform_real_distribution<double> unit(-1, 1);
    int strokes = 0;
    for (; strokes < 36; strokes++) {
        double points[6], depth[3];
        for (int d = 0; d < 3; d++) {
            const double at = (d == 2 ? 0.75 + 0.2 * unit(random) : 0.5 + 0.45 * unit(random)) * box[d],
                         half = 0.012 * unit(random);
            points[d] = at - half;
            points[3 + d] = at + half;
            depth[d] = 0.015 * unit(random);
        }
        ASSERT_EQ(pliant_data_cut(body.model, body.data, 2, points, depth, nullptr), PLIANT_OK) << pliant_last_error();
        if (strokes % 6 == 5) ASSERT_GE(pliant_step(body.model, body.data), 0) << pliant_last_error();
    }
    // and one through all of it
    const double points[6] = {-0.02, -0.05, 0.084, 0.09, -0.05, 0.078}, depth[3] = {0, 0.15, 0};
    ASSERT_EQ(pliant_data_cut(body.model, body.data, 2, points, depth, nullptr), PLIANT_OK) << pliant_last_error();
    ASSERT_TRUE(body.data->body->pieces);
    const Elements elements(*body.data->discretization->system);
    int tets = 0, hexahedra = 0, coarse = 0;
    for (int32_t e = 0; e < elements.count; e++) {
        const std::vector<double> stiffness = elements.stiffness(e);
        const std::vector<int32_t> nodes = elements.nodes(e);
        (stiffness.size() == 144 ? tets : hexahedra)++;
        double low = INFINITY, high = 0;
        for (int32_t n : nodes) {
            low = std::min(low, elements.rest(n)[2]);
            high = std::max(high, elements.rest(n)[2]);
        }
        coarse += high - low > 0.015; // fine elements are 0.01 high
        // a tetrahedron next to coarse elements has corners that depend on two nodes
        const size_t rank = GetParam().element == PLIANT_LINEAR ? 6 : 3 * nodes.size() - 6;
        expect_rigid_modes(elements, nodes, stiffness, rank, "element " + std::to_string(e));
        if (HasFatalFailure()) return;
    }
    EXPECT_GT(GetParam().element == PLIANT_LINEAR ? tets : tets + hexahedra, 100);
    EXPECT_GT(tets, 20);
    if (GetParam().element == PLIANT_HEXAHEDRA) EXPECT_GT(hexahedra, 10);
    EXPECT_EQ(coarse > 3, !fine) << coarse;
    // Parts connected by faces, with nothing fixed; other connections are hinges. Parts solved together with coarse
    // elements are no detached pieces.
    size_t maximum = 0;
    const std::vector<std::vector<int32_t>> pieces = elements.pieces();
    for (const std::vector<int32_t> &piece : pieces) {
        const std::vector<int32_t> nodes = elements.nodes(piece);
        expect_rigid_modes(elements, nodes, elements.stiffness(piece), 3 * nodes.size() - 6,
                           "a piece of " + std::to_string(piece.size()) + " elements");
        if (HasFatalFailure()) return;
        maximum = std::max(maximum, piece.size());
    }
    EXPECT_GT(maximum, 100u);
    EXPECT_EQ(pieces.size() > 1, fine);
}

const Kind kinds[] = {{"tetrahedra", PLIANT_FINE, PLIANT_LINEAR},
                      {"hexahedra", PLIANT_FINE, PLIANT_HEXAHEDRA},
                      {"graded_tetrahedra", PLIANT_COARSE, PLIANT_LINEAR},
                      {"graded_hexahedra", PLIANT_COARSE, PLIANT_HEXAHEDRA},
                      {"averaged_hexahedra", PLIANT_AVERAGED, PLIANT_HEXAHEDRA}};
INSTANTIATE_TEST_SUITE_P(Kinds, EveryElement, testing::ValuesIn(kinds),
                         [](const auto &info) { return std::string(info.param.name); });

} // namespace
