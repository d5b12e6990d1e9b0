/* Distances between two solutions, and their statistics. */
#include "base/fail.h"
#include "base/memory.h"
#include "report/report.h"

#include <math.h>
#include <stdlib.h>

static int compare(const void *a, const void *b)
{
    double x = *(const double *)a, y = *(const double *)b;
    return (x > y) - (x < y);
}

/* Compute the maximum, root mean square and 95th percentile of values, which are sorted. */
static void summarize(int32_t count, double *values, pliant_error *out)
{
    double squares = 0;
    out->count = count;
    for (int32_t i = 0; i < count; i++) squares += values[i] * values[i];
    qsort(values, (size_t)count, sizeof *values, compare);
    out->max = count > 0 ? values[count - 1] : 0;
    out->rms = count > 0 ? sqrt(squares / count) : 0;
    out->p95 = count > 0 ? values[(int32_t)ceil(0.95 * count) - 1] : 0;
}

pliant_status pliant_error_between(int32_t count, const uint8_t *use, const double *rest, const double *reference,
                                   const double *other, pliant_error *out)
{
    double *distance = pliant_calloc((size_t)count, sizeof *distance);
    if (!distance) return pliant_fail_memory("the errors of the points");
    pliant_error error = {.worst = -1};
    double maximum = -1;
    int32_t number = 0;
    for (int32_t p = 0; p < count; p++) {
        if (use && !use[p]) continue;
        double moved = 0, squared_distance = 0;
        for (int32_t i = 3 * p; i < 3 * p + 3; i++) {
            moved += (reference[i] - rest[i]) * (reference[i] - rest[i]);
            squared_distance += (reference[i] - other[i]) * (reference[i] - other[i]);
        }
        if (!isfinite(moved) || !isfinite(squared_distance)) {
            pliant_free(distance);
            return pliant_fail(PLIANT_ERROR_NUMERIC, "point %d has a position that is not finite", p);
        }
        error.largest = fmax(error.largest, sqrt(moved));
        distance[number++] = sqrt(squared_distance);
        if (squared_distance > maximum) {
            maximum = squared_distance;
            error.worst = p;
        }
    }
    summarize(number, distance, &error);
    pliant_free(distance);
    *out = error;
    return PLIANT_OK;
}

pliant_status pliant_error_histogram(const pliant_volume *error, int32_t bins, double width, uint64_t *counts,
                                     pliant_error *summary)
{
    if (error->encoding != PLIANT_FLOAT32 || bins < 1 || !(width > 0))
        return pliant_fail(PLIANT_ERROR_ARGUMENT, "a histogram needs a volume of errors, bins and their width");
    const float *voxels = error->voxels;
    size_t size = pliant_geometry_voxels(&error->geometry), tissue = 0;
    for (size_t v = 0; v < size; v++) tissue += voxels[v] >= 0;
    double *values = NULL;
    if (summary && tissue > 0) {
        values = pliant_calloc(tissue, sizeof *values);
        if (!values) return pliant_fail_memory("the errors of the voxels");
    }
    for (int32_t b = 0; b < bins; b++) counts[b] = 0;
    size_t next = 0;
    for (size_t v = 0; v < size; v++) {
        if (!(voxels[v] >= 0)) continue;
        double bin = floor(voxels[v] / width);
        counts[bin < bins - 1 ? (int32_t)bin : bins - 1]++;
        if (values) values[next++] = voxels[v];
    }
    if (summary) {
        *summary = (pliant_error){.worst = -1};
        summarize((int32_t)tissue, values, summary);
    }
    pliant_free(values);
    return PLIANT_OK;
}
