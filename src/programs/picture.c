#include "picture.h"

#include "base/fail.h"
#include "base/memory.h"
#include "scan/volume.h"

#include <math.h>
#include <stdio.h>
#include <string.h>

enum { GAP = 4, CROSS = 8, GAP_GREY = 96 };

const picture_plane picture_planes[PICTURE_PLANES] = {
    {"axial", 0, 1, 2, false}, {"coronal", 0, 2, 1, true}, {"sagittal", 1, 2, 0, true}};

/* Interpolate trilinearly; outside the volume return the background value. */
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
            value +=
                weight * pliant_volume_value(volume, at[0] + (size_t)g->size[0] * (at[1] + (size_t)g->size[1] * at[2]));
    }
    return value;
}

/* Return the bounding box of a volume's corners in world axes. */
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

picture_frame picture_frame_of(const picture_plane *plane, const pliant_geometry *shown)
{
    picture_frame frame = {.plane = plane};
    world_box(shown, frame.low, frame.high);
    double wide = frame.high[plane->right] - frame.low[plane->right];
    double tall = frame.high[plane->down] - frame.low[plane->down];
    frame.pixel = fmax(wide, tall) / PICTURE_PIXELS;
    frame.width = (int32_t)ceil(wide / frame.pixel - 1e-6);
    frame.height = (int32_t)ceil(tall / frame.pixel - 1e-6);
    return frame;
}

void picture_world(const picture_frame *frame, const double point[3], int32_t column, int32_t row, double world[3])
{
    const picture_plane *plane = frame->plane;
    double down = (row + 0.5) * frame->pixel;
    world[plane->normal] = point[plane->normal];
    world[plane->right] = frame->low[plane->right] + (column + 0.5) * frame->pixel;
    world[plane->down] = plane->upwards ? frame->high[plane->down] - down : frame->low[plane->down] + down;
}

/* Panels side by side. */
typedef struct canvas {
    picture_frame frame;
    int32_t stride; /* pixels per row of the whole picture */
    uint8_t *rgb;
} canvas;

static pliant_status canvas_create(const picture_plane *plane, const pliant_geometry *shown, int panels, canvas *out)
{
    canvas made = {.frame = picture_frame_of(plane, shown)};
    made.stride = panels * made.frame.width + (panels - 1) * GAP;
    made.rgb = pliant_calloc((size_t)made.stride * (size_t)made.frame.height, 3);
    if (!made.rgb) return pliant_fail_memory("a picture");
    memset(made.rgb, GAP_GREY, 3 * (size_t)made.stride * (size_t)made.frame.height);
    *out = made;
    return PLIANT_OK;
}

static uint8_t *canvas_pixel(const canvas *canvas, int panel, int32_t column, int32_t row)
{
    return canvas->rgb +
           3 * ((size_t)row * (size_t)canvas->stride + (size_t)(column + panel * (canvas->frame.width + GAP)));
}

static pliant_status canvas_write(canvas *canvas, const char *folder, const char *suffix)
{
    char path[4096];
    snprintf(path, sizeof path, "%s/%s%s.png", folder, canvas->frame.plane->name, suffix);
    pliant_status status = picture_png(path, canvas->rgb, canvas->stride, canvas->frame.height);
    pliant_free(canvas->rgb);
    return status;
}

static uint8_t grey(double value, double low, double high)
{
    double shade = (value - low) / (high - low);
    return (uint8_t)(255.0 * fmin(fmax(shade, 0.0), 1.0) + 0.5);
}

static void draw_cross(const canvas *canvas, int panel, const double point[3])
{
    const picture_frame *frame = &canvas->frame;
    const picture_plane *plane = frame->plane;
    double down =
        plane->upwards ? frame->high[plane->down] - point[plane->down] : point[plane->down] - frame->low[plane->down];
    int32_t x = (int32_t)((point[plane->right] - frame->low[plane->right]) / frame->pixel),
            y = (int32_t)(down / frame->pixel);
    for (int32_t step = -CROSS; step <= CROSS; ++step)
        for (int direction = 0; direction < 2; ++direction) {
            int32_t column = x + (direction ? 0 : step), row = y + (direction ? step : 0);
            if (column < 0 || column >= frame->width || row < 0 || row >= frame->height) continue;
            uint8_t *pixel = canvas_pixel(canvas, panel, column, row);
            pixel[0] = 255;
            pixel[1] = 200;
            pixel[2] = 0;
        }
}

static void draw_slice(const canvas *canvas, int panel, const pliant_volume *volume, const double point[3], double low,
                       double high)
{
    for (int32_t row = 0; row < canvas->frame.height; ++row)
        for (int32_t column = 0; column < canvas->frame.width; ++column) {
            double world[3];
            picture_world(&canvas->frame, point, column, row, world);
            memset(canvas_pixel(canvas, panel, column, row), grey(sample(volume, world), low, high), 3);
        }
}

/* Draw the difference: red where the second panel is brighter than the first, blue where it is darker. */
static void draw_difference(const canvas *canvas)
{
    for (int32_t row = 0; row < canvas->frame.height; ++row)
        for (int32_t column = 0; column < canvas->frame.width; ++column) {
            uint8_t was = *canvas_pixel(canvas, 0, column, row), is = *canvas_pixel(canvas, 1, column, row);
            uint8_t *pixel = canvas_pixel(canvas, 2, column, row);
            pixel[0] = is > was ? (uint8_t)(is - was) : 0;
            pixel[1] = 0;
            pixel[2] = was > is ? (uint8_t)(was - is) : 0;
        }
}

pliant_status picture_window(const pliant_volume *scan, double *low, double *high)
{
    const double percent[4] = {0.0, 1.0, 99.0, 100.0};
    double value[4];
    pliant_status status = pliant_volume_percentiles(scan, 4, percent, value);
    if (status < 0) return status;
    bool is_ct =
        scan->modality == PLIANT_MODALITY_CT || (scan->modality == PLIANT_MODALITY_UNKNOWN && value[0] < -500.0);
    bool narrow = !(value[2] > value[1]); /* nearly all voxels have one value, with a few bright ones */
    *low = is_ct ? -160.0 : value[narrow ? 0 : 1];
    *high = is_ct ? 240.0 : value[narrow ? 3 : 2];
    if (!(*high > *low)) *high = *low + 1.0;
    return PLIANT_OK;
}

pliant_status picture_write(const char *folder, const char *suffix, const pliant_volume *before,
                            const pliant_volume *after, const picture_view *view)
{
    for (int n = 0; n < PICTURE_PLANES; ++n) {
        canvas canvas;
        pliant_status status = canvas_create(&picture_planes[n], &after->geometry, 3, &canvas);
        if (status < 0) return status;
        draw_slice(&canvas, 0, before, view->before_point, view->low, view->high);
        draw_slice(&canvas, 1, after, view->before_point, view->low, view->high);
        draw_difference(&canvas);
        draw_cross(&canvas, 0, view->before_point);
        draw_cross(&canvas, 1, view->after_point);
        status = canvas_write(&canvas, folder, suffix);
        if (status < 0) return status;
    }
    return PLIANT_OK;
}

pliant_status picture_write_row(const char *folder, const picture_row *row)
{
    for (int n = 0; n < PICTURE_PLANES; ++n) {
        canvas canvas;
        pliant_status status =
            canvas_create(&picture_planes[n], &row->volumes[row->num_volumes - 1]->geometry, row->num_volumes, &canvas);
        if (status < 0) return status;
        for (int v = 0; v < row->num_volumes; ++v) {
            draw_slice(&canvas, v, row->volumes[v], row->point, row->low, row->high);
            draw_cross(&canvas, v, row->marks[v]);
        }
        status = canvas_write(&canvas, folder, "");
        if (status < 0) return status;
    }
    return PLIANT_OK;
}

void picture_label_colour(int label, uint8_t rgb[3])
{
    double hue = fmod(label * 0.61803398875, 1.0) * 6, shade = label % 3 == 0 ? 255 : label % 3 == 1 ? 200 : 150;
    for (int c = 0; c < 3; c++) {
        double hue_distance = fabs(fmod(hue - 2 * c + 9, 6) - 3); /* 0 where the channel is strongest */
        rgb[c] = (uint8_t)(shade * fmin(fmax(2 - hue_distance, 0.15), 1));
    }
}

static void draw_labels(const canvas *canvas, int panel, const pliant_labels *labels, const pliant_geometry *geometry,
                        const double point[3])
{
    for (int32_t row = 0; row < canvas->frame.height; ++row)
        for (int32_t column = 0; column < canvas->frame.width; ++column) {
            double world[3], index[3];
            size_t voxel = 0;
            bool inside = true;
            picture_world(&canvas->frame, point, column, row, world);
            pliant_geometry_to_index(geometry, world, index);
            for (int d = 2; d >= 0; --d) {
                const double nearest = floor(index[d] + 0.5);
                inside = inside && nearest >= 0.0 && nearest < geometry->size[d];
                voxel = voxel * (size_t)geometry->size[d] + (inside ? (size_t)nearest : 0);
            }
            if (inside) picture_label_colour(labels->voxels[voxel], canvas_pixel(canvas, panel, column, row));
        }
}

pliant_status picture_write_labels(const char *folder, const pliant_volume *scan, const pliant_labels *labels,
                                   const double point[3])
{
    double low, high;
    pliant_status status = picture_window(scan, &low, &high);
    for (int n = 0; status >= 0 && n < PICTURE_PLANES; ++n) {
        canvas canvas;
        status = canvas_create(&picture_planes[n], &scan->geometry, 2, &canvas);
        if (status < 0) return status;
        draw_slice(&canvas, 0, scan, point, low, high);
        draw_labels(&canvas, 1, labels, &scan->geometry, point);
        status = canvas_write(&canvas, folder, "");
    }
    return status;
}
