/* Pictures of a scan before and after: slices through a point, one PNG an anatomical plane. */
#ifndef PLIANT_TOOLS_PICTURE_H
#define PLIANT_TOOLS_PICTURE_H

#include "pliant/scan.h"

#ifdef __cplusplus
extern "C" {
#endif

typedef struct picture_view {
    double before_point[3], after_point[3]; /* marked with a cross; the planes go through the first one. LPS [m] */
    double low, high;                       /* values that are shown black and white */
} picture_view;

/* What suits the scan: a soft-tissue window for CT (where the header does not tell, anything below -500 is air), else from the 1st
 * percentile to the 99th, so that a few bright vessels do not darken all else. Errors: MEMORY. */
pliant_status picture_window(const pliant_volume *scan, double *low, double *high);

/* folder/axial.png, coronal.png, sagittal.png: before, after and difference side by side. In the difference red is
 * brighter than before, blue darker. Errors: FILE, MEMORY. */
pliant_status picture_write(const char *folder, const pliant_volume *before, const pliant_volume *after,
                            const picture_view *view);

/* rgb is (height x width x 3), top row first. Errors: FILE. */
pliant_status picture_png(const char *path, const uint8_t *rgb, int32_t width, int32_t height);

#ifdef __cplusplus
}
#endif
#endif
