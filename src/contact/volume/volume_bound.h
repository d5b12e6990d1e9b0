/* Volume bound: no leg inverts an element.
 *
 * An element keeps a fraction of its rest volume. Two mechanisms work together. First, contact points push an
 * element open that is already small; the solver finds their forces together with all other contact forces. Second,
 * the bound shortens a leg that would make an element too small, as conservative advancement does for tools
 * (advance.h).
 *
 * The volume of a tetrahedron is V = A h / 3. A is the area of a face, and h is the height of the opposite node.
 * Divide "V is at least V0" by A / 3, with A at the start of the leg. To first order the result is a contact
 * without friction: h + g'(x - x0) >= h0. The gradient g is the force of a pressure on the four nodes, divided by
 * A. At the opposite node it is the face's normal. */
#ifndef PLIANT_CONTACT_VOLUME_VOLUME_BOUND_H
#define PLIANT_CONTACT_VOLUME_VOLUME_BOUND_H

#include "contact/contact.h"
#include "contact/settings.h"

#ifdef __cplusplus
extern "C" {
#endif

/* Append a contact point for each element below the fraction volume_near of its rest volume, ascending by feature.
 * @param positions (nodes x 3) [m]
 * @param piece_of_node Nullable: (nodes) rigid piece or -1; elements of pieces have no point
 * @param opens the points push elements open that are below volume_stop; otherwise they keep their volume
 * Errors: MEMORY. */
pliant_status pliant_volume_find(const pliant_contact_settings *settings, const pliant_mesh *mesh,
                                 const double *positions, const int32_t *piece_of_node, bool opens, int num_threads,
                                 pliant_contacts *out);

/* Compute the gradient of the gap of such a point for each of its nodes. positions: (nodes x 3) [m] */
void pliant_volume_gradient(const pliant_contact_point *point, const double *positions, double out[4][3]);

/* Return the largest penetration depth of such points at other positions [m]. It is above 0 if the volume, which is not
 * linear in the positions, is smaller than the points foresaw. */
double pliant_volume_lacking(const pliant_contact_settings *settings, const pliant_mesh *mesh, const double *positions,
                             const pliant_contacts *points);

/* Shorten the motion of nodes so that no element becomes too small during the leg. The limit is
 * max(min(advance_keep V, volume_stop V_rest), min(volume_stop V_rest / 2, V)), where V is the element's volume at the
 * start. All nodes move along straight lines in the same time. Elements that are inverted at the start are exempt.
 * @param from, to (nodes x 3) positions at both ends of the leg [m]
 * @param piece_of_node as above
 * @param fraction (nodes) out: fraction of its motion that each node may make
 * @return number of elements that would have been too small; 0: all fractions are 1; -1: no fractions were found */
int32_t pliant_volume_bound_motion(const pliant_contact_settings *settings, const pliant_mesh *mesh, const double *from,
                                   const double *to, const int32_t *piece_of_node, int num_threads, double *fraction);

/* Return whether an element keeps that limit if each node makes its own fraction of the leg. Parameters as above. */
bool pliant_volume_is_kept(const pliant_contact_settings *settings, const pliant_mesh *mesh, int32_t element,
                           const double *from, const double *to, const double *fraction);

/* Return the largest fraction of a leg in which no element becomes smaller than that limit, if all nodes make the
 * same fraction of their motion. Parameters as above. */
double pliant_volume_advance(const pliant_contact_settings *settings, const pliant_mesh *mesh, const double *from,
                             const double *to, const int32_t *piece_of_node, int num_threads);

#ifdef __cplusplus
}
#endif
#endif
