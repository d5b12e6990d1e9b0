/* How do I load a scan, grasp a point and pull it?    pull_a_point SCAN X Y Z    (position of the point, LPS [m]) */
#include "pliant/pliant.h"

#include <stdio.h>
#include <stdlib.h>

int main(int argc, char **argv)
{
    /* the built-in phantom, a DICOM folder, or a .nii.gz, .nrrd or .mha file */
    const char *path = argc > 1 ? argv[1] : "phantom:80x58x60";
    double point[3] = {0.05, -0.09, 0.06};
    for (int d = 0; d < 3 && argc > 4; d++) point[d] = atof(argv[2 + d]);

    pliant_scene scene; /* options of the model and the solver (see README.md), here the defaults */
    pliant_volume scan = {0};
    pliant_labels labels = {0};
    pliant_material_table materials = {0};
    pliant_model *model = NULL;
    pliant_data *data = NULL;
    int tool;
    pliant_scene_defaults(&scene);
    pliant_status status = pliant_inputs_read(&scene, path, &scan, &labels, &materials);
    if (status >= 0) status = pliant_model_build(&scene, &scan, &labels, &materials, (pliant_progress){0}, &model);
    if (status >= 0) status = pliant_data_create(model, &data);
    if (status >= 0) status = pliant_tool_add(model, data, "forceps", &tool);
    if (status >= 0) status = pliant_tool_set_pose(data, tool, point, NULL);
    if (status >= 0) status = pliant_tool_grasp(model, data, tool, point);
    for (int step = 1; step <= 10 && status >= 0; step++) { /* pull forward by 1 cm, 1 mm per step */
        double tip[3] = {point[0], point[1] - 0.001 * step, point[2]};
        status = pliant_tool_set_pose(data, tool, tip, NULL);
        if (status >= 0) status = pliant_step(model, data);
    }
    pliant_tool_state state;
    if (status >= 0) status = pliant_tool_get(data, tool, &state);
    if (status >= 0)
        printf("the held point moved %.2f mm, and pulls back with %.3f N\n", 1e3 * (point[1] - state.held_point[1]),
               -state.force[1]);
    else
        fprintf(stderr, "%s\n", pliant_last_error());

    pliant_data_free(data);
    pliant_model_free(model);
    pliant_material_table_free(&materials);
    pliant_labels_free(&labels);
    pliant_volume_free(&scan);
    return status < 0;
}
