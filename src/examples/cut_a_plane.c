/* How do I cut? Instantly from a script, and with a simulated knife that receives forces.    cut_a_plane */
#include "example.h"

/* Move a knife with an edge of 4 cm backwards through the liver, 1 mm per step. Return the maximum force on it [N] and
 * its state with the cut area. */
static pliant_status stroke(example *all, double *force, pliant_tool_state *state)
{
    const double from[3] = {-0.02, 0, 0}, to[3] = {0.02, 0, 0}; /* ends of its edge, in its own axes */
    int tool;
    pliant_status status = pliant_tool_add(all->model, all->data, "knife", &tool);
    if (status >= 0) status = pliant_tool_set_blade(all->data, tool, from, to);
    for (int step = 0; step < 40 && status >= 0; step++) {
        const double tip[3] = {-0.07, -0.06 + 0.001 * step, 0.11};
        status = pliant_tool_set_pose(all->data, tool, tip, NULL);
        if (status >= 0) status = pliant_tool_set_cutting(all->data, tool, true);
        if (status >= 0) status = pliant_step(all->model, all->data);
        if (status >= 0) status = pliant_tool_get(all->data, tool, state);
        if (status >= 0 && state->force[1] > *force) *force = state->force[1];
    }
    return status;
}

int main(void)
{
    example all;
    pliant_scene scene;
    pliant_cut_report report;
    pliant_tool_state knife = {.severed_area = 0};
    double force = 0;
    pliant_scene_defaults(&scene);
    pliant_status status = pliant_scene_set(&scene, "cut/kind", "sever"); /* without this option nothing can be cut */
    if (status < 0) return 1;
    status = example_begin(&scene, &all);
    /* a line of points on the deformed tissue, and the vector from the line to the bottom of the cut [m] */
    const double line[6] = {0.06, -0.2, -0.2, 0.06, -0.2, 0.2}, depth[3] = {0, 0.4, 0};
    if (status >= 0) status = pliant_data_cut(all.model, all.data, 2, line, depth, &report);
    if (status >= 0) printf("a plane: %.1f cm^2, %d pieces\n", 1e4 * report.area, (int)report.pieces);
    /* restores the previous body, bitwise identical */
    if (status >= 0) status = pliant_data_undo_cut(all.model, all.data);
    if (status >= 0) status = stroke(&all, &force, &knife);
    if (status >= 0) printf("a knife: %.1f cm^2, felt as up to %.1f N\n", 1e4 * knife.severed_area, force);
    return example_end(&all, status);
}
