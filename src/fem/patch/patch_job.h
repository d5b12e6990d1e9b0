/* Data of the patches, and of the background thread that computes them. */
#ifndef PLIANT_FEM_PATCH_PATCH_JOB_H
#define PLIANT_FEM_PATCH_PATCH_JOB_H

#include "base/worker.h"
#include "fem/patch/patch.h"
#include "fem/linear/basis.h"

#include <stdatomic.h>

/* A grasp or press, and its footprint. */
typedef struct patch_hold {
    uint64_t hold;            /* pliant_tool.hold; 0: none */
    pliant_footprint footprint;
} patch_hold;

/* Responses to the footprints: to a single one at [t][t], to a pair at [t][u], t < u (response.h). NULL: unknown, or
 * too far apart to interact. */
typedef double *patch_blocks[PLIANT_MAX_TOOLS][PLIANT_MAX_TOOLS];

/* Work of the background thread. */
typedef struct patch_job {
    pliant_worker worker;
    bool running;             /* the result was not taken yet */
    uint64_t due;             /* step at which the result is installed */
    double *x;                /* (3 fine nodes) the state */
    patch_hold holds[PLIANT_MAX_TOOLS]; /* known ones are borrowed from the patch, others are copies */
    bool copied[PLIANT_MAX_TOOLS];
    patch_blocks blocks;      /* borrowed or computed, likewise */
    bool wanted[PLIANT_MAX_TOOLS][PLIANT_MAX_TOOLS]; /* blocks that the thread computes */
    pliant_basis *basis;
    pliant_solver *solver;
    pliant_status status;
    char message[256];
} patch_job;

/* Work arrays of a step with a basis. */
typedef struct patch_buffers {
    double (*element_forces)[12][LANES]; /* element forces of the near elements at the base */
    double *positions, *coarse;          /* (3 fine nodes), (3 coarse nodes) state before the step, for rollback */
    double force[PLIANT_MAX_ROWS];       /* tool forces before the step */
} patch_buffers;

/* State of a tool that presses with its shape (patch_contact.c). */
typedef struct patch_press {
    uint64_t hold;            /* number used like pliant_tool.hold; 0: no press */
    uint64_t before;          /* number of the patch in use until the patch for `hold` is ready; 0: none */
    double centre[3];         /* rest position of the press when its patch was requested [m] */
} patch_press;

struct pliant_patch {
    const pliant_scene *scene;
    const pliant_discretization *discretization; /* retained */
    struct pliant_patch *before; /* Nullable: the patches before a cut, while their thread is running */
    pliant_preconditioner *preconditioner; /* of the fine system; owned, and created with the first patch */
    patch_job job;
    atomic_bool stop;         /* the result is not needed any more */
    patch_hold holds[PLIANT_MAX_TOOLS]; /* holds with known responses */
    patch_blocks blocks;
    bool is_in_basis[PLIANT_MAX_TOOLS];      /* the basis in use includes this tool's hold */
    uint64_t refused[PLIANT_MAX_TOOLS]; /* holds for which no patch could be computed */
    uint64_t refused_until[PLIANT_MAX_TOOLS]; /* step */
    pliant_basis *basis;      /* Nullable */
    pliant_solver *solver;    /* of it */
    patch_buffers buffers;
    patch_press press[PLIANT_MAX_TOOLS];
    uint64_t num_presses;     /* number of presses so far */
    bool is_suspended;        /* it moves with the coarse model, which has all contact points */
    pliant_contact_bodies proxies;   /* proxies of tools, which move by their couplings */
    pliant_contacts inside, outside; /* contact points of the step: on the near part's nodes, and on the coarse model */
    int32_t point_capacity,
        *point_of;            /* (point_capacity) index of each point in `outside`, or -1 - index in `inside` */
    uint8_t *own;             /* (fine nodes) nonzero: an own node of the patch */
};

/* ---- Implemented in patch_contact.c. */
/* Return the hold or press number of a tool; 0: neither. */
uint64_t patch_hold_of(const pliant_data *data, int tool);
bool patch_still_held(const pliant_data *data, int tool, uint64_t hold);
/* Find the pressing tools from the forces of the last step. */
void patch_find_presses(pliant_data *data);
/* Copy a press as a hold. Errors: MEMORY. */
pliant_status patch_press_copy(const pliant_data *data, int tool, patch_hold *out);
/* Copy the forces of `inside` and `outside` to the step's points. */
void patch_merge(pliant_data *data);
void patch_contact_free(pliant_patch *patch);

void patch_hold_free(patch_hold *hold);
/* Return whether no patch could be computed for the tool's hold, and it is too early for another attempt. */
bool patch_is_refused(const pliant_patch *patch, const pliant_data *data, int tool);

/* Start the computation of a patch around all holds. Errors: MEMORY; no work is running then. */
pliant_status patch_job_start(pliant_patch *patch, pliant_data *data);
/* Finish or cancel the job: wait for its thread and free unused results. */
void patch_job_clear(pliant_patch *patch);

#endif
