/* Measured bodies: what validation_bodies.c reads and validation.c fits and predicts. */
#ifndef PLIANT_REPORT_VALIDATION_H
#define PLIANT_REPORT_VALIDATION_H

#include "pliant/report.h"

#ifdef __cplusplus
extern "C" {
#endif

enum { MOST_STATES = 64 };

/* A table, or a folder with a scene of the user's. */
typedef struct measured_source {
    enum { MEASURED_BEAM, MEASURED_CUBE, MEASURED_SCENE } kind;
    char path[4096], scan[4096]; /* scan: of a scene */
} measured_source;

typedef struct measured_body {
    char name[64];
    pliant_scene scene;
    pliant_volume scan;
    pliant_labels labels;
    pliant_material_table materials;
    int32_t num_states;
    char state[MOST_STATES][48];
    pliant_path load[MOST_STATES]; /* of each state */
    bool loaded;                   /* false: the scene's own gravity is the load of all */
    int32_t fitted;                /* the state that is fitted on; all others are predicted */
    bool fits_poisson;             /* displacements alone are prescribed: no modulus can be seen */
    bool free_motion;              /* a rigid motion of all markers of a state is not known */
    bool recordings;               /* states are repetitions of one experiment */
    pliant_marker *markers;        /* marker.load: its state */
    int32_t num_markers;
    uint64_t bytes;                /* report_hash of what was measured and under which loads */
} measured_body;

/* What was measured in a folder, in the order of names; where there is nothing, what is in its folders. Free with pliant_free. FILE: nothing that is known. */
pliant_status measured_bodies_find(const char *folder, int32_t *count, measured_source **out);
/* Free with measured_body_free. */
pliant_status measured_body_read(const measured_source *source, measured_body *out);
void measured_body_free(measured_body *body);

/* Displacements of markers at rest under one load, as moduli.c fits them. @param load Nullable: the scene's own gravity
 * @param moved (num_markers x 3) of the markers of this state [m] */
pliant_status report_markers_move(const pliant_model *model, const pliant_path *load, int32_t state, int32_t num_markers, const pliant_marker *markers,
                                  double *moved);

/* Check that markers are in the tissue and that no displacement is far longer than the tissue. Errors: ARGUMENT, MEMORY. */
pliant_status report_markers_check(const pliant_mesh *mesh, int32_t num_markers, const pliant_marker *markers);

/* Warn when markers lie, after a fit, far more than their deviations from where they were measured. */
void report_markers_warn(int32_t num_markers, const pliant_marker *markers, const pliant_moduli *found);

#ifdef __cplusplus
}
#endif
#endif
