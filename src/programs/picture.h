/* Pictures of a scan before and after a deformation: slices through a point, one PNG per anatomical plane. */
#ifndef PLIANT_TOOLS_PICTURE_H
#define PLIANT_TOOLS_PICTURE_H

#include "pliant/scan.h"

#ifdef __cplusplus
extern "C" {
#endif

enum { PICTURE_PIXELS = 480, PICTURE_PLANES = 3, PICTURE_MAX_VOLUMES = 8 };

/* World axes of a picture to the right and downwards; upwards: the vertical axis is inverted (superior is up). */
typedef struct picture_plane {
    const char *name;
    int right, down, normal;
    bool upwards;
} picture_plane;
extern const picture_plane picture_planes[PICTURE_PLANES]; /* axial, coronal, sagittal */

/* The world box of a grid as one panel, whose longer side has PICTURE_PIXELS pixels. */
typedef struct picture_frame {
    const picture_plane *plane;
    double low[3], high[3]; /* [m] */
    double pixel;           /* [m] */
    int32_t width, height;
} picture_frame;
picture_frame picture_frame_of(const picture_plane *plane, const pliant_geometry *shown);
/* Return the centre of a pixel in the plane through a point. */
void picture_world(const picture_frame *frame, const double point[3], int32_t column, int32_t row, double world[3]);

typedef struct picture_view {
    double before_point[3], after_point[3]; /* marked with a cross; the planes go through the first one. LPS [m] */
    double low, high;                       /* values shown as black and white */
} picture_view;

/* Choose the grey-value window of a scan: a soft-tissue window for CT, otherwise the 1st to the 99th percentile, so
 * that a few bright vessels do not darken the rest. If the header does not contain the modality, a scan with values
 * below -500 counts as CT. Errors: MEMORY. */
pliant_status picture_window(const pliant_volume *scan, double *low, double *high);

/* Write folder/axialSUFFIX.png, coronal, sagittal: before, after and difference side by side. In the difference, red is
 * brighter than before and blue darker. Errors: FILE, MEMORY. */
pliant_status picture_write(const char *folder, const char *suffix, const pliant_volume *before,
                            const pliant_volume *after, const picture_view *view);

/* The same slice of several volumes. */
typedef struct picture_row {
    int num_volumes;
    const pliant_volume *volumes[PICTURE_MAX_VOLUMES];
    double marks[PICTURE_MAX_VOLUMES][3]; /* positions of crosses, LPS [m] */
    double point[3];                      /* point on all planes */
    double low, high;                     /* values shown as black and white */
} picture_row;
/* Write folder/axial.png, coronal.png, sagittal.png: the volumes side by side. Errors: FILE, MEMORY. */
pliant_status picture_write_row(const char *folder, const picture_row *row);

/* Set the colour of a label. Hues differ by the golden angle, so that successive labels have very different colours. */
void picture_label_colour(int label, uint8_t rgb[3]);

/* Write folder/axial.png, coronal.png and sagittal.png: the scan, and the colours of its labels. Errors: FILE,
 * MEMORY. */
pliant_status picture_write_labels(const char *folder, const pliant_volume *scan, const pliant_labels *labels,
                                   const double point[3]);

/* rgb is (height x width x 3), top row first. Errors: FILE. */
pliant_status picture_png(const char *path, const uint8_t *rgb, int32_t width, int32_t height);

#ifdef __cplusplus
}
#endif
#endif
