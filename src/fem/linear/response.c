#include "fem/linear/response.h"

#include "base/fail.h"
#include "base/dense.h"
#include "base/memory.h"

#include <math.h>
#include <string.h>

static double largest(size_t n, const double *v)
{
    double maximum = 0;
    for (size_t i = 0; i < n; i++) maximum = fmax(maximum, fabs(v[i]));
    return maximum;
}

pliant_status pliant_linearized_create(const pliant_system *system, const double *x, pliant_linearized *out)
{
    pliant_linearized linearized = {.system = *system, .x = x};
    linearized.system.num_threads = 1;
    linearized.at = pliant_calloc((size_t)system->mesh->num_nodes, 3 * sizeof *linearized.at);
    linearized.element_forces = pliant_calloc((size_t)system->num_blocks, sizeof *linearized.element_forces);
    if (!linearized.at || !linearized.element_forces) {
        pliant_linearized_free(&linearized);
        return pliant_fail_memory("the response of the fine mesh");
    }
    *out = linearized;
    return PLIANT_OK;
}

void pliant_linearized_free(pliant_linearized *linearized)
{
    pliant_free(linearized->at);
    pliant_free(linearized->element_forces);
    memset(linearized, 0, sizeof *linearized);
}

pliant_status pliant_linearized_check_cancel(const pliant_linearized *linearized)
{
    return pliant_report_progress(linearized->progress, 0, "patch") ? PLIANT_OK : PLIANT_ERROR_CANCELLED;
}

void pliant_linearized_forces(pliant_linearized *linearized, const double *u, double *out)
{
    const pliant_system *system = &linearized->system;
    memcpy(linearized->at, linearized->x, 3 * (size_t)system->mesh->num_nodes * sizeof *linearized->at);
    for (int32_t f = 0; f < system->num_free; f++)
        for (int d = 0; d < 3; d++) linearized->at[3 * system->node_of_free[f] + d] += u[3 * f + d];
    pliant_system_element_forces(system, linearized->at, linearized->element_forces);
    pliant_system_gather(system, linearized->element_forces, out);
}

/* Return the largest displacement in a difference quotient. fraction: as a fraction of a cell's shortest edge. */
static double step_of(const pliant_system *system, double fraction)
{
    const double *size = system->mesh->cell_size;
    return fraction * fmin(size[0], fmin(size[1], size[2]));
}

/* Use a central difference: its error is of second order, and no matrix is stored. */
void pliant_linearized_product(pliant_linearized *linearized, const double *v, double *buffers, double *out)
{
    size_t n = 3 * (size_t)linearized->system.num_free;
    double maximum = largest(n, v);
    if (!(maximum > 0)) {
        memset(out, 0, n * sizeof *out);
        return;
    }
    double step = step_of(&linearized->system, 1e-5) / maximum;
    for (size_t i = 0; i < n; i++) buffers[i] = step * v[i];
    pliant_linearized_forces(linearized, buffers, out);
    for (size_t i = 0; i < n; i++) buffers[i] = -step * v[i];
    double *minus = buffers; /* the displacement is read before the forces are written */
    pliant_linearized_forces(linearized, buffers, minus);
    for (size_t i = 0; i < n; i++) out[i] = (out[i] - minus[i]) / (2 * step);
}

/* Solve K v = right by preconditioned conjugate gradients (Golub and Van Loan, 11.5.2). Stop at a direction without
 * stiffness: the state may be no equilibrium. work: (5 x n). */
static pliant_status solve(pliant_linearized *linearized, pliant_preconditioner *preconditioner, const double *right,
                           double *work, double *v)
{
    enum { MAX_ITERATIONS = 60 };
    const double tolerance = 1e-4, direct = 1e-6;
    size_t n = 3 * (size_t)linearized->system.num_free;
    double *r = work, *z = r + n, *p = z + n, *q = p + n, *buffers = q + n;
    memcpy(r, right, n * sizeof *r);
    memset(v, 0, n * sizeof *v);
    double size = sqrt(pliant_dot(n, r, r)), first = 0, before = 0;
    for (int k = 0; k < MAX_ITERATIONS && size > 0; k++) {
        pliant_status status = pliant_linearized_check_cancel(linearized);
        if (status == PLIANT_OK) status = pliant_preconditioner_solve(preconditioner, 1, r, z);
        if (status != PLIANT_OK) return status;
        double now = pliant_dot(n, r, z);
        if (k == 0) first = now;
        if (!(now > tolerance * tolerance * first)) break;
        for (size_t i = 0; i < n; i++) p[i] = z[i] + (k > 0 ? now / before * p[i] : 0);
        pliant_linearized_product(linearized, p, buffers, q);
        double curvature = pliant_dot(n, p, q);
        if (!(curvature > 0)) {
            if (k == 0) memcpy(v, z, n * sizeof *v);
            break;
        }
        for (size_t i = 0; i < n; i++) {
            v[i] += now / curvature * p[i];
            r[i] -= now / curvature * q[i];
        }
        before = now;
        if (sqrt(pliant_dot(n, r, r)) < direct * size) break;
    }
    return PLIANT_OK;
}

/* Compute f''(a, b) by central differences. u, forces: (n) work arrays. */
static void second_derivative(pliant_linearized *linearized, const double *a, const double *b, double step, double *u,
                              double *forces, double *out)
{
    static const double signs[4][3] = {{1, 1, 1}, {1, -1, -1}, {-1, 1, -1}, {-1, -1, 1}};
    size_t n = 3 * (size_t)linearized->system.num_free;
    memset(out, 0, n * sizeof *out);
    for (int s = 0; s < 4; s++) {
        for (size_t i = 0; i < n; i++) u[i] = step * (signs[s][0] * a[i] + signs[s][1] * b[i]);
        pliant_linearized_forces(linearized, u, forces);
        for (size_t i = 0; i < n; i++) out[i] += signs[s][2] * forces[i] / (4 * step * step);
    }
}

typedef struct solve_buffers {
    double *work, *right; /* (5 x n), (n) */
} solve_buffers;

static pliant_status buffers_create(size_t n, solve_buffers *out)
{
    out->work = pliant_calloc(n, 5 * sizeof *out->work);
    out->right = pliant_calloc(n, sizeof *out->right);
    return out->work && out->right ? PLIANT_OK : pliant_fail_memory("the response of the fine mesh");
}

static void buffers_free(solve_buffers *buffers)
{
    pliant_free(buffers->work);
    pliant_free(buffers->right);
}

/* Compute -K^-1 f''(a, b), whose largest displacement is limited to `maximum`. */
static pliant_status derivative(pliant_linearized *linearized, pliant_preconditioner *preconditioner,
                                const solve_buffers *buffers, const double *a, const double *b, double maximum,
                                double *out)
{
    size_t n = 3 * (size_t)linearized->system.num_free;
    memset(buffers->right, 0, n * sizeof *buffers->right);
    if (maximum > 0)
        second_derivative(linearized, a, b, step_of(&linearized->system, 0.01) / maximum, buffers->work,
                          buffers->work + n, buffers->right);
    for (size_t m = 0; m < n; m++) buffers->right[m] = -buffers->right[m];
    return solve(linearized, preconditioner, buffers->right, buffers->work, out);
}

pliant_status pliant_response_modes(pliant_linearized *linearized, pliant_preconditioner *preconditioner, int32_t count,
                                    const int32_t *nodes, const double *weights, double *modes)
{
    const pliant_system *system = &linearized->system;
    size_t n = 3 * (size_t)system->num_free, next = 3;
    solve_buffers buffers = {0};
    double maximum = 0;
    pliant_status status = buffers_create(n, &buffers);
    for (int d = 0; d < 3 && status == PLIANT_OK; d++) {
        memset(buffers.right, 0, n * sizeof *buffers.right);
        for (int32_t h = 0; h < count; h++) {
            int32_t unknown = system->free_of_node[nodes[h]];
            if (unknown >= 0) buffers.right[3 * unknown + d] += weights[h];
        }
        status = solve(linearized, preconditioner, buffers.right, buffers.work, modes + n * (size_t)d);
        maximum = fmax(maximum, largest(n, modes + n * (size_t)d));
    }
    for (size_t i = 0; i < 3; i++)
        for (size_t j = i; j < 3 && status == PLIANT_OK; j++)
            status = derivative(linearized, preconditioner, &buffers, modes + n * i, modes + n * j, maximum,
                                modes + n * next++);
    buffers_free(&buffers);
    return status;
}

pliant_status pliant_response_pair_modes(pliant_linearized *linearized, pliant_preconditioner *preconditioner,
                                         const double *first, const double *second, double *out)
{
    size_t n = 3 * (size_t)linearized->system.num_free;
    solve_buffers buffers = {0};
    double maximum = fmax(largest(3 * n, first), largest(3 * n, second));
    pliant_status status = buffers_create(n, &buffers);
    for (size_t i = 0; i < 3; i++)
        for (size_t j = 0; j < 3 && status == PLIANT_OK; j++)
            status = derivative(linearized, preconditioner, &buffers, first + n * i, second + n * j, maximum,
                                out + n * (3 * i + j));
    buffers_free(&buffers);
    return status;
}

double pliant_response_force_operations(const pliant_system *system)
{
    /* For a tetrahedron: rotation, stiffness and back-rotation, with LANES elements at a time, in operations at a
     * scalar rate. A hexahedron takes about four times as many. */
    const double one = system->macros ? 600 : 150;
    return one * pliant_element_count(system);
}

double pliant_response_operations(const pliant_system *system, const pliant_preconditioner *preconditioner,
                                  const double *positions)
{
    /* Products per solve with the factor at rest, which is exact at rest. The count of a multigrid includes its
     * cycles. */
    const double moved = 1e-4; /* of a cell */
    bool direct = pliant_preconditioner_can_fail(preconditioner), is_at_rest = true;
    for (int32_t v = 0; v < 3 * system->mesh->num_nodes && is_at_rest; v++)
        is_at_rest = fabs(positions[v] - system->mesh->rest[v]) <= moved * system->mesh->cell_size[0];
    const double usual = !direct ? 8 : is_at_rest ? 1 : 5;
    double forces = pliant_response_force_operations(system);
    double solve = pliant_preconditioner_solve_operations(preconditioner) * (direct ? usual : 1);
    return PLIANT_RESPONSE_MODES * (solve + usual * 2 * forces + 4 * forces);
}
