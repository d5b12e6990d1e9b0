/* One element's forces on its corners: the lines of src/fem/element/stress.h around those of src/fem/dynamics/tled_elements.c. */
#ifndef PLIANT_CUDA_TLED_FORCES_CUH
#define PLIANT_CUDA_TLED_FORCES_CUH

#include "fem/element/stress.h"
#include "tled_state.h"

static __device__ __forceinline__ gpu_tet load_tet(const gpu_tet *d_tets, int32_t tet)
{
    const float4 *from = reinterpret_cast<const float4 *>(d_tets + tet);
    union { float4 part[4]; gpu_tet tet; } out;
    for (int q = 0; q < 4; q++) out.part[q] = __ldg(from + q);
    return out.tet;
}

/* H = sum over corners 1 to 3 of (u_v - u_0) g_v', differences in double. Nothing writes to d_u while this runs. */
static __device__ __forceinline__ void load_gradient(const double *d_u, const gpu_tet &tet, float h[9])
{
    const double2 *first = reinterpret_cast<const double2 *>(d_u + 4 * (size_t)tet.node[0]);
    const double2 xy = __ldg(first);
    const double z = __ldg(&first[1].x);
    float apart[9];
    for (int v = 0; v < 3; v++) {
        const double2 *at = reinterpret_cast<const double2 *>(d_u + 4 * (size_t)tet.node[v + 1]);
        const double2 at_xy = __ldg(at);
        apart[3 * v] = (float)(at_xy.x - xy.x);
        apart[3 * v + 1] = (float)(at_xy.y - xy.y);
        apart[3 * v + 2] = (float)(__ldg(&at[1].x) - z);
    }
    for (int r = 0; r < 3; r++)
        for (int c = 0; c < 3; c++)
            h[3 * r + c] = apart[r] * tet.gradient[c] + apart[3 + r] * tet.gradient[3 + c] + apart[6 + r] * tet.gradient[6 + c];
}

/* What has relaxed after this sub-step; one of the element's groups keeps it, the others only work it out. */
static __device__ __forceinline__ void relax(const gpu_tled &tled, int from, int32_t tet, bool keeps, const float h[9], const float cofactor[9], float p[9])
{
    float s[6], relaxed[6] = {0, 0, 0, 0, 0, 0};
    pliant_stress_at_rest(h, cofactor, p, s);
    for (int term = 0; term < tled.num_prony; term++) {
        const float part = tled.d_frame->prony_part[term], share = tled.d_frame->prony_share[term];
        const size_t place = 8 * ((size_t)term * (size_t)tled.num_tets + (size_t)tet);
        const float *old = tled.d_memory[from] + place;
        float *next = tled.d_memory[1 - from] + place;
        for (int m = 0; m < 6; m++) {
            float y = old[m];
            y += part * (share * s[m] - y);
            relaxed[m] += y;
            if (keeps) next[m] = y;
        }
    }
    pliant_subtract_relaxed(h, relaxed, p);
}

template <int LAW, bool VISCOUS, bool NODAL>
static __device__ __forceinline__ void element_forces(const gpu_tled &tled, int from, int from_memory, int32_t element, const gpu_tet &tet,
                                                      float (*out)[GPU_THREADS])
{
    float h[9], p[9], cofactor[9], volume[9], pressure = 0;
    load_gradient(tled.d_u[from], tet, h);
    if (NODAL) {
        const float *at = tled.d_pressure;
        pressure = 0.25f * tet.volume * (at[tet.node[0]] + at[tet.node[1]] + at[tet.node[2]] + at[tet.node[3]]);
    }
    if (LAW == PLIANT_LAW_SAINT_VENANT_KIRCHHOFF) {
        pliant_saint_venant_kirchhoff_stress(h, tet.shear, tet.bulk, p, volume);
        if (VISCOUS) {
            float of_h[9];
            pliant_change_of(h, of_h);
            for (int r = 0; r < 3; r++)
                for (int c = 0; c < 3; c++) cofactor[3 * r + c] = (r == c) * (1 + h[0] + h[4] + h[8]) - h[3 * c + r] + of_h[3 * r + c];
        }
    } else {
        float factor = pliant_neo_hookean_stress((pliant_law)LAW, h, tet.shear, tet.bulk, cofactor, p);
        if (NODAL) factor = pressure;
        for (int m = 0; m < 9; m++) volume[m] = factor * cofactor[m];
    }
    if (VISCOUS) relax(tled, from_memory, element >> 1, element & 1, h, cofactor, p);
    for (int r = 0; r < 3; r++) {
        const float x = p[3 * r] + volume[3 * r], y = p[3 * r + 1] + volume[3 * r + 1], z = p[3 * r + 2] + volume[3 * r + 2];
        const float *g = tet.gradient;
        const float first = x * g[0] + y * g[1] + z * g[2], second = x * g[3] + y * g[4] + z * g[5], third = x * g[6] + y * g[7] + z * g[8];
        out[r][threadIdx.x] = -(first + second + third);
        out[3 + r][threadIdx.x] = first;
        out[6 + r][threadIdx.x] = second;
        out[9 + r][threadIdx.x] = third;
    }
}

#endif
