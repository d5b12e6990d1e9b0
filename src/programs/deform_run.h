/* One run of pliant_deform: a model of the inputs, stepped along the tool path. */
#ifndef PLIANT_TOOLS_DEFORM_RUN_H
#define PLIANT_TOOLS_DEFORM_RUN_H

#include "deform_arguments.h"
#include "deform_probes.h"
#include "deform_tools.h"
#include "timing.h"

#ifdef __cplusplus
extern "C" {
#endif

typedef struct deform_inputs {
    pliant_volume scan;
    pliant_labels labels;
    pliant_material_table materials;
    pliant_path path;
} deform_inputs;

typedef struct deform_run {
    const deform_arguments *arguments;
    const deform_inputs *inputs;
    pliant_scene scene;   /* the arguments' own, or with another method */
    const char *folder;   /* where its results go; made if it is missing */
    pliant_model *model;
    pliant_data *data;
    deform_tools tools;
    step_times times;
    deform_probes probes;
} deform_run;

/* What the command line names. Free with deform_inputs_free. Errors: as of the readers. */
pliant_status deform_inputs_read(const deform_arguments *arguments, deform_inputs *out);
void deform_inputs_free(deform_inputs *inputs);

/* Builds, steps and writes the results, those of the steps before one that broke down too. Afterwards the run has the last state, to
 * be freed with deform_run_free in any case. */
pliant_status deform_run_do(deform_run *run);
void deform_run_free(deform_run *run);

#ifdef __cplusplus
}
#endif
#endif
