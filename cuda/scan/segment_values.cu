/* Conversion of values to bins: range, counts, noise, and the sigma filter. */
#include "cuda/base/check.h"
#include "cuda/scan/segment_value.cuh"

/* Map floats to integers in the same order. */
static __device__ uint32_t ordered(float value)
{
    const uint32_t bits = __float_as_uint(value);
    return bits & 0x80000000u ? ~bits : bits | 0x80000000u;
}

float pliant_cuda_segment_float(uint32_t number)
{
    union { uint32_t bits; float value; } out;
    out.bits = number & 0x80000000u ? number & 0x7fffffffu : ~number;
    return out.value;
}

__global__ void range_kernel(const gpu_segment segment)
{
    uint32_t minimum = 0xffffffffu, maximum = 0;
    bool infinite = false;
    for (int32_t v = (int32_t)(blockIdx.x * blockDim.x + threadIdx.x); v < segment.voxels;
         v += (int32_t)(gridDim.x * blockDim.x)) {
        const float value = value_of(segment, v);
        infinite |= !isfinite(value);
        minimum = min(minimum, ordered(value));
        maximum = max(maximum, ordered(value));
    }
    for (int step = 16; step > 0; step /= 2) {
        minimum = min(minimum, __shfl_xor_sync(0xffffffffu, minimum, step));
        maximum = max(maximum, __shfl_xor_sync(0xffffffffu, maximum, step));
    }
    if (infinite) segment.d_range->infinite = 1;
    if (threadIdx.x % 32 != 0) return;
    atomicMin(&segment.d_range->minimum, minimum);
    atomicMax(&segment.d_range->maximum, maximum);
}

__global__ void fine_kernel(const gpu_segment segment, double minimum, double scale)
{
    for (int32_t v = (int32_t)(blockIdx.x * blockDim.x + threadIdx.x); v < segment.voxels;
         v += (int32_t)(gridDim.x * blockDim.x))
        atomicAdd(segment.d_fine + (int32_t)(((double)value_of(segment, v) - minimum) * scale), 1u);
}

static __device__ void flush_counts(const uint32_t *count, unsigned long long *d_count)
{
    __syncthreads();
    for (int bin = (int)threadIdx.x; bin < SEGMENT_BINS; bin += SEGMENT_THREADS)
        if (count[bin]) atomicAdd(d_count + bin, (unsigned long long)count[bin]);
}

__global__ void __launch_bounds__(SEGMENT_THREADS) raw_kernel(const gpu_segment segment, double low, double width)
{
    for (int32_t v = (int32_t)(blockIdx.x * blockDim.x + threadIdx.x); v < segment.voxels;
         v += (int32_t)(gridDim.x * blockDim.x))
        segment.d_raw[v] =
            (uint16_t)fmin(fmax(((double)value_of(segment, v) - low) / width, 0.0), (double)(SEGMENT_BINS - 1));
}

__global__ void __launch_bounds__(SEGMENT_THREADS) noise_kernel(const gpu_segment segment)
{
    __shared__ uint32_t count[SEGMENT_BINS];
    for (int bin = (int)threadIdx.x; bin < SEGMENT_BINS; bin += SEGMENT_THREADS) count[bin] = 0;
    __syncthreads();
    for (int32_t v = (int32_t)(blockIdx.x * blockDim.x + threadIdx.x) + 1; v < segment.voxels;
         v += (int32_t)(gridDim.x * blockDim.x)) {
        const int own = segment.d_raw[v], before = segment.d_raw[v - 1];
        if (own != 0 && before != 0) atomicAdd(count + abs(own - before), 1u);
    }
    flush_counts(count, segment.d_count);
}

/* As smooth of src/scan/segment.c, one row of voxels at a time. */
__global__ void __launch_bounds__(SEGMENT_THREADS) smooth_kernel(const gpu_segment segment, int reach)
{
    __shared__ uint32_t count[SEGMENT_BINS];
    for (int bin = (int)threadIdx.x; bin < SEGMENT_BINS; bin += SEGMENT_THREADS) count[bin] = 0;
    __syncthreads();
    const int32_t nx = segment.size[0], ny = segment.size[1], nz = segment.size[2];
    for (int32_t row = (int32_t)blockIdx.x; row < ny * nz; row += (int32_t)gridDim.x)
        for (int32_t i = (int32_t)threadIdx.x; i < nx; i += SEGMENT_THREADS) {
            const int32_t j = row % ny, k = row / ny, v = i + nx * row;
            const int own = segment.d_raw[v];
            int sum = 0, alike = 0;
            for (int32_t c = k > 0 ? -1 : 0; c <= (k + 1 < nz); c++)
                for (int32_t b = j > 0 ? -1 : 0; b <= (j + 1 < ny); b++)
                    for (int32_t a = i > 0 ? -1 : 0; a <= (i + 1 < nx); a++) {
                        const int other = segment.d_raw[v + a + nx * (b + ny * c)], near = abs(other - own) <= reach;
                        sum += near ? other : 0;
                        alike += near;
                    }
            const int bin = (2 * sum + alike) / (2 * alike);
            segment.d_bins[v] = (uint16_t)bin;
            atomicAdd(count + bin, alike >= SEGMENT_MIN_ALIKE_NEIGHBOURS ? 4u : 1u);
        }
    flush_counts(count, segment.d_count);
}

pliant_status pliant_cuda_segment_range(const gpu_segment *segment, cudaStream_t stream)
{
    CUDA_TRY(CUDA_CALL(cudaMemsetAsync(segment->d_range, 0, sizeof *segment->d_range, stream)));
    CUDA_TRY(CUDA_CALL(cudaMemsetAsync(&segment->d_range->minimum, 0xff, sizeof segment->d_range->minimum, stream)));
    range_kernel<<<SEGMENT_BLOCKS, SEGMENT_THREADS, 0, stream>>>(*segment);
    return CUDA_LAUNCHED("the range of the values");
}

pliant_status pliant_cuda_segment_fine(const gpu_segment *segment, double minimum, double scale, cudaStream_t stream)
{
    CUDA_TRY(CUDA_CALL(cudaMemsetAsync(segment->d_fine, 0, SEGMENT_FINE_BINS * sizeof *segment->d_fine, stream)));
    fine_kernel<<<SEGMENT_BLOCKS, SEGMENT_THREADS, 0, stream>>>(*segment, minimum, scale);
    return CUDA_LAUNCHED("the counts of the values");
}

pliant_status pliant_cuda_segment_raw(const gpu_segment *segment, const segment_histogram *histogram,
                                      cudaStream_t stream)
{
    CUDA_TRY(CUDA_CALL(cudaMemsetAsync(segment->d_count, 0, SEGMENT_BINS * sizeof *segment->d_count, stream)));
    raw_kernel<<<SEGMENT_BLOCKS, SEGMENT_THREADS, 0, stream>>>(*segment, histogram->low, histogram->width);
    CUDA_TRY(CUDA_LAUNCHED("the bins"));
    noise_kernel<<<SEGMENT_BLOCKS, SEGMENT_THREADS, 0, stream>>>(*segment);
    return CUDA_LAUNCHED("the noise");
}

pliant_status pliant_cuda_segment_smooth(const gpu_segment *segment, int reach, cudaStream_t stream)
{
    CUDA_TRY(CUDA_CALL(cudaMemsetAsync(segment->d_count, 0, SEGMENT_BINS * sizeof *segment->d_count, stream)));
    smooth_kernel<<<SEGMENT_BLOCKS, SEGMENT_THREADS, 0, stream>>>(*segment, reach);
    return CUDA_LAUNCHED("the sigma filter");
}
