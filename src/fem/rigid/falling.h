/* Where pieces are that have come off (pliant_body.pieces).
 *
 * Quasi-static solvers know no inertia: they keep such a piece's nodes fixed, so that no matrix is singular and the
 * rest of the body does not notice, and each piece falls, lands and is pulled as a rigid body of its own (rigid.h) in
 * the shape that it has at rest, into which it springs back: what quasi-static elasticity says of a body on which no
 * force is. What lies on the ground or hangs on a tool keeps that shape. A piece that hangs on one node or two swings
 * there; what it hangs on does not feel it.
 *
 * What a piece touches (tissue, tools, obstacles) it feels, and is felt by: the solver finds these forces with those of
 * all contacts, and knows of pieces what they weigh (fem/quasistatic/contact_pieces.c). A piece near something goes a
 * step by implicit Euler, by the same answer.
 *
 * Explicit dynamics moves pieces as it moves everything. In either case, one that has left all that is ever drawn stops
 * there. */
#ifndef PLIANT_FEM_FALLING_FALLING_H
#define PLIANT_FEM_FALLING_FALLING_H

#include "fem/quasistatic/contact.h"
#include "state/data.h"

#ifdef __cplusplus
extern "C" {
#endif

/* *out: NULL where nothing has come off. body: borrowed. positions: of its fine nodes. from, map: Nullable, of the body
 * before, whose pieces go on as they move. Errors: MEMORY. */
pliant_status pliant_falling_create(const pliant_scene *scene, const pliant_body *body, const double *positions, const pliant_falling *from,
                                    const pliant_body_map *map, pliant_falling **out);
void pliant_falling_free(pliant_falling *falling); /* Nullable */

/* A step of the scene, or one of the parts that it is taken in (data->share), from data->positions of all else: pieces'
 * nodes in data->positions, what tools feel of them, statistics. true: explicit dynamics must take the state of the
 * host anew. */
bool pliant_falling_step(pliant_data *data);
/* ---- touched.c, of quasi-static solvers. data->falling is there */
/* Before contacts are looked for: how pieces go on if nothing touches them. @return how far any node of them goes at
 * most [m] */
double pliant_falling_foresee(pliant_data *data);
/* Where pieces that touch something get to walls (ground), after all other points. Errors: MEMORY. */
pliant_status pliant_falling_find_walls(pliant_data *data, pliant_contacts *contacts);
/* Whether a point is of any piece. */
bool pliant_falling_is_touched(pliant_falling *falling, const pliant_contacts *contacts);
/* As foreseen; NULL: explicit dynamics moves them. */
const pliant_touch_pieces *pliant_falling_touch_pieces(const pliant_falling *falling);

/* A ball that a piece does not leave in a step: as foreseen, or, with `now`, as fast as it is. @return how far any node
 * of it goes [m]; 0: it rests, or there is no such piece any more */
double pliant_falling_ball(const pliant_falling *falling, int32_t piece, bool now, double centre[3], double *radius);
/* Whether it may meet a tool in this step: it is followed, then. */
void pliant_falling_mark(pliant_falling *falling, int32_t piece, bool meets);
/* Amid a step: their nodes are where it found them. Explicit dynamics moves them itself. */
void pliant_falling_stay(const pliant_falling *falling, double *positions);
/* They are there, and do not move. */
void pliant_falling_set_positions(pliant_falling *falling, const double *positions);

/* ---- kept.c: what a step of quasi-static solvers begins with. *kept: NULL at first. Errors: MEMORY */
typedef struct pliant_falling_kept pliant_falling_kept;
pliant_status pliant_falling_keep(const pliant_falling *falling, pliant_falling_kept **kept);
void pliant_falling_back(const pliant_falling_kept *kept, pliant_falling *falling); /* of the same body */
/* What a step has moved goes a share of that way instead: places along chords, with the pieces' shapes kept, and motion
 * likewise. */
void pliant_falling_partway(const pliant_falling_kept *from, double share, pliant_falling *falling);
void pliant_falling_kept_free(pliant_falling_kept *kept);                           /* Nullable */

/* Nullable falling. Where a node was when its piece came off; NULL: it is of none */
const double *pliant_falling_home(const pliant_falling *falling, int32_t node);
bool pliant_falling_has(const pliant_falling *falling, int32_t node);

#ifdef __cplusplus
}
#endif
#endif
