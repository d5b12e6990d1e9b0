/* The simulation state (pliant/state.h). All other data in pliant_data are the model, the topology, or buffers. A
 * GPU step ends with its positions and pressures on the host. Therefore one implementation serves both backends: a GPU
 * reads a restored state when it restarts (backend/backend.h). */
#ifndef PLIANT_SIM_STATE_H
#define PLIANT_SIM_STATE_H

#include "fem/rigid/rigid_pieces_data.h"
#include "pliant/state.h"
#include "model_data/background.h"
#include "model_data/data.h"

#ifdef __cplusplus
extern "C" {
#endif

/* Arrays of the state. An array that a simulation does not need is empty. Sizes:
 * - fine nodes, pieces, piece nodes, joints: as in the topology
 * - solved nodes: nodes of the solved mesh
 * - blocks: LANES elements each (pliant_tled_blocks)
 * - held nodes, edge points: of all tools, one tool after the other */
#define PLIANT_STATE_ARRAYS(X) \
    X(double, positions)       /* (fine nodes x 3) LPS [m] */ \
    X(double, solved)          /* quasi-static: (solved nodes x 3) solved positions; rigid pieces at their home [m] */ \
    X(double, pressure)        /* nearly incompressible tissue: (pressures) [Pa]; explicit: and their offsets [m^3] */ \
    X(double, displacement)    /* explicit: (fine nodes x 3) from rest [m] */ \
    X(double, increment)       /* explicit: (fine nodes x 3) in the last sub-step: velocity times time_step [m] */ \
    X(float, relaxed)          /* Prony: (blocks x 6 PLIANT_PRONY_TERMS x LANES) relaxed stress times volume [N m] */ \
    X(piece, pieces)           /* (pieces) velocity [m/s], angular momentum [kg m^2/s], rest and stop flags */ \
    X(double, piece_positions) /* (piece nodes x 3) [m] */ \
    X(double, piece_home)      /* (piece nodes x 3) positions at the detachment [m] */ \
    X(double, joints)          /* (joints x 3) positions of the pieces' joints in the last step [m] */ \
    X(grip, grips)             /* tools that grasp pieces */ \
    X(int32_t, held)           /* (held nodes) fine nodes of grasps */ \
    X(double, held_weight)     /* (held nodes) weights, sum 1 for each tool */ \
    X(double, edge_place)      /* (edge points x 3) cut's end, for blades in a stroke [m] */ \
    X(int32_t, edge_tet)       /* (edge points) fine tetrahedron; -1: outside tissue */ \
    X(double, edge_weight)     /* (edge points x 4) barycentric coordinates */ \
    X(int32_t, edge_carrier)  /* (edge points) fine node that the point moves with; -1: none */ \
    X(double, edge_now)        /* (edge points x 3) positions of the blade [m] */ \
    X(double, edge_carrier_offset)      /* (edge points x 3) offset from that node [m] */ \
    X(const pliant_body *, undo) /* topologies before cuts, the latest last; each retained */

typedef struct pliant_state_contact {
    pliant_contacts points;        /* of the last step: forces [N], anchors [m], contact flags */
    pliant_contact_search *search; /* Nullable: data that the search keeps between steps */
} pliant_state_contact;

/* Explicit dynamics, in addition to the arrays above. */
typedef struct pliant_state_dynamics {
    int32_t substeps, halvings;  /* number of sub-steps in a step; number of halvings of the sub-step */
    double time_step;            /* of a sub-step [s] */
    double target[PLIANT_MAX_TOOLS][3];        /* targets of grasped points [m] */
    double previous_point[PLIANT_MAX_TOOLS][3];        /* grasped points, one sub-step before the last one [m] */
    double previous_target[PLIANT_MAX_TOOLS][3]; /* their targets at that time [m] */
    double previous_time_step;          /* time between that sub-step and the last one [s] */
    double quotient[4];          /* dynamic relaxation: pliant_substep_frequency */
    double contact_energy;       /* that contacts may use to remove penetrations [J] */
    double tool_work;            /* of the tools on the tissue in the last step [J] */
} pliant_state_dynamics;

struct pliant_state {
    /* MODEL, TOPOLOGY */
    const pliant_model *model;   /* of the simulation that was saved, borrowed */
    const pliant_body *body;     /* retained; NULL: nothing is saved */
    uint64_t last_revision;      /* highest revision of a topology so far */
    int undo_tool;               /* as in pliant_undo */
    uint64_t undo_stroke;
    bool undo_reported;
    /* INPUT */
    double gravity[3];           /* LPS [m/s^2] */
    int iterations;              /* maximum number per step */
    double tolerance;            /* tolerance, relative to the largest displacement */
    pliant_background_kind background;
    /* TOOLS: input pose, pose of the last step, grasp, blade, forces [pliant_tool]. Their arrays are listed above;
     * shapes are retained. */
    int num_tools;
    pliant_tool tools[PLIANT_MAX_TOOLS];
    double grasp_force[PLIANT_MAX_TOOLS][3]; /* forces of the solver's springs at the start of the next step [N] */
    /* CONTACT: the second one is a buffer */
    pliant_state_contact contact[2];
    /* TISSUE */
    pliant_state_dynamics dynamics;
    double pieces_gravity[3]; /* gravity in the last step of rigid pieces [m/s^2] */
    bool pieces_reported;     /* the log has reported that a piece left the drawn volume */
    pliant_statistics statistics;
#define PLIANT_STATE_ARRAY(type, name) struct { type *at; size_t count, capacity; } name;
    PLIANT_STATE_ARRAYS(PLIANT_STATE_ARRAY)
#undef PLIANT_STATE_ARRAY
};

/* ---- state_arrays.c: copies between a state and a simulation of the same topology */
typedef enum pliant_state_transfer {
    PLIANT_STATE_RESERVE,
    PLIANT_STATE_SAVE,
    PLIANT_STATE_COMPARE,
    PLIANT_STATE_RESTORE
} pliant_state_transfer;
/* Transfer the arrays. RESERVE grows the state's arrays to the simulation's sizes and keeps their contents. SAVE
 * copies to the state. COMPARE compares sizes. RESTORE copies to the simulation, except arrays of tools. Return
 * false when RESERVE is out of memory, and when COMPARE finds another size. The caller handles the undo array.
 * @param tissue false: arrays of tools only */
bool pliant_state_arrays(pliant_state *state, pliant_data *data, bool tissue, pliant_state_transfer operation);
/* Grow the capacity for topologies to undo. Return false if out of memory. */
bool pliant_state_reserve_undo(pliant_state *state, size_t count);
/* Copy the arrays of a tool's grasp and blade from the state to arrays of the same sizes. */
void pliant_state_copy_grasp(const pliant_state *state, int tool, int32_t *held, double *weight);
void pliant_state_copy_edge(const pliant_state *state, int tool, pliant_edge *edge);
/* Restore the scalars and arrays of the tissue in a simulation of the state's topology. Then its backend must
 * restart. The caller restores tools and contacts. */
void pliant_state_restore_tissue(const pliant_state *state, pliant_data *data);
/* Save the scalars. The caller saves tools, contacts and topology. */
void pliant_state_save_scalars(const pliant_data *data, bool tissue, pliant_state *state);

/* ---- state_save.c */
/* tissue: its arrays; topology: the current one and those to undo */
typedef struct pliant_state_parts { bool tissue, topology; } pliant_state_parts;
/* Save some parts of the state, and all of its scalars. Errors: MEMORY (the state stays as it is). */
pliant_status pliant_state_save_parts(const pliant_model *model, pliant_data *data, const pliant_state_parts *parts,
                                      pliant_state *state);
void pliant_state_clear(pliant_state *state); /* frees all contents */

/* ---- rollback.c: rollback of a failed step */
/* Save the state after the cut stage, whose topology stays. Errors: MEMORY (the step must not continue). */
pliant_status pliant_rollback_begin(const pliant_model *model, pliant_data *data);
/* Find the positions at the start of this step in the saved state: (nodes x 3) of the fine mesh and of the solved mesh
 * [m]. Return false if they are not saved. */
bool pliant_rollback_find_positions(const pliant_data *data, const double **positions, const double **solved);
/* Restore the state without any allocation. Do nothing if this step has not saved one. */
void pliant_rollback_undo(const pliant_model *model, pliant_data *data);
void pliant_rollback_free(pliant_rollback *rollback); /* Nullable */

#ifdef __cplusplus
}
#endif
#endif
