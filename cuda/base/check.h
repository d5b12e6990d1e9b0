/* Error handling of CUDA runtime calls. CUDA_CALL converts an error to a pliant_status with a message. Tests can make
 * any call fail. */
#ifndef PLIANT_CUDA_CHECK_H
#define PLIANT_CUDA_CHECK_H

#include "pliant/status.h"

#include <cuda_runtime_api.h>

#ifdef __cplusplus
extern "C" {
#endif

/* Convert an error: MEMORY if the device is out of memory, otherwise UNAVAILABLE (device or driver missing or
 * broken). */
pliant_status pliant_cuda_status(cudaError_t error, const char *what);

/* For tests: after `calls` further calls, make one call fail as if the device were lost. Negative: no failure (the
 * default). Return the remaining count of the previous request; negative: its call has failed, or there was no
 * request. */
int64_t pliant_cuda_fail_after(int64_t calls);
bool pliant_cuda_fails_now(void);

#define CUDA_CALL(call) pliant_cuda_status(pliant_cuda_fails_now() ? cudaErrorUnknown : (call), #call)
/* Check a kernel launch. */
#define CUDA_LAUNCHED(kernel) \
    pliant_cuda_status(pliant_cuda_fails_now() ? cudaErrorUnknown : cudaGetLastError(), kernel)
/* Return from the function at the first failure. The caller frees partially created objects. */
#define CUDA_TRY(status)                                                                                               \
    do {                                                                                                               \
        pliant_status cuda_try_status = (status);                                                                      \
        if (cuda_try_status != PLIANT_OK) return cuda_try_status;                                                      \
    } while (0)

/* Allocate device memory, not zeroed. After a failure *out is unchanged. what: for the message. Errors: MEMORY, with
 * figures. */
pliant_status pliant_cuda_allocate(size_t bytes, const char *what, void **out);
/* Ensure a capacity of `bytes` at *d_block, whose present capacity is *capacity. A block that is too small is replaced
 * by a new one with undefined content. grows: allocate a quarter more than requested. */
pliant_status pliant_cuda_ensure(size_t bytes, bool grows, const char *what, void **d_block, size_t *capacity);
/* Allocate page-locked host memory, zeroed. */
pliant_status pliant_cuda_allocate_host(size_t bytes, const char *what, void **out);
/* Lock the pages of a host block (pliant_calloc_pages); unlock them before the block is freed. Return false if this
 * fails; copies are then only slower. */
bool pliant_cuda_lock_pages(void *h_block, size_t bytes);
void pliant_cuda_unlock_pages(void *h_block);
void pliant_cuda_release(void *d_block);      /* Nullable */
void pliant_cuda_release_host(void *h_block); /* Nullable */
/* Mark a thread that uses the device in the background (from begin to end). Memory that other threads free in between
 * is released only at its end, because cudaFree waits for all device work. After pliant_cuda_background_pool, the
 * thread allocates and frees memory of the pool, in the order of its stream. pool: NULL: ordinary memory. */
void pliant_cuda_background_begin(void);
void pliant_cuda_background_pool(cudaMemPool_t pool, cudaStream_t stream);
void pliant_cuda_background_end(void);
/* Create a memory pool that keeps freed memory until it is destroyed. NULL: pools are not available. */
cudaMemPool_t pliant_cuda_pool_create(int device);
void pliant_cuda_pool_destroy(cudaMemPool_t pool); /* Nullable */
/* Allocate device memory and copy to it from the host. The copy is complete on return. */
pliant_status pliant_cuda_upload(const void *h_from, size_t bytes, const char *what, cudaStream_t stream, void **out);
/* Enqueue a copy from the host to the device. */
pliant_status pliant_cuda_send(const void *h_from, size_t bytes, void *d_to, cudaStream_t stream);

#ifdef __cplusplus
}

#include <type_traits>

/* The same for pointers to elements. */
template <class T> void **gpu_block(T **block)
{
    return reinterpret_cast<void **>(const_cast<typename std::remove_const<T>::type **>(block));
}
template <class T> pliant_status pliant_cuda_allocate(size_t bytes, const char *what, T **out)
{
    return pliant_cuda_allocate(bytes, what, gpu_block(out));
}
template <class T>
pliant_status pliant_cuda_ensure(size_t bytes, bool grows, const char *what, T **d_block, size_t *capacity)
{
    return pliant_cuda_ensure(bytes, grows, what, gpu_block(d_block), capacity);
}
template <class T> pliant_status pliant_cuda_allocate_host(size_t bytes, const char *what, T **out)
{
    return pliant_cuda_allocate_host(bytes, what, gpu_block(out));
}
template <class T>
pliant_status pliant_cuda_upload(const void *h_from, size_t bytes, const char *what, cudaStream_t stream, T **out)
{
    return pliant_cuda_upload(h_from, bytes, what, stream, gpu_block(out));
}

/* Release several blocks. */
template <class... T> void pliant_cuda_release(T *...blocks)
{
    for (const void *block : {static_cast<const void *>(blocks)...}) pliant_cuda_release(const_cast<void *>(block));
}
template <class... T> void pliant_cuda_release_host(T *...blocks)
{
    for (void *block : {static_cast<void *>(blocks)...}) pliant_cuda_release_host(block);
}
#endif
#endif
