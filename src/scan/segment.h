/* The steps of a segmentation. */
#ifndef PLIANT_SCAN_SEGMENT_H
#define PLIANT_SCAN_SEGMENT_H

#include "pliant/segment.h"

#ifdef __cplusplus
extern "C" {
#endif

enum { SEGMENT_BINS = 1024 };

/* The values of a volume, counted. The first and last bin also hold what lies beyond. */
typedef struct segment_histogram {
    double low, width;          /* lower side of the first bin, width of one */
    double count[SEGMENT_BINS];
    double total;
    double noise;               /* standard deviation of the values' noise */
} segment_histogram;

/* ---- segment_mixture.c */
/* Fit by expectation and maximization, from one class up: of each number the best split of the one before. out has room for
 * PLIANT_MAX_CLASSES, ascending means; returns how many. */
int segment_fit(const segment_histogram *histogram, const pliant_segment_options *options, pliant_segment_class *out, double *criterion);
/* log of weight times density at every bin: (SEGMENT_BINS x PLIANT_MAX_CLASSES) */
void segment_log_densities(const segment_histogram *histogram, const pliant_segment_class *classes, int count, float *out);

/* ---- segment_pieces.c */
/* Connected voxels (6 neighbours) of one class: piece of every voxel, in the order of their first voxels. Errors: MEMORY. */
pliant_status segment_connect(const int32_t size[3], const uint8_t *class_of_voxel, int32_t *piece, int32_t *count);
/* Voxels of pieces below `least` voxels take the class of the nearest voxel of a larger piece, in steps to neighbours; when none is
 * that large, nothing changes. Errors: MEMORY. */
pliant_status segment_absorb(const int32_t size[3], const int32_t *piece, int32_t count, double least, uint8_t *class_of_voxel);

#ifdef __cplusplus
}
#endif

#endif
