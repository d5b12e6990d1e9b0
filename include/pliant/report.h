/** @file report.h
 *  Accuracy against run time on a scan of the user's own, what breaks the solver, and what each stage costs.
 *
 *  Every figure is a row of a table (pliant_results) that is kept on disk as it is made: a run that was stopped goes on
 *  where it ended. Errors are distances [m] between where two solutions place the same tissue; percentages are formed by
 *  whoever reads the rows, of the largest displacement of the whole run or of the frame's own.
 */
#ifndef PLIANT_REPORT_H
#define PLIANT_REPORT_H

#include "pliant/path.h"

#ifdef __cplusplus
extern "C" {
#endif

/* ---- POINTS: the same tissue in meshes of different method or resolution (points.c) */

/** Points of the body at rest and the nodes that they follow: x = sum of weights . positions. */
typedef struct pliant_points {
    int32_t count, num_found;
    int32_t *nodes;  /**< (count x 4) */
    double *weights; /**< (count x 4) barycentric; all zero where the mesh holds no tissue */
    uint8_t *found;  /**< (count) 1: the mesh holds the point */
} pliant_points;

/** Nodes of the fine mesh whose tetrahedra hold tissue, at rest: where errors are measured.
 *  @param rest (count x 3) LPS [m], out; free with pliant_free. Errors: MEMORY, SCENE (no tissue). */
PLIANT_API pliant_status pliant_body_points(const pliant_model *model, int32_t *count, double **rest);

/** Find points in a mesh: lattice nodes by their place, so that nested grids agree exactly, all others by barycentric
 *  coordinates. @param rest (count x 3) LPS [m]. Errors: ARGUMENT (count < 1), MEMORY. */
PLIANT_API pliant_status pliant_points_create(const pliant_mesh *mesh, int32_t count, const double *rest, pliant_points *out);
PLIANT_API void pliant_points_free(pliant_points *points); /**< Nullable; leaves the struct zeroed */
/** Where the points are at these positions of the mesh; (0, 0, 0) for those that it does not hold.
 *  @param positions (nodes of the mesh x 3) [m]; @param out (count x 3) [m] */
PLIANT_API void pliant_points_move(const pliant_points *points, const double *positions, double *out);

/* ---- ERROR (error.c, voxel_error.c) */

typedef struct pliant_error {
    double max, rms, p95; /**< [m] */
    double largest;       /**< largest displacement of the reference in this frame [m] */
    int32_t count;        /**< points that were compared */
    int32_t worst;        /**< where max is; -1: nothing was compared */
} pliant_error;

/** Distance between two solutions, point by point. p95 is the smallest value that 95 % of the points do not exceed.
 *  @param use Nullable: (count) nonzero for the points that count
 *  @param rest, reference, other (count x 3) LPS [m]. Errors: MEMORY, NUMERIC (a position is not finite). */
PLIANT_API pliant_status pliant_error_between(int32_t count, const uint8_t *use, const double *rest, const double *reference,
                                              const double *other, pliant_error *out);

/** Error in the warped image, figure 2 of [H]: for every voxel of the deformed volume that shows tissue, the distance
 *  between the voxel and where the reference places the tissue that is seen there. Voxels without tissue are -1.
 *  The lowest tetrahedron draws, as in pliant_warp_update.
 *  @param model, positions  the solution that is shown
 *  @param reference_mesh, reference  the other one; tissue that it does not hold counts as none
 *  @param out FLOAT32 volume on the target grid [m]; free with pliant_volume_free. Errors: ARGUMENT, MEMORY. */
PLIANT_API pliant_status pliant_error_voxels(const pliant_model *model, const double *positions, const pliant_mesh *reference_mesh,
                                             const double *reference, const pliant_geometry *target, pliant_volume *out);

/** Count the voxels of an error volume. counts[b] holds b * width <= error < (b + 1) * width, the last bin the rest too.
 *  @param summary Nullable; its `largest` and `worst` are 0 and -1. Errors: ARGUMENT, MEMORY. */
PLIANT_API pliant_status pliant_error_histogram(const pliant_volume *error, int32_t bins, double width, uint64_t *counts,
                                                pliant_error *summary);

/** The slice through a point, as it is looked at: axis 2 axial (anterior up, patient left on the right), 1 coronal and
 *  0 sagittal (superior up). The voxel axes nearest to the anatomical ones are taken.
 *  @param size columns, rows; @param spacing of the same [m]
 *  @param out (rows x columns) values, slope and intercept applied; free with pliant_free. Errors: ARGUMENT, MEMORY. */
PLIANT_API pliant_status pliant_volume_plane(const pliant_volume *volume, int axis, const double world[3], int32_t size[2],
                                             double spacing[2], float **out);

/* ---- RESULTS: tables that survive a stop (results.c) */

typedef struct pliant_results pliant_results;

/** Open a CSV table, or go on with the one that is there.
 *  @param path    Nullable: in memory only
 *  @param columns (num_columns) names; the first num_keys of them make the key of a row
 *  Errors: FILE, FORMAT (the file has other columns), MEMORY. */
PLIANT_API pliant_status pliant_results_open(const char *path, const char *const *columns, int num_columns, int num_keys,
                                             pliant_results **out);
/** The whole table as a CSV file, over what is there. Errors: FILE. */
PLIANT_API pliant_status pliant_results_write(const pliant_results *results, const char *path);
/** Whether a row with this key (num_keys texts) is there. */
PLIANT_API bool pliant_results_has(const pliant_results *results, const char *const *key);
/** Add a row (num_columns texts); it is on disk, for a table of a file, when this returns. Errors: FILE, MEMORY. */
PLIANT_API pliant_status pliant_results_add(pliant_results *results, const char *const *cells);
PLIANT_API size_t pliant_results_rows(const pliant_results *results);
PLIANT_API int pliant_results_columns(const pliant_results *results);
/** Index of a column; -1: there is none of this name. */
PLIANT_API int pliant_results_column(const pliant_results *results, const char *name);
PLIANT_API const char *pliant_results_cell(const pliant_results *results, size_t row, int column);
/** The rows as a JSON array of objects; cells that are numbers become numbers, empty ones null.
 *  @param file  FILE* of stdio, not closed
 *  @param first Nullable: only rows whose first column is this. Errors: FILE. */
PLIANT_API pliant_status pliant_results_json(const pliant_results *results, const char *first, void *file);
PLIANT_API void pliant_results_close(pliant_results *results); /**< Nullable */

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
/** The tables as they are to folder/sweep.csv and so on, over what is there. Errors: FILE. */
PLIANT_API pliant_status pliant_report_write(const char *folder, const pliant_report_tables *tables);
/** Rows of another report, with the slices that they name, that are not in this one: sweeps that were run in parts.
 *  @param from, folder  the other's folder, and this one's. Errors: FILE, FORMAT, MEMORY. */
PLIANT_API pliant_status pliant_report_merge(const char *from, const char *folder, const pliant_report_tables *tables);
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

/** Time and memory of the scene as it is, without each of its stages in turn, and without all of them.
 *  Errors: as of building and stepping; CANCELLED. */
PLIANT_API pliant_status pliant_left_out_run(const pliant_report_input *input, const pliant_sweep *sweep, pliant_report_tables *tables,
                                             pliant_progress progress);

/** Explicit dynamics as the scene has it, through a pull that is let go: bounds of its time step, steps a frame, times; what its time
 *  integration is off by, from the same run with half the sub-step (Richardson: 4/3 of how far the two are apart, worst node and frame);
 *  and without damping the drift of its energy. What the core refuses is a row.
 *  Errors: SCENE (another solver/kind), ARGUMENT (no point), CANCELLED, FILE, MEMORY. */
PLIANT_API pliant_status pliant_dynamics_run(const pliant_report_input *input, const pliant_sweep *sweep, pliant_report_tables *tables,
                                             pliant_progress progress);

/* ---- TRUTH (truth.c): what a mesh is off by from tissue that is not cut into elements */

/** Where points would be on a mesh of endless resolution, from three meshes of which each has twice the resolution of the one before
 *  (Richardson): the next differences fall by 2^-p, p between the order that the last two differences show and the theory's 2.
 *  @param use Nullable: nonzero for points that the order is measured at
 *  @param coarse, middle, fine (count x 3) [m]; @param out (count x 3)
 *  @return the order that was seen */
PLIANT_API double pliant_extrapolate(int32_t count, const uint8_t *use, const double *coarse, const double *middle, const double *fine, double *out);

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

/* ---- MODULI (moduli.c): how stiff materials are, from where points of the tissue were measured */

enum { PLIANT_MAX_MODULI = 8 };

/** A point whose displacement was measured. */
typedef struct pliant_marker {
    int32_t load;                /**< under which load, from 0 */
    double rest[3], moved[3];    /**< point of the tissue, and displacement of the marker (deformed minus rest position), LPS [m] */
    double deviation;            /**< standard deviation of each of the three numbers [m] */
    double offset[3];            /**< from the tissue's point to the marker's centre: it turns with the tissue; zero: the marker is the point [m] */
    int32_t line;                /**< in the file that it was read from, for messages; 0: none */
} pliant_marker;

typedef struct pliant_moduli_data {
    int32_t num_loads;
    const pliant_path *loads;    /**< Nullable: the scene's own gravity. (num_loads) a load is where a path ends: its gravity, its tools */
    int32_t num_markers;
    const pliant_marker *markers;
} pliant_moduli_data;

typedef struct pliant_moduli {
    int32_t count, passes;
    double young[PLIANT_MAX_MODULI];                       /**< [Pa] */
    double low[PLIANT_MAX_MODULI], high[PLIANT_MAX_MODULI]; /**< the true one is in between with a probability of 95 %, if the rest of the model is right */
    double correlation[PLIANT_MAX_MODULI][PLIANT_MAX_MODULI];
    double misfit;               /**< sum of squared residuals over deviations, over the degrees of freedom: far above 1 the model, or a deviation, is wrong */
    double rms;                  /**< of the distances that are left [m] */
} pliant_moduli;

/** Read markers from a table, one marker per line: load,x,y,z,moved_x,moved_y,moved_z and maybe the deviation. Loads count from 1. x, y, z is the
 *  position at rest. moved_x, moved_y, moved_z is the displacement: the deformed minus the rest position. Lengths are in metres. Cells are separated by commas, semicolons or tabs. Lines that begin with # are comments. A first line that
 *  begins with "load" is a header. A byte order mark is skipped.
 *  @param deviation where a line has none. Free with pliant_free. Errors: FILE, FORMAT (names line, column, value and remedy), MEMORY. */
PLIANT_API pliant_status pliant_markers_read(const char *path, double deviation, int32_t *count, pliant_marker **out);

/** Young's moduli of `count` named materials that bring the scene's tissue, at rest under each load, nearest to the markers: Gauss-Newton on their logarithms
 *  from those of the table on, sensitivities by differences. A modulus is that of the scene's mesh: pliant_truth_run tells what that is off by.
 *  A misfit above 9 is logged as a warning: the residuals are then three times as large as the deviations.
 *  Errors: ARGUMENT (names, markers outside of the tissue), NUMERIC (nothing measured tells of a material), those of building and stepping, CANCELLED.
 *  NOT_CONVERGED: *out is the best that was found. */
PLIANT_API pliant_status pliant_moduli_fit(const pliant_report_input *input, const pliant_moduli_data *data, int32_t count, const char *const *names,
                                           pliant_progress progress, pliant_moduli *out);

/* ---- VALIDATION (validation.c): measured bodies, fitted on one state, predicted in the others */

/** What is measured in a folder, or, where nothing is, in its folders: its kind is told from the files in it, each table is a body of its own.
 *  Cells of a table are parted by tabs, semicolons or commas, whichever its header has first in this order; a comma in a cell is a decimal one.
 *  - gravity_markers.csv, or any .csv whose header has a column beam_x: silicone beams of 30 x 30 x 100 mm, 1070 kg/m^3, clamped
 *    and released under their own weight, a state a recording: columns recording (may be missing: then there is one), marker, state (rest, end; others are left out with a warning) and
 *    beam_x, beam_y, beam_z [m], in any order among others; the beam between x -0.1 (clamp) and 0, y and z 0 to 0.03, z up; markers Base* are on
 *    the clamp, one without both states is left out. Young's modulus is fitted on the first recording.
 *  - truthcube*.csv, or any .csv with a line that names strains: beads in a cube of 80 mm between plates across z (Kerdok et al. 2003, Medical Image
 *    Analysis 7): a line that names states above their first columns, 'no strain' and 'N% strain' in any order, then lines of beads [mm]; one that
 *    was lost in a state has no numbers there, 4 at least in each. Displacements say nothing of a modulus: Poisson's ratio is fitted, on
 *    the state that stands first. A rigid motion of all beads is left out of every state: how the scanner lay to the plates is not known.
 *  - scene.yaml, scan.* and markers.csv (pliant_markers_read), and for each load load_1.yaml, load_2.yaml, ... (pliant_path_read), or none for
 *    the scene's own gravity: moduli of the materials are fitted on the first load.
 *  Rows go to tables->validation: a state with how far the markers moved and how far the simulation is from where they were measured (root mean
 *  square and largest [mm]), beside what the measurement itself is good for: its spread (over recordings of the same state, or about a smooth field
 *  where hundreds of beads were measured) and the deviation that its notes tell.
 *  @param names (count) materials of a scene.yaml to fit; 0: all that are not empty and not fixed
 *  Errors: FILE (no folder, or nothing in it that is known), FORMAT, those of pliant_moduli_fit, CANCELLED. */
PLIANT_API pliant_status pliant_validation_run(const char *folder, int32_t count, const char *const *names, pliant_report_tables *tables,
                                               pliant_progress progress);

/* ---- STABILITY */

typedef enum pliant_verdict {
    PLIANT_VERDICT_CONVERGED, /**< every step ended well, and the body came to rest where it should */
    PLIANT_VERDICT_REFUSED,   /**< an error, told; the state before it was kept */
    PLIANT_VERDICT_DEGRADED,  /**< went on with a caveat, told */
    PLIANT_VERDICT_BROKEN     /**< not finite, state lost, or memory lost: a defect */
} pliant_verdict;
PLIANT_API const char *pliant_verdict_name(pliant_verdict verdict);

typedef struct pliant_stability {
    uint32_t methods;      /**< bit m: pliant_method m */
    const char *only;      /**< Nullable: the one case to run */
    int64_t long_steps;    /**< of the long run */
    int32_t settle_steps;  /**< most steps that a body may take to come to rest */
    const pliant_scene *scene; /**< Nullable; with solver/kind tled: its options are those of every trial, by dynamic relaxation */
} pliant_stability;
PLIANT_API void pliant_stability_defaults(pliant_stability *out);

/** Names of the cases, in order; NULL after the last. */
PLIANT_API const char *pliant_stability_case(int index);

/** Every case that is not in tables->stability yet. Cases that vary the load run on the input's body, all others on
 *  bodies of their own.
 *  @param input Nullable: a small block with a hard inclusion instead
 *  @param worst out, the worst verdict of this setup's rows. Errors: CANCELLED, FILE, MEMORY. */
PLIANT_API pliant_status pliant_stability_run(const pliant_report_input *input, const pliant_stability *options,
                                              pliant_report_tables *tables, pliant_progress progress, pliant_verdict *worst);

#ifdef __cplusplus
}
#endif
#endif
