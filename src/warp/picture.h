/* Pictures of a volume as it lies. */
#ifndef PLIANT_WARP_PICTURE_H
#define PLIANT_WARP_PICTURE_H

#include "pliant/render.h"

#ifdef __cplusplus
extern "C" {
#endif

/* A volume as it lies.
 *  @param labels      Nullable: UINT8 on the volume's grid; 0 is none
 *  @param num_threads 0: as many as the machine has cores. On the CPU.
 *  Errors: ARGUMENT (camera, style, grids), MEMORY. */
pliant_status pliant_render(const pliant_volume *volume, const pliant_volume *labels, const pliant_camera *camera,
                                       const pliant_style *style, int num_threads, const pliant_image *out);

/* Line integrals of attenuation along the rays of a camera (a radiograph): mu = water x (1 + HU / 1000), 0 below -1000 HU, and 0 outside the
 *  volume. Of a CT. What a detector measures is exp(-out).
 *  @param water of water [1/m]
 *  @param out   (height x width)
 *  Errors: as pliant_render. */
pliant_status pliant_radiograph(const pliant_volume *volume, const pliant_camera *camera, double water, int num_threads, float *out);

#ifdef __cplusplus
}
#endif
#endif
