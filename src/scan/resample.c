/* Resamples a volume to other voxel counts in the same box. The old index of a new voxel depends on one axis at a time,
 * so neighbours and weights are tabulated per axis. */
#include "scan/volume.h"

#include "base/fail.h"
#include "base/memory.h"

#include <math.h>
#include <string.h>

/* Two old neighbours of a new voxel along one axis, and the weight of the second. */
typedef struct neighbours {
    size_t low, high; /* times the stride of the axis */
    float weight;
} neighbours;

/* Return the old continuous index of a new voxel's centre. The boxes have equal edges. */
static double old_index(int32_t new_index, int32_t new_size, int32_t old_size)
{
    return (new_index + 0.5) * ((double)old_size / new_size) - 0.5;
}

/* Tabulate the neighbours. The end values also apply in the half voxel outside of the old centres. */
static void tabulate(int32_t new_size, int32_t old_size, size_t stride, neighbours *out)
{
    for (int32_t n = 0; n < new_size; n++) {
        double x = fmin(fmax(old_index(n, new_size, old_size), 0.0), old_size - 1.0);
        int32_t low = (int32_t)x;
        out[n].low = (size_t)low * stride;
        out[n].high = (size_t)(low + 1 < old_size ? low + 1 : low) * stride;
        out[n].weight = (float)(x - low);
    }
}

/* Tabulate the nearest old voxel. Between two the lower one is chosen, so that the choice does not depend on
 * rounding. */
static void tabulate_nearest(int32_t new_size, int32_t old_size, size_t stride, size_t *out)
{
    for (int32_t n = 0; n < new_size; n++) {
        double x = fmin(fmax(ceil(old_index(n, new_size, old_size) - 0.5), 0.0), old_size - 1.0);
        out[n] = (size_t)x * stride;
    }
}

static float mix(float a, float b, float weight) { return a + weight * (b - a); }

static uint8_t to_uint8(float value) { return (uint8_t)(value + 0.5f); }
static int16_t to_int16(float value) { return (int16_t)floorf(value + 0.5f); }
static float to_float(float value) { return value; }

/* Define the computation of one row of new voxels. Interpolated values are between their neighbours, so they fit in the
 * type. */
#define DEFINE_ROW(name, type, convert)                                                                             \
    static void name(const type *old, const neighbours *x, neighbours y, neighbours z, int32_t count, type *out)    \
    {                                                                                                               \
        const type *a = old + y.low + z.low, *b = old + y.high + z.low;                                             \
        const type *c = old + y.low + z.high, *d = old + y.high + z.high;                                           \
        for (int32_t i = 0; i < count; i++) {                                                                       \
            size_t low = x[i].low, high = x[i].high;                                                                \
            float t = x[i].weight;                                                                                  \
            float front = mix(mix(a[low], a[high], t), mix(b[low], b[high], t), y.weight);                          \
            float back = mix(mix(c[low], c[high], t), mix(d[low], d[high], t), y.weight);                           \
            out[i] = convert(mix(front, back, z.weight));                                                           \
        }                                                                                                           \
    }
DEFINE_ROW(row_uint8, uint8_t, to_uint8)
DEFINE_ROW(row_int16, int16_t, to_int16)
DEFINE_ROW(row_float, float, to_float)

static pliant_status new_geometry(const pliant_geometry *old, const int32_t size[3], pliant_geometry *out)
{
    pliant_geometry geometry = *old;
    double first[3];
    for (int d = 0; d < 3; d++) {
        if (size[d] < 1)
            return pliant_fail(PLIANT_ERROR_ARGUMENT, "resample: %d x %d x %d voxels: each must be at least 1", size[0],
                               size[1], size[2]);
        geometry.size[d] = size[d];
        if (size[d] != old->size[d]) geometry.spacing[d] = old->size[d] * old->spacing[d] / size[d];
        first[d] = old_index(0, size[d], old->size[d]);
    }
    pliant_geometry_to_world(old, first, geometry.origin);
    *out = geometry;
    return PLIANT_OK;
}

static void resample_rows(const pliant_volume *old, const neighbours *axis[3], pliant_volume *out)
{
    const int32_t *size = out->geometry.size;
    int64_t num_rows = (int64_t)size[1] * size[2];
#pragma omp parallel for schedule(static)
    for (int64_t row = 0; row < num_rows; row++) {
        neighbours y = axis[1][row % size[1]], z = axis[2][row / size[1]];
        size_t first = (size_t)row * (size_t)size[0];
        switch (old->encoding) {
        case PLIANT_UINT8: row_uint8(old->voxels, axis[0], y, z, size[0], (uint8_t *)out->voxels + first); break;
        case PLIANT_INT16: row_int16(old->voxels, axis[0], y, z, size[0], (int16_t *)out->voxels + first); break;
        case PLIANT_FLOAT32: row_float(old->voxels, axis[0], y, z, size[0], (float *)out->voxels + first); break;
        }
    }
}

static size_t table_length(const int32_t size[3]) { return (size_t)size[0] + (size_t)size[1] + (size_t)size[2]; }

pliant_status pliant_volume_resample(const pliant_volume *volume, const int32_t size[3], pliant_volume *out)
{
    const pliant_geometry *old = &volume->geometry;
    pliant_geometry geometry;
    pliant_volume result = {0};
    neighbours *table = NULL;
    pliant_status status = new_geometry(old, size, &geometry);
    if (status != PLIANT_OK) return status;

    status = pliant_volume_create(&geometry, volume->encoding, &result);
    if (status != PLIANT_OK) goto done;
    table = pliant_calloc(table_length(size), sizeof *table);
    if (!table) {
        status = pliant_fail_memory("resampling a volume");
        goto done;
    }
    const neighbours *axis[3] = {table, table + size[0], table + size[0] + size[1]};
    size_t stride = 1;
    for (int d = 0; d < 3; d++) {
        tabulate(size[d], old->size[d], stride, (neighbours *)axis[d]);
        stride *= (size_t)old->size[d];
    }
    resample_rows(volume, axis, &result);

    result.slope = volume->slope;
    result.intercept = volume->intercept;
    result.background = volume->background;
    result.modality = volume->modality;
    memcpy(result.id, volume->id, sizeof result.id);
    *out = result;
    memset(&result, 0, sizeof result);
done:
    pliant_free(table);
    pliant_volume_free(&result);
    return status;
}

pliant_status pliant_labels_resample(const pliant_labels *labels, const int32_t size[3], pliant_labels *out)
{
    const pliant_geometry *old = &labels->geometry;
    pliant_geometry geometry;
    pliant_labels result = {0};
    size_t *table = NULL;
    pliant_status status = new_geometry(old, size, &geometry);
    if (status != PLIANT_OK) return status;

    status = pliant_labels_create(&geometry, &result);
    if (status != PLIANT_OK) goto done;
    table = pliant_calloc(table_length(size), sizeof *table);
    if (!table) {
        status = pliant_fail_memory("resampling a label map");
        goto done;
    }
    size_t *axis[3] = {table, table + size[0], table + size[0] + size[1]}, stride = 1;
    for (int d = 0; d < 3; d++) {
        tabulate_nearest(size[d], old->size[d], stride, axis[d]);
        stride *= (size_t)old->size[d];
    }
    int64_t num_rows = (int64_t)size[1] * size[2];
#pragma omp parallel for schedule(static)
    for (int64_t row = 0; row < num_rows; row++) {
        const uint16_t *from = labels->voxels + axis[1][row % size[1]] + axis[2][row / size[1]];
        uint16_t *to = result.voxels + (size_t)row * (size_t)size[0];
        for (int32_t i = 0; i < size[0]; i++) to[i] = from[axis[0][i]];
    }
    if (labels->num_segments > 0) {
        const size_t bytes = labels->num_segments * sizeof *result.segments;
        result.segments = pliant_calloc(labels->num_segments, sizeof *result.segments);
        if (!result.segments) {
            status = pliant_fail_memory("the segments of a label map");
            goto done;
        }
        memcpy(result.segments, labels->segments, bytes);
        result.num_segments = labels->num_segments;
    }
    *out = result;
    memset(&result, 0, sizeof result);
done:
    pliant_free(table);
    pliant_labels_free(&result);
    return status;
}
