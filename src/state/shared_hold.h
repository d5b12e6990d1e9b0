/* Rigid tools that hold one point: their constraints would be one row twice, and the matrix of all constraints
 * singular. */
#ifndef PLIANT_STATE_SHARED_HOLD_H
#define PLIANT_STATE_SHARED_HOLD_H

#include "state/data.h"

#ifdef __cplusplus
extern "C" {
#endif

/* Whether both are rigid and their held points at rest are closer than a quarter of the shortest edge of a cube.
 * Displacements are linear within an element, so that such points cannot move apart: two constraints would hold each
 * other's forces, which grow as 1 / distance. */
bool pliant_hold_one_point(const pliant_mesh *fine, const pliant_tool *a, const pliant_tool *b);

#ifdef __cplusplus
}
#endif
#endif
