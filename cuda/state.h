/* The solver's state on the GPU: what src/fem/quasistatic/solver.c keeps, laid out for kernels that decide by themselves, so that the host
 * looks only when a step is done. Iterate `now` and the trial are buffers 0 and 1 and change places. */
#ifndef PLIANT_CUDA_STATE_H
#define PLIANT_CUDA_STATE_H

#include "fem/quasistatic/solver.h"

#include <cuda_runtime_api.h>

#ifdef __cplusplus
extern "C" {
#endif

enum { GATHER_SUMS = 2, DOT_SUMS = 4 + PLIANT_MAX_HISTORY };
enum { GPU_ROWS = PLIANT_MAX_ROWS, GPU_HISTORY = PLIANT_MAX_HISTORY, GPU_TOOLS = PLIANT_MAX_TOOLS };

/* What becomes of x after an evaluation: the step is done; the next trial; the present one takes its step unseen; the trial is
 * what was left so in the last step, or the body at rest. */
enum { PLAN_NOTHING, PLAN_TRIAL, PLAN_LAST, PLAN_LEFT, PLAN_REST };

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
    int32_t max_iterations, depth, forget;
    double tolerance, smallest_scale;
} gpu_step;

typedef struct gpu_state {
    gpu_step step;
    /* what the host reads */
    int32_t now;               /* buffer of the present iterate */
    int32_t done, iterations, rejected;
    double merit[2], scale[2], residual_force[2], force[2][GPU_ROWS];
    double first_merit;        /* that this step began with */
    double rate;               /* merit after over before an evaluation, mean of this step; 0: there was nothing to do */
    /* springs: rows of S = c I + W Z, only those of tools with springs */
    int32_t rows, row_of[GPU_ROWS]; /* 3 tool + axis */
    int32_t singular;
    double step_force[2][GPU_ROWS];
    /* Anderson */
    int32_t num_history, next_history;
    int32_t refused;           /* trials refused since the last accepted one, from step to step where none is accepted */
    int32_t accepted;          /* a trial of this step was */
    int32_t slow;              /* steps in a row that hardly lowered the merit */
    int32_t ahead;             /* the present x is one step beyond what was evaluated; what was is in d_left_x and left_force */
    double left_force[GPU_ROWS];
    double before;             /* merit of the iterate before the present one */
    double energy;             /* step . pull of the present iterate, without springs */
    double along[GPU_HISTORY]; /* secants' step . pull of the present iterate */
    /* what the next proposal does */
    int32_t remember;          /* place for the secant of trial and old present; -1: none */
    int32_t old_now;           /* buffer that was present when the trial was made */
    int32_t propose;           /* PLAN_... */
    int32_t num_weights;
    double weights[GPU_HISTORY], damping;
} gpu_state;

/* What goes with it and is too much to be copied in every decision. */
typedef struct gpu_history {
    double inverse[GPU_ROWS * GPU_ROWS];   /* of S, its leading rows x rows */
    double gram[GPU_HISTORY][GPU_HISTORY]; /* secants' step . secants' pull */
    double force[GPU_HISTORY][GPU_ROWS], step_force[GPU_HISTORY][GPU_ROWS]; /* secants' of the tools */
} gpu_history;

/* Arrays of the iteration. Pointers are of the device; n = 3 num_free. */
typedef struct gpu_iteration {
    int32_t num_free, num_nodes, depth;
    const int32_t *d_node_of_free; /* (num_free) */
    const double *d_rest;      /* (3 num_nodes) */
    gpu_state *d_state;
    gpu_history *d_history;
    double *d_x[2], *d_left_x; /* (3 num_nodes) */
    double *d_step[2], *d_pull[2]; /* (n) */
    double *d_load, *d_extra;  /* (n) gravity; the tools' forces */
    double *d_secant_x, *d_secant_step, *d_secant_pull; /* (depth x n) */
    double *d_element_force;   /* (num_tets x 4 x 4), three numbers and a gap; or (corners of macro-elements x 4) */
    double *d_turn;            /* (num_free x 9) rotation of the preconditioner at each node */
    float *d_right, *d_left;   /* (n, padded) what the preconditioner takes and gives */
    double *d_sums;            /* (GATHER_SUMS x blocks of the gather), then (DOT_SUMS x blocks of the dot products) */
} gpu_iteration;

#ifdef __CUDACC__
/* the iterate that an evaluation is about */
static __device__ __forceinline__ int gpu_target(const gpu_state *state) { return state->iterations == 0 ? state->now : 1 - state->now; }
#endif

#ifdef __cplusplus
}
#endif
#endif
