/* How many iterations per step are enough? Compare the result of a pull after 10 steps with a converged result.
 * error_against_time */
#include "example.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

static double seconds_of_step(const pliant_data *data)
{
    double seconds = 0;
    for (int s = 0; s < PLIANT_NUM_STEP_STAGES; s++) seconds += pliant_data_get_statistics(data)->seconds[s];
    return seconds;
}

/* Pull a point in 10 steps.
 * @param out (nodes x 3) final positions [m]
 * @param seconds mean time per step */
static pliant_status pull(example *all, int iterations, double tolerance, double *out, int32_t nodes, double *seconds)
{
    const double point[3] = {0.05, -0.09, 0.06};
    const int steps = 10;
    int tool;
    pliant_status status = pliant_data_reset(all->model, all->data);
    if (status >= 0) status = pliant_data_set_limits(all->data, iterations, tolerance);
    if (status >= 0) status = example_hold(all, all->data, point, &tool);
    *seconds = 0;
    for (int step = 1; step <= steps && status >= 0; step++) {
        const double tip[3] = {point[0], point[1] - 0.02 * step / steps, point[2]};
        status = pliant_tool_set_pose(all->data, tool, tip, NULL);
        if (status >= 0) status = pliant_step(all->model, all->data);
        if (status >= 0) *seconds += seconds_of_step(all->data) / steps;
    }
    if (status >= 0) memcpy(out, pliant_data_get_positions(all->data, NULL), 3 * (size_t)nodes * sizeof *out);
    return status;
}

int main(void)
{
    example all;
    double seconds, *reference = NULL, *now = NULL;
    pliant_status status = example_begin(NULL, &all);
    const int32_t nodes = status < 0 ? 0 : pliant_data_get_body(all.data)->fine.num_nodes;
    if (status >= 0) {
        reference = malloc((size_t)nodes * 3 * sizeof *reference);
        now = malloc((size_t)nodes * 3 * sizeof *now);
        if (!reference || !now) status = PLIANT_ERROR_MEMORY;
    }
    if (status >= 0) status = pull(&all, 200, 1e-8, reference, nodes, &seconds);
    printf("iterations,ms_a_step,largest_error_mm\n");
    for (int iterations = 1; iterations <= 8 && status >= 0; iterations *= 2) {
        double worst = 0;
        status = pull(&all, iterations, 1e-8, now, nodes, &seconds);
        for (int32_t n = 0; n < 3 * nodes && status >= 0; n++) worst = fmax(worst, fabs(now[n] - reference[n]));
        if (status >= 0) printf("%d,%.2f,%.4f\n", iterations, 1e3 * seconds, 1e3 * worst);
    }
    free(reference);
    free(now);
    return example_end(&all, status);
}
