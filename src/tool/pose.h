/* The two poses of a tool. */
#ifndef PLIANT_INTERACT_POSE_H
#define PLIANT_INTERACT_POSE_H

#include "contact/advance/advance.h"
#include "model_data/data.h"

#ifdef __cplusplus
extern "C" {
#endif

/* Return the target pose, which is measured. */
pliant_tool_pose pliant_tool_measured(const pliant_tool *tool);
/* Return the proxy pose, which is simulated. */
pliant_tool_pose pliant_tool_proxy(const pliant_tool *tool);
/* Set the proxy pose. */
void pliant_tool_set_proxy(pliant_tool *tool, const pliant_tool_pose *pose);

#ifdef __cplusplus
}
#endif

#endif
