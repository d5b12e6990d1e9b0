/* The solve stage. A step moves tissue and tools in legs: each finds points of contact, solves for where all goes, and goes there as far as no tissue enters the
 * core of a part (pliant_advance_find). One leg is enough where nothing is in the way. What a step does not get to is left to the next one. */
#ifndef PLIANT_SIM_LEGS_H
#define PLIANT_SIM_LEGS_H

#include "contact/detect/find.h"
#include "fem/quasistatic/contact.h"
#include "fem/rigid/falling.h"
#include "sim/step/proxy.h"

#ifdef __cplusplus
extern "C" {
#endif

/* A tool in a step. */
typedef struct pliant_leg_tool {
    pliant_tool_pose measured;     /* as it was set */
    pliant_tool_pose begin, ahead, goal; /* of its proxy in the leg at hand: ahead is where it is expected to end, and goal first where it shall go, then where it was solved to */
    double axis[3];                /* of its jaws, of length 1 */
    double gives[2];               /* pliant_contact_gives of the leg before */
    double target[3];              /* what it pulls tissue to, where it is measured [m] */
    pliant_proxy_load before;      /* on its proxy as the leg begins */
} pliant_leg_tool;

struct pliant_legs {
    pliant_leg_tool tool[PLIANT_MAX_TOOLS];
    pliant_touch_piece proxy[2 * PLIANT_MAX_TOOLS];
    pliant_touch_pieces bodies;    /* pieces and proxies */
    bool blocked;                  /* the leg before could not go all of its way */
    bool planes;                   /* one of this step could not, or the last one of the step before: planes keep tissue out of cores */
    /* WHAT THE LEG BEGINS WITH; between that and where it was solved to lies where it ends */
    int32_t room_nodes, room_solved, room_shares;
    double *share;                 /* (nodes) fraction of its way that each node goes: elements keep their least volume */
    double *positions, *solved;    /* (nodes x 3), of the fine mesh and of the one that is solved [m] */
    double force[PLIANT_MAX_TOOLS][3]; /* of what tools pull with [N] */
    pliant_contacts points;        /* with forces and anchors */
    pliant_falling_kept *falling;  /* Nullable */
    /* EXPLICIT DYNAMICS: forces are means over the step */
    pliant_contacts told, merged;
};

/* Contact, solve, upsample and patch. *caveat: of the last leg. Errors: as of the stages */
pliant_status pliant_legs_stage(const pliant_model *model, pliant_data *data, pliant_status *caveat);
void pliant_legs_free(pliant_data *data);
/* By stages, for tests: points of a leg in which tools go to where they are measured; and tools are there. Errors: MEMORY */
pliant_status pliant_legs_find(const pliant_model *model, pliant_data *data);
void pliant_legs_arrive(pliant_data *data);

/* ---- legs_keep.c: where a leg begins, and a part of its way. Errors: MEMORY; of a backend that cannot go on from there */
pliant_status pliant_legs_keep(const pliant_model *model, pliant_data *data);
pliant_status pliant_legs_keep_points(pliant_data *data);
/* Of all that the leg has moved, but for proxies. */
pliant_status pliant_legs_go_partway(const pliant_model *model, pliant_data *data, double share);
/* Nodes go so far that no element inverts (contact/advance/volume.h). */
pliant_status pliant_legs_keep_volumes(const pliant_model *model, pliant_data *data);
/* Explicit dynamics: points of a part of the step, to those that are told of all of it; those. Errors: MEMORY */
pliant_status pliant_legs_add_forces(pliant_data *data, double share);
void pliant_legs_tell_forces(pliant_data *data);

#ifdef __cplusplus
}
#endif

#endif
