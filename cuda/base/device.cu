#include "cuda/base/check.h"
#include "base/fail.h"
#include "base/buffer.h"
#include "cuda/base/device.h"
#include "base/memory.h"

#include <nvtx3/nvToolsExt.h>

#include <atomic>
#include <cstdio>
#include <cstring>
#include <mutex>

static std::atomic<long long> calls_left{-1};

extern "C" int64_t pliant_cuda_fail_after(int64_t calls) { return calls_left.exchange(calls); }

extern "C" bool pliant_cuda_fails_now(void)
{
    long long left = calls_left.load();
    while (left >= 0)
        if (calls_left.compare_exchange_weak(left, left - 1)) return left == 0;
    return false;
}

extern "C" pliant_status pliant_cuda_status(cudaError_t error, const char *what)
{
    if (error == cudaSuccess) return PLIANT_OK;
    cudaGetLastError(); /* clears the error, so that the next check does not report it again */
    if (error == cudaErrorMemoryAllocation)
        return pliant_fail(PLIANT_ERROR_MEMORY, "the GPU is out of memory (%s)", what);
    return pliant_fail(PLIANT_ERROR_UNAVAILABLE, "the GPU failed: %s (%s)", cudaGetErrorString(error), what);
}

struct retired { void *block; bool of_host; };

static std::mutex retired_lock;
static retired *retired_blocks;
static size_t num_retired, retired_capacity;
static int num_background; /* protected by the lock */
static thread_local bool in_background;

/* ---- Allocation. It blocks other threads as well, except for memory of a pool. */

static thread_local cudaMemPool_t background_pool;
static thread_local cudaStream_t background_stream;
static void **pooled; /* (num_pooled) blocks of pools, protected by the lock */
static size_t num_pooled, pooled_capacity;

static bool note_pooled(void *block)
{
    std::lock_guard<std::mutex> lock(retired_lock);
    if (num_pooled == pooled_capacity) {
        void *longer = pliant_resize(pooled, 2 * pooled_capacity + 64, sizeof *pooled);
        if (!longer) return false;
        pooled = static_cast<void **>(longer);
        pooled_capacity = 2 * pooled_capacity + 64;
    }
    pooled[num_pooled++] = block;
    return true;
}

/* Remove a block from the list of pool blocks. Return whether it was in the list. */
static bool forget_pooled(const void *block)
{
    std::lock_guard<std::mutex> lock(retired_lock);
    size_t n = 0;
    while (n < num_pooled && pooled[n] != block) n++;
    if (n == num_pooled) return false;
    pooled[n] = pooled[--num_pooled];
    if (num_pooled > 0) return true;
    pliant_free(pooled);
    pooled = nullptr;
    pooled_capacity = 0;
    return true;
}

static cudaError_t take(size_t bytes, void **out)
{
    if (!background_pool) return cudaMalloc(out, bytes);
    const cudaError_t error = cudaMallocFromPoolAsync(out, bytes, background_pool, background_stream);
    if (error != cudaSuccess || note_pooled(*out)) return error;
    cudaFreeAsync(*out, background_stream);
    return cudaErrorMemoryAllocation;
}

extern "C" void pliant_cuda_background_pool(cudaMemPool_t pool, cudaStream_t stream)
{
    background_pool = pool;
    background_stream = stream;
}

extern "C" cudaMemPool_t pliant_cuda_pool_create(int device)
{
    cudaMemPool_t pool = nullptr;
    cudaMemPoolProps wanted = {};
    int there = 0;
    uint64_t keeps = (uint64_t)1 << 30; /* memory above this size is returned, since other processes use the device */
    wanted.allocType = cudaMemAllocationTypePinned;
    wanted.location.type = cudaMemLocationTypeDevice;
    wanted.location.id = device;
    if (pliant_cuda_fails_now() ||
        cudaDeviceGetAttribute(&there, cudaDevAttrMemoryPoolsSupported, device) != cudaSuccess || !there ||
        cudaMemPoolCreate(&pool, &wanted) != cudaSuccess) {
        cudaGetLastError();
        return nullptr;
    }
    if (cudaMemPoolSetAttribute(pool, cudaMemPoolAttrReleaseThreshold, &keeps) != cudaSuccess) cudaGetLastError();
    return pool;
}

extern "C" void pliant_cuda_pool_destroy(cudaMemPool_t pool)
{
    if (pool && cudaMemPoolDestroy(pool) != cudaSuccess) cudaGetLastError();
}

extern "C" pliant_status pliant_cuda_allocate(size_t bytes, const char *what, void **out)
{
    void *block = nullptr;
    cudaError_t error = pliant_cuda_fails_now() ? cudaErrorMemoryAllocation : take(bytes > 0 ? bytes : 1, &block);
    if (error == cudaErrorMemoryAllocation) {
        size_t free_bytes = 0, total = 0;
        cudaGetLastError();
        cudaMemGetInfo(&free_bytes, &total);
        return pliant_fail(PLIANT_ERROR_MEMORY, "not enough GPU memory for %s: %.1f MB needed, %.1f of %.1f MB free",
                           what, 1e-6 * (double)bytes, 1e-6 * (double)free_bytes, 1e-6 * (double)total);
    }
    CUDA_TRY(pliant_cuda_status(error, what));
    *out = block;
    return PLIANT_OK;
}

extern "C" pliant_status pliant_cuda_ensure(size_t bytes, bool grows, const char *what, void **d_block,
                                            size_t *capacity)
{
    if (*d_block && bytes <= *capacity) return PLIANT_OK;
    const size_t more = grows ? bytes + bytes / 4 : bytes;
    void *longer;
    CUDA_TRY(pliant_cuda_allocate(more, what, &longer));
    pliant_cuda_release(*d_block);
    *d_block = longer;
    *capacity = more;
    return PLIANT_OK;
}

extern "C" pliant_status pliant_cuda_allocate_host(size_t bytes, const char *what, void **out)
{
    void *block = nullptr;
    cudaError_t error =
        pliant_cuda_fails_now() ? cudaErrorMemoryAllocation : cudaMallocHost(&block, bytes > 0 ? bytes : 1);
    if (error == cudaErrorMemoryAllocation) {
        cudaGetLastError();
        return pliant_fail_memory(what);
    }
    CUDA_TRY(pliant_cuda_status(error, what));
    memset(block, 0, bytes);
    *out = block;
    return PLIANT_OK;
}

/* The block must be alone on its pages: CUDA refuses copies of other blocks on a locked page. */
extern "C" bool pliant_cuda_lock_pages(void *h_block, size_t bytes)
{
    if (!pliant_is_on_own_pages(h_block)) return false;
    const bool locked = cudaHostRegister(h_block, bytes, cudaHostRegisterDefault) == cudaSuccess;
    cudaGetLastError();
    return locked;
}

extern "C" void pliant_cuda_unlock_pages(void *h_block)
{
    if (cudaHostUnregister(h_block) != cudaSuccess) cudaGetLastError();
}

/* ---- Release. cudaFree waits for all work of the device, and no thread may wait for background work. */

/* Free a block. A failure means that the device is lost, which other calls report. */
static void return_to_system(const retired &of)
{
    const bool of_pool = !of.of_host && forget_pooled(of.block);
    const bool in_order = of_pool && background_pool;
    if ((of.of_host ? cudaFreeHost(of.block)
         : in_order ? cudaFreeAsync(of.block, background_stream)
                    : cudaFree(of.block)) != cudaSuccess)
        cudaGetLastError();
}

static bool retire(const retired &of)
{
    std::lock_guard<std::mutex> lock(retired_lock);
    if (num_background == 0 || in_background) return false;
    if (num_retired == retired_capacity) {
        const size_t more = 2 * retired_capacity + 16;
        void *longer = pliant_resize(retired_blocks, more, sizeof *retired_blocks);
        if (!longer) return false;
        retired_blocks = static_cast<retired *>(longer);
        retired_capacity = more;
    }
    retired_blocks[num_retired++] = of;
    return true;
}

static void release(void *block, bool of_host)
{
    const retired of = {block, of_host};
    if (block && !retire(of)) return_to_system(of);
}

extern "C" void pliant_cuda_background_begin(void)
{
    std::lock_guard<std::mutex> lock(retired_lock);
    num_background++;
    in_background = true;
}

extern "C" void pliant_cuda_background_end(void)
{
    retired *blocks = nullptr;
    size_t count = 0;
    pliant_cuda_background_pool(nullptr, nullptr);
    {
        std::lock_guard<std::mutex> lock(retired_lock);
        in_background = false;
        if (--num_background == 0) {
            blocks = retired_blocks;
            count = num_retired;
            retired_blocks = nullptr;
            num_retired = retired_capacity = 0;
        }
    }
    for (size_t n = 0; n < count; n++) return_to_system(blocks[n]);
    pliant_free(blocks);
}

extern "C" void pliant_cuda_release(void *d_block) { release(d_block, false); }
extern "C" void pliant_cuda_release_host(void *h_block) { release(h_block, true); }

extern "C" pliant_status pliant_cuda_send(const void *h_from, size_t bytes, void *d_to, cudaStream_t stream)
{
    return CUDA_CALL(cudaMemcpyAsync(d_to, h_from, bytes, cudaMemcpyHostToDevice, stream));
}

extern "C" pliant_status pliant_cuda_upload(const void *h_from, size_t bytes, const char *what, cudaStream_t stream,
                                            void **out)
{
    void *block;
    CUDA_TRY(pliant_cuda_allocate(bytes, what, &block));
    pliant_status status = pliant_cuda_send(h_from, bytes, block, stream);
    if (status == PLIANT_OK) status = CUDA_CALL(cudaStreamSynchronize(stream));
    if (status != PLIANT_OK) {
        pliant_cuda_release(block);
        return status;
    }
    *out = block;
    return PLIANT_OK;
}

__global__ void probe_kernel(int *out) { *out = 42; }

/* Run a kernel on the device and check its result. */
static cudaError_t try_device(int index)
{
    int *d_answer = nullptr, h_answer = 0;
    cudaStream_t stream = nullptr;
    cudaError_t error = cudaSetDevice(index);
    if (error == cudaSuccess) error = cudaStreamCreateWithFlags(&stream, cudaStreamNonBlocking);
    if (error == cudaSuccess) error = cudaMalloc(&d_answer, sizeof *d_answer);
    if (error == cudaSuccess) {
        probe_kernel<<<1, 1, 0, stream>>>(d_answer);
        error = cudaGetLastError();
    }
    if (error == cudaSuccess)
        error = cudaMemcpyAsync(&h_answer, d_answer, sizeof h_answer, cudaMemcpyDeviceToHost, stream);
    if (error == cudaSuccess) error = cudaStreamSynchronize(stream);
    if (error == cudaSuccess && h_answer != 42) error = cudaErrorUnknown;
    cudaFree(d_answer);
    if (stream) cudaStreamDestroy(stream);
    cudaGetLastError();
    return error;
}

/* The device of the last probe. A simulation and its volume use each other's device memory, so all of them stay on one
 * device while it works. */
static std::atomic<int> chosen{-1};

struct found_device {
    int index;
    char name[128];
    size_t free_bytes, total_bytes;
    int major, minor; /* compute capability */
};

/* Find the device with the most free memory that runs a kernel of this build. Return false with the reason (no driver,
 * no device, no code for it) if there is no such device. The function logs nothing. */
static bool find_device(found_device *out, char *reason, size_t reason_size)
{
    const int before = chosen;
    int count = 0;
    cudaError_t error = pliant_cuda_fails_now() ? cudaErrorNoDevice : cudaGetDeviceCount(&count);
    found_device best = {};
    best.index = -1;
    for (int index = 0; error == cudaSuccess && index < count; index++) {
        cudaDeviceProp properties;
        found_device device = {};
        cudaError_t here = cudaGetDeviceProperties(&properties, index);
        if (here == cudaSuccess) here = try_device(index);
        if (here == cudaSuccess) here = cudaMemGetInfo(&device.free_bytes, &device.total_bytes);
        if (here != cudaSuccess) {
            error = index + 1 < count || best.index >= 0 ? cudaSuccess : here;
            continue;
        }
        device.index = index;
        snprintf(device.name, sizeof device.name, "%s", properties.name);
        device.major = properties.major;
        device.minor = properties.minor;
        if (best.index < 0 || index == before || (best.index != before && device.free_bytes > best.free_bytes))
            best = device;
    }
    cudaGetLastError();
    if (best.index < 0 || cudaSetDevice(best.index) != cudaSuccess) {
        snprintf(reason, reason_size, "%s", error != cudaSuccess ? cudaGetErrorString(error) : "no CUDA device found");
        return false;
    }
    chosen = best.index;
    *out = best;
    return true;
}

bool pliant_cuda_text(char *text, size_t size)
{
    found_device device;
    char reason[200];
    if (!find_device(&device, reason, sizeof reason)) {
        snprintf(text, size, "%s", reason);
        return false;
    }
    snprintf(text, size, "%s, compute capability %d.%d, %.1f of %.1f GB free", device.name, device.major, device.minor,
             1e-9 * (double)device.free_bytes, 1e-9 * (double)device.total_bytes);
    return true;
}

pliant_status pliant_cuda_current_device(int *out)
{
    found_device device;
    char reason[200];
    if (!find_device(&device, reason, sizeof reason))
        return pliant_fail(PLIANT_ERROR_UNAVAILABLE, "no GPU can be used: %s", reason);
    *out = device.index;
    return PLIANT_OK;
}

void pliant_cuda_section_begin(const char *name) { nvtxRangePushA(name); }
void pliant_cuda_section_end(void) { nvtxRangePop(); }
