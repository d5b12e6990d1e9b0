/* Inner loops with AVX2, chosen at run time; the rest of the library stays portable. Same bits as sample_portable.c.
 * Cost of 8 voxels of 16 bits: 4 gathers (each of 32 bits holds a voxel and its right neighbour) and about 60 other
 * instructions; floats take 8 gathers. */
#include "warp/raster.h"
#include "warp/sample.h"

#if defined(__x86_64__) && defined(__GNUC__)

#include <immintrin.h>
#include <string.h>

#define AVX2 __attribute__((target("avx2,popcnt")))
#define AVX2_INLINE static inline __attribute__((always_inline, target("avx2,popcnt")))

/* 4 rows: the least t of some planes; at[p] is plane p's value in each row */
AVX2_INLINE __m256d least(const struct raster_plane *planes, int32_t count, const __m256d *at, __m256d start)
{
    for (int32_t p = 0; p < count; p++) {
        __m256d t = _mm256_add_pd(_mm256_mul_pd(at[p], _mm256_set1_pd(planes[p].factor)), _mm256_set1_pd(planes[p].bias));
        start = _mm256_min_pd(t, start);
    }
    return start;
}

AVX2_INLINE void start_rows(const struct raster_plane *planes, int32_t count, int32_t j, int32_t k, __m256d *at)
{
    const __m256d rows = _mm256_setr_pd(0, 1, 2, 3);
    for (int32_t p = 0; p < count; p++) {
        double value = planes[p].value + planes[p].step_j * j + planes[p].step_k * k;
        at[p] = _mm256_add_pd(_mm256_set1_pd(value), _mm256_mul_pd(_mm256_set1_pd(planes[p].step_j), rows));
    }
}

AVX2_INLINE void next_rows(const struct raster_plane *planes, int32_t count, __m256d *at)
{
    for (int32_t p = 0; p < count; p++) at[p] = _mm256_add_pd(at[p], _mm256_set1_pd(ROWS_AT_ONCE * planes[p].step_j));
}

AVX2 static int32_t claim(raster_brick *brick, const raster_planes *planes, const int32_t low[3], const int32_t high[3],
                          uint32_t entry)
{
    const __m256d first_voxel = _mm256_set1_pd(-low[0]), last_voxel = _mm256_set1_pd(high[0]);
    const __m256d before = _mm256_set1_pd(-BRICK), none = _mm256_set1_pd(-1), zero = _mm256_setzero_pd();
    const __m128i ones = _mm_set1_epi32(ENTRY_MASK);
    int32_t first_group = low[1] / ROWS_AT_ONCE, last_group = high[1] / ROWS_AT_ONCE;
    int32_t claimed = 0;
    for (int32_t k = low[2]; k <= high[2]; k++) {
        __m256d rising[4], others[4];
        start_rows(planes->rising, planes->num_rising, first_group * ROWS_AT_ONCE, k, rising);
        start_rows(planes->others, planes->num_others, first_group * ROWS_AT_ONCE, k, others);
        for (int32_t g = first_group; g <= last_group; g++) {
            __m256d rise = _mm256_max_pd(least(planes->rising, planes->num_rising, rising, first_voxel), before);
            __m256d fall = _mm256_max_pd(least(planes->others, planes->num_others, others, last_voxel), none);
            next_rows(planes->rising, planes->num_rising, rising);
            next_rows(planes->others, planes->num_others, others);
            __m128i first = _mm256_cvttpd_epi32(_mm256_sub_pd(zero, _mm256_floor_pd(rise)));
            __m128i last = _mm256_cvttpd_epi32(_mm256_floor_pd(fall));
            __m128i mask = _mm_and_si128(_mm_sllv_epi32(ones, first),
                                         _mm_srlv_epi32(ones, _mm_sub_epi32(_mm_set1_epi32(BRICK - 1), last)));
            uint64_t *owned = &brick->owned[k * (BRICK / ROWS_AT_ONCE) + g];
            uint64_t fresh = (uint64_t)_mm_cvtsi128_si64(_mm_packus_epi32(mask, mask)) & ~*owned;
            if (!fresh) continue;
            *owned |= fresh;
            claimed += (int32_t)_mm_popcnt_u64(fresh);
            int32_t row = k * BRICK + g * ROWS_AT_ONCE;
            for (int r = 0; r < ROWS_AT_ONCE; r++) { /* an empty one is written but not counted */
                uint32_t voxels = (uint32_t)(fresh >> 16 * r) & ENTRY_MASK;
                brick->entry[row + r][brick->num_entries[row + r]] = entry | voxels;
                brick->num_entries[row + r] += voxels != 0;
            }
        }
    }
    return claimed;
}

/* all ones in the lanes whose bit is set in the low 8 bits of mask */
AVX2_INLINE __m256i lanes(uint32_t mask)
{
    const __m256i bits = _mm256_setr_epi32(1, 2, 4, 8, 16, 32, 64, 128);
    return _mm256_cmpeq_epi32(_mm256_and_si256(_mm256_set1_epi32((int32_t)mask), bits), bits);
}

/* all ones in the 16-bit lanes whose bit is set */
AVX2_INLINE __m256i lanes16(uint32_t mask)
{
    const __m256i bits = _mm256_setr_epi16(1, 2, 4, 8, 16, 32, 64, 128, 256, 512, 1024, 2048, 4096, 8192, 16384, INT16_MIN);
    return _mm256_cmpeq_epi16(_mm256_and_si256(_mm256_set1_epi16((int16_t)mask), bits), bits);
}

/* source coordinates of the 16 voxels of a row: [axis][half] */
typedef struct row_points { __m256 at[3][2]; } row_points;

/* the voxels of a row that are not copied; their points, each by its owner's map */
AVX2_INLINE uint32_t find_points(const raster_brick *brick, int32_t row, row_points *points)
{
    const __m256 left = _mm256_setr_ps(0, 1, 2, 3, 4, 5, 6, 7), right = _mm256_setr_ps(8, 9, 10, 11, 12, 13, 14, 15);
    const __m128 j = _mm_set1_ps((float)(row % BRICK)), k = _mm_set1_ps((float)(row / BRICK));
    uint32_t sampled = 0;
    for (int e = 0; e < brick->num_entries[row]; e++) {
        uint32_t entry = brick->entry[row][e];
        if (entry & ENTRY_COPY) continue;
        sampled |= entry & ENTRY_MASK;
        const raster_slot *map = &brick->slot[entry >> ENTRY_SLOT_SHIFT & ENTRY_SLOT].sample;
        __m128 start = _mm_add_ps(_mm_load_ps(map->origin), _mm_mul_ps(j, _mm_load_ps(map->step_j)));
        start = _mm_add_ps(start, _mm_mul_ps(k, _mm_load_ps(map->step_k)));
        const __m128 starts[3] = {start, _mm_shuffle_ps(start, start, 0x55), _mm_shuffle_ps(start, start, 0xaa)};
        const __m256 own_left = _mm256_castsi256_ps(lanes(entry)), own_right = _mm256_castsi256_ps(lanes(entry >> 8));
        for (int d = 0; d < 3; d++) {
            __m256 from = _mm256_broadcastss_ps(starts[d]), step = _mm256_broadcast_ss(&map->step_i[d]);
            __m256 at_left = _mm256_add_ps(from, _mm256_mul_ps(left, step));
            __m256 at_right = _mm256_add_ps(from, _mm256_mul_ps(right, step));
            points->at[d][0] = _mm256_blendv_ps(points->at[d][0], at_left, own_left);
            points->at[d][1] = _mm256_blendv_ps(points->at[d][1], at_right, own_right);
        }
    }
    return sampled;
}

/* cells of 8 points: flat index of the left lower corner relative to the brick's base, and where in the cell */
typedef struct row_cells { __m256i corner; __m256 x, y, z; } row_cells;

AVX2_INLINE __m256 split(__m256 at, float low, float high, float last, __m256i *whole)
{
    at = _mm256_min_ps(_mm256_max_ps(at, _mm256_set1_ps(low)), _mm256_set1_ps(high));
    __m256 below = _mm256_min_ps(_mm256_floor_ps(at), _mm256_set1_ps(last));
    *whole = _mm256_cvttps_epi32(below);
    return _mm256_sub_ps(at, below);
}

AVX2_INLINE row_cells find_cells(const raster_source *source, const raster_brick *brick, const row_points *points, int half)
{
    __m256i i, j, k;
    row_cells cells;
    cells.x = split(points->at[0][half], brick->low[0], brick->high[0], brick->last[0], &i);
    cells.y = split(points->at[1][half], brick->low[1], brick->high[1], brick->last[1], &j);
    cells.z = split(points->at[2][half], brick->low[2], brick->high[2], brick->last[2], &k);
    j = _mm256_mullo_epi32(j, _mm256_set1_epi32((int32_t)source->step[1]));
    k = _mm256_mullo_epi32(k, _mm256_set1_epi32((int32_t)source->step[2]));
    cells.corner = _mm256_add_epi32(i, _mm256_add_epi32(j, k));
    return cells;
}

AVX2_INLINE __m256 between(__m256 a, __m256 b, __m256 t) { return _mm256_add_ps(a, _mm256_mul_ps(t, _mm256_sub_ps(b, a))); }

/* two neighbours along x as 16-bit numbers in each lane, weighed; voxel is the first lane's base */
AVX2_INLINE __m256 pair_i16(const int16_t *voxels, const row_cells *cells, __m256i weights)
{
    __m256i pairs = _mm256_i32gather_epi32((const int *)(const void *)voxels, cells->corner, 2);
    return _mm256_cvtepi32_ps(_mm256_madd_epi16(pairs, weights));
}

AVX2_INLINE __m256 pair_u8(const uint8_t *voxels, const row_cells *cells, __m256i weights)
{
    const __m256i spread = _mm256_setr_epi8(0, -1, 1, -1, 4, -1, 5, -1, 8, -1, 9, -1, 12, -1, 13, -1,
                                            0, -1, 1, -1, 4, -1, 5, -1, 8, -1, 9, -1, 12, -1, 13, -1);
    __m256i pairs = _mm256_shuffle_epi8(_mm256_i32gather_epi32((const int *)(const void *)voxels, cells->corner, 1), spread);
    return _mm256_cvtepi32_ps(_mm256_madd_epi16(pairs, weights));
}

AVX2_INLINE __m256 pair_f32(const float *voxels, const row_cells *cells)
{
    return between(_mm256_i32gather_ps(voxels, cells->corner, 4), _mm256_i32gather_ps(voxels + 1, cells->corner, 4), cells->x);
}

/* left weight in the low, right weight in the high 16 bits of each lane */
AVX2_INLINE __m256i pair_weights(const row_cells *cells)
{
    __m256i right = _mm256_cvtps_epi32(_mm256_mul_ps(cells->x, _mm256_set1_ps(SAMPLE_ONE)));
    __m256i left = _mm256_sub_epi32(_mm256_set1_epi32(SAMPLE_ONE), right);
    return _mm256_or_si256(left, _mm256_slli_epi32(right, 16));
}

AVX2_INLINE __m256i round_parts(__m256 value)
{
    return _mm256_cvtps_epi32(_mm256_mul_ps(value, _mm256_set1_ps(1.0f / SAMPLE_ONE)));
}

AVX2_INLINE __m256i half_i16(const raster_source *source, const raster_brick *brick, const row_points *points, int half)
{
    row_cells cells = find_cells(source, brick, points, half);
    __m256i weights = pair_weights(&cells);
    const int16_t *base = (const int16_t *)source->voxels + brick->base_index;
    __m256 low = between(pair_i16(base, &cells, weights), pair_i16(base + source->step[1], &cells, weights), cells.y);
    base += source->step[2];
    __m256 high = between(pair_i16(base, &cells, weights), pair_i16(base + source->step[1], &cells, weights), cells.y);
    return round_parts(between(low, high, cells.z));
}

AVX2_INLINE __m256i half_u8(const raster_source *source, const raster_brick *brick, const row_cells *cells)
{
    __m256i weights = pair_weights(cells);
    const uint8_t *base = (const uint8_t *)source->voxels + brick->base_index;
    __m256 low = between(pair_u8(base, cells, weights), pair_u8(base + source->step[1], cells, weights), cells->y);
    base += source->step[2];
    __m256 high = between(pair_u8(base, cells, weights), pair_u8(base + source->step[1], cells, weights), cells->y);
    return round_parts(between(low, high, cells->z));
}

AVX2_INLINE __m256 half_f32(const raster_source *source, const raster_brick *brick, const row_points *points, int half)
{
    row_cells cells = find_cells(source, brick, points, half);
    const float *base = (const float *)source->voxels + brick->base_index;
    __m256 low = between(pair_f32(base, &cells), pair_f32(base + source->step[1], &cells), cells.y);
    base += source->step[2];
    __m256 high = between(pair_f32(base, &cells), pair_f32(base + source->step[1], &cells), cells.y);
    return between(low, high, cells.z);
}

/* A copied run of voxels; whole rows at once where the scan's memory allows. */
#define COPY_FUNCTION(type, name, copy_row)                                                                        \
    AVX2_INLINE void copy_##name(const raster_source *source, const raster_brick *brick, int32_t row, type *values) \
    {                                                                                                              \
        const type *voxels = source->voxels;                                                                       \
        for (int e = 0; e < brick->num_entries[row]; e++) {                                                         \
            uint32_t entry = brick->entry[row][e];                                                                 \
            if (!(entry & ENTRY_COPY)) continue;                                                                   \
            const raster_copy *copy = &brick->slot[entry >> ENTRY_SLOT_SHIFT & ENTRY_SLOT].copy;                   \
            int64_t start = sample_copy_start(copy, row);                                                          \
            if (copy->step_i == 1 && start >= 0 && start + BRICK <= source->count)                                 \
                copy_row(voxels + start, entry, values);                                                           \
            else                                                                                                   \
                for (int i = 0; i < BRICK; i++)                                                                    \
                    if (entry >> i & 1) values[i] = voxels[start + i * copy->step_i];                              \
        }                                                                                                          \
    }

AVX2_INLINE void put_i16(__m256i from, uint32_t mask, int16_t *values)
{
    __m256i old = _mm256_load_si256((const __m256i *)(const void *)values);
    _mm256_store_si256((__m256i *)(void *)values, _mm256_blendv_epi8(old, from, lanes16(mask)));
}

AVX2_INLINE void put_u8(__m128i from, uint32_t mask, uint8_t *values)
{
    __m256i wide = lanes16(mask);
    __m128i own = _mm_packs_epi16(_mm256_castsi256_si128(wide), _mm256_extracti128_si256(wide, 1));
    __m128i old = _mm_load_si128((const __m128i *)(const void *)values);
    _mm_store_si128((__m128i *)(void *)values, _mm_blendv_epi8(old, from, own));
}

AVX2_INLINE void put_f32(__m256 from, uint32_t mask, float *values)
{
    _mm256_store_ps(values, _mm256_blendv_ps(_mm256_load_ps(values), from, _mm256_castsi256_ps(lanes(mask))));
}

AVX2_INLINE void copy_row_i16(const int16_t *from, uint32_t mask, int16_t *values)
{
    put_i16(_mm256_loadu_si256((const __m256i *)(const void *)from), mask, values);
}

AVX2_INLINE void copy_row_u8(const uint8_t *from, uint32_t mask, uint8_t *values)
{
    put_u8(_mm_loadu_si128((const __m128i *)(const void *)from), mask, values);
}

AVX2_INLINE void copy_row_f32(const float *from, uint32_t mask, float *values)
{
    put_f32(_mm256_loadu_ps(from), mask, values);
    put_f32(_mm256_loadu_ps(from + 8), mask >> 8, values + 8);
}

COPY_FUNCTION(int16_t, i16, copy_row_i16)
COPY_FUNCTION(uint8_t, u8, copy_row_u8)
COPY_FUNCTION(float, f32, copy_row_f32)

AVX2_INLINE void clear_points(row_points *points)
{
    for (int d = 0; d < 3; d++) points->at[d][0] = points->at[d][1] = _mm256_setzero_ps();
}

AVX2 static void row_i16(const raster_source *source, const raster_brick *brick, int32_t row, void *out)
{
    int16_t *values = out;
    _mm256_store_si256(out, _mm256_set1_epi16(source->background.i16));
    row_points points;
    clear_points(&points);
    uint32_t sampled = find_points(brick, row, &points);
    copy_i16(source, brick, row, values);
    if (!sampled) return;
    __m256i left = _mm256_setzero_si256(), right = left;
    if (sampled & 0xff) left = half_i16(source, brick, &points, 0);
    if (sampled >> 8) right = half_i16(source, brick, &points, 1);
    put_i16(_mm256_permute4x64_epi64(_mm256_packs_epi32(left, right), 0xd8), sampled, values);
}

AVX2 static void row_u8(const raster_source *source, const raster_brick *brick, int32_t row, void *out)
{
    uint8_t *values = out;
    _mm_store_si128(out, _mm_set1_epi8((char)source->background.u8));
    row_points points;
    clear_points(&points);
    uint32_t sampled = find_points(brick, row, &points);
    copy_u8(source, brick, row, values);
    if (!sampled) return;
    row_cells left = find_cells(source, brick, &points, 0), right = find_cells(source, brick, &points, 1);
    /* a gather reads 4 bytes: the two wanted and two behind them, which the scan's last voxels do not have */
    ptrdiff_t last = source->count - 4 - brick->base_index - source->step[1] - source->step[2];
    __m256i beyond = _mm256_cmpgt_epi32(_mm256_max_epi32(left.corner, right.corner), _mm256_set1_epi32((int32_t)last));
    if (_mm256_movemask_epi8(beyond)) {
        pliant_raster_kernels_portable(source).row(source, brick, row, out);
        return;
    }
    __m256i words = _mm256_permute4x64_epi64(_mm256_packs_epi32(half_u8(source, brick, &left), half_u8(source, brick, &right)), 0xd8);
    put_u8(_mm_packus_epi16(_mm256_castsi256_si128(words), _mm256_extracti128_si256(words, 1)), sampled, values);
}

AVX2 static void row_f32(const raster_source *source, const raster_brick *brick, int32_t row, void *out)
{
    float *values = out;
    _mm256_store_ps(values, _mm256_set1_ps(source->background.f32));
    _mm256_store_ps(values + 8, _mm256_set1_ps(source->background.f32));
    row_points points;
    clear_points(&points);
    uint32_t sampled = find_points(brick, row, &points);
    copy_f32(source, brick, row, values);
    if (sampled & 0xff) put_f32(half_f32(source, brick, &points, 0), sampled, values);
    if (sampled >> 8) put_f32(half_f32(source, brick, &points, 1), sampled >> 8, values + 8);
}

bool pliant_raster_kernels_avx2(const raster_source *source, raster_kernels *out)
{
    /* gathers take 32-bit indices and a right neighbour in memory */
    if (!__builtin_cpu_supports("avx2") || !__builtin_cpu_supports("popcnt")) return false;
    if (source->size[0] < 2 || source->count > INT32_MAX / 4) return false;
    *out = (raster_kernels){claim, source->encoding == PLIANT_UINT8 ? row_u8 : source->encoding == PLIANT_INT16 ? row_i16 : row_f32};
    return true;
}

#else

bool pliant_raster_kernels_avx2(const raster_source *source, raster_kernels *out)
{
    (void)source, (void)out;
    return false;
}

#endif
