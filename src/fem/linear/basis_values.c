/* Values of a basis at one state. */
#include "base/fail.h"
#include "base/dense.h"
#include "fem/linear/basis.h"
#include "base/memory.h"

#include <string.h>

pliant_status pliant_reduction_create(const pliant_basis *basis, const pliant_reduction *from, pliant_reduction **out)
{
    pliant_reduction *reduction = pliant_calloc(1, sizeof *reduction);
    if (!reduction) return pliant_fail_memory("a patch");
    size_t n = 3 * (size_t)basis->system.num_free, own = 3 * (size_t)basis->num_own, count = (size_t)basis->num_modes;
    bool made = true;
    if (own > 0) {
        reduction->values = pliant_calloc((size_t)basis->inner.pattern.num_values, sizeof *reduction->values);
        reduction->part = pliant_calloc(own, sizeof *reduction->part);
        made = reduction->values && reduction->part;
    }
    if (count > 0) {
        reduction->image = pliant_calloc(n * count, sizeof *reduction->image);
        reduction->schur = pliant_calloc(count * count, sizeof *reduction->schur);
        reduction->amplitude = pliant_calloc(count, sizeof *reduction->amplitude);
        made = made && reduction->image && reduction->schur && reduction->amplitude;
    }
    if (own > 0 && count > 0)
        made = made && (reduction->answers = pliant_calloc(own * count, sizeof *reduction->answers));
    pliant_status status = made ? PLIANT_OK : pliant_fail_memory("a patch");
    if (status == PLIANT_OK && own > 0)
        status = pliant_factor_clone(from ? from->factor : basis->analyzed, &reduction->factor);
    if (status != PLIANT_OK) {
        pliant_reduction_free(reduction);
        return status;
    }
    if (from && count > 0) memcpy(reduction->schur, from->schur, count * count * sizeof *reduction->schur);
    if (from && own > 0 && count > 0)
        memcpy(reduction->answers, from->answers, own * count * sizeof *reduction->answers);
    *out = reduction;
    return PLIANT_OK;
}

void pliant_reduction_free(pliant_reduction *reduction)
{
    if (!reduction) return;
    pliant_factor_free(reduction->factor);
    pliant_free(reduction->values);
    pliant_free(reduction->image);
    pliant_free(reduction->answers);
    pliant_free(reduction->schur);
    pliant_free(reduction->amplitude);
    pliant_free(reduction->part);
    pliant_free(reduction);
}

/* Compute Q = K_near E + M A. */
static void images(const pliant_basis *basis, const pliant_tangent *tangents, double *image)
{
    const pliant_system *system = &basis->system;
    size_t n = 3 * (size_t)system->num_free;
    memset(image, 0, n * (size_t)basis->num_modes * sizeof *image);
    for (int32_t e = 0; e < pliant_element_count(system); e++) {
        const int32_t begin = pliant_element_begin(system, e),
                      unknowns = 3 * (pliant_element_begin(system, e + 1) - begin);
        const int32_t *nodes = pliant_element_nodes(system) + begin;
        double stiffness[PLIANT_ELEMENT_UNKNOWNS * PLIANT_ELEMENT_UNKNOWNS];
        pliant_system_element(system, tangents, e, stiffness);
        for (int32_t m = 0; m < basis->num_modes; m++) {
            double local[PLIANT_ELEMENT_UNKNOWNS];
            for (int i = 0; i < unknowns; i++) {
                int32_t at = system->free_of_node[nodes[i / 3]];
                local[i] = at < 0 ? 0 : basis->modes[n * (size_t)m + 3 * (size_t)at + (size_t)(i % 3)];
            }
            for (int i = 0; i < unknowns; i++) {
                int32_t at = system->free_of_node[nodes[i / 3]];
                if (at >= 0)
                    image[n * (size_t)m + 3 * (size_t)at + (size_t)(i % 3)] +=
                        pliant_dot((size_t)unknowns, stiffness + unknowns * i, local);
            }
        }
    }
    for (int32_t m = 0; m < basis->num_modes; m++)
        for (int32_t k = 0; k < basis->num_modes; k++) {
            double far = basis->far[k * basis->num_modes + m];
            for (size_t i = 0; i < n; i++) image[n * (size_t)m + i] += far * basis->outer[n * (size_t)k + i];
        }
}

/* Compute S = E'Q - Q_p' K_pp^-1 Q_p. */
static pliant_status schur_complement(const pliant_basis *basis, pliant_reduction *reduction)
{
    size_t n = 3 * (size_t)basis->system.num_free, own = 3 * (size_t)basis->num_own, count = (size_t)basis->num_modes;
    double *schur = reduction->schur;
    if (count == 0) return PLIANT_OK;
    memset(schur, 0, count * count * sizeof *schur);
    for (size_t m = 0; m < count && own > 0; m++) {
        double *answer = reduction->answers + own * m;
        const double *image = reduction->image + n * m;
        for (int32_t f = 0; f < basis->num_own; f++)
            memcpy(answer + 3 * f, image + 3 * basis->own[f], 3 * sizeof *answer);
        pliant_status status = pliant_factor_solve(reduction->factor, 1, answer, answer);
        if (status != PLIANT_OK) return status;
        for (size_t k = 0; k < count; k++)
            for (int32_t f = 0; f < basis->num_own; f++)
                schur[k * count + m] -= pliant_dot(3, reduction->image + n * k + 3 * basis->own[f], answer + 3 * f);
    }
    for (size_t k = 0; k < count; k++)
        for (size_t m = 0; m <= k; m++) {
            double whole = 0.5 * (pliant_dot(n, basis->modes + n * k, reduction->image + n * m) +
                                  pliant_dot(n, basis->modes + n * m, reduction->image + n * k));
            schur[k * count + m] = 0.5 * (schur[k * count + m] + schur[m * count + k]) + whole;
        }
    if (pliant_dense_cholesky((int32_t)count, schur)) return PLIANT_OK;
    return pliant_fail(PLIANT_ERROR_NUMERIC, "the stiffness near the grasp is not positive definite");
}

pliant_status pliant_reduction_numeric(const pliant_basis *basis, const pliant_tangent *tangents,
                                       pliant_reduction *reduction)
{
    if (basis->num_own > 0) {
        pliant_system_assemble(&basis->inner, tangents, reduction->values);
        pliant_status status = pliant_factor_numeric(reduction->factor, reduction->values);
        if (status != PLIANT_OK) return status;
    }
    if (basis->num_modes > 0) images(basis, tangents, reduction->image);
    return schur_complement(basis, reduction);
}

double pliant_reduction_element_operations(const pliant_system *system)
{
    double sum = 0;
    for (int32_t e = 0; e < pliant_element_count(system); e++) {
        const double unknowns = 3.0 * (pliant_element_begin(system, e + 1) - pliant_element_begin(system, e));
        sum += 2 * unknowns * unknowns;
    }
    return sum;
}

double pliant_reduction_operations(const pliant_basis *basis)
{
    double modes = basis->num_modes, operations = modes * pliant_reduction_element_operations(&basis->system) +
                                                  12 * modes * modes * basis->system.num_free;
    if (!basis->analyzed) return operations;
    return operations + pliant_factor_operations(basis->analyzed) + 4 * modes * pliant_factor_values(basis->analyzed);
}

pliant_status pliant_reduction_solve(const pliant_basis *basis, pliant_reduction *reduction, const double *right,
                                     double *out)
{
    size_t n = 3 * (size_t)basis->system.num_free, own = 3 * (size_t)basis->num_own;
    double *q = reduction->amplitude, *a = reduction->part;
    for (int32_t f = 0; f < basis->num_own; f++) memcpy(a + 3 * f, right + 3 * basis->own[f], 3 * sizeof *a);
    for (int32_t m = 0; m < basis->num_modes; m++)
        q[m] = pliant_dot(n, basis->modes + n * (size_t)m, right) -
               pliant_dot(own, reduction->answers + own * (size_t)m, a);
    if (basis->num_modes > 0) pliant_dense_cholesky_solve(basis->num_modes, reduction->schur, 1, q);
    if (own > 0) {
        pliant_status status = pliant_factor_solve(reduction->factor, 1, a, a);
        if (status != PLIANT_OK) return status;
    }
    memset(out, 0, n * sizeof *out);
    for (int32_t m = 0; m < basis->num_modes; m++) {
        for (size_t i = 0; i < n; i++) out[i] += q[m] * basis->modes[n * (size_t)m + i];
        for (size_t i = 0; i < own; i++) a[i] -= q[m] * reduction->answers[own * (size_t)m + i];
    }
    for (int32_t f = 0; f < basis->num_own; f++)
        for (int d = 0; d < 3; d++) out[3 * basis->own[f] + d] += a[3 * f + d];
    return PLIANT_OK;
}
