/* Seconds of every stage of every step, kept for the summary and written as a table. */
#ifndef PLIANT_TOOLS_TIMING_H
#define PLIANT_TOOLS_TIMING_H

#include "pliant/data.h"

#include <stdio.h>

#ifdef __cplusplus
extern "C" {
#endif

typedef struct step_times {
    FILE *steps;         /* steps.csv, a row a step */
    FILE *tools;         /* tools.csv, a row a step and tool that holds, cuts or presses */
    double *seconds;     /* (num_steps x columns): the stages, the two parts of the warp, the whole step */
    double median;       /* of the whole step [s], after timing_end */
    size_t num_steps, capacity;
    uint64_t iterations;
    bool last_converged;
    double worst_error;        /* that a step which did not converge told [m] */
    size_t inverted_steps;     /* steps with inverted elements, and the most that one had */
    int32_t most_inverted;
} step_times;

/* folder/steps.csv and tools.csv with their first lines. Errors: FILE. */
pliant_status timing_start(const char *folder, step_times *out);

/* Rows for the step that data has just done. Errors: FILE, MEMORY. */
pliant_status timing_add(step_times *times, const pliant_data *data, pliant_status status, double seconds);

/* Errors: FILE, when the rows did not reach the disk. */
pliant_status timing_end(step_times *times);

/* Mean, median and largest time of every stage, culling and rasterization apart ([H] 4.1), their shares of the step, and how the steps
 * ended. */
void timing_print(const step_times *times, const pliant_model *model, const pliant_data *data, FILE *file);

/* Warnings for the log where results are not to be relied on: steps that did not converge, elements that are inverted. */
void timing_warn(const step_times *times, const pliant_model *model, const pliant_data *data);

/* The table of the build: seconds and bytes of every stage; the largest memory that the process had. */
void timing_print_build(const pliant_model *model, FILE *file);
void timing_print_memory(FILE *file);

/* folder/build.csv. Errors: FILE. */
pliant_status timing_write_build(const char *folder, const pliant_model *model);

#ifdef __cplusplus
}
#endif
#endif
