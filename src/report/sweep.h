/* The parts of a sweep: what all runs are measured against, and rows from runs. */
#ifndef PLIANT_REPORT_SWEEP_H
#define PLIANT_REPORT_SWEEP_H

#include "report/cases.h"
#include "report/rows.h"

#ifdef __cplusplus
extern "C" {
#endif

enum { MOST_CASES = 3 * PLIANT_MAX_PULLS + 1 };

/* A case on a mesh, solved tightly. */
typedef struct sweep_reference {
    bool there;
    report_run run;  /* its data is freed */
    double *last;    /* (fine nodes x 3) of its own mesh, at the end; only for the same resolution */
    double largest;  /* over the frames [m] */
} sweep_reference;

/* Everything that the runs of one ratio (and variant) share. */
typedef struct sweep_ground {
    const pliant_report_input *input;
    const pliant_sweep *sweep;
    const char *folder;
    pliant_report_tables *tables;
    pliant_scene scene;          /* with the ratio and the varied option */
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
