/* What a model holds; users see it through the functions of pliant/model.h. Who works on it is in src/fem and src/sim:
 * these are names. */
#ifndef PLIANT_STATE_MODEL_H
#define PLIANT_STATE_MODEL_H

#include "pliant/contact.h"
#include "pliant/model.h"

#ifdef __cplusplus
extern "C" {
#endif

typedef struct pliant_system pliant_system; /* what is solved: elements, fixed nodes, matrix pattern, first factor (src/fem) */

typedef struct pliant_tled_system pliant_tled_system; /* the same for explicit dynamics: gradients, masses, gather lists (src/fem) */

/* What follows from a body and stays as it is until the next one: what is solved, and how. Counted by reference. */
typedef struct pliant_discretization {
    const pliant_body *body;          /* retained: all of this points into it */
    pliant_system *system;            /* of tled: threads and meshes only */
    pliant_system *fine_system;       /* Nullable: model/patch; the fine mesh, solved only when a tool takes hold */
    pliant_tled_system *tled;         /* Nullable: solver/kind tled */
    pliant_system *coarse_system;     /* Nullable: of a body at load in which tissue is parted already: its coarse mesh alone */
    const struct pliant_discretization *first; /* Nullable: retained: that of the body at load: it has coarse elements that no cut has touched, and for patches a
                                       * factor of its fine mesh */
    double condition_estimate;        /* of the stiffness matrix, 1-norm (CHOLMOD's rcond inverted); 0: not known */
    struct pliant_discretization_holders *holders; /* how many there are (src/state/discretization.c) */
} pliant_discretization;

struct pliant_model {
    pliant_scene scene;
    const pliant_volume *scan;        /* borrowed; outlives the model */
    const pliant_volume *drawn;       /* what is deformed: the scan, or seen */
    pliant_volume seen;               /* warp/hide_empty: the scan without voxels of empty materials */
    pliant_material_table materials;
    pliant_tool_shape obstacles;      /* contact/obstacles */

    /* MATERIAL */
    uint8_t *material_of_voxel;       /* (voxels) */
    /* BODY */
    pliant_body *body;                /* at load; a simulation's own may be a later one (data.h) */
    /* FEM */
    const pliant_discretization *discretization; /* of the body at load; below, what it has */
    const pliant_system *system, *fine_system;
    const pliant_tled_system *tled;
    double condition_estimate;

    /* STATISTICS */
    double build_seconds[PLIANT_NUM_BUILD_STAGES];
    size_t build_bytes[PLIANT_NUM_BUILD_STAGES]; /* held after the stage minus before [bytes] */
};

#ifdef __cplusplus
}
#endif
#endif
