/* What a simulation holds, by the stage that writes it; users see it through the functions of pliant/data.h. */
#ifndef PLIANT_STATE_DATA_H
#define PLIANT_STATE_DATA_H

#include "pliant/data.h"
#include "state/model.h"

#ifdef __cplusplus
extern "C" {
#endif

typedef struct pliant_tool {
    char name[48];
    /* INPUT, written by pliant_tool_* */
    bool present;          /* has a pose */
    double tip[3];         /* LPS [m] */
    double rotation[4];    /* quaternion x y z w, for the directions of forces told to a robot; not used by the solver */
    pliant_drive drive;
    double driving_force[3]; /* PLIANT_DRIVE_FORCE: on the tissue [N] */
    double stiffness, damping, radius; /* from the scene, may be set per tool [N/m, N s/m, m] */
    /* HOLD, written by grasp and release */
    bool holding;
    uint64_t hold;         /* how many times it has taken hold */
    int32_t num_held;      /* fine nodes that share the force ([H] 11: barycentric weights over the blob) */
    int32_t *held;         /* (num_held), ascending */
    double *weight;        /* (num_held), sum 1 */
    bool attached;         /* the solver knows of this hold */
    double last_target[3]; /* where the held point was pulled to in the last step [m] */
    double grip[3];        /* tip minus held point when it took hold; the tip pulls the held point to tip - grip [m] */
    double grasped[3], grasped_radius; /* the blob that it holds, at rest [m] */
    /* OUTPUT of the last step */
    double held_point[3];  /* where the held point is [m] */
    double force[3];       /* of the tool on the tissue [N] */
} pliant_tool;

typedef struct pliant_backend pliant_backend; /* functions of a step's stages (src/backend) */
typedef struct pliant_solver pliant_solver; /* iteration history, factors, the background factorizer (src/fem) */

typedef struct pliant_patch pliant_patch; /* local fine solutions around holds (src/fem) */

typedef struct pliant_falling pliant_falling; /* where pieces are that have come off (src/fem/dynamics) */

typedef struct pliant_tled pliant_tled; /* displacements, increments, sub-steps of explicit dynamics (src/fem) */

struct pliant_data {
    /* BODY */
    const pliant_body *body;  /* what is true now; at first, and after a reset, the model's */
    const pliant_discretization *discretization; /* of it, or of an earlier one of the same topology */
    uint64_t last_revision;   /* highest of a body so far: the next one takes one more */
    /* BACKEND */
    const pliant_backend *backend; /* who runs the stages from solve on: as the scene's solver/backend says, or the CPU after a
                                    *   GPU failed */
    void *backend_state;      /* Nullable: what it keeps */

    pliant_background background;

    /* INTERACT */
    pliant_tool tools[PLIANT_MAX_TOOLS];
    int32_t num_tools;
    double gravity[3];        /* LPS [m/s^2]; from the scene at first, changed by pliant_data_set_gravity */
    /* SOLVE */
    pliant_solver *solver;    /* NULL: solver/kind tled */
    pliant_tled *tled;        /* Nullable: solver/kind tled */
    /* PATCH */
    pliant_patch *patch;      /* Nullable: model/patch */
    /* PATCH, at its end */
    pliant_falling *falling;  /* Nullable: nothing has come off */
    /* UPSAMPLE, PATCH */
    double *positions;        /* (body->fine.num_nodes x 3) LPS [m]; written by every step */
    /* WARP */
    pliant_warp *warp;        /* Nullable: only when pliant_data_set_warp asked for it */

    pliant_statistics statistics;
};

#ifdef __cplusplus
}
#endif
#endif
