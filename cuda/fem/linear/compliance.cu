#include "cuda/fem/linear/compliance.h"

#include "base/fail.h"
#include "cuda/base/check.h"
#include "base/memory.h"

#include <algorithm>
#include <cstring>

static void free_slots(gpu_compliance_columns *blocks)
{
    pliant_free(blocks->unknown);
    pliant_free(blocks->last_use);
    pliant_cuda_release(blocks->d_column);
    pliant_cuda_release(blocks->d_which);
    pliant_cuda_release_host(blocks->h_which);
}

void pliant_cuda_compliance_free(gpu_compliance_columns *blocks)
{
    free_slots(blocks);
    pliant_free(blocks->slot);
    memset(blocks, 0, sizeof *blocks);
}

void pliant_cuda_compliance_discard(gpu_compliance_columns *blocks)
{
    for (int32_t s = 0; s < blocks->capacity; s++) {
        if (blocks->unknown[s] >= 0) blocks->slot[blocks->unknown[s]] = -1;
        blocks->unknown[s] = -1;
    }
}

static pliant_status set_size(gpu_compliance_columns *blocks, int32_t num_free)
{
    if (blocks->num_free == num_free) return PLIANT_OK;
    pliant_cuda_compliance_free(blocks);
    if (!(blocks->slot = static_cast<int32_t *>(pliant_calloc((size_t)num_free, sizeof *blocks->slot))))
        return pliant_fail_memory("contact compliance");
    std::fill(blocks->slot, blocks->slot + num_free, -1);
    blocks->num_free = num_free;
    blocks->stride = (size_t)pliant_cuda_inverse_padded(3 * num_free);
    return PLIANT_OK;
}

/* Increase the number of slots, and keep the known columns. */
static pliant_status reserve_capacity(gpu_compliance_columns *blocks, int32_t count, cudaStream_t stream)
{
    const int32_t capacity = std::min(std::max(128, 2 * count), blocks->num_free);
    const size_t column = 3 * blocks->stride * sizeof(float), slots = (size_t)capacity;
    gpu_compliance_columns made = *blocks;
    if (count <= blocks->capacity) return PLIANT_OK;
    made.unknown = static_cast<int32_t *>(pliant_calloc(slots, sizeof *made.unknown));
    made.last_use = static_cast<uint64_t *>(pliant_calloc(slots, sizeof *made.last_use));
    made.d_column = NULL;
    made.d_which = made.h_which = NULL;
    pliant_status status = made.unknown && made.last_use ? PLIANT_OK : pliant_fail_memory("contact compliance");
    if (status == PLIANT_OK) status = pliant_cuda_allocate(slots * column, "contact compliance", &made.d_column);
    if (status == PLIANT_OK)
        status = pliant_cuda_allocate(2 * slots * sizeof *made.d_which, "contact compliance", &made.d_which);
    if (status == PLIANT_OK)
        status = pliant_cuda_allocate_host(2 * slots * sizeof *made.h_which, "contact compliance", &made.h_which);
    if (status == PLIANT_OK && blocks->capacity > 0) {
        status = CUDA_CALL(cudaMemcpyAsync(made.d_column, blocks->d_column, (size_t)blocks->capacity * column,
                                           cudaMemcpyDeviceToDevice, stream));
        if (status == PLIANT_OK) status = CUDA_CALL(cudaStreamSynchronize(stream));
    }
    if (status != PLIANT_OK) {
        free_slots(&made);
        return status;
    }
    std::fill(made.unknown, made.unknown + capacity, -1);
    std::copy(blocks->unknown, blocks->unknown + blocks->capacity, made.unknown);
    std::copy(blocks->last_use, blocks->last_use + blocks->capacity, made.last_use);
    made.capacity = capacity;
    free_slots(blocks);
    *blocks = made;
    return PLIANT_OK;
}

/* Return a slot that is free, or not used in this step. */
static int32_t take_slot(gpu_compliance_columns *blocks)
{
    while (blocks->unknown[blocks->next] >= 0 && blocks->last_use[blocks->next] == blocks->now)
        blocks->next = (blocks->next + 1) % blocks->capacity;
    const int32_t slot = blocks->next;
    if (blocks->unknown[slot] >= 0) blocks->slot[blocks->unknown[slot]] = -1;
    return slot;
}

pliant_status pliant_cuda_compliance_compute(gpu_compliance_columns *blocks, const gpu_preconditioner *preconditioner,
                                             const gpu_iteration *iteration, int32_t count, const int32_t *unknown,
                                             cudaStream_t stream, bool *made)
{
    CUDA_TRY(set_size(blocks, iteration->num_free));
    CUDA_TRY(reserve_capacity(blocks, count, stream));
    int32_t missing = 0;
    blocks->now++;
    for (int32_t i = 0; i < count; i++)
        if (blocks->slot[unknown[i]] >= 0) blocks->last_use[blocks->slot[unknown[i]]] = blocks->now;
    for (int32_t i = 0; i < count; i++) {
        if (blocks->slot[unknown[i]] >= 0) continue;
        const int32_t slot = take_slot(blocks);
        blocks->slot[unknown[i]] = slot;
        blocks->unknown[slot] = unknown[i];
        blocks->last_use[slot] = blocks->now;
        blocks->h_which[2 * missing] = unknown[i];
        blocks->h_which[2 * missing++ + 1] = 3 * slot;
    }
    *made = missing > 0;
    if (missing == 0) return PLIANT_OK;
    pliant_status status =
        pliant_cuda_send(blocks->h_which, 2 * (size_t)missing * sizeof *blocks->d_which, blocks->d_which, stream);
    if (status == PLIANT_OK)
        status = pliant_cuda_columns(preconditioner, iteration, missing, blocks->h_which, blocks->d_which,
                                     blocks->stride, blocks->d_column, stream);
    if (status != PLIANT_OK) pliant_cuda_compliance_discard(blocks);
    return status;
}
