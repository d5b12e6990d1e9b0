/* Every call of the CUDA runtime goes through CUDA_CALL: its error becomes a pliant_status with a message, and tests
 * can make any one of them fail. */
#ifndef PLIANT_CUDA_CHECK_H
#define PLIANT_CUDA_CHECK_H

#include "pliant/status.h"

#include <cuda_runtime_api.h>

#ifdef __cplusplus
extern "C" {
#endif

/* MEMORY when the device has no room, UNAVAILABLE for all else: the device or its driver is gone or broken. */
pliant_status pliant_cuda_status(cudaError_t error, const char *what);

/* For tests: the call after the next `calls` ones fails, once, as if the device were lost. Negative: none (the
 * default). Returns what was left of those that were asked for before: negative: one has failed, or none was to. */
int64_t pliant_cuda_fail_after(int64_t calls);
bool pliant_cuda_fails_now(void);

#define CUDA_CALL(call) pliant_cuda_status(pliant_cuda_fails_now() ? cudaErrorUnknown : (call), #call)
/* after a kernel launch */
#define CUDA_LAUNCHED(kernel) pliant_cuda_status(pliant_cuda_fails_now() ? cudaErrorUnknown : cudaGetLastError(), kernel)
/* leave the function on the first failure; whoever owns the half-made object frees it */
#define CUDA_TRY(status)                                                                                               \
    do {                                                                                                               \
        pliant_status cuda_try_status = (status);                                                                      \
        if (cuda_try_status != PLIANT_OK) return cuda_try_status;                                                      \
    } while (0)

/* Device memory, not zeroed; *out is untouched on failure. what: for the message. Errors: MEMORY, with figures. */
pliant_status pliant_cuda_allocate(size_t bytes, const char *what, void **out);
/* Room for so many bytes at *d_block, which has *room of them: where they are too few, another block takes its place,
 * with nothing in it; grows: larger by a quarter than asked for. */
pliant_status pliant_cuda_ensure(size_t bytes, bool grows, const char *what, void **d_block, size_t *room);
/* Page-locked host memory, zeroed. */
pliant_status pliant_cuda_allocate_host(size_t bytes, const char *what, void **out);
/* The pages of a block of the host (pliant_pages), before it is freed to be unlocked; false: they are not, and copies
 * are slower, no more. */
bool pliant_cuda_lock_pages(void *h_block, size_t bytes);
void pliant_cuda_unlock_pages(void *h_block);
void pliant_cuda_release(void *d_block);      /* Nullable */
void pliant_cuda_release_host(void *h_block); /* Nullable */
/* A thread that works on the device while steps go on, from and to here: what others give back in between is kept until
 * it ends, since the device gives back nothing before it has done all that it was given. What it takes and gives back
 * itself is of a pool, in the order of its stream, from then on; pool: NULL: as others do. */
void pliant_cuda_background_begin(void);
void pliant_cuda_background_pool(cudaMemPool_t pool, cudaStream_t stream);
void pliant_cuda_background_end(void);
/* A pool on a device that keeps what is given back to it until it is destroyed; NULL: there is none. */
cudaMemPool_t pliant_cuda_pool_create(int device);
void pliant_cuda_pool_destroy(cudaMemPool_t pool); /* Nullable */
/* Allocate, and copy from the host before it returns. */
pliant_status pliant_cuda_upload(const void *h_from, size_t bytes, const char *what, cudaStream_t stream, void **out);

#ifdef __cplusplus
}
#endif
#endif
