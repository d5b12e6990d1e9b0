/* Upsampling from solved nodes to fine nodes, and transfer of forces by the transposed weights ([H] 2.3 and 3). */
#include "base/fail.h"
#include "fem/element/macro_element.h"
#include "fem/coarse/shape_interpolation.h"
#include "fem/element/hexahedra.h"
#include "fem/element/rotation.h"
#include "fem/system.h"
#include "base/memory.h"
#include "mesh/mesh.h"

#include <math.h>
#include <string.h>

/* Return the first coarse element that contains each fine node: (fine nodes). The interpolation is continuous, so any
 * of them would do. */
static int32_t *owners_of(const pliant_mesh *fine, const int32_t *element_of_fine)
{
    int32_t *owner = pliant_calloc((size_t)fine->num_nodes, sizeof *owner);
    if (owner) memset(owner, 0xff, (size_t)fine->num_nodes * sizeof *owner);
    for (int32_t v = 0; owner && v < 4 * fine->num_tets; v++)
        if (owner[fine->tets[v]] < 0) owner[fine->tets[v]] = element_of_fine[v / 4];
    return owner;
}

/* Allocate weights for `corners` corners per node. owner: out: freed by the caller. */
static pliant_status begin(pliant_system *system, int32_t corners, const int32_t *element_of_fine, int32_t **owner)
{
    const size_t count = (size_t)system->fine->num_nodes, of_each = (size_t)corners;
    pliant_upsample *upsample = system->upsample = pliant_calloc(1, sizeof *upsample);
    if (!upsample) return pliant_fail_memory("the upsampling");
    upsample->corners = corners;
    upsample->node = pliant_calloc(count, of_each * sizeof *upsample->node);
    upsample->weights = pliant_calloc(count, of_each * sizeof *upsample->weights);
    *owner = upsample->node && upsample->weights ? owners_of(system->fine, element_of_fine) : NULL;
    return *owner ? PLIANT_OK : pliant_fail_memory("the upsampling");
}

pliant_status pliant_upsample_linear(pliant_system *system, const int32_t *coarse_of_fine)
{
    const pliant_mesh *fine = system->fine, *coarse = system->mesh;
    int32_t *owner;
    pliant_status status = begin(system, 4, coarse_of_fine, &owner);
    if (status != PLIANT_OK) return status;
    pliant_upsample *upsample = system->upsample;
    for (int32_t n = 0; n < fine->num_nodes; n++) {
        const int32_t *nodes = coarse->tets + 4 * owner[n];
        memcpy(upsample->node + 4 * n, nodes, 4 * sizeof *nodes);
        pliant_mesh_barycentric(coarse, owner[n], fine->rest + 3 * n, upsample->weights + 4 * n);
    }
    pliant_free(owner);
    return PLIANT_OK;
}

void pliant_trilinear_weights(const pliant_system *system, int32_t cell, const double *point, double weights[8])
{
    const pliant_mesh *mesh = system->mesh, *fine = system->fine;
    const int32_t at[3] = {cell % mesh->cells[0], cell / mesh->cells[0] % mesh->cells[1],
                           cell / mesh->cells[0] / mesh->cells[1]};
    double along[3];
    for (int d = 0; d < 3; d++) {
        double sum = 0, finer = (double)fine->cells[d] / mesh->cells[d];
        for (int r = 0; r < 3; r++) sum += mesh->direction[3 * r + d] * (point[r] - mesh->corner[r]);
        along[d] = sum / mesh->cell_size[d] - at[d];
        double nearest = round(finer * along[d]) / finer;
        if (fabs(along[d] - nearest) < 1e-6) along[d] = nearest;
    }
    for (int v = 0; v < 8; v++) {
        weights[v] = 1;
        for (int d = 0; d < 3; d++) weights[v] *= v >> d & 1 ? along[d] : 1 - along[d];
    }
}

pliant_status pliant_upsample_trilinear(pliant_system *system, const int32_t *element_of_fine)
{
    const pliant_mesh *fine = system->fine;
    const pliant_macros *macros = system->macros;
    int32_t *owner;
    pliant_status status = begin(system, 8, element_of_fine, &owner);
    if (status != PLIANT_OK) return status;
    pliant_upsample *upsample = system->upsample;
    for (int32_t n = 0; n < fine->num_nodes; n++) {
        const int32_t element = owner[n], *nodes = macros->node + macros->start[element],
                      corners = macros->start[element + 1] - macros->start[element];
        double *weights = upsample->weights + 8 * (size_t)n, gradients[12];
        for (int v = 0; v < 8; v++) upsample->node[8 * (size_t)n + (size_t)v] = nodes[v % corners];
        if (corners == 8) {
            pliant_trilinear_weights(system, macros->cell[element], fine->rest + 3 * n, weights);
            continue;
        }
        memcpy(gradients, macros->gradient + 24 * (size_t)element, sizeof gradients); /* next to a cut: a tetrahedron */
        const double *origin = system->mesh->rest + 3 * nodes[0];
        for (int v = 0; v < 4; v++) {
            weights[v] = v == 0;
            for (int d = 0; d < 3; d++) weights[v] += gradients[3 * v + d] * (fine->rest[3 * n + d] - origin[d]);
        }
    }
    pliant_free(owner);
    return PLIANT_OK;
}

pliant_status pliant_upsample_cubes(pliant_system *system, const int32_t *coarse_of_fine)
{
    int32_t *element = NULL, *of_fine = pliant_calloc((size_t)system->fine->num_tets, sizeof *of_fine);
    pliant_status status = of_fine ? pliant_hexahedra_of_tets(system->mesh, system->macros, &element)
                                   : pliant_fail_memory("the upsampling");
    for (int32_t t = 0; status == PLIANT_OK && t < system->fine->num_tets; t++) of_fine[t] = element[coarse_of_fine[t]];
    if (status == PLIANT_OK) status = pliant_upsample_trilinear(system, of_fine);
    pliant_free(element);
    pliant_free(of_fine);
    return status;
}

/* ---- Homogenized shape functions. */

typedef struct tet_frame {
    double x[12], rest[12];
    pliant_shaped_frame frame;
} tet_frame;

static void frame_of(const pliant_system *system, const double *solved, int32_t tet, tet_frame *out)
{
    const pliant_mesh *mesh = system->mesh;
    const int32_t *nodes = mesh->tets + 4 * tet;
    double gradients[12], f[9];
    for (int v = 0; v < 4; v++)
        for (int d = 0; d < 3; d++) {
            out->x[3 * v + d] = solved[3 * nodes[v] + d];
            out->rest[3 * v + d] = mesh->rest[3 * nodes[v] + d];
            gradients[3 * v + d] = system->gradients[tet / LANES][3 * v + d][tet % LANES];
        }
    if (system->grounded && system->grounded[tet]) {
        pliant_shaped_ground(&out->frame);
        return;
    }
    pliant_shaped_find_frame(out->x, out->rest, gradients, f, &out->frame);
    pliant_rotation_signed_svd(f, out->frame.rotation);
}

static void macro_frame_of(const pliant_system *system, const double *solved, int32_t element, pliant_macro_frame *out)
{
    const pliant_macros *macros = system->macros;
    double f[9];
    pliant_macro_find_frame(macros->own + 8 * (size_t)element, macros->gradient + 24 * (size_t)element, solved,
                            system->mesh->rest, f, out);
    for (int m = 0; m < 9 && macros->grounded[element]; m++) f[m] = m % 4 == 0;
    pliant_rotation_signed_svd(f, out->rotation);
}

/* Compute the position of a fine node, and dx_f/dx_v, from one entry's element alone. */
static void entry_position(const pliant_system *system, const double *solved, int32_t entry, const double *rest,
                           double x[3])
{
    const pliant_upsample *upsample = system->upsample;
    const pliant_macros *macros = system->macros;
    const int32_t element = upsample->entry_element[entry];
    const double *shape = upsample->entry_shape + 9 * (size_t)upsample->corners * (size_t)entry;
    if (!macros) {
        tet_frame tet;
        frame_of(system, solved, element, &tet);
        pliant_shaped_position(&tet.frame, tet.x, tet.rest, shape, rest, x);
        return;
    }
    double q[24], w[3];
    pliant_macro_frame frame;
    macro_frame_of(system, solved, element, &frame);
    for (int32_t c = macros->start[element]; c < macros->start[element + 1]; c++)
        pliant_macro_corner(&frame, macros->held[c], solved + 3 * macros->node[c],
                            system->mesh->rest + 3 * macros->node[c], q + 3 * (c - macros->start[element]));
    pliant_macro_shaped_by_all(macros->start[element + 1] - macros->start[element], shape, q, w);
    memcpy(x, rest, 3 * sizeof *x);
    pliant_macro_follow(&frame, macros->grounded[element], w, x);
}

static void entry_rotation(const pliant_system *system, const double *solved, int32_t entry, double out[9])
{
    const int32_t element = system->upsample->entry_element[entry];
    tet_frame tet;
    pliant_macro_frame macro;
    if (system->macros) macro_frame_of(system, solved, element, &macro);
    else frame_of(system, solved, element, &tet);
    memcpy(out, system->macros ? macro.rotation : tet.frame.rotation, 9 * sizeof *out);
}

/* Return whether fine nodes follow macro-elements. Otherwise the macro-elements belong to the fine mesh. */
static bool follows_macros(const pliant_system *system) { return system->macros && system->macros->fine_start; }

bool pliant_solves_fine(const pliant_system *system) { return !system->upsample && !follows_macros(system); }

bool pliant_upsample_turns(const pliant_system *system)
{
    return follows_macros(system) || (system->upsample && system->upsample->start);
}

void pliant_upsample_positions(const pliant_system *system, const double *solved, double *fine)
{
    const pliant_upsample *upsample = system->upsample;
    size_t count = (size_t)system->fine->num_nodes;
    if (follows_macros(system)) {
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
        if (upsample->still && upsample->still[n] == PLIANT_FIXED_AT_REST) {
            memcpy(sum, rest, sizeof sum);
        } else if (!upsample->start) {
            const size_t corners = (size_t)upsample->corners;
            const int32_t *nodes = upsample->node + corners * n;
            for (size_t v = 0; v < corners; v++)
                for (int d = 0; d < 3; d++)
                    sum[d] += upsample->weights[corners * n + v] *
                              (solved[3 * nodes[v] + d] - system->mesh->rest[3 * nodes[v] + d]);
            /* Displacements are exactly 0 if the coarse nodes are at rest. */
            for (int d = 0; d < 3; d++) sum[d] += rest[d];
        } else {
            for (int32_t e = upsample->start[n]; e < upsample->start[n + 1]; e++) {
                double x[3];
                entry_position(system, solved, e, rest, x);
                for (int d = 0; d < 3; d++) sum[d] += upsample->entry_weight[e] * (x[d] - rest[d]);
            }
            for (int d = 0; d < 3; d++) sum[d] += rest[d];
        }
        memcpy(fine + 3 * n, sum, sizeof sum);
    }
}

/* Add a weight to the unknowns. block: Nullable: NULL means the identity. */
static void add_block(const pliant_system *system, int32_t node, double weight, const double block[9],
                      pliant_weight_blocks *blocks)
{
    const int32_t unknown = system->free_of_node[node];
    if (unknown < 0) return;
    double *out = pliant_weight_blocks_at(blocks, unknown);
    for (int m = 0; block && m < 9; m++) out[m] += weight * block[m];
    for (int m = 0; !block && m < 9; m += 4) out[m] += weight;
}

/* Compute the masses for linear weights, where every M_j is m_j I. */
static void linear_masses(const pliant_system *system, const double *mass, double *dense)
{
    const pliant_upsample *upsample = system->upsample;
    const size_t corners = (size_t)upsample->corners, count = (size_t)system->fine->num_nodes;
    for (size_t n = 0; n < count; n++) {
        if (upsample->still && upsample->still[n] != PLIANT_MOVES) continue;
        for (size_t v = corners * n; v < corners * (n + 1); v++) {
            const int32_t unknown = system->free_of_node[upsample->node[v]];
            if (unknown >= 0) dense[9 * (size_t)unknown] += mass[n] * upsample->weights[v];
        }
    }
    for (size_t f = 0; f < (size_t)system->num_free; f++) dense[9 * f + 4] = dense[9 * f + 8] = dense[9 * f];
}

pliant_status pliant_upsample_masses(const pliant_system *system, const double *mass, double *dense)
{
    const int32_t count = system->fine->num_nodes;
    if (!follows_macros(system) && system->upsample && !system->upsample->start) {
        linear_masses(system, mass, dense);
        return PLIANT_OK;
    }
    int32_t *nodes = pliant_calloc((size_t)count, sizeof *nodes);
    if (!nodes) return pliant_fail_memory("the gravity-mass matrices");
    for (int32_t n = 0; n < count; n++) nodes[n] = n;
    pliant_weight_blocks blocks = {.block = dense};
    pliant_upsample_weights(system, system->mesh->rest, count, nodes, mass, &blocks);
    pliant_free(nodes);
    return PLIANT_OK;
}

void pliant_upsample_weights(const pliant_system *system, const double *solved, int32_t count, const int32_t *nodes,
                             const double *weights, pliant_weight_blocks *blocks)
{
    const pliant_upsample *upsample = system->upsample;
    for (int32_t h = 0; h < count; h++) {
        int32_t n = nodes[h];
        if (follows_macros(system)) {
            pliant_macro_weights(system, solved, n, weights[h], blocks);
        } else if (!upsample) {
            add_block(system, n, weights[h], NULL, blocks);
        } else if (upsample->still && upsample->still[n] != PLIANT_MOVES) {
            continue;
        } else if (!upsample->start) {
            const size_t corners = (size_t)upsample->corners, first = corners * (size_t)n;
            for (size_t v = first; v < first + corners; v++)
                add_block(system, upsample->node[v], weights[h] * upsample->weights[v], NULL, blocks);
        } else {
            for (int32_t e = upsample->start[n]; e < upsample->start[n + 1]; e++) {
                const int32_t begin = pliant_element_begin(system, upsample->entry_element[e]),
                              end = pliant_element_begin(system, upsample->entry_element[e] + 1);
                const double *shape = upsample->entry_shape + 9 * (size_t)upsample->corners * (size_t)e;
                double rotation[9], turned[9];
                entry_rotation(system, solved, e, rotation);
                for (int32_t c = begin; c < end; c++) {
                    pliant_shaped_weight(rotation, shape, end - begin, c - begin, turned);
                    add_block(system, pliant_element_nodes(system)[c], weights[h] * upsample->entry_weight[e], turned,
                              blocks);
                }
            }
        }
    }
}
