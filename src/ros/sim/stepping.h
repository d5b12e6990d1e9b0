/* One turn of the simulation out of a Step message: the same live and when a recording is made again. */
#ifndef PLIANT_ROS_SIM_STEPPING_H
#define PLIANT_ROS_SIM_STEPPING_H

#include "ros/sim/loaded.h"

#include <pliant/Step.h>

namespace pliant_ros {

using pliant::CutInput;
using pliant::Step;
using pliant::ToolInput;

/* A tool's shape to its message. */
void set_shape(const pliant_tool_shape &shape, ToolInput *out);
/* The tools of a new simulation, with their blades and shapes. Throws Failure. */
void add_tools(const pliant_model &model, pliant_data *data, const std::vector<ToolInput> &tools);
/* A cut at once, or an undo. Throws Failure, and then nothing has changed. report: of a cut. */
void make_cut(const pliant_model &model, pliant_data *data, const CutInput &cut, pliant_cut_report *report);
/* Settings and tools of the message go into the simulation, which steps unless it is paused. Prescribed: with what the message says was
   put to use. Throws Failure where the simulation has another number of tools. */
pliant_status make_step(const pliant_model &model, pliant_data *data, pliant_background_kind kind, const Step &step);
/* What came of it: background, status, step, checksum and seconds. Tools, settings, sequence and revisions are the caller's. */
void tell_outcome(pliant_status status, const pliant_data &data, Step *out);

} // namespace pliant_ros

#endif
