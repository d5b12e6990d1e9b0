/** @file report.h
 *  Accuracy and run time on a given scan, and the choice of settings for a time budget. Link pliant::report.
 *
 *  Each figure is a row of a table. A complete row is on disk at once: an interrupted run continues with the next row.
 *  Errors are distances between the positions of the same tissue in two solutions [m]. Percentages refer to the largest
 *  displacement of the run or of the frame.
 */
#ifndef PLIANT_REPORT_H
#define PLIANT_REPORT_H

#include "pliant/data.h"

#ifdef __cplusplus
extern "C" {
#endif

/* ---- INPUT */

/** A scene with its inputs, all borrowed. */
typedef struct pliant_report_input {
    const pliant_scene *scene;
    const pliant_volume *scan;
    const pliant_labels *labels; /**< Nullable */
    const pliant_material_table *materials;
} pliant_report_input;

enum {
    PLIANT_MAX_PULLS = 8,  /**< maximum number of pulled points */
    PLIANT_MAX_SWEPT = 16, /**< maximum number of values of a swept quantity */
    PLIANT_MAX_VARIED = 8  /**< maximum number of values of a varied option */
};

/** A point to pull at. */
typedef struct pliant_pull_point {
    char name[32];
    double rest[3]; /**< LPS [m] */
} pliant_pull_point;

/** Find points to pull at. These are the fronts of liver, colon and kidney if materials have these names, or the fronts
 *  of given labels. Otherwise they are front points of soft tissue under the skin, spread out, with the middle one
 *  first.
 *  @param input      The scene with its inputs.
 *  @param labels     (num_labels) Nullable: label ids.
 *  @param num_labels Number of labels.
 *  @param maximum       Maximum number of points.
 *  @param out        (maximum) Out: the points.
 *  @return The number of points. */
PLIANT_API int pliant_pull_points(const pliant_report_input *input, const int32_t *labels, int num_labels, int maximum,
                                  pliant_pull_point *out);

/* ---- TABLES */

/** Distances between two solutions. */
typedef struct pliant_error {
    double max, rms, p95; /**< maximum, root mean square, 95th percentile [m] */
    double largest;       /**< largest displacement of the reference in this frame [m] */
    int32_t count;        /**< number of compared points */
    int32_t worst;        /**< point with the maximum; -1 without compared points */
} pliant_error;

typedef struct pliant_results pliant_results; /**< opaque: a table, also as a CSV file */

/** Tables of a report. Each table begins with a column `setup` (pliant_report_setup). */
typedef struct pliant_report_tables {
    pliant_results *sweep;     /**< one row per case, method, ratio, variant and budget */
    pliant_results *frames;    /**< one row per frame of each row of sweep */
    pliant_results *builds;    /**< one row per model: time and memory of every stage */
    pliant_results *histogram; /**< bins of the error per voxel in the deformed volume */
    pliant_results *slices;    /**< the same error in slices: names of .npy files */
    pliant_results *stages;    /**< time and memory without each stage */
    pliant_results *stability; /**< one row per case of the stability report */
    pliant_results *choice;    /**< settings that pliant_choose has selected */
    pliant_results *dynamics;  /**< one row per setup: time steps and energy of explicit dynamics */
    pliant_results *truth;     /**< one row per case: errors of mesh and solver */
    pliant_results *validation; /**< one row per measured state: measured and simulated positions of markers */
} pliant_report_tables;

/** Open the tables of a folder (folder/sweep.csv and so on), or create them.
 *  @param folder Nullable: the tables are in memory only.
 *  @param out    Out: close with pliant_report_close.
 *  @return Errors: FILE, FORMAT (other columns), MEMORY. */
PLIANT_API pliant_status pliant_report_open(const char *folder, pliant_report_tables *out);

/** Close the tables and zero the struct.
 *  @param tables The tables. */
PLIANT_API void pliant_report_close(pliant_report_tables *tables);

/* ---- SWEEPS: error against run time */

/** Variants of a sweep. */
typedef struct pliant_sweep {
    uint32_t methods; /**< bit m: pliant_method m */
    int32_t ratios[PLIANT_MAX_SWEPT];     /**< (num_ratios) values of mesh/ratio */
    int32_t num_ratios;
    int32_t iterations[PLIANT_MAX_SWEPT]; /**< (num_iterations) budgets of a step; 0: until the scene's tolerance is
                                           *   met */
    int32_t num_iterations;
    char option[64];                      /**< another option of the scene to vary; "": none */
    char values[PLIANT_MAX_VARIED][32];   /**< (num_values) values of this option */
    int32_t num_values;
    pliant_pull_point points[PLIANT_MAX_PULLS]; /**< (num_points) points to pull at */
    int32_t num_points;
    uint32_t cases;           /**< bits: 0 pulls by displacement, 1 by force, 2 by a spring, 3 turning gravity, 4 the
                               *   scene's own gravity from rest */
    double pull[3];           /**< displacement of a pulled point at the end, LPS [m] */
    int32_t frames;           /**< frames of a pull; gravity has twice as many */
    double max_refined_tets;  /**< maximum number of fine tetrahedra of a mesh with twice the resolution; 0: no such
                               *   mesh */
    double reference_tolerance; /**< tolerance of the references; ten times this value on the mesh with twice the
                                 *   resolution */
    double max_ms;           /**< time of a median frame above which larger budgets are skipped [ms]; 0: none is
                               *   skipped */
    int32_t repeats;          /**< number of equal runs; the shortest time of each frame counts */
    bool before_patch;        /**< with model/patch: also run pulls that begin before the patch is ready, as separate
                               *   rows */
    bool uses_thread_time;    /**< CPU: measure the time of the stepping thread; otherwise measure wall time. Runs are
                               *   repeated only in case of disturbance */
    bool paced;               /**< frames begin solver/step apart, as in a running simulation; otherwise without
                               *   pauses */
    bool warp;                /**< also make and time the deformed volume of every frame */
    int32_t shard, shards;    /**< part of the models to run, 1 to shards; 0, 0: all */
} pliant_sweep;

/** Set the defaults of a sweep: all methods and cases, the scene's ratio, a few budgets, one point, 3 cm in 30 frames.
 *  pliant_pull_points finds the points.
 *  @param scene The scene.
 *  @param out   Out: the sweep, without points. */
PLIANT_API void pliant_sweep_defaults(const pliant_scene *scene, pliant_sweep *out);

/** Run all rows of a sweep that are not in the tables.
 *  @param input    The scene with its inputs.
 *  @param sweep    The variants.
 *  @param folder   Nullable: no slices. Folder for slices of the error per voxel (.npy).
 *  @param tables   In/out: sweep, frames, builds, histogram and slices get rows. Rows before an error are kept.
 *  @param progress Callback; it can cancel the call.
 *  @return Errors: as of pliant_model_build and pliant_step, FILE, CANCELLED. */
PLIANT_API pliant_status pliant_sweep_run(const pliant_report_input *input, const pliant_sweep *sweep,
                                          const char *folder, pliant_report_tables *tables, pliant_progress progress);

/** Compute the name of a setup: eight letters and digits. They are equal only for equal scans, materials, pulls,
 *  versions and scenes. Method, ratio and iterations may differ. Rows of one setup are comparable.
 *  @param input The scene with its inputs.
 *  @param sweep Nullable.
 *  @param out   (9) Out: the name, with a final 0. */
PLIANT_API void pliant_report_setup(const pliant_report_input *input, const pliant_sweep *sweep, char out[9]);

/** Write folder/report.json: machine, threads, backend, version, and the rows of a setup.
 *  @param folder The folder.
 *  @param setup  Name from pliant_report_setup.
 *  @param scene  The scene.
 *  @param tables The tables.
 *  @return Errors: FILE. */
PLIANT_API pliant_status pliant_report_json(const char *folder, const char *setup, const pliant_scene *scene,
                                            const pliant_report_tables *tables);

/* ---- TRUTH: error of a mesh, by extrapolation */

/** Errors of a scene's mesh and of its solver. */
typedef struct pliant_truth {
    pliant_error mesh;   /**< the scene's fine mesh, solved tightly, against the extrapolation */
    pliant_error solver; /**< the scene's method and iterations, against the same mesh solved tightly */
    double order;        /**< observed order of convergence */
    pliant_error laws; /**< the other element/law, extrapolated, against the scene's; zero: no other law is possible */
} pliant_truth;

/** Estimate the error of a mesh by Richardson's extrapolation over three meshes. They are the scene's
 *  mesh and finer meshes with up to sweep->max_refined_tets tetrahedra, or else coarser meshes. Loads are the
 *  sweep's pulls by displacement and force, and the scene's gravity. Each row gives the errors of mesh and solver, the
 *  larger one, and the options that reduce it. Elements of the fine mesh can have two laws (element/law). Then more
 *  rows contain the same for the law that is not the scene's, and the distance between both.
 *  @param input    The scene with its inputs.
 *  @param sweep    Points and loads.
 *  @param tables   Nullable, in/out: truth gets rows.
 *  @param progress Callback; it can cancel the call.
 *  @param worst    Out: the case with the largest error of the mesh, of the scene's law; the largest distance of laws.
 *  @return Errors: SCENE (explicit dynamics, an octree, or no three meshes), MEMORY, CANCELLED, FILE. */
PLIANT_API pliant_status pliant_truth_run(const pliant_report_input *input, const pliant_sweep *sweep,
                                          pliant_report_tables *tables, pliant_progress progress, pliant_truth *worst);

/* ---- CHOICE: settings for a time budget */

enum { PLIANT_CHOICE_TEXT = 256 /**< size of pliant_choice.options */ };

/** Selected settings and their measured error. Errors are fractions of the largest displacement. */
typedef struct pliant_choice {
    pliant_scene scene;          /**< with the selected settings; unchanged if made is false */
    bool made;                   /**< false: the scene has no choose/budget_ms, or no candidate could be measured */
    char options[PLIANT_CHOICE_TEXT]; /**< selected settings: "model/method=fine mesh/coarse_cells=7,7,7 ...", each
                                       *   valid for --set */
    double error;                /**< max, p95 or rms, as choose/measure names it */
    double max, p95, rms;        /**< worst frame of the probe load, over the body */
    double settled_error;        /**< as error, from the time when patches are ready and the tissue has sagged under
                                  *   gravity */
    double reference_error;      /**< error of the reference's own mesh, estimated from three resolutions; 0: unknown */
    double mesh;                 /**< error of the selected mesh, including reference_error. The solver or the method
                                  *   causes the rest of error + reference_error */
    double seconds;              /**< median step of the probe load, without the deformed volume [s] */
    bool within_budget;          /**< false: no candidate was within the budget, and this is the fastest one */
    int32_t reference_tetrahedra; /**< number of fine tetrahedra of the reference */
    int32_t tried, dropped;      /**< number of measured candidates; number of candidates that could not be measured */
} pliant_choice;

/** Select the most accurate settings whose step stays within choose/budget_ms. Methods, cells, ratios and iterations
 *  vary as the scene's group `choose` allows. A scene without choose/budget_ms returns at once.
 *
 *  - Probe load: a point of the body's front is pulled by 1 cm in ten frames, by displacement and then by the resulting
 *    force. With a patch, the pulls run from the grasp on, and again when the patch is ready. With gravity, the first
 *    ten frames after a load count too.
 *  - Reference: the fine solution on a mesh of twice the resolution, if the mesh may vary and this mesh is not too
 *    large. Otherwise it is the fine solution on the scene's mesh.
 *  - Error: the worst frame, plus the reference's own error (Richardson), so that no time is spent on iterations below
 *    the mesh's error. Among candidates within a factor of two of the minimum, the smallest `settled_error` wins;
 *    within 5 % of it, the fastest candidate wins.
 *  - Time: the median over frames that begin solver/step apart; on the CPU, the time of the thread.
 *
 *  Candidates that cannot be built or do not converge are dropped. If no candidate can be measured, the scene's
 *  settings are returned with a warning in the log.
 *  @param input    The scene with its inputs.
 *  @param tables   Nullable, in/out: sweep, frames, builds and choice get rows.
 *  @param progress Callback; it can cancel the call.
 *  @param out      Out: the choice.
 *  @return Errors: SCENE (no lattice, or explicit dynamics), MEMORY, CANCELLED. */
PLIANT_API pliant_status pliant_choose(const pliant_report_input *input, pliant_report_tables *tables,
                                       pliant_progress progress, pliant_choice *out);

#ifdef __cplusplus
}
#endif
#endif
