/* March along a ray through the voxels of a volume, sample by sample, to the crossing of a threshold ([H] 3.2). The CPU
 * (tool/pick.c) and the GPU (cuda/warp/pick.cu) execute the same operations in the same order, so both find the same
 * crossings. */
#ifndef PLIANT_SCAN_MARCH_H
#define PLIANT_SCAN_MARCH_H

#include "scan/stored_value.h"

#include <math.h>

/* A ray in continuous voxel indices: index(t) = start + t * step, with t in metres along the ray. */
typedef struct march_ray {
    int32_t size[3];       /* size of the volume */
    double start[3], step[3];
    double enter, leave;   /* range of the ray inside the volume's box, and between near and far [m] */
    double stride;         /* half a voxel [m] */
    double threshold;
    int64_t maximum;          /* index of the last sample */
} march_ray;

/* Voxel array of a volume and the conversion of its values (pliant_volume). */
typedef struct march_voxels {
    const void *voxels;    /* in host or GPU memory */
    pliant_encoding encoding;
    float slope, intercept;
} march_voxels;

typedef struct march_crossing {
    int64_t sample; /* first sample at or above the threshold; -1: no crossing, and the other members are not set */
    double t;              /* position of the crossing [m] */
    float value;           /* value of the volume there */
} march_crossing;

PLIANT_INLINE float march_stored(const march_voxels *from, size_t index)
{
    return pliant_stored_value(from->voxels, from->encoding, from->slope, from->intercept, index);
}

/* Interpolate trilinearly. Outside of the centres of the outermost voxels the value is constant. */
PLIANT_INLINE double march_value(const march_voxels *from, const march_ray *ray, double t)
{
    int32_t low[3], high[3];
    double part[3];
    for (int d = 0; d < 3; d++) {
        double index = fmin(fmax(ray->start[d] + t * ray->step[d], 0.0), ray->size[d] - 1.0);
        low[d] = (int32_t)index;
        high[d] = low[d] + 1 < ray->size[d] ? low[d] + 1 : low[d];
        part[d] = index - low[d];
    }
    double value = 0;
    for (int corner = 0; corner < 8; corner++) {
        int a = corner & 1, b = corner >> 1 & 1, c = corner >> 2;
        double weight = (a ? part[0] : 1 - part[0]) * (b ? part[1] : 1 - part[1]) * (c ? part[2] : 1 - part[2]);
        size_t j = (size_t)(b ? high[1] : low[1]), k = (size_t)(c ? high[2] : low[2]);
        size_t index = (size_t)(a ? high[0] : low[0]) + (size_t)ray->size[0] * (j + (size_t)ray->size[1] * k);
        if (weight > 0) value += weight * march_stored(from, index);
    }
    return value;
}

PLIANT_INLINE double march_at(const march_ray *ray, int64_t sample)
{
    return fmin(ray->enter + (double)sample * ray->stride, ray->leave);
}

/* Return whether a sample exists. The last sample is the first one at the ray's end, and there is at least one. */
PLIANT_INLINE bool march_has(const march_ray *ray, int64_t sample)
{
    return sample == 0 || (sample <= ray->maximum && march_at(ray, sample - 1) < ray->leave);
}

/* Return whether the value is at or above the threshold. NaN is below every threshold. */
PLIANT_INLINE bool march_above(const march_voxels *from, const march_ray *ray, double t)
{
    return march_value(from, ray, t) >= ray->threshold;
}

/* Refine the crossing between a sample at or above the threshold and the sample before it. */
PLIANT_INLINE march_crossing march_refine(const march_voxels *from, const march_ray *ray, int64_t sample)
{
    double high = march_at(ray, sample), low = sample > 0 ? march_at(ray, sample - 1) : high,
           enough = 2e-4 * ray->stride;
    while (high - low > enough) {
        double middle = 0.5 * (low + high);
        if (!(middle > low && middle < high)) break;
        if (march_above(from, ray, middle)) high = middle;
        else low = middle;
    }
    march_crossing crossing;
    crossing.sample = sample;
    crossing.t = high;
    crossing.value = (float)march_value(from, ray, high);
    return crossing;
}

#endif
