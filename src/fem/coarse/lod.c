#include "fem/coarse/lod.h"

#include "base/fail.h"
#include "base/threads.h"
#include "pliant/memory.h"

#include <math.h>
#include <stdio.h>
#include <string.h>

static void place_of(const int32_t cells[3], int32_t cell, int32_t out[3])
{
    out[0] = cell % cells[0];
    out[1] = cell / cells[0] % cells[1];
    out[2] = cell / cells[0] / cells[1];
}

/* ---- what the parts ask for */

void lod_patch(const lod_builder *lod, int32_t cube, int32_t low[3], int32_t high[3])
{
    const int32_t *cells = lod->system->mesh->cells;
    int32_t at[3];
    place_of(cells, lod->cell[cube], at);
    for (int d = 0; d < 3; d++) {
        low[d] = at[d] > lod->layers ? at[d] - lod->layers : 0;
        high[d] = at[d] + lod->layers < cells[d] ? at[d] + lod->layers : cells[d] - 1;
    }
}

int lod_near(const lod_builder *lod, int32_t cube, int32_t near[PLIANT_MAX_NEAR])
{
    const int32_t *cells = lod->system->mesh->cells;
    int32_t low[3], high[3];
    int count = 0;
    lod_patch(lod, cube, low, high);
    for (int32_t k = low[2]; k <= high[2]; k++)
        for (int32_t j = low[1]; j <= high[1]; j++)
            for (int32_t i = low[0]; i <= high[0]; i++) {
                int32_t other = lod->cube_of_cell[i + cells[0] * (j + cells[1] * k)];
                if (other >= 0) near[count++] = other;
            }
    return count;
}

int lod_interpolation(const lod_builder *lod, int32_t fine_node, int32_t nodes[4], double weights[4])
{
    const pliant_upsample *upsample = lod->system->upsample;
    int count = 0;
    for (int v = 0; v < 4; v++) {
        double weight = upsample->weights[4 * (size_t)fine_node + (size_t)v];
        if (fabs(weight) < 1e-9) continue; /* nested: zero, or at least one over the ratio */
        nodes[count] = lod->system->mesh->tets[4 * upsample->coarse_tet[fine_node] + v];
        weights[count++] = weight;
    }
    return count;
}

int lod_corner(const lod_builder *lod, int32_t cube, int32_t node)
{
    for (int v = 0; v < 8; v++)
        if (lod->own[8 * cube + v] == node) return v;
    return -1;
}

pliant_status lod_room_create(const lod_builder *lod, lod_room *out)
{
    size_t fine = (size_t)lod->system->fine->num_nodes, coarse = 2 * (size_t)lod->system->mesh->num_nodes;
    out->local = pliant_calloc(fine, sizeof *out->local);
    out->slot = pliant_calloc(coarse, sizeof *out->slot);
    if (!out->local || !out->slot) return pliant_fail_memory("the correctors");
    memset(out->local, 0xff, fine * sizeof *out->local);
    memset(out->slot, 0xff, coarse * sizeof *out->slot);
    return PLIANT_OK;
}

void lod_room_free(lod_room *room)
{
    pliant_free(room->local);
    pliant_free(room->slot);
}

/* ---- grounded cubes */

pliant_status pliant_lod_ground(pliant_system *system, const uint8_t *fine_fixed, const uint8_t *coarse_fixed,
                                const int32_t *coarse_of_fine)
{
    const pliant_mesh *fine = system->fine, *coarse = system->mesh;
    pliant_status status = pliant_upsample_linear(system, coarse_of_fine);
    if (status != PLIANT_OK) return status;
    system->upsample->still = fine_fixed;
    size_t cells = (size_t)coarse->cells[0] * (size_t)coarse->cells[1] * (size_t)coarse->cells[2];
    uint8_t *cell = pliant_calloc(cells, sizeof *cell);
    system->grounded = pliant_calloc((size_t)coarse->num_tets, sizeof *system->grounded);
    if (!cell || !system->grounded) status = pliant_fail_memory("the coarse elements");
    const lod_builder lod = {.system = system};
    for (int32_t v = 0; status == PLIANT_OK && v < 4 * fine->num_tets; v++) {
        int32_t node = fine->tets[v], nodes[4];
        double weights[4];
        if (!fine_fixed[node]) continue;
        int leans = lod_interpolation(&lod, node, nodes, weights);
        for (int c = 0; c < leans; c++)
            if (!coarse_fixed[nodes[c]]) cell[coarse->lattice_of_tet[coarse_of_fine[v / 4]] / 5] = 1;
    }
    for (int32_t t = 0; status == PLIANT_OK && t < coarse->num_tets; t++) system->grounded[t] = cell[coarse->lattice_of_tet[t] / 5];
    pliant_free(cell);
    return status;
}

/* ---- cubes and the fine mesh */

static int32_t cell_of_tet(const lod_builder *lod, int32_t fine_tet)
{
    const pliant_mesh *fine = lod->system->fine, *coarse = lod->system->mesh;
    int32_t cell = fine->lattice_of_tet[fine_tet] / 5, r = lod->ratio;
    int32_t i = cell % fine->cells[0] / r, j = cell / fine->cells[0] % fine->cells[1] / r, k = cell / fine->cells[0] / fine->cells[1] / r;
    return i + coarse->cells[0] * (j + coarse->cells[1] * k);
}

static void find_own(lod_builder *lod)
{
    const pliant_mesh *coarse = lod->system->mesh;
    int32_t nx = coarse->cells[0] + 1, ny = coarse->cells[1] + 1;
    memset(lod->own, 0xff, 8 * (size_t)lod->count * sizeof *lod->own);
    for (int32_t v = 0; v < 4 * coarse->num_tets; v++) {
        int32_t cell = coarse->lattice_of_tet[v / 4] / 5, node = coarse->tets[v], at = coarse->lattice_of_node[node];
        int32_t cube = lod->cube_of_cell[cell], of_cell[3];
        place_of(coarse->cells, cell, of_cell);
        int32_t i = at % nx - of_cell[0], j = at / nx % ny - of_cell[1], k = at / nx / ny - of_cell[2];
        lod->own[8 * cube + i + 2 * j + 4 * k] = node;
        lod->grounded[cube] |= lod->system->grounded[v / 4];
    }
}

static pliant_status list_cubes(lod_builder *lod)
{
    const pliant_mesh *fine = lod->system->fine, *coarse = lod->system->mesh;
    int32_t cells = coarse->cells[0] * coarse->cells[1] * coarse->cells[2];
    lod->cube_of_cell = pliant_calloc((size_t)cells, sizeof *lod->cube_of_cell);
    lod->tets = pliant_calloc((size_t)fine->num_tets, sizeof *lod->tets);
    if (!lod->cube_of_cell || !lod->tets) return pliant_fail_memory("the coarse cubes");
    for (int32_t t = 0; t < fine->num_tets; t++) lod->cube_of_cell[cell_of_tet(lod, t)]++;
    for (int32_t c = 0; c < cells; c++) lod->count += lod->cube_of_cell[c] > 0;
    size_t count = (size_t)lod->count;
    bool good = (lod->cell = pliant_calloc(count, sizeof *lod->cell)) &&
                (lod->tet_start = pliant_calloc(count + 2, sizeof *lod->tet_start)) &&
                (lod->own = pliant_calloc(count, 8 * sizeof *lod->own)) && (lod->grounded = pliant_calloc(count, sizeof *lod->grounded)) &&
                (lod->patch_nodes = pliant_calloc(count, sizeof *lod->patch_nodes)) &&
                (lod->patch_means = pliant_calloc(count, sizeof *lod->patch_means)) &&
                (lod->correctors = pliant_calloc(count, sizeof *lod->correctors));
    if (!good) return pliant_fail_memory("the coarse cubes");
    int32_t cube = 0;
    for (int32_t c = 0; c < cells; c++) {
        int32_t tets = lod->cube_of_cell[c];
        lod->cube_of_cell[c] = tets > 0 ? cube : -1;
        if (tets == 0) continue;
        lod->tet_start[cube + 2] = lod->tet_start[cube + 1] + tets;
        lod->cell[cube++] = c;
    }
    for (int32_t t = 0; t < fine->num_tets; t++) lod->tets[lod->tet_start[lod->cube_of_cell[cell_of_tet(lod, t)] + 1]++] = t;
    find_own(lod);
    return PLIANT_OK;
}

static pliant_status measure_fine(lod_builder *lod)
{
    const pliant_mesh *fine = lod->system->fine, *coarse = lod->system->mesh;
    const double massless = 1e-3; /* what has no mass counts a little all the same [kg/m^3] */
    size_t count = (size_t)fine->num_nodes;
    lod->mass = pliant_calloc(count, sizeof *lod->mass);
    lod->reach = pliant_calloc(count, 6 * sizeof *lod->reach);
    if (!lod->mass || !lod->reach) return pliant_fail_memory("the fine nodes");
    for (size_t n = 0; n < count; n++) memset(lod->reach + 6 * n, 0xff, 3);
    for (int32_t t = 0; t < fine->num_tets; t++) {
        const int32_t *nodes = fine->tets + 4 * t;
        double gradients[12];
        double volume = pliant_mesh_gradients(fine, t, gradients);
        int32_t at[3];
        place_of(coarse->cells, cell_of_tet(lod, t), at);
        for (int v = 0; v < 4; v++) {
            uint8_t *reach = lod->reach + 6 * (size_t)nodes[v];
            lod->mass[nodes[v]] += 0.25 * volume * (lod->material[t].density + massless);
            for (int d = 0; d < 3; d++) { /* at most 256 cells along an axis */
                if (at[d] < reach[d]) reach[d] = (uint8_t)at[d];
                if (at[d] > reach[3 + d]) reach[3 + d] = (uint8_t)at[d];
            }
        }
    }
    return PLIANT_OK;
}

/* the matrix of the fine mesh at rest, by its free nodes */
static pliant_status assemble_fine(lod_builder *lod)
{
    pliant_system *whole = &lod->whole;
    pliant_tangent *tangents = NULL;
    pliant_status status = pliant_system_elements(whole, lod->material);
    if (status != PLIANT_OK) return status;
    tangents = pliant_calloc((size_t)whole->num_blocks, sizeof *tangents);
    lod->values = pliant_calloc((size_t)whole->pattern.num_values, sizeof *lod->values);
    if (!tangents || !lod->values) {
        pliant_free(tangents);
        return pliant_fail_memory("the stiffness of the fine mesh");
    }
    for (int32_t b = 0; b < whole->num_blocks; b++)
        for (int m = 0; m < 9; m += 4)
            for (int l = 0; l < LANES; l++) tangents[b].rotation[m][l] = 1;
    pliant_system_assemble(whole, tangents, lod->values);
    const double share = 1e-6; /* of the stiffness that a coarse node has, which grows with the cube */
    lod->support = share * lod->ratio * pliant_system_mean_diagonal(whole);
    pliant_free(tangents);
    return PLIANT_OK;
}

/* ---- what it takes */

/* One core of an AVX-512 server needs about this for a corrector: ordering; the factor, whose operations grow as nodes^2 in space
 * (nested dissection) and whose numbers as nodes^(4/3); a solve for every column; and for the macro-element N'(K_C N). */
static const double factor_numbers = 110;

static double seconds_of(double nodes, double means, double own)
{
    double columns = 24 + 3 * means, numbers = pow(nodes, 4.0 / 3);
    return 3.5e-5 * nodes + 60 * nodes * nodes / 1.5e10 + 1.2e-8 * columns * numbers + 1e-9 * own * columns * columns;
}

typedef struct lod_cost { double seconds, mib; } lod_cost;

/* with another ratio or number of layers than the patches were numbered with */
static lod_cost cost_of(const lod_builder *lod, int32_t ratio, int32_t layers)
{
    double finer = pow((double)ratio / lod->ratio, 3), wider = pow((2.0 * layers + 1) / (2.0 * lod->layers + 1), 3), largest = 0;
    double more_means = pow((2.0 * layers + 2) / (2.0 * lod->layers + 2), 3);
    int32_t threads = lod->system->num_threads;
    lod_cost cost = {0, 0};
    for (int32_t cube = 0; cube < lod->count; cube++) {
        double nodes = lod->patch_nodes[cube] * finer * wider, means = lod->patch_means[cube] * more_means, columns = 3 * means;
        double own = 3 * pow(ratio + 1, 3);
        cost.seconds += seconds_of(nodes, means, own) / threads;
        /* corrector, root, entries; in the making: K^-1 [G, Phi] three times and the factor */
        cost.mib += 4 * (72 * nodes + fmin(own, columns) * columns + 3 * own * means);
        largest = fmax(largest, 8 * (3 * (24 + columns) * 3 * nodes + factor_numbers * pow(nodes, 4.0 / 3)));
    }
    cost.mib = (cost.mib + largest * threads) / 1048576;
    return cost;
}

static bool fits(lod_cost cost, const pliant_scene *scene)
{
    return cost.seconds <= scene->model.lod_seconds && cost.mib <= scene->model.lod_memory;
}

static pliant_status check_cost(const lod_builder *lod, const pliant_scene *scene)
{
    lod_cost cost = cost_of(lod, lod->ratio, lod->layers);
    char instead[80] = "fewer mesh/coarse_cells";
    if (fits(cost, scene)) {
        pliant_log(PLIANT_LOG_INFO, "lod: preparing %d cubes, about %.0f s and %.0f MiB", lod->count, ceil(cost.seconds), ceil(cost.mib));
        return PLIANT_OK;
    }
    if (lod->layers > 1 && fits(cost_of(lod, lod->ratio, lod->layers - 1), scene)) {
        snprintf(instead, sizeof instead, "model/lod_layers %d", lod->layers - 1);
    } else {
        for (int32_t ratio = 1; ratio < lod->ratio; ratio++)
            if (fits(cost_of(lod, ratio, lod->layers), scene)) snprintf(instead, sizeof instead, "mesh/ratio %d", ratio);
    }
    return pliant_fail(PLIANT_ERROR_SCENE, "lod: preparing %d cubes would take about %.0f s and %.0f MiB, model/lod_seconds and "
                                           "model/lod_memory allow %g and %g; %s would fit", lod->count, ceil(cost.seconds), ceil(cost.mib),
                       scene->model.lod_seconds, scene->model.lod_memory, instead);
}

/* ---- the work, cube by cube */

typedef pliant_status (*lod_work)(lod_builder *lod, lod_room *room, int32_t cube);

static pliant_status for_every_cube(lod_builder *lod, lod_work work, pliant_progress progress, double begin, double end)
{
    pliant_work all = {.what = "homogenization", .stage = "homogenize", .progress = progress, .begin = begin, .end = end,
                       .count = lod->count, .interval = 1};
#pragma omp parallel num_threads(lod->system->num_threads)
    {
        lod_room room = {0};
        pliant_status status = lod_room_create(lod, &room);
#pragma omp for schedule(dynamic, 1)
        for (int32_t cube = 0; cube < lod->count; cube++) {
            if (status == PLIANT_OK) status = work(lod, &room, cube);
            if (status == PLIANT_OK) status = pliant_work_done(&all);
        }
        lod_room_free(&room);
        pliant_work_leave(&all, status);
    }
    return pliant_work_outcome(&all);
}

static void builder_free(lod_builder *lod)
{
    for (int32_t cube = 0; lod->correctors && cube < lod->count; cube++) {
        pliant_free(lod->correctors[cube].node);
        pliant_free(lod->correctors[cube].value);
    }
    void *blocks[] = {lod->cell, lod->cube_of_cell, lod->tet_start, lod->tets, lod->own, lod->grounded, lod->patch_nodes, lod->patch_means,
                      lod->values, lod->mass, lod->reach, lod->correctors};
    for (size_t b = 0; b < sizeof blocks / sizeof *blocks; b++) pliant_free(blocks[b]);
    pliant_system_clear(&lod->whole);
}

pliant_status pliant_lod(pliant_system *system, const pliant_scene *scene, const uint8_t *fine_fixed, const uint8_t *coarse_fixed,
                         const pliant_tet_material *material, pliant_progress progress)
{
    lod_builder lod = {.system = system, .fine_fixed = fine_fixed, .coarse_fixed = coarse_fixed, .material = material,
                       .layers = scene->model.lod_layers, .ratio = system->fine->cells[0] / system->mesh->cells[0]};
    const double correctors_share = 0.9; /* of the time */
    lod_room room = {0};
    lod.whole.mesh = lod.whole.fine = system->fine;
    lod.whole.num_threads = system->num_threads;
    pliant_status status = list_cubes(&lod);
    if (status == PLIANT_OK) status = measure_fine(&lod);
    if (status == PLIANT_OK) status = pliant_system_unknowns(&lod.whole, fine_fixed);
    if (status == PLIANT_OK) status = lod_room_create(&lod, &room);
    for (int32_t cube = 0; status == PLIANT_OK && cube < lod.count; cube++) status = lod_size(&lod, &room, cube);
    if (status == PLIANT_OK) status = check_cost(&lod, scene);
    if (status == PLIANT_OK) status = assemble_fine(&lod);
    if (status == PLIANT_OK) status = for_every_cube(&lod, lod_correct, progress, 0, correctors_share);
    if (status == PLIANT_OK) status = lod_macros_create(&lod);
    if (status == PLIANT_OK) status = for_every_cube(&lod, lod_macro, progress, correctors_share, 1);
    lod_room_free(&room);
    builder_free(&lod);
    return status;
}
