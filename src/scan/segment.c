/* Segmentation from values to labelled pieces: histogram, mixture, neighbour agreement, pieces. */
#include "scan/segment.h"

#include "base/fail.h"
#include "base/threads.h"
#include "base/memory.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

void pliant_segment_options_from(const pliant_scene *scene, const pliant_geometry *scan, pliant_segment_options *out)
{
    const double usual = 1e-6, part = 5e-4;
    const double volume = (double)pliant_geometry_voxels(scan) * scan->spacing[0] * scan->spacing[1] * scan->spacing[2];
    *out = (pliant_segment_options){.classes = scene->segment.classes, .max_classes = scene->segment.max_classes,
                                    .coherence = scene->segment.coherence, .min_volume = scene->segment.min_volume,
                                    .num_threads = scene->solver.threads, .backend = scene->solver.backend};
    if (scene->segment.min_volume == PLIANT_AUTO_LENGTH) out->min_volume = fmin(usual, part * volume);
}

static pliant_status check(const pliant_volume *scan, const pliant_segment_options *options)
{
    size_t voxels = pliant_geometry_voxels(&scan->geometry);
    if (!scan->voxels || voxels == 0 || voxels > INT32_MAX)
        return pliant_fail(PLIANT_ERROR_ARGUMENT, "segmentation: expected a volume of 1 to %d voxels", INT32_MAX);
    if (options->classes < 0 || options->classes > PLIANT_MAX_CLASSES || options->max_classes < 1 ||
        options->max_classes > PLIANT_MAX_CLASSES)
        return pliant_fail(PLIANT_ERROR_ARGUMENT,
                           "segmentation: 1 to %d classes are possible, not %d (0: chosen, at most %d)",
                           PLIANT_MAX_CLASSES, options->classes, options->max_classes);
    if (!(options->coherence >= 0) || !isfinite(options->coherence) || !(options->min_volume >= 0) ||
        options->num_threads < 0)
        return pliant_fail(PLIANT_ERROR_ARGUMENT,
                           "segmentation: coherence and smallest piece must not be negative, nor threads");
    return PLIANT_OK;
}

/* Set the bins between the outermost thousandths of the values, so that extreme values do not widen them. Stored
 * integers span at least a bin each: narrower bins would be empty between the values. In a volume with few integers,
 * such as a mask, each integer is a spike. */
void segment_set_bins(const pliant_volume *scan, double lowest, double top, const uint32_t *count,
                      segment_histogram *histogram)
{
    const double scale = top > lowest ? (SEGMENT_FINE_BINS - 1) / (top - lowest) : 0,
                 outside = 1e-3 * (double)pliant_geometry_voxels(&scan->geometry);
    int32_t first = 0, last = SEGMENT_FINE_BINS - 1;
    for (double sum = 0; first < last && (sum += count[first]) <= outside; first++) {}
    for (double sum = 0; last > first && (sum += count[last]) <= outside; last--) {}
    double low = scale > 0 ? lowest + first / scale : lowest,
           high = scale > 0 ? lowest + (last + 1) / scale : lowest + 1;
    double step = scan->encoding == PLIANT_FLOAT32 ? 0 : fabs(scan->slope), width = (high - low) / SEGMENT_BINS;
    if (top - lowest < SEGMENT_FEW_STEPS * step) step = 0;
    histogram->width = step > 0 ? step * fmax(ceil(width / step - 1e-9), 1) : width;
    histogram->low = step > 0 ? low - 0.5 * step : low;
}

static pliant_status find_bins(const pliant_volume *scan, int num_threads, segment_histogram *histogram)
{
    ptrdiff_t voxels = (ptrdiff_t)pliant_geometry_voxels(&scan->geometry);
    double lowest = INFINITY, top = -INFINITY;
    bool finite = true;
#pragma omp parallel for num_threads(num_threads) reduction(min : lowest) reduction(max : top) reduction(&& : finite)
    for (ptrdiff_t v = 0; v < voxels; v++) {
        double value = pliant_volume_value(scan, (size_t)v);
        finite = finite && isfinite(value);
        lowest = fmin(lowest, value);
        top = fmax(top, value);
    }
    if (!finite)
        return pliant_fail(PLIANT_ERROR_ARGUMENT, "segmentation: %s holds values that are not finite", scan->id);
    uint32_t *count = pliant_calloc(SEGMENT_FINE_BINS, sizeof *count);
    if (!count) return pliant_fail_memory("the histogram");
    double scale = top > lowest ? (SEGMENT_FINE_BINS - 1) / (top - lowest) : 0;
    for (ptrdiff_t v = 0; v < voxels; v++) count[(int32_t)((pliant_volume_value(scan, (size_t)v) - lowest) * scale)]++;
    segment_set_bins(scan, lowest, top, count, histogram);
    pliant_free(count);
    return PLIANT_OK;
}

static uint16_t bin_of(const segment_histogram *histogram, double value)
{
    return (uint16_t)fmin(fmax((value - histogram->low) / histogram->width, 0), SEGMENT_BINS - 1);
}

/* Set the standard deviation of the noise. Most differences between neighbours along i are noise alone. For Gaussian
 * noise, the median of their magnitudes is 0.6745 sqrt 2 deviations. */
void segment_set_noise(const int64_t count[SEGMENT_BINS], segment_histogram *histogram)
{
    int64_t total = 0, sum = 0;
    int median = 0;
    for (int bin = 0; bin < SEGMENT_BINS; bin++) total += count[bin];
    for (; median + 1 < SEGMENT_BINS && 2 * (sum += count[median]) < total; median++) {}
    histogram->noise = fmax(median, 0.5) * histogram->width / (0.6745 * 1.41421356);
}

int segment_max_noise_step(const segment_histogram *histogram)
{
    return (int)ceil(2.5 * histogram->noise / histogram->width);
}

static void find_noise(segment_histogram *histogram, const uint16_t *bins, ptrdiff_t voxels)
{
    int64_t count[SEGMENT_BINS] = {0};
    /* Values beyond the bins, such as padding and most air, contain no information on noise. */
    for (ptrdiff_t v = 1; v < voxels; v++)
        if (bins[v] != 0 && bins[v - 1] != 0) count[abs(bins[v] - bins[v - 1])]++;
    segment_set_noise(count, histogram);
}

/* Apply the sigma filter (Lee 1983): the mean of the surrounding 27 voxels whose difference is within the noise. It
 * sharpens the peaks of the histogram and preserves edges. A voxel that differs from most neighbours is on an edge
 * between tissues, or in a texture such as bone. It gets a lower weight. */
static const double edge_part = 0.25;
static void smooth(const pliant_volume *scan, int num_threads, segment_histogram *histogram, const uint16_t *raw,
                   uint16_t *bins, uint8_t *counted)
{
    const int32_t *size = scan->geometry.size;
    const int reach = segment_max_noise_step(histogram);
#pragma omp parallel for num_threads(num_threads) schedule(static)
    for (int32_t k = 0; k < size[2]; k++)
        for (int32_t j = 0; j < size[1]; j++)
            for (int32_t i = 0; i < size[0]; i++) {
                ptrdiff_t v = i + (ptrdiff_t)size[0] * (j + (ptrdiff_t)size[1] * k);
                int own = raw[v], sum = 0, alike = 0;
                int32_t low[3] = {i > 0 ? -1 : 0, j > 0 ? -1 : 0, k > 0 ? -1 : 0};
                int32_t high[3] = {i + 1 < size[0], j + 1 < size[1], k + 1 < size[2]};
                for (int32_t c = low[2]; c <= high[2]; c++)
                    for (int32_t b = low[1]; b <= high[1]; b++)
                        for (int32_t a = low[0]; a <= high[0]; a++) {
                            int other = raw[v + a + (ptrdiff_t)size[0] * (b + (ptrdiff_t)size[1] * c)];
                            int near = abs(other - own) <= reach;
                            sum += near ? other : 0;
                            alike += near;
                        }
                bins[v] = (uint16_t)((2 * sum + alike) / (2 * alike));
                counted[v] = alike >= SEGMENT_MIN_ALIKE_NEIGHBOURS;
            }
    memset(histogram->count, 0, sizeof histogram->count);
    histogram->total = 0;
    ptrdiff_t voxels = (ptrdiff_t)pliant_geometry_voxels(&scan->geometry);
    for (ptrdiff_t v = 0; v < voxels; v++) {
        double part = counted[v] ? 1 : edge_part;
        histogram->count[bins[v]] += part;
        histogram->total += part;
    }
}

static pliant_status count_values(const pliant_volume *scan, int num_threads, segment_histogram *histogram,
                                  uint16_t *bins)
{
    pliant_status status = find_bins(scan, num_threads, histogram);
    if (status != PLIANT_OK) return status;
    ptrdiff_t voxels = (ptrdiff_t)pliant_geometry_voxels(&scan->geometry);
    uint16_t *raw = pliant_calloc((size_t)voxels, sizeof *raw);
    uint8_t *counted = pliant_calloc((size_t)voxels, 1);
    if (raw && counted) {
#pragma omp parallel for num_threads(num_threads)
        for (ptrdiff_t v = 0; v < voxels; v++) raw[v] = bin_of(histogram, pliant_volume_value(scan, (size_t)v));
        find_noise(histogram, raw, voxels);
        smooth(scan, num_threads, histogram, raw, bins, counted);
    } else {
        status = pliant_fail_memory("the segmentation");
    }
    pliant_free(raw);
    pliant_free(counted);
    return status;
}

static void assign_most_likely_class(const uint16_t *bins, ptrdiff_t voxels, const float *logs, int count,
                                     int num_threads, uint8_t *classes)
{
    uint8_t of_bin[SEGMENT_BINS];
    for (int bin = 0; bin < SEGMENT_BINS; bin++) {
        int best = 0;
        for (int k = 1; k < count; k++)
            if (logs[bin * PLIANT_MAX_CLASSES + k] > logs[bin * PLIANT_MAX_CLASSES + best]) best = k;
        of_bin[bin] = (uint8_t)best;
    }
#pragma omp parallel for num_threads(num_threads)
    for (ptrdiff_t v = 0; v < voxels; v++) classes[v] = of_bin[bins[v]];
}

typedef struct field {
    const int32_t *size;
    const uint16_t *bins;
    const float *logs;
    int count;
    float coherence;
    uint8_t *classes;
} field;

/* Choose the best class of a voxel given its six neighbours. Return whether it has changed. */
static bool choose_best_class(const field *f, int32_t i, int32_t j, int32_t k)
{
    const int32_t row = f->size[0], slice = f->size[0] * f->size[1];
    const size_t v = (size_t)i + (size_t)row * (size_t)j + (size_t)slice * (size_t)k;
    uint8_t *c = f->classes + v, around[6];
    int num = 0;
    if (i > 0) around[num++] = c[-1];
    if (i + 1 < f->size[0]) around[num++] = c[1];
    if (j > 0) around[num++] = c[-row];
    if (j + 1 < f->size[1]) around[num++] = c[row];
    if (k > 0) around[num++] = c[-slice];
    if (k + 1 < f->size[2]) around[num++] = c[slice];
    bool alike = true;
    for (int n = 0; n < num; n++) alike = alike && around[n] == *c;
    const float *logs = f->logs + f->bins[v] * PLIANT_MAX_CLASSES;
    float score[PLIANT_MAX_CLASSES] = {0};
    if (alike) { /* no other class gains from the neighbours: only a class that is better by all six can win */
        float own = logs[*c] + (float)num * f->coherence;
        int best = *c;
        for (int n = 0; n < f->count; n++)
            if (logs[n] > own) own = logs[best = n];
        if (best == *c) return false;
        *c = (uint8_t)best;
        return true;
    }
    for (int n = 0; n < f->count; n++) score[n] = logs[n];
    for (int n = 0; n < num; n++) score[around[n]] += f->coherence;
    int best = *c;
    for (int n = 0; n < f->count; n++)
        if (score[n] > score[best]) best = n;
    if (best == *c) return false;
    *c = (uint8_t)best;
    return true;
}

/* Run iterated conditional modes (Besag 1986) of a Potts field, on one colour of a chessboard after the other. Voxels
 * of one colour are independent, so their order has no effect. */
static void run_conditional_modes(const field *f, int num_threads)
{
    for (int sweep = 0; sweep < SEGMENT_SWEEPS; sweep++) {
        int64_t changed = 0;
        for (int colour = 0; colour < 2; colour++) {
#pragma omp parallel for num_threads(num_threads) reduction(+ : changed) schedule(static)
            for (int32_t k = 0; k < f->size[2]; k++)
                for (int32_t j = 0; j < f->size[1]; j++)
                    for (int32_t i = (j + k + colour) & 1; i < f->size[0]; i += 2)
                        changed += choose_best_class(f, i, j, k);
        }
        if (changed == 0) break;
    }
}

static int by_size(const void *a, const void *b)
{
    const segment_tally *x = a, *y = b;
    if (x->voxels != y->voxels) return x->voxels < y->voxels ? 1 : -1;
    return (x->piece > y->piece) - (x->piece < y->piece);
}

pliant_status segment_name(const pliant_geometry *geometry, segment_tally *tallies, int32_t count, uint16_t *label,
                           pliant_segmentation *out)
{
    if (count > UINT16_MAX)
        return pliant_fail(PLIANT_ERROR_FORMAT,
                           "segmentation: %d pieces are more than %d labels can name; take a larger smallest piece",
                           count, UINT16_MAX);
    pliant_status status = (out->pieces = pliant_calloc((size_t)count, sizeof *out->pieces))
                               ? pliant_labels_create(geometry, &out->labels)
                               : pliant_fail_memory("the pieces");
    if (status != PLIANT_OK) return status;
    qsort(tallies, (size_t)count, sizeof *tallies, by_size);
    double voxel = geometry->spacing[0] * geometry->spacing[1] * geometry->spacing[2];
    for (int32_t p = 0; p < count; p++) {
        const segment_tally *one = tallies + p;
        pliant_segment_piece *entry = out->pieces + p;
        double index[3] = {one->at[0] / one->voxels, one->at[1] / one->voxels, one->at[2] / one->voxels};
        *entry = (pliant_segment_piece){
            .class_index = one->class_index, .mean = one->sum / one->voxels, .volume = one->voxels * voxel};
        pliant_geometry_to_world(geometry, index, entry->centre);
        label[one->piece] = (uint16_t)(p + 1);
    }
    out->num_pieces = count;
    return PLIANT_OK;
}

/* Label the pieces by size, and compute their means and the label of every voxel. */
static pliant_status write_pieces(const pliant_volume *scan, const uint8_t *classes, const int32_t *piece,
                                  int32_t count, pliant_segmentation *out)
{
    const pliant_geometry *geometry = &scan->geometry;
    segment_tally *tallies = pliant_calloc((size_t)count, sizeof *tallies);
    uint16_t *label = pliant_calloc((size_t)count, sizeof *label);
    pliant_status status = tallies && label ? PLIANT_OK : pliant_fail_memory("the pieces");
    if (status != PLIANT_OK) goto done;
    size_t v = 0;
    for (int32_t k = 0; k < geometry->size[2]; k++)
        for (int32_t j = 0; j < geometry->size[1]; j++)
            for (int32_t i = 0; i < geometry->size[0]; i++, v++) {
                segment_tally *one = tallies + piece[v];
                one->piece = piece[v];
                one->voxels++;
                one->class_index = classes[v];
                one->sum += pliant_volume_value(scan, v);
                one->at[0] += i;
                one->at[1] += j;
                one->at[2] += k;
            }
    status = segment_name(geometry, tallies, count, label, out);
    for (v = 0; status == PLIANT_OK && v < pliant_geometry_voxels(geometry); v++)
        out->labels.voxels[v] = label[piece[v]];
done:
    pliant_free(tallies);
    pliant_free(label);
    return status;
}

static pliant_status segment_on_cpu(const pliant_volume *scan, const pliant_segment_options *options,
                                    pliant_segmentation *out)
{
    const int32_t *size = scan->geometry.size;
    size_t voxels = pliant_geometry_voxels(&scan->geometry);
    pliant_segmentation made = {0};
    int32_t count = 0, *piece = NULL;
    segment_histogram *histogram = pliant_calloc(1, sizeof *histogram);
    segment_fits *fits = pliant_calloc(1, sizeof *fits);
    float *logs = pliant_calloc(SEGMENT_BINS, PLIANT_MAX_CLASSES * sizeof *logs);
    uint16_t *bins = pliant_calloc(voxels, sizeof *bins);
    uint8_t *classes = pliant_calloc(voxels, 1);
    pliant_status status = histogram && fits && logs && bins && classes
                               ? count_values(scan, options->num_threads, histogram, bins)
                               : pliant_fail_memory("the segmentation");
    if (status != PLIANT_OK) goto done;
    segment_fit(histogram, segment_max_classes(options), fits);
    made.num_classes = segment_choose_mixture(histogram, options, fits, made.classes, &made.criterion);
    segment_log_densities(histogram, made.classes, made.num_classes, logs);
    assign_most_likely_class(bins, (ptrdiff_t)voxels, logs, made.num_classes, options->num_threads, classes);
    field f = {size, bins, logs, made.num_classes, (float)options->coherence, classes};
    run_conditional_modes(&f, options->num_threads);
    pliant_free(bins);
    bins = NULL;
    piece = pliant_calloc(voxels, sizeof *piece);
    status = piece ? segment_connect(size, classes, piece, &count) : pliant_fail_memory("the pieces");
    double lowest =
        options->min_volume / (scan->geometry.spacing[0] * scan->geometry.spacing[1] * scan->geometry.spacing[2]);
    if (status == PLIANT_OK) status = segment_absorb(size, piece, count, lowest, classes);
    if (status == PLIANT_OK) status = segment_connect(size, classes, piece, &count);
    if (status == PLIANT_OK) status = write_pieces(scan, classes, piece, count, &made);
done:
    PLIANT_FREE(histogram, fits, logs, bins, classes, piece);
    if (status == PLIANT_OK) *out = made;
    else pliant_segmentation_free(&made);
    return status;
}

pliant_status pliant_segment(const pliant_volume *scan, const pliant_segment_options *wanted, pliant_segmentation *out)
{
    const pliant_segment_device *device = PLIANT_ON_GPU(pliant_cuda_segment_device);
    char text[PLIANT_BACKEND_TEXT];
    bool use;
    pliant_segment_options with_threads = *wanted;
    const pliant_segment_options *options = &with_threads;
    with_threads.num_threads = pliant_threads_or_cores(wanted->num_threads);
    pliant_status status = check(scan, wanted);
    if (status == PLIANT_OK) status = pliant_gpu_choose(options->backend, device ? device->probe : NULL, text, &use);
    if (status != PLIANT_OK) return status;
    if (!use) return segment_on_cpu(scan, options, out);
    pliant_segmentation made = {0};
    status = device->segment(scan, options, &made);
    if (status == PLIANT_OK) {
        *out = made;
        return PLIANT_OK;
    }
    pliant_segmentation_free(&made);
    if (options->backend == PLIANT_CUDA || (status != PLIANT_ERROR_UNAVAILABLE && status != PLIANT_ERROR_MEMORY))
        return status;
    pliant_log(PLIANT_LOG_WARNING, "GPU segmentation failed (%s); using the CPU", pliant_last_error());
    return segment_on_cpu(scan, options, out);
}

void pliant_segmentation_free(pliant_segmentation *segmentation)
{
    if (!segmentation) return;
    pliant_labels_free(&segmentation->labels);
    pliant_free(segmentation->pieces);
    memset(segmentation, 0, sizeof *segmentation);
}
