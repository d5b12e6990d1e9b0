/* Data of a model. Users access it through pliant/model.h. The functions on this data are in src/fem and src/sim; this
 * header has only types. */
#ifndef PLIANT_MODEL_DATA_MODEL_H
#define PLIANT_MODEL_DATA_MODEL_H

#include "contact/settings.h"
#include "pliant/contact.h"
#include "pliant/model.h"

#ifdef __cplusplus
extern "C" {
#endif

typedef struct pliant_system pliant_system; /* elements, fixed nodes, matrix pattern, first factor (src/fem) */

/* The same for explicit dynamics: gradients, masses, gather lists (src/fem). */
typedef struct pliant_tled_system pliant_tled_system;

/* Data derived from a body, constant until the next cut: the solved system. Reference-counted. */
typedef struct pliant_discretization {
    const pliant_body *body;          /* retained: all other members point into it */
    pliant_system *system;            /* with tled: only threads and meshes */
    pliant_system *fine_system;       /* Nullable: model/patch; the fine mesh, solved only after a grasp */
    pliant_tled_system *tled;         /* Nullable: solver/kind tled */
    pliant_system *coarse_system;     /* Nullable: the coarse mesh alone, of a body that is already cut at load time */
    /* Nullable: retained: the discretization at load time. It has the coarse elements without cuts, and a factor of the
     * fine mesh for patches. */
    const struct pliant_discretization *first;
    double condition_estimate;        /* of the stiffness matrix, 1-norm (inverse of CHOLMOD's rcond); 0: unknown */
    struct pliant_discretization_holders *holders; /* reference count (src/model_data/discretization.c) */
} pliant_discretization;

struct pliant_model {
    pliant_scene scene;
    pliant_contact_settings contact; /* with the values that the scene sets */
    bool without_missing_compliance; /* for tests that compare backends to rounding errors, which it amplifies */
    const pliant_volume *scan;       /* borrowed; outlives the model */
    const pliant_volume *drawn;      /* the deformed volume: the scan, or `visible_scan` */
    pliant_volume visible_scan;      /* warp/hide_empty: the scan without voxels of empty materials */
    pliant_material_table materials;
    pliant_tool_shape obstacles;      /* contact/obstacles */

    /* MATERIAL. */
    uint8_t *material_of_voxel;       /* (voxels) */
    /* BODY. */
    pliant_body *body;                /* at load time; a simulation can have a later one (data.h) */
    /* FEM. */
    const pliant_discretization *discretization; /* of the body at load time; the members below are its contents */
    const pliant_system *system, *fine_system;
    const pliant_tled_system *tled;
    double condition_estimate;

    /* STATISTICS. */
    double build_seconds[PLIANT_NUM_BUILD_STAGES];
    size_t build_bytes[PLIANT_NUM_BUILD_STAGES]; /* memory after the stage minus before [bytes] */
};

#ifdef __cplusplus
}
#endif
#endif
