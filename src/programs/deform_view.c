#include "deform_view.h"

#include "base/fail.h"
#include "base/memory.h"
#include "picture.h"

#include <math.h>
#include <stdio.h>
#include <string.h>

enum { WIDTH = 640, HEIGHT = 480, FILM = 512 };
static const double degree = 3.14159265358979323846 / 180;
static const double usual_view = 50; /* [degrees] */

bool deform_view_read_camera(const char *text, pliant_camera *out)
{
    const double up[2][3] = {{0, 0, 1}, {0, -1, 0}}; /* up direction: the head; if the view is along it, the front */
    double from[3], at[3], view = usual_view;
    char beyond;
    const int count =
        sscanf(text, "%lf,%lf,%lf:%lf,%lf,%lf:%lf%c", from, from + 1, from + 2, at, at + 1, at + 2, &view, &beyond);
    if ((count == 6 || count == 7) && view > 0 && view < 180) {
        pliant_camera_of_view(WIDTH, HEIGHT, view * degree, out);
        const bool steep = from[0] == at[0] && from[1] == at[1];
        if (pliant_camera_look_at(out, from, at, up[steep]) == PLIANT_OK) return true;
    }
    fprintf(stderr,
            "--camera %s: expected X,Y,Z:X,Y,Z[:DEGREES], the position, the target [m, LPS] and the field of view\n",
            text);
    return false;
}

bool deform_view_read_arm(const char *text, double angles[2])
{
    char beyond;
    if (sscanf(text, "%lf,%lf%c", angles, angles + 1, &beyond) == 2 && isfinite(angles[0]) && isfinite(angles[1]))
        return true;
    fprintf(stderr, "--radiograph %s: expected PRIMARY,SECONDARY [degrees]\n", text);
    return false;
}

static pliant_status write_camera(const deform_run *run, pliant_view *view, const char *number)
{
    const pliant_camera *camera = &run->arguments->camera;
    char path[4096];
    pliant_image image = {.rgb = pliant_calloc((size_t)camera->width * (size_t)camera->height, 3)};
    if (!image.rgb) return pliant_fail_memory("a picture");
    pliant_status status = pliant_view_render(view, camera, NULL, &image);
    snprintf(path, sizeof path, "%s/camera%s.png", run->folder, number);
    if (status >= 0) status = picture_png(path, image.rgb, camera->width, camera->height);
    pliant_free(image.rgb);
    return status;
}

/* Write the film. The maximum attenuation is white. */
static pliant_status write_film(const char *path, const float *integral)
{
    uint8_t *rgb = pliant_calloc((size_t)FILM * FILM, 3);
    float maximum = 0;
    if (!rgb) return pliant_fail_memory("a picture");
    for (size_t n = 0; n < (size_t)FILM * FILM; n++) maximum = fmaxf(maximum, integral[n]);
    for (size_t n = 0; n < (size_t)FILM * FILM; n++)
        memset(rgb + 3 * n, maximum > 0 ? (int)(255 * integral[n] / maximum + 0.5f) : 0, 3);
    pliant_status status = picture_png(path, rgb, FILM, FILM);
    pliant_free(rgb);
    return status;
}

/* Write a radiograph centred on the scan; the longest side of the scan fits on the detector. */
static pliant_status write_radiograph(const deform_run *run, pliant_view *view, const char *number)
{
    const pliant_geometry *scan = &run->inputs->scan.geometry;
    pliant_c_arm arm = {.source_to_isocentre = 0.8,
                        .source_to_detector = 1.2,
                        .primary_angle = run->arguments->arm[0] * degree,
                        .secondary_angle = run->arguments->arm[1] * degree,
                        .width = FILM,
                        .height = FILM};
    double middle[3];
    char path[4096];
    pliant_camera camera;
    for (int d = 0; d < 3; d++) {
        middle[d] = 0.5 * (scan->size[d] - 1);
        arm.pixel = fmax(arm.pixel, 1.7 * scan->size[d] * scan->spacing[d] / FILM);
    }
    pliant_geometry_to_world(scan, middle, arm.isocentre);
    pliant_status status = pliant_c_arm_camera(&arm, &camera);
    float *integral = pliant_calloc((size_t)FILM * FILM, sizeof *integral);
    if (!integral) return pliant_fail_memory("a radiograph");
    if (status >= 0) status = pliant_view_radiograph(view, &camera, PLIANT_WATER_ATTENUATION, integral);
    snprintf(path, sizeof path, "%s/radiograph%s.png", run->folder, number);
    if (status >= 0) status = write_film(path, integral);
    pliant_free(integral);
    return status;
}

pliant_status deform_view_write(const deform_run *run, const char *number)
{
    const deform_arguments *arguments = run->arguments;
    const pliant_warp *warp = pliant_data_get_warp(run->data);
    pliant_view *view;
    if (!arguments->has_camera && !arguments->has_arm) return PLIANT_OK;
    pliant_status status = pliant_view_create(run->model, warp ? &pliant_warp_volume(warp)->geometry : NULL, &view);
    if (status < 0) return status;
    status = pliant_view_set(view, pliant_data_get_body(run->data), pliant_data_get_positions(run->data, NULL), warp);
    if (status >= 0 && arguments->has_camera) status = write_camera(run, view, number);
    if (status >= 0 && arguments->has_arm) status = write_radiograph(run, view, number);
    pliant_view_free(view);
    return status;
}
