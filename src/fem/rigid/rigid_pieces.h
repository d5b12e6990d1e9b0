/* Motion of detached pieces (pliant_body.pieces).
 *
 * Quasi-static solvers have no inertia. They keep the nodes of a detached piece fixed, so that no matrix is singular
 * and the rest of the body is unaffected. Each piece falls, lands and is pulled as a separate rigid body (rigid.h). Its
 * shape is the rest shape, to which it springs back: the quasi-static state of a body without forces. A piece that lies
 * on the ground or is held by a tool keeps that shape. A piece attached at one or two nodes swings there, without any
 * force on the tissue that it is attached to.
 *
 * A piece exchanges contact forces with tissue, tools and obstacles. The solver finds these forces together with all
 * other contacts, and uses the pieces' inertia (fem/quasistatic/contact_bodies.c). A piece near an obstacle takes an
 * implicit Euler step with the same response.
 *
 * Explicit dynamics moves pieces like all other tissue. With both kinds of solver, a piece that has left the drawn
 * region stops there. */
#ifndef PLIANT_FEM_RIGID_RIGID_PIECES_H
#define PLIANT_FEM_RIGID_RIGID_PIECES_H

#include "fem/quasistatic/contact.h"
#include "model_data/data.h"

#ifdef __cplusplus
extern "C" {
#endif

/* Create the detached pieces of a body.
 * @param body       Borrowed.
 * @param positions  Positions of the body's fine nodes [m].
 * @param from, map  Nullable: pieces before a cut, whose motion continues.
 * @param out        NULL if no piece is detached.
 * Errors: MEMORY. */
pliant_status pliant_rigid_pieces_create(const pliant_scene *scene, const pliant_body *body, const double *positions,
                                         const pliant_rigid_pieces *from, const pliant_body_map *map,
                                         pliant_rigid_pieces **out);
void pliant_rigid_pieces_free(pliant_rigid_pieces *rigid_pieces); /* Nullable */

/* Move the pieces by a step of the scene or by one of its parts (data->fraction). The function reads data->positions of
 * all other tissue. It writes the pieces' nodes in data->positions, the tools' forces, and statistics. Return true if
 * explicit dynamics must read the host's state again. */
bool pliant_rigid_pieces_step(pliant_data *data);
/* ---- Implemented in piece_contact.c, for quasi-static solvers. data->rigid_pieces is not NULL. */
/* Predict the motion of the pieces without contact, before collision detection.
 * @return Maximum motion of a node of the pieces [m]. */
double pliant_rigid_pieces_predict(pliant_data *data);
/* Add contact points between touched pieces and walls (ground), after all other points. Errors: MEMORY. */
pliant_status pliant_rigid_pieces_find_walls(pliant_data *data, pliant_contacts *contacts);
/* Return whether any point belongs to a piece. */
bool pliant_rigid_pieces_have_contact(pliant_rigid_pieces *rigid_pieces, const pliant_contacts *contacts);
/* Return the predicted motion; NULL: explicit dynamics moves the pieces. */
const pliant_contact_bodies *pliant_rigid_pieces_bodies(const pliant_rigid_pieces *rigid_pieces);

/* Compute a ball that contains a piece during a step, for its predicted motion, or with `now` for its present velocity.
 * @return Maximum motion of its nodes [m]; 0: it rests, or the piece does not exist. */
double pliant_rigid_pieces_ball(const pliant_rigid_pieces *rigid_pieces, int32_t piece, bool now, double centre[3],
                                double *radius);
/* Record whether the piece may touch a tool in this step. If so, it is included in the contact solve. */
void pliant_rigid_pieces_mark(pliant_rigid_pieces *rigid_pieces, int32_t piece, bool may_touch_tool);
/* During a step, restore the pieces' nodes to the start of the step. Explicit dynamics moves them itself. */
void pliant_rigid_pieces_hold(const pliant_rigid_pieces *rigid_pieces, double *positions);
/* Set the positions of the pieces' nodes, with zero velocity. */
void pliant_rigid_pieces_set_positions(pliant_rigid_pieces *rigid_pieces, const double *positions);

/* ---- Implemented in piece_leg.c: positions and velocities at the start of a leg of quasi-static solvers. *kept:
 * NULL at first. Errors: MEMORY. */
typedef struct pliant_rigid_pieces_saved pliant_rigid_pieces_saved;
pliant_status pliant_rigid_pieces_save(const pliant_rigid_pieces *rigid_pieces, pliant_rigid_pieces_saved **kept);
/* Reduce the motion since then to a fraction, for the same body: positions move along chords, with the pieces' shapes
 * preserved, and velocities are interpolated. */
void pliant_rigid_pieces_interpolate(const pliant_rigid_pieces_saved *from, double fraction,
                                     pliant_rigid_pieces *rigid_pieces);
void pliant_rigid_pieces_saved_free(pliant_rigid_pieces_saved *kept);                           /* Nullable */

/* Return the position of a node when its piece detached; NULL: it belongs to no piece. Nullable falling */
const double *pliant_rigid_pieces_detachment_position(const pliant_rigid_pieces *rigid_pieces, int32_t node);
/* Set the solved positions of the pieces' nodes to these positions. A solver of the fine mesh keeps them there, but
 * downloaded positions include the motion of the pieces. rigid_pieces: Nullable */
void pliant_rigid_pieces_set_detachment_positions(const pliant_rigid_pieces *rigid_pieces, const pliant_system *system,
                                                  double *solved);
bool pliant_rigid_pieces_contain(const pliant_rigid_pieces *rigid_pieces, int32_t node);

#ifdef __cplusplus
}
#endif
#endif
