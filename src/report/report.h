/* Reports: what the library of reports and its programs need beyond pliant/report.h. */
#ifndef PLIANT_REPORT_REPORT_H
#define PLIANT_REPORT_REPORT_H

#include "base/export.h"
#include "pliant/report.h"
#include "tool/path.h"

#ifdef __cplusplus
extern "C" {
#endif

/* ---- POINTS: the same tissue in meshes of different method or resolution (points.c) */

/* Points of the body at rest and the nodes that they follow: x = sum of weights . positions. */
typedef struct pliant_points {
    int32_t count, num_found;
    int32_t *nodes;  /* (count x 4) */
    double *weights; /* (count x 4) barycentric; all zero where the mesh holds no tissue */
    uint8_t *found;  /* (count) 1: the mesh holds the point */
} pliant_points;

/* Nodes of the fine mesh whose tetrahedra hold tissue, at rest: where errors are measured.
 *  @param rest (count x 3) LPS [m], out; free with pliant_free. Errors: MEMORY, SCENE (no tissue). */
pliant_status pliant_body_points(const pliant_model *model, int32_t *count, double **rest);

/* Find points in a mesh: lattice nodes by their place, so that nested grids agree exactly, all others by barycentric
 *  coordinates. @param rest (count x 3) LPS [m]. Errors: ARGUMENT (count < 1), MEMORY. */
PLIANT_INTERNAL pliant_status pliant_points_create(const pliant_mesh *mesh, int32_t count, const double *rest, pliant_points *out);

PLIANT_INTERNAL void pliant_points_free(pliant_points *points); /* Nullable; leaves the struct zeroed */

/* Where the points are at these positions of the mesh; (0, 0, 0) for those that it does not hold.
 *  @param positions (nodes of the mesh x 3) [m]; @param out (count x 3) [m] */
PLIANT_INTERNAL void pliant_points_move(const pliant_points *points, const double *positions, double *out);

/* ---- ERROR (error.c, voxel_error.c) */

/* Distance between two solutions, point by point. p95 is the smallest value that 95 % of the points do not exceed.
 *  @param use Nullable: (count) nonzero for the points that count
 *  @param rest, reference, other (count x 3) LPS [m]. Errors: MEMORY, NUMERIC (a position is not finite). */
pliant_status pliant_error_between(int32_t count, const uint8_t *use, const double *rest, const double *reference,
                                              const double *other, pliant_error *out);

/* Error in the warped image, figure 2 of [H]: for every voxel of the deformed volume that shows tissue, the distance
 *  between the voxel and where the reference places the tissue that is seen there. Voxels without tissue are -1.
 *  The lowest tetrahedron draws, as in pliant_warp_update.
 *  @param model, positions  the solution that is shown
 *  @param reference_mesh, reference  the other one; tissue that it does not hold counts as none
 *  @param out FLOAT32 volume on the target grid [m]; free with pliant_volume_free. Errors: ARGUMENT, MEMORY. */
PLIANT_INTERNAL pliant_status pliant_error_voxels(const pliant_model *model, const double *positions, const pliant_mesh *reference_mesh,
                                             const double *reference, const pliant_geometry *target, pliant_volume *out);

/* Count the voxels of an error volume. counts[b] holds b * width <= error < (b + 1) * width, the last bin the rest too.
 *  @param summary Nullable; its `largest` and `worst` are 0 and -1. Errors: ARGUMENT, MEMORY. */
PLIANT_INTERNAL pliant_status pliant_error_histogram(const pliant_volume *error, int32_t bins, double width, uint64_t *counts,
                                                pliant_error *summary);

/* The slice through a point, as it is looked at: axis 2 axial (anterior up, patient left on the right), 1 coronal and
 *  0 sagittal (superior up). The voxel axes nearest to the anatomical ones are taken.
 *  @param size columns, rows; @param spacing of the same [m]
 *  @param out (rows x columns) values, slope and intercept applied; free with pliant_free. Errors: ARGUMENT, MEMORY. */
pliant_status pliant_volume_plane(const pliant_volume *volume, int axis, const double world[3], int32_t size[2],
                                             double spacing[2], float **out);

/* ---- RESULTS: tables that survive a stop (results.c) */

/* Open a CSV table, or go on with the one that is there.
 *  @param path    Nullable: in memory only
 *  @param columns (num_columns) names; the first num_keys of them make the key of a row
 *  Errors: FILE, FORMAT (the file has other columns), MEMORY. */
pliant_status pliant_results_open(const char *path, const char *const *columns, int num_columns, int num_keys,
                                             pliant_results **out);

/* The whole table as a CSV file, over what is there. Errors: FILE. */
pliant_status pliant_results_write(const pliant_results *results, const char *path);

/* Whether a row with this key (num_keys texts) is there. */
bool pliant_results_has(const pliant_results *results, const char *const *key);

/* Add a row (num_columns texts); it is on disk, for a table of a file, when this returns. Errors: FILE, MEMORY. */
pliant_status pliant_results_add(pliant_results *results, const char *const *cells);

PLIANT_INTERNAL size_t pliant_results_rows(const pliant_results *results);

int pliant_results_columns(const pliant_results *results);

/* Index of a column; -1: there is none of this name. */
PLIANT_INTERNAL int pliant_results_column(const pliant_results *results, const char *name);

PLIANT_INTERNAL const char *pliant_results_cell(const pliant_results *results, size_t row, int column);

/* The rows as a JSON array of objects; cells that are numbers become numbers, empty ones null.
 *  @param file  FILE* of stdio, not closed
 *  @param first Nullable: only rows whose first column is this. Errors: FILE. */
pliant_status pliant_results_json(const pliant_results *results, const char *first, void *file);

void pliant_results_close(pliant_results *results); /* Nullable */

/* ---- TABLES of a report */

/* The tables as they are to folder/sweep.csv and so on, over what is there. Errors: FILE. */
PLIANT_INTERNAL pliant_status pliant_report_write(const char *folder, const pliant_report_tables *tables);

/* Rows of another report, with the slices that they name, that are not in this one: sweeps that were run in parts.
 *  @param from, folder  the other's folder, and this one's. Errors: FILE, FORMAT, MEMORY. */
PLIANT_INTERNAL pliant_status pliant_report_merge(const char *from, const char *folder, const pliant_report_tables *tables);

/* ---- STAGES AND DYNAMICS */

/* Time and memory of the scene as it is, without each of its stages in turn, and without all of them.
 *  Errors: as of building and stepping; CANCELLED. */
PLIANT_INTERNAL pliant_status pliant_left_out_run(const pliant_report_input *input, const pliant_sweep *sweep, pliant_report_tables *tables,
                                             pliant_progress progress);

/* Explicit dynamics as the scene has it, through a pull that is let go: bounds of its time step, steps a frame, times; what its time
 *  integration is off by, from the same run with half the sub-step (Richardson: 4/3 of how far the two are apart, worst node and frame);
 *  and without damping the drift of its energy. What the core refuses is a row.
 *  Errors: SCENE (another solver/kind), ARGUMENT (no point), CANCELLED, FILE, MEMORY. */
PLIANT_INTERNAL pliant_status pliant_dynamics_run(const pliant_report_input *input, const pliant_sweep *sweep, pliant_report_tables *tables,
                                             pliant_progress progress);

/* ---- TRUTH (truth.c) */

/* Where points would be on a mesh of endless resolution, from three meshes of which each has twice the resolution of the one before
 *  (Richardson): the next differences fall by 2^-p, p between the order that the last two differences show and the theory's 2.
 *  @param use Nullable: nonzero for points that the order is measured at
 *  @param coarse, middle, fine (count x 3) [m]; @param out (count x 3)
 *  @return the order that was seen */
double pliant_extrapolate(int32_t count, const uint8_t *use, const double *coarse, const double *middle, const double *fine, double *out);

/* ---- MODULI (moduli.c): how stiff materials are, from where points of the tissue were measured */

enum { PLIANT_MAX_MODULI = 8 };

/* A point whose displacement was measured. */
typedef struct pliant_marker {
    int32_t load;                /* under which load, from 0 */
    double rest[3], moved[3];    /* point of the tissue, and displacement of the marker (deformed minus rest position), LPS [m] */
    double deviation;            /* standard deviation of each of the three numbers [m] */
    double offset[3];            /* from the tissue's point to the marker's centre: it turns with the tissue; zero: the marker is the point [m] */
    int32_t line;                /* in the file that it was read from, for messages; 0: none */
} pliant_marker;

typedef struct pliant_moduli_data {
    int32_t num_loads;
    const pliant_path *loads;    /* Nullable: the scene's own gravity. (num_loads) a load is where a path ends: its gravity, its tools */
    int32_t num_markers;
    const pliant_marker *markers;
} pliant_moduli_data;

typedef struct pliant_moduli {
    int32_t count, passes;
    double young[PLIANT_MAX_MODULI];                       /* [Pa] */
    double low[PLIANT_MAX_MODULI], high[PLIANT_MAX_MODULI]; /* the true one is in between with a probability of 95 %, if the rest of the model is right */
    double correlation[PLIANT_MAX_MODULI][PLIANT_MAX_MODULI];
    double misfit;               /* sum of squared residuals over deviations, over the degrees of freedom: far above 1 the model, or a deviation, is wrong */
    double rms;                  /* of the distances that are left [m] */
} pliant_moduli;

/* Read markers from a table, one marker per line: load,x,y,z,moved_x,moved_y,moved_z and maybe the deviation. Loads count from 1. x, y, z is the
 *  position at rest. moved_x, moved_y, moved_z is the displacement: the deformed minus the rest position. Lengths are in metres. Cells are separated by commas, semicolons or tabs. Lines that begin with # are comments. A first line that
 *  begins with "load" is a header. A byte order mark is skipped.
 *  @param deviation where a line has none. Free with pliant_free. Errors: FILE, FORMAT (names line, column, value and remedy), MEMORY. */
PLIANT_INTERNAL pliant_status pliant_markers_read(const char *path, double deviation, int32_t *count, pliant_marker **out);

/* Young's moduli of `count` named materials that bring the scene's tissue, at rest under each load, nearest to the markers: Gauss-Newton on their logarithms
 *  from those of the table on, sensitivities by differences. A modulus is that of the scene's mesh: pliant_truth_run tells what that is off by.
 *  A misfit above 9 is logged as a warning: the residuals are then three times as large as the deviations.
 *  Errors: ARGUMENT (names, markers outside of the tissue), NUMERIC (nothing measured tells of a material), those of building and stepping, CANCELLED.
 *  NOT_CONVERGED: *out is the best that was found. */
PLIANT_INTERNAL pliant_status pliant_moduli_fit(const pliant_report_input *input, const pliant_moduli_data *data, int32_t count, const char *const *names,
                                           pliant_progress progress, pliant_moduli *out);

/* ---- VALIDATION (validation.c): measured bodies, fitted on one state, predicted in the others */

/* What is measured in a folder, or, where nothing is, in its folders: its kind is told from the files in it, each table is a body of its own.
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
PLIANT_INTERNAL pliant_status pliant_validation_run(const char *folder, int32_t count, const char *const *names, pliant_report_tables *tables,
                                               pliant_progress progress);

/* ---- STABILITY */

typedef enum pliant_verdict {
    PLIANT_VERDICT_CONVERGED, /* every step ended well, and the body came to rest where it should */
    PLIANT_VERDICT_REFUSED,   /* an error, told; the state before it was kept */
    PLIANT_VERDICT_DEGRADED,  /* went on with a caveat, told */
    PLIANT_VERDICT_BROKEN     /* not finite, state lost, or memory lost: a defect */
} pliant_verdict;

PLIANT_INTERNAL const char *pliant_verdict_name(pliant_verdict verdict);

typedef struct pliant_stability {
    uint32_t methods;      /* bit m: pliant_method m */
    const char *only;      /* Nullable: the one case to run */
    int64_t long_steps;    /* of the long run */
    int32_t settle_steps;  /* most steps that a body may take to come to rest */
    const pliant_scene *scene; /* Nullable; with solver/kind tled: its options are those of every trial, by dynamic relaxation */
} pliant_stability;

PLIANT_INTERNAL void pliant_stability_defaults(pliant_stability *out);

/* Names of the cases, in order; NULL after the last. */
PLIANT_INTERNAL const char *pliant_stability_case(int index);

/* Every case that is not in tables->stability yet. Cases that vary the load run on the input's body, all others on
 *  bodies of their own.
 *  @param input Nullable: a small block with a hard inclusion instead
 *  @param worst out, the worst verdict of this setup's rows. Errors: CANCELLED, FILE, MEMORY. */
PLIANT_INTERNAL pliant_status pliant_stability_run(const pliant_report_input *input, const pliant_stability *options,
                                              pliant_report_tables *tables, pliant_progress progress, pliant_verdict *worst);

#ifdef __cplusplus
}
#endif
#endif
