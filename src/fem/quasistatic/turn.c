#include "fem/quasistatic/turn.h"

#include "base/fail.h"
#include "fem/element/deformation.h"
#include "fem/element/rotation.h"
#include "pliant/memory.h"

#include <string.h>

pliant_status pliant_turn_create(const pliant_system *system, pliant_turn **out)
{
    *out = NULL;
    if (system->stiffness || system->macros || system->basis) return PLIANT_OK;
    pliant_turn *turn = pliant_calloc(1, sizeof *turn);
    if (turn) {
        turn->rotation = pliant_calloc((size_t)system->num_free, 9 * sizeof *turn->rotation);
        turn->before = pliant_calloc((size_t)system->num_blocks, sizeof *turn->before);
        turn->product = pliant_calloc((size_t)system->num_blocks, sizeof *turn->product);
    }
    if (!turn || !turn->rotation || !turn->before || !turn->product) {
        pliant_turn_free(turn);
        return pliant_fail_memory("the solver's axes");
    }
    *out = turn;
    return PLIANT_OK;
}

void pliant_turn_free(pliant_turn *turn)
{
    if (!turn) return;
    pliant_free(turn->rotation);
    pliant_free(turn->before);
    pliant_free(turn->product);
    pliant_free(turn);
}

/* F of a block of elements. What keeps R = I counts as not turned: I. */
static inline __attribute__((always_inline)) void deformations(const pliant_system *system, int32_t block, const double *positions, double f[9][LANES])
{
    double x[12][LANES];
    load_corners(system, positions, block, x);
    deformation_of(x, system->gradients[block], f);
    const uint8_t *grounded = grounded_of(system, block);
    if (grounded) ground(grounded, f);
}

PLIANT_VECTORIZED static void keep_before(const pliant_system *system, int32_t block, const double *positions, float before[9][LANES])
{
    double f[9][LANES];
    deformations(system, block, positions, f);
    for (int m = 0; m < 9; m++)
        for (int l = 0; l < LANES; l++) before[m][l] = (float)(system->lame[block][1][l] * f[m][l]);
}

/* For F = Q F0 the rotation of F F0' is Q, whatever the stretch F0 was. */
PLIANT_VECTORIZED static void multiply(const pliant_system *system, int32_t block, const double *positions, float before[9][LANES],
                                       float product[LANES][9])
{
    double f[9][LANES];
    deformations(system, block, positions, f);
    for (int r = 0; r < 3; r++)
        for (int c = 0; c < 3; c++)
            for (int l = 0; l < LANES; l++)
                product[l][3 * r + c] = (float)(f[3 * r][l] * before[3 * c][l] + f[3 * r + 1][l] * before[3 * c + 1][l] +
                                                f[3 * r + 2][l] * before[3 * c + 2][l]);
}

void pliant_turn_from(const pliant_system *system, const double *positions, pliant_turn *turn)
{
    if (!turn) return;
#pragma omp parallel for schedule(static) num_threads(system->num_threads)
    for (int32_t block = 0; block < system->num_blocks; block++) keep_before(system, block, positions, turn->before[block]);
    turn->turned = false;
}

PLIANT_VECTORIZED static void rotations(double sum[9][LANES], double out[9][LANES]) { pliant_rotations(sum, out); }

void pliant_turn_to(const pliant_system *system, const double *positions, pliant_turn *turn)
{
    if (!turn) return;
#pragma omp parallel for schedule(static) num_threads(system->num_threads)
    for (int32_t block = 0; block < system->num_blocks; block++)
        multiply(system, block, positions, turn->before[block], turn->product[block]);
#pragma omp parallel for schedule(static) num_threads(system->num_threads)
    for (int32_t first = 0; first < system->num_free; first += LANES) {
        double sum[9][LANES], out[9][LANES];
        memset(sum, 0, sizeof sum);
        for (int l = 0; l < LANES; l++) {
            int32_t n = first + l;
            if (n >= system->num_free) {
                for (int m = 0; m < 9; m += 4) sum[m][l] = 1;
                continue;
            }
            for (int32_t c = system->corner_start[n]; c < system->corner_start[n + 1]; c++) {
                int32_t element = system->corner[c] / 4;
                for (int m = 0; m < 9; m++) sum[m][l] += turn->product[element / LANES][element % LANES][m];
            }
        }
        rotations(sum, out);
        for (int l = 0; l < LANES && first + l < system->num_free; l++)
            for (int m = 0; m < 9; m++) turn->rotation[9 * (size_t)(first + l) + (size_t)m] = out[m][l];
    }
    turn->turned = true;
}
