/* What a simulation holds, by the stage that writes it; users see it through the functions of pliant/data.h. */
#ifndef PLIANT_STATE_DATA_H
#define PLIANT_STATE_DATA_H

#include "base/account.h"
#include "contact/contact.h"
#include "pliant/contact.h"
#include "state/model.h"

#ifdef __cplusplus
extern "C" {
#endif

/* The edge of a blade that cuts, in points: where the cut ends. */
typedef struct pliant_edge {
    int32_t count;
    double *place;         /* (count x 3) [m]; of points in tissue as of the last step */
    int32_t *tet;          /* (count) fine tetrahedron that a point goes with; -1: it is in no tissue */
    double *weight;        /* (count x 4) barycentric */
    int32_t *beside;       /* (count) of a point in no tissue: the node that it goes with; -1: the nearest point that is in tissue, if any */
    double *apart;         /* (count x 3) from that node to the point [m] */
    double reach;          /* how far that node may be [m] */
    double *now, *swept;   /* (count x 3) room: where the blade is, what it is swept from or to */
} pliant_edge;

typedef struct pliant_blade {
    /* INPUT, written by pliant_tool_set_blade, _set_cutting */
    double from[3], to[3]; /* ends of its edge in the tool's frame [m]; both equal: no blade */
    bool cutting;
    /* STROKE: from when it begins to cut until it is lifted, lost or jumps */
    bool under_way, failed; /* failed: and that was said */
    uint64_t stroke;       /* how many so far */
    pliant_edge edge;      /* while one is under way */
    double tip[3], rotation[4]; /* of the tool when the edge was moved last */
    /* RESISTANCE: the edge drags the tissue along by the tool's hold, until it slips */
    bool drags;
    bool slips;            /* tissue was let go in the step before: the blade parts what has come back over it */
    double stiffness;      /* of its spring [N/m] */
    double anchor[3];      /* where the middle of the edge was when it began to drag [m] */
    double drawn[3];       /* how far it has come since, across the edge [m] */
    double moved[3], force[3]; /* of the middle in the last step [m], and what was felt in the one before [N] */
    double work;           /* done since tissue has parted last, and what was left over then [J] */
    bool passes;           /* the step before went far: tissue lies free, and was not dragged */
    double parting[3];     /* what it feels then [N] */
    /* OUTPUT */
    double engaged_length, severed_area; /* [m], at rest since load [m^2] */
    int32_t pieces;        /* after its last cut */
} pliant_blade;

typedef struct pliant_tool {
    char name[48];
    /* INPUT, written by pliant_tool_* */
    bool present;          /* has a pose */
    double tip[3];         /* LPS [m] */
    double rotation[4];    /* quaternion x y z w, for the directions of forces told to a robot; not used by the solver */
    pliant_drive drive;
    double driving_force[3]; /* PLIANT_DRIVE_FORCE: on the tissue [N] */
    double stiffness, damping, radius; /* from the scene, may be set per tool [N/m, N s/m, m] */
    double mass;           /* at the held point [kg] */
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
    double slipped;        /* how far, in this hold (grasp/slip) [m] */
    pliant_blade blade;
    /* SHAPE, written by pliant_tool_set_shape, _set_jaw */
    pliant_tool_shape shape;
    double jaw;            /* angle [rad] */
    /* PROXY: the simulated tool, which is where the measured one is unless tissue is in the way (sim/step/proxy.h). Of
     * a tool without a shape: where it was as the last step ended */
    struct {
        bool known;
        bool released;         /* it was placed inside tissue, and touches nothing until it is out of there */
        double tip[3], rotation[4], jaw;
        double pulls[3];       /* force and torque of its coupling, and torque of its jaws, as the last leg was solved, however far it went [N, N m] */
        bool saturated;        /* its coupling pulls with all that it may (contact/max_force, contact/grip_torque) */
    } proxy;
    /* OUTPUT of the last step */
    double held_point[3];  /* where the held point is [m] */
    double force[3];       /* of the tool on the tissue [N] */
} pliant_tool;

/* What the solver pulls with: the tool's spring, or its blade's. */
static inline pliant_drive pliant_tool_drive(const pliant_tool *tool) { return tool->blade.drags ? PLIANT_DRIVE_SPRING : tool->drive; }
static inline double pliant_tool_stiffness(const pliant_tool *tool) { return tool->blade.drags ? tool->blade.stiffness : tool->stiffness; }
static inline double pliant_tool_damping(const pliant_tool *tool) { return tool->blade.drags ? 0 : tool->damping; }
static inline double pliant_tool_mass(const pliant_tool *tool) { return tool->blade.drags ? 0 : tool->mass; }
/* Whether it holds tissue, other than by its blade. */
static inline bool pliant_tool_grips(const pliant_tool *tool) { return tool->holding && !tool->blade.drags; }

/* Bodies from before what was cut, the latest last. */
typedef struct pliant_undo {
    const pliant_body **body; /* (count) each retained */
    int32_t count;
    int tool;                 /* that the last one is of; -1: pliant_data_cut */
    uint64_t stroke;
    bool told;                /* that there are no more of them */
} pliant_undo;

typedef struct pliant_contact_search pliant_contact_search; /* room, and sides of parts on which the tissue is (src/sim/step/contact.c) */

typedef struct pliant_rollback pliant_rollback; /* state at the begin of a step (src/sim/step/rollback.c) */
typedef struct pliant_clearance pliant_clearance; /* the surface that contact uses, for distances to it (src/tool/clearance.c) */
typedef struct pliant_legs pliant_legs; /* where the leg at hand began, what couplings of proxies answer in it (src/sim/step) */

typedef struct pliant_backend pliant_backend; /* functions of a step's stages (src/backend) */
typedef struct pliant_solver pliant_solver; /* iteration history, factors, the background factorizer (src/fem) */

typedef struct pliant_patch pliant_patch; /* local fine solutions around holds (src/fem) */

typedef struct pliant_falling pliant_falling; /* where pieces are that have come off (src/fem/rigid) */

typedef struct pliant_tled pliant_tled; /* displacements, increments, sub-steps of explicit dynamics (src/fem) */

struct pliant_data {
    const pliant_model *model; /* that it was created for, which outlives it */
    pliant_account *account;  /* of what it holds; shared with a state that takes its place */
    /* BODY */
    const pliant_body *body;  /* what is true now; at first, and after a reset, the model's */
    const pliant_discretization *discretization; /* of it, or of an earlier one of the same topology */
    uint64_t last_revision;   /* highest of a body so far: the next one takes one more */
    /* BACKEND */
    const pliant_backend *backend; /* who runs the stages from solve on: as the scene's solver/backend says, or the CPU after a
                                    *   GPU failed */
    void *backend_state;      /* Nullable: what it keeps */

    pliant_background background;

    /* CUT */
    pliant_undo undo;
    size_t keeps;             /* of the memory that a cut leaves, for the next one (base/room.h) [bytes] */
    /* INTERACT */
    pliant_tool tools[PLIANT_MAX_TOOLS];
    int32_t num_tools;
    double gravity[3];        /* LPS [m/s^2]; from the scene at first, changed by pliant_data_set_gravity */
    /* CONTACT, SOLVE */
    pliant_contact_search *contact_search; /* Nullable: there was nothing to touch yet */
    pliant_contacts contacts; /* of this step: points by who finds them, forces by who solves */
    double share;             /* of the step's time that the leg at hand takes (sim/step/legs.h) */
    const struct pliant_touch_pieces *bodies; /* Nullable: rigid bodies that points of the leg at hand are of */
    pliant_legs *legs;        /* Nullable: what a leg begins with, and room */
    /* SOLVE */
    pliant_solver *solver;    /* NULL: solver/kind tled */
    pliant_tled *tled;        /* Nullable: solver/kind tled */
    /* PATCH */
    pliant_patch *patch;      /* Nullable: model/patch */
    /* PATCH, at its end */
    pliant_falling *falling;  /* Nullable: nothing has come off */
    /* UPSAMPLE, PATCH */
    double *positions;        /* (body->fine.num_nodes x 3) LPS [m]; written by every step */
    /* OF A STEP THAT FAILS */
    pliant_rollback *rollback; /* Nullable: there was no step yet */
    pliant_clearance *clearance; /* empty until a tool's distance to the tissue is asked for */
    /* WARP */
    pliant_warp *warp;        /* Nullable: only when pliant_data_set_warp asked for it */

    pliant_statistics statistics;
};

#ifdef __cplusplus
}
#endif
#endif
