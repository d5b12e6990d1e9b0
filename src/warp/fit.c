#include "warp/fit.h"

#include "base/fail.h"
#include "base/memory.h"
#include "mesh/mesh.h"
#include "warp/fit_point.h"

/* Vectorized code for the machine's instruction set, chosen at program start. Fused operations are disabled
 * (CMakeLists.txt), so all variants give bitwise identical results. */
#if defined(__x86_64__) && defined(__GNUC__) && !defined(__clang__) && !defined(__SANITIZE_ADDRESS__) && \
    !defined(__SANITIZE_THREAD__)
#define FIT_VECTORIZED __attribute__((target_clones("avx512f", "avx2", "default")))
#else
#define FIT_VECTORIZED
#endif

/* number of mesh edges within which the kernel can reach both sides of a copied node */
enum { ZONE_EDGES = 3 };

struct pliant_fit {
    fit_view view;
    const pliant_mesh *mesh;
    int num_threads;
    const pliant_parts *parts;
    uint8_t *near, *zone; /* non-const pointers to arrays of the view */
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

static pliant_status allocate(const pliant_mesh *mesh, const fit_view *from, const double *rest, int num_threads,
                              pliant_fit **out)
{
    pliant_fit *fit = pliant_calloc(1, sizeof *fit);
    if (!fit) return pliant_fail_memory("the fit");
    fit_view *view = &fit->view;
    fit->mesh = mesh;
    fit->num_threads = num_threads;
    view->num_nodes = mesh->num_nodes;
    view->rest = rest;
    view->target = from->target;
    view->step = from->step;
    view->num_tets = mesh->num_tets;
    view->tets = mesh->tets;
    view->deviation = from->deviation;
    size_t points = 1, scan = 1;
    for (int d = 0; d < 3; d++) {
        view->scan_size[d] = from->scan_size[d];
        view->size[d] = (from->target.size[d] - 1 + from->step - 1) / from->step + 1;
        points *= (size_t)view->size[d];
        scan *= (size_t)from->scan_size[d];
    }
    view->map = pliant_calloc(points, 3 * sizeof *view->map);
    view->wanted = pliant_calloc(points, 1);
    view->covered = pliant_calloc(pliant_geometry_voxels(&from->target), 1);
    view->tissue = pliant_calloc(scan, 1);
    view->at = pliant_calloc((size_t)mesh->num_nodes, 3 * sizeof *view->at);
    view->bin_node = pliant_calloc((size_t)mesh->num_nodes, sizeof *view->bin_node);
    view->bin_start = pliant_calloc(fit_max_bins(view) + 1, sizeof *view->bin_start);
    view->sorted = pliant_calloc((size_t)mesh->num_nodes, 6 * sizeof *view->sorted);
    if (!view->map || !view->wanted || !view->covered || !view->tissue || !view->at || !view->sorted ||
        !view->bin_node || !view->bin_start) {
        pliant_fit_free(fit);
        return pliant_fail_memory("the fit");
    }
    *out = fit;
    return PLIANT_OK;
}

pliant_status pliant_fit_create(const pliant_mesh *mesh, const pliant_geometry *scan, const double *rest,
                                const pliant_geometry *target, int32_t step, int num_threads, pliant_fit **out)
{
    if (step < 1) return pliant_fail(PLIANT_ERROR_ARGUMENT, "warp: fits are at least 1 voxel apart, not %d", step);
    fit_view from = {.target = *target, .step = step, .deviation = FIT_EDGES_OF_DEVIATION * mean_edge(mesh)};
    memcpy(from.scan_size, scan->size, sizeof from.scan_size);
    pliant_status status = allocate(mesh, &from, rest, num_threads, out);
    if (status == PLIANT_OK) mark_tissue(*out, scan);
    return status;
}

/* Mark nodes near a cut: copied nodes, their copies, and the corners of tetrahedra at the cut; then all nodes within
 * ZONE_EDGES edges. */
static void find_near(const pliant_body *body, const pliant_parts *parts, uint8_t *near)
{
    const pliant_mesh *mesh = &body->fine;
    for (int32_t n = 0; body->node_parent && n < mesh->num_nodes; n++)
        if (body->node_parent[n] != n) near[n] = near[body->node_parent[n]] = 1;
    for (int32_t t = 0; t < mesh->num_tets; t++)
        for (int v = 0; v < 4 && parts->view.elements[t].box >= 0; v++) near[mesh->tets[4 * (size_t)t + v]] = 1;
    for (uint8_t edges = 1; edges <= ZONE_EDGES; edges++)
        for (int32_t t = 0; t < mesh->num_tets; t++) {
            const int32_t *node = mesh->tets + 4 * (size_t)t;
            bool in_range = false;
            for (int v = 0; v < 4; v++) in_range = in_range || (near[node[v]] > 0 && near[node[v]] <= edges);
            for (int v = 0; v < 4 && in_range; v++)
                if (near[node[v]] == 0) near[node[v]] = (uint8_t)(edges + 1);
        }
    for (int32_t n = 0; n < mesh->num_nodes; n++) near[n] = near[n] > 0;
}

pliant_status pliant_fit_next(const pliant_fit *fit, const pliant_body *body, const pliant_parts *parts,
                              const double *rest, pliant_fit **out)
{
    pliant_fit *next = NULL;
    pliant_status status = allocate(&body->fine, &fit->view, rest, fit->num_threads, &next);
    if (status != PLIANT_OK) return status;
    const fit_view *view = &fit->view;
    memcpy(next->view.tissue, view->tissue,
           (size_t)view->scan_size[0] * (size_t)view->scan_size[1] * (size_t)view->scan_size[2]);
    if (parts) {
        next->parts = parts;
        next->near = pliant_calloc((size_t)body->fine.num_nodes, 1);
        next->zone = pliant_calloc((size_t)parts->view.num_elements, 1);
        if (!next->near || !next->zone) {
            pliant_fit_free(next);
            return pliant_fail_memory("the fit");
        }
        find_near(body, parts, next->near);
        for (int32_t e = 0; e < parts->view.num_elements; e++)
            for (int v = 0; v < 4; v++)
                next->zone[e] += e >= body->fine.num_tets || next->near[body->fine.tets[4 * (size_t)e + v]];
        next->view.num_elements = parts->view.num_elements;
        next->view.zone = next->zone;
        next->view.near = next->near;
    }
    *out = next;
    return PLIANT_OK;
}

const uint8_t *pliant_fit_zone(const pliant_fit *fit) { return fit->zone; }

void pliant_fit_free(pliant_fit *fit)
{
    if (!fit) return;
    fit_view *view = &fit->view;
    PLIANT_FREE(view->map, view->wanted, view->covered, view->tissue, view->at, view->sorted, view->bin_node,
                view->bin_start, fit->near, fit->zone, fit);
}

static void sort_nodes(pliant_fit *fit, const double *positions)
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
    int32_t *start = view->bin_start;
    memset(start, 0, ((size_t)count + 1) * sizeof *start);
    for (int32_t n = 0; n < nodes; n++) start[fit_flat_bin(view, view->at + 3 * (size_t)n) + 1]++;
    for (int32_t b = 0; b < count; b++) start[b + 1] += start[b];
    /* fill from the back, so that the starts stay valid and the nodes of a bin ascend */
    for (int32_t n = nodes - 1; n >= 0; n--)
        view->bin_node[--start[fit_flat_bin(view, view->at + 3 * (size_t)n) + 1]] = n;
    for (int32_t b = 0; b < count; b++) start[b] = start[b + 1];
    start[count] = nodes;
    for (int32_t place = 0; place < nodes; place++) fit_set_place(view, place);
}

/* Mark the voxels that tetrahedra cover in slices begin to end, and the lattice points needed in slices want_begin to
 * want_end. */
FIT_VECTORIZED static void cover(const fit_view *view, int32_t begin, int32_t end, int32_t want_begin, int32_t want_end)
{
    const int32_t *size = view->target.size;
    const size_t slice = (size_t)size[0] * (size_t)size[1], wanted = (size_t)view->size[0] * (size_t)view->size[1];
    memset(view->covered + slice * (size_t)begin, 0, slice * (size_t)(end - begin));
    memset(view->wanted + wanted * (size_t)want_begin, 0, wanted * (size_t)(want_end - want_begin));
    for (int32_t t = 0; t < view->num_tets; t++) {
        fit_tet tet;
        int32_t first[3], last[3];
        if (!fit_covers(view, t, true) || !fit_tet_at(view, t, &tet)) continue;
        fit_mark_needed_points(view, &tet, want_begin, want_end);
        if (!fit_covers(view, t, false)) continue;
        bool in_range = true;
        for (int d = 1; d < 3; d++)
            in_range = in_range && fit_range(tet.low[d], tet.high[d], size[d], first + d, last + d);
        if (!in_range) continue;
        for (int32_t k = first[2] > begin ? first[2] : begin; k <= last[2] && k < end; k++)
            for (int32_t j = first[1]; j <= last[1]; j++) fit_cover_row(view, &tet, j, k);
    }
}

static void cover_all(const pliant_fit *fit)
{
    const int64_t parts = fit->num_threads, slices = fit->view.target.size[2], wanted = fit->view.size[2];
#pragma omp parallel for num_threads(fit->num_threads) schedule(static, 1)
    for (int64_t part = 0; part < parts; part++)
        cover(&fit->view, (int32_t)(slices * part / parts), (int32_t)(slices * (part + 1) / parts),
              (int32_t)(wanted * part / parts), (int32_t)(wanted * (part + 1) / parts));
}

FIT_VECTORIZED static void map_row(const fit_view *view, int32_t j, int32_t k)
{
    float *out = view->map + 3 * (size_t)view->size[0] * ((size_t)j + (size_t)view->size[1] * (size_t)k);
    for (int32_t i = 0; i < view->size[0]; i++) fit_point(view, (const int32_t[3]){i, j, k}, out + 3 * i);
}

void pliant_fit_map(pliant_fit *fit, const double *positions)
{
    const fit_view *view = &fit->view;
    sort_nodes(fit, positions);
    cover_all(fit);
#pragma omp parallel for num_threads(fit->num_threads) schedule(dynamic)
    for (int32_t row = 0; row < view->size[1] * view->size[2]; row++)
        map_row(view, row % view->size[1], row / view->size[1]);
}

const fit_view *pliant_fit_parts(const pliant_fit *fit) { return &fit->view; }

/* Draw voxels first[0] to end of a row; return whether a voxel has changed. Data per row are reused between the same
 * lattice points. */
FIT_VECTORIZED static bool draw_row(const fit_view *view, const raster_source *source, const int32_t first[3],
                                    int32_t end, void *voxels)
{
    const int32_t *size = view->target.size;
    double part[3], left[3] = {0, 0, 0}, right[3] = {0, 0, 0};
    int32_t low[3], between = -1;
    bool other = false;
    for (int d = 1; d < 3; d++) low[d] = fit_below(view, d, first[d], part + d);
    const size_t row = (size_t)size[0] * ((size_t)first[1] + (size_t)size[1] * (size_t)first[2]);
    for (int32_t i = first[0]; i < end; i++) {
        double index[3] = {0, 0, 0};
        bool known = view->covered[row + (size_t)i];
        if (view->covered[row + (size_t)i] == FIT_DRAWN) continue;
        if (known) {
            low[0] = fit_below(view, 0, i, part);
            if (low[0] != between) {
                fit_between_rows(view, low[0], low, part, left);
                fit_between_rows(view, view->size[0] > 1 ? low[0] + 1 : low[0], low, part, right);
                between = low[0];
            }
            known = fit_between(left, right, part[0], index);
        }
        other |= fit_draw_voxel(view, source, known, index, voxels, row + (size_t)i);
    }
    return other;
}

static bool draw_owned(const pliant_fit *fit, const raster_source *source, const raster_tet *tets, const int32_t low[3],
                       const raster_brick *owned, void *voxels)
{
    const int32_t *size = fit->view.target.size;
    bool other = false;
    for (int32_t n = 0; n < owned->num_masked; n++) {
        const int32_t place = owned->masked[n], element = owned->masked_by[n];
        const int32_t at[3] = {low[0] + place % BRICK, low[1] + place / BRICK % BRICK, low[2] + place / BRICK_ROWS};
        const double voxel[3] = {at[0], at[1], at[2]};
        const size_t v = (size_t)at[0] + (size_t)size[0] * ((size_t)at[1] + (size_t)size[1] * (size_t)at[2]);
        const double(*map)[4] = tets[element].map;
        double index[3];
        for (int d = 0; d < 3; d++) index[d] = part_index(map[0][d], map[1][d], map[2][d], map[3][d], voxel);
        fit->view.covered[v] = FIT_DRAWN;
        other |= fit_draw_owned(&fit->view, &fit->parts->view, source, element, voxel, index, voxels, v);
    }
    return other;
}

bool pliant_fit_draw_brick(const pliant_fit *fit, const raster_source *source, const raster_tet *tets,
                           const int32_t brick[3], const raster_brick *owned, void *voxels)
{
    int32_t low[3], high[3];
    for (int d = 0; d < 3; d++) {
        low[d] = brick[d] * BRICK;
        high[d] = low[d] + BRICK < fit->view.target.size[d] ? low[d] + BRICK : fit->view.target.size[d];
    }
    bool other = owned && draw_owned(fit, source, tets, low, owned, voxels);
    for (int32_t k = low[2]; k < high[2]; k++)
        for (int32_t j = low[1]; j < high[1]; j++)
            other |= draw_row(&fit->view, source, (const int32_t[3]){low[0], j, k}, high[0], voxels);
    return other;
}

void pliant_fit_draw(const pliant_fit *fit, const raster_source *source, const int32_t bricks[3], void *voxels,
                     uint8_t *changed)
{
#pragma omp parallel for num_threads(fit->num_threads) schedule(dynamic)
    for (int32_t b = 0; b < bricks[0] * bricks[1] * bricks[2]; b++) {
        const int32_t brick[3] = {b % bricks[0], b / bricks[0] % bricks[1], b / bricks[0] / bricks[1]};
        changed[b] = pliant_fit_draw_brick(fit, source, NULL, brick, NULL, voxels);
    }
}
