/* The corrector of one cube: a fine problem on the surrounding cubes, with constrained means. */
#include "base/fail.h"
#include "base/dense.h"
#include "fem/coarse/lod_corrector.h"
#include "base/memory.h"

#include <math.h>
#include <string.h>

enum { COLUMNS = 24 };

typedef struct patch_problem {
    int32_t count, num_means, num_bulk; /* free fine nodes, constrained coarse nodes, cubes with a mean change of
                                         * volume */
    int32_t *node;             /* (count) in the numbering of lod->whole, ascending */
    int32_t *mean;             /* (num_means) coarse nodes */
    int32_t *lean;             /* (count x LOD_MAX_WEIGHTS) means to which a node contributes, or -1 */
    double *weight;            /* (count x LOD_MAX_WEIGHTS) m_i lambda_j(x_i) [kg] */
    pliant_pattern pattern;    /* of the patch */
    double *values;
    double *bulk;              /* (num_bulk x 3 count) B, scaled to the energy 1/2 |B'Q|^2 */
    double *z;                 /* ((24 + held) x 3 count): K^-1 [G, Phi, B]; held = 3 num_means + num_bulk */
    double *s, *t;             /* (held x held), (held x 24) */
} patch_problem;

static void patch_free(patch_problem *patch)
{
    PLIANT_FREE(patch->node, patch->mean, patch->lean, patch->weight, patch->pattern.start, patch->pattern.row,
                patch->values, patch->bulk, patch->z, patch->s, patch->t);
}

/* List the free fine nodes in the box of the patch without adjacent tetrahedra outside of it. */
static void find_nodes(const lod_builder *lod, lod_buffers *buffers, const int32_t low[3], const int32_t side[3],
                       patch_problem *patch)
{
    const pliant_mesh *fine = lod->system->fine;
    int32_t r = lod->ratio;
    for (int32_t at = 0; at < side[0] * side[1] * side[2]; at++) {
        int32_t i = low[0] * r + at % side[0], j = low[1] * r + at / side[0] % side[1],
                k = low[2] * r + at / side[0] / side[1];
        int32_t n = fine->node_of_lattice[i + (fine->cells[0] + 1) * (j + (fine->cells[1] + 1) * k)];
        if (n < 0 || lod->whole.free_of_node[n] < 0) continue;
        const uint8_t *reach = lod->reach + 6 * (size_t)n;
        bool inside = true;
        for (int d = 0; d < 3; d++) inside = inside && reach[d] >= low[d] && (reach[3 + d] + 1 - low[d]) * r < side[d];
        if (!inside) continue;
        buffers->local[lod->whole.free_of_node[n]] = patch->count;
        patch->node[patch->count++] = lod->whole.free_of_node[n];
    }
}

/* List the free coarse nodes that interpolate these fine nodes. */
static void find_means(const lod_builder *lod, lod_buffers *buffers, patch_problem *patch)
{
    for (int32_t i = 0; i < patch->count; i++) {
        int32_t fine_node = lod->whole.node_of_free[patch->node[i]], nodes[LOD_MAX_WEIGHTS];
        double weights[LOD_MAX_WEIGHTS];
        int leans = lod_interpolation(lod, fine_node, nodes, weights);
        for (int v = 0; v < LOD_MAX_WEIGHTS; v++) {
            bool counts = v < leans && !lod->coarse_fixed[nodes[v]];
            patch->lean[LOD_MAX_WEIGHTS * i + v] = -1;
            if (!counts) continue;
            if (buffers->slot[nodes[v]] < 0) {
                buffers->slot[nodes[v]] = patch->num_means;
                patch->mean[patch->num_means++] = nodes[v];
            }
            patch->lean[LOD_MAX_WEIGHTS * i + v] = buffers->slot[nodes[v]];
            patch->weight[LOD_MAX_WEIGHTS * i + v] = weights[v] * lod->mass[fine_node];
        }
    }
}

static void leave(lod_buffers *buffers, const patch_problem *patch)
{
    for (int32_t i = 0; i < patch->count; i++) buffers->local[patch->node[i]] = -1;
    for (int32_t j = 0; j < patch->num_means; j++) buffers->slot[patch->mean[j]] = -1;
}

static pliant_status number(const lod_builder *lod, lod_buffers *buffers, int32_t cube, patch_problem *patch)
{
    int32_t low[3], high[3], side[3];
    size_t maximum = 1, means = 1;
    lod_patch(lod, cube, low, high);
    for (int d = 0; d < 3; d++) {
        side[d] = (high[d] - low[d] + 1) * lod->ratio + 1;
        maximum *= (size_t)side[d];
        means *= (size_t)(high[d] - low[d] + 2);
    }
    patch->node = pliant_calloc(maximum, sizeof *patch->node);
    patch->mean = pliant_calloc(means, sizeof *patch->mean);
    patch->lean = pliant_calloc(maximum, LOD_MAX_WEIGHTS * sizeof *patch->lean);
    patch->weight = pliant_calloc(maximum, LOD_MAX_WEIGHTS * sizeof *patch->weight);
    if (!patch->node || !patch->mean || !patch->lean || !patch->weight) return pliant_fail_memory("a corrector");
    find_nodes(lod, buffers, low, side, patch);
    find_means(lod, buffers, patch);
    return PLIANT_OK;
}

/* Return the starts of the scalar columns 3j, 3j+1, 3j+2 of a pattern. */
static void columns_of(const pliant_pattern *pattern, double *values, int32_t column, double *out[3])
{
    int32_t first = pattern->start[column], height = pattern->start[column + 1] - first;
    out[0] = values + 9 * (int64_t)first - 3 * (int64_t)column;
    out[1] = out[0] + 3 * height;
    out[2] = out[1] + 3 * height - 1;
}

/* Extract the patch's part of the matrix. A small amount is added to the diagonal, for pieces that are attached only at
 * an edge within the patch. */
static pliant_status take_matrix(const lod_builder *lod, const lod_buffers *buffers, patch_problem *patch)
{
    const double supported = 1e-10;
    const pliant_pattern *whole = &lod->whole.pattern;
    pliant_pattern *own = &patch->pattern;
    own->num_columns = patch->count;
    own->start = pliant_calloc((size_t)patch->count + 1, sizeof *own->start);
    if (!own->start) return pliant_fail_memory("a corrector");
    for (int32_t c = 0; c < patch->count; c++) {
        own->start[c + 1] = own->start[c];
        for (int32_t b = whole->start[patch->node[c]]; b < whole->start[patch->node[c] + 1]; b++)
            own->start[c + 1] += buffers->local[whole->row[b]] >= 0;
    }
    own->num_blocks = own->start[patch->count];
    own->num_values = 9 * (int64_t)own->num_blocks - 3 * (int64_t)patch->count;
    own->row = pliant_calloc((size_t)own->num_blocks, sizeof *own->row);
    patch->values = pliant_calloc((size_t)own->num_values, sizeof *patch->values);
    if (!own->row || !patch->values) return pliant_fail_memory("a corrector");
    for (int32_t c = 0; c < patch->count; c++) {
        int32_t column = patch->node[c], next = own->start[c];
        double *from[3], *to[3];
        columns_of(whole, lod->values, column, from);
        columns_of(own, patch->values, c, to);
        for (int32_t b = whole->start[column]; b < whole->start[column + 1]; b++) {
            int32_t row = buffers->local[whole->row[b]], in = b - whole->start[column], out = next - own->start[c];
            if (row < 0) continue;
            own->row[next++] = row;
            for (int d = 0; d < 3; d++)
                for (int e = in == 0 ? d : 0; e < 3; e++) to[d][3 * out + e - d] = from[d][3 * in + e - d];
        }
        for (int d = 0; d < 3; d++) to[d][0] *= 1 + supported;
    }
    return PLIANT_OK;
}

/* Compute K_C P by column of the cube's corners: g (24 x 3 count). */
static void load_of_cube(const lod_builder *lod, const lod_buffers *buffers, int32_t cube, const patch_problem *patch,
                         double *g)
{
    const size_t size = 3 * (size_t)patch->count;
    for (int32_t e = lod->element_start[cube]; e < lod->element_start[cube + 1]; e++) {
        const int32_t *of_element;
        double k[PLIANT_ELEMENT_UNKNOWNS * PLIANT_ELEMENT_UNKNOWNS];
        const int corners = lod_element(lod, lod->elements[e], &of_element, k), n = 3 * corners;
        for (int b = 0; b < corners; b++) {
            int32_t nodes[LOD_MAX_WEIGHTS];
            double weights[LOD_MAX_WEIGHTS];
            if (lod->grounded[cube] && lod->fine_fixed[of_element[b]]) continue;
            int leans = lod_interpolation(lod, of_element[b], nodes, weights);
            for (int v = 0; v < leans; v++) {
                int corner = lod_corner(lod, cube, nodes[v]);
                for (int a = 0; a < corners; a++) {
                    int32_t unknown = lod->whole.free_of_node[of_element[a]];
                    if (unknown < 0 || buffers->local[unknown] < 0) continue;
                    for (int c = 0; c < 3; c++)
                        for (int d = 0; d < 3; d++)
                            g[size * (size_t)(3 * corner + c) + 3 * (size_t)buffers->local[unknown] + (size_t)d] +=
                                weights[v] * k[n * (3 * a + d) + 3 * b + c];
                }
            }
        }
    }
}

static int32_t held_of(const patch_problem *patch) { return 3 * patch->num_means + patch->num_bulk; }

/* Compute the weighted mean change of volume of a cube (lod.h), and return its weight.
 * @param b  Out: (3 count) for the patch's nodes.
 * @param p  Out: (24) for the corners' interpolation. */
static double change_of_cube(const lod_builder *lod, const lod_buffers *buffers, int32_t cube, double *b,
                             double p[COLUMNS])
{
    double whole = 0;
    memset(p, 0, COLUMNS * sizeof *p);
    for (int32_t e = lod->element_start[cube]; e < lod->element_start[cube + 1]; e++) {
        const int32_t element = lod->elements[e], *of_element;
        const double *gradient = lod->whole.macros->gradient + 24 * (size_t)element, weight = lod->bulk[element];
        const int corners = lod_element(lod, element, &of_element, NULL);
        whole += weight;
        for (int a = 0; a < corners; a++) {
            const int32_t unknown = lod->whole.free_of_node[of_element[a]],
                          local = unknown < 0 ? -1 : buffers->local[unknown];
            int32_t nodes[LOD_MAX_WEIGHTS];
            double weights[LOD_MAX_WEIGHTS];
            for (int d = 0; d < 3 && local >= 0; d++) b[3 * (size_t)local + (size_t)d] += weight * gradient[3 * a + d];
            if (lod->grounded[cube] && lod->fine_fixed[of_element[a]]) continue;
            const int leans = lod_interpolation(lod, of_element[a], nodes, weights);
            for (int v = 0; v < leans; v++)
                for (int d = 0; d < 3; d++)
                    p[3 * lod_corner(lod, cube, nodes[v]) + d] += weights[v] * weight * gradient[3 * a + d];
        }
    }
    return whole;
}

/* Fill B, scaled, and add the cube's own part to G. */
static pliant_status fill_bulk(const lod_builder *lod, const lod_buffers *buffers, int32_t cube, patch_problem *patch,
                               double *g)
{
    const size_t size = 3 * (size_t)patch->count;
    int32_t near[PLIANT_MAX_NEAR];
    const int cubes = lod->bulk ? lod_near(lod, cube, near) : 0;
    if (cubes > 0 && !(patch->bulk = pliant_calloc((size_t)cubes, size * sizeof *patch->bulk)))
        return pliant_fail_memory("a corrector");
    for (int c = 0; c < cubes; c++) {
        double *b = patch->bulk + size * (size_t)patch->num_bulk, p[COLUMNS];
        const double whole = change_of_cube(lod, buffers, near[c], b, p);
        if (!(whole > 0)) continue;
        for (size_t n = 0; n < size; n++) b[n] /= sqrt(whole);
        for (size_t i = 0; near[c] == cube && i < COLUMNS; i++)
            for (size_t n = 0; n < size; n++) g[size * i + n] += p[i] / sqrt(whole) * b[n];
        patch->num_bulk++;
    }
    return PLIANT_OK;
}

/* Fill Phi by column of the means: (3 num_means x 3 count). */
static void fill_means(const patch_problem *patch, double *phi)
{
    size_t size = 3 * (size_t)patch->count;
    for (int32_t i = 0; i < LOD_MAX_WEIGHTS * patch->count; i++)
        for (int32_t d = 0; d < 3 && patch->lean[i] >= 0; d++)
            phi[size * (size_t)(3 * patch->lean[i] + d) + (size_t)(3 * (i / LOD_MAX_WEIGHTS) + d)] = patch->weight[i];
}

/* Compute out (held x columns) = [Phi, B]' of columns (columns x 3 count). */
static void take_held(const patch_problem *patch, int32_t columns, const double *from, double *out)
{
    const size_t size = 3 * (size_t)patch->count;
    for (int32_t c = 0; c < columns; c++, from += size) {
        for (int32_t i = 0; i < LOD_MAX_WEIGHTS * patch->count; i++)
            for (int32_t d = 0; d < 3 && patch->lean[i] >= 0; d++)
                out[(size_t)(3 * patch->lean[i] + d) * (size_t)columns + (size_t)c] +=
                    patch->weight[i] * from[3 * (i / LOD_MAX_WEIGHTS) + d];
        for (int32_t k = 0; k < patch->num_bulk; k++) {
            double *to = out + (size_t)(3 * patch->num_means + k) * (size_t)columns + (size_t)c;
            for (size_t n = 0; n < size; n++) *to += patch->bulk[size * (size_t)k + n] * from[n];
        }
    }
}

/* Apply the constraints Phi'Q = 0 to the solution Z_G of K + B B':
 *     Q = Z_G - [Z_Phi, Z_B] S^-1 [Phi, B]' Z_G,   S = [Phi, B]' [Z_Phi, Z_B]
 * with 1 added to the diagonal of B'Z_B. Where few nodes of the patch are free, the means are dependent and the matrix
 * is singular. A small regularization of its scaled diagonal prevents this. */
static pliant_status hold_means(patch_problem *patch)
{
    const double relaxed = 1e-10;
    const int32_t m = held_of(patch);
    size_t size = 3 * (size_t)patch->count;
    if (m == 0) return PLIANT_OK;
    double *z_phi = patch->z + COLUMNS * size, *scale;
    patch->s = pliant_calloc((size_t)m * (size_t)m, sizeof *patch->s);
    patch->t = pliant_calloc((size_t)m, (COLUMNS + 1) * sizeof *patch->t);
    if (!patch->s || !patch->t) return pliant_fail_memory("a corrector");
    scale = patch->t + COLUMNS * (size_t)m;
    take_held(patch, m, z_phi, patch->s);
    take_held(patch, COLUMNS, patch->z, patch->t);
    for (int32_t i = 3 * patch->num_means; i < m; i++) patch->s[(size_t)i * (size_t)(m + 1)] += 1;
    for (int32_t i = 0; i < m; i++) scale[i] = 1 / sqrt(patch->s[(size_t)i * (size_t)(m + 1)]);
    for (int32_t i = 0; i < m; i++) {
        for (int32_t j = 0; j < m; j++) patch->s[(size_t)i * (size_t)m + (size_t)j] *= scale[i] * scale[j];
        patch->s[(size_t)i * (size_t)(m + 1)] = 1 + relaxed;
        for (int c = 0; c < COLUMNS; c++) patch->t[COLUMNS * i + c] *= scale[i];
    }
    if (!pliant_dense_cholesky(m, patch->s))
        return pliant_fail(PLIANT_ERROR_NUMERIC,
                           "lod: the means of a corrector cannot be held; the stiffness contrast is beyond double "
                           "precision");
    pliant_dense_cholesky_solve(m, patch->s, COLUMNS, patch->t);
    for (int c = 0; c < COLUMNS; c++)
        for (int32_t i = 0; i < m; i++) {
            double x = patch->t[COLUMNS * i + c] * scale[i], *to = patch->z + (size_t)c * size;
            const double *from = z_phi + (size_t)i * size;
            for (size_t n = 0; n < size; n++) to[n] -= x * from[n];
        }
    return PLIANT_OK;
}

static pliant_status solve(const lod_builder *lod, const lod_buffers *buffers, int32_t cube, patch_problem *patch)
{
    size_t size = 3 * (size_t)patch->count;
    int32_t near[PLIANT_MAX_NEAR];
    const size_t maximum = COLUMNS + 3 * (size_t)patch->num_means + (size_t)(lod->bulk ? lod_near(lod, cube, near) : 0);
    pliant_factor *factor = NULL;
    pliant_status status = take_matrix(lod, buffers, patch);
    if (status != PLIANT_OK) return status;
    if (!(patch->z = pliant_calloc(maximum, size * sizeof *patch->z))) return pliant_fail_memory("a corrector");
    load_of_cube(lod, buffers, cube, patch, patch->z);
    if ((status = fill_bulk(lod, buffers, cube, patch, patch->z)) != PLIANT_OK) return status;
    const int32_t columns = COLUMNS + held_of(patch);
    fill_means(patch, patch->z + COLUMNS * size);
    if (patch->num_bulk > 0)
        memcpy(patch->z + size * (size_t)(columns - patch->num_bulk), patch->bulk,
               size * (size_t)patch->num_bulk * sizeof *patch->z);
    status = pliant_factor_analyze(&patch->pattern, &factor);
    if (status == PLIANT_OK) {
        pliant_factor_in_double(factor);
        status = pliant_factor_numeric(factor, patch->values);
    }
    if (status == PLIANT_OK) status = pliant_factor_solve(factor, columns, patch->z, patch->z);
    pliant_factor_free(factor);
    return status == PLIANT_OK ? hold_means(patch) : status;
}

static pliant_status keep(const lod_builder *lod, const patch_problem *patch, lod_corrector *out)
{
    size_t size = 3 * (size_t)patch->count;
    out->node = pliant_calloc((size_t)patch->count, sizeof *out->node);
    out->value = pliant_calloc(size, COLUMNS * sizeof *out->value);
    if (!out->node || !out->value) return pliant_fail_memory("a corrector");
    out->count = patch->count;
    for (int32_t i = 0; i < patch->count; i++) out->node[i] = lod->whole.node_of_free[patch->node[i]];
    for (size_t i = 0; i < size; i++)
        for (size_t c = 0; c < COLUMNS; c++) out->value[COLUMNS * i + c] = (float)patch->z[size * c + i];
    return PLIANT_OK;
}

pliant_status lod_correct(lod_builder *lod, lod_buffers *buffers, int32_t cube)
{
    patch_problem patch = {0};
    pliant_status status = number(lod, buffers, cube, &patch);
    if (status == PLIANT_OK && patch.count > 0) status = solve(lod, buffers, cube, &patch);
    if (status == PLIANT_OK && patch.count > 0) status = keep(lod, &patch, lod->correctors + cube);
    leave(buffers, &patch);
    patch_free(&patch);
    return status;
}

pliant_status lod_size(lod_builder *lod, lod_buffers *buffers, int32_t cube)
{
    patch_problem patch = {0};
    pliant_status status = number(lod, buffers, cube, &patch);
    lod->patch_nodes[cube] = patch.count;
    lod->patch_means[cube] = patch.num_means;
    leave(buffers, &patch);
    patch_free(&patch);
    return status;
}
