// Errors of steps that report convergence.
#ifndef PLIANT_TEST_TOLERANCE_H
#define PLIANT_TEST_TOLERANCE_H

#include "body.h"

inline double max_distance(const std::vector<double> &a, const std::vector<double> &b)
{
    double maximum = 0;
    for (size_t n = 0; n < a.size(); n += 3)
        maximum = std::fmax(maximum, std::hypot(std::hypot(a[n] - b[n], a[n + 1] - b[n + 1]), a[n + 2] - b[n + 2]));
    return maximum;
}

inline std::vector<double> positions(const pliant_data *data)
{
    return std::vector<double>(data->positions, data->positions + 3 * data->body->fine.num_nodes);
}

// A body lies under its weight, then is pulled by displacement or by force. Return the maximum error of converged steps
// relative to the frame's maximum displacement.
inline double worst_error(const pliant_model *model, const double point[3], const double by[3], int frames,
                          pliant_drive drive, double tolerance)
{
    std::vector<std::vector<double>> right;
    std::vector<double> force;
    double worst = 0, minimum = INFINITY, maximum = 0; // and ratio of the estimate to the true error
    int converged = 0;
    for (bool exact : {true, false}) {
        pliant_data *data = nullptr;
        EXPECT_EQ(pliant_data_create(model, &data), PLIANT_OK) << pliant_last_error();
        EXPECT_EQ(pliant_data_set_limits(data, exact ? 200 : 60, 1e-8), PLIANT_OK);
        pliant_status status = PLIANT_NOT_CONVERGED;
        for (int s = 0; s < 40 && status == PLIANT_NOT_CONVERGED; s++)
            EXPECT_GE(status = pliant_step(model, data), 0) << pliant_last_error();
        EXPECT_EQ(pliant_data_set_limits(data, exact ? 200 : 60, exact ? 1e-8 : tolerance), PLIANT_OK);
        int tool;
        EXPECT_EQ(pliant_tool_add(model, data, "t", &tool), PLIANT_OK);
        EXPECT_EQ(pliant_tool_set_pose(data, tool, point, nullptr), PLIANT_OK);
        EXPECT_EQ(pliant_tool_grasp(model, data, tool, point), PLIANT_OK) << pliant_last_error();
        double from[3];
        for (int d = 0; d < 3; d++) from[d] = data->tools[tool].held_point[d];
        for (int f = 0; f < frames; f++) {
            double tip[3];
            for (int d = 0; d < 3; d++) tip[d] = from[d] + by[d] * (f + 1) / frames;
            EXPECT_EQ(pliant_tool_set_pose(data, tool, tip, nullptr), PLIANT_OK);
            const bool by_force = drive == PLIANT_DRIVE_FORCE && !exact;
            EXPECT_EQ(pliant_tool_set_drive(data, tool, by_force ? PLIANT_DRIVE_FORCE : PLIANT_DRIVE_RIGID,
                                            by_force ? force.data() + 3 * f : nullptr),
                      PLIANT_OK);
            status = PLIANT_NOT_CONVERGED;
            for (int s = 0; s < (exact ? 40 : 1) && status == PLIANT_NOT_CONVERGED; s++)
                EXPECT_GE(status = pliant_step(model, data), 0) << pliant_last_error();
            if (exact) {
                right.push_back(positions(data));
                force.insert(force.end(), data->tools[tool].force, data->tools[tool].force + 3);
                continue;
            }
            if (status != PLIANT_OK) continue;
            converged++;
            const std::vector<double> rest(model->body->fine.rest,
                                           model->body->fine.rest + 3 * model->body->fine.num_nodes);
            const double error = max_distance(positions(data), right[f]);
            worst = std::fmax(worst, error / max_distance(right[f], rest));
            minimum = std::fmin(minimum, data->statistics.error / error);
            maximum = std::fmax(maximum, data->statistics.error / error);
        }
        pliant_data_free(data);
    }
    EXPECT_GT(converged, 0.8 * frames);
    std::printf("drive %d: %d of %d frames converged, worst error %.3f %% of the displacement, "
                "told %.2f to %.2f times as much\n",
                drive, converged, frames, 100 * worst, minimum, maximum);
    return worst;
}

#endif
