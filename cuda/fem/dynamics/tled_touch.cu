#include "cuda/fem/dynamics/tled_touch.h"

#include "base/fail.h"
#include "cuda/base/check.h"
#include "base/memory.h"

#include <algorithm>
#include <cstring>

static void free_points(gpu_touching *touching, gpu_tled *gpu)
{
    pliant_cuda_release_host(touching->h_point);
    pliant_cuda_release_host(touching->h_touch);
    pliant_cuda_release_host(touching->h_level);
    pliant_free(touching->order);
    pliant_free(touching->level_of);
    pliant_cuda_release(gpu->d_point);
    pliant_cuda_release(gpu->d_touch);
    pliant_cuda_release(gpu->d_level);
    touching->h_point = NULL;
    touching->h_touch = NULL;
    touching->h_level = touching->order = touching->level_of = NULL;
    gpu->d_point = NULL;
    gpu->d_touch = NULL;
    gpu->d_level = NULL;
    touching->room_points = 0;
}

extern "C" void pliant_cuda_touching_free(gpu_touching *touching, gpu_tled *gpu)
{
    free_points(touching, gpu);
    pliant_cuda_release(gpu->d_near_room);
    gpu->d_near_room = NULL;
    pliant_free(touching->near);
    pliant_free(touching->place);
    pliant_free(touching->last);
    memset(touching, 0, sizeof *touching);
}

template <class T> static pliant_status make(size_t count, bool on_gpu, T **out)
{
    void *block = NULL;
    CUDA_TRY(on_gpu ? pliant_cuda_allocate(count * sizeof(T), "contacts", &block)
                    : pliant_cuda_allocate_host(count * sizeof(T), "contacts", &block));
    *out = static_cast<T *>(block);
    return PLIANT_OK;
}

static pliant_status make_points(gpu_touching *touching, gpu_tled *gpu, int32_t count)
{
    const size_t room = (size_t)std::max(64, count + count / 2);
    free_points(touching, gpu);
    CUDA_TRY(make(room, false, &touching->h_point));
    CUDA_TRY(make(room, false, &touching->h_touch));
    CUDA_TRY(make(room + 1, false, &touching->h_level));
    CUDA_TRY(make(room, true, &gpu->d_point));
    CUDA_TRY(make(room, true, &gpu->d_touch));
    CUDA_TRY(make(room + 1, true, &gpu->d_level));
    touching->order = static_cast<int32_t *>(pliant_calloc(room, sizeof *touching->order));
    touching->level_of = static_cast<int32_t *>(pliant_calloc(room, sizeof *touching->level_of));
    if (!touching->order || !touching->level_of) return pliant_fail_memory("contacts");
    touching->room_points = (int32_t)room;
    return PLIANT_OK;
}

static pliant_status make_nodes(const pliant_tled *tled, gpu_touching *touching)
{
    const size_t nodes = (size_t)tled->system->mesh->num_nodes;
    if (touching->place && touching->last && touching->near) return PLIANT_OK;
    if (!touching->place) touching->place = static_cast<int32_t *>(pliant_calloc(nodes, sizeof *touching->place));
    if (!touching->last) touching->last = static_cast<int32_t *>(pliant_calloc(nodes, sizeof *touching->last));
    if (!touching->near) touching->near = static_cast<int32_t *>(pliant_calloc(nodes, sizeof *touching->near));
    if (!touching->place || !touching->last || !touching->near) return pliant_fail_memory("contacts");
    for (size_t n = 0; n < nodes; n++) touching->place[n] = -1;
    return PLIANT_OK;
}

/* List the nodes of the points in the order of their first use, and find the level of every point. */
static void find_levels(const pliant_contacts *contacts, gpu_touching *touching)
{
    for (int32_t n = 0; n < touching->num_near; n++) touching->place[touching->near[n]] = -1;
    touching->num_near = touching->num_levels = 0;
    for (int32_t p = 0; p < contacts->count; p++) {
        const pliant_contact_point *point = contacts->point + p;
        int32_t level = 0;
        for (int32_t k = 0; k < point->count; k++) {
            const int32_t node = point->node[k];
            if (touching->place[node] < 0) {
                touching->place[node] = touching->num_near;
                touching->near[touching->num_near++] = node;
                touching->last[node] = -1;
            }
            level = std::max(level, touching->last[node] + 1);
        }
        for (int32_t k = 0; k < point->count; k++) touching->last[point->node[k]] = level;
        touching->level_of[p] = level;
        touching->num_levels = std::max(touching->num_levels, level + 1);
    }
}

/* Sort the points by level, and within a level in the host's order. */
static void sort_points(const pliant_contacts *contacts, gpu_touching *touching)
{
    int32_t *first = touching->h_level;
    memset(first, 0, ((size_t)touching->num_levels + 1) * sizeof *first);
    for (int32_t p = 0; p < contacts->count; p++) first[touching->level_of[p] + 1]++;
    for (int32_t l = 0; l < touching->num_levels; l++) first[l + 1] += first[l];
    for (int32_t p = contacts->count - 1; p >= 0; p--) touching->order[--first[touching->level_of[p] + 1]] = p;
    for (int32_t l = 0; l < touching->num_levels; l++) first[l] = first[l + 1];
    first[touching->num_levels] = contacts->count;
}

/* Use shared memory for the contacts if it suffices, in addition to the kernel's static shared memory. */
static pliant_status choose_memory(const gpu_touching *touching, gpu_tled *gpu)
{
    int device = 0, most = 0;
    const size_t bytes = pliant_cuda_touch_bytes(touching->room_points, touching->room_near);
    CUDA_TRY(CUDA_CALL(cudaGetDevice(&device)));
    CUDA_TRY(CUDA_CALL(cudaDeviceGetAttribute(&most, cudaDevAttrMaxSharedMemoryPerBlockOptin, device)));
    gpu->room_points = touching->room_points;
    gpu->room_near = touching->room_near;
    return pliant_cuda_tled_share(gpu, bytes, (size_t)most);
}

extern "C" pliant_status pliant_cuda_touching_sort(const pliant_tled *tled, gpu_touching *touching, gpu_tled *gpu,
                                                   bool *moved)
{
    static const pliant_contacts none = {};
    const pliant_contacts *contacts = pliant_tled_touches(tled) ? tled->contacts : &none;
    touching->num_points = 0;
    if (contacts->count == 0) {
        find_levels(contacts, touching);
        return PLIANT_OK;
    }
    const bool grows = contacts->count > touching->room_points;
    if (grows) CUDA_TRY(make_points(touching, gpu, contacts->count));
    CUDA_TRY(make_nodes(tled, touching));
    find_levels(contacts, touching);
    sort_points(contacts, touching);
    const bool more = touching->num_near > touching->room_near;
    if (more) {
        const int32_t room = touching->num_near + touching->num_near / 2;
        pliant_cuda_release(gpu->d_near_room);
        gpu->d_near_room = NULL;
        touching->room_near = 0;
        CUDA_TRY(make(NEAR_NUMBERS * (size_t)room, true, &gpu->d_near_room));
        touching->room_near = room;
    }
    if (grows || more) CUDA_TRY(choose_memory(touching, gpu));
    *moved = *moved || grows || more;
    touching->num_points = contacts->count;
    for (int32_t i = 0; i < contacts->count; i++) {
        pliant_contact_point *point = touching->h_point + i;
        *point = contacts->point[touching->order[i]];
        for (int32_t k = 0; k < point->count; k++) point->node[k] = touching->place[point->node[k]];
        touching->h_touch[i] = tled->touch[touching->order[i]];
    }
    return PLIANT_OK;
}

extern "C" pliant_status pliant_cuda_touching_send(const gpu_touching *touching, const gpu_tled *gpu,
                                                   cudaStream_t stream)
{
    const size_t count = (size_t)touching->num_points, levels = (size_t)touching->num_levels + 1;
    if (count == 0) return PLIANT_OK;
    CUDA_TRY(CUDA_CALL(cudaMemcpyAsync(gpu->d_point, touching->h_point, count * sizeof *gpu->d_point,
                                       cudaMemcpyHostToDevice, stream)));
    CUDA_TRY(CUDA_CALL(cudaMemcpyAsync(gpu->d_touch, touching->h_touch, count * sizeof *gpu->d_touch,
                                       cudaMemcpyHostToDevice, stream)));
    return CUDA_CALL(cudaMemcpyAsync(gpu->d_level, touching->h_level, levels * sizeof *gpu->d_level,
                                     cudaMemcpyHostToDevice, stream));
}

extern "C" pliant_status pliant_cuda_touching_download(const gpu_touching *touching, const gpu_tled *gpu,
                                                       cudaStream_t stream)
{
    const size_t count = (size_t)touching->num_points;
    if (count == 0) return PLIANT_OK;
    CUDA_TRY(CUDA_CALL(cudaMemcpyAsync(touching->h_point, gpu->d_point, count * sizeof *gpu->d_point,
                                       cudaMemcpyDeviceToHost, stream)));
    return CUDA_CALL(
        cudaMemcpyAsync(touching->h_touch, gpu->d_touch, count * sizeof *gpu->d_touch, cudaMemcpyDeviceToHost, stream));
}

extern "C" void pliant_cuda_touching_take(const gpu_touching *touching, pliant_tled *tled)
{
    for (int32_t i = 0; i < touching->num_points; i++) {
        pliant_contact_point *point = tled->contacts->point + touching->order[i];
        memcpy(point->weight, touching->h_point[i].weight, sizeof point->weight);
        memcpy(point->normal, touching->h_point[i].normal, sizeof point->normal);
        memcpy(point->place, touching->h_point[i].place, sizeof point->place);
        tled->touch[touching->order[i]] = touching->h_touch[i];
    }
}
