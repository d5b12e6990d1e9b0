/* Compute the brick maxima with one warp per brick, and the pixels with one warp per tile of 8 x 4 pixels, so that
 * adjacent rays read the same voxels. */
#include "cuda/base/check.h"
#include "cuda/warp/render.h"

#include <cstring>

enum { THREADS = 128, TILE_WIDTH = 8, TILE_HEIGHT = 16, WARP = 32 };

/* Compute the maximum value of a brick. Each lane takes every 32nd column. */
template <pliant_encoding ENCODING, bool BY_LABEL>
static __global__ void __launch_bounds__(THREADS) bricks_kernel(const render_scene scene)
{
    const int32_t b = (int32_t)((blockIdx.x * THREADS + threadIdx.x) / WARP), lane = (int32_t)threadIdx.x % WARP;
    const int32_t brick[3] = {b % scene.bricks[0], b / scene.bricks[0] % scene.bricks[1],
                              b / scene.bricks[0] / scene.bricks[1]};
    if (brick[2] >= scene.bricks[2]) return;
    float high = render_brick_high(&scene, ENCODING, BY_LABEL, brick, lane, WARP);
    for (int n = WARP / 2; n > 0; n /= 2) high = fmaxf(high, __shfl_xor_sync(~0u, high, n));
    if (lane == 0) scene.brick_high[b] = high;
}

template <pliant_encoding ENCODING, bool BY_LABEL, bool INTEGRAL>
static __global__ void __launch_bounds__(THREADS) pixels_kernel(const render_scene scene, const render_output out)
{
    const int32_t column = (int32_t)(blockIdx.x * TILE_WIDTH + threadIdx.x % TILE_WIDTH),
                  row = (int32_t)(blockIdx.y * TILE_HEIGHT + threadIdx.x / TILE_WIDTH);
    if (column >= scene.width || row >= scene.height) return;
    if (INTEGRAL) render_integral(&scene, ENCODING, column, row, &out);
    else render_surface(&scene, ENCODING, BY_LABEL, column, row, &out);
}

template <pliant_encoding ENCODING, bool BY_LABEL>
static pliant_status draw(const render_scene &scene, const render_output &d_out, cudaStream_t stream)
{
    const unsigned warps = (unsigned)(scene.bricks[0] * scene.bricks[1] * scene.bricks[2]),
                   blocks = (warps * WARP + THREADS - 1) / THREADS;
    const dim3 tiles((unsigned)((scene.width + TILE_WIDTH - 1) / TILE_WIDTH),
                     (unsigned)((scene.height + TILE_HEIGHT - 1) / TILE_HEIGHT));
    bricks_kernel<ENCODING, BY_LABEL><<<blocks, THREADS, 0, stream>>>(scene);
    CUDA_TRY(CUDA_LAUNCHED("bricks_kernel"));
    if (d_out.integral) pixels_kernel<ENCODING, false, true><<<tiles, THREADS, 0, stream>>>(scene, d_out);
    else pixels_kernel<ENCODING, BY_LABEL, false><<<tiles, THREADS, 0, stream>>>(scene, d_out);
    return CUDA_LAUNCHED("pixels_kernel");
}

template <pliant_encoding ENCODING>
static pliant_status draw(const render_scene &scene, const render_output &d_out, cudaStream_t stream)
{
    return !d_out.integral && scene.style.by_label ? draw<ENCODING, true>(scene, d_out, stream)
                                                   : draw<ENCODING, false>(scene, d_out, stream);
}

/* Place the requested arrays consecutively in a block. Return the number of bytes. */
static size_t place(const render_output &wanted, size_t pixels, uint8_t *block, render_output *out)
{
    size_t bytes = 0;
    *out = render_output();
    if (wanted.depth) out->depth = reinterpret_cast<float *>(block + bytes), bytes += pixels * sizeof(float);
    if (wanted.integral) out->integral = reinterpret_cast<float *>(block + bytes), bytes += pixels * sizeof(float);
    if (wanted.rgb) out->rgb = block + bytes, bytes += 3 * pixels;
    if (wanted.label) out->label = block + bytes, bytes += pixels;
    return bytes;
}

static pliant_status reserve_capacity(gpu_pictures *pictures, size_t bricks, size_t bytes)
{
    void *h_pixels = nullptr;
    CUDA_TRY(
        pliant_cuda_ensure(bricks * sizeof(float), false, "pictures", &pictures->d_bricks, &pictures->brick_bytes));
    CUDA_TRY(pliant_cuda_ensure(bytes, false, "pictures", &pictures->d_pixels, &pictures->device_bytes));
    if (bytes <= pictures->host_bytes) return PLIANT_OK;
    CUDA_TRY(pliant_cuda_allocate_host(bytes, "pictures", &h_pixels));
    pliant_cuda_release_host(pictures->h_pixels);
    pictures->h_pixels = h_pixels;
    pictures->host_bytes = bytes;
    return PLIANT_OK;
}

pliant_status pliant_cuda_render(gpu_pictures *pictures, const render_scene *given, const render_output *out,
                                 cudaStream_t stream)
{
    const size_t pixels = (size_t)given->width * (size_t)given->height,
                 bricks = (size_t)given->bricks[0] * (size_t)given->bricks[1] * (size_t)given->bricks[2];
    render_scene scene = *given;
    render_output d_out, h_out;
    const size_t bytes = place(*out, pixels, nullptr, &d_out);
    if (bytes == 0) return PLIANT_OK;
    CUDA_TRY(reserve_capacity(pictures, bricks, bytes));
    place(*out, pixels, static_cast<uint8_t *>(pictures->d_pixels), &d_out);
    place(*out, pixels, static_cast<uint8_t *>(pictures->h_pixels), &h_out);
    scene.brick_high = pictures->d_bricks;
    pliant_status status = PLIANT_OK;
    switch (scene.encoding) {
    case PLIANT_UINT8: status = draw<PLIANT_UINT8>(scene, d_out, stream); break;
    case PLIANT_INT16: status = draw<PLIANT_INT16>(scene, d_out, stream); break;
    case PLIANT_FLOAT32: status = draw<PLIANT_FLOAT32>(scene, d_out, stream); break;
    }
    CUDA_TRY(status);
    CUDA_TRY(CUDA_CALL(cudaMemcpyAsync(pictures->h_pixels, pictures->d_pixels, bytes, cudaMemcpyDeviceToHost, stream)));
    CUDA_TRY(CUDA_CALL(cudaStreamSynchronize(stream)));
    if (out->depth) memcpy(out->depth, h_out.depth, pixels * sizeof(float));
    if (out->integral) memcpy(out->integral, h_out.integral, pixels * sizeof(float));
    if (out->rgb) memcpy(out->rgb, h_out.rgb, 3 * pixels);
    if (out->label) memcpy(out->label, h_out.label, pixels);
    return PLIANT_OK;
}

void pliant_cuda_pictures_free(gpu_pictures *pictures)
{
    pliant_cuda_release(pictures->d_bricks);
    pliant_cuda_release(pictures->d_pixels);
    pliant_cuda_release_host(pictures->h_pixels);
}
