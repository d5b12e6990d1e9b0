/* The quasi-static solve: find x with f_int(x) = load + sum of the tools' forces.
 *
 * Fixed-point steps on a frozen factor K0 of the warped stiffness, accelerated by Anderson (type II, in the energy norm of
 * K0), accepted only when they lower the merit, with K0 refreshed in the background at fixed steps, so that the same input
 * gives the same bits (NUMERICS 5, 7.4, 7.6).
 *
 * A tool that holds the tissue by a spring of compliance c adds a force l at y = W x with  c l = target - y;  c = 0 is
 * displacement control. The pair (x, l) is stepped together:
 *     K0 dx - W' dl = r,   W dx + c dl = e,   r = load + W' l - f_int(x),   e = target - y - c l
 * by the Schur complement  S = c I + W Z,  Z = K0^-1 W'  (three columns a tool; Woodbury, NUMERICS 5).
 * The merit is the energy norm of that step,  dx' K0 dx + c dl' dl,  and K0 dx = r + W' dl costs nothing.
 * Steps, pulls and secants are vectors in the nodes' own axes (nodal_rotations.h); positions, loads and forces are not. */
#ifndef PLIANT_FEM_QUASISTATIC_SOLVER_H
#define PLIANT_FEM_QUASISTATIC_SOLVER_H

#include "fem/quasistatic/anderson.h"
#include "fem/quasistatic/contact.h"
#include "fem/quasistatic/even.h"
#include "fem/quasistatic/nodal_rotations.h"
#include "fem/system.h"
#include "state/data.h"

#ifdef __cplusplus
extern "C" {
#endif

/* What one tool does to the unknowns. */
typedef struct pliant_handle {
    bool active;
    bool by_force;         /* a given force, no spring */
    double force[3];       /* on the tissue: given, or the unknown l [N] */
    double compliance;     /* c [m/N] */
    double target[3];      /* [m] */
    int32_t count;         /* of the unknown nodes that W names */
    int32_t *unknown;      /* (count) */
    double *block;         /* (count x 9) dy/dx */
    double *turned;        /* (count x 9) the same, x in the nodes' own axes; block itself where nothing turns */
    double origin[3];      /* y = origin + W x */
    double *response;      /* Z: (3 x 3 num_free), column by column; NULL: it was not asked for yet */
    uint64_t response_of;  /* pliant_in_use.number that Z belongs to; 0: none */
} pliant_handle;

typedef struct pliant_refresh pliant_refresh; /* the background factorizer, refresh.c */

enum { PLIANT_MAX_ROWS = 3 * PLIANT_MAX_TOOLS };
/* Fewer are sooner done by one thread. */
enum { PLIANT_NODES_FOR_THREADS = 4096 };

/* A state and what is known about it. */
struct pliant_iterate {
    double *x;             /* (3 num_nodes) positions of the solved mesh, fixed nodes too */
    double force[PLIANT_MAX_ROWS];
    double *step;          /* (3 num_free) dx */
    double *residual;      /* (3 num_free) r + W' dl = K0 dx */
    double *elastic;       /* (3 num_free) elastic forces [N] */
    double *free_step;     /* (3 num_free) K0^-1 r: dx without the springs' share */
    double step_force[PLIANT_MAX_ROWS]; /* dl */
    double merit;          /* energy norm of the step [sqrt(J)] */
    double scale;          /* the same of the load: sqrt of its work */
    double displacement;   /* of the node that is farthest from rest [m] */
};

typedef struct pliant_secant { /* differences of two iterates */
    double *x, *step, *residual;
    double force[PLIANT_MAX_ROWS], step_force[PLIANT_MAX_ROWS];
} pliant_secant;

/* The state that the last step ended with (estimate.c). */
typedef struct pliant_posterior {
    bool seen;                  /* at the beginning of this step it was known, and so was what it was evaluated with */
    pliant_iterate at;          /* its step, residual and step_force; the rest is not used */
} pliant_posterior;

/* The preconditioner in the axes that it is used in, by the backend that steps (begin.c). */
typedef struct pliant_in_use {
    uint64_t number;            /* from 1, another one with every factor and every turn of the axes: responses and ends of steps belong to one */
    bool turned;                /* the axes are not those that the preconditioner was made in */
    bool rough;                 /* elements have but a rough notion of how they turn: homogenized ones */
    bool renews;                /* where it serves badly, a new preconditioner comes soon */
    bool served_badly;          /* since the axes turned */
    uint64_t turned_at;         /* step */
    int64_t evaluations;        /* since then, those that took time */
} pliant_in_use;

/* What the last step was for, and how it ended (begin.c). */
typedef struct pliant_asked {
    bool kept;                  /* there was one, and nothing but what stands here has changed since */
    bool evaluated;             /* the forces of its last state, and what the preconditioner gives there, are at hand */
    bool converged, touched;    /* touched: there were contacts */
    uint64_t number;            /* pliant_in_use that the last state was evaluated with; 0: one that is not used again */
    double gravity[3], force[PLIANT_MAX_ROWS];
    double target[PLIANT_MAX_ROWS], compliance[PLIANT_MAX_TOOLS];
} pliant_asked;

/* What is known of a state that is to be evaluated. */
typedef enum pliant_known { PLIANT_KNOWN_NOTHING, PLIANT_KNOWN_FORCES, PLIANT_KNOWN_STEP } pliant_known;
/* Whether the axes of the nodes turn with the tissue. */
typedef enum pliant_axes { PLIANT_AXES_STAY, PLIANT_AXES_TURN, PLIANT_AXES_TURN_AND_FORGET } pliant_axes;

struct pliant_solver {
    const pliant_system *system;
    pliant_anderson rules;      /* limits of a step, secants' numbers, what goes on from step to step */
    int32_t refresh_interval;
    int32_t refresh_delay, convert_delay; /* steps until a factor is there, and then until the history fits it */
    double smallest_scale;
    double budget;              /* of the iterations of a step [s]; 0: none */
    double spent;               /* of that by solves before, of a step that has several [s] */
    double evaluation_seconds;  /* of a whole one, in the last step that had one */
    double (*clock)(void *user); /* that it is measured by: the machine's, or a test's [s] */
    void *clock_user;

    pliant_preconditioner *preconditioner; /* in use; below, "factor" means it */
    uint64_t factors;           /* put to use so far; 1: it is that of rest */
    pliant_in_use in_use;       /* of a backend of its own: it has its own */
    pliant_asked asked;
    bool awake;                 /* there is what a step needs, which is what follows but for load, now.x, dense_weights and handles */
    pliant_nodal_rotations *rotations;          /* Nullable: the axes that it is used in */
    bool opened;                /* the next step is the first one after a cut */
    bool opened_axes;           /* the axes are those of Newton's step, which is still to be judged */
    pliant_refresh *refresh;    /* Nullable */
    bool forgotten;             /* the history was dropped since that has begun: what it makes of it is of no use */
    pliant_background *background; /* Nullable; borrowed: when what it makes is put to use */
    uint32_t takes_factor, takes_history; /* and what these are called there */
    pliant_even even;           /* of live steps */

    double *load;               /* (3 num_free) gravity [N] */
    double gravity[3];          /* that it is of [m/s^2] */
    bool loaded;
    pliant_handle handles[PLIANT_MAX_TOOLS];
    pliant_touches *touches;    /* Nullable: nothing has been touched yet */

    pliant_iterate now, trial;
    double *previous_x, previous_force[PLIANT_MAX_ROWS]; /* before a blind step (3 num_nodes) */
    pliant_secant history[PLIANT_MAX_HISTORY];
    double gram[PLIANT_MAX_HISTORY * PLIANT_MAX_HISTORY]; /* energy products of the secants' steps */
    pliant_posterior posterior;
    double (*element_forces)[12][LANES];
    double *dense_weights;      /* (9 num_free) room to build W; NULL where the fine nodes are solved themselves */
};

/* Of the next step's evaluations: those of live steps are even. */
pliant_even_limit pliant_solver_limit(const pliant_solver *solver);

/* Limits and intervals as the scene says. Both are borrowed. */
pliant_status pliant_solver_create(const pliant_scene *scene, const pliant_system *system, pliant_solver **out);
/* the same without a preconditioner and a load, nothing set; rests: without what only a step of its own needs */
pliant_status pliant_solver_create_without(const pliant_scene *scene, const pliant_system *system, bool rests, pliant_solver **out);
/* That is made where it is not there yet; axes refer to nothing. Errors: MEMORY. */
pliant_status pliant_solver_wake(pliant_solver *solver);
/* Its load, by the gravity of the solver before: only nodes of another mass have another one. Errors: MEMORY. */
pliant_status pliant_solver_carry_load(pliant_solver *solver, const pliant_solver *from);
void pliant_solver_free(pliant_solver *solver);
/* At rest, on the factor at rest, nothing held. Errors: MEMORY. */
pliant_status pliant_solver_reset(pliant_solver *solver);

void pliant_solver_gravity(pliant_solver *solver, const double gravity[3]);
/* Point the handle at fine nodes with weights (sum 1); positions of the fine nodes say where y is now. Errors: MEMORY. */
pliant_status pliant_solver_hold(pliant_solver *solver, int tool, int32_t count, const int32_t *nodes, const double *weights,
                                 const double *fine_positions);
void pliant_solver_release(pliant_solver *solver, int tool);
/* The axes have turned: what the tools keep in them. */
void pliant_solver_turned(pliant_solver *solver);

/* Drop the history: what it compares no longer holds. */
void pliant_solver_forget(pliant_solver *solver);
/* The state was changed from outside. */
void pliant_solver_moved(pliant_solver *solver);
static inline size_t pliant_solver_unknowns(const pliant_solver *solver) { return 3 * (size_t)solver->system->num_free; }

/* What is left of the budget as a solve of this step begins, but for later parts of it [s]. */
double pliant_solver_time_left(const pliant_solver *solver);
/* Whether another solve of this step has time; without a budget it has. */
bool pliant_solver_has_time(const pliant_solver *solver);
/* How many evaluations, of `each` [s], would be done before it from `now` on; INT32_MAX: without a budget, or where that is not known (0). */
int32_t pliant_solver_affordable(const pliant_solver *solver, double start, double now, double each);
/* One step from the present state. NOT_CONVERGED keeps the best iterate; NUMERIC keeps the old one. */
pliant_status pliant_solver_step(pliant_solver *solver, pliant_statistics *statistics);

/* ---- evaluate.c */
/* a . b over the unknowns; the same for any number of threads */
double pliant_solver_product(const pliant_solver *solver, const double *a, const double *b);
/* Of a state that nothing is known of: its elastic forces. */
void pliant_solver_elastic_forces(pliant_solver *solver, pliant_iterate *at);
/* Residual, step, and merit, from what is known of a state. Errors: MEMORY. */
pliant_status pliant_solver_evaluate(pliant_solver *solver, pliant_known known, pliant_iterate *at);

/* ---- opened.c */
/* Before the first step after a cut: Newton's, of at most so many evaluations. evaluations: out: how many it took; 0: this is no such step, or the cut has released
 * nothing (*settled: the state of now is evaluated). Errors: MEMORY, NUMERIC. */
pliant_status pliant_solver_open(pliant_solver *solver, int32_t most, int32_t *evaluations, bool *settled);
/* What that led to is no good: back to the axes of the state before. Errors: MEMORY, NUMERIC. */
pliant_status pliant_solver_open_back(pliant_solver *solver);
/* What the first step after a cut may take: a part (a third: 3) more than any step, but live no more than twice the median, where that is more than usual. */
int32_t pliant_solver_open_evaluations(const pliant_solver *solver, const pliant_even_limit *limit, int32_t part);

/* ---- handle.c */
static inline bool pliant_handle_is_spring(const pliant_handle *handle) { return handle->active && !handle->by_force && handle->count > 0; }
/* out += W v, v in the nodes' own axes */
void pliant_handle_apply(const pliant_handle *handle, const double *v, double out[3]);
/* target - y - c l of a spring */
void pliant_handle_stretch(const pliant_solver *solver, int tool, const pliant_iterate *at, double out[3]);
/* W (x + free step) + c l - target of a spring */
void pliant_handle_gap(const pliant_solver *solver, int tool, const pliant_iterate *at, double out[3]);
/* v += W' f, v in the nodes' own axes; and in those of all */
void pliant_handle_pull(const pliant_handle *handle, const double force[3], double *v);
void pliant_handle_load(const pliant_handle *handle, const double force[3], double *v);
/* Its weights in the nodes' axes. */
void pliant_handle_turn(pliant_handle *handle, const pliant_nodal_rotations *rotations);
/* Z of a spring, of this preconditioner. Errors: MEMORY, NUMERIC. */
pliant_status pliant_handle_respond(pliant_handle *handle, size_t unknowns, pliant_preconditioner *preconditioner);
/* A copy of what it holds, without Z; *out is freed first, and empty on errors. Errors: MEMORY. */
pliant_status pliant_handle_copy(const pliant_handle *handle, pliant_handle *out);
bool pliant_handle_same_hold(const pliant_handle *a, const pliant_handle *b);
void pliant_handle_free(pliant_handle *handle); /* and empty */
/* Z of the springs, where it belongs to another factor. */
pliant_status pliant_solver_respond(pliant_solver *solver);
/* Tools that pull by springs; returns how many. matrix: S of their rows. */
int pliant_solver_springs(const pliant_solver *solver, int index[PLIANT_MAX_TOOLS], double matrix[PLIANT_MAX_ROWS * PLIANT_MAX_ROWS]);
/* step += Z force of one */
void pliant_solver_respond_to(const pliant_solver *solver, int tool, const double force[3], double *step);
/* dl = S^-1 (e - W g0), and the step with it: g = g0 + Z dl, K0 g = r + W' dl. false: S is singular */
bool pliant_solver_step_tools(const pliant_solver *solver, pliant_iterate *at);
/* sum over springs of c a' b */
double pliant_solver_spring_energy(const pliant_solver *solver, const double *a, const double *b);

/* ---- secants.c */
/* (count) of the arrays; the first may be left with some when there is no memory. Errors: MEMORY. */
pliant_status pliant_secants_create(const pliant_system *system, int32_t count, pliant_secant *secants);
void pliant_secants_free(pliant_secant secants[PLIANT_MAX_HISTORY]);
void pliant_solver_remember(pliant_solver *solver, int32_t place, const pliant_iterate *from, const pliant_iterate *to);
/* Products of the secants' steps with a residual; false: there is no secant. */
bool pliant_secants_along(const pliant_solver *solver, const pliant_iterate *at, double along[PLIANT_MAX_HISTORY]);
/* Their weights (secant_equations.h). */
bool pliant_secants_mix(const pliant_solver *solver, const double along[PLIANT_MAX_HISTORY], bool estimates, double weights[PLIANT_MAX_HISTORY]);
/* Largest move of a node that the secants and the residual of a state still call for, now and later [m]. */
double pliant_secants_error(const pliant_solver *solver, const pliant_iterate *at);
/* trial = now + damping * (mixed step), as the rules say. left: as pliant_secants_error; made: largest move of a node [m]. false: not mixed */
bool pliant_solver_propose(pliant_solver *solver, double *left, double *made);

/* ---- adapt.c: the solver of the next body, and what it takes over from the one before */
/* Its positions, limits, and axes; what stands for the inverse of its stiffness is carried over (carried.h). Nothing of the one before
 * changes, and the next one cannot step, until it has taken over what the other has.
 * rests: another backend solves: what only a step needs is made when one comes. state: NULL, or (solved nodes) where they are, if not where the one before
 * has them. Errors: MEMORY, NUMERIC. */
pliant_status pliant_solver_follow(const pliant_scene *scene, const pliant_system *system, const pliant_solver *from,
                                   const pliant_body_map *map, bool rests, const double *state, pliant_solver **out);
/* The preconditioner, and what is being made in the background: the one before can only be freed then. */
void pliant_solver_take_over(pliant_solver *solver, pliant_solver *from);
/* A tool's hold, on fine nodes of the next body, and its force. Errors: MEMORY. */
pliant_status pliant_solver_carry_hold(pliant_solver *solver, const pliant_solver *from, int tool, int32_t count, const int32_t *nodes,
                                       const double *weights, const double *fine_positions, const double force[3]);

/* ---- begin.c: how a step begins, decided here for every backend. in_use: of the one that steps */
/* Whether a step would find nothing to do: the last one has converged, and nothing has changed since. */
bool pliant_solver_rests(const pliant_solver *solver);
/* Whether the axes turn with the tissue before it. */
pliant_axes pliant_solver_axes(const pliant_solver *solver, const pliant_in_use *in_use, uint64_t step);
/* They have. */
void pliant_in_use_turned(pliant_in_use *in_use);
/* What is known of its first state, with the tools' forces set. seen: and what it was evaluated with is in use still */
pliant_known pliant_solver_known(pliant_solver *solver, const pliant_in_use *in_use, bool *seen);
/* The step has ended, and handles have the tools' forces. evaluated: so is the state that it ended with. step_force: dl of that state, which those take where
 * it is the one that the step began with. */
void pliant_solver_ended(pliant_solver *solver, const pliant_in_use *in_use, bool evaluated, const pliant_anderson *rules, const double *step_force);

/* ---- estimate.c: how far nodes still are from where a step would converge to [m] */
pliant_status pliant_posterior_create(pliant_solver *solver);
void pliant_posterior_free(pliant_solver *solver);
/* What is known of the state that a step ends with. */
void pliant_posterior_keep(pliant_solver *solver);

/* ---- refresh.c */
/* Start and deliver factors at fixed steps. Errors of the factorization keep the old factor. */
pliant_status pliant_refresh_step(pliant_solver *solver, pliant_statistics *statistics);
void pliant_refresh_free(pliant_solver *solver);
size_t pliant_refresh_bytes(const pliant_solver *solver);
bool pliant_refresh_is_busy(const pliant_solver *solver); /* freeing it would wait */
/* For a solver that follows another: room for what that one has under way (errors: MEMORY), and taking it over. */
pliant_status pliant_refresh_carry(pliant_solver *solver, const pliant_solver *from, const int32_t *source);
void pliant_refresh_take(pliant_solver *solver, pliant_solver *from);

#ifdef __cplusplus
}
#endif

#endif
