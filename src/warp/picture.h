/* Pictures and radiographs of an undeformed volume. */
#ifndef PLIANT_WARP_PICTURE_H
#define PLIANT_WARP_PICTURE_H

#include "base/export.h"
#include "pliant/render.h"

#ifdef __cplusplus
extern "C" {
#endif

/* Render a volume on the CPU.
 *   @param labels      Nullable: UINT8 on the volume's grid; 0: no label
 *   @param num_threads 0: the number of cores
 * Errors: ARGUMENT (camera, style, grids), MEMORY. */
PLIANT_INTERNAL pliant_status pliant_render(const pliant_volume *volume, const pliant_volume *labels,
                                            const pliant_camera *camera, const pliant_style *style, int num_threads,
                                            const pliant_image *out);

/* Compute line integrals of attenuation in a CT along the rays of a camera (a radiograph). mu is water x (1 + HU /
 * 1000), 0 below -1000 HU, and 0 outside of the volume. A detector measures exp(-out).
 *   @param water attenuation of water [1/m]
 *   @param out   (height x width)
 * Errors: as pliant_render. */
pliant_status pliant_radiograph(const pliant_volume *volume, const pliant_camera *camera, double water, int num_threads,
                                float *out);

#ifdef __cplusplus
}
#endif
#endif
