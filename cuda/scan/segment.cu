#include "cuda/scan/segment.h"

#include "cuda/base/check.h"
#include "base/fail.h"
#include "cuda/base/device.h"
#include "base/memory.h"
#include "scan/volume.h"

#include <cmath>

/* Data of one segmentation. */
struct segmenting {
    cudaStream_t stream;
    gpu_segment gpu;
    void *d_arena, *d_tallies, *d_label;
    segment_histogram histogram;
    segment_fits fits;
    float logs[SEGMENT_BINS * PLIANT_MAX_CLASSES];
    uint32_t fine[SEGMENT_FINE_BINS];
    unsigned long long count[SEGMENT_BINS];
    double quantum;
};

/* Arrays in one block of memory: sizes are added up first, then addresses are assigned. */
struct arena {
    char *begin;
    size_t used;
    template <class T> void place(T **out, size_t count)
    {
        if (begin) *out = reinterpret_cast<T *>(begin + used);
        used += (count * sizeof(T) + 255) / 256 * 256;
    }
};

static void place_all(gpu_segment *gpu, size_t source_bytes, arena *memory)
{
    const size_t voxels = (size_t)gpu->voxels;
    char *d_source = NULL;
    memory->place(&d_source, source_bytes);
    gpu->d_source = d_source;
    memory->place(&gpu->d_raw, voxels);
    memory->place(&gpu->d_bins, voxels);
    memory->place(&gpu->d_classes, voxels);
    memory->place(&gpu->d_wave, voxels);
    memory->place(&gpu->d_parent, voxels);
    memory->place(&gpu->d_piece, voxels);
    memory->place(&gpu->d_key, voxels);
    memory->place(&gpu->d_block_count, voxels / SEGMENT_NUMBERED + 2);
    memory->place(&gpu->d_range, 1);
    memory->place(&gpu->d_fine, SEGMENT_FINE_BINS);
    memory->place(&gpu->d_count, SEGMENT_BINS);
    memory->place(&gpu->d_logs, SEGMENT_BINS * PLIANT_MAX_CLASSES);
    memory->place(&gpu->d_left, 1);
}

static pliant_status begin(segmenting *work, const pliant_volume *scan)
{
    int device;
    gpu_segment *gpu = &work->gpu;
    CUDA_TRY(pliant_cuda_current_device(&device));
    CUDA_TRY(CUDA_CALL(cudaStreamCreateWithFlags(&work->stream, cudaStreamNonBlocking)));
    for (int d = 0; d < 3; d++) gpu->size[d] = scan->geometry.size[d];
    gpu->voxels = (int32_t)pliant_geometry_voxels(&scan->geometry);
    gpu->encoding = scan->encoding;
    gpu->slope = scan->slope;
    gpu->intercept = scan->intercept;
    const size_t bytes = (size_t)gpu->voxels * pliant_encoding_size(scan->encoding);
    arena memory = {};
    place_all(gpu, bytes, &memory);
    CUDA_TRY(pliant_cuda_allocate(memory.used, "the segmentation", &work->d_arena));
    memory = {static_cast<char *>(work->d_arena), 0};
    place_all(gpu, bytes, &memory);
    return pliant_cuda_send(scan->voxels, bytes, const_cast<void *>(gpu->d_source), work->stream);
}

static pliant_status fetch(segmenting *work, void *h_to, const void *d_from, size_t bytes)
{
    CUDA_TRY(CUDA_CALL(cudaMemcpyAsync(h_to, d_from, bytes, cudaMemcpyDeviceToHost, work->stream)));
    return CUDA_CALL(cudaStreamSynchronize(work->stream));
}

/* As count_values of src/scan/segment.c. */
static pliant_status count_values(segmenting *work, const pliant_volume *scan)
{
    const gpu_segment *gpu = &work->gpu;
    segment_histogram *histogram = &work->histogram;
    gpu_range range;
    int64_t differences[SEGMENT_BINS];
    CUDA_TRY(pliant_cuda_segment_range(gpu, work->stream));
    CUDA_TRY(fetch(work, &range, gpu->d_range, sizeof range));
    if (range.infinite)
        return pliant_fail(PLIANT_ERROR_ARGUMENT, "segmentation: %s holds values that are not finite", scan->id);
    const double minimum = pliant_cuda_segment_float(range.minimum), maximum = pliant_cuda_segment_float(range.maximum);
    CUDA_TRY(pliant_cuda_segment_fine(
        gpu, minimum, maximum > minimum ? (SEGMENT_FINE_BINS - 1) / (maximum - minimum) : 0, work->stream));
    CUDA_TRY(fetch(work, work->fine, gpu->d_fine, sizeof work->fine));
    segment_set_bins(scan, minimum, maximum, work->fine, histogram);
    CUDA_TRY(pliant_cuda_segment_raw(gpu, histogram, work->stream));
    CUDA_TRY(fetch(work, work->count, gpu->d_count, sizeof work->count));
    for (int bin = 0; bin < SEGMENT_BINS; bin++) differences[bin] = (int64_t)work->count[bin];
    segment_set_noise(differences, histogram);
    CUDA_TRY(pliant_cuda_segment_smooth(gpu, segment_max_noise_step(histogram), work->stream));
    CUDA_TRY(fetch(work, work->count, gpu->d_count, sizeof work->count));
    for (int bin = 0; bin < SEGMENT_BINS; bin++) {
        histogram->count[bin] = 0.25 * (double)work->count[bin];
        histogram->total += histogram->count[bin];
    }
    /* Integer multiples of this quantum, summed over all voxels, stay below 2^62. */
    work->quantum = ldexp(1, ilogb(fmax(fmax(fabs(minimum), fabs(maximum)), 1e-30)) + 1 - 30);
    return PLIANT_OK;
}

/* Absorb specks on the CPU if some voxels are too deep inside for the keys. */
static pliant_status absorb_on_cpu(segmenting *work, double minimum, int32_t count)
{
    const gpu_segment *gpu = &work->gpu;
    const size_t voxels = (size_t)gpu->voxels;
    uint8_t *classes = static_cast<uint8_t *>(pliant_calloc(voxels, 1));
    int32_t *piece = static_cast<int32_t *>(pliant_calloc(voxels, sizeof *piece));
    pliant_status status = classes && piece ? PLIANT_OK : pliant_fail_memory("the specks");
    if (status == PLIANT_OK) status = fetch(work, classes, gpu->d_classes, voxels);
    if (status == PLIANT_OK) status = fetch(work, piece, gpu->d_piece, voxels * sizeof *piece);
    if (status == PLIANT_OK) status = segment_absorb(gpu->size, piece, count, minimum, classes);
    if (status == PLIANT_OK) status = pliant_cuda_send(classes, voxels, gpu->d_classes, work->stream);
    if (status == PLIANT_OK) status = CUDA_CALL(cudaStreamSynchronize(work->stream));
    pliant_free(classes);
    pliant_free(piece);
    return status;
}

static pliant_status piece_count(segmenting *work, int32_t *out)
{
    const gpu_segment *gpu = &work->gpu;
    CUDA_TRY(pliant_cuda_segment_connect(gpu, work->stream));
    return fetch(work, out, gpu->d_block_count + (gpu->voxels + (int64_t)SEGMENT_NUMBERED - 1) / SEGMENT_NUMBERED,
                 sizeof *out);
}

/* Find the pieces and give the voxels of small ones to their neighbours. If a key is too short, the CPU does it
 * instead. */
static pliant_status absorb(segmenting *work, const pliant_volume *scan, const pliant_segment_options *options,
                            int32_t *count)
{
    const gpu_segment *gpu = &work->gpu;
    const double *spacing = scan->geometry.spacing,
                 minimum = options->min_volume / (spacing[0] * spacing[1] * spacing[2]);
    int32_t waiting, left;
    CUDA_TRY(piece_count(work, count));
    CUDA_TRY(pliant_cuda_segment_wait(gpu, minimum, work->stream));
    CUDA_TRY(fetch(work, &waiting, gpu->d_left, sizeof waiting));
    if (waiting == 0 || waiting == gpu->voxels) return PLIANT_OK;
    CUDA_TRY(CUDA_CALL(
        cudaMemcpyAsync(gpu->d_raw, gpu->d_classes, (size_t)gpu->voxels, cudaMemcpyDeviceToDevice, work->stream)));
    CUDA_TRY(pliant_cuda_segment_absorb(gpu, work->stream));
    CUDA_TRY(fetch(work, &left, gpu->d_left, sizeof left));
    if (left > 0) {
        CUDA_TRY(CUDA_CALL(
            cudaMemcpyAsync(gpu->d_classes, gpu->d_raw, (size_t)gpu->voxels, cudaMemcpyDeviceToDevice, work->stream)));
        CUDA_TRY(absorb_on_cpu(work, minimum, *count));
    }
    return piece_count(work, count);
}

static pliant_status write_pieces(segmenting *work, const pliant_volume *scan, int32_t count, pliant_segmentation *out)
{
    const gpu_segment *gpu = &work->gpu;
    const size_t pieces = (size_t)count;
    if (count > UINT16_MAX) return segment_name(&scan->geometry, NULL, count, NULL, out); /* returns the error */
    gpu_tally *sums = static_cast<gpu_tally *>(pliant_calloc(pieces, sizeof *sums));
    segment_tally *tallies = static_cast<segment_tally *>(pliant_calloc(pieces, sizeof *tallies));
    uint16_t *label = static_cast<uint16_t *>(pliant_calloc(pieces, sizeof *label));
    pliant_status status = sums && tallies && label ? PLIANT_OK : pliant_fail_memory("the pieces");
    if (status == PLIANT_OK) status = pliant_cuda_allocate(pieces * sizeof *sums, "the pieces", &work->d_tallies);
    if (status == PLIANT_OK)
        status = pliant_cuda_segment_tally(gpu, work->quantum, static_cast<gpu_tally *>(work->d_tallies), count,
                                           work->stream);
    if (status == PLIANT_OK) status = fetch(work, sums, work->d_tallies, pieces * sizeof *sums);
    for (int32_t p = 0; status == PLIANT_OK && p < count; p++) {
        segment_tally *one = tallies + p;
        one->piece = p;
        one->voxels = (int32_t)sums[p].voxels;
        one->sum = work->quantum * (double)sums[p].value;
        one->class_index = (uint8_t)sums[p].class_index;
        for (int d = 0; d < 3; d++) one->at[d] = (double)sums[p].at[d];
    }
    if (status == PLIANT_OK) status = segment_name(&scan->geometry, tallies, count, label, out);
    if (status == PLIANT_OK)
        status = pliant_cuda_upload(label, pieces * sizeof *label, "the labels", work->stream, &work->d_label);
    if (status == PLIANT_OK)
        status = pliant_cuda_segment_label(gpu, static_cast<const uint16_t *>(work->d_label), work->stream);
    if (status == PLIANT_OK)
        status = fetch(work, out->labels.voxels, gpu->d_raw, (size_t)gpu->voxels * sizeof *out->labels.voxels);
    pliant_free(sums);
    pliant_free(tallies);
    pliant_free(label);
    return status;
}

static pliant_status run(segmenting *work, const pliant_volume *scan, const pliant_segment_options *options,
                         pliant_segmentation *out)
{
    const gpu_segment *gpu = &work->gpu;
    int32_t count;
    CUDA_TRY(begin(work, scan));
    CUDA_TRY(count_values(work, scan));
    CUDA_TRY(pliant_cuda_segment_fit(&work->histogram, segment_max_classes(options), work->stream, &work->fits));
    out->num_classes = segment_choose_mixture(&work->histogram, options, &work->fits, out->classes, &out->criterion);
    segment_log_densities(&work->histogram, out->classes, out->num_classes, work->logs);
    CUDA_TRY(pliant_cuda_send(work->logs, sizeof work->logs, gpu->d_logs, work->stream));
    CUDA_TRY(pliant_cuda_segment_agree(gpu, out->num_classes, (float)options->coherence, work->stream));
    CUDA_TRY(absorb(work, scan, options, &count));
    return write_pieces(work, scan, count, out);
}

static pliant_status segment(const pliant_volume *scan, const pliant_segment_options *options, pliant_segmentation *out)
{
    segmenting *work = static_cast<segmenting *>(pliant_calloc(1, sizeof *work));
    if (!work) return pliant_fail_memory("the segmentation");
    pliant_cuda_section_begin("segment");
    pliant_status status = run(work, scan, options, out);
    if (work->stream) cudaStreamSynchronize(work->stream);
    pliant_cuda_release(work->d_arena, work->d_tallies, work->d_label);
    if (work->stream) cudaStreamDestroy(work->stream);
    cudaGetLastError();
    pliant_cuda_section_end();
    pliant_free(work);
    return status;
}

/* Assigned by name, since C++14 has no designated initializers. */
static constexpr pliant_segment_device table()
{
    pliant_segment_device made{};
    made.probe = pliant_cuda_text;
    made.segment = segment;
    return made;
}
const pliant_segment_device pliant_cuda_segment_device = table();
