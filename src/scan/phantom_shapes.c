#include "scan/phantom_shapes.h"

#include <math.h>

enum {
    FAR = 1000,
    NO_GAS = -FAR,
    SAME_PLACE = 4 /* distance between tubes of a chain that count as the same position */
};

uint32_t phantom_hash(uint32_t a, uint32_t b, uint32_t c, uint32_t d)
{
    /* Multiply by odd constants and fold, once for every number. */
    uint64_t h = 0x9e3779b97f4a7c15u;
    const uint32_t numbers[4] = {a, b, c, d};
    for (int i = 0; i < 4; ++i) {
        h = (h ^ numbers[i]) * 0xd6e8feb86659fd93u;
        h ^= h >> 32;
    }
    h *= 0xd6e8feb86659fd93u;
    return (uint32_t)(h >> 32);
}

float phantom_random(uint32_t a, uint32_t b, uint32_t c)
{
    return (float)(phantom_hash(a, b, c, 77) >> 8) * (1.0f / 8388608.0f) - 1.0f;
}

static int floor_of(float value)
{
    int whole = (int)value;
    return (float)whole > value ? whole - 1 : whole;
}

static float smooth(float t) { return t * t * (3 - 2 * t); }

/* Return the lattice value of a column, interpolated over y and z. */
static float column(int i, int j, int k, float v, float w, uint32_t seed)
{
    float corner[4];
    for (int c = 0; c < 4; ++c)
        corner[c] = phantom_random((uint32_t)i, (uint32_t)(j + (c & 1)) * 65599u + (uint32_t)(k + (c >> 1)), seed);
    float near_k = corner[0] + v * (corner[1] - corner[0]), far_k = corner[2] + v * (corner[3] - corner[2]);
    return near_k + w * (far_k - near_k);
}

void phantom_add_noise(const phantom_row *row, float cell, uint32_t seed, float scale, float *out)
{
    float inverse = 1 / cell, y = row->y * inverse, z = row->z * inverse;
    int j = floor_of(y), k = floor_of(z), i = 0;
    float v = smooth(y - (float)j), w = smooth(z - (float)k), left = 0, right = 0;
    for (int n = 0; n < row->n; ++n) {
        float x = row->x[n] * inverse;
        int at = floor_of(x);
        if (n == 0 || at != i) {
            left = n > 0 && at == i + 1 ? right : column(at, j, k, v, w, seed);
            right = column(at + 1, j, k, v, w, seed);
            i = at;
        }
        out[n] += scale * (left + smooth(x - (float)i) * (right - left));
    }
}

static float dot(phantom_point a, phantom_point b) { return a.x * b.x + a.y * b.y + a.z * b.z; }

static phantom_point unit(phantom_point a)
{
    float length = sqrtf(dot(a, a));
    return (phantom_point){a.x / length, a.y / length, a.z / length};
}

static phantom_point cross(phantom_point a, phantom_point b)
{
    return (phantom_point){a.y * b.z - a.z * b.y, a.z * b.x - a.x * b.z, a.x * b.y - a.y * b.x};
}

phantom_ellipsoid phantom_ellipsoid_make(phantom_point centre, phantom_point radius, phantom_point up)
{
    phantom_ellipsoid e = {.centre = centre, .radius = radius};
    e.axis[2] = unit(up);
    e.axis[1] = unit(cross(e.axis[2], (phantom_point){1, 0, 0}));
    e.axis[0] = cross(e.axis[1], e.axis[2]);
    return e;
}

float phantom_ellipsoid_distance(const phantom_ellipsoid *e, float x, float y, float z)
{
    phantom_point p = {x - e->centre.x, y - e->centre.y, z - e->centre.z};
    float u = dot(p, e->axis[0]) / e->radius.x, v = dot(p, e->axis[1]) / e->radius.y,
          w = dot(p, e->axis[2]) / e->radius.z;
    float size = sqrtf(u * u + v * v + w * w);
    u /= e->radius.x, v /= e->radius.y, w /= e->radius.z;
    float slope = sqrtf(u * u + v * v + w * w);
    return slope > 0 ? size * (size - 1) / slope : -e->radius.x;
}

bool phantom_add_tube(phantom_tubes *list, phantom_point a, phantom_point b, float radius_a, float radius_b)
{
    if (list->number == list->capacity) return false;
    float r = radius_a > radius_b ? radius_a : radius_b;
    list->tubes[list->number++] = (phantom_tube){
        .a = a, .b = b, .radius_a = radius_a, .radius_b = radius_b, .level = NO_GAS,
        .low = {(a.x < b.x ? a.x : b.x) - r, (a.y < b.y ? a.y : b.y) - r, (a.z < b.z ? a.z : b.z) - r},
        .high = {(a.x > b.x ? a.x : b.x) + r, (a.y > b.y ? a.y : b.y) + r, (a.z > b.z ? a.z : b.z) + r}};
    return true;
}

/* Return the Catmull-Rom cubic through b and c. */
static float curve(float a, float b, float c, float d, float t)
{
    return b + 0.5f * t * (c - a + t * (2 * a - 5 * b + 4 * c - d + t * (3 * (b - c) + d - a)));
}

static bool add_chain(phantom_tubes *list, const phantom_knot *knots, int number, int pieces, float side)
{
    for (int s = 0; s + 1 < number; ++s) {
        const phantom_knot *a = &knots[s ? s - 1 : 0], *b = &knots[s], *c = &knots[s + 1];
        const phantom_knot *d = &knots[s + 2 < number ? s + 2 : number - 1];
        phantom_knot from = *b;
        for (int piece = 1; piece <= pieces; ++piece) {
            float t = (float)piece / (float)pieces;
            phantom_knot to = {curve(a->x, b->x, c->x, d->x, t), curve(a->y, b->y, c->y, d->y, t),
                               curve(a->z, b->z, c->z, d->z, t), b->radius + t * (c->radius - b->radius)};
            if (!phantom_add_tube(list, (phantom_point){side * from.x, from.y, from.z},
                                  (phantom_point){side * to.x, to.y, to.z}, from.radius, to.radius))
                return false;
            from = to;
        }
    }
    return true;
}

bool phantom_add_chain(phantom_tubes *list, const phantom_knot *knots, int number, int pieces)
{
    return add_chain(list, knots, number, pieces, 1);
}

bool phantom_add_mirrored(phantom_tubes *list, const phantom_knot *knots, int number, int pieces)
{
    return add_chain(list, knots, number, pieces, -1);
}

void phantom_span(const phantom_row *row, float low, float high, int *first, int *end)
{
    float from = (low - PHANTOM_BEND - row->x_first) / row->x_step,
          to = (high + PHANTOM_BEND - row->x_first) / row->x_step;
    *first = from <= 0 ? 0 : from >= (float)row->n ? row->n : floor_of(from);
    *end = to < 0 ? 0 : to >= (float)(row->n - 1) ? row->n : floor_of(to) + 1;
}

static void measure_tube(const phantom_tube *tube, int index, phantom_row *row)
{
    int first, end;
    phantom_span(row, tube->low.x - 2, tube->high.x + 2, &first, &end);
    phantom_point axis = {tube->b.x - tube->a.x, tube->b.y - tube->a.y, tube->b.z - tube->a.z};
    float length = dot(axis, axis), inverse = length > 0 ? 1 / length : 0;
    for (int n = first; n < end; ++n) {
        phantom_point p = {row->position_x[n] - tube->a.x, row->position_y[n] - tube->a.y,
                           row->position_z[n] - tube->a.z};
        float t = phantom_clamp(dot(p, axis) * inverse, 0, 1);
        p.x -= t * axis.x, p.y -= t * axis.y, p.z -= t * axis.z;
        float distance = sqrtf(dot(p, p)) - tube->radius_a - t * (tube->radius_b - tube->radius_a);
        bool elsewhere = index - row->nearest[n] > SAME_PLACE;
        if (distance < row->near[n]) {
            if (elsewhere && row->nearest[n] >= 0) row->second[n] = row->near[n];
            row->near[n] = distance;
            row->nearest[n] = index;
        } else if (elsewhere && distance < row->second[n]) {
            row->second[n] = distance;
        }
    }
}

bool phantom_measure(const phantom_tubes *list, phantom_row *row)
{
    const float reach = PHANTOM_BEND + 2;
    bool any = false;
    for (int index = 0; index < list->number; ++index) {
        const phantom_tube *tube = &list->tubes[index];
        if (row->z < tube->low.z - reach || row->z > tube->high.z + reach || row->y < tube->low.y - reach ||
            row->y > tube->high.y + reach)
            continue;
        if (!any)
            for (int n = 0; n < row->n; ++n) {
                row->near[n] = row->second[n] = FAR;
                row->nearest[n] = -1;
            }
        any = true;
        measure_tube(tube, index, row);
    }
    return any;
}
