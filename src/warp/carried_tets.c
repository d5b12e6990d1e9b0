/* Find the carried tetrahedra of a tetrahedron, and how they follow their carriers. */
#include "base/memory.h"
#include "warp/parts_maker.h"

#include <math.h>

/* subdivisions of a cell along each axis, to test whether a carrier has a part of it */
enum { PIECES = 4 };
/* boxes extend this far around their tetrahedra [voxels], at least to the extent of carried tetrahedra */
static const double around = 0.02;

/* ---- positions */

static void find_corners(const part_maker *work, int32_t tet, double out[4][3])
{
    const pliant_mesh *mesh = &work->body->fine;
    for (int v = 0; v < 4; v++)
        pliant_geometry_to_index(work->scan, mesh->rest + 3 * (size_t)mesh->tets[4 * (size_t)tet + v], out[v]);
}

void pliant_parts_shape(const part_maker *work, int32_t tet, part_shape *out)
{
    double edge[3][3], volume = 0;
    find_corners(work, tet, out->corner);
    for (int e = 0; e < 3; e++)
        for (int d = 0; d < 3; d++) edge[e][d] = out->corner[e + 1][d] - out->corner[0][d];
    for (int e = 0; e < 3; e++)
        for (int d = 0; d < 3; d++) {
            const double *p = edge[(e + 1) % 3], *q = edge[(e + 2) % 3];
            out->slope[e + 1][d] = p[(d + 1) % 3] * q[(d + 2) % 3] - p[(d + 2) % 3] * q[(d + 1) % 3];
        }
    for (int d = 0; d < 3; d++) volume += edge[0][d] * out->slope[1][d];
    for (int d = 0; d < 3; d++) {
        for (int v = 1; v < 4; v++) out->slope[v][d] /= volume;
        out->slope[0][d] = -(out->slope[1][d] + out->slope[2][d] + out->slope[3][d]);
    }
    for (int v = 0; v < 4; v++) {
        out->value[v] = v == 0;
        for (int d = 0; d < 3; d++) out->value[v] -= out->slope[v][d] * out->corner[0][d];
    }
}

/* Return whether a shape, extended as carried tetrahedra are, may touch a box, by its planes.
 * low: lower corner of the box */
bool pliant_parts_touches(const part_shape *at, const double low[3], const double size[3])
{
    for (int v = 0; v < 4; v++) {
        double maximum = at->value[v];
        for (int d = 0; d < 3; d++) maximum += part_max_on_interval(at->slope[v][d], low[d], size[d]);
        if (maximum < -PART_GROWTH) return false;
    }
    return true;
}

void pliant_parts_box(const part_maker *work, int32_t tet, part_box *out)
{
    double corner[4][3];
    find_corners(work, tet, corner);
    for (int d = 0; d < 3; d++) {
        double low = INFINITY, high = -INFINITY, margin;
        for (int v = 0; v < 4; v++) {
            low = fmin(low, corner[v][d]);
            high = fmax(high, corner[v][d]);
        }
        margin = around + PART_GROWTH * (high - low);
        const int32_t last = work->voxels->geometry.size[d] - 1;
        out->low[d] = (int32_t)fmin(fmax(floor(low - margin), 0), last > 0 ? last - 1 : 0);
        out->size[d] = (int32_t)fmin(fmax(ceil(high + margin), out->low[d] + (last > 0)), last) - out->low[d] + 1;
    }
}

/* ---- carried tetrahedra */

/* Return whether a label may have a part of a cell within the tetrahedron. */
static bool has_part(const part_maker *work, const int32_t at[3], const int32_t label[8], int32_t wanted)
{
    int32_t different = 0;
    for (int c = 0; c < 8; c++) {
        bool first = true;
        for (int e = 0; e < c; e++) first = first && label[e] != label[c];
        different += first;
    }
    /* if all its corners lie on one side along an axis, its weight is at most theirs */
    const double fraction = 1.0 / different - PART_SPARE, size[3] = {1.0 / PIECES, 1.0 / PIECES, 1.0 / PIECES};
    double begin[3], length[3];
    for (int d = 0; d < 3; d++) {
        int sides = 0;
        for (int c = 0; c < 8; c++) sides |= label[c] == wanted ? 1 << (c >> d & 1) : 0;
        begin[d] = work->box.low[d] + at[d] + (sides == 2 ? fraction : 0);
        length[d] = sides == 3 ? 1 : 1 - fraction;
    }
    if (!pliant_parts_touches(&work->at, begin, length)) return false;
    for (int piece = 0; piece < PIECES * PIECES * PIECES; piece++) {
        const int32_t where[3] = {piece % PIECES, piece / PIECES % PIECES, piece / PIECES / PIECES};
        double low[3], maximum = 0;
        for (int d = 0; d < 3; d++) low[d] = work->box.low[d] + at[d] + (double)where[d] / PIECES;
        if (!pliant_parts_touches(&work->at, low, size)) continue;
        for (int end = 0; end < 8; end++) { /* the maximum is at a corner of the subdivision */
            part_cell cell;
            double sum = 0;
            for (int d = 0; d < 3; d++) cell.part[d] = (double)(where[d] + (end >> d & 1)) / PIECES;
            for (int c = 0; c < 8; c++) sum += label[c] == wanted ? part_weight(&cell, c) : 0;
            maximum = fmax(maximum, sum);
        }
        if (maximum > fraction) return true;
    }
    return false;
}

static bool add_carried_tet(part_maker *work, int32_t label)
{
    part_carried_tet *carried_tet = pliant_parts_grow(&work->carried_tets, 1);
    part_shape by;
    if (!carried_tet) return false;
    carried_tet->host = work->tet;
    carried_tet->carrier = ((const int32_t *)work->carriers.at)[work->first_carrier + label];
    pliant_parts_shape(work, carried_tet->carrier, &by);
    for (int d = 0; d < 3; d++) {
        double middle = 0;
        for (int v = 0; v < 4; v++) middle += 0.25 * work->at.corner[v][d];
        for (int v = 0; v < 4; v++)
            carried_tet->rest[v][d] = work->at.corner[v][d] + PART_GROWTH * (work->at.corner[v][d] - middle);
    }
    for (int v = 0; v < 4; v++)
        for (int n = 0; n < 4; n++) {
            carried_tet->blend[v][n] = by.value[n];
            for (int d = 0; d < 3; d++) carried_tet->blend[v][n] += by.slope[n][d] * carried_tet->rest[v][d];
        }
    return true;
}

/* Find the labels of carriers that are no fragments of this tetrahedron but have a part of it.
 * wanted: (carriers) */
static void find_carried_tets(const part_maker *work, uint8_t *wanted)
{
    const int32_t *size = work->box.size;
    int32_t at[3], last[3], label[8];
    for (int d = 0; d < 3; d++) last[d] = size[d] > 1 ? size[d] - 2 : 0;
    for (at[2] = 0; at[2] <= last[2]; at[2]++)
        for (at[1] = 0; at[1] <= last[1]; at[1]++)
            for (at[0] = 0; at[0] <= last[0]; at[0]++) {
                bool others = false;
                for (int c = 0; c < 8; c++) {
                    int32_t corner[3];
                    for (int d = 0; d < 3; d++) corner[d] = at[d] + (size[d] > 1 ? c >> d & 1 : 0);
                    label[c] = work->label[part_index_of(size, corner)];
                    others = others || label[c] >= work->num_fragments;
                }
                for (int c = 0; c < 8 && others; c++)
                    if (label[c] >= work->num_fragments && !wanted[label[c]] && has_part(work, at, label, label[c]))
                        wanted[label[c]] = 1;
            }
}

pliant_status pliant_parts_add_carried_tets(part_maker *work)
{
    if (work->num_carriers == work->num_fragments) return PLIANT_OK;
    uint8_t *wanted = pliant_calloc((size_t)work->num_carriers, 1);
    bool good = wanted != NULL;
    if (good) find_carried_tets(work, wanted);
    for (int32_t n = work->num_fragments; good && n < work->num_carriers; n++)
        good = !wanted[n] || add_carried_tet(work, n);
    pliant_free(wanted);
    return good ? PLIANT_OK : pliant_parts_no_memory();
}
