/* GPU search for contacts of tissue on tissue. Data that depend on the topology are sent once. In a step, positions
 * are uploaded and contacts are downloaded. */
#include "cuda/contact/tissue.h"

#include "cuda/base/check.h"
#include "contact/detect/tissue_rules.h"
#include "cuda/base/device.h"
#include "cuda/contact/overlaps.cuh"
#include "cuda/contact/self_pairs.h"
#include "base/fail.h"
#include "base/memory.h"

#include <cstring>

namespace {

enum { THREADS = 64, WARP = 32 };

/* Contacts of one node. */
struct found { int32_t index, count; pliant_node_contact node_contacts[PLIANT_MAX_NODE_CONTACTS]; };

struct gpu_tissue {
    int device;
    cudaStream_t stream;
    uint64_t revision;         /* of the topology; 0: none */
    const pliant_body *body;   /* previous topology, only for comparison */
    gpu_overlaps *overlaps;
    gpu_self_pairs *pairs;     /* Nullable: not used yet for this topology */
    pliant_tissue_view view;   /* pointers of the device */
    int32_t num_nodes, num_triangles;
    size_t positions_bytes, last_bytes, normals_bytes;
    double *d_positions, (*d_normal)[3], *h_normal;
    int32_t *d_last, *d_count, *d_num_found, *h_num_found;
    pliant_node_contact *d_touching;
    found *d_found, *h_found;  /* (num_nodes) */
    void *of_body[12];         /* buffers of the device */
    int32_t num_blocks;
};

/* ---- kernels */

__global__ void __launch_bounds__(THREADS) normal_kernel(pliant_tissue_view on, int32_t count)
{
    const int32_t s = (int32_t)(blockIdx.x * THREADS + threadIdx.x);
    if (s < count) pliant_tissue_set_normal(&on, s);
}

/* Return the next tetrahedron after `last` whose box contains a point, of one list of the grid, or INT32_MAX. Each
 * thread of the warp tests a part of the list. */
__device__ int32_t next_around(const overlaps::view &v, const double *point, uint32_t list, unsigned long long key,
                               int32_t last)
{
    const int32_t end = v.start[list] + v.length[list];
    int32_t next = INT32_MAX;
    for (int32_t k = v.start[list] + (int32_t)threadIdx.x % WARP; k < end; k += WARP) {
        const int32_t i = v.entries[k].tet;
        if (i > last && i < next && v.entries[k].cell == key &&
            pliant_tissue_is_in_box(point, v.box[i].low, v.box[i].high))
            next = i;
    }
    for (int lanes = WARP / 2; lanes > 0; lanes /= 2) next = min(next, __shfl_xor_sync(0xffffffffu, next, lanes));
    return next;
}

/* Test one triangle with each thread of the warp (-1: none), and add the contacts in the order of the threads. */
__device__ void try_triangles(const pliant_tissue_view &on, int32_t index, int32_t triangle)
{
    pliant_node_contact one;
    const bool touches = triangle >= 0 && pliant_tissue_test_triangle(&on, index, triangle, &one);
    for (unsigned left = __ballot_sync(0xffffffffu, touches); left != 0; left &= left - 1) {
        if ((int)threadIdx.x % WARP == __ffs((int)left) - 1) pliant_tissue_add_contact(&on, index, &one);
        __syncwarp();
    }
}

/* Test the triangles of all tetrahedra whose boxes contain a node, in the CPU's order, with one warp. */
__device__ void look_around(const pliant_tissue_view &on, const overlaps::view &v, int32_t index)
{
    const double *point = pliant_tissue_position(&on, on.node[index]), side = v.now->side;
    if (!isfinite(point[0] + point[1] + point[2])) return;
    const int32_t cell[3] = {overlaps::cell_of(side, point[0]), overlaps::cell_of(side, point[1]),
                             overlaps::cell_of(side, point[2])};
    const uint32_t list = overlaps::hash_of(v, cell[0], cell[1], cell[2]);
    const unsigned long long key = overlaps::key_of(cell[0], cell[1], cell[2]);
    int32_t own = -1, count = 0; /* triangles that wait: each thread's own one, and their number */
    for (int32_t tet = -1; tet < INT32_MAX;) {
        tet = next_around(v, point, list, key, tet);
        const bool ends = tet == INT32_MAX;
        const int32_t first = ends ? 0 : on.triangle_start[tet], number = ends ? 0 : on.triangle_start[tet + 1] - first;
        if (ends || count + number > WARP) {
            try_triangles(on, index, own);
            own = -1;
            count = 0;
        }
        const int32_t place = (int32_t)threadIdx.x % WARP - count;
        if (place >= 0 && place < number) own = first + place;
        count += number;
    }
}

/* One warp for each node. */
__global__ void __launch_bounds__(THREADS)
    node_kernel(pliant_tissue_view on, overlaps::view v, int32_t count, found *d_found, int32_t *d_num_found)
{
    const int32_t index = (int32_t)(blockIdx.x * THREADS + threadIdx.x) / WARP, lane = (int32_t)threadIdx.x % WARP;
    if (index >= count || !overlaps::are_whole(v)) return;
    if (lane == 0) on.count[index] = 0;
    __syncwarp();
    look_around(on, v, index);
    if (lane != 0) return;
    pliant_tissue_try_last(&on, index);
    if (on.count[index] == 0) return;
    found *out = d_found + atomicAdd(d_num_found, 1); /* the order varies, but each result names its node */
    out->index = index;
    out->count = on.count[index];
    for (int32_t k = 0; k < out->count; k++)
        out->node_contacts[k] = on.node_contacts[PLIANT_MAX_NODE_CONTACTS * (size_t)index + (size_t)k];
}

/* ---- topology */

void forget_body(gpu_tissue *gpu)
{
    gpu_overlaps_free(gpu->overlaps);
    gpu_self_pairs_free(gpu->pairs);
    for (int32_t b = 0; b < gpu->num_blocks; b++) pliant_cuda_release(gpu->of_body[b]);
    void *blocks[] = {gpu->d_positions, gpu->d_normal,    gpu->d_last, gpu->d_count,
                      gpu->d_touching,  gpu->d_num_found, gpu->d_found};
    for (void *block : blocks) pliant_cuda_release(block);
    void *h_blocks[] = {gpu->h_normal, gpu->h_num_found, gpu->h_found};
    for (void *block : h_blocks) pliant_cuda_release_host(block);
    const int device = gpu->device;
    const cudaStream_t stream = gpu->stream;
    memset(gpu, 0, sizeof *gpu);
    gpu->device = device;
    gpu->stream = stream;
}

template <class T> pliant_status send(gpu_tissue *gpu, size_t count, const T **array)
{
    if (!*array || count == 0) return PLIANT_OK;
    void *d_block = NULL;
    CUDA_TRY(pliant_cuda_upload(*array, count * sizeof(T), "the surface", gpu->stream, &d_block));
    gpu->of_body[gpu->num_blocks++] = d_block;
    *array = static_cast<const T *>(d_block);
    return PLIANT_OK;
}

/* Return the mean size of the boxes at rest, as the side of the cells. */
double side_of(const pliant_tissue *tissue)
{
    const pliant_mesh *mesh = &tissue->body->fine;
    double sum = 0;
    for (int32_t i = 0; i < tissue->num_tets; i++) {
        const int32_t *node = mesh->tets + 4 * (size_t)tissue->tet[i];
        double size = 0;
        for (int d = 0; d < 3; d++) {
            double low = INFINITY, high = -INFINITY;
            for (int k = 0; k < 4; k++) {
                low = fmin(low, mesh->rest[3 * (size_t)node[k] + (size_t)d]);
                high = fmax(high, mesh->rest[3 * (size_t)node[k] + (size_t)d]);
            }
            size = fmax(size, high - low);
        }
        sum += size;
    }
    return sum / tissue->num_tets;
}

pliant_status set_body(gpu_tissue *gpu, pliant_tissue *tissue)
{
    const pliant_mesh *mesh = &tissue->body->fine;
    const size_t nodes = (size_t)tissue->num_nodes, tets = (size_t)mesh->num_tets, all = (size_t)mesh->num_nodes,
                 triangles = (size_t)tissue->num_triangles;
    const pliant_tissue_rule none = {};
    pliant_tissue_view view = pliant_tissue_view_of(tissue, NULL, &none);
    forget_body(gpu);
    CUDA_TRY(gpu_overlaps_create(mesh->num_tets, mesh->tets, tissue->num_tets, tissue->tet, 1.2 * side_of(tissue),
                                 gpu->stream, &gpu->overlaps));
    view.tets = gpu_overlaps_view(gpu->overlaps).tets;
    CUDA_TRY(send(gpu, 4 * tets, &view.across));
    CUDA_TRY(send(gpu, tets, &view.is_candidate));
    CUDA_TRY(send(gpu, all, &view.fixed));
    CUDA_TRY(send(gpu, all, &view.node_parent));
    CUDA_TRY(send(gpu, all, &view.piece));
    CUDA_TRY(send(gpu, triangles, &view.triangle));
    CUDA_TRY(send(gpu, (size_t)tissue->num_tets + 1, &view.triangle_start));
    CUDA_TRY(send(gpu, nodes, &view.node));
    CUDA_TRY(send(gpu, (size_t)tissue->around_start[nodes], &view.around));
    CUDA_TRY(send(gpu, nodes + 1, &view.around_start));
    CUDA_TRY(send(gpu, (size_t)tissue->node_triangle_start[nodes], &view.node_triangles));
    CUDA_TRY(send(gpu, nodes + 1, &view.node_triangle_start));
    gpu->positions_bytes = 3 * all * sizeof *gpu->d_positions;
    gpu->last_bytes = nodes * sizeof *gpu->d_last;
    gpu->normals_bytes = triangles * sizeof *gpu->d_normal;
    CUDA_TRY(pliant_cuda_allocate(gpu->positions_bytes, "the surface", (void **)&gpu->d_positions));
    CUDA_TRY(pliant_cuda_allocate(gpu->last_bytes, "the surface", (void **)&gpu->d_last));
    CUDA_TRY(pliant_cuda_allocate(gpu->normals_bytes, "the surface", (void **)&gpu->d_normal));
    CUDA_TRY(pliant_cuda_allocate(nodes * sizeof *gpu->d_count, "the surface", (void **)&gpu->d_count));
    CUDA_TRY(pliant_cuda_allocate(PLIANT_MAX_NODE_CONTACTS * nodes * sizeof *gpu->d_touching, "the surface",
                                  (void **)&gpu->d_touching));
    CUDA_TRY(pliant_cuda_allocate(sizeof *gpu->d_num_found, "the surface", (void **)&gpu->d_num_found));
    CUDA_TRY(pliant_cuda_allocate(nodes * sizeof *gpu->d_found, "the surface", (void **)&gpu->d_found));
    CUDA_TRY(pliant_cuda_allocate_host(gpu->normals_bytes, "the surface", (void **)&gpu->h_normal));
    CUDA_TRY(pliant_cuda_allocate_host(sizeof *gpu->h_num_found, "the surface", (void **)&gpu->h_num_found));
    CUDA_TRY(pliant_cuda_allocate_host(nodes * sizeof *gpu->h_found, "the surface", (void **)&gpu->h_found));
    view.positions = gpu->d_positions;
    view.last = gpu->d_last;
    view.normal = gpu->d_normal;
    view.count = gpu->d_count;
    view.node_contacts = gpu->d_touching;
    gpu->view = view;
    gpu->num_nodes = tissue->num_nodes;
    gpu->num_triangles = tissue->num_triangles;
    gpu->revision = tissue->revision;
    gpu->body = tissue->body;
    return PLIANT_OK;
}

/* ---- step */

unsigned blocks_for(int32_t count) { return (unsigned)((count + THREADS - 1) / THREADS); }

pliant_status enqueue(void *context, gpu_overlaps *of)
{
    gpu_tissue *gpu = static_cast<gpu_tissue *>(context);
    CUDA_TRY(CUDA_CALL(cudaMemsetAsync(gpu->d_num_found, 0, sizeof *gpu->d_num_found, gpu->stream)));
    normal_kernel<<<blocks_for(gpu->num_triangles), THREADS, 0, gpu->stream>>>(gpu->view, gpu->num_triangles);
    CUDA_TRY(CUDA_LAUNCHED("normal_kernel"));
    node_kernel<<<blocks_for(WARP * gpu->num_nodes), THREADS, 0, gpu->stream>>>(
        gpu->view, gpu_overlaps_view(of), gpu->num_nodes, gpu->d_found, gpu->d_num_found);
    CUDA_TRY(CUDA_LAUNCHED("node_kernel"));
    CUDA_TRY(CUDA_CALL(
        cudaMemcpyAsync(gpu->h_normal, gpu->d_normal, gpu->normals_bytes, cudaMemcpyDeviceToHost, gpu->stream)));
    return CUDA_CALL(cudaMemcpyAsync(gpu->h_num_found, gpu->d_num_found, sizeof *gpu->h_num_found,
                                     cudaMemcpyDeviceToHost, gpu->stream));
}

/* Copy normals and contacts to the host's data. */
pliant_status take(gpu_tissue *gpu, pliant_tissue *tissue)
{
    const size_t count = (size_t)*gpu->h_num_found;
    memcpy(tissue->normal, gpu->h_normal, gpu->normals_bytes);
    memset(tissue->count, 0, (size_t)tissue->num_nodes * sizeof *tissue->count);
    if (count == 0) return PLIANT_OK;
    CUDA_TRY(CUDA_CALL(cudaMemcpyAsync(gpu->h_found, gpu->d_found, count * sizeof *gpu->h_found, cudaMemcpyDeviceToHost,
                                       gpu->stream)));
    CUDA_TRY(CUDA_CALL(cudaStreamSynchronize(gpu->stream)));
    for (size_t n = 0; n < count; n++) {
        const found *one = gpu->h_found + n;
        tissue->count[one->index] = one->count;
        memcpy(tissue->node_contacts + PLIANT_MAX_NODE_CONTACTS * (size_t)one->index, one->node_contacts,
               (size_t)one->count * sizeof *one->node_contacts);
    }
    return PLIANT_OK;
}

pliant_status find(gpu_tissue *gpu, pliant_tissue *tissue, const double *positions, const pliant_tissue_rule *rule)
{
    int32_t *pair;
    const double margin = rule ? fmax(rule->margin, rule->max_piece_motion) : 0;
    CUDA_TRY(CUDA_CALL(cudaSetDevice(gpu->device)));
    if (gpu->revision != tissue->revision || gpu->body != tissue->body) CUDA_TRY(set_body(gpu, tissue));
    CUDA_TRY(CUDA_CALL(
        cudaMemcpyAsync(gpu->d_positions, positions, gpu->positions_bytes, cudaMemcpyHostToDevice, gpu->stream)));
    if (rule) {
        gpu->view.rule = *rule;
        gpu->view.settings = *rule->settings;
        CUDA_TRY(CUDA_CALL(
            cudaMemcpyAsync(gpu->d_last, tissue->last, gpu->last_bytes, cudaMemcpyHostToDevice, gpu->stream)));
    }
    CUDA_TRY(gpu_overlaps_find(gpu->overlaps, gpu->d_positions, margin, gpu->stream, rule ? enqueue : NULL, gpu,
                               &tissue->num_overlaps));
    CUDA_TRY(pliant_grid_take_pairs(&tissue->grid, tissue->num_overlaps, &pair));
    CUDA_TRY(gpu_overlaps_get_pairs(gpu->overlaps, gpu->stream, pair));
    return rule ? take(gpu, tissue) : PLIANT_OK;
}

pliant_status create(gpu_tissue *gpu)
{
    CUDA_TRY(pliant_cuda_current_device(&gpu->device));
    CUDA_TRY(CUDA_CALL(cudaSetDevice(gpu->device)));
    return CUDA_CALL(cudaStreamCreateWithFlags(&gpu->stream, cudaStreamNonBlocking));
}

void destroy(void *state)
{
    gpu_tissue *gpu = static_cast<gpu_tissue *>(state);
    if (!gpu) return;
    cudaSetDevice(gpu->device);
    if (gpu->stream) cudaStreamSynchronize(gpu->stream);
    forget_body(gpu);
    if (gpu->stream) cudaStreamDestroy(gpu->stream);
    cudaGetLastError();
    pliant_free(gpu);
}

pliant_status search(void **state, pliant_tissue *tissue, const double *positions, const pliant_tissue_rule *rule)
{
    if (!*state) {
        gpu_tissue *made = static_cast<gpu_tissue *>(pliant_calloc(1, sizeof *made));
        if (!made) return pliant_fail(PLIANT_ERROR_MEMORY, "out of memory: the self-contacts of the tissue");
        *state = made;
        CUDA_TRY(create(made));
    }
    return find(static_cast<gpu_tissue *>(*state), tissue, positions, rule);
}

pliant_status list_pairs(void *state, pliant_tissue *tissue, const pliant_advance_self *self)
{
    gpu_tissue *gpu = static_cast<gpu_tissue *>(state);
    pliant_advance *advance = tissue->advance;
    CUDA_TRY(CUDA_CALL(cudaSetDevice(gpu->device)));
    if (!gpu->pairs) {
        CUDA_TRY(pliant_advance_tree_set(&advance->tree, tissue->num_triangles, tissue->triangles, self->rest));
        CUDA_TRY(gpu_self_pairs_create(&advance->tree, tissue->body->fine.num_nodes, self->exempt, self->piece,
                                       gpu->stream, &gpu->pairs));
    }
    return gpu_self_pairs_find(gpu->pairs, gpu->d_positions, self->thickness, gpu->stream, advance, tissue->exempt);
}

} // namespace

const pliant_tissue_searcher pliant_cuda_tissue_searcher = {search, list_pairs, destroy};
