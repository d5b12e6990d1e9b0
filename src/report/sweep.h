/* The parts of a sweep: what all runs are measured against, and rows from runs. */
#ifndef PLIANT_REPORT_SWEEP_H
#define PLIANT_REPORT_SWEEP_H

#include "report/cases.h"
#include "report/rows.h"

#ifdef __cplusplus
extern "C" {
#endif

enum { MOST_CASES = 3 * PLIANT_MAX_PULLS + 2 };

/* Ends the variant of rows whose pull began before the patch was there. */
#define SWEEP_BEFORE_PATCH "before its patch"

/* A case on a mesh, solved tightly. */
typedef struct sweep_reference {
    bool there;
    report_run run;  /* its data is freed */
    double *last;    /* (fine nodes x 3) of its own mesh, at the end; only for the same resolution */
    double largest;  /* over the frames [m] */
} sweep_reference;

/* What runs are measured against, and what they have in common. */
typedef struct sweep_ground {
    const pliant_report_input *input;
    const pliant_sweep *sweep;
    const char *folder;          /* Nullable without the deformed volume */
    pliant_report_tables *tables;
    pliant_scene scene;          /* of the runs: with the ratio and the varied option */
    pliant_scene reference;      /* whose fine mesh is the reference's */
    pliant_geometry target;      /* of the deformed volume */
    report_case cases[MOST_CASES];
    const char *point_names[MOST_CASES];
    int num_cases;
    int32_t count;               /* points */
    double *rest;                /* (count x 3) */
    pliant_model *fine;          /* the reference's */
    size_t fine_peak;            /* bytes while it was built */
    sweep_reference same[MOST_CASES], twice[MOST_CASES];
    pliant_points twice_points;
    int32_t twice_tets;          /* 0: not solved */
} sweep_ground;

/* One run to be told about. */
typedef struct sweep_told {
    const sweep_ground *ground;
    const pliant_model *model;
    const pliant_points *points;
    int index;                   /* of the case */
    const report_run *run;
    bool voxels;                 /* per-voxel error too */
} sweep_told;

/* A sweep under way. */
typedef struct sweep_state {
    sweep_ground ground;
    pliant_progress progress;
    char setup[9];
    char variant[112];
    char doing[160];
    int grounds; /* ratios and variants before this one */
    int done, total;
} sweep_state;

/* Whether runs of ground.scene are made before its patch is there, too. */
bool sweep_runs_before_patch(const sweep_ground *ground, report_case_kind kind);

/* Load cases of the sweep into the ground. */
void sweep_list_cases(sweep_ground *ground);
/* Build the reference and solve it tightly for the cases that are missing: (cases). Free with sweep_free_ground, also after
 * a failure. */
pliant_status sweep_prepare(sweep_state *state, const uint8_t *missing);
void sweep_free_ground(sweep_ground *ground);
/* Build ground.scene with this method and run every case and budget of it that is not in the tables yet. What this model or
 * one of its runs cannot do goes to the tables. Errors: MEMORY, CANCELLED, FILE. */
pliant_status sweep_run_model(sweep_state *state, int method, int touch);

/* ---- sweep_kept.c: references in the folder, where there is one. What a reference is told from others by: */
typedef struct sweep_kept {
    int index;             /* of the case */
    int32_t nodes, points; /* of its mesh, and those that its positions are of */
    double tolerance;
    bool with_last;
} sweep_kept;
/* out->there: it was. Errors: MEMORY */
pliant_status sweep_kept_read(const sweep_state *state, const sweep_kept *kept, sweep_reference *out);
/* One that is too large for that is not kept. Errors: FILE */
pliant_status sweep_kept_write(const sweep_state *state, const sweep_kept *kept, const sweep_reference *reference);

/* Rows of the frames, the voxels and the sweep, in that order: the last one says that the run is done.
 * @param key row with the RUN_KEYS cells of the run; cells are added */
pliant_status sweep_tell(const sweep_told *told, report_row *key);
/* Histogram and slices; *summary over the voxels, all zero when there is no deformed volume. */
pliant_status sweep_tell_voxels(const sweep_told *told, report_row *key, pliant_error *summary);
/* The row of a model that was built; message NULL: it was. @param key MODEL_KEYS cells */
pliant_status sweep_tell_build(const pliant_model *model, const char *message, size_t peak, report_row *key, pliant_results *builds);

#ifdef __cplusplus
}
#endif
#endif
