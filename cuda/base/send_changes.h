/* Transfer of a changed array to the GPU, which has the array from before the change. Only the differences are sent. */
#ifndef PLIANT_CUDA_BASE_SEND_CHANGES_H
#define PLIANT_CUDA_BASE_SEND_CHANGES_H

#include "base/buffer.h"
#include "cuda/base/check.h"

/* Send the differences. d_out holds the first bytes of h_before (bytes_before), limited to the size of h_now (bytes).
 * Both host arrays are complete blocks of the library (base/buffer.h). Errors: UNAVAILABLE. */
static inline pliant_status pliant_cuda_send_differences(const void *h_now, size_t bytes, const void *h_before,
                                                         size_t bytes_before, void *d_out, cudaStream_t stream)
{
    const size_t common = bytes < bytes_before ? bytes : bytes_before;
    const char *h_from = static_cast<const char *>(h_now);
    char *d_to = static_cast<char *>(d_out);
    for (size_t from = 0, to = 0; pliant_next_difference(h_now, h_before, common, &from, &to);)
        CUDA_TRY(CUDA_CALL(cudaMemcpyAsync(d_to + from, h_from + from, to - from, cudaMemcpyHostToDevice, stream)));
    return bytes == common ? PLIANT_OK
                           : CUDA_CALL(cudaMemcpyAsync(d_to + common, h_from + common, bytes - common,
                                                       cudaMemcpyHostToDevice, stream));
}

#endif
