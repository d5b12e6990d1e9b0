/* From solved nodes to fine nodes, and forces the other way by the same weights ([H] 2.3 and 3). */
#include "base/fail.h"
#include "fem/system.h"
#include "pliant/memory.h"

#include <string.h>

void pliant_upsample_free(pliant_upsample *upsample)
{
    if (!upsample) return;
    pliant_free(upsample->coarse_tet);
    pliant_free(upsample->weights);
    pliant_free(upsample->start);
    pliant_free(upsample->entry_tet);
    pliant_free(upsample->entry_share);
    pliant_free(upsample->entry_shape);
    pliant_free(upsample);
}

pliant_status pliant_upsample_linear(pliant_system *system, const int32_t *coarse_of_fine)
{
    const pliant_mesh *fine = system->fine, *coarse = system->mesh;
    pliant_upsample *upsample = system->upsample = pliant_calloc(1, sizeof *upsample);
    if (!upsample) return pliant_fail_memory("the upsampling");
    upsample->coarse_tet = pliant_calloc((size_t)fine->num_nodes, sizeof *upsample->coarse_tet);
    upsample->weights = pliant_calloc((size_t)fine->num_nodes, 4 * sizeof *upsample->weights);
    if (!upsample->coarse_tet || !upsample->weights) return pliant_fail_memory("the upsampling");
    /* any coarse tetrahedron that holds the node serves, the interpolation is continuous: the first one */
    memset(upsample->coarse_tet, 0xff, (size_t)fine->num_nodes * sizeof *upsample->coarse_tet);
    for (int32_t v = 0; v < 4 * fine->num_tets; v++)
        if (upsample->coarse_tet[fine->tets[v]] < 0) upsample->coarse_tet[fine->tets[v]] = coarse_of_fine[v / 4];
    for (int32_t n = 0; n < fine->num_nodes; n++)
        pliant_mesh_barycentric(coarse, upsample->coarse_tet[n], fine->rest + 3 * n, upsample->weights + 4 * n);
    return PLIANT_OK;
}

static void frame_of(const pliant_system *system, const double *solved, int32_t tet, double rotation[9], double centre[3],
                     double rest_centre[3])
{
    const pliant_mesh *mesh = system->mesh;
    const int32_t *nodes = mesh->tets + 4 * tet;
    double f[9] = {0};
    memset(centre, 0, 3 * sizeof *centre);
    memset(rest_centre, 0, 3 * sizeof *rest_centre);
    for (int v = 0; v < 4; v++)
        for (int r = 0; r < 3; r++) {
            double x = solved[3 * nodes[v] + r];
            centre[r] += 0.25 * x;
            rest_centre[r] += 0.25 * mesh->rest[3 * nodes[v] + r];
            for (int c = 0; c < 3; c++) f[3 * r + c] += (x - solved[3 * nodes[0] + r]) * system->gradients[tet / LANES][3 * v + c][tet % LANES];
        }
    if (system->grounded && system->grounded[tet])
        for (int m = 0; m < 9; m++) rotation[m] = m % 4 == 0;
    else
        pliant_rotation_signed_svd(f, rotation);
}

/* One entry: R (N u_c + X_f - C) + c, with u_c = R' (x_c - c) - (X_c - C). [H] 4, 5, 7 */
static void shaped_position(const pliant_system *system, const double *solved, int32_t tet, const double *shape, const double *rest,
                            double out[3])
{
    const pliant_mesh *mesh = system->mesh;
    double rotation[9], c[3], big_c[3], u[12], local[3];
    frame_of(system, solved, tet, rotation, c, big_c);
    for (int v = 0; v < 4; v++) {
        int32_t node = mesh->tets[4 * tet + v];
        for (int d = 0; d < 3; d++) {
            u[3 * v + d] = -(mesh->rest[3 * node + d] - big_c[d]);
            for (int r = 0; r < 3; r++) u[3 * v + d] += rotation[3 * r + d] * (solved[3 * node + r] - c[r]);
        }
    }
    for (int d = 0; d < 3; d++) {
        local[d] = rest[d] - big_c[d];
        for (int m = 0; m < 12; m++) local[d] += shape[12 * d + m] * u[m];
    }
    for (int d = 0; d < 3; d++) out[d] = rotation[3 * d] * local[0] + rotation[3 * d + 1] * local[1] + rotation[3 * d + 2] * local[2] + c[d];
}

bool pliant_upsample_turns(const pliant_system *system) { return system->macros || (system->upsample && system->upsample->start); }

void pliant_upsample_positions(const pliant_system *system, const double *solved, double *fine)
{
    const pliant_upsample *upsample = system->upsample;
    size_t count = (size_t)system->fine->num_nodes;
    if (system->macros) {
        pliant_macro_positions(system, solved, fine);
        return;
    }
    if (!upsample) {
        memcpy(fine, solved, 3 * count * sizeof *fine);
        return;
    }
#pragma omp parallel for schedule(static) num_threads(system->num_threads)
    for (size_t n = 0; n < count; n++) {
        const double *rest = system->fine->rest + 3 * n;
        double sum[3] = {0, 0, 0};
        if (upsample->still && upsample->still[n]) {
            memcpy(sum, rest, sizeof sum);
        } else if (!upsample->start) {
            const int32_t *nodes = system->mesh->tets + 4 * upsample->coarse_tet[n];
            for (int v = 0; v < 4; v++)
                for (int d = 0; d < 3; d++)
                    sum[d] += upsample->weights[4 * n + v] * (solved[3 * nodes[v] + d] - system->mesh->rest[3 * nodes[v] + d]);
            for (int d = 0; d < 3; d++) sum[d] += rest[d]; /* displacements: exactly at rest when the coarse nodes are */
        } else {
            for (int32_t e = upsample->start[n]; e < upsample->start[n + 1]; e++) {
                double x[3];
                shaped_position(system, solved, upsample->entry_tet[e], upsample->entry_shape + 36 * (size_t)e, rest, x);
                for (int d = 0; d < 3; d++) sum[d] += upsample->entry_share[e] * (x[d] - rest[d]);
            }
            for (int d = 0; d < 3; d++) sum[d] += rest[d];
        }
        memcpy(fine + 3 * n, sum, sizeof sum);
    }
}

static void add_block(const pliant_system *system, int32_t node, double weight, const double block[9], double *dense)
{
    int32_t unknown = system->free_of_node[node];
    if (unknown < 0) return;
    for (int m = 0; m < 9; m++) dense[9 * (size_t)unknown + m] += weight * (block ? block[m] : m % 4 == 0);
}

void pliant_upsample_weights(const pliant_system *system, const double *solved, int32_t count, const int32_t *nodes, const double *weights,
                             double *dense)
{
    const pliant_upsample *upsample = system->upsample;
    for (int32_t h = 0; h < count; h++) {
        int32_t n = nodes[h];
        if (system->macros) {
            pliant_macro_weights(system, solved, n, weights[h], dense);
        } else if (!upsample) {
            add_block(system, n, weights[h], NULL, dense);
        } else if (upsample->still && upsample->still[n]) {
            continue;
        } else if (!upsample->start) {
            for (int v = 0; v < 4; v++)
                add_block(system, system->mesh->tets[4 * upsample->coarse_tet[n] + v], weights[h] * upsample->weights[4 * n + v], NULL, dense);
        } else {
            for (int32_t e = upsample->start[n]; e < upsample->start[n + 1]; e++) {
                int32_t tet = upsample->entry_tet[e];
                const double *shape = upsample->entry_shape + 36 * (size_t)e;
                double rotation[9], c[3], big_c[3];
                frame_of(system, solved, tet, rotation, c, big_c);
                for (int v = 0; v < 4; v++) {
                    double turned[9] = {0}; /* R N_v R' */
                    for (int i = 0; i < 3; i++)
                        for (int j = 0; j < 3; j++)
                            for (int k = 0; k < 3; k++)
                                for (int l = 0; l < 3; l++)
                                    turned[3 * i + j] += rotation[3 * i + k] * shape[12 * k + 3 * v + l] * rotation[3 * j + l];
                    add_block(system, system->mesh->tets[4 * tet + v], weights[h] * upsample->entry_share[e], turned, dense);
                }
            }
        }
    }
}
