/* Read the fine mesh from a file (mesh/file). */
#ifndef PLIANT_SIM_BUILD_MESH_FROM_FILE_H
#define PLIANT_SIM_BUILD_MESH_FROM_FILE_H

#include "model_data/model.h"

/* Read mesh/file into the topology's fine mesh. Its tetrahedra get their materials from the file's regions, or from
 * the scan if there are none. Errors: FILE, FORMAT, SCENE, MATERIAL (regions without a material), MEMORY. */
pliant_status pliant_external_mesh(pliant_model *model);

/* Refuse options that conflict with mesh/file. Errors: SCENE. */
pliant_status pliant_external_check(const pliant_scene *scene);

#endif
