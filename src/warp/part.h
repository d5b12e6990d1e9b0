/* Whose voxel of the scan is whose, where tissue is cut: the same lines for the CPU and for kernels.
 *
 * Around every tetrahedron at load that a cut passes, each voxel has a label: the carrier that it moves with. A rest point of that
 * tetrahedron is its carrier's whose voxels weigh most in trilinear interpolation there, and it is interpolated from those alone: of the
 * voxels on the other side of a cut nothing is seen. In double, from the owner's map, so that it does not matter which loops draw. */
#ifndef PLIANT_WARP_PART_H
#define PLIANT_WARP_PART_H

#include "base/inline.h"

#include <math.h>
#include <stddef.h>
#include <stdint.h>

/* Weights are compared with this much to spare: two carriers may both hold a point between them, but never none. */
#define PART_SPARE 1e-3

/* in a label: those of all corners of the cell that begins there are the same */
#define PART_UNIFORM 0x8000u
#define PART_MOST_LABELS 0x8000

/* The voxels around a tetrahedron: all corners of the cells of the scan that it touches. */
typedef struct part_box {
    int32_t low[3], size[3];
    int32_t first; /* of its labels; along i, j, k */
} part_box;

/* Of what is drawn as one: the box of the tetrahedron that it is a part of, -1 where no cut is near, and its label there. */
typedef struct part_element { int32_t box, label; } part_element;

/* Pointers are of where it runs. */
typedef struct part_view {
    int32_t scan_size[3];
    int32_t num_elements;
    const part_element *elements;
    const part_box *boxes;
    const uint16_t *labels; /* with PART_UNIFORM */
} part_view;

/* A cell of the scan, and where in it. */
typedef struct part_cell {
    int32_t low[3];
    double part[3];
} part_cell;

typedef enum part_claim { PART_OTHERS, PART_WHOLE, PART_MASKED } part_claim;

/* One index of the scan where a voxel of the target was, by an affine map. */
PLIANT_INLINE double part_index(double by_i, double by_j, double by_k, double from, const double voxel[3])
{
    return by_i * voxel[0] + by_j * voxel[1] + by_k * voxel[2] + from;
}

/* Limited as the scan is. */
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

/* where the label of a cell's first corner is */
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

/* labels of a cell's corners */
PLIANT_INLINE void part_labels(const part_view *view, const part_box *box, int32_t first, uint16_t out[8])
{
    const int32_t along[3] = {box->size[0] > 1 ? 1 : 0, box->size[1] > 1 ? box->size[0] : 0, box->size[2] > 1 ? box->size[0] * box->size[1] : 0};
    PLIANT_UNROLL for (int c = 0; c < 8; c++)
        out[c] = (uint16_t)(view->labels[first + (c & 1 ? along[0] : 0) + (c & 2 ? along[1] : 0) + (c & 4 ? along[2] : 0)] & ~PART_UNIFORM);
}

/* Whether a rest point (index in the scan) is an element's; WHOLE: all voxels around it are, too. */
PLIANT_INLINE part_claim part_claims(const part_view *view, part_element element, const double index[3])
{
    part_cell cell;
    uint16_t label[8];
    double weight[8], own = 0;
    part_find_cell(view->scan_size, index, &cell);
    const part_box *box = &view->boxes[element.box];
    const int32_t first = part_first(box, &cell);
    if (view->labels[first] & PART_UNIFORM) return (view->labels[first] & ~PART_UNIFORM) == (uint32_t)element.label ? PART_WHOLE : PART_OTHERS;
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

/* Trilinear interpolation in a cell of an element's voxels alone; it has some there. values: of the eight corners */
PLIANT_INLINE double part_value(const part_view *view, part_element element, const part_cell *cell, const double values[8])
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

/* The value of the one of an element's own voxels that weighs most there. */
PLIANT_INLINE double part_nearest(const part_view *view, part_element element, const part_cell *cell, const double values[8])
{
    uint16_t label[8];
    double most = -1, nearest = 0;
    const part_box *box = &view->boxes[element.box];
    part_labels(view, box, part_first(box, cell), label);
    PLIANT_UNROLL for (int c = 0; c < 8; c++) {
        const double weight = part_weight(cell, c);
        if (label[c] != element.label || !(weight > most)) continue;
        most = weight;
        nearest = values[c];
    }
    return nearest;
}

#endif
