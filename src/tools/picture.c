#include "picture.h"

#include "pliant/fail.h"
#include "pliant/memory.h"

#include <math.h>
#include <stdio.h>
#include <string.h>

enum { PIXELS = 480, GAP = 4, CROSS = 8, PANELS = 3, GAP_GREY = 96 };

/* Two world axes: the one to the right and the one down, and whether down runs against it (superior is up). */
typedef struct view_plane {
    const char *name;
    int right, down, normal;
    bool upwards;
} view_plane;
static const view_plane planes[] = {{"axial", 0, 1, 2, false}, {"coronal", 0, 2, 1, true}, {"sagittal", 1, 2, 0, true}};

typedef struct panel_frame {
    const view_plane *plane;
    double low[3], high[3]; /* [m] */
    double pixel;           /* [m] */
    int32_t width, height;  /* of one panel */
} panel_frame;

/* Trilinear; outside the volume its background. */
static double sample(const pliant_volume *volume, const double world[3])
{
    const pliant_geometry *g = &volume->geometry;
    double index[3], value = 0.0;
    int32_t base[3];
    double part[3];
    pliant_geometry_to_index(g, world, index);
    for (int d = 0; d < 3; ++d) {
        if (!(index[d] >= -0.5 && index[d] <= g->size[d] - 0.5))
            return volume->slope * volume->background + volume->intercept;
        double inside = fmin(fmax(index[d], 0.0), g->size[d] - 1.0);
        base[d] = (int32_t)fmin(floor(inside), g->size[d] > 1 ? g->size[d] - 2.0 : 0.0);
        part[d] = inside - base[d];
    }
    for (int corner = 0; corner < 8; ++corner) {
        double weight = 1.0;
        size_t at[3];
        for (int d = 0; d < 3; ++d) {
            int upper = corner >> d & 1;
            weight *= upper ? part[d] : 1.0 - part[d];
            at[d] = (size_t)(base[d] + upper);
        }
        if (weight > 0.0)
            value += weight * pliant_volume_value(volume, at[0] + (size_t)g->size[0] * (at[1] + (size_t)g->size[1] * at[2]));
    }
    return value;
}

/* The box of a volume's corners in world axes. */
static void world_box(const pliant_geometry *geometry, double low[3], double high[3])
{
    for (int corner = 0; corner < 8; ++corner) {
        double index[3], world[3];
        for (int d = 0; d < 3; ++d) index[d] = corner >> d & 1 ? geometry->size[d] - 0.5 : -0.5;
        pliant_geometry_to_world(geometry, index, world);
        for (int d = 0; d < 3; ++d) {
            low[d] = corner ? fmin(low[d], world[d]) : world[d];
            high[d] = corner ? fmax(high[d], world[d]) : world[d];
        }
    }
}

/* The longer side has PIXELS pixels. */
static panel_frame make_frame(const view_plane *plane, const pliant_geometry *shown)
{
    panel_frame frame = {.plane = plane};
    world_box(shown, frame.low, frame.high);
    double wide = frame.high[plane->right] - frame.low[plane->right];
    double tall = frame.high[plane->down] - frame.low[plane->down];
    frame.pixel = fmax(wide, tall) / PIXELS;
    frame.width = (int32_t)ceil(wide / frame.pixel - 1e-6);
    frame.height = (int32_t)ceil(tall / frame.pixel - 1e-6);
    return frame;
}

static void world_of_pixel(const panel_frame *frame, const double point[3], int32_t column, int32_t row, double world[3])
{
    const view_plane *plane = frame->plane;
    double down = (row + 0.5) * frame->pixel;
    world[plane->normal] = point[plane->normal];
    world[plane->right] = frame->low[plane->right] + (column + 0.5) * frame->pixel;
    world[plane->down] = plane->upwards ? frame->high[plane->down] - down : frame->low[plane->down] + down;
}

static uint8_t grey(double value, const picture_view *view)
{
    double shade = (value - view->low) / (view->high - view->low);
    return (uint8_t)(255.0 * fmin(fmax(shade, 0.0), 1.0) + 0.5);
}

static void draw_cross(const panel_frame *frame, const double point[3], int panel, uint8_t *rgb)
{
    const view_plane *plane = frame->plane;
    double down = plane->upwards ? frame->high[plane->down] - point[plane->down] : point[plane->down] - frame->low[plane->down];
    int32_t x = (int32_t)((point[plane->right] - frame->low[plane->right]) / frame->pixel), y = (int32_t)(down / frame->pixel);
    int32_t stride = PANELS * frame->width + (PANELS - 1) * GAP;
    for (int32_t step = -CROSS; step <= CROSS; ++step)
        for (int direction = 0; direction < 2; ++direction) {
            int32_t column = x + (direction ? 0 : step), row = y + (direction ? step : 0);
            if (column < 0 || column >= frame->width || row < 0 || row >= frame->height) continue;
            uint8_t *pixel = rgb + 3 * ((size_t)row * (size_t)stride + (size_t)(column + panel * (frame->width + GAP)));
            pixel[0] = 255;
            pixel[1] = 200;
            pixel[2] = 0;
        }
}

static void draw(const panel_frame *frame, const pliant_volume *before, const pliant_volume *after, const picture_view *view,
                 uint8_t *rgb)
{
    int32_t stride = PANELS * frame->width + (PANELS - 1) * GAP, panel = frame->width + GAP;
    memset(rgb, GAP_GREY, 3 * (size_t)stride * (size_t)frame->height);
    for (int32_t row = 0; row < frame->height; ++row)
        for (int32_t column = 0; column < frame->width; ++column) {
            double world[3];
            world_of_pixel(frame, view->before_point, column, row, world);
            uint8_t was = grey(sample(before, world), view), is = grey(sample(after, world), view);
            uint8_t *pixel = rgb + 3 * ((size_t)row * (size_t)stride + (size_t)column);
            for (int channel = 0; channel < 3; ++channel) {
                pixel[channel] = was;
                pixel[3 * panel + channel] = is;
            }
            pixel[6 * panel] = is > was ? (uint8_t)(is - was) : 0;
            pixel[6 * panel + 1] = 0;
            pixel[6 * panel + 2] = was > is ? (uint8_t)(was - is) : 0;
        }
    draw_cross(frame, view->before_point, 0, rgb);
    draw_cross(frame, view->after_point, 1, rgb);
}

pliant_status picture_window(const pliant_volume *scan, double *low, double *high)
{
    const double percent[4] = {0.0, 1.0, 99.0, 100.0};
    double value[4];
    pliant_status status = pliant_volume_percentiles(scan, 4, percent, value);
    if (status < 0) return status;
    bool is_ct = scan->modality == PLIANT_MODALITY_CT || (scan->modality == PLIANT_MODALITY_UNKNOWN && value[0] < -500.0);
    bool narrow = !(value[2] > value[1]); /* nearly all of one value: a few bright voxels */
    *low = is_ct ? -160.0 : value[narrow ? 0 : 1];
    *high = is_ct ? 240.0 : value[narrow ? 3 : 2];
    if (!(*high > *low)) *high = *low + 1.0;
    return PLIANT_OK;
}

pliant_status picture_write(const char *folder, const pliant_volume *before, const pliant_volume *after,
                            const picture_view *view)
{
    for (size_t n = 0; n < sizeof planes / sizeof *planes; ++n) {
        panel_frame frame = make_frame(&planes[n], &after->geometry);
        int32_t width = PANELS * frame.width + (PANELS - 1) * GAP;
        uint8_t *rgb = pliant_calloc((size_t)width * (size_t)frame.height, 3);
        if (!rgb) return pliant_fail_memory("a picture");
        draw(&frame, before, after, view, rgb);
        char path[4096];
        snprintf(path, sizeof path, "%s/%s.png", folder, planes[n].name);
        pliant_status status = picture_png(path, rgb, width, frame.height);
        pliant_free(rgb);
        if (status < 0) return status;
    }
    return PLIANT_OK;
}
