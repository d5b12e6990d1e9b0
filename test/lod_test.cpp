// Tests of localized orthogonal decomposition: its matrix, its error by the reach of the shape functions, and its
// limits.
#include "algebra.h"
#include "base/memory.h"
#include "pipeline/body.h"

#include <algorithm>
#include <string>

namespace {

const int size[3] = {24, 24, 24};
const double box[3] = {0.12, 0.12, 0.12};
const std::vector<Material> three = {{4000, 0.45, 950, false}, {30000, 0.4, 1060, false}, {300000, 0.3, 1100, false}};

int patches(int i, int j, int k) { return (i / 4 * 7 + j / 4 * 5 + k / 4 * 3) % 3; }

pliant_element_kind kind_of_bodies = PLIANT_LINEAR;

struct EveryKind : ::testing::TestWithParam<pliant_element_kind> {
    void SetUp() override { kind_of_bodies = GetParam(); }
    void TearDown() override { kind_of_bodies = PLIANT_LINEAR; }
};
INSTANTIATE_TEST_SUITE_P(Kinds, EveryKind, testing::Values(PLIANT_LINEAR, PLIANT_HEXAHEDRA));

void prepare(Body &body, pliant_method method, int cells, int ratio, int layers)
{
    body.scene.element.kind = kind_of_bodies;
    body.scene.model.method = method;
    body.scene.model.lod_layers = layers;
    body.cells(cells, cells, cells, ratio);
    body.fix_plane(0, 0, 0, 0, 0, 1);
}

// Fix a block between the coarse nodes.
void fix_inclusion(Body &body)
{
    body.scene.fixed.boxes[body.scene.fixed.num_boxes++] = {{0.013, 0.033, 0.053}, {0.047, 0.067, 0.087}};
}

std::vector<double> shaken(const pliant_mesh &mesh, double by)
{
    std::vector<double> x(mesh.rest, mesh.rest + 3 * mesh.num_nodes);
    for (size_t i = 0; i < x.size(); i++) x[i] += by * std::sin(12.9898 * static_cast<double>(i));
    return x;
}

double max_distance(const std::vector<double> &a, const std::vector<double> &b)
{
    double squares = 0;
    for (size_t i = 0; i < a.size(); i++) squares += (a[i] - b[i]) * (a[i] - b[i]);
    return std::sqrt(squares);
}

// At ratio 1, no correction is needed. The macro-elements are the cubes, of five tetrahedra or one hexahedron, up to
// single precision.
TEST_P(EveryKind, OfRatioOneIsTheFineMesh)
{
    Body fine(size, box, three, patches), lod(size, box, three, patches);
    prepare(fine, PLIANT_FINE, 4, 1, 1);
    prepare(lod, PLIANT_LOD, 4, 1, 1);
    ASSERT_EQ(fine.build(), PLIANT_OK) << pliant_last_error();
    ASSERT_EQ(lod.build(), PLIANT_OK) << pliant_last_error();
    std::vector<double> x = shaken(fine.model->body->fine, 1e-8), expected = fine.elastic_force(x),
                        found = lod.elastic_force(x);
    std::vector<double> none(expected.size());
    EXPECT_LT(max_distance(expected, found), 1e-6 * max_distance(expected, none));
}

// The assembled matrix is the derivative of the gathered forces at rest, also with a fixed block between the coarse
// nodes.
TEST_P(EveryKind, MatrixIsTheDerivativeOfTheForce)
{
    Body body(size, box, three, patches);
    prepare(body, PLIANT_LOD, 3, 2, 1);
    fix_inclusion(body);
    ASSERT_EQ(body.build(), PLIANT_OK) << pliant_last_error();
    const pliant_system *system = body.model->system;
    const pliant_mesh &mesh = *system->mesh;
    int grounded = 0, held = 0;
    for (int32_t c = 0; c < system->macros->count; c++) grounded += system->macros->grounded[c];
    for (int32_t c = 0; c < system->macros->start[system->macros->count]; c++) held += system->macros->held[c];
    EXPECT_GT(grounded, 0);
    EXPECT_LT(grounded, system->macros->count);
    EXPECT_GT(held, 0);
    const pliant_pattern &pattern = system->pattern;
    std::vector<pliant_tangent> tangents(static_cast<size_t>(system->num_blocks));
    std::vector<double> values(pattern.num_values);
    pliant_system_tangents(system, mesh.rest, PLIANT_TWIST_EXACT, tangents.data());
    pliant_system_assemble(system, tangents.data(), values.data());
    int n = 3 * system->num_free;
    Eigen::MatrixXd matrix = Eigen::MatrixXd::Zero(n, n), difference(n, n);
    int64_t at = 0;
    for (int32_t column = 0; column < pattern.num_columns; column++)
        for (int c = 0; c < 3; c++)
            for (int32_t block = pattern.start[column]; block < pattern.start[column + 1]; block++)
                for (int r = 0; r < 3; r++) {
                    int row = 3 * pattern.row[block] + r, col = 3 * column + c;
                    if (row >= col) matrix(row, col) = matrix(col, row) = values[at++];
                }
    ASSERT_EQ(at, pattern.num_values);
    const double h = 1e-5 * mesh.cell_size[0];
    for (int c = 0; c < n; c++) {
        std::vector<double> forward(mesh.rest, mesh.rest + 3 * mesh.num_nodes), back = forward;
        forward[3 * system->node_of_free[c / 3] + c % 3] += h;
        back[3 * system->node_of_free[c / 3] + c % 3] -= h;
        std::vector<double> f = body.elastic_force(forward), g = body.elastic_force(back);
        for (int r = 0; r < n; r++) {
            int32_t i = 3 * system->node_of_free[r / 3] + r % 3;
            difference(r, c) = (f[i] - g[i]) / (2 * h);
        }
    }
    EXPECT_LT((matrix - difference).norm(), 1e-6 * matrix.norm());
    EXPECT_GT(algebra::eigenvalues(matrix)[0], 0);
    double sum = 0;
    for (int c = 0; c < n; c++) sum += matrix(c, c) / n;
    EXPECT_NEAR(system->mean_diagonal, sum, 1e-9 * sum);
}

// A block of three coarse cubes along each axis, with one fine cube of tissue in a fourth cube, in a strained state.
struct StrainedBlock {
    Body body{size, box, {{4000, 0.45, 950, false}, {1, 0, 1, true}},
              [](int i, int j, int k) {
                  const bool is_inside = i < 18 && j < 18 && k < 18,
                             protrudes = i >= 18 && i < 21 && j < 3 && k >= 15 && k < 18;
                  return is_inside || protrudes ? 0 : 1;
              }};
    std::vector<double> x;
    void build()
    {
        prepare(body, PLIANT_LOD, 4, 2, 1);
        ASSERT_EQ(body.build(), PLIANT_OK) << pliant_last_error();
        const pliant_mesh &mesh = *body.model->system->mesh;
        x.assign(mesh.rest, mesh.rest + 3 * mesh.num_nodes);
        for (int32_t f = 0; f < 3 * body.model->system->num_free; f++)
            x[3 * body.model->system->node_of_free[f / 3] + f % 3] += 0.004 * std::sin(1.7 * f);
    }
};

std::vector<double> upsampled(const pliant_system *system, const std::vector<double> &x)
{
    std::vector<double> out(3 * static_cast<size_t>(system->fine->num_nodes));
    pliant_upsample_positions(system, x.data(), out.data());
    return out;
}

// The weights of a fine node are the derivative of its position. They contain the rotation of its cube, and leave out
// blocks of N below 1e-4.
TEST_P(EveryKind, WeightsAreTheDerivativeOfThePosition)
{
    StrainedBlock block;
    block.build();
    const pliant_system *system = block.body.model->system;
    const double h = 2e-5, one = 1;
    std::vector<double> forward = block.x, back = block.x, direction(3 * static_cast<size_t>(system->num_free));
    for (size_t f = 0; f < direction.size(); f++) {
        direction[f] = std::sin(0.7 * static_cast<double>(f));
        forward[3 * system->node_of_free[f / 3] + f % 3] += h * direction[f];
        back[3 * system->node_of_free[f / 3] + f % 3] -= h * direction[f];
    }
    const std::vector<double> to = upsampled(system, forward), from = upsampled(system, back);
    for (int32_t n = 0; n < system->fine->num_nodes; n++) {
        std::vector<double> weights(9 * static_cast<size_t>(system->num_free));
        pliant_weight_blocks blocks = {weights.data(), nullptr, nullptr, 0};
        pliant_upsample_weights(system, block.x.data(), 1, &n, &one, &blocks);
        for (size_t d = 0; d < 3; d++) {
            double moved = 0;
            for (size_t f = 0; f < direction.size(); f++) moved += weights[9 * (f / 3) + 3 * d + f % 3] * direction[f];
            EXPECT_NEAR(moved, (to[3 * n + d] - from[3 * n + d]) / (2 * h), 1e-4) << n;
        }
    }
}

// The tissue of a cube determines the cube's rotation, and linear motions are exact. Nodes that move little tissue have
// little influence.
TEST_P(EveryKind, RotationIsOfTheTissue)
{
    StrainedBlock block;
    block.build();
    const pliant_macros *macros = block.body.model->system->macros;
    const pliant_mesh &coarse = *block.body.model->system->mesh;
    double smallest = INFINITY;
    for (int32_t cube = 0; cube < macros->count; cube++) {
        Eigen::Matrix3d of_rest = Eigen::Matrix3d::Zero();
        Eigen::Vector3d sum = Eigen::Vector3d::Zero();
        for (int v = 0; v < 8; v++) {
            const int32_t node = macros->own[8 * cube + v];
            const Eigen::Vector3d g(macros->gradient + 24 * cube + 3 * v);
            if (node < 0) continue;
            of_rest += Eigen::Vector3d(coarse.rest + 3 * node) * g.transpose();
            sum += g;
            smallest = std::min(smallest, g.norm() * coarse.cell_size[0]);
        }
        EXPECT_LT((of_rest - Eigen::Matrix3d::Identity()).norm(), 1e-9);
        EXPECT_LT(sum.norm() * coarse.cell_size[0], 1e-9);
    }
    // all nodes of a full cube have sqrt(3) / 4
    if (kind_of_bodies == PLIANT_HEXAHEDRA) EXPECT_LT(smallest, 0.15);
}

// Without nearby fixed nodes, a rigid rotation of any angle causes no force, and the fine nodes rotate with the body.
TEST_P(EveryKind, TurnsFreely)
{
    Body body(size, box, three, patches);
    prepare(body, PLIANT_LOD, 4, 2, 1);
    ASSERT_EQ(body.build(), PLIANT_OK) << pliant_last_error();
    Eigen::Matrix<double, 3, 3, Eigen::RowMajor> turn = algebra::rotation(3.1, {2, -1, 1});
    const double b[3] = {5, -3, 2}, stretch[9] = {1.01, 0, 0, 0, 1, 0, 0, 0, 1};
    const pliant_mesh &fine = body.model->body->fine;
    std::vector<double> coarse = affine(*body.model->system->mesh, turn.data(), b),
                        expected = affine(fine, turn.data(), b);
    std::vector<double> up(3 * fine.num_nodes);
    EXPECT_LT(largest(body.elastic_force(coarse)),
              1e-9 * largest(body.elastic_force(affine(*body.model->system->mesh, stretch, b))));
    pliant_upsample_positions(body.model->system, coarse.data(), up.data());
    for (int32_t n = 0; n < 3 * fine.num_nodes; n++)
        if (!body.model->body->fine_fixed[n / 3]) ASSERT_NEAR(up[n], expected[n], 1e-9);
}

std::vector<double> under_gravity(Body &body)
{
    body.scene.model.gravity[0] = 0.2;
    body.scene.model.gravity[2] = -0.5;
    EXPECT_EQ(body.build(), PLIANT_OK) << pliant_last_error();
    EXPECT_EQ(body.settle(), PLIANT_OK);
    return {body.data->positions, body.data->positions + 3 * body.model->body->fine.num_nodes};
}

// Return the rms error against the fine mesh, divided by its rms displacement.
double gravity_error(pliant_method method, int layers, const std::vector<double> &fine)
{
    Body body(size, box, three, patches);
    prepare(body, method, 4, 2, layers);
    fix_inclusion(body);
    std::vector<double> found = under_gravity(body),
                        rest(body.model->body->fine.rest, body.model->body->fine.rest + fine.size());
    return max_distance(found, fine) / max_distance(rest, fine);
}

// The averages are weighted by mass, so gravity does no work on the part that the shape functions leave out. The only
// error comes from the limited reach: the tails of the shape functions decay exponentially. A fixed inclusion is harder
// than a fixed plane.
TEST_P(EveryKind, ErrorFallsWithTheReach)
{
    Body fine(size, box, three, patches);
    prepare(fine, PLIANT_FINE, 4, 2, 1);
    fix_inclusion(fine);
    std::vector<double> exact = under_gravity(fine);
    double coarse = gravity_error(PLIANT_COARSE, 1, exact), averaged = gravity_error(PLIANT_AVERAGED, 1, exact);
    double one = gravity_error(PLIANT_LOD, 1, exact), two = gravity_error(PLIANT_LOD, 2, exact);
    std::printf("coarse %.1f %%, averaged %.1f %%, lod %.2f %%, %.2f %% with 1, 2 layers\n", 100 * coarse,
                100 * averaged, 100 * one, 100 * two);
    EXPECT_LT(one, 0.25 * coarse);
    EXPECT_LT(one, 0.5 * averaged);
    EXPECT_LT(two, 0.3 * one);
}

// Homogeneous material under constant strain needs no correction. The corrections of the cubes around a node cancel,
// except for their tails. The test uses the middle node, because no shape function there reaches the boundary.
TEST_P(EveryKind, PatchTestHoldsUpToTheTails)
{
    Body body(size, box, {{5000, 0.4, 1000, false}});
    prepare(body, PLIANT_LOD, 6, 2, 1);
    ASSERT_EQ(body.build(), PLIANT_OK) << pliant_last_error();
    const pliant_mesh &mesh = *body.model->system->mesh;
    const double a[9] = {1.1, 0.03, -0.02, 0.03, 0.93, 0.05, -0.02, 0.05, 1.04}, b[3] = {0.01, 0.02, -0.01};
    std::vector<double> force = body.elastic_force(affine(mesh, a, b));
    int32_t middle = mesh.node_of_lattice[3 + 7 * (3 + 7 * 3)];
    double inside =
        std::hypot(std::hypot(force[3 * middle], force[3 * middle + 1]), force[3 * middle + 2]) / largest(force);
    std::printf("patch test: %.3f %% of the largest force\n", 100 * inside);
    EXPECT_LT(inside, 0.01);
}

TEST(Lod, RefusesBeyondItsLimits)
{
    Body body(size, box, three, patches);
    body.scene.solver.threads = 1;
    prepare(body, PLIANT_LOD, 8, 4, 3);
    size_t before = pliant_memory_in_use();
    ASSERT_EQ(body.build(), PLIANT_ERROR_SCENE);
    const std::string message = pliant_last_error();
    EXPECT_NE(message.find("more than 300 s or 4096 MiB; model/lod_layers 2 would fit"), std::string::npos) << message;
    prepare(body, PLIANT_LOD, 4, 3, 2);
    body.scene.solver.preconditioner = PLIANT_MULTIGRID;
    ASSERT_EQ(body.build(), PLIANT_ERROR_SCENE);
    body.scene.solver.preconditioner = PLIANT_PRECONDITIONER_AUTO;
    body.scene.mesh.bone_surface = true;
    ASSERT_EQ(body.build(), PLIANT_ERROR_SCENE);
    EXPECT_EQ(pliant_memory_in_use(), before);
}

// The log states the estimated memory; the limit acts on this estimate.
TEST(Lod, UsesAtMostTwiceTheEstimatedMemory)
{
    Body body(size, box, three, patches);
    prepare(body, PLIANT_LOD, 4, 3, 1);
    double mib = 0;
    pliant_set_log([](pliant_log_level, const char *message, void *user) {
        std::sscanf(message, "lod: preparing %*d cubes, about %*f s and %lf MiB", static_cast<double *>(user));
    }, &mib);
    pliant_memory_reset_peak();
    size_t before = pliant_memory_in_use();
    EXPECT_EQ(body.build(), PLIANT_OK) << pliant_last_error();
    pliant_set_log(nullptr, nullptr);
    EXPECT_GT(mib, 0);
    EXPECT_LT(static_cast<double>(pliant_memory_peak() - before), 2 * mib * 1048576.0);
}

bool seven_times(double, const char *stage, void *user)
{
    int *calls = static_cast<int *>(user);
    if (std::string(stage) == "homogenize") ++*calls;
    return *calls < 7;
}

TEST(Lod, IsCancelled)
{
    Body body(size, box, three, patches);
    prepare(body, PLIANT_LOD, 4, 2, 1);
    int calls = 0;
    pliant_model *model = nullptr;
    EXPECT_EQ(pliant_model_build(&body.scene, &body.scan, nullptr, &body.table, {seven_times, &calls}, &model),
              PLIANT_ERROR_CANCELLED);
    EXPECT_GE(calls, 7);
    EXPECT_LT(calls, 16); // threads finish the work that they have begun
    EXPECT_EQ(model, nullptr);
}

TEST_P(EveryKind, FailingAllocationsNeverLeak)
{
    Body body(size, box, three, patches);
    prepare(body, PLIANT_LOD, 2, 2, 1);
    body.scene.solver.threads = 1;
    fix_inclusion(body);
    size_t before = pliant_memory_in_use();
    int failures = 0;
    for (int n = 0;; n += 1 + n / 60) {
        pliant_model *model = nullptr;
        pliant_memory_fail_after(n);
        pliant_status status =
            pliant_model_build(&body.scene, &body.scan, nullptr, &body.table, {nullptr, nullptr}, &model);
        pliant_memory_fail_after(-1);
        pliant_model_free(model);
        ASSERT_EQ(pliant_memory_in_use(), before) << "allocation " << n;
        if (status >= 0) break;
        ASSERT_EQ(status, PLIANT_ERROR_MEMORY) << "allocation " << n << ": " << pliant_last_error();
        failures++;
        ASSERT_LT(n, 20000);
    }
    EXPECT_GT(failures, 80);
}

} // namespace
