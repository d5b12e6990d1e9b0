/* Create cameras from their usual parameters, and choose the default appearance of a scan. */
#include "base/fail.h"
#include "base/vector3.h"
#include "pliant/render.h"
#include "scan/volume.h"

#include <math.h>
#include <string.h>

void pliant_camera_of_view(int32_t width, int32_t height, double field_of_view, pliant_camera *out)
{
    const double focal = 0.5 * width / tan(0.5 * field_of_view);
    *out = (pliant_camera){.width = width,
                           .height = height,
                           .fx = focal,
                           .fy = focal,
                           .cx = 0.5 * (width - 1),
                           .cy = 0.5 * (height - 1),
                           .pose = {1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0}};
}

/* Normalize a vector; false for length zero. */
static bool make_unit(double v[3])
{
    const double length = sqrt(v[0] * v[0] + v[1] * v[1] + v[2] * v[2]);
    for (int d = 0; d < 3; d++) v[d] /= length;
    return length > 1e-12 && isfinite(length);
}

pliant_status pliant_camera_look_at(pliant_camera *camera, const double from[3], const double at[3], const double up[3])
{
    double ahead[3], right[3], down[3];
    for (int d = 0; d < 3; d++) ahead[d] = at[d] - from[d];
    bool good = make_unit(ahead);
    pliant_cross3(ahead, up, right);
    good = good && make_unit(right);
    pliant_cross3(ahead, right, down);
    if (!good)
        return pliant_fail(PLIANT_ERROR_ARGUMENT,
                           "a camera looks from one point at another, and up in its image is not along its view");
    for (int d = 0; d < 3; d++) {
        const double row[4] = {right[d], down[d], ahead[d], from[d]};
        memcpy(camera->pose + 4 * d, row, sizeof row);
    }
    return PLIANT_OK;
}

pliant_status pliant_c_arm_camera(const pliant_c_arm *arm, pliant_camera *out)
{
    if (!(arm->source_to_isocentre > 0) || !(arm->source_to_detector > 0) || !(arm->pixel > 0) ||
        !isfinite(arm->primary_angle) || !isfinite(arm->secondary_angle))
        return pliant_fail(PLIANT_ERROR_ARGUMENT,
                           "a C-arm's distances and pixel must be above 0, and its angles finite");
    const double sp = sin(arm->primary_angle), cp = cos(arm->primary_angle), ss = sin(arm->secondary_angle),
                 cs = cos(arm->secondary_angle);
    /* directions from the source to the detector; axes: front, left, head */
    const double ahead[3] = {sp * cs, -cp * cs, ss};
    const double up[3] = {-sp * ss, cp * ss, cs};
    double from[3], at[3];
    for (int d = 0; d < 3; d++) {
        at[d] = arm->isocentre[d];
        from[d] = at[d] - arm->source_to_isocentre * ahead[d];
    }
    const double focal = arm->source_to_detector / arm->pixel;
    /* mirrored, so that the patient's left is on the left as seen from the source */
    pliant_camera camera = {.width = arm->width,
                            .height = arm->height,
                            .fx = -focal,
                            .fy = focal,
                            .cx = 0.5 * (arm->width - 1),
                            .cy = 0.5 * (arm->height - 1)};
    pliant_status status = pliant_camera_look_at(&camera, from, at, up);
    if (status == PLIANT_OK) *out = camera;
    return status;
}

/* Colours of tissue in an endoscopic image by Hounsfield units: fat is yellow, organs are red, contrast-enhanced tissue
 * is darker, bone is ivory. */
static const pliant_colour ct_colours[] = {{-1000, {0.25f, 0.18f, 0.17f}}, {-500, {0.72f, 0.45f, 0.40f}},
                                           {-140, {0.86f, 0.68f, 0.46f}},  {-60, {0.86f, 0.66f, 0.40f}},
                                           {-5, {0.76f, 0.40f, 0.33f}},    {60, {0.66f, 0.24f, 0.21f}},
                                           {120, {0.52f, 0.14f, 0.12f}},   {170, {0.66f, 0.32f, 0.25f}},
                                           {230, {0.88f, 0.80f, 0.66f}},   {1200, {0.97f, 0.95f, 0.90f}}};

pliant_status pliant_style_defaults(const pliant_volume *scan, pliant_style *out)
{
    const double percent[4] = {0, 1, 99, 100};
    double value[4];
    pliant_status status = pliant_volume_percentiles(scan, 4, percent, value);
    if (status != PLIANT_OK) return status;
    pliant_style style = {.ambient = 0.25f, .diffuse = 0.75f, .specular = 0.15f};
    memset(style.shown + 1, 1, PLIANT_NUM_LABELS - 1);
    for (int d = 0; d < 3; d++) style.beneath = fmaxf(style.beneath, 2 * (float)scan->geometry.spacing[d]);
    if (scan->modality == PLIANT_MODALITY_CT || (scan->modality == PLIANT_MODALITY_UNKNOWN && value[0] < -500)) {
        style.threshold = -300;
        style.num_colours = (int32_t)(sizeof ct_colours / sizeof *ct_colours);
        memcpy(style.colours, ct_colours, sizeof ct_colours);
    } else {
        const bool narrow = !(value[2] > value[1]);
        const float low = (float)value[narrow ? 0 : 1], high = (float)value[narrow ? 3 : 2];
        style.threshold = low + 0.15f * (high - low);
        style.num_colours = 2;
        style.colours[0] = (pliant_colour){low, {0.05f, 0.05f, 0.05f}};
        style.colours[1] = (pliant_colour){high, {1, 1, 1}};
    }
    *out = style;
    return PLIANT_OK;
}
