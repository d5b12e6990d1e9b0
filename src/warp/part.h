/* Assign scan voxels to the parts of cut tissue; shared by CPU and kernels.
 *
 * Around every initial tetrahedron at a cut, each voxel has a label of its carrier: the tetrahedron that it moves with.
 * A rest point belongs to the carrier whose voxels have the largest trilinear weight there. It is interpolated from
 * these voxels alone, so voxels on the other side of the cut do not contribute. Computations are in double precision
 * from the owner's map, so all inner loops give the same result. */
#ifndef PLIANT_WARP_PART_H
#define PLIANT_WARP_PART_H

#include "base/inline.h"

#include <math.h>
#include <stddef.h>
#include <stdint.h>

/* Tolerance for comparing weights. Two carriers may both contain a point between them, but at least one does. */
#define PART_SPARE 1e-3

/* flag in a label: all corners of the cell that begins here have the same label */
#define PART_UNIFORM 0x8000u
#define PART_MAX_LABELS 0x8000

/* Voxels around a tetrahedron: all corners of the scan's cells that it touches. */
typedef struct part_box {
    int32_t low[3], size[3];
    int32_t first; /* index of its first label; order i, j, k */
} part_box;

/* A drawn element: the box of the tetrahedron that it is part of (-1: no cut is near), and its label in the box. */
typedef struct part_element { int32_t box, label; } part_element;

/* Pointers are valid where it runs (CPU or GPU). */
typedef struct part_view {
    int32_t scan_size[3];
    int32_t num_elements;
    const part_element *elements;
    const part_box *boxes;
    const uint16_t *labels; /* with the flag PART_UNIFORM */
} part_view;

/* A cell of the scan and the position inside. */
typedef struct part_cell {
    int32_t low[3];
    double part[3];
} part_cell;

typedef enum part_claim { PART_OTHERS, PART_WHOLE, PART_MASKED } part_claim;

/* Return one scan index of a target voxel's rest position, by an affine map. */
PLIANT_INLINE double part_index(double by_i, double by_j, double by_k, double from, const double voxel[3])
{
    return by_i * voxel[0] + by_j * voxel[1] + by_k * voxel[2] + from;
}

/* Find the cell of an index, clamped to the scan. */
PLIANT_INLINE void part_find_cell(const int32_t size[3], const double index[3], part_cell *out)
{
    PLIANT_UNROLL for (int d = 0; d < 3; d++) {
        const double end = size[d] - 1.0, inside = !(index[d] > 0.0) ? 0.0 : index[d] < end ? index[d] : end;
        out->low[d] = size[d] < 2 ? 0 : inside < end - 1.0 ? (int32_t)inside : size[d] - 2;
        out->part[d] = inside - out->low[d];
    }
}

PLIANT_INLINE double part_weight(const part_cell *cell, int corner)
{
    double weight = 1;
    PLIANT_UNROLL for (int d = 0; d < 3; d++) weight *= corner >> d & 1 ? cell->part[d] : 1 - cell->part[d];
    return weight;
}

/* Return the index of the label of a cell's first corner. */
PLIANT_INLINE int32_t part_first(const part_box *box, const part_cell *cell)
{
    int32_t first = box->first, step = 1;
    PLIANT_UNROLL for (int d = 0; d < 3; d++) {
        const int32_t at = cell->low[d] - box->low[d], last = box->size[d] > 1 ? box->size[d] - 2 : 0;
        first += step * (at < 0 ? 0 : at > last ? last : at);
        step *= box->size[d];
    }
    return first;
}

/* Read the labels of a cell's corners. */
PLIANT_INLINE void part_labels(const part_view *view, const part_box *box, int32_t first, uint16_t out[8])
{
    const int32_t along[3] = {box->size[0] > 1 ? 1 : 0, box->size[1] > 1 ? box->size[0] : 0,
                              box->size[2] > 1 ? box->size[0] * box->size[1] : 0};
    PLIANT_UNROLL for (int c = 0; c < 8; c++) out[c] =
        (uint16_t)(view->labels[first + (c & 1 ? along[0] : 0) + (c & 2 ? along[1] : 0) + (c & 4 ? along[2] : 0)] &
                   ~PART_UNIFORM);
}

/* Return whether a rest point (scan index) belongs to an element; WHOLE: all surrounding voxels do, too. */
PLIANT_INLINE part_claim part_claims(const part_view *view, part_element element, const double index[3])
{
    part_cell cell;
    uint16_t label[8];
    double weight[8], own = 0;
    part_find_cell(view->scan_size, index, &cell);
    const part_box *box = &view->boxes[element.box];
    const int32_t first = part_first(box, &cell);
    if (view->labels[first] & PART_UNIFORM)
        return (view->labels[first] & ~PART_UNIFORM) == (uint32_t)element.label ? PART_WHOLE : PART_OTHERS;
    part_labels(view, box, first, label);
    PLIANT_UNROLL for (int c = 0; c < 8; c++) {
        weight[c] = part_weight(&cell, c);
        own += label[c] == element.label ? weight[c] : 0;
    }
    if (!(own > 0)) return PART_OTHERS;
    PLIANT_UNROLL for (int c = 0; c < 8; c++) {
        if (label[c] == element.label) continue;
        double other = 0;
        PLIANT_UNROLL for (int e = 0; e < 8; e++) other += label[e] == label[c] ? weight[e] : 0;
        if (other > own + PART_SPARE) return PART_OTHERS;
    }
    return PART_MASKED;
}

/* Interpolate trilinearly in a cell with the element's voxels alone; it must have some there.
 * values: at the eight corners */
PLIANT_INLINE double part_value(const part_view *view, part_element element, const part_cell *cell,
                                const double values[8])
{
    uint16_t label[8];
    double sum = 0, weights = 0;
    const part_box *box = &view->boxes[element.box];
    part_labels(view, box, part_first(box, cell), label);
    PLIANT_UNROLL for (int c = 0; c < 8; c++) {
        if (label[c] != element.label) continue;
        const double weight = part_weight(cell, c);
        sum += weight * values[c];
        weights += weight;
    }
    return sum / weights;
}

/* Return the value of the element's voxel with the largest weight. */
PLIANT_INLINE double part_nearest(const part_view *view, part_element element, const part_cell *cell,
                                  const double values[8])
{
    uint16_t label[8];
    double maximum = -1, nearest = 0;
    const part_box *box = &view->boxes[element.box];
    part_labels(view, box, part_first(box, cell), label);
    PLIANT_UNROLL for (int c = 0; c < 8; c++) {
        const double weight = part_weight(cell, c);
        if (label[c] != element.label || !(weight > maximum)) continue;
        maximum = weight;
        nearest = values[c];
    }
    return nearest;
}

#endif
