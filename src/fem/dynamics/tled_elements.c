/* Forces of the elements ([C] 5, 6, 10, 11), LANES at a time. For constant strain, [C] 6, F = integral of B_L' S dV
 * with B_L = B_L0 X', equals V P g_v with P = X S, which needs fewer operations. */
#include "fem/element/stress.h"
#include "fem/dynamics/tled_cubes.h"

/* Compute H = sum over corners 1 to 3 of (u_v - u_0) g_v'. The differences are in double precision. Single precision
 * would round a displacement of centimetres to 1e-9 m, a pressure of 0.1 Pa in nearly incompressible tissue. */
PLIANT_INLINE void load_gradient(const double *u, int32_t nodes[4][LANES], float g[9][LANES], float h[9][LANES])
{
    float difference[9][LANES];
    for (int l = 0; l < LANES; l++) {
        const double *first = u + 3 * (size_t)nodes[0][l];
        for (int v = 0; v < 3; v++) {
            const double *at = u + 3 * (size_t)nodes[v + 1][l];
            for (int d = 0; d < 3; d++) difference[3 * v + d][l] = (float)(at[d] - first[d]);
        }
    }
    for (int r = 0; r < 3; r++)
        for (int c = 0; c < 3; c++)
            for (int l = 0; l < LANES; l++)
                h[3 * r + c][l] = difference[r][l] * g[c][l] + difference[3 + r][l] * g[3 + c][l] +
                                  difference[6 + r][l] * g[6 + c][l];
}

/* Relax a block by the Prony series and update each term's memory. */
PLIANT_INLINE void relax_block(const pliant_tled_system *system, float dt, float h[9][LANES], float cofactor[9][LANES],
                               float p[9][LANES], float memory[6 * PLIANT_PRONY_TERMS][LANES])
{
    float stress[6][LANES], relaxed[6][LANES] = {{0}};
    for (int l = 0; l < LANES; l++) {
        float one[9], of_one[9], p_one[9], s[6];
        for (int m = 0; m < 9; m++) one[m] = h[m][l], of_one[m] = cofactor[m][l], p_one[m] = p[m][l];
        pliant_stress_at_rest(one, of_one, p_one, s);
        for (int m = 0; m < 6; m++) stress[m][l] = s[m];
    }
    for (int term = 0; term < system->num_prony; term++) {
        float part = pliant_prony_relaxed_fraction(dt, (float)system->prony_time[term]),
              fraction = (float)system->prony_share[term];
        for (int m = 0; m < 6; m++)
            for (int l = 0; l < LANES; l++) {
                float *y = &memory[6 * term + m][l];
                *y += part * (fraction * stress[m][l] - *y);
                relaxed[m][l] += *y;
            }
    }
    for (int l = 0; l < LANES; l++) {
        float one[9], p_one[9], s[6];
        for (int m = 0; m < 9; m++) one[m] = h[m][l], p_one[m] = p[m][l];
        for (int m = 0; m < 6; m++) s[m] = relaxed[m][l];
        pliant_subtract_relaxed(one, s, p_one);
        for (int m = 0; m < 9; m++) p[m][l] = p_one[m];
    }
}

PLIANT_INLINE void damp_block(float change[9][LANES], const float *mu, float factor, float h[9][LANES],
                              float p[9][LANES])
{
    for (int l = 0; l < LANES; l++) {
        float one[9], of_one[9], p_one[9];
        for (int m = 0; m < 9; m++) one[m] = h[m][l], of_one[m] = change[m][l], p_one[m] = p[m][l];
        pliant_add_viscous(one, of_one, mu[l], factor, p_one);
        for (int m = 0; m < 9; m++) p[m][l] = p_one[m];
    }
}

/* Compute rest volume times first Piola-Kirchhoff stress of a block from H and, with damping, from its change.
 * pressure: NULL if it follows from H. */
PLIANT_INLINE void block_stress(const pliant_tled_system *system, pliant_law law, bool viscous, bool damped, float dt,
                                float h[9][LANES], float change[9][LANES], float moduli[3][LANES],
                                const float *pressure, float (*memory)[LANES], float out[9][LANES])
{
    float p[9][LANES], cofactor[9][LANES], volume[9][LANES];
    for (int l = 0; l < LANES; l++) {
        float one[9], stress[9], other[9];
        for (int m = 0; m < 9; m++) one[m] = h[m][l];
        if (law == PLIANT_LAW_SAINT_VENANT_KIRCHHOFF) {
            pliant_saint_venant_kirchhoff_stress(one, moduli[0][l], moduli[1][l], stress, other);
            for (int m = 0; m < 9; m++) volume[m][l] = other[m];
            if (viscous) pliant_change_of(one, other);
            for (int r = 0; viscous && r < 3; r++)
                for (int c = 0; c < 3; c++)
                    cofactor[3 * r + c][l] =
                        (r == c) * (1 + one[0] + one[4] + one[8]) - one[3 * c + r] + other[3 * r + c];
        } else {
            float factor = pliant_neo_hookean_stress(law, one, moduli[0][l], moduli[1][l], other, stress);
            if (pressure) factor = pressure[l];
            for (int m = 0; m < 9; m++) {
                cofactor[m][l] = other[m];
                volume[m][l] = factor * other[m];
            }
        }
        for (int m = 0; m < 9; m++) p[m][l] = stress[m];
    }
    if (viscous) relax_block(system, dt, h, cofactor, p, memory);
    if (damped) damp_block(change, moduli[0], (float)system->stiffness_damping / dt, h, p);
    for (int l = 0; l < LANES; l++)
        for (int m = 0; m < 9; m++) out[m][l] = p[m][l] + volume[m][l];
}

PLIANT_INLINE void block_forces(const pliant_tled *tled, pliant_law law, bool viscous, bool nodal, bool damped,
                                int32_t block, float dt, float *out)
{
    const pliant_tled_system *system = tled->system;
    float (*g)[LANES] = system->gradients[block], (*moduli)[LANES] = system->moduli[block];
    int32_t (*nodes)[LANES] = system->nodes[block];
    float h[9][LANES], change[9][LANES], p[9][LANES], pressure[LANES];
    load_gradient(tled->u, nodes, g, h);
    if (damped) load_gradient(tled->d, nodes, g, change);
    if (nodal)
        for (int l = 0; l < LANES; l++) {
            const float *at = tled->pressure;
            pressure[l] =
                0.25f * moduli[2][l] * (at[nodes[0][l]] + at[nodes[1][l]] + at[nodes[2][l]] + at[nodes[3][l]]);
        }
    block_stress(system, law, viscous, damped, dt, h, change, moduli, nodal ? pressure : NULL,
                 viscous ? tled->memory[block] : NULL, p);
    for (int r = 0; r < 3; r++)
        for (int l = 0; l < LANES; l++) {
            float x = p[3 * r][l], y = p[3 * r + 1][l], z = p[3 * r + 2][l];
            float first = x * g[0][l] + y * g[1][l] + z * g[2][l], second = x * g[3][l] + y * g[4][l] + z * g[5][l];
            float third = x * g[6][l] + y * g[7][l] + z * g[8][l];
            out[r * LANES + l] = -(first + second + third);
            out[(3 + r) * LANES + l] = first;
            out[(6 + r) * LANES + l] = second;
            out[(9 + r) * LANES + l] = third;
        }
}

/* Transform corners to modes, w_m = sum of +-1 v_a, and back, v_a = sum of +-1 w_m (tled_cubes.h), in three passes of
 * sums and differences. */
PLIANT_INLINE void transform(float w[8][LANES], float sign)
{
    for (int bit = 1; bit < 8; bit *= 2)
        for (int i = 0; i < 8; i++) {
            if (i & bit) continue;
            for (int l = 0; l < LANES; l++) {
                float low = w[i][l], high = w[i | bit][l];
                w[i][l] = sign > 0 ? low + high : low - high;
                w[i | bit][l] = sign > 0 ? high - low : low + high;
            }
        }
}

/* Load the modes of a block of cubes, their mean gradient H or its change, and its change of volume. */
PLIANT_INLINE void load_modes(const pliant_tled_cubes *cubes, const double *u, int32_t block, float w[3][8][LANES],
                              float h[9][LANES], float change[LANES])
{
    int32_t (*nodes)[LANES] = cubes->nodes[block];
    double exact[9][LANES];
    for (int l = 0; l < LANES; l++) {
        const double *first = u + 3 * (size_t)nodes[0][l], finer = (double)cubes->finer[block][l];
        for (int r = 0; r < 3; r++) {
            double difference[8], along[3];
            for (int v = 0; v < 8; v++) {
                difference[v] = u[3 * (size_t)nodes[v][l] + (size_t)r] - first[r];
                w[r][v][l] = (float)difference[v];
            }
            pliant_cube_differences(difference, along);
            for (int c = 0; c < 3; c++)
                exact[3 * r + c][l] =
                    finer * (along[0] * (double)cubes->gradient[c] + along[1] * (double)cubes->gradient[3 + c] +
                             along[2] * (double)cubes->gradient[6 + c]);
        }
    }
    for (int r = 0; r < 3; r++) transform(w[r], 1);
    for (int l = 0; l < LANES; l++) {
        double one[9];
        for (int m = 0; m < 9; m++) h[m][l] = (float)(one[m] = exact[m][l]);
        change[l] = (float)pliant_exact_change_of(one);
    }
}

/* Compute the forces of the modes of a block of cubes. more: their change, if it is damped. */
PLIANT_INLINE void bend_block(const pliant_tled_cubes *cubes, bool damped, float factor, int32_t block,
                              float w[3][8][LANES], float more[3][8][LANES], float out[3][8][LANES])
{
    float (*moduli)[LANES] = cubes->moduli[block];
    for (int l = 0; l < LANES; l++) {
        const float finer = cubes->finer[block][l], shear = moduli[0][l] * (finer * finer);
        pliant_cube_modes modes, change, force;
        for (int m = 0; m < 9; m++) {
            modes.along[m] = w[m % 3][1 << m / 3][l];
            modes.across[m] = w[m % 3][7 ^ 1 << m / 3][l];
            if (damped) change.along[m] = more[m % 3][1 << m / 3][l];
            if (damped) change.across[m] = more[m % 3][7 ^ 1 << m / 3][l];
        }
        pliant_cube_bend(&cubes->bending, finer, shear, moduli[2][l], &modes, damped ? &change : NULL, factor, &force);
        for (int m = 0; m < 9; m++) {
            out[m % 3][1 << m / 3][l] = force.along[m];
            out[m % 3][7 ^ 1 << m / 3][l] = force.across[m];
        }
        for (int r = 0; r < 3; r++) {
            out[r][0][l] = 0;
            out[r][7][l] = shear * cubes->bending.twist * (w[r][7][l] + (damped ? factor * more[r][7][l] : 0));
        }
    }
}

PLIANT_INLINE void cube_forces(const pliant_tled *tled, pliant_law law, bool viscous, bool damped, int32_t block,
                               float dt, float *out)
{
    const pliant_tled_system *system = tled->system;
    const pliant_tled_cubes *cubes = system->cubes;
    const float *finer = cubes->finer[block];
    float (*moduli)[LANES] = cubes->moduli[block], w[3][8][LANES], more[3][8][LANES], force[3][8][LANES];
    float h[9][LANES], change[9][LANES], p[9][LANES], pressure[LANES], other[LANES];
    load_modes(cubes, tled->u, block, w, h, pressure);
    for (int l = 0; l < LANES; l++) pressure[l] = moduli[1][l] * pliant_law_float_volume(law, pressure[l]);
    if (damped) load_modes(cubes, tled->d, block, more, change, other);
    bend_block(cubes, damped, damped ? (float)system->stiffness_damping / dt : 0, block, w, more, force);
    block_stress(system, law, viscous, damped, dt, h, change, moduli, pressure,
                 viscous ? tled->memory[system->num_blocks + block] : NULL, p);
    for (int r = 0; r < 3; r++) {
        for (int axis = 0; axis < 3; axis++)
            for (int l = 0; l < LANES; l++)
                force[r][1 << axis][l] += finer[l] * (p[3 * r][l] * cubes->gradient[3 * axis] +
                                                      p[3 * r + 1][l] * cubes->gradient[3 * axis + 1] +
                                                      p[3 * r + 2][l] * cubes->gradient[3 * axis + 2]);
        transform(force[r], -1);
        for (int v = 0; v < 8; v++)
            for (int l = 0; l < LANES; l++) out[(3 * v + r) * LANES + l] = force[r][v][l];
    }
}

/* A separate function for each combination lets the compiler vectorize without branches. */
#define DEFINE_FORCES(name, law, viscous, nodal)                                                                       \
    PLIANT_VECTORIZED static void name(const pliant_tled *tled, int32_t block, float dt, float *out)                  \
    {                                                                                                                  \
        if (tled->system->stiffness_damping > 0) block_forces(tled, law, viscous, nodal, true, block, dt, out);        \
        else block_forces(tled, law, viscous, nodal, false, block, dt, out);                                           \
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

#define DEFINE_CUBE_FORCES(name, law, viscous)                                                                         \
    PLIANT_VECTORIZED static void name(const pliant_tled *tled, int32_t block, float dt, float *out)                  \
    {                                                                                                                  \
        if (tled->system->stiffness_damping > 0) cube_forces(tled, law, viscous, true, block, dt, out);                \
        else cube_forces(tled, law, viscous, false, block, dt, out);                                                   \
    }
DEFINE_CUBE_FORCES(neo_hookean_cubes, PLIANT_LAW_NEO_HOOKEAN, false)
DEFINE_CUBE_FORCES(neo_hookean_viscous_cubes, PLIANT_LAW_NEO_HOOKEAN, true)
DEFINE_CUBE_FORCES(compressible_cubes, PLIANT_LAW_COMPRESSIBLE, false)
DEFINE_CUBE_FORCES(compressible_viscous_cubes, PLIANT_LAW_COMPRESSIBLE, true)
DEFINE_CUBE_FORCES(saint_venant_kirchhoff_cubes, PLIANT_LAW_SAINT_VENANT_KIRCHHOFF, false)
DEFINE_CUBE_FORCES(saint_venant_kirchhoff_viscous_cubes, PLIANT_LAW_SAINT_VENANT_KIRCHHOFF, true)

typedef void (*forces_function)(const pliant_tled *, int32_t, float, float *);

static forces_function forces_of(const pliant_tled_system *system)
{
    static const forces_function table[][2][2] = {
        [PLIANT_LAW_NEO_HOOKEAN] = {{neo_hookean, neo_hookean_nodal}, {neo_hookean_viscous, neo_hookean_viscous_nodal}},
        [PLIANT_LAW_COMPRESSIBLE] = {{compressible, compressible_nodal},
                                     {compressible_viscous, compressible_viscous_nodal}},
        [PLIANT_LAW_SAINT_VENANT_KIRCHHOFF] = {{saint_venant_kirchhoff, NULL}, {saint_venant_kirchhoff_viscous, NULL}},
    };
    static_assert(sizeof table / sizeof *table == PLIANT_COUNT_OF(PLIANT_LAW_LIST), "each law has its functions");
    return table[system->law][system->num_prony > 0][system->nodal_pressure];
}

static forces_function cube_forces_of(const pliant_tled_system *system)
{
    static const forces_function table[][2] = {
        [PLIANT_LAW_NEO_HOOKEAN] = {neo_hookean_cubes, neo_hookean_viscous_cubes},
        [PLIANT_LAW_COMPRESSIBLE] = {compressible_cubes, compressible_viscous_cubes},
        [PLIANT_LAW_SAINT_VENANT_KIRCHHOFF] = {saint_venant_kirchhoff_cubes, saint_venant_kirchhoff_viscous_cubes},
    };
    static_assert(sizeof table / sizeof *table == PLIANT_COUNT_OF(PLIANT_LAW_LIST), "each law has its functions");
    return table[system->law][system->num_prony > 0];
}

void pliant_tled_element_forces(pliant_tled *tled, double time_step)
{
    const forces_function forces = forces_of(tled->system);
    if (tled->system->cubes) {
        const forces_function of_cubes = cube_forces_of(tled->system);
        float *out = tled->forces + (size_t)tled->system->num_blocks * 12 * LANES;
#pragma omp for schedule(static)
        for (int32_t block = 0; block < tled->system->cubes->num_blocks; block++)
            of_cubes(tled, block, (float)time_step, out + (size_t)block * 24 * LANES);
    }
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
        tled->change[block][l] = system->moduli[block][2][l] * pliant_change_of(one, cofactor);
    }
}

/* Compute average nodal pressures (Bonet and Burton 1998, in the form that conserves energy). A node's change of volume
 * is the mean over its adjacent elements, p = modulus f(J), and an element has the mean of its nodes' pressures. */
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
