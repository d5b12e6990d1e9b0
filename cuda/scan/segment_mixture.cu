/* The mixture, as in src/scan/segment_mixture.c: one block per trial, four bins per thread, sums in a tree. The host
 * reads the result after all numbers of classes are done. */
#include "cuda/base/check.h"
#include "cuda/scan/segment.h"
#include "cuda/base/warp_sum.cuh"

#include <cmath>

enum {
    THREADS = 256,
    BINS_A_THREAD = SEGMENT_BINS / THREADS,
    WARPS = THREADS / 32,
    TRIAL_PASSES = 30,
    FINAL_PASSES = 200
};

struct trial { pliant_segment_class classes[PLIANT_MAX_CLASSES]; double likelihood; };

struct mixture { segment_histogram histogram; trial trials[PLIANT_MAX_CLASSES]; segment_fits fits; };

struct pass_work {
    pliant_segment_class classes[PLIANT_MAX_CLASSES];
    /* Log of weight / (deviation sqrt(2 pi)); 1 / deviation. */
    double level[PLIANT_MAX_CLASSES], inverse[PLIANT_MAX_CLASSES];
    double part[WARPS][3 * PLIANT_MAX_CLASSES + 1], sums[3 * PLIANT_MAX_CLASSES + 1];
};

static __device__ void add_up(double value, int slot, pass_work *work)
{
    value = warp_sum(value);
    if (threadIdx.x % 32 == 0) work->part[threadIdx.x / 32][slot] = value;
}

/* Sum the bins' contributions to a pass in work->sums: for every class the share, share times distance from the mean,
 * and share times squared distance; then the log likelihood. counts, values: of this thread's bins. */
static __device__ void sum_bins(const double *counts, const double *values, int bins, int classes, pass_work *work)
{
    double sums[PLIANT_MAX_CLASSES][3] = {}, now = 0;
#pragma unroll 1
    for (int b = 0; b < bins; b++) {
        if (counts[b] == 0) continue;
        double part[PLIANT_MAX_CLASSES], largest = -INFINITY, sum = 0;
#pragma unroll
        for (int k = 0; k < PLIANT_MAX_CLASSES; k++) {
            if (k >= classes) break;
            const double difference = (values[b] - work->classes[k].mean) * work->inverse[k];
            part[k] = work->classes[k].weight > 0 ? work->level[k] - 0.5 * difference * difference : -INFINITY;
            largest = fmax(largest, part[k]);
        }
#pragma unroll
        for (int k = 0; k < PLIANT_MAX_CLASSES; k++) {
            if (k >= classes) break;
            part[k] = exp(part[k] - largest);
            sum += part[k];
        }
        now += counts[b] * (largest + log(sum));
        const double scale = counts[b] / sum;
#pragma unroll
        for (int k = 0; k < PLIANT_MAX_CLASSES; k++) {
            if (k >= classes) break;
            const double fraction = scale * part[k], difference = values[b] - work->classes[k].mean;
            sums[k][0] += fraction;
            sums[k][1] += fraction * difference;
            sums[k][2] += fraction * difference * difference;
        }
    }
#pragma unroll
    for (int k = 0; k < PLIANT_MAX_CLASSES; k++) {
        if (k >= classes) break;
        for (int s = 0; s < 3; s++) add_up(sums[k][s], 3 * k + s, work);
    }
    add_up(now, 3 * classes, work);
    __syncthreads();
    if ((int)threadIdx.x <= 3 * classes) {
        double total = 0;
        for (int w = 0; w < WARPS; w++) total += work->part[w][threadIdx.x];
        work->sums[threadIdx.x] = total;
    }
    __syncthreads();
}

/* As maximize of src/scan/segment_mixture.c, on work->classes. */
static __device__ double maximize(const segment_histogram &histogram, const double *counts, const double *values,
                                  int bins, int classes, int passes, pass_work *work)
{
    const double narrowest = fmax(1.5 * histogram.width, 0.5 * histogram.noise),
                 widest = 0.04 * SEGMENT_BINS * histogram.width;
    double likelihood = -INFINITY;
    for (int pass = 0; pass < passes; pass++) {
        __syncthreads();
        if ((int)threadIdx.x < classes) {
            const pliant_segment_class one = work->classes[threadIdx.x];
            work->level[threadIdx.x] = log(one.weight) - log(one.deviation) - 0.91893853320467274178;
            work->inverse[threadIdx.x] = 1 / one.deviation;
        }
        __syncthreads();
        sum_bins(counts, values, bins, classes, work);
        if ((int)threadIdx.x < classes) {
            pliant_segment_class *one = work->classes + threadIdx.x;
            const double *sums = work->sums + 3 * threadIdx.x;
            one->weight = sums[0] / histogram.total;
            if (sums[0] > 0) {
                const double shift = sums[1] / sums[0];
                one->mean += shift;
                one->deviation = fmin(fmax(sqrt(fmax(sums[2] / sums[0] - shift * shift, 0.0)), narrowest), widest);
            }
        }
        const double now = work->sums[3 * classes] / histogram.total;
        if (now - likelihood < 1e-7) return now;
        likelihood = now;
    }
    return likelihood;
}

static __device__ double value_at(const segment_histogram &histogram, int bin)
{
    return histogram.low + (bin + 0.5) * histogram.width;
}

/* Try a split of each of `count` classes, on a coarse histogram with four bins combined. */
__global__ void __launch_bounds__(THREADS) trial_kernel(mixture *d_mixture, int count)
{
    __shared__ pass_work work;
    const segment_histogram &histogram = d_mixture->histogram;
    const int which = (int)blockIdx.x, first = 4 * (int)threadIdx.x;
    if (threadIdx.x == 0) {
        for (int k = 0; k < count; k++) work.classes[k] = d_mixture->fits.classes[count - 1][k];
        pliant_segment_class *one = work.classes + which, *other = work.classes + count;
        *other = *one;
        one->weight = other->weight = 0.5 * one->weight;
        one->mean -= 0.8 * one->deviation;
        other->mean += 0.8 * other->deviation;
        one->deviation = other->deviation = 0.6 * one->deviation;
    }
    const double coarse =
        histogram.count[first] + histogram.count[first + 1] + histogram.count[first + 2] + histogram.count[first + 3];
    const double value = value_at(histogram, first + 1 + ((int)threadIdx.x & 1));
    const double likelihood = maximize(histogram, &coarse, &value, 1, count + 1, TRIAL_PASSES, &work);
    __syncthreads();
    if ((int)threadIdx.x <= count) d_mixture->trials[which].classes[threadIdx.x] = work.classes[threadIdx.x];
    if (threadIdx.x == 0) d_mixture->trials[which].likelihood = likelihood;
}

/* Iterate the best trial to the end on the fine histogram. With one class, start from the middle. */
__global__ void __launch_bounds__(THREADS) final_kernel(mixture *d_mixture, int count)
{
    __shared__ pass_work work;
    const segment_histogram &histogram = d_mixture->histogram;
    double counts[BINS_A_THREAD], values[BINS_A_THREAD];
    for (int b = 0; b < BINS_A_THREAD; b++) {
        const int bin = (int)threadIdx.x + b * THREADS;
        counts[b] = histogram.count[bin];
        values[b] = value_at(histogram, bin);
    }
    if (threadIdx.x == 0) {
        int best = 0;
        for (int t = 1; t < count - 1; t++)
            if (d_mixture->trials[t].likelihood > d_mixture->trials[best].likelihood) best = t;
        for (int k = 0; k < count; k++) work.classes[k] = d_mixture->trials[best].classes[k];
        if (count == 1) {
            work.classes[0].weight = 1;
            work.classes[0].mean = value_at(histogram, SEGMENT_BINS / 2);
            work.classes[0].deviation = 0.25 * SEGMENT_BINS * histogram.width;
        }
    }
    const double likelihood = maximize(histogram, counts, values, BINS_A_THREAD, count, FINAL_PASSES, &work);
    __syncthreads();
    if ((int)threadIdx.x < count) d_mixture->fits.classes[count - 1][threadIdx.x] = work.classes[threadIdx.x];
    if (threadIdx.x == 0) d_mixture->fits.likelihood[count - 1] = likelihood;
}

static pliant_status enqueue(mixture *d_mixture, const segment_histogram *histogram, int maximum, cudaStream_t stream,
                             segment_fits *out)
{
    CUDA_TRY(CUDA_CALL(cudaMemsetAsync(d_mixture, 0, sizeof *d_mixture, stream)));
    CUDA_TRY(pliant_cuda_send(histogram, sizeof *histogram, &d_mixture->histogram, stream));
    for (int count = 1; count <= maximum; count++) {
        if (count > 1) {
            trial_kernel<<<(unsigned)count - 1, THREADS, 0, stream>>>(d_mixture, count - 1);
            CUDA_TRY(CUDA_LAUNCHED("the trials of the mixture"));
        }
        final_kernel<<<1, THREADS, 0, stream>>>(d_mixture, count);
        CUDA_TRY(CUDA_LAUNCHED("the mixture"));
    }
    CUDA_TRY(CUDA_CALL(cudaMemcpyAsync(out, &d_mixture->fits, sizeof *out, cudaMemcpyDeviceToHost, stream)));
    return CUDA_CALL(cudaStreamSynchronize(stream));
}

pliant_status pliant_cuda_segment_fit(const segment_histogram *histogram, int maximum, cudaStream_t stream,
                                      segment_fits *out)
{
    mixture *d_mixture;
    CUDA_TRY(pliant_cuda_allocate(sizeof *d_mixture, "the mixture", &d_mixture));
    pliant_status status = enqueue(d_mixture, histogram, maximum, stream, out);
    pliant_cuda_release(d_mixture);
    return status;
}
