#include "fem/turn.h"

#include "core/fail.h"
#include "pliant/memory.h"

#include <string.h>

pliant_status pliant_turn_create(const pliant_system *system, pliant_turn **out)
{
    *out = NULL;
    if (system->stiffness || system->macros || system->space) return PLIANT_OK;
    pliant_turn *turn = pliant_calloc(1, sizeof *turn);
    if (turn) {
        turn->rotation = pliant_calloc((size_t)system->num_free, 9 * sizeof *turn->rotation);
        turn->reference = pliant_calloc((size_t)system->mesh->num_nodes, 3 * sizeof *turn->reference);
    }
    if (!turn || !turn->rotation || !turn->reference) {
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
    pliant_free(turn->reference);
    pliant_free(turn);
}

void pliant_turn_from(const pliant_system *system, const double *positions, pliant_turn *turn)
{
    if (!turn) return;
    memcpy(turn->reference, positions, 3 * (size_t)system->mesh->num_nodes * sizeof *positions);
    turn->turned = false;
}

/* V mu F F0' of each element, F0 at the reference: for F = Q F0 the rotation of this is Q, whatever the stretch F0 was. What
 * keeps R = I counts as not turned. */
PLIANT_VECTORIZED static void element_turns(const pliant_system *system, int32_t block, const double *reference, const double *now,
                                            double out[12][LANES])
{
    double (*g)[LANES] = system->gradients[block], f[2][9][LANES];
    for (int state = 0; state < 2; state++) {
        const double *positions = state ? now : reference;
        double x[12][LANES];
        for (int l = 0; l < LANES; l++) {
            int32_t tet = block * LANES + l < system->mesh->num_tets ? block * LANES + l : system->mesh->num_tets - 1;
            const int32_t *nodes = system->mesh->tets + 4 * (size_t)tet;
            for (int v = 0; v < 4; v++)
                for (int d = 0; d < 3; d++) x[3 * v + d][l] = positions[3 * nodes[v] + d] - positions[3 * nodes[0] + d];
        }
        for (int r = 0; r < 3; r++)
            for (int c = 0; c < 3; c++)
                for (int l = 0; l < LANES; l++)
                    f[state][3 * r + c][l] = x[3 + r][l] * g[3 + c][l] + x[6 + r][l] * g[6 + c][l] + x[9 + r][l] * g[9 + c][l];
    }
    const uint8_t *grounded = system->grounded ? system->grounded + LANES * (size_t)block : NULL;
    for (int r = 0; r < 3; r++)
        for (int c = 0; c < 3; c++)
            for (int l = 0; l < LANES; l++) {
                double product = f[1][3 * r][l] * f[0][3 * c][l] + f[1][3 * r + 1][l] * f[0][3 * c + 1][l] +
                                 f[1][3 * r + 2][l] * f[0][3 * c + 2][l];
                out[3 * r + c][l] = system->lame[block][1][l] * (grounded && grounded[l] ? r == c : product);
            }
}

PLIANT_VECTORIZED static void rotations(double sum[9][LANES], double out[9][LANES]) { pliant_rotations(sum, out); }

void pliant_turn_to(const pliant_system *system, const double *positions, double (*room)[12][LANES], pliant_turn *turn)
{
    if (!turn) return;
#pragma omp parallel for schedule(static) num_threads(system->num_threads)
    for (int32_t block = 0; block < system->num_blocks; block++)
        element_turns(system, block, turn->reference, positions, room[block]);
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
                for (int m = 0; m < 9; m++) sum[m][l] += room[element / LANES][m][element % LANES];
            }
        }
        rotations(sum, out);
        for (int l = 0; l < LANES && first + l < system->num_free; l++)
            for (int m = 0; m < 9; m++) turn->rotation[9 * (size_t)(first + l) + (size_t)m] = out[m][l];
    }
    turn->turned = true;
}
