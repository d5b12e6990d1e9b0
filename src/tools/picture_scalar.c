#include "picture_scalar.h"

#include "pliant/fail.h"
#include "picture.h"
#include "pliant/memory.h"

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

/* @param part 0 .. 1 */
static void colour_of(double part, uint8_t rgb[3])
{
    for (int c = 0; c < 3; ++c) {
        double centre = 0.75 - 0.25 * c; /* where red, green, blue are strongest */
        rgb[c] = (uint8_t)(255.0 * fmin(fmax(1.5 - 4.0 * fabs(part - centre), 0.0), 1.0) + 0.5);
    }
}

/* Whether a point lies in a tetrahedron: on the inner side of its four faces. */
static bool holds(const double corner[4][3], const double at[3])
{
    double volume[5]; /* of the whole, and with the point in place of a corner */
    for (int n = 0; n < 5; ++n) {
        const double *c[4] = {corner[0], corner[1], corner[2], corner[3]};
        double e[3][3];
        if (n > 0) c[n - 1] = at;
        for (int a = 0; a < 3; ++a)
            for (int d = 0; d < 3; ++d) e[a][d] = c[a + 1][d] - c[0][d];
        volume[n] = e[0][0] * (e[1][1] * e[2][2] - e[1][2] * e[2][1]) - e[0][1] * (e[1][0] * e[2][2] - e[1][2] * e[2][0]) +
                    e[0][2] * (e[1][0] * e[2][1] - e[1][1] * e[2][0]);
    }
    for (int n = 1; n < 5; ++n)
        if (volume[n] * volume[0] < 0.0) return false;
    return volume[0] != 0.0;
}

/* Pixels from the first to behind the last that a tetrahedron may cover, along one axis of the panel. */
static void pixel_range(double low, double high, double origin, double pixel, int32_t size, int32_t *first, int32_t *last)
{
    *first = (int32_t)fmin(fmax(floor((low - origin) / pixel), 0.0), size);
    *last = (int32_t)fmin(fmax(ceil((high - origin) / pixel), 0.0), size);
}

static void draw_tet(const picture_frame *frame, const double point[3], const double corner[4][3], const uint8_t colour[3], int32_t stride, uint8_t *rgb)
{
    const picture_plane *plane = frame->plane;
    double low[3], high[3];
    int32_t left, right, top, bottom;
    for (int d = 0; d < 3; ++d) {
        low[d] = fmin(fmin(corner[0][d], corner[1][d]), fmin(corner[2][d], corner[3][d]));
        high[d] = fmax(fmax(corner[0][d], corner[1][d]), fmax(corner[2][d], corner[3][d]));
    }
    if (low[plane->normal] > point[plane->normal] || high[plane->normal] < point[plane->normal]) return;
    pixel_range(low[plane->right], high[plane->right], frame->low[plane->right], frame->pixel, frame->width, &left, &right);
    if (plane->upwards) pixel_range(-high[plane->down], -low[plane->down], -frame->high[plane->down], frame->pixel, frame->height, &top, &bottom);
    else pixel_range(low[plane->down], high[plane->down], frame->low[plane->down], frame->pixel, frame->height, &top, &bottom);
    for (int32_t row = top; row < bottom; ++row)
        for (int32_t column = left; column < right; ++column) {
            double world[3];
            picture_world(frame, point, column, row, world);
            if (holds(corner, world)) memcpy(rgb + 3 * ((size_t)row * (size_t)stride + (size_t)column), colour, 3);
        }
}

static pliant_status draw_plane(const char *path, const picture_plane *plane, const picture_scalars *scalars, const pliant_geometry *shown,
                                const double point[3], double low, double high)
{
    picture_frame frame = picture_frame_of(plane, shown);
    int32_t stride = frame.width + GAP + BAR;
    uint8_t colour[3], *rgb = pliant_calloc((size_t)stride * (size_t)frame.height, 3);
    if (!rgb) return pliant_fail_memory("a picture");
    for (int32_t tet = 0; tet < scalars->mesh->num_tets; ++tet) {
        double corner[4][3];
        for (int v = 0; v < 4; ++v) memcpy(corner[v], scalars->positions + 3 * scalars->mesh->tets[4 * tet + v], sizeof corner[v]);
        double part = high > low ? ((double)scalars->of_tet[tet] - low) / (high - low) : 0.5;
        colour_of(fmin(fmax(part, 0.0), 1.0), colour);
        draw_tet(&frame, point, corner, colour, stride, rgb);
    }
    for (int32_t row = 0; row < frame.height; ++row) {
        colour_of(1.0 - (row + 0.5) / frame.height, colour);
        for (int32_t column = stride - BAR; column < stride; ++column) memcpy(rgb + 3 * ((size_t)row * (size_t)stride + (size_t)column), colour, 3);
    }
    pliant_status status = picture_png(path, rgb, stride, frame.height);
    pliant_free(rgb);
    return status;
}

pliant_status picture_scalar(const char *folder, const char *name, const picture_scalars *scalars, const pliant_geometry *shown, const double point[3])
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
