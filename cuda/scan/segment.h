/* Segmentation on the GPU (src/scan/segment.c): bins, sigma filter, neighbours that agree, pieces and specks give what
 * the CPU's give, number for number; the mixture is summed in another order, in a fixed tree, so its classes agree to
 * some 1e-12. Its entry is pliant_cuda_segment_device (scan/segment.h). */
#ifndef PLIANT_CUDA_SEGMENT_H
#define PLIANT_CUDA_SEGMENT_H

#include "scan/segment.h"

#include <cuda_runtime_api.h>

#ifdef __cplusplus
extern "C" {
#endif

enum { SEGMENT_MOST_WAVES = 11 /* of 3 bits of a key each */, SEGMENT_NUMBERED = 1024 /* voxels that a block numbers */ };

/* What the sums over a piece are made of; value in units of a quantum. */
typedef struct gpu_tally { unsigned long long voxels, at[3]; long long value; int32_t class_index; } gpu_tally;

/* Extent of the values, as unsigned integers in the order of the floats. */
typedef struct gpu_range { uint32_t least, most, infinite; } gpu_range;

/* Arrays (voxels) of the device, but for those with a size. */
typedef struct gpu_segment {
    int32_t size[3], voxels;
    pliant_encoding encoding;
    float slope, intercept;
    const void *d_source;
    uint16_t *d_raw, *d_bins;       /* raw: later the labels */
    uint8_t *d_classes, *d_wave;    /* wave: in which a speck's voxel was reached, 0 for all others */
    int32_t *d_parent, *d_piece;
    unsigned long long *d_key;      /* of specks; two numbers a voxel while pieces are numbered */
    int32_t *d_block_count;         /* (voxels / SEGMENT_NUMBERED, and one more: all) */
    gpu_range *d_range;             /* (1) */
    uint32_t *d_fine;               /* (SEGMENT_FINE_BINS) */
    unsigned long long *d_count;    /* (SEGMENT_BINS) differences; then four times the histogram */
    float *d_logs;                  /* (SEGMENT_BINS x PLIANT_MAX_CLASSES) */
    int32_t *d_left;                /* (1) voxels that wait */
} gpu_segment;

/* ---- segment_values.cu; all enqueue */
pliant_status pliant_cuda_segment_range(const gpu_segment *segment, cudaStream_t stream);
float pliant_cuda_segment_float(uint32_t ordered); /* of gpu_range */
pliant_status pliant_cuda_segment_fine(const gpu_segment *segment, double least, double scale, cudaStream_t stream);
pliant_status pliant_cuda_segment_raw(const gpu_segment *segment, const segment_histogram *histogram, cudaStream_t stream);
pliant_status pliant_cuda_segment_smooth(const gpu_segment *segment, int reach, cudaStream_t stream);

/* ---- segment_mixture.cu; waits for the result. Errors: MEMORY, UNAVAILABLE. */
pliant_status pliant_cuda_segment_fit(const segment_histogram *histogram, int most, cudaStream_t stream, segment_fits *out);

/* ---- segment_pieces.cu; all enqueue */
pliant_status pliant_cuda_segment_agree(const gpu_segment *segment, int count, float coherence, cudaStream_t stream);
/* d_piece, and how many to the end of d_block_count */
pliant_status pliant_cuda_segment_connect(const gpu_segment *segment, cudaStream_t stream);
/* *d_left: voxels of small pieces; then those that are too far inside one for SEGMENT_MOST_WAVES. */
pliant_status pliant_cuda_segment_wait(const gpu_segment *segment, double least, cudaStream_t stream);
pliant_status pliant_cuda_segment_absorb(const gpu_segment *segment, cudaStream_t stream);
pliant_status pliant_cuda_segment_tally(const gpu_segment *segment, double quantum, gpu_tally *d_tallies, int32_t count, cudaStream_t stream);
pliant_status pliant_cuda_segment_label(const gpu_segment *segment, const uint16_t *d_label, cudaStream_t stream);

#ifdef __cplusplus
}
#endif
#endif
