// The stiffness of what strokes leave: of every element, and of a whole piece that has come off.
#include "../cuts.h"
#include "fem/system.h"
#include "sim/discretization.h"

#include <Eigen/Eigenvalues>

namespace {

// of a symmetric matrix, ascending
std::vector<double> eigenvalues(const std::vector<double> &a)
{
    const auto n = static_cast<Eigen::Index>(std::lround(std::sqrt(static_cast<double>(a.size()))));
    const Eigen::SelfAdjointEigenSolver<Eigen::MatrixXd> solver(Eigen::Map<const Eigen::MatrixXd>(a.data(), n, n), Eigen::EigenvaluesOnly);
    return {solver.eigenvalues().data(), solver.eigenvalues().data() + n};
}

struct Kind {
    const char *name;
    pliant_method method;
    pliant_element_kind element;
};
void PrintTo(const Kind &kind, std::ostream *out) { *out << kind.name; }

// of a system, at rest
struct Elements {
    const pliant_system &system;
    int32_t count;
    std::vector<pliant_tangent> tangents;
    explicit Elements(const pliant_system &of) : system(of), count(pliant_element_count(&of)), tangents(static_cast<size_t>(of.num_blocks))
    {
        pliant_system_tangents(&system, system.mesh->rest, PLIANT_TWIST_EXACT, tangents.data());
    }
    const double *rest(int32_t node) const { return system.mesh->rest + 3 * node; }
    std::vector<int32_t> nodes(int32_t e) const
    {
        const int32_t *all = pliant_element_nodes(&system);
        return {all + pliant_element_begin(&system, e), all + pliant_element_begin(&system, e + 1)};
    }
    std::vector<double> stiffness(int32_t e) const
    {
        const size_t n = 3 * nodes(e).size();
        std::vector<double> out(n * n);
        pliant_system_element(&system, tangents.data(), e, out.data());
        return out;
    }
    std::vector<int32_t> nodes(const std::vector<int32_t> &elements) const
    {
        std::set<int32_t> all;
        for (int32_t e : elements)
            for (int32_t n : nodes(e)) all.insert(n);
        return {all.begin(), all.end()};
    }
    std::vector<double> stiffness(const std::vector<int32_t> &elements) const
    {
        std::map<int32_t, size_t> number;
        for (int32_t n : nodes(elements)) number.emplace(n, number.size());
        const size_t size = 3 * number.size();
        std::vector<double> out(size * size);
        for (int32_t e : elements) {
            const std::vector<int32_t> own = nodes(e);
            const std::vector<double> of = stiffness(e);
            const size_t n = 3 * own.size();
            for (size_t i = 0; i < n; i++)
                for (size_t j = 0; j < n; j++) out[size * (3 * number[own[i / 3]] + i % 3) + 3 * number[own[j / 3]] + j % 3] += of[n * i + j];
        }
        return out;
    }
    // elements that hang together by three nodes
    std::vector<std::vector<int32_t>> pieces() const
    {
        Parts parts(static_cast<size_t>(count));
        std::map<int32_t, std::vector<int32_t>> around;
        for (int32_t e = 0; e < count; e++)
            for (int32_t n : nodes(e)) around[n].push_back(e);
        for (int32_t e = 0; e < count; e++) {
            std::map<int32_t, int> shared;
            for (int32_t n : nodes(e))
                for (int32_t other : around[n]) shared[other]++;
            for (const auto &each : shared)
                if (each.second >= 3) parts.join(e, each.first);
        }
        std::map<int32_t, std::vector<int32_t>> found;
        for (int32_t e = 0; e < count; e++) found[parts.find(e)].push_back(e);
        std::vector<std::vector<int32_t>> out;
        for (const auto &each : found) out.push_back(each.second);
        return out;
    }
};

struct EveryElement : testing::TestWithParam<Kind> {};

// rounding, of the largest eigenvalue: of elements whose roots are single precision six modes have it squared
const double rounding = 1e-12;

void expect_rigid_modes(const Elements &elements, const std::vector<int32_t> &nodes, const std::vector<double> &stiffness, size_t rank, const std::string &what)
{
    const size_t size = 3 * nodes.size();
    const std::vector<double> values = eigenvalues(stiffness);
    const double most = values.back();
    ASSERT_GT(most, 0) << what;
    ASSERT_GT(values.front(), -rounding * most) << what << ": not positive semidefinite";
    ASSERT_LT(values[size - rank - 1], rounding * most) << what;
    ASSERT_GT(values[size - rank], 1e3 * rounding * most) << what << ": moves without force";
    double middle[3] = {0, 0, 0}, reach = 0;
    for (int32_t n : nodes)
        for (int d = 0; d < 3; d++) middle[d] += elements.rest(n)[d] / static_cast<double>(nodes.size());
    for (int32_t n : nodes)
        for (int d = 0; d < 3; d++) reach = std::max(reach, std::fabs(elements.rest(n)[d] - middle[d]));
    for (int mode = 0; mode < 6; mode++) {
        std::vector<double> moved(size);
        for (size_t n = 0; n < nodes.size(); n++) {
            const double *at = elements.rest(nodes[n]);
            if (mode < 3) moved[3 * n + mode] = 1;
            else {
                const int i = (mode + 1) % 3, j = (mode + 2) % 3;
                moved[3 * n + i] = -(at[j] - middle[j]) / reach;
                moved[3 * n + j] = (at[i] - middle[i]) / reach;
            }
        }
        for (size_t i = 0; i < size; i++) {
            double force = 0;
            for (size_t j = 0; j < size; j++) force += stiffness[size * i + j] * moved[j];
            ASSERT_LT(std::fabs(force), 1e-6 * most) << what << ", mode " << mode; // roots of elements are single precision
        }
    }
}

TEST_P(EveryElement, IsPositiveSemidefiniteWithItsRigidModes)
{
    const int size[3] = {16, 16, 48};
    const double box[3] = {0.04, 0.04, 0.12};
    Body body(size, box, {{4000, 0.45, 1000, false}, {40000, 0.3, 1000, false}}, [](int i, int j, int k) { return (i / 3 + j / 5 + k / 4) % 3 == 0; });
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
            const double at = (d == 2 ? 0.75 + 0.2 * unit(random) : 0.5 + 0.45 * unit(random)) * box[d], half = 0.012 * unit(random);
            points[d] = at - half;
            points[3 + d] = at + half;
            depth[d] = 0.015 * unit(random);
        }
        ASSERT_EQ(pliant_data_cut(body.model, body.data, 2, points, depth, nullptr), PLIANT_OK) << pliant_last_error();
        if (strokes % 6 == 5) ASSERT_GE(pliant_step(body.model, body.data), 0) << pliant_last_error();
    }
    const double points[6] = {-0.02, -0.05, 0.084, 0.09, -0.05, 0.078}, depth[3] = {0, 0.15, 0}; // and one through all of it
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
        coarse += high - low > 0.015; // fine ones are 0.01 high
        // a tetrahedron beside coarse ones has corners that follow two nodes
        const size_t rank = GetParam().element == PLIANT_LINEAR ? 6 : 3 * nodes.size() - 6;
        expect_rigid_modes(elements, nodes, stiffness, rank, "element " + std::to_string(e));
        if (HasFatalFailure()) return;
    }
    EXPECT_GT(tets, 100);
    if (GetParam().element == PLIANT_HEXAHEDRA) EXPECT_GT(hexahedra, 10);
    EXPECT_EQ(coarse > 3, !fine) << coarse;
    // what hangs together by faces, with nothing held; the rest has hinges. Solved beside coarse elements are no pieces that have come off.
    size_t most = 0;
    const std::vector<std::vector<int32_t>> pieces = elements.pieces();
    for (const std::vector<int32_t> &piece : pieces) {
        const std::vector<int32_t> nodes = elements.nodes(piece);
        expect_rigid_modes(elements, nodes, elements.stiffness(piece), 3 * nodes.size() - 6, "a piece of " + std::to_string(piece.size()) + " elements");
        if (HasFatalFailure()) return;
        most = std::max(most, piece.size());
    }
    EXPECT_GT(most, 100u);
    EXPECT_EQ(pieces.size() > 1, fine);
}

const Kind kinds[] = {{"tetrahedra", PLIANT_FINE, PLIANT_LINEAR}, {"hexahedra", PLIANT_FINE, PLIANT_HEXAHEDRA}, {"graded_tetrahedra", PLIANT_COARSE, PLIANT_LINEAR},
                      {"graded_hexahedra", PLIANT_COARSE, PLIANT_HEXAHEDRA}, {"averaged_hexahedra", PLIANT_AVERAGED, PLIANT_HEXAHEDRA}};
INSTANTIATE_TEST_SUITE_P(Kinds, EveryElement, testing::ValuesIn(kinds), [](const auto &info) { return std::string(info.param.name); });

} // namespace
