#include "warp/fit.h"

#include "core/fail.h"
#include "pliant/memory.h"

#include <math.h>
#include <string.h>

enum { TERMS = 10, LINEAR = 4, ENOUGH = 16 /* nodes, for the 10 terms */, ATTEMPTS = 2 };

/* Gaussian of one mean edge's width, cut off where it is 2 %; the support of a regular point then holds some 60 nodes */
static const double edges_of_deviation = 0.9, cut_off = 2.8;

struct pliant_fit {
    const pliant_mesh *mesh;
    const double *rest;
    pliant_geometry target;
    int32_t scan_size[3], step, size[3]; /* of the lattice of fits */
    int num_threads;
    double deviation;         /* [m] */
    float *map;               /* (lattice x 3) index in the scan; NaN where no node is near */
    uint8_t *tissue;          /* (scan voxels) 1: the mesh holds it */
    /* NODES by bins, in metres along the target's axes */
    double low[3], width;
    int32_t bins[3];
    int32_t *bin_start, *bin_node;
    int32_t capacity;         /* of bin_start */
    double *at;               /* (num_nodes x 3) */
};

static double mean_edge(const pliant_mesh *mesh)
{
    double sum = 0;
    for (int32_t t = 0; t < mesh->num_tets; t++)
        for (int a = 0; a < 4; a++)
            for (int b = 0; b < a; b++) {
                const double *p = mesh->rest + 3 * mesh->tets[4 * t + a], *q = mesh->rest + 3 * mesh->tets[4 * t + b];
                sum += sqrt(pow(p[0] - q[0], 2) + pow(p[1] - q[1], 2) + pow(p[2] - q[2], 2));
            }
    return sum / (6.0 * mesh->num_tets);
}

static void mark_tissue(pliant_fit *fit, const pliant_geometry *scan)
{
#pragma omp parallel for num_threads(fit->num_threads) schedule(dynamic)
    for (int32_t k = 0; k < scan->size[2]; k++)
        for (int32_t j = 0; j < scan->size[1]; j++)
            for (int32_t i = 0; i < scan->size[0]; i++) {
                double world[3], weights[4];
                pliant_geometry_to_world(scan, (const double[3]){i, j, k}, world);
                size_t v = (size_t)i + (size_t)scan->size[0] * ((size_t)j + (size_t)scan->size[1] * (size_t)k);
                fit->tissue[v] = pliant_mesh_locate(fit->mesh, world, weights) >= 0;
            }
}

pliant_status pliant_fit_create(const pliant_mesh *mesh, const pliant_geometry *scan, const double *rest, const pliant_geometry *target,
                                int32_t step, int num_threads, pliant_fit **out)
{
    if (step < 1) return pliant_fail(PLIANT_ERROR_ARGUMENT, "warp: fits are at least 1 voxel apart, not %d", step);
    pliant_fit *fit = pliant_calloc(1, sizeof *fit);
    if (!fit) return pliant_fail_memory("the fit");
    fit->mesh = mesh;
    fit->rest = rest;
    fit->target = *target;
    fit->step = step;
    fit->num_threads = num_threads;
    fit->deviation = edges_of_deviation * mean_edge(mesh);
    size_t points = 1;
    for (int d = 0; d < 3; d++) {
        fit->scan_size[d] = scan->size[d];
        fit->size[d] = (target->size[d] - 1 + step - 1) / step + 1;
        points *= (size_t)fit->size[d];
    }
    fit->map = pliant_calloc(points, 3 * sizeof *fit->map);
    fit->tissue = pliant_calloc(pliant_geometry_voxels(scan), 1);
    fit->at = pliant_calloc((size_t)mesh->num_nodes, 3 * sizeof *fit->at);
    fit->bin_node = pliant_calloc((size_t)mesh->num_nodes, sizeof *fit->bin_node);
    if (!fit->map || !fit->tissue || !fit->at || !fit->bin_node) {
        pliant_fit_free(fit);
        return pliant_fail_memory("the fit");
    }
    mark_tissue(fit, scan);
    *out = fit;
    return PLIANT_OK;
}

void pliant_fit_free(pliant_fit *fit)
{
    if (!fit) return;
    pliant_free(fit->map);
    pliant_free(fit->tissue);
    pliant_free(fit->at);
    pliant_free(fit->bin_node);
    pliant_free(fit->bin_start);
    pliant_free(fit);
}

static int32_t bin_of(const pliant_fit *fit, int d, double at)
{
    double bin = (at - fit->low[d]) / fit->width;
    return bin < 0 ? 0 : bin >= fit->bins[d] ? fit->bins[d] - 1 : (int32_t)bin;
}

static size_t flat_bin(const pliant_fit *fit, const double at[3])
{
    return (size_t)bin_of(fit, 0, at[0]) +
           (size_t)fit->bins[0] * ((size_t)bin_of(fit, 1, at[1]) + (size_t)fit->bins[1] * (size_t)bin_of(fit, 2, at[2]));
}

/* false: out of memory */
static bool sort_nodes(pliant_fit *fit, const double *positions)
{
    const int32_t nodes = fit->mesh->num_nodes;
    double high[3] = {-INFINITY, -INFINITY, -INFINITY}, count = 1;
    for (int d = 0; d < 3; d++) fit->low[d] = INFINITY;
    for (int32_t n = 0; n < nodes; n++) {
        double *at = fit->at + 3 * (size_t)n;
        pliant_geometry_to_index(&fit->target, positions + 3 * (size_t)n, at);
        for (int d = 0; d < 3; d++) {
            at[d] *= fit->target.spacing[d];
            fit->low[d] = fmin(fit->low[d], at[d]);
            high[d] = fmax(high[d], at[d]);
        }
    }
    const double most = 128; /* bins along an axis: a node that flew away makes them wider, not more */
    fit->width = cut_off * fit->deviation;
    for (int d = 0; d < 3; d++) fit->width = fmax(fit->width, (high[d] - fit->low[d]) / most);
    for (int d = 0; d < 3; d++) {
        fit->bins[d] = (int32_t)((high[d] - fit->low[d]) / fit->width) + 1;
        count *= fit->bins[d];
    }
    if ((int32_t)count + 1 > fit->capacity) {
        int32_t *start = pliant_calloc((size_t)count + 1, sizeof *start);
        if (!start) return false;
        pliant_free(fit->bin_start);
        fit->bin_start = start;
        fit->capacity = (int32_t)count + 1;
    }
    memset(fit->bin_start, 0, ((size_t)count + 1) * sizeof *fit->bin_start);
    for (int32_t n = 0; n < nodes; n++) fit->bin_start[flat_bin(fit, fit->at + 3 * (size_t)n) + 1]++;
    for (int32_t b = 0; b < (int32_t)count; b++) fit->bin_start[b + 1] += fit->bin_start[b];
    /* filled from behind, so that the starts stay and a bin's nodes ascend */
    for (int32_t n = nodes - 1; n >= 0; n--) {
        size_t bin = flat_bin(fit, fit->at + 3 * (size_t)n);
        int32_t *end = fit->bin_start + bin + 1;
        fit->bin_node[--*end] = n;
    }
    for (int32_t b = 0; b < (int32_t)count; b++) fit->bin_start[b] = fit->bin_start[b + 1];
    fit->bin_start[(int32_t)count] = nodes;
    return true;
}

typedef struct normal_equations {
    double matrix[TERMS][TERMS], right[TERMS][3];
    int32_t nodes;
} normal_equations;

static void add_node(const pliant_fit *fit, int32_t n, const double apart[3], double weight, normal_equations *out)
{
    const double x = apart[0], y = apart[1], z = apart[2];
    const double term[TERMS] = {1, x, y, z, x * x, y * y, z * z, x * y, x * z, y * z};
    const double *value = fit->rest + 3 * (size_t)n;
    for (int r = 0; r < TERMS; r++) {
        double weighted = weight * term[r];
        for (int c = 0; c <= r; c++) out->matrix[r][c] += weighted * term[c];
        for (int d = 0; d < 3; d++) out->right[r][d] += weighted * value[d];
    }
    out->nodes++;
}

static void gather(const pliant_fit *fit, const double p[3], double deviation, normal_equations *out)
{
    const double reach = cut_off * deviation;
    int32_t first[3], last[3];
    memset(out, 0, sizeof *out);
    for (int d = 0; d < 3; d++) {
        if (p[d] + reach < fit->low[d] || p[d] - reach > fit->low[d] + fit->bins[d] * fit->width) return;
        first[d] = bin_of(fit, d, p[d] - reach);
        last[d] = bin_of(fit, d, p[d] + reach);
    }
    for (int32_t c = first[2]; c <= last[2]; c++)
        for (int32_t b = first[1]; b <= last[1]; b++) {
            size_t row = (size_t)fit->bins[0] * ((size_t)b + (size_t)fit->bins[1] * (size_t)c);
            for (int32_t s = fit->bin_start[row + (size_t)first[0]]; s < fit->bin_start[row + (size_t)last[0] + 1]; s++) {
                const double *at = fit->at + 3 * (size_t)fit->bin_node[s];
                double apart[3] = {(at[0] - p[0]) / deviation, (at[1] - p[1]) / deviation, (at[2] - p[2]) / deviation};
                double square = apart[0] * apart[0] + apart[1] * apart[1] + apart[2] * apart[2];
                if (square < cut_off * cut_off) add_node(fit, fit->bin_node[s], apart, exp(-0.5 * square), out);
            }
        }
}

/* Value of the fitted polynomial at its origin, by Cholesky of the leading `terms`; false: the nodes do not determine so many. */
static bool solve(const normal_equations *equations, int terms, double out[3])
{
    double l[TERMS][TERMS], y[TERMS][3];
    for (int r = 0; r < terms; r++)
        for (int c = 0; c <= r; c++) {
            double sum = equations->matrix[r][c];
            for (int k = 0; k < c; k++) sum -= l[r][k] * l[c][k];
            if (c < r) l[r][c] = sum / l[c][c];
            else if (!(sum > 1e-6 * equations->matrix[r][r])) return false;
            else l[r][r] = sqrt(sum);
        }
    for (int d = 0; d < 3; d++) {
        for (int r = 0; r < terms; r++) {
            y[r][d] = equations->right[r][d];
            for (int k = 0; k < r; k++) y[r][d] -= l[r][k] * y[k][d];
            y[r][d] /= l[r][r];
        }
        for (int r = terms - 1; r >= 0; r--) {
            for (int k = r + 1; k < terms; k++) y[r][d] -= l[k][r] * y[k][d];
            y[r][d] /= l[r][r];
        }
        out[d] = y[0][d];
    }
    return true;
}

/* Where few nodes are near, at larger cells and beside the tissue, the kernel is widened once. */
static void fit_point(const pliant_fit *fit, const double p[3], float out[3])
{
    normal_equations equations;
    double deviation = fit->deviation, value[3];
    for (int attempt = 0; attempt < ATTEMPTS; attempt++, deviation *= 2) {
        gather(fit, p, deviation, &equations);
        if (equations.nodes >= ENOUGH && solve(&equations, TERMS, value)) {
            for (int d = 0; d < 3; d++) out[d] = (float)value[d];
            return;
        }
    }
    bool some = equations.nodes >= LINEAR && solve(&equations, LINEAR, value);
    for (int d = 0; d < 3; d++) out[d] = some ? (float)value[d] : NAN;
}

pliant_status pliant_fit_map(pliant_fit *fit, const double *positions)
{
    const int32_t *size = fit->size;
    if (!sort_nodes(fit, positions)) return pliant_fail_memory("the nodes of the fit; the deformed volume stays as it is");
#pragma omp parallel for num_threads(fit->num_threads) schedule(dynamic)
    for (int32_t row = 0; row < size[1] * size[2]; row++)
        for (int32_t i = 0; i < size[0]; i++) {
            const int32_t at[3] = {i, row % size[1], row / size[1]};
            double p[3];
            for (int d = 0; d < 3; d++) p[d] = (double)at[d] * fit->step * fit->target.spacing[d];
            fit_point(fit, p, fit->map + 3 * ((size_t)i + (size_t)size[0] * (size_t)row));
        }
    return PLIANT_OK;
}

bool pliant_fit_at(const pliant_fit *fit, const double target[3], double scan[3])
{
    int32_t low[3];
    double part[3];
    for (int d = 0; d < 3; d++) {
        double at = fmin(fmax(target[d] / fit->step, 0), fit->size[d] - 1);
        low[d] = fit->size[d] > 1 ? (int32_t)fmin(floor(at), fit->size[d] - 2) : 0;
        part[d] = at - low[d];
    }
    memset(scan, 0, 3 * sizeof *scan);
    for (int corner = 0; corner < 8; corner++) {
        double weight = 1;
        size_t flat = 0;
        for (int d = 2; d >= 0; d--) {
            int upper = corner >> d & 1;
            weight *= upper ? part[d] : 1 - part[d];
            flat = flat * (size_t)fit->size[d] + (size_t)(low[d] + upper);
        }
        if (weight == 0) continue;
        for (int d = 0; d < 3; d++) scan[d] += weight * fit->map[3 * flat + (size_t)d];
    }
    return !isnan(scan[0]);
}

/* the scan's value at an index inside it, trilinear, in its own type */
static double sample(const raster_source *source, const double index[3])
{
    ptrdiff_t at = 0;
    double part[3], value = 0;
    for (int d = 0; d < 3; d++) {
        double inside = fmin(fmax(index[d], 0), source->size[d] - 1);
        int32_t low = source->size[d] > 1 ? (int32_t)fmin(floor(inside), source->size[d] - 2) : 0;
        part[d] = inside - low;
        at += low * source->step[d];
    }
    for (int corner = 0; corner < 8; corner++) {
        ptrdiff_t place = at;
        double weight = 1;
        for (int d = 0; d < 3; d++) {
            place += corner >> d & 1 ? source->step[d] : 0;
            weight *= corner >> d & 1 ? part[d] : 1 - part[d];
        }
        switch (source->encoding) {
        case PLIANT_UINT8: value += weight * ((const uint8_t *)source->voxels)[place]; break;
        case PLIANT_INT16: value += weight * ((const int16_t *)source->voxels)[place]; break;
        case PLIANT_FLOAT32: value += weight * (double)((const float *)source->voxels)[place]; break;
        }
    }
    return value;
}

static bool in_tissue(const pliant_fit *fit, const double index[3])
{
    size_t at[3];
    for (int d = 0; d < 3; d++) {
        double nearest = floor(index[d] + 0.5);
        if (!(nearest >= 0 && nearest < fit->scan_size[d])) return false;
        at[d] = (size_t)nearest;
    }
    return fit->tissue[at[0] + (size_t)fit->scan_size[0] * (at[1] + (size_t)fit->scan_size[1] * at[2])];
}

/* one voxel; true when it is another than before */
static bool draw_voxel(const pliant_fit *fit, const raster_source *source, const double target[3], void *voxels, size_t v)
{
    double index[3];
    bool inside = pliant_fit_at(fit, target, index) && in_tissue(fit, index);
    double value = inside ? sample(source, index) : 0;
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

void pliant_fit_draw(const pliant_fit *fit, const raster_source *source, const int32_t bricks[3], void *voxels, uint8_t *changed)
{
    const int32_t *size = fit->target.size;
#pragma omp parallel for num_threads(fit->num_threads) schedule(dynamic)
    for (int32_t b = 0; b < bricks[0] * bricks[1] * bricks[2]; b++) {
        int32_t low[3] = {b % bricks[0] * BRICK, b / bricks[0] % bricks[1] * BRICK, b / bricks[0] / bricks[1] * BRICK}, high[3];
        for (int d = 0; d < 3; d++) high[d] = low[d] + BRICK < size[d] ? low[d] + BRICK : size[d];
        bool other = false;
        for (int32_t k = low[2]; k < high[2]; k++)
            for (int32_t j = low[1]; j < high[1]; j++)
                for (int32_t i = low[0]; i < high[0]; i++) {
                    size_t v = (size_t)i + (size_t)size[0] * ((size_t)j + (size_t)size[1] * (size_t)k);
                    other |= draw_voxel(fit, source, (const double[3]){i, j, k}, voxels, v);
                }
        changed[b] = other;
    }
}
