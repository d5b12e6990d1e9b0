/* Stages of a sweep: reference solutions, runs, and rows. */
#ifndef PLIANT_REPORT_SWEEP_H
#define PLIANT_REPORT_SWEEP_H

#include "report/cases.h"
#include "report/report.h"
#include "report/rows.h"

#ifdef __cplusplus
extern "C" {
#endif

enum { MAX_CASES = 3 * PLIANT_MAX_PULLS + 2 };

/* Suffix of the variant for rows whose pull began before the patch was available. */
#define SWEEP_BEFORE_PATCH "before its patch"

/* A tightly converged solution of a case on a mesh. */
typedef struct sweep_reference {
    bool there;
    report_run run;  /* its data are freed */
    double *last;    /* (fine nodes x 3) final positions of the run's mesh; only for the same resolution */
    double largest;  /* maximum displacement over the frames [m] */
} sweep_reference;

/* Reference solutions and other data that runs share. */
typedef struct sweep_ground {
    const pliant_report_input *input;
    const pliant_sweep *sweep;
    const char *folder;          /* Nullable if there is no deformed volume */
    pliant_report_tables *tables;
    pliant_scene scene;          /* scene of the runs, with the ratio and the varied option */
    pliant_scene reference;      /* scene whose fine mesh gives the reference */
    pliant_geometry target;      /* grid of the deformed volume */
    report_case cases[MAX_CASES];
    const char *point_names[MAX_CASES];
    int num_cases;
    int32_t count;               /* number of points */
    double *rest;                /* (count x 3) rest positions of the points */
    pliant_model *fine;          /* model of the reference */
    size_t fine_peak;            /* maximum memory during its build [bytes] */
    sweep_reference same[MAX_CASES], refined[MAX_CASES];
    pliant_points refined_points;
    int32_t refined_tets;          /* 0: not computed */
} sweep_ground;

/* A run to be written to the tables. */
typedef struct sweep_result {
    const sweep_ground *ground;
    const pliant_model *model;
    const pliant_points *points;
    int index;                   /* index of the case */
    const report_run *run;
    bool voxels;                 /* whether to compute per-voxel errors */
} sweep_result;

/* A running sweep. */
typedef struct sweep_state {
    sweep_ground ground;
    pliant_progress progress;
    char setup[9];
    char variant[112];
    char activity[160];
    int grounds; /* number of ratios and variants before this one */
    int done, total;
} sweep_state;

/* Return whether ground.scene is also run without waiting for its patch. */
bool sweep_runs_before_patch(const sweep_ground *ground, report_case_kind kind);

/* Store the load cases of the sweep in the ground. */
void sweep_list_cases(sweep_ground *ground);
/* Build the reference, and compute tightly converged solutions of the missing cases: (cases). Free with
 * sweep_free_ground, also after a failure. */
pliant_status sweep_prepare(sweep_state *state, const uint8_t *missing);
void sweep_free_ground(sweep_ground *ground);
/* Build ground.scene with this method, and run every case and budget that is not in the tables yet. Failures of the
 * model or a run are written to the tables. Errors: MEMORY, CANCELLED, FILE. */
pliant_status sweep_run_model(sweep_state *state, int method, int submesh);

/* ---- sweep_reference_file.c: reference solutions stored in the folder. Identification of a reference: */
typedef struct sweep_reference_key {
    int index;             /* index of the case */
    int32_t nodes, points; /* nodes of its mesh, and number of points */
    double tolerance;
    bool has_last_state;
} sweep_reference_key;
/* out->there: whether it was found. Errors: MEMORY. */
pliant_status sweep_reference_read(const sweep_state *state, const sweep_reference_key *kept, sweep_reference *out);
/* A reference that is too large is not stored. Errors: FILE. */
pliant_status sweep_reference_write(const sweep_state *state, const sweep_reference_key *kept,
                                    const sweep_reference *reference);

/* Write the rows of the frames, the voxels and the sweep, in this order; the last one marks the run as complete.
 * @param key row with the RUN_KEYS cells of the run; cells are added */
pliant_status sweep_write_rows(const sweep_result *result, report_row *key);
/* Write the histogram and the slices. *summary: statistics over the voxels; zero without a deformed volume. */
pliant_status sweep_write_voxel_rows(const sweep_result *result, report_row *key, pliant_error *summary);
/* Write the row of a model.
 * @param message NULL: the model was built; otherwise the error
 * @param key MODEL_KEYS cells */
pliant_status sweep_write_build_row(const pliant_model *model, const char *message, size_t peak, report_row *key,
                                    pliant_results *builds);

#ifdef __cplusplus
}
#endif
#endif
