/* What happens if organs are three times as stiff? Change the material table and build the model again.
 * change_materials */
#include "example.h"

#include <string.h>

/* Compute the force [N] that moves a point near the liver by 1 cm. */
static pliant_status pull(example *all, double *force)
{
    const double point[3] = {-0.09, -0.04, 0.05}, tip[3] = {-0.09, -0.05, 0.05};
    int tool;
    pliant_tool_state state;
    pliant_status status = example_hold(all, all->data, point, &tool);
    if (status >= 0) status = pliant_tool_set_drive(all->data, tool, PLIANT_DRIVE_RIGID, NULL);
    if (status >= 0) status = pliant_tool_set_pose(all->data, tool, tip, NULL);
    for (int step = 0; step < 10 && status >= 0; step++) status = pliant_step(all->model, all->data);
    if (status >= 0) status = pliant_tool_get(all->data, tool, &state);
    if (status >= 0) *force = -state.force[1];
    return status;
}

int main(void)
{
    example all;
    double before = 0, after = 0;
    pliant_status status = example_begin(NULL, &all);
    if (status >= 0) status = pull(&all, &before);
    for (uint32_t m = 0; m < all.materials.num_materials; m++)
        if (strcmp(all.materials.materials[m].name, "organ") == 0) all.materials.materials[m].young_modulus *= 3;
    pliant_model *stiffer = NULL;
    if (status >= 0)
        status = pliant_model_build(pliant_model_get_scene(all.model), &all.scan, &all.labels, &all.materials,
                                    (pliant_progress){0}, &stiffer);
    if (status >= 0) {
        pliant_data_free(all.data); /* the data refer to the old model, so they are freed first */
        pliant_model_free(all.model);
        all.model = stiffer;
        all.data = NULL;
        status = pliant_data_create(stiffer, &all.data);
    }
    if (status >= 0) status = pull(&all, &after);
    if (status >= 0) printf("1 cm takes %.3f N; with organs three times as stiff %.3f N\n", before, after);
    return example_end(&all, status);
}
