/* Who runs the stages of a step: one table of functions a backend. The CPU is always there, and what the others are
 * compared with. State stays where the backend keeps it; what the host needs comes back in every step: fine positions,
 * the tools' forces, statistics. Drawing and segmenting on their own have tables of their own (warp/device.h,
 * scan/segment.h). */
#ifndef PLIANT_BACKEND_BACKEND_H
#define PLIANT_BACKEND_BACKEND_H

#include "contact/detect/tissue.h"
#include "state/data.h"
#include "scene/gpu_choice.h"

#ifdef __cplusplus
extern "C" {
#endif

/* What a kind of solver (solver/kind) does on the host, whoever runs its steps. */
typedef struct pliant_host_solver {
    pliant_status (*create)(const pliant_model *model, pliant_data *data); /* its state in data, at rest. Errors: MEMORY, SCENE */
    /* that of the next body, whose discretization next has, in next, from data's, which stays as it is. Errors: MEMORY,
     * SCENE, NUMERIC */
    pliant_status (*follow)(const pliant_model *model, const pliant_data *data, const pliant_body_map *map, pliant_data *next);
    pliant_status (*reset)(pliant_data *data);                             /* to rest. Errors: MEMORY (nothing changed) */
    pliant_status (*interact)(const pliant_model *model, pliant_data *data); /* the first stage of a step: what the tools pull at */
    void (*set_positions)(const pliant_model *model, pliant_data *data, const double *positions); /* data's own positions too */
    void (*limits)(pliant_data *data, int iterations, double tolerance);
    void (*fell_back)(pliant_data *data); /* another backend failed: what it made is not to be used. Nullable */
    const pliant_backend *cpu, *cuda; /* who can run its steps; cuda is NULL in a build without */
} pliant_host_solver;
extern const pliant_host_solver pliant_corotational, pliant_explicit;

struct pliant_backend {
    const char *name;
    const pliant_host_solver *kind;
    bool on_host; /* keeps no state of its own: nothing to download or to free, and none to fall back on when it fails */
    bool solves_on_host; /* what a solve leads to is the host's as soon as it ends: when a later stage fails, it is not done again */
    bool touches; /* its solve knows of contacts, as those on the host do */
    pliant_probe probe;
    const pliant_tissue_searcher *searcher; /* of tissue that touches tissue; Nullable: the CPU */

    /* STATE of a data, from its host state. Errors: MEMORY, NUMERIC, UNAVAILABLE. */
    pliant_status (*create)(const pliant_model *model, pliant_data *data);
    void (*free)(pliant_data *data); /* NULL on the host */
    /* The host's state is of the next body, and before has that of the one before: take what differs. map:
     * pliant_data_set_body. Where *possible is false, or on an error, it is made anew. Nullable: it always is. Errors:
     * MEMORY, UNAVAILABLE. */
    pliant_status (*follow)(const pliant_model *model, pliant_data *data, const pliant_data *before, const pliant_body_map *map, bool *possible);
    pliant_status (*restart)(const pliant_model *model, pliant_data *data); /* the host's state was changed: take it */
    pliant_status (*move)(const pliant_model *model, pliant_data *data); /* nodes of it are elsewhere, and nothing else has changed; Nullable: as restart */
    void (*download)(const pliant_model *model, pliant_data *data); /* the state of the last step to the host's solver; NULL: it is there */

    /* STAGES, each from the state that the one before left */
    pliant_status (*solve)(const pliant_model *model, pliant_data *data);
    pliant_status (*upsample)(const pliant_model *model, pliant_data *data);
    pliant_status (*bring)(const pliant_model *model, pliant_data *data); /* after upsample, before the step goes on: what it led to becomes the host's. Nullable: it is */
    pliant_status (*warp)(const pliant_model *model, pliant_data *data);
};

extern const pliant_backend pliant_cpu_backend;
extern const pliant_backend pliant_tled_backend; /* explicit dynamics on the CPU */
/* what the two share */
bool pliant_cpu_probe(char *text, size_t size);
pliant_status pliant_cpu_nothing(const pliant_model *model, pliant_data *data);
pliant_status pliant_cpu_warp(const pliant_model *model, pliant_data *data);
/* explicit dynamics: positions from the displacements, what is told of the tools */
pliant_status pliant_tled_upsample(const pliant_model *model, pliant_data *data);

/* Before the corotational solve: what a tool pulls at, and where to. Errors: MEMORY. */
pliant_status pliant_pull(const pliant_model *model, pliant_data *data, int tool);
/* Rigid tools that hold one point (state/shared_hold.h) share one constraint and its force. Return the first of them,
 * the leader, which has the constraint. Any other tool is its own leader. */
int pliant_pull_leader(const pliant_data *data, int tool);
/* List the tools that share the constraint of a leader, the leader first. @return how many */
int pliant_pull_members(const pliant_data *data, int leader, int member[PLIANT_MAX_TOOLS]);
/* Before it, too: the points of contact, where the host's solver knows the positions. Errors: MEMORY. */
pliant_status pliant_push(pliant_data *data);
/* After a solve: where every tool's held point is, and what force it took. */
void pliant_pull_report(pliant_data *data);

#ifdef PLIANT_WITH_CUDA
extern const pliant_backend pliant_cuda_backend, pliant_cuda_tled_backend;
#endif

/* The host moves nodes after the solve, which a backend that solves elsewhere must bring before, and take again. */
static inline bool pliant_host_moves(const pliant_data *data) { return data->patch || data->falling; }

const pliant_host_solver *pliant_host_solver_of(const pliant_model *model);

/* For a data that was just made. A line in the log says which it is; with auto also why not a GPU. */
pliant_status pliant_backend_create(const pliant_model *model, pliant_data *data);
/* The host's state was changed: the backend takes it, or the CPU goes on. Errors: none but those of neither. */
pliant_status pliant_backend_restart(const pliant_model *model, pliant_data *data);
/* The same where nodes are elsewhere, amid a step, and nothing else has changed: what was made for the step so far is
 * kept. */
pliant_status pliant_backend_move(const pliant_model *model, pliant_data *data);
/* The host's state is of another body than before's, whose arrays are still there: the backend follows, makes its own
 * anew, or the CPU goes on. */
void pliant_backend_follow(const pliant_model *model, pliant_data *data, const pliant_data *before, const pliant_body_map *map);
/* Whether a GPU solves for the fine nodes themselves, none of which has been moved since: its state is where they
 * are. */
bool pliant_positions_are_state(const pliant_data *data);
/* After a failure of the backend: the CPU goes on from the last good state. false: it was the CPU's own failure. */
bool pliant_backend_fall_back(const pliant_model *model, pliant_data *data, pliant_status status);

#ifdef __cplusplus
}
#endif
#endif
