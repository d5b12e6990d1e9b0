/* One step of the simulation as a Step message, both live and when a recording is recomputed. */
#ifndef PLIANT_ROS_SIM_STEPPING_H
#define PLIANT_ROS_SIM_STEPPING_H

#include "ros/sim/loaded_model.h"
#include "model_data/background.h"

#include <pliant/Step.h>

namespace pliant_ros {

using pliant::CutInput;
using pliant::Step;
using pliant::ToolInput;

/* ---- stepping.cpp: tools and cuts from messages */
/* Convert a tool's shape to its message. */
void set_shape(const pliant_tool_shape &shape, ToolInput *out);
/* Set a tool's shape from its message. Throws Failure. */
void apply_shape(const ToolInput &input, pliant_data *data, int tool);
/* Add tools with their blades and shapes to a new simulation. Throws Failure. */
void add_tools(const pliant_model &model, pliant_data *data, const std::vector<ToolInput> &tools);
/* Cut immediately, or undo a cut. Throws Failure; then nothing has changed.
 * report: set by a cut */
void make_cut(const pliant_model &model, pliant_data *data, const CutInput &cut, pliant_cut_report *report);

/* ---- simulation_step.cpp */
/* Apply the settings and tools of the message, and compute a step unless the message is paused. With background kind
 * PRESCRIBED, background results are installed as the message lists them. Throws Failure if the number of tools
 * differs. */
pliant_status make_step(const pliant_model &model, pliant_data *data, pliant_background_kind kind, const Step &step);
/* Store the result of a step in its message: background, status, step, checksum and duration. The caller sets tools,
 * settings, sequence and revisions. */
void set_step_outcome(pliant_status status, const pliant_data &data, Step *out);

} // namespace pliant_ros

#endif
