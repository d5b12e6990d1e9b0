// Mechanics of a cut: a cut that ends in a bar is a crack, whose energy release rate follows Griffith; homogenized
// models agree with the fine model.
#include "../cuts.h"
#include "fem/quasistatic/solver.h"
#include "mesh/mesh.h"
#include "sim/api/data.h"

#include <array>

namespace {

// A bar that hangs along x, of height 1 (y) and thickness 1/8 (z), in units of 80 mm. With nu = 0, plane stress equals
// plane strain.
constexpr double height = 0.08, thickness = 0.01, length = 4 * height, young = 1e4, density = 1000, gravity = 1e-3;

struct Bar {
    std::unique_ptr<Body> body;
    double plane, cell, depth = 0, area = 0;

    // across: number of cells over its height; offset: distance of the cut from a lattice plane [cells]
    Bar(int across, double offset) : cell(height / across)
    {
        const int thick = std::max(1, across / 8), size[3] = {16 * across, 4 * across, 4 * thick};
        const double box[3] = {length, height, thickness};
        body.reset(new Body(size, box, {{young, 0.0, density, false}}));
        body->fix_plane(1e-6, 0, 0, 1, 0, 0);
        body->cells(4 * across, across, thick, 1);
        body->scene.cut.kind = PLIANT_CUT_SEVER;
        body->scene.model.gravity[0] = gravity; // small strains: 3e-5
        EXPECT_EQ(body->build(), PLIANT_OK) << pliant_last_error();
        plane = 0.5 * length + offset * cell;
        EXPECT_EQ(body->settle(), PLIANT_OK);
    }
    void cut_to(double deep)
    {
        const double points[6] = {plane, depth - 0.5 * height * (depth == 0), -1,
                                  plane, depth - 0.5 * height * (depth == 0), 1};
        const double way[3] = {0, deep - points[1], 0};
        pliant_cut_report report;
        ASSERT_EQ(pliant_data_cut(body->model, body->data, 2, points, way, &report), PLIANT_OK) << pliant_last_error();
        depth = deep;
        area += report.area;
        EXPECT_EQ(body->settle(), PLIANT_OK);
    }
    // Return the stored energy, half of the work of the load. Under a dead load, crack growth releases the same amount.
    double stored() const
    {
        const pliant_body &now = *body->data->body;
        double work = 0;
        for (int32_t n = 0; n < now.fine.num_nodes; n++)
            work += now.node_mass[n] * gravity * (body->data->positions[3 * n] - now.fine.rest[3 * n]);
        return 0.5 * work;
    }
    // Return J as a domain integral around the tip (Li, Shih and Needleman 1985), with the body force; mean over the
    // thickness.
    double j_integral() const
    {
        const pliant_body &now = *body->data->body;
        const double *x = body->data->positions, near = 1.5 * cell, far = 0.35 * height;
        double sum = 0;
        for (int32_t t = 0; t < now.fine.num_tets; t++) {
            const int32_t *nodes = now.fine.tets + 4 * t;
            double gradients[12], strain[9], u[9] = {0}, q[3] = {0}, middle = 0, trace = 0, energy = 0;
            const double volume = pliant_mesh_gradients(&now.fine, t, gradients);
            const pliant_tet_material &m = now.fine_material[t];
            for (int v = 0; v < 4; v++) {
                const double *rest = now.fine.rest + 3 * nodes[v];
                const double away = std::max(std::fabs(rest[0] - plane), std::fabs(rest[1] - depth));
                const double weight = std::min(1., std::max(0., (far - away) / (far - near)));
                middle += 0.25 * weight;
                for (int i = 0; i < 3; i++) {
                    q[i] += weight * gradients[3 * v + i];
                    for (int j = 0; j < 3; j++) u[3 * j + i] += (x[3 * nodes[v] + j] - rest[j]) * gradients[3 * v + i];
                }
            }
            for (int i = 0; i < 9; i++) strain[i] = 0.5 * (u[i] + u[3 * (i % 3) + i / 3]);
            for (int i = 0; i < 3; i++) trace += strain[4 * i];
            for (int i = 0; i < 9; i++) energy += m.mu * strain[i] * strain[i];
            energy += 0.5 * m.lambda * trace * trace;
            for (int i = 0; i < 3; i++) {
                double flow = i == 1 ? -energy : 0;
                for (int j = 0; j < 3; j++)
                    flow += (2 * m.mu * strain[3 * i + j] + (i == j ? m.lambda * trace : 0)) * u[3 * j + 1];
                sum += volume * flow * q[i];
            }
            sum -= volume * middle * m.density * gravity * u[1];
        }
        return sum / thickness;
    }
};

// Return K^2 / E of an edge crack under tension (Brown and Srawley 1966), integrated over its area.
double handbook(double depth)
{
    const double stress = density * gravity * 0.5 * length;
    double sum = 0;
    for (int i = 0; i < 1000; i++) {
        const double a = (i + 0.5) / 1000 * depth / height,
                     f = 1.12 + a * (-0.231 + a * (10.55 + a * (-21.72 + a * 30.39)));
        sum += stress * stress * M_PI * a * height * f * f / young * depth / 1000 * thickness;
    }
    return sum;
}

// In a lattice plane the mesh has a notch, and only nodes are separated; between planes tetrahedra are cut.
const double planes[2] = {0, 0.4};

TEST(Griffith, EnergyReleasedIsTheJIntegral)
{
    for (double offset : planes) {
        Bar bar(16, offset);
        double j[3], stored[3];
        for (int i = 0; i < 3; i++) { // deeper by one lattice period each time
            bar.cut_to((4 + 2 * i) * bar.cell);
            j[i] = bar.j_integral();
            stored[i] = bar.stored();
        }
        // Simpson's rule
        const double area = 4 * bar.cell * thickness, released = (stored[2] - stored[0]) / area,
                     mean = (j[0] + 4 * j[1] + j[2]) / 6;
        EXPECT_NEAR(bar.area, 8 * bar.cell * thickness, 1e-3 * area);
        EXPECT_NEAR(released, mean, 0.03 * mean) << offset;
        EXPECT_GT(j[2], 5 * j[0]);
    }
}

// The crack tip is singular; linear elements lose energy there in proportion to their size.
TEST(Griffith, ConvergesToTheNotch)
{
    double released[2][3];
    const double theory = handbook(0.5 * height);
    for (int p = 0; p < 2; p++)
        for (int n = 0; n < 3; n++) {
            Bar bar(4 << n, planes[p]);
            const double whole = bar.stored();
            bar.cut_to(0.5 * height);
            EXPECT_NEAR(bar.area, 0.5 * height * thickness, 1e-3 * bar.area);
            released[p][n] = bar.stored() - whole;
        }
    for (int p = 0; p < 2; p++) {
        EXPECT_NEAR(2 * released[p][2] - released[p][1], theory, 0.08 * theory) << "extrapolated";
        for (int n = 1; n < 3; n++) EXPECT_LT(theory - released[p][n], 0.63 * (theory - released[p][n - 1]));
    }
    for (int n = 1; n < 3; n++) // converges to the bar whose mesh contains the notch
        EXPECT_LT(1 - released[1][n] / released[0][n], 0.6 * (1 - released[1][n - 1] / released[0][n - 1]));
    EXPECT_LT(std::fabs(1 - released[1][2] / released[0][2]), 0.08);
}

// ---- random strokes

// Return the work of the load while a bar comes to rest: twice the decrease of potential energy.
double work_of_load(const Body &bar)
{
    const pliant_solver &solver = *bar.data->solver;
    const pliant_system &system = *solver.system;
    const double *rest = system.macros && system.macros->rest ? system.macros->rest : system.mesh->rest;
    double sum = 0;
    for (int32_t f = 0; f < system.num_free; f++)
        for (int m = 0; m < 9; m++) {
            const int32_t at = 3 * system.node_of_free[f] + m / 3;
            sum += system.gravity_mass[9 * f + m] * bar.scene.model.gravity[m % 3] * (solver.now.x[at] - rest[at]);
        }
    return sum;
}

// After any cut, the bar comes to rest at no higher energy, because a part of an element has at most the element's
// stiffness. Parts of hexahedra that lack a corner become tetrahedra; with 20 mm cubes and two tissues the effect is
// visible.
void expect_no_energy(pliant_method method, pliant_element_kind kind, int cells, int tissues, double bound)
{
    const int size[3] = {16, 16, 48}, ratio = method == PLIANT_FINE ? 1 : 2;
    const double box[3] = {0.08, 0.08, 0.24};
    Body bar(size, box, {{4000, 0.45, 1000, false}, {20000, 0.45, 1100, false}},
             [=](int i, int j, int k) { return tissues == 2 && (i / 4 + j / 4 + k / 4) % 3 == 0; });
    bar.scene.model.method = method;
    bar.scene.element.kind = kind;
    bar.cells(cells / ratio, cells / ratio, 3 * cells / ratio, ratio);
    bar.fix_plane(0, 0, 1e-6, 0, 0, 1);
    bar.scene.cut.kind = PLIANT_CUT_SEVER;
    bar.scene.model.gravity[0] = 0.001;
    bar.scene.solver.tolerance = 1e-7;
    ASSERT_EQ(bar.build(), PLIANT_OK) << pliant_last_error();
    ASSERT_EQ(bar.settle(200), PLIANT_OK);
    std::mt19937 random(3);
    std::uniform_real_distribution<double> unit(-1, 1);
    double before = work_of_load(bar);
    const double whole = before;
    for (int stroke = 0; stroke < 10; stroke++) {
        const double normal[3] = {unit(random), unit(random), 1},
                     point[3] = {0.04 + 0.04 * unit(random), 0.04 + 0.04 * unit(random), 0.12 + 0.1 * unit(random)};
        std::vector<double> from, to;
        CutState::plane(point, normal, 0.024, from, to);
        const pliant_cut_sweep sweep{2, from.data(), to.data(), nullptr};
        pliant_body *next = nullptr;
        ASSERT_EQ(
            pliant_body_cut(bar.data->body, bar.data->last_revision + 1, bar.data->positions, &sweep, &next, nullptr),
            PLIANT_OK)
            << pliant_last_error();
        ASSERT_NE(next, nullptr);
        ASSERT_EQ(pliant_data_set_body(bar.model, bar.data, next), PLIANT_OK) << pliant_last_error();
        pliant_body_release(next);
        ASSERT_EQ(bar.settle(200), PLIANT_OK);
        const double after = work_of_load(bar);
        EXPECT_GE(after, before * (1 - bound))
            << "method " << method << ", kind " << kind << ", cells " << cells << ", stroke " << stroke;
        before = after;
    }
    EXPECT_GT(before, 1.02 * whole); // the cut has an effect
}

TEST(Strokes, LeaveABarWithNoMoreEnergy)
{
    const double rounding = 1e-6;
    for (pliant_element_kind kind : {PLIANT_LINEAR, PLIANT_HEXAHEDRA})
        for (int cells : {4, 8}) {
            expect_no_energy(PLIANT_FINE, kind, cells, 1, rounding);
            expect_no_energy(PLIANT_FINE, kind, cells, 2, kind == PLIANT_HEXAHEDRA && cells == 4 ? 2e-3 : rounding);
        }
    for (pliant_element_kind kind : {PLIANT_LINEAR, PLIANT_HEXAHEDRA})
        expect_no_energy(PLIANT_AVERAGED, kind, 8, 1, rounding);
}

// ---- homogenized models

struct Beam {
    std::unique_ptr<Body> body;
    static constexpr double pull = 0.002; // schur is several times too soft; blades must make the same cut

    Beam(pliant_method method, int ratio, pliant_element_kind kind = PLIANT_LINEAR)
    {
        const int size[3] = {64, 32, 16};
        const double box[3] = {0.16, 0.08, 0.04};
        body.reset(new Body(size, box, {{5000, 0.4, 1000, false}, {20000, 0.4, 1000, false}},
                            [](int i, int j, int k) { return (i / 6 + j / 5 + k / 4) % 2; }));
        body->fix_plane(1e-6, 0, 0, 1, 0, 0);
        body->scene.model.method = method;
        body->scene.element.kind = kind;
        body->cells(16 / ratio, 8 / ratio, 4 / ratio, ratio);
        body->scene.cut.kind = PLIANT_CUT_SEVER;
        body->scene.model.gravity[1] = -pull;
        EXPECT_EQ(body->build(), PLIANT_OK) << pliant_last_error();
        EXPECT_EQ(body->settle(), PLIANT_OK);
    }
    void cut_to(double deep, double plane = 0.081)
    {
        const double points[6] = {plane, 0.2, -1, plane, 0.2, 1}, way[3] = {0, -0.12 - deep, 0};
        ASSERT_EQ(pliant_data_cut(body->model, body->data, 2, points, way, nullptr), PLIANT_OK) << pliant_last_error();
        EXPECT_EQ(body->settle(), PLIANT_OK);
    }
    // Return the work of the load; the potential energy at rest is minus half of it.
    double work() const
    {
        const pliant_body &now = *body->data->body;
        double sum = 0;
        for (int32_t n = 0; n < now.fine.num_nodes; n++)
            sum += now.node_mass[n] * pull * (now.fine.rest[3 * n + 1] - body->data->positions[3 * n + 1]);
        return sum;
    }
    double error_against(const Beam &fine) const
    {
        const pliant_mesh &mesh = fine.body->data->body->fine;
        EXPECT_EQ(mesh.num_nodes, body->data->body->fine.num_nodes);
        double apart = 0, whole = 0;
        for (int32_t i = 0; i < 3 * mesh.num_nodes; i++) {
            apart += std::pow(body->data->positions[i] - fine.body->data->positions[i], 2);
            whole += std::pow(fine.body->data->positions[i] - mesh.rest[i], 2);
        }
        return std::sqrt(apart / whole);
    }
};

// In the plane between coarse cubes (0.08), cuts of 2 and 4 cm end at coarse nodes, and one of 5 cm in the middle of
// coarse faces. The cuts at 0.086 and 0.09 end inside coarse cubes. Fine elements next to the cut must not increase the
// error relative to the fine model: at most 1.04 times the error before the cut.
void expect_as_before(pliant_element_kind kind, int ratio, std::initializer_list<pliant_method> methods, double plane,
                      std::initializer_list<double> depths)
{
    Beam fine(PLIANT_FINE, 1, kind);
    const double whole = fine.work();
    std::vector<std::unique_ptr<Beam>> beams;
    std::vector<double> before, work;
    for (pliant_method method : methods) {
        beams.emplace_back(new Beam(method, ratio, kind));
        before.push_back(beams.back()->error_against(fine));
        if (method != PLIANT_SCHUR)
            EXPECT_LT(before.back(), kind == PLIANT_HEXAHEDRA ? 0.06 : ratio == 4 ? 0.35 : 0.13) << "method " << method;
        work.push_back(beams.back()->work());
    }
    for (double deep : depths) {
        fine.cut_to(deep, plane);
        for (size_t b = 0; b < beams.size(); b++) {
            beams[b]->cut_to(deep, plane);
            EXPECT_LT(beams[b]->error_against(fine), 1.1 * before[b])
                << "method " << methods.begin()[b] << ", kind " << kind << ", cut at " << plane << " to " << deep;
            /* the fine elements that replace its elements are stiffer */
            if (methods.begin()[b] == PLIANT_SCHUR) continue;
            EXPECT_GE(beams[b]->work(), (1 - 1e-9) * work[b])
                << "energy never rises by a cut: method " << methods.begin()[b];
            work[b] = beams[b]->work();
        }
    }
    EXPECT_GT(fine.work(), 1.05 * whole); // the cut has an effect
}

TEST(Homogenized, TetrahedraFollowTheFineOnesAfterTheSameCuts)
{
    expect_as_before(PLIANT_LINEAR, 2, {PLIANT_COARSE, PLIANT_AVERAGED, PLIANT_SCHUR}, 0.081,
                     {0.02, 0.04, 0.05});
    for (double plane : {0.086, 0.09})
        expect_as_before(PLIANT_LINEAR, 2, {PLIANT_AVERAGED}, plane, {0.03, 0.05});
    expect_as_before(PLIANT_LINEAR, 4, {PLIANT_AVERAGED}, 0.09, {0.03});
}

TEST(Homogenized, HexahedraFollowTheFineOnesAfterTheSameCuts)
{
    expect_as_before(PLIANT_HEXAHEDRA, 2, {PLIANT_COARSE, PLIANT_AVERAGED, PLIANT_SCHUR}, 0.081,
                     {0.02, 0.04, 0.05});
    for (double plane : {0.086, 0.09})
        expect_as_before(PLIANT_HEXAHEDRA, 2, {PLIANT_AVERAGED}, plane, {0.03, 0.05});
    expect_as_before(PLIANT_HEXAHEDRA, 4, {PLIANT_AVERAGED}, 0.09, {0.03});
}

// ---- stress on new faces

// A part of a bar that hangs along x, between two heights in voxel layers, and the stress at its nodes.
struct Strip {
    static constexpr double length = 0.16, pull = 0.01;
    Body body;
    Strip(int low, int high, pliant_element_kind kind)
        : body(std::array<int, 3>{32, 16, 4}.data(), std::array<double, 3>{length, 0.08, 0.02}.data(),
               {{young, 0, density, false}, {1e-3, 0, 1e-3, true}},
               [=](int, int j, int) { return j < low || j >= high; })
    {
        body.fix_plane(1e-6, 0, 0, 1, 0, 0);
        body.cells(8, 4, 1, 1);
        body.scene.element.kind = kind;
        body.scene.cut.kind = PLIANT_CUT_SEVER;
        body.scene.model.gravity[0] = pull;
        EXPECT_EQ(body.build(), PLIANT_OK) << pliant_last_error();
        EXPECT_EQ(body.settle(), PLIANT_OK);
    }
    std::vector<float> stress() const
    {
        std::vector<float> out(static_cast<size_t>(body.data->body->fine.num_nodes));
        EXPECT_EQ(pliant_data_get_scalar(body.model, body.data, PLIANT_SCALAR_VON_MISES, out.data()), PLIANT_OK);
        return out;
    }
    int32_t node_at(const double rest[3]) const
    {
        const pliant_mesh &mesh = body.data->body->fine;
        int32_t n = 0;
        while (n < mesh.num_nodes && !std::equal(rest, rest + 3, mesh.rest + 3 * n,
                                                 [](double a, double b) { return std::fabs(a - b) < 1e-9; }))
            n++;
        return n;
    }
};

// A bar slit along its whole length within a layer of elements becomes two bars. The stress at copied nodes equals the
// stress of two separately meshed bars. Both equal the weight below, although a cut element has only a fraction of the
// tissue's stiffness.
TEST(Stress, OfNewFacesIsThatOfHalvesThatAreMeshedApart)
{
    for (pliant_element_kind kind : {PLIANT_LINEAR, PLIANT_HEXAHEDRA}) {
        Strip whole(0, 16, kind);
        const Strip halves[2] = {{0, 6, kind}, {6, 16, kind}};
        const double points[6] = {-1, 0.03, -1, -1, 0.03, 1}, way[3] = {2, 0, 0};
        ASSERT_EQ(pliant_data_cut(whole.body.model, whole.body.data, 2, points, way, nullptr), PLIANT_OK)
            << pliant_last_error();
        ASSERT_EQ(whole.body.settle(), PLIANT_OK);
        const pliant_body &now = *whole.body.data->body;
        const std::vector<float> stress = whole.stress(), apart[2] = {halves[0].stress(), halves[1].stress()};
        const std::vector<int32_t> pieces = mesh_pieces(now);
        int32_t low = -1;
        for (int32_t v = 0; v < 4 * now.fine.num_tets; v++)
            if (now.fine.rest[3 * now.fine.tets[v] + 1] < 1e-9) low = pieces[v / 4];
        std::set<int32_t> seen;
        for (int32_t v = 0; v < 4 * now.fine.num_tets; v++) {
            const int32_t node = now.fine.tets[v], upper = pieces[v / 4] != low;
            const double *rest = now.fine.rest + 3 * node, exact = density * Strip::pull * (Strip::length - rest[0]);
            ASSERT_TRUE(std::isfinite(stress[node]));
            const int32_t other = halves[upper].node_at(rest);
            ASSERT_LT(other, static_cast<int32_t>(apart[upper].size()));
            if (rest[0] < 0.03 || rest[0] > 0.13) continue; // exclude the fixed end and the unloaded end
            EXPECT_NEAR(stress[node], apart[upper][other], (kind == PLIANT_LINEAR ? 0.1 : 0.3) * exact)
                << "kind " << kind << ", node " << node;
            EXPECT_NEAR(stress[node], exact, 0.3 * exact) << "kind " << kind << ", node " << node;
            if (now.node_parent && now.node_parent[node] != node) seen.insert(node);
        }
        EXPECT_GT(seen.size(), 10u) << "copies";
    }
}

} // namespace
