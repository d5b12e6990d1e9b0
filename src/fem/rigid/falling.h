/* Motion of detached pieces (pliant_body.pieces).
 *
 * Quasi-static solvers have no inertia. They keep the nodes of a detached piece fixed, so that no matrix is singular
 * and the rest of the body is unaffected. Each piece falls, lands and is pulled as a separate rigid body (rigid.h). Its
 * shape is the rest shape, to which it springs back: the quasi-static state of a body without forces. A piece that lies
 * on the ground or is held by a tool keeps that shape. A piece attached at one or two nodes swings there, without any
 * force on the tissue that it is attached to.
 *
 * A piece exchanges contact forces with tissue, tools and obstacles. The solver finds these forces together with all
 * other contacts, and uses the pieces' inertia (fem/quasistatic/contact_pieces.c). A piece near an obstacle takes an
 * implicit Euler step with the same response.
 *
 * Explicit dynamics moves pieces like all other tissue. With both kinds of solver, a piece that has left the drawn
 * region stops there. */
#ifndef PLIANT_FEM_FALLING_FALLING_H
#define PLIANT_FEM_FALLING_FALLING_H

#include "fem/quasistatic/contact.h"
#include "state/data.h"

#ifdef __cplusplus
extern "C" {
#endif

/* Create the detached pieces of a body.
 * @param body       Borrowed.
 * @param positions  Positions of the body's fine nodes [m].
 * @param from, map  Nullable: pieces before a cut, whose motion continues.
 * @param out        NULL if no piece is detached.
 * Errors: MEMORY. */
pliant_status pliant_falling_create(const pliant_scene *scene, const pliant_body *body, const double *positions,
                                    const pliant_falling *from, const pliant_body_map *map, pliant_falling **out);
void pliant_falling_free(pliant_falling *falling); /* Nullable */

/* Move the pieces by a step of the scene or by one of its parts (data->share). The function reads data->positions of
 * all other tissue. It writes the pieces' nodes in data->positions, the tools' forces, and statistics. Return true if
 * explicit dynamics must read the host's state again. */
bool pliant_falling_step(pliant_data *data);
/* ---- Implemented in touched.c, for quasi-static solvers. data->falling is not NULL. */
/* Predict the motion of the pieces without contact, before collision detection.
 * @return Maximum motion of a node of the pieces [m]. */
double pliant_falling_foresee(pliant_data *data);
/* Add contact points between touched pieces and walls (ground), after all other points. Errors: MEMORY. */
pliant_status pliant_falling_find_walls(pliant_data *data, pliant_contacts *contacts);
/* Return whether any point belongs to a piece. */
bool pliant_falling_is_touched(pliant_falling *falling, const pliant_contacts *contacts);
/* Return the predicted motion; NULL: explicit dynamics moves the pieces. */
const pliant_touch_pieces *pliant_falling_touch_pieces(const pliant_falling *falling);

/* Compute a ball that contains a piece during a step, for its predicted motion, or with `now` for its present velocity.
 * @return Maximum motion of its nodes [m]; 0: it rests, or the piece does not exist. */
double pliant_falling_ball(const pliant_falling *falling, int32_t piece, bool now, double centre[3], double *radius);
/* Record whether the piece may touch a tool in this step. If so, it is included in the contact solve. */
void pliant_falling_mark(pliant_falling *falling, int32_t piece, bool meets);
/* During a step, restore the pieces' nodes to the start of the step. Explicit dynamics moves them itself. */
void pliant_falling_stay(const pliant_falling *falling, double *positions);
/* Set the positions of the pieces' nodes, with zero velocity. */
void pliant_falling_set_positions(pliant_falling *falling, const double *positions);

/* ---- Implemented in kept.c: positions and velocities at the start of a leg of quasi-static solvers. *kept: NULL at
 * first. Errors: MEMORY. */
typedef struct pliant_falling_kept pliant_falling_kept;
pliant_status pliant_falling_keep(const pliant_falling *falling, pliant_falling_kept **kept);
/* Reduce the motion since then to a fraction, for the same body: positions move along chords, with the pieces' shapes
 * preserved, and velocities are interpolated. */
void pliant_falling_partway(const pliant_falling_kept *from, double share, pliant_falling *falling);
void pliant_falling_kept_free(pliant_falling_kept *kept);                           /* Nullable */

/* Return the position of a node when its piece detached; NULL: it belongs to no piece. Nullable falling */
const double *pliant_falling_home(const pliant_falling *falling, int32_t node);
bool pliant_falling_has(const pliant_falling *falling, int32_t node);

#ifdef __cplusplus
}
#endif
#endif
