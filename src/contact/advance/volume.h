/* Least volume of elements: no leg inverts an element.
 *
 * An element keeps a fraction of the volume that it has at rest. Two parts work together. Contact points push an
 * element open that is already small: the solver finds their forces with those of all other contacts. The bound
 * shortens a leg that would make an element smaller still, as conservative advancement does for tools (advance.h).
 *
 * The volume of a tetrahedron is V = A h / 3, with the area A of a face and the height h of the node across from it.
 * Divided by A / 3 of the start of the leg, "V is at least V0" is to first order the contact h + g'(x - x0) >= h0 without
 * friction. Its gradient g is the pressure force on the four nodes, over A: the normal of the face at the node across
 * from it. */
#ifndef PLIANT_CONTACT_VOLUME_H
#define PLIANT_CONTACT_VOLUME_H

#include "contact/contact.h"

#ifdef __cplusplus
extern "C" {
#endif

typedef struct pliant_volume_rule {
    double near;  /* fraction of the rest volume; 0.3: an element below it has a contact point */
    double stop;  /* fraction of the rest volume; 0.1: contact points keep it */
    double keep;  /* fraction of the volume at the start of a leg that the leg leaves; 0.1, as pliant_advance_rule */
    double floor; /* fraction of the rest volume; 0.05: no leg makes an element smaller than that */
} pliant_volume_rule;
pliant_volume_rule pliant_volume_rule_default(void);

/* Append a contact point for each element below `near`, ascending by feature.
 * @param positions (nodes x 3) [m]; @param piece_of_node Nullable: (nodes) rigid piece or -1; elements of
 * pieces have no point
 * Errors: MEMORY. */
pliant_status pliant_volume_find(const pliant_volume_rule *rule, const pliant_mesh *mesh, const double *positions,
                                 const int32_t *piece_of_node, pliant_contacts *out);

/* Gradient of the gap of such a point at positions (nodes x 3), by its nodes. */
void pliant_volume_gradient(const pliant_contact_point *point, const double *positions, double out[4][3]);

/* Shorten the ways of nodes so that at no time in the leg an element becomes smaller than max(min(keep V, stop V_rest), min(floor V_rest, V)),
 * with its volume V at the start of the leg. Nodes go straight, all with the same clock. Elements that are inverted at the start are exempt.
 * @param from, to (nodes x 3) positions at both ends of the leg [m]; @param piece_of_node as above
 * @param share (nodes) out: fraction of its way that each node may go
 * @return elements that would have been too small; 0: all shares are 1 */
int32_t pliant_volume_hold_back(const pliant_volume_rule *rule, const pliant_mesh *mesh, const double *from,
                                const double *to, const int32_t *piece_of_node, double *share);

/* The largest fraction of a leg in which no element becomes smaller than that, where all nodes go the same fraction of
 * their ways. Parameters as above. */
double pliant_volume_advance(const pliant_volume_rule *rule, const pliant_mesh *mesh, const double *from,
                             const double *to, const int32_t *piece_of_node);

#ifdef __cplusplus
}
#endif
#endif
