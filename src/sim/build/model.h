/* Models: functions for nodes, programs and tests. */
#ifndef PLIANT_SIM_MODEL_H
#define PLIANT_SIM_MODEL_H

#include "base/export.h"
#include "pliant/model.h"

#ifdef __cplusplus
extern "C" {
#endif

/* Return the name of a pliant_build_stage, static. */
PLIANT_INTERNAL const char *pliant_build_stage_name(int stage);

/* Log a warning if the scene's method is a coarse one and gravity is not 0, because no coarse method is accurate under
 * gravity. */
PLIANT_INTERNAL void pliant_gravity_warning(const pliant_scene *scene, const double gravity[3]);

/* Compute the factor of default lengths for a body. It is 1 for bodies of 50 to 600 mm (cube root of the tissue's
 * volume) and in proportion for smaller and larger bodies. Errors: as of pliant_material_classify.
 * @param labels Nullable */
PLIANT_INTERNAL pliant_status pliant_length_scale(const pliant_volume *scan, const pliant_labels *labels,
                                                  const pliant_material_table *materials, double *out);

/* Return the deformed volume's source: the scan, or with warp/hide_empty a copy without empty materials. */
PLIANT_INTERNAL const pliant_volume *pliant_model_get_drawn(const pliant_model *model);

/* Return the material of every voxel: (voxels) index into the material table. */
const uint8_t *pliant_model_get_voxel_materials(const pliant_model *model);

/* Read scan and labels as pliant_inputs_read does, for a given table instead of the scene's material/file. */
PLIANT_INTERNAL pliant_status pliant_scan_inputs_read(const pliant_scene *scene, const pliant_material_table *materials,
                                                      const char *scan_path, pliant_volume *scan,
                                                      pliant_labels *labels);

#ifdef __cplusplus
}
#endif
#endif
