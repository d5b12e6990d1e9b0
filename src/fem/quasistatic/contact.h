/* Contact in the quasi-static solve. Points (contact/contact.h) enter a step as the tools' springs do, with forces in cones in place of springs'.
 *
 * At a state x with forces l the residual is r = load + W' l - f_int(x). The step without a change of the forces is g0 = K0^-1 r; forces
 * l + dl are those that keep the points x + g0 + U dl out of the obstacles, by the rules of Signorini and Coulomb (cones.h), with
 * A = W U for what a change moves; then the step is g = K0^-1 (r + W' dl). Since U = K0^-1 W', it ends where the obstacles are touched. All of A is of one
 * factor: of two, it is not positive, and steps go astray (src/contact/NUMERICS.md). */
#ifndef PLIANT_FEM_QUASISTATIC_CONTACT_H
#define PLIANT_FEM_QUASISTATIC_CONTACT_H

#include "contact/contact.h"
#include "fem/linear/answers.h"
#include "fem/quasistatic/anderson.h"
#include "fem/quasistatic/piece_rules.h"
#include "fem/system.h"
#include "state/data.h"

#ifdef __cplusplus
extern "C" {
#endif

typedef struct pliant_iterate pliant_iterate;

/* Rigid bodies that points are of: pieces that have come off, and proxies of tools. */
typedef struct pliant_touch_pieces {
    const int32_t *of_node; /* Nullable: (fine nodes) which piece; -1: none */
    const pliant_touch_piece *piece;
    const pliant_touch_piece *proxy; /* Nullable: (PLIANT_MAX_TOOLS x 2) of each tool: all of it about its tip, its jaws about their joint */
    double compliance;      /* of a point, over that of a flat punch on the pieces' tissue */
} pliant_touch_pieces;

/* Forces of all points, as one evaluation found them. */
typedef struct pliant_touch_forces {
    double *force;         /* (room x 3) l + dl: along the normal, and two tangents [N] */
    double *motion;        /* (room x 3) of the point at x + g from where it touches and sticks, likewise [m] */
} pliant_touch_forces;

struct pliant_touches {
    pliant_contacts *points; /* borrowed, for a step */
    /* POINTS that some unknown moves */
    int32_t count, room;
    int32_t *point;        /* (room) which of the step's */
    double *frame;         /* (room x 9) rows: normal, two tangents */
    double *goal;          /* (room x 3) where W x touches and sticks [m] */
    int32_t *start;        /* (room + 1) into the weights */
    double *friction;      /* (room + PLIANT_MAX_TOOLS) */
    int32_t num_weights, room_weights;
    int32_t *unknown;      /* (room_weights) */
    double *block;         /* (room_weights x 9) dy/dx, in the axes of all */
    double *turned;        /* (room_weights x 9) rows of the frame, x in the nodes' axes */
    /* PIECES (contact_pieces.c) */
    const pliant_touch_pieces *pieces; /* Nullable: none has come off; borrowed, for a step */
    int32_t num_arms, room_arms, num_moving, room_moving;
    int32_t *arm_start;    /* (room + 1) */
    pliant_touch_arm *arm; /* (room_arms) */
    int32_t *moving;       /* (num_moving) bodies that points are of: pieces, and -1 less a proxy */
    /* FORCES */
    pliant_touch_forces taken, found; /* of the state of the step; of the one evaluated last */
    double *change;        /* (room x 3) dl of that */
    /* ANSWERS */
    pliant_answers answers;
    uint64_t of_factor;    /* pliant_solver.factors that they are of */
    pliant_factor *factor; /* Nullable: solves in two parts, for now at these unknowns; borrowed */
    bool by_halves;        /* those: no springs pull elsewhere */
    int32_t num_touched, *touched; /* (num_free) unknowns that points are moved by, in the order of points */
    uint8_t *seen;         /* (num_free) room */
    double *matrix;        /* A, tools' springs after the points; (rows x rows) */
    double *motion, *force, *sweeps; /* (rows) room; cones.h */
    size_t room_matrix;
    double *step;          /* (3 num_free) room */
};
typedef struct pliant_touches pliant_touches;

/* The points of the next step; none: NULL. fine_positions: of all fine nodes, now. pieces: Nullable. Errors: MEMORY. */
pliant_status pliant_solver_touch(pliant_solver *solver, pliant_contacts *points, const pliant_touch_pieces *pieces, const double *fine_positions);
void pliant_touches_free(pliant_touches *touches); /* Nullable */
static inline bool pliant_touches_any(const pliant_touches *touches) { return touches && touches->count > 0; }

/* A, before the evaluations of a step. Errors: MEMORY, NUMERIC. */
pliant_status pliant_touches_respond(pliant_solver *solver);
/* residual += W' l, in the axes of all */
void pliant_touches_load(const pliant_touches *touches, double *residual);
/* The free step, of a factor at the points alone. Errors: MEMORY. */
pliant_status pliant_touches_begin(pliant_solver *solver, pliant_iterate *at);
/* From the free step: the forces; step += U W' dl and residual += W' dl. Errors: MEMORY. */
pliant_status pliant_touches_step(pliant_solver *solver, pliant_iterate *at);
/* Of that, once motion has the free step's: the forces, by a matrix A. false: none changes */
bool pliant_touches_find(pliant_touches *touches, int num_tools, const double *matrix);
/* Tools that pull by springs, in A after the points; returns how many. Room for A and what is found with it. Errors: MEMORY. */
int pliant_touches_springs(const pliant_solver *solver, int index[PLIANT_MAX_TOOLS]);
pliant_status pliant_touches_make_matrix(pliant_touches *touches, int num_tools);
/* out (3) += the rows of a point on v, and v += the rows' transposes on the forces (count x 3) of all; v in the nodes' own axes */
void pliant_touches_apply(const pliant_touches *touches, int32_t point, const double *v, double out[3]);
void pliant_touches_pull(const pliant_touches *touches, const double *force, double *v);
/* what was evaluated last becomes the state of the step */
void pliant_touches_take(pliant_touches *touches);
/* Forces and anchors to the points, how deep the deepest lies. */
void pliant_touches_report(pliant_solver *solver, pliant_statistics *statistics);
/* The same with moved (count x 3), W x of the points where the step has led. touches: Nullable */
void pliant_touches_tell(pliant_touches *touches, const double *moved, pliant_statistics *statistics);

/* ---- contact_pieces.c, by piece_rules.h: what is rigid adds its own answer to A. Rigid bodies between rigid jaws have none along the line between them: points of a piece
 * give way by 1 / (E sqrt(area)), as an elastic half-space does under a patch of that area (Johnson, Contact Mechanics, 3.4). */
/* What the point has of pieces. Errors: MEMORY. */
pliant_status pliant_touches_add_arms(pliant_touches *touches, const pliant_contact_point *point, const double *fine_positions);
/* out += how much further than to first order the pieces' turns take a point [m] */
void pliant_touches_bend(const pliant_touches *touches, int32_t point, double out[3]);
/* one of those that points are of */
const pliant_touch_piece *pliant_touches_moving(const pliant_touches *touches, int32_t moving);
/* of a point by itself [m/N] */
double pliant_touches_give_way(const pliant_touches *touches, int32_t point);
/* out += block of A of two points, in their frames */
void pliant_touches_answer_pieces(const pliant_touches *touches, int32_t a, int32_t b, double out[9]);
/* motion (count x 3) += of the points by the pieces, where these forces are on (in the points' frames); bare: without what the points themselves give way */
void pliant_touches_move_pieces(const pliant_touches *touches, const double *force, bool bare, double *motion);

#ifdef __cplusplus
}
#endif
#endif
