#include "base/fail.h"
#include "fem/linear/half_solve.h"
#include "fem/system.h"
#include "base/memory.h"

#include <cholmod.h>
#include <pthread.h>
#include <stdlib.h>
#include <string.h>

struct pliant_factor {
    cholmod_common common; /* one per factor, since different threads use them */
    cholmod_factor *cholesky;
    int32_t size;          /* scalar unknowns */
    bool in_double;        /* no panels */
    int *column_start, *row; /* (size + 1), (values): the pattern in CHOLMOD's format, int indices */
    cholmod_dense *solution, *workspace, *workspace_sparse;
    pliant_panels panels;  /* copy of the values if the factor is supernodal; empty: CHOLMOD solves */
    pliant_reach reach;    /* of pliant_factor_reach; empty: not used yet */
};

/* Concurrent calls of BLAS: CHOLMOD calls it from the stepping thread and the factoring thread. OpenBLAS built for one
 * thread is not safe for concurrent calls (results change from run to run), so its calls are serialized. OpenBLAS built
 * for threads is safe. It gets one thread, since Pliant's own threads use all cores. */
extern int openblas_get_parallel(void) __attribute__((weak));
extern void openblas_set_num_threads(int threads) __attribute__((weak));

static pthread_once_t blas_known = PTHREAD_ONCE_INIT;
static pthread_mutex_t blas_lock = PTHREAD_MUTEX_INITIALIZER;
static bool blas_is_unsafe;

static void know_blas(void)
{
    if (!openblas_get_parallel) return;
    blas_is_unsafe = openblas_get_parallel() == 0;
    if (blas_is_unsafe)
        pliant_log(PLIANT_LOG_WARNING,
                   "this OpenBLAS is built for one thread: solving waits while a factor is made in the background; "
                   "install libopenblas0-pthread");
    else if (openblas_set_num_threads && !getenv("OPENBLAS_NUM_THREADS"))
        openblas_set_num_threads(1);
}

static void enter_blas(void)
{
    if (blas_is_unsafe) pthread_mutex_lock(&blas_lock);
}

static void leave_blas(void)
{
    if (blas_is_unsafe) pthread_mutex_unlock(&blas_lock);
}

static pliant_status from_cholmod(const pliant_factor *factor, const char *what)
{
    switch (factor->common.status) {
    case CHOLMOD_OK: return PLIANT_OK;
    case CHOLMOD_OUT_OF_MEMORY: return pliant_fail_memory(what);
    case CHOLMOD_TOO_LARGE:
        return pliant_fail(PLIANT_ERROR_SCENE,
                           "%s: %d unknowns are too many for a direct factorization; use fewer cells", what,
                           factor->size);
    case CHOLMOD_NOT_POSDEF:
        return pliant_fail(PLIANT_ERROR_NUMERIC,
                           "%s: the stiffness matrix is not positive definite: too little is fixed, or the stiffness "
                           "contrast is beyond double precision",
                           what);
    default: return pliant_fail(PLIANT_ERROR_NUMERIC, "%s: CHOLMOD reports status %d", what, factor->common.status);
    }
}

static cholmod_sparse view_of(const pliant_factor *factor, double *values)
{
    cholmod_sparse view;
    memset(&view, 0, sizeof view);
    view.nrow = view.ncol = (size_t)factor->size;
    view.nzmax = (size_t)factor->column_start[factor->size];
    view.p = factor->column_start;
    view.i = factor->row;
    view.x = values;
    view.stype = -1;
    view.itype = CHOLMOD_INT;
    view.xtype = values ? CHOLMOD_REAL : CHOLMOD_PATTERN;
    view.dtype = CHOLMOD_DOUBLE;
    view.sorted = 1;
    view.packed = 1;
    return view;
}

static void scalar_pattern(const pliant_pattern *pattern, int *column_start, int *row)
{
    for (int32_t column = 0; column < pattern->num_columns; column++) {
        int32_t first = pattern->start[column], height = pattern->start[column + 1] - first;
        int next = 9 * first - 3 * column;
        for (int c = 0; c < 3; c++) {
            column_start[3 * column + c] = next;
            for (int32_t n = 0; n < height; n++)
                for (int r = n == 0 ? c : 0; r < 3; r++) row[next++] = 3 * pattern->row[first + n] + r;
        }
        column_start[3 * column + 3] = next;
    }
}

static pliant_factor *factor_new(int32_t size, size_t values)
{
    pliant_factor *factor = pliant_calloc(1, sizeof *factor);
    if (!factor) return NULL;
    pthread_once(&blas_known, know_blas);
    cholmod_start(&factor->common);
    factor->common.print = 0;
    factor->common.error_handler = NULL;
    factor->common.try_catch = 1;
    factor->size = size;
    factor->column_start = pliant_calloc((size_t)size + 1, sizeof *factor->column_start);
    factor->row = pliant_calloc(values, sizeof *factor->row);
    if (factor->column_start && factor->row) return factor;
    pliant_factor_free(factor);
    return NULL;
}

static pthread_mutex_t metis_lock = PTHREAD_MUTEX_INITIALIZER;

/* Order the columns of 3 x 3 blocks as given. */
static pliant_status order_as(pliant_factor *factor, const int32_t *order)
{
    cholmod_sparse view = view_of(factor, NULL);
    cholmod_common *common = &factor->common;
    int *scalar = pliant_calloc((size_t)factor->size, sizeof *scalar);
    if (!scalar) return pliant_fail_memory("the factor");
    for (int32_t i = 0; i < factor->size; i++) scalar[i] = 3 * order[i / 3] + i % 3;
    common->nmethods = 1;
    common->method[0].ordering = CHOLMOD_GIVEN;
    factor->cholesky = cholmod_analyze_p(&view, scalar, NULL, 0, common);
    common->nmethods = 0;
    pliant_free(scalar);
    return from_cholmod(factor, "symbolic factorization");
}

/* Choose the better of two orderings, as CHOLMOD does: minimum degree, and METIS if that causes much fill-in. METIS
 * uses C's rand() and sets signal handlers of the process. Two concurrent calls would change orderings from run to run,
 * and leave the handlers installed. */
static pliant_status find_order(pliant_factor *factor)
{
    const double operations = 500, fill = 5; /* operations per value of the factor, values of the factor per value of
                                              * the matrix */
    cholmod_sparse view = view_of(factor, NULL);
    cholmod_common *common = &factor->common;
    common->nmethods = 1;
    common->method[0].ordering = CHOLMOD_AMD;
    factor->cholesky = cholmod_analyze(&view, common);
    common->nmethods = 0; /* the default: try both */
    if (common->status == CHOLMOD_OK && common->fl >= operations * common->lnz && common->lnz >= fill * common->anz) {
        cholmod_free_factor(&factor->cholesky, common);
        pthread_mutex_lock(&metis_lock);
        factor->cholesky = cholmod_analyze(&view, common);
        pthread_mutex_unlock(&metis_lock);
    }
    return from_cholmod(factor, "symbolic factorization");
}

pliant_status pliant_factor_analyze(const pliant_pattern *pattern, pliant_factor **out)
{
    return pliant_factor_analyze_in(pattern, NULL, out);
}

int32_t pliant_factor_order(const pliant_factor *factor, int32_t *order)
{
    const int *permutation = factor->cholesky->Perm;
    int32_t count = 0;
    uint8_t *visited = pliant_calloc((size_t)factor->size / 3, 1);
    for (int32_t i = 0; visited && i < factor->size; i++) {
        if (visited[permutation[i] / 3]) continue;
        visited[permutation[i] / 3] = 1;
        order[count++] = permutation[i] / 3;
    }
    pliant_free(visited);
    return count;
}

pliant_status pliant_factor_analyze_in(const pliant_pattern *pattern, const int32_t *columns, pliant_factor **out)
{
    if (pattern->num_values > INT32_MAX)
        return pliant_fail(PLIANT_ERROR_SCENE,
                           "the matrix has too many entries for a direct factorization; use fewer cells");
    pliant_factor *factor = factor_new(3 * pattern->num_columns, (size_t)pattern->num_values);
    if (!factor) return pliant_fail_memory("the factor");
    scalar_pattern(pattern, factor->column_start, factor->row);
    pliant_status status = columns ? order_as(factor, columns) : find_order(factor);
    if (status != PLIANT_OK) {
        pliant_factor_free(factor);
        return status;
    }
    *out = factor;
    return PLIANT_OK;
}

pliant_status pliant_factor_analyze_scalar(int32_t size, const int *column_start, const int *row, pliant_factor **out)
{
    pliant_factor *factor = factor_new(size, (size_t)column_start[size]);
    if (!factor) return pliant_fail_memory("the factor");
    memcpy(factor->column_start, column_start, ((size_t)size + 1) * sizeof *column_start);
    memcpy(factor->row, row, (size_t)column_start[size] * sizeof *row);
    const pliant_status status = find_order(factor);
    if (status != PLIANT_OK) {
        pliant_factor_free(factor);
        return status;
    }
    *out = factor;
    return PLIANT_OK;
}

void pliant_factor_in_double(pliant_factor *factor) { factor->in_double = true; }

static pliant_supernodes supernodes_of(const pliant_factor *factor)
{
    const cholmod_factor *l = factor->cholesky;
    return (pliant_supernodes){.count = (int32_t)l->nsuper,
                               .first = l->super,
                               .row_start = l->pi,
                               .value_start = l->px,
                               .row = l->s,
                               .permutation = l->Perm,
                               .value = l->x};
}

/* Copy the values to single precision, if CHOLMOD made supernodes. */
static pliant_status fill_panels(pliant_factor *factor)
{
    if (factor->in_double || !factor->cholesky->is_super || !factor->cholesky->x) return PLIANT_OK;
    pliant_status status =
        factor->panels.value ? PLIANT_OK : pliant_panels_create(factor->cholesky->xsize, factor->size, &factor->panels);
    if (status != PLIANT_OK) return status;
    pliant_supernodes supernodes = supernodes_of(factor);
    pliant_panels_fill(&factor->panels, &supernodes);
    return PLIANT_OK;
}

pliant_status pliant_factor_clone(const pliant_factor *source, pliant_factor **out)
{
    size_t values = (size_t)source->column_start[source->size];
    pliant_factor *factor = factor_new(source->size, values);
    if (!factor) return pliant_fail_memory("a second factor");
    memcpy(factor->column_start, source->column_start, ((size_t)source->size + 1) * sizeof *factor->column_start);
    memcpy(factor->row, source->row, values * sizeof *factor->row);
    factor->cholesky = cholmod_copy_factor(source->cholesky, &factor->common);
    factor->common.fl = source->common.fl; /* the analysis counted them */
    pliant_status status = from_cholmod(factor, "copy of the symbolic factorization");
    if (status == PLIANT_OK) status = fill_panels(factor);
    if (status != PLIANT_OK) {
        pliant_factor_free(factor);
        return status;
    }
    *out = factor;
    return PLIANT_OK;
}

/* Return whether all pivots are positive. CHOLMOD's supernodal factor L L' stops at a pivot that is not positive. The
 * factor L D L' of small matrices does not stop, and its solutions are then no valid merit. */
static bool is_positive(const cholmod_factor *l)
{
    if (l->is_super || l->is_ll) return true;
    const int *start = l->p;
    const double *value = l->x;
    for (size_t column = 0; column < l->n; column++)
        if (!(value[start[column]] > 0)) return false;
    return true;
}

pliant_status pliant_factor_numeric(pliant_factor *factor, double *values)
{
    cholmod_sparse view = view_of(factor, values);
    enter_blas();
    cholmod_factorize(&view, factor->cholesky, &factor->common);
    leave_blas();
    if (factor->common.status == CHOLMOD_OK && !is_positive(factor->cholesky))
        factor->common.status = CHOLMOD_NOT_POSDEF;
    pliant_status status = from_cholmod(factor, "factorization");
    return status == PLIANT_OK ? fill_panels(factor) : status;
}

pliant_status pliant_factor_solve(pliant_factor *factor, int32_t columns, const double *right, double *out)
{
    if (factor->panels.value) {
        pliant_supernodes supernodes = supernodes_of(factor);
        for (int32_t c = 0; c < columns; c++) {
            size_t at = (size_t)c * (size_t)factor->size;
            pliant_panels_solve(&factor->panels, &supernodes, factor->size, right + at, out + at);
        }
        return PLIANT_OK;
    }
    cholmod_dense b;
    memset(&b, 0, sizeof b);
    b.nrow = b.d = (size_t)factor->size;
    b.ncol = (size_t)columns;
    b.nzmax = b.nrow * b.ncol;
    b.x = (double *)(uintptr_t)right; /* CHOLMOD reads it only */
    b.xtype = CHOLMOD_REAL;
    b.dtype = CHOLMOD_DOUBLE;
    enter_blas();
    cholmod_solve2(CHOLMOD_A, factor->cholesky, &b, NULL, &factor->solution, NULL, &factor->workspace,
                   &factor->workspace_sparse, &factor->common);
    leave_blas();
    pliant_status status = from_cholmod(factor, "solve");
    if (status == PLIANT_OK) memcpy(out, factor->solution->x, b.nzmax * sizeof *out);
    return status;
}

pliant_status pliant_factor_reach(pliant_factor *factor, int32_t count, const int32_t *nodes, bool *possible)
{
    *possible = factor->panels.value != NULL;
    if (!*possible) return PLIANT_OK;
    pliant_supernodes supernodes = supernodes_of(factor);
    pliant_status status =
        factor->reach.of ? PLIANT_OK : pliant_reach_create(&supernodes, factor->size, &factor->reach);
    if (status == PLIANT_OK) pliant_reach_mark(&factor->reach, &supernodes, count, nodes);
    return status;
}

void pliant_factor_begin(pliant_factor *factor, const double *right, double *out)
{
    pliant_supernodes supernodes = supernodes_of(factor);
    pliant_panels_begin(&factor->panels, &supernodes, &factor->reach, factor->size, right, out);
}

void pliant_factor_end(pliant_factor *factor, const double *more, double *out)
{
    pliant_supernodes supernodes = supernodes_of(factor);
    pliant_panels_end(&factor->panels, &supernodes, &factor->reach, factor->size, more, out);
}

void pliant_factor_begin_half(pliant_factor *factor, const double *right)
{
    pliant_supernodes supernodes = supernodes_of(factor);
    pliant_panels_begin_half(&factor->panels, &supernodes, factor->size, right);
}

void pliant_factor_end_half(pliant_factor *factor, double *out)
{
    pliant_supernodes supernodes = supernodes_of(factor);
    pliant_panels_end_half(&factor->panels, &supernodes, factor->size, out);
}

pliant_status pliant_factor_half(pliant_factor *factor, int32_t node, pliant_half_solve *out)
{
    pliant_supernodes supernodes = supernodes_of(factor);
    return pliant_half_solve_compute(&factor->panels, &supernodes, &factor->reach, node, out);
}

void pliant_factor_half_product(const pliant_factor *factor, const pliant_half_solve *a, const pliant_half_solve *b,
                                double out[9])
{
    pliant_half_solve_product(&factor->reach, a, b, out);
}

void pliant_factor_half_answer(const pliant_factor *factor, const pliant_half_solve *half, double out[3])
{
    pliant_supernodes supernodes = supernodes_of(factor);
    pliant_half_solve_displacement(&supernodes, &factor->reach, half, factor->panels.x, out);
}

void pliant_factor_half_add(pliant_factor *factor, const pliant_half_solve *half, const double force[3])
{
    pliant_supernodes supernodes = supernodes_of(factor);
    pliant_half_solve_add_force(&supernodes, &factor->reach, half, force, factor->panels.x);
}

double pliant_factor_condition(pliant_factor *factor)
{
    double reciprocal = cholmod_rcond(factor->cholesky, &factor->common);
    return reciprocal > 0 ? 1 / reciprocal : 0;
}

double pliant_factor_operations(const pliant_factor *factor) { return factor->common.fl; }

double pliant_factor_values(const pliant_factor *factor) { return factor->common.lnz; }

size_t pliant_factor_bytes(const pliant_factor *factor) { return factor ? factor->common.memory_inuse : 0; }

void pliant_factor_free(pliant_factor *factor)
{
    if (!factor) return;
    cholmod_free_factor(&factor->cholesky, &factor->common);
    cholmod_free_dense(&factor->solution, &factor->common);
    cholmod_free_dense(&factor->workspace, &factor->common);
    cholmod_free_dense(&factor->workspace_sparse, &factor->common);
    cholmod_finish(&factor->common);
    pliant_free(factor->column_start);
    pliant_free(factor->row);
    pliant_panels_free(&factor->panels);
    pliant_reach_free(&factor->reach);
    pliant_free(factor);
}
