/* Trials that try to break the solver: a body, a method, a treatment, a verdict. */
#ifndef PLIANT_REPORT_STABILITY_TRIAL_H
#define PLIANT_REPORT_STABILITY_TRIAL_H

#include "pliant/report.h"
#include "report/rows.h"

#ifdef __cplusplus
extern "C" {
#endif

typedef struct stability_context {
    const pliant_report_input *input; /* the body of cases that vary the load */
    const pliant_stability *options;
    pliant_report_tables *tables;
    pliant_progress progress;
    char setup[9];
    const char *name;                 /* of the case */
    int index, count;                 /* of cases, for the progress */
    bool dynamic;                     /* the case's body says how it is solved */
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
    double size;              /* largest edge of the body's box at rest [m] */
    int64_t steps;
    int64_t iterations;
    int32_t steps_to_rest;    /* -1: did not, -2: was not asked */
    int32_t inverted_most;
    int64_t refused;
    double largest;           /* displacement seen [m] */
    double energy;            /* of explicit dynamics, the largest when it was settling [J] */
    int32_t still;            /* frames in a row without motion */
    pliant_status last;       /* of the last step or call */
    bool broken, wrong_rest, unsettled;
    bool cancelled;           /* no verdict */
    char doing[128];          /* for the progress */
    char message[ROW_TEXT];
    char figure[128];
} stability_trial;

/* What is done to one body by one method; called for every method. A status below 0 was seen by the trial already. */
typedef pliant_status (*stability_treatment)(stability_trial *trial, const void *argument);

/* Build the input's body with every method, treat it, tell the verdict. Trials in the table are passed over.
 * Errors: CANCELLED, FILE, MEMORY; what the core refuses is a verdict. */
pliant_status stability_try(stability_context *context, const char *parameter, const pliant_report_input *input,
                            stability_treatment treatment, const void *argument);

/* Trials of explicit dynamics are by dynamic relaxation: bodies that come to rest. Cases about inertia have bodies of their own. */
void trial_as_asked(const stability_context *context, pliant_scene *scene);

/* One step: checks that positions are finite and that a refusal keeps them. */
pliant_status trial_step(stability_trial *trial);
/* Steps until one ends below the tolerance, with inertia until nothing moves, at most settle_steps; how many it took, or -1. */
int32_t trial_settle(stability_trial *trial);
/* Tools let go, gravity off, settle; says whether the body is where it was at rest. */
pliant_status trial_let_go(stability_trial *trial);
/* A status of a call other than a step. */
pliant_status trial_called(stability_trial *trial, pliant_status status);
/* Take hold of the free node farthest from the fixed ones; from: the tip. */
pliant_status trial_grasp(stability_trial *trial, pliant_drive drive, double from[3]);
/* Gravity settles, a pull of a tenth of the body, let go. For cases about the body itself. */
pliant_status trial_workout(stability_trial *trial, const void *argument);

#ifdef __cplusplus
}
#endif
#endif
