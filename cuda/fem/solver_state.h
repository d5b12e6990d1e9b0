/* State of the quasi-static solver on the GPU. It corresponds to src/fem/quasistatic/solver.c, laid out so that kernels
 * decide without the host. The host reads the state once at the end of a step. The present iterate and the trial are
 * buffers 0 and 1, in either order. */
#ifndef PLIANT_CUDA_FEM_SOLVER_STATE_H
#define PLIANT_CUDA_FEM_SOLVER_STATE_H

#include "fem/quasistatic/solver.h"

#include <cuda_runtime_api.h>

enum { GATHER_SUMS = 2, SINGLE_SUMS = 5, DOT_SUMS = SINGLE_SUMS + 2 * PLIANT_MAX_HISTORY };
enum { GPU_ROWS = PLIANT_MAX_ROWS, GPU_HISTORY = PLIANT_MAX_HISTORY, GPU_TOOLS = PLIANT_MAX_TOOLS };

/* A tool's effect on the unknowns in this step (struct pliant_grasp_constraint). Pointers are device pointers. */
typedef struct gpu_tool {
    int32_t active, spring, count;
    const int32_t *d_unknown;  /* (count) */
    const double *d_block;     /* (count x 9) */
    const double *d_response;  /* (3 x 3 num_free) */
    double compliance, target[3], origin[3], force[3];
} gpu_tool;

/* Inputs of a step, written by the host. */
typedef struct gpu_step {
    gpu_tool tools[GPU_TOOLS];
    int32_t has_contacts;           /* there are contacts (contact.h) */
    int32_t restart,
        drops_secants; /* restart: no quantity of the state is known; drops_secants: the secants are invalid */
    int32_t known, start_is_evaluated; /* pliant_known of the first state; pliant_final_state */
    int32_t is_cycle;          /* the preconditioner is a V-cycle */
    int32_t max_evaluations, depth, capacity;
    pliant_evaluation_limit limit;   /* one more evaluation if the first one needs no work */
    double tolerance, smallest_displacement, smallest_scale;
    /* The state is the end of the Newton step after a cut (newton_after_cut.cu). The other buffer holds the state
     * before it. */
    int32_t after_newton;
    double trusted_merit, previous_force[GPU_ROWS]; /* of the state before the Newton step */
} gpu_step;

typedef struct gpu_state {
    gpu_step step;
    /* Read by the host. */
    int32_t now; /* buffer of the present iterate; after a blind step the other buffer holds the state before it */
    int32_t done, iterations;
    int32_t needs_host;        /* done until the host has computed the contact forces: too many points press */
    int32_t evaluates_end;     /* after a blind step: its end is being evaluated */
    int32_t evaluated;         /* d_element_force and d_left belong to the final state of the step */
    int32_t restored_previous; /* the state from before the previous blind step was restored */
    int32_t was_accepted;      /* the last evaluated state became the present state */
    pliant_anderson rules;     /* as on the CPU */
    double scale[2], residual_force[2], force[2][GPU_ROWS], step_force[2][GPU_ROWS];
    double accepted_scale, accepted_residual_force; /* of the last accepted evaluation */
    /* Springs: rows of S = c I + W Z, only for tools with springs. */
    int32_t rows, row_of[GPU_ROWS]; /* 3 tool + axis */
    int32_t singular;
    /* Anderson */
    double energy;             /* step . residual of the present iterate, without springs */
    double along[GPU_HISTORY]; /* products of the secants' steps with the residual of the present iterate */
    double weights[3][GPU_HISTORY]; /* weights of the next proposal, of the error estimate, and of the previous step's
                                     * error estimate */
    int32_t mixed;             /* the proposal has nonzero weights */
    int32_t old_now;           /* present buffer at the time when the last evaluated state was proposed */
    /* Squared maxima over the nodes, as bits: remaining motion, proposed motion, displacement, remaining motion of the
     * previous step. */
    unsigned long long largest[4];
    unsigned long long blocks; /* number of blocks that have added their maxima */
    /* pliant_final_state */
    int32_t last_target;        /* buffer of the last evaluation */
    int32_t start_is_evaluated; /* the first state of this step was evaluated by the previous step, for its loads */
    int32_t skips;              /* the preconditioner has no work */
    double past_step_force[GPU_ROWS];
    double past_of_now;        /* step of the present iterate . residual of the previous step's end */
    double past_along[GPU_HISTORY]; /* products of the secants' steps with the residual of the previous step's end */
} gpu_state;

typedef struct gpu_secants {
    double gram[GPU_HISTORY * GPU_HISTORY]; /* secants' step . secants' residual, including springs */
    double force[GPU_HISTORY][GPU_ROWS], step_force[GPU_HISTORY][GPU_ROWS]; /* secants of the tools' forces */
} gpu_secants;

typedef struct gpu_history {
    double inverse[GPU_ROWS * GPU_ROWS];   /* of S, its leading rows x rows */
    gpu_secants secants;
} gpu_history;

/* Sums of each block of pressures: products of the evaluated steps of the pressures with themselves, with the present
 * iterate's and with the previous step's. Products of the secants with the evaluated steps follow, and then with the
 * previous step's. */
enum { PRESSURE_OWN, PRESSURE_NOW, PRESSURE_PAST, PRESSURE_SECANTS };
enum { PRESSURE_SUMS = PRESSURE_SECANTS + 2 * GPU_HISTORY };

/* Pressures of nearly incompressible tissue (src/fem/quasistatic/pressure.h). Without such tissue, `count` is 0, and no
 * array exists. */
typedef struct gpu_pressures {
    int32_t count, elements;
    /* Constant: struct pliant_pressures. */
    int32_t *d_of_element;     /* (elements) */
    double *d_element_volume;  /* (elements) */
    double *d_volume, *d_compliance, *d_gain; /* (count) */
    int32_t *d_unknown;        /* (corners of all elements) unknown node, or -1 */
    int32_t *d_group_start;    /* (count + 1) into d_group */
    int32_t *d_group;          /* elements of each pressure; they have equally many corners */
    /* These belong to the two iterates, like gpu_iteration.d_x. */
    double *d_pressure[2], *d_step[2]; /* (count) */
    double *d_past_step;               /* (count) final step of the previous step */
    double *d_secant_pressure, *d_secant_step; /* (`capacity` x count) */
    /* These belong to the state whose forces were computed last. */
    double *d_change;          /* (elements) change of volume */
    double *d_derivative;      /* (9 x elements) its derivative by F */
    double *d_sums;            /* (PRESSURE_SUMS x blocks) */
} gpu_pressures;

/* Arrays of the iteration. Pointers are device pointers; n = 3 num_free. */
typedef struct gpu_iteration {
    int32_t num_free, num_nodes, capacity;
    const int32_t *d_node_of_free; /* (num_free) */
    const double *d_rest;      /* (3 num_nodes) */
    gpu_state *d_state;
    gpu_history *d_history;
    double *d_x[2];            /* (3 num_nodes) */
    double *d_step[2], *d_residual[2]; /* (n) in the nodes' axes, like the secants */
    double *d_free_residual;   /* (n) residual of the last evaluation, without the change of spring forces */
    double *d_past_step, *d_past_residual; /* (n) final step and residual of the previous step */
    double *d_load, *d_extra;  /* (n) gravity; the tools' forces */
    double *d_contact_force;           /* (n) contact forces */
    double *d_secant_x, *d_secant_step, *d_secant_residual; /* (`capacity` x n) */
    double *d_element_force;   /* (num_tets x 4 x 4), three numbers and padding; or (corners of macro-elements x 4) */
    double *d_rotations;       /* (num_tets or macro-elements x 16) contributions to the nodes' axes, nine numbers and
                                * padding */
    double *d_axes;            /* (num_free x 9) axes of the nodes */
    /* Nullable: (num_free x 9) rotations since rest in the preconditioner's state; NULL: I. */
    const double *d_reference;
    float *d_right, *d_left;   /* (n, padded) input and output of the preconditioner */
    double *d_sums;            /* (GATHER_SUMS x blocks of the gather), then (DOT_SUMS x blocks of the dot products) */
    gpu_pressures pressures;
} gpu_iteration;

#ifdef __CUDACC__
/* Return the buffer that is being evaluated. */
static __device__ __forceinline__ int gpu_target(const gpu_state *state)
{
    return state->iterations == 0 ? state->now : 1 - state->now;
}
/* Return whether products with the final step of the previous step are computed. */
static __device__ __forceinline__ bool gpu_looks_back(const gpu_state *state)
{
    return state->iterations == 0 && state->start_is_evaluated;
}
/* Return whether the elastic forces of the evaluated state are known from the end of the last step. */
static __device__ __forceinline__ bool gpu_has_forces(const gpu_state *state)
{
    return state->iterations == 0 && state->step.known != PLIANT_KNOWN_NOTHING;
}
#endif

#endif
