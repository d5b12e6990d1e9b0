#include "warp/render.h"

#include "base/fail.h"
#include "base/threads.h"
#include "base/memory.h"
#include "scan/volume.h"
#include "warp/picture.h"

static bool all_finite(int count, const double *values)
{
    for (int n = 0; n < count; n++)
        if (!isfinite(values[n])) return false;
    return true;
}

static pliant_status check_camera(const pliant_camera *camera)
{
    enum { MAX_PIXELS = 1 << 15 };
    const double numbers[] = {camera->fx, camera->fy, camera->cx, camera->cy, camera->near, camera->far};
    if (camera->width < 1 || camera->height < 1 || camera->width > MAX_PIXELS || camera->height > MAX_PIXELS)
        return pliant_fail(PLIANT_ERROR_ARGUMENT, "a camera has %d x %d pixels; use 1 to %d each", camera->width,
                           camera->height, MAX_PIXELS);
    if (!all_finite(6, numbers) || !all_finite(12, camera->pose))
        return pliant_fail(PLIANT_ERROR_ARGUMENT, "a camera's fx, fy, cx, cy, near, far and pose must be finite");
    const double minimum = 1e-3, maximum = 1e9; /* [pixels] */
    if (!(fabs(camera->fx) >= minimum && fabs(camera->fx) <= maximum && fabs(camera->fy) >= minimum &&
          fabs(camera->fy) <= maximum))
        return pliant_fail(PLIANT_ERROR_ARGUMENT, "a camera's fx and fy are %g and %g pixels; use %g to %g", camera->fx,
                           camera->fy, minimum, maximum);
    for (int a = 0; a < 3; a++)
        for (int b = a; b < 3; b++) {
            double product = 0;
            for (int row = 0; row < 3; row++) product += camera->pose[4 * row + a] * camera->pose[4 * row + b];
            if (fabs(product - (a == b)) > 1e-3)
                return pliant_fail(
                    PLIANT_ERROR_ARGUMENT,
                    "the first three columns of a camera's pose must be a rotation: unit vectors at right angles");
        }
    return PLIANT_OK;
}

static pliant_status check_style(const pliant_style *style)
{
    bool good = style->num_colours >= 1 && style->num_colours <= PLIANT_MAX_COLOURS && isfinite(style->threshold) &&
                isfinite(style->beneath) && isfinite(style->ambient) && isfinite(style->diffuse) &&
                isfinite(style->specular);
    for (int n = 0; good && n < style->num_colours; n++) {
        good = isfinite(style->colours[n].value) && (n == 0 || style->colours[n].value >= style->colours[n - 1].value);
        for (int c = 0; c < 3; c++) good = good && isfinite(style->colours[n].rgb[c]) && isfinite(style->background[c]);
    }
    return good ? PLIANT_OK
                : pliant_fail(PLIANT_ERROR_ARGUMENT,
                              "a style needs 1 to %d colours whose values ascend, and numbers that are finite",
                              PLIANT_MAX_COLOURS);
}

pliant_status render_scene_of(const pliant_volume *volume, const pliant_camera *camera, const pliant_style *style,
                              double water, render_scene *out)
{
    const pliant_geometry *geometry = &volume->geometry;
    pliant_status status = check_camera(camera);
    if (status == PLIANT_OK && style) status = check_style(style);
    if (status == PLIANT_OK && !style && !(water >= 0 && isfinite(water)))
        status = pliant_fail(PLIANT_ERROR_ARGUMENT, "the attenuation of water must be finite and not negative, not %g",
                             water);
    if (status != PLIANT_OK) return status;
    render_scene scene = {.encoding = volume->encoding,
                          .slope = volume->slope,
                          .intercept = volume->intercept,
                          .width = camera->width,
                          .height = camera->height,
                          .near = fmax(camera->near, 0),
                          .far = camera->far > 0 ? camera->far : INFINITY,
                          .water = water};
    const double *pose = camera->pose, *axis = geometry->direction;
    const double origin[3] = {pose[3], pose[7], pose[11]};
    pliant_geometry_to_index(geometry, origin, scene.from);
    for (int d = 0; d < 3; d++) {
        double turned[3]; /* camera axes in voxel indices per metre */
        for (int c = 0; c < 3; c++)
            turned[c] =
                (axis[d] * pose[c] + axis[3 + d] * pose[4 + c] + axis[6 + d] * pose[8 + c]) / geometry->spacing[d];
        scene.right[d] = turned[0] / camera->fx;
        scene.down[d] = turned[1] / camera->fy;
        scene.ahead[d] = turned[2] - camera->cx * scene.right[d] - camera->cy * scene.down[d];
        scene.size[d] = geometry->size[d];
        scene.bricks[d] = (geometry->size[d] + RENDER_BRICK - 1) / RENDER_BRICK;
        scene.spacing[d] = (float)geometry->spacing[d];
        scene.per_spacing[d] = (float)(1 / geometry->spacing[d]);
    }
    if (style) scene.style = *style;
    scene.level = !style ? nextafterf(-1000, 0) : style->by_label ? 0.5f : style->threshold;
    *out = scene;
    return PLIANT_OK;
}

size_t render_num_bricks(const render_scene *scene)
{
    return (size_t)scene->bricks[0] * (size_t)scene->bricks[1] * (size_t)scene->bricks[2];
}

void render_fill_bricks(const render_scene *scene, bool by_label, int num_threads)
{
    const ptrdiff_t count = (ptrdiff_t)render_num_bricks(scene);
    const int32_t *bricks = scene->bricks;
#pragma omp parallel for num_threads(pliant_threads_or_cores(num_threads)) schedule(static)
    for (ptrdiff_t b = 0; b < count; b++) {
        const int32_t brick[3] = {(int32_t)(b % bricks[0]), (int32_t)(b / bricks[0] % bricks[1]),
                                  (int32_t)(b / bricks[0] / bricks[1])};
        switch (scene->encoding) { /* gives the compiler the encoding as a constant in the loops */
        case PLIANT_UINT8: scene->brick_high[b] = render_brick_high(scene, PLIANT_UINT8, by_label, brick, 0, 1); break;
        case PLIANT_INT16: scene->brick_high[b] = render_brick_high(scene, PLIANT_INT16, by_label, brick, 0, 1); break;
        case PLIANT_FLOAT32:
            scene->brick_high[b] = render_brick_high(scene, PLIANT_FLOAT32, by_label, brick, 0, 1);
            break;
        }
    }
}

PLIANT_INLINE void draw_row(const render_scene *scene, pliant_encoding encoding, int32_t row, const render_output *out)
{
    if (out->integral)
        for (int32_t column = 0; column < scene->width; column++) render_integral(scene, encoding, column, row, out);
    else if (scene->style.by_label)
        for (int32_t column = 0; column < scene->width; column++)
            render_surface(scene, encoding, true, column, row, out);
    else
        for (int32_t column = 0; column < scene->width; column++)
            render_surface(scene, encoding, false, column, row, out);
}

void render_draw(const render_scene *scene, const render_output *out, int num_threads)
{
#pragma omp parallel for num_threads(pliant_threads_or_cores(num_threads)) schedule(dynamic, 4)
    for (int32_t row = 0; row < scene->height; row++)
        switch (scene->encoding) {
        case PLIANT_UINT8: draw_row(scene, PLIANT_UINT8, row, out); break;
        case PLIANT_INT16: draw_row(scene, PLIANT_INT16, row, out); break;
        case PLIANT_FLOAT32: draw_row(scene, PLIANT_FLOAT32, row, out); break;
        }
}

static pliant_status draw_volume(const pliant_volume *volume, const pliant_volume *labels, render_scene *scene,
                                 const render_output *out, int num_threads)
{
    const bool by_label = render_by_label(scene, out);
    if (!volume->voxels) return pliant_fail(PLIANT_ERROR_ARGUMENT, "the volume of a picture has no voxels");
    if (labels && (!labels->voxels || labels->encoding != PLIANT_UINT8 ||
                   !pliant_geometry_equal(&labels->geometry, &volume->geometry)))
        return pliant_fail(PLIANT_ERROR_ARGUMENT, "the labels of a picture must be UINT8, on the grid of its volume");
    if (by_label && !labels) return pliant_fail(PLIANT_ERROR_ARGUMENT, "a picture by label needs labels");
    scene->voxels = volume->voxels;
    scene->labels = labels ? labels->voxels : NULL;
    scene->brick_high = pliant_calloc(render_num_bricks(scene), sizeof *scene->brick_high);
    if (!scene->brick_high) return pliant_fail_memory("a picture");
    render_fill_bricks(scene, by_label, num_threads);
    render_draw(scene, out, num_threads);
    pliant_free(scene->brick_high);
    return PLIANT_OK;
}

pliant_status pliant_render(const pliant_volume *volume, const pliant_volume *labels, const pliant_camera *camera,
                            const pliant_style *style, int num_threads, const pliant_image *out)
{
    const render_output output = {.rgb = out->rgb, .depth = out->depth, .label = out->label};
    render_scene scene;
    pliant_status status = render_scene_of(volume, camera, style, 0, &scene);
    return status == PLIANT_OK ? draw_volume(volume, labels, &scene, &output, num_threads) : status;
}

pliant_status pliant_radiograph(const pliant_volume *volume, const pliant_camera *camera, double water, int num_threads,
                                float *out)
{
    const render_output output = {.integral = out};
    render_scene scene;
    pliant_status status = render_scene_of(volume, camera, NULL, water, &scene);
    return status == PLIANT_OK ? draw_volume(volume, NULL, &scene, &output, num_threads) : status;
}
