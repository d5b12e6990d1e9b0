/* What of a scan does not move: fixed materials (bone) and the regions of the scene. */
#ifndef PLIANT_SIM_FIXED_H
#define PLIANT_SIM_FIXED_H

#include "state/model.h"

#ifdef __cplusplus
extern "C" {
#endif

/* Whether a node of the fine mesh is fixed, by where it lies. */
bool pliant_fixed_node(const pliant_model *model, int32_t node);

/* Warns of planes of the scene that lie between nodes, with how far. @return the first that holds none, counted from 1; 0: there is no such plane */
int pliant_fixed_planes_tell(const pliant_model *model);

/* Nodes of the fine mesh beside what is fixed onto its surface, as voxels show it (mesh/bone_surface). Errors: MEMORY, FORMAT. */
pliant_status pliant_fixed_surface(pliant_model *model);

#ifdef __cplusplus
}
#endif

#endif
