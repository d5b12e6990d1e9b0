/* How do I load a scan, take hold of a point and pull it?    pull_a_point SCAN X Y Z    (of the point, LPS [m]) */
#include "pliant/pliant.h"

#include <stdio.h>
#include <stdlib.h>

int main(int argc, char **argv)
{
    const char *path = argc > 1 ? argv[1] : "phantom:80x58x60"; /* computed; or a DICOM folder, .nii.gz, .nrrd, .mha */
    double point[3] = {0.05, -0.09, 0.06};
    for (int d = 0; d < 3 && argc > 4; d++) point[d] = atof(argv[2 + d]);

    pliant_scene scene; /* what to build and how to solve: options of README.md, all at their defaults here */
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
    for (int step = 1; step <= 10 && status >= 0; step++) { /* 1 cm to the front, a millimetre a step */
        double tip[3] = {point[0], point[1] - 0.001 * step, point[2]};
        status = pliant_tool_set_pose(data, tool, tip, NULL);
        if (status >= 0) status = pliant_step(model, data);
    }
    pliant_tool_state state;
    if (status >= 0) status = pliant_tool_get(data, tool, &state);
    if (status >= 0)
        printf("the held point moved %.2f mm, and pulls back with %.3f N\n", 1e3 * (point[1] - state.held_point[1]), -state.force[1]);
    else
        fprintf(stderr, "%s\n", pliant_last_error());

    pliant_data_free(data);
    pliant_model_free(model);
    pliant_material_table_free(&materials);
    pliant_labels_free(&labels);
    pliant_volume_free(&scan);
    return status < 0;
}
