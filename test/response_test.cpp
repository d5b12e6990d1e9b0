// The response of the fine mesh to the force on a footprint, and the basis of these responses.
#include "pipeline/body.h"

#include "fem/patch/patch.h"
#include "fem/linear/basis.h"
#include "model_data/data.h"
#include "base/memory.h"

namespace {

const double side = 0.2;

struct Response : testing::Test {
    const int size[3] = {16, 16, 16};
    const double box[3] = {side, side, side};
    Body body{size, box, {{4000, 0.45, 1000, false}, {60000, 0.3, 1000, false}},
              [](int i, int j, int k) { return (i / 4 + j / 5 + k / 3) % 2; }};
    const pliant_system *fine = nullptr;
    size_t unknowns = 0;
    std::vector<int32_t> nodes;
    std::vector<double> weights;

    void SetUp() override
    {
        body.fix_plane(0, 0, 0, 0, 0, 1);
        body.cells(4, 4, 4, 2);
        body.scene.model.method = PLIANT_AVERAGED;
        body.scene.model.patch = 0.04;
        ASSERT_EQ(body.build(), PLIANT_OK) << pliant_last_error();
        fine = body.model->fine_system;
        unknowns = 3 * static_cast<size_t>(fine->num_free);
        int tool;
        const double at[3] = {0.1, 0.1, 0.19};
        body.scene.grasp.radius = 0.03;
        ASSERT_EQ(pliant_tool_add(body.model, body.data, "tool", &tool), PLIANT_OK);
        ASSERT_EQ(pliant_tool_grasp(body.model, body.data, tool, at), PLIANT_OK) << pliant_last_error();
        nodes.assign(body.data->tools[0].held, body.data->tools[0].held + body.data->tools[0].num_held);
        weights.assign(body.data->tools[0].weight, body.data->tools[0].weight + body.data->tools[0].num_held);
    }

    std::vector<double> modes_at(const std::vector<double> &x) const
    {
        std::vector<double> out(PLIANT_RESPONSE_MODES * unknowns);
        pliant_linearized linearized{};
        EXPECT_EQ(pliant_linearized_create(fine, x.data(), &linearized), PLIANT_OK);
        EXPECT_EQ(pliant_response_modes(&linearized, fine->preconditioner, static_cast<int32_t>(nodes.size()),
                                        nodes.data(), weights.data(), out.data()),
                  PLIANT_OK);
        pliant_linearized_free(&linearized);
        return out;
    }
    std::vector<double> rest() const
    {
        return {body.model->body->fine.rest, body.model->body->fine.rest + 3 * body.model->body->fine.num_nodes};
    }
};

double norm(const std::vector<double> &v)
{
    double sum = 0;
    for (double x : v) sum += x * x;
    return std::sqrt(sum);
}

// The forces at  z l t + 1/2 psi l l t^2  equal the load, up to the third order of t.
TEST_F(Response, BalancesTheLoadToSecondOrder)
{
    const std::vector<double> x = rest(), modes = modes_at(x);
    const double l[3] = {0.6, -0.3, 0.7};
    pliant_linearized linearized{};
    ASSERT_EQ(pliant_linearized_create(fine, x.data(), &linearized), PLIANT_OK);
    double left[2];
    for (int half = 0; half < 2; half++) {
        double t = half ? 0.5 : 1;
        std::vector<double> u(unknowns), forces(unknowns);
        for (size_t i = 0; i < unknowns; i++) {
            size_t next = 3;
            for (int a = 0; a < 3; a++) {
                u[i] += t * l[a] * modes[unknowns * a + i];
                for (int b = a; b < 3; b++)
                    u[i] += (a == b ? 0.5 : 1) * t * t * l[a] * l[b] * modes[unknowns * next++ + i];
            }
        }
        pliant_linearized_forces(&linearized, u.data(), forces.data());
        for (size_t h = 0; h < nodes.size(); h++)
            for (int d = 0; d < 3; d++)
                forces[3 * static_cast<size_t>(fine->free_of_node[nodes[h]]) + d] -= t * l[d] * weights[h];
        left[half] = norm(forces);
    }
    pliant_linearized_free(&linearized);
    EXPECT_LT(left[0], 0.05); // of a load of 1 N
    EXPECT_NEAR(left[0] / left[1], 8, 1);
}

// In a rotated body, the response rotates with the body.
TEST_F(Response, TurnsWithTheBody)
{
    const double angle = 0.3, c = std::cos(angle), s = std::sin(angle);
    const double turn[9] = {c, -s, 0, s, c, 0, 0, 0, 1}, shift[3] = {0.02, -0.01, 0.005};
    const std::vector<double> before = modes_at(rest()), after = modes_at(affine(body.model->body->fine, turn, shift));
    // The response z of the rotated body to e_0 is the rotated response to turn' e_0 = (c, -s, 0).
    std::vector<double> expected(unknowns), difference(unknowns);
    for (size_t f = 0; f < unknowns; f += 3)
        for (size_t r = 0; r < 3; r++) {
            for (size_t k = 0; k < 3; k++)
                expected[f + r] += turn[3 * r + k] * (c * before[f + k] - s * before[unknowns + f + k]);
            difference[f + r] = after[f + r] - expected[f + r];
        }
    EXPECT_LT(norm(difference), 1e-3 * norm(expected));
}

TEST_F(Response, SpaceHasTheStiffnessOfTheWholeMesh)
{
    const std::vector<double> x = rest();
    std::vector<double> modes = modes_at(x);
    pliant_footprint footprint{static_cast<int32_t>(nodes.size()), nodes.data(), weights.data(), {0.1, 0.1, 0.19}};
    const double *const block = modes.data();
    pliant_linearized linearized{};
    pliant_basis *basis = nullptr;
    ASSERT_EQ(pliant_linearized_create(fine, x.data(), &linearized), PLIANT_OK);
    ASSERT_EQ(
        pliant_basis_create(fine, &linearized, body.model->body->fine_fixed, 0.04, 1, &footprint, 1, &block, 2, &basis),
        PLIANT_OK)
        << pliant_last_error();
    EXPECT_EQ(basis->num_modes, PLIANT_RESPONSE_MODES);
    EXPECT_GT(basis->num_own, 10);
    EXPECT_LT(basis->mesh.num_tets, body.model->body->fine.num_tets);
    const size_t n = 3 * static_cast<size_t>(basis->system.num_free);
    auto dot = [](size_t count, const double *a, const double *b) {
        double sum = 0;
        for (size_t i = 0; i < count; i++) sum += a[i] * b[i];
        return sum;
    };
    // For a small displacement E q, the projected forces of the near part and of the far part equal the forces of the
    // whole mesh.
    std::vector<double> near(x.size()), small(3 * static_cast<size_t>(basis->mesh.num_nodes)), forces(n);
    std::vector<double> whole(unknowns), product(unknowns), capacity(unknowns);
    for (int m = 0; m < basis->num_modes; m++)
        for (size_t i = 0; i < unknowns; i++) whole[i] += (m % 2 ? -1 : 1) * 1e-7 * basis->whole[unknowns * m + i];
    pliant_linearized_product(&linearized, whole.data(), capacity.data(), product.data());
    std::vector<double> blocks(12 * LANES * static_cast<size_t>(basis->system.num_blocks));
    std::memcpy(small.data(), basis->mesh.rest, small.size() * sizeof(double));
    for (size_t f = 0; f < n / 3; f++)
        for (int d = 0; d < 3; d++) {
            size_t at = 3 * static_cast<size_t>(basis->system.node_of_free[f]) + d;
            for (int m = 0; m < basis->num_modes; m++)
                small[at] += (m % 2 ? -1 : 1) * 1e-7 * basis->modes[n * m + 3 * f + d];
        }
    auto element_forces = reinterpret_cast<double (*)[12][LANES]>(blocks.data());
    pliant_system_element_forces(&basis->system, small.data(), element_forces);
    pliant_system_gather(&basis->system, element_forces, forces.data());
    pliant_basis_far_forces(basis, small.data(), forces.data());
    for (int m = 0; m < basis->num_modes; m++) {
        double expected = dot(unknowns, basis->whole + unknowns * m, product.data());
        EXPECT_NEAR(dot(n, basis->modes + n * m, forces.data()), expected, 1e-4 * std::fabs(expected)) << m;
    }
    // The fine positions of such a state are the positions of the modes on the whole mesh.
    pliant_basis_positions(basis, fine, x.data(), small.data(), near.data());
    double max_difference = 0;
    for (size_t f = 0; f < unknowns / 3; f++)
        for (int d = 0; d < 3; d++) {
            size_t at = 3 * static_cast<size_t>(fine->node_of_free[f]) + d;
            max_difference = std::fmax(max_difference, std::fabs(near[at] - x[at] - whole[3 * f + d]));
        }
    EXPECT_LT(max_difference, 1e-12);
    // The projection keeps a state of the basis. It maps any other state into the basis, and a second projection keeps
    // the result.
    std::vector<double> state = small, other = small;
    pliant_basis_project(basis, state.data());
    for (size_t i = 0; i < small.size(); i++) EXPECT_NEAR(state[i], small[i], 1e-15) << i;
    for (size_t i = 0; i < other.size(); i++) other[i] += 1e-3 * std::sin(0.7 * double(i));
    const std::vector<double> rough = other;
    pliant_basis_project(basis, other.data());
    state = other;
    pliant_basis_project(basis, state.data());
    double moved = 0, again = 0;
    for (size_t i = 0; i < state.size(); i++) {
        moved = std::fmax(moved, std::fabs(other[i] - rough[i]));
        again = std::fmax(again, std::fabs(state[i] - other[i]));
    }
    EXPECT_GT(moved, 1e-4);
    EXPECT_LT(again, 1e-14);
    for (int32_t o = 0; o < basis->num_own; o++)
        for (int d = 0; d < 3; d++) {
            size_t at = 3 * static_cast<size_t>(basis->system.node_of_free[basis->own[o]]) + d;
            EXPECT_EQ(other[at], rough[at]);
        }
    // The approximate inverse is symmetric and positive definite.
    std::vector<double> a(n), b(n), inverse_a(n), inverse_b(n);
    for (size_t i = 0; i < n; i++) {
        a[i] = std::sin(0.7 * double(i));
        b[i] = std::cos(0.3 * double(i * i % 101));
    }
    ASSERT_EQ(pliant_preconditioner_solve(basis->system.preconditioner, 1, a.data(), inverse_a.data()), PLIANT_OK);
    ASSERT_EQ(pliant_preconditioner_solve(basis->system.preconditioner, 1, b.data(), inverse_b.data()), PLIANT_OK);
    const double energy = dot(n, a.data(), inverse_a.data());
    EXPECT_GT(energy, 0);
    EXPECT_NEAR(dot(n, a.data(), inverse_b.data()), dot(n, b.data(), inverse_a.data()), 1e-6 * energy);
    // the response to the footprint's force is in the basis
    std::vector<double> load(n), answer(n);
    for (size_t h = 0; h < nodes.size(); h++)
        load[3 * static_cast<size_t>(basis->system.free_of_node[basis->near_node[nodes[h]]]) + 2] += weights[h];
    ASSERT_EQ(pliant_preconditioner_solve(basis->system.preconditioner, 1, load.data(), answer.data()), PLIANT_OK);
    double off = 0, maximum = 0;
    for (size_t f = 0; f < n / 3; f++)
        for (int d = 0; d < 3; d++) {
            int32_t node = basis->fine_node[basis->system.node_of_free[f]];
            double z = modes[2 * unknowns + 3 * static_cast<size_t>(fine->free_of_node[node]) + d];
            off = std::fmax(off, std::fabs(answer[3 * f + d] - z));
            maximum = std::fmax(maximum, std::fabs(z));
        }
    EXPECT_LT(off, 1e-3 * maximum);
    pliant_basis_free(basis);
    pliant_linearized_free(&linearized);
}

// The cost prediction of a patch bounds the cost of a patch that contains most of the body, within a factor of 10.
TEST_F(Response, TheCostOfASpaceIsPredicted)
{
    const double radius = 0.15;
    const std::vector<double> x = rest(), modes = modes_at(x);
    const double *const block = modes.data();
    pliant_footprint footprint{static_cast<int32_t>(nodes.size()), nodes.data(), weights.data(), {0.1, 0.1, 0.19}};
    pliant_linearized linearized{};
    pliant_basis *basis = nullptr;
    ASSERT_EQ(pliant_linearized_create(fine, x.data(), &linearized), PLIANT_OK);
    ASSERT_EQ(pliant_basis_create(fine, &linearized, body.model->body->fine_fixed, radius, 1, &footprint, 1, &block, 2,
                                  &basis),
              PLIANT_OK)
        << pliant_last_error();
    pliant_basis_size size = pliant_basis_measure(fine, radius, 1, &footprint, 1), none = size;
    EXPECT_EQ(size.own, basis->num_own);
    EXPECT_LE(size.near, basis->system.num_free);
    EXPECT_GT(size.near, 2 * size.own / 3);
    none.own = none.near = 0;
    const double foretold = pliant_basis_operations(fine, size) - pliant_basis_operations(fine, none);
    const double blas = 5,
                 done = pliant_reduction_operations(basis) - (1 - 1 / blas) * pliant_factor_operations(basis->analyzed);
    EXPECT_GT(foretold, done);
    EXPECT_LT(foretold, 10 * done);
    const double bytes = pliant_basis_bytes(fine, size) - pliant_basis_bytes(fine, none);
    const double held = 3.0 * (sizeof(double) + sizeof(float)) * pliant_factor_values(basis->analyzed);
    EXPECT_GT(bytes, held);
    EXPECT_LT(bytes, 3 * held);
    std::printf("operations %g of %g, bytes %g of %g\n", done, foretold, held, bytes);
    pliant_basis_free(basis);
    pliant_linearized_free(&linearized);
}

TEST_F(Response, EndsWhenCancelled)
{
    const std::vector<double> x = rest();
    std::vector<double> modes = modes_at(x), out(modes.size());
    const double *const block = modes.data();
    pliant_footprint footprint{static_cast<int32_t>(nodes.size()), nodes.data(), weights.data(), {0.1, 0.1, 0.19}};
    pliant_linearized linearized{};
    ASSERT_EQ(pliant_linearized_create(fine, x.data(), &linearized), PLIANT_OK);
    int left = 0;
    linearized.progress = {[](double, const char *, void *calls) { return --*static_cast<int *>(calls) >= 0; }, &left};
    const size_t bytes = pliant_memory_in_use();
    for (int calls : {0, 1, 7}) {
        pliant_basis *basis = nullptr;
        left = calls;
        EXPECT_EQ(pliant_response_modes(&linearized, fine->preconditioner, static_cast<int32_t>(nodes.size()),
                                        nodes.data(), weights.data(), out.data()),
                  PLIANT_ERROR_CANCELLED);
        left = calls;
        EXPECT_EQ(pliant_response_pair_modes(&linearized, fine->preconditioner, modes.data(), modes.data(), out.data()),
                  PLIANT_ERROR_CANCELLED);
        left = calls;
        EXPECT_EQ(pliant_basis_create(fine, &linearized, body.model->body->fine_fixed, 0.04, 1, &footprint, 1, &block,
                                      2, &basis),
                  PLIANT_ERROR_CANCELLED);
        EXPECT_EQ(basis, nullptr);
        EXPECT_EQ(pliant_memory_in_use(), bytes);
    }
    pliant_linearized_free(&linearized);
}

} // namespace
