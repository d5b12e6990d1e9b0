/* Hide materials of a scan. */
#ifndef PLIANT_WARP_HIDE_MATERIALS_H
#define PLIANT_WARP_HIDE_MATERIALS_H

#include "pliant/scan.h"

#include <stdbool.h>
#include <stdint.h>

/* Copy a scan, with the background value in hidden materials.
 * @param material_of_voxel (voxels)
 * @param out free with pliant_volume_free
 * Errors: MEMORY. */
pliant_status pliant_volume_hide(const pliant_volume *scan, const uint8_t *material_of_voxel, const bool hidden[256],
                                 pliant_volume *out);

#endif
