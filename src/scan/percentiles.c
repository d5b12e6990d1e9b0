/* Percentiles of a volume's values. Large volumes are sampled. */
#include "base/fail.h"
#include "base/memory.h"
#include "scan/volume.h"

#include <math.h>
#include <stdlib.h>

enum { MAX_PERCENTILE_SAMPLES = 1 << 20 };

static int compare(const void *a, const void *b)
{
    float x = *(const float *)a, y = *(const float *)b;
    return (x > y) - (x < y);
}

pliant_status pliant_volume_percentiles(const pliant_volume *volume, int count, const double *percent, double *value)
{
    size_t voxels = pliant_geometry_voxels(&volume->geometry);
    size_t stride = (voxels / MAX_PERCENTILE_SAMPLES) | 1; /* odd, so that not every row has the same columns */
    float *sample = pliant_calloc(voxels / stride + 1, sizeof *sample);
    if (!sample) return pliant_fail_memory("the percentiles of a volume");
    size_t taken = 0;
    for (size_t v = 0; v < voxels; v += stride) {
        float one = pliant_volume_value(volume, v);
        if (isfinite(one)) sample[taken++] = one;
    }
    qsort(sample, taken, sizeof *sample, compare);
    for (int n = 0; n < count; n++)
        value[n] = taken ? (double)sample[(size_t)(0.01 * percent[n] * (double)(taken - 1) + 0.5)] : 0.0;
    pliant_free(sample);
    return PLIANT_OK;
}
