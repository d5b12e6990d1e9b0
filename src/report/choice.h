/* The parts of a choice: what is tried, what became known of it, which of it is taken. */
#ifndef PLIANT_REPORT_CHOICE_H
#define PLIANT_REPORT_CHOICE_H

#include "report/sweep.h"

#ifdef __cplusplus
extern "C" {
#endif

#define CHOICE_COUNT(name, yaml) +1
enum { NUM_MEASURES = 0 PLIANT_MEASURE_LIST(CHOICE_COUNT) };
#undef CHOICE_COUNT

enum { CHOICE_BUDGETS = 9, CHOICE_METHODS = 8, CHOICE_MESHES = 10, CHOICE_CANDIDATES = (CHOICE_METHODS + 1) * CHOICE_MESHES };
extern const int32_t choice_budgets[CHOICE_BUDGETS]; /* iterations of a step, ascending */

typedef struct choice_method {
    pliant_method method;
    pliant_touch touch;
    double patch; /* model/patch [m] */
} choice_method;

typedef struct choice_mesh {
    int32_t cells_factor, ratio; /* of the scene's coarse cells */
} choice_mesh;

typedef struct choice_candidate {
    choice_method by;
    choice_mesh mesh;
} choice_candidate;

/* What a user sees one after the other; an error is the worst of them. */
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

/* What a candidate did with one budget, the worse of the cases. Errors are fractions of the largest displacement. */
typedef struct choice_point {
    choice_candidate candidate;
    int32_t iterations;
    double error[NUM_MEASURES];       /* worst frame of all */
    choice_phase worst[NUM_MEASURES]; /* that it was in */
    double later[NUM_MEASURES];       /* from when patches are there and the tissue has sagged */
    double seconds;                   /* median step, as measured */
    /* work of a step: more of none of these takes no longer */
    double evaluations;               /* mean */
    int32_t solved_tetrahedra, fine_tetrahedra;
    bool on_host;                     /* run by the CPU */
} choice_point;

/* ---- choice_candidates.c */
/* Of the mesh that all are measured against: twice the scene's where the mesh may vary and that is not too large. */
int32_t choice_reference_ratio(const pliant_scene *scene, double limit);
/* The scene's own settings first, so that they are known whatever becomes of the others; then its method on other meshes, then the
 * others. @param finest ratio of the reference @return how many */
int choice_list_candidates(const pliant_scene *scene, int32_t finest, choice_candidate out[CHOICE_CANDIDATES]);
/* Errors: SCENE */
pliant_status choice_scene(const pliant_scene *scene, const choice_candidate *candidate, pliant_scene *out);
/* The options that make the candidate, as --set takes them. */
const char *choice_describe(const choice_candidate *candidate, const pliant_scene *scene, char out[PLIANT_CHOICE_TEXT]);
/* The same less method, touch and ratio, which have columns of their own. */
enum { CHOICE_VARIANT = sizeof((sweep_state *)NULL)->variant };
void choice_name_variant(const choice_candidate *candidate, const pliant_scene *scene, char out[CHOICE_VARIANT]);
const char *choice_method_name(const choice_candidate *candidate);
const char *choice_touch_name(const choice_candidate *candidate); /* "" but for schur */

/* ---- choice_points.c */
/* Points of a candidate from its rows of the sweep's table, from `first` on: of each budget the worse of its cases. A case that
 * converged needs no larger budget. @return how many, at most CHOICE_BUDGETS */
int choice_gather(const sweep_ground *ground, const choice_candidate *candidate, size_t first, choice_point out[CHOICE_BUDGETS]);
/* Median step of a point: as measured, or of the quickest that does at least as much work. Other programs may have taken time, but
 * less work takes no longer, so that nothing is taken that another one betters with less work. */
double choice_seconds(const choice_point *points, int count, const choice_point *of);
/* Least error of the fine method on a mesh so many times as fine as the scene's coarse one, which is that of the mesh where points have enough
 * iterations; NAN: it was not tried. */
double choice_mesh_error(const choice_point *points, int count, int32_t resolution, pliant_measure measure);
/* What the reference's own mesh leaves out, from the errors against it of meshes of half and of a quarter of its resolution, which grow by 2^p + 1
 * where errors of a mesh do by 2^p; that order is raised halfway to the theory's, as pliant_extrapolate does. 0: they were not tried. */
double choice_reference_error(const choice_point *points, int count, int32_t resolution, pliant_measure measure);
/* The point to take within a time. Errors count with what the reference leaves out, so that iterations are not spent below that. Settings whose worst frames are alike, within a factor of two, are told apart by what comes
 * later; within 5 % of that the quickest is taken. NULL: none is as quick. */
const choice_point *choice_best(const choice_point *points, int count, pliant_measure measure, double left_out, double most_seconds);
const choice_point *choice_quickest(const choice_point *points, int count); /* NULL: there is none */

#ifdef __cplusplus
}
#endif
#endif
