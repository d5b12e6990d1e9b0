// Local axes for a preconditioner. They represent the rotation of deformed tissue, so a factor of the body at rest
// solves a strongly bent bar.
#include "body.h"

#include <array>

namespace {

const int size[3] = {24, 8, 8};
const double box[3] = {0.24, 0.08, 0.08};

// about z, then x
std::array<double, 9> rotation(double a, double b)
{
    double c = std::cos(a), s = std::sin(a), d = std::cos(b), t = std::sin(b);
    return {{c, -s, 0, d * s, d * c, -t, t * s, t * c, d}};
}

TEST(Turn, FindsTheRotationWhateverTheStretchBefore)
{
    Body body(size, box, {{5000, 0.45, 1000, false}, {10, 0.3, 1, true}}, [](int, int, int k) { return k >= 6; });
    body.cells(6, 2, 2, 2);
    body.scene.mesh.keep_air = true;
    body.fix_plane(0.001, 0, 0, 1, 0, 0);
    ASSERT_EQ(body.build(), PLIANT_OK) << pliant_last_error();
    const pliant_system *system = body.model->system;
    const double stretch[9] = {1.6, 0.3, 0.1, 0, 0.7, -0.2, 0.1, 0, 1.2}, shift[3] = {0.1, -0.2, 0.3},
                 none[3] = {0, 0, 0};
    const std::array<double, 9> q = rotation(1.1, -0.7);
    std::vector<double> before = affine(body.model->body->fine, stretch, none), now(before.size());
    for (size_t n = 0; n < before.size(); n += 3)
        for (int r = 0; r < 3; r++)
            now[n + r] = q[3 * r] * before[n] + q[3 * r + 1] * before[n + 1] + q[3 * r + 2] * before[n + 2] + shift[r];
    pliant_nodal_rotations *rotations;
    ASSERT_EQ(pliant_nodal_rotations_create(system, &rotations), PLIANT_OK);
    ASSERT_NE(rotations, nullptr);
    pliant_nodal_rotations_refer(system, before.data(), rotations);
    EXPECT_FALSE(rotations->is_rotated);
    pliant_nodal_rotations_update(system, now.data(), rotations);
    int tissue = 0, air = 0;
    for (int32_t f = 0; f < system->num_free; f++) {
        double height = system->mesh->rest[3 * system->node_of_free[f] + 2];
        if (height > 0.055 && height < 0.065) continue; // between the two
        bool empty = height > 0.06;
        (empty ? air : tissue)++;
        double v[3] = {1, 2, 3}, back[3];
        pliant_from_node_axes(rotations, f, v);
        for (int r = 0; r < 3; r++)
            EXPECT_NEAR(v[r], empty ? r + 1 : q[3 * r] + 2 * q[3 * r + 1] + 3 * q[3 * r + 2], 1e-5)
                << "what is empty keeps its axes";
        std::memcpy(back, v, sizeof back);
        pliant_into_node_axes(rotations, f, back);
        for (int r = 0; r < 3; r++) EXPECT_NEAR(back[r], r + 1, 1e-5);
    }
    EXPECT_GT(tissue, 100);
    EXPECT_GT(air, 20);
    pliant_nodal_rotations_free(rotations);
}

// A bar hangs from a wall under its weight, with one step per frame. Return the maximum error of its end for a number
// of evaluations.
double error_of_bending(bool turning, pliant_preconditioner_choice choice)
{
    double worst = 0;
    std::vector<double> right;
    for (bool exact : {true, false}) {
        Body body(size, box, {{40000, 0.3, 1000, false}});
        body.cells(6, 2, 2, 2);
        body.scene.solver.preconditioner = choice;
        body.scene.solver.iterations = exact ? 200 : 4;
        body.scene.solver.tolerance = 1e-10;
        body.scene.solver.refresh_interval = exact ? 5 : 0;
        body.fix_plane(0.001, 0, 0, 1, 0, 0);
        EXPECT_EQ(body.build(), PLIANT_OK) << pliant_last_error();
        if (!turning) {
            pliant_nodal_rotations_free(body.data->solver->rotations);
            body.data->solver->rotations = nullptr;
        }
        std::vector<double> found;
        for (int f = 1; f <= 20; f++) {
            const double gravity[3] = {0, 0, -9.81 * f / 20};
            EXPECT_EQ(pliant_data_set_gravity(body.data, gravity), PLIANT_OK);
            if (exact) EXPECT_EQ(body.settle(), PLIANT_OK);
            else EXPECT_GE(pliant_step(body.model, body.data), 0);
            found.insert(found.end(), body.data->positions,
                         body.data->positions + 3 * body.model->body->fine.num_nodes);
        }
        for (size_t n = 0; !exact && n < found.size(); n++) worst = std::fmax(worst, std::fabs(found[n] - right[n]));
        right = found;
    }
    return worst;
}

TEST(Turn, TheFactorAtRestSolvesTheRotatedBody)
{
    for (pliant_preconditioner_choice choice : {PLIANT_DIRECT, PLIANT_MULTIGRID}) {
        double with = error_of_bending(true, choice), without = error_of_bending(false, choice);
        std::printf("multigrid %d: error with turning axes %.3g mm, without %.3g mm\n", choice == PLIANT_MULTIGRID,
                    1e3 * with, 1e3 * without);
        EXPECT_LT(with, 0.3 * without);
        EXPECT_LT(with, 1e-3);
    }
}

// A spring's response rotates with the axes while its tool pulls by a given force; then it is a spring again.
TEST(Turn, AReturningSpringIsFoundInThePresentAxes)
{
    Body body(size, box, {{40000, 0.3, 1000, false}});
    body.cells(6, 2, 2, 2);
    body.scene.solver.refresh_interval = 0;
    body.scene.solver.iterations = 20;
    body.fix_plane(0.001, 0, 0, 1, 0, 0);
    ASSERT_EQ(body.build(), PLIANT_OK) << pliant_last_error();
    int tool;
    const double end[3] = {0.23, 0.04, 0.04}, none[3] = {0, 0, 0}, down[3] = {0, 0, -9.81};
    ASSERT_EQ(pliant_tool_add(body.model, body.data, "t", &tool), PLIANT_OK);
    ASSERT_EQ(pliant_tool_set_pose(body.data, tool, end, nullptr), PLIANT_OK);
    ASSERT_EQ(pliant_tool_grasp(body.model, body.data, tool, end), PLIANT_OK) << pliant_last_error();
    ASSERT_GE(pliant_step(body.model, body.data), 0);
    ASSERT_EQ(pliant_tool_set_drive(body.data, tool, PLIANT_DRIVE_FORCE, none), PLIANT_OK);
    ASSERT_EQ(pliant_data_set_gravity(body.data, down), PLIANT_OK);
    for (int s = 0; s < 30; s++) ASSERT_GE(pliant_step(body.model, body.data), 0);
    ASSERT_EQ(pliant_tool_set_drive(body.data, tool, PLIANT_DRIVE_SPRING, none), PLIANT_OK);
    ASSERT_GE(pliant_step(body.model, body.data), 0);
    pliant_solver *solver = body.data->solver;
    const pliant_grasp_constraint *handle = solver->grasps + tool;
    const size_t n = 3 * static_cast<size_t>(body.model->system->num_free);
    std::vector<double> right(n), response(n);
    for (int d = 0; d < 3; d++) {
        const double unit[3] = {d == 0 ? 1. : 0, d == 1 ? 1. : 0, d == 2 ? 1. : 0};
        std::fill(right.begin(), right.end(), 0);
        pliant_grasp_add_pull(handle, unit, right.data());
        ASSERT_EQ(pliant_preconditioner_solve(solver->preconditioner, 1, right.data(), response.data()), PLIANT_OK);
        const double maximum = largest(response);
        for (size_t i = 0; i < n; i++) response[i] -= handle->response[n * d + i];
        EXPECT_LT(largest(response), 1e-9 * maximum);
    }
}

} // namespace
