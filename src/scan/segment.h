/* Steps of a segmentation. */
#ifndef PLIANT_SCAN_SEGMENT_H
#define PLIANT_SCAN_SEGMENT_H

#include "pliant/segment.h"
#include "scene/gpu_choice.h"

#ifdef __cplusplus
extern "C" {
#endif

enum { SEGMENT_BINS = 1024 };

/* Histogram of a volume's values. The first and last bin include the values beyond them. */
typedef struct segment_histogram {
    double low, width;          /* lower edge of the first bin, width of a bin */
    double count[SEGMENT_BINS];
    double total;
    double noise;               /* standard deviation of the noise */
} segment_histogram;

/* A mixture for each number of classes, [number - 1]. likelihood: mean log likelihood of a voxel. */
typedef struct segment_fits {
    pliant_segment_class classes[PLIANT_MAX_CLASSES][PLIANT_MAX_CLASSES];
    double likelihood[PLIANT_MAX_CLASSES];
} segment_fits;

/* Sums over a piece. sum: of the values, with slope and intercept; at: of the voxel indices. */
typedef struct segment_tally { int32_t piece, voxels; double sum, at[3]; uint8_t class_index; } segment_tally;

/* ---- Implemented in segment.c: parts shared by CPU and GPU. */
enum {
    SEGMENT_FINE_BINS = 1 << 16,
    SEGMENT_SWEEPS = 8,
    SEGMENT_MIN_ALIKE_NEIGHBOURS = 18 /* of 27 */,
    SEGMENT_FEW_STEPS = 16 /* of integers */
};
/* Set the bins from the values' range and their counts in SEGMENT_FINE_BINS bins of it. */
void segment_set_bins(const pliant_volume *scan, double minimum, double maximum, const uint32_t *count,
                      segment_histogram *histogram);
/* Set the noise from counts of differences between neighbours along i, without the first bin. */
void segment_set_noise(const int64_t count[SEGMENT_BINS], segment_histogram *histogram);
/* Return the maximum difference in bins that noise alone can cause. */
int segment_max_noise_step(const segment_histogram *histogram);
/* Label the pieces by size and compute their means. tallies: (count), sorted here; label: out: (count). Errors: FORMAT,
 * MEMORY. */
pliant_status segment_name(const pliant_geometry *geometry, segment_tally *tallies, int32_t count, uint16_t *label,
                           pliant_segmentation *out);

/* A device that can run segmentations instead of the CPU. */
typedef struct pliant_segment_device {
    pliant_probe probe;
    /* Run pliant_segment with checked arguments; `out` is zeroed. The caller frees partial results after an error. */
    pliant_status (*segment)(const pliant_volume *scan, const pliant_segment_options *options,
                             pliant_segmentation *out);
} pliant_segment_device;
#ifdef PLIANT_WITH_CUDA
extern const pliant_segment_device pliant_cuda_segment_device;
#endif

/* ---- Implemented in segment_mixture.c. */
/* Fit mixtures by expectation maximization, from one class up to `maximum`. Each mixture is the best split of a class
 * of the previous one. */
void segment_fit(const segment_histogram *histogram, int maximum, segment_fits *out);
/* Choose the mixture with the requested number of classes, or with the best BIC. Return its number of classes.
 * @param out  (PLIANT_MAX_CLASSES) out: classes with ascending means. */
int segment_choose_mixture(const segment_histogram *histogram, const pliant_segment_options *options,
                           const segment_fits *fits, pliant_segment_class *out, double *criterion);
int segment_max_classes(const pliant_segment_options *options);
/* Compute the logarithm of weight times density for every bin: (SEGMENT_BINS x PLIANT_MAX_CLASSES). */
void segment_log_densities(const segment_histogram *histogram, const pliant_segment_class *classes, int count,
                           float *out);

/* ---- Implemented in segment_pieces.c. */
/* Find connected voxels (6 neighbours) of one class. piece: out: piece of every voxel, numbered by their first voxels.
 * Errors: MEMORY. */
pliant_status segment_connect(const int32_t size[3], const uint8_t *class_of_voxel, int32_t *piece, int32_t *count);
/* Absorb pieces of less than `minimum` voxels: their voxels take the class of the nearest voxel of a larger piece, in
 * steps to neighbours. Without a larger piece, no voxel changes. Errors: MEMORY. */
pliant_status segment_absorb(const int32_t size[3], const int32_t *piece, int32_t count, double minimum,
                             uint8_t *class_of_voxel);

#ifdef __cplusplus
}
#endif

#endif
