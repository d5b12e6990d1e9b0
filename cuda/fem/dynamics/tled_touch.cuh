/* Contacts in a sub-step, by all threads of one block, as in pliant_tled_touch_all. */
#ifndef PLIANT_CUDA_TLED_TOUCH_CUH
#define PLIANT_CUDA_TLED_TOUCH_CUH

#include "cuda/fem/dynamics/tled_state.h"

/* Memory in which points are corrected: shared memory, or global memory. */
typedef struct gpu_touch_room {
    bool shared;
    pliant_contact_point *point;
    pliant_tled_touch *touch;
    double *rest, *u, *d, *acceleration, *inverse_mass; /* of the points' nodes */
} gpu_touch_room;

static __device__ gpu_touch_room make_touch_room(const gpu_tled &tled, bool shared, double *block)
{
    gpu_touch_room room;
    double *near = shared ? block : tled.d_near_room;
    room.shared = shared;
    room.rest = near;
    room.u = near + 3 * (size_t)tled.room_near;
    room.d = room.u + 3 * (size_t)tled.room_near;
    room.acceleration = room.d + 3 * (size_t)tled.room_near;
    room.inverse_mass = room.acceleration + 3 * (size_t)tled.room_near;
    near += NEAR_NUMBERS * (size_t)tled.room_near;
    room.point = shared ? reinterpret_cast<pliant_contact_point *>(near) : tled.d_point;
    room.touch = shared ? reinterpret_cast<pliant_tled_touch *>(room.point + tled.room_points) : tled.d_touch;
    return room;
}

static __device__ __forceinline__ void copy_numbers(const void *from, void *to, size_t bytes)
{
    for (size_t m = threadIdx.x; m < bytes / sizeof(unsigned long long); m += GPU_THREADS)
        static_cast<unsigned long long *>(to)[m] = static_cast<const unsigned long long *>(from)[m];
}

/* Copy the points' nodes to this memory, and back after the corrections. */
static __device__ void load_near(const gpu_tled &tled, int32_t count, const double *d_u, const double *d_d,
                                 const gpu_touch_room &room)
{
    for (int32_t i = (int32_t)threadIdx.x; i < 3 * count; i += GPU_THREADS) {
        const size_t n = (size_t)tled.d_near[i / 3], k = (size_t)(i % 3);
        room.rest[i] = tled.d_rest[3 * n + k];
        room.u[i] = __ldcg(d_u + 4 * n + k);
        room.d[i] = __ldcg(d_d + 3 * n + k);
        room.acceleration[i] = __ldcg(tled.d_acceleration + 3 * n + k);
        if (k == 0) room.inverse_mass[i / 3] = tled.d_nodes[n].inverse_mass;
    }
}

static __device__ void store_near(const gpu_tled &tled, int32_t count, double *d_u, double *d_d,
                                  const gpu_touch_room &room)
{
    for (int32_t i = (int32_t)threadIdx.x; i < 3 * count; i += GPU_THREADS) {
        const size_t n = (size_t)tled.d_near[i / 3], k = (size_t)(i % 3);
        if (room.inverse_mass[i / 3] == 0) continue;
        d_u[4 * n + k] = room.u[i];
        d_d[3 * n + k] = room.d[i];
        tled.d_acceleration[3 * n + k] = room.acceleration[i];
    }
}

/* Correct the points level by level, and return this thread's part of the load. made: sub-steps of this part of the
 * frame before this one. */
static __device__ double touch_all(const gpu_tled &tled, const gpu_frame &frame, double factor, int32_t made,
                                   double *d_u, double *d_d, const gpu_touch_room &room)
{
    const pliant_touch_time time = pliant_touch_time_of(tled.still, factor, frame.substeps, made);
    const pliant_touch_nodes nodes = {room.rest, room.inverse_mass, room.u, room.d, room.acceleration};
    const size_t points = (size_t)frame.num_points * sizeof *room.point,
                 touches = (size_t)frame.num_points * sizeof *room.touch;
    double load = 0;
    load_near(tled, frame.num_near, d_u, d_d, room);
    if (room.shared) {
        copy_numbers(tled.d_point, room.point, points);
        copy_numbers(tled.d_touch, room.touch, touches);
    }
    __syncthreads();
    for (int32_t level = 0; level < frame.num_levels; level++) {
        for (int32_t p = tled.d_level[level] + (int32_t)threadIdx.x; p < tled.d_level[level + 1]; p += GPU_THREADS)
            load += pliant_touch_press(&nodes, &time, room.point + p, room.touch + p);
        __syncthreads();
    }
    store_near(tled, frame.num_near, d_u, d_d, room);
    if (room.shared) {
        copy_numbers(room.point, tled.d_point, points);
        copy_numbers(room.touch, tled.d_touch, touches);
    }
    __syncthreads();
    return load;
}

#endif
