/* Internal functions of models, in addition to pliant/model.h. */
#ifndef PLIANT_SIM_MODEL_H
#define PLIANT_SIM_MODEL_H

#include "base/export.h"
#include "pliant/model.h"

#ifdef __cplusplus
extern "C" {
#endif

PLIANT_INTERNAL const char *pliant_build_stage_name(int stage);

/* Warn if the scene's method is coarse and there is gravity: no coarse method represents gravity well. Building
 * checks the scene's own gravity. */
PLIANT_INTERNAL void pliant_gravity_warning(const pliant_scene *scene, const double gravity[3]);

/* Compute the factor of default lengths for a body. It is 1 for bodies of 50 to 600 mm (cube root of the tissue's volume) and in proportion to smaller
 *  and larger bodies. @param labels Nullable. Errors: as pliant_material_classify. */
PLIANT_INTERNAL pliant_status pliant_length_scale(const pliant_volume *scan, const pliant_labels *labels, const pliant_material_table *materials, double *out);

/* the volume that is deformed: the scan, or with warp/hide_empty a copy without empty voxels */
PLIANT_INTERNAL const pliant_volume *pliant_model_get_drawn(const pliant_model *model);

/* (voxels) index into the materials. */
const uint8_t *pliant_model_get_voxel_materials(const pliant_model *model);

/* Read scan and labels with a given material table instead of the scene's material/file. The caller frees both. */
PLIANT_INTERNAL pliant_status pliant_scan_inputs_read(const pliant_scene *scene, const pliant_material_table *materials, const char *scan_path,
                                                 pliant_volume *scan, pliant_labels *labels);

#ifdef __cplusplus
}
#endif
#endif
