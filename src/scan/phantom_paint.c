#include "scan/phantom_anatomy.h"

static bool is_free(const phantom_row *row, int n) { return row->tissue[n] == PHANTOM_ORGAN_CAPACITY; }

/* --- Skin, fat and muscle wall. --- */

static void paint_wall(phantom_row *row)
{
    for (int n = 0; n < row->n; ++n) {
        float x = row->position_x[n], y = row->position_y[n], z = row->position_z[n], fat, muscle;
        float depth = phantom_depth(x, y, z), clump = row->clump[n], grain = row->grain[n];
        phantom_wall(x, y, z, &fat, &muscle);
        if (depth < 2.4f) phantom_put(row, n, depth < 0 ? PHANTOM_AIR : PHANTOM_skin, 45);
        else if (depth < fat) phantom_put(row, n, PHANTOM_fat, -104 + 6 * clump + (grain > 0.7f ? 25 : 0));
        else if (depth > muscle)
            phantom_put(row, n, PHANTOM_ORGAN_CAPACITY, -100 + 6 * clump + (grain > 0.6f ? 30 : 0));
        else {
            float layer = (depth - fat) / (muscle - fat), across = x < 0 ? -x : x;
            /* The flank has three muscle layers; back and buttock have layers of fat. */
            bool flank = y < 40 && across > 84 && z > -60;
            bool between = flank ? (layer > 0.33f && layer < 0.41f) || (layer > 0.67f && layer < 0.74f)
                                 : y > 30 && clump > -0.035f && clump < 0.035f;
            phantom_put(row, n, PHANTOM_muscle, between ? -55 : 58 + 7 * grain);
        }
        /* A voxel at the body's surface contains air and tissue. Inside, borders of tissues coincide with borders of
         * voxels. */
        float part = phantom_clamp(0.5f + depth / row->voxel, 0, 1);
        if (part < 1) row->value[n] = (int16_t)(PHANTOM_AIR_VALUE + part * (float)(row->value[n] - PHANTOM_AIR_VALUE));
    }
}

static void paint_muscles(const phantom_tubes *list, phantom_row *row)
{
    bool any = phantom_measure(list, row);
    for (int n = 0; n < row->n; ++n) {
        if (!is_free(row, n)) continue;
        /* The deep back muscles are adjacent to the spine, and behind the sacrum. */
        float x = row->position_x[n] < 0 ? -row->position_x[n] : row->position_x[n], z = row->position_z[n];
        bool deep =
            x < 56 && row->position_y[n] > phantom_spine_y(z) + 19 + 0.2f * x + (z < -80 ? 0.8f * (-80 - z) : 0);
        if (deep || (any && row->near[n] < 0)) phantom_put(row, n, PHANTOM_muscle, 60 + 7 * row->grain[n]);
    }
}

static void paint_ribs(const phantom_tubes *list, phantom_row *row)
{
    if (!phantom_measure(list, row)) return;
    for (int n = 0; n < row->n; ++n) {
        if (row->tissue[n] == PHANTOM_AIR || row->tissue[n] == PHANTOM_skin) continue;
        if (row->near[n] < 0) phantom_put(row, n, PHANTOM_rib, row->near[n] > -1.6f ? 620 : 230 + 40 * row->grain[n]);
        else if (row->near[n] < 4 && is_free(row, n)) phantom_put(row, n, PHANTOM_muscle, 56);
    }
}

/* --- Organs. --- */

static void paint_kidneys(const phantom_anatomy *anatomy, phantom_row *row)
{
    for (int side = 0; side < 2; ++side) {
        const phantom_ellipsoid *kidney = &anatomy->kidney[side], *sinus = &anatomy->sinus[side];
        int first, end;
        if (row->z < kidney->centre.z - 75 || row->z > kidney->centre.z + 75 || row->y < -10 || row->y > 90) continue;
        phantom_span(row, kidney->centre.x - 50, kidney->centre.x + 50, &first, &end);
        for (int n = first; n < end; ++n) {
            if (!is_free(row, n)) continue;
            float x = row->position_x[n], y = row->position_y[n], z = row->position_z[n];
            float distance = phantom_ellipsoid_distance(kidney, x, y, z),
                  hollow = phantom_ellipsoid_distance(sinus, x, y, z);
            if (distance < 0 && hollow > 0) {
                bool pyramid = distance < -6.5f && hollow > 2.5f && row->clump[n] > 0.05f;
                phantom_put(row, n, side ? PHANTOM_kidney_right : PHANTOM_kidney_left,
                            (pyramid ? 150 : 192) + 6 * row->grain[n]);
            } else if (distance < 7 || hollow < 0) {
                phantom_put(row, n, PHANTOM_KEPT_FREE, hollow < -4 ? 15 : -98);
            }
        }
    }
}

static void paint_vessels(const phantom_tubes *list, phantom_row *row, int tissue, float value, bool marked)
{
    if (!phantom_measure(list, row)) return;
    for (int n = 0; n < row->n; ++n)
        if (row->near[n] < 0 && list->tubes[row->nearest[n]].mark == marked &&
            (is_free(row, n) || row->tissue[n] == PHANTOM_KEPT_FREE))
            phantom_put(row, n, tissue, value + 4 * row->grain[n]);
}

static float liver_distance(const phantom_anatomy *anatomy, float x, float y, float z)
{
    float distance = phantom_ellipsoid_distance(&anatomy->liver[0], x, y, z);
    distance = phantom_blend(distance, phantom_ellipsoid_distance(&anatomy->liver[1], x, y, z), 22);
    distance = phantom_blend(distance, phantom_ellipsoid_distance(&anatomy->liver[2], x, y, z), 12);
    /* The lower surface rises from the right flank to the left lobe. */
    distance = -phantom_blend(-distance, -0.9f * (10 + 0.46f * (x + 140) - z), 12);
    /* The cleft in front separates the lobes. */
    float cleft = (x - 16) * (x - 16) + 0.12f * (y + 90) * (y + 90);
    return cleft < 20 ? 1 : distance;
}

static void paint_liver(const phantom_anatomy *anatomy, phantom_row *row)
{
    bool any = false;
    if (row->z < -15) return;
    for (int n = 0; n < row->n; ++n) {
        float x = row->position_x[n], y = row->position_y[n], z = row->position_z[n];
        if (!is_free(row, n) || liver_distance(anatomy, x, y, z) >= 0) continue;
        float tumour = phantom_ellipsoid_distance(&anatomy->tumour, x, y, z) + 2.5f * row->clump[n];
        any = true;
        if (tumour >= 0) phantom_put(row, n, PHANTOM_liver, 108 + 4 * row->grain[n] + 3 * row->clump[n]);
        else phantom_put(row, n, PHANTOM_tumour, tumour > -3 ? 88 : tumour < -9 ? 48 + 12 * row->grain[n] : 68);
    }
    if (!any || !phantom_measure(&anatomy->liver_vessels, row)) return;
    for (int n = 0; n < row->n; ++n)
        if (row->near[n] < 0 && row->tissue[n] == PHANTOM_liver) phantom_put(row, n, PHANTOM_vessel, 170);
}

static void paint_spleen(const phantom_anatomy *anatomy, phantom_row *row)
{
    int first, end;
    if (row->z < 30) return;
    phantom_span(row, 60, 160, &first, &end);
    for (int n = first; n < end; ++n) {
        float x = row->position_x[n], y = row->position_y[n], z = row->position_z[n];
        if (is_free(row, n) && phantom_ellipsoid_distance(&anatomy->spleen, x, y, z) < 0 &&
            phantom_ellipsoid_distance(&anatomy->spleen_hollow, x, y, z) > 0)
            phantom_put(row, n, PHANTOM_spleen, 124 + 5 * row->grain[n]);
    }
}

/* Paint a hollow organ: wall, and gas, fluid or stool. */
static void paint_gut(const phantom_tubes *list, phantom_row *row, float wall, float content, float lumps)
{
    if (!phantom_measure(list, row)) return;
    for (int n = 0; n < row->n; ++n) {
        if (!is_free(row, n) || row->near[n] >= 0) continue;
        const phantom_tube *tube = &list->tubes[row->nearest[n]];
        bool inside = row->near[n] < -wall && row->second[n] - row->near[n] > wall;
        if (!inside) phantom_put(row, n, PHANTOM_bowel, 92);
        else if (row->y < tube->level) phantom_put(row, n, PHANTOM_bowel_gas, -990);
        else phantom_put(row, n, PHANTOM_bowel, content + lumps * row->grain[n]);
    }
}

void phantom_paint(const phantom_anatomy *anatomy, phantom_row *row)
{
    paint_wall(row);
    paint_muscles(&anatomy->muscles, row);
    paint_ribs(&anatomy->ribs, row);
    phantom_paint_hips(row);
    phantom_paint_spine(row);
    paint_kidneys(anatomy, row);
    paint_vessels(&anatomy->aorta, row, PHANTOM_aorta, 185, false);
    paint_vessels(&anatomy->vessels, row, PHANTOM_vessel, 168, false);
    paint_liver(anatomy, row);
    paint_spleen(anatomy, row);
    paint_gut(&anatomy->stomach, row, 3.8f, 20, 10);
    paint_gut(&anatomy->colon, row, 2.4f, 30, 55);
    paint_gut(&anatomy->small_bowel, row, 2.2f, 28, 8);
    paint_vessels(&anatomy->vessels, row, PHANTOM_vessel, 168, true);
    for (int n = 0; n < row->n; ++n)
        if (row->tissue[n] >= PHANTOM_ORGAN_CAPACITY) row->tissue[n] = PHANTOM_fat;
}
