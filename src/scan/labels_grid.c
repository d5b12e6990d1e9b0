/* Resamples labels to the grid of their scan: every voxel of the scan gets the nearest label. Programs that draw labels
 * may flip the axes, crop, or write origins with few digits. An affine map of indices covers all of these cases. */
#include "scan/volume.h"

#include "base/fail.h"

#include <math.h>
#include <stdio.h>

/* Maximum distance of a corner of labels from a voxel of the scan on one grid [voxels]. */
static const double same_grid = 0.05;

/* An affine map of indices: to = at + i step[0] + j step[1] + k step[2]. */
typedef struct index_map {
    double at[3], step[3][3];
} index_map;

static void apply(const index_map *map, const double index[3], double out[3])
{
    for (int d = 0; d < 3; d++)
        out[d] = map->at[d] + index[0] * map->step[0][d] + index[1] * map->step[1][d] + index[2] * map->step[2][d];
}

static index_map map_between(const pliant_geometry *from, const pliant_geometry *to)
{
    index_map map;
    double point[3], index[3] = {0, 0, 0};
    pliant_geometry_to_world(from, index, point);
    pliant_geometry_to_index(to, point, map.at);
    for (int a = 0; a < 3; a++) {
        double one[3] = {a == 0, a == 1, a == 2};
        pliant_geometry_to_world(from, one, point);
        pliant_geometry_to_index(to, point, index);
        for (int d = 0; d < 3; d++) map.step[a][d] = index[d] - map.at[d];
    }
    return map;
}

/* How a label map's grid differs from the scan's. */
typedef struct difference {
    double corner;  /* maximum distance of a corner from its voxel of the scan [voxels] */
    double spacing; /* ratio minus one */
    double angle;   /* between axes [rad] */
} difference;

/* Return the axis of the scan that is nearest to axis a of the labels. */
static int axis_along(const index_map *to_scan, const pliant_geometry *scan, int a)
{
    int along = 0;
    for (int d = 1; d < 3; d++)
        if (fabs(to_scan->step[a][d] * scan->spacing[d]) > fabs(to_scan->step[a][along] * scan->spacing[along]))
            along = d;
    return along;
}

static difference compare(const pliant_geometry *labels, const pliant_geometry *scan, const index_map *to_scan)
{
    difference found = {0, 0, 0};
    int along[3];
    for (int a = 0; a < 3; a++) {
        along[a] = axis_along(to_scan, scan, a);
        if (labels->size[a] == 1) continue;
        double across = 0.0; /* of the axis, squared */
        for (int d = 0; d < 3; d++)
            if (d != along[a]) across += pow(to_scan->step[a][d] * scan->spacing[d], 2);
        const double part = fabs(to_scan->step[a][along[a]] * scan->spacing[along[a]]);
        found.angle = fmax(found.angle, atan2(sqrt(across), part));
        found.spacing = fmax(found.spacing, fabs(labels->spacing[a] / scan->spacing[along[a]] - 1.0));
    }
    for (int corner = 0; corner < 8; corner++) {
        double at[3], index[3], expected[3];
        for (int d = 0; d < 3; d++) expected[d] = round(to_scan->at[d]);
        for (int a = 0; a < 3; a++) {
            at[a] = corner >> a & 1 ? labels->size[a] - 1 : 0;
            expected[along[a]] += copysign(at[a], to_scan->step[a][along[a]]);
        }
        apply(to_scan, at, index);
        for (int d = 0; d < 3; d++) found.corner = fmax(found.corner, fabs(index[d] - expected[d]));
    }
    return found;
}

/* Set index to the nearest voxel; exactly between two: the lower one. Return whether it lies on the grid. */
static bool nearest(const double at[3], const int32_t size[3], size_t index[3])
{
    for (int d = 0; d < 3; d++) {
        const double n = ceil(at[d] - 0.5 - 1e-6); /* rounding errors must not decide between two voxels */
        if (!(n >= 0.0 && n < size[d])) return false;
        index[d] = (size_t)n;
    }
    return true;
}

/* Numbers of voxels. */
typedef struct tally {
    size_t covered;  /* in the scan, and covered by the label map's grid */
    size_t taken;    /* in the scan, and with a label */
    size_t labelled; /* in the label map, and with a label */
    size_t outside;  /* labelled, and outside of the scan */
} tally;

static void fill(const pliant_labels *from, const index_map *to_labels, pliant_labels *to, tally *count)
{
    const int32_t *size = to->geometry.size, *from_size = from->geometry.size;
    const int64_t num_rows = (int64_t)size[1] * size[2];
    size_t covered = 0, taken = 0;
#pragma omp parallel for schedule(static) reduction(+ : covered, taken)
    for (int64_t row = 0; row < num_rows; row++) {
        uint16_t *out = to->voxels + (size_t)row * (size_t)size[0];
        for (int32_t i = 0; i < size[0]; i++) {
            const double index[3] = {i, (double)(row % size[1]), (double)(row / size[1])};
            double at[3];
            size_t n[3];
            apply(to_labels, index, at);
            if (!nearest(at, from_size, n)) continue;
            covered++;
            out[i] = from->voxels[n[0] + (size_t)from_size[0] * (n[1] + (size_t)from_size[1] * n[2])];
            taken += out[i] != 0;
        }
    }
    count->covered = covered;
    count->taken = taken;
}

static void count_labelled(const pliant_labels *labels, const index_map *to_scan, const int32_t scan_size[3],
                           tally *count)
{
    const int32_t *size = labels->geometry.size;
    const int64_t num_rows = (int64_t)size[1] * size[2];
    size_t labelled = 0, outside = 0;
#pragma omp parallel for schedule(static) reduction(+ : labelled, outside)
    for (int64_t row = 0; row < num_rows; row++)
        for (int32_t i = 0; i < size[0]; i++) {
            if (!labels->voxels[(size_t)row * (size_t)size[0] + (size_t)i]) continue;
            const double index[3] = {i, (double)(row % size[1]), (double)(row / size[1])};
            double at[3];
            size_t n[3];
            apply(to_scan, index, at);
            labelled++;
            outside += !nearest(at, scan_size, n);
        }
    count->labelled = labelled;
    count->outside = outside;
}

/* Describe the bounds of a grid, from edge to edge, in patient axes [mm]. */
static void describe_box(const pliant_geometry *geometry, size_t size, char *out)
{
    double low[3] = {HUGE_VAL, HUGE_VAL, HUGE_VAL}, high[3] = {-HUGE_VAL, -HUGE_VAL, -HUGE_VAL};
    for (int corner = 0; corner < 8; corner++) {
        double at[3], point[3];
        for (int d = 0; d < 3; d++) at[d] = corner >> d & 1 ? geometry->size[d] - 0.5 : -0.5;
        pliant_geometry_to_world(geometry, at, point);
        for (int d = 0; d < 3; d++) {
            low[d] = fmin(low[d], 1e3 * point[d]);
            high[d] = fmax(high[d], 1e3 * point[d]);
        }
    }
    snprintf(out, size, "from (%.1f, %.1f, %.1f) to (%.1f, %.1f, %.1f) mm", low[0], low[1], low[2], high[0], high[1],
             high[2]);
}

static pliant_status refuse(const pliant_geometry *labels, const pliant_geometry *scan, const tally *count)
{
    char labels_box[120], scan_box[120];
    describe_box(labels, sizeof labels_box, labels_box);
    describe_box(scan, sizeof scan_box, scan_box);
    return pliant_fail(PLIANT_ERROR_ARGUMENT,
                       "the label map misses the scan: %s; in LPS axes the label map lies %s, the scan %s; use the "
                       "labels of this scan, or register and resample them to its grid (3D Slicer and SimpleITK do)",
                       count->covered ? "no voxel of the scan gets a label" : "their grids do not overlap", labels_box,
                       scan_box);
}

/* Round away digits that are rounding errors. */
static double shown(double value) { return round(1e6 * value) / 1e6; }

static void report(const pliant_geometry *labels, const pliant_geometry *scan, const index_map *to_scan,
                   const difference *off, const tally *count)
{
    if (off->corner > same_grid)
        pliant_log(
            PLIANT_LOG_WARNING,
            "the label map (%d x %d x %d voxels of %.6g x %.6g x %.6g mm) lies on another grid than the scan (%d x %d "
            "x %d voxels of %.6g x %.6g x %.6g mm). Its spacing differs by %.3g %%, axes by %.3g degrees, corners by "
            "up to %.3g voxels. Every voxel of the scan takes the nearest label; check that the labels fit the scan",
            labels->size[0], labels->size[1], labels->size[2], 1e3 * labels->spacing[0], 1e3 * labels->spacing[1],
            1e3 * labels->spacing[2], scan->size[0], scan->size[1], scan->size[2], 1e3 * scan->spacing[0],
            1e3 * scan->spacing[1], 1e3 * scan->spacing[2], shown(100.0 * off->spacing),
            shown(off->angle * 57.29577951308232), off->corner);
    else if (count->covered < pliant_geometry_voxels(scan))
        pliant_log(PLIANT_LOG_INFO,
                   "the label map covers %zu of the %zu voxels of the scan; its voxel (0, 0, 0) is voxel (%.0f, %.0f, "
                   "%.0f) of the scan; there is no label in the rest",
                   count->covered, pliant_geometry_voxels(scan), round(to_scan->at[0]) + 0.0,
                   round(to_scan->at[1]) + 0.0, round(to_scan->at[2]) + 0.0);
    if (count->outside)
        pliant_log(PLIANT_LOG_WARNING, "the label map: %zu of its %zu voxels with a label lie outside the scan",
                   count->outside, count->labelled);
}

pliant_status pliant_labels_to_grid(pliant_labels *labels, const pliant_geometry *grid)
{
    if (pliant_geometry_equal(&labels->geometry, grid)) return PLIANT_OK;
    const index_map to_labels = map_between(grid, &labels->geometry), to_scan = map_between(&labels->geometry, grid);
    const difference off = compare(&labels->geometry, grid, &to_scan);
    tally count = {0};
    pliant_labels out = {0};
    pliant_status status = pliant_labels_create(grid, &out);
    if (status != PLIANT_OK) return status;
    fill(labels, &to_labels, &out, &count);
    count_labelled(labels, &to_scan, grid->size, &count);
    if (count.covered == 0 || (count.taken == 0 && count.labelled > 0)) {
        status = refuse(&labels->geometry, grid, &count);
        pliant_labels_free(&out);
        return status;
    }
    report(&labels->geometry, grid, &to_scan, &off, &count);
    uint16_t *old = labels->voxels;
    labels->geometry = out.geometry;
    labels->voxels = out.voxels;
    out.voxels = old;
    pliant_labels_free(&out);
    return PLIANT_OK;
}
