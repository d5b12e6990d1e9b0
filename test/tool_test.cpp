// Tools: what they are called, what they find where they take hold, and what is said about it.
#include "pipeline/body.h"

#include "state/data.h"
#include "pliant/memory.h"
#include "pliant/session.h"

#include <string>

namespace {

const int size[3] = {6, 6, 6};
const double box[3] = {0.12, 0.12, 0.12};

struct Tool : testing::Test {
    Body body{size, box, {{4000, 0.45, 1000, false}}};
    static std::string said;
    int tool = -1;

    void SetUp() override
    {
        body.fix_plane(0, 0, 0.041, 0, 0, 1);
        body.cells(6, 6, 6, 1);
        ASSERT_EQ(body.build(), PLIANT_OK) << pliant_last_error();
        said.clear();
        pliant_set_log([](pliant_log_level level, const char *message, void *) { if (level == PLIANT_LOG_WARNING) said = message; }, nullptr);
    }
    void TearDown() override { pliant_set_log(nullptr, nullptr); }
    pliant_status grasp(double x, double y, double z)
    {
        const double rest[3] = {x, y, z};
        return pliant_tool_grasp(body.model, body.data, tool, rest);
    }
};
std::string Tool::said;

TEST_F(Tool, ANameThatIsTooLongIsRefusedAndNotAddedAgain)
{
    const std::string longest(47, 'n'), longer(48, 'n');
    int first = -1, again = -1;
    ASSERT_EQ(pliant_tool_add(body.model, body.data, longest.c_str(), &first), PLIANT_OK);
    ASSERT_EQ(pliant_tool_add(body.model, body.data, longest.c_str(), &again), PLIANT_OK);
    EXPECT_EQ(first, again);
    EXPECT_EQ(pliant_tool_add(body.model, body.data, longer.c_str(), &again), PLIANT_ERROR_ARGUMENT);
    EXPECT_NE(std::string(pliant_last_error()).find("48 characters, at most 47"), std::string::npos) << pliant_last_error();
    EXPECT_EQ(body.data->num_tools, 1);
}

TEST_F(Tool, GraspingWhatIsFixedSaysSo)
{
    ASSERT_EQ(pliant_tool_add(body.model, body.data, "hook", &tool), PLIANT_OK);
    ASSERT_EQ(grasp(0.05, 0.06, 0.09), PLIANT_OK) << pliant_last_error();
    EXPECT_EQ(said, "");
    ASSERT_EQ(grasp(0.05, 0.06, 0.02), PLIANT_OK) << pliant_last_error();
    EXPECT_NE(said.find("tool hook holds nothing but what is fixed"), std::string::npos) << said;
    EXPECT_NE(said.find("(0.0500 0.0600 0.0200) m"), std::string::npos) << said;
    body.data->tools[tool].radius = 0;
    ASSERT_EQ(grasp(0.05, 0.06, 0.05), PLIANT_OK) << pliant_last_error();
    EXPECT_NE(said.find("tool hook holds to 50 % what is fixed"), std::string::npos) << said;
}

TEST_F(Tool, WhereThereIsNoTissueItSaysWhereThereIs)
{
    ASSERT_EQ(pliant_tool_add(body.model, body.data, "hook", &tool), PLIANT_OK);
    EXPECT_EQ(grasp(0.2, 0.06, 0.02), PLIANT_ERROR_ARGUMENT);
    std::string message = pliant_last_error();
    EXPECT_NE(message.find("tool hook: there is no tissue at (0.2000 0.0600 0.0200) m"), std::string::npos) << message;
    EXPECT_NE(message.find("between (0.0000 0.0000 0.0000) and (0.1200 0.1200 0.1200) m"), std::string::npos) << message;
    EXPECT_EQ(message.find("millimetres"), std::string::npos) << message;
    EXPECT_EQ(grasp(50, 60, 90), PLIANT_ERROR_ARGUMENT);
    EXPECT_NE(std::string(pliant_last_error()).find("seems to be in millimetres"), std::string::npos) << pliant_last_error();
    const double tip[3] = {50, 60, 90};
    ASSERT_EQ(pliant_tool_set_pose(body.data, tool, tip, nullptr), PLIANT_OK);
    EXPECT_EQ(pliant_tool_grasp(body.model, body.data, tool, nullptr), PLIANT_ERROR_ARGUMENT);
    EXPECT_NE(std::string(pliant_last_error()).find("seems to be in millimetres"), std::string::npos) << pliant_last_error();
    EXPECT_FALSE(body.data->tools[tool].holding);
}

TEST_F(Tool, ALoadBeyondDoublePrecisionNamesWhatMayBeWrong)
{
    ASSERT_EQ(pliant_tool_add(body.model, body.data, "hook", &tool), PLIANT_OK);
    ASSERT_EQ(grasp(0.05, 0.06, 0.09), PLIANT_OK) << pliant_last_error();
    const double force[3] = {0, 0, 1e200};
    ASSERT_EQ(pliant_tool_set_drive(body.data, tool, PLIANT_DRIVE_FORCE, force), PLIANT_OK);
    EXPECT_EQ(pliant_step(body.model, body.data), PLIANT_ERROR_NUMERIC);
    const std::string message = pliant_last_error();
    for (const char *word : {"model/gravity", "material table", "grasp/stiffness", "forces"}) EXPECT_NE(message.find(word), std::string::npos) << message;
}

// A point on the surface is held by the tissue below it, above which there are cells of air, and also where single precision of a scan's
// header has moved the surface by a ten millionth.
TEST(ToolOnAFace, APointIsHeldOnEverySide)
{
    const int voxels[3] = {20, 20, 20};
    const double room[3] = {0.1, 0.1, 0.1};
    Body air(voxels, room, {{4000, 0.45, 1000, false}, {1, 0.3, 1, true}}, [](int i, int j, int k) {
        return i >= 4 && i < 16 && j >= 4 && j < 16 && k >= 4 && k < 16 ? 0 : 1;
    });
    air.cells(10, 10, 10, 1);
    air.fix_plane(0, 0, 0.02, 0, 0, 1);
    air.scene.grasp.radius = 0;
    ASSERT_EQ(air.build(), PLIANT_OK) << pliant_last_error();
    int index;
    ASSERT_EQ(pliant_tool_add(air.model, air.data, "point", &index), PLIANT_OK);
    for (int axis = 0; axis < 3; axis++)
        for (int side = 0; side < 2; side++)
            for (double off : {-2e-9, 0.0, 2e-9}) {
                double at[3] = {0.043, 0.047, 0.053};
                at[axis] = (side ? 0.08 : 0.02) + off;
                EXPECT_EQ(pliant_tool_grasp(air.model, air.data, index, at), PLIANT_OK) << axis << side << off << pliant_last_error();
                for (int d = 0; d < 3; d++) EXPECT_NEAR(air.data->tools[index].held_point[d], at[d], 1e-8);
            }
    const double off[3] = {0.043, 0.047, 0.0801};
    EXPECT_EQ(pliant_tool_grasp(air.model, air.data, index, off), PLIANT_ERROR_ARGUMENT);
}

// stiff tissue: what a grip by a spring takes is bounded in every step, quasi-static or not, and it ends where the tissue has slipped out
TEST(Slip, AGripGivesWayAtItsForceAndIsLostOnceItHasSlippedOut)
{
    for (pliant_solver_kind kind : {PLIANT_COROTATIONAL, PLIANT_TLED}) {
        Body stiff(size, box, {{40000, 0.45, 1000, false}});
        stiff.fix_plane(0, 0, 0.041, 0, 0, 1);
        stiff.cells(6, 6, 6, 1);
        stiff.scene.solver.kind = kind;
        stiff.scene.solver.step = 0.005;
        stiff.scene.grasp.slip = 0.5;
        ASSERT_EQ(stiff.build(), PLIANT_OK) << pliant_last_error();
        int tool = -1;
        const double held[3] = {0.06, 0.06, 0.11};
        ASSERT_EQ(pliant_tool_add(stiff.model, stiff.data, "forceps", &tool), PLIANT_OK);
        ASSERT_EQ(pliant_tool_grasp(stiff.model, stiff.data, tool, held), PLIANT_OK);
        pliant_tool_state state;
        double most = 0;
        int steps = 0;
        for (bool holding = true; holding && steps < 200; ++steps) {
            const double tip[3] = {0.06, 0.06, 0.11 + 0.0005 * steps};
            ASSERT_EQ(pliant_tool_set_pose(stiff.data, tool, tip, nullptr), PLIANT_OK);
            ASSERT_GE(pliant_step(stiff.model, stiff.data), 0) << pliant_last_error();
            ASSERT_EQ(pliant_tool_get(stiff.data, tool, &state), PLIANT_OK);
            most = std::max(most, std::fabs(state.force[2]));
            holding = state.holding;
        }
        EXPECT_LT(most, 0.55); // the held point springs back a little within a step
        EXPECT_GT(most, 0.3);
        EXPECT_GT(steps, 20); // 12 mm, the blob's width, in half millimetres
        EXPECT_LT(steps, 60);
        EXPECT_EQ(state.force[2], 0);

        ASSERT_EQ(pliant_tool_grasp(stiff.model, stiff.data, tool, held), PLIANT_OK);
        const double far[3] = {0.36, 0.06, 0.11}; // one that teleports
        ASSERT_EQ(pliant_tool_set_pose(stiff.data, tool, far, nullptr), PLIANT_OK);
        ASSERT_GE(pliant_step(stiff.model, stiff.data), 0);
        ASSERT_EQ(pliant_tool_get(stiff.data, tool, &state), PLIANT_OK);
        EXPECT_FALSE(state.holding);
        EXPECT_EQ(state.force[0], 0);
    }
}

// what a process that goes on for another one needs: the same hold on the same tissue pulls it to the same place
TEST(Hold, ToldAndTakenAgainPullsAsBefore)
{
    Body first(size, box, {{4000, 0.45, 1000, false}}), second(size, box, {{4000, 0.45, 1000, false}});
    const double tip[3] = {0.062, 0.059, 0.111}, pulled[3] = {0.07, 0.06, 0.125};
    pliant_tool_hold hold;
    int tool = -1;
    for (Body *body : {&first, &second}) {
        body->fix_plane(0, 0, 0.041, 0, 0, 1);
        body->cells(6, 6, 6, 1);
        ASSERT_EQ(body->build(), PLIANT_OK) << pliant_last_error();
        ASSERT_EQ(pliant_tool_add(body->model, body->data, "forceps", &tool), PLIANT_OK);
    }
    ASSERT_EQ(pliant_tool_get_hold(first.data, tool, &hold), PLIANT_OK);
    EXPECT_FALSE(hold.holding);
    ASSERT_EQ(pliant_tool_set_pose(first.data, tool, tip, nullptr), PLIANT_OK);
    ASSERT_EQ(pliant_tool_grasp(first.model, first.data, tool, nullptr), PLIANT_OK);
    ASSERT_EQ(pliant_tool_set_pose(first.data, tool, pulled, nullptr), PLIANT_OK);
    for (int s = 0; s < 20; ++s) ASSERT_GE(pliant_step(first.model, first.data), 0);
    ASSERT_EQ(pliant_tool_get_hold(first.data, tool, &hold), PLIANT_OK);
    EXPECT_TRUE(hold.holding);

    EXPECT_EQ(pliant_tool_set_hold(second.model, second.data, tool, &hold), PLIANT_ERROR_ARGUMENT); // no pose
    ASSERT_EQ(pliant_tool_set_pose(second.data, tool, pulled, nullptr), PLIANT_OK);
    pliant_tool_hold wrong = hold;
    wrong.grip[1] = NAN;
    EXPECT_EQ(pliant_tool_set_hold(second.model, second.data, tool, &wrong), PLIANT_ERROR_ARGUMENT);
    ASSERT_EQ(pliant_data_set_positions(second.model, second.data, pliant_data_get_positions(first.data, nullptr)), PLIANT_OK);
    ASSERT_EQ(pliant_tool_set_hold(second.model, second.data, tool, &hold), PLIANT_OK) << pliant_last_error();
    for (int s = 0; s < 20; ++s) ASSERT_GE(pliant_step(second.model, second.data), 0);
    pliant_tool_state a, b;
    pliant_tool_get(first.data, tool, &a);
    pliant_tool_get(second.data, tool, &b);
    EXPECT_GT(std::fabs(a.force[2]), 0.01);
    for (int d = 0; d < 3; d++) {
        EXPECT_NEAR(b.force[d], a.force[d], 1e-3 * std::fabs(a.force[2]));
        EXPECT_NEAR(b.held_point[d], a.held_point[d], 1e-6);
    }
    hold.holding = false;
    ASSERT_EQ(pliant_tool_set_hold(second.model, second.data, tool, &hold), PLIANT_OK);
    pliant_tool_get(second.data, tool, &b);
    EXPECT_FALSE(b.holding);
}

} // namespace
