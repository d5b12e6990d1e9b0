/* What the quasi-static solve keeps on the GPU from step to step, for the files that make it, step it and carry it
 * over. */
#ifndef PLIANT_CUDA_SOLVER_H
#define PLIANT_CUDA_SOLVER_H

#include "cuda/fem/linear/preconditioner.h"
#include "cuda/fem/quasistatic/solve.h"
#include "cuda/fem/system.h"
#include "cuda/fem/quasistatic/touch.h"

#ifdef __cplusplus
extern "C" {
#endif

typedef struct gpu_tool_arrays {
    int32_t *d_unknown;
    double *d_block, *d_response;
    size_t unknown_room, block_room, response_room; /* bytes */
} gpu_tool_arrays;

enum { SOLVER_ARRAYS = 25 };

typedef struct gpu_renewal gpu_renewal;

struct pliant_cuda_solver {
    int device;
    cudaStream_t stream; /* borrowed */
    pliant_preconditioner_choice choice;
    gpu_system system;
    gpu_system_room system_room;
    gpu_preconditioner preconditioner;
    bool of_state;             /* it was made of a state, not of rest */
    gpu_renewal *renewal;      /* Nullable: the next preconditioner, in the background */
    gpu_iteration iteration;
    size_t room[SOLVER_ARRAYS]; /* bytes of its arrays, of d_fine and of d_solved */
    double *d_between;         /* room to carry axes over */
    size_t between_room;
    double *h_open;            /* page-locked: numbers of the step after a cut, where there may be cuts */
    size_t open_room;          /* bytes */
    int gather_blocks;
    cudaGraphExec_t evaluation, look, touching; /* the latter two: Nullable: not used yet */
    size_t kernels;            /* in it */
    int kind;                  /* of preconditioner */
    gpu_state *h_state;        /* page-locked; its first part is what comes back */
    double *d_fine, *d_solved, *h_solved;
    size_t solved_room;        /* bytes of h_solved */
    gpu_tool_arrays tools[PLIANT_MAX_TOOLS];
    gpu_touches touches;
    bool touched;              /* in the last step */
    pliant_in_use in_use;
    bool fresh;                /* the state was taken from the host */
    double gravity[3];         /* that d_load is of */
    bool loaded;
    int32_t last_launches;     /* evaluations, that of the end among them */
};

/* ---- solve.cu: the state is the host's, and nothing else is known of it. */
pliant_status pliant_cuda_solver_begin(pliant_cuda_solver *gpu, const pliant_solver *solver);

/* ---- size.cu: arrays of the iteration for the system at hand. */
pliant_status pliant_cuda_solver_size(pliant_cuda_solver *gpu, const pliant_solver *solver);

/* ---- open.cu: the first step after a cut */
enum { PLIANT_CUDA_OPEN_PART = 2 }; /* of a step's evaluations, so many more: half; what a step begins and ends with counts for more than on the CPU */
/* Its kernels are loaded, as those of carried.h. Errors: UNAVAILABLE. */
pliant_status pliant_cuda_open_load(void);
/* Room for it. Errors: MEMORY, UNAVAILABLE. */
pliant_status pliant_cuda_solver_open_room(pliant_cuda_solver *gpu);
/* Before the first step of a fresh state, with its load, tools and limit: where a cut came before it, to where Newton's
 * step leads, and so do axes and tools' forces; the step is told. evaluations: out: that it took; 0: there was none.
 * Errors: MEMORY, UNAVAILABLE. */
pliant_status pliant_cuda_solver_open(pliant_cuda_solver *gpu, pliant_solver *solver, gpu_step *step, int32_t *evaluations);

/* ---- evaluate.cu: the evaluation as a graph. */
pliant_status pliant_cuda_solver_record(pliant_cuda_solver *gpu);
/* A step's first evaluation; known: as pliant_cuda_complete has it. Few kernels go one by one: the GPU begins with the
 * first of them sooner than with a graph, and works on those while graphs follow. */
pliant_status pliant_cuda_solver_evaluate_first(pliant_cuda_solver *gpu, bool known);
/* The two halves of an evaluation, between which contacts find their forces: up to the free step, and from there on. */
pliant_status pliant_cuda_solver_look(pliant_cuda_solver *gpu);
pliant_status pliant_cuda_solver_judge(const pliant_cuda_solver *gpu);
/* One whose contacts' forces the GPU finds. */
pliant_status pliant_cuda_solver_evaluate_touching(pliant_cuda_solver *gpu);

/* ---- renew.cu: a preconditioner of its own for a body whose one is carried over, made in the background */
/* At the start of a step: what has arrived is put to use (*renewed), and the next one begun. Errors: MEMORY,
 * UNAVAILABLE; where none could be made, the old one stays. */
pliant_status pliant_cuda_renewal_step(pliant_cuda_solver *gpu, const pliant_solver *solver, pliant_statistics *statistics, bool *renewed);
/* One for the system at hand, waited for and timed. at: Nullable: at rest. Errors: MEMORY, NUMERIC, UNAVAILABLE; out
 * may hold part of it then. */
pliant_status pliant_cuda_preconditioner_make(pliant_cuda_solver *gpu, const pliant_solver *solver, const gpu_state_made_at *at, gpu_preconditioner *out);
/* How long it takes, once more, since the first one of a process loads kernels. Without memory for it that stands.
 * Errors: UNAVAILABLE. */
pliant_status pliant_cuda_preconditioner_time(pliant_cuda_solver *gpu, const pliant_solver *solver);
/* In place of one of this body: of the state that the step has led to, at once; *made: false: none could be made, or it
 * is carried over from a body before. It turns the axes. Errors: MEMORY, UNAVAILABLE. */
/* Where the one in use is of a state: of rest. Errors: UNAVAILABLE. */
pliant_status pliant_cuda_renew_at_rest(pliant_cuda_solver *gpu, const pliant_solver *solver);
/* The next body: what is under way will be of the one before. node: (nodes of the solved mesh) of that one's. Errors:
 * MEMORY. */
pliant_status pliant_cuda_renewal_follow(pliant_cuda_solver *gpu, int32_t num_nodes, const int32_t *node);
void pliant_cuda_renewal_free(pliant_cuda_solver *gpu); /* waits for the background */

#ifdef __cplusplus
}
#endif
#endif
