/* Voxels that tissue shares with air (partial volume). By their intensity they look like a lighter material, such as
 * lung. */
#ifndef PLIANT_MATERIAL_MIXED_H
#define PLIANT_MATERIAL_MIXED_H

#include "pliant/material.h"

#ifdef __cplusplus
extern "C" {
#endif

/* Return the material of a voxel as pictures show it. A voxel in a layer of at most 3 voxels between air (an empty
 * material) and a tissue of more than twice its density has the material of that tissue; all others have their own.
 * @param at voxel along i, j, k */
uint8_t pliant_material_shown(const pliant_material_table *table, const int32_t size[3], const uint8_t *material_of_voxel, const int32_t at[3]);

#ifdef __cplusplus
}
#endif

#endif
