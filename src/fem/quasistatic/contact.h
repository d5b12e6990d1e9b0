/* Contact in the quasi-static solve. Contact points (contact/contact.h) enter a step like the tools' springs, but
 * their forces lie in friction cones.
 *
 * The residual at a state x with contact forces l is r = load + W' l - f_int(x). The step without a change of the
 * forces is the free step g0 = K0^-1 r. The changes dl of the forces are chosen so that the points x + g0 + U dl
 * satisfy the conditions of Signorini and Coulomb (cones.h). Here U = K0^-1 W', and A = W U is the compliance of
 * the points. The step is g = K0^-1 (r + W' dl), so it ends where the obstacles are touched.
 *
 * All of A comes from one factor. With parts from two factors, A is not positive definite and steps diverge
 * (src/contact/NUMERICS.md). */
#ifndef PLIANT_FEM_QUASISTATIC_CONTACT_H
#define PLIANT_FEM_QUASISTATIC_CONTACT_H

#include "contact/contact.h"
#include "contact/solve/coupling_rules.h"
#include "fem/linear/compliance.h"
#include "fem/quasistatic/anderson.h"
#include "fem/quasistatic/rigid_body_rules.h"
#include "fem/system.h"
#include "model_data/data.h"

#ifdef __cplusplus
extern "C" {
#endif

typedef struct pliant_iterate pliant_iterate;

/* Maximum load of a coupling between proxy and target: of its force, of its torque, or of the torque of its jaws. */
typedef struct pliant_touch_limit {
    double load;           /* [N] or [N m] */
    double compliance;     /* of the coupling below this load [m/N] or [rad/(N m)] */
    double axis[3];        /* unit axis of the jaws; unused for the others */
} pliant_touch_limit;

/* Rigid bodies with contact points: detached pieces and proxies of tools. */
typedef struct pliant_contact_bodies {
    const int32_t *of_node; /* Nullable: (fine nodes) piece of each node; -1: none */
    const pliant_contact_body *piece;
    /* Nullable: (PLIANT_MAX_TOOLS x 2): for each tool, its motion about the tip and its jaws' motion about their
     * joint. The solver changes their compliance, so that each load stays at its limit. */
    pliant_contact_body *proxy;
    const pliant_touch_limit *limit; /* (PLIANT_MAX_TOOLS x 3) */
} pliant_contact_bodies;

/* Forces and motions of all points from one evaluation. */
typedef struct pliant_contact_forces {
    double *force;         /* (capacity x 3) l + dl: normal and two tangential components [N] */
    /* (capacity x 3) motion of the point at x + g relative to its contact and sticking position, likewise [m] */
    double *motion;
} pliant_contact_forces;

struct pliant_contact_problem {
    pliant_contacts *points; /* borrowed, for a step */
    /* POINTS that at least one unknown moves */
    int32_t count, capacity;
    int32_t *point;        /* (capacity) index of the step's contact point */
    double *frame;         /* (capacity x 9) rows: normal and two tangents */
    double *goal;          /* (capacity x 3) value of W x at which the point touches and sticks [m] */
    int32_t *start;        /* (capacity + 1) offsets into the weights */
    double *friction;      /* (capacity + PLIANT_MAX_TOOLS) */
    int32_t num_weights, weight_capacity;
    int32_t *unknown;      /* (weight_capacity) */
    double *block;         /* (weight_capacity x 9) dy/dx, in the global axes */
    double *rotated_block; /* (weight_capacity x 9) dy in the rows of the frame, dx in the nodes' axes */
    /* RIGID BODIES (contact_bodies.c) */
    const pliant_contact_bodies *pieces; /* Nullable: there is no rigid body; borrowed, for a step */
    int32_t num_arms, arm_capacity, num_moving, moving_capacity;
    int32_t *arm_start;      /* (capacity + 1) */
    pliant_contact_arm *arm; /* (arm_capacity) */
    int32_t *moving;         /* (num_moving) bodies of the points: a piece's number, or -1 minus a proxy's number */
    int32_t num_couplings;   /* that have a limit, of tools that touch */
    pliant_coupling coupling[3 * PLIANT_MAX_TOOLS];
    double *columns;         /* (num_couplings x count x 9) pliant_couplings */
    size_t columns_capacity;
    /* FORCES */
    pliant_contact_forces taken, found; /* of the step's state; of the last evaluation */
    double *change;                     /* (capacity x 3) dl of the last evaluation */
    /* COMPLIANCE */
    pliant_compliance_blocks blocks;
    uint64_t of_factor;    /* value of pliant_solver.factors to which the answers belong */
    pliant_factor *factor; /* Nullable: factor whose solve can be split for these unknowns; borrowed */
    bool can_split_solve;        /* the split solve is possible: no spring acts on other unknowns */
    int32_t num_moved_unknowns, *moved_unknowns; /* (num_free) unknowns that move points, in the order of the points */
    uint8_t *visited;         /* (num_free) buffer */
    double *matrix;        /* A, with the tools' springs after the points; (rows x rows) */
    double *motion, *force, *sweeps; /* (rows) buffers of cones.h */
    size_t matrix_capacity;
    double *step;          /* (3 num_free) buffer */
};
typedef struct pliant_contact_problem pliant_contact_problem;

/* Set the contact points of the next step; NULL: none.
 * @param pieces Nullable; @param fine_positions (fine nodes x 3) current positions [m]
 * Errors: MEMORY. */
pliant_status pliant_solver_set_contacts(pliant_solver *solver, pliant_contacts *points,
                                         const pliant_contact_bodies *pieces, const double *fine_positions);
void pliant_contact_problem_free(pliant_contact_problem *contacts); /* Nullable */
static inline bool pliant_contact_problem_has_points(const pliant_contact_problem *contacts)
{
    return contacts && contacts->count > 0;
}

/* Compute A, before the evaluations of a step. Errors: MEMORY, NUMERIC. */
pliant_status pliant_contact_problem_find_matrix(pliant_solver *solver);
/* Add W' l to the residual, in the global axes. */
void pliant_contact_problem_add_load(const pliant_contact_problem *contacts, double *residual);
/* Compute the free step; with a split factor only at the unknowns of the points. Errors: MEMORY. */
pliant_status pliant_contact_problem_free_step(pliant_solver *solver, pliant_iterate *at);
/* Compute the forces from the free step. Add U W' dl to the step, and W' dl to the residual. Errors: MEMORY. */
pliant_status pliant_contact_problem_step(pliant_solver *solver, pliant_iterate *at);
/* Compute the forces; contacts->motion must contain the motion of the free step. Return whether any force changes. */
bool pliant_contact_problem_solve(pliant_contact_problem *contacts, int num_tools);
/* Allocate A and its buffers. The rows of the tools' springs follow the rows of the points. Errors: MEMORY. */
pliant_status pliant_contact_problem_size_matrix(pliant_contact_problem *contacts, int num_tools);
/* Add the rows of a point times v to out (3). v: in the nodes' own axes */
void pliant_contact_problem_apply(const pliant_contact_problem *contacts, int32_t point, const double *v,
                                  double out[3]);
/* Add the transposed rows of all points times the forces (count x 3) to v. v: in the nodes' own axes */
void pliant_contact_problem_add_forces(const pliant_contact_problem *contacts, const double *force, double *v);
/* Make the result of the last evaluation the step's state. */
void pliant_contact_problem_accept(pliant_contact_problem *contacts);
/* Write forces and anchors to the contact points, and the largest penetration depth to the statistics. */
void pliant_contact_problem_report(pliant_solver *solver, pliant_statistics *statistics);
/* As before, with given W x of the points at the end of the step: moved (count x 3). contacts: Nullable */
void pliant_contact_problem_report_motion(pliant_contact_problem *contacts, const double *moved,
                                          pliant_statistics *statistics);

/* ---- contact_bodies.c, by rigid_body_rules.h: rigid bodies add their own compliance to A. Between rigid jaws, a rigid
 * body has no compliance along the line between them. Therefore points of a piece have a compliance of their own,
 * proportional to 1 / (E sqrt(area)), as an elastic half-space under a patch of that area (Johnson, Contact
 * Mechanics, 3.4). */
/* Add the relations of a point to rigid bodies. Errors: MEMORY. */
pliant_status pliant_contact_problem_add_arms(pliant_contact_problem *contacts, const pliant_contact_point *point,
                                              const double *fine_positions);
/* Add the nonlinear part of a point's motion by the rotation of its bodies to out [m]. */
void pliant_contact_problem_rotation_part(const pliant_contact_problem *contacts, int32_t point, double out[3]);
/* Return a body by its index in touches->moving. */
const pliant_contact_body *pliant_contact_problem_body(const pliant_contact_problem *contacts, int32_t moving);
/* Return the compliance of a point of a piece [m/N]. */
double pliant_contact_problem_compliance(const pliant_contact_problem *contacts, int32_t point);
/* Add the block of A of two points by their common rigid bodies to out, in their frames. */
void pliant_contact_problem_add_bodies(const pliant_contact_problem *contacts, int32_t a, int32_t b, double out[9]);
/* List the couplings of all tools that touch, once all points are set. Errors: MEMORY. */
pliant_status pliant_contact_problem_list_couplings(pliant_contact_problem *contacts);
/* Read the compliances of the couplings, before A is computed. */
void pliant_contact_problem_begin_couplings(pliant_contact_problem *contacts);
/* Keep the loads of all couplings within their limits (coupling_rules.h). The function updates A and the forces of the
 * last cone solve. resistance: of cones.h, in and out */
void pliant_contact_problem_apply_limits(pliant_contact_problem *contacts, int num_tools, double *resistance);
/* Give all bodies the present compliances of their couplings. */
void pliant_contact_problem_set_couplings(pliant_contact_problem *contacts);
/* Give all bodies the compliances of the accepted forces again, after a rejected evaluation has changed them. */
void pliant_contact_problem_restore_couplings(pliant_contact_problem *contacts);
/* Add the motion of the points by the rigid bodies under these forces (in the points' frames) to motion (count x
 * 3). bare: without the points' own compliance */
void pliant_contact_problem_move_bodies(const pliant_contact_problem *contacts, const double *force, bool bare,
                                        double *motion);

#ifdef __cplusplus
}
#endif
#endif
