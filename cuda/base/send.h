/* Arrays of the next body on their way to the GPU, which has those of the body before: what differs is sent. */
#ifndef PLIANT_CUDA_SEND_H
#define PLIANT_CUDA_SEND_H

#include "base/room.h"
#include "cuda/base/check.h"

/* d_out has the first bytes of h_before (bytes_before) already, as many as h_now (bytes) has. Both are whole blocks of
 * the library (base/room.h). Errors: UNAVAILABLE. */
static inline pliant_status pliant_cuda_send_differences(const void *h_now, size_t bytes, const void *h_before, size_t bytes_before, void *d_out, cudaStream_t stream)
{
    const size_t common = bytes < bytes_before ? bytes : bytes_before;
    const char *h_from = static_cast<const char *>(h_now);
    char *d_to = static_cast<char *>(d_out);
    for (size_t from = 0, to = 0; pliant_next_difference(h_now, h_before, common, &from, &to);)
        CUDA_TRY(CUDA_CALL(cudaMemcpyAsync(d_to + from, h_from + from, to - from, cudaMemcpyHostToDevice, stream)));
    return bytes == common ? PLIANT_OK : CUDA_CALL(cudaMemcpyAsync(d_to + common, h_from + common, bytes - common, cudaMemcpyHostToDevice, stream));
}

#endif
