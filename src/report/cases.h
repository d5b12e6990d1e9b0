/* Load cases that every method computes frame by frame, and their recorded results. */
#ifndef PLIANT_REPORT_CASES_H
#define PLIANT_REPORT_CASES_H

#include "report/report.h"

#ifdef __cplusplus
extern "C" {
#endif

/* displacement: the grasped point is moved; force: an increasing force up to the force of the fine solution; grasp: a
 * spring is moved; gravity: 1 g rotated from posterior through superior to anterior; sag: the scene's gravity acts on
 * the undeformed body from the first frame on */
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
    double rest[3], pull[3]; /* grasped point, and displacement of a pull [m] */
    double force[3];         /* for force: force at the end [N] */
} report_case;

typedef struct report_limits {
    int32_t iterations; /* per step; 0: until the tolerance is met */
    double tolerance;
    /* frame period, which gives background work its time as in a running simulation; 0: no waiting [s] */
    double period;
    /* iterate each frame until the tolerance is met, without a limit: for reference solutions */
    bool iterates_to_tolerance;
    bool before_patch;  /* start the pull immediately after the grasp; otherwise when the patch is available */
    /* measure the CPU time of the stepping thread instead of wall time, so that other programs do not count */
    bool uses_thread_time;
    pliant_progress progress; /* called in every frame; its fraction refers to the run */
} report_limits;

typedef struct report_run {
    int32_t frames, points;
    double *positions;        /* (frames x points x 3) positions of the points */
    double *seconds;          /* (PLIANT_NUM_STEP_STAGES x frames) */
    double cpu_time_fraction; /* fraction of the frames' time that the stepping thread was running */
    double *residual;         /* (frames) */
    int32_t *iterations;
    pliant_statistics statistics; /* at the end */
    double force[3];              /* force on the tool at the end [N] */
    double held_point[3];         /* position of the grasped point at the end [m] */
    size_t bytes;                 /* memory of the simulation, including factors */
    pliant_data *data;            /* simulation at the end */
} report_run;

/* Run a load case.
 * @param points points of the model's fine mesh
 * @param target Nullable: compute the deformed volume on this grid
 * Errors: as for stepping, CANCELLED. A step that does not converge is no error. */
pliant_status report_case_run(const pliant_model *model, const report_case *load, report_limits limits,
                              const pliant_points *points, const pliant_geometry *target, report_run *out);
void report_run_free(report_run *run); /* Nullable; zeroes the struct */

/* Return the grid of the deformed volume: it contains the fine mesh at rest with the scene's margin. */
pliant_status report_target(const pliant_model *model, pliant_geometry *out);

/* Return the memory of a simulation, including CHOLMOD's factors.
 * before: memory in use before the simulation was created */
size_t report_data_bytes(const pliant_data *data, size_t before);

#ifdef __cplusplus
}
#endif
#endif
