/* The solver's state on the GPU: what src/fem/quasistatic/solver.c keeps, laid out for kernels that decide by
 * themselves, so that the host looks only when a step is done. Iterate `now` and the trial are buffers 0 and 1 and
 * change places. */
#ifndef PLIANT_CUDA_STATE_H
#define PLIANT_CUDA_STATE_H

#include "fem/quasistatic/solver.h"

#include <cuda_runtime_api.h>

#ifdef __cplusplus
extern "C" {
#endif

enum { GATHER_SUMS = 2, SINGLE_SUMS = 5, DOT_SUMS = SINGLE_SUMS + 2 * PLIANT_MAX_HISTORY };
enum { GPU_ROWS = PLIANT_MAX_ROWS, GPU_HISTORY = PLIANT_MAX_HISTORY, GPU_TOOLS = PLIANT_MAX_TOOLS };

/* What a tool does to the unknowns in this step (struct pliant_handle). Pointers are of the device. */
typedef struct gpu_tool {
    int32_t active, spring, count;
    const int32_t *d_unknown;  /* (count) */
    const double *d_block;     /* (count x 9) */
    const double *d_response;  /* (3 x 3 num_free) */
    double compliance, target[3], origin[3], force[3];
} gpu_tool;

/* What the host says at the beginning of a step. */
typedef struct gpu_step {
    gpu_tool tools[GPU_TOOLS];
    int32_t touches;           /* there are contacts (touch.h) */
    int32_t restart, forget;   /* nothing is known of the state; the secants no longer hold */
    int32_t known, seen;       /* pliant_known of its first state, and whether the preconditioner is as it was there */
    int32_t is_cycle;          /* the preconditioner is a V-cycle */
    int32_t most_evaluations, depth, room;
    pliant_even_limit limit;   /* one more where the first costs nothing */
    double tolerance, smallest_displacement, smallest_scale;
    int32_t opened;            /* the state is where the step after a cut has led to (open.cu), and the other buffer has the one before it */
    double sound_merit, previous_force[GPU_ROWS]; /* of that one */
} gpu_step;

typedef struct gpu_state {
    gpu_step step;
    /* what the host reads */
    int32_t now;               /* buffer of the present iterate; after a blind step the other one has the state before it */
    int32_t done, iterations;
    int32_t ending;            /* a blind step was made: its end is evaluated */
    int32_t evaluated;         /* d_element_force and d_left are of the state that the step ended with */
    int32_t went_back;         /* to the state before the one that the step began with */
    int32_t took;              /* what was evaluated last became the present state */
    pliant_anderson rules;     /* as on the CPU */
    double scale[2], residual_force[2], force[2][GPU_ROWS], step_force[2][GPU_ROWS];
    double told_scale, told_residual_force; /* of the last state that was evaluated and kept */
    /* springs: rows of S = c I + W Z, only those of tools with springs */
    int32_t rows, row_of[GPU_ROWS]; /* 3 tool + axis */
    int32_t singular;
    /* Anderson */
    double energy;             /* step . residual of the present iterate, without springs */
    double along[GPU_HISTORY]; /* secants' step . residual of the present iterate */
    double weights[3][GPU_HISTORY]; /* of the next proposal, of the estimate of what is left, and of that of the state before */
    int32_t mixed;             /* there are some of the first kind */
    int32_t old_now;           /* buffer that was present when what was evaluated last was proposed */
    /* largest squares over the nodes, as bits: what is left, what the proposal moves, displacement, what was left at
     * the state before */
    unsigned long long largest[4];
    unsigned long long blocks; /* that have found theirs */
    /* pliant_posterior */
    int32_t last_target;       /* buffer that was evaluated last */
    int32_t seen;              /* by this step's beginning: what its first state lacked for the loads of then */
    int32_t skips;             /* the preconditioner has nothing to do */
    double past_step_force[GPU_ROWS];
    double past_of_now;        /* step of the present iterate . residual of then */
    double past_along[GPU_HISTORY]; /* secants' step . residual of then */
} gpu_state;

typedef struct gpu_secants {
    double gram[GPU_HISTORY * GPU_HISTORY]; /* secants' step . secants' residual, and of springs */
    double force[GPU_HISTORY][GPU_ROWS], step_force[GPU_HISTORY][GPU_ROWS]; /* secants' of the tools */
} gpu_secants;

typedef struct gpu_history {
    double inverse[GPU_ROWS * GPU_ROWS];   /* of S, its leading rows x rows */
    gpu_secants secants;
} gpu_history;

/* Arrays of the iteration. Pointers are of the device; n = 3 num_free. */
typedef struct gpu_iteration {
    int32_t num_free, num_nodes, room;
    const int32_t *d_node_of_free; /* (num_free) */
    const double *d_rest;      /* (3 num_nodes) */
    gpu_state *d_state;
    gpu_history *d_history;
    double *d_x[2];            /* (3 num_nodes) */
    double *d_step[2], *d_residual[2]; /* (n) in the nodes' own axes, as the secants */
    double *d_free_residual;   /* (n) that of the last evaluation, but for what springs were to change in it */
    double *d_past_step, *d_past_residual; /* (n) that the step before ended with */
    double *d_load, *d_extra;  /* (n) gravity; the tools' forces */
    double *d_touch;           /* (n) those of contacts */
    double *d_secant_x, *d_secant_step, *d_secant_residual; /* (room x n) */
    double *d_element_force;   /* (num_tets x 4 x 4), three numbers and a gap; or (corners of macro-elements x 4) */
    double *d_rotations;       /* (num_tets or macro-elements x 16) what elements say of the axes, nine numbers and a gap */
    double *d_axes;            /* (num_free x 9) the nodes' own axes */
    float *d_right, *d_left;   /* (n, padded) what the preconditioner takes and gives */
    double *d_sums;            /* (GATHER_SUMS x blocks of the gather), then (DOT_SUMS x blocks of the dot products) */
} gpu_iteration;

#ifdef __CUDACC__
/* the iterate that an evaluation is about */
static __device__ __forceinline__ int gpu_target(const gpu_state *state) { return state->iterations == 0 ? state->now : 1 - state->now; }
/* whose elastic forces are those of the end of the last step */
static __device__ __forceinline__ bool gpu_knows_forces(const gpu_state *state) { return state->iterations == 0 && state->step.known != PLIANT_KNOWN_NOTHING; }
#endif

#ifdef __cplusplus
}
#endif
#endif
