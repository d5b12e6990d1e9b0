#include "contact/detect/tet_grid.h"

#include "base/buffer.h"
#include "base/fail.h"
#include "base/lanes.h"
#include "contact/detect/overlap.h"
#include "base/memory.h"

#include <float.h>
#include <math.h>
#include <string.h>

enum { CELLS_PER_BOX = 8, MIN_CELLS = 64, MAX_ENLARGEMENTS = 200 };
static const double min_enlargement = 1.01; /* factor on the side of too many cells */
static const float float_spacing = 1.2e-7f; /* more than the relative spacing of floats */

void pliant_grid_free(pliant_grid *grid)
{
    PLIANT_FREE(grid->box, grid->start, grid->item);
    for (int c = 0; c < PLIANT_GRID_CHUNKS; c++) pliant_free(grid->found[c].pair);
    memset(grid, 0, sizeof *grid);
}

static pliant_status reserve_capacity(void *list, int32_t *capacity, size_t count, size_t size)
{
    if (count <= (size_t)*capacity) return PLIANT_OK;
    const size_t more = count + count / 2;
    if (more > INT32_MAX || !pliant_grow(list, more, size)) return pliant_fail_memory("the grid of tetrahedra");
    *capacity = (int32_t)more;
    return PLIANT_OK;
}

/* ---- boxes and cells */

static void find_boxes(pliant_grid *grid, const int32_t *tets, const double *positions, double margin, int threads)
{
#pragma omp parallel for schedule(static) num_threads(threads)
    for (int32_t i = 0; i < grid->count; i++) {
        const int32_t *node = tets + 4 * (size_t)grid->tet[i];
        pliant_grid_box *box = grid->box + i;
        for (int d = 0; d < 3; d++) {
            double low = INFINITY, high = -INFINITY, sum = 0;
            for (int v = 0; v < 4; v++) {
                const double x = positions[3 * (size_t)node[v] + (size_t)d];
                low = x < low ? x : low;
                high = x > high ? x : high;
                sum += x;
            }
            if (!isfinite(sum)) low = high = NAN;
            box->low[d] = low - margin;
            box->high[d] = high + margin;
        }
    }
}

static int is_sound(const pliant_grid_box *box)
{
    return box->low[0] <= box->high[0] && box->low[1] <= box->high[1] && box->low[2] <= box->high[2];
}

/* Choose cells as large as the mean box, or larger to limit their number. */
static void choose_cells(pliant_grid *grid)
{
    const double maximum = (double)CELLS_PER_BOX * grid->count + MIN_CELLS;
    double low[3] = {INFINITY, INFINITY, INFINITY}, high[3] = {-INFINITY, -INFINITY, -INFINITY}, sum = 0, sound = 0,
           cells = 1;
    for (int32_t i = 0; i < grid->count; i++) {
        const pliant_grid_box *box = grid->box + i;
        if (!is_sound(box)) continue;
        double size = 0;
        for (int d = 0; d < 3; d++) {
            low[d] = fmin(low[d], box->low[d]);
            high[d] = fmax(high[d], box->high[d]);
            size = fmax(size, box->high[d] - box->low[d]);
        }
        sum += size;
        sound++;
    }
    grid->side = sound > 0 && sum > 0 ? sum / sound : 1;
    for (int again = 0; again < MAX_ENLARGEMENTS; again++) {
        cells = 1;
        for (int d = 0; d < 3; d++) cells *= sound > 0 ? floor((high[d] - low[d]) / grid->side) + 1 : 1;
        if (cells <= maximum) break;
        grid->side *= fmax(cbrt(cells / maximum), min_enlargement);
    }
    for (int d = 0; d < 3; d++) {
        grid->low[d] = sound > 0 ? low[d] : 0;
        grid->cells[d] = sound > 0 ? (int32_t)floor((high[d] - low[d]) / grid->side) + 1 : 1;
    }
}

static int32_t cell_along(const pliant_grid *grid, int axis, double x)
{
    const double cell = floor((x - grid->low[axis]) / grid->side);
    return cell < 0 ? 0 : cell < grid->cells[axis] ? (int32_t)cell : grid->cells[axis] - 1;
}

int64_t pliant_grid_cell(const pliant_grid *grid, const double point[3])
{
    int64_t cell = 0;
    for (int d = 2; d >= 0; d--) {
        const double at = floor((point[d] - grid->low[d]) / grid->side);
        if (grid->count == 0 || !(at >= 0 && at < grid->cells[d])) return -1;
        cell = cell * grid->cells[d] + (int64_t)at;
    }
    return cell;
}

/* Visit every cell that a box overlaps: count the box, or store its index from the cell's end to its start. */
static void each_cell(pliant_grid *grid, int32_t i, int give)
{
    pliant_grid_box *box = grid->box + i;
    int32_t last[3];
    if (!is_sound(box)) return;
    for (int d = 0; d < 3; d++) {
        if (!give) box->cell[d] = cell_along(grid, d, box->low[d]);
        last[d] = cell_along(grid, d, box->high[d]);
    }
    for (int32_t c = box->cell[2]; c <= last[2]; c++)
        for (int32_t b = box->cell[1]; b <= last[1]; b++)
            for (int32_t a = box->cell[0]; a <= last[0]; a++) {
                const size_t cell =
                    (size_t)a + (size_t)grid->cells[0] * ((size_t)b + (size_t)grid->cells[1] * (size_t)c);
                if (give) grid->item[--grid->start[cell]] = i;
                else grid->start[cell]++;
            }
}

pliant_status pliant_grid_fill(pliant_grid *grid, int32_t count, const int32_t *tet, const int32_t *tets,
                               const double *positions, double margin, int threads)
{
    grid->count = 0;
    pliant_status status = reserve_capacity(&grid->box, &grid->box_capacity, (size_t)count, sizeof *grid->box);
    if (status != PLIANT_OK) return status;
    grid->count = count;
    grid->tet = tet;
    find_boxes(grid, tets, positions, margin, threads);
    choose_cells(grid);
    const size_t cells = (size_t)grid->cells[0] * (size_t)grid->cells[1] * (size_t)grid->cells[2];
    status = reserve_capacity(&grid->start, &grid->start_capacity, cells + 1, sizeof *grid->start);
    if (status == PLIANT_OK) {
        memset(grid->start, 0, (cells + 1) * sizeof *grid->start);
        for (int32_t i = 0; i < count; i++) each_cell(grid, i, 0);
        for (size_t c = 1; c <= cells; c++) grid->start[c] += grid->start[c - 1];
        status = reserve_capacity(&grid->item, &grid->item_capacity, (size_t)grid->start[cells], sizeof *grid->item);
    }
    if (status != PLIANT_OK) {
        grid->count = 0;
        return status;
    }
    for (int32_t i = count - 1; i >= 0; i--) each_cell(grid, i, 1);
    return PLIANT_OK;
}

/* ---- pairs */

typedef struct pair_search {
    pliant_grid *grid;
    const int32_t *tets;
    const double *positions;
} pair_search;

enum { TILE = 64 };

/* Boxes of a cell in single precision, rounded outwards. */
typedef struct tile {
    int32_t count;
    float low[3][TILE], high[3][TILE];
} tile;

static void fill_tile(const pliant_grid *grid, const int32_t *item, int32_t count, tile *out)
{
    out->count = count;
    for (int32_t i = 0; i < count; i++)
        for (int d = 0; d < 3; d++) {
            const double *low = grid->box[item[i]].low, *high = grid->box[item[i]].high;
            out->low[d][i] = (float)(low[d] - grid->low[d]) * (1 - float_spacing) - FLT_MIN;
            out->high[d][i] = (float)(high[d] - grid->low[d]) * (1 + float_spacing) + FLT_MIN;
        }
}

/* Test which boxes of a tile intersect one box. */
PLIANT_VECTORIZED static void meet(const tile *all, const tile *of, int32_t one, uint8_t hit[TILE])
{
    const float low[3] = {of->low[0][one], of->low[1][one], of->low[2][one]},
                high[3] = {of->high[0][one], of->high[1][one], of->high[2][one]};
    for (int j = 0; j < TILE; j++)
        hit[j] = (all->low[0][j] < high[0]) & (low[0] < all->high[0][j]) & (all->low[1][j] < high[1]) &
                 (low[1] < all->high[1][j]) & (all->low[2][j] < high[2]) & (low[2] < all->high[2][j]);
}

static int share_a_node(const int32_t *a, const int32_t *b)
{
    int same = 0;
    for (int v = 0; v < 4; v++)
        for (int w = 0; w < 4; w++) same |= a[v] == b[w];
    return same;
}

static int overlap(const double *positions, const int32_t *one, const int32_t *other)
{
    double x[3][4], y[3][4];
    for (int v = 0; v < 4; v++)
        for (int d = 0; d < 3; d++) {
            x[d][v] = positions[3 * (size_t)one[v] + (size_t)d];
            y[d][v] = positions[3 * (size_t)other[v] + (size_t)d];
        }
    return pliant_tets_overlap(x, y);
}

static void take_pair(const pair_search *search, const int32_t at[3], int32_t i, int32_t j, pliant_grid_pairs *found)
{
    const pliant_grid *grid = search->grid;
    const pliant_grid_box *one = grid->box + i, *other = grid->box + j;
    for (int d = 0; d < 3; d++) { /* a pair is found in the cell with the lowest corner of the boxes' intersection */
        if ((one->cell[d] > other->cell[d] ? one->cell[d] : other->cell[d]) != at[d]) return;
        /* boxes of a tile are larger by rounding */
        if (!(one->low[d] < other->high[d] && other->low[d] < one->high[d])) return;
    }
    const int32_t a = grid->tet[i], b = grid->tet[j];
    const int32_t *nodes = search->tets + 4 * (size_t)a, *others = search->tets + 4 * (size_t)b;
    if (share_a_node(nodes, others) || !overlap(search->positions, nodes, others)) return;
    if (found->count < found->capacity) {
        found->pair[2 * found->count] = a < b ? a : b;
        found->pair[2 * found->count + 1] = a < b ? b : a;
    }
    found->count++;
}

static void search_cell(const pair_search *search, const int32_t at[3], size_t cell, pliant_grid_pairs *found)
{
    const pliant_grid *grid = search->grid;
    const int32_t *item = grid->item + grid->start[cell], count = grid->start[cell + 1] - grid->start[cell];
    tile tiles[2];
    uint8_t hit[TILE];
    for (int32_t a = 0; a < count; a += TILE) {
        fill_tile(grid, item + a, count - a < TILE ? count - a : TILE, tiles);
        for (int32_t b = a; b < count; b += TILE) {
            const tile *others = b > a ? tiles + 1 : tiles;
            if (b > a) fill_tile(grid, item + b, count - b < TILE ? count - b : TILE, tiles + 1);
            for (int32_t i = 0; i < tiles->count; i++) {
                meet(others, tiles, i, hit);
                for (int32_t j = b > a ? 0 : i + 1; j < others->count; j++)
                    if (hit[j]) take_pair(search, at, item[a + i], item[b + j], found);
            }
        }
    }
}

static void search_chunk(const pair_search *search, int chunk)
{
    const pliant_grid *grid = search->grid;
    pliant_grid_pairs *found = search->grid->found + chunk;
    const int64_t cells = (int64_t)grid->cells[0] * grid->cells[1] * grid->cells[2];
    const int64_t first = cells * chunk / PLIANT_GRID_CHUNKS, end = cells * (chunk + 1) / PLIANT_GRID_CHUNKS;
    found->count = 0;
    for (int64_t cell = first; cell < end; cell++) {
        if (grid->start[cell + 1] - grid->start[cell] < 2) continue;
        const int32_t at[3] = {(int32_t)(cell % grid->cells[0]), (int32_t)(cell / grid->cells[0] % grid->cells[1]),
                               (int32_t)(cell / grid->cells[0] / grid->cells[1])};
        search_cell(search, at, (size_t)cell, found);
    }
}

pliant_status pliant_grid_overlaps(pliant_grid *grid, const int32_t *tets, const double *positions, int threads,
                                   int32_t *count)
{
    const pair_search search = {.grid = grid, .tets = tets, .positions = positions};
    for (int c = 0; c < PLIANT_GRID_CHUNKS; c++) grid->found[c].count = 0;
    *count = 0;
    if (grid->count == 0) return PLIANT_OK;
#pragma omp parallel for schedule(dynamic) num_threads(threads)
    for (int c = 0; c < PLIANT_GRID_CHUNKS; c++) search_chunk(&search, c);
    for (int c = 0; c < PLIANT_GRID_CHUNKS; c++) { /* repeat the groups whose buffer was too small */
        pliant_grid_pairs *found = grid->found + c;
        if (found->count > found->capacity) {
            pliant_status status =
                reserve_capacity(&found->pair, &found->capacity, 2 * (size_t)found->count, sizeof *found->pair);
            if (status != PLIANT_OK) return status;
            found->capacity /= 2;
            search_chunk(&search, c);
        }
        *count += found->count;
    }
    return PLIANT_OK;
}

pliant_status pliant_grid_take_pairs(pliant_grid *grid, int32_t count, int32_t **pair)
{
    pliant_grid_pairs *found = grid->found;
    for (int c = 0; c < PLIANT_GRID_CHUNKS; c++) grid->found[c].count = 0;
    if (count > found->capacity) {
        pliant_status status = reserve_capacity(&found->pair, &found->capacity, 2 * (size_t)count, sizeof *found->pair);
        if (status != PLIANT_OK) return status;
        found->capacity /= 2;
    }
    found->count = count;
    *pair = found->pair;
    return PLIANT_OK;
}
