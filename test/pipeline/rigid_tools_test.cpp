// Rigid tools that grasp one point share its force.
#include "hanging_bar.h"

namespace {

struct Rigid : testing::TestWithParam<Case> {};
std::string name_of(const testing::TestParamInfo<Case> &info) { return info.param.name; }

int hold(Body &body, const char *name, double x)
{
    int tool = -1;
    const double at[3] = {x, 0.02, 0.04};
    EXPECT_EQ(pliant_tool_add(body.model, body.data, name, &tool), PLIANT_OK);
    EXPECT_EQ(pliant_tool_grasp(body.model, body.data, tool, at), PLIANT_OK) << pliant_last_error();
    EXPECT_EQ(pliant_tool_set_drive(body.data, tool, PLIANT_DRIVE_RIGID, nullptr), PLIANT_OK);
    return tool;
}

void move(Body &body, int tool, double by)
{
    const pliant_tool &of = body.data->tools[tool];
    const double tip[3] = {of.tip[0] + by, of.tip[1], of.tip[2]};
    ASSERT_EQ(pliant_tool_set_pose(body.data, tool, tip, nullptr), PLIANT_OK);
}

std::vector<double> positions_of(const Body &body)
{
    return {body.data->positions, body.data->positions + 3 * body.data->body->fine.num_nodes};
}

double farthest(const std::vector<double> &a, const std::vector<double> &b)
{
    double maximum = 0;
    for (size_t i = 0; i < a.size(); i++) maximum = std::fmax(maximum, std::fabs(a[i] - b[i]));
    return maximum;
}

TEST_P(Rigid, ToolsAtOnePointShareItsForce)
{
    std::unique_ptr<Body> one = hang(GetParam());
    const int alone = hold(*one, "alone", 0.02);
    for (int s = 0; s < 10; s++) {
        move(*one, alone, 1e-3);
        step(*one, 1);
    }
    step(*one, 20);
    const pliant_tool &single = one->data->tools[alone];
    const double whole = std::sqrt(single.force[0] * single.force[0] + single.force[1] * single.force[1] +
                                   single.force[2] * single.force[2]);
    ASSERT_GT(whole, 0.01);
    for (double apart : {0.0, 1e-4, 1e-3}) {
        std::unique_ptr<Body> body = hang(GetParam());
        const int tool[2] = {hold(*body, "left", 0.02), hold(*body, "right", 0.02 + apart)};
        for (int s = 0; s < 10; s++) {
            for (int t : tool) move(*body, t, 1e-3);
            step(*body, 1);
        }
        step(*body, 20);
        const double close = 0.01 * whole + 50 * apart * whole; // two points deform the tissue differently than one
        for (int d = 0; d < 3; d++) {
            const double left = body->data->tools[tool[0]].force[d], right = body->data->tools[tool[1]].force[d];
            EXPECT_NEAR(left + right, single.force[d], close) << apart << " m, axis " << d;
            EXPECT_NEAR(left, right, close) << apart << " m, axis " << d;
        }
        EXPECT_LT(farthest(positions_of(*body), positions_of(*one)), 2e-4 + apart) << apart;
    }
}
INSTANTIATE_TEST_SUITE_P(Methods, Rigid,
                         testing::Values(direct, multigrid, plain, averaged, patched, octree, hexahedra, relaxed),
                         name_of);

// If one of two tools releases, the other one takes all of the force without a jump.
TEST(RigidTools, TheOtherToolTakesOver)
{
    for (int first : {0, 1}) {
        std::unique_ptr<Body> body = hang(direct);
        const int tool[2] = {hold(*body, "left", 0.02), hold(*body, "right", 0.02)};
        for (int s = 0; s < 10; s++) {
            for (int t : tool) move(*body, t, 1e-3);
            step(*body, 1);
        }
        step(*body, 20);
        const std::vector<double> before = positions_of(*body);
        const double force = 2 * body->data->tools[tool[0]].force[0];
        pliant_tool_release(body->data, tool[first]);
        step(*body, 20);
        EXPECT_LT(farthest(positions_of(*body), before), 1e-5);
        EXPECT_NEAR(body->data->tools[tool[1 - first]].force[0], force, 1e-3 * std::fabs(force));
    }
}

// The tools move apart: the tissue follows the mean of their displacements, and a copy of the simulation behaves
// equally.
TEST(RigidTools, TheTissueFollowsTheMeanOfTheirMotions)
{
    std::unique_ptr<Body> body = hang(direct);
    const int tool[2] = {hold(*body, "left", 0.02), hold(*body, "right", 0.02)};
    for (int s = 0; s < 10; s++) {
        move(*body, tool[0], 2e-3);
        move(*body, tool[1], -1e-3);
        step(*body, 1);
    }
    pliant_data *copy = nullptr;
    ASSERT_EQ(pliant_data_copy(body->model, body->data, &copy), PLIANT_OK) << pliant_last_error();
    ASSERT_GE(pliant_step(body->model, copy), 0);
    step(*body, 1);
    const std::vector<double> copied(copy->positions, copy->positions + 3 * copy->body->fine.num_nodes);
    EXPECT_LT(farthest(positions_of(*body), copied), 1e-7);
    pliant_data_free(copy);
    step(*body, 20);
    for (int t : tool) EXPECT_NEAR(body->data->tools[t].held_point[0], 0.02 + 0.005, 1e-5);
    for (int d = 0; d < 3; d++) EXPECT_EQ(body->data->tools[tool[0]].force[d], body->data->tools[tool[1]].force[d]);
}

} // namespace
