/* Load cases that every method goes through, frame by frame, and what is recorded of them. */
#ifndef PLIANT_REPORT_CASES_H
#define PLIANT_REPORT_CASES_H

#include "pliant/report.h"

#ifdef __cplusplus
extern "C" {
#endif

/* displacement: the held point is moved; force: the force that the fine solution took, growing; grasp: a spring is moved;
 * gravity: 1 g turned from posterior through superior to anterior; sag: from rest, the scene's gravity acts from the first frame on */
#define REPORT_CASE_LIST(X) X(displacement) X(force) X(grasp) X(gravity) X(sag)
typedef enum report_case_kind {
#define REPORT_CASE_ENUM(name) CASE_##name,
    REPORT_CASE_LIST(REPORT_CASE_ENUM)
#undef REPORT_CASE_ENUM
    NUM_CASES
} report_case_kind;
const char *report_case_name(report_case_kind kind);
static inline bool report_case_pulls(report_case_kind kind) { return kind < CASE_gravity; }

typedef struct report_case {
    report_case_kind kind;
    int32_t frames;
    double rest[3], pull[3]; /* of a pull [m] */
    double force[3];         /* force: at the end [N] */
} report_case;

typedef struct report_limits {
    int32_t iterations; /* of a step; 0: until the tolerance is met */
    double tolerance;
    double period;      /* frames begin this far apart, as in a running simulation, so that the background has its time; 0: at once [s] */
    bool tight;         /* a frame goes on until the tolerance is met, whatever it takes: for references */
    bool before_patch;  /* the pull begins when the tool takes hold; else when its patch is there */
    bool own_time;      /* CPU: the time that the thread that steps ran, not the clock's: other programs take none of it */
    pliant_progress progress; /* asked in every frame whether to go on; its fraction is of the run */
} report_limits;

typedef struct report_run {
    int32_t frames, points;
    double *positions; /* (frames x points x 3) of the points */
    double *seconds;   /* (PLIANT_NUM_STEP_STAGES x frames) */
    double own_share;  /* of the frames' time that the thread that steps ran, and did not wait or give way to others */
    double *residual;  /* (frames) */
    int32_t *iterations;
    pliant_statistics statistics; /* at the end */
    double force[3];              /* of the tool, at the end [N] */
    double held_point[3];         /* at the end [m] */
    size_t bytes;                 /* held by the data, factors too */
    pliant_data *data;            /* at the end */
} report_run;

/* @param points  of the model's fine mesh
 * @param target  Nullable: the deformed volume is made too
 * Errors: as of stepping, CANCELLED; a step that does not converge is none. */
pliant_status report_case_run(const pliant_model *model, const report_case *load, report_limits limits, const pliant_points *points,
                              const pliant_geometry *target, report_run *out);
void report_run_free(report_run *run); /* Nullable; leaves it zeroed */

/* The grid of the deformed volume: it holds the fine mesh at rest with the scene's margin around it. */
pliant_status report_target(const pliant_model *model, pliant_geometry *out);

/* Everything that a data holds, CHOLMOD's factors too, when `before` was in use before it was made. */
size_t report_data_bytes(const pliant_data *data, size_t before);

#ifdef __cplusplus
}
#endif
#endif
