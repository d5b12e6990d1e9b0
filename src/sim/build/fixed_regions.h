/* Fixed parts of a scan: fixed materials (bone) and the regions of the scene. */
#ifndef PLIANT_SIM_BUILD_FIXED_REGIONS_H
#define PLIANT_SIM_BUILD_FIXED_REGIONS_H

#include "model_data/model.h"

/* Return whether a node of the fine mesh is fixed, from its rest position. */
bool pliant_fixed_node(const pliant_model *model, int32_t node);

/* Warn about planes of the scene that lie between nodes, with their distance to the nearest ones.
 * @return number of the first plane without fixed nodes, counted from 1; 0: there is none */
int pliant_fixed_planes_log(const pliant_model *model);

/* Move nodes of the fine mesh near fixed material onto its surface, as the voxels show it (mesh/bone_surface).
 * Errors: MEMORY, FORMAT. */
pliant_status pliant_fixed_surface(pliant_model *model);

#endif
