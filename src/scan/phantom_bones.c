#include "scan/phantom_anatomy.h"

#include <math.h>

/* Heights [mm]: vertebrae are LEVEL apart, one of them at LUMBAR_3. The sacrum begins below the last disc. */
#define LEVEL 36.5f
#define LUMBAR_3 10.0f
#define HALF_BODY 13.75f
#define SACRUM -85.75f
#define CREST -44.0f

static float square(float value) { return value * value; }
static float larger(float a, float b) { return a > b ? a : b; }
static float smaller(float a, float b) { return a < b ? a : b; }

/* Return the distance from a point to a segment in the plane. */
static float to_segment(float x, float y, float ax, float ay, float bx, float by)
{
    float dx = bx - ax, dy = by - ay;
    float t = phantom_clamp(((x - ax) * dx + (y - ay) * dy) / (dx * dx + dy * dy), 0, 1);
    return sqrtf(square(x - ax - t * dx) + square(y - ay - t * dy));
}

/* Return the value of bone: compact outside, spongy inside. */
static float bone(float distance, float spongy, float grain)
{
    return distance > -1.7f ? 560 : spongy + 45 * grain;
}

/* Return the distance to pedicles, laminae, spinous, transverse and joint processes. x is relative to the midline, y to
 * the middle of the vertebral body. */
static float arch(float x, float y, float dz)
{
    float pedicle = larger(larger(fabsf(x - 14) - 4.2f, fabsf(y - 18) - 10), fabsf(dz - 4.5f) - 6.5f);
    float lamina = larger(to_segment(x, y, 17, 27, 0, 38.5f) - 3.8f, fabsf(dz + 3) - 9);
    float spinous = larger(larger(x - 3.8f, fabsf(y - 55) - 19), fabsf(dz + 5 + 0.2f * (y - 36)) - 9.5f);
    float across = to_segment(x, y, 17, 24, 43, 29);
    float transverse = sqrtf(across * across + square(dz - 3)) - 4.3f;
    float joint = sqrtf(square(x - 19) + square(y - 31) + 0.7f * square(dz + 17)) - 7.5f;
    float joint_above = sqrtf(square(x - 19) + square(y - 30) + 0.7f * square(dz - LEVEL + 17)) - 7.5f;
    return smaller(smaller(smaller(pedicle, lamina), smaller(spinous, transverse)), smaller(joint, joint_above));
}

static void paint_vertebra(phantom_row *row, int n, float x, float y, float dz)
{
    float waist = 1 - square(phantom_clamp(dz / HALF_BODY, -1, 1)), wide = 23 - 2 * waist, deep = 16.5f - waist;
    float behind = y > 0 ? y * (1 + 0.22f * larger(0, 1 - square(x / wide))) : y;
    float round = (sqrtf(square(x / wide) + square(behind / deep)) - 1) * deep;
    float body = larger(round, fabsf(dz) - HALF_BODY), processes = arch(x, y, dz);
    float distance = smaller(body, processes);
    if (distance < 0) phantom_put(row, n, PHANTOM_spine, bone(distance, 205, row->grain[n]));
    else if (round < 1 && fabsf(dz) >= HALF_BODY) phantom_put(row, n, PHANTOM_spine, 88 + 10 * row->grain[n]);
    float canal = sqrtf(square(x / 12) + square((y - 24.5f) / 8.5f));
    if (canal < 1) phantom_put(row, n, PHANTOM_spine, canal < 0.78f ? 28 : -45);
}

static void paint_sacrum(phantom_row *row, int n, float x, float y, float z)
{
    float below = SACRUM - z, middle = 36 + 0.55f * below, wide = 54 - 0.26f * below, deep = 17 - 0.03f * below;
    float bowed = y - middle - x * x / 190;
    float distance = (sqrtf(square(square(x / wide)) + square(bowed / deep)) - 1) * deep;
    float crest = larger(larger(x - 3, fabsf(y - middle - 20) - 7), -distance);
    float joint = fabsf(x - wide + 2);
    float level = below / 27, hole_z = (level - (float)(int)level - 0.6f) * 27;
    float hole = sqrtf(square(x - 21) + square(hole_z) + 0.1f * square(bowed)) - 4.5f;
    float canal = square(x / 10) + square((bowed - 7) / 4.5f);
    distance = larger(smaller(distance, crest), -smaller(hole, joint));
    if (distance < 0) phantom_put(row, n, PHANTOM_spine, canal < 1 ? 10 : bone(distance, 170, row->grain[n]));
}

void phantom_paint_spine(phantom_row *row)
{
    int first, end;
    phantom_span(row, -60, 60, &first, &end);
    if (row->y < -15) return;
    for (int n = first; n < end; ++n) {
        float x = fabsf(row->position_x[n]), z = row->position_z[n], y = row->position_y[n];
        if (row->tissue[n] == PHANTOM_AIR || row->tissue[n] == PHANTOM_skin) continue;
        float level = (z - LUMBAR_3) / LEVEL + 100.5f; /* positive, so that truncation rounds down */
        float dz = (level - (float)(int)level - 0.5f) * LEVEL;
        if (z >= SACRUM) paint_vertebra(row, n, x, y - phantom_spine_y(z), dz);
        else paint_sacrum(row, n, x, y, z);
    }
}

/* Paint the hips: a curved plate from the joint with the sacrum to the front. It is longer at lower heights. */
void phantom_paint_hips(phantom_row *row)
{
    enum { PIECES = 14 };
    float path_x[PIECES + 1], path_y[PIECES + 1];
    if (row->z > CREST + PHANTOM_BEND) return;
    float depth = phantom_clamp((CREST - row->z) / 46, 0.02f, 1), extent = depth * (2 - depth);
    float from = 0.47f * (1 - extent), to = 0.58f + 0.42f * extent, flare = 0.10f * (row->z + 100);
    for (int p = 0; p <= PIECES; ++p) {
        float t = from + (to - from) * (float)p / PIECES, s = 1 - t;
        path_x[p] = s * s * 48 + 2 * s * t * (113 + flare) + t * t * (130 + flare);
        path_y[p] = s * s * 72 + 2 * s * t * 70 + t * t * -44;
    }
    for (int n = 0; n < row->n; ++n) {
        float x = fabsf(row->position_x[n]), y = row->position_y[n], distance = 100;
        if (x < 36 || x > 140 || row->tissue[n] == PHANTOM_AIR || row->tissue[n] == PHANTOM_skin) continue;
        for (int p = 0; p < PIECES; ++p)
            distance = smaller(distance, to_segment(x, y, path_x[p], path_y[p], path_x[p + 1], path_y[p + 1]));
        distance -= 4.6f + 2.6f * (1 - extent) + 2.5f * phantom_ramp(-y, 15, 45);
        if (distance < 0) phantom_put(row, n, PHANTOM_hip, bone(distance, 190, row->grain[n]));
    }
}
