/* Common beginning and end of the other examples: the phantom, its model, and a simulation. pull_a_point.c shows these
 * steps in full. */
#ifndef PLIANT_EXAMPLE_H
#define PLIANT_EXAMPLE_H

#include "pliant/pliant.h"

#include <stdio.h>

typedef struct example {
    pliant_volume scan;
    pliant_labels labels;
    pliant_material_table materials;
    pliant_model *model;
    pliant_data *data;
} example;

/* Build a model of the phantom with a scene (NULL: the default scene), and its simulation data. */
static inline pliant_status example_begin(const pliant_scene *wanted, example *out)
{
    pliant_scene scene;
    pliant_scene_defaults(&scene);
    if (wanted) scene = *wanted;
    *out = (example){0};
    pliant_status status = pliant_inputs_read(&scene, "phantom:80x58x60", &out->scan, &out->labels, &out->materials);
    if (status >= 0)
        status =
            pliant_model_build(&scene, &out->scan, &out->labels, &out->materials, (pliant_progress){0}, &out->model);
    return status < 0 ? status : pliant_data_create(out->model, &out->data);
}

/* Add a tool that grasps the tissue at a rest point. */
static inline pliant_status example_hold(example *of, pliant_data *data, const double point[3], int *tool)
{
    pliant_status status = pliant_tool_add(of->model, data, "forceps", tool);
    if (status >= 0) status = pliant_tool_set_pose(data, *tool, point, NULL);
    return status < 0 ? status : pliant_tool_grasp(of->model, data, *tool, point);
}

/* Print the error, free everything, and return the exit code of the program. */
static inline int example_end(example *of, pliant_status status)
{
    if (status < 0) fprintf(stderr, "%s\n", pliant_last_error());
    pliant_data_free(of->data);
    pliant_model_free(of->model);
    pliant_material_table_free(&of->materials);
    pliant_labels_free(&of->labels);
    pliant_volume_free(&of->scan);
    return status < 0;
}

#endif
