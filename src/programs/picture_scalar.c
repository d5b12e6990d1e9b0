#include "picture_scalar.h"

#include "base/fail.h"
#include "picture.h"
#include "picture_section.h"
#include "base/memory.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

enum { GAP = 8, BAR = 16 };

static int compare(const void *a, const void *b)
{
    float x = *(const float *)a, y = *(const float *)b;
    return (x > y) - (x < y);
}

static pliant_status find_range(const picture_scalars *scalars, double *low, double *high)
{
    size_t count = (size_t)scalars->mesh->num_tets;
    float *sorted = pliant_calloc(count, sizeof *sorted);
    if (!sorted) return pliant_fail_memory("the range of a scalar");
    memcpy(sorted, scalars->of_tet, count * sizeof *sorted);
    qsort(sorted, count, sizeof *sorted, compare);
    *low = count ? (double)sorted[count / 100] : 0.0;
    *high = count ? (double)sorted[count - 1 - count / 100] : 0.0;
    pliant_free(sorted);
    return PLIANT_OK;
}

/* @param part in [0, 1] */
static void colour_of(double part, uint8_t rgb[3])
{
    for (int c = 0; c < 3; ++c) {
        double centre = 0.75 - 0.25 * c; /* position of the maximum of red, green, blue */
        rgb[c] = (uint8_t)(255.0 * fmin(fmax(1.5 - 4.0 * fabs(part - centre), 0.0), 1.0) + 0.5);
    }
}

static pliant_status draw_plane(const char *path, const picture_plane *plane, const picture_scalars *scalars,
                                const pliant_geometry *shown, const double point[3], double low, double high)
{
    picture_frame frame = picture_frame_of(plane, shown);
    int32_t stride = frame.width + GAP + BAR, *section;
    uint8_t *rgb = pliant_calloc((size_t)stride * (size_t)frame.height, 3);
    if (!rgb) return pliant_fail_memory("a picture");
    pliant_status status = picture_section(&frame, point, scalars->mesh, scalars->positions, &section);
    for (int32_t row = 0; status >= 0 && row < frame.height; ++row) {
        uint8_t *pixel = rgb + 3 * (size_t)row * (size_t)stride;
        for (int32_t column = 0; column < frame.width; ++column) {
            const int32_t tet = section[(size_t)row * (size_t)frame.width + (size_t)column];
            if (tet < 0) continue;
            double part = high > low ? ((double)scalars->of_tet[tet] - low) / (high - low) : 0.5;
            colour_of(fmin(fmax(part, 0.0), 1.0), pixel + 3 * column);
        }
        for (int32_t column = stride - BAR; column < stride; ++column)
            colour_of(1.0 - (row + 0.5) / frame.height, pixel + 3 * column);
    }
    if (status >= 0) {
        status = picture_png(path, rgb, stride, frame.height);
        pliant_free(section);
    }
    pliant_free(rgb);
    return status;
}

pliant_status picture_scalar(const char *folder, const char *name, const picture_scalars *scalars,
                             const pliant_geometry *shown, const double point[3])
{
    double low = 0.0, high = 0.0;
    pliant_status status = find_range(scalars, &low, &high);
    for (int n = 0; status >= 0 && n < PICTURE_PLANES; ++n) {
        char path[4096];
        snprintf(path, sizeof path, "%s/%s_%s.png", folder, name, picture_planes[n].name);
        status = draw_plane(path, &picture_planes[n], scalars, shown, point, low, high);
    }
    if (status >= 0) pliant_log(PLIANT_LOG_INFO, "%s in pictures: blue %.4g to red %.4g", name, low, high);
    return status;
}
