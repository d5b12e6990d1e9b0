/* Shapes of the phantom: tubes, ellipsoids and smooth noise, in millimetres, LPS. Only + - * / and square roots
 * decide the borders of tissues, so every machine draws the same voxels. These files are compiled without fused
 * multiply-add. */
#ifndef PLIANT_SCAN_PHANTOM_SHAPES_H
#define PLIANT_SCAN_PHANTOM_SHAPES_H

#include <stdbool.h>
#include <stdint.h>

typedef struct phantom_point { float x, y, z; } phantom_point;

/* The convex hull of two balls. */
typedef struct phantom_tube {
    phantom_point a, b;
    float radius_a, radius_b;
    phantom_point low, high; /* bounding box */
    float level; /* bowel: gas fills it where y is below the level (supine patient) */
    bool mark;   /* vessels: of the mesentery */
} phantom_tube;

typedef struct phantom_tubes {
    phantom_tube *tubes;
    int number, capacity;
} phantom_tubes;

/* A point of a chain of tubes, and the radius there. */
typedef struct phantom_knot { float x, y, z, radius; } phantom_knot;

/* The unit vectors of its axes are the columns of a rotation. */
typedef struct phantom_ellipsoid {
    phantom_point centre, radius;
    phantom_point axis[3];
} phantom_ellipsoid;

/* One row of voxels. Arrays have n entries; positions are distorted by noise, like anatomy. */
typedef struct phantom_row {
    int n;
    float x_first, x_step, y, z; /* undistorted [mm] */
    float voxel; /* edge of a cube with a voxel's volume [mm] */
    float *x, *position_x, *position_y, *position_z;
    float *near,
        *second; /* distance to the nearest tube, and to the nearest tube at another position of the chain */
    int32_t *nearest;     /* nearest tube, -1: no tube is close */
    float *grain, *clump; /* textures in [-1, 1], 2.5 mm and 9 mm wide */
    uint8_t *tissue;
    int16_t *value; /* Hounsfield units */
} phantom_row;

enum { PHANTOM_BEND = 6 /* maximum distortion along an axis [mm] */ };

static inline float phantom_clamp(float value, float low, float high)
{
    return value < low ? low : value > high ? high : value;
}

/* Return 0 below low, 1 above high, and a smooth transition between them. */
static inline float phantom_ramp(float value, float low, float high)
{
    float t = phantom_clamp((value - low) / (high - low), 0, 1);
    return t * t * (3 - 2 * t);
}

/* Return the smaller of two distances, rounded where they are within k of each other. */
static inline float phantom_blend(float a, float b, float k)
{
    float h = phantom_clamp(0.5f + 0.5f * (b - a) / k, 0, 1);
    return b + (a - b) * h - k * h * (1 - h);
}

uint32_t phantom_hash(uint32_t a, uint32_t b, uint32_t c, uint32_t d);
float phantom_random(uint32_t a, uint32_t b, uint32_t c); /* in [-1, 1) */

/* Add smooth noise in [-1, 1], multiplied by scale, along a row at y, z. cell: size of its features [mm]. */
void phantom_add_noise(const phantom_row *row, float cell, uint32_t seed, float scale, float *out);

/* Create an ellipsoid whose long axis (z) points along `up`. */
phantom_ellipsoid phantom_ellipsoid_make(phantom_point centre, phantom_point radius, phantom_point up);
/* Return the first-order distance to the surface, negative inside. */
float phantom_ellipsoid_distance(const phantom_ellipsoid *e, float x, float y, float z);

/* Add a tube. Return false if the list is full. */
bool phantom_add_tube(phantom_tubes *list, phantom_point a, phantom_point b, float radius_a, float radius_b);
/* Add a smooth chain through the knots, with `pieces` tubes between two knots. */
bool phantom_add_chain(phantom_tubes *list, const phantom_knot *knots, int number, int pieces);
/* Add the chain mirrored to the other side (x -> -x). */
bool phantom_add_mirrored(phantom_tubes *list, const phantom_knot *knots, int number, int pieces);

/* Compute near, nearest and second of a row for the tubes of a list. Return false if no tube is close to the row. */
bool phantom_measure(const phantom_tubes *list, phantom_row *row);

/* Find the voxels of a row whose x is in [low, high], including the distortion: from *first to before *end. */
void phantom_span(const phantom_row *row, float low, float high, int *first, int *end);

#endif
