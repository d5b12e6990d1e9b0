#include "cuda/contact/near_triangles.h"

#include "base/buffer.h"
#include "base/fail.h"
#include "base/memory.h"
#include "cuda/base/launch.h"

#include <cmath>
#include <cstring>

enum { THREADS = 128, WORD = 32 /* bits of a word of the mask; threads of a warp */ };

/* Pointers are device pointers. */
struct near_view {
    int num_triangles, num_regions;
    const int32_t *triangles;
    const int4 *nodes;
    const double *weights;
    const pliant_near_region *regions;
};

/* Enlarge a box so that it contains a corner. */
static __device__ __forceinline__ void add_corner(const int4 &node, const double *weight, const double *positions,
                                                  double low[3], double high[3])
{
    for (int d = 0; d < 3; d++) {
        const double x = weight[0] * positions[3 * (size_t)node.x + d] + weight[1] * positions[3 * (size_t)node.y + d] +
                         weight[2] * positions[3 * (size_t)node.z + d] + weight[3] * positions[3 * (size_t)node.w + d];
        low[d] = x < low[d] ? x : low[d];
        high[d] = x > high[d] ? x : high[d];
    }
}

static __global__ void __launch_bounds__(THREADS)
    near_kernel(near_view view, const double *from, const double *to, uint32_t *mask)
{
    const int t = (int)(blockIdx.x * THREADS + threadIdx.x);
    bool near = false;
    if (t < view.num_triangles) {
        double low[3] = {INFINITY, INFINITY, INFINITY}, high[3] = {-INFINITY, -INFINITY, -INFINITY};
        for (int c = 0; c < 3; c++) {
            const int corner = view.triangles[3 * (size_t)t + c];
            const int4 node = view.nodes[corner];
            const double *weight = view.weights + 4 * (size_t)corner;
            add_corner(node, weight, to, low, high);
            if (from != to) add_corner(node, weight, from, low, high);
        }
        for (int r = 0; r < view.num_regions && !near; r++) near = !pliant_near_is_apart(view.regions + r, low, high);
    }
    const uint32_t bits = __ballot_sync(0xffffffff, near);
    if (threadIdx.x % WORD == 0 && t < view.num_triangles) mask[t / WORD] = bits;
}

extern "C" void pliant_cuda_near_free(gpu_near *near)
{
    for (void *block : near->d_block) pliant_cuda_release(block);
    pliant_cuda_release_host(near->mask);
    pliant_free(near->triangle);
    memset(near, 0, sizeof *near);
}

/* Host arrays of the surface before they are sent. */
struct packed {
    int32_t count, *corner_of_node, *triangles, *node;
    double *weight;
};

static void release(packed *of)
{
    pliant_free(of->corner_of_node);
    pliant_free(of->triangles);
    pliant_free(of->node);
    pliant_free(of->weight);
}

/* Number the corners, and list the nodes that move them. Errors: MEMORY. */
static pliant_status pack(const pliant_near_surface *surface, packed *out)
{
    const pliant_body *body = surface->body;
    const size_t nodes = (size_t)body->fine.num_nodes, all = 3 * (size_t)body->num_triangles,
                 most = all < nodes ? all : nodes;
    out->corner_of_node = static_cast<int32_t *>(pliant_calloc(nodes, sizeof *out->corner_of_node));
    out->triangles = static_cast<int32_t *>(pliant_calloc(all, sizeof *out->triangles));
    out->node = static_cast<int32_t *>(pliant_calloc(4 * most, sizeof *out->node));
    out->weight = static_cast<double *>(pliant_calloc(4 * most, sizeof *out->weight));
    if (!out->corner_of_node || !out->triangles || !out->node || !out->weight) return pliant_fail_memory("contacts");
    for (size_t c = 0; c < all; c++) {
        const int32_t node = body->triangles[c];
        int32_t *corner = out->corner_of_node + node; /* plus 1 */
        if (*corner == 0) {
            int32_t *support = out->node + 4 * (size_t)out->count;
            double *weight = out->weight + 4 * (size_t)out->count;
            for (int k = 0; k < 4; k++) support[k] = node;
            weight[0] = 1;
            if (surface->corners) pliant_contact_surface_support(surface->corners, node, support, weight);
            *corner = ++out->count;
        }
        out->triangles[c] = *corner - 1;
    }
    return PLIANT_OK;
}

static pliant_status send(gpu_near *near, int block, const void *h_from, size_t bytes, cudaStream_t stream)
{
    CUDA_TRY(pliant_cuda_ensure(bytes, true, "contacts", near->d_block + block, near->capacity + block));
    return pliant_cuda_send(h_from, bytes, near->d_block[block], stream);
}

static pliant_status send_surface(gpu_near *near, const packed *from, int32_t num_triangles, cudaStream_t stream)
{
    const size_t corners = 4 * (size_t)from->count;
    CUDA_TRY(send(near, NEAR_TRIANGLES, from->triangles, 3 * (size_t)num_triangles * sizeof *from->triangles, stream));
    CUDA_TRY(send(near, NEAR_NODES, from->node, corners * sizeof *from->node, stream));
    CUDA_TRY(send(near, NEAR_WEIGHTS, from->weight, corners * sizeof *from->weight, stream));
    if (num_triangles > near->triangle_capacity) {
        if (!pliant_grow(&near->triangle, (size_t)num_triangles, sizeof *near->triangle))
            return pliant_fail_memory("contacts");
        near->triangle_capacity = num_triangles;
    }
    const int32_t words = (num_triangles + WORD - 1) / WORD;
    if (words <= near->mask_capacity) return PLIANT_OK;
    pliant_cuda_release_host(near->mask);
    near->mask = nullptr;
    near->mask_capacity = 0;
    CUDA_TRY(pliant_cuda_allocate_host((size_t)words * sizeof *near->mask, "contacts", &near->mask));
    near->mask_capacity = words;
    return PLIANT_OK;
}

extern "C" pliant_status pliant_cuda_near_set_surface(gpu_near *near, const pliant_near_surface *surface,
                                                      cudaStream_t stream)
{
    const pliant_body *body = surface->body;
    if (near->revision == body->revision) return PLIANT_OK;
    near->revision = 0;
    packed from = {};
    pliant_status status = body->num_triangles > 0 ? pack(surface, &from) : PLIANT_OK;
    if (status == PLIANT_OK && body->num_triangles > 0)
        status = send_surface(near, &from, body->num_triangles, stream);
    release(&from);
    if (status != PLIANT_OK) return status;
    near->num_triangles = body->num_triangles;
    near->revision = body->revision;
    return PLIANT_OK;
}

/* List the bits that are set. */
static int32_t list_bits(const gpu_near *near)
{
    int32_t count = 0;
    for (int32_t w = 0; w < (near->num_triangles + WORD - 1) / WORD; w++)
        for (uint32_t bits = near->mask[w]; bits != 0; bits &= bits - 1)
            near->triangle[count++] = WORD * w + __builtin_ctz(bits);
    return count;
}

extern "C" pliant_status pliant_cuda_near_find(gpu_near *near, const double *d_from, const double *d_to, int32_t count,
                                               const pliant_near_region *regions, cudaStream_t stream,
                                               pliant_triangle_list *out)
{
    out->count = 0;
    out->triangle = near->triangle;
    if (near->num_triangles == 0 || count == 0) return PLIANT_OK;
    CUDA_TRY(send(near, NEAR_REGIONS, regions, (size_t)count * sizeof *regions, stream));
    const near_view view = {near->num_triangles,
                            count,
                            static_cast<const int32_t *>(near->d_block[NEAR_TRIANGLES]),
                            static_cast<const int4 *>(near->d_block[NEAR_NODES]),
                            static_cast<const double *>(near->d_block[NEAR_WEIGHTS]),
                            static_cast<const pliant_near_region *>(near->d_block[NEAR_REGIONS])};
    near_kernel<<<blocks_for(near->num_triangles, THREADS), THREADS, 0, stream>>>(view, d_from, d_to, near->mask);
    CUDA_TRY(CUDA_LAUNCHED("near_kernel"));
    CUDA_TRY(CUDA_CALL(cudaStreamSynchronize(stream)));
    out->count = list_bits(near);
    return PLIANT_OK;
}
