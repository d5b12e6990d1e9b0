#include "cuda/base/check.h"
#include "cuda/fem/linear/sweep.cuh"

enum { THREADS = 256 };

/* ---- Symmetric sweep over SWEEP unknowns at a time. After all unknowns the tiles hold minus the inverse.
 *     P = A_kk^-1, C = A_ik, B = C P;  A_ij -= B_i C_j',  A_ik = B,  A_kk = -P */

static __global__ void __launch_bounds__(THREADS)
    pivot_kernel(double *tile, const double *whole, double fraction, double *pivot, int *failed)
{
    __shared__ double a[SWEEP][SWEEP], row[SWEEP], column[SWEEP];
    for (int n = (int)threadIdx.x; n < SWEEP_TILE; n += THREADS) a[n / SWEEP][n % SWEEP] = tile[n];
    __syncthreads();
    for (int p = 0; p < SWEEP; p++) {
        if (threadIdx.x < SWEEP) {
            row[threadIdx.x] = a[p][threadIdx.x];
            column[threadIdx.x] = a[threadIdx.x][p];
        }
        __syncthreads();
        double d = row[p];
        if (whole && !(d > fraction * whole[p])) {
            d = whole[p] > 0 ? whole[p] : 1;
        } else if (!(d > 0)) {
            if (threadIdx.x == 0) *failed = 1;
            return; /* the same for all threads */
        }
        d = 1 / d;
        for (int n = (int)threadIdx.x; n < SWEEP_TILE; n += THREADS) {
            int r = n / SWEEP, c = n % SWEEP;
            double by = column[r] * d;
            a[r][c] = r == p ? (c == p ? d : row[c] * d) : c == p ? -by : a[r][c] - by * row[c];
        }
        __syncthreads();
    }
    for (int n = (int)threadIdx.x; n < SWEEP_TILE; n += THREADS) {
        pivot[n] = a[n / SWEEP][n % SWEEP];
        tile[n] = -a[n / SWEEP][n % SWEEP];
    }
}

/* Compute the sum over m of left[r][m] * right[c][m], for 4 x 4 numbers per thread. */
static __device__ __forceinline__ void multiply(const double *left, const double *right, double sum[4][4])
{
    enum { DEEP = 16 };
    __shared__ double a[DEEP][SWEEP + 2], b[DEEP][SWEEP + 2];
    const int thread = (int)threadIdx.x, x = thread % 16, y = thread / 16;
    for (int begin = 0; begin < SWEEP; begin += DEEP) {
        __syncthreads();
        for (int n = thread; n < SWEEP * DEEP; n += THREADS) {
            a[n % DEEP][n / DEEP] = left[SWEEP * (n / DEEP) + begin + n % DEEP];
            b[n % DEEP][n / DEEP] = right[SWEEP * (n / DEEP) + begin + n % DEEP];
        }
        __syncthreads();
#pragma unroll
        for (int m = 0; m < DEEP; m++)
#pragma unroll
            for (int r = 0; r < 4; r++)
#pragma unroll
                for (int c = 0; c < 4; c++) sum[r][c] += a[m][4 * y + r] * b[m][4 * x + c];
    }
}

static __global__ void __launch_bounds__(THREADS) copy_panel_kernel(const double *tiles, int k, double *old)
{
    int i = (int)blockIdx.x;
    const double *tile = tiles + SWEEP_TILE * (i >= k ? triangle(i, k) : triangle(k, i));
    for (int n = (int)threadIdx.x; n < SWEEP_TILE; n += THREADS)
        old[(size_t)SWEEP_TILE * i + n] = i >= k ? tile[n] : tile[SWEEP * (n % SWEEP) + n / SWEEP];
}

/* P is symmetric: its rows are its columns */
static __global__ void __launch_bounds__(THREADS)
    panel_kernel(double *tiles, int k, const double *pivot, const double *old, double *panel)
{
    int i = (int)blockIdx.x;
    if (i == k) return;
    double sum[4][4] = {};
    multiply(old + (size_t)SWEEP_TILE * i, pivot, sum);
    double *tile = tiles + SWEEP_TILE * (i >= k ? triangle(i, k) : triangle(k, i));
    const int x = (int)threadIdx.x % 16, y = (int)threadIdx.x / 16;
    for (int r = 0; r < 4; r++)
        for (int c = 0; c < 4; c++) {
            int row = 4 * y + r, column = 4 * x + c;
            panel[(size_t)SWEEP_TILE * i + SWEEP * row + column] = sum[r][c];
            tile[i >= k ? SWEEP * row + column : SWEEP * column + row] = sum[r][c];
        }
}

/* Update only columns of pivots, since later sweeps read no others. */
static __global__ void __launch_bounds__(THREADS)
    update_kernel(double *tiles, int k, const double *old, const double *panel)
{
    int i = (int)blockIdx.y, j = (int)blockIdx.x;
    if (j > i || i == k || j == k) return;
    double sum[4][4] = {};
    multiply(panel + (size_t)SWEEP_TILE * i, old + (size_t)SWEEP_TILE * j, sum);
    double *tile = tiles + SWEEP_TILE * triangle(i, j);
    const int x = (int)threadIdx.x % 16, y = (int)threadIdx.x / 16;
    for (int r = 0; r < 4; r++)
        for (int c = 0; c < 4; c++) tile[SWEEP * (4 * y + r) + 4 * x + c] -= sum[r][c];
}

size_t pliant_cuda_sweep_bytes(int32_t tiles) { return triangle((size_t)tiles, 0) * SWEEP_TILE * sizeof(double); }
size_t pliant_cuda_sweep_buffer_bytes(int32_t tiles) { return (2 * (size_t)tiles + 1) * SWEEP_TILE * sizeof(double); }

pliant_status pliant_cuda_sweep(const gpu_sweep *sweep, const double *d_whole, double fraction, int32_t pivots,
                                int32_t tiles, cudaStream_t stream)
{
    double *d_old = sweep->d_buffer, *d_panel = d_old + (size_t)SWEEP_TILE * (size_t)tiles,
           *d_pivot = d_panel + (size_t)SWEEP_TILE * (size_t)tiles;
    for (int k = 0; k < pivots; k++) {
        pivot_kernel<<<1, THREADS, 0, stream>>>(sweep->d_tiles + SWEEP_TILE * triangle((size_t)k, (size_t)k),
                                                d_whole ? d_whole + SWEEP * k : nullptr, fraction, d_pivot,
                                                sweep->d_failed);
        copy_panel_kernel<<<(unsigned)tiles, THREADS, 0, stream>>>(sweep->d_tiles, k, d_old);
        panel_kernel<<<(unsigned)tiles, THREADS, 0, stream>>>(sweep->d_tiles, k, d_pivot, d_old, d_panel);
        update_kernel<<<dim3((unsigned)pivots, (unsigned)tiles), THREADS, 0, stream>>>(sweep->d_tiles, k, d_old,
                                                                                       d_panel);
        CUDA_TRY(CUDA_LAUNCHED("update_kernel"));
    }
    return PLIANT_OK;
}
