/* Corner forces of one element. The code corresponds to src/fem/dynamics/tled_elements.c, and both use
 * src/fem/element/stress.h. */
#ifndef PLIANT_CUDA_TLED_FORCES_CUH
#define PLIANT_CUDA_TLED_FORCES_CUH

#include "fem/element/stress.h"
#include "cuda/fem/dynamics/tled_state.h"

static __device__ __forceinline__ gpu_tet load_tet(const gpu_tet *d_tets, int32_t tet)
{
    const float4 *from = reinterpret_cast<const float4 *>(d_tets + tet);
    union { float4 part[4]; gpu_tet tet; } out;
    for (int q = 0; q < 4; q++) out.part[q] = __ldg(from + q);
    return out.tet;
}

static __device__ __forceinline__ gpu_cube load_cube(const gpu_cube *d_cubes, int32_t cube)
{
    const float4 *from = reinterpret_cast<const float4 *>(d_cubes + cube);
    union { float4 part[3]; gpu_cube cube; } out;
    for (int q = 0; q < 3; q++) out.part[q] = __ldg(from + q);
    return out.cube;
}

/* Load the change of H in the last sub-step. */
static __device__ __forceinline__ void load_change(const double *d_d, const gpu_tet &tet, float change[9])
{
    float difference[9];
    for (int v = 0; v < 3; v++)
        for (int k = 0; k < 3; k++)
            difference[3 * v + k] =
                (float)(__ldg(d_d + 3 * (size_t)tet.node[v + 1] + k) - __ldg(d_d + 3 * (size_t)tet.node[0] + k));
    for (int r = 0; r < 3; r++)
        for (int c = 0; c < 3; c++)
            change[3 * r + c] = difference[r] * tet.gradient[c] + difference[3 + r] * tet.gradient[3 + c] +
                                difference[6 + r] * tet.gradient[6 + c];
}

/* Transform corner values to modes and back, as in tled_elements.c. */
static __device__ __forceinline__ void transform(float w[8], bool back)
{
    for (int bit = 1; bit < 8; bit *= 2)
        for (int i = 0; i < 8; i++) {
            if (i & bit) continue;
            const float low = w[i], high = w[i | bit];
            w[i] = back ? low - high : low + high;
            w[i | bit] = back ? low + high : high - low;
        }
}

/* Load the modes of a hexahedron and its mean gradient, from differences in double precision. Return the mean
 * gradient's change of volume. stride: numbers per node. */
static __device__ __forceinline__ float load_modes(const gpu_tled &tled, const double *d_from, size_t stride,
                                                   const gpu_cube &cube, float w[3][8], float h[9])
{
    double exact[9];
    for (int r = 0; r < 3; r++) {
        const double first = __ldg(d_from + stride * (size_t)cube.node[0] + r);
        double difference[8], along[3];
        for (int v = 0; v < 8; v++)
            w[r][v] = (float)(difference[v] = __ldg(d_from + stride * (size_t)cube.node[v] + r) - first);
        transform(w[r], false);
        pliant_cube_differences(difference, along);
        for (int c = 0; c < 3; c++) {
            const float *g = tled.cube_gradient + c;
            exact[3 * r + c] =
                (double)cube.finer * (along[0] * (double)g[0] + along[1] * (double)g[3] + along[2] * (double)g[6]);
            h[3 * r + c] = (float)exact[3 * r + c];
        }
    }
    return (float)pliant_exact_change_of(exact);
}

static __device__ __forceinline__ void modes_of(const float w[3][8], pliant_cube_modes *out)
{
    for (int m = 0; m < 9; m++) {
        out->along[m] = w[m % 3][1 << m / 3];
        out->across[m] = w[m % 3][7 ^ 1 << m / 3];
    }
}

/* Compute H = sum over corners 1 to 3 of (u_v - u_0) g_v', with differences in double precision. d_u is constant while
 * this runs. */
static __device__ __forceinline__ void load_gradient(const double *d_u, const gpu_tet &tet, float h[9])
{
    const double2 *first = reinterpret_cast<const double2 *>(d_u + 4 * (size_t)tet.node[0]);
    const double2 xy = __ldg(first);
    const double z = __ldg(&first[1].x);
    float difference[9];
    for (int v = 0; v < 3; v++) {
        const double2 *at = reinterpret_cast<const double2 *>(d_u + 4 * (size_t)tet.node[v + 1]);
        const double2 at_xy = __ldg(at);
        difference[3 * v] = (float)(at_xy.x - xy.x);
        difference[3 * v + 1] = (float)(at_xy.y - xy.y);
        difference[3 * v + 2] = (float)(__ldg(&at[1].x) - z);
    }
    for (int r = 0; r < 3; r++)
        for (int c = 0; c < 3; c++)
            h[3 * r + c] = difference[r] * tet.gradient[c] + difference[3 + r] * tet.gradient[3 + c] +
                           difference[6 + r] * tet.gradient[6 + c];
}

/* Update the relaxed stress after this sub-step. One of the element's groups stores it; the other groups only compute
 * it. */
static __device__ __forceinline__ void relax(const gpu_tled &tled, int from, int32_t tet, bool keeps, const float h[9],
                                             const float cofactor[9], float p[9])
{
    float s[6], relaxed[6] = {0, 0, 0, 0, 0, 0};
    pliant_stress_at_rest(h, cofactor, p, s);
    for (int term = 0; term < tled.num_prony; term++) {
        const float part = tled.d_frame->prony_relaxed_fraction[term], fraction = tled.d_frame->prony_share[term];
        const size_t place = 8 * ((size_t)term * (size_t)tled.num_elements + (size_t)tet);
        const float *old = tled.d_memory[from] + place;
        float *next = tled.d_memory[1 - from] + place;
        for (int m = 0; m < 6; m++) {
            float y = old[m];
            y += part * (fraction * s[m] - y);
            relaxed[m] += y;
            if (keeps) next[m] = y;
        }
    }
    pliant_subtract_relaxed(h, relaxed, p);
}

/* Compute rest volume times first Piola-Kirchhoff stress. change: NULL without stiffness-proportional damping;
 * pressure: NULL if it follows from H. */
template <int LAW, bool VISCOUS>
static __device__ __forceinline__ void element_stress(const gpu_tled &tled, int from_memory, int32_t element,
                                                      const float h[9], const float *change, float shear, float bulk,
                                                      const float *pressure, float p[9])
{
    float cofactor[9], volume[9];
    if (LAW == PLIANT_LAW_SAINT_VENANT_KIRCHHOFF) {
        pliant_saint_venant_kirchhoff_stress(h, shear, bulk, p, volume);
        if (VISCOUS) {
            float of_h[9];
            pliant_change_of(h, of_h);
            for (int r = 0; r < 3; r++)
                for (int c = 0; c < 3; c++)
                    cofactor[3 * r + c] = (r == c) * (1 + h[0] + h[4] + h[8]) - h[3 * c + r] + of_h[3 * r + c];
        }
    } else {
        float factor = pliant_neo_hookean_stress((pliant_law)LAW, h, shear, bulk, cofactor, p);
        if (pressure) factor = *pressure;
        for (int m = 0; m < 9; m++) volume[m] = factor * cofactor[m];
    }
    if (VISCOUS) relax(tled, from_memory, element >> 1, element & 1, h, cofactor, p);
    if (change) pliant_add_viscous(h, change, shear, tled.d_frame->damping, p);
    for (int m = 0; m < 9; m++) p[m] += volume[m];
}

/* Compute the forces of a tetrahedron. DAMPED: stiffness-proportional damping is possible. */
template <int LAW, bool VISCOUS, bool NODAL, bool DAMPED>
static __device__ __forceinline__ void element_forces(const gpu_tled &tled, int from, int from_memory, int32_t element,
                                                      const gpu_tet &tet, float (*out)[GPU_THREADS])
{
    float h[9], p[9], change[9], pressure = 0;
    load_gradient(tled.d_u[from], tet, h);
    const bool nodal = NODAL && tled.nodal, damped = DAMPED && tled.damped;
    if (nodal) {
        const float *at = tled.d_pressure;
        pressure = 0.25f * tet.volume * (at[tet.node[0]] + at[tet.node[1]] + at[tet.node[2]] + at[tet.node[3]]);
    }
    if (damped) load_change(tled.d_d[from], tet, change);
    element_stress<LAW, VISCOUS>(tled, from_memory, element, h, damped ? change : NULL, tet.shear, tet.bulk,
                                 nodal ? &pressure : NULL, p);
    for (int r = 0; r < 3; r++) {
        const float x = p[3 * r], y = p[3 * r + 1], z = p[3 * r + 2];
        const float *g = tet.gradient;
        const float first = x * g[0] + y * g[1] + z * g[2], second = x * g[3] + y * g[4] + z * g[5],
                    third = x * g[6] + y * g[7] + z * g[8];
        out[r][threadIdx.x] = -(first + second + third);
        out[3 + r][threadIdx.x] = first;
        out[6 + r][threadIdx.x] = second;
        out[9 + r][threadIdx.x] = third;
    }
}

/* Compute the forces of a hexahedron. */
template <int LAW, bool VISCOUS>
static __device__ __forceinline__ void cube_forces(const gpu_tled &tled, int from, int from_memory, int32_t element,
                                                   float (*out)[GPU_THREADS])
{
    const gpu_cube cube = load_cube(tled.d_cubes, (element >> 1) - tled.num_tets);
    float w[3][8], more[3][8], h[9], change[9], p[9];
    pliant_cube_modes modes, moved, force;
    const float pressure =
        cube.bulk * pliant_law_float_volume((pliant_law)LAW, load_modes(tled, tled.d_u[from], 4, cube, w, h));
    const float shear = cube.shear * (cube.finer * cube.finer), damping = tled.d_frame->damping;
    modes_of(w, &modes);
    if (tled.damped) {
        load_modes(tled, tled.d_d[from], 3, cube, more, change);
        modes_of(more, &moved);
        pliant_cube_bend(&tled.cube_bending, cube.finer, shear, cube.contraction, &modes, &moved, damping, &force);
        for (int r = 0; r < 3; r++) w[r][7] += damping * more[r][7];
    } else {
        pliant_cube_bend(&tled.cube_bending, cube.finer, shear, cube.contraction, &modes, NULL, 0, &force);
    }
    element_stress<LAW, VISCOUS>(tled, from_memory, element, h, tled.damped ? change : NULL, cube.shear, cube.bulk,
                                 &pressure, p);
    for (int r = 0; r < 3; r++) {
        w[r][0] = 0;
        w[r][7] *= shear * tled.cube_bending.twist;
        for (int axis = 0; axis < 3; axis++) {
            w[r][7 ^ 1 << axis] = force.across[3 * axis + r];
            w[r][1 << axis] =
                force.along[3 * axis + r] + cube.finer * (p[3 * r] * tled.cube_gradient[3 * axis] +
                                                          p[3 * r + 1] * tled.cube_gradient[3 * axis + 1] +
                                                          p[3 * r + 2] * tled.cube_gradient[3 * axis + 2]);
        }
        transform(w[r], true);
        for (int v = 0; v < 8; v++) out[3 * v + r][threadIdx.x] = w[r][v];
    }
}

#endif
