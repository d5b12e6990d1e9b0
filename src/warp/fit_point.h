/* One point of the fit, and one voxel drawn by it, shared by CPU and kernels. The normal equations have a condition
 * number of 1e4 and more. In single precision the error would be tenths of a voxel, so double precision is used.
 * Without fused operations and with a common exponential function, CPU and GPU give bitwise identical results. */
#ifndef PLIANT_WARP_FIT_POINT_H
#define PLIANT_WARP_FIT_POINT_H

#include "base/inline.h"
#include "warp/part_sample.h"

#include <math.h>
#include <string.h>

enum {
    FIT_TERMS = 10,
    FIT_PADDED = 12, /* a multiple of the vector length */
    FIT_LINEAR = 4,
    FIT_MIN_NODES = 16, /* minimum number of nodes for the 10 terms */
    FIT_ATTEMPTS = 2,
    FIT_DRAWN = 2
};

/* Standard deviation of the Gaussian in mean edge lengths. It is truncated where it falls to 2 %; the support of an
 * interior point then contains about 60 nodes. */
#define FIT_EDGES_OF_DEVIATION 0.9
#define FIT_CUT_OFF 2.8
#define FIT_MAX_BINS 128.0 /* along each axis */
/* Voxels are drawn up to this distance around the tetrahedra [voxels]. Farther away the extrapolated polynomials can
 * turn back into the tissue. */
#define FIT_MARGIN 1.0

/* Data of a fit; pointers are valid where it runs (CPU or GPU). */
typedef struct fit_view {
    pliant_geometry target;
    int32_t scan_size[3], step, size[3]; /* size: number of lattice points of the fit */
    double deviation;         /* [m] */
    int32_t num_nodes, num_tets;
    const int32_t *tets;      /* (num_tets x 4) */
    const double *rest;       /* (num_nodes x 3) index in the scan */
    uint8_t *tissue;          /* (scan voxels) 1: inside the mesh */
    uint8_t *covered;         /* (target voxels) 1: in or next to a tetrahedron; FIT_DRAWN: already drawn */
    uint8_t *wanted;          /* (lattice) 1: next to covered voxels */
    float *map;               /* (lattice x 3) scan index; NaN where it is not needed or no node is near */
    /* NODES sorted into bins, in metres along the target's axes */
    double low[3], width;
    int32_t bins[3];
    int32_t *bin_start, *bin_node;
    double *at;               /* (num_nodes x 3) */
    double *sorted;           /* (num_nodes x 6) by bins: deformed position and rest index of a node */
    /* CUTS; NULL: no cuts */
    int32_t num_elements;
    const uint8_t *zone;      /* (num_elements) number of corners near a cut */
    const uint8_t *near;      /* (num_nodes) 1: within the kernel's reach of a cut */
} fit_view;

/* Return whether the fit determines the voxels of a tetrahedron.
 * only_wanted: at least for a part of it */
PLIANT_INLINE bool fit_covers(const fit_view *fit, int32_t tet, bool only_wanted)
{
    return !fit->zone || fit->zone[tet] < (only_wanted ? 4 : 1);
}

PLIANT_INLINE int32_t fit_bin_of(const fit_view *fit, int d, double at)
{
    double bin = (at - fit->low[d]) / fit->width;
    return !(bin >= 0) ? 0 : bin >= fit->bins[d] ? fit->bins[d] - 1 : (int32_t)bin;
}

PLIANT_INLINE size_t fit_flat_bin(const fit_view *fit, const double at[3])
{
    return (size_t)fit_bin_of(fit, 0, at[0]) +
           (size_t)fit->bins[0] *
               ((size_t)fit_bin_of(fit, 1, at[1]) + (size_t)fit->bins[1] * (size_t)fit_bin_of(fit, 2, at[2]));
}

/* Compute a node's position along the target's axes [m]: pliant_geometry_to_index times the spacing. */
PLIANT_INLINE void fit_node_at(const pliant_geometry *target, const double position[3], double at[3])
{
    double offset[3];
    for (int d = 0; d < 3; d++) offset[d] = position[d] - target->origin[d];
    for (int d = 0; d < 3; d++) {
        const double *axis = target->direction + d;
        at[d] =
            (axis[0] * offset[0] + axis[3] * offset[1] + axis[6] * offset[2]) / target->spacing[d] * target->spacing[d];
    }
}

/* Copy the data of a node to its position in the sorted array. */
PLIANT_INLINE void fit_set_place(const fit_view *fit, int32_t place)
{
    const size_t node = (size_t)fit->bin_node[place];
    for (int d = 0; d < 3; d++) {
        fit->sorted[6 * (size_t)place + (size_t)d] = fit->at[3 * node + (size_t)d];
        fit->sorted[6 * (size_t)place + 3 + (size_t)d] = fit->rest[3 * node + (size_t)d];
    }
}

/* Set the bins from the bounding box of the nodes, limited to the target plus the widest kernel. Nodes outside fall
 * into the outermost bins, which no query uses. Return the number of bins. */
PLIANT_INLINE int32_t fit_set_bins(fit_view *fit, const double low[3], const double high[3])
{
    const double reach = FIT_CUT_OFF * fit->deviation * (1 << (FIT_ATTEMPTS - 1));
    double count = 1, length[3];
    fit->width = FIT_CUT_OFF * fit->deviation;
    for (int d = 0; d < 3; d++) {
        const double end = fit->target.size[d] * fit->target.spacing[d] + reach;
        fit->low[d] = fmin(fmax(low[d], -reach), end);
        length[d] = fmax(fmin(high[d], end) - fit->low[d], 0.0);
        fit->width = fmax(fit->width, length[d] / FIT_MAX_BINS);
    }
    for (int d = 0; d < 3; d++) {
        fit->bins[d] = (int32_t)(length[d] / fit->width) + 1;
        count *= fit->bins[d];
    }
    return (int32_t)count;
}

/* A deformed tetrahedron in target voxels: its bounding box and planes, extended by FIT_MARGIN. Inside every plane
 * normal . voxel + value >= 0. */
typedef struct fit_tet {
    double low[3], high[3], normal[4][3], value[4];
} fit_tet;

/* Compute it; fit->at must be set. Return false if it is flat. */
PLIANT_INLINE bool fit_tet_at(const fit_view *fit, int32_t tet, fit_tet *out)
{
    const int32_t *node = fit->tets + 4 * (size_t)tet;
    double at[4][3];
    for (int v = 0; v < 4; v++)
        for (int d = 0; d < 3; d++) at[v][d] = fit->at[3 * (size_t)node[v] + (size_t)d] / fit->target.spacing[d];
    for (int d = 0; d < 3; d++) {
        out->low[d] = fmin(fmin(at[0][d], at[1][d]), fmin(at[2][d], at[3][d])) - FIT_MARGIN;
        out->high[d] = fmax(fmax(at[0][d], at[1][d]), fmax(at[2][d], at[3][d])) + FIT_MARGIN;
    }
    PLIANT_UNROLL for (int v = 0; v < 4; v++) { /* the plane through the other three nodes */
        const double *a = at[(v + 1) % 4], *b = at[(v + 2) % 4], *c = at[(v + 3) % 4], *own = at[v];
        double first[3], second[3], normal[3], square = 0, side = 0;
        for (int d = 0; d < 3; d++) {
            first[d] = b[d] - a[d];
            second[d] = c[d] - a[d];
        }
        for (int d = 0; d < 3; d++) {
            normal[d] = first[(d + 1) % 3] * second[(d + 2) % 3] - first[(d + 2) % 3] * second[(d + 1) % 3];
            square += normal[d] * normal[d];
            side += normal[d] * (own[d] - a[d]);
        }
        const double length = side > 0 ? sqrt(square) : -sqrt(square);
        if (!(side != 0) || !(square > 0) || !(square < INFINITY)) return false;
        out->value[v] = FIT_MARGIN;
        for (int d = 0; d < 3; d++) {
            out->normal[v][d] = normal[d] / length;
            out->value[v] -= out->normal[v][d] * a[d];
        }
    }
    return true;
}

/* Find the integers from low to high within [0, size - 1]; false: none. */
PLIANT_INLINE bool fit_range(double low, double high, int32_t size, int32_t *first, int32_t *last)
{
    if (!(high >= 0.0) || !(low <= size - 1.0)) return false;
    *first = low > 0.0 ? (int32_t)ceil(low) : 0;
    *last = high < size - 1.0 ? (int32_t)high : size - 1;
    return *first <= *last;
}

/* Mark the lattice points of the cells that a tetrahedron's box touches, in slices begin to end. Several threads may
 * write the same value. */
PLIANT_INLINE void fit_mark_needed_points(const fit_view *fit, const fit_tet *tet, int32_t begin, int32_t end)
{
    int32_t first[3], last[3];
    for (int d = 0; d < 3; d++)
        if (!fit_range(floor(tet->low[d] / fit->step), floor(tet->high[d] / fit->step) + 1.0, fit->size[d], first + d,
                       last + d))
            return;
    for (int32_t c = first[2] > begin ? first[2] : begin; c <= last[2] && c < end; c++)
        for (int32_t b = first[1]; b <= last[1]; b++)
            for (int32_t a = first[0]; a <= last[0]; a++)
                fit->wanted[(size_t)a + (size_t)fit->size[0] * ((size_t)b + (size_t)fit->size[1] * (size_t)c)] = 1;
}

/* Mark a tetrahedron's voxels of one row. Several threads may write the same value. */
PLIANT_INLINE void fit_cover_row(const fit_view *fit, const fit_tet *tet, int32_t j, int32_t k)
{
    double low = tet->low[0], high = tet->high[0];
    int32_t first, last;
    PLIANT_UNROLL for (int v = 0; v < 4; v++) {
        const double slope = tet->normal[v][0], value = tet->value[v] + tet->normal[v][1] * j + tet->normal[v][2] * k;
        if (slope > 0) low = fmax(low, -value / slope);
        else if (slope < 0) high = fmin(high, -value / slope);
        else if (value < 0) return;
    }
    if (!fit_range(low, high, fit->target.size[0], &first, &last)) return;
    uint8_t *row = fit->covered + (size_t)fit->target.size[0] * ((size_t)j + (size_t)fit->target.size[1] * (size_t)k);
    for (int32_t i = first; i <= last; i++) row[i] = 1;
}

/* Return an upper bound of the result of fit_set_bins. */
PLIANT_INLINE size_t fit_max_bins(const fit_view *fit)
{
    const double width = FIT_CUT_OFF * fit->deviation, reach = width * (1 << (FIT_ATTEMPTS - 1));
    size_t count = 1;
    for (int d = 0; d < 3; d++)
        count *= (size_t)fmin((fit->target.size[d] * fit->target.spacing[d] + 2 * reach) / width, FIT_MAX_BINS) + 2;
    return count;
}

/* Return exp(-square / 2) for squares up to FIT_CUT_OFF^2: 2^-k times the Taylor series of the remainder, accurate to
 * 1e-11. */
PLIANT_INLINE double fit_gaussian(double square)
{
    const double half = 0.5 * square;
    const int k = (int)(half * 1.4426950408889634 + 0.5);
    const double r = k * 0.693147180369123816490 + k * 1.90821492927058770002e-10 - half;
    const double part[10] = {0, 1, 1.0 / 2, 1.0 / 3, 1.0 / 4, 1.0 / 5, 1.0 / 6, 1.0 / 7, 1.0 / 8, 1.0 / 9};
    double sum = 1;
    PLIANT_UNROLL for (int n = 9; n > 0; n--) sum = 1 + sum * (r * part[n]);
    return sum / (double)(1 << k);
}

typedef struct normal_equations {
    double matrix[FIT_TERMS][FIT_PADDED], right[3][FIT_PADDED]; /* only the lower triangle of the matrix is used */
    int32_t nodes;
} normal_equations;

PLIANT_INLINE void fit_add_node(const double *value, const double offset[3], double weight, normal_equations *out)
{
    const double x = offset[0], y = offset[1], z = offset[2];
    const double term[FIT_PADDED] = {1, x, y, z, x * x, y * y, z * z, x * y, x * z, y * z};
    double weighted[FIT_PADDED];
    PLIANT_UNROLL for (int c = 0; c < FIT_PADDED; c++) weighted[c] = weight * term[c];
    PLIANT_UNROLL for (int r = 0; r < FIT_TERMS; r++)
        PLIANT_UNROLL for (int c = 0; c < FIT_PADDED; c++) out->matrix[r][c] += weighted[r] * term[c];
    PLIANT_UNROLL for (int d = 0; d < 3; d++)
        PLIANT_UNROLL for (int c = 0; c < FIT_PADDED; c++) out->right[d][c] += weighted[c] * value[d];
    out->nodes++;
}

PLIANT_INLINE void fit_gather(const fit_view *fit, const double p[3], double deviation, normal_equations *out)
{
    const double reach = FIT_CUT_OFF * deviation, inverse = 1 / deviation;
    int32_t first[3], last[3];
    memset(out, 0, sizeof *out);
    for (int d = 0; d < 3; d++) {
        if (p[d] + reach < fit->low[d] || p[d] - reach > fit->low[d] + fit->bins[d] * fit->width) return;
        first[d] = fit_bin_of(fit, d, p[d] - reach);
        last[d] = fit_bin_of(fit, d, p[d] + reach);
    }
    for (int32_t c = first[2]; c <= last[2]; c++)
        for (int32_t b = first[1]; b <= last[1]; b++) {
            size_t row = (size_t)fit->bins[0] * ((size_t)b + (size_t)fit->bins[1] * (size_t)c);
            for (int32_t s = fit->bin_start[row + (size_t)first[0]]; s < fit->bin_start[row + (size_t)last[0] + 1];
                 s++) {
                const double *at = fit->sorted + 6 * (size_t)s;
                double offset[3] = {(at[0] - p[0]) * inverse, (at[1] - p[1]) * inverse, (at[2] - p[2]) * inverse};
                double square = offset[0] * offset[0] + offset[1] * offset[1] + offset[2] * offset[2];
                /* All nearby nodes are assumed to be on the point's side: within reach of a cut no fit is used
                 * (pliant_fit_next). */
                if (square < FIT_CUT_OFF * FIT_CUT_OFF) fit_add_node(at + 3, offset, fit_gaussian(square), out);
            }
        }
}

/* Return the value of the fitted polynomial at its origin, by a Cholesky factorization of the leading `terms`. Return
 * false if the nodes do not determine these terms. */
PLIANT_INLINE bool fit_solve(const normal_equations *equations, const int terms, double out[3])
{
    double l[FIT_TERMS][FIT_TERMS], y[FIT_TERMS][3];
    PLIANT_UNROLL for (int r = 0; r < terms; r++)
        PLIANT_UNROLL for (int c = 0; c <= r; c++) {
            double sum = equations->matrix[r][c];
            PLIANT_UNROLL for (int k = 0; k < c; k++) sum -= l[r][k] * l[c][k];
            if (c < r) l[r][c] = sum / l[c][c];
            else if (!(sum > 1e-6 * equations->matrix[r][r])) return false;
            else l[r][r] = sqrt(sum);
        }
    PLIANT_UNROLL for (int d = 0; d < 3; d++) {
        PLIANT_UNROLL for (int r = 0; r < terms; r++) {
            y[r][d] = equations->right[d][r];
            PLIANT_UNROLL for (int k = 0; k < r; k++) y[r][d] -= l[r][k] * y[k][d];
            y[r][d] /= l[r][r];
        }
        PLIANT_UNROLL for (int r = terms - 1; r >= 0; r--) {
            PLIANT_UNROLL for (int k = r + 1; k < terms; k++) y[r][d] -= l[k][r] * y[k][d];
            y[r][d] /= l[r][r];
        }
        out[d] = y[0][d];
    }
    return true;
}

/* Fit one lattice point. If few nodes are near, as in larger cells, the kernel is widened once. */
PLIANT_INLINE void fit_point(const fit_view *fit, const int32_t lattice[3], float out[3])
{
    normal_equations equations;
    double deviation = fit->deviation, value[3], p[3];
    for (int d = 0; d < 3; d++) out[d] = NAN;
    if (!fit->wanted[(size_t)lattice[0] +
                     (size_t)fit->size[0] * ((size_t)lattice[1] + (size_t)fit->size[1] * (size_t)lattice[2])])
        return;
    for (int d = 0; d < 3; d++) p[d] = (double)lattice[d] * fit->step * fit->target.spacing[d];
    for (int attempt = 0; attempt < FIT_ATTEMPTS; attempt++, deviation *= 2) {
        fit_gather(fit, p, deviation, &equations);
        if (equations.nodes >= FIT_MIN_NODES && fit_solve(&equations, FIT_TERMS, value)) {
            for (int d = 0; d < 3; d++) out[d] = (float)value[d];
            return;
        }
    }
    bool some = equations.nodes >= FIT_LINEAR && fit_solve(&equations, FIT_LINEAR, value);
    for (int d = 0; some && d < 3; d++) out[d] = (float)value[d];
}

/* Return the lattice point below a target coordinate, and the fraction of the distance to the next one. */
PLIANT_INLINE int32_t fit_below(const fit_view *fit, int d, double target, double *part)
{
    const double at = target / fit->step, end = fit->size[d] - 1.0, inside = !(at > 0.0) ? 0.0 : at < end ? at : end;
    const int32_t low = fit->size[d] < 2 ? 0 : inside < end - 1.0 ? (int32_t)inside : fit->size[d] - 2;
    *part = inside - low;
    return low;
}

/* Interpolate the map between four rows at lattice point i, along k, then along j. */
PLIANT_INLINE void fit_between_rows(const fit_view *fit, int32_t i, const int32_t low[3], const double part[3],
                                    double out[3])
{
    const size_t across = (size_t)fit->size[0], up = fit->size[1] > 1 ? across : 0,
                 above = fit->size[2] > 1 ? across * (size_t)fit->size[1] : 0;
    const float *map = fit->map + 3 * ((size_t)i + across * ((size_t)low[1] + (size_t)fit->size[1] * (size_t)low[2]));
    for (int d = 0; d < 3; d++) {
        const double a = map[d], b = map[3 * up + (size_t)d], c = map[3 * above + (size_t)d],
                     e = map[3 * (up + above) + (size_t)d];
        const double near = a + part[2] * (c - a), far = b + part[2] * (e - b);
        out[d] = near + part[1] * (far - near);
    }
}

/* Interpolate between two lattice points along i. */
PLIANT_INLINE bool fit_between(const double left[3], const double right[3], double part, double scan[3])
{
    for (int d = 0; d < 3; d++) scan[d] = left[d] + part * (right[d] - left[d]);
    return scan[0] == scan[0];
}

/* Compute the scan index of the rest position of a target point (continuous index). Return false if no node is near
 * enough. */
PLIANT_INLINE bool fit_map_at(const fit_view *fit, const double target[3], double scan[3])
{
    int32_t low[3];
    double part[3], left[3], right[3];
    for (int d = 0; d < 3; d++) low[d] = fit_below(fit, d, target[d], part + d);
    fit_between_rows(fit, low[0], low, part, left);
    fit_between_rows(fit, fit->size[0] > 1 ? low[0] + 1 : low[0], low, part, right);
    return fit_between(left, right, part[0], scan);
}

/* Interpolate the scan trilinearly at an index inside it; the result is rounded as in the scan's type. */
PLIANT_INLINE double fit_sample(const raster_source *source, const double index[3])
{
    ptrdiff_t at = 0;
    double part[3], value = 0;
    for (int d = 0; d < 3; d++) {
        const double end = source->size[d] - 1.0, inside = !(index[d] > 0.0) ? 0.0 : index[d] < end ? index[d] : end;
        const int32_t low = source->size[d] < 2 ? 0 : inside < end - 1.0 ? (int32_t)inside : source->size[d] - 2;
        part[d] = inside - low;
        at += low * source->step[d];
    }
    PLIANT_UNROLL for (int corner = 0; corner < 8; corner++) {
        ptrdiff_t place = at;
        double weight = 1;
        PLIANT_UNROLL for (int d = 0; d < 3; d++) {
            place += corner >> d & 1 ? source->step[d] : 0;
            weight *= corner >> d & 1 ? part[d] : 1 - part[d];
        }
        value += weight * raster_stored(source, place);
    }
    return value;
}

PLIANT_INLINE bool fit_in_tissue(const fit_view *fit, const double index[3])
{
    size_t at[3];
    for (int d = 0; d < 3; d++) {
        const double nearest = index[d] + 0.5;
        if (!(nearest >= 0 && nearest < fit->scan_size[d])) return false;
        at[d] = (size_t)nearest;
    }
    return fit->tissue[at[0] + (size_t)fit->scan_size[0] * (at[1] + (size_t)fit->scan_size[1] * at[2])];
}

/* Write a voxel or the background. Return whether it has changed. */
PLIANT_INLINE bool fit_put_voxel(const raster_source *source, double value, bool inside, void *voxels, size_t v)
{
    if (source->encoding == PLIANT_UINT8) {
        uint8_t now = inside ? (uint8_t)lrint(value) : source->background.u8, *voxel = (uint8_t *)voxels + v;
        bool other = *voxel != now;
        *voxel = now;
        return other;
    }
    if (source->encoding == PLIANT_INT16) {
        int16_t now = inside ? (int16_t)lrint(value) : source->background.i16, *voxel = (int16_t *)voxels + v;
        bool other = *voxel != now;
        *voxel = now;
        return other;
    }
    float now = inside ? (float)value : source->background.f32, *voxel = (float *)voxels + v;
    bool other = *voxel != now;
    *voxel = now;
    return other;
}

/* Write a voxel from its rest position if known, otherwise the background. Return whether it has changed. */
PLIANT_INLINE bool fit_draw_voxel(const fit_view *fit, const raster_source *source, bool known, const double index[3],
                                  void *voxels, size_t v)
{
    const bool inside = known && fit_in_tissue(fit, index);
    return fit_put_voxel(source, inside ? fit_sample(source, index) : 0, inside, voxels, v);
}

/* Compute the scan index of a voxel in a zone element. If not all of its corners are near a cut, the element's own map
 * (input in index) is blended with the fit. */
PLIANT_INLINE void fit_blend(const fit_view *fit, int32_t element, const double voxel[3], double index[3])
{
    double fitted[3], near = 0;
    if (fit->zone[element] == 4 || !fit_map_at(fit, voxel, fitted)) return;
    const int32_t *node = fit->tets + 4 * (size_t)element;
    double at[3][3], inverse[3][3], from[3], weight[4] = {1, 0, 0, 0};
    const double *first = fit->rest + 3 * (size_t)node[0];
    for (int v = 0; v < 3; v++)
        for (int d = 0; d < 3; d++) at[d][v] = fit->rest[3 * (size_t)node[v + 1] + (size_t)d] - first[d];
    double determinant = 0;
    PLIANT_UNROLL for (int r = 0; r < 3; r++) PLIANT_UNROLL for (int c = 0; c < 3; c++) inverse[c][r] =
        at[(r + 1) % 3][(c + 1) % 3] * at[(r + 2) % 3][(c + 2) % 3] -
        at[(r + 1) % 3][(c + 2) % 3] * at[(r + 2) % 3][(c + 1) % 3];
    for (int d = 0; d < 3; d++) {
        determinant += at[0][d] * inverse[d][0];
        from[d] = index[d] - first[d];
    }
    for (int v = 0; v < 3; v++) {
        for (int d = 0; d < 3; d++) weight[v + 1] += inverse[v][d] * from[d] / determinant;
        weight[0] -= weight[v + 1];
    }
    for (int v = 0; v < 4; v++) near += fit->near[node[v]] ? weight[v] : 0;
    for (int d = 0; d < 3; d++) index[d] = fitted[d] + near * (index[d] - fitted[d]);
}

/* Write a voxel of a zone element from its own map's index. Return whether it has changed. */
PLIANT_INLINE bool fit_draw_owned(const fit_view *fit, const part_view *parts, const raster_source *source,
                                  int32_t element, const double voxel[3], double index[3], void *voxels, size_t v)
{
    fit_blend(fit, element, voxel, index);
    const part_element of = parts->elements[element];
    const bool masked = of.box >= 0 && part_claims(parts, of, index) == PART_MASKED;
    const double value = masked ? part_sample(source, parts, of, index) : fit_sample(source, index);
    return fit_put_voxel(source, value, true, voxels, v);
}

#endif
