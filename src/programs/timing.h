/* Record the time of every stage of every step, for a summary and a table. */
#ifndef PLIANT_TOOLS_TIMING_H
#define PLIANT_TOOLS_TIMING_H

#include "pliant/data.h"

#include <stdio.h>

/* Largest contact force of a tool, and its standard error [N]. */
typedef struct contact_peak { double force, error; size_t step; } contact_peak;

typedef struct step_times {
    FILE *steps;         /* steps.csv, one row per step */
    FILE *tools;         /* tools.csv, one row per step and tool that grasps, cuts or presses */
    double *seconds;     /* (num_steps x columns): the stages, the two parts of the warp, the whole step */
    double median;       /* median time of the whole step [s], set by timing_end */
    size_t num_steps, capacity;
    uint64_t iterations;
    bool last_converged;
    double worst_error;        /* maximum error estimate of steps that did not converge [m] */
    size_t inverted_steps;     /* number of steps with inverted elements, and maximum number of inverted elements */
    int32_t max_inverted;
    contact_peak contact[PLIANT_MAX_TOOLS];
} step_times;

/* Create folder/steps.csv and tools.csv with their header lines. Errors: FILE. */
pliant_status timing_start(const char *folder, step_times *out);

/* Append the rows of the last step. Errors: FILE, MEMORY. */
pliant_status timing_add(step_times *times, const pliant_data *data, pliant_status status, double seconds);

/* Close the files. Errors: FILE if the rows could not be written. */
pliant_status timing_end(step_times *times);

/* Print mean, median and maximum time of every stage, with culling and rasterization separately ([H] 4.1), their
 * fractions of the step, and how the steps ended. */
void timing_print(const step_times *times, const pliant_model *model, const pliant_data *data, FILE *file);

/* Log warnings about unreliable results: steps that did not converge, inverted elements. */
void timing_warn(const step_times *times, const pliant_model *model, const pliant_data *data);

/* Print the time and memory of every stage of the build, and the maximum memory of the process. */
void timing_print_build(const pliant_model *model, FILE *file);
void timing_print_memory(FILE *file);

/* Write folder/build.csv. Errors: FILE. */
pliant_status timing_write_build(const char *folder, const pliant_model *model);

#endif
