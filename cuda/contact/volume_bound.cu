#include "cuda/contact/volume_bound.h"

#include "contact/volume/volume_rules.h"

#include <cstring>

enum { THREADS = 128, MAY_BE_SMALL = 0, IS_NEAR = 1, NUM_RESULTS };

/* Load the edges of a tetrahedron into lane 0. */
static __device__ __forceinline__ void load_edges(const int4 &tet, const double *positions, pliant_volume_edges out)
{
    const int node[3] = {tet.y, tet.z, tet.w};
    for (int d = 0; d < 3; d++) {
        const double origin = positions[3 * (size_t)tet.x + d];
        for (int k = 0; k < 3; k++) out[k][d][0] = positions[3 * (size_t)node[k] + d] - origin;
    }
}

static __global__ void __launch_bounds__(THREADS)
    volume_kernel(int num_tets, const int4 *tets, const double *rest, const double *from, const double *to,
                  pliant_contact_settings settings, int32_t *any)
{
    const int t = (int)(blockIdx.x * THREADS + threadIdx.x);
    pliant_volume_edges a, b, relaxed;
    bool small = false, near = false;
    if (t < num_tets) {
        const int4 tet = tets[t];
        load_edges(tet, from, a);
        load_edges(tet, to, b);
        load_edges(tet, rest, relaxed);
        small = pliant_volume_may_be_small(settings.advance_keep, settings.volume_stop, a, b, relaxed, 0);
        near = pliant_volume_is_below(settings.volume_near, b, relaxed, 0);
    }
    small = __syncthreads_or(small);
    near = __syncthreads_or(near);
    if (threadIdx.x == 0 && small) any[MAY_BE_SMALL] = 1;
    if (threadIdx.x == 0 && near) any[IS_NEAR] = 1;
}

extern "C" void pliant_cuda_volume_free(gpu_volume_bound *bound)
{
    pliant_cuda_release(bound->d_tets);
    pliant_cuda_release(bound->d_rest);
    pliant_cuda_release(bound->d_from);
    pliant_cuda_release(bound->d_any);
    pliant_cuda_release_host(bound->h_any);
    memset(bound, 0, sizeof *bound);
}

extern "C" pliant_status pliant_cuda_volume_set_body(gpu_volume_bound *bound, const pliant_body *body,
                                                     cudaStream_t stream)
{
    const pliant_mesh *mesh = &body->fine;
    const char *what = "the volume bound";
    const size_t tets = 4 * (size_t)mesh->num_tets * sizeof *mesh->tets,
                 nodes = 3 * (size_t)mesh->num_nodes * sizeof *mesh->rest, results = NUM_RESULTS * sizeof(int32_t);
    if (bound->revision == body->revision) return PLIANT_OK;
    bound->revision = 0;
    bound->has_from = bound->has_near = false;
    if (!bound->d_any) CUDA_TRY(pliant_cuda_allocate(results, what, reinterpret_cast<void **>(&bound->d_any)));
    if (!bound->h_any) CUDA_TRY(pliant_cuda_allocate_host(results, what, reinterpret_cast<void **>(&bound->h_any)));
    CUDA_TRY(pliant_cuda_ensure(tets, true, what, &bound->d_tets, &bound->tets_capacity));
    CUDA_TRY(pliant_cuda_ensure(nodes, true, what, &bound->d_rest, &bound->rest_capacity));
    CUDA_TRY(pliant_cuda_ensure(nodes, true, what, &bound->d_from, &bound->from_capacity));
    CUDA_TRY(CUDA_CALL(cudaMemcpyAsync(bound->d_tets, mesh->tets, tets, cudaMemcpyHostToDevice, stream)));
    CUDA_TRY(CUDA_CALL(cudaMemcpyAsync(bound->d_rest, mesh->rest, nodes, cudaMemcpyHostToDevice, stream)));
    bound->num_tets = mesh->num_tets;
    bound->revision = body->revision;
    return PLIANT_OK;
}

extern "C" pliant_status pliant_cuda_volume_begin_leg(gpu_volume_bound *bound, const double *d_positions,
                                                      size_t num_nodes, cudaStream_t stream)
{
    CUDA_TRY(CUDA_CALL(cudaMemcpyAsync(bound->d_from, d_positions, 3 * num_nodes * sizeof *d_positions,
                                       cudaMemcpyDeviceToDevice, stream)));
    bound->has_from = true;
    return PLIANT_OK;
}

extern "C" pliant_status pliant_cuda_volume_enqueue(gpu_volume_bound *bound, const pliant_contact_settings *settings,
                                                    bool is_still, const double *d_positions, cudaStream_t stream)
{
    const size_t results = NUM_RESULTS * sizeof *bound->d_any;
    const unsigned blocks = (unsigned)((bound->num_tets + THREADS - 1) / THREADS);
    CUDA_TRY(CUDA_CALL(cudaMemsetAsync(bound->d_any, 0, results, stream)));
    volume_kernel<<<blocks, THREADS, 0, stream>>>(
        bound->num_tets, static_cast<const int4 *>(bound->d_tets), static_cast<const double *>(bound->d_rest),
        is_still ? d_positions : static_cast<const double *>(bound->d_from), d_positions, *settings, bound->d_any);
    CUDA_TRY(CUDA_LAUNCHED("volume_kernel"));
    CUDA_TRY(CUDA_CALL(cudaMemcpyAsync(bound->h_any, bound->d_any, results, cudaMemcpyDeviceToHost, stream)));
    bound->is_enqueued = !is_still;
    return PLIANT_OK;
}

extern "C" pliant_status pliant_cuda_volume_finish(gpu_volume_bound *bound, cudaStream_t stream, bool *may_be_small)
{
    CUDA_TRY(CUDA_CALL(cudaStreamSynchronize(stream)));
    *may_be_small = bound->h_any[MAY_BE_SMALL];
    bound->is_near = bound->h_any[IS_NEAR];
    bound->has_near = true;
    return PLIANT_OK;
}
