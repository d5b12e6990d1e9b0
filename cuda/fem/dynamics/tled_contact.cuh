/* Contacts in a sub-step, by all threads of one block, as in pliant_tled_contacts_correct. */
#ifndef PLIANT_CUDA_TLED_CONTACT_CUH
#define PLIANT_CUDA_TLED_CONTACT_CUH

#include "cuda/fem/dynamics/tled_state.h"

/* Memory in which points are corrected: shared memory, or global memory. */
typedef struct gpu_contact_buffers {
    bool shared;
    pliant_contact_point *point;
    pliant_tled_contact *contact;
    double *rest, *u, *d, *acceleration, *inverse_mass; /* of the points' nodes */
} gpu_contact_buffers;

static __device__ gpu_contact_buffers make_contact_buffers(const gpu_tled &tled, bool shared, double *block)
{
    gpu_contact_buffers buffers;
    double *near = shared ? block : tled.d_near_buffer;
    buffers.shared = shared;
    buffers.rest = near;
    buffers.u = near + 3 * (size_t)tled.near_capacity;
    buffers.d = buffers.u + 3 * (size_t)tled.near_capacity;
    buffers.acceleration = buffers.d + 3 * (size_t)tled.near_capacity;
    buffers.inverse_mass = buffers.acceleration + 3 * (size_t)tled.near_capacity;
    near += NEAR_NUMBERS * (size_t)tled.near_capacity;
    buffers.point = shared ? reinterpret_cast<pliant_contact_point *>(near) : tled.d_point;
    buffers.contact =
        shared ? reinterpret_cast<pliant_tled_contact *>(buffers.point + tled.point_capacity) : tled.d_contact;
    return buffers;
}

static __device__ __forceinline__ void copy_numbers(const void *from, void *to, size_t bytes)
{
    for (size_t m = threadIdx.x; m < bytes / sizeof(unsigned long long); m += GPU_THREADS)
        static_cast<unsigned long long *>(to)[m] = static_cast<const unsigned long long *>(from)[m];
}

/* Copy the points' nodes to this memory, and back after the corrections. */
static __device__ void load_near(const gpu_tled &tled, int32_t count, const double *d_u, const double *d_d,
                                 const gpu_contact_buffers &buffers)
{
    for (int32_t i = (int32_t)threadIdx.x; i < 3 * count; i += GPU_THREADS) {
        const size_t n = (size_t)tled.d_near[i / 3], k = (size_t)(i % 3);
        buffers.rest[i] = tled.d_rest[3 * n + k];
        buffers.u[i] = __ldcg(d_u + 4 * n + k);
        buffers.d[i] = __ldcg(d_d + 3 * n + k);
        buffers.acceleration[i] = __ldcg(tled.d_acceleration + 3 * n + k);
        if (k == 0) buffers.inverse_mass[i / 3] = tled.d_nodes[n].inverse_mass;
    }
}

static __device__ void store_near(const gpu_tled &tled, int32_t count, double *d_u, double *d_d,
                                  const gpu_contact_buffers &buffers)
{
    for (int32_t i = (int32_t)threadIdx.x; i < 3 * count; i += GPU_THREADS) {
        const size_t n = (size_t)tled.d_near[i / 3], k = (size_t)(i % 3);
        if (buffers.inverse_mass[i / 3] == 0) continue;
        d_u[4 * n + k] = buffers.u[i];
        d_d[3 * n + k] = buffers.d[i];
        tled.d_acceleration[3 * n + k] = buffers.acceleration[i];
    }
}

/* Call a function for all points that are solved together, or for all others, level by level. */
template <typename Function>
static __device__ void for_all_points(const gpu_tled &tled, const gpu_frame &frame, const gpu_contact_buffers &buffers,
                                      bool coupled, Function function)
{
    for (int32_t level = 0; level < frame.num_levels; level++) {
        for (int32_t p = tled.d_level[level] + (int32_t)threadIdx.x; p < tled.d_level[level + 1]; p += GPU_THREADS)
            if (pliant_tled_contact_is_coupled(tled.still, buffers.point + p) == coupled)
                function(buffers.point + p, buffers.contact + p);
        __syncthreads();
    }
}

/* Solve for the impulses of the points that are solved together. Return this thread's part of the load. */
static __device__ double solve_coupled(const gpu_tled &tled, const gpu_frame &frame,
                                       const pliant_tled_contact_nodes &nodes, const pliant_tled_contact_timing &time,
                                       const gpu_contact_buffers &buffers)
{
    double load = 0;
    int changed = 0;
    for_all_points(tled, frame, buffers, true, [&](pliant_contact_point *point, pliant_tled_contact *contact) {
        pliant_tled_contact_prepare(&nodes, &time, point, contact);
        changed = 1;
    });
    if (!__syncthreads_or(changed)) return 0;
    for_all_points(tled, frame, buffers, true, [&](pliant_contact_point *point, pliant_tled_contact *contact) {
        pliant_tled_contact_start(&nodes, &time, point, contact);
    });
    changed = 1;
    for (int pass = 0; pass < PLIANT_TLED_CONTACT_PASSES && __syncthreads_or(changed); pass++) {
        changed = 0;
        for_all_points(tled, frame, buffers, true, [&](pliant_contact_point *point, pliant_tled_contact *contact) {
            if (pliant_tled_contact_push(&nodes, &time, point, contact)) changed = 1;
        });
    }
    for_all_points(tled, frame, buffers, true, [&](pliant_contact_point *point, pliant_tled_contact *contact) {
        load += pliant_tled_contact_finish(&nodes, &time, point, contact);
    });
    return load;
}

/* Correct the points, and return this thread's part of the load. made: sub-steps of this part of the frame before this
 * one. */
static __device__ double correct_contacts(const gpu_tled &tled, const gpu_frame &frame, double factor, int32_t made,
                                          double *d_u, double *d_d, const gpu_contact_buffers &buffers)
{
    const pliant_tled_contact_timing time = pliant_tled_contact_time(tled.still, factor, frame.substeps, made);
    const pliant_tled_contact_nodes nodes = {buffers.rest, buffers.inverse_mass, buffers.u, buffers.d,
                                             buffers.acceleration};
    const size_t points = (size_t)frame.num_points * sizeof *buffers.point,
                 touches = (size_t)frame.num_points * sizeof *buffers.contact;
    double load = 0;
    load_near(tled, frame.num_near, d_u, d_d, buffers);
    if (buffers.shared) {
        copy_numbers(tled.d_point, buffers.point, points);
        copy_numbers(tled.d_contact, buffers.contact, touches);
    }
    __syncthreads();
    for_all_points(tled, frame, buffers, false, [&](pliant_contact_point *point, pliant_tled_contact *contact) {
        load += pliant_tled_contact_correct(&nodes, &time, point, contact);
    });
    load += solve_coupled(tled, frame, nodes, time, buffers);
    store_near(tled, frame.num_near, d_u, d_d, buffers);
    if (buffers.shared) {
        copy_numbers(buffers.point, tled.d_point, points);
        copy_numbers(buffers.contact, tled.d_contact, touches);
    }
    __syncthreads();
    return load;
}

#endif
