/* Internal functions of the report library and its programs, in addition to pliant/report.h. */
#ifndef PLIANT_REPORT_REPORT_H
#define PLIANT_REPORT_REPORT_H

#include "base/export.h"
#include "pliant/report.h"
#include "tool/path.h"

#ifdef __cplusplus
extern "C" {
#endif

/* ---- POINTS: the same tissue in meshes of different method or resolution (points.c) */

/* Points of the body at rest, as weighted sums of node positions. */
typedef struct pliant_points {
    int32_t count, num_found;
    int32_t *nodes;  /* (count x 4) */
    double *weights; /* (count x 4) barycentric; all zero if no tetrahedron contains the point */
    uint8_t *found;  /* (count) 1: a tetrahedron contains the point */
} pliant_points;

/* Return the rest positions of the fine nodes of tetrahedra with tissue. Errors are measured at these points.
 *   @param rest (count x 3) LPS [m], out; free with pliant_free. Errors: MEMORY, SCENE (no tissue). */
pliant_status pliant_body_points(const pliant_model *model, int32_t *count, double **rest);

/* Find points in a mesh. Lattice nodes match exactly by their coordinates, so nested grids agree exactly. Other points
 * get barycentric coordinates.
 *   @param rest (count x 3) LPS [m]. Errors: ARGUMENT (count < 1), MEMORY. */
PLIANT_INTERNAL pliant_status pliant_points_create(const pliant_mesh *mesh, int32_t count, const double *rest,
                                                   pliant_points *out);

PLIANT_INTERNAL void pliant_points_free(pliant_points *points); /* Nullable; leaves the struct zeroed */

/* Compute the points for these positions of the mesh; (0, 0, 0) for points outside of the mesh.
 *   @param positions (nodes of the mesh x 3) [m]
 *   @param out (count x 3) [m] */
PLIANT_INTERNAL void pliant_points_move(const pliant_points *points, const double *positions, double *out);

/* ---- ERROR (error.c, voxel_error.c) */

/* Compute the point-wise distance between two solutions. p95 is the smallest value that 95 % of the points do not
 * exceed.
 *   @param use Nullable: (count) nonzero for included points
 *   @param rest, reference, other (count x 3) LPS [m]
 * Errors: MEMORY, NUMERIC (a position is not finite). */
pliant_status pliant_error_between(int32_t count, const uint8_t *use, const double *rest, const double *reference,
                                              const double *other, pliant_error *out);

/* Compute the error in the warped image, figure 2 of [H]. Each voxel of the deformed volume shows some tissue. Its
 * error is the distance between the voxel and the reference position of this tissue. Voxels without tissue are -1. The
 * tetrahedron with the lowest index draws, as in pliant_warp_update.
 *   @param model, positions  the displayed solution
 *   @param reference_mesh, reference  the reference solution; tissue outside of its mesh is ignored
 *   @param out FLOAT32 volume on the target grid [m]; free with pliant_volume_free
 * Errors: ARGUMENT, MEMORY. */
PLIANT_INTERNAL pliant_status pliant_error_voxels(const pliant_model *model, const double *positions,
                                                  const pliant_mesh *reference_mesh, const double *reference,
                                                  const pliant_geometry *target, pliant_volume *out);

/* Count the voxels of an error volume by error. counts[b] counts b * width <= error < (b + 1) * width, and the last bin
 * includes all larger errors.
 *   @param summary Nullable; its `largest` and `worst` are 0 and -1. Errors: ARGUMENT, MEMORY. */
PLIANT_INTERNAL pliant_status pliant_error_histogram(const pliant_volume *error, int32_t bins, double width,
                                                     uint64_t *counts, pliant_error *summary);

/* Return the slice through a point in its viewing orientation. It uses the voxel axes nearest to the anatomical axes.
 *   @param axis 2: axial (anterior up, patient's left on the right), 1: coronal, 0: sagittal (superior up)
 *   @param size columns, rows
 *   @param spacing of columns and rows [m]
 *   @param out (rows x columns) values, slope and intercept applied; free with pliant_free
 * Errors: ARGUMENT, MEMORY. */
pliant_status pliant_volume_plane(const pliant_volume *volume, int axis, const double world[3], int32_t size[2],
                                             double spacing[2], float **out);

/* ---- RESULTS: tables that an interruption keeps complete (results.c) */

/* Open a CSV table, and continue an existing file.
 *   @param path    Nullable: in memory only
 *   @param columns (num_columns) names; the first num_keys columns are the key of a row
 * Errors: FILE, FORMAT (the file has other columns), MEMORY. */
pliant_status pliant_results_open(const char *path, const char *const *columns, int num_columns, int num_keys,
                                             pliant_results **out);

/* Write the whole table as a CSV file, and overwrite an existing file. Errors: FILE. */
pliant_status pliant_results_write(const pliant_results *results, const char *path);

/* Return whether a row with this key (num_keys texts) exists. */
bool pliant_results_has(const pliant_results *results, const char *const *key);

/* Add a row (num_columns texts). A table with a file writes it to disk before the function returns. Errors: FILE,
 * MEMORY. */
pliant_status pliant_results_add(pliant_results *results, const char *const *cells);

PLIANT_INTERNAL size_t pliant_results_rows(const pliant_results *results);

int pliant_results_columns(const pliant_results *results);

/* Return the index of a column; -1: no column has this name. */
PLIANT_INTERNAL int pliant_results_column(const pliant_results *results, const char *name);

PLIANT_INTERNAL const char *pliant_results_cell(const pliant_results *results, size_t row, int column);

/* Write the rows as a JSON array of objects. Numeric cells become numbers, and empty cells become null.
 *   @param file  FILE* of stdio, not closed
 *   @param first Nullable: only rows with this first column. Errors: FILE. */
pliant_status pliant_results_json(const pliant_results *results, const char *first, void *file);

void pliant_results_close(pliant_results *results); /* Nullable */

/* ---- TABLES of a report */

/* Write the tables to folder/sweep.csv and so on, and overwrite existing files. Errors: FILE. */
PLIANT_INTERNAL pliant_status pliant_report_write(const char *folder, const pliant_report_tables *tables);

/* Add the missing rows of another report and the slices that they name. This merges the parts of a sweep.
 *   @param from, folder  folder of the other report, and of this one
 * Errors: FILE, FORMAT, MEMORY. */
PLIANT_INTERNAL pliant_status pliant_report_merge(const char *from, const char *folder,
                                                  const pliant_report_tables *tables);

/* ---- STAGES AND DYNAMICS */

/* Measure time and memory of the scene with all stages, without each single stage, and without all stages.
 * Errors: those of building and stepping; CANCELLED. */
PLIANT_INTERNAL pliant_status pliant_ablation_run(const pliant_report_input *input, const pliant_sweep *sweep,
                                                  pliant_report_tables *tables, pliant_progress progress);

/* Measure explicit dynamics of the scene during a pull and a release: bounds of its time step, steps per frame and
 * times. It also measures the time integration error. The error comes from the same run with half the sub-step
 * (Richardson: 4/3 of the distance between the two runs, at the worst node and frame). Without damping, the energy
 * drift is also measured. A case that the library refuses becomes a row.
 * Errors: SCENE (another solver/kind), ARGUMENT (no point), CANCELLED, FILE, MEMORY. */
PLIANT_INTERNAL pliant_status pliant_dynamics_run(const pliant_report_input *input, const pliant_sweep *sweep,
                                                  pliant_report_tables *tables, pliant_progress progress);

/* ---- TRUTH (truth.c) */

/* Extrapolate points to infinite resolution (Richardson). Each of the three meshes has twice the resolution of the
 * previous one. The differences then fall by 2^-p. p is the mean of the observed order and of the theoretical order 2.
 *   @param use Nullable: nonzero for points that determine the order
 *   @param coarse, middle, fine (count x 3) [m]
 *   @param out (count x 3)
 * Return the observed order. */
double pliant_extrapolate(int32_t count, const uint8_t *use, const double *coarse, const double *middle,
                          const double *fine, double *out);

/* ---- MODULI (moduli.c): Young's moduli of materials from measured points of the tissue */

enum { PLIANT_MAX_MODULI = 8 };

/* A point with a measured displacement. */
typedef struct pliant_marker {
    int32_t load;                /* index of the load, from 0 */
    /* point of the tissue, and displacement of the marker (deformed minus rest position), LPS [m] */
    double rest[3], moved[3];
    double deviation;            /* standard deviation of each component [m] */
    /* from the point of the tissue to the marker's centre, rotating with the tissue; zero: the marker is the point
     * [m] */
    double offset[3];
    int32_t line;                /* line of its file, for messages; 0: none */
} pliant_marker;

typedef struct pliant_moduli_data {
    int32_t num_loads;
    /* (num_loads) Nullable: the scene's own gravity. The gravity and tools at the end of each path are a load */
    const pliant_path *loads;
    int32_t num_markers;
    const pliant_marker *markers;
} pliant_moduli_data;

typedef struct pliant_moduli {
    int32_t count, passes;
    double young[PLIANT_MAX_MODULI];                       /* [Pa] */
    /* 95 % confidence interval, if the rest of the model is right */
    double low[PLIANT_MAX_MODULI], high[PLIANT_MAX_MODULI];
    double correlation[PLIANT_MAX_MODULI][PLIANT_MAX_MODULI];
    /* sum of squared residuals over deviations, over the degrees of freedom; far above 1: the model or a deviation is
     * wrong */
    double misfit;
    double rms;                  /* of the remaining distances [m] */
} pliant_moduli;

/* Read markers from a table, one marker per line: load,x,y,z,moved_x,moved_y,moved_z and optionally the deviation.
 * Loads count from 1. x, y, z is the position at rest. moved_x, moved_y, moved_z is the displacement: the deformed
 * minus the rest position. Lengths are in metres. Cells are separated by commas, semicolons or tabs. Lines that begin
 * with # are comments. A first line that begins with "load" is a header. A byte order mark is skipped.
 *   @param deviation default for lines without a deviation
 *   @param out free with pliant_free
 * Errors: FILE, FORMAT (names line, column, value and remedy), MEMORY. */
PLIANT_INTERNAL pliant_status pliant_markers_read(const char *path, double deviation, int32_t *count,
                                                  pliant_marker **out);

/* Fit the Young's moduli of `count` named materials to the markers. For each load the tissue is in static equilibrium.
 * Gauss-Newton iterations on the logarithms start at the table's moduli, with sensitivities by finite differences. The
 * result depends on the scene's mesh: pliant_truth_run estimates the mesh's error. A misfit above 9 (residuals three
 * times as large as the deviations) logs a warning.
 * Errors: ARGUMENT (names, markers outside of the tissue), NUMERIC (the measurements do not determine a material),
 * those of building and stepping, CANCELLED. NOT_CONVERGED: *out is the best result. */
PLIANT_INTERNAL pliant_status pliant_moduli_fit(const pliant_report_input *input, const pliant_moduli_data *data,
                                                int32_t count, const char *const *names, pliant_progress progress,
                                                pliant_moduli *out);

/* ---- VALIDATION (validation.c): measured bodies, fitted to one state, predicted in the others */

/* Validate the measured bodies of a folder, or of its subfolders if it has none itself. The files determine the kind of
 * measurement. Each table is a separate body. Cells are separated by tabs, semicolons or commas: the first of these in
 * the header counts. A comma within a cell is a decimal comma.
 *   - gravity_markers.csv, or any .csv whose header has a column beam_x: silicone beams of 30 x 30 x 100 mm,
 *     1070 kg/m^3, clamped and released under their own weight. Each recording is a state. Columns, in any order
 *     among others: recording (optional), marker, state (rest or end; others are skipped with a warning), beam_x,
 *     beam_y, beam_z [m].
 *     The beam lies between x -0.1 (clamp) and 0, y and z 0 to 0.03, z up. Markers Base* are on the clamp. A marker
 *     without both states is skipped. Young's modulus is fitted to the first recording.
 *   - truthcube*.csv, or any .csv with a line that names strains: beads in a cube of 80 mm between plates across z
 *     (Kerdok et al. 2003, Medical Image Analysis 7). A line names the states above their first columns, 'no strain'
 *     and 'N% strain' in any order. Lines of beads [mm] follow. A lost bead has empty cells, and each state needs
 *     4 beads. Displacements do not determine a modulus, so Poisson's ratio is fitted to the first state. A rigid
 *     motion of all beads is removed from every state, because the pose of the scanner is unknown.
 *   - scene.yaml, scan.* and markers.csv (pliant_markers_read), and for each load load_1.yaml, load_2.yaml, ...
 *     (pliant_path_read), or none for the scene's own gravity. The moduli are fitted to the first load.
 * Each state becomes a row of tables->validation. It contains the motion of the markers and the distance between
 * simulation and measurement (root mean square and maximum [mm]). It also contains the measurement's spread, over
 * recordings of the same state or about a smooth field of hundreds of beads, and the deviation in its notes.
 *   @param names (count) materials of a scene.yaml to fit; 0: all except empty and fixed ones
 * Errors: FILE (no folder, or no known measurement), FORMAT, those of pliant_moduli_fit, CANCELLED. */
PLIANT_INTERNAL pliant_status pliant_validation_run(const char *folder, int32_t count, const char *const *names,
                                                    pliant_report_tables *tables, pliant_progress progress);

/* ---- STABILITY */

typedef enum pliant_verdict {
    PLIANT_VERDICT_CONVERGED, /* every step succeeded, and the body came to rest in the expected state */
    PLIANT_VERDICT_REFUSED,   /* an error with a message; the previous state was kept */
    PLIANT_VERDICT_DEGRADED,  /* a result with a warning */
    PLIANT_VERDICT_BROKEN     /* not finite, a lost state, or a memory leak: a defect */
} pliant_verdict;

PLIANT_INTERNAL const char *pliant_verdict_name(pliant_verdict verdict);

typedef struct pliant_stability {
    uint32_t methods;      /* bit m: pliant_method m */
    const char *only;      /* Nullable: the only case to run */
    int64_t long_steps;    /* of the long run */
    int32_t settle_steps;  /* maximum number of steps until the body must be at rest */
    /* Nullable; with solver/kind tled: every trial uses its options, with dynamic relaxation */
    const pliant_scene *scene;
} pliant_stability;

PLIANT_INTERNAL void pliant_stability_defaults(pliant_stability *out);

/* Return the name of a case, in order; NULL after the last one. */
PLIANT_INTERNAL const char *pliant_stability_case(int index);

/* Run every case that is not in tables->stability yet. Cases that vary the load use the input's body. All others use
 * bodies of their own.
 *   @param input Nullable: a small block with a hard inclusion instead
 *   @param worst out: the worst verdict of this setup's rows
 * Errors: CANCELLED, FILE, MEMORY. */
PLIANT_INTERNAL pliant_status pliant_stability_run(const pliant_report_input *input, const pliant_stability *options,
                                                   pliant_report_tables *tables, pliant_progress progress,
                                                   pliant_verdict *worst);

#ifdef __cplusplus
}
#endif
#endif
