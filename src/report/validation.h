/* Measured bodies: validation_bodies.c reads them; validation.c fits and predicts. */
#ifndef PLIANT_REPORT_VALIDATION_H
#define PLIANT_REPORT_VALIDATION_H

#include "report/report.h"

#ifdef __cplusplus
extern "C" {
#endif

enum { MAX_STATES = 64 };

/* A measured table, or a folder with the user's scene. */
typedef struct measured_source {
    enum { MEASURED_BEAM, MEASURED_CUBE, MEASURED_SCENE } kind;
    char path[4096], scan[4096]; /* scan: for a scene */
} measured_source;

typedef struct measured_body {
    char name[64];
    pliant_scene scene;
    pliant_volume scan;
    pliant_labels labels;
    pliant_material_table materials;
    int32_t num_states;
    char state[MAX_STATES][48];
    pliant_path load[MAX_STATES]; /* load of each state */
    bool loaded;                  /* false: the scene's gravity is the only load */
    int32_t fitted;               /* state used for the fit; all others are predicted */
    bool fits_poisson;            /* only displacements are prescribed, so moduli have no effect */
    bool free_motion;             /* the rigid motion of all markers of a state is unknown */
    bool recordings;              /* states are repetitions of one experiment */
    pliant_marker *markers;       /* marker.load: index of its state */
    int32_t num_markers;
    uint64_t bytes;                /* report_hash of the measurement and its loads */
} measured_body;

/* Find the measurements in a folder in the order of names, or in its subfolders if it has none. Free with pliant_free.
 * Errors: FILE: no known measurement. */
pliant_status measured_bodies_find(const char *folder, int32_t *count, measured_source **out);
/* Free with measured_body_free. */
pliant_status measured_body_read(const measured_source *source, measured_body *out);
void measured_body_free(measured_body *body);

/* Compute displacements of markers at equilibrium under one load, as moduli.c does.
 * @param load Nullable: only the scene's gravity
 * @param moved (num_markers x 3) for the markers of this state [m] */
pliant_status report_markers_move(const pliant_model *model, const pliant_path *load, int32_t state,
                                  int32_t num_markers, const pliant_marker *markers, double *moved);

/* Check that markers are in the tissue, and that no displacement is far larger than the tissue. Errors: ARGUMENT,
 * MEMORY. */
pliant_status report_markers_check(const pliant_mesh *mesh, int32_t num_markers, const pliant_marker *markers);

/* Warn if the residuals of markers after a fit are much larger than their deviations. */
void report_markers_warn(int32_t num_markers, const pliant_marker *markers, const pliant_moduli *found);

#ifdef __cplusplus
}
#endif
#endif
