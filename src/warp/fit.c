#include "warp/fit.h"

#include "base/fail.h"
#include "pliant/memory.h"
#include "warp/fit_point.h"

struct pliant_fit {
    fit_view view;
    const pliant_mesh *mesh;
    int num_threads;
    int32_t capacity;         /* of bin_start */
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
                fit->view.tissue[v] = pliant_mesh_locate(fit->mesh, world, weights) >= 0;
            }
}

pliant_status pliant_fit_create(const pliant_mesh *mesh, const pliant_geometry *scan, const double *rest, const pliant_geometry *target,
                                int32_t step, int num_threads, pliant_fit **out)
{
    if (step < 1) return pliant_fail(PLIANT_ERROR_ARGUMENT, "warp: fits are at least 1 voxel apart, not %d", step);
    pliant_fit *fit = pliant_calloc(1, sizeof *fit);
    if (!fit) return pliant_fail_memory("the fit");
    fit_view *view = &fit->view;
    fit->mesh = mesh;
    fit->num_threads = num_threads;
    view->num_nodes = mesh->num_nodes;
    view->rest = rest;
    view->target = *target;
    view->step = step;
    view->deviation = FIT_EDGES_OF_DEVIATION * mean_edge(mesh);
    size_t points = 1;
    for (int d = 0; d < 3; d++) {
        view->scan_size[d] = scan->size[d];
        view->size[d] = (target->size[d] - 1 + step - 1) / step + 1;
        points *= (size_t)view->size[d];
    }
    view->map = pliant_calloc(points, 3 * sizeof *view->map);
    view->tissue = pliant_calloc(pliant_geometry_voxels(scan), 1);
    view->at = pliant_calloc((size_t)mesh->num_nodes, 3 * sizeof *view->at);
    view->bin_node = pliant_calloc((size_t)mesh->num_nodes, sizeof *view->bin_node);
    view->sorted = pliant_calloc((size_t)mesh->num_nodes, 6 * sizeof *view->sorted);
    if (!view->map || !view->tissue || !view->at || !view->sorted || !view->bin_node) {
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
    fit_view *view = &fit->view;
    pliant_free(view->map);
    pliant_free(view->tissue);
    pliant_free(view->at);
    pliant_free(view->sorted);
    pliant_free(view->bin_node);
    pliant_free(view->bin_start);
    pliant_free(fit);
}

/* false: out of memory */
static bool sort_nodes(pliant_fit *fit, const double *positions)
{
    fit_view *view = &fit->view;
    const int32_t nodes = view->num_nodes;
    double low[3] = {INFINITY, INFINITY, INFINITY}, high[3] = {-INFINITY, -INFINITY, -INFINITY};
    for (int32_t n = 0; n < nodes; n++) {
        double *at = view->at + 3 * (size_t)n;
        fit_node_at(&view->target, positions + 3 * (size_t)n, at);
        for (int d = 0; d < 3; d++) {
            low[d] = fmin(low[d], at[d]);
            high[d] = fmax(high[d], at[d]);
        }
    }
    const int32_t count = fit_set_bins(view, low, high);
    if (count + 1 > fit->capacity) {
        int32_t *start = pliant_calloc((size_t)count + 1, sizeof *start);
        if (!start) return false;
        pliant_free(view->bin_start);
        view->bin_start = start;
        fit->capacity = count + 1;
    }
    int32_t *start = view->bin_start;
    memset(start, 0, ((size_t)count + 1) * sizeof *start);
    for (int32_t n = 0; n < nodes; n++) start[fit_flat_bin(view, view->at + 3 * (size_t)n) + 1]++;
    for (int32_t b = 0; b < count; b++) start[b + 1] += start[b];
    /* filled from behind, so that the starts stay and a bin's nodes ascend */
    for (int32_t n = nodes - 1; n >= 0; n--) view->bin_node[--start[fit_flat_bin(view, view->at + 3 * (size_t)n) + 1]] = n;
    for (int32_t b = 0; b < count; b++) start[b] = start[b + 1];
    start[count] = nodes;
    for (int32_t place = 0; place < nodes; place++) fit_set_place(view, place);
    return true;
}

pliant_status pliant_fit_map(pliant_fit *fit, const double *positions)
{
    const fit_view *view = &fit->view;
    if (!sort_nodes(fit, positions)) return pliant_fail_memory("the nodes of the fit; the deformed volume stays as it is");
#pragma omp parallel for num_threads(fit->num_threads) schedule(dynamic)
    for (int32_t row = 0; row < view->size[1] * view->size[2]; row++)
        for (int32_t i = 0; i < view->size[0]; i++)
            fit_point(view, (const int32_t[3]){i, row % view->size[1], row / view->size[1]}, view->map + 3 * ((size_t)i + (size_t)view->size[0] * (size_t)row));
    return PLIANT_OK;
}

bool pliant_fit_at(const pliant_fit *fit, const double target[3], double scan[3]) { return fit_map_at(&fit->view, target, scan); }

const fit_view *pliant_fit_parts(const pliant_fit *fit) { return &fit->view; }

void pliant_fit_draw(const pliant_fit *fit, const raster_source *source, const int32_t bricks[3], void *voxels, uint8_t *changed)
{
    const int32_t *size = fit->view.target.size;
#pragma omp parallel for num_threads(fit->num_threads) schedule(dynamic)
    for (int32_t b = 0; b < bricks[0] * bricks[1] * bricks[2]; b++) {
        int32_t low[3] = {b % bricks[0] * BRICK, b / bricks[0] % bricks[1] * BRICK, b / bricks[0] / bricks[1] * BRICK}, high[3];
        for (int d = 0; d < 3; d++) high[d] = low[d] + BRICK < size[d] ? low[d] + BRICK : size[d];
        bool other = false;
        for (int32_t k = low[2]; k < high[2]; k++)
            for (int32_t j = low[1]; j < high[1]; j++)
                for (int32_t i = low[0]; i < high[0]; i++) {
                    size_t v = (size_t)i + (size_t)size[0] * ((size_t)j + (size_t)size[1] * (size_t)k);
                    other |= fit_draw_voxel(&fit->view, source, (const double[3]){i, j, k}, voxels, v);
                }
        changed[b] = other;
    }
}
