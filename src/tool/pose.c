#include "tool/pose.h"

#include <string.h>

pliant_tool_pose pliant_tool_measured(const pliant_tool *tool)
{
    pliant_tool_pose pose = {.jaw = tool->jaw};
    memcpy(pose.tip, tool->tip, sizeof pose.tip);
    memcpy(pose.rotation, tool->rotation, sizeof pose.rotation);
    return pose;
}

pliant_tool_pose pliant_tool_proxy(const pliant_tool *tool)
{
    pliant_tool_pose pose = {.jaw = tool->proxy.jaw};
    memcpy(pose.tip, tool->proxy.tip, sizeof pose.tip);
    memcpy(pose.rotation, tool->proxy.rotation, sizeof pose.rotation);
    return pose;
}

void pliant_tool_set_proxy(pliant_tool *tool, const pliant_tool_pose *pose)
{
    memcpy(tool->proxy.tip, pose->tip, sizeof pose->tip);
    memcpy(tool->proxy.rotation, pose->rotation, sizeof pose->rotation);
    tool->proxy.jaw = pose->jaw;
}
