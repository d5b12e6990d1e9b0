// A recorded step is executed as recorded by a newer library, too. No ROS, no clock.
#include "../pipeline/body.h"
#include "contact/shapes/tool_shape.h"
#include "ros/sim/stepping.h"

#include <algorithm>

namespace {

using pliant_ros::Step;
using pliant_ros::ToolInput;

const int size[3] = {6, 6, 6};
const double box[3] = {0.12, 0.12, 0.12};

// A step with a forceps in the tissue: grasp/kind is auto, and a current node records no closing jaw for it.
Step turn(const pliant_tool_shape &shape, bool closes)
{
    Step step;
    step.iterations = 60; // the jaws crush tissue: with fewer the force of the grasp is not yet known
    step.tolerance = 1e-3;
    step.stiffness = 1000;
    ToolInput tool;
    tool.name = "forceps";
    tool.present = tool.closed = true;
    tool.closes = closes;
    tool.tip[0] = tool.tip[1] = 0.06;
    tool.tip[2] = 0.11;
    tool.rotation[0] = 1;
    pliant_ros::set_shape(shape, &tool);
    step.tools.push_back(tool);
    return step;
}

TEST(Stepping, AClosingJawInARecordingGrasps)
{
    pliant_tool_shape shape;
    ASSERT_EQ(pliant_tool_shape_find("prograsp_forceps", &shape), PLIANT_OK);
    for (bool closes : {true, false}) {
        Body block(size, box, {{4000, 0.45, 1000, false}});
        block.fix_plane(0, 0, 0.041, 0, 0, 1);
        block.cells(6, 6, 6, 1);
        block.scene.solver.threads = 1;
        ASSERT_EQ(block.build(), PLIANT_OK) << pliant_last_error();
        ASSERT_TRUE(pliant_tool_shape_holds(&block.scene, &shape));
        Step step = turn(shape, closes);
        uint32_t max_legs = 0;
        pliant_ros::add_tools(*block.model, block.data, step.tools);
        for (int s = 0; s < 3; s++) {
            const pliant_status status =
                pliant_ros::make_step(*block.model, block.data, PLIANT_BACKGROUND_PLANNED, step);
            ASSERT_GE(status, 0) << pliant_last_error();
            pliant_ros::set_step_outcome(status, *block.data, &step);
            EXPECT_EQ(step.legs, static_cast<uint32_t>(pliant_data_get_statistics(block.data)->legs));
            EXPECT_EQ(step.evaluations, static_cast<uint32_t>(pliant_data_get_statistics(block.data)->iterations));
            max_legs = std::max(max_legs, step.legs);
            step.tools[0].closes = false;
            step.tools[0].tip[2] += 0.002;
        }
        pliant_tool_state state;
        ASSERT_EQ(pliant_tool_get(block.data, 0, &state), PLIANT_OK);
        EXPECT_GE(max_legs, 1u);
        EXPECT_EQ(state.holding, closes);
        EXPECT_EQ(state.force[2] > 0.01, closes) << state.force[2];
    }
}

} // namespace
