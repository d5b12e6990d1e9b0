/* Segmentation on the GPU (src/scan/segment.c). Bins, sigma filter, neighbour agreement, pieces and specks are
 * identical to the CPU's results. The sums of the mixture use another order, in a fixed tree, so its classes differ by
 * about 1e-12. The entry point is pliant_cuda_segment_device (scan/segment.h). */
#ifndef PLIANT_CUDA_SEGMENT_H
#define PLIANT_CUDA_SEGMENT_H

#include "scan/segment.h"

#include <cuda_runtime_api.h>

enum {
    SEGMENT_MAX_WAVES = 11 /* keys have 3 bits per wave */,
    SEGMENT_NUMBERED = 1024 /* voxels numbered by a block */
};

/* Sums over a piece; value is in units of a quantum. */
typedef struct gpu_tally { unsigned long long voxels, at[3]; long long value; int32_t class_index; } gpu_tally;

/* Range of the values, as unsigned integers in the order of the floats. */
typedef struct gpu_range { uint32_t minimum, maximum, infinite; } gpu_range;

/* Device arrays, (voxels) unless a size is given. */
typedef struct gpu_segment {
    int32_t size[3], voxels;
    pliant_encoding encoding;
    float slope, intercept;
    const void *d_source;
    uint16_t *d_raw, *d_bins;       /* raw: holds the labels later */
    uint8_t *d_classes, *d_wave;    /* wave: number of the wave that reached a speck's voxel; 0 for all others */
    int32_t *d_parent, *d_piece;
    unsigned long long *d_key;      /* of specks; two numbers per voxel while pieces are numbered */
    int32_t *d_block_count;         /* (voxels / SEGMENT_NUMBERED, and one more for the total) */
    gpu_range *d_range;             /* (1) */
    uint32_t *d_fine;               /* (SEGMENT_FINE_BINS) */
    unsigned long long *d_count;    /* (SEGMENT_BINS) differences; later four times the histogram */
    float *d_logs;                  /* (SEGMENT_BINS x PLIANT_MAX_CLASSES) */
    int32_t *d_left;                /* (1) remaining voxels */
} gpu_segment;

/* ---- Implemented in segment_values.cu; all functions enqueue work. */
pliant_status pliant_cuda_segment_range(const gpu_segment *segment, cudaStream_t stream);
float pliant_cuda_segment_float(uint32_t ordered); /* a value of gpu_range */
pliant_status pliant_cuda_segment_fine(const gpu_segment *segment, double minimum, double scale, cudaStream_t stream);
pliant_status pliant_cuda_segment_raw(const gpu_segment *segment, const segment_histogram *histogram,
                                      cudaStream_t stream);
pliant_status pliant_cuda_segment_smooth(const gpu_segment *segment, int reach, cudaStream_t stream);

/* ---- Implemented in segment_mixture.cu; waits for the result. Errors: MEMORY, UNAVAILABLE. */
pliant_status pliant_cuda_segment_fit(const segment_histogram *histogram, int maximum, cudaStream_t stream,
                                      segment_fits *out);

/* ---- Implemented in segment_pieces.cu; all functions enqueue work. */
pliant_status pliant_cuda_segment_agree(const gpu_segment *segment, int count, float coherence, cudaStream_t stream);
/* Compute d_piece, and the number of pieces at the end of d_block_count. */
pliant_status pliant_cuda_segment_connect(const gpu_segment *segment, cudaStream_t stream);
/* Count the remaining voxels in *d_left: first all voxels of small pieces (wait), then voxels too deep inside one for
 * SEGMENT_MAX_WAVES (absorb). */
pliant_status pliant_cuda_segment_wait(const gpu_segment *segment, double minimum, cudaStream_t stream);
pliant_status pliant_cuda_segment_absorb(const gpu_segment *segment, cudaStream_t stream);
pliant_status pliant_cuda_segment_tally(const gpu_segment *segment, double quantum, gpu_tally *d_tallies, int32_t count,
                                        cudaStream_t stream);
pliant_status pliant_cuda_segment_label(const gpu_segment *segment, const uint16_t *d_label, cudaStream_t stream);

#endif
