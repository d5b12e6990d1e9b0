/* State of a simulation, grouped by the stage that writes it. Users access it through pliant/data.h. */
#ifndef PLIANT_MODEL_DATA_DATA_H
#define PLIANT_MODEL_DATA_DATA_H

#include "base/account.h"
#include "base/step_clock.h"
#include "contact/advance/advance.h"
#include "contact/contact.h"
#include "pliant/contact.h"
#include "model_data/background.h"
#include "model_data/model.h"

#ifdef __cplusplus
extern "C" {
#endif

/* The edge of a cutting blade, as points: the end of the present cut. */
typedef struct pliant_edge {
    int32_t count;
    double *place;         /* (count x 3) [m]; points in tissue as of the last step */
    int32_t *tet;          /* (count) fine tetrahedron that carries the point; -1: in no tissue */
    double *weight;        /* (count x 4) barycentric */
    /* (count) For a point outside of the tissue: the node that carries it. -1: use the nearest point in tissue, if
     * any. */
    int32_t *carrier;
    double *carrier_offset;         /* (count x 3) offset of the point from that node [m] */
    double reach;          /* maximum distance of this node [m] */
    double *now, *swept;   /* (count x 3) work arrays: present position of the blade, and start or end of the swept
                            * strip */
} pliant_edge;

typedef struct pliant_blade {
    /* INPUT, written by pliant_tool_set_blade, _set_cutting. */
    double from[3], to[3]; /* ends of its edge in the tool's frame [m]; equal: no blade */
    bool cutting;
    /* STROKE: from the first cut until the blade is lifted, lost or jumps. */
    bool is_in_stroke, failed; /* failed: and the failure was logged */
    bool is_ending;        /* it was switched off: the next step ends the stroke */
    double direction[3];   /* direction in which it last swept tissue */
    uint64_t stroke;       /* number of strokes so far */
    pliant_edge edge;      /* during a stroke */
    double tip[3], rotation[4]; /* pose at the last motion of the edge (pliant_blade_pose) */
    /* RESISTANCE: the edge drags the tissue by the tool's hold until it slips. */
    bool is_dragging;
    bool has_slipped; /* the tissue is free: the blade cuts tissue that has moved back over it */
    double stiffness;      /* stiffness of its spring [N/m] */
    double anchor[3];      /* position of the middle of the edge at the start of dragging [m] */
    double cut_end[3];     /* the same at the end of the cut [m] */
    double drag_displacement[3];       /* motion since then, perpendicular to the edge [m] */
    double moved[3], force[3]; /* motion of the middle in the last step [m]; force in the step before [N] */
    double work;           /* work of the blade minus the energy of its cuts since it entered tissue [J] */
    double pending;        /* energy of its cuts that has been charged to `work` before they separate [J] */
    double free_tissue_force[3];     /* cutting force while tissue is free [N] */
    /* OUTPUT. */
    double engaged_length, severed_area; /* [m]; rest area since load [m^2] */
    int32_t pieces;        /* number after its last cut */
} pliant_blade;

enum { PLIANT_RESOLVED_CELLS = 2 }; /* a contact of a smaller radius has an inaccurate force, which is warned of */
/* Depth of the dimple that the mesh cannot form under a tool (sim/step/missing_compliance.h). */
typedef struct pliant_missing_depth {
    double compliance, jaw_compliance; /* depth over the force [m/N]; the same of the jaws [rad/(N m)] */
    double fraction;                   /* depth over the depth of the whole dimple. 1: it is unknown */
    double cells;                      /* radius of the narrowest contact over the cell size. 0: it is unknown */
} pliant_missing_depth;

/* Load of the tissue on a proxy: force and torque about the tip, and torque that opens the jaws [N, N m]. */
typedef struct pliant_proxy_load { double wrench[6], jaw; } pliant_proxy_load;

typedef struct pliant_tool {
    char name[48];
    /* INPUT, written by pliant_tool_*. */
    bool present;          /* has a pose */
    double tip[3];         /* LPS [m] */
    /* Quaternion x y z w, for the directions of published forces; the solver does not use it. */
    double rotation[4];
    pliant_drive drive;
    double driving_force[3]; /* PLIANT_DRIVE_FORCE: force on the tissue [N] */
    double stiffness, damping, radius; /* from the scene; can be set per tool [N/m, N s/m, m] */
    double mass;           /* at the held point [kg] */
    /* HOLD, written by grasp and release. */
    bool holding;
    uint64_t hold;         /* number of grasps so far */
    int32_t num_held;      /* fine nodes that share the force ([H] 11: barycentric weights over the grasped ball) */
    int32_t *held;         /* (num_held), ascending */
    double *weight;        /* (num_held), sum 1 */
    bool attached;         /* the solver has this hold */
    double last_target[3]; /* target of the held point in the last step [m] */
    /* Offset from the held point to the tip at the time of the grasp (pliant_tool_target) [m]. */
    double tip_offset[3];
    double grasped[3], grasped_radius; /* the grasped ball, at rest [m] */
    double slipped;        /* slip distance of this hold (grasp/slip) [m] */
    pliant_blade blade;
    /* SHAPE, written by pliant_tool_set_shape, _set_jaw. */
    pliant_tool_shape shape;
    double jaw;            /* angle [rad] */
    bool warned_of_cells;  /* the log has a warning that a contact is narrow (pliant_contact_warn_of_cells) */
    /* PROXY: the simulated tool. It is at the measured pose unless tissue blocks it (sim/step/proxy.h). For a tool
     * without a shape: the pose at the end of the last step. */
    struct {
        bool known;
        bool released;         /* it was placed inside tissue, and has no contact until it has left the tissue */
        bool has_jumped;       /* in the last step, to the measured pose */
        double tip[3], rotation[4], jaw;
        double target[3]; /* tip of the target in the last step [m] */
        /* Quasi-static steps: where the proxy would be without a load, and the load of its coupling. Both end as far in
         * a leg as the proxy does. The load is not summed over the contact points again, because points vanish. */
        pliant_tool_pose unloaded;
        pliant_proxy_load load;
        /* Force and torque of its coupling, and torque of its jaws, from the solve of the last leg [N, N m]. A
         * shortened leg does not change them. */
        double coupling_load[3];
        pliant_missing_depth missing; /* in the last leg */
        bool saturated;        /* its coupling has reached its maximum force (contact/max_force, contact/grip_torque) */
    } proxy;
    /* OUTPUT of the last step. */
    double held_point[3];  /* position of the held point [m] */
    double force[3];       /* of the tool on the tissue [N] */
} pliant_tool;

/* Return the drive of the solver: the tool's own, or its blade's spring. */
static inline pliant_drive pliant_tool_drive(const pliant_tool *tool)
{
    return tool->blade.is_dragging ? PLIANT_DRIVE_SPRING : tool->drive;
}
static inline double pliant_tool_stiffness(const pliant_tool *tool)
{
    return tool->blade.is_dragging ? tool->blade.stiffness : tool->stiffness;
}
static inline double pliant_tool_damping(const pliant_tool *tool)
{
    return tool->blade.is_dragging ? 0 : tool->damping;
}
static inline double pliant_tool_mass(const pliant_tool *tool) { return tool->blade.is_dragging ? 0 : tool->mass; }
/* Return whether the tool drags tissue by a blade that acts at the proxy. */
static inline bool pliant_tool_drags_at_proxy(const pliant_tool *tool)
{
    return tool->blade.is_dragging && tool->shape.num_parts > 0;
}
/* Return a coordinate of the target of the held point [m]. It moves with the tool, which is the predicted proxy during
 * a leg. A blade at the proxy drags tissue to where the blade was when the step began. */
static inline double pliant_tool_target(const pliant_tool *tool, int d)
{
    return (pliant_tool_drags_at_proxy(tool) ? tool->blade.tip[d] : tool->tip[d]) - tool->tip_offset[d];
}
/* Return whether the tool holds tissue, other than by its blade. */
static inline bool pliant_tool_grips(const pliant_tool *tool) { return tool->holding && !tool->blade.is_dragging; }

/* Earlier bodies for undo, the latest last. */
typedef struct pliant_undo {
    const pliant_body **body; /* (count) each retained */
    int32_t count;
    int tool;                 /* tool of the last cut; -1: pliant_data_cut */
    uint64_t stroke;
    bool reported;                /* that the limit is reached was logged */
} pliant_undo;

/* Work arrays of collision detection, and sides of parts (src/sim/step/contact.c). */
typedef struct pliant_contact_search pliant_contact_search;

typedef struct pliant_rollback pliant_rollback; /* state at the start of a step (src/sim/step/rollback.c) */
typedef struct pliant_clearance pliant_clearance; /* surface for contact, for distances to it (src/tool/clearance.c) */
typedef struct pliant_legs pliant_legs; /* start of the present leg, and responses of proxy couplings (src/sim/step) */

typedef struct pliant_backend pliant_backend; /* functions of a step's stages (src/backend) */
typedef struct pliant_solver pliant_solver; /* iteration history, factors, background factorization (src/fem) */

typedef struct pliant_patch pliant_patch; /* local fine solutions around grasps (src/fem) */

typedef struct pliant_rigid_pieces pliant_rigid_pieces; /* motion of detached pieces (src/fem/rigid) */

typedef struct pliant_tled pliant_tled; /* displacements, increments, sub-steps of explicit dynamics (src/fem) */

struct pliant_data {
    const pliant_model *model; /* the model; it outlives this struct */
    pliant_account *account;  /* account of its memory; shared with a state that replaces it */
    /* BODY. */
    const pliant_body *body;  /* present body; initially, and after a reset, the model's */
    const pliant_discretization *discretization; /* of the body, or of an earlier body with the same topology */
    uint64_t last_revision;   /* highest revision of a body so far */
    /* BACKEND. */
    /* Runs the stages from solve on: as in the scene's solver/backend, or the CPU after a GPU failure. */
    const pliant_backend *backend;
    void *backend_state;      /* Nullable: the backend's state */

    pliant_background background;
    pliant_step_clock clock;

    /* CUT. */
    pliant_undo undo;
    size_t reserved_bytes;    /* freed memory kept for the next cut (base/buffer.h) [bytes] */
    /* INTERACT. */
    pliant_tool tools[PLIANT_MAX_TOOLS];
    int32_t num_tools;
    double gravity[3];        /* LPS [m/s^2]; initially from the scene, changed by pliant_data_set_gravity */
    /* CONTACT, SOLVE. */
    pliant_contact_search *contact_search; /* Nullable: no contact was possible yet */
    pliant_contacts contacts; /* of this step: points from collision detection, forces from the solver */
    double fraction;             /* fraction of the step's time in the present leg (sim/step/legs.h) */
    const struct pliant_contact_bodies *bodies; /* Nullable: rigid bodies in contact in the present leg */
    pliant_legs *legs;        /* Nullable: state at the start of a leg, and work arrays */
    /* SOLVE. */
    pliant_solver *solver;    /* NULL with solver/kind tled */
    pliant_tled *tled;        /* Nullable: solver/kind tled */
    /* PATCH. */
    pliant_patch *patch;      /* Nullable: model/patch */
    /* PATCH, at its end. */
    pliant_rigid_pieces *rigid_pieces;  /* Nullable: no piece is detached */
    /* UPSAMPLE, PATCH. */
    double *positions;        /* (body->fine.num_nodes x 3) LPS [m]; written by every step */
    /* ROLLBACK of a failed step. */
    pliant_rollback *rollback; /* Nullable: no step was run yet */
    pliant_clearance *clearance; /* empty until the distance of a tool to the tissue is requested */
    /* WARP. */
    pliant_warp *warp;        /* Nullable: only after pliant_data_set_warp */

    pliant_statistics statistics;
};

#ifdef __cplusplus
}
#endif
#endif
