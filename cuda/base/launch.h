/* Launches of kernels: number of thread blocks, kernels loaded in advance, graphs. */
#ifndef PLIANT_CUDA_LAUNCH_H
#define PLIANT_CUDA_LAUNCH_H

#include "cuda/base/check.h"

/* Return the number of thread blocks for `count` threads. */
template <class T> unsigned blocks_for(T count, int threads)
{
    return (unsigned)((count + (T)threads - 1) / (T)threads);
}

/* Load kernels in advance. Otherwise their first launch in a process loads them. Errors: UNAVAILABLE. */
template <class... Kernel> pliant_status pliant_cuda_load_kernels(Kernel... kernels)
{
    for (const void *kernel : {reinterpret_cast<const void *>(kernels)...}) {
        cudaFuncAttributes attributes;
        CUDA_TRY(CUDA_CALL(cudaFuncGetAttributes(&attributes, kernel)));
    }
    return PLIANT_OK;
}

/* Record the work that a function enqueues on a stream. The caller destroys *graph, which may exist after a failure. */
template <class Enqueue> pliant_status pliant_cuda_capture(cudaStream_t stream, cudaGraph_t *graph, Enqueue enqueue)
{
    CUDA_TRY(CUDA_CALL(cudaStreamBeginCapture(stream, cudaStreamCaptureModeThreadLocal)));
    const pliant_status status = enqueue();
    /* Also after a failure: memory cannot be freed while a stream records. */
    const cudaError_t ended = cudaStreamEndCapture(stream, graph);
    return status == PLIANT_OK ? CUDA_CALL(ended) : status;
}

/* Replace an executable graph by the work that a function enqueues on a stream. *out: in: Nullable; null after a
 * failure. */
template <class Enqueue> pliant_status pliant_cuda_record(cudaStream_t stream, cudaGraphExec_t *out, Enqueue enqueue)
{
    cudaGraph_t graph = nullptr;
    if (*out) cudaGraphExecDestroy(*out);
    *out = nullptr;
    pliant_status status = pliant_cuda_capture(stream, &graph, enqueue);
    if (status == PLIANT_OK) status = CUDA_CALL(cudaGraphInstantiateWithFlags(out, graph, 0));
    if (graph) cudaGraphDestroy(graph);
    return status;
}

#endif
