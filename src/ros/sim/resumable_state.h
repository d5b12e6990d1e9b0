/* A simulation between two steps, with everything that another process needs to continue it. */
#ifndef PLIANT_ROS_SIM_RESUMABLE_STATE_H
#define PLIANT_ROS_SIM_RESUMABLE_STATE_H

#include "ros/sim/snapshot.h"

#include <string>
#include <vector>

namespace pliant_ros {

struct ResumableState {
    Snapshot snapshot;
    uint64_t sequence = 0, strokes = 0; /* number of steps since load or reset; number of cuts by services */
    bool paused = false;
    std::vector<std::string> holding, touching; /* names of tools that grasped or touched tissue */
    std::vector<uint8_t> state;  /* simulation state (pliant_state_write) */
};

struct StateDeleter {
    void operator()(pliant_state *state) const { pliant_state_free(state); }
};
using SavedState = std::unique_ptr<pliant_state, StateDeleter>;

inline SavedState create_state()
{
    pliant_state *state = nullptr;
    check(pliant_state_create(&state));
    return SavedState(state);
}

/* Store the state of a simulation in a moment. Throws Failure. */
inline void take_state(const pliant_model &model, pliant_data *data, ResumableState *out)
{
    for (int tool = 0; tool < pliant_data_get_num_tools(data); ++tool) {
        const pliant_tool_state state = tool_state(*data, tool);
        const double *force = state.contact_force;
        if (state.holding) out->holding.emplace_back(state.name);
        else if (force[0] != 0 || force[1] != 0 || force[2] != 0) out->touching.emplace_back(state.name);
    }
    const SavedState state = create_state();
    check(pliant_state_save(&model, data, state.get()));
    out->state.resize(pliant_state_write(state.get(), 0, nullptr));
    pliant_state_write(state.get(), out->state.size(), out->state.data());
}

/* Restore the state in a new simulation that has the same tools. Throws Failure. */
inline void restore_state(const ResumableState &moment, const pliant_model &model, pliant_data *data)
{
    const SavedState state = create_state();
    check(pliant_state_read(&model, data, moment.snapshot.body.get(), moment.state.size(), moment.state.data(),
                            state.get()));
    check(pliant_state_restore(&model, data, state.get()));
}

} // namespace pliant_ros

#endif
