#include "fem/coarse/lod.h"

#include "base/fail.h"
#include "base/buffer.h"
#include "base/threads.h"
#include "fem/coarse/lod_corrector.h"
#include "fem/coarse/lod_macro.h"
#include "fem/element/hexahedra.h"
#include "base/memory.h"
#include "mesh/mesh.h"

#include <math.h>
#include <stdio.h>
#include <string.h>

/* ---- Grounded cubes. */

/* Build P: linear in coarse tetrahedra, or trilinear in coarse cubes. */
static pliant_status interpolate(pliant_system *system, bool hexahedra, const int32_t *coarse_of_fine)
{
    if (!hexahedra) return pliant_upsample_linear(system, coarse_of_fine);
    pliant_status status = pliant_system_cubes(system);
    if (status == PLIANT_OK) status = pliant_upsample_cubes(system, coarse_of_fine);
    pliant_macros_free(system->macros);
    system->macros = NULL;
    return status;
}

pliant_status pliant_lod_build_upsample(pliant_system *system, bool hexahedra, const uint8_t *fine_fixed,
                                        const uint8_t *coarse_fixed, const int32_t *coarse_of_fine)
{
    const pliant_mesh *fine = system->fine, *coarse = system->mesh;
    pliant_status status = interpolate(system, hexahedra, coarse_of_fine);
    if (status != PLIANT_OK) return status;
    system->upsample->still = fine_fixed;
    size_t cells = (size_t)coarse->cells[0] * (size_t)coarse->cells[1] * (size_t)coarse->cells[2];
    uint8_t *cell = pliant_calloc(cells, sizeof *cell);
    system->grounded = pliant_calloc((size_t)coarse->num_tets, sizeof *system->grounded);
    if (!cell || !system->grounded) status = pliant_fail_memory("the coarse elements");
    const lod_builder lod = {.system = system};
    for (int32_t v = 0; status == PLIANT_OK && v < 4 * fine->num_tets; v++) {
        int32_t node = fine->tets[v], nodes[LOD_MAX_WEIGHTS];
        double weights[LOD_MAX_WEIGHTS];
        if (!fine_fixed[node]) continue;
        int leans = lod_interpolation(&lod, node, nodes, weights);
        for (int c = 0; c < leans; c++)
            if (!coarse_fixed[nodes[c]]) cell[coarse->lattice_of_tet[coarse_of_fine[v / 4]] / 5] = 1;
    }
    for (int32_t t = 0; status == PLIANT_OK && t < coarse->num_tets; t++)
        system->grounded[t] = cell[coarse->lattice_of_tet[t] / 5];
    pliant_free(cell);
    return status;
}

/* Build hexahedra with lambda limited to a Poisson's ratio of 0.43. The excess goes to lod->bulk. */
static pliant_status make_hexahedra(lod_builder *lod)
{
    const double maximum = 6; /* maximum lambda / mu */
    const pliant_mesh *fine = lod->system->fine;
    pliant_tet_material *material = pliant_copy_block(lod->material, (size_t)fine->num_tets, sizeof *material);
    int32_t *element = NULL;
    pliant_status status = material ? PLIANT_OK : pliant_fail_memory("the fine mesh");
    for (int32_t t = 0; material && t < fine->num_tets; t++)
        material[t].lambda = fmin(material[t].lambda, maximum * material[t].mu);
    if (status == PLIANT_OK) status = pliant_system_build_hexahedra(&lod->whole, material, NULL, NULL, NULL);
    if (status == PLIANT_OK) status = pliant_hexahedra_of_tets(fine, lod->whole.macros, &element);
    if (status == PLIANT_OK && !(lod->bulk = pliant_calloc((size_t)lod->whole.macros->count, sizeof *lod->bulk)))
        status = pliant_fail_memory("the fine mesh");
    for (int32_t t = 0; status == PLIANT_OK && t < fine->num_tets; t++) {
        double gradients[12];
        lod->bulk[element[t]] +=
            pliant_mesh_gradients(fine, t, gradients) * (lod->material[t].lambda - material[t].lambda);
    }
    pliant_free(element);
    pliant_free(material);
    return status;
}

/* Create the fine mesh's elements at rest. */
static pliant_status make_fine(lod_builder *lod, bool hexahedra)
{
    pliant_system *whole = &lod->whole;
    whole->mesh = whole->fine = lod->system->fine;
    whole->num_threads = lod->system->num_threads;
    pliant_status status =
        hexahedra ? make_hexahedra(lod) : pliant_system_build_tetrahedra(whole, lod->material, NULL, NULL);
    if (status != PLIANT_OK) return status;
    if (!(lod->at_rest = pliant_calloc((size_t)whole->num_blocks, sizeof *lod->at_rest)))
        return pliant_fail_memory("the stiffness of the fine mesh");
    for (int32_t b = 0; b < whole->num_blocks; b++)
        for (int m = 0; m < 9; m += 4)
            for (int l = 0; l < LANES; l++) lod->at_rest[b].rotation[m][l] = 1;
    return PLIANT_OK;
}

/* Assemble the fine matrix on the free nodes. */
static pliant_status assemble_fine(lod_builder *lod)
{
    pliant_system *whole = &lod->whole;
    pliant_status status = pliant_system_find_mean_diagonal(whole, NULL, NULL);
    if (status != PLIANT_OK) return status;
    if (!(lod->values = pliant_calloc((size_t)whole->pattern.num_values, sizeof *lod->values)))
        return pliant_fail_memory("the stiffness of the fine mesh");
    pliant_system_assemble(whole, lod->at_rest, lod->values);
    const double fraction = 1e-6; /* fraction of a coarse node's stiffness, which grows with the cube */
    lod->support = fraction * lod->ratio * whole->mean_diagonal;
    return PLIANT_OK;
}

/* ---- Cost estimate. */

/* Costs of a corrector on one core of an AVX-512 server: ordering; factor; a solve for every column; N'(K_C N) for the
 * macro-element. The factor's operations grow as nodes^2 and its values as nodes^(4/3) in 3D (nested dissection). */
static const double factor_numbers = 110;

/* Return the ratio of a factor's values to those for tetrahedra (NUMERICS.md). */
static double fill_of(const lod_builder *lod) { return lod->whole.macros ? 1.8 : 1; }

static double seconds_of(double fill, double nodes, double held, double own)
{
    double columns = 24 + held, numbers = fill * pow(nodes, 4.0 / 3);
    return 3.5e-5 * nodes + 60 * pow(fill * nodes, 2) / 1.5e10 + 1.2e-8 * columns * numbers +
           1e-9 * own * columns * columns;
}

typedef struct lod_cost { double seconds, mib; } lod_cost;

/* Estimate the cost for another ratio or number of layers, from the present patch sizes. */
static lod_cost cost_of(const lod_builder *lod, int32_t ratio, int32_t layers)
{
    double finer = pow((double)ratio / lod->ratio, 3), wider = pow((2.0 * layers + 1) / (2.0 * lod->layers + 1), 3),
           largest = 0;
    double more_means = pow((2.0 * layers + 2) / (2.0 * lod->layers + 2), 3);
    int32_t threads = lod->system->num_threads;
    lod_cost cost = {0, 0};
    for (int32_t cube = 0; cube < lod->count; cube++) {
        double nodes = lod->patch_nodes[cube] * finer * wider, means = lod->patch_means[cube] * more_means,
               columns = 3 * means;
        double own = 3 * pow(ratio + 1, 3), held = columns + (lod->bulk ? pow(2.0 * layers + 1, 3) : 0);
        cost.seconds += seconds_of(fill_of(lod), nodes, held, own) / threads;
        /* Corrector, root, entries; temporary: three times K^-1 [G, Phi], and the factor. */
        cost.mib += 4 * (72 * nodes + fmin(own, columns) * columns + 3 * own * means);
        largest =
            fmax(largest, 8 * (3 * (24 + held) * 3 * nodes + fill_of(lod) * factor_numbers * pow(nodes, 4.0 / 3)));
    }
    cost.mib = (cost.mib + largest * threads) / 1048576;
    return cost;
}

/* Limits of the preparation: a model beyond them is refused. */
static const double max_seconds = 300, max_mib = 4096;

static bool fits(lod_cost cost)
{
    return cost.seconds <= max_seconds && cost.mib <= max_mib;
}

static pliant_status check_cost(const lod_builder *lod)
{
    lod_cost cost = cost_of(lod, lod->ratio, lod->layers);
    char instead[80] = "fewer mesh/coarse_cells";
    if (fits(cost)) {
        pliant_log(PLIANT_LOG_INFO, "lod: preparing %d cubes, about %.0f s and %.0f MiB", lod->count,
                   ceil(cost.seconds), ceil(cost.mib));
        return PLIANT_OK;
    }
    if (lod->layers > 1 && fits(cost_of(lod, lod->ratio, lod->layers - 1))) {
        snprintf(instead, sizeof instead, "model/lod_layers %d", lod->layers - 1);
    } else {
        for (int32_t ratio = 1; ratio < lod->ratio; ratio++)
            if (fits(cost_of(lod, ratio, lod->layers)))
                snprintf(instead, sizeof instead, "mesh/ratio %d", ratio);
    }
    return pliant_fail(PLIANT_ERROR_SCENE,
                       "lod: preparing %d cubes would take about %.0f s and %.0f MiB, more than %g s or %g MiB; "
                       "%s would fit",
                       lod->count, ceil(cost.seconds), ceil(cost.mib), max_seconds, max_mib, instead);
}

/* ---- The computation, cube by cube. */

typedef pliant_status (*lod_work)(lod_builder *lod, lod_buffers *buffers, int32_t cube);

static pliant_status for_every_cube(lod_builder *lod, lod_work work, pliant_progress progress, double begin, double end)
{
    pliant_work all = {.what = "homogenization",
                       .stage = "homogenize",
                       .progress = progress,
                       .begin = begin,
                       .end = end,
                       .count = lod->count,
                       .interval = 1};
#pragma omp parallel num_threads(lod->system->num_threads)
    {
        lod_buffers buffers = {0};
        pliant_status status = lod_buffers_create(lod, &buffers);
#pragma omp for schedule(dynamic, 1)
        for (int32_t cube = 0; cube < lod->count; cube++) {
            if (status == PLIANT_OK) status = work(lod, &buffers, cube);
            if (status == PLIANT_OK) status = pliant_work_finish_item(&all);
        }
        lod_buffers_free(&buffers);
        pliant_work_finish_thread(&all, status);
    }
    return pliant_work_result(&all);
}

static void builder_free(lod_builder *lod)
{
    for (int32_t cube = 0; lod->correctors && cube < lod->count; cube++) {
        pliant_free(lod->correctors[cube].node);
        pliant_free(lod->correctors[cube].value);
    }
    PLIANT_FREE(lod->cell, lod->cube_of_cell, lod->element_start, lod->elements, lod->at_rest, lod->bulk, lod->own,
                lod->grounded, lod->patch_nodes, lod->patch_means, lod->values, lod->mass, lod->reach, lod->correctors);
    pliant_system_clear(&lod->whole);
}

pliant_status pliant_lod_build_macros(pliant_system *system, const pliant_scene *scene, const uint8_t *fine_fixed,
                                      const uint8_t *coarse_fixed, const pliant_tet_material *material,
                                      pliant_progress progress)
{
    lod_builder lod = {.system = system, .fine_fixed = fine_fixed, .coarse_fixed = coarse_fixed, .material = material,
                       .layers = scene->model.lod_layers, .ratio = system->fine->cells[0] / system->mesh->cells[0]};
    const double correctors_share = 0.9; /* of the time */
    lod_buffers buffers = {0};
    pliant_status status = make_fine(&lod, scene->element.kind == PLIANT_HEXAHEDRA);
    if (status == PLIANT_OK) status = lod_list_cubes(&lod);
    if (status == PLIANT_OK) status = lod_measure_fine(&lod);
    if (status == PLIANT_OK) status = pliant_system_unknowns(&lod.whole, fine_fixed);
    if (status == PLIANT_OK) status = lod_buffers_create(&lod, &buffers);
    for (int32_t cube = 0; status == PLIANT_OK && cube < lod.count; cube++) status = lod_size(&lod, &buffers, cube);
    if (status == PLIANT_OK) status = check_cost(&lod);
    if (status == PLIANT_OK) status = assemble_fine(&lod);
    if (status == PLIANT_OK) status = for_every_cube(&lod, lod_correct, progress, 0, correctors_share);
    if (status == PLIANT_OK) status = lod_macros_create(&lod);
    if (status == PLIANT_OK) status = for_every_cube(&lod, lod_macro, progress, correctors_share, 1);
    lod_buffers_free(&buffers);
    builder_free(&lod);
    return status;
}
