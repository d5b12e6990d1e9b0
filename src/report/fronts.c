/* Choose points to pull at: fronts of organs, or of the body. The front is anterior (-y in LPS). */
#include "base/threads.h"
#include "base/memory.h"
#include "report/rows.h"
#include "sim/build/model.h"

#include <ctype.h>
#include <math.h>
#include <stdio.h>
#include <string.h>

/* Lengths for a patient [m]; for other bodies they are scaled (pliant_length_scale). */
static const double inside = 0.006; /* depth of a pulled point behind the front */
/* maximum distance from the line through an organ's centre; minimum distance between fronts of a body */
static const double near = 0.01;

/* voxels of one label or material */
typedef struct front_voxels {
    const pliant_geometry *geometry;
    const uint16_t *labels; /* Nullable */
    const uint8_t *materials;
    int32_t wanted;
    double scale; /* scale of lengths */
} front_voxels;

static bool is_wanted(const front_voxels *voxels, size_t v)
{
    return voxels->labels ? voxels->labels[v] == voxels->wanted : voxels->materials[v] == voxels->wanted;
}

static void world_of(const pliant_geometry *geometry, size_t v, double world[3])
{
    size_t nx = (size_t)geometry->size[0], ny = (size_t)geometry->size[1];
    double index[3] = {(double)(v % nx), (double)(v / nx % ny), (double)(v / (nx * ny))};
    pliant_geometry_to_world(geometry, index, world);
}

/* Find the most anterior voxel near the line through the centroid; false: none. */
static bool find_front(const front_voxels *voxels, double out[3])
{
    size_t size = pliant_geometry_voxels(voxels->geometry), count = 0;
    double centre[3] = {0, 0, 0}, world[3], best = INFINITY;
    for (size_t v = 0; v < size; v++) {
        if (!is_wanted(voxels, v)) continue;
        world_of(voxels->geometry, v, world);
        for (int d = 0; d < 3; d++) centre[d] += world[d];
        count++;
    }
    for (int d = 0; d < 3; d++) centre[d] /= (double)count;
    for (size_t v = 0; count > 0 && v < size; v++) {
        if (!is_wanted(voxels, v)) continue;
        world_of(voxels->geometry, v, world);
        if (hypot(world[0] - centre[0], world[2] - centre[2]) > near * voxels->scale || world[1] >= best) continue;
        best = world[1];
        memcpy(out, world, sizeof world);
    }
    if (!isfinite(best)) return false;
    out[1] += inside * voxels->scale;
    return true;
}

static bool contains(const char *text, const char *word)
{
    for (; *text; text++) {
        size_t c = 0;
        while (word[c] && tolower((unsigned char)text[c]) == word[c]) c++;
        if (!word[c]) return true;
    }
    return false;
}

static int organ_fronts(const pliant_report_input *input, front_voxels *voxels, int maximum, pliant_pull_point *out)
{
    static const char *const organs[][2] = {{"liver", "liver"}, {"colon", "bowel"}, {"kidney", "kidney"}};
    int found = 0;
    for (size_t o = 0; o < sizeof organs / sizeof *organs; o++)
        for (uint32_t m = 0; found < maximum && m < input->materials->num_materials; m++) {
            const char *name = input->materials->materials[m].name;
            voxels->wanted = (int32_t)m;
            if (input->materials->materials[m].fixed || input->materials->materials[m].empty) continue;
            if (!(contains(name, organs[o][0]) || contains(name, organs[o][1])) || !find_front(voxels, out[found].rest))
                continue;
            snprintf(out[found++].name, sizeof out->name, "%.31s", organs[o][0]);
            break;
        }
    return found;
}

/* ---- front of the body */

typedef struct front_column { double world[3]; } front_column;

/* For every line of voxels from anterior to posterior, find the first soft voxel behind at least `inside` of tissue. */
static size_t body_columns(const pliant_report_input *input, const uint8_t *materials, double scale, front_column *out)
{
    const pliant_geometry *g = &input->scan->geometry;
    int along = 0;
    for (int v = 1; v < 3; v++)
        if (fabs(g->direction[3 + v]) > fabs(g->direction[3 + along])) along = v;
    int a = (along + 1) % 3, b = (along + 2) % 3, forward = g->direction[3 + along] > 0 ? 1 : -1;
    size_t stride[3] = {1, (size_t)g->size[0], (size_t)g->size[0] * (size_t)g->size[1]}, count = 0;
    int32_t deep = (int32_t)fmax(ceil(inside * scale / g->spacing[along]), 1);
    for (int32_t p = 0; p < g->size[a]; p++)
        for (int32_t q = 0; q < g->size[b]; q++)
            for (int32_t n = 0, tissue = 0; n < g->size[along]; n++) {
                int32_t at = forward > 0 ? n : g->size[along] - 1 - n;
                size_t voxel = (size_t)at * stride[along] + (size_t)p * stride[a] + (size_t)q * stride[b];
                const pliant_material *material = input->materials->materials + materials[voxel];
                tissue = material->empty ? 0 : tissue + 1;
                if (material->fixed) break; /* bone behind thin skin: no soft tissue to pull at */
                if (tissue <= deep) continue;
                world_of(g, voxel, out[count++].world);
                break;
            }
    return count;
}

/* Choose the column nearest to the centre, then repeatedly the column farthest from the chosen ones, within the central
 * two thirds of the body. */
static int body_fronts(const pliant_report_input *input, const uint8_t *materials, double scale, int maximum,
                       pliant_pull_point *out)
{
    const pliant_geometry *g = &input->scan->geometry;
    size_t voxels = pliant_geometry_voxels(g), shortest = (size_t)g->size[0];
    for (int d = 1; d < 3; d++) shortest = (size_t)g->size[d] < shortest ? (size_t)g->size[d] : shortest;
    front_column *columns = pliant_calloc(voxels / shortest, sizeof *columns);
    if (!columns) return 0;
    size_t count = body_columns(input, materials, scale, columns);
    double middle[3] = {0, 0, 0}, reach[3] = {0, 0, 0};
    for (size_t c = 0; c < count; c++)
        for (int d = 0; d < 3; d++) middle[d] += columns[c].world[d] / (double)count;
    for (size_t c = 0; c < count; c++)
        for (int d = 0; d < 3; d++) reach[d] = fmax(reach[d], fabs(columns[c].world[d] - middle[d]));
    int found = 0;
    for (; found < maximum; found++) {
        double best = -INFINITY;
        size_t taken = count;
        for (size_t c = 0; c < count; c++) {
            const double *w = columns[c].world;
            if (fabs(w[0] - middle[0]) > 0.6 * reach[0] || fabs(w[2] - middle[2]) > 0.6 * reach[2]) continue;
            double score = found ? INFINITY : -hypot(w[0] - middle[0], w[2] - middle[2]);
            for (int f = 0; f < found; f++) score = fmin(score, hypot(w[0] - out[f].rest[0], w[2] - out[f].rest[2]));
            if (score <= best || (found && score < near * scale)) continue;
            best = score;
            taken = c;
        }
        if (taken == count) break;
        memcpy(out[found].rest, columns[taken].world, sizeof out->rest);
        snprintf(out[found].name, sizeof out->name, "front %d", found + 1);
    }
    pliant_free(columns);
    return found;
}

int pliant_pull_points(const pliant_report_input *input, const int32_t *labels, int num_labels, int maximum,
                       pliant_pull_point *out)
{
    size_t voxels = pliant_geometry_voxels(&input->scan->geometry);
    uint8_t *materials = pliant_calloc(voxels, 1);
    int found = 0;
    if (!materials) return 0;
    front_voxels kind = {.geometry = &input->scan->geometry, .materials = materials};
    int threads = pliant_threads_begin(input->scene->solver.threads);
    pliant_status status = pliant_material_classify(input->materials, input->scan, input->labels, materials);
    pliant_threads_end(threads);
    if (status >= 0) status = pliant_length_scale(input->scan, input->labels, input->materials, &kind.scale);
    if (status < 0) goto done;
    if (num_labels > 0) {
        if (!input->labels) goto done;
        kind.labels = input->labels->voxels;
        for (int n = 0; n < num_labels && found < maximum; n++) {
            kind.wanted = labels[n];
            if (find_front(&kind, out[found].rest))
                snprintf(out[found++].name, sizeof out->name, "label %d", (int)labels[n]);
        }
        goto done;
    }
    found = organ_fronts(input, &kind, maximum, out);
    if (found == 0) found = body_fronts(input, materials, kind.scale, maximum, out);
done:
    pliant_free(materials);
    return found;
}
