#include "check.h"
#include "base/fail.h"
#include "system.h"

#include <cstring>
#include <new>
#include <vector>

template <class T> static pliant_status upload(const T *h_from, size_t count, const char *what, cudaStream_t stream, T **d_out)
{
    if (!h_from) return PLIANT_OK;
    void *block;
    CUDA_TRY(pliant_cuda_upload(h_from, count * sizeof(T), what, stream, &block));
    *d_out = static_cast<T *>(block);
    return PLIANT_OK;
}

/* lanes of 8 on the CPU; one number after the other over all elements on the GPU */
template <int ROWS>
static pliant_status upload_lanes(double (*blocks)[ROWS][LANES], int32_t num_tets, const char *what, cudaStream_t stream, double **d_out)
{
    try {
        std::vector<double> flat((size_t)ROWS * (size_t)num_tets);
        for (int32_t t = 0; t < num_tets; t++)
            for (int m = 0; m < ROWS; m++) flat[(size_t)m * (size_t)num_tets + (size_t)t] = blocks[t / LANES][m][t % LANES];
        return upload(flat.data(), flat.size(), what, stream, d_out);
    } catch (const std::bad_alloc &) {
        return pliant_fail_memory(what);
    }
}

static pliant_status upload_stiffness(const pliant_system *system, cudaStream_t stream, double **d_out)
{
    if (!system->stiffness) return PLIANT_OK;
    size_t count = (size_t)system->mesh->num_tets;
    try {
        std::vector<double> flat(144 * count);
        for (size_t t = 0; t < count; t++)
            for (size_t m = 0; m < 144; m++) flat[m * count + t] = system->stiffness[144 * t + m];
        return upload(flat.data(), flat.size(), "the homogenized elements", stream, d_out);
    } catch (const std::bad_alloc &) {
        return pliant_fail_memory("the homogenized elements");
    }
}

static pliant_status upload_weights(const pliant_system *system, cudaStream_t stream, gpu_system *out)
{
    const pliant_upsample *upsample = system->upsample;
    const size_t fine = (size_t)system->fine->num_nodes;
    const char *what = "the upsampling";
    out->corners = upsample->corners;
    CUDA_TRY(upload(upsample->still, fine, what, stream, &out->d_still));
    CUDA_TRY(upload(upsample->node, (size_t)upsample->corners * fine, what, stream, &out->d_upsample_node));
    return upload(upsample->weights, (size_t)upsample->corners * fine, what, stream, &out->d_weights);
}

static pliant_status fill(const pliant_system *system, cudaStream_t stream, gpu_system *out)
{
    const pliant_mesh *mesh = system->mesh;
    const size_t tets = (size_t)mesh->num_tets, nodes = (size_t)mesh->num_nodes, free_nodes = (size_t)system->num_free;
    const char *what = "the elements";
    CUDA_TRY(upload(mesh->rest, 3 * nodes, what, stream, &out->d_rest));
    CUDA_TRY(upload(system->node_of_free, free_nodes, what, stream, &out->d_node_of_free));
    CUDA_TRY(upload(system->corner_start, free_nodes + 1, what, stream, &out->d_corner_start));
    CUDA_TRY(upload(system->corner, (size_t)system->corner_start[free_nodes], what, stream, &out->d_corner));
    const pliant_upsample *upsample = system->upsample;
    const size_t fine = (size_t)system->fine->num_nodes;
    if (upsample) CUDA_TRY(upload(system->fine->rest, 3 * fine, "the upsampling", stream, &out->d_fine_rest));
    if (system->macros) {
        CUDA_TRY(pliant_cuda_macros_create(system->macros, stream, &out->macros));
        return upsample && !system->macros->fine_start ? upload_weights(system, stream, out) : PLIANT_OK;
    }
    CUDA_TRY(upload(mesh->tets, 4 * tets, what, stream, &out->d_tets));
    CUDA_TRY(upload_lanes<12>(system->gradients, mesh->num_tets, what, stream, &out->d_gradients));
    if (system->lame) CUDA_TRY(upload_lanes<2>(system->lame, mesh->num_tets, what, stream, &out->d_lame));
    CUDA_TRY(upload_stiffness(system, stream, &out->d_stiffness));
    CUDA_TRY(upload(system->grounded, tets, what, stream, &out->d_grounded));
    if (!upsample) return PLIANT_OK;
    if (!upsample->start) return upload_weights(system, stream, out);
    what = "the upsampling";
    CUDA_TRY(upload(upsample->still, fine, what, stream, &out->d_still));
    const size_t entries = (size_t)upsample->start[fine];
    CUDA_TRY(upload(upsample->start, fine + 1, what, stream, &out->d_entry_start));
    CUDA_TRY(upload(upsample->entry_tet, entries, what, stream, &out->d_entry_tet));
    CUDA_TRY(upload(upsample->entry_share, entries, what, stream, &out->d_entry_share));
    return upload(upsample->entry_shape, 36 * entries, what, stream, &out->d_entry_shape);
}

extern "C" pliant_status pliant_cuda_system_create(const pliant_system *system, cudaStream_t stream, gpu_system *out)
{
    gpu_system made = {};
    made.num_tets = system->mesh->num_tets;
    made.num_nodes = system->mesh->num_nodes;
    made.num_free = system->num_free;
    made.num_fine = system->fine->num_nodes;
    pliant_status status = fill(system, stream, &made);
    if (status != PLIANT_OK) {
        pliant_cuda_system_free(&made);
        return status;
    }
    *out = made;
    return PLIANT_OK;
}

extern "C" void pliant_cuda_system_free(gpu_system *system)
{
    void *blocks[] = {system->d_tets, system->d_rest, system->d_gradients, system->d_lame, system->d_stiffness, system->d_grounded,
                      system->d_node_of_free, system->d_corner_start, system->d_corner, system->d_fine_rest, system->d_upsample_node,
                      system->d_weights, system->d_entry_start, system->d_entry_tet, system->d_entry_share, system->d_entry_shape,
                      system->d_still};
    for (void *block : blocks) pliant_cuda_release(block);
    pliant_cuda_macros_free(&system->macros);
    memset(system, 0, sizeof *system);
}
