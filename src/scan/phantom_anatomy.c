#include "scan/phantom_anatomy.h"

#include <math.h>

/* --- The body and its wall. --- */

static float square(float value) { return value * value; }

float phantom_depth(float x, float y, float z)
{
    /* The cross-sections are rounded squares with waist, furrow of the back, and navel. */
    float s = z / 150, a = 174 + 7 * s * s - 3 * s, b = 119 + 4 * s * s;
    float back = y > 0 ? square(1 - phantom_clamp(x * x / 2500, 0, 1)) * (y / b) : 0;
    float navel = y < 0 ? 9 * square(1 - phantom_clamp((x * x + square(z + 25)) / 260, 0, 1)) : 0;
    float u = x / a, v = y / b * (1 + 0.05f * back), corner = 0.30f;
    float f = u * u + v * v - corner * u * u * v * v;
    if (f < 0.1f) return 100; /* deep inside, where the ellipses shrink to a point */
    float size = sqrtf(f), slope_x = u * (1 - corner * v * v) / (a * size),
          slope_y = v * (1 - corner * u * u) / (b * size);
    return (1 - size) / sqrtf(slope_x * slope_x + slope_y * slope_y) - navel;
}

void phantom_wall(float x, float y, float z, float *fat, float *muscle)
{
    float u = square(x / 174), v = square(y / 119), side = u / (u + v + 1e-6f), front = y < 0 ? 1 - side : 0,
          back = y < 0 ? 0 : 1 - side;
    float low = phantom_ramp(-z, -60, 120), pelvis = phantom_ramp(-z, 40, 125), across = fabsf(x);
    *fat = 4 + side * (9 + 11 * low) + front * (13 + 7 * low) + back * (9 + 13 * low);

    float strap = across > 3 && across < 66 ? 1 - square(square((across - 34.5f) / 31.5f)) : 0;
    float flank = 17 * phantom_ramp(across, 62, 92);
    float before = 2 + 10 * strap > flank ? 2 + 10 * strap : flank;
    float behind = 17 * side + 36 * back + pelvis * (24 * side + 9 * back);
    *muscle = *fat + (y < 0 ? before + pelvis * side * 24 : behind);
}

/* The spine is curved inwards in the lower back. */
float phantom_spine_y(float z) { return 26 + 16 * square((z - 5) / 145); }

/* --- Chains of knots. --- */

#define CHAIN(list, knots, pieces) phantom_add_chain(list, knots, (int)(sizeof(knots) / sizeof *(knots)), pieces)
#define BOTH_SIDES(list, knots, pieces) \
    (CHAIN(list, knots, pieces) && phantom_add_mirrored(list, knots, (int)(sizeof(knots) / sizeof *(knots)), pieces))

static bool make_muscles(phantom_tubes *list)
{
    static const phantom_knot psoas[] = {{27, 44, 95, 7}, {33, 40, 50, 12}, {41, 35, 5, 17}, {50, 27, -45, 21},
                                         {63, 2, -100, 20}, {76, -28, -155, 17}};
    static const phantom_knot quadratus[] = {{52, 66, 92, 5}, {66, 66, 50, 8}, {74, 62, 10, 9}, {80, 56, -38, 8}};
    static const phantom_knot iliacus[] = {
        {98, 26, -62, 8}, {94, 12, -85, 12}, {90, -12, -120, 14}, {88, -28, -155, 13}};
    return BOTH_SIDES(list, psoas, 4) && BOTH_SIDES(list, quadratus, 3) && BOTH_SIDES(list, iliacus, 3);
}

/* Create ribs 8 to 12, which run down and forward in the wall. u is the angle from the back in quarter turns. */
static bool make_ribs(phantom_tubes *list)
{
    static const struct { float top, drop, end; } ribs[] = {
        {258, 72, 1.78f}, {222, 72, 1.66f}, {186, 70, 1.50f}, {152, 60, 1.12f}, {118, 50, 0.62f}};
    enum { PIECES = 40 };
    for (int r = 0; r < (int)(sizeof ribs / sizeof *ribs); ++r) {
        phantom_point last = {0, 0, 0};
        for (int piece = 0; piece <= PIECES; ++piece) {
            float u = 0.14f + (ribs[r].end - 0.14f) * (float)piece / PIECES, q = u < 1 ? u : 2 - u;
            float t = q * (0.785f + 0.215f * q * q),
                  cosine = (1 - t * t) / (1 + t * t); /* t: tangent of half the angle */
            float sine = 2 * t / (1 + t * t), behind = u < 1 ? cosine : -cosine;
            float scale = 1 / sqrtf(1 - 0.30f * square(sine * cosine));
            float x = 152 * sine * scale, y = 94 * behind * scale, z = ribs[r].top - ribs[r].drop * u;
            /* The rib heads bend towards the spine. */
            y -= 24 * square(1 - phantom_clamp(u / 0.32f, 0, 1));
            phantom_point here = {x, y, z};
            float radius = u > ribs[r].end - 0.1f ? 3.6f : 4.8f;
            if (piece && z < 170 &&
                !(phantom_add_tube(list, last, here, radius, radius) &&
                  phantom_add_tube(list, (phantom_point){-last.x, last.y, last.z}, (phantom_point){-x, y, z}, radius,
                                   radius)))
                return false;
            last = here;
        }
    }
    return true;
}

/* --- Bowel. --- */

/* Fill the tubes [from, end) of a chain with gas above one level: their mean y plus `more`. */
static void fill_with_gas(phantom_tubes *list, int first, int from, int end, float more)
{
    float mean = 0;
    for (int t = from; t < end; ++t) mean += list->tubes[first + t].a.y / (float)(end - from);
    for (int t = from; t < end; ++t) list->tubes[first + t].level = mean + more;
}

static bool make_colon(phantom_tubes *list)
{
    static const phantom_knot path[] = {
        {-78, -38, -120, 20}, {-86, -32, -95, 25}, {-97, -14, -60, 24}, {-108, 8, -25, 23}, {-110, 6, 0, 23},
        {-98, -30, 4, 22},    {-78, -66, -8, 22},   {-40, -84, -22, 20}, {10, -86, -30, 20}, {55, -82, -18, 20},
        {88, -66, 8, 20},     {108, -35, 40, 19},   {118, -2, 56, 18},   {124, 22, 30, 16},  {119, 26, -10, 15},
        {106, 10, -50, 15},   {98, -14, -85, 15},   {86, -24, -115, 16}, {66, -6, -138, 16}, {38, -10, -158, 16}};
    int before = list->number;
    if (!CHAIN(list, path, 6)) return false;
    /* Pouches: every third tube is narrow. */
    for (int t = before; t < list->number; ++t) {
        static const float width[] = {1.10f, 1.04f, 0.82f};
        phantom_tube *tube = &list->tubes[t];
        tube->radius_a *= width[(t - before) % 3];
        tube->radius_b *= width[(t + 1 - before) % 3];
    }
    fill_with_gas(list, before, 38, 60, 4);  /* the transverse colon */
    fill_with_gas(list, before, 84, 94, 0);  /* pockets in the descending one */
    fill_with_gas(list, before, 104, 110, 2);
    return true;
}

/* Create a path that fills the middle of the abdomen layer by layer in alternating directions, with random
 * displacements. */
static bool make_small_bowel(phantom_tubes *list)
{
    enum { LAYERS = 6, MAX_KNOTS = 400 };
    phantom_knot knots[MAX_KNOTS];
    int number = 0, lane = 0;
    for (int layer = 0; layer < LAYERS; ++layer) {
        float z = -8.0f - 25.0f * (float)layer, half = layer == 0 ? 58 : 74;
        bool along = layer % 2 == 0; /* lanes along x, then along y */
        int lanes = along ? 3 : 6, steps = along ? 7 : 3;
        for (int n = 0; n < lanes; ++n, ++lane)
            for (int s = 0; s < steps && number < MAX_KNOTS; ++s, ++number) {
                float across = (float)n / (float)(lanes - 1) * 2 - 1, forth = (float)s / (float)(steps - 1) * 2 - 1;
                if (lane % 2) forth = -forth;
                if (layer % 4 > 1) across = -across;
                float x = half * (along ? forth : across), y = -38 + 34 * (along ? across : forth);
                uint32_t id = (uint32_t)number;
                knots[number] = (phantom_knot){x + 9 * phantom_random(id, 1, 5), y + 7 * phantom_random(id, 2, 5),
                                               z + 9 * phantom_random(id, 3, 5), 11.5f + 2 * phantom_random(id, 4, 5)};
            }
    }
    int before = list->number;
    if (!phantom_add_chain(list, knots, number, 4)) return false;
    for (int t = 0; before + t + 14 < list->number; t += 14)
        if (phantom_hash((uint32_t)t, 9, 9, 9) % 6 == 0) fill_with_gas(list, before, t, t + 10, -2);
    return true;
}

static bool make_stomach(phantom_tubes *list)
{
    static const phantom_knot stomach[] = {{62, 0, 132, 33}, {68, -22, 108, 34}, {58, -48, 84, 29}, {30, -68, 64, 21},
                                           {0, -68, 58, 15}, {-26, -56, 64, 10}};
    static const phantom_knot duodenum[] = {{-26, -56, 64, 10}, {-46, -34, 52, 12}, {-50, -8, 28, 12}, {-42, 2, 6, 12},
                                            {-14, -6, -4, 11}, {18, -12, 2, 11}, {34, -22, 14, 11}};
    if (!CHAIN(list, stomach, 4)) return false;
    fill_with_gas(list, 0, 0, list->number, -22);
    return CHAIN(list, duodenum, 3);
}

/* --- Vessels. --- */

/* Create a vessel and its branches, recursively. */
static bool grow(phantom_tubes *list, phantom_point from, phantom_point to, float radius, int generations,
                 uint32_t seed)
{
    phantom_point run = {to.x - from.x, to.y - from.y, to.z - from.z};
    float length = sqrtf(run.x * run.x + run.y * run.y + run.z * run.z);
    phantom_point middle = {from.x + run.x / 2 + 0.12f * length * phantom_random(seed, 1, 8),
                            from.y + run.y / 2 + 0.12f * length * phantom_random(seed, 2, 8),
                            from.z + run.z / 2 + 0.12f * length * phantom_random(seed, 3, 8)};
    if (!phantom_add_tube(list, from, middle, radius, radius * 0.95f) ||
        !phantom_add_tube(list, middle, to, radius * 0.95f, radius * 0.88f))
        return false;
    for (int child = 0; generations > 0 && child < 2; ++child) {
        uint32_t id = 2 * seed + (uint32_t)child;
        float sign = child ? 0.62f : -0.62f;
        phantom_point aside = {phantom_random(seed, 4, 8), phantom_random(seed, 5, 8), phantom_random(seed, 6, 8)};
        phantom_point end = {
            to.x + 0.72f * (run.x + sign * length * aside.x) + 0.1f * length * phantom_random(id, 7, 8),
            to.y + 0.72f * (run.y + sign * length * aside.y) + 0.1f * length * phantom_random(id, 8, 8),
            to.z + 0.72f * (run.z + sign * length * aside.z) + 0.1f * length * phantom_random(id, 9, 8)};
        if (!grow(list, to, end, radius * 0.74f, generations - 1, id)) return false;
    }
    return true;
}

static bool make_liver_vessels(phantom_tubes *list)
{
    static const phantom_point porta = {-38, -8, 84}, veins = {-20, 14, 142};
    static const struct { phantom_point to; float radius; } branches[] = {
        {{-70, 4, 92}, 6}, {{-62, -30, 72}, 4.5f}, {{2, -44, 108}, 4.5f}};
    static const phantom_point veins_to[] = {{-72, 34, 116}, {-52, -28, 116}, {14, -32, 124}};
    for (uint32_t b = 0; b < 3; ++b)
        if (!grow(list, porta, branches[b].to, branches[b].radius, 4, 17 + b) ||
            !grow(list, veins, veins_to[b], 5, 3, 31 + b))
            return false;
    return true;
}

static bool make_vessels(phantom_tubes *list)
{
    static const phantom_knot cava[] = {{-19, 12, 152, 11},  {-20, 10, 120, 11.5f}, {-20, 8, 80, 11},
                                        {-19, 2, 40, 10.5f}, {-18, -3, 0, 10},      {-16, -4, -38, 10}};
    static const phantom_knot iliac_vein[] = {
        {-10, -2, -40, 8}, {24, 8, -78, 8}, {50, 20, -112, 7.5f}, {70, 0, -155, 7}};
    static const phantom_knot iliac_vein_right[] = {
        {-16, -4, -38, 8}, {-34, 8, -78, 8}, {-52, 20, -112, 7.5f}, {-70, 0, -155, 7}};
    static const phantom_knot iliac_artery[] = {
        {12, -6, -30, 6.5f}, {28, 0, -65, 6}, {48, 4, -100, 5.5f}, {66, -14, -155, 5}};
    static const phantom_knot iliac_artery_right[] = {
        {12, -6, -30, 6.5f}, {-20, -8, -60, 6}, {-44, 2, -100, 5.5f}, {-64, -14, -155, 5}};
    static const phantom_knot mesenteric[] = {{11, -6, 66, 4}, {8, -22, 54, 4}, {3, -30, 20, 3.5f}, {-4, -32, -24, 3}};
    static const phantom_knot mesenteric_vein[] = {{-12, -22, 62, 6}, {-8, -30, 30, 5}, {-12, -34, -24, 4}};
    static const phantom_knot portal[] = {{-12, -22, 62, 7}, {-24, -16, 74, 7}, {-38, -8, 84, 6.5f}};
    static const phantom_knot splenic[] = {{-12, -22, 62, 5}, {20, -16, 72, 4.5f}, {56, 14, 88, 4}, {86, 26, 96, 3.5f}};
    static const phantom_knot celiac[] = {{11, -2, 84, 4}, {4, -16, 86, 3.5f}, {-20, -20, 80, 3}, {-38, -8, 84, 2.5f}};
    static const phantom_knot renal[] = {{12, 4, 52, 4}, {34, 16, 56, 3.6f}, {56, 28, 58, 3.2f}};
    static const phantom_knot renal_vein[] = {{-20, 4, 54, 5}, {8, -10, 56, 4.5f}, {34, 8, 58, 5}, {56, 26, 62, 4.5f}};
    static const phantom_knot renal_right[] = {{12, 6, 48, 4}, {-22, 20, 46, 3.6f}, {-54, 28, 46, 3.2f}};
    static const phantom_knot renal_vein_right[] = {{-20, 4, 44, 5}, {-38, 14, 46, 5}, {-55, 26, 48, 4.5f}};
    if (!(CHAIN(list, cava, 4) && CHAIN(list, iliac_vein, 4) && CHAIN(list, iliac_vein_right, 4) &&
          CHAIN(list, iliac_artery, 4) && CHAIN(list, iliac_artery_right, 4) && CHAIN(list, mesenteric, 4) &&
          CHAIN(list, mesenteric_vein, 4) && CHAIN(list, portal, 3) && CHAIN(list, splenic, 4) &&
          CHAIN(list, celiac, 4) && CHAIN(list, renal, 3) && CHAIN(list, renal_vein, 3) &&
          CHAIN(list, renal_right, 3) && CHAIN(list, renal_vein_right, 3)))
        return false;
    /* The marked fans of the mesentery run between the loops of the bowel. */
    static const phantom_point fans[] = {{34, -36, -16}, {-40, -38, -6}, {24, -34, -62}, {-36, -34, -58}};
    int before = list->number;
    for (uint32_t f = 0; f < 4; ++f)
        if (!grow(list, (phantom_point){0, -31, f < 2 ? 12.0f : -24.0f}, fans[f], 2.2f, 2, 90 + f)) return false;
    for (int t = before; t < list->number; ++t) list->tubes[t].mark = true;
    return true;
}

static bool make_aorta(phantom_tubes *list)
{
    static const phantom_knot aorta[] = {{8, 14, 155, 11.5f}, {9, 8, 120, 11}, {11, 3, 80, 10.5f}, {12, -1, 40, 9.5f},
                                         {13, -5, 0, 9}, {12, -6, -32, 8.5f}};
    return CHAIN(list, aorta, 6);
}

bool phantom_anatomy_make(phantom_anatomy *anatomy)
{
    const struct {
        phantom_tubes *list;
        bool (*make)(phantom_tubes *list);
    } parts[] = {{&anatomy->muscles, make_muscles}, {&anatomy->ribs, make_ribs},
                 {&anatomy->colon, make_colon},     {&anatomy->small_bowel, make_small_bowel},
                 {&anatomy->stomach, make_stomach}, {&anatomy->liver_vessels, make_liver_vessels},
                 {&anatomy->vessels, make_vessels}, {&anatomy->aorta, make_aorta}};
    int used = 0;
    for (int p = 0; p < (int)(sizeof parts / sizeof *parts); ++p) {
        *parts[p].list =
            (phantom_tubes){anatomy->store + used, 0, (int)(sizeof anatomy->store / sizeof *anatomy->store) - used};
        if (!parts[p].make(parts[p].list)) return false;
        used += parts[p].list->number;
    }
    const phantom_point upright = {0, 0, 1};
    anatomy->liver[0] =
        phantom_ellipsoid_make((phantom_point){-76, 4, 96}, (phantom_point){78, 84, 88}, (phantom_point){0.05f, 0, 1});
    anatomy->liver[1] = phantom_ellipsoid_make((phantom_point){0, -48, 118}, (phantom_point){84, 38, 42},
                                               (phantom_point){-0.25f, 0, 1});
    anatomy->liver[2] = phantom_ellipsoid_make((phantom_point){-22, 12, 112}, (phantom_point){30, 22, 28}, upright);
    anatomy->spleen = phantom_ellipsoid_make((phantom_point){110, 34, 102}, (phantom_point){34, 48, 56},
                                             (phantom_point){-0.2f, 0.25f, 1});
    anatomy->spleen_hollow = phantom_ellipsoid_make((phantom_point){66, 2, 104}, (phantom_point){50, 50, 70}, upright);
    anatomy->tumour = phantom_ellipsoid_make((phantom_point){-104, -14, 78}, (phantom_point){21, 19, 20}, upright);
    for (int side = 0; side < 2; ++side) {
        float x = side ? -1 : 1, z = side ? 46 : 58;
        phantom_point up = {-0.22f * x, 0.16f, 1};
        anatomy->kidney[side] = phantom_ellipsoid_make((phantom_point){68 * x, 38, z}, (phantom_point){27, 23, 54}, up);
        anatomy->sinus[side] = phantom_ellipsoid_make((phantom_point){52 * x, 31, z}, (phantom_point){17, 9, 27}, up);
    }
    return true;
}
