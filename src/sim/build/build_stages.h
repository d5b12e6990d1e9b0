/* Stages of building a model (model.c) that have their own files. */
#ifndef PLIANT_SIM_BUILD_STAGES_H
#define PLIANT_SIM_BUILD_STAGES_H

#include "model_data/model.h"

/* ---- mesh_from_file.c
 * Read mesh/file into the topology's fine mesh. Its tetrahedra get their materials from the file's regions, or from
 * the scan if there is no region. Errors: FILE, FORMAT, SCENE, MATERIAL (regions without a material), MEMORY. */
pliant_status pliant_external_mesh(pliant_model *model);
/* Refuse options that conflict with mesh/file. Errors: SCENE. */
pliant_status pliant_external_check(const pliant_scene *scene);

/* ---- fixed_regions.c: fixed materials (bone) and the regions of the scene
 * Return whether a node of the fine mesh is fixed, from its rest position. */
bool pliant_fixed_node(const pliant_model *model, int32_t node);
/* Warn about planes of the scene that lie between nodes, with their distance to the nearest ones.
 * @return number of the first plane without fixed nodes, counted from 1; 0: all planes have fixed nodes */
int pliant_fixed_planes_log(const pliant_model *model);
/* Move nodes of the fine mesh near fixed material onto its surface, as the voxels show it (mesh/bone_surface).
 * Errors: MEMORY, FORMAT. */
pliant_status pliant_fixed_surface(pliant_model *model);

/* ---- automatic_lengths.c
 * Set every length that is `auto` in the model's copy of the scene; it follows from the size of the tissue. The mesh
 * must exist. Warn if the scene's margin makes the deformed volume more than 4 times as large as the scan. */
void pliant_model_set_lengths(pliant_model *model);

/* ---- sliding_organs.c
 * Cut the rest topology, which must have voxels, where a sliding material meets another one (material/slides).
 * Errors: SCENE (no such material), and as of pliant_body_sever. */
pliant_status pliant_model_part_slides(pliant_model *model);

#endif
