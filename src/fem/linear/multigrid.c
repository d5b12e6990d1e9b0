#include "fem/linear/multigrid.h"

#include "base/fail.h"
#include "fem/linear/hierarchy.h"
#include "base/memory.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

/* SMOOTHING_STEPS: Chebyshev steps before and after; test/bench/bench_budget compares them. */
enum { SMOOTHING_STEPS = 2, POWER_STEPS = 12 };
/* Maximum number of corners of an element of the finest level, next to a cut (coarse/graded.c). */
enum { MAX_CORNERS = 64 };
/* spectrum_share: fraction of the spectrum that the smoother leaves to coarser levels. */
static const double spectrum_share = 0.12, spectrum_margin = 1.1;

/* Values of one level. */
typedef struct level_values {
    pliant_system system;       /* view of the hierarchy's system, with this multigrid's stiffness and threads */
    double *stiffness;          /* (elements x 144, hexahedra x 576) Galerkin products; below the finest level */
    pliant_tangent *tangents;   /* for these products: without rotation */
    float *blocks;              /* (row entries x 9, and 3 more), each column-major */
    float *inverse;             /* (num_free x 9) inverted diagonal blocks */
    double largest;             /* largest eigenvalue of the inverted diagonal times the matrix */
    float *x, *right, *residual, *step; /* (3 num_free) */
} level_values;

struct pliant_multigrid {
    const pliant_hierarchy *hierarchy;
    level_values level[PLIANT_MAX_LEVELS];
    pliant_factor *factor;
    double *values;             /* of the coarsest matrix */
    double *coarsest;           /* (3 num_free of it) */
};

static pliant_status level_create(const pliant_grid_level *grid, bool finest, bool coarsest, int num_threads,
                                  level_values *level)
{
    size_t n = 3 * (size_t)grid->system.num_free, elements = (size_t)pliant_level_elements(&grid->system);
    size_t numbers = grid->system.macros ? 576 : 144;
    level->system = grid->system;
    level->system.num_threads = num_threads;
    bool good =
        (level->x = pliant_calloc(n, sizeof *level->x)) && (level->right = pliant_calloc(n, sizeof *level->right));
    if (!finest) {
        good = good && (level->stiffness = pliant_calloc(elements, numbers * sizeof *level->stiffness)) &&
               (level->tangents = pliant_calloc((size_t)grid->system.num_blocks, sizeof *level->tangents));
        level->system.stiffness = level->stiffness;
        for (int32_t b = 0; good && b < grid->system.num_blocks; b++)
            for (int m = 0; m < 9; m += 4)
                for (int l = 0; l < LANES; l++) level->tangents[b].rotation[m][l] = 1;
    }
    if (!coarsest)
        good = good &&
               (level->blocks =
                    pliant_calloc(9 * (size_t)grid->row_start[grid->system.num_free] + 3, sizeof *level->blocks)) &&
               (level->inverse = pliant_calloc((size_t)grid->system.num_free, 9 * sizeof *level->inverse)) &&
               (level->residual = pliant_calloc(n, sizeof *level->residual)) &&
               (level->step = pliant_calloc(n, sizeof *level->step));
    return good ? PLIANT_OK : pliant_fail_memory("the multigrid");
}

pliant_status pliant_multigrid_create(const pliant_hierarchy *hierarchy, int num_threads, pliant_multigrid **out)
{
    pliant_multigrid *multigrid = pliant_calloc(1, sizeof *multigrid);
    if (!multigrid) return pliant_fail_memory("the multigrid");
    multigrid->hierarchy = hierarchy;
    int last = hierarchy->num_levels - 1;
    pliant_status status = PLIANT_OK;
    for (int l = 0; l <= last && status == PLIANT_OK; l++)
        status = level_create(hierarchy->level + l, l == 0, l == last, num_threads, multigrid->level + l);
    if (status == PLIANT_OK) {
        multigrid->values =
            pliant_calloc((size_t)hierarchy->level[last].system.pattern.num_values, sizeof *multigrid->values);
        multigrid->coarsest =
            pliant_calloc((size_t)hierarchy->level[last].system.num_free, 3 * sizeof *multigrid->coarsest);
        status = multigrid->values && multigrid->coarsest ? pliant_factor_clone(hierarchy->factor, &multigrid->factor)
                                                          : pliant_fail_memory("the multigrid");
    }
    if (status != PLIANT_OK) {
        pliant_multigrid_free(multigrid);
        return status;
    }
    *out = multigrid;
    return PLIANT_OK;
}

void pliant_multigrid_free(pliant_multigrid *multigrid)
{
    if (!multigrid) return;
    for (int l = 0; l < multigrid->hierarchy->num_levels; l++) {
        level_values *level = multigrid->level + l;
        pliant_free(level->stiffness);
        pliant_free(level->tangents);
        pliant_free(level->blocks);
        pliant_free(level->inverse);
        pliant_free(level->x);
        pliant_free(level->right);
        pliant_free(level->residual);
        pliant_free(level->step);
    }
    pliant_factor_free(multigrid->factor);
    pliant_free(multigrid->values);
    pliant_free(multigrid->coarsest);
    pliant_free(multigrid);
}

void pliant_multigrid_threads(pliant_multigrid *multigrid, int num_threads)
{
    for (int l = 0; l < multigrid->hierarchy->num_levels; l++) multigrid->level[l].system.num_threads = num_threads;
}

/* ---- The matrices. */

/* Compute P' K P over the children of one coarse tetrahedron; rows of fixed nodes are zero. */
static void galerkin(const pliant_grid_level *grid, const level_values *fine, const pliant_tangent *tangents,
                     int32_t tet, double out[144])
{
    const pliant_system *system = &fine->system;
    memset(out, 0, 144 * sizeof *out);
    for (int32_t c = grid->child_start[tet]; c < grid->child_start[tet + 1]; c++) {
        int32_t child = grid->child[c];
        double k[144], fraction[4][4];
        pliant_system_element(system, tangents, child, k);
        for (int v = 0; v < 4; v++) {
            int32_t node = system->mesh->tets[4 * child + v];
            memset(fraction[v], 0, sizeof fraction[v]);
            if (system->free_of_node[node] >= 0) pliant_coarse_weights(system, &grid[1].system, node, tet, fraction[v]);
        }
        for (int v = 0; v < 4; v++)
            for (int a = 0; a < 4; a++) {
                if (fraction[v][a] == 0) continue;
                for (int u = 0; u < 4; u++)
                    for (int b = 0; b < 4; b++) {
                        double weight = fraction[v][a] * fraction[u][b];
                        if (weight == 0) continue;
                        for (int r = 0; r < 3; r++)
                            for (int s = 0; s < 3; s++)
                                out[12 * (3 * a + r) + 3 * b + s] += weight * k[12 * (3 * v + r) + 3 * u + s];
                    }
            }
    }
}

/* Compute the blocks of one corner's column, relative to its element's first corner. */
static void element_column(const pliant_system *system, const pliant_tangent *tangents, const double *whole,
                           int32_t corner, int v, double *blocks)
{
    if (system->macros) pliant_macro_column(system, tangents, corner, blocks);
    else
        for (int u = 0; u < 4; u++)
            for (int m = 0; m < 9; m++) blocks[9 * u + m] = whole[12 * (3 * u + m / 3) + 3 * v + m % 3];
}

/* Compute the same for a coarse hexahedron: P' K of one corner first, then its contributions to the coarse corners. */
static void galerkin_cube(const pliant_grid_level *grid, const level_values *fine, const pliant_tangent *tangents,
                          int32_t cube, double out[576])
{
    const pliant_system *system = &fine->system;
    memset(out, 0, 576 * sizeof *out);
    for (int32_t c = grid->child_start[cube]; c < grid->child_start[cube + 1]; c++) {
        const int32_t child = grid->child[c], begin = pliant_element_begin(system, child),
                      count = pliant_element_begin(system, child + 1) - begin;
        const int32_t *node = pliant_element_nodes(system) + begin;
        double fraction[MAX_CORNERS][8], k[MAX_CORNERS * 9], half[8 * 9], whole[144];
        for (int v = 0; v < count; v++) {
            memset(fraction[v], 0, sizeof fraction[v]);
            if (system->free_of_node[node[v]] >= 0)
                pliant_coarse_weights(system, &grid[1].system, node[v], cube, fraction[v]);
        }
        if (!system->macros) pliant_system_element(system, tangents, child, whole);
        for (int v = 0; v < count; v++) {
            if (system->free_of_node[node[v]] < 0) continue;
            element_column(system, tangents, whole, begin + v, v, k);
            memset(half, 0, sizeof half);
            for (int u = 0; u < count; u++)
                for (int b = 0; b < 8; b++)
                    for (int m = 0; fraction[u][b] != 0 && m < 9; m++) half[9 * b + m] += fraction[u][b] * k[9 * u + m];
            for (int a = 0; a < 8; a++)
                for (int b = 0; fraction[v][a] != 0 && b < 8; b++)
                    for (int m = 0; m < 9; m++)
                        out[24 * (3 * a + m % 3) + 3 * b + m / 3] += fraction[v][a] * half[9 * b + m];
        }
    }
}

static void invert(const double m[9], float out[9])
{
    double c[9] = {m[4] * m[8] - m[5] * m[7], m[2] * m[7] - m[1] * m[8], m[1] * m[5] - m[2] * m[4],
                   m[5] * m[6] - m[3] * m[8], m[0] * m[8] - m[2] * m[6], m[2] * m[3] - m[0] * m[5],
                   m[3] * m[7] - m[4] * m[6], m[1] * m[6] - m[0] * m[7], m[0] * m[4] - m[1] * m[3]};
    double determinant = m[0] * c[0] + m[1] * c[3] + m[2] * c[6];
    for (int n = 0; n < 9; n++) out[n] = determinant > 0 ? (float)(c[n] / determinant) : 0;
}

/* Fill a column from elements that list their blocks. */
static void fill_column(const pliant_grid_level *grid, level_values *level, const pliant_tangent *tangents,
                        int32_t column)
{
    const pliant_pattern *pattern = &level->system.pattern;
    for (int32_t b = pattern->start[column]; b < pattern->start[column + 1]; b++) {
        double block[9];
        pliant_system_assemble_block(&level->system, tangents, b, block);
        float *here = level->blocks + 9 * (size_t)grid->place[2 * b];
        for (int m = 0; m < 9; m++) here[m] = (float)block[3 * (m % 3) + m / 3];
        if (grid->place[2 * b + 1] < 0) {
            invert(block, level->inverse + 9 * (size_t)column);
            continue;
        }
        float *there = level->blocks + 9 * (size_t)grid->place[2 * b + 1];
        for (int m = 0; m < 9; m++) there[m] = (float)block[m];
    }
}

static int ascending(const void *a, const void *b)
{
    int32_t x = *(const int32_t *)a, y = *(const int32_t *)b;
    return (x > y) - (x < y);
}

/* Fill a row from hexahedra. A column-major block (row, column) equals the row-major block (column, row). */
static void fill_row(const pliant_grid_level *grid, level_values *level, const pliant_tangent *tangents, int32_t row)
{
    const pliant_system *system = &level->system;
    const pliant_macros *macros = system->macros;
    const int32_t *columns = grid->column + grid->row_start[row];
    size_t count = (size_t)(grid->row_start[row + 1] - grid->row_start[row]);
    float *blocks = level->blocks + 9 * (size_t)grid->row_start[row];
    memset(blocks, 0, 9 * count * sizeof *blocks);
    for (int32_t e = system->corner_start[row]; e < system->corner_end[row]; e++) {
        int32_t corner = system->corner[e], cube = macros->cube_of_corner[corner], begin = macros->start[cube];
        double k[MAX_CORNERS * 9];
        pliant_macro_column(system, tangents, corner, k);
        for (int32_t v = 0; v < macros->start[cube + 1] - begin; v++) {
            int32_t column = system->free_of_node[macros->node[begin + v]];
            if (column < 0) continue;
            const int32_t *found = bsearch(&column, columns, count, sizeof *found, ascending);
            for (int m = 0; m < 9; m++) blocks[9 * (found - columns) + m] += (float)k[9 * v + m];
        }
    }
    const int32_t *diagonal = bsearch(&row, columns, count, sizeof *diagonal, ascending);
    double block[9];
    for (int m = 0; m < 9; m++) block[m] = blocks[9 * (diagonal - columns) + m];
    invert(block, level->inverse + 9 * (size_t)row);
}

static void fill_rows(const pliant_grid_level *grid, level_values *level, const pliant_tangent *tangents)
{
#pragma omp parallel for schedule(static) num_threads(level->system.num_threads)
    for (int32_t n = 0; n < level->system.num_free; n++) {
        if (level->system.macros) fill_row(grid, level, tangents, n);
        else fill_column(grid, level, tangents, n);
    }
}

/* ---- Products with the matrices. */

enum { ROWS = 64 }; /* per thread and work item */
typedef float float4 __attribute__((vector_size(16)));

static inline float4 load4(const float *from)
{
    float4 out;
    memcpy(&out, from, sizeof out);
    return out;
}

/* Compute rows [first, end) of right - A x, or of A x without right. A block's columns are loaded with one extra
 * number, which is not used. */
PLIANT_VECTORIZED static void apply_rows(const int32_t *row_start, const int32_t *columns, const float *blocks,
                                         const float *right, const float *x, float *out, int32_t first, int32_t end)
{
    for (int32_t row = first; row < end; row++) {
        float4 sum = {0}, second = {0}, third = {0};
        for (int32_t e = row_start[row]; e < row_start[row + 1]; e++) {
            const float *a = blocks + 9 * (size_t)e, *v = x + 3 * (size_t)columns[e];
            sum += load4(a) * v[0];
            second += load4(a + 3) * v[1];
            third += load4(a + 6) * v[2];
        }
        sum += second + third;
        for (int d = 0; d < 3; d++) out[3 * row + d] = right ? right[3 * row + d] - sum[d] : sum[d];
    }
}

static void apply(const pliant_grid_level *grid, const level_values *level, const float *right, const float *x,
                  float *out)
{
    const int32_t count = level->system.num_free;
#pragma omp parallel for schedule(static) num_threads(level->system.num_threads)
    for (int32_t first = 0; first < count; first += ROWS)
        apply_rows(grid->row_start, grid->column, level->blocks, right, x, out, first,
                   first + ROWS < count ? first + ROWS : count);
}

/* Compute step = a * step + b * D^-1 residual. */
static void scaled_step(const level_values *level, float a, float b, const float *residual, float *step)
{
#pragma omp parallel for schedule(static) num_threads(level->system.num_threads)
    for (int32_t row = 0; row < level->system.num_free; row++) {
        const float *inverse = level->inverse + 9 * (size_t)row, *r = residual + 3 * row;
        for (int d = 0; d < 3; d++)
            step[3 * row + d] = a * step[3 * row + d] +
                                b * (inverse[3 * d] * r[0] + inverse[3 * d + 1] * r[1] + inverse[3 * d + 2] * r[2]);
    }
}

/* Estimate the largest eigenvalue by power iteration from a fixed, non-smooth start. The margin covers the remaining
 * error. */
static void find_largest(const pliant_grid_level *grid, level_values *level)
{
    size_t n = 3 * (size_t)level->system.num_free;
    uint32_t seed = 12345;
    for (size_t i = 0; i < n; i++) {
        seed = seed * 1664525u + 1013904223u;
        level->step[i] = (float)(seed >> 8) / (1 << 24) - 0.5f;
    }
    level->largest = 1;
    for (int pass = 0; pass < POWER_STEPS; pass++) {
        double before = 0, after = 0;
        for (size_t i = 0; i < n; i++) before += (double)level->step[i] * level->step[i];
        float scale = before > 0 ? (float)(1 / sqrt(before)) : 0;
        for (size_t i = 0; i < n; i++) level->x[i] = scale * level->step[i];
        apply(grid, level, NULL, level->x, level->residual);
        scaled_step(level, 0, 1, level->residual, level->step);
        for (size_t i = 0; i < n; i++) after += (double)level->step[i] * level->step[i];
        level->largest = sqrt(after);
    }
    level->largest *= spectrum_margin;
}

pliant_status pliant_multigrid_numeric(pliant_multigrid *multigrid, const pliant_tangent *tangents)
{
    const pliant_hierarchy *hierarchy = multigrid->hierarchy;
    int last = hierarchy->num_levels - 1;
    for (int l = 0; l < last; l++) {
        const pliant_grid_level *grid = hierarchy->level + l;
        level_values *fine = multigrid->level + l, *coarse = fine + 1;
        const pliant_tangent *at = l == 0 ? tangents : fine->tangents;
#pragma omp parallel for schedule(static) num_threads(fine->system.num_threads)
        for (int32_t e = 0; e < pliant_level_elements(&coarse->system); e++) {
            if (coarse->system.macros) galerkin_cube(grid, fine, at, e, coarse->stiffness + 576 * (size_t)e);
            else galerkin(grid, fine, at, e, coarse->stiffness + 144 * (size_t)e);
        }
        fill_rows(grid, fine, at);
        find_largest(grid, fine);
    }
    pliant_system_assemble(&multigrid->level[last].system, multigrid->level[last].tangents, multigrid->values);
    return pliant_factor_numeric(multigrid->factor, multigrid->values);
}

pliant_status pliant_multigrid_copy(pliant_multigrid *to, const pliant_multigrid *from)
{
    const pliant_hierarchy *hierarchy = to->hierarchy;
    for (int l = 0; l + 1 < hierarchy->num_levels; l++) {
        const pliant_grid_level *grid = hierarchy->level + l;
        size_t n = (size_t)grid->system.num_free;
        memcpy(to->level[l].blocks, from->level[l].blocks, 9 * (size_t)grid->row_start[n] * sizeof(float));
        memcpy(to->level[l].inverse, from->level[l].inverse, 9 * n * sizeof(float));
        to->level[l].largest = from->level[l].largest;
    }
    memcpy(to->values, from->values,
           (size_t)hierarchy->level[hierarchy->num_levels - 1].system.pattern.num_values * sizeof *to->values);
    return pliant_factor_numeric(to->factor, to->values);
}

void pliant_multigrid_level(const pliant_multigrid *multigrid, int level, const float **blocks, const float **inverse,
                            double *largest)
{
    *blocks = multigrid->level[level].blocks;
    *inverse = multigrid->level[level].inverse;
    *largest = multigrid->level[level].largest;
}

const double *pliant_multigrid_coarsest(const pliant_multigrid *multigrid) { return multigrid->values; }

/* ---- The cycle. */

/* Run Chebyshev iteration for A x = right on [share, 1] of the spectrum of D^-1 A (Saad, Iterative Methods, 12.3). */
static void smooth(const pliant_grid_level *grid, level_values *level, const float *right, bool from_zero)
{
    size_t n = 3 * (size_t)level->system.num_free;
    double high = level->largest, low = spectrum_share * high, centre = 0.5 * (high + low), half = 0.5 * (high - low);
    double sigma = centre / half, rho = 1 / sigma;
    if (from_zero) memcpy(level->residual, right, n * sizeof *right);
    else apply(grid, level, right, level->x, level->residual);
    scaled_step(level, 0, (float)(1 / centre), level->residual, level->step);
    for (int pass = 0;; pass++) {
        for (size_t i = 0; i < n; i++) level->x[i] = (from_zero && pass == 0 ? 0 : level->x[i]) + level->step[i];
        if (pass + 1 == SMOOTHING_STEPS) return;
        apply(grid, level, right, level->x, level->residual);
        double next = 1 / (2 * sigma - rho);
        scaled_step(level, (float)(next * rho), (float)(2 * next / half), level->residual, level->step);
        rho = next;
    }
}

static void restrict_residual(const pliant_grid_level *grid, const level_values *fine, level_values *coarse)
{
#pragma omp parallel for schedule(static) num_threads(fine->system.num_threads)
    for (int32_t c = 0; c < coarse->system.num_free; c++) {
        float sum[3] = {0, 0, 0};
        for (int32_t e = grid->from_start[c]; e < grid->from_start[c + 1]; e++)
            for (int d = 0; d < 3; d++)
                sum[d] += grid->weight[grid->from[e]] * fine->residual[3 * (grid->from[e] / grid->corners) + d];
        memcpy(coarse->right + 3 * c, sum, sizeof sum);
    }
}

static void add_correction(const pliant_grid_level *grid, level_values *fine, const level_values *coarse)
{
    const int corners = grid->corners;
#pragma omp parallel for schedule(static) num_threads(fine->system.num_threads)
    for (int32_t f = 0; f < fine->system.num_free; f++)
        for (int v = 0; v < corners; v++) {
            if (grid->weight[corners * f + v] == 0) continue;
            for (int d = 0; d < 3; d++)
                fine->x[3 * f + d] += grid->weight[corners * f + v] * coarse->x[3 * grid->to[corners * f + v] + d];
        }
}

static pliant_status solve_coarsest(pliant_multigrid *multigrid, level_values *level)
{
    size_t n = 3 * (size_t)level->system.num_free;
    for (size_t i = 0; i < n; i++) multigrid->coarsest[i] = level->right[i];
    pliant_status status = pliant_factor_solve(multigrid->factor, 1, multigrid->coarsest, multigrid->coarsest);
    for (size_t i = 0; i < n; i++) level->x[i] = (float)multigrid->coarsest[i];
    return status;
}

/* Run the cycle from level->right to level->x. */
static pliant_status cycle(pliant_multigrid *multigrid, int l)
{
    const pliant_grid_level *grid = multigrid->hierarchy->level + l;
    level_values *level = multigrid->level + l;
    if (l == multigrid->hierarchy->num_levels - 1) return solve_coarsest(multigrid, level);
    smooth(grid, level, level->right, true);
    apply(grid, level, level->right, level->x, level->residual);
    restrict_residual(grid, level, level + 1);
    pliant_status status = cycle(multigrid, l + 1);
    if (status != PLIANT_OK) return status;
    add_correction(grid, level, level + 1);
    smooth(grid, level, level->right, false);
    return PLIANT_OK;
}

/* The computation is in single precision. Scaling keeps small forces within its range. */
pliant_status pliant_multigrid_solve(pliant_multigrid *multigrid, const double *right, double *out)
{
    level_values *level = multigrid->level;
    size_t n = 3 * (size_t)level->system.num_free;
    double largest = 0;
    for (size_t i = 0; i < n; i++) largest = fmax(largest, fabs(right[i]));
    const double scale = largest > 0 && isfinite(largest) ? largest : 1;
    for (size_t i = 0; i < n; i++) level->right[i] = (float)(right[i] / scale);
    pliant_status status = cycle(multigrid, 0);
    for (size_t i = 0; status == PLIANT_OK && i < n; i++) out[i] = scale * level->x[i];
    return status;
}
