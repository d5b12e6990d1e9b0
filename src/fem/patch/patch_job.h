/* What the patches keep, and what is being made for them in the background. */
#ifndef PLIANT_FEM_PATCH_PATCH_JOB_H
#define PLIANT_FEM_PATCH_PATCH_JOB_H

#include "fem/patch/patch.h"
#include "fem/linear/basis.h"

#include <pthread.h>
#include <stdatomic.h>

/* A hold: whose, and where. */
typedef struct patch_hold {
    uint64_t hold;            /* pliant_tool.hold; 0: none */
    pliant_foothold foothold;
} patch_hold;

/* The responses to them: of a hold alone at [t][t], of two together at [t][u], t < u (response.h). NULL: not known, or
 * too far from each other to matter. */
typedef double *patch_blocks[PLIANT_MAX_TOOLS][PLIANT_MAX_TOOLS];

/* What is being made in the background. */
typedef struct patch_job {
    pthread_t thread;
    bool running, in_thread;
    pliant_account *account;  /* that it works for */
    uint64_t due;             /* step */
    double *x;                /* (3 fine nodes) the state */
    patch_hold holds[PLIANT_MAX_TOOLS]; /* known ones borrowed from the patch, others copied here */
    bool copied[PLIANT_MAX_TOOLS];
    patch_blocks blocks;      /* likewise */
    bool wanted[PLIANT_MAX_TOOLS][PLIANT_MAX_TOOLS]; /* made here */
    pliant_basis *basis;
    pliant_solver *solver;
    pliant_status status;
    char message[256];
} patch_job;

/* What a step with a basis needs besides. */
typedef struct patch_room {
    double (*element_forces)[12][LANES]; /* of the near elements at the base */
    double *positions, *coarse;          /* (3 fine nodes), (3 coarse nodes) before the step, to undo it */
    double force[PLIANT_MAX_ROWS];       /* of the tools, likewise */
} patch_room;

/* Where a tool presses by its shape (patch_contact.c). */
typedef struct patch_press {
    uint64_t hold;            /* in place of pliant_tool.hold; 0: nowhere */
    uint64_t before;          /* what the patch in use is for, until that for hold is there; 0: none */
    double centre[3];         /* at rest, when it was first wanted [m] */
} patch_press;

struct pliant_patch {
    const pliant_scene *scene;
    const pliant_discretization *discretization; /* retained */
    struct pliant_patch *before; /* Nullable: of the body before, while a thread still works for it */
    pliant_preconditioner *preconditioner; /* of the fine system, this one's own; made with the first patch */
    patch_job job;
    atomic_bool stop;         /* the job is no longer wanted */
    atomic_bool finished;     /* it has ended */
    patch_hold holds[PLIANT_MAX_TOOLS]; /* whose responses are known */
    patch_blocks blocks;
    bool serves[PLIANT_MAX_TOOLS];      /* the basis in use is for this hold, too */
    uint64_t refused[PLIANT_MAX_TOOLS]; /* holds that no patch could be made for */
    uint64_t refused_until[PLIANT_MAX_TOOLS]; /* step */
    pliant_basis *basis;      /* Nullable */
    pliant_solver *solver;    /* of it */
    patch_room room;
    patch_press press[PLIANT_MAX_TOOLS];
    uint64_t num_presses;     /* that there ever were */
    bool rests;               /* it goes along with the coarse model, which has all points of contact */
    pliant_touch_pieces proxies;     /* of tools, which give way by their couplings */
    pliant_contacts inside, outside; /* the step's points: of the near part's nodes; those that the coarse model has */
    int32_t room_of, *point_of; /* (room_of) of each point which of outside, or -1 - which of inside */
    uint8_t *own;             /* (fine nodes) that the patch moves freely */
};

/* ---- patch_contact.c */
/* What a tool has hold of or presses at; 0: nothing */
uint64_t patch_hold_of(const pliant_data *data, int tool);
bool patch_still_held(const pliant_data *data, int tool, uint64_t hold);
/* Who presses, by the forces of the last step. */
void patch_find_presses(pliant_data *data);
/* As a hold. Errors: MEMORY. */
pliant_status patch_press_copy(const pliant_data *data, int tool, patch_hold *out);
/* Forces of inside and outside to the step's points. */
void patch_merge(pliant_data *data);
void patch_contact_free(pliant_patch *patch);

void patch_hold_free(patch_hold *hold);
/* whether no patch could be made for what a tool holds, and it is not time to try again */
bool patch_is_refused(const pliant_patch *patch, const pliant_data *data, int tool);

/* Begin to make a patch around all that is held. Errors: MEMORY; nothing is being made then. */
pliant_status patch_job_start(pliant_patch *patch, pliant_data *data);
/* It is no longer wanted, or was taken: waits for its thread, frees what nobody took. */
void patch_job_clear(pliant_patch *patch);

#endif
