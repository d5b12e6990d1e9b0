/* Neighbour agreement, connected pieces, specks, and the statistics of the pieces. */
#include "cuda/base/check.h"
#include "cuda/base/prefix_sum.cuh"
#include "cuda/scan/segment_value.cuh"
#include "cuda/base/warp_sum.cuh"

/* ---- Classes. */

__global__ void most_likely_kernel(const gpu_segment segment, int count)
{
    for (int32_t v = (int32_t)(blockIdx.x * blockDim.x + threadIdx.x); v < segment.voxels;
         v += (int32_t)(gridDim.x * blockDim.x)) {
        const float *logs = segment.d_logs + segment.d_bins[v] * PLIANT_MAX_CLASSES;
        int best = 0;
        for (int k = 1; k < count; k++)
            if (logs[k] > logs[best]) best = k;
        segment.d_classes[v] = (uint8_t)best;
    }
}

/* As improve of src/scan/segment.c, for the voxels of one colour of a chessboard. */
__global__ void __launch_bounds__(SEGMENT_THREADS)
    agree_kernel(const gpu_segment segment, int count, float coherence, int colour)
{
    const int32_t nx = segment.size[0], ny = segment.size[1], nz = segment.size[2], slice = nx * ny;
    for (int32_t row = (int32_t)blockIdx.x; row < ny * nz; row += (int32_t)gridDim.x) {
        const int32_t j = row % ny, k = row / ny;
        for (int32_t i = ((j + k + colour) & 1) + 2 * (int32_t)threadIdx.x; i < nx; i += 2 * SEGMENT_THREADS) {
            uint8_t *c = segment.d_classes + i + nx * row;
            const int none = 255;
            const int around[6] = {i > 0 ? c[-1] : none, i + 1 < nx ? c[1] : none, j > 0 ? c[-nx] : none,
                                   j + 1 < ny ? c[nx] : none, k > 0 ? c[-slice] : none, k + 1 < nz ? c[slice] : none};
            const float *logs = segment.d_logs + segment.d_bins[i + nx * row] * PLIANT_MAX_CLASSES;
            const int own = *c;
            int best = own, num = 0;
            bool alike = true;
            for (int n = 0; n < 6; n++) {
                num += around[n] != none;
                alike = alike && (around[n] == none || around[n] == own);
            }
            float highest = logs[own];
            if (alike) highest = logs[own] + (float)num * coherence;
            else
                for (int n = 0; n < 6; n++)
                    if (around[n] == own) highest += coherence;
            for (int n = 0; n < count; n++) {
                float score = logs[n];
                for (int m = 0; m < 6; m++)
                    if (!alike && around[m] == n) score += coherence;
                if (n != own && score > highest) highest = score, best = n;
            }
            *c = (uint8_t)best;
        }
    }
}

pliant_status pliant_cuda_segment_agree(const gpu_segment *segment, int count, float coherence, cudaStream_t stream)
{
    most_likely_kernel<<<SEGMENT_BLOCKS, SEGMENT_THREADS, 0, stream>>>(*segment, count);
    CUDA_TRY(CUDA_LAUNCHED("the classes"));
    for (int sweep = 0; sweep < SEGMENT_SWEEPS; sweep++) /* once a sweep changes nothing, later sweeps change nothing */
        for (int colour = 0; colour < 2; colour++) {
            agree_kernel<<<SEGMENT_BLOCKS, SEGMENT_THREADS, 0, stream>>>(*segment, count, coherence, colour);
            CUDA_TRY(CUDA_LAUNCHED("neighbours that agree"));
        }
    return PLIANT_OK;
}

/* ---- Pieces by union-find, where the lower index becomes the parent (Playne and Hawick 2018). The result does not
 * depend on the order. */

static __device__ int32_t root_of(int32_t *parent, int32_t v)
{
    int32_t p = __ldcg(parent + v);
    for (int32_t above; p != (above = __ldcg(parent + p)); p = above) {}
    return p;
}

static __device__ void join(int32_t *parent, int32_t a, int32_t b)
{
    for (;;) {
        a = root_of(parent, a);
        b = root_of(parent, b);
        if (a == b) return;
        const int32_t low = min(a, b), high = max(a, b), old = atomicMin(parent + high, low);
        if (old == high) return;
        a = old; /* another thread set a parent first; both belong to the same piece */
        b = low;
    }
}

/* Initialize each voxel's parent with the first voxel of its run, within its group of 32 voxels. */
__global__ void run_kernel(const gpu_segment segment)
{
    const int32_t v = (int32_t)(blockIdx.x * blockDim.x + threadIdx.x), lane = (int32_t)threadIdx.x % 32;
    const bool there = v < segment.voxels,
               along = there && v % segment.size[0] > 0 && segment.d_classes[v - 1] == segment.d_classes[v];
    const unsigned breaks = __ballot_sync(0xffffffffu, !along || lane == 0) & (0xffffffffu >> (31 - lane));
    if (there) segment.d_parent[v] = v - lane + (31 - __clz((int)breaks));
}

__global__ void join_kernel(const gpu_segment segment)
{
    const int32_t v = (int32_t)(blockIdx.x * blockDim.x + threadIdx.x), row = segment.size[0],
                  slice = row * segment.size[1];
    if (v >= segment.voxels) return;
    const uint8_t *classes = segment.d_classes, c = classes[v];
    const int32_t i = v % row, j = v / row % segment.size[1];
    const bool along = i > 0 && classes[v - 1] == c;
    if (along && threadIdx.x % 32 == 0) join(segment.d_parent, v, v - 1);
    if (j > 0 && classes[v - row] == c && !(along && classes[v - row - 1] == c)) join(segment.d_parent, v, v - row);
    if (v >= slice && classes[v - slice] == c && !(along && classes[v - slice - 1] == c))
        join(segment.d_parent, v, v - slice);
}

/* Count the roots in every SEGMENT_NUMBERED voxels. */
__global__ void __launch_bounds__(SEGMENT_NUMBERED) flatten_kernel(const gpu_segment segment)
{
    const int32_t v = (int32_t)(blockIdx.x * SEGMENT_NUMBERED + threadIdx.x);
    const int32_t root = v < segment.voxels ? root_of(segment.d_parent, v) : -1;
    if (v < segment.voxels) segment.d_piece[v] = root;
    const int count = __syncthreads_count(root == v);
    if (threadIdx.x == 0) segment.d_block_count[blockIdx.x] = count;
}

/* Replace counts by exclusive prefix sums, with one block. */
__global__ void __launch_bounds__(1024) scan_kernel(int32_t *d_count, int32_t blocks)
{
    __shared__ int32_t sums[1024];
    const int32_t length = (blocks + 1023) / 1024, first = min((int32_t)threadIdx.x * length, blocks),
                  end = min(first + length, blocks);
    int32_t sum = 0;
    for (int32_t b = first; b < end; b++) sum += d_count[b];
    int32_t before = sum_before<1024>(sum, sums);
    for (int32_t b = first; b < end; b++) {
        const int32_t count = d_count[b];
        d_count[b] = before;
        before += count;
    }
    if (threadIdx.x == 1023) d_count[blocks] = sums[1023];
}

/* Number the pieces in the order of their first voxels, which are the roots. */
__global__ void __launch_bounds__(SEGMENT_NUMBERED) number_kernel(const gpu_segment segment, int32_t *d_number)
{
    __shared__ int32_t warps[SEGMENT_NUMBERED / 32];
    const int32_t v = (int32_t)(blockIdx.x * SEGMENT_NUMBERED + threadIdx.x);
    const bool root = v < segment.voxels && segment.d_piece[v] == v;
    const unsigned roots = __ballot_sync(0xffffffffu, root);
    if (threadIdx.x % 32 == 0) warps[threadIdx.x / 32] = __popc(roots);
    __syncthreads();
    if (!root) return;
    int32_t number = segment.d_block_count[blockIdx.x] + __popc(roots & ((1u << threadIdx.x % 32) - 1));
    for (int w = 0; w < (int)threadIdx.x / 32; w++) number += warps[w];
    d_number[v] = number;
}

__global__ void piece_kernel(const gpu_segment segment, const int32_t *d_number)
{
    const int32_t v = (int32_t)(blockIdx.x * blockDim.x + threadIdx.x);
    if (v < segment.voxels) segment.d_piece[v] = d_number[segment.d_piece[v]];
}

static unsigned blocks_of(const gpu_segment *segment, int32_t threads)
{
    return (unsigned)((segment->voxels + (int64_t)threads - 1) / threads);
}

pliant_status pliant_cuda_segment_connect(const gpu_segment *segment, cudaStream_t stream)
{
    const unsigned blocks = blocks_of(segment, SEGMENT_THREADS), numbered = blocks_of(segment, SEGMENT_NUMBERED);
    int32_t *d_number = reinterpret_cast<int32_t *>(segment->d_key);
    run_kernel<<<blocks, SEGMENT_THREADS, 0, stream>>>(*segment);
    CUDA_TRY(CUDA_LAUNCHED("the runs"));
    join_kernel<<<blocks, SEGMENT_THREADS, 0, stream>>>(*segment);
    CUDA_TRY(CUDA_LAUNCHED("the pieces"));
    flatten_kernel<<<numbered, SEGMENT_NUMBERED, 0, stream>>>(*segment);
    CUDA_TRY(CUDA_LAUNCHED("the pieces"));
    scan_kernel<<<1, 1024, 0, stream>>>(segment->d_block_count, (int32_t)numbered);
    CUDA_TRY(CUDA_LAUNCHED("the numbers of the pieces"));
    number_kernel<<<numbered, SEGMENT_NUMBERED, 0, stream>>>(*segment, d_number);
    CUDA_TRY(CUDA_LAUNCHED("the numbers of the pieces"));
    piece_kernel<<<blocks, SEGMENT_THREADS, 0, stream>>>(*segment, d_number);
    return CUDA_LAUNCHED("the numbers of the pieces");
}

/* ---- Specks. */

/* Count the members of pieces. Integer sums do not depend on the order. A warp within one piece adds at once. */
__global__ void members_kernel(const gpu_segment segment, int32_t *d_members)
{
    const int32_t v = (int32_t)(blockIdx.x * blockDim.x + threadIdx.x);
    const bool there = v < segment.voxels;
    const unsigned all = __ballot_sync(0xffffffffu, there);
    if (!there) return;
    const int32_t piece = segment.d_piece[v];
    int same;
    __match_all_sync(all, piece, &same);
    if (!same) atomicAdd(d_members + piece, 1);
    else if (threadIdx.x % 32 == 0) atomicAdd(d_members + piece, __popc(all));
}

__global__ void wait_kernel(const gpu_segment segment, const int32_t *d_members, double minimum)
{
    const int32_t v = (int32_t)(blockIdx.x * blockDim.x + threadIdx.x);
    const bool waits = v < segment.voxels && d_members[segment.d_piece[v]] < minimum;
    if (v < segment.voxels) segment.d_wave[v] = waits ? 255 : 0;
    const unsigned waiting = __ballot_sync(0xffffffffu, waits);
    if (threadIdx.x % 32 == 0 && waiting) atomicAdd(segment.d_left, __popc(waiting));
}

pliant_status pliant_cuda_segment_wait(const gpu_segment *segment, double minimum, cudaStream_t stream)
{
    const unsigned blocks = blocks_of(segment, SEGMENT_THREADS);
    int32_t *d_members = reinterpret_cast<int32_t *>(segment->d_key);
    CUDA_TRY(CUDA_CALL(cudaMemsetAsync(d_members, 0, (size_t)segment->voxels * sizeof *d_members, stream)));
    CUDA_TRY(CUDA_CALL(cudaMemsetAsync(segment->d_left, 0, sizeof *segment->d_left, stream)));
    members_kernel<<<blocks, SEGMENT_THREADS, 0, stream>>>(*segment, d_members);
    CUDA_TRY(CUDA_LAUNCHED("the sizes of the pieces"));
    wait_kernel<<<blocks, SEGMENT_THREADS, 0, stream>>>(*segment, d_members, minimum);
    return CUDA_LAUNCHED("the specks");
}

/* Give a speck's voxel the class of the neighbour that would reach it first in the CPU's queue. In the queue, voxels
 * are ordered by the voxel that reached them, and then by side. The key encodes this path: the starting voxel, followed
 * by 3 bits per wave. */
__global__ void wave_kernel(const gpu_segment segment, int wave)
{
    const int32_t v = (int32_t)(blockIdx.x * blockDim.x + threadIdx.x);
    if (v >= segment.voxels || segment.d_wave[v] != 255) return;
    const int32_t size[3] = {segment.size[0], segment.size[1], segment.size[2]},
                  step[3] = {1, size[0], size[0] * size[1]};
    const int32_t at[3] = {v % size[0], v / size[0] % size[1], v / step[2]};
    unsigned long long first = ~0ull;
    int32_t from = -1;
    for (int side = 0; side < 6; side++) { /* sides as seen from the other voxel: odd sides point upwards */
        const int d = side / 2;
        if (side & 1 ? at[d] == 0 : at[d] + 1 >= size[d]) continue;
        const int32_t other = side & 1 ? v - step[d] : v + step[d];
        if (segment.d_wave[other] != wave - 1) continue;
        const unsigned long long key =
            (wave == 1 ? (unsigned long long)other : segment.d_key[other]) * 8 + (unsigned)side;
        if (key < first) first = key, from = other;
    }
    if (from < 0) return;
    segment.d_key[v] = first;
    segment.d_classes[v] = segment.d_classes[from];
    segment.d_parent[v] = wave; /* other threads still read d_wave */
}

__global__ void wave_end_kernel(const gpu_segment segment, int wave)
{
    const int32_t v = (int32_t)(blockIdx.x * blockDim.x + threadIdx.x);
    const bool waits = v < segment.voxels && segment.d_wave[v] == 255, reached = waits && segment.d_parent[v] == wave;
    if (reached) segment.d_wave[v] = (uint8_t)wave;
    const unsigned left = __ballot_sync(0xffffffffu, reached);
    if (threadIdx.x % 32 == 0 && left) atomicSub(segment.d_left, __popc(left));
}

pliant_status pliant_cuda_segment_absorb(const gpu_segment *segment, cudaStream_t stream)
{
    const unsigned blocks = blocks_of(segment, SEGMENT_THREADS);
    CUDA_TRY(
        CUDA_CALL(cudaMemsetAsync(segment->d_parent, 0, (size_t)segment->voxels * sizeof *segment->d_parent, stream)));
    for (int wave = 1; wave <= SEGMENT_MAX_WAVES; wave++) {
        wave_kernel<<<blocks, SEGMENT_THREADS, 0, stream>>>(*segment, wave);
        CUDA_TRY(CUDA_LAUNCHED("the specks"));
        wave_end_kernel<<<blocks, SEGMENT_THREADS, 0, stream>>>(*segment, wave);
        CUDA_TRY(CUDA_LAUNCHED("the specks"));
    }
    return PLIANT_OK;
}

/* ---- Statistics. */

/* Integer sums do not depend on the order. */
__global__ void tally_kernel(const gpu_segment segment, double quantum, gpu_tally *d_tallies)
{
    const int32_t v = (int32_t)(blockIdx.x * blockDim.x + threadIdx.x);
    const bool there = v < segment.voxels;
    const int32_t piece = there ? segment.d_piece[v] : -1;
    int same;
    __match_all_sync(0xffffffffu, piece, &same);
    long long sums[5] = {1, v % segment.size[0], v / segment.size[0] % segment.size[1],
                         v / segment.size[0] / segment.size[1],
                         there ? __double2ll_rn((double)value_of(segment, v) / quantum) : 0};
    if (same)
        for (int s = 0; s < 5; s++) sums[s] = warp_sum(sums[s]);
    if (!there || (same && threadIdx.x % 32 != 0)) return;
    gpu_tally *tally = d_tallies + piece;
    atomicAdd(&tally->voxels, (unsigned long long)sums[0]);
    for (int d = 0; d < 3; d++) atomicAdd(&tally->at[d], (unsigned long long)sums[1 + d]);
    atomicAdd(reinterpret_cast<unsigned long long *>(&tally->value), (unsigned long long)sums[4]);
    tally->class_index = segment.d_classes[v];
}

__global__ void label_kernel(const gpu_segment segment, const uint16_t *d_label)
{
    const int32_t v = (int32_t)(blockIdx.x * blockDim.x + threadIdx.x);
    if (v < segment.voxels) segment.d_raw[v] = d_label[segment.d_piece[v]];
}

pliant_status pliant_cuda_segment_tally(const gpu_segment *segment, double quantum, gpu_tally *d_tallies, int32_t count,
                                        cudaStream_t stream)
{
    CUDA_TRY(CUDA_CALL(cudaMemsetAsync(d_tallies, 0, (size_t)count * sizeof *d_tallies, stream)));
    tally_kernel<<<blocks_of(segment, SEGMENT_THREADS), SEGMENT_THREADS, 0, stream>>>(*segment, quantum, d_tallies);
    return CUDA_LAUNCHED("what is told of the pieces");
}

pliant_status pliant_cuda_segment_label(const gpu_segment *segment, const uint16_t *d_label, cudaStream_t stream)
{
    label_kernel<<<blocks_of(segment, SEGMENT_THREADS), SEGMENT_THREADS, 0, stream>>>(*segment, d_label);
    return CUDA_LAUNCHED("the labels");
}
