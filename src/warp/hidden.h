/* What of a scan is not drawn. */
#ifndef PLIANT_WARP_HIDDEN_H
#define PLIANT_WARP_HIDDEN_H

#include "pliant/scan.h"

#include <stdbool.h>
#include <stdint.h>

#ifdef __cplusplus
extern "C" {
#endif

/* A copy of a scan with its background where a material is hidden.
 * @param material_of_voxel (voxels) @param out pliant_volume_free   Errors: MEMORY. */
pliant_status pliant_volume_hide(const pliant_volume *scan, const uint8_t *material_of_voxel, const bool hidden[256], pliant_volume *out);

#ifdef __cplusplus
}
#endif

#endif
