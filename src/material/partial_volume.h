/* Voxels that contain both tissue and air (partial volume). Their intensity resembles a lighter material, such as
 * lung. */
#ifndef PLIANT_MATERIAL_PARTIAL_VOLUME_H
#define PLIANT_MATERIAL_PARTIAL_VOLUME_H

#include "pliant/material.h"

#ifdef __cplusplus
extern "C" {
#endif

/* Return the material of a voxel for pictures. Layers of at most 3 voxels between air (an empty material) and much
 * denser tissue get the tissue's material. "Much denser" means more than twice the voxel's density. All other voxels
 * keep their material.
 * @param at  Voxel along i, j, k. */
uint8_t pliant_material_for_display(const pliant_material_table *table, const int32_t size[3],
                                    const uint8_t *material_of_voxel, const int32_t at[3]);

#ifdef __cplusplus
}
#endif

#endif
