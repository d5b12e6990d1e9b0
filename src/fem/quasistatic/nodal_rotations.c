#include "fem/quasistatic/nodal_rotations.h"

#include "base/fail.h"
#include "base/buffer.h"
#include "fem/element/macro_element.h"
#include "fem/element/deformation.h"
#include "fem/element/rotation.h"
#include "base/memory.h"

#include <string.h>

pliant_status pliant_nodal_rotations_create(const pliant_system *system, pliant_nodal_rotations **out)
{
    *out = NULL;
    if (system->stiffness || system->basis || (system->macros && !system->macros->shear)) return PLIANT_OK;
    pliant_nodal_rotations *rotations = pliant_calloc(1, sizeof *rotations);
    if (rotations) {
        /* Written by refer and by update. */
        rotations->rotation = pliant_malloc((size_t)system->num_free, 9 * sizeof *rotations->rotation);
        rotations->before = pliant_malloc((size_t)system->num_blocks, sizeof *rotations->before);
        rotations->product = pliant_malloc((size_t)system->num_blocks, sizeof *rotations->product);
    }
    if (!rotations || !rotations->rotation || !rotations->before || !rotations->product) {
        pliant_nodal_rotations_free(rotations);
        return pliant_fail_memory("the solver's axes");
    }
    *out = rotations;
    return PLIANT_OK;
}

void pliant_nodal_rotations_free(pliant_nodal_rotations *rotations)
{
    if (!rotations) return;
    PLIANT_FREE(rotations->rotation, rotations->before, rotations->product, rotations);
}

/* Compute F of a block of elements. Grounded elements have F = I. */
static inline __attribute__((always_inline)) void deformations(const pliant_system *system, int32_t block,
                                                               const double *positions, double f[9][LANES])
{
    double x[12][LANES];
    load_corners(system, positions, block, x);
    deformation_of(x, system->gradients[block], f);
    const uint8_t *grounded = grounded_of(system, block);
    if (grounded) ground(grounded, f);
}

PLIANT_VECTORIZED static void keep_before(const pliant_system *system, int32_t block, const double *positions,
                                          float before[9][LANES])
{
    double f[9][LANES];
    deformations(system, block, positions, f);
    for (int m = 0; m < 9; m++)
        for (int l = 0; l < LANES; l++) before[m][l] = (float)(system->lame[block][1][l] * f[m][l]);
}

/* Compute F F0' of a block. For F = Q F0 its rotation is Q, for any stretch F0. */
PLIANT_VECTORIZED static void multiply(const pliant_system *system, int32_t block, const double *positions,
                                       float before[9][LANES], float product[LANES][9])
{
    double f[9][LANES];
    deformations(system, block, positions, f);
    for (int r = 0; r < 3; r++)
        for (int c = 0; c < 3; c++)
            for (int l = 0; l < LANES; l++)
                product[l][3 * r + c] =
                    (float)(f[3 * r][l] * before[3 * c][l] + f[3 * r + 1][l] * before[3 * c + 1][l] +
                            f[3 * r + 2][l] * before[3 * c + 2][l]);
}

/* Compute the same for a hexahedron. */
static void deformation_of_macro(const pliant_system *system, int32_t element, const double *positions, double f[9])
{
    const pliant_macros *macros = system->macros;
    pliant_macro_frame frame;
    pliant_macro_find_frame(macros->own + 8 * (size_t)element, macros->gradient + 24 * (size_t)element, positions,
                            system->mesh->rest, f, &frame);
}

static void keep_macros_before(const pliant_system *system, const double *positions, pliant_nodal_rotations *rotations)
{
#pragma omp parallel for schedule(static) num_threads(system->num_threads)
    for (int32_t e = 0; e < system->macros->count; e++) {
        double f[9];
        deformation_of_macro(system, e, positions, f);
        for (int m = 0; m < 9; m++)
            rotations->before[e / LANES][m][e % LANES] = (float)(system->macros->shear[e] * f[m]);
    }
}

static void multiply_macros(const pliant_system *system, const double *positions, pliant_nodal_rotations *rotations)
{
#pragma omp parallel for schedule(static) num_threads(system->num_threads)
    for (int32_t e = 0; e < system->macros->count; e++) {
        double f[9];
        float(*before)[LANES] = rotations->before[e / LANES], *product = rotations->product[e / LANES][e % LANES];
        deformation_of_macro(system, e, positions, f);
        for (int r = 0; r < 3; r++)
            for (int c = 0; c < 3; c++)
                product[3 * r + c] =
                    (float)(f[3 * r] * before[3 * c][e % LANES] + f[3 * r + 1] * before[3 * c + 1][e % LANES] +
                            f[3 * r + 2] * before[3 * c + 2][e % LANES]);
    }
}

void pliant_nodal_rotations_refer(const pliant_system *system, const double *positions,
                                  pliant_nodal_rotations *rotations)
{
    if (!rotations) return;
    if (system->macros) {
        keep_macros_before(system, positions, rotations);
    } else {
#pragma omp parallel for schedule(static) num_threads(system->num_threads)
        for (int32_t block = 0; block < system->num_blocks; block++)
            keep_before(system, block, positions, rotations->before[block]);
    }
    rotations->is_rotated = false;
}

PLIANT_VECTORIZED static void rotations_of(double sum[9][LANES], double out[9][LANES]) { pliant_rotations(sum, out); }

/* Sum the contributions of the elements at a block of nodes, and I at the padding. */
static void sum_elements(const pliant_system *system, const pliant_nodal_rotations *rotations, int32_t first,
                         double sum[9][LANES])
{
    memset(sum, 0, 9 * sizeof *sum);
    for (int l = 0; l < LANES; l++) {
        int32_t n = first + l;
        if (n >= system->num_free) {
            for (int m = 0; m < 9; m += 4) sum[m][l] = 1;
            continue;
        }
        for (int32_t c = system->corner_start[n]; c < system->corner_end[n]; c++) {
            int32_t element =
                system->macros ? system->macros->cube_of_corner[system->corner[c]] : system->corner[c] / 4;
            for (int m = 0; m < 9; m++) sum[m][l] += rotations->product[element / LANES][element % LANES][m];
        }
    }
}

static void store(const pliant_system *system, int32_t first, double values[9][LANES],
                  pliant_nodal_rotations *rotations)
{
    for (int l = 0; l < LANES && first + l < system->num_free; l++)
        for (int m = 0; m < 9; m++) rotations->rotation[9 * (size_t)(first + l) + (size_t)m] = values[m][l];
}

/* Replace the contribution of every element with the sums at its nodes, so that axes hardly differ across a thin
 * element (../linear/NUMERICS.md). */
static void smooth(const pliant_system *system, pliant_nodal_rotations *rotations)
{
#pragma omp parallel for schedule(static) num_threads(system->num_threads)
    for (int32_t first = 0; first < system->num_free; first += LANES) {
        double sum[9][LANES];
        sum_elements(system, rotations, first, sum);
        store(system, first, sum, rotations);
    }
#pragma omp parallel for schedule(static) num_threads(system->num_threads)
    for (int32_t t = 0; t < system->mesh->num_tets; t++) {
        double sum[9] = {0};
        for (int v = 0; v < 4; v++) {
            const int32_t f = system->free_of_node[system->mesh->tets[4 * (size_t)t + (size_t)v]];
            for (int m = 0; m < 9 && f >= 0; m++) sum[m] += rotations->rotation[9 * (size_t)f + (size_t)m];
        }
        for (int m = 0; m < 9; m++) rotations->product[t / LANES][t % LANES][m] = (float)sum[m];
    }
}

void pliant_nodal_rotations_update(const pliant_system *system, const double *positions,
                                   pliant_nodal_rotations *rotations)
{
    if (!rotations) return;
    if (system->macros) {
        multiply_macros(system, positions, rotations);
    } else {
#pragma omp parallel for schedule(static) num_threads(system->num_threads)
        for (int32_t block = 0; block < system->num_blocks; block++)
            multiply(system, block, positions, rotations->before[block], rotations->product[block]);
    }
    if (system->is_subdivided) smooth(system, rotations);
#pragma omp parallel for schedule(static) num_threads(system->num_threads)
    for (int32_t first = 0; first < system->num_free; first += LANES) {
        double sum[9][LANES], out[9][LANES];
        sum_elements(system, rotations, first, sum);
        rotations_of(sum, out);
        store(system, first, out, rotations);
    }
    rotations->is_rotated = true;
}
