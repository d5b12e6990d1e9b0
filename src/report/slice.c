/* Extract slices in radiological orientation, and write them as files for Python. */
#include "base/fail.h"
#include "base/memory.h"
#include "report/report.h"
#include "report/rows.h"

#include <errno.h>
#include <math.h>
#include <stdio.h>
#include <string.h>

/* Find the voxel axis nearest to each anatomical axis, each used once. */
static void nearest_axes(const pliant_geometry *geometry, int axis_of[3])
{
    bool used[3] = {false, false, false}, done[3] = {false, false, false};
    for (int round = 0; round < 3; round++) {
        int world = 0, voxel = 0;
        double maximum = -1;
        for (int w = 0; w < 3; w++)
            for (int v = 0; v < 3; v++)
                if (!done[w] && !used[v] && fabs(geometry->direction[3 * w + v]) > maximum) {
                    maximum = fabs(geometry->direction[3 * w + v]);
                    world = w;
                    voxel = v;
                }
        axis_of[world] = voxel;
        done[world] = used[voxel] = true;
    }
}

pliant_status pliant_volume_plane(const pliant_volume *volume, int axis, const double world[3], int32_t size[2],
                                  double spacing[2], float **out)
{
    const pliant_geometry *geometry = &volume->geometry;
    if (axis < 0 || axis > 2)
        return pliant_fail(PLIANT_ERROR_ARGUMENT, "a slice is sagittal (0), coronal (1) or axial (2), not %d", axis);
    int axis_of[3], across_world = axis == 0 ? 1 : 0, down_world = axis == 2 ? 1 : 2;
    nearest_axes(geometry, axis_of);
    int across = axis_of[across_world], down = axis_of[down_world], fixed = axis_of[axis];
    double index[3];
    pliant_geometry_to_index(geometry, world, index);
    double at = floor(index[fixed] + 0.5);
    if (!(at >= 0 && at < geometry->size[fixed]))
        return pliant_fail(PLIANT_ERROR_ARGUMENT, "the slice lies outside the volume");
    int32_t columns = geometry->size[across], rows = geometry->size[down];
    float *values = pliant_calloc((size_t)columns * (size_t)rows, sizeof *values);
    if (!values) return pliant_fail_memory("a slice");
    /* columns to the patient's left or posterior; rows to posterior in axial slices, to inferior in others */
    bool mirror = geometry->direction[3 * across_world + across] < 0;
    bool turn = (geometry->direction[3 * down_world + down] < 0) == (axis == 2);
    size_t stride[3] = {1, (size_t)geometry->size[0], (size_t)geometry->size[0] * (size_t)geometry->size[1]};
    for (int32_t r = 0; r < rows; r++)
        for (int32_t c = 0; c < columns; c++) {
            size_t row = (size_t)(turn ? rows - 1 - r : r), column = (size_t)(mirror ? columns - 1 - c : c);
            values[(size_t)r * (size_t)columns + (size_t)c] =
                pliant_volume_value(volume, (size_t)at * stride[fixed] + row * stride[down] + column * stride[across]);
        }
    size[0] = columns;
    size[1] = rows;
    spacing[0] = geometry->spacing[across];
    spacing[1] = geometry->spacing[down];
    *out = values;
    return PLIANT_OK;
}

pliant_status report_write_npy(const char *path, const int32_t size[2], const float *values)
{
    char text[119];
    snprintf(text, sizeof text, "{'descr': '<f4', 'fortran_order': False, 'shape': (%d, %d), }", (int)size[1],
             (int)size[0]);
    FILE *file = fopen(path, "wb");
    if (!file) return pliant_fail(PLIANT_ERROR_FILE, "%s: %s", path, strerror(errno));
    /* magic number, version 1.0, header length, header padded with blanks to a total of 128 bytes */
    static const unsigned char magic[10] = {0x93, 'N', 'U', 'M', 'P', 'Y', 1, 0, 118, 0};
    fwrite(magic, 1, sizeof magic, file);
    fprintf(file, "%-117s\n", text);
    fwrite(values, sizeof *values, (size_t)size[0] * (size_t)size[1], file);
    bool failed = ferror(file);
    failed |= fclose(file) != 0;
    return failed ? pliant_fail(PLIANT_ERROR_FILE, "%s could not be written completely: %s", path, strerror(errno))
                  : PLIANT_OK;
}
