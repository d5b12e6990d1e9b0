#include "fem/linear/multigrid.h"

#include "base/fail.h"
#include "base/lanes.h"
#include "fem/linear/hierarchy.h"
#include "fem/linear/pattern.h"
#include "pliant/memory.h"

#include <math.h>
#include <string.h>

enum { LANCZOS_STEPS = 12, ROWS_AT_ONCE = 64, PADDING = 4 };

/* numbers of one level */
typedef struct level_values {
    double *lower;              /* (pattern.num_blocks x 9) while numbers are made */
    double *place, *arms;       /* (nodes that move x 3), (nodes x 3), likewise */
    float *blocks;              /* (row entries x 9) column after column, and PADDING */
    float *inverse;             /* (nodes x 9) inverted diagonal blocks, and PADDING */
    float *arm;                 /* (nodes x 3) from the centre of its aggregate [m] */
    double largest;             /* eigenvalue of inverse times matrix */
    float *x, *next, *right, *step; /* (3 nodes) */
} level_values;

struct pliant_multigrid {
    const pliant_hierarchy *hierarchy;
    int num_threads;
    level_values level[PLIANT_MAX_LEVELS];
    pliant_factor *factor;
    double *values;             /* of the coarsest matrix */
    double *coarsest;           /* (3 nodes) of it */
};

static pliant_status level_create(const pliant_grid_level *grid, bool coarsest, level_values *level)
{
    const size_t nodes = (size_t)grid->pattern.num_columns, n = 3 * nodes;
    bool good = (level->x = pliant_calloc(n, sizeof *level->x)) && (level->right = pliant_calloc(n, sizeof *level->right)) &&
                (level->lower = pliant_calloc((size_t)grid->pattern.num_blocks, 9 * sizeof *level->lower)) &&
                (level->place = pliant_calloc(n, sizeof *level->place));
    if (!coarsest)
        good = good && (level->blocks = pliant_calloc(9 * (size_t)grid->row_start[nodes] + PADDING, sizeof *level->blocks)) &&
               (level->inverse = pliant_calloc(9 * nodes + PADDING, sizeof *level->inverse)) &&
               (level->arm = pliant_calloc(n, sizeof *level->arm)) && (level->arms = pliant_calloc(n, sizeof *level->arms)) &&
               (level->next = pliant_calloc(n, sizeof *level->next)) && (level->step = pliant_calloc(n, sizeof *level->step));
    return good ? PLIANT_OK : pliant_fail_memory("the multigrid");
}

pliant_status pliant_multigrid_create(const pliant_hierarchy *hierarchy, int num_threads, pliant_multigrid **out)
{
    pliant_multigrid *multigrid = pliant_calloc(1, sizeof *multigrid);
    if (!multigrid) return pliant_fail_memory("the multigrid");
    multigrid->hierarchy = hierarchy;
    multigrid->num_threads = num_threads;
    int last = hierarchy->num_levels - 1;
    pliant_status status = PLIANT_OK;
    for (int l = 0; l <= last && status == PLIANT_OK; l++) status = level_create(hierarchy->level + l, l == last, multigrid->level + l);
    if (status == PLIANT_OK) {
        const pliant_pattern *pattern = &hierarchy->level[last].pattern;
        multigrid->values = pliant_calloc((size_t)pattern->num_values, sizeof *multigrid->values);
        multigrid->coarsest = pliant_calloc((size_t)pattern->num_columns, 3 * sizeof *multigrid->coarsest);
        bool good = multigrid->values && multigrid->coarsest;
        status = good ? pliant_factor_clone(hierarchy->factor, &multigrid->factor) : pliant_fail_memory("the multigrid");
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
        void *arrays[] = {level->lower, level->place, level->arms, level->blocks, level->inverse, level->arm, level->x, level->next, level->right, level->step};
        for (size_t a = 0; a < sizeof arrays / sizeof *arrays; a++) pliant_free(arrays[a]);
    }
    pliant_factor_free(multigrid->factor);
    pliant_free(multigrid->values);
    pliant_free(multigrid->coarsest);
    pliant_free(multigrid);
}

void pliant_multigrid_threads(pliant_multigrid *multigrid, int num_threads) { multigrid->num_threads = num_threads; }

/* ---- the matrices */

static void invert(const double m[9], float out[9])
{
    double c[9] = {m[4] * m[8] - m[5] * m[7], m[2] * m[7] - m[1] * m[8], m[1] * m[5] - m[2] * m[4],
                   m[5] * m[6] - m[3] * m[8], m[0] * m[8] - m[2] * m[6], m[2] * m[3] - m[0] * m[5],
                   m[3] * m[7] - m[4] * m[6], m[1] * m[6] - m[0] * m[7], m[0] * m[4] - m[1] * m[3]};
    double determinant = m[0] * c[0] + m[1] * c[3] + m[2] * c[6];
    for (int n = 0; n < 9; n++) out[n] = determinant > 0 ? (float)(c[n] / determinant) : 0;
}

static void fill_rows(const pliant_grid_level *grid, level_values *level, int num_threads)
{
#pragma omp parallel for schedule(static) num_threads(num_threads)
    for (int32_t b = 0; b < grid->pattern.num_blocks; b++) {
        const double *block = level->lower + 9 * (size_t)b;
        float *here = level->blocks + 9 * (size_t)grid->place[2 * b];
        for (int m = 0; m < 9; m++) here[m] = (float)block[3 * (m % 3) + m / 3];
        if (grid->place[2 * b + 1] < 0) {
            invert(block, level->inverse + 9 * (size_t)grid->block_column[b]);
            continue;
        }
        float *there = level->blocks + 9 * (size_t)grid->place[2 * b + 1];
        for (int m = 0; m < 9; m++) there[m] = (float)block[m];
    }
}

/* three numbers and one that does not count */
typedef float four __attribute__((vector_size(16)));

static inline __attribute__((always_inline)) four load(const float *from)
{
    four out;
    memcpy(&out, from, sizeof out);
    return out;
}

/* block times vector; the block column after column */
static inline __attribute__((always_inline)) four times(const float *block, const float *v)
{
    return load(block) * v[0] + load(block + 3) * v[1] + load(block + 6) * v[2];
}

/* what smoothing does to some rows: step = again step + fresh D^-1 (right - A x), next = x + step; with next NULL, step = right - A x */
typedef struct sweep {
    const pliant_grid_level *grid;
    const level_values *level;
    const float *right, *x; /* Nullable: zero */
    float *step, *next;
    float again, fresh;
} sweep;

PLIANT_VECTORIZED static void sweep_rows(const sweep *s, int32_t from, int32_t to)
{
    const int32_t *start = s->grid->row_start, *column = s->grid->column;
    for (int32_t row = from; row < to; row++) {
        four sum = {0, 0, 0, 0};
        for (int32_t e = start[row]; s->x && e < start[row + 1]; e++) sum += times(s->level->blocks + 9 * (size_t)e, s->x + 3 * (size_t)column[e]);
        float residual[3], *step = s->step + 3 * (size_t)row;
        for (int d = 0; d < 3; d++) residual[d] = (s->right ? s->right[3 * (size_t)row + (size_t)d] : 0) - sum[d];
        if (!s->next) {
            memcpy(step, residual, sizeof residual);
            continue;
        }
        four fresh = times(s->level->inverse + 9 * (size_t)row, residual);
        for (int d = 0; d < 3; d++) {
            step[d] = (s->again != 0 ? s->again * step[d] : 0) + s->fresh * fresh[d];
            s->next[3 * (size_t)row + (size_t)d] = (s->x ? s->x[3 * (size_t)row + (size_t)d] : 0) + step[d];
        }
    }
}

static void run(const sweep *s, int num_threads)
{
    const int32_t rows = s->grid->pattern.num_columns;
#pragma omp parallel for schedule(static) num_threads(num_threads)
    for (int32_t from = 0; from < rows; from += ROWS_AT_ONCE) sweep_rows(s, from, from + ROWS_AT_ONCE < rows ? from + ROWS_AT_ONCE : rows);
}

/* Largest eigenvalue of a symmetric tridiagonal matrix: where a Sturm sequence (Golub and Van Loan, 8.4.2) counts none above. */
static double largest_of(int n, const double *diagonal, const double *beside)
{
    double low = 0, high = 0;
    for (int k = 0; k < n; k++) high = fmax(high, fabs(diagonal[k]) + (k > 0 ? fabs(beside[k - 1]) : 0) + (k + 1 < n ? fabs(beside[k]) : 0));
    for (int pass = 0; pass < 40; pass++) {
        const double middle = 0.5 * (low + high);
        double pivot = diagonal[0] - middle;
        bool above = pivot > 0;
        for (int k = 1; k < n && !above; k++) {
            pivot = diagonal[k] - middle - beside[k - 1] * beside[k - 1] / fmin(pivot, -1e-30);
            above = pivot > 0;
        }
        if (above) low = middle;
        else high = middle;
    }
    return high;
}

static double dot(size_t n, const float *a, const float *b)
{
    double sum = 0;
    for (size_t i = 0; i < n; i++) sum += (double)a[i] * b[i];
    return sum;
}

/* Of D^-1 A, by Lanczos: conjugate gradients for A x = r know its tridiagonal matrix (Saad, Iterative Methods, 6.7.3). From a fixed start
 * that is far from smooth; the margin covers what it has not found yet. */
static void find_largest(const pliant_grid_level *grid, level_values *level, int num_threads)
{
    const double margin = 1.05;
    const size_t n = 3 * (size_t)grid->pattern.num_columns;
    float *r = level->right, *z = level->next, *p = level->x, *q = level->step;
    uint32_t seed = 12345;
    for (size_t i = 0; i < n; i++) {
        seed = seed * 1664525u + 1013904223u;
        r[i] = (float)(seed >> 8) / (1 << 24) - 0.5f;
        p[i] = 0;
    }
    const sweep scaled = {.grid = grid, .level = level, .right = r, .step = q, .next = z, .fresh = 1};
    const sweep product = {.grid = grid, .level = level, .x = p, .step = q};
    double diagonal[LANCZOS_STEPS], beside[LANCZOS_STEPS], alpha = 0, before = 0;
    int found = 0;
    while (found < LANCZOS_STEPS) {
        run(&scaled, num_threads);
        const double now = dot(n, r, z), beta = before > 0 ? now / before : 0;
        if (!(now > 0)) break;
        if (found > 0) beside[found - 1] = sqrt(beta) / alpha;
        for (size_t i = 0; i < n; i++) p[i] = z[i] + (float)beta * p[i];
        run(&product, num_threads); /* q = -A p */
        const double curvature = -dot(n, p, q), behind = found > 0 ? beta / alpha : 0;
        if (!(curvature > 0)) break;
        alpha = now / curvature;
        diagonal[found++] = 1 / alpha + behind;
        for (size_t i = 0; i < n; i++) r[i] += (float)alpha * q[i];
        before = now;
    }
    level->largest = found > 0 ? margin * largest_of(found, diagonal, beside) : 1;
}

pliant_status pliant_multigrid_numeric(pliant_multigrid *multigrid, const double *positions, const pliant_tangent *tangents)
{
    const pliant_hierarchy *hierarchy = multigrid->hierarchy;
    const int last = hierarchy->num_levels - 1, threads = multigrid->num_threads;
    pliant_system system = hierarchy->system;
    system.num_threads = threads;
    level_values *finest = multigrid->level;
    pliant_galerkin_finest(&system, tangents, finest->lower);
    for (int32_t f = 0; f < system.num_free; f++)
        memcpy(finest->place + 3 * (size_t)f, positions + 3 * (size_t)system.node_of_free[f], 3 * sizeof *positions);
    for (int l = 0; l < last; l++) {
        const pliant_grid_level *grid = hierarchy->level + l;
        level_values *level = multigrid->level + l;
        fill_rows(grid, level, threads);
        find_largest(grid, level, threads);
        pliant_galerkin_arms(hierarchy, l, level->place, level[1].place, level->arms);
        for (size_t i = 0; i < 3 * (size_t)grid->pattern.num_columns; i++) level->arm[i] = (float)level->arms[i];
        pliant_galerkin_product(hierarchy, l, level->lower, level->arms, threads, level[1].lower);
    }
    pliant_pattern_values(&hierarchy->level[last].pattern, multigrid->level[last].lower, multigrid->values);
    return pliant_factor_numeric(multigrid->factor, multigrid->values);
}

pliant_status pliant_multigrid_copy(pliant_multigrid *to, const pliant_multigrid *from)
{
    const pliant_hierarchy *hierarchy = to->hierarchy;
    for (int l = 0; l + 1 < hierarchy->num_levels; l++) {
        const pliant_grid_level *grid = hierarchy->level + l;
        size_t n = (size_t)grid->pattern.num_columns;
        memcpy(to->level[l].blocks, from->level[l].blocks, 9 * (size_t)grid->row_start[n] * sizeof(float));
        memcpy(to->level[l].inverse, from->level[l].inverse, 9 * n * sizeof(float));
        memcpy(to->level[l].arm, from->level[l].arm, 3 * n * sizeof(float));
        to->level[l].largest = from->level[l].largest;
    }
    memcpy(to->values, from->values, (size_t)hierarchy->level[hierarchy->num_levels - 1].pattern.num_values * sizeof *to->values);
    return pliant_factor_numeric(to->factor, to->values);
}

void pliant_multigrid_level(const pliant_multigrid *multigrid, int level, const float **blocks, const float **inverse, const float **arm,
                            double *largest)
{
    *blocks = multigrid->level[level].blocks;
    *inverse = multigrid->level[level].inverse;
    *arm = multigrid->level[level].arm;
    *largest = multigrid->level[level].largest;
}

const double *pliant_multigrid_coarsest(const pliant_multigrid *multigrid) { return multigrid->values; }

/* ---- the cycle */

pliant_chebyshev pliant_multigrid_smoother(double largest)
{
    const double share = 0.12, low = share * largest, centre = 0.5 * (largest + low), half = 0.5 * (largest - low);
    const double sigma = centre / half, rho = 1 / sigma, next = 1 / (2 * sigma - rho);
    return (pliant_chebyshev){(float)(1 / centre), (float)(next * rho), (float)(2 * next / half)};
}

/* two steps, from zero or from x */
static void smooth(const pliant_grid_level *grid, level_values *level, bool from_zero, int num_threads)
{
    const pliant_chebyshev by = pliant_multigrid_smoother(level->largest);
    const sweep first = {.grid = grid, .level = level, .right = level->right, .x = from_zero ? NULL : level->x, .step = level->step,
                         .next = level->next, .fresh = by.first};
    const sweep second = {.grid = grid, .level = level, .right = level->right, .x = level->next, .step = level->step,
                          .next = level->x, .again = by.again, .fresh = by.fresh};
    run(&first, num_threads);
    run(&second, num_threads);
}

/* forces of aggregates, and moments about their centres */
static void restrict_residual(const pliant_hierarchy *hierarchy, int l, level_values *level, int num_threads)
{
    const pliant_grid_level *grid = hierarchy->level + l;
    const sweep residual = {.grid = grid, .level = level, .right = level->right, .x = level->x, .step = level->step};
    run(&residual, num_threads);
#pragma omp parallel for schedule(static) num_threads(num_threads)
    for (int32_t a = 0; a < grid->num_aggregates; a++) {
        float sum[6] = {0, 0, 0, 0, 0, 0};
        for (int32_t m = grid->member_start[a]; m < grid->member_start[a + 1]; m++) {
            const int32_t node = grid->member[m];
            const float *f = level->step + 3 * (size_t)node, *d = level->arm + 3 * (size_t)node;
            if (pliant_level_turns(l, node)) {
                for (int c = 0; c < 3; c++) sum[3 + c] += f[c];
                continue;
            }
            for (int c = 0; c < 3; c++) sum[c] += f[c];
            sum[3] += d[1] * f[2] - d[2] * f[1];
            sum[4] += d[2] * f[0] - d[0] * f[2];
            sum[5] += d[0] * f[1] - d[1] * f[0];
        }
        memcpy(level[1].right + 6 * (size_t)a, sum, sizeof sum);
    }
}

static void add_correction(const pliant_hierarchy *hierarchy, int l, level_values *level, int num_threads)
{
    const pliant_grid_level *grid = hierarchy->level + l;
#pragma omp parallel for schedule(static) num_threads(num_threads)
    for (int32_t n = 0; n < grid->pattern.num_columns; n++) {
        const float *t = level[1].x + 6 * (size_t)grid->aggregate[n], *w = t + 3, *d = level->arm + 3 * (size_t)n;
        float *x = level->x + 3 * (size_t)n;
        const bool turns = pliant_level_turns(l, n);
        x[0] += turns ? w[0] : t[0] + w[1] * d[2] - w[2] * d[1];
        x[1] += turns ? w[1] : t[1] + w[2] * d[0] - w[0] * d[2];
        x[2] += turns ? w[2] : t[2] + w[0] * d[1] - w[1] * d[0];
    }
}

static pliant_status solve_coarsest(pliant_multigrid *multigrid, const level_values *level, size_t n)
{
    for (size_t i = 0; i < n; i++) multigrid->coarsest[i] = level->right[i];
    pliant_status status = pliant_factor_solve(multigrid->factor, 1, multigrid->coarsest, multigrid->coarsest);
    for (size_t i = 0; i < n; i++) level->x[i] = (float)multigrid->coarsest[i];
    return status;
}

/* x of a level for its right */
static pliant_status cycle(pliant_multigrid *multigrid, int l)
{
    const pliant_hierarchy *hierarchy = multigrid->hierarchy;
    const pliant_grid_level *grid = hierarchy->level + l;
    const int threads = multigrid->num_threads, times_through = l > 0 ? PLIANT_CYCLES_BELOW : 1;
    level_values *level = multigrid->level + l;
    if (l == hierarchy->num_levels - 1) return solve_coarsest(multigrid, level, 3 * (size_t)grid->pattern.num_columns);
    for (int pass = 0; pass < times_through; pass++) {
        smooth(grid, level, pass == 0, threads);
        restrict_residual(hierarchy, l, level, threads);
        pliant_status status = cycle(multigrid, l + 1);
        if (status != PLIANT_OK) return status;
        add_correction(hierarchy, l, level, threads);
        smooth(grid, level, false, threads);
    }
    return PLIANT_OK;
}

pliant_status pliant_multigrid_solve(pliant_multigrid *multigrid, const double *right, double *out)
{
    level_values *finest = multigrid->level;
    const size_t n = 3 * (size_t)multigrid->hierarchy->system.num_free;
    for (size_t i = 0; i < n; i++) finest->right[i] = (float)right[i];
    pliant_status status = cycle(multigrid, 0);
    for (size_t i = 0; status == PLIANT_OK && i < n; i++) out[i] = finest->x[i];
    return status;
}
