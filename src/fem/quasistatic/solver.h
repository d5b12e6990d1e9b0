/* The quasi-static solver: find x with f_int(x) = load + sum of the tools' forces.
 *
 * The solver takes fixed-point steps with a constant factor K0 of the warped stiffness. Anderson acceleration (type II,
 * in the energy norm of K0) accelerates them. A step is accepted only if it lowers the merit. A background thread
 * refreshes K0 at fixed steps, so that the same input gives bitwise identical results (NUMERICS.md).
 *
 * A tool that holds the tissue by a spring of compliance c adds a force l at y = W x with  c l = target - y. With c = 0
 * the tool prescribes the displacement. The pair (x, l) is stepped together:
 *     K0 dx - W' dl = r,   W dx + c dl = e,   r = load + W' l - f_int(x),   e = target - y - c l
 * by the Schur complement  S = c I + W Z,  Z = K0^-1 W'  (three columns per tool; Woodbury, NUMERICS.md).
 *
 * The merit is the energy norm of this step, dx' K0 dx + c dl' dl. The product K0 dx = r + W' dl needs no extra
 * operations. Steps, W and secants are vectors in the rotated axes of the nodes (nodal_rotations.h). Positions, loads
 * and forces are in world axes. */
#ifndef PLIANT_FEM_QUASISTATIC_SOLVER_H
#define PLIANT_FEM_QUASISTATIC_SOLVER_H

#include "fem/quasistatic/anderson.h"
#include "fem/quasistatic/contact.h"
#include "fem/quasistatic/evaluation_limit.h"
#include "fem/quasistatic/nodal_rotations.h"
#include "fem/element/pressures.h"
#include "fem/system.h"
#include "model_data/background.h"
#include "model_data/data.h"

#ifdef __cplusplus
extern "C" {
#endif

/* The effect of one tool on the unknowns. */
typedef struct pliant_grasp_constraint {
    bool active;
    bool by_force;            /* true: a prescribed force, without a spring */
    double force[3];          /* force on the tissue: prescribed, or the unknown l [N] */
    double compliance;        /* c [m/N] */
    double target[3];         /* [m] */
    int32_t count;            /* number of unknown nodes in W */
    int32_t *unknown;         /* (count) */
    double *block;            /* (count x 9) dy/dx */
    double *rotated_block;    /* (count x 9) dy/dx with x in the nodes' axes; equal to block if no axis is rotated */
    double origin[3];         /* y = origin + W x */
    double *response;         /* Z: (3 x 3 num_free), column by column; NULL: not computed yet */
    uint64_t response_number; /* pliant_preconditioner_use.number for which Z was computed; 0: not computed */
} pliant_grasp_constraint;

typedef struct pliant_refresh pliant_refresh; /* the background factorizer (refresh.c) */

enum { PLIANT_MAX_ROWS = 3 * PLIANT_MAX_TOOLS };
/* With fewer nodes one thread is faster. */
enum { PLIANT_NODES_FOR_THREADS = 4096 };

/* A state and the quantities that are evaluated there. */
struct pliant_iterate {
    double *x;             /* (3 num_nodes) positions of the solved mesh, including fixed nodes [m] */
    double force[PLIANT_MAX_ROWS];
    double *step;          /* (3 num_free) dx */
    double *residual;      /* (3 num_free) r + W' dl = K0 dx */
    double *elastic;       /* (3 num_free) elastic forces [N] */
    double *free_step;     /* (3 num_free) K0^-1 r: dx without the springs' contribution */
    double step_force[PLIANT_MAX_ROWS]; /* dl */
    double *pressure;      /* Nullable: (pressures) of nearly incompressible tissue [Pa] (pressure.h) */
    double *pressure_step; /* Nullable: (pressures) dp */
    double merit;          /* energy norm of the step [sqrt(J)] */
    double scale;          /* energy norm of the load: square root of its work */
    double displacement;   /* largest distance of a node from its rest position [m] */
};

typedef struct pliant_secant { /* Differences of two iterates. */
    double *x, *step, *residual;
    double *pressure, *pressure_step; /* Nullable */
    double force[PLIANT_MAX_ROWS], step_force[PLIANT_MAX_ROWS];
} pliant_secant;

/* The final state of the previous step (solver.c). */
typedef struct pliant_final_state {
    /* At the start of this step, the previous final state was evaluated with the preconditioner in use. */
    bool start_is_evaluated;
    pliant_iterate at;          /* its steps, residual and step_force; other fields are unused */
} pliant_final_state;

/* The preconditioner and the axes in which it is applied. Each backend that runs steps has one (step_start.c). */
typedef struct pliant_preconditioner_use {
    /* Identifies a pair of factor and axes, from 1. It changes with every new factor and every rotation of the axes.
     * Responses and evaluated final states are valid for one number. */
    uint64_t number;
    bool is_rotated;               /* the axes differ from the axes in which the preconditioner was computed */
    bool has_inaccurate_rotations; /* rotations are inaccurate, as for homogenized elements */
    bool is_renewed_when_slow;     /* when it converges slowly, a new preconditioner is due soon */
    bool converged_slowly;         /* it has converged slowly since the last rotation of the axes */
    uint64_t rotation_step;        /* step of the last rotation */
    int64_t evaluations;           /* evaluations since then, counting only evaluations with work */
} pliant_preconditioner_use;

/* Inputs and outcome of the previous step (step_start.c). */
typedef struct pliant_previous_step {
    /* There was a previous step, and only the inputs in this struct can have changed since. */
    bool is_comparable;
    bool evaluated;             /* the forces and the preconditioned step of its final state are available */
    bool converged, had_contacts;    /* had_contacts: there were contacts */
    uint64_t number; /* pliant_preconditioner_use.number of the final state's evaluation; 0: do not reuse it */
    double gravity[3], force[PLIANT_MAX_ROWS];
    double target[PLIANT_MAX_ROWS], compliance[PLIANT_MAX_TOOLS];
} pliant_previous_step;

/* Quantities that are known before a state is evaluated. */
typedef enum pliant_known { PLIANT_KNOWN_NOTHING, PLIANT_KNOWN_FORCES, PLIANT_KNOWN_STEP } pliant_known;
/* Whether the axes of the nodes rotate with the tissue before a step. */
typedef enum pliant_axes { PLIANT_AXES_KEEP, PLIANT_AXES_ROTATE, PLIANT_AXES_ROTATE_AND_DROP_HISTORY } pliant_axes;

struct pliant_solver {
    const pliant_system *system;
    pliant_anderson rules;      /* limits of a step, secant numbers, and the state of the acceleration between steps */
    int32_t refresh_interval;
    int32_t refresh_delay, convert_delay; /* steps until a factor is available, and then until the history is converted
                                           * to it */
    double smallest_scale;
    pliant_step_clock *clock;   /* Nullable: no time limit. Set at the start of every step. */
    double evaluation_seconds;  /* duration of a complete evaluation in the last step that had one [s] */

    pliant_preconditioner *preconditioner; /* in use; called "factor" below */
    uint64_t factors;           /* number of factors installed so far; 1: the factor at rest */
    pliant_preconditioner_use in_use;       /* unused if a backend keeps its own */
    pliant_previous_step previous;
    /* The arrays for a step are allocated. These are all fields below except load, now.x, weights and grasps. */
    bool has_step_arrays;
    pliant_nodal_rotations *rotations;          /* Nullable: the axes in which the preconditioner is applied */
    bool is_after_cut;                /* the next step is the first step after a cut */
    bool newton_axes;           /* the axes follow the Newton step, which has not been judged yet */
    pliant_refresh *refresh;    /* Nullable */
    /* The history was dropped after the background work began. The converted history will be discarded. */
    bool history_was_dropped;
    pliant_background *background; /* Nullable; borrowed: decides when background results are installed */
    uint32_t takes_factor, takes_history; /* flags of the factor and of the history in it */
    pliant_evaluation_history evaluation_history;           /* evaluations per step in live use */

    pliant_pressures *pressures; /* Nullable: nearly incompressible tissue (pressure.h) */
    double *load;               /* (3 num_free) gravity [N] */
    double gravity[3];          /* gravity of the load [m/s^2] */
    bool loaded;
    pliant_grasp_constraint grasps[PLIANT_MAX_TOOLS];
    pliant_contact_problem *contacts;    /* Nullable: there was no contact yet */

    pliant_iterate now, trial;
    double *previous_x, previous_force[PLIANT_MAX_ROWS]; /* (3 num_nodes) state before a blind step */
    double *previous_pressure;  /* Nullable */
    double *volume_change, *volume_rows; /* Nullable: of the last state whose forces were computed (pressures.h) */
    pliant_secant history[PLIANT_MAX_HISTORY];
    double gram[PLIANT_MAX_HISTORY * PLIANT_MAX_HISTORY]; /* energy products of the secants' steps */
    pliant_final_state final_state;
    double (*element_forces)[12][LANES];
    /* Work arrays to build W, empty between uses; NULL if the fine mesh is the solved mesh. */
    pliant_weight_blocks weights;
};

/* Return the evaluation limit of the next step (evaluation_limit.h). */
pliant_evaluation_limit pliant_solver_limit(const pliant_solver *solver);

/* Create a solver with the limits and intervals of the scene. Scene and system are borrowed. */
pliant_status pliant_solver_create(const pliant_scene *scene, const pliant_system *system, pliant_solver **out);
/* Create a solver without a preconditioner and without a load.
 * @param without_step_arrays  True: do not allocate the arrays that only a step needs. */
pliant_status pliant_solver_create_empty(const pliant_scene *scene, const pliant_system *system,
                                         bool without_step_arrays, pliant_solver **out);
/* Allocate the arrays for a step if they are missing. The axes then have no reference positions. Errors: MEMORY. */
pliant_status pliant_solver_allocate_step(pliant_solver *solver);
/* Compute the load from the gravity of the solver before the cut. Only the masses of changed nodes differ. Errors:
 * MEMORY. */
pliant_status pliant_solver_carry_load(pliant_solver *solver, const pliant_solver *from);
void pliant_solver_free(pliant_solver *solver);
/* Restore the rest state with the factor at rest, without grasps. Errors: MEMORY. */
pliant_status pliant_solver_reset(pliant_solver *solver);

void pliant_solver_set_gravity(pliant_solver *solver, const double gravity[3]);
/* Attach the tool's spring to fine nodes with weights (sum 1). fine_positions give the initial position of y. Errors:
 * MEMORY. */
pliant_status pliant_solver_add_grasp(pliant_solver *solver, int tool, int32_t count, const int32_t *nodes,
                                      const double *weights, const double *fine_positions);
void pliant_solver_remove_grasp(pliant_solver *solver, int tool);
/* Update the tools' weights after the axes have rotated. */
void pliant_solver_rotate_grasps(pliant_solver *solver);

/* Drop the history. Call it when old secants are no longer valid. */
void pliant_solver_drop_history(pliant_solver *solver);
/* Call this after the state was changed by the caller. */
void pliant_solver_reset_after_move(pliant_solver *solver);
static inline size_t pliant_solver_unknowns(const pliant_solver *solver)
{
    return 3 * (size_t)solver->system->num_free;
}

/* Run one step from the present state. NOT_CONVERGED keeps the best iterate; NUMERIC keeps the old state. */
pliant_status pliant_solver_step(pliant_solver *solver, pliant_statistics *statistics);

/* ---- Implemented in residual.c. */
/* Return a . b over the unknowns. The result does not depend on the number of threads. */
double pliant_solver_product(const pliant_solver *solver, const double *a, const double *b);
/* Compute the elastic forces of a state. */
void pliant_solver_elastic_forces(pliant_solver *solver, pliant_iterate *at);
/* Compute the residual in the nodes' axes, the norm of the load, and the largest displacement from rest. On entry,
 * residual holds loads and tools' forces, and elastic holds elastic forces. */
void pliant_solver_find_residual(const pliant_solver *solver, pliant_iterate *at);

/* ---- Implemented in newton_after_cut.c. */
/* Return whether this is the first step after a cut, and has enough evaluations for a Newton step. */
bool pliant_solver_begin_newton(pliant_solver *solver, int32_t maximum);
/* Take a Newton step from the present state, which is evaluated.
 * @param maximum         Maximum number of evaluations.
 * @param evaluations  Out: evaluations done; 0 if the cut has released no tissue.
 * @param settled      Out: the cut has released no tissue, and the present state is evaluated.
 * Errors: MEMORY, NUMERIC. */
pliant_status pliant_solver_newton_step(pliant_solver *solver, int32_t maximum, int32_t *evaluations, bool *settled);
/* Restore the axes of the state before the Newton step, after that step was rejected. Errors: MEMORY, NUMERIC. */
pliant_status pliant_solver_newton_rollback(pliant_solver *solver);
/* Return the evaluation limit of the first step after a cut. The limit exceeds a normal step's limit by the fraction 1
 * / part. In live use it is at most twice the median, unless the normal limit is higher. */
int32_t pliant_solver_newton_limit(const pliant_solver *solver, const pliant_evaluation_limit *limit, int32_t part);

/* ---- Implemented in grasp_constraint.c. */
static inline bool pliant_grasp_is_spring(const pliant_grasp_constraint *grasp)
{
    return grasp->active && !grasp->by_force && grasp->count > 0;
}
/* Add W v to out. v is in the nodes' axes. */
void pliant_grasp_apply(const pliant_grasp_constraint *grasp, const double *v, double out[3]);
/* Compute target - y - c l of a spring. */
void pliant_grasp_stretch(const pliant_solver *solver, int tool, const pliant_iterate *at, double out[3]);
/* Compute W (x + free step) + c l - target of a spring. */
void pliant_grasp_gap(const pliant_solver *solver, int tool, const pliant_iterate *at, double out[3]);
/* Add W' f to v: `pull` in the nodes' axes, `load` in world axes. */
void pliant_grasp_add_pull(const pliant_grasp_constraint *grasp, const double force[3], double *v);
void pliant_grasp_add_load(const pliant_grasp_constraint *grasp, const double force[3], double *v);
/* Convert the tool's weights to the nodes' axes. */
void pliant_grasp_rotate(pliant_grasp_constraint *grasp, const pliant_nodal_rotations *rotations);
/* Compute Z of a spring with this preconditioner. Errors: MEMORY, NUMERIC. */
pliant_status pliant_grasp_find_response(pliant_grasp_constraint *grasp, size_t unknowns,
                                         pliant_preconditioner *preconditioner);
/* Copy a grasp without Z. *out is freed first, and empty after an error. Errors: MEMORY. */
pliant_status pliant_grasp_copy(const pliant_grasp_constraint *grasp, pliant_grasp_constraint *out);
bool pliant_grasp_is_same(const pliant_grasp_constraint *a, const pliant_grasp_constraint *b);
void pliant_grasp_free(pliant_grasp_constraint *grasp); /* leaves it empty */
/* Compute Z of all springs whose Z belongs to another factor. */
pliant_status pliant_solver_find_responses(pliant_solver *solver);
/* List the tools that hold by springs and return their number. */
int pliant_solver_list_springs(const pliant_solver *solver, int index[PLIANT_MAX_TOOLS]);
/* Compute S of the rows of `count` springs. row: length of the matrix' rows */
void pliant_solver_fill_springs(const pliant_solver *solver, const int *index, int count, size_t row, double *matrix);
/* Add Z force of one tool to the step. */
void pliant_solver_add_response(const pliant_solver *solver, int tool, const double force[3], double *step);
/* Return the sum over the springs of c a' b. */
double pliant_solver_spring_energy(const pliant_solver *solver, const double *a, const double *b);

/* ---- Implemented in secants.c. */
/* Allocate the arrays of `count` secants. After an error some may be allocated. Errors: MEMORY. */
pliant_status pliant_secants_create(const pliant_system *system, int32_t count, pliant_secant *secants);
void pliant_secants_free(pliant_secant secants[PLIANT_MAX_HISTORY]);
void pliant_solver_store_secant(pliant_solver *solver, int32_t place, const pliant_iterate *from,
                                const pliant_iterate *to);
/* Return the largest remaining motion of a node, estimated from the secants and the residual of a state [m]. */
double pliant_secants_error(const pliant_solver *solver, const pliant_iterate *at);
/* Set trial = now + damping * (mixed step), by the rules.
 * @param left  Out: result of pliant_secants_error [m].
 * @param made  Out: largest motion of a node [m].
 * @return False: no secants were mixed. */
bool pliant_solver_propose(pliant_solver *solver, double *left, double *made);

/* ---- Implemented in solver_after_cut.c: the solver after a cut, and the data that it takes over from the solver
 * before the cut. */
/* Create the solver after a cut, with positions, limits and axes of the solver before it. The preconditioner is carried
 * over (carried.h). The earlier solver stays unchanged. The new solver can step only after pliant_solver_take_over.
 * @param without_step_arrays  True: another backend solves; arrays for a step are allocated when needed.
 * @param state  Nullable: (solved nodes x 3) positions before the cut; NULL: the earlier solver's positions.
 * Errors: MEMORY, NUMERIC. */
pliant_status pliant_solver_carry_over_cut(const pliant_scene *scene, const pliant_system *system,
                                           const pliant_solver *from, const pliant_body_map *map,
                                           bool without_step_arrays, const double *state, pliant_solver **out);
/* Move the preconditioner and the running background work to the new solver. Free the earlier solver only after this
 * call. */
void pliant_solver_take_over(pliant_solver *solver, pliant_solver *from);
/* Carry a tool's grasp over to fine nodes of the cut mesh, with its force. Errors: MEMORY. */
pliant_status pliant_solver_carry_grasp(pliant_solver *solver, const pliant_solver *from, int tool, int32_t count,
                                        const int32_t *nodes, const double *weights, const double *fine_positions,
                                        const double force[3]);

/* ---- Implemented in step_start.c: the start of a step, for all backends. in_use: preconditioner of the backend that
 * steps. */
/* Return whether a step has nothing to do: the previous step has converged, and its inputs are unchanged. */
bool pliant_solver_is_idle(const pliant_solver *solver);
/* Return whether the axes rotate with the tissue before the step. */
pliant_axes pliant_solver_choose_axes(const pliant_solver *solver, const pliant_preconditioner_use *in_use,
                                      uint64_t step);
/* Record that the axes have rotated. */
void pliant_preconditioner_use_rotated(pliant_preconditioner_use *in_use);
/* Return the known quantities of the step's first state. Call it after the tools' forces are set.
 * @param start_is_evaluated  Out: the previous final state was evaluated with the preconditioner in use. */
pliant_known pliant_solver_find_known(pliant_solver *solver, const pliant_preconditioner_use *in_use,
                                      bool *start_is_evaluated);
/* Record the end of a step. The grasps have the tools' forces.
 * @param evaluated   The final state is evaluated.
 * @param step_force  Change dl of the springs' forces in the final state. It is added to the springs' forces if the
 *     step ends with its first state. */
void pliant_solver_record_step(pliant_solver *solver, const pliant_preconditioner_use *in_use, bool evaluated,
                               const pliant_anderson *rules, const double *step_force);

/* ---- Implemented in refresh.c. */
/* Start and install factors at fixed steps. After a failed factorization the old factor stays. */
pliant_status pliant_refresh_step(pliant_solver *solver, pliant_statistics *statistics);
void pliant_refresh_free(pliant_solver *solver);
size_t pliant_refresh_bytes(const pliant_solver *solver);
bool pliant_refresh_is_busy(const pliant_solver *solver); /* true: freeing the solver would wait */
/* Move background work to the solver after a cut: `carry` allocates the memory (errors: MEMORY), `take` moves the
 * work. */
pliant_status pliant_refresh_carry(pliant_solver *solver, const pliant_solver *from, const int32_t *source);
void pliant_refresh_take(pliant_solver *solver, pliant_solver *from);

#ifdef __cplusplus
}
#endif

#endif
