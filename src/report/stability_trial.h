/* Stability trials: a body, a method, a treatment, a verdict. */
#ifndef PLIANT_REPORT_STABILITY_TRIAL_H
#define PLIANT_REPORT_STABILITY_TRIAL_H

#include "report/report.h"
#include "report/rows.h"

typedef struct stability_context {
    const pliant_report_input *input; /* body of cases that vary the load */
    const pliant_stability *options;
    pliant_report_tables *tables;
    pliant_progress progress;
    char setup[9];
    const char *name;                 /* name of the case */
    int index, count;                 /* index and number of cases, for the progress */
    bool dynamic;                     /* the case's body determines the solver */
} stability_context;

typedef struct stability_trial {
    stability_context *context;
    const pliant_report_input *input;
    pliant_method method;
    report_row row;
    double start;
    size_t bytes_before;
    pliant_model *model;
    pliant_data *data;
    double *kept;             /* (fine nodes x 3) positions before the step */
    double size;              /* maximum edge of the body's bounding box at rest [m] */
    int64_t steps;
    int64_t iterations;
    int32_t steps_to_rest;    /* -1: did not come to rest, -2: not tested */
    int32_t max_inverted_elements;
    int64_t refused;
    double largest;           /* maximum displacement [m] */
    double energy;            /* maximum energy of explicit dynamics while settling [J] */
    int32_t still;            /* consecutive frames without motion */
    pliant_status last;       /* status of the last step or call */
    bool broken, has_wrong_rest, is_unsettled;
    bool cancelled;     /* there is no verdict */
    char activity[128]; /* text for the progress */
    char message[ROW_TEXT];
    char figure[128];
} stability_trial;

/* Treatment of one body with one method; called for every method. Negative statuses are already recorded in the
 * trial. */
typedef pliant_status (*stability_treatment)(stability_trial *trial, const void *argument);

/* Build the input's body with every method, apply the treatment and record the verdict. Trials that are in the table
 * are skipped. Errors: CANCELLED, FILE, MEMORY; other errors are part of the verdict. */
pliant_status stability_try(stability_context *context, const char *parameter, const pliant_report_input *input,
                            stability_treatment treatment, const void *argument);

/* Use dynamic relaxation for explicit dynamics, so that bodies come to rest. Cases about inertia use their own
 * bodies. */
void trial_use_requested_tled(const stability_context *context, pliant_scene *scene);

/* Compute one step. Check that positions are finite, and that a rejected step keeps them. */
pliant_status trial_step(stability_trial *trial);
/* Step until a step ends below the tolerance, or with inertia until nothing moves, at most settle_steps. Return the
 * number of steps, or -1. */
int32_t trial_settle(stability_trial *trial);
/* Remove tools and gravity, and settle. Record whether the body returns to its rest shape. */
pliant_status trial_release_tools(stability_trial *trial);
/* Record the status of a call other than a step. */
pliant_status trial_check_status(stability_trial *trial, pliant_status status);
/* Grasp the free node farthest from the fixed ones.
 * from: output; position of the tip */
pliant_status trial_grasp(stability_trial *trial, pliant_drive drive, double from[3]);
/* Apply gravity, pull by a tenth of the body's size, and release. For cases about the body itself. */
pliant_status trial_sag_and_pull(stability_trial *trial, const void *argument);

#endif
