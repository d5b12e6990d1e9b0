/* Can two simulations share one model? Yes, also on two threads: the model is constant, and each simulation has its own
 * data.    two_simulations */
#include "example.h"

#include <pthread.h>

typedef struct pull {
    example *all;
    pliant_data *data;
    double distance, moved; /* in metres */
    pliant_status status;
} pull;

static void *run(void *user)
{
    pull *mine = user;
    const double point[3] = {0.05, -0.09, 0.06};
    int tool;
    pliant_tool_state state;
    mine->status = example_hold(mine->all, mine->data, point, &tool);
    for (int step = 1; step <= 10 && mine->status >= 0; step++) {
        const double tip[3] = {point[0], point[1] - mine->distance * step / 10, point[2]};
        mine->status = pliant_tool_set_pose(mine->data, tool, tip, NULL);
        if (mine->status >= 0) mine->status = pliant_step(mine->all->model, mine->data);
    }
    if (mine->status >= 0) mine->status = pliant_tool_get(mine->data, tool, &state);
    if (mine->status >= 0) mine->moved = point[1] - state.held_point[1];
    return NULL;
}

int main(void)
{
    example all;
    pliant_data *second = NULL;
    pthread_t thread;
    pliant_status status = example_begin(NULL, &all);
    if (status >= 0) status = pliant_data_create(all.model, &second);
    pull pulls[2] = {{&all, all.data, 0.01, 0, PLIANT_OK}, {&all, second, 0.02, 0, PLIANT_OK}};
    if (status >= 0 && pthread_create(&thread, NULL, run, &pulls[1]) == 0) {
        run(&pulls[0]);
        pthread_join(thread, NULL);
        for (int n = 0; n < 2 && status >= 0; n++) status = pulls[n].status;
        if (status >= 0)
            printf("pulled by 10 and 20 mm: the points moved %.2f and %.2f mm\n", 1e3 * pulls[0].moved,
                   1e3 * pulls[1].moved);
    }
    pliant_data_free(second);
    return example_end(&all, status);
}
