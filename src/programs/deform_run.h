/* One run of pliant_deform: build a model from the inputs, and compute steps along the tool path. */
#ifndef PLIANT_TOOLS_DEFORM_RUN_H
#define PLIANT_TOOLS_DEFORM_RUN_H

#include "deform_arguments.h"
#include "deform_probes.h"
#include "deform_tools.h"
#include "timing.h"
#include "tool/path.h"

typedef struct deform_inputs {
    pliant_volume scan;
    pliant_labels labels;
    pliant_material_table materials;
    pliant_path path;
} deform_inputs;

typedef struct deform_run {
    const deform_arguments *arguments;
    const deform_inputs *inputs;
    pliant_scene scene;   /* the arguments' scene, possibly with another method */
    const char *folder;   /* folder for results; created if missing */
    pliant_model *model;
    pliant_data *data;
    deform_tools tools;
    step_times times;
    deform_probes probes;
} deform_run;

/* Read the files that the command line names. Free with deform_inputs_free. Errors: as for the readers. */
pliant_status deform_inputs_read(const deform_arguments *arguments, deform_inputs *out);
void deform_inputs_free(deform_inputs *inputs);

/* Build the model, compute the steps and write the results. If a step fails, the results of the steps before it are
 * written. The run keeps the last state; always free it with deform_run_free. */
pliant_status deform_run_execute(deform_run *run);
void deform_run_free(deform_run *run);

#endif
