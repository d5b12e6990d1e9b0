/* Models: what the library needs beyond pliant/model.h. */
#ifndef PLIANT_SIM_MODEL_H
#define PLIANT_SIM_MODEL_H

#include "base/export.h"
#include "pliant/model.h"

#ifdef __cplusplus
extern "C" {
#endif

PLIANT_INTERNAL const char *pliant_build_stage_name(int stage);

/* A warning to the log when the scene's method is a coarse one and there is gravity, which none of them carries well; building asks for
 *  the scene's own. */
PLIANT_INTERNAL void pliant_gravity_warning(const pliant_scene *scene, const double gravity[3]);

/* Compute the factor of default lengths for a body. It is 1 for bodies of 50 to 600 mm (cube root of the tissue's volume) and in proportion to smaller
 *  and larger bodies. @param labels Nullable. Errors: as pliant_material_classify. */
PLIANT_INTERNAL pliant_status pliant_length_scale(const pliant_volume *scan, const pliant_labels *labels, const pliant_material_table *materials, double *out);

PLIANT_INTERNAL const pliant_volume *pliant_model_get_drawn(const pliant_model *model); /* what is deformed: the scan, with warp/hide_empty a copy without what is empty */

/* (voxels) index into the materials. */
const uint8_t *pliant_model_get_voxel_materials(const pliant_model *model);

/* The same with a table that is there already, in place of the scene's material/file. Free scan and labels. */
PLIANT_INTERNAL pliant_status pliant_scan_inputs_read(const pliant_scene *scene, const pliant_material_table *materials, const char *scan_path,
                                                 pliant_volume *scan, pliant_labels *labels);

#ifdef __cplusplus
}
#endif
#endif
