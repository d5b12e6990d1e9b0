/* Update the deformed volume: find the moved elements and the bricks that they touch, and redraw these bricks. */
#include "base/fail.h"
#include "base/clock.h"
#include "base/free_memory.h"
#include "base/memory.h"
#include "scan/volume.h"
#include "warp/warp_state.h"
#include "warp/warp.h"

#include <math.h>
#include <omp.h>
#include <string.h>

void pliant_warp_free(pliant_warp *warp)
{
    if (!warp) return;
    if (warp->accelerated) warp->device->free(warp->accelerated);
    pliant_volume_free(&warp->volume);
    pliant_fit_free(warp->fit);
    pliant_parts_free(warp->parts);
    pliant_part_hosts_release(warp->hosts);
    PLIANT_FREE(warp->rest, warp->fixed, warp->next, warp->moved, warp->carried_tet_fixed, warp->tets, warp->rebuilt,
                warp->changed, warp->dirty, warp->vacated, warp->dirty_bricks, warp->end, warp->candidates,
                warp->scratch);
    pliant_free(warp);
}

raster_source pliant_warp_source(const pliant_volume *scan)
{
    raster_source source = {.voxels = scan->voxels, .encoding = scan->encoding, .count = 1};
    for (int d = 0; d < 3; d++) {
        source.size[d] = scan->geometry.size[d];
        source.step[d] = source.size[d] > 1 ? source.count : 0;
        source.count *= source.size[d];
    }
    switch (scan->encoding) {
    case PLIANT_UINT8: source.background.u8 = (uint8_t)lrintf(fminf(fmaxf(scan->background, 0), UINT8_MAX)); break;
    case PLIANT_INT16:
        source.background.i16 = (int16_t)lrintf(fminf(fmaxf(scan->background, INT16_MIN), INT16_MAX));
        break;
    case PLIANT_FLOAT32: source.background.f32 = scan->background; break;
    }
    return source;
}

static pliant_status check(const pliant_volume *scan, const pliant_mesh *mesh, int num_threads)
{
    if (!scan->voxels || pliant_encoding_size(scan->encoding) == 0)
        return pliant_fail(PLIANT_ERROR_ARGUMENT, "the scan of a warp has no voxels");
    if (num_threads < 1)
        return pliant_fail(PLIANT_ERROR_ARGUMENT, "a warp needs at least one thread, not %d", num_threads);
    if (mesh->num_nodes < 1 || mesh->num_tets < 1)
        return pliant_fail(PLIANT_ERROR_ARGUMENT, "the mesh of a warp is empty");
    for (int32_t v = 0; v < 4 * mesh->num_tets; v++)
        if (mesh->tets[v] < 0 || mesh->tets[v] >= mesh->num_nodes)
            return pliant_fail(PLIANT_ERROR_ARGUMENT, "tetrahedron %d of the warped mesh names node %d of %d", v / 4,
                               mesh->tets[v], mesh->num_nodes);
    return PLIANT_OK;
}

static bool allocate(pliant_warp *warp)
{
    size_t nodes = warp->node_capacity = (size_t)warp->mesh->num_nodes, bricks = (size_t)warp->num_bricks;
    size_t elements = warp->element_capacity = warp->capacity = (size_t)warp->num_elements;
    return (warp->rest = pliant_calloc(nodes, 3 * sizeof *warp->rest)) &&
           (warp->fixed = pliant_calloc(nodes, 3 * sizeof *warp->fixed)) &&
           (warp->next = pliant_calloc(nodes, 3 * sizeof *warp->next)) && (warp->moved = pliant_calloc(nodes, 1)) &&
           (warp->tets = pliant_calloc(elements, sizeof *warp->tets)) && (warp->rebuilt = pliant_calloc(elements, 1)) &&
           (warp->changed = pliant_calloc(bricks, 1)) && (warp->dirty = pliant_calloc(bricks, 1)) &&
           (warp->vacated = pliant_calloc(bricks, 1)) &&
           (warp->dirty_bricks = pliant_calloc(bricks, sizeof *warp->dirty_bricks)) &&
           (warp->end = pliant_calloc(bricks, (size_t)warp->num_threads * sizeof *warp->end)) &&
           (warp->candidates = pliant_calloc(elements, sizeof *warp->candidates)) &&
           (warp->scratch = pliant_calloc((size_t)warp->num_threads, sizeof *warp->scratch));
}

static void fill_background(const raster_source *source, pliant_volume *volume)
{
    size_t count = pliant_geometry_voxels(&volume->geometry);
    switch (source->encoding) {
    case PLIANT_UINT8: memset(volume->voxels, source->background.u8, count); break;
    case PLIANT_INT16:
        for (size_t v = 0; v < count; v++) ((int16_t *)volume->voxels)[v] = source->background.i16;
        break;
    case PLIANT_FLOAT32:
        for (size_t v = 0; v < count; v++) ((float *)volume->voxels)[v] = source->background.f32;
        break;
    }
}

pliant_status pliant_warp_create(const pliant_volume *scan, const pliant_mesh *mesh, const pliant_geometry *target,
                                 int num_threads, pliant_warp **out)
{
    pliant_status status = check(scan, mesh, num_threads);
    if (status != PLIANT_OK) return status;
    pliant_volume volume = {0};
    status = pliant_memory_check((double)pliant_geometry_voxels(target) * (double)pliant_encoding_size(scan->encoding),
                                 "the deformed volume (warp/margin)");
    if (status == PLIANT_OK) status = pliant_volume_create(target, scan->encoding, &volume);
    if (status != PLIANT_OK) return status;
    pliant_warp *warp = pliant_calloc(1, sizeof *warp);
    if (!warp) {
        pliant_volume_free(&volume);
        return pliant_fail_memory("the warp");
    }
    warp->volume = volume;
    warp->volume.slope = scan->slope;
    warp->volume.intercept = scan->intercept;
    warp->volume.background = scan->background;
    memcpy(warp->volume.id, scan->id, sizeof warp->volume.id);
    warp->mesh = mesh;
    warp->num_elements = mesh->num_tets;
    warp->scan = scan->geometry;
    warp->num_threads = num_threads;
    warp->source = pliant_warp_source(scan);
    if (!pliant_warp_use(warp, RASTER_AVX512) && !pliant_warp_use(warp, RASTER_AVX2))
        pliant_warp_use(warp, RASTER_PORTABLE);

    if (!pliant_raster_grid(target, mesh, &warp->grid)) {
        status = pliant_fail(
            PLIANT_ERROR_ARGUMENT,
            "the warp target is too large, or its voxels are too small. The target and four tetrahedra on each side "
            "may span at most %d voxels along an axis",
            1 << (SPAN_BITS - FRACTION_BITS_MIN));
        goto failed;
    }
    int64_t bricks = (int64_t)warp->grid.bricks[0] * warp->grid.bricks[1] * warp->grid.bricks[2];
    warp->num_bricks = (int32_t)(bricks < INT32_MAX ? bricks : INT32_MAX);
    status = bricks == warp->num_bricks && allocate(warp) ? PLIANT_OK : pliant_fail_memory("the warp");
    if (status != PLIANT_OK) goto failed;
    for (int32_t n = 0; n < mesh->num_nodes; n++)
        pliant_geometry_to_index(&scan->geometry, mesh->rest + 3 * n, warp->rest + 3 * n);
    fill_background(&warp->source, &warp->volume);
    *out = warp;
    return PLIANT_OK;
failed:
    pliant_warp_free(warp);
    return status;
}

bool pliant_warp_use(pliant_warp *warp, raster_set set)
{
    if (warp->source.nearest && set != RASTER_PORTABLE) return false;
    switch (set) {
    case RASTER_AVX512: return pliant_raster_kernels_avx512(&warp->source, &warp->kernels);
    case RASTER_AVX2: return pliant_raster_kernels_avx2(&warp->source, &warp->kernels);
    default: warp->kernels = pliant_raster_kernels_portable(&warp->source); return true;
    }
}

/* Compute the fixed-point nodes of the next update. Return the number of moved nodes. */
static int32_t fix_nodes(pliant_warp *warp, const double *positions)
{
    int32_t num_nodes = warp->mesh->num_nodes, num_moved = 0;
#pragma omp parallel for num_threads(warp->num_threads) reduction(+ : num_moved) if (num_nodes > 10000)
    for (int32_t n = 0; n < num_nodes; n++) {
        int32_t *next = warp->next + 3 * n;
        pliant_raster_fix(&warp->grid, positions + 3 * n, next);
        warp->moved[n] = !warp->drawn || memcmp(next, warp->fixed + 3 * n, 3 * sizeof *next) != 0;
        num_moved += warp->moved[n];
    }
    return num_moved;
}

/* Compute the corners of carried tetrahedra for the next update. Mark moved ones, and return their number. */
static int32_t fix_carried_tets(pliant_warp *warp, const double *positions)
{
    int32_t num_moved = 0;
    for (int32_t g = 0; warp->parts && g < warp->parts->num_carried_tets; g++) {
        const part_carried_tet *carried_tet = &warp->parts->carried_tets[g];
        const double *node[4];
        bool moved = false;
        for (int v = 0; v < 4; v++)
            node[v] = positions + 3 * (size_t)warp->mesh->tets[4 * (size_t)carried_tet->carrier + v];
        for (int v = 0; v < 4; v++) {
            int32_t *last = warp->carried_tet_fixed + 12 * (size_t)g + 3 * v, next[3];
            double corner[3];
            part_carried_tet_corner(carried_tet->blend[v], node, corner);
            pliant_raster_fix(&warp->grid, corner, next);
            moved = moved || memcmp(next, last, sizeof next) != 0;
            memcpy(last, next, sizeof next);
        }
        if (moved) warp->rebuilt[warp->mesh->num_tets + g] = 1;
        num_moved += moved;
    }
    return num_moved;
}

static bool tet_moved(const pliant_warp *warp, int32_t tet)
{
    if (warp->rebuilt[tet]) return true;
    if (tet >= warp->mesh->num_tets) return !warp->drawn;
    const int32_t *nodes = warp->mesh->tets + 4 * (size_t)tet;
    return warp->moved[nodes[0]] | warp->moved[nodes[1]] | warp->moved[nodes[2]] | warp->moved[nodes[3]];
}

static void set_tet(pliant_warp *warp, const int32_t *fixed, int32_t t)
{
    const int32_t *corners[4], carried_tet = t - warp->mesh->num_tets;
    const double *rest[4];
    for (int v = 0; v < 4; v++) {
        size_t node = carried_tet < 0 ? (size_t)warp->mesh->tets[4 * (size_t)t + v] : 0;
        corners[v] = carried_tet < 0 ? fixed + 3 * node : warp->carried_tet_fixed + 12 * (size_t)carried_tet + 3 * v;
        rest[v] = carried_tet < 0 ? warp->rest + 3 * node : warp->parts->carried_tets[carried_tet].rest[v];
    }
    pliant_raster_tet(&warp->grid, &warp->source, corners, rest, &warp->tets[t]);
    warp->tets[t].has_parts = warp->parts && warp->parts->view.elements[t].box >= 0;
}

typedef enum visit { VISIT_MARK, VISIT_LEAVE, VISIT_COUNT, VISIT_LIST } visit;

/* Visit a brick that a tetrahedron touches: mark it as dirty or left, or count or list the tetrahedron if the brick is
 * dirty.
 * end: range ends of this thread */
static inline void visit_brick(pliant_warp *warp, int32_t t, int32_t brick, visit what, size_t *end)
{
    switch (what) {
    case VISIT_MARK:
#pragma omp atomic write
        warp->dirty[brick] = 1;
        break;
    case VISIT_LEAVE: warp->vacated[brick] = 1; break;
    case VISIT_COUNT: end[brick] += warp->dirty[brick]; break;
    case VISIT_LIST:
        if (warp->dirty[brick] && brick >= warp->listed[0] && brick < warp->listed[1])
            warp->candidates[end[brick]++] = t;
        break;
    }
}

static void visit_bricks(pliant_warp *warp, int32_t t, visit what, size_t *end)
{
    const raster_tet *tet = &warp->tets[t];
    if (tet->kind == RASTER_NOTHING) return;
    const int32_t across = warp->grid.bricks[0], down = warp->grid.bricks[1];
    int32_t low[3], high[3], at[3];
    if (raster_range(tet, low, high)) {
        int32_t first = low[0] + across * (low[1] + down * low[2]);
        for (uint64_t bits = tet->bricks; bits; bits &= bits - 1) {
            int32_t bit = raster_lowest_bit(bits), i = bit % MASK_EDGE, j = bit / MASK_EDGE % MASK_EDGE;
            visit_brick(warp, t, first + i + across * (j + down * (bit / MASK_EDGE / MASK_EDGE)), what, end);
        }
        return;
    }
    for (at[2] = low[2]; at[2] <= high[2]; at[2]++)
        for (at[1] = low[1]; at[1] <= high[1]; at[1]++)
            for (at[0] = low[0]; at[0] <= high[0]; at[0]++)
                if (pliant_raster_cuts(tet, at))
                    visit_brick(warp, t, at[0] + across * (at[1] + down * at[2]), what, end);
}

void pliant_warp_remove_from_bricks(pliant_warp *warp, int32_t element)
{
    visit_bricks(warp, element, VISIT_LEAVE, NULL);
}

/* Mark the tetrahedra that moved from the given nodes; bricks that they touched or touch become dirty. */
static void move_tets(pliant_warp *warp, const int32_t *fixed)
{
#pragma omp parallel for num_threads(warp->num_threads) schedule(static)
    for (int32_t t = 0; t < warp->num_elements; t++) {
        if (!tet_moved(warp, t)) continue;
        if (warp->drawn) visit_bricks(warp, t, VISIT_MARK, NULL);
        set_tet(warp, fixed, t);
        if (warp->drawn) visit_bricks(warp, t, VISIT_MARK, NULL);
        warp->rebuilt[t] = 0;
    }
}

/* Visit all tetrahedra. Each thread takes a contiguous range, so that a brick's candidates ascend from thread to
 * thread. */
static void visit_all(pliant_warp *warp, visit what)
{
    int64_t num_tets = warp->num_elements, parts = warp->num_threads;
#pragma omp parallel for num_threads(warp->num_threads) schedule(static, 1)
    for (int64_t part = 0; part < parts; part++)
        for (int64_t t = num_tets * part / parts; t < num_tets * (part + 1) / parts; t++)
            visit_bricks(warp, (int32_t)t, what, warp->end + part * warp->num_bricks);
}

/* Count the candidates of every dirty brick for each thread, and enlarge the list if memory permits. */
static void count_candidates(pliant_warp *warp)
{
    const size_t counts = (size_t)warp->num_bricks * (size_t)warp->num_threads;
    size_t total = 0;
    memset(warp->end, 0, counts * sizeof *warp->end);
    visit_all(warp, VISIT_COUNT);
    for (size_t n = 0; n < counts; n++) total += warp->end[n];
    int32_t *candidates = total > warp->capacity ? pliant_calloc(total + total / 4, sizeof *candidates) : NULL;
    if (!candidates) return;
    pliant_free(warp->candidates);
    warp->candidates = candidates;
    warp->capacity = total + total / 4;
}

/* List the candidates of the next bricks, as many as fit but at least one. The counts become range ends. */
static void list_candidates(pliant_warp *warp)
{
    size_t total = 0;
    int32_t b = warp->listed[0] = warp->listed[1];
    for (; b < warp->num_bricks; b++) { /* store the start of each range, which listing advances to its end */
        size_t count = 0;
        for (int part = 0; part < warp->num_threads; part++)
            count += warp->end[(size_t)part * (size_t)warp->num_bricks + (size_t)b];
        if (total + count > warp->capacity) break;
        for (int part = 0; part < warp->num_threads; part++) {
            size_t *end = &warp->end[(size_t)part * (size_t)warp->num_bricks + (size_t)b], own = *end;
            *end = total;
            total += own;
        }
    }
    warp->listed[1] = b;
    visit_all(warp, VISIT_LIST);
}

/* Find the voxels of a brick inside the target, and mark them as not yet owned by any element. */
static void begin_brick(const pliant_warp *warp, const int32_t brick[3], int32_t origin[3], int32_t extent[3],
                        raster_brick *owned)
{
    const int32_t *size = warp->grid.target.size;
    for (int d = 0; d < 3; d++) {
        origin[d] = brick[d] * BRICK;
        extent[d] = size[d] - origin[d] < BRICK ? size[d] - origin[d] : BRICK;
    }
    memset(owned->owned, 0, sizeof owned->owned);
    memset(owned->num_entries, 0, sizeof owned->num_entries);
    owned->num_masked = 0;
    owned->num_free = extent[0] * extent[1] * extent[2];
    if (extent[1] == BRICK && extent[2] == BRICK) return;
    for (int32_t row = 0; row < BRICK_ROWS; row++) /* rows outside the target are not free */
        if (row % BRICK >= extent[1] || row / BRICK >= extent[2])
            owned->owned[row / ROWS_AT_ONCE] |= (uint64_t)ENTRY_MASK << 16 * (row % ROWS_AT_ONCE);
}

/* Draw all voxels of a brick from its candidates, in ascending order: find the owner of each voxel, then write the
 * values row by row (sample_portable.c, or a vector variant). */
static void draw_brick(pliant_warp *warp, const int32_t *candidates, size_t num_candidates, const int32_t brick[3],
                       raster_brick *owned)
{
    const raster_source *source = &warp->source;
    const part_view *parts = warp->parts ? &warp->parts->view : NULL;
    int32_t origin[3], extent[3];
    begin_brick(warp, brick, origin, extent, owned);
    warp->kernels.find_owners(source, parts, warp->tets, candidates, num_candidates, origin, owned);
    const ptrdiff_t row_step = warp->grid.target.size[0], slice_step = row_step * warp->grid.target.size[1];
    const ptrdiff_t first = origin[0] + row_step * origin[1] + slice_step * origin[2];
    char *voxels = (char *)warp->volume.voxels + first * (ptrdiff_t)pliant_encoding_size(source->encoding);
    warp->kernels.write(source, owned, extent, voxels, row_step, slice_step);
    if (owned->num_masked > 0)
        pliant_raster_write_masked(source, parts, warp->tets, origin, owned, voxels, row_step, slice_step);
}

static void redo_bricks(pliant_warp *warp)
{
    const int32_t first = warp->listed[0];
    int32_t num_dirty = 0;
    for (int32_t b = first; b < warp->listed[1]; b++)
        if (warp->dirty[b]) warp->dirty_bricks[num_dirty++] = b;
    /* runs of adjacent bricks along i share memory; several runs per thread balance the load */
    const size_t *end = warp->end + (size_t)(warp->num_threads - 1) * (size_t)warp->num_bricks;
    int32_t run = num_dirty / (16 * warp->num_threads);
    run = run < 1 ? 1 : run > warp->grid.bricks[0] ? warp->grid.bricks[0] : run;
#pragma omp parallel for num_threads(warp->num_threads) schedule(dynamic, run)
    for (int32_t n = 0; n < num_dirty; n++) {
        int32_t b = warp->dirty_bricks[n], across = warp->grid.bricks[0], down = warp->grid.bricks[1];
        int32_t brick[3] = {b % across, b / across % down, b / across / down};
        size_t begin = b > first ? end[b - 1] : 0;
        draw_brick(warp, warp->candidates + begin, end[b] - begin, brick, &warp->scratch[omp_get_thread_num()]);
    }
}

/* Draw the listed bricks of a fit: first near a cut from the elements' own maps, then the rest. */
static void fit_bricks(pliant_warp *warp)
{
    const int32_t first = warp->listed[0], across = warp->grid.bricks[0], down = warp->grid.bricks[1];
    const size_t *end = warp->end + (size_t)(warp->num_threads - 1) * (size_t)warp->num_bricks;
#pragma omp parallel for num_threads(warp->num_threads) schedule(dynamic)
    for (int32_t b = first; b < warp->listed[1]; b++) {
        const int32_t brick[3] = {b % across, b / across % down, b / across / down};
        raster_brick *owned = &warp->scratch[omp_get_thread_num()];
        const size_t begin = b > first ? end[b - 1] : 0;
        int32_t origin[3], extent[3];
        begin_brick(warp, brick, origin, extent, owned);
        owned->all_masked = true;
        warp->kernels.find_owners(&warp->source, &warp->parts->view, warp->tets, warp->candidates + begin,
                                  end[b] - begin, origin, owned);
        warp->changed[b] =
            pliant_fit_draw_brick(warp->fit, &warp->source, warp->tets, brick, owned, warp->volume.voxels);
    }
}

static void fit_elements_at_cuts(pliant_warp *warp, const double *positions)
{
    const uint8_t *zone = pliant_fit_zone(warp->fit);
    fix_nodes(warp, positions);
    fix_carried_tets(warp, positions);
#pragma omp parallel for num_threads(warp->num_threads) schedule(static)
    for (int32_t t = 0; t < warp->num_elements; t++) {
        warp->tets[t].kind = RASTER_NOTHING;
        if (zone[t] == 0) continue;
        set_tet(warp, warp->next, t);
        warp->tets[t].has_parts = true;
    }
    memset(warp->dirty, 1, (size_t)warp->num_bricks);
    count_candidates(warp);
    for (warp->listed[1] = 0; warp->listed[1] < warp->num_bricks;) {
        list_candidates(warp);
        fit_bricks(warp);
    }
}

/* Log once if tissue is clipped by more than a voxel. The outermost nodes lie on the edge of a scan. */
static void log_clipped_tissue(pliant_warp *warp, const double *positions)
{
    const pliant_geometry *target = &warp->volume.geometry;
    double maximum = 0;
    for (int32_t n = 0; !warp->has_logged_clipping && n < warp->mesh->num_nodes; n++) {
        double index[3];
        pliant_geometry_to_index(target, positions + 3 * (size_t)n, index);
        for (int d = 0; d < 3; d++) {
            double beyond = fmax(-0.5 - index[d], index[d] - (target->size[d] - 0.5));
            if (beyond > 1) maximum = fmax(maximum, beyond * target->spacing[d]);
        }
    }
    if (maximum == 0) return;
    warp->has_logged_clipping = true;
    pliant_log(
        PLIANT_LOG_WARNING,
        "tissue is moved out of the deformed volume, by %.3g m, and cut off there; a larger warp/margin holds it",
        maximum);
}

pliant_status pliant_warp_update(pliant_warp *warp, const double *positions)
{
    double start = pliant_seconds();
    for (int32_t v = 0; v < 3 * warp->mesh->num_nodes; v++)
        if (!isfinite(positions[v]))
            return pliant_fail(PLIANT_ERROR_ARGUMENT,
                               "the position of node %d is not finite; the deformed volume does not change", v / 3);
    log_clipped_tissue(warp, positions);
    if (warp->accelerated) {
        if (warp->device->update(warp->accelerated, positions) == PLIANT_OK) return PLIANT_OK;
        pliant_warp_fall_back(warp);
    }
    if (warp->fit) {
        pliant_fit_map(warp->fit, positions);
        double mapped = pliant_seconds();
        if (pliant_fit_zone(warp->fit)) fit_elements_at_cuts(warp, positions);
        else pliant_fit_draw(warp->fit, &warp->source, warp->grid.bricks, warp->volume.voxels, warp->changed);
        warp->seconds[0] = mapped - start;
        warp->seconds[1] = pliant_seconds() - mapped;
        return PLIANT_OK;
    }
    int32_t num_moved = fix_nodes(warp, positions);
    num_moved += fix_carried_tets(warp, positions);
    if (num_moved == 0 && !warp->has_new_body) {
        memset(warp->changed, 0, (size_t)warp->num_bricks);
        warp->seconds[0] = pliant_seconds() - start;
        warp->seconds[1] = 0;
        return PLIANT_OK;
    }
    /* bricks touched before and after */
    if (warp->drawn) memcpy(warp->dirty, warp->vacated, (size_t)warp->num_bricks);
    else memset(warp->dirty, 1, (size_t)warp->num_bricks);
    if (warp->has_new_body) memset(warp->vacated, 0, (size_t)warp->num_bricks);
    warp->has_new_body = false;
    move_tets(warp, warp->next);
    count_candidates(warp);
    double drawn = 0;
    for (warp->listed[1] = 0; warp->listed[1] < warp->num_bricks;) {
        list_candidates(warp);
        double listed = pliant_seconds();
        redo_bricks(warp);
        drawn += pliant_seconds() - listed;
    }
    int32_t *fixed = warp->fixed;
    warp->fixed = warp->next;
    warp->next = fixed;
    uint8_t *changed = warp->changed;
    warp->changed = warp->dirty;
    warp->dirty = changed;
    warp->drawn = true;
    warp->seconds[0] = pliant_seconds() - start - drawn;
    warp->seconds[1] = drawn;
    return PLIANT_OK;
}

pliant_status pliant_warp_fit(pliant_warp *warp, int32_t step)
{
    pliant_fit *fit = NULL;
    pliant_status status =
        pliant_fit_create(warp->mesh, &warp->scan, warp->rest, &warp->volume.geometry, step, warp->num_threads, &fit);
    if (status == PLIANT_OK && !warp->parts) status = pliant_parts_whole(warp->body, &warp->scan, &warp->parts);
    if (status == PLIANT_OK && warp->parts) {
        pliant_fit *whole = fit;
        fit = NULL;
        status = pliant_fit_next(whole, warp->body, warp->parts, warp->rest, &fit);
        pliant_fit_free(whole);
    }
    if (status != PLIANT_OK) {
        pliant_fit_free(fit);
        return status;
    }
    if (warp->accelerated) warp->device->free(warp->accelerated);
    warp->accelerated = NULL;
    pliant_fit_free(warp->fit);
    warp->fit = fit;
    return PLIANT_OK;
}

pliant_status pliant_warp_nearest(pliant_warp *warp)
{
    if (warp->volume.encoding != PLIANT_UINT8 || warp->fit)
        return pliant_fail(PLIANT_ERROR_ARGUMENT, "a warp of labels needs 8-bit voxels and no warp/fit");
    if (warp->accelerated) warp->device->free(warp->accelerated);
    warp->accelerated = NULL;
    warp->source.nearest = true;
    warp->drawn = false;
    pliant_warp_use(warp, RASTER_PORTABLE);
    return PLIANT_OK;
}

pliant_warp_parts pliant_warp_device_parts(pliant_warp *warp)
{
    return (pliant_warp_parts){warp->mesh,    &warp->grid,
                               &warp->source, warp->rest,
                               &warp->volume, warp->changed,
                               warp->seconds, warp->fit ? pliant_fit_parts(warp->fit) : NULL,
                               warp->parts,   0};
}

pliant_status pliant_warp_backend(pliant_warp *warp, pliant_backend_choice choice)
{
    const pliant_warp_device *device = PLIANT_ON_GPU(pliant_cuda_warp_device);
    char text[PLIANT_BACKEND_TEXT];
    void *accelerated = NULL;
    bool use;
    pliant_status status = pliant_gpu_choose(choice, device ? device->probe : NULL, text, &use);
    if (status != PLIANT_OK) return status;
    if (use) {
        pliant_warp_parts parts = pliant_warp_device_parts(warp);
        status = device->create(&parts, &accelerated);
        if (status != PLIANT_OK && choice != PLIANT_AUTO) return status;
        if (status != PLIANT_OK)
            pliant_log(PLIANT_LOG_WARNING, "the deformed volume cannot use the GPU (%s); using the CPU",
                       pliant_last_error());
    }
    if (warp->accelerated) warp->device->free(warp->accelerated);
    warp->device = device;
    warp->accelerated = accelerated;
    warp->drawn = false;
    return PLIANT_OK;
}

void *pliant_warp_accelerated(const pliant_warp *warp) { return warp->accelerated; }

void pliant_warp_fall_back(pliant_warp *warp)
{
    if (!warp->accelerated) return;
    pliant_log(PLIANT_LOG_WARNING, "computing the deformed volume on the GPU failed (%s); using the CPU",
               pliant_last_error());
    warp->device->free(warp->accelerated);
    warp->accelerated = NULL;
    warp->drawn = false;
}

const pliant_volume *pliant_warp_volume(const pliant_warp *warp)
{
    /* If a lost GPU cannot deliver the volume, the last fetched one is returned; the next update draws everything. */
    if (warp->accelerated && warp->device->fetch(warp->accelerated) != PLIANT_OK)
        pliant_log(PLIANT_LOG_WARNING, "the deformed volume is not up to date: %s", pliant_last_error());
    return &warp->volume;
}

const pliant_mesh *pliant_warp_mesh(const pliant_warp *warp) { return warp->mesh; }
const pliant_geometry *pliant_warp_geometry(const pliant_warp *warp) { return &warp->volume.geometry; }

bool pliant_warp_cross(const pliant_warp *warp, const march_ray *ray, int64_t first, march_crossing *out)
{
    if (!warp->accelerated || !warp->device->cross) return false;
    if (warp->device->cross(warp->accelerated, ray, first, out) == PLIANT_OK) return true;
    pliant_log(PLIANT_LOG_WARNING, "GPU picking failed (%s); using the CPU", pliant_last_error());
    return false;
}

void pliant_warp_bricks(const pliant_warp *warp, int32_t count[3], const uint8_t **changed)
{
    memcpy(count, warp->grid.bricks, sizeof warp->grid.bricks);
    *changed = warp->changed;
}

void pliant_warp_seconds(const pliant_warp *warp, double *cull, double *rasterize)
{
    *cull = warp->seconds[0];
    *rasterize = warp->seconds[1];
}
