/* What is the force on the tool for each millimetre of a pull?    read_forces > forces.csv */
#include "example.h"

int main(void)
{
    const double point[3] = {0.05, -0.09, 0.06};
    example all;
    int tool;
    pliant_status status = example_begin(NULL, &all);
    if (status >= 0) status = example_hold(&all, all.data, point, &tool);
    /* The grasped point follows the tool exactly. PLIANT_DRIVE_SPRING connects them by a spring; PLIANT_DRIVE_FORCE
     * prescribes the force. */
    if (status >= 0) status = pliant_tool_set_drive(all.data, tool, PLIANT_DRIVE_RIGID, NULL);
    printf("pull_mm,force_x_n,force_y_n,force_z_n,residual_n\n");
    for (int millimetre = 1; millimetre <= 8 && status >= 0; millimetre++) {
        const double tip[3] = {point[0], point[1] - 0.001 * millimetre, point[2]};
        pliant_tool_state state;
        status = pliant_tool_set_pose(all.data, tool, tip, NULL);
        /* PLIANT_NOT_CONVERGED is positive: the result is the best approximation */
        if (status >= 0) status = pliant_step(all.model, all.data);
        if (status >= 0) status = pliant_tool_get(all.data, tool, &state);
        if (status < 0) break;
        printf("%d,%.4f,%.4f,%.4f,%.2g\n", millimetre, state.force[0], state.force[1], state.force[2],
               pliant_data_get_statistics(all.data)->residual_force);
    }
    return example_end(&all, status);
}
