/** @file report.h
 *  Accuracy against run time on a scan of the user's own, what breaks the solver, and what each stage costs.
 *
 *  Every figure is a row of a table (pliant_results) that is kept on disk as it is made: a run that was stopped goes on
 *  where it ended. Errors are distances [m] between where two solutions place the same tissue; percentages are formed by
 *  whoever reads the rows, of the largest displacement of the whole run or of the frame's own.
 */
#ifndef PLIANT_REPORT_H
#define PLIANT_REPORT_H

#include "pliant/data.h"

#ifdef __cplusplus
extern "C" {
#endif

typedef struct pliant_error {
    double max, rms, p95; /**< [m] */
    double largest;       /**< largest displacement of the reference in this frame [m] */
    int32_t count;        /**< points that were compared */
    int32_t worst;        /**< where max is; -1: nothing was compared */
} pliant_error;

typedef struct pliant_results pliant_results;

/* ---- WHAT IS REPORTED ON */

typedef struct pliant_report_input {
    const pliant_scene *scene;
    const pliant_volume *scan;
    const pliant_labels *labels; /**< Nullable */
    const pliant_material_table *materials;
} pliant_report_input;

enum { PLIANT_MAX_PULLS = 8, PLIANT_MAX_SWEPT = 16, PLIANT_MAX_VARIED = 8 };

typedef struct pliant_pull_point {
    char name[32];
    double rest[3]; /**< LPS [m] */
} pliant_pull_point;

/** Points to pull at: the fronts of liver, colon and kidney where materials have these names (a label's own name is
 *  not known), or of given labels; else front points of soft tissue under the skin, spread out, the middle one first.
 *  @param labels (num_labels) Nullable: label ids instead
 *  @return how many were found, at most `most` */
PLIANT_API int pliant_pull_points(const pliant_report_input *input, const int32_t *labels, int num_labels, int most,
                                  pliant_pull_point *out);

typedef struct pliant_sweep {
    uint32_t methods; /**< bit m: pliant_method m */
    int32_t ratios[PLIANT_MAX_SWEPT], num_ratios;
    int32_t iterations[PLIANT_MAX_SWEPT], num_iterations; /**< a step's budget; 0: until the scene's tolerance is met */
    char option[64];                                      /**< one more option of the scene to vary; "": none */
    char values[PLIANT_MAX_VARIED][32];
    int32_t num_values;
    pliant_pull_point points[PLIANT_MAX_PULLS];
    int32_t num_points;
    uint32_t cases;           /**< of pulls by displacement, by force and by a spring (bits 0 to 2), gravity that turns (bit 3), and the
                               *   scene's own gravity, from rest, where it has one (bit 4) */
    double pull[3];           /**< where a pulled point ends, from where it was [m] */
    int32_t frames;           /**< of a pull; twice as many for gravity */
    double twice_limit;       /**< most fine tetrahedra of the mesh of twice the resolution that is still solved; 0: never */
    double reference_tolerance; /**< to which the references are solved; ten times that on the mesh of twice the resolution */
    double most_ms;           /**< of a median frame: larger budgets are left out when a run takes longer or converges; 0: none is */
    int32_t repeats;          /**< runs of the same; the quickest of each frame is told, for machines that do other work too */
    bool before_patch;        /**< where a scene asks for patches, pulls are run once more from when the tool takes hold: rows of a variant
                               *   of their own. Else they begin when the patch is there */
    bool own_time;            /**< CPU: times are those that the thread that steps ran, so that what other programs take does not count;
                               *   else the clock's. Runs are repeated only where there were some */
    bool paced;               /**< frames begin solver/step apart, as in a running simulation, not one at the end of the other */
    bool warp;                /**< the deformed volume is made in every frame and its time is told */
    int32_t shard, shards;    /**< the part that is run, 1 to shards: every so-manieth model; 0, 0: all */
} pliant_sweep;

/** All methods and cases, the scene's ratio, a few budgets, one point to pull at, 3 cm in 30 frames. The points are left to
 *  pliant_pull_points. */
PLIANT_API void pliant_sweep_defaults(const pliant_scene *scene, pliant_sweep *out);

/** Tables of a report; each begins with a column `setup`: pliant_report_setup. */
typedef struct pliant_report_tables {
    pliant_results *sweep;     /**< a row per case, method, ratio, variant and budget */
    pliant_results *frames;    /**< a row per frame of those */
    pliant_results *builds;    /**< a row per model: seconds and bytes of every stage */
    pliant_results *histogram; /**< per-voxel error in the warped image: bins */
    pliant_results *slices;    /**< the same in slices: names of .npy files */
    pliant_results *stages;    /**< what was left out */
    pliant_results *stability;
    pliant_results *choice;    /**< what pliant_choose took */
    pliant_results *dynamics;  /**< a row per setup: time steps and energy of explicit dynamics */
    pliant_results *truth;     /**< a row per case: error of the scene's mesh, beside that of its solver */
    pliant_results *validation; /**< a row per measured state: where markers were measured and where they are simulated */
} pliant_report_tables;

/** Opens folder/sweep.csv and so on. @param folder Nullable: in memory only. Errors: FILE, FORMAT, MEMORY. */
PLIANT_API pliant_status pliant_report_open(const char *folder, pliant_report_tables *out);
PLIANT_API void pliant_report_close(pliant_report_tables *tables);

/** folder/report.json: machine, threads, backend, version, and the rows of this setup. Errors: FILE. */
PLIANT_API pliant_status pliant_report_json(const char *folder, const char *setup, const pliant_scene *scene,
                                            const pliant_report_tables *tables);

/** Eight letters and digits that are the same only for the same scan, materials, scene (but method, ratio and iterations),
 *  pulls and version: rows of one setup are comparable. @param sweep Nullable */
PLIANT_API void pliant_report_setup(const pliant_report_input *input, const pliant_sweep *sweep, char out[9]);

/** Run what the sweep asks for and is not in the tables yet; slices of the per-voxel error go to folder as .npy.
 *  Errors: as of building and stepping; CANCELLED (rows done so far are kept). */
PLIANT_API pliant_status pliant_sweep_run(const pliant_report_input *input, const pliant_sweep *sweep, const char *folder,
                                          pliant_report_tables *tables, pliant_progress progress);

/* ---- CHOICE: the settings that a scene's budget allows (choice.c) */

enum { PLIANT_CHOICE_TEXT = 256 };
typedef struct pliant_choice {
    pliant_scene scene;          /**< with the settings that were taken; the scene's own when none were */
    bool made;                   /**< false: the scene does not ask for it, or nothing could be measured */
    char options[PLIANT_CHOICE_TEXT]; /**< what was taken: "model/method=fine mesh/coarse_cells=7,7,7 ...", each good for --set */
    double error;                /**< the one of the three that choose/measure names */
    double max, p95, rms;        /**< measured on the probe load, worst frame: over the body, as a fraction of the largest displacement */
    double later;                /**< as error, from when a hold has its patch and the tissue has sagged under the scene's gravity */
    double left_out;             /**< what the reference's own mesh is off by, estimated from three resolutions; 0: not known */
    double mesh;                 /**< what the mesh that was taken is off by, that included; the rest of error + left_out is the solver's or the method's */
    double seconds;              /**< median step of the probe load, without the deformed volume [s] */
    bool within_budget;          /**< false: nothing was, and this is the quickest */
    int32_t reference_tetrahedra; /**< of the fine mesh that errors are against */
    int32_t tried, dropped;      /**< methods and meshes; those that could not be measured */
} pliant_choice;

/** Try methods, cells, ratios and iterations on a probe load, as far as the scene's group `choose` lets them vary, and take the
 *  most accurate ones whose step keeps to choose/budget_ms. The probe load: a point of the body's front is pulled forward by 1 cm
 *  in ten frames, once by displacement, once by the force which that took; with a patch both from when the tool takes hold, and again
 *  when its patch is there. Where the scene has gravity, the first ten frames after a load, too. Errors are against the fine solution on a mesh of twice
 *  the scene's resolution where the mesh may vary and that is not too large, else on the scene's own. The largest error of a frame
 *  counts, with what the reference itself leaves out where three resolutions of the fine method tell it (Richardson), so that a budget is not spent on
 *  iterations below the error of the mesh; where those are within a factor of two of the least, the one from when patches are there and the tissue has sagged; within
 *  5 % of that the quicker settings are taken. Times are medians over frames that begin solver/step apart, on the CPU those that
 *  the thread ran, and what does less work than another takes no longer. What cannot be built or does not converge is dropped; when nothing can be measured, the scene's own settings are told, with a warning in the log.
 *  A scene without choose/budget_ms costs nothing.
 *  @param tables Nullable: rows of what was tried (sweep, frames, builds) and taken (choice) are added
 *  Errors: SCENE (no lattice, or explicit dynamics), MEMORY, CANCELLED. */
PLIANT_API pliant_status pliant_choose(const pliant_report_input *input, pliant_report_tables *tables,
                                       pliant_progress progress, pliant_choice *out);

/* ---- TRUTH (truth.c): what a mesh is off by from tissue that is not cut into elements */

typedef struct pliant_truth {
    pliant_error mesh;   /**< of the scene's fine mesh, solved tightly, against the extrapolation; its largest is of that */
    pliant_error solver; /**< of the scene's method and iterations, against the same mesh solved tightly */
    double order;        /**< that was seen */
} pliant_truth;

/** Pulls by displacement and by force at the sweep's points and the scene's own gravity, as far as the sweep has them, on three meshes: the
 *  scene's and as far as sweep->twice_limit goes finer ones, else coarser ones. A row a case says how far the mesh and how far the solver is off, which of
 *  the two is the larger, and which options would pay.
 *  @param tables Nullable; @param worst out: the case with the largest error of the mesh
 *  Errors: SCENE (explicit dynamics, an octree, or no three meshes), MEMORY, CANCELLED, FILE. */
PLIANT_API pliant_status pliant_truth_run(const pliant_report_input *input, const pliant_sweep *sweep, pliant_report_tables *tables, pliant_progress progress,
                                          pliant_truth *worst);

#ifdef __cplusplus
}
#endif
#endif
