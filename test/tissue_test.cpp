// Self-contact of tissue: blocks, crossing bars, a folded strip, the two sides of a cut.
#include "base/memory.h"
#include "contact/detect/tissue.h"
#include "contact/detect/update_sides.h"
#include "cuts.h"
#include "mesh/mesh.h"

#include <array>

namespace {

// A mesh of blocks of cells, one above the other, with an empty layer between them.
struct Blocks {
    static constexpr double h = 0.01;
    pliant_body *body = nullptr;
    std::vector<double> positions;
    std::vector<int> block_of; // node -> block
    pliant_tissue tissue{};
    pliant_contacts contacts{};
    pliant_tissue_rule rule{0.2 * h, 1.0, 0.3};

    Blocks(int x, int y, int z, int count)
    {
        pliant_geometry geometry{};
        const int32_t cells[3] = {x, y, count * (z + 1) - 1};
        for (int d = 0; d < 3; d++) {
            geometry.size[d] = cells[d];
            geometry.spacing[d] = h;
            geometry.origin[d] = 0.5 * h;
            geometry.direction[4 * d] = 1;
        }
        std::vector<uint8_t> keep;
        for (int c = 0; c < cells[2]; c++) keep.insert(keep.end(), static_cast<size_t>(5 * x * y), c % (z + 1) != z);
        EXPECT_EQ(pliant_body_create(1, &body), PLIANT_OK);
        EXPECT_EQ(pliant_mesh_grid(&geometry, cells, keep.data(), &body->fine), PLIANT_OK) << pliant_last_error();
        positions.assign(body->fine.rest, body->fine.rest + 3 * body->fine.num_nodes);
        for (int32_t n = 0; n < body->fine.num_nodes; n++)
            block_of.push_back(static_cast<int>(std::floor(positions[3 * n + 2] / ((z + 1) * h) + 1e-9)));
    }
    Blocks(const Blocks &) = delete;
    Blocks &operator=(const Blocks &) = delete;
    ~Blocks()
    {
        pliant_tissue_free(&tissue);
        pliant_free(contacts.point);
        pliant_body_release(body);
    }
    void move(int block, double dx, double dy, double dz)
    {
        const double by[3] = {dx, dy, dz};
        for (size_t n = 0; n < block_of.size(); n++)
            for (int d = 0; d < 3; d++) positions[3 * n + d] += block_of[n] == block ? by[d] : 0;
    }
    void map(int block, const std::function<void(double *)> &change)
    {
        for (size_t n = 0; n < block_of.size(); n++)
            if (block_of[n] == block) change(positions.data() + 3 * n);
    }
    void find(int threads = 1)
    {
        contacts.count = 0;
        ASSERT_EQ(pliant_tissue_set_body(&tissue, body, nullptr, threads), PLIANT_OK) << pliant_last_error();
        tissue.threads = threads;
        ASSERT_EQ(pliant_tissue_find(&tissue, positions.data(), &rule, &contacts), PLIANT_OK) << pliant_last_error();
    }
};

const double Blocks::h;

std::array<double, 3> offset_of(const pliant_contact_point &point, const std::vector<double> &positions)
{
    std::array<double, 3> out{};
    for (int32_t k = 0; k < point.count; k++)
        for (int d = 0; d < 3; d++) out[d] += point.weight[k] * positions[3 * point.node[k] + d];
    return out;
}

double gap(const pliant_contact_point &point, const std::vector<double> &positions)
{
    const auto offset = offset_of(point, positions);
    return point.normal[0] * offset[0] + point.normal[1] * offset[1] + point.normal[2] * offset[2];
}

int kind_of(const pliant_contact_point &point) { return static_cast<int>(point.feature >> 56); }

// Check each point, and that forces along the normals conserve momentum and angular momentum, up to rounding.
void check_points(const pliant_contacts &contacts, const std::vector<double> &positions)
{
    double force[3] = {0, 0, 0}, moment[3] = {0, 0, 0}, scale = 0;
    for (int32_t c = 0; c < contacts.count; c++) {
        const pliant_contact_point &point = contacts.point[c];
        if (c > 0) EXPECT_LT(contacts.point[c - 1].feature, point.feature);
        EXPECT_EQ(point.kind, PLIANT_OBSTACLE_TISSUE);
        EXPECT_LE(point.count, static_cast<int32_t>(PLIANT_CONTACT_NODES));
        EXPECT_EQ(std::set<int32_t>(point.node, point.node + point.count).size(), static_cast<size_t>(point.count));
        double square = 0;
        for (double n : point.normal) square += n * n;
        EXPECT_NEAR(square, 1, 1e-12);
        EXPECT_GT(point.area, 0);
        const double push = 1 + c % 7;
        for (int32_t k = 0; k < point.count; k++) {
            const double *x = positions.data() + 3 * point.node[k];
            double f[3];
            for (int d = 0; d < 3; d++) {
                f[d] = push * point.weight[k] * point.normal[d];
                force[d] += f[d];
                scale += std::fabs(f[d]);
            }
            for (int d = 0; d < 3; d++) moment[d] += x[(d + 1) % 3] * f[(d + 2) % 3] - x[(d + 2) % 3] * f[(d + 1) % 3];
        }
    }
    for (int d = 0; d < 3; d++) {
        EXPECT_NEAR(force[d], 0, 1e-14 * scale);
        EXPECT_NEAR(moment[d], 0, 1e-14 * scale);
    }
}

// ---- blocks

TEST(Tissue, BlocksTouchWhereTheyFaceEachOther)
{
    for (double between : {0.1, 0.0, -0.05}) {
        Blocks blocks(4, 4, 3, 2);
        blocks.move(1, 0.3 * blocks.h, 0.4 * blocks.h, (between - 1) * blocks.h); // a layer lies between them
        blocks.find();
        ASSERT_FALSE(HasFatalFailure());
        check_points(blocks.contacts, blocks.positions);
        // both faces have 25 nodes; 9 nodes of each one lie beyond the border of the other face.
        EXPECT_EQ(blocks.contacts.count, 2 * 16) << between;
        double area = 0;
        for (int32_t c = 0; c < blocks.contacts.count; c++) {
            const pliant_contact_point &point = blocks.contacts.point[c];
            EXPECT_NEAR(gap(point, blocks.positions), between * blocks.h, 1e-12);
            EXPECT_NEAR(std::fabs(point.normal[2]), 1, 1e-12);
            EXPECT_EQ(point.normal[2] > 0, blocks.block_of[point.node[0]] == 1);
            area += 0.5 * point.area;
        }
        EXPECT_NEAR(area, 14 * blocks.h * blocks.h, 4 * blocks.h * blocks.h);
    }
    Blocks apart(4, 4, 3, 2);
    apart.move(1, 0, 0, -0.75 * apart.h);
    apart.find();
    EXPECT_EQ(apart.contacts.count, 0) << "further than the margin";
}

TEST(Tissue, NothingTouchesAtRest)
{
    Blocks blocks(5, 4, 3, 3);
    blocks.find();
    EXPECT_EQ(blocks.contacts.count, 0);
    EXPECT_EQ(blocks.tissue.num_overlaps, 0);
    pliant_tissue_discard(&blocks.tissue);
    blocks.map(0, [](double *x) { // far from rest, without folding
        x[1] += 0.6 * x[0];
        x[0] *= 0.7;
    });
    blocks.find();
    EXPECT_EQ(blocks.contacts.count, 0);
}

// Overlap by more than an element: all inner nodes get the shortest way out.
TEST(Tissue, DeepNodesArePushedOutByTheShortestPath)
{
    Blocks blocks(6, 6, 6, 2);
    const double h = blocks.h;
    blocks.move(1, 1.3 * h, 2.2 * h, (-1 - 2.6) * h);
    for (int again = 0; again < 2; again++) { // the second search starts from the first result
        blocks.find();
        ASSERT_FALSE(HasFatalFailure());
        check_points(blocks.contacts, blocks.positions);
        std::map<int32_t, double> depth;
        for (int32_t c = 0; c < blocks.contacts.count; c++) {
            EXPECT_EQ(kind_of(blocks.contacts.point[c]), PLIANT_TISSUE_NODE);
            if (gap(blocks.contacts.point[c], blocks.positions) < 0)
                depth[blocks.contacts.point[c].node[0]] = gap(blocks.contacts.point[c], blocks.positions);
        }
        double low[2][3], high[2][3];
        for (int b = 0; b < 2; b++)
            for (int d = 0; d < 3; d++) {
                low[b][d] = 1e9, high[b][d] = -1e9;
                for (size_t n = 0; n < blocks.block_of.size(); n++)
                    if (blocks.block_of[n] == b) {
                        low[b][d] = std::min(low[b][d], blocks.positions[3 * n + d]);
                        high[b][d] = std::max(high[b][d], blocks.positions[3 * n + d]);
                    }
            }
        const std::set<int32_t> surface(blocks.tissue.node, blocks.tissue.node + blocks.tissue.num_nodes);
        int inside = 0;
        for (int32_t n : surface) {
            const int other = 1 - blocks.block_of[n];
            double offset = 1e9;
            for (int d = 0; d < 3; d++)
                offset = std::min({offset, blocks.positions[3 * n + d] - low[other][d],
                                   high[other][d] - blocks.positions[3 * n + d]});
            if (offset <= 1e-9) continue;
            inside++;
            ASSERT_TRUE(depth.count(n)) << "node " << n << " is inside by " << offset;
            EXPECT_LE(depth[n], -offset + 1e-9) << n;
            EXPECT_GE(depth[n], -offset - blocks.rule.margin) << n << ": what does not face it counts as deeper";
        }
        EXPECT_GT(inside, 60);
        EXPECT_EQ(static_cast<size_t>(inside), depth.size());
    }
}

TEST(Tissue, DeepTissueRecoversGradually)
{
    Blocks blocks(4, 4, 3, 2);
    blocks.rule.recovery = 0.01 * blocks.h;
    blocks.move(1, 0.3 * blocks.h, 0.2 * blocks.h, -1.2 * blocks.h);
    blocks.find();
    ASSERT_GT(blocks.contacts.count, 0);
    for (int32_t c = 0; c < blocks.contacts.count; c++) {
        const pliant_contact_point &point = blocks.contacts.point[c];
        if (gap(point, blocks.positions) >= 0) continue;
        double place = 0;
        for (int d = 0; d < 3; d++) place += point.normal[d] * point.place[d];
        EXPECT_NEAR(gap(point, blocks.positions) - place, -0.01 * blocks.h, 1e-12);
    }
}

TEST(Tissue, IsTheSameForAnyNumberOfThreads)
{
    Blocks one(5, 5, 4, 3), three(5, 5, 4, 3);
    std::mt19937 random(3);
    std::uniform_real_distribution<double> unit(-0.1, 0.1);
    for (double &x : one.positions) x += unit(random) * one.h;
    three.positions = one.positions;
    for (Blocks *blocks : {&one, &three}) {
        blocks->move(1, 0.4 * one.h, 0, -1.1 * one.h);
        blocks->move(2, 0, 0.4 * one.h, -2.3 * one.h);
        blocks->find(blocks == &one ? 1 : 3);
    }
    check_points(one.contacts, one.positions);
    ASSERT_GT(one.contacts.count, 40);
    ASSERT_EQ(one.contacts.count, three.contacts.count);
    EXPECT_EQ(std::memcmp(one.contacts.point, three.contacts.point,
                          sizeof(pliant_contact_point) * static_cast<size_t>(one.contacts.count)),
              0);
}

// ---- edges

// Edges have a point before they cross, and after that. Only edges that have crossed are exempt.
TEST(Tissue, EdgesTouchBeforeAndAfterTheyCross)
{
    for (double depth_ratio : {-0.01, 0.1}) {
        Blocks bars(1, 8, 1, 2);
        const double h = bars.h, c = std::sqrt(0.5), depth = depth_ratio * h;
        bars.rule.margin = 0.02 * h;
        bars.rule.thickness = 0.005 * h;
        const double middle[3] = {0.5 * h, 4 * h, 0.5 * h};
        bars.map(0, [&](double *x) { // on its edge, along y, highest at z = sqrt(2) h
            const double a = x[0] - middle[0], b = x[2] - middle[2];
            x[0] = c * (a - b);
            x[2] = c * (a + b) + c * h;
            x[1] -= middle[1];
        });
        bars.map(1, [&](double *x) { // likewise, along x above it
            const double a = x[0] - middle[0], b = x[2] - 2 * h - middle[2], along = x[1] - middle[1] - 0.3 * h;
            x[0] = along;
            x[1] = -c * (a - b) + 0.2 * h;
            x[2] = c * (a + b) + 3 * c * h - depth;
        });
        bars.find();
        ASSERT_FALSE(HasFatalFailure());
        check_points(bars.contacts, bars.positions);
        int exempt = 0;
        for (int32_t n = 0; n < bars.body->fine.num_nodes; n++) exempt += bars.tissue.exempt[n];
        EXPECT_EQ(exempt > 0, depth > 0);
        ASSERT_EQ(bars.contacts.count, 1);
        const pliant_contact_point &point = bars.contacts.point[0];
        EXPECT_EQ(kind_of(point), PLIANT_TISSUE_EDGE);
        EXPECT_NEAR(gap(point, bars.positions), -depth, 1e-12);
        EXPECT_NEAR(std::fabs(point.normal[2]), 1, 1e-12);
        EXPECT_EQ(point.normal[2] > 0, bars.block_of[point.node[0]] == 1);
        const auto offset = offset_of(point, bars.positions);
        EXPECT_NEAR(offset[0], 0, 1e-12);
        EXPECT_NEAR(offset[1], 0, 1e-12);
    }
}

// ---- a folded strip

TEST(Tissue, AStripFoldedOntoItselfTouchesWhereItsHalvesMeet)
{
    const int length = 40;
    Blocks strip(length, 4, 1, 1);
    const double h = strip.h, straight = 15 * h, bend = 10 * h, inner = bend / M_PI;
    strip.map(0, [&](double *x) { // its inner side keeps its length; half a turn in the middle
        const double s = x[0], up = h - x[2];
        const double radius = inner + up;
        if (s < straight) {
            x[2] = -radius;
        } else if (s < straight + bend) {
            const double angle = (s - straight) / inner;
            x[0] = straight + radius * std::sin(angle);
            x[2] = -radius * std::cos(angle);
        } else {
            x[0] = straight - (s - straight - bend);
            x[2] = radius;
        }
    });
    strip.find();
    EXPECT_EQ(strip.contacts.count, 0) << "the halves are " << 2 * inner / h << " elements apart";
    // pressed together except for the bend, with a penetration of a twentieth of an element
    for (size_t n = 0; n < strip.block_of.size(); n++) {
        double *x = strip.positions.data() + 3 * n;
        const double fraction = std::min(std::max((8 * h - x[0]) / (6 * h), 0.0), 1.0);
        x[2] -= (x[2] > 0 ? 1 : -1) * fraction * (inner + 0.025 * h);
    }
    strip.find();
    check_points(strip.contacts, strip.positions);
    std::set<int32_t> nodes;
    int deep = 0;
    for (int32_t c = 0; c < strip.contacts.count; c++) {
        const pliant_contact_point &point = strip.contacts.point[c];
        nodes.insert(point.node[0]);
        EXPECT_LT(strip.positions[3 * point.node[0]], 5 * h) << "none in the bend";
        EXPECT_GT(point.normal[2] * (strip.body->fine.rest[3 * point.node[0]] < 0.5 * length * h ? -1 : 1), 0.8);
        deep += gap(point, strip.positions) < 0;
    }
    EXPECT_GE(nodes.size(), 3u * 5 * 2);
    EXPECT_GE(deep, 2 * 5 * 2);
}

// ---- cuts

std::unique_ptr<Body> bar()
{
    const int size[3] = {16, 16, 32};
    const double box[3] = {0.04, 0.04, 0.08};
    std::unique_ptr<Body> body(new Body(size, box, {{10e3, 0.4, 1000, false}}));
    body->cells(4, 4, 8, 1);
    body->fix_plane(0, 0, 1e-4, 0, 0, 1);
    EXPECT_EQ(pliant_scene_set(&body->scene, "cut/kind", "sever"), PLIANT_OK);
    EXPECT_EQ(body->build(), PLIANT_OK) << pliant_last_error();
    return body;
}

// Return which nodes are connected with the highest node.
std::vector<bool> beyond(const CutState &cut)
{
    const pliant_body &body = *cut.now;
    std::vector<bool> out(static_cast<size_t>(body.fine.num_nodes), false);
    std::vector<int32_t> part(out.size());
    std::iota(part.begin(), part.end(), 0);
    const std::function<int32_t(int32_t)> first = [&](int32_t n) {
        return part[n] == n ? n : part[n] = first(part[n]);
    };
    for (int32_t t = 0; t < body.fine.num_tets; t++)
        for (int v = 1; v < 4; v++) part[first(body.fine.tets[4 * t + v])] = first(body.fine.tets[4 * t]);
    int32_t top = 0;
    for (int32_t n = 0; n < body.fine.num_nodes; n++)
        if (body.fine.rest[3 * n + 2] > body.fine.rest[3 * top + 2]) top = n;
    for (int32_t n = 0; n < body.fine.num_nodes; n++) out[n] = first(n) == first(top);
    return out;
}

TEST(Tissue, SidesOfACutTouchAtTheirCommonPoints)
{
    const double h = 0.01, point[3] = {0.02, 0.02, 0.0437}; // inside a layer of tetrahedra
    for (const std::array<double, 3> &normal : {std::array<double, 3>{0, 0, 1}, std::array<double, 3>{0.3, 0, 1}}) {
        CutState cut(bar());
        ASSERT_TRUE(cut.cut_plane(point, normal.data()));
        ASSERT_EQ(cut.report.pieces, 2);
        const std::vector<bool> up = beyond(cut);
        const double length = std::sqrt(normal[0] * normal[0] + normal[2] * normal[2]);
        pliant_tissue tissue{};
        pliant_contacts contacts{};
        pliant_tissue_rule rule{0.2 * h, 1.0, 0.3};
        ASSERT_EQ(pliant_tissue_set_body(&tissue, cut.now, nullptr, 2), PLIANT_OK);
        for (double away : {0.0, 0.1 * h, -0.1 * h}) {
            std::vector<double> positions = cut.positions;
            for (size_t n = 0; n < up.size(); n++)
                for (int d = 0; d < 3; d++) positions[3 * n + d] += up[n] ? away * normal[d] / length : 0;
            contacts.count = 0;
            ASSERT_EQ(pliant_tissue_find(&tissue, positions.data(), &rule, &contacts), PLIANT_OK);
            check_points(contacts, positions);
            double area[3] = {0, 0, 0}, squares = 0;
            int faces = 0;
            for (int32_t c = 0; c < contacts.count; c++) {
                const pliant_contact_point &one = contacts.point[c];
                if (kind_of(one) != PLIANT_TISSUE_CUT) continue;
                faces++;
                const bool first_up = up[one.node[0]];
                const double along = (one.normal[0] * normal[0] + one.normal[2] * normal[2]) / length;
                EXPECT_NEAR(gap(one, positions), away * std::fabs(along), 1e-12);
                EXPECT_GT(along * (first_up ? 1 : -1), 0.5);
                squares += one.area * std::pow(std::fabs(along) - 1, 2);
                for (int d = 0; d < 3; d++) area[d] += (first_up ? 1 : -1) * one.area * one.normal[d];
            }
            EXPECT_GT(faces, 16);
            EXPECT_NEAR(area[2], 0.04 * 0.04, normal[0] > 0 ? 5e-5 : 1e-9);
            EXPECT_NEAR(area[0], 0.04 * 0.04 * normal[0], normal[0] > 0 ? 5e-5 : 1e-9);
            EXPECT_LT(std::sqrt(squares / (0.04 * 0.04)), 0.1);
        }
        pliant_tissue_free(&tissue);
        pliant_free(contacts.point);
    }
}

TEST(Tissue, FailsWithoutMemory)
{
    CutState cut(bar());
    const double point[3] = {0.02, 0.02, 0.0437}, normal[3] = {0, 0, 1};
    ASSERT_TRUE(cut.cut_plane(point, normal));
    const size_t before = pliant_memory_in_use();
    const pliant_tissue_rule rule{0.001, 1.0, 0.3};
    bool done = false;
    for (int64_t calls = 0; !done; calls++) {
        pliant_tissue tissue{};
        pliant_contacts contacts{};
        pliant_memory_fail_after(calls);
        pliant_status status = pliant_tissue_set_body(&tissue, cut.now, nullptr, 1);
        if (status == PLIANT_OK) status = pliant_tissue_find(&tissue, cut.positions.data(), &rule, &contacts);
        pliant_memory_fail_after(-1);
        done = status == PLIANT_OK;
        if (!done) EXPECT_EQ(status, PLIANT_ERROR_MEMORY);
        EXPECT_EQ(done, contacts.count > 0);
        pliant_tissue_free(&tissue);
        pliant_free(contacts.point);
        EXPECT_EQ(pliant_memory_in_use(), before);
        ASSERT_LT(calls, 1000);
    }
}

} // namespace
