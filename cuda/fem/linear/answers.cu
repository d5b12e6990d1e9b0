#include "cuda/fem/linear/answers.h"

#include "base/fail.h"
#include "cuda/base/check.h"
#include "base/memory.h"

#include <algorithm>
#include <cstring>

static void free_slots(gpu_answers *answers)
{
    pliant_free(answers->unknown);
    pliant_free(answers->asked);
    pliant_cuda_release(answers->d_column);
    pliant_cuda_release(answers->d_which);
    pliant_cuda_release_host(answers->h_which);
}

extern "C" void pliant_cuda_answers_free(gpu_answers *answers)
{
    free_slots(answers);
    pliant_free(answers->slot);
    memset(answers, 0, sizeof *answers);
}

extern "C" void pliant_cuda_answers_forget(gpu_answers *answers)
{
    for (int32_t s = 0; s < answers->room; s++) {
        if (answers->unknown[s] >= 0) answers->slot[answers->unknown[s]] = -1;
        answers->unknown[s] = -1;
    }
}

static pliant_status set_size(gpu_answers *answers, int32_t num_free)
{
    if (answers->num_free == num_free) return PLIANT_OK;
    pliant_cuda_answers_free(answers);
    if (!(answers->slot = static_cast<int32_t *>(pliant_calloc((size_t)num_free, sizeof *answers->slot))))
        return pliant_fail_memory("answers to contact");
    std::fill(answers->slot, answers->slot + num_free, -1);
    answers->num_free = num_free;
    answers->stride = (size_t)pliant_cuda_inverse_padded(3 * num_free);
    return PLIANT_OK;
}

/* Increase the number of slots, and keep the known columns. */
static pliant_status make_room(gpu_answers *answers, int32_t count, cudaStream_t stream)
{
    const int32_t room = std::min(std::max(128, 2 * count), answers->num_free);
    const size_t column = 3 * answers->stride * sizeof(float), slots = (size_t)room;
    gpu_answers made = *answers;
    if (count <= answers->room) return PLIANT_OK;
    made.unknown = static_cast<int32_t *>(pliant_calloc(slots, sizeof *made.unknown));
    made.asked = static_cast<uint64_t *>(pliant_calloc(slots, sizeof *made.asked));
    made.d_column = NULL;
    made.d_which = made.h_which = NULL;
    pliant_status status = made.unknown && made.asked ? PLIANT_OK : pliant_fail_memory("answers to contact");
    if (status == PLIANT_OK)
        status = pliant_cuda_allocate(slots * column, "answers to contact", reinterpret_cast<void **>(&made.d_column));
    if (status == PLIANT_OK)
        status = pliant_cuda_allocate(2 * slots * sizeof *made.d_which, "answers to contact",
                                      reinterpret_cast<void **>(&made.d_which));
    if (status == PLIANT_OK)
        status = pliant_cuda_allocate_host(2 * slots * sizeof *made.h_which, "answers to contact",
                                           reinterpret_cast<void **>(&made.h_which));
    if (status == PLIANT_OK && answers->room > 0) {
        status = CUDA_CALL(cudaMemcpyAsync(made.d_column, answers->d_column, (size_t)answers->room * column,
                                           cudaMemcpyDeviceToDevice, stream));
        if (status == PLIANT_OK) status = CUDA_CALL(cudaStreamSynchronize(stream));
    }
    if (status != PLIANT_OK) {
        free_slots(&made);
        return status;
    }
    std::fill(made.unknown, made.unknown + room, -1);
    std::copy(answers->unknown, answers->unknown + answers->room, made.unknown);
    std::copy(answers->asked, answers->asked + answers->room, made.asked);
    made.room = room;
    free_slots(answers);
    *answers = made;
    return PLIANT_OK;
}

/* Return a slot that is free, or not used in this step. */
static int32_t take_slot(gpu_answers *answers)
{
    while (answers->unknown[answers->next] >= 0 && answers->asked[answers->next] == answers->now)
        answers->next = (answers->next + 1) % answers->room;
    const int32_t slot = answers->next;
    if (answers->unknown[slot] >= 0) answers->slot[answers->unknown[slot]] = -1;
    return slot;
}

extern "C" pliant_status pliant_cuda_answers_find(gpu_answers *answers, const gpu_preconditioner *preconditioner,
                                                  const gpu_iteration *iteration, int32_t count, const int32_t *unknown,
                                                  cudaStream_t stream, bool *made)
{
    CUDA_TRY(set_size(answers, iteration->num_free));
    CUDA_TRY(make_room(answers, count, stream));
    int32_t missing = 0;
    answers->now++;
    for (int32_t i = 0; i < count; i++)
        if (answers->slot[unknown[i]] >= 0) answers->asked[answers->slot[unknown[i]]] = answers->now;
    for (int32_t i = 0; i < count; i++) {
        if (answers->slot[unknown[i]] >= 0) continue;
        const int32_t slot = take_slot(answers);
        answers->slot[unknown[i]] = slot;
        answers->unknown[slot] = unknown[i];
        answers->asked[slot] = answers->now;
        answers->h_which[2 * missing] = unknown[i];
        answers->h_which[2 * missing++ + 1] = 3 * slot;
    }
    *made = missing > 0;
    if (missing == 0) return PLIANT_OK;
    pliant_status status =
        CUDA_CALL(cudaMemcpyAsync(answers->d_which, answers->h_which, 2 * (size_t)missing * sizeof *answers->d_which,
                                  cudaMemcpyHostToDevice, stream));
    if (status == PLIANT_OK)
        status = pliant_cuda_columns(preconditioner, iteration, missing, answers->h_which, answers->d_which,
                                     answers->stride, answers->d_column, stream);
    if (status != PLIANT_OK) pliant_cuda_answers_forget(answers);
    return status;
}
