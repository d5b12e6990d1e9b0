/* Compute a pixel of an image with the same operations on the CPU (warp/render.c) and on a GPU (cuda/warp/render.cu).
 * The operations have the same order and no fused multiply-adds, so the results are bitwise identical.
 *
 * A ray is followed from its entry into the volume's box, in voxel indices: index(s) = start + s * step, with s along
 * the camera's z [m]. Bricks of RENDER_BRICK^3 cells whose maximum is below the threshold are skipped. */
#ifndef PLIANT_WARP_RAY_H
#define PLIANT_WARP_RAY_H

#include "pliant/render.h"
#include "scan/stored_value.h"

#include <math.h>

enum { RENDER_BRICK = 8, RENDER_BISECTIONS = 12, RENDER_LABEL_SAMPLES = 8, RENDER_DEPTHS = 4 };

/* Pointers are valid where it runs (CPU or GPU). */
typedef struct render_scene {
    /* VOLUME */
    const void *voxels;
    const uint8_t *labels;          /* Nullable */
    /* (bricks) maximum value in their cells; by label: 1 if a label is shown, otherwise 0 */
    float *brick_high;
    pliant_encoding encoding;
    float slope, intercept;
    int32_t size[3], bricks[3];
    float spacing[3], per_spacing[3]; /* [m], [1/m] */
    /* CAMERA: rays in volume indices per metre along z */
    int32_t width, height;
    double from[3], right[3], down[3], ahead[3];
    double near, far;               /* far: may be infinite */
    /* STYLE */
    pliant_style style;
    float level;                    /* level of the surface: the threshold, or one half for labels */
    double water;                   /* attenuation of water, for radiographs [1/m] */
} render_scene;

/* All are Nullable; with integral the image is a radiograph. */
typedef struct render_output {
    uint8_t *rgb;
    float *depth;
    uint8_t *label;
    float *integral;
} render_output;

typedef struct render_ray {
    double enter;                   /* z [m] */
    float start[3], step[3];
    float stride, length;           /* half a voxel; length from entry to exit: both along z [m] */
    float metres;                   /* ray length per metre along z */
} render_ray;

/* NaN gives low */
PLIANT_INLINE float render_limit(float value, float low, float high)
{
    return value > low ? (value < high ? value : high) : low;
}

/* Find the entry of a ray into the box of the voxels' edges; false: it misses the box. */
PLIANT_INLINE bool render_enter(const render_scene *scene, int32_t column, int32_t row, render_ray *ray)
{
    double enter = scene->near, leave = scene->far, step[3], voxels = 0.0;
    float metres = 0.0f;
    for (int d = 0; d < 3; d++) {
        step[d] = scene->ahead[d] + column * scene->right[d] + row * scene->down[d];
        voxels += step[d] * step[d];
        const double low = -0.5 - scene->from[d], high = scene->size[d] - 0.5 - scene->from[d];
        if (step[d] == 0.0) {
            if (low > 0.0 || high < 0.0) return false;
            continue;
        }
        const double a = low / step[d], b = high / step[d], first = a < b ? a : b, last = a < b ? b : a;
        enter = first > enter ? first : enter;
        leave = last < leave ? last : leave;
    }
    if (!(enter < leave)) return false;
    ray->enter = enter;
    for (int d = 0; d < 3; d++) {
        ray->start[d] = (float)(scene->from[d] + enter * step[d]);
        ray->step[d] = (float)step[d];
        metres += ray->step[d] * scene->spacing[d] * (ray->step[d] * scene->spacing[d]);
    }
    ray->metres = sqrtf(metres);
    ray->stride = (float)(0.5 / sqrt(voxels));
    ray->length = (float)(leave - enter);
    return true;
}

/* A cell of voxels and the position inside. Beyond the centres of the outermost voxels, their values are extended. */
typedef struct render_cell {
    /* index of the first corner, and offsets to the other corners; 0 where there is no other voxel */
    size_t first, along[3];
    float part[3];
    int32_t low[3];
} render_cell;

PLIANT_INLINE void render_find_cell(const render_scene *scene, const float at[3], render_cell *cell)
{
    size_t pitch = 1;
    cell->first = 0;
    PLIANT_UNROLL for (int d = 0; d < 3; d++) {
        const float inside = render_limit(at[d], 0.0f, (float)(scene->size[d] - 1));
        cell->low[d] = (int32_t)inside;
        cell->part[d] = inside - (float)cell->low[d];
        cell->along[d] = cell->low[d] + 1 < scene->size[d] ? pitch : 0;
        cell->first += (size_t)cell->low[d] * pitch;
        pitch *= (size_t)scene->size[d];
    }
}

PLIANT_INLINE void render_at(const render_ray *ray, float s, float at[3])
{
    PLIANT_UNROLL for (int d = 0; d < 3; d++) at[d] = ray->start[d] + s * ray->step[d];
}

PLIANT_INLINE float render_between(const float corner[8], const float part[3])
{
    float along[4];
    PLIANT_UNROLL for (int c = 0; c < 4; c++) along[c] = corner[2 * c] + part[0] * (corner[2 * c + 1] - corner[2 * c]);
    const float low = along[0] + part[1] * (along[1] - along[0]), high = along[2] + part[1] * (along[3] - along[2]);
    return low + part[2] * (high - low);
}

PLIANT_INLINE size_t render_corner(const render_cell *cell, int c)
{
    return cell->first + (c & 1 ? cell->along[0] : 0) + (c & 2 ? cell->along[1] : 0) + (c & 4 ? cell->along[2] : 0);
}

/* Return the scan's value.
 * encoding: of the scene, as a compile-time constant */
PLIANT_INLINE float render_value(const render_scene *scene, pliant_encoding encoding, const float at[3])
{
    render_cell cell;
    float corner[8];
    render_find_cell(scene, at, &cell);
    PLIANT_UNROLL for (int c = 0; c < 8; c++) corner[c] =
        pliant_stored_number(scene->voxels, encoding, render_corner(&cell, c));
    return scene->slope * render_between(corner, cell.part) + scene->intercept;
}

/* Return the interpolated fraction of shown labels, 0 to 1. */
PLIANT_INLINE float render_shown(const render_scene *scene, const float at[3])
{
    render_cell cell;
    float corner[8];
    render_find_cell(scene, at, &cell);
    PLIANT_UNROLL for (int c = 0; c < 8; c++) corner[c] =
        scene->style.shown[scene->labels[render_corner(&cell, c)]] ? 1.0f : 0.0f;
    return render_between(corner, cell.part);
}

PLIANT_INLINE float render_field(const render_scene *scene, pliant_encoding encoding, bool by_label, const float at[3])
{
    return by_label ? render_shown(scene, at) : render_value(scene, encoding, at);
}

/* Return whether the brick at a point can contain the surface; if not, *next is the first sample that may lie beyond
 * it. */
PLIANT_INLINE bool render_brick(const render_scene *scene, const render_ray *ray, const float at[3], float level,
                                int32_t sample, int32_t *next)
{
    int32_t brick[3];
    float beyond = ray->length;
    PLIANT_UNROLL for (int d = 0; d < 3; d++) brick[d] =
        (int32_t)render_limit(at[d], 0.0f, (float)(scene->size[d] - 1)) / RENDER_BRICK;
    if (scene->brick_high[brick[0] + scene->bricks[0] * (brick[1] + scene->bricks[1] * brick[2])] >= level) return true;
    PLIANT_UNROLL for (int d = 0; d < 3; d++) {
        if (ray->step[d] == 0.0f) continue;
        const float end =
            ((float)(ray->step[d] > 0.0f ? (brick[d] + 1) * RENDER_BRICK : brick[d] * RENDER_BRICK) - ray->start[d]) /
            ray->step[d];
        beyond = end < beyond ? end : beyond;
    }
    /* the last sample in the brick, or the sample before it */
    const int32_t last = (int32_t)render_limit(beyond / ray->stride, 0.0f, 1e9f);
    *next = last > sample ? last : sample + 1;
    return false;
}

/* Find the first intersection of the ray with the surface; false: none.
 * first: whether the ray starts inside */
PLIANT_INLINE bool render_find(const render_scene *scene, pliant_encoding encoding, bool by_label,
                               const render_ray *ray, float *hit, bool *first)
{
    float at[3];
    for (int32_t n = 0;;) {
        const float s = (float)n * ray->stride;
        int32_t next = n + 1;
        if (s >= ray->length) return false;
        render_at(ray, s, at);
        if (render_brick(scene, ray, at, scene->level, n, &next) &&
            render_field(scene, encoding, by_label, at) >= scene->level) {
            float low = n > 0 ? (float)(n - 1) * ray->stride : s, high = s;
            *first = n == 0;
            for (int h = 0; n > 0 && h < RENDER_BISECTIONS; h++) {
                const float middle = 0.5f * (low + high);
                render_at(ray, middle, at);
                if (render_field(scene, encoding, by_label, at) >= scene->level) high = middle;
                else low = middle;
            }
            *hit = high;
            return true;
        }
        n = next;
    }
}

/* Compute the unit vector into the shown tissue, along the scan's axes, from samples in 14 directions. A difference of
 * only two neighbours would show voxel steps on sharp surfaces. With `first`, or in a uniform region, it is the ray's
 * direction. */
PLIANT_INLINE void render_inward(const render_scene *scene, pliant_encoding encoding, bool by_label,
                                 const render_ray *ray, const float at[3], bool first, float out[3])
{
    const float along = 2.0f, oblique = 1.25f; /* [voxels] */
    float length = 0.0f;
    for (int d = 0; d < 3; d++) out[d] = 0.0f;
    for (int n = 0; n < (first ? 0 : 14); n++) {
        float place[3], by[3];
        for (int d = 0; d < 3; d++) {
            by[d] = n < 8 ? (n >> d & 1 ? oblique : -oblique) : (n - 8) / 2 != d ? 0.0f : n & 1 ? along : -along;
            place[d] = at[d] + by[d];
        }
        const float value = render_field(scene, encoding, by_label, place);
        for (int d = 0; d < 3; d++) out[d] += value * by[d];
    }
    for (int d = 0; d < 3; d++) {
        out[d] *= scene->per_spacing[d];
        length += out[d] * out[d];
    }
    if (!(length > 0.0f)) {
        for (int d = 0; d < 3; d++) out[d] = ray->step[d] * scene->spacing[d];
        length = ray->metres * ray->metres;
    }
    const float unit = 1.0f / sqrtf(length);
    for (int d = 0; d < 3; d++) out[d] *= unit;
}

/* Return the scan's value below the surface: the mean over several depths, since skin may be one voxel thin. Each
 * sample is at least the surface level. */
PLIANT_INLINE float render_value_below_surface(const render_scene *scene, pliant_encoding encoding, bool by_label,
                                               const float at[3], const float inward[3], bool first)
{
    float sum = 0.0f;
    for (int n = 1; n <= RENDER_DEPTHS; n++) {
        const float deep = first ? 0.0f : scene->style.beneath * (float)n * (1.0f / RENDER_DEPTHS);
        const float place[3] = {at[0] + deep * inward[0] * scene->per_spacing[0],
                                at[1] + deep * inward[1] * scene->per_spacing[1],
                                at[2] + deep * inward[2] * scene->per_spacing[2]};
        const float value = render_value(scene, encoding, place);
        sum += by_label || value > scene->level ? value : scene->level;
    }
    return sum * (1.0f / RENDER_DEPTHS);
}

PLIANT_INLINE void render_colour(const pliant_style *style, float value, float rgb[3])
{
    int above = 0;
    while (above < style->num_colours && style->colours[above].value < value) above++;
    const pliant_colour *high = &style->colours[above < style->num_colours ? above : style->num_colours - 1];
    const pliant_colour *low = &style->colours[above > 0 ? above - 1 : 0];
    const float part =
        high->value > low->value ? render_limit((value - low->value) / (high->value - low->value), 0.0f, 1.0f) : 0.0f;
    for (int c = 0; c < 3; c++) rgb[c] = low->rgb[c] + part * (high->rgb[c] - low->rgb[c]);
}

/* Shade with a light at the camera (B. T. Phong, Communications of the ACM 18:311, 1975): light and view direction lie
 * along the ray. */
PLIANT_INLINE void render_shade(const pliant_style *style, float cosine, float rgb[3])
{
    float shine = cosine * cosine;
    for (int n = 0; n < 4; n++) shine *= shine;
    for (int c = 0; c < 3; c++) rgb[c] = rgb[c] * (style->ambient + style->diffuse * cosine) + style->specular * shine;
}

/* Return the label of the nearest voxel, or of the next labelled voxel inwards. */
PLIANT_INLINE uint8_t render_label(const render_scene *scene, bool by_label, const float at[3], const float inward[3])
{
    for (int n = 0; scene->labels && n < RENDER_LABEL_SAMPLES; n++) {
        size_t index = 0, pitch = 1;
        PLIANT_UNROLL for (int d = 0; d < 3; d++) {
            const float peek = at[d] + 0.25f * (float)n * inward[d];
            index += (size_t)(int32_t)(render_limit(peek, 0.0f, (float)(scene->size[d] - 1)) + 0.5f) * pitch;
            pitch *= (size_t)scene->size[d];
        }
        const uint8_t label = scene->labels[index];
        if (label && (!by_label || scene->style.shown[label])) return label;
    }
    return 0;
}

PLIANT_INLINE uint8_t render_byte(float value)
{
    return (uint8_t)(int32_t)(render_limit(value, 0.0f, 1.0f) * 255.0f + 0.5f);
}

/* Compute colour, depth and label of a pixel. */
PLIANT_INLINE void render_surface(const render_scene *scene, pliant_encoding encoding, bool by_label, int32_t column,
                                  int32_t row, const render_output *out)
{
    const size_t pixel = (size_t)row * (size_t)scene->width + (size_t)column;
    float rgb[3] = {scene->style.background[0], scene->style.background[1], scene->style.background[2]}, depth = NAN,
          hit = 0.0f;
    uint8_t label = 0;
    bool first = false;
    render_ray ray;
    if (render_enter(scene, column, row, &ray) && render_find(scene, encoding, by_label, &ray, &hit, &first)) {
        float at[3], inward[3], peek[3], cosine = 0.0f;
        depth = (float)(ray.enter + (double)hit);
        render_at(&ray, hit, at);
        render_inward(scene, encoding, by_label, &ray, at, first, inward);
        for (int d = 0; d < 3; d++) {
            cosine += inward[d] * (ray.step[d] * scene->spacing[d]);
            peek[d] = inward[d] * scene->per_spacing[d] * scene->spacing[0];
        }
        label = render_label(scene, by_label, at, peek);
        if (out->rgb) {
            render_colour(&scene->style, render_value_below_surface(scene, encoding, by_label, at, inward, first), rgb);
            if (!first) render_shade(&scene->style, render_limit(cosine / ray.metres, 0.0f, 1.0f), rgb);
        }
    }
    if (out->rgb)
        for (int c = 0; c < 3; c++) out->rgb[3 * pixel + (size_t)c] = render_byte(rgb[c]);
    if (out->depth) out->depth[pixel] = depth;
    if (out->label) out->label[pixel] = label;
}

/* Compute the line integral of attenuation along a pixel's ray with the midpoint rule, with equal steps of at most half
 * a voxel. */
PLIANT_INLINE void render_integral(const render_scene *scene, pliant_encoding encoding, int32_t column, int32_t row,
                                   const render_output *out)
{
    double sum = 0.0;
    render_ray ray;
    if (render_enter(scene, column, row, &ray)) {
        const int32_t count = (int32_t)(ray.length / ray.stride) + 1;
        ray.stride = ray.length / (float)count;
        for (int32_t n = 0; n < count;) {
            float at[3];
            int32_t next = n + 1;
            render_at(&ray, ((float)n + 0.5f) * ray.stride, at);
            if (render_brick(scene, &ray, at, scene->level, n, &next)) {
                const float density = 1.0f + 1e-3f * render_value(scene, encoding, at); /* relative to water */
                sum += density > 0.0f ? (double)density : 0.0;
            }
            n = next;
        }
        sum *= (double)ray.stride * (double)ray.metres * scene->water;
    }
    out->integral[(size_t)row * (size_t)scene->width + (size_t)column] = (float)sum;
}

/* Return the maximum value of a brick's cells, or whether any of its labels is shown, for rows first, first + step, ...
 * along i. */
PLIANT_INLINE float render_brick_high(const render_scene *scene, pliant_encoding encoding, bool by_label,
                                      const int32_t brick[3], int32_t first, int32_t step)
{
    float high = -INFINITY;
    int32_t begin[3], end[3];
    for (int d = 0; d < 3; d++) {
        begin[d] = brick[d] * RENDER_BRICK;
        end[d] = begin[d] + RENDER_BRICK + 1 < scene->size[d] ? begin[d] + RENDER_BRICK + 1 : scene->size[d];
    }
    const int32_t down = end[1] - begin[1], rows = down * (end[2] - begin[2]);
    for (int32_t row = first; row < rows; row += step) {
        const size_t j = (size_t)(begin[1] + row % down), k = (size_t)(begin[2] + row / down);
        for (int32_t i = begin[0]; i < end[0]; i++) {
            const size_t index = (size_t)i + (size_t)scene->size[0] * (j + (size_t)scene->size[1] * k);
            const float value =
                by_label ? (scene->style.shown[scene->labels[index]] ? 1.0f : 0.0f)
                         : pliant_stored_value(scene->voxels, encoding, scene->slope, scene->intercept, index);
            high = value > high ? value : high;
        }
    }
    return high;
}

#endif
