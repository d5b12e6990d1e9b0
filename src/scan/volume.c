#include "scan/volume.h"

#include "base/fail.h"
#include "base/free_memory.h"
#include "base/buffer.h"
#include "base/memory.h"
#include "scan/stored_value.h"

#include <float.h>
#include <math.h>
#include <stdio.h>
#include <string.h>

size_t pliant_geometry_voxels(const pliant_geometry *geometry)
{
    size_t count = 1;
    for (int d = 0; d < 3; d++) {
        if (geometry->size[d] < 1 || count > SIZE_MAX / (size_t)geometry->size[d]) return 0;
        count *= (size_t)geometry->size[d];
    }
    return count;
}

bool pliant_geometry_equal(const pliant_geometry *a, const pliant_geometry *b)
{
    const double tolerance = 1e-4;
    for (int d = 0; d < 3; d++) {
        if (a->size[d] != b->size[d]) return false;
        if (!(fabs(a->spacing[d] - b->spacing[d]) <= tolerance * a->spacing[d])) return false;
    }
    for (int d = 0; d < 9; d++)
        if (!(fabs(a->direction[d] - b->direction[d]) <= tolerance)) return false;

    /* Files store the origin in single precision; far from zero the error can exceed 1e-4 of a voxel. */
    double smallest = fmin(a->spacing[0], fmin(a->spacing[1], a->spacing[2]));
    for (int d = 0; d < 3; d++) {
        double rounding = FLT_EPSILON * fmax(fabs(a->origin[d]), fabs(b->origin[d]));
        if (!(fabs(a->origin[d] - b->origin[d]) <= tolerance * smallest + rounding)) return false;
    }
    return true;
}

void pliant_geometry_to_world(const pliant_geometry *geometry, const double index[3], double world[3])
{
    double scaled[3], point[3];
    for (int d = 0; d < 3; d++) scaled[d] = geometry->spacing[d] * index[d];
    for (int row = 0; row < 3; row++) {
        const double *axis = geometry->direction + 3 * row;
        point[row] = geometry->origin[row] + axis[0] * scaled[0] + axis[1] * scaled[1] + axis[2] * scaled[2];
    }
    memcpy(world, point, sizeof point);
}

void pliant_geometry_to_index(const pliant_geometry *geometry, const double world[3], double index[3])
{
    double offset[3], result[3];
    for (int d = 0; d < 3; d++) offset[d] = world[d] - geometry->origin[d];
    /* The direction is orthonormal, so its inverse is its transpose. */
    for (int column = 0; column < 3; column++) {
        const double *axis = geometry->direction + column;
        result[column] = (axis[0] * offset[0] + axis[3] * offset[1] + axis[6] * offset[2]) / geometry->spacing[column];
    }
    memcpy(index, result, sizeof result);
}

size_t pliant_encoding_size(pliant_encoding encoding)
{
    switch (encoding) {
    case PLIANT_UINT8: return sizeof(uint8_t);
    case PLIANT_INT16: return sizeof(int16_t);
    case PLIANT_FLOAT32: return sizeof(float);
    }
    return 0;
}

static pliant_status check_geometry(const pliant_geometry *geometry)
{
    static const char axis_name[3] = {'i', 'j', 'k'};
    for (int d = 0; d < 3; d++) {
        if (geometry->size[d] < 1)
            return pliant_fail(PLIANT_ERROR_ARGUMENT, "volume: size along %c is %d, it must be at least 1",
                               axis_name[d], geometry->size[d]);
        if (!(geometry->spacing[d] > 0.0) || !isfinite(geometry->spacing[d]))
            return pliant_fail(PLIANT_ERROR_ARGUMENT, "volume: spacing along %c is %g m, it must be above 0",
                               axis_name[d], geometry->spacing[d]);
        if (!isfinite(geometry->origin[d]))
            return pliant_fail(PLIANT_ERROR_ARGUMENT, "volume: coordinate %d of the origin is not finite", d);
    }
    for (int a = 0; a < 3; a++)
        for (int b = a; b < 3; b++) {
            double dot = 0.0;
            for (int row = 0; row < 3; row++)
                dot += geometry->direction[3 * row + a] * geometry->direction[3 * row + b];
            if (!(fabs(dot - (a == b)) <= 1e-6))
                return pliant_fail(PLIANT_ERROR_ARGUMENT,
                                   "volume: the direction is not orthonormal (axes %c and %c: dot product %g)",
                                   axis_name[a], axis_name[b], dot);
        }
    if (pliant_geometry_voxels(geometry) == 0)
        return pliant_fail(PLIANT_ERROR_ARGUMENT, "volume: %d x %d x %d voxels are more than can be counted",
                           geometry->size[0], geometry->size[1], geometry->size[2]);
    return PLIANT_OK;
}

pliant_status pliant_volume_create(const pliant_geometry *geometry, pliant_encoding encoding, pliant_volume *out)
{
    pliant_status status = check_geometry(geometry);
    if (status != PLIANT_OK) return status;
    if (pliant_encoding_size(encoding) == 0)
        return pliant_fail(PLIANT_ERROR_ARGUMENT, "volume: %d is not an encoding", (int)encoding);

    size_t count = pliant_geometry_voxels(geometry), size = pliant_encoding_size(encoding);
    char what[80];
    snprintf(what, sizeof what, "a volume of %d x %d x %d voxels", geometry->size[0], geometry->size[1],
             geometry->size[2]);
    if ((status = pliant_memory_check((double)count * (double)size, what)) != PLIANT_OK) return status;
    void *voxels = pliant_calloc_pages(count, size);
    if (!voxels) return pliant_fail_memory("the voxels of a volume");
    pliant_volume volume = {.geometry = *geometry, .encoding = encoding, .slope = 1.0f, .voxels = voxels};
    *out = volume;
    return PLIANT_OK;
}

void pliant_volume_free(pliant_volume *volume)
{
    if (!volume) return;
    pliant_free(volume->voxels);
    memset(volume, 0, sizeof *volume);
}

pliant_status pliant_labels_create(const pliant_geometry *geometry, pliant_labels *out)
{
    pliant_status status = check_geometry(geometry);
    if (status != PLIANT_OK) return status;

    size_t count = pliant_geometry_voxels(geometry);
    char what[80];
    snprintf(what, sizeof what, "a label map of %d x %d x %d voxels", geometry->size[0], geometry->size[1],
             geometry->size[2]);
    if ((status = pliant_memory_check((double)count * sizeof(uint16_t), what)) != PLIANT_OK) return status;
    uint16_t *voxels = pliant_calloc(count, sizeof *voxels);
    if (!voxels) return pliant_fail_memory("the voxels of a label map");
    pliant_labels labels = {.geometry = *geometry, .voxels = voxels};
    *out = labels;
    return PLIANT_OK;
}

void pliant_labels_free(pliant_labels *labels)
{
    if (!labels) return;
    pliant_free(labels->voxels);
    pliant_free(labels->segments);
    memset(labels, 0, sizeof *labels);
}

float pliant_volume_value(const pliant_volume *volume, size_t index)
{
    return pliant_stored_value(volume->voxels, volume->encoding, volume->slope, volume->intercept, index);
}
