#include "fem/linear/basis.h"

#include "base/fail.h"
#include "base/dense.h"
#include "base/memory.h"
#include "mesh/mesh.h"

#include <math.h>
#include <string.h>

/* ---- In a step. */

/* Compute q = M' (x - base). */
static void amplitudes(pliant_basis *basis, const double *x)
{
    size_t n = 3 * (size_t)basis->system.num_free;
    for (int32_t m = 0; m < basis->num_modes; m++) {
        const double *mode = basis->outer + n * (size_t)m;
        double sum = 0;
        for (int32_t f = 0; f < basis->system.num_free; f++) {
            size_t at = 3 * (size_t)basis->system.node_of_free[f];
            for (size_t d = 0; d < 3; d++) sum += mode[3 * (size_t)f + d] * (x[at + d] - basis->mesh.rest[at + d]);
        }
        basis->amplitude[m] = sum;
    }
}

void pliant_basis_far_forces(pliant_basis *basis, const double *x, double *forces)
{
    size_t n = 3 * (size_t)basis->system.num_free;
    amplitudes(basis, x);
    for (int32_t k = 0; k < basis->num_modes; k++) {
        double force = pliant_dot((size_t)basis->num_modes, basis->far + k * basis->num_modes, basis->amplitude);
        for (size_t i = 0; i < n; i++) forces[i] += force * basis->outer[n * (size_t)k + i];
    }
}

void pliant_basis_positions(pliant_basis *basis, const pliant_system *fine, const double *base, const double *x,
                            double *out)
{
    size_t n = 3 * (size_t)fine->num_free;
    amplitudes(basis, x);
    if (out != base) memcpy(out, base, 3 * (size_t)fine->mesh->num_nodes * sizeof *out);
#pragma omp parallel for schedule(static) num_threads(basis->system.num_threads)
    for (int32_t f = 0; f < fine->num_free; f++) {
        double by[3] = {0, 0, 0};
        for (int32_t m = 0; m < basis->num_modes; m++)
            for (int d = 0; d < 3; d++)
                by[d] += basis->amplitude[m] * basis->whole[n * (size_t)m + 3 * (size_t)f + (size_t)d];
        for (int d = 0; d < 3; d++) out[3 * fine->node_of_free[f] + d] += by[d];
    }
    for (int32_t v = 0; v < basis->mesh.num_nodes; v++)
        memcpy(out + 3 * basis->fine_node[v], x + 3 * v, 3 * sizeof *out);
}

void pliant_basis_project(pliant_basis *basis, double *x)
{
    size_t n = 3 * (size_t)basis->system.num_free;
    int32_t own = 0;
    amplitudes(basis, x);
    for (int32_t f = 0; f < basis->system.num_free; f++) {
        if (own < basis->num_own && basis->own[own] == f) {
            own++;
            continue;
        }
        size_t at = 3 * (size_t)basis->system.node_of_free[f];
        for (size_t d = 0; d < 3; d++) {
            double by = 0;
            for (int32_t m = 0; m < basis->num_modes; m++)
                by += basis->amplitude[m] * basis->outer[n * (size_t)m + 3 * (size_t)f + d];
            x[at + d] = basis->mesh.rest[at + d] + by;
        }
    }
}

/* ---- Construction. */

/* Data used only during construction. */
typedef struct basis_builder {
    const pliant_system *fine;
    pliant_linearized *linearized;
    pliant_basis *basis;
    int32_t num_footprints;
    const pliant_footprint *footprints;
    int32_t num_near, *near_element; /* elements of the fine system, ascending */
    uint8_t *still;                /* (near nodes) */
    uint8_t *is_own;               /* (near unknowns) */
    pliant_linearized near;        /* linearization of the near part around the same state */
    double *near_x;                /* (near nodes x 3) */
    pliant_tangent *tangents;
} basis_builder;

static bool within(int32_t num_footprints, const pliant_footprint *footprints, const double *rest, double radius)
{
    for (int32_t t = 0; t < num_footprints; t++) {
        double squares = 0;
        for (int d = 0; d < 3; d++) squares += pow(rest[d] - footprints[t].centre[d], 2);
        if (squares <= radius * radius) return true;
    }
    return false;
}

/* Find the nodes and elements within twice the radius. An element is included if one of its corners is within this
 * radius or in a footprint. */
static pliant_status near_elements(basis_builder *build, double radius)
{
    const pliant_system *fine = build->fine;
    const pliant_mesh *mesh = fine->mesh;
    const int32_t *nodes = pliant_element_nodes(fine);
    pliant_basis *basis = build->basis;
    const size_t count = (size_t)mesh->num_nodes;
    uint8_t *close = pliant_calloc(count, 1);
    build->near_element = pliant_calloc((size_t)pliant_element_count(fine), sizeof *build->near_element);
    basis->near_node = pliant_calloc(count, sizeof *basis->near_node);
    basis->fine_node = pliant_calloc(count, sizeof *basis->fine_node);
    if (!close || !build->near_element || !basis->near_node || !basis->fine_node) {
        pliant_free(close);
        return pliant_fail_memory("a patch");
    }
    for (int32_t t = 0; t < build->num_footprints; t++)
        for (int32_t h = 0; h < build->footprints[t].count; h++) close[build->footprints[t].nodes[h]] = 1;
    for (int32_t n = 0; n < mesh->num_nodes; n++)
        close[n] = close[n] || within(build->num_footprints, build->footprints, mesh->rest + 3 * n, 2 * radius);
    for (int32_t e = 0; e < pliant_element_count(fine); e++) {
        const int32_t begin = pliant_element_begin(fine, e), end = pliant_element_begin(fine, e + 1);
        bool near = false;
        for (int32_t v = begin; v < end; v++) near = near || close[nodes[v]];
        if (!near) continue;
        build->near_element[build->num_near++] = e;
        for (int32_t v = begin; v < end; v++) basis->near_node[nodes[v]] = 1;
    }
    for (int32_t n = 0; n < mesh->num_nodes; n++) {
        if (basis->near_node[n]) basis->fine_node[basis->mesh.num_nodes] = n;
        basis->near_node[n] = basis->near_node[n] ? basis->mesh.num_nodes++ : -1;
    }
    pliant_free(close);
    return PLIANT_OK;
}

static pliant_status near_system(basis_builder *build, const uint8_t *fixed)
{
    pliant_basis *basis = build->basis;
    pliant_system *system = &basis->system;
    build->still = pliant_calloc((size_t)basis->mesh.num_nodes, 1);
    build->near_x = pliant_calloc((size_t)basis->mesh.num_nodes, 3 * sizeof *build->near_x);
    if (!build->still || !build->near_x) return pliant_fail_memory("a patch");
    for (int32_t n = 0; n < basis->mesh.num_nodes; n++) {
        build->still[n] = fixed[basis->fine_node[n]];
        memcpy(build->near_x + 3 * n, build->linearized->x + 3 * basis->fine_node[n], 3 * sizeof *build->near_x);
    }
    pliant_status status = pliant_system_extract(build->fine, build->num_near, build->near_element, basis->near_node,
                                                 &basis->mesh, system);
    if (status == PLIANT_OK) status = pliant_system_unknowns(system, build->still);
    if (status == PLIANT_OK) status = pliant_linearized_create(system, build->near_x, &build->near);
    if (status == PLIANT_OK) status = pliant_system_find_mean_diagonal(system, NULL, NULL);
    if (status != PLIANT_OK) return status;
    build->tangents = pliant_calloc((size_t)system->num_blocks, sizeof *build->tangents);
    return build->tangents ? PLIANT_OK : pliant_fail_memory("a patch");
}

static pliant_status own_nodes(basis_builder *build, double radius)
{
    pliant_basis *basis = build->basis;
    const pliant_system *system = &basis->system;
    build->is_own = pliant_calloc((size_t)system->num_free, 1);
    basis->own = pliant_calloc((size_t)system->num_free, sizeof *basis->own);
    if (!build->is_own || !basis->own) return pliant_fail_memory("a patch");
    for (int32_t f = 0; f < system->num_free; f++) {
        int32_t node = system->node_of_free[f];
        build->is_own[f] = within(build->num_footprints, build->footprints, basis->mesh.rest + 3 * node, radius);
        if (build->is_own[f]) basis->own[basis->num_own++] = f;
        else build->still[node] = 1;
    }
    if (basis->num_own == 0) return PLIANT_OK;
    basis->inner = (pliant_system){.mesh = system->mesh,
                                   .fine = system->fine,
                                   .num_threads = 1,
                                   .num_blocks = system->num_blocks,
                                   .gradients = system->gradients,
                                   .lame = system->lame,
                                   .macros = system->macros};
    pliant_status status = pliant_system_unknowns(&basis->inner, build->still);
    return status == PLIANT_OK ? pliant_factor_analyze(&basis->inner.pattern, &basis->analyzed) : status;
}

/* Orthonormalize the modes on the near part's nodes that are no own nodes (Gram-Schmidt, twice). Dependent modes are
 * dropped. */
static pliant_status orthonormal_modes(basis_builder *build, int32_t num_blocks, const double *const *blocks)
{
    const double dependent = 1e-6;
    pliant_basis *basis = build->basis;
    size_t n = 3 * (size_t)basis->system.num_free, all = 3 * (size_t)build->fine->num_free;
    size_t maximum = PLIANT_RESPONSE_MODES * (size_t)num_blocks;
    basis->modes = pliant_calloc(n * maximum, sizeof *basis->modes);
    basis->outer = pliant_calloc(n * maximum, sizeof *basis->outer);
    basis->whole = pliant_calloc(all * maximum, sizeof *basis->whole);
    if (!basis->modes || !basis->outer || !basis->whole) return pliant_fail_memory("a patch");
    for (size_t k = 0; k < maximum; k++) {
        pliant_status status = pliant_linearized_check_cancel(build->linearized);
        if (status != PLIANT_OK) return status;
        double *mode = basis->modes + n * (size_t)basis->num_modes,
               *outer = basis->outer + n * (size_t)basis->num_modes;
        double *whole = basis->whole + all * (size_t)basis->num_modes;
        memcpy(whole, blocks[k / PLIANT_RESPONSE_MODES] + all * (k % PLIANT_RESPONSE_MODES), all * sizeof *whole);
        for (int32_t f = 0; f < basis->system.num_free; f++) {
            size_t from = 3 * (size_t)build->fine->free_of_node[basis->fine_node[basis->system.node_of_free[f]]];
            memcpy(mode + 3 * f, whole + from, 3 * sizeof *mode);
            for (int d = 0; d < 3; d++) outer[3 * f + d] = build->is_own[f] ? 0 : mode[3 * f + d];
        }
        double size = sqrt(pliant_dot(n, outer, outer));
        for (int pass = 0; pass < 2; pass++)
            for (int32_t m = 0; m < basis->num_modes; m++) {
                double along = pliant_dot(n, basis->outer + n * (size_t)m, outer);
                for (size_t i = 0; i < n; i++) {
                    mode[i] -= along * basis->modes[n * (size_t)m + i];
                    outer[i] -= along * basis->outer[n * (size_t)m + i];
                }
                for (size_t i = 0; i < all; i++) whole[i] -= along * basis->whole[all * (size_t)m + i];
            }
        double left = sqrt(pliant_dot(n, outer, outer));
        if (!isfinite(left)) return pliant_fail(PLIANT_ERROR_NUMERIC, "the response of the fine mesh is not finite");
        if (!(left > dependent * size)) continue;
        for (size_t i = 0; i < n; i++) {
            mode[i] /= left;
            outer[i] /= left;
        }
        for (size_t i = 0; i < all; i++) whole[i] /= left;
        basis->num_modes++;
    }
    return PLIANT_OK;
}

/* Compute A = E' (K - K_near) E. */
static pliant_status far_stiffness(basis_builder *build)
{
    pliant_basis *basis = build->basis;
    size_t n = 3 * (size_t)basis->system.num_free, all = 3 * (size_t)build->fine->num_free,
           count = (size_t)basis->num_modes;
    if (count == 0) return PLIANT_OK;
    basis->far = pliant_calloc(count * count, sizeof *basis->far);
    basis->amplitude = pliant_calloc(count, sizeof *basis->amplitude);
    double *buffers = pliant_calloc(all, sizeof *buffers), *product = pliant_calloc(all, sizeof *product);
    pliant_status status =
        basis->far && basis->amplitude && buffers && product ? PLIANT_OK : pliant_fail_memory("a patch");
    for (size_t l = 0; status == PLIANT_OK && l < count; l++) {
        if ((status = pliant_linearized_check_cancel(build->linearized)) != PLIANT_OK) break;
        pliant_linearized_product(build->linearized, basis->whole + all * l, buffers, product);
        for (size_t k = 0; k < count; k++) basis->far[k * count + l] = pliant_dot(all, basis->whole + all * k, product);
        pliant_linearized_product(&build->near, basis->modes + n * l, buffers, product);
        for (size_t k = 0; k < count; k++) basis->far[k * count + l] -= pliant_dot(n, basis->modes + n * k, product);
    }
    for (size_t k = 0; status == PLIANT_OK && k < count; k++)
        for (size_t l = 0; l < k; l++) {
            double mean = 0.5 * (basis->far[k * count + l] + basis->far[l * count + k]);
            basis->far[k * count + l] = basis->far[l * count + k] = mean;
        }
    pliant_free(buffers);
    pliant_free(product);
    return status;
}

/* Compute the first reduction, at the exact tangent if that is positive definite. */
static pliant_status first_numbers(basis_builder *build)
{
    pliant_system *system = &build->basis->system;
    pliant_status status = pliant_preconditioner_create_in_basis(build->basis, system, &system->preconditioner);
    if (status != PLIANT_OK) return status;
    for (int twist = PLIANT_TWIST_EXACT; twist <= PLIANT_TWIST_POSITIVE; twist++) {
        pliant_system_tangents(system, build->near_x, (pliant_twist)twist, build->tangents);
        status = pliant_preconditioner_numeric(system->preconditioner, build->tangents);
        if (status != PLIANT_ERROR_NUMERIC) break;
    }
    return status;
}

static void builder_clear(basis_builder *build)
{
    pliant_free(build->near_element);
    pliant_free(build->still);
    pliant_free(build->is_own);
    pliant_free(build->near_x);
    pliant_free(build->tangents);
    pliant_linearized_free(&build->near);
}

pliant_status pliant_basis_create(const pliant_system *fine, pliant_linearized *linearized, const uint8_t *fixed,
                                  double radius, int32_t num_footprints, const pliant_footprint *footprints,
                                  int32_t num_blocks, const double *const *blocks, int num_threads, pliant_basis **out)
{
    pliant_basis *basis = pliant_calloc(1, sizeof *basis);
    if (!basis) return pliant_fail_memory("a patch");
    basis_builder build = {.fine = fine,
                           .linearized = linearized,
                           .basis = basis,
                           .num_footprints = num_footprints,
                           .footprints = footprints};
    pliant_status status = near_elements(&build, radius);
    if (status == PLIANT_OK) status = near_system(&build, fixed);
    if (status == PLIANT_OK) status = own_nodes(&build, radius);
    if (status == PLIANT_OK) status = orthonormal_modes(&build, num_blocks, blocks);
    if (status == PLIANT_OK) status = far_stiffness(&build);
    if (status == PLIANT_OK) status = first_numbers(&build);
    basis->system.num_threads = num_threads;
    basis->system.basis = basis;
    builder_clear(&build);
    if (status != PLIANT_OK) {
        pliant_basis_free(basis);
        return status;
    }
    *out = basis;
    return PLIANT_OK;
}

pliant_basis_size pliant_basis_measure(const pliant_system *fine, double radius, int32_t num_footprints,
                                       const pliant_footprint *footprints, int32_t num_blocks)
{
    pliant_basis_size size = {.blocks = num_blocks};
    for (int32_t f = 0; f < fine->num_free; f++) {
        const double *rest = fine->mesh->rest + 3 * fine->node_of_free[f];
        size.near += within(num_footprints, footprints, rest, 2 * radius);
        size.own += within(num_footprints, footprints, rest, radius);
    }
    return size;
}

/* Estimate the values in a factor of K_pp, by nodes^(4/3) (nested dissection), and the operations of ordering and
 * factorization. It is an upper bound, accurate for compact tissue. Operations in BLAS are faster than others. */
static double factor_numbers(pliant_basis_size size) { return 45 * pow(size.own, 4.0 / 3); }

static double factor_operations(pliant_basis_size size)
{
    const double ordering = 7e4, of_blas = 0.2;
    return ordering * size.own + of_blas * 70 * pow(size.own, 2);
}

double pliant_basis_operations(const pliant_system *fine, pliant_basis_size size)
{
    double modes = (double)PLIANT_RESPONSE_MODES * size.blocks;
    /* A product per mode; for every two modes a scalar product and two differences; then the reduction
     * (basis_values.c). */
    double fields = 2 * modes * pliant_response_force_operations(fine) + 4 * modes * modes * 3 * fine->num_free;
    double images = (pliant_reduction_element_operations(fine) / fine->num_free + 12 * modes) * modes * size.near;
    return fields + images + factor_operations(size) + 4 * modes * factor_numbers(size);
}

double pliant_basis_bytes(const pliant_system *fine, pliant_basis_size size)
{
    const double factors = 3; /* the basis's own, one in use, one in progress; in double and single precision */
    double fields = (double)PLIANT_RESPONSE_MODES * size.blocks * 3 * fine->num_free * (double)sizeof(double);
    return fields + factors * factor_numbers(size) * (double)(sizeof(double) + sizeof(float));
}

void pliant_basis_free(pliant_basis *basis)
{
    if (!basis) return;
    basis->inner.gradients = NULL; /* borrowed from the system */
    basis->inner.lame = NULL;
    basis->inner.macros = NULL;
    pliant_system_clear(&basis->inner);
    pliant_preconditioner_free(basis->system.preconditioner);
    pliant_system_clear(&basis->system);
    pliant_mesh_free(&basis->mesh);
    pliant_factor_free(basis->analyzed);
    pliant_free(basis->fine_node);
    pliant_free(basis->near_node);
    pliant_free(basis->own);
    pliant_free(basis->modes);
    pliant_free(basis->outer);
    pliant_free(basis->whole);
    pliant_free(basis->far);
    pliant_free(basis->amplitude);
    pliant_free(basis);
}
