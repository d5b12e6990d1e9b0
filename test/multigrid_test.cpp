// Tests of the V-cycle as a preconditioner: symmetric, positive definite, fast, and without effect on the solution.
#include "pipeline/body.h"

#include <random>

namespace {

class Multigrid : public ::testing::TestWithParam<pliant_element_kind> {};
INSTANTIATE_TEST_SUITE_P(Kinds, Multigrid, testing::Values(PLIANT_LINEAR, PLIANT_HEXAHEDRA));

const int size[3] = {32, 32, 32};
const double box[3] = {0.16, 0.16, 0.16};
const std::vector<Material> three = {{4000, 0.45, 950, false}, {20000, 0.45, 1050, false}, {1e6, 0.3, 1100, false}};
int blobs(int i, int j, int k)
{
    double v = std::sin(0.4 * i) * std::sin(0.3 * j) + std::cos(0.35 * k);
    return v > 0.9 ? 2 : v > 0.2;
}

void prepare(Body &body, pliant_preconditioner_choice choice, pliant_element_kind kind)
{
    body.scene.element.kind = kind;
    body.scene.solver.preconditioner = choice;
    body.cells(8, 8, 8, 2);
    body.fix_plane(0, 0, 0.001, 0, 0, 1);
}

TEST_P(Multigrid, IsSymmetricAndPositive)
{
    Body body(size, box, three, blobs);
    prepare(body, PLIANT_MULTIGRID, GetParam());
    ASSERT_EQ(body.build(), PLIANT_OK) << pliant_last_error();
    pliant_preconditioner *m = body.data->solver->preconditioner;
    size_t n = 3 * static_cast<size_t>(body.model->system->num_free);
    std::mt19937 random(2);
    std::normal_distribution<double> normal;
    std::vector<double> x(n), y(n), mx(n), my(n);
    for (int trial = 0; trial < 5; trial++) {
        for (double &v : x) v = normal(random);
        for (double &v : y) v = normal(random);
        ASSERT_EQ(pliant_preconditioner_solve(m, 1, x.data(), mx.data()), PLIANT_OK);
        ASSERT_EQ(pliant_preconditioner_solve(m, 1, y.data(), my.data()), PLIANT_OK);
        double xmy = 0, ymx = 0, xmx = 0, ymy = 0;
        for (size_t i = 0; i < n; i++) {
            xmy += x[i] * my[i];
            ymx += y[i] * mx[i];
            xmx += x[i] * mx[i];
            ymy += y[i] * my[i];
        }
        EXPECT_GT(xmx, 0);
        EXPECT_NEAR(xmy, ymx, 1e-5 * std::sqrt(xmx * ymy)); // blocks are stored as float
    }
}

// Conjugate gradients on the true matrix reduce the energy error to a hundredth in a few cycles, at a contrast of 250.
TEST_P(Multigrid, ConjugateGradientsConvergeInFewCycles)
{
    Body body(size, box, three, blobs);
    prepare(body, PLIANT_MULTIGRID, GetParam());
    ASSERT_EQ(body.build(), PLIANT_OK) << pliant_last_error();
    const pliant_system *system = body.model->system;
    size_t n = 3 * static_cast<size_t>(system->num_free);
    auto matrix = [&](const std::vector<double> &v) { // the force of a tiny displacement: linear about rest
        std::vector<double> at(system->mesh->rest, system->mesh->rest + 3 * system->mesh->num_nodes), out(n);
        double scale = 1e-7 / largest(v);
        for (int32_t f = 0; f < system->num_free; f++)
            for (int d = 0; d < 3; d++) at[3 * system->node_of_free[f] + d] += scale * v[3 * f + d];
        std::vector<double> force = body.elastic_force(at);
        for (int32_t f = 0; f < system->num_free; f++)
            for (int d = 0; d < 3; d++) out[3 * f + d] = force[3 * system->node_of_free[f] + d] / scale;
        return out;
    };
    std::vector<double> x(n, 0.0), r(n, 0.0), z(n), p(n);
    for (int32_t f = 0; f < system->num_free; f++) r[3 * f + 2] = -1;
    auto dot = [](const std::vector<double> &a, const std::vector<double> &b) {
        double sum = 0;
        for (size_t i = 0; i < a.size(); i++) sum += a[i] * b[i];
        return sum;
    };
    pliant_preconditioner_solve(body.data->solver->preconditioner, 1, r.data(), z.data());
    p = z;
    double rz = dot(r, z), start = rz;
    int cycles = 0;
    for (; cycles < 40 && rz > 1e-4 * start; cycles++) {
        std::vector<double> ap = matrix(p);
        double alpha = rz / dot(p, ap);
        for (size_t i = 0; i < n; i++) r[i] -= alpha * ap[i];
        pliant_preconditioner_solve(body.data->solver->preconditioner, 1, r.data(), z.data());
        double next = dot(r, z);
        for (size_t i = 0; i < n; i++) p[i] = z[i] + next / rz * p[i];
        rz = next;
    }
    std::printf("%d cycles to a hundredth\n", cycles);
    EXPECT_LE(cycles, 12);
}

std::vector<double> pulled(Body &body)
{
    EXPECT_EQ(body.build(), PLIANT_OK) << pliant_last_error();
    int tool;
    EXPECT_EQ(pliant_tool_add(body.model, body.data, "t", &tool), PLIANT_OK);
    const double point[3] = {0.08, 0.08, 0.15};
    EXPECT_EQ(pliant_tool_grasp(body.model, body.data, tool, point), PLIANT_OK);
    for (int s = 1; s <= 12; s++) {
        const double tip[3] = {0.08 + 0.001 * s, 0.08, 0.15 + 0.002 * s};
        pliant_tool_set_pose(body.data, tool, tip, nullptr);
        EXPECT_GE(pliant_step(body.model, body.data), 0);
    }
    EXPECT_EQ(body.settle(), PLIANT_OK);
    return std::vector<double>(body.data->positions, body.data->positions + 3 * body.model->body->fine.num_nodes);
}

TEST_P(Multigrid, SameAnswerAsDirect)
{
    Body direct(size, box, three, blobs), layered(size, box, three, blobs);
    prepare(direct, PLIANT_DIRECT, GetParam());
    prepare(layered, PLIANT_MULTIGRID, GetParam());
    layered.scene.solver.tolerance = direct.scene.solver.tolerance = 1e-6;
    layered.scene.solver.refresh_interval = direct.scene.solver.refresh_interval = 4;
    std::vector<double> a = pulled(direct), b = pulled(layered);
    double worst = 0;
    for (size_t n = 0; n < a.size(); n++) worst = std::fmax(worst, std::fabs(a[n] - b[n]));
    EXPECT_LT(worst, 1e-6); // for a pull of 26 mm, both solved to 1e-6
    EXPECT_GT(layered.data->statistics.factors, 0u);
}

TEST_P(Multigrid, SameBitsWithAnyNumberOfThreads)
{
    std::vector<double> results[2];
    for (int run = 0; run < 2; run++) {
        Body body(size, box, three, blobs);
        prepare(body, PLIANT_MULTIGRID, GetParam());
        body.scene.solver.threads = run + 1;
        body.scene.solver.iterations = 5;
        body.scene.solver.tolerance = 1e-4;
        results[run] = pulled(body);
    }
    EXPECT_EQ(results[0], results[1]);
}

TEST_P(Multigrid, ALatticeThatCannotBeHalvedIsFactored)
{
    Body body(size, box, three, blobs);
    prepare(body, PLIANT_MULTIGRID, GetParam());
    body.cells(11, 4, 4, 1);
    body.fix_plane(0, 0, 0.001, 0, 0, 1);
    EXPECT_EQ(body.build(), PLIANT_OK) << pliant_last_error();
    EXPECT_EQ(body.settle(), PLIANT_OK);
}

} // namespace
