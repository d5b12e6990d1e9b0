/* Inner loops with AVX-512. A row of a brick is one register of floats, and the masks of its owners are mask registers.
 * Voxels are loaded as with AVX2. */
#include "warp/inner_loops.h"

#if defined(__x86_64__) && defined(__GNUC__)

#include "warp/simd.h"

#define SIMD_ROWS 8
#define SIMD __attribute__((target("avx512f,avx512bw,avx512dq,avx512vl,avx2,popcnt")))
#define SIMD_INLINE \
    static inline __attribute__((always_inline, target("avx512f,avx512bw,avx512dq,avx512vl,avx2,popcnt")))

SIMD_INLINE int32_t claim_rows(raster_brick *brick, const raster_tet *tet, const brick_planes *planes,
                               const owner_box *box, uint32_t entry, const int32_t num_rising, const int32_t num_others)
{
    const __m512d first_voxel = _mm512_set1_pd(OWNER_SHIFT - box->low[0]),
                  last_voxel = _mm512_set1_pd(OWNER_SHIFT + box->high[0]);
    const __m256i ones = _mm256_set1_epi32(ENTRY_MASK);
    const __m128i entries = _mm_set1_epi32((int32_t)entry);
    const int32_t first_group = box->low[1] / SIMD_ROWS, last_group = box->high[1] / SIMD_ROWS;
    const int32_t count = num_rising + num_others;
    const __m512d rows = _mm512_setr_pd(0, 1, 2, 3, 4, 5, 6, 7);
    __m512d start[6], factor[6], step_group[6], step_k[6]; /* start: values in the first rows of the slice */
    uint32_t rising = planes->rising, others = planes->others;
    for (int32_t p = 0; p < count; p++) {
        uint32_t *left = p < num_rising ? &rising : &others;
        const int v = __builtin_ctz(*left);
        *left &= *left - 1;
        factor[p] = _mm512_set1_pd(tet->factor[v]);
        step_k[p] = _mm512_set1_pd(tet->normal[2][v]);
        step_group[p] = _mm512_set1_pd(planes->step_group[v]);
        start[p] =
            _mm512_add_pd(_mm512_set1_pd(planes->start[v]), _mm512_mul_pd(_mm512_set1_pd(tet->normal[1][v]), rows));
    }
    int32_t claimed = 0;
    for (int32_t k = box->low[2]; k <= box->high[2]; k++) {
        __m512d at[6];
        for (int32_t p = 0; p < count; p++) {
            at[p] = start[p];
            start[p] = _mm512_add_pd(start[p], step_k[p]);
        }
        for (int32_t g = first_group; g <= last_group; g++) {
            __m512d rise = first_voxel, fall = last_voxel;
            for (int32_t p = 0; p < count; p++) {
                __m512d t = _mm512_mul_pd(at[p], factor[p]);
                if (p < num_rising)
                    rise = _mm512_min_pd(t, rise);
                else
                    fall = _mm512_min_pd(t, fall);
                at[p] = _mm512_add_pd(at[p], step_group[p]);
            }
            /* A shift by more than 16 or 31 bits, also after conversion to INT_MIN, leaves no bit. */
            __m256i first = _mm256_sub_epi32(_mm256_set1_epi32(OWNER_SHIFT), _mm512_cvttpd_epi32(rise));
            __m256i beyond = _mm256_sub_epi32(_mm256_set1_epi32(OWNER_SHIFT + BRICK - 1), _mm512_cvttpd_epi32(fall));
            __m256i mask = _mm256_and_si256(_mm256_sllv_epi32(ones, first), _mm256_srlv_epi32(ones, beyond));
            int32_t group = (k * BRICK + g * SIMD_ROWS) / ROWS_AT_ONCE; /* this group and the next one */
            __m128i *owned = (__m128i *)(void *)&brick->owned[group];
            __m128i before = _mm_loadu_si128(owned), fresh = _mm_andnot_si128(before, _mm256_cvtepi32_epi16(mask));
            if (_mm_testz_si128(fresh, fresh)) continue;
            _mm_storeu_si128(owned, _mm_or_si128(before, fresh));
            uint64_t near = (uint64_t)_mm_cvtsi128_si64(fresh), far = (uint64_t)_mm_extract_epi64(fresh, 1);
            claimed += (int32_t)(_mm_popcnt_u64(near) + _mm_popcnt_u64(far));
            add_entries(brick, group, fresh, entries);
            add_entries(brick, group + 1, _mm_srli_si128(fresh, 8), entries);
        }
    }
    return claimed;
}

CLAIM_FUNCTIONS

/* source coordinates of the 16 voxels of a row */
typedef struct row_points { __m512 at[3]; } row_points;

/* Map the sampled voxels of a row, each by its owner's map. */
SIMD_INLINE row_kinds find_points(const raster_brick *brick, int32_t row, row_points *points)
{
    const __m512 voxels = _mm512_setr_ps(0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11, 12, 13, 14, 15);
    const __m128 j = _mm_set1_ps((float)(row % BRICK)), k = _mm_set1_ps((float)(row / BRICK));
    const int count = brick->num_entries[row];
    row_kinds kinds = {0, 0};
    for (int d = 0; d < 3; d++) points->at[d] = _mm512_setzero_ps();
    for (int e = 0; e < count; e++) {
        uint32_t entry = brick->entry[e][row];
        if (entry & ENTRY_COPY) {
            kinds.copied |= entry;
            continue;
        }
        kinds.sampled |= entry;
        const raster_slot *map = &brick->slot[entry >> ENTRY_SLOT_SHIFT & ENTRY_SLOT].sample;
        __m128 start = _mm_add_ps(_mm_load_ps(map->origin), _mm_mul_ps(j, _mm_load_ps(map->step_j)));
        start = _mm_add_ps(start, _mm_mul_ps(k, _mm_load_ps(map->step_k)));
        const __m512 starts = _mm512_castps128_ps512(start);
        const __m512 from[3] = {_mm512_broadcastss_ps(start), _mm512_permutexvar_ps(_mm512_set1_epi32(1), starts),
                                _mm512_permutexvar_ps(_mm512_set1_epi32(2), starts)};
        for (int d = 0; d < 3; d++) {
            __m512 along = _mm512_mul_ps(voxels, _mm512_set1_ps(map->step_i[d]));
            points->at[d] = _mm512_mask_add_ps(points->at[d], (__mmask16)entry, from[d], along);
        }
    }
    kinds.sampled &= ENTRY_MASK;
    kinds.copied &= ENTRY_MASK;
    return kinds;
}

/* Return the cell below 16 coordinates along one axis; `within` gets the position in the cell.
 * inner: no coordinate needs clamping */
SIMD_INLINE __m512i split(const raster_brick *brick, int axis, const bool inner, __m512 at, float *within)
{
    if (!inner)
        at = _mm512_min_ps(_mm512_max_ps(at, _mm512_set1_ps(brick->low[axis])), _mm512_set1_ps(brick->high[axis]));
    __m512 below = _mm512_roundscale_ps(at, _MM_FROUND_TO_NEG_INF | _MM_FROUND_NO_EXC);
    if (!inner) below = _mm512_min_ps(below, _mm512_set1_ps(brick->last[axis]));
    _mm512_store_ps(within, _mm512_sub_ps(at, below));
    return _mm512_cvttps_epi32(below);
}

SIMD_INLINE void split_all(const raster_source *source, const raster_brick *brick, const row_points *points,
                           const bool inner, row_cells *cells)
{
    __m512i i = split(brick, 0, inner, points->at[0], cells->x);
    __m512i j = split(brick, 1, inner, points->at[1], cells->y);
    __m512i k = split(brick, 2, inner, points->at[2], cells->z);
    j = _mm512_mullo_epi32(j, _mm512_set1_epi32((int32_t)source->step[1]));
    k = _mm512_mullo_epi32(k, _mm512_set1_epi32((int32_t)source->step[2]));
    _mm512_store_si512(cells->corner, _mm512_add_epi32(i, _mm512_add_epi32(j, k)));
}

SIMD_INLINE void find_cells(const raster_source *source, const raster_brick *brick, int32_t row, row_cells *cells)
{
    row_points points;
    cells->kinds = find_points(brick, row, &points);
    /* the coordinates of a free voxel are arbitrary */
    cells->inner = brick->inner && cells->kinds.sampled == ENTRY_MASK;
    if (cells->inner)
        split_all(source, brick, &points, true, cells);
    else if (cells->kinds.sampled)
        split_all(source, brick, &points, false, cells);
}

/* Load the pairs of a row at the four corners. */
SIMD_INLINE void load_row(const brick_scan *scan, const row_cells *cells, const ptrdiff_t voxel, __m512i pairs[4])
{
    __m128i quarter[4][4];
    for (int q = 0; q < 4; q++) load_pairs(scan, cells->corner + 4 * q, voxel, quarter[q]);
    for (int c = 0; c < 4; c++)
        pairs[c] = _mm512_inserti64x4(_mm512_castsi256_si512(join(quarter[0][c], quarter[1][c])),
                                      join(quarter[2][c], quarter[3][c]), 1);
}

SIMD_INLINE __m512 between16(__m512 a, __m512 b, __m512 t)
{
    return _mm512_add_ps(a, _mm512_mul_ps(t, _mm512_sub_ps(b, a)));
}

/* Interpolate pairs of 16-bit numbers at the four corners. */
SIMD_INLINE __m512i blend_pairs(const __m512i pairs[4], const row_cells *cells)
{
    /* left weight in the low and right weight in the high 16 bits of each lane */
    __m512i right = _mm512_cvtps_epi32(_mm512_mul_ps(_mm512_load_ps(cells->x), _mm512_set1_ps(SAMPLE_ONE)));
    __m512i weights =
        _mm512_or_si512(_mm512_sub_epi32(_mm512_set1_epi32(SAMPLE_ONE), right), _mm512_slli_epi32(right, 16));
    __m512 along_x[4], y = _mm512_load_ps(cells->y), z = _mm512_load_ps(cells->z);
    for (int c = 0; c < 4; c++) along_x[c] = _mm512_cvtepi32_ps(_mm512_madd_epi16(pairs[c], weights));
    __m512 value = between16(between16(along_x[0], along_x[1], y), between16(along_x[2], along_x[3], y), z);
    return _mm512_cvtps_epi32(_mm512_mul_ps(value, _mm512_set1_ps(1.0f / SAMPLE_ONE)));
}

/* Sample the voxels of a row; the background where none is sampled. */
SIMD_INLINE void sample_i16(const raster_source *source, const raster_brick *brick, const brick_scan *scan,
                            const row_cells *cells, int32_t row, int16_t *values)
{
    (void)brick, (void)row;
    __m512i pairs[4];
    load_row(scan, cells, sizeof *values, pairs);
    fill_i16(source, _mm512_cvtsepi32_epi16(blend_pairs(pairs, cells)), cells->kinds.sampled, values);
}

SIMD_INLINE void sample_u8(const raster_source *source, const raster_brick *brick, const brick_scan *scan,
                           const row_cells *cells, int32_t row, uint8_t *values)
{
    if (!bytes_to_spare(source, brick, cells)) {
        pliant_raster_row_u8(source, brick, row, values);
        return;
    }
    const __m512i spread =
        _mm512_broadcast_i32x4(_mm_setr_epi8(0, -1, 1, -1, 4, -1, 5, -1, 8, -1, 9, -1, 12, -1, 13, -1));
    __m512i pairs[4];
    load_row(scan, cells, sizeof *values, pairs);
    for (int c = 0; c < 4; c++) pairs[c] = _mm512_shuffle_epi8(pairs[c], spread);
    fill_u8(source, _mm512_cvtusepi32_epi8(blend_pairs(pairs, cells)), cells->kinds.sampled, values);
}

SIMD_INLINE void sample_f32(const raster_source *source, const raster_brick *brick, const brick_scan *scan,
                            const row_cells *cells, int32_t row, float *values)
{
    (void)brick, (void)row;
    fill_f32(source, eight_f32(scan, cells, 0), eight_f32(scan, cells, BRICK / 2), cells->kinds.sampled, values);
}

WRITE_FUNCTION(int16_t, i16)
WRITE_FUNCTION(uint8_t, u8)
WRITE_FUNCTION(float, f32)
KERNEL_FUNCTION(pliant_raster_kernels_avx512, __builtin_cpu_supports("avx512f") && __builtin_cpu_supports("avx512bw") &&
                                                  __builtin_cpu_supports("avx512dq") &&
                                                  __builtin_cpu_supports("avx512vl"))

#else

bool pliant_raster_kernels_avx512(const raster_source *source, raster_kernels *out)
{
    (void)source, (void)out;
    return false;
}

#endif
