/* Stages of a choice: list the candidates, measure them, take one. */
#ifndef PLIANT_REPORT_CHOICE_H
#define PLIANT_REPORT_CHOICE_H

#include "report/sweep.h"

#ifdef __cplusplus
extern "C" {
#endif

#define CHOICE_COUNT(name, yaml) +1
enum { NUM_MEASURES = 0 PLIANT_MEASURE_LIST(CHOICE_COUNT) };
#undef CHOICE_COUNT

enum {
    CHOICE_BUDGETS = 9,
    CHOICE_METHODS = 7,
    CHOICE_MESHES = 10,
    CHOICE_CANDIDATES = (CHOICE_METHODS + 1) * CHOICE_MESHES
};
extern const int32_t choice_budgets[CHOICE_BUDGETS]; /* numbers of iterations per step, ascending */

typedef struct choice_method {
    pliant_method method;
    pliant_submesh_extent submesh;
    double patch; /* model/patch [m] */
} choice_method;

typedef struct choice_mesh {
    int32_t cells_factor, ratio; /* cells_factor: relative to the scene's coarse cells */
} choice_mesh;

typedef struct choice_candidate {
    choice_method by;
    choice_mesh mesh;
} choice_candidate;

/* Phases of a user's interaction; a point's error is the maximum over the phases. */
#define CHOICE_PHASE_LIST(X)                                                                     \
    X(pull, "in a pull")                                                                         \
    X(hold, "in the first frames of a hold, before its patch is there")                          \
    X(sag, "in the first frames after a load, while the tissue sags under the scene's gravity")
typedef enum choice_phase {
#define CHOICE_PHASE_ENUM(name, text) CHOICE_PHASE_##name,
    CHOICE_PHASE_LIST(CHOICE_PHASE_ENUM)
#undef CHOICE_PHASE_ENUM
} choice_phase;
const char *choice_phase_text(choice_phase phase);

/* Result of a candidate with one budget, the maximum over the cases. Errors are relative to the maximum
 * displacement. */
typedef struct choice_point {
    choice_candidate candidate;
    int32_t iterations;
    double error[NUM_MEASURES];         /* maximum over all frames */
    choice_phase worst[NUM_MEASURES];   /* phase of the frame with this error */
    double settled_error[NUM_MEASURES]; /* maximum after patches are available and the tissue has settled */
    double seconds;                     /* median step, as measured */
    /* work per step; if none of these increases, the time does not either */
    double evaluations;               /* mean number of evaluations */
    int32_t solved_tetrahedra, fine_tetrahedra;
    bool on_host;                     /* whether the CPU runs it */
} choice_point;

/* ---- choice_candidates.c */
/* Return the ratio of the reference mesh: twice the scene's ratio if the mesh may vary and is not too large. */
int32_t choice_reference_ratio(const pliant_scene *scene, double limit);
/* List the candidates. The scene's own settings come first, so that they are always measured. Then its method on other
 * meshes and other methods follow.
 * @param finest ratio of the reference
 * @return number of candidates */
int choice_list_candidates(const pliant_scene *scene, int32_t finest, choice_candidate out[CHOICE_CANDIDATES]);
/* Create the scene of a candidate. Errors: SCENE. */
pliant_status choice_scene(const pliant_scene *scene, const choice_candidate *candidate, pliant_scene *out);
/* Return the options of a candidate in the syntax of --set. */
const char *choice_describe(const choice_candidate *candidate, const pliant_scene *scene, char out[PLIANT_CHOICE_TEXT]);
/* Return the same without method, submesh and ratio, which have separate columns. */
enum { CHOICE_VARIANT = sizeof((sweep_state *)NULL)->variant };
void choice_name_variant(const choice_candidate *candidate, const pliant_scene *scene, char out[CHOICE_VARIANT]);
const char *choice_method_name(const choice_candidate *candidate);
const char *choice_submesh_name(const choice_candidate *candidate); /* "" except for schur */

/* ---- choice_points.c */
/* Collect the points of a candidate from its rows of the sweep's table, starting at `first`: for each budget the
 * maximum over the cases. A converged case needs no larger budget.
 * @return number of points, at most CHOICE_BUDGETS */
int choice_collect_points(const sweep_ground *ground, const choice_candidate *candidate, size_t first,
                          choice_point out[CHOICE_BUDGETS]);
/* Return the median step time of a point. It is the minimum of the point's measurement and the measurements of points
 * with at least as much work. Less work cannot take longer, so a longer measurement was disturbed by other programs. */
double choice_seconds(const choice_point *points, int count, const choice_point *of);
/* Return the error of the mesh `resolution` times as fine as the scene's coarse mesh: the minimum error of the fine
 * method, whose points have enough iterations. NAN: not measured. */
double choice_mesh_error(const choice_point *points, int count, int32_t resolution, pliant_measure measure);
/* Estimate the discretization error of the reference mesh by Richardson extrapolation. The inputs are the errors of
 * meshes with 1/2 and 1/4 of its resolution relative to the reference. Their ratio is 2^p + 1 for order p. The order is
 * averaged with the theoretical one, as in pliant_extrapolate. 0: not measured. */
double choice_reference_error(const choice_point *points, int count, int32_t resolution, pliant_measure measure);
/* Return the best point within a time limit; NULL: no point is fast enough. The reference's error is added to each
 * error, so that no iterations are spent below it. Points whose maximum errors are equal within a factor of two are
 * compared by their later errors. Among points within 5 % of the best, the fastest is taken. */
const choice_point *choice_best(const choice_point *points, int count, pliant_measure measure, double reference_error,
                                double max_seconds);
const choice_point *choice_fastest(const choice_point *points, int count); /* NULL: the list is empty */

#ifdef __cplusplus
}
#endif
#endif
