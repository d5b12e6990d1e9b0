/* Forces of the elements ([C] 5, 6, 10, 11), LANES at a time. [C] 6, F = integral of B_L' S dV with B_L = B_L0 X', is for constant strain
 * the same as V P g_v with P = X S, which costs less. */
#include "fem/tled.h"

#define INLINE static inline __attribute__((always_inline))

/* H = sum over corners 1 to 3 of (u_v - u_0) g_v'. The differences are taken in double: single precision would lose a displacement of
 * centimetres to 1e-9 m, a pressure of 0.1 Pa in nearly incompressible tissue. */
INLINE void load_gradient(const double *u, int32_t nodes[4][LANES], float g[9][LANES], float h[9][LANES])
{
    float apart[9][LANES];
    for (int l = 0; l < LANES; l++) {
        const double *first = u + 3 * (size_t)nodes[0][l];
        for (int v = 0; v < 3; v++) {
            const double *at = u + 3 * (size_t)nodes[v + 1][l];
            for (int d = 0; d < 3; d++) apart[3 * v + d][l] = (float)(at[d] - first[d]);
        }
    }
    for (int r = 0; r < 3; r++)
        for (int c = 0; c < 3; c++)
            for (int l = 0; l < LANES; l++)
                h[3 * r + c][l] = apart[r][l] * g[c][l] + apart[3 + r][l] * g[3 + c][l] + apart[6 + r][l] * g[6 + c][l];
}

/* one lane: cofactors of H, and J - 1 without the loss of digits of det F - 1 */
INLINE float change_of(const float h[9], float cofactor[9])
{
    cofactor[0] = h[4] * h[8] - h[5] * h[7];
    cofactor[1] = h[5] * h[6] - h[3] * h[8];
    cofactor[2] = h[3] * h[7] - h[4] * h[6];
    cofactor[3] = h[2] * h[7] - h[1] * h[8];
    cofactor[4] = h[0] * h[8] - h[2] * h[6];
    cofactor[5] = h[1] * h[6] - h[0] * h[7];
    cofactor[6] = h[1] * h[5] - h[2] * h[4];
    cofactor[7] = h[2] * h[3] - h[0] * h[5];
    cofactor[8] = h[0] * h[4] - h[1] * h[3];
    float third = h[0] * cofactor[0] + h[1] * cofactor[1] + h[2] * cofactor[2];
    return h[0] + h[4] + h[8] + (cofactor[0] + cofactor[4] + cofactor[8]) + third;
}

/* shear part of the stress in p and the volume part's factor of cof F; cof F in cofactor. One lane, rest volume included. */
INLINE float neo_hookean_stress(pliant_law law, const float h[9], float mu, float modulus, float cofactor[9], float p[9])
{
    float squares = 0, trace = h[0] + h[4] + h[8], change = change_of(h, cofactor), a, shear;
    for (int m = 0; m < 9; m++) squares += h[m] * h[m];
    pliant_law_float_terms(law, mu, 2 * trace + squares, change, &a, &shear);
    for (int r = 0; r < 3; r++)
        for (int c = 0; c < 3; c++) {
            /* F - cof F = H + H' - tr(H) I - cof H, and cof F = (1 + tr H) I - H' + cof H */
            float transposed = h[3 * c + r], one = r == c ? trace : 0, of_h = cofactor[3 * r + c];
            cofactor[3 * r + c] = (r == c) + one - transposed + of_h;
            p[3 * r + c] = a * (h[3 * r + c] + transposed - one - of_h) + shear * cofactor[3 * r + c];
        }
    return modulus * pliant_law_float_volume(law, change);
}

INLINE void saint_venant_kirchhoff_stress(const float h[9], float mu, float lambda, float p[9], float volume[9])
{
    float e[9];
    for (int r = 0; r < 3; r++)
        for (int c = 0; c < 3; c++)
            e[3 * r + c] = h[3 * r + c] + h[3 * c + r] + h[r] * h[c] + h[3 + r] * h[3 + c] + h[6 + r] * h[6 + c]; /* twice E */
    float trace = 0.5f * lambda * (e[0] + e[4] + e[8]);
    for (int r = 0; r < 3; r++)
        for (int c = 0; c < 3; c++) {
            p[3 * r + c] = mu * (e[3 * r + c] + h[3 * r] * e[c] + h[3 * r + 1] * e[3 + c] + h[3 * r + 2] * e[6 + c]);
            volume[3 * r + c] = trace * ((r == c) + h[3 * r + c]);
        }
}

/* Prony series, implicit in time (Taylor et al. 2009): what has relaxed, Y_i, goes towards its share of the instantaneous stress,
 * Y_i+ = (tau_i Y_i + dt share_i S) / (tau_i + dt), and S - sum of Y_i is felt. S: of the shear part, back at rest: S = F^-1 P. */
INLINE void relax_block(const pliant_tled_system *system, float dt, float h[9][LANES], float cofactor[9][LANES], float p[9][LANES],
                        float memory[6 * PLIANT_PRONY_TERMS][LANES])
{
    static const int row[6] = {0, 1, 2, 0, 0, 1}, column[6] = {0, 1, 2, 1, 2, 2}, place[9] = {0, 3, 4, 3, 1, 5, 4, 5, 2};
    float overstress[6][LANES] = {{0}};
    for (int m = 0; m < 6; m++)
        for (int l = 0; l < LANES; l++) {
            int r = row[m], c = column[m];
            float ratio = (1 + h[0][l]) * cofactor[0][l] + h[1][l] * cofactor[1][l] + h[2][l] * cofactor[2][l];
            float sum = cofactor[r][l] * p[c][l] + cofactor[3 + r][l] * p[3 + c][l] + cofactor[6 + r][l] * p[6 + c][l];
            overstress[m][l] = sum * pliant_law_float_reciprocal(ratio);
        }
    float relaxed[6][LANES] = {{0}};
    for (int term = 0; term < system->num_prony; term++) {
        float tau = (float)system->prony_time[term], part = dt / (tau + dt), share = (float)system->prony_share[term];
        for (int m = 0; m < 6; m++)
            for (int l = 0; l < LANES; l++) {
                float *y = &memory[6 * term + m][l];
                *y += part * (share * overstress[m][l] - *y);
                relaxed[m][l] += *y;
            }
    }
    for (int r = 0; r < 3; r++)
        for (int c = 0; c < 3; c++)
            for (int l = 0; l < LANES; l++) {
                float sum = relaxed[place[3 * r + c]][l];
                for (int k = 0; k < 3; k++) sum += h[3 * r + k][l] * relaxed[place[3 * k + c]][l];
                p[3 * r + c][l] -= sum;
            }
}

INLINE void block_forces(const pliant_tled *tled, pliant_law law, bool viscous, bool nodal, int32_t block, float dt, float *out)
{
    const pliant_tled_system *system = tled->system;
    float (*g)[LANES] = system->gradients[block], (*moduli)[LANES] = system->moduli[block];
    int32_t (*nodes)[LANES] = system->nodes[block];
    float h[9][LANES], p[9][LANES], cofactor[9][LANES], volume[9][LANES], pressure[LANES];
    load_gradient(tled->u, nodes, g, h);
    if (nodal)
        for (int l = 0; l < LANES; l++) {
            const float *at = tled->pressure;
            pressure[l] = 0.25f * moduli[2][l] * (at[nodes[0][l]] + at[nodes[1][l]] + at[nodes[2][l]] + at[nodes[3][l]]);
        }
    for (int l = 0; l < LANES; l++) {
        float one[9], stress[9], other[9];
        for (int m = 0; m < 9; m++) one[m] = h[m][l];
        if (law == PLIANT_LAW_SAINT_VENANT_KIRCHHOFF) {
            saint_venant_kirchhoff_stress(one, moduli[0][l], moduli[1][l], stress, other);
            for (int m = 0; m < 9; m++) volume[m][l] = other[m];
            if (viscous) change_of(one, other);
            for (int r = 0; viscous && r < 3; r++)
                for (int c = 0; c < 3; c++)
                    cofactor[3 * r + c][l] = (r == c) * (1 + one[0] + one[4] + one[8]) - one[3 * c + r] + other[3 * r + c];
        } else {
            float factor = neo_hookean_stress(law, one, moduli[0][l], moduli[1][l], other, stress);
            if (nodal) factor = pressure[l];
            for (int m = 0; m < 9; m++) {
                cofactor[m][l] = other[m];
                volume[m][l] = factor * other[m];
            }
        }
        for (int m = 0; m < 9; m++) p[m][l] = stress[m];
    }
    if (viscous) relax_block(system, dt, h, cofactor, p, tled->memory[block]);
    for (int r = 0; r < 3; r++)
        for (int l = 0; l < LANES; l++) {
            float x = p[3 * r][l] + volume[3 * r][l], y = p[3 * r + 1][l] + volume[3 * r + 1][l], z = p[3 * r + 2][l] + volume[3 * r + 2][l];
            float first = x * g[0][l] + y * g[1][l] + z * g[2][l], second = x * g[3][l] + y * g[4][l] + z * g[5][l];
            float third = x * g[6][l] + y * g[7][l] + z * g[8][l];
            out[r * LANES + l] = -(first + second + third);
            out[(3 + r) * LANES + l] = first;
            out[(6 + r) * LANES + l] = second;
            out[(9 + r) * LANES + l] = third;
        }
}

/* One function a choice, so that the compiler makes straight vector code of each. */
#define DEFINE_FORCES(name, law, viscous, nodal)                                                                       \
    PLIANT_VECTORIZED static void name(const pliant_tled *tled, int32_t block, float dt, float *out)                  \
    {                                                                                                                  \
        block_forces(tled, law, viscous, nodal, block, dt, out);                                                       \
    }
DEFINE_FORCES(neo_hookean, PLIANT_LAW_NEO_HOOKEAN, false, false)
DEFINE_FORCES(neo_hookean_viscous, PLIANT_LAW_NEO_HOOKEAN, true, false)
DEFINE_FORCES(neo_hookean_nodal, PLIANT_LAW_NEO_HOOKEAN, false, true)
DEFINE_FORCES(neo_hookean_viscous_nodal, PLIANT_LAW_NEO_HOOKEAN, true, true)
DEFINE_FORCES(compressible, PLIANT_LAW_COMPRESSIBLE, false, false)
DEFINE_FORCES(compressible_viscous, PLIANT_LAW_COMPRESSIBLE, true, false)
DEFINE_FORCES(compressible_nodal, PLIANT_LAW_COMPRESSIBLE, false, true)
DEFINE_FORCES(compressible_viscous_nodal, PLIANT_LAW_COMPRESSIBLE, true, true)
DEFINE_FORCES(saint_venant_kirchhoff, PLIANT_LAW_SAINT_VENANT_KIRCHHOFF, false, false)
DEFINE_FORCES(saint_venant_kirchhoff_viscous, PLIANT_LAW_SAINT_VENANT_KIRCHHOFF, true, false)

typedef void (*forces_function)(const pliant_tled *, int32_t, float, float *);

static forces_function forces_of(const pliant_tled_system *system)
{
    static const forces_function table[3][2][2] = {
        {{neo_hookean, neo_hookean_nodal}, {neo_hookean_viscous, neo_hookean_viscous_nodal}},
        {{compressible, compressible_nodal}, {compressible_viscous, compressible_viscous_nodal}},
        {{saint_venant_kirchhoff, NULL}, {saint_venant_kirchhoff_viscous, NULL}},
    };
    return table[system->law][system->num_prony > 0][system->nodal_pressure];
}

void pliant_tled_element_forces(pliant_tled *tled, double time_step)
{
    const forces_function forces = forces_of(tled->system);
#pragma omp for schedule(static)
    for (int32_t block = 0; block < tled->system->num_blocks; block++)
        forces(tled, block, (float)time_step, tled->forces + (size_t)block * 12 * LANES);
}

PLIANT_VECTORIZED static void block_change(const pliant_tled *tled, int32_t block)
{
    const pliant_tled_system *system = tled->system;
    float h[9][LANES];
    load_gradient(tled->u, system->nodes[block], system->gradients[block], h);
    for (int l = 0; l < LANES; l++) {
        float one[9], cofactor[9];
        for (int m = 0; m < 9; m++) one[m] = h[m][l];
        tled->change[block][l] = system->moduli[block][2][l] * change_of(one, cofactor);
    }
}

/* Average nodal pressure (Bonet and Burton 1998, in the form that keeps an energy): a node's change of volume is the mean of those around
 * it, p = modulus f(J), and an element feels the mean of its nodes' pressures. */
void pliant_tled_pressures(pliant_tled *tled)
{
    const pliant_tled_system *system = tled->system;
#pragma omp for schedule(static)
    for (int32_t block = 0; block < system->num_blocks; block++) block_change(tled, block);
#pragma omp for schedule(static)
    for (int32_t n = 0; n < system->mesh->num_nodes; n++) {
        double sum = 0;
        for (int32_t c = system->corner_start[n]; c < system->corner_start[n + 1]; c++) {
            int32_t place = system->corner[c];
            sum += tled->change[place / (12 * LANES)][place % LANES];
        }
        float change = (float)(0.25 * sum) * system->node_volume[n];
        tled->pressure[n] = system->node_modulus[n] * pliant_law_float_volume(system->law, change);
    }
}
