#include "cuda/base/check.h"
#include "cuda/base/launch.h"
#include "base/fail.h"
#include "cuda/fem/linear/inverse.h"
#include "cuda/fem/linear/sweep.cuh"

#include <cstring>

enum { TILE = INVERSE_TILE, THREADS = 256 };

/* ---- The matrix at rest, in tiles of SWEEP. */

struct sparse { int num_columns, num_blocks; const int *start, *row; const double *values; };

/* Copy the matrix to tiles, one thread per block of the pattern (layout: src/fem/linear/pattern.c). */
static __global__ void scatter_kernel(sparse matrix, double *tiles)
{
    int b = (int)(blockIdx.x * blockDim.x + threadIdx.x);
    if (b >= matrix.num_blocks) return;
    int low = 0, high = matrix.num_columns; /* search for the column that contains the block */
    while (high - low > 1) {
        int middle = (low + high) / 2;
        if (matrix.start[middle] <= b) low = middle;
        else high = middle;
    }
    long long first = matrix.start[low], height = matrix.start[low + 1] - first, place = b - first;
    long long begin = 9 * first - 3 * (long long)low;
    for (int c = 0; c < 3; c++) {
        for (int r = place == 0 ? c : 0; r < 3; r++)
            put(tiles, 3 * matrix.row[b] + r, 3 * low + c,
                matrix.values[begin + (place == 0 ? r - c : 3 * place - c + r)]);
        begin += 3 * height - c;
    }
}

static __global__ void pad_kernel(double *tiles, int size, int padded)
{
    int n = size + (int)threadIdx.x;
    if (n < padded) put(tiles, n, n, 1);
}

/* ---- The inverse: minus the result of a sweep over all unknowns. */

static __global__ void narrow_kernel(const double *sweep, float *tiles)
{
    int i = (int)blockIdx.y, j = (int)blockIdx.x;
    if (j > i) return;
    float *tile = tiles + (size_t)TILE * TILE * triangle(i, j);
    for (int n = (int)threadIdx.x; n < TILE * TILE; n += (int)blockDim.x) {
        int row = TILE * i + n / TILE, column = TILE * j + n % TILE;
        int high = row / SWEEP >= column / SWEEP ? row : column, low = high == row ? column : row;
        tile[n] =
            (float)-sweep[SWEEP_TILE * triangle(high / SWEEP, low / SWEEP) + SWEEP * (high % SWEEP) + low % SWEEP];
    }
}

static __global__ void diagonal_kernel(const double *tiles, int padded, double *out)
{
    const int n = (int)(blockIdx.x * blockDim.x + threadIdx.x), tile = n / SWEEP, place = n % SWEEP;
    if (n < padded) out[n] = tiles[SWEEP_TILE * triangle((size_t)tile, (size_t)tile) + SWEEP * place + place];
}

/* Pivot threshold for zero, as a fraction of the original diagonal. It is far above rounding errors. */
static constexpr double nothing = 1e-10;

struct workspace { gpu_sweep sweep; int *d_start, *d_row; double *d_values, *d_whole; };

static void workspace_free(workspace *work)
{
    pliant_cuda_release(work->sweep.d_tiles, work->sweep.d_buffer, work->sweep.d_failed, work->d_start, work->d_row,
                        work->d_values, work->d_whole);
}

static pliant_status find_failed(const gpu_sweep *sweep, cudaStream_t stream)
{
    int h_failed = 0;
    /* Otherwise the copy would wait, and block copies of other threads. */
    CUDA_TRY(CUDA_CALL(cudaStreamSynchronize(stream)));
    CUDA_TRY(CUDA_CALL(cudaMemcpyAsync(&h_failed, sweep->d_failed, sizeof h_failed, cudaMemcpyDeviceToHost, stream)));
    CUDA_TRY(CUDA_CALL(cudaStreamSynchronize(stream)));
    if (h_failed)
        return pliant_fail(PLIANT_ERROR_NUMERIC,
                           "the stiffness matrix is not positive definite: it has no inverse on the GPU");
    return PLIANT_OK;
}

static pliant_status invert(const pliant_pattern *pattern, const double *h_values, bool holds, cudaStream_t stream,
                            workspace *work, gpu_inverse *out)
{
    const int padded = out->tiles * TILE, sweeps = padded / SWEEP;
    const size_t bytes = pliant_cuda_sweep_bytes(sweeps);
    gpu_sweep *sweep = &work->sweep;
    CUDA_TRY(pliant_cuda_allocate(bytes, "the inverse", &sweep->d_tiles));
    CUDA_TRY(pliant_cuda_allocate(pliant_cuda_sweep_buffer_bytes(sweeps), "the inverse", &sweep->d_buffer));
    CUDA_TRY(pliant_cuda_allocate(sizeof(int), "the inverse", &sweep->d_failed));
    CUDA_TRY(pliant_cuda_upload(pattern->start, ((size_t)pattern->num_columns + 1) * sizeof *pattern->start,
                                "the matrix", stream, &work->d_start));
    CUDA_TRY(pliant_cuda_upload(pattern->row, (size_t)pattern->num_blocks * sizeof *pattern->row, "the matrix", stream,
                                &work->d_row));
    CUDA_TRY(pliant_cuda_upload(h_values, (size_t)pattern->num_values * sizeof *h_values, "the matrix", stream,
                                &work->d_values));
    CUDA_TRY(CUDA_CALL(cudaMemsetAsync(sweep->d_tiles, 0, bytes, stream)));
    CUDA_TRY(CUDA_CALL(cudaMemsetAsync(sweep->d_failed, 0, sizeof(int), stream)));
    sparse matrix = {pattern->num_columns, pattern->num_blocks, work->d_start, work->d_row, work->d_values};
    scatter_kernel<<<blocks_for(matrix.num_blocks, THREADS), THREADS, 0, stream>>>(matrix, sweep->d_tiles);
    CUDA_TRY(CUDA_LAUNCHED("scatter_kernel"));
    pad_kernel<<<1, TILE, 0, stream>>>(sweep->d_tiles, out->size, padded);
    CUDA_TRY(CUDA_LAUNCHED("pad_kernel"));
    if (holds) {
        CUDA_TRY(pliant_cuda_allocate((size_t)padded * sizeof *work->d_whole, "the inverse", &work->d_whole));
        diagonal_kernel<<<blocks_for(padded, THREADS), THREADS, 0, stream>>>(sweep->d_tiles, padded, work->d_whole);
        CUDA_TRY(CUDA_LAUNCHED("diagonal_kernel"));
    }
    CUDA_TRY(pliant_cuda_sweep(sweep, work->d_whole, nothing, sweeps, sweeps, stream));
    CUDA_TRY(find_failed(sweep, stream));
    narrow_kernel<<<dim3((unsigned)out->tiles, (unsigned)out->tiles), THREADS, 0, stream>>>(sweep->d_tiles,
                                                                                            out->d_tiles);
    CUDA_TRY(CUDA_LAUNCHED("narrow_kernel"));
    return CUDA_CALL(cudaStreamSynchronize(stream));
}

int32_t pliant_cuda_inverse_padded(int32_t size) { return (size + TILE - 1) / TILE * TILE; }

size_t pliant_cuda_inverse_memory(int32_t size, size_t *kept)
{
    size_t padded = (size_t)pliant_cuda_inverse_padded(size), tiles = padded / TILE;
    *kept = triangle(tiles, 0) * TILE * TILE * sizeof(float) + tiles * padded * sizeof(float);
    return *kept + pliant_cuda_sweep_bytes((int32_t)(padded / SWEEP)) +
           pliant_cuda_sweep_buffer_bytes((int32_t)(padded / SWEEP));
}

pliant_status pliant_cuda_inverse_create(const pliant_pattern *pattern, const double *h_values, bool holds,
                                         cudaStream_t stream, gpu_inverse *out)
{
    gpu_inverse made = {};
    workspace work = {};
    made.size = 3 * pattern->num_columns;
    made.tiles = pliant_cuda_inverse_padded(made.size) / TILE;
    const size_t tiles = (size_t)made.tiles;
    pliant_status status =
        pliant_cuda_allocate(triangle(tiles, 0) * TILE * TILE * sizeof(float), "the inverse", &made.d_tiles);
    if (status == PLIANT_OK)
        status = pliant_cuda_allocate(tiles * tiles * TILE * sizeof(float), "the inverse", &made.d_parts);
    if (status == PLIANT_OK) status = invert(pattern, h_values, holds, stream, &work, &made);
    workspace_free(&work);
    if (status != PLIANT_OK) {
        pliant_cuda_inverse_free(&made);
        return status;
    }
    *out = made;
    return PLIANT_OK;
}

void pliant_cuda_inverse_free(gpu_inverse *inverse)
{
    pliant_cuda_release(inverse->d_tiles);
    pliant_cuda_release(inverse->d_parts);
    memset(inverse, 0, sizeof *inverse);
}

/* ---- In a step. */

/* Return the tile of a block: row i, column j <= i, row by row. */
static __device__ __forceinline__ void tile_of(int block, int *i, int *j)
{
    int row = (int)((sqrtf(8.0f * (float)block + 1.0f) - 1.0f) * 0.5f);
    while ((row + 1) * (row + 2) / 2 <= block) row++;
    while (row * (row + 1) / 2 > block) row--;
    *i = row;
    *j = block - row * (row + 1) / 2;
}

template <int HALF> static __device__ __forceinline__ void fold(float *p, int lane)
{
    bool upper = lane & 2 * HALF;
#pragma unroll
    for (int q = 0; q < HALF; q++) {
        float give = upper ? p[q] : p[q + HALF], keep = upper ? p[q + HALF] : p[q];
        p[q] = keep + __shfl_xor_sync(0xffffffff, give, 2 * HALF);
    }
}

/* Sum 16 numbers of each lane over the warp. Lane l returns the sum of number l / 2. */
static __device__ __forceinline__ float sum_rows(float *p, int lane)
{
    fold<8>(p, lane);
    fold<4>(p, lane);
    fold<2>(p, lane);
    fold<1>(p, lane);
    return p[0] + __shfl_xor_sync(0xffffffff, p[0], 1);
}

/* Multiply one tile per block. Its rows contribute to the unknowns of its row, and below the diagonal its columns
 * contribute to the unknowns of its column. For several vectors the tile is read once. */
template <bool SEVERAL>
static __global__ void __launch_bounds__(THREADS)
    product_kernel(gpu_inverse inverse, const int *d_skip, int count, size_t stride, const float *__restrict__ d_right)
{
    enum { WARPS = THREADS / 32, ROWS = TILE / WARPS };
    __shared__ float4 columns[WARPS][32];
    if (d_skip && *d_skip) return;
    int i, j;
    tile_of((int)blockIdx.x, &i, &j);
    const int warp = (int)threadIdx.x / 32, lane = (int)threadIdx.x % 32, padded = inverse.tiles * TILE;
    const float4 *tile = reinterpret_cast<const float4 *>(inverse.d_tiles + (size_t)TILE * TILE * blockIdx.x) +
                         warp * ROWS * (TILE / 4) + lane;
    float4 kept[SEVERAL ? ROWS : 1];
#pragma unroll
    for (int r = 0; SEVERAL && r < ROWS; r++) kept[r] = __ldcs(tile + r * (TILE / 4));
    for (int v = 0; v < (SEVERAL ? count : 1); v++) {
        const float4 x = reinterpret_cast<const float4 *>(d_right + TILE * j)[lane];
        const float own = d_right[TILE * i + warp * ROWS + lane % ROWS];
        float sums[ROWS];
        float4 column = make_float4(0, 0, 0, 0);
#pragma unroll
        for (int r = 0; r < ROWS; r++) {
            float4 a = SEVERAL ? kept[r] : __ldcs(tile + r * (TILE / 4));
            float at = __shfl_sync(0xffffffff, own, r);
            sums[r] = a.x * x.x + a.y * x.y + a.z * x.z + a.w * x.w;
            column.x += a.x * at;
            column.y += a.y * at;
            column.z += a.z * at;
            column.w += a.w * at;
        }
        float sum = sum_rows(sums, lane);
        if (lane % 2 == 0) inverse.d_parts[(size_t)padded * j + TILE * i + warp * ROWS + lane / 2] = sum;
        if (i != j) {
            if (SEVERAL) __syncthreads();
            columns[warp][lane] = column;
            __syncthreads();
            float whole = 0;
            for (int w = 0; w < WARPS && threadIdx.x < TILE; w++)
                whole += reinterpret_cast<const float *>(columns[w])[threadIdx.x];
            if (threadIdx.x < TILE) inverse.d_parts[(size_t)padded * i + TILE * j + threadIdx.x] = whole;
        }
        d_right += stride;
        inverse.d_parts += (size_t)inverse.tiles * (size_t)padded;
    }
}

enum { SUM_ROWS = 32, SUM_GROUPS = THREADS / SUM_ROWS };

static __global__ void __launch_bounds__(THREADS)
    sum_kernel(gpu_inverse inverse, const int *d_skip, size_t stride, float *__restrict__ d_left)
{
    __shared__ float sums[SUM_GROUPS][SUM_ROWS];
    if (d_skip && *d_skip) return;
    const int row = (int)threadIdx.x % SUM_ROWS, group = (int)threadIdx.x / SUM_ROWS,
              n = (int)blockIdx.x * SUM_ROWS + row;
    const size_t padded = (size_t)inverse.tiles * TILE;
    d_left += stride * blockIdx.y;
    inverse.d_parts += (size_t)inverse.tiles * padded * blockIdx.y;
    float sum = 0;
#pragma unroll 4
    for (int k = group; k < inverse.tiles; k += SUM_GROUPS) sum += inverse.d_parts[padded * (size_t)k + n];
    sums[group][row] = sum;
    __syncthreads();
    if (group != 0) return;
    for (int g = 1; g < SUM_GROUPS; g++) sum += sums[g][row];
    d_left[n] = sum;
}

pliant_status pliant_cuda_inverse_apply_all(const gpu_inverse *inverse, const int32_t *d_skip, int32_t count,
                                            size_t stride, const float *d_right, float *d_left, cudaStream_t stream)
{
    const unsigned tiles = (unsigned)triangle((size_t)inverse->tiles, 0);
    if (count > 1) product_kernel<true><<<tiles, THREADS, 0, stream>>>(*inverse, d_skip, count, stride, d_right);
    else product_kernel<false><<<tiles, THREADS, 0, stream>>>(*inverse, d_skip, count, stride, d_right);
    CUDA_TRY(CUDA_LAUNCHED("product_kernel"));
    sum_kernel<<<dim3((unsigned)(inverse->tiles * TILE / SUM_ROWS), (unsigned)count), THREADS, 0, stream>>>(
        *inverse, d_skip, stride, d_left);
    return CUDA_LAUNCHED("sum_kernel");
}

pliant_status pliant_cuda_inverse_apply(const gpu_inverse *inverse, const int32_t *d_skip, const float *d_right,
                                        float *d_left, cudaStream_t stream)
{
    return pliant_cuda_inverse_apply_all(inverse, d_skip, 1, 0, d_right, d_left, stream);
}

size_t pliant_cuda_inverse_parts(const gpu_inverse *inverse)
{
    return (size_t)inverse->tiles * TILE * (size_t)inverse->tiles;
}

static __device__ __forceinline__ float entry(const gpu_inverse &inverse, int row, int column)
{
    int high = row / TILE >= column / TILE ? row : column, low = high == row ? column : row;
    return inverse.d_tiles[(size_t)TILE * TILE * triangle((size_t)(high / TILE), (size_t)(low / TILE)) +
                           TILE * (high % TILE) + low % TILE];
}

static __global__ void __launch_bounds__(THREADS)
    column_kernel(gpu_inverse inverse, const int32_t *d_which, size_t stride, float *d_column)
{
    const int n = (int)(blockIdx.x * THREADS + threadIdx.x), axis = (int)blockIdx.y % 3;
    const int32_t *which = d_which + 2 * (size_t)(blockIdx.y / 3);
    if (n < inverse.size) d_column[stride * (size_t)(which[1] + axis) + n] = entry(inverse, n, 3 * which[0] + axis);
}

pliant_status pliant_cuda_inverse_columns(const gpu_inverse *inverse, int32_t count, const int32_t *d_which,
                                          size_t stride, float *d_column, cudaStream_t stream)
{
    const unsigned blocks = blocks_for(inverse->size, THREADS);
    column_kernel<<<dim3(blocks, 3 * (unsigned)count), THREADS, 0, stream>>>(*inverse, d_which, stride, d_column);
    return CUDA_LAUNCHED("column_kernel");
}

enum { RESPONSE_NODES = 64, RESPONSE_ROWS = 3 * RESPONSE_NODES, RESPONSE_CHUNK = 32 };

/* Compute the response, one thread per unknown. */
static __global__ void __launch_bounds__(RESPONSE_ROWS)
    response_kernel(gpu_inverse inverse, gpu_iteration iteration, gpu_tool tool, double *d_response)
{
    __shared__ double turned[RESPONSE_CHUNK][3][3], sums[3][RESPONSE_ROWS];
    __shared__ int unknown[RESPONSE_CHUNK];
    const int thread = (int)threadIdx.x, n = (int)blockIdx.x * RESPONSE_ROWS + thread;
    double sum[3] = {0, 0, 0};
    for (int first = 0; first < tool.count; first += RESPONSE_CHUNK) {
        int here = tool.count - first < RESPONSE_CHUNK ? tool.count - first : RESPONSE_CHUNK;
        __syncthreads();
        for (int m = thread; m < 9 * here; m += RESPONSE_ROWS) { /* T' of W' e_d */
            int h = m / 9, d = m / 3 % 3, c = m % 3, node = tool.d_unknown[first + h];
            const double *turn = iteration.d_axes + 9 * (size_t)node,
                         *block = tool.d_block + 9 * (size_t)(first + h) + 3 * d;
            turned[h][d][c] = turn[c] * block[0] + turn[3 + c] * block[1] + turn[6 + c] * block[2];
            if (m % 9 == 0) unknown[h] = node;
        }
        __syncthreads();
        if (n >= inverse.size) continue;
        for (int h = 0; h < here; h++)
            for (int c = 0; c < 3; c++) {
                double a = entry(inverse, n, 3 * unknown[h] + c);
                for (int d = 0; d < 3; d++) sum[d] += a * turned[h][d][c];
            }
    }
    for (int d = 0; d < 3; d++) sums[d][thread] = sum[d];
    __syncthreads();
    if (n >= inverse.size) return;
    const double *turn = iteration.d_axes + 9 * (size_t)(n / 3) + 3 * (n % 3);
    const int base = thread - thread % 3;
    for (int d = 0; d < 3; d++)
        d_response[(size_t)inverse.size * d + n] =
            turn[0] * sums[d][base] + turn[1] * sums[d][base + 1] + turn[2] * sums[d][base + 2];
}

pliant_status pliant_cuda_inverse_response(const gpu_inverse *inverse, const gpu_iteration *iteration,
                                           const gpu_tool *tool, double *d_response, cudaStream_t stream)
{
    unsigned blocks = (unsigned)((inverse->size + RESPONSE_ROWS - 1) / RESPONSE_ROWS);
    response_kernel<<<blocks, RESPONSE_ROWS, 0, stream>>>(*inverse, *iteration, *tool, d_response);
    return CUDA_LAUNCHED("response_kernel");
}
