// Tests of a preconditioner that is carried over from one body to the next.
#include "fem/linear/carried_preconditioner.h"
#include "base/dense.h"
#include "blocks.h"
#include "pipeline/body.h"
#include "pipeline/fragments.h"
#include "base/memory.h"
#include "sim/build/discretization.h"

#include <memory>
#include <random>

namespace {

// A bar that a plane cuts half-way through. Its preconditioner is carried over at rest.
struct Bar {
    std::unique_ptr<Body> body;
    const pliant_body *next = nullptr;
    const pliant_discretization *made = nullptr;
    pliant_body_map map{};
    pliant_preconditioner *carried = nullptr;
    std::vector<double> values;

    explicit Bar(pliant_preconditioner_choice choice, pliant_element_kind kind = PLIANT_LINEAR)
    {
        const int size[3] = {24, 12, 12};
        const double box[3] = {0.24, 0.12, 0.12};
        body.reset(new Body(size, box, {{4000, 0.4, 1000, false}, {40000, 0.4, 1000, false}},
                            [](int i, int j, int) { return i / 4 % 2 && j > 5; }));
        body->fix_plane(1e-6, 0, 0, 1, 0, 0);
        body->cells(12, 6, 6, 1);
        body->scene.solver.preconditioner = choice;
        body->scene.element.kind = kind;
        EXPECT_EQ(body->build(), PLIANT_OK) << pliant_last_error();
        const pliant_body *load = body->model->body;
        next = sever_plane(load, 2, {{0.11, 0.06, 0.06}, {1, 0.1, 0.2}}, [](const double *x) { return x[2] > 0.05; });
        EXPECT_TRUE(next) << pliant_last_error();
        EXPECT_EQ(pliant_body_map_create(load, next, &map), PLIANT_OK);
        EXPECT_EQ(pliant_discretization_next(&body->scene, body->model->discretization, next, &map, &made), PLIANT_OK)
            << pliant_last_error();
        EXPECT_EQ(pliant_system_find_pattern(made->system), PLIANT_OK);
        int32_t *source =
            static_cast<int32_t *>(pliant_calloc(static_cast<size_t>(system().num_free), sizeof(int32_t)));
        for (int32_t f = 0; f < system().num_free; f++)
            source[f] = body->model->system->free_of_node[map.node[system().node_of_free[f]]];
        EXPECT_EQ(pliant_preconditioner_carry(&system(), body->model->discretization, body->model->system, source,
                                              system().mesh->rest, nullptr, &carried),
                  PLIANT_OK);
        pliant_preconditioner *base = nullptr;
        EXPECT_EQ(pliant_preconditioner_clone(body->model->system->preconditioner, 1, &base), PLIANT_OK);
        pliant_preconditioner_take_base(carried, &base);
        std::vector<pliant_tangent> tangents(static_cast<size_t>(system().num_blocks));
        pliant_system_tangents(&system(), system().mesh->rest, PLIANT_TWIST_EXACT, tangents.data());
        values.resize(static_cast<size_t>(system().pattern.num_values));
        pliant_system_assemble(&system(), tangents.data(), values.data());
    }
    ~Bar()
    {
        pliant_preconditioner_free(carried);
        pliant_discretization_release(made);
        pliant_body_map_free(&map);
        pliant_body_release(next);
    }
    const pliant_system &system() const { return *made->system; }
    size_t unknowns() const { return 3 * static_cast<size_t>(system().num_free); }
    std::vector<double> multiply(const std::vector<double> &x) const
    {
        return multiply_blocks(system().pattern, values, x);
    }
    std::vector<double> solve(const std::vector<double> &x) const
    {
        std::vector<double> y(x.size());
        EXPECT_EQ(pliant_preconditioner_solve(carried, 1, x.data(), y.data()), PLIANT_OK);
        return y;
    }
};

double dot(const std::vector<double> &a, const std::vector<double> &b)
{
    return pliant_dot(a.size(), a.data(), b.data());
}

std::vector<double> noise(size_t count, unsigned seed)
{
    std::mt19937 random(seed);
    std::uniform_real_distribution<double> unit(-1, 1);
    std::vector<double> out(count);
    for (double &x : out) x = unit(random);
    return out;
}

struct EveryBase : testing::TestWithParam<std::tuple<pliant_preconditioner_choice, pliant_element_kind>> {
    Bar bar{std::get<0>(GetParam()), std::get<1>(GetParam())};
};

TEST_P(EveryBase, IsSymmetricAndPositive)
{
    EXPECT_GT(bar.next->fine.num_nodes, bar.body->model->body->fine.num_nodes + 20);
    for (unsigned seed = 0; seed < 20; seed++) {
        const std::vector<double> a = noise(bar.unknowns(), 2 * seed), b = noise(bar.unknowns(), 2 * seed + 1),
                                  ma = bar.solve(a), mb = bar.solve(b);
        const double ab = dot(a, mb), ba = dot(b, ma), aa = dot(a, ma), bb = dot(b, mb);
        EXPECT_GT(aa, 0);
        EXPECT_NEAR(ab, ba, 1e-5 * std::sqrt(aa * bb)); // the factor's panels are in single precision
    }
}

// Conjugate gradients solve K x = right. The count is the number of products until the residual's norm is a thousandth.
TEST_P(EveryBase, NearlyInvertsTheDividedStiffness)
{
    std::vector<double> right(bar.unknowns()); // a weight that opens the cut
    for (size_t i = 0; i < right.size(); i += 3) right[i + 2] = -1;
    std::vector<double> x(bar.unknowns()), r = right, z = bar.solve(r), p = z;
    double rz = dot(r, z);
    const double first = rz;
    int products = 0;
    for (int all = 0; all < 100 && rz > 1e-14 * first; all++) {
        const std::vector<double> q = bar.multiply(p);
        products += rz > 1e-6 * first;
        const double alpha = rz / dot(p, q);
        for (size_t i = 0; i < x.size(); i++) x[i] += alpha * p[i], r[i] -= alpha * q[i];
        z = bar.solve(r);
        const double now = dot(r, z);
        for (size_t i = 0; i < x.size(); i++) p[i] = z[i] + now / rz * p[i];
        rz = now;
    }
    EXPECT_LE(products, 9);
    EXPECT_GE(products, 2);
    const std::vector<double> kx = bar.multiply(x);
    double difference = 0;
    for (size_t i = 0; i < x.size(); i++) difference = std::fmax(difference, std::fabs(kx[i] - right[i]));
    EXPECT_LT(difference, 1e-3);
}

// Where nothing is opened, the result is the base's result.
TEST(Carried, IsExactWhereNothingIsOpened)
{
    Bar bar(PLIANT_DIRECT);
    const pliant_system &load = *bar.body->model->system;
    std::vector<int32_t> same(static_cast<size_t>(load.num_free));
    for (int32_t f = 0; f < load.num_free; f++) same[f] = f;
    int32_t *source = static_cast<int32_t *>(pliant_calloc(same.size(), sizeof(int32_t)));
    std::copy(same.begin(), same.end(), source);
    pliant_preconditioner *carried = nullptr, *base = nullptr;
    ASSERT_EQ(pliant_preconditioner_carry(&load, bar.body->model->discretization, &load, source, load.mesh->rest,
                                          nullptr, &carried),
              PLIANT_OK);
    ASSERT_EQ(pliant_preconditioner_clone(load.preconditioner, 1, &base), PLIANT_OK);
    const std::vector<double> a = noise(3 * same.size(), 1);
    std::vector<double> b(a.size()), c(a.size());
    ASSERT_EQ(pliant_preconditioner_solve(base, 1, a.data(), b.data()), PLIANT_OK);
    pliant_preconditioner_take_base(carried, &base);
    EXPECT_EQ(base, nullptr);
    ASSERT_EQ(pliant_preconditioner_solve(carried, 1, a.data(), c.data()), PLIANT_OK);
    EXPECT_EQ(b, c);
    pliant_preconditioner_free(carried);
}

// A prescribed elimination order gives the same solution within rounding.
TEST(Carried, AFactorInAGivenOrder)
{
    Bar bar(PLIANT_DIRECT);
    const pliant_system &system = bar.system();
    std::vector<int32_t> order(static_cast<size_t>(system.num_free)), found(order.size());
    for (int32_t f = 0; f < system.num_free; f++) order[f] = system.num_free - 1 - f;
    pliant_factor *given = nullptr, *free_choice = nullptr;
    ASSERT_EQ(pliant_factor_analyze_in(&system.pattern, order.data(), &given), PLIANT_OK);
    ASSERT_EQ(pliant_factor_analyze(&system.pattern, &free_choice), PLIANT_OK);
    ASSERT_EQ(pliant_factor_order(free_choice, found.data()), system.num_free);
    std::vector<int32_t> sorted = found;
    std::sort(sorted.begin(), sorted.end());
    for (int32_t f = 0; f < system.num_free; f++) ASSERT_EQ(sorted[f], f);
    const std::vector<double> a = noise(bar.unknowns(), 3);
    std::vector<double> b(a.size()), c(a.size());
    ASSERT_EQ(pliant_factor_numeric(given, bar.values.data()), PLIANT_OK);
    ASSERT_EQ(pliant_factor_numeric(free_choice, bar.values.data()), PLIANT_OK);
    ASSERT_EQ(pliant_factor_solve(given, 1, a.data(), b.data()), PLIANT_OK);
    ASSERT_EQ(pliant_factor_solve(free_choice, 1, a.data(), c.data()), PLIANT_OK);
    const double size = largest(b);
    for (size_t i = 0; i < b.size(); i++) ASSERT_NEAR(b[i], c[i], 1e-4 * size);
    EXPECT_LT(pliant_factor_values(free_choice), pliant_factor_values(given));
    pliant_factor_free(given);
    pliant_factor_free(free_choice);
}

// A coarse model in which fine cubes near an earlier cut are divided: a later cut opens only the cubes that it divides.
TEST(Carried, ALaterCutOfCoarseHexahedraOpensNothingNextToAnEarlierOne)
{
    const int size[3] = {48, 12, 12};
    const double box[3] = {0.48, 0.12, 0.12};
    Body body(size, box, {{4000, 0.4, 1000, false}});
    body.fix_plane(1e-6, 0, 0, 1, 0, 0);
    body.cells(12, 3, 3, 2);
    body.scene.element.kind = PLIANT_HEXAHEDRA;
    body.scene.model.method = PLIANT_AVERAGED;
    ASSERT_EQ(body.build(), PLIANT_OK) << pliant_last_error();
    const Plane earlier{{0.11, 0.06, 0.06}, {1, 0.1, 0.2}}, later{{0.37, 0.06, 0.06}, {1, 0.1, 0.2}};
    std::vector<int8_t> sides[2];
    const pliant_body *bodies[4] = {body.model->body};
    const pliant_discretization *made[4] = {body.model->discretization};
    std::vector<int32_t> source; // for each unknown of the last system, its source
    for (int c = 0; c < 3; c++) {
        const double depth = c == 1 ? 0.09 : 0.05;
        bodies[c + 1] = sever_plane(
            bodies[c], c + 2, c == 0 ? earlier : later, [depth](const double *x) { return x[2] > depth; },
            &sides[c > 0]);
        ASSERT_TRUE(bodies[c + 1]) << pliant_last_error();
        if (c == 0) sides[1].assign(static_cast<size_t>(bodies[1]->fine.num_tets), 0);
        pliant_body_map map;
        ASSERT_EQ(pliant_body_map_create(bodies[c], bodies[c + 1], &map), PLIANT_OK);
        ASSERT_EQ(pliant_discretization_next(&body.scene, made[c], bodies[c + 1], &map, &made[c + 1]), PLIANT_OK)
            << pliant_last_error();
        const pliant_system &was = *made[c]->system, &next = *made[c + 1]->system;
        int32_t *own = nullptr;
        const int32_t *node = nullptr;
        ASSERT_EQ(pliant_solved_sources(&next, &was, &map, &own, &node), PLIANT_OK);
        source.resize(static_cast<size_t>(next.num_free));
        for (int32_t f = 0; f < next.num_free; f++)
            source[f] = node[next.node_of_free[f]] >= 0 ? was.free_of_node[node[next.node_of_free[f]]] : -1;
        pliant_free(own);
        pliant_body_map_free(&map);
    }
    const pliant_system &before = *made[2]->system, &now = *made[3]->system;
    ASSERT_TRUE(before.graded && now.graded);
    pliant_carried_layout layout;
    ASSERT_EQ(pliant_carried_layout_create(&before, &layout), PLIANT_OK);
    std::vector<uint8_t> opened(static_cast<size_t>(now.num_free), 0);
    ASSERT_EQ(pliant_carried_mark_opened(&now, &layout, source.data(), opened.data()), PLIANT_OK);
    pliant_carried_layout_free(&layout);
    int count = 0;
    for (int32_t f = 0; f < now.num_free; f++) {
        if (!opened[f]) continue;
        count++;
        // fine unknowns of newly divided coarse cubes have no source
        EXPECT_LT(std::fabs(later.side(now.mesh->rest + 3 * now.node_of_free[f])), source[f] < 0 ? 0.1 : 0.04);
    }
    EXPECT_GT(count, 10);
    EXPECT_LT(count, now.num_free / 4);
    for (int c = 1; c < 4; c++) {
        pliant_discretization_release(made[c]);
        pliant_body_release(bodies[c]);
    }
}

INSTANTIATE_TEST_SUITE_P(Choices, EveryBase,
                         testing::Combine(testing::Values(PLIANT_DIRECT, PLIANT_MULTIGRID),
                                          testing::Values(PLIANT_LINEAR, PLIANT_HEXAHEDRA)));

} // namespace
