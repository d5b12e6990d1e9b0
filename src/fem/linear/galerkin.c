/* Galerkin products of a hierarchy: rigid aggregates' stiffness from their nodes'. */
#include "fem/linear/hierarchy.h"

#include <math.h>
#include <string.h>

void pliant_galerkin_finest(const pliant_system *system, const pliant_tangent *tangents, double *blocks)
{
#pragma omp parallel for schedule(static) num_threads(system->num_threads)
    for (int32_t b = 0; b < system->pattern.num_blocks; b++) pliant_system_assemble_block(system, tangents, b, blocks + 9 * (size_t)b);
}

void pliant_galerkin_arms(const pliant_hierarchy *hierarchy, int level, const double *place, double *centre, double *arm)
{
    const pliant_grid_level *grid = hierarchy->level + level;
    const int32_t stride = level > 0 ? 2 : 1;
    for (int32_t a = 0; a < grid->num_aggregates; a++) {
        double sum[3] = {0, 0, 0};
        int32_t count = 0;
        for (int32_t m = grid->member_start[a]; m < grid->member_start[a + 1]; m++) {
            if (pliant_level_turns(level, grid->member[m])) continue;
            for (int d = 0; d < 3; d++) sum[d] += place[3 * (grid->member[m] / stride) + d];
            count++;
        }
        for (int d = 0; d < 3; d++) centre[3 * a + d] = sum[d] / count;
    }
    for (int32_t n = 0; n < grid->pattern.num_columns; n++)
        for (int d = 0; d < 3; d++)
            arm[3 * (size_t)n + (size_t)d] =
                pliant_level_turns(level, n) ? 0 : place[3 * (size_t)(n / stride) + (size_t)d] - centre[3 * grid->aggregate[n] + d];
}

/* out += a b, or a' b */
static void add_product(const double a[9], const double b[9], bool transposed, double out[9])
{
    for (int r = 0; r < 3; r++)
        for (int c = 0; c < 3; c++)
            for (int k = 0; k < 3; k++) out[3 * r + c] += (transposed ? a[3 * k + r] : a[3 * r + k]) * b[3 * k + c];
}

/* d to w: d x w' = -[d]x, what w x d is of w; of a node that turns itself I */
static void lever(const double d[3], bool turns, double out[9])
{
    const double moving[9] = {0, d[2], -d[1], -d[2], 0, d[0], d[1], -d[0], 0}, turning[9] = {1, 0, 0, 0, 1, 0, 0, 0, 1};
    memcpy(out, turns ? turning : moving, sizeof moving);
}

typedef struct corner {
    double lever[9];
    bool turns;
} corner;

/* what the block of nodes i, j gives to those of their aggregates: moving-moving, moving-turning, turning-moving, turning-turning */
static void add_block(const corner *i, const corner *j, const double k[9], double out[4][9])
{
    double right[9] = {0}; /* K P_j of how j's aggregate turns */
    add_product(k, j->lever, false, right);
    for (int m = 0; m < 9 && !i->turns; m++) {
        if (!j->turns) out[0][m] += k[m];
        out[1][m] += right[m];
    }
    if (!j->turns) add_product(i->lever, k, true, out[2]);
    add_product(i->lever, right, true, out[3]);
}

static void pair_product(const pliant_hierarchy *hierarchy, int level, int32_t pair, bool same, const double *blocks, const double *arm,
                         double out[4][9])
{
    const pliant_grid_level *grid = hierarchy->level + level;
    memset(out, 0, 4 * sizeof *out);
    for (int32_t t = grid->pairs.term_start[pair]; t < grid->pairs.term_start[pair + 1]; t++) {
        const int32_t b = grid->pairs.term[t] / 2, row = grid->pattern.row[b], column = grid->block_column[b];
        const double *k = blocks + 9 * (size_t)b;
        double other[9];
        for (int m = 0; m < 9; m++) other[m] = k[3 * (m % 3) + m / 3];
        corner i = {.turns = pliant_level_turns(level, row)}, j = {.turns = pliant_level_turns(level, column)};
        lever(arm + 3 * (size_t)row, i.turns, i.lever);
        lever(arm + 3 * (size_t)column, j.turns, j.lever);
        const bool transposed = grid->pairs.term[t] % 2;
        if (!transposed) add_block(&i, &j, k, out);
        if (transposed || (same && row != column)) add_block(&j, &i, other, out);
    }
}

/* Aggregates of one node, or of nodes in line, do not resist some of their turns, nor does anything ask for those: a little stiffness
 * keeps the matrix positive definite. */
static void stiffen(const double moving[9], double length, double turning[9])
{
    const double little = 1e-6;
    for (int d = 0; d < 9; d += 4) turning[d] += little * length * length * (moving[0] + moving[4] + moving[8]) / 3;
}

void pliant_galerkin_product(const pliant_hierarchy *hierarchy, int level, const double *blocks, const double *arm, int num_threads, double *coarse)
{
    const pliant_grid_level *grid = hierarchy->level + level;
    const pliant_pattern *pairs = &grid->pairs, *next = &grid[1].pattern;
#pragma omp parallel for schedule(dynamic, 64) num_threads(num_threads)
    for (int32_t a = 0; a < pairs->num_columns; a++)
        for (int32_t p = pairs->start[a]; p < pairs->start[a + 1]; p++) {
            /* the columns of how a moves, and of how it turns, from their diagonals on */
            const int32_t n = 2 * (p - pairs->start[a]);
            const bool same = n == 0;
            double out[4][9];
            pair_product(hierarchy, level, p, same, blocks, arm, out);
            if (same) stiffen(out[0], hierarchy->length, out[3]);
            double *moves = coarse + 9 * (size_t)(next->start[2 * a] + n), *turns = coarse + 9 * (size_t)(next->start[2 * a + 1] + n - 1);
            memcpy(moves, out[0], sizeof out[0]);
            memcpy(moves + 9, out[2], sizeof out[2]);
            if (!same) memcpy(turns, out[1], sizeof out[1]);
            memcpy(turns + 9, out[3], sizeof out[3]);
        }
}
