/* A simulation between two steps: what another process needs to go on from there. */
#ifndef PLIANT_ROS_SIM_MOMENT_H
#define PLIANT_ROS_SIM_MOMENT_H

#include "ros/sim/snapshot.h"

#include <string>
#include <vector>

namespace pliant_ros {

struct Moment {
    Snapshot snapshot;
    uint64_t sequence = 0, strokes = 0; /* turns since load or reset; cuts by services */
    bool paused = false;
    std::vector<std::pair<std::string, pliant_tool_hold>> holds; /* of tools that have hold of something */
};

/* Of a simulation of these tools. */
inline std::vector<std::pair<std::string, pliant_tool_hold>> holds_of(const pliant_data &data)
{
    std::vector<std::pair<std::string, pliant_tool_hold>> out;
    for (int tool = 0; tool < pliant_data_get_num_tools(&data); ++tool) {
        pliant_tool_hold hold;
        check(pliant_tool_get_hold(&data, tool, &hold));
        if (hold.holding) out.emplace_back(tool_state(data, tool).name, hold);
    }
    return out;
}

/* The tissue of a new simulation as it was then: cuts and positions. Throws Failure. */
inline void put_back(const Moment &moment, const pliant_model &model, pliant_data *data)
{
    const pliant_body *body = moment.snapshot.body.get();
    if (body->revision != pliant_data_get_body(data)->revision) check(pliant_data_set_body(&model, data, body));
    check(pliant_data_set_positions(&model, data, moment.snapshot.positions.data()));
}

} // namespace pliant_ros

#endif
