/* The stages from contact to patch, made in legs.
 *
 * Each tool has two poses. The target pose is measured. The proxy pose is simulated, and contact happens at the
 * proxy. A virtual coupling pulls the proxy towards the target (proxy.h). A leg is one straight motion of all nodes,
 * together with all proxies. It has five parts:
 * 1. Choose the distance of the proxies in this leg: about half an element near tissue (leg_goals.c).
 * 2. Find contact points between the tissue and the parts of tools (pliant_contact_find_points).
 * 3. Solve for the new positions and the contact forces, upsample them, and solve the patches (step.c).
 * 4. Compute the largest fraction of the leg at which no surface enters the core of a part (pliant_contact_advance).
 *    The core is the region deeper than the guard depth below the part's surface. Tissue may enter the zone above
 *    the core, but it cannot pass through the part.
 * 5. Apply that fraction to the tissue and to the proxies (apply_leg). Afterwards no surface is in a core.
 * If the fraction is below 1, the leg was blocked. The next leg adds plane constraints: separating planes that keep
 * nearby triangles out of the cores. The volume bound limits the motion of nodes so that no element inverts
 * (contact/volume/volume_bound.h).
 *
 * The step ends when a leg completes the remaining motion. It also ends when its evaluations or its time are used
 * up, or after several blocked legs. The next step then makes the rest of the motion. */
#ifndef PLIANT_SIM_LEGS_H
#define PLIANT_SIM_LEGS_H

#include "contact/detect/part_contacts.h"
#include "fem/quasistatic/contact.h"
#include "fem/rigid/rigid_pieces.h"
#include "sim/step/missing_compliance.h"
#include "sim/step/proxy.h"

#ifdef __cplusplus
extern "C" {
#endif

/* One tool during a step. */
typedef struct pliant_leg_tool {
    pliant_tool_pose measured;     /* target pose */
    pliant_tool_pose behind;       /* explicit dynamics: where the proxy goes in this leg; otherwise the target pose */
    /* proxy poses in this leg: at its start; predicted at its end; desired, and after the solve the solved one */
    pliant_tool_pose begin, ahead, goal;
    bool is_placed;             /* the proxy has been set to its target at the start of this step */
    double free_fraction;       /* fraction of the leg that this tool's island can make; 1 in quasi-static steps */
    double piece_compliance[2]; /* pliant_proxy_compliance with the contact points of the previous leg */
    pliant_missing_depth missing; /* likewise */
    pliant_tool_pose from, unloaded; /* without a load: at the start and at the end of the leg */
    double yields[3];           /* pliant_proxy_estimate_tissue_compliance; 0 in quasi-static steps */
    double target[3];           /* grasp target at the target pose [m] */
    pliant_proxy_load before, after; /* load on the proxy at the start of the leg; of the solved leg */
} pliant_leg_tool;

struct pliant_legs {
    pliant_leg_tool tool[PLIANT_MAX_TOOLS];
    pliant_contact_body proxy[2 * PLIANT_MAX_TOOLS];
    pliant_touch_limit limit[3 * PLIANT_MAX_TOOLS]; /* of each proxy's force, torque, and jaws */
    pliant_contact_bodies bodies;    /* rigid pieces and proxies */
    double completed;                /* smallest fraction that anything made in this leg */
    pliant_node_loads node_loads;    /* buffer */
    bool first;                      /* this is the first leg of the step */
    bool blocked;                  /* the previous leg was blocked */
    bool holds_proxies;            /* tools do not move in this leg */
    bool limited_by_elements;      /* the volume bound shortened this leg */
    bool use_plane_constraints; /* a leg of this step, or the last leg of the previous one, was blocked */
    /* STATE AT THE START OF THE LEG: the leg ends between this state and the solved one */
    double *fraction;              /* (nodes) fraction of its motion that each node makes: volume bound, islands */
    int32_t *island;               /* (nodes + tools) forest of islands (contact_islands.c) */
    /* (nodes x 3) of the fine mesh and of the solved mesh [m]: in the rollback of the step, or in these buffers */
    const double *positions, *solved;
    double *position_buffer, *solved_buffer;
    double force[PLIANT_MAX_TOOLS][3]; /* grasp forces [N] */
    pliant_contacts points;        /* with their forces and anchors */
    pliant_rigid_pieces_saved *rigid_pieces;  /* Nullable */
    /* EXPLICIT DYNAMICS: contact points of the step with their mean forces, and a buffer */
    pliant_contacts mean_points, merged;
};

/* The stages from solve to patch, for one leg. */
typedef pliant_status pliant_solve_stages(const pliant_model *model, pliant_data *data, pliant_status *warning);

/* Make all legs of a step.
 * @param completed fraction that the last leg of the previous step made
 * @param solve     called for each leg
 * @param warning   out: status of the last leg, such as PLIANT_NOT_CONVERGED
 * Errors: as of the stages. */
pliant_status pliant_legs_run(const pliant_model *model, pliant_data *data, double completed,
                              pliant_solve_stages *solve, pliant_status *warning);
/* Without contact: set all proxies to the target poses. */
void pliant_legs_skip(const pliant_model *model, pliant_data *data);
void pliant_legs_free(pliant_data *data);
/* For tests: find the contact points of a leg in which all proxies go to their targets, or are held after a leg without
 * progress. Errors: MEMORY. */
pliant_status pliant_legs_find(const pliant_model *model, pliant_data *data, bool holds_proxies);
/* For tests: set the proxies to the goals of that leg, and end the step. */
void pliant_legs_set_goals_reached(pliant_data *data);

/* ---- leg_goals.c: where proxies go in a leg */
/* Return whether a tool has pressed tissue in the last leg. */
bool pliant_legs_press(const pliant_data *data);
/* Save the proxies' poses and loads at the start of a leg. Errors: MEMORY. */
pliant_status pliant_legs_begin_leg(const pliant_model *model, pliant_data *data);
/* Return the fraction of the remaining motion for this leg: the smallest of all tools. */
double pliant_legs_choose_fraction(const pliant_model *model, pliant_data *data);
/* Explicit dynamics: choose the number of sub-steps that may use one set of contact points. Return their fraction
 * of the remaining ones. */
double pliant_legs_choose_part(const pliant_model *model, pliant_data *data);
/* Explicit dynamics: choose the sub-step for the motion of tools and tissue in one sub-step [m]. */
void pliant_legs_choose_substep(const pliant_model *model, pliant_data *data, double motion);
/* Return the maximum motion of a proxy with this load in a leg [m]. */
double pliant_legs_max_motion(const pliant_data *data, const pliant_proxy_load *load);
/* Set the goals of all proxies for a fraction of their remaining motion. */
void pliant_legs_set_goals(const pliant_model *model, pliant_data *data, double fraction);

/* ---- legs_state.c: save the start of a leg, and apply a fraction of the leg.
 * Errors: MEMORY; a backend that cannot continue from the new positions. */
/* Return whether this is explicit dynamics, in which time passes. */
bool pliant_legs_are_dynamic(const pliant_data *data);
/* Return the grasp constraint of a tool, from its patch or from the model. Not in explicit dynamics. */
pliant_grasp_constraint *pliant_legs_grasp(const pliant_data *data, int tool);
/* Save positions, grasp forces and pieces at the start of the leg. */
pliant_status pliant_legs_save(const pliant_model *model, pliant_data *data);
/* Return whether fine nodes turn with coarse elements, and no patch moves them. Then they move on arcs. */
bool pliant_legs_turn_nodes(const pliant_data *data);
/* Return the largest fraction of the leg in which all elements keep their volume, if all nodes make this fraction on
 * straight lines. */
double pliant_legs_find_volume_fraction(const pliant_model *model, const pliant_data *data);
/* Move everything except the proxies to this fraction of the leg. */
pliant_status pliant_legs_apply_fraction(const pliant_model *model, pliant_data *data, double fraction);
/* Explicit dynamics: move each node to its own fraction of the leg (data->legs->fraction). */
pliant_status pliant_legs_apply_islands(const pliant_model *model, pliant_data *data);
/* Allocate the fractions of nodes. Errors: MEMORY. */
pliant_status pliant_legs_reserve_fractions(const pliant_data *data);
/* Shorten the motion of single nodes so that no element inverts (contact/volume/volume_bound.h).
 * @param found out: false: no such motion was found, and nothing changed */
pliant_status pliant_legs_bound_volumes(const pliant_model *model, pliant_data *data, bool *found);
/* Add a distance to the error estimate that nodes lose because the leg is shortened [m]. The solver's estimate is for
 * the end of the leg. */
void pliant_legs_add_truncation_error(pliant_data *data, double lost);
/* Explicit dynamics: add the contact forces of a leg to the mean forces of the step. fraction: the leg's fraction of
 * the step. Errors: MEMORY. */
pliant_status pliant_legs_add_forces(pliant_data *data, double fraction);
/* Explicit dynamics: publish the mean forces of the step. */
void pliant_legs_publish_forces(pliant_data *data);

#ifdef __cplusplus
}
#endif

#endif
