/* Rigid tools that hold one point. With a constraint for each, two rows would be equal and the constraint matrix
 * singular. */
#ifndef PLIANT_MODEL_DATA_COINCIDENT_GRASPS_H
#define PLIANT_MODEL_DATA_COINCIDENT_GRASPS_H

#include "model_data/data.h"

/* Return whether both tools are rigid and their held points at rest are closer than a quarter of a cube's shortest
 * edge. Displacements are linear within an element, so such points cannot separate. Two constraints would exert
 * opposite forces that grow as 1 / distance. */
bool pliant_holds_coincide(const pliant_mesh *fine, const pliant_tool *a, const pliant_tool *b);

#endif
