// A multigrid cycle as a preconditioner: symmetric, positive definite, quick, and it changes no answer.
#include "fem/linear/hierarchy.h"
#include "pipeline/body.h"

#include <functional>
#include <random>

namespace {

const int size[3] = {32, 32, 32};
const double box[3] = {0.16, 0.16, 0.16};
const std::vector<Material> three = {{4000, 0.45, 950, false}, {20000, 0.45, 1050, false}, {1e6, 0.3, 1100, false}};
int blobs(int i, int j, int k)
{
    double v = std::sin(0.4 * i) * std::sin(0.3 * j) + std::cos(0.35 * k);
    return v > 0.9 ? 2 : v > 0.2;
}

void prepare(Body &body, pliant_preconditioner_choice choice)
{
    body.scene.solver.preconditioner = choice;
    body.cells(8, 8, 8, 2);
    body.fix_plane(0, 0, 0.001, 0, 0, 1);
}

TEST(Multigrid, IsSymmetricAndPositive)
{
    Body body(size, box, three, blobs);
    prepare(body, PLIANT_MULTIGRID);
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
        EXPECT_NEAR(xmy, ymx, 1e-5 * std::sqrt(xmx * ymy)); // blocks are kept in float
    }
}

double dot(const std::vector<double> &a, const std::vector<double> &b)
{
    double sum = 0;
    for (size_t i = 0; i < a.size(); i++) sum += a[i] * b[i];
    return sum;
}

using Operator = std::function<void(const std::vector<double> &, std::vector<double> &)>;

// the matrix at a state of the solved mesh
Operator matrix_at(const pliant_system *system, const std::vector<double> &positions)
{
    std::vector<pliant_tangent> tangents(static_cast<size_t>(system->num_blocks));
    pliant_system_tangents(system, positions.data(), PLIANT_TWIST_POSITIVE, tangents.data());
    std::vector<double> blocks(9 * static_cast<size_t>(system->pattern.num_blocks));
    for (int32_t b = 0; b < system->pattern.num_blocks; b++)
        pliant_system_assemble_block(system, tangents.data(), b, &blocks[9 * static_cast<size_t>(b)]);
    return [system, blocks](const std::vector<double> &x, std::vector<double> &out) {
        out.assign(x.size(), 0);
        const pliant_pattern &pattern = system->pattern;
        for (int32_t column = 0; column < pattern.num_columns; column++)
            for (int32_t b = pattern.start[column]; b < pattern.start[column + 1]; b++)
                for (int m = 0; m < 9; m++) {
                    const int32_t r = 3 * pattern.row[b] + m / 3, c = 3 * column + m % 3;
                    const double k = blocks[9 * static_cast<size_t>(b) + static_cast<size_t>(m)];
                    out[r] += k * x[c];
                    if (pattern.row[b] != column) out[c] += k * x[r];
                }
    };
}

// Conjugate gradients: what a step leaves of the error in the energy norm, on average over so many; cycles until a hundredth is left.
struct Convergence {
    double rate;
    int cycles;
};
Convergence converge(const Operator &matrix, const Operator &inverse, std::vector<double> r, int steps)
{
    std::vector<double> z(r.size()), p, ap;
    inverse(r, z);
    p = z;
    double rz = dot(r, z), start = rz;
    Convergence out = {0, 0};
    for (int k = 1; k <= steps; k++) {
        matrix(p, ap);
        double alpha = rz / dot(p, ap);
        for (size_t i = 0; i < r.size(); i++) r[i] -= alpha * ap[i];
        inverse(r, z);
        double next = dot(r, z);
        for (size_t i = 0; i < r.size(); i++) p[i] = z[i] + next / rz * p[i];
        rz = next;
        if (out.cycles == 0 && rz < 1e-4 * start) out.cycles = k;
        out.rate = std::pow(rz / start, 0.5 / k);
    }
    return out;
}

Operator preconditioner_of(pliant_preconditioner *preconditioner)
{
    return [preconditioner](const std::vector<double> &x, std::vector<double> &out) {
        ASSERT_EQ(pliant_preconditioner_solve(preconditioner, 1, x.data(), out.data()), PLIANT_OK);
    };
}

std::vector<double> rest_of(const pliant_system *system) { return {system->mesh->rest, system->mesh->rest + 3 * system->mesh->num_nodes}; }

std::vector<double> load_of(const pliant_system *system, int axis)
{
    std::vector<double> out(3 * static_cast<size_t>(system->num_free));
    for (int32_t f = 0; f < system->num_free; f++) out[3 * f + axis] = system->gravity_mass[9 * f];
    return out;
}

// A contrast of 250.
TEST(Multigrid, ConjugateGradientsConvergeInFewCycles)
{
    Body body(size, box, three, blobs);
    prepare(body, PLIANT_MULTIGRID);
    ASSERT_EQ(body.build(), PLIANT_OK) << pliant_last_error();
    const pliant_system *system = body.model->system;
    Convergence found = converge(matrix_at(system, rest_of(system)), preconditioner_of(body.data->solver->preconditioner), load_of(system, 2), 20);
    std::printf("%d cycles to a hundredth, rate %.3f\n", found.cycles, found.rate);
    EXPECT_LE(found.cycles, 9);
    EXPECT_LT(found.rate, 0.55);
}

// Soft sheets one cell thick, held along one edge, with two cells of air between them, so that they lie across any coarser lattice: they
// bend, and the air follows. (Linear interpolation on a lattice of twice the cells leaves 0.81.)
int fold(int i, int, int) { return i % 6 < 2; }
void prepare_fold(Body &body)
{
    body.scene.solver.preconditioner = PLIANT_MULTIGRID;
    body.scene.mesh.keep_air = true;
    body.cells(8, 8, 8, 2);
    body.fix_plane(0, 0, 0.001, 0, 0, 1);
}
const std::vector<Material> sheet = {{10, 0.3, 1, true}, {4000, 0.45, 950, false}};

TEST(Multigrid, ThinSheetsInAirBend)
{
    Body body(size, box, sheet, fold);
    prepare_fold(body);
    ASSERT_EQ(body.build(), PLIANT_OK) << pliant_last_error();
    const pliant_system *system = body.model->system;
    Convergence found = converge(matrix_at(system, rest_of(system)), preconditioner_of(body.data->solver->preconditioner), load_of(system, 0), 20);
    std::printf("%d cycles to a hundredth, rate %.3f\n", found.cycles, found.rate);
    EXPECT_LT(found.rate, 0.6);
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
        pliant_tool_pose(body.data, tool, tip, nullptr);
        EXPECT_GE(pliant_step(body.model, body.data), 0);
    }
    EXPECT_EQ(body.settle(), PLIANT_OK);
    return std::vector<double>(body.data->positions, body.data->positions + 3 * body.model->body->fine.num_nodes);
}

TEST(Multigrid, SameAnswerAsDirect)
{
    Body direct(size, box, three, blobs), layered(size, box, three, blobs);
    prepare(direct, PLIANT_DIRECT);
    prepare(layered, PLIANT_MULTIGRID);
    layered.scene.solver.tolerance = direct.scene.solver.tolerance = 1e-6;
    layered.scene.solver.refresh_interval = direct.scene.solver.refresh_interval = 4;
    std::vector<double> a = pulled(direct), b = pulled(layered);
    double worst = 0;
    for (size_t n = 0; n < a.size(); n++) worst = std::fmax(worst, std::fabs(a[n] - b[n]));
    EXPECT_LT(worst, 1e-6); // of a pull of 26 mm, both solved to 1e-6
    EXPECT_GT(layered.data->statistics.factors, 0u);
}

TEST(Multigrid, SameBitsWithAnyNumberOfThreads)
{
    std::vector<double> results[2];
    for (int run = 0; run < 2; run++) {
        Body body(size, box, three, blobs);
        prepare(body, PLIANT_MULTIGRID);
        body.scene.solver.threads = run + 1;
        body.scene.solver.iterations = 5;
        body.scene.solver.tolerance = 1e-4;
        results[run] = pulled(body);
    }
    EXPECT_EQ(results[0], results[1]);
}

// more than two levels, as large meshes have
TEST(Multigrid, ManyLevelsConvergeToo)
{
    Body body(size, box, sheet, fold);
    prepare_fold(body);
    ASSERT_EQ(body.build(), PLIANT_OK) << pliant_last_error();
    const pliant_system *system = body.model->system;
    pliant_hierarchy *hierarchy = nullptr;
    pliant_multigrid *multigrid = nullptr;
    ASSERT_EQ(pliant_hierarchy_create(system, 40, &hierarchy), PLIANT_OK);
    EXPECT_GE(hierarchy->num_levels, 4);
    ASSERT_EQ(pliant_multigrid_create(hierarchy, 1, &multigrid), PLIANT_OK);
    std::vector<pliant_tangent> tangents(static_cast<size_t>(system->num_blocks));
    pliant_system_tangents(system, system->mesh->rest, PLIANT_TWIST_EXACT, tangents.data());
    ASSERT_EQ(pliant_multigrid_numeric(multigrid, system->mesh->rest, tangents.data()), PLIANT_OK);
    Operator cycle = [multigrid](const std::vector<double> &x, std::vector<double> &out) {
        ASSERT_EQ(pliant_multigrid_solve(multigrid, x.data(), out.data()), PLIANT_OK);
    };
    Convergence found = converge(matrix_at(system, rest_of(system)), cycle, load_of(system, 1), 20);
    std::printf("%d levels: %d cycles to a hundredth, rate %.3f\n", hierarchy->num_levels, found.cycles, found.rate);
    EXPECT_LT(found.rate, 0.7);
    pliant_multigrid_free(multigrid);
    pliant_hierarchy_free(hierarchy);
}

// Aggregates move as rigid bodies about where nodes are, not where they were at rest.
TEST(Multigrid, ATurnedBodyConvergesAsAtRest)
{
    Body body(size, box, sheet, fold);
    prepare_fold(body);
    ASSERT_EQ(body.build(), PLIANT_OK) << pliant_last_error();
    const pliant_system *system = body.model->system;
    const double turn[9] = {0, -1, 0, 1, 0, 0, 0, 0, 1}, by[3] = {0.1, 0.2, 0.3};
    std::vector<double> turned = affine(*system->mesh, turn, by), load = load_of(system, 1), turned_load = load_of(system, 0);
    for (double &v : turned_load) v = -v;
    pliant_preconditioner *preconditioner = body.data->solver->preconditioner;
    double at_rest = converge(matrix_at(system, rest_of(system)), preconditioner_of(preconditioner), load, 10).rate;
    std::vector<pliant_tangent> tangents(static_cast<size_t>(system->num_blocks));
    pliant_system_tangents(system, turned.data(), PLIANT_TWIST_POSITIVE, tangents.data());
    ASSERT_EQ(pliant_preconditioner_numeric(preconditioner, turned.data(), tangents.data()), PLIANT_OK);
    double after = converge(matrix_at(system, turned), preconditioner_of(preconditioner), turned_load, 10).rate;
    EXPECT_NEAR(after, at_rest, 0.01);
}

// nothing but the matrix and the places of nodes is asked for
TEST(Multigrid, AnyLatticeAndAnOctreeWillDo)
{
    for (bool octree : {false, true}) {
        std::vector<double> positions[2];
        for (int way = 0; way < 2; way++) {
            Body body(size, box, three, blobs);
            body.scene.solver.preconditioner = way == 0 ? PLIANT_DIRECT : PLIANT_MULTIGRID;
            body.scene.solver.tolerance = 1e-7;
            body.scene.model.gravity[0] = 2;
            if (octree) body.scene.mesh.kind = PLIANT_OCTREE;
            if (octree) body.cells(4, 4, 4, 1);
            else body.cells(11, 5, 7, 1);
            body.fix_plane(0, 0, 0.001, 0, 0, 1);
            ASSERT_EQ(body.build(), PLIANT_OK) << pliant_last_error();
            EXPECT_EQ(pliant_preconditioner_refuses(body.data->solver->preconditioner), way == 0);
            ASSERT_EQ(body.settle(), PLIANT_OK);
            positions[way].assign(body.data->positions, body.data->positions + 3 * body.model->body->fine.num_nodes);
        }
        double worst = 0;
        for (size_t n = 0; n < positions[0].size(); n++) worst = std::fmax(worst, std::fabs(positions[0][n] - positions[1][n]));
        EXPECT_LT(worst, 1e-7) << octree;
    }
}

TEST(Multigrid, RunsOutOfMemoryCleanly)
{
    Body body(size, box, three, blobs);
    prepare(body, PLIANT_MULTIGRID);
    body.cells(4, 4, 4, 2);
    ASSERT_EQ(body.build(), PLIANT_OK) << pliant_last_error();
    const pliant_system *system = body.model->system;
    const size_t held = pliant_memory_in_use();
    int failures = 0;
    for (int calls = 0;; calls++) {
        ASSERT_LT(calls, 200);
        pliant_hierarchy *hierarchy = nullptr;
        pliant_multigrid *multigrid = nullptr;
        pliant_memory_fail_after(calls);
        pliant_status status = pliant_hierarchy_create(system, 100, &hierarchy);
        if (status == PLIANT_OK) status = pliant_multigrid_create(hierarchy, 1, &multigrid);
        pliant_memory_fail_after(-1);
        pliant_multigrid_free(multigrid);
        pliant_hierarchy_free(hierarchy);
        ASSERT_EQ(pliant_memory_in_use(), held) << calls;
        if (status == PLIANT_OK) break;
        ASSERT_EQ(status, PLIANT_ERROR_MEMORY) << calls;
        failures++;
    }
    EXPECT_GT(failures, 40);
}

} // namespace
