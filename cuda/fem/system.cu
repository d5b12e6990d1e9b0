#include "cuda/base/check.h"
#include "cuda/base/launch.h"
#include "base/fail.h"
#include "base/memory.h"
#include "cuda/base/send_changes.h"
#include "cuda/fem/system.h"

#include <cstring>

enum { THREADS = 128, PASSAGE = 4 << 20 }; /* bytes */

/* Transfer of a system to the GPU. before: NULL: the GPU has no system yet. */
struct passage {
    const pliant_system *now, *before;
    cudaStream_t stream;
    gpu_system *gpu;
    gpu_system_capacity *capacity;
    const pliant_body_changes *changes; /* Nullable: if the fine mesh is solved, all changed tetrahedra are in this
                                         * list */
};

/* Return the body's changes, if the system follows directly after `before`. */
static const pliant_body_changes *changes_of(const pliant_system *now, const pliant_system *before)
{
    const bool next = now->of && before->of && now->mesh == now->fine && before->mesh == before->fine &&
                      now->of->body->changes.since == before->of->body->revision;
    return next ? &now->of->body->changes : nullptr;
}

/* Send an array; if it exists already, send only the differences. */
template <class T>
static pliant_status send(const passage &work, int array, const T *h_now, size_t count, const T *h_before,
                          size_t count_before, const char *what, T **d_out)
{
    if (!h_now) { /* the presence of an array has a meaning */
        pliant_cuda_release(*d_out);
        *d_out = nullptr;
        return PLIANT_OK;
    }
    const bool held = *d_out && work.capacity->bytes[array] >= count * sizeof(T);
    CUDA_TRY(pliant_cuda_ensure(count * sizeof(T), work.capacity->grows, what, d_out, work.capacity->bytes + array));
    if (held && h_before)
        return pliant_cuda_send_differences(h_now, count * sizeof(T), h_before, count_before * sizeof(T), *d_out,
                                            work.stream);
    return pliant_cuda_send(h_now, count * sizeof(T), *d_out, work.stream);
}

/* ---- Elements: in lanes of 8 on the CPU; one number of all elements after the other on the GPU. */

/* Packed numbers: (count x rows x lanes). */
struct packet { int32_t count, rows, lanes, stride; const int32_t *d_which; const double *d_numbers; };

static __global__ void __launch_bounds__(THREADS) unpack_kernel(packet from, int last, double *d_out)
{
    const long long n = (long long)blockIdx.x * THREADS + threadIdx.x;
    if (n >= (long long)from.count * from.rows * from.lanes) return;
    const int lane = (int)(n % from.lanes), row = (int)(n / from.lanes % from.rows),
              which = from.d_which[n / ((long long)from.lanes * from.rows)];
    const int element = from.lanes * which + lane;
    if (element < last) d_out[(size_t)row * from.stride + element] = from.d_numbers[n];
}

/* Send the numbers of listed elements, in transfers of limited size. from: numbers of all elements, each (rows x
 * lanes). */
static pliant_status send_numbers(const passage &work, const int32_t *which, int32_t count, int rows, int lanes,
                                  const double *from, int last, double *d_out)
{
    if (count == 0) return PLIANT_OK;
    const size_t each = (size_t)rows * (size_t)lanes,
                 maximum = PASSAGE / (each * sizeof(double) + sizeof(int32_t)) / 2 * 2;
    double *h_packed = static_cast<double *>(
        pliant_calloc((size_t)count < maximum ? (size_t)count : maximum, each * sizeof *h_packed));
    if (!h_packed) return pliant_fail_memory("the elements");
    pliant_status status = PLIANT_OK;
    for (size_t done = 0, here; done < (size_t)count && status == PLIANT_OK; done += here) {
        here = (size_t)count - done < maximum ? (size_t)count - done : maximum;
        for (size_t n = 0; n < here; n++)
            memcpy(h_packed + each * n, from + each * (size_t)which[done + n], each * sizeof *from);
        double *d_numbers = static_cast<double *>(work.capacity->d_passage);
        int32_t *d_which = reinterpret_cast<int32_t *>(d_numbers + each * here);
        const packet sent = {(int32_t)here, rows, lanes, work.gpu->tet_stride, d_which, d_numbers};
        status = pliant_cuda_send(h_packed, here * each * sizeof *h_packed, d_numbers, work.stream);
        if (status == PLIANT_OK) status = pliant_cuda_send(which + done, here * sizeof *which, d_which, work.stream);
        if (status != PLIANT_OK) break;
        unpack_kernel<<<blocks_for(here * each, THREADS), THREADS, 0, work.stream>>>(sent, last, d_out);
        status = CUDA_LAUNCHED("unpack_kernel");
    }
    pliant_free(h_packed);
    return status;
}

/* List the entries that differ from the earlier ones. Each entry has `bytes` bytes. */
static int32_t find_changed(const void *now, const void *before, size_t bytes, int32_t count, int32_t count_before,
                            int32_t *which)
{
    int32_t found = 0;
    for (int32_t n = 0; n < count; n++) {
        const size_t at = bytes * (size_t)n;
        if (!before || n >= count_before ||
            memcmp(static_cast<const char *>(now) + at, static_cast<const char *>(before) + at, bytes) != 0)
            which[found++] = n;
    }
    return found;
}

/* List the blocks with changed elements and the new blocks, in ascending order. */
static int32_t list_changed(const passage &work, int lanes, int32_t count, int32_t count_before, int32_t *which)
{
    int32_t found = 0;
    for (int32_t i = 0; i < work.changes->num_touched; i++) {
        const int32_t n = work.changes->touched[i] / lanes;
        if (n < count_before && (found == 0 || which[found - 1] != n)) which[found++] = n;
    }
    for (int32_t n = count_before; n < count; n++) which[found++] = n;
    return found;
}

static pliant_status send_elements(const passage &work, int array, const void *now, const void *before, int rows,
                                   int lanes, double **d_out)
{
    if (!now) return PLIANT_OK;
    const pliant_system *system = work.now;
    const int32_t count = (system->mesh->num_tets + lanes - 1) / lanes,
                  count_before = work.before ? work.before->mesh->num_tets / lanes : 0;
    const size_t bytes = (size_t)rows * (size_t)work.gpu->tet_stride * sizeof(double);
    const bool held = *d_out && work.capacity->bytes[array] >= bytes;
    /* The stride includes reserved capacity. */
    CUDA_TRY(pliant_cuda_ensure(bytes, false, "the elements", d_out, work.capacity->bytes + array));
    int32_t *which = static_cast<int32_t *>(pliant_calloc((size_t)count, sizeof *which));
    if (!which) return pliant_fail_memory("the elements");
    const size_t each = (size_t)rows * (size_t)lanes * sizeof(double);
    const int32_t changed = held && work.changes
                                ? list_changed(work, lanes, count, count_before, which)
                                : find_changed(now, held ? before : nullptr, each, count, count_before, which);
    pliant_status status = send_numbers(work, which, changed, rows, lanes, static_cast<const double *>(now),
                                        system->mesh->num_tets, *d_out);
    pliant_free(which);
    return status;
}

/* ---- The complete system. */

enum {
    TETS,
    REST,
    GRADIENTS,
    LAME,
    STIFFNESS,
    GROUNDED,
    NODE_OF_FREE,
    FREE_OF_NODE,
    CORNER_START,
    CORNER_END,
    CORNER,
    FINE_REST,
    UPSAMPLE_NODE,
    WEIGHTS,
    ENTRY_START,
    ENTRY_ELEMENT,
    ENTRY_SHARE,
    ENTRY_SHAPE,
    STILL
};

static pliant_status send_upsampling(const passage &work)
{
    static const pliant_upsample none = {};
    const pliant_system *now = work.now, *before = work.before;
    const pliant_upsample *up = now->upsample, *was = before && before->upsample ? before->upsample : &none;
    const size_t fine = (size_t)now->fine->num_nodes, fine_was = before ? (size_t)before->fine->num_nodes : 0;
    const size_t corners = (size_t)up->corners, corners_was = (size_t)was->corners;
    gpu_system *gpu = work.gpu;
    const char *what = "the upsampling";
    gpu->corners = up->corners;
    CUDA_TRY(send(work, STILL, up->still, fine, was->still, fine_was, what, &gpu->d_still));
    CUDA_TRY(send(work, UPSAMPLE_NODE, up->start ? nullptr : up->node, corners * fine, was->node,
                  corners_was * fine_was, what, &gpu->d_upsample_node));
    CUDA_TRY(send(work, WEIGHTS, up->start ? nullptr : up->weights, corners * fine, was->weights,
                  corners_was * fine_was, what, &gpu->d_weights));
    if (!up->start) return PLIANT_OK;
    const size_t entries = (size_t)up->start[fine], entries_was = was->start ? (size_t)was->start[fine_was] : 0;
    CUDA_TRY(send(work, ENTRY_START, up->start, fine + 1, was->start, fine_was + 1, what, &gpu->d_entry_start));
    CUDA_TRY(send(work, ENTRY_ELEMENT, up->entry_element, entries, was->entry_element, entries_was, what,
                  &gpu->d_entry_element));
    CUDA_TRY(
        send(work, ENTRY_SHARE, up->entry_weight, entries, was->entry_weight, entries_was, what, &gpu->d_entry_weight));
    return send(work, ENTRY_SHAPE, up->entry_shape, 9 * corners * entries, was->entry_shape,
                9 * corners_was * entries_was, what, &gpu->d_entry_shape);
}

/* Free the tetrahedra of a coarse model that a cut refines. All its elements are macro-elements from then on. */
static void release_tets(gpu_system *gpu)
{
    pliant_cuda_release(gpu->d_tets, gpu->d_gradients, gpu->d_lame, gpu->d_stiffness, gpu->d_grounded);
    gpu->d_tets = nullptr;
    gpu->d_gradients = gpu->d_lame = gpu->d_stiffness = nullptr;
    gpu->d_grounded = nullptr;
}

static pliant_status send_all(const passage &work)
{
    static const pliant_mesh no_mesh = {};
    static const pliant_system none = {};
    const pliant_system *now = work.now, *was = work.before ? work.before : &none;
    const pliant_mesh *mesh = now->mesh, *mesh_was = work.before ? was->mesh : &no_mesh,
                      *fine_was = work.before ? was->fine : &no_mesh;
    gpu_system *gpu = work.gpu;
    const size_t tets = (size_t)mesh->num_tets, free_nodes = (size_t)now->num_free, free_was = (size_t)was->num_free;
    const char *what = "the elements";
    gpu->num_tets = mesh->num_tets;
    gpu->num_nodes = mesh->num_nodes;
    gpu->num_free = now->num_free;
    gpu->num_fine = now->fine->num_nodes;
    gpu->law = now->law;
    if (gpu->num_tets > gpu->tet_stride)
        gpu->tet_stride = work.capacity->grows ? gpu->num_tets + gpu->num_tets / 4 : gpu->num_tets;
    CUDA_TRY(send(work, REST, mesh->rest, 3 * (size_t)mesh->num_nodes, mesh_was->rest, 3 * (size_t)mesh_was->num_nodes,
                  what, &gpu->d_rest));
    CUDA_TRY(send(work, NODE_OF_FREE, now->node_of_free, free_nodes, was->node_of_free, free_was, what,
                  &gpu->d_node_of_free));
    CUDA_TRY(send(work, FREE_OF_NODE, now->is_subdivided ? now->free_of_node : nullptr, (size_t)mesh->num_nodes,
                  was->free_of_node, (size_t)mesh_was->num_nodes, what, &gpu->d_free_of_node));
    CUDA_TRY(send(work, CORNER_START, now->corner_start, free_nodes, was->corner_start, free_was, what,
                  &gpu->d_corner_start));
    CUDA_TRY(send(work, CORNER_END, now->corner_end, free_nodes, was->corner_end, free_was, what, &gpu->d_corner_end));
    CUDA_TRY(send(work, CORNER, now->corner, (size_t)now->num_corners, was->corner, (size_t)was->num_corners, what,
                  &gpu->d_corner));
    if (now->upsample)
        CUDA_TRY(send(work, FINE_REST, now->fine->rest, 3 * (size_t)gpu->num_fine, fine_was->rest,
                      3 * (size_t)fine_was->num_nodes, "the upsampling", &gpu->d_fine_rest));
    if (now->macros) {
        release_tets(gpu);
        CUDA_TRY(pliant_cuda_macros_set(now->macros, work.capacity->grows, work.stream, work.capacity->macros,
                                        &gpu->macros));
        return now->upsample && !now->macros->fine_start ? send_upsampling(work) : PLIANT_OK;
    }
    CUDA_TRY(
        send(work, TETS, mesh->tets, 4 * tets, mesh_was->tets, 4 * (size_t)mesh_was->num_tets, what, &gpu->d_tets));
    CUDA_TRY(send_elements(work, GRADIENTS, now->gradients, was->gradients, 12, LANES, &gpu->d_gradients));
    CUDA_TRY(send_elements(work, LAME, now->lame, was->lame, 2, LANES, &gpu->d_lame));
    CUDA_TRY(send_elements(work, STIFFNESS, now->stiffness, was->stiffness, 144, 1, &gpu->d_stiffness));
    CUDA_TRY(
        send(work, GROUNDED, now->grounded, tets, was->grounded, (size_t)mesh_was->num_tets, what, &gpu->d_grounded));
    return now->upsample ? send_upsampling(work) : PLIANT_OK;
}

pliant_status pliant_cuda_system_create(const pliant_system *system, cudaStream_t stream, gpu_system *out,
                                        gpu_system_capacity *capacity)
{
    gpu_system made = {};
    pliant_status status = pliant_cuda_allocate(PASSAGE, "the elements", &capacity->d_passage);
    if (status == PLIANT_OK) status = send_all({system, nullptr, stream, &made, capacity, nullptr});
    if (status == PLIANT_OK) status = CUDA_CALL(cudaStreamSynchronize(stream));
    if (status != PLIANT_OK) {
        pliant_cuda_system_free(&made, capacity);
        return status;
    }
    if (!capacity->grows) {
        pliant_cuda_release(capacity->d_passage);
        capacity->d_passage = nullptr;
    }
    *out = made;
    return PLIANT_OK;
}

pliant_status pliant_cuda_system_carry_over_cut(const pliant_system *system, const pliant_system *before,
                                                cudaStream_t stream, gpu_system *gpu, gpu_system_capacity *capacity)
{
    return send_all({system, before, stream, gpu, capacity, changes_of(system, before)});
}

void pliant_cuda_system_free(gpu_system *system, gpu_system_capacity *capacity)
{
    pliant_cuda_release(system->d_tets, system->d_rest, system->d_gradients, system->d_lame, system->d_stiffness,
                        system->d_grounded, system->d_node_of_free, system->d_free_of_node, system->d_corner_start,
                        system->d_corner_end, system->d_corner, system->d_fine_rest, system->d_upsample_node,
                        system->d_weights, system->d_entry_start, system->d_entry_element, system->d_entry_weight,
                        system->d_entry_shape, system->d_still, capacity->d_passage);
    pliant_cuda_macros_free(&system->macros);
    memset(system, 0, sizeof *system);
    memset(capacity, 0, sizeof *capacity);
}
