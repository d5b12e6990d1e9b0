/* Data of the quasi-static solver that stays on the GPU between steps, for the files that create, run and carry it
 * over. */
#ifndef PLIANT_CUDA_SOLVER_H
#define PLIANT_CUDA_SOLVER_H

#include "cuda/fem/linear/preconditioner.h"
#include "cuda/fem/quasistatic/solve.h"
#include "cuda/fem/quasistatic/pressures.h"
#include "cuda/fem/system.h"
#include "cuda/fem/quasistatic/contact.h"

typedef struct gpu_tool_arrays {
    int32_t *d_unknown;
    double *d_block, *d_response;
    size_t unknown_capacity, block_capacity, response_capacity; /* bytes */
} gpu_tool_arrays;

enum { SOLVER_ARRAYS = 25 };

typedef struct gpu_refresh gpu_refresh;

struct pliant_cuda_solver {
    int device;
    cudaStream_t stream; /* borrowed */
    pliant_preconditioner_choice choice;
    gpu_system system;
    gpu_system_capacity system_capacity;
    gpu_preconditioner preconditioner; /* in use */
    gpu_preconditioner at_rest; /* of the rest state, while a preconditioner of a deformed state is in use; or empty */
    gpu_preconditioner unused;  /* the next thread of the background frees it; or empty */
    double *d_reference;        /* Nullable: rotations in the deformed state (gpu_iteration.d_reference) */
    size_t reference_capacity;
    /* A trial under tools was refused since the last start of a refresh. Other steps converge well with rotated axes,
     * and a refresh takes as long as a hundred of them. */
    bool wants_refresh;
    gpu_refresh *refresh;      /* Nullable: the next preconditioner, in progress in the background */
    gpu_iteration iteration;
    gpu_pressure_memory pressure_memory;
    size_t capacity[SOLVER_ARRAYS]; /* capacity of its arrays, of d_fine and of d_solved, in bytes */
    double *d_between;              /* work array to carry over axes */
    size_t between_capacity;
    double *h_newton;       /* page-locked: results of the step after a cut, if cuts are possible */
    size_t newton_capacity; /* bytes */
    int gather_blocks;
    cudaGraphExec_t evaluation, free_step_graph, contact_graph; /* the last two are Nullable: not used yet */
    size_t kernels;            /* kernels in `evaluation` */
    int kind;                  /* kind of preconditioner in `evaluation` */
    gpu_state *h_state;        /* page-locked; its first part is copied from the device */
    double *d_fine, *d_solved, *h_solved;
    size_t solved_capacity;        /* bytes of h_solved */
    gpu_tool_arrays tools[PLIANT_MAX_TOOLS];
    gpu_contacts contacts;
    bool had_contacts;              /* there was contact in the last step */
    pliant_preconditioner_use in_use;
    bool fresh;                /* the state was read from the host */
    double gravity[3];         /* gravity of d_load */
    bool loaded;
    int32_t last_launches;     /* evaluations of the last step, including the one at its end */
};

/* ---- Implemented in solve.cu: start from the host's state, without known quantities. */
pliant_status pliant_cuda_solver_begin(pliant_cuda_solver *gpu, const pliant_solver *solver);

/* ---- Implemented in solver_allocate.cu: allocate the iteration's arrays for the present system. */
pliant_status pliant_cuda_solver_size(pliant_cuda_solver *gpu, const pliant_solver *solver);

/* ---- Implemented in newton_after_cut.cu: the first step after a cut. */
/* Load the kernels in advance, as in carried.h. Errors: UNAVAILABLE. */
pliant_status pliant_cuda_newton_load_kernels(void);
/* Allocate its arrays. Errors: MEMORY, UNAVAILABLE. */
pliant_status pliant_cuda_solver_newton_reserve(pliant_cuda_solver *gpu);
/* Take the Newton step after a cut, before the first step of a fresh state with its load, tools and limit. It updates
 * positions, axes, tools' forces and `step`.
 * @param evaluations  Out: evaluations done; 0: no Newton step was taken.
 * Errors: MEMORY, UNAVAILABLE. */
pliant_status pliant_cuda_solver_newton_step(pliant_cuda_solver *gpu, pliant_solver *solver, gpu_step *step,
                                             int32_t *evaluations);

/* ---- Implemented in evaluate.cu: the evaluation as a graph. */
pliant_status pliant_cuda_solver_record(pliant_cuda_solver *gpu);
/* Run a step's first evaluation. known: as in pliant_cuda_complete. Its few kernels are launched one by one: the GPU
 * starts earlier than with a graph, and works on them while graphs are launched. */
pliant_status pliant_cuda_solver_evaluate_first(pliant_cuda_solver *gpu, bool known);
/* Run half of an evaluation: up to the free step (free_step_graph), or the rest (judge). In between, the host computes
 * contact forces. */
pliant_status pliant_cuda_solver_free_step(pliant_cuda_solver *gpu);
pliant_status pliant_cuda_solver_evaluate_rest(const pliant_cuda_solver *gpu);
/* Run an evaluation whose contact forces are computed on the GPU. */
pliant_status pliant_cuda_solver_evaluate_contacts(pliant_cuda_solver *gpu);

/* ---- Implemented in refresh.cu: a new preconditioner that replaces a carried or a slow one, computed in the
 * background. */
/* At the start of a step, install a finished preconditioner (*renewed) and start the next one. Errors: MEMORY,
 * UNAVAILABLE. If no preconditioner can be computed, the old one stays. */
pliant_status pliant_cuda_refresh_step(pliant_cuda_solver *gpu, const pliant_solver *solver,
                                       pliant_statistics *statistics, bool *renewed);
/* Use the preconditioner of the rest state again. The result of background work for a deformed state will be dropped.
 * Errors: UNAVAILABLE. */
pliant_status pliant_cuda_refresh_return_to_rest(pliant_cuda_solver *gpu);
/* Do the same when the state is set. Unless steps are live, wait for that work: later steps do not depend on earlier
 * ones. */
pliant_status pliant_cuda_refresh_restart(pliant_cuda_solver *gpu, const pliant_solver *solver);
/* Keep background work across a cut: its result will belong to the earlier body. node: (nodes of the solved mesh) node
 * before the cut. Errors: MEMORY. */
pliant_status pliant_cuda_refresh_carry_over_cut(pliant_cuda_solver *gpu, int32_t num_nodes, const int32_t *node);
void pliant_cuda_refresh_free(pliant_cuda_solver *gpu); /* waits for the background */

#endif
