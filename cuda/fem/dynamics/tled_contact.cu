#include "cuda/fem/dynamics/tled_contact.h"

#include "base/fail.h"
#include "cuda/base/check.h"
#include "base/memory.h"

#include <algorithm>
#include <cstring>

static void free_points(gpu_tled_contacts *sorted, gpu_tled *gpu)
{
    pliant_cuda_release_host(sorted->h_point);
    pliant_cuda_release_host(sorted->h_touch);
    pliant_cuda_release_host(sorted->h_level);
    pliant_free(sorted->order);
    pliant_free(sorted->level_of);
    pliant_cuda_release(gpu->d_point);
    pliant_cuda_release(gpu->d_contact);
    pliant_cuda_release(gpu->d_level);
    sorted->h_point = NULL;
    sorted->h_touch = NULL;
    sorted->h_level = sorted->order = sorted->level_of = NULL;
    gpu->d_point = NULL;
    gpu->d_contact = NULL;
    gpu->d_level = NULL;
    sorted->point_capacity = 0;
}

void pliant_cuda_tled_contacts_free(gpu_tled_contacts *sorted, gpu_tled *gpu)
{
    free_points(sorted, gpu);
    pliant_cuda_release(gpu->d_near_buffer);
    gpu->d_near_buffer = NULL;
    pliant_free(sorted->near);
    pliant_free(sorted->place);
    pliant_free(sorted->last);
    memset(sorted, 0, sizeof *sorted);
}

template <class T> static pliant_status make(size_t count, bool on_gpu, T **out)
{
    void *block = NULL;
    CUDA_TRY(on_gpu ? pliant_cuda_allocate(count * sizeof(T), "contacts", &block)
                    : pliant_cuda_allocate_host(count * sizeof(T), "contacts", &block));
    *out = static_cast<T *>(block);
    return PLIANT_OK;
}

static pliant_status make_points(gpu_tled_contacts *sorted, gpu_tled *gpu, int32_t count)
{
    const size_t capacity = (size_t)std::max(64, count + count / 2);
    free_points(sorted, gpu);
    CUDA_TRY(make(capacity, false, &sorted->h_point));
    CUDA_TRY(make(capacity, false, &sorted->h_touch));
    CUDA_TRY(make(capacity + 1, false, &sorted->h_level));
    CUDA_TRY(make(capacity, true, &gpu->d_point));
    CUDA_TRY(make(capacity, true, &gpu->d_contact));
    CUDA_TRY(make(capacity + 1, true, &gpu->d_level));
    sorted->order = static_cast<int32_t *>(pliant_calloc(capacity, sizeof *sorted->order));
    sorted->level_of = static_cast<int32_t *>(pliant_calloc(capacity, sizeof *sorted->level_of));
    if (!sorted->order || !sorted->level_of) return pliant_fail_memory("contacts");
    sorted->point_capacity = (int32_t)capacity;
    return PLIANT_OK;
}

static pliant_status make_nodes(const pliant_tled *tled, gpu_tled_contacts *sorted)
{
    const size_t nodes = (size_t)tled->system->mesh->num_nodes;
    if (sorted->place && sorted->last && sorted->near) return PLIANT_OK;
    if (!sorted->place) sorted->place = static_cast<int32_t *>(pliant_calloc(nodes, sizeof *sorted->place));
    if (!sorted->last) sorted->last = static_cast<int32_t *>(pliant_calloc(nodes, sizeof *sorted->last));
    if (!sorted->near) sorted->near = static_cast<int32_t *>(pliant_calloc(nodes, sizeof *sorted->near));
    if (!sorted->place || !sorted->last || !sorted->near) return pliant_fail_memory("contacts");
    for (size_t n = 0; n < nodes; n++) sorted->place[n] = -1;
    return PLIANT_OK;
}

/* List the nodes of the points in the order of their first use, and find the level of every point. */
static void find_levels(const pliant_contacts *contacts, gpu_tled_contacts *sorted)
{
    for (int32_t n = 0; n < sorted->num_near; n++) sorted->place[sorted->near[n]] = -1;
    sorted->num_near = sorted->num_levels = 0;
    for (int32_t p = 0; p < contacts->count; p++) {
        const pliant_contact_point *point = contacts->point + p;
        int32_t level = 0;
        for (int32_t k = 0; k < point->count; k++) {
            const int32_t node = point->node[k];
            if (sorted->place[node] < 0) {
                sorted->place[node] = sorted->num_near;
                sorted->near[sorted->num_near++] = node;
                sorted->last[node] = -1;
            }
            level = std::max(level, sorted->last[node] + 1);
        }
        for (int32_t k = 0; k < point->count; k++) sorted->last[point->node[k]] = level;
        sorted->level_of[p] = level;
        sorted->num_levels = std::max(sorted->num_levels, level + 1);
    }
}

/* Sort the points by level, and within a level in the host's order. */
static void sort_points(const pliant_contacts *contacts, gpu_tled_contacts *sorted)
{
    int32_t *first = sorted->h_level;
    memset(first, 0, ((size_t)sorted->num_levels + 1) * sizeof *first);
    for (int32_t p = 0; p < contacts->count; p++) first[sorted->level_of[p] + 1]++;
    for (int32_t l = 0; l < sorted->num_levels; l++) first[l + 1] += first[l];
    for (int32_t p = contacts->count - 1; p >= 0; p--) sorted->order[--first[sorted->level_of[p] + 1]] = p;
    for (int32_t l = 0; l < sorted->num_levels; l++) first[l] = first[l + 1];
    first[sorted->num_levels] = contacts->count;
}

/* Use shared memory for the contacts if it suffices, in addition to the kernel's static shared memory. */
static pliant_status choose_memory(const gpu_tled_contacts *sorted, gpu_tled *gpu)
{
    int device = 0, maximum = 0;
    const size_t bytes = pliant_cuda_tled_contact_bytes(sorted->point_capacity, sorted->near_capacity);
    CUDA_TRY(CUDA_CALL(cudaGetDevice(&device)));
    CUDA_TRY(CUDA_CALL(cudaDeviceGetAttribute(&maximum, cudaDevAttrMaxSharedMemoryPerBlockOptin, device)));
    gpu->point_capacity = sorted->point_capacity;
    gpu->near_capacity = sorted->near_capacity;
    return pliant_cuda_tled_use_shared_memory(gpu, bytes, (size_t)maximum);
}

pliant_status pliant_cuda_tled_contacts_sort(const pliant_tled *tled, gpu_tled_contacts *sorted, gpu_tled *gpu,
                                             bool *moved)
{
    static const pliant_contacts none = {};
    const pliant_contacts *contacts = pliant_tled_touches(tled) ? tled->contacts : &none;
    sorted->num_points = 0;
    if (contacts->count == 0) {
        find_levels(contacts, sorted);
        return PLIANT_OK;
    }
    const bool grows = contacts->count > sorted->point_capacity;
    if (grows) CUDA_TRY(make_points(sorted, gpu, contacts->count));
    CUDA_TRY(make_nodes(tled, sorted));
    find_levels(contacts, sorted);
    sort_points(contacts, sorted);
    const bool more = sorted->num_near > sorted->near_capacity;
    if (more) {
        const int32_t capacity = sorted->num_near + sorted->num_near / 2;
        pliant_cuda_release(gpu->d_near_buffer);
        gpu->d_near_buffer = NULL;
        sorted->near_capacity = 0;
        CUDA_TRY(make(NEAR_NUMBERS * (size_t)capacity, true, &gpu->d_near_buffer));
        sorted->near_capacity = capacity;
    }
    if (grows || more) CUDA_TRY(choose_memory(sorted, gpu));
    *moved = *moved || grows || more;
    sorted->num_points = contacts->count;
    for (int32_t i = 0; i < contacts->count; i++) {
        pliant_contact_point *point = sorted->h_point + i;
        *point = contacts->point[sorted->order[i]];
        for (int32_t k = 0; k < point->count; k++) point->node[k] = sorted->place[point->node[k]];
        sorted->h_touch[i] = tled->contact[sorted->order[i]];
    }
    return PLIANT_OK;
}

pliant_status pliant_cuda_tled_contacts_send(const gpu_tled_contacts *sorted, const gpu_tled *gpu, cudaStream_t stream)
{
    const size_t count = (size_t)sorted->num_points, levels = (size_t)sorted->num_levels + 1;
    if (count == 0) return PLIANT_OK;
    CUDA_TRY(CUDA_CALL(
        cudaMemcpyAsync(gpu->d_point, sorted->h_point, count * sizeof *gpu->d_point, cudaMemcpyHostToDevice, stream)));
    CUDA_TRY(CUDA_CALL(cudaMemcpyAsync(gpu->d_contact, sorted->h_touch, count * sizeof *gpu->d_contact,
                                       cudaMemcpyHostToDevice, stream)));
    return CUDA_CALL(
        cudaMemcpyAsync(gpu->d_level, sorted->h_level, levels * sizeof *gpu->d_level, cudaMemcpyHostToDevice, stream));
}

pliant_status pliant_cuda_tled_contacts_download(const gpu_tled_contacts *sorted, const gpu_tled *gpu,
                                                 cudaStream_t stream)
{
    const size_t count = (size_t)sorted->num_points;
    if (count == 0) return PLIANT_OK;
    CUDA_TRY(CUDA_CALL(
        cudaMemcpyAsync(sorted->h_point, gpu->d_point, count * sizeof *gpu->d_point, cudaMemcpyDeviceToHost, stream)));
    return CUDA_CALL(cudaMemcpyAsync(sorted->h_touch, gpu->d_contact, count * sizeof *gpu->d_contact,
                                     cudaMemcpyDeviceToHost, stream));
}

void pliant_cuda_tled_contacts_take(const gpu_tled_contacts *sorted, pliant_tled *tled)
{
    for (int32_t i = 0; i < sorted->num_points; i++) {
        pliant_contact_point *point = tled->contacts->point + sorted->order[i];
        memcpy(point->weight, sorted->h_point[i].weight, sizeof point->weight);
        memcpy(point->normal, sorted->h_point[i].normal, sizeof point->normal);
        memcpy(point->place, sorted->h_point[i].place, sizeof point->place);
        tled->contact[sorted->order[i]] = sorted->h_touch[i];
    }
}
