/* Inner loops with AVX2. 8 voxels of 16 bits need 32 loads, each of a voxel and its right neighbour, and about as many
 * instructions to arrange them. Floats are similar. */
#include "warp/inner_loops.h"

#if defined(__x86_64__) && defined(__GNUC__)

#include "warp/simd.h"

#define SIMD_ROWS ROWS_AT_ONCE
#define SIMD AVX2
#define SIMD_INLINE AVX2_INLINE

AVX2_INLINE int32_t claim_rows(raster_brick *brick, const raster_tet *tet, const brick_planes *planes,
                               const owner_box *box, uint32_t entry, const int32_t num_rising, const int32_t num_others)
{
    const __m256d first_voxel = _mm256_set1_pd(OWNER_SHIFT - box->low[0]),
                  last_voxel = _mm256_set1_pd(OWNER_SHIFT + box->high[0]);
    const __m128i ones = _mm_set1_epi32(ENTRY_MASK), entries = _mm_set1_epi32((int32_t)entry);
    const int32_t first_group = box->low[1] / ROWS_AT_ONCE, last_group = box->high[1] / ROWS_AT_ONCE;
    const int32_t count = num_rising + num_others;
    const __m256d rows = _mm256_setr_pd(0, 1, 2, 3);
    __m256d start[6], factor[6], step_group[6], step_k[6]; /* start: values in the first rows of the slice */
    uint32_t rising = planes->rising, others = planes->others;
    for (int32_t p = 0; p < count; p++) {
        uint32_t *left = p < num_rising ? &rising : &others;
        const int v = __builtin_ctz(*left);
        *left &= *left - 1;
        factor[p] = _mm256_broadcast_sd(&tet->factor[v]);
        step_k[p] = _mm256_broadcast_sd(&tet->normal[2][v]);
        step_group[p] = _mm256_broadcast_sd(&planes->step_group[v]);
        start[p] = _mm256_add_pd(_mm256_broadcast_sd(&planes->start[v]),
                                 _mm256_mul_pd(_mm256_broadcast_sd(&tet->normal[1][v]), rows));
    }
    int32_t claimed = 0;
    for (int32_t k = box->low[2]; k <= box->high[2]; k++) {
        __m256d at[6];
        for (int32_t p = 0; p < count; p++) {
            at[p] = start[p];
            start[p] = _mm256_add_pd(start[p], step_k[p]);
        }
        for (int32_t g = first_group; g <= last_group; g++) {
            __m256d rise = first_voxel, fall = last_voxel;
            for (int32_t p = 0; p < count; p++) {
                __m256d t = _mm256_mul_pd(at[p], factor[p]);
                if (p < num_rising)
                    rise = _mm256_min_pd(t, rise);
                else
                    fall = _mm256_min_pd(t, fall);
                at[p] = _mm256_add_pd(at[p], step_group[p]);
            }
            /* A shift by more than 16 or 31 bits, also after conversion to INT_MIN, leaves no bit. */
            __m128i first = _mm_sub_epi32(_mm_set1_epi32(OWNER_SHIFT), _mm256_cvttpd_epi32(rise));
            __m128i beyond = _mm_sub_epi32(_mm_set1_epi32(OWNER_SHIFT + BRICK - 1), _mm256_cvttpd_epi32(fall));
            __m128i mask = _mm_and_si128(_mm_sllv_epi32(ones, first), _mm_srlv_epi32(ones, beyond));
            int32_t group = k * (BRICK / ROWS_AT_ONCE) + g;
            uint64_t fresh = (uint64_t)_mm_cvtsi128_si64(_mm_packus_epi32(mask, mask)) & ~brick->owned[group];
            if (!fresh) continue;
            brick->owned[group] |= fresh;
            claimed += (int32_t)_mm_popcnt_u64(fresh);
            add_entries(brick, group, _mm_cvtsi64_si128((long long)fresh), entries);
        }
    }
    return claimed;
}

CLAIM_FUNCTIONS

/* source coordinates of the 16 voxels of a row: [axis][half] */
typedef struct row_points { __m256 at[3][2]; } row_points;

/* Map all voxels of a row by one map.
 * j, k: indices of the row */
AVX2_INLINE row_points map_row(const raster_slot *map, __m128 j, __m128 k)
{
    const __m256 left = _mm256_setr_ps(0, 1, 2, 3, 4, 5, 6, 7), right = _mm256_setr_ps(8, 9, 10, 11, 12, 13, 14, 15);
    __m128 start = _mm_add_ps(_mm_load_ps(map->origin), _mm_mul_ps(j, _mm_load_ps(map->step_j)));
    start = _mm_add_ps(start, _mm_mul_ps(k, _mm_load_ps(map->step_k)));
    const __m256 both = _mm256_set_m128(start, start);
    const __m256 from[3] = {_mm256_shuffle_ps(both, both, 0), _mm256_shuffle_ps(both, both, 0x55),
                            _mm256_shuffle_ps(both, both, 0xaa)};
    row_points points;
    for (int d = 0; d < 3; d++) {
        __m256 step = _mm256_broadcast_ss(&map->step_i[d]);
        points.at[d][0] = _mm256_add_ps(from[d], _mm256_mul_ps(left, step));
        points.at[d][1] = _mm256_add_ps(from[d], _mm256_mul_ps(right, step));
    }
    return points;
}

/* Map the sampled voxels of a row, each by its owner's map. */
AVX2_INLINE row_kinds find_points(const raster_brick *brick, int32_t row, row_points *points)
{
    const __m128 j = _mm_set1_ps((float)(row % BRICK)), k = _mm_set1_ps((float)(row / BRICK));
    const int count = brick->num_entries[row];
    int e = 0;
    row_kinds kinds = {0, 0};
    for (; e < count && brick->entry[e][row] & ENTRY_COPY; e++) kinds.copied |= brick->entry[e][row];
    if (e < count) { /* use the first map for all voxels; other entries overwrite their part */
        uint32_t entry = brick->entry[e++][row];
        kinds.sampled = entry;
        *points = map_row(&brick->slot[entry >> ENTRY_SLOT_SHIFT & ENTRY_SLOT].sample, j, k);
    }
    for (; e < count; e++) {
        uint32_t entry = brick->entry[e][row];
        if (entry & ENTRY_COPY) {
            kinds.copied |= entry;
            continue;
        }
        kinds.sampled |= entry;
        row_points mapped = map_row(&brick->slot[entry >> ENTRY_SLOT_SHIFT & ENTRY_SLOT].sample, j, k);
        const __m256i mask = _mm256_set1_epi32((int32_t)entry);
        const __m256 own_left = left_lanes(mask), own_right = right_lanes(mask);
        for (int d = 0; d < 3; d++) {
            points->at[d][0] = _mm256_blendv_ps(points->at[d][0], mapped.at[d][0], own_left);
            points->at[d][1] = _mm256_blendv_ps(points->at[d][1], mapped.at[d][1], own_right);
        }
    }
    kinds.sampled &= ENTRY_MASK;
    kinds.copied &= ENTRY_MASK;
    return kinds;
}

/* Return the cell below 8 coordinates along one axis; `within` gets the position in the cell.
 * inner: no coordinate needs clamping */
AVX2_INLINE __m256i split(const raster_brick *brick, int axis, const bool inner, __m256 at, float *within)
{
    if (!inner)
        at = _mm256_min_ps(_mm256_max_ps(at, _mm256_broadcast_ss(&brick->low[axis])),
                           _mm256_broadcast_ss(&brick->high[axis]));
    __m256 below = _mm256_floor_ps(at);
    if (!inner) below = _mm256_min_ps(below, _mm256_broadcast_ss(&brick->last[axis]));
    _mm256_store_ps(within, _mm256_sub_ps(at, below));
    return _mm256_cvttps_epi32(below);
}

AVX2_INLINE void split_all(const raster_source *source, const raster_brick *brick, const row_points *points,
                           const bool inner, row_cells *cells)
{
    for (int half = 0; half < 2; half++) {
        __m256i i = split(brick, 0, inner, points->at[0][half], cells->x + 8 * half);
        __m256i j = split(brick, 1, inner, points->at[1][half], cells->y + 8 * half);
        __m256i k = split(brick, 2, inner, points->at[2][half], cells->z + 8 * half);
        j = _mm256_mullo_epi32(j, _mm256_set1_epi32((int32_t)source->step[1]));
        k = _mm256_mullo_epi32(k, _mm256_set1_epi32((int32_t)source->step[2]));
        _mm256_store_si256((__m256i *)(void *)(cells->corner + 8 * half), _mm256_add_epi32(i, _mm256_add_epi32(j, k)));
    }
}

AVX2_INLINE void find_cells(const raster_source *source, const raster_brick *brick, int32_t row, row_cells *cells)
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

/* left weight in the low and right weight in the high 16 bits of each lane */
AVX2_INLINE __m256i pair_weights(__m256 x)
{
    __m256i right = _mm256_cvtps_epi32(_mm256_mul_ps(x, _mm256_set1_ps(SAMPLE_ONE)));
    __m256i left = _mm256_sub_epi32(_mm256_set1_epi32(SAMPLE_ONE), right);
    return _mm256_or_si256(left, _mm256_slli_epi32(right, 16));
}

/* Interpolate pairs of 16-bit numbers at the four corners. */
AVX2_INLINE __m256i blend_pairs(const __m256i pairs[4], const row_cells *cells, int first)
{
    const __m256i weights = pair_weights(_mm256_load_ps(cells->x + first));
    __m256 along_x[4];
    for (int c = 0; c < 4; c++) along_x[c] = _mm256_cvtepi32_ps(_mm256_madd_epi16(pairs[c], weights));
    return _mm256_cvtps_epi32(_mm256_mul_ps(blend_corners(along_x, cells, first), _mm256_set1_ps(1.0f / SAMPLE_ONE)));
}

/* Load 8 pairs from `first` on, at the four corners. */
AVX2_INLINE void load_eight(const brick_scan *scan, const row_cells *cells, int first, const ptrdiff_t voxel,
                            __m256i pairs[4])
{
    __m128i left[4], right[4];
    load_pairs(scan, cells->corner + first, voxel, left);
    load_pairs(scan, cells->corner + first + 4, voxel, right);
    for (int c = 0; c < 4; c++) pairs[c] = join(left[c], right[c]);
}

AVX2_INLINE __m256i eight_i16(const brick_scan *scan, const row_cells *cells, int first)
{
    __m256i pairs[4];
    load_eight(scan, cells, first, sizeof(int16_t), pairs);
    return blend_pairs(pairs, cells, first);
}

AVX2_INLINE __m256i eight_u8(const brick_scan *scan, const row_cells *cells, int first)
{
    const __m256i spread = _mm256_setr_epi8(0, -1, 1, -1, 4, -1, 5, -1, 8, -1, 9, -1, 12, -1, 13, -1,
                                            0, -1, 1, -1, 4, -1, 5, -1, 8, -1, 9, -1, 12, -1, 13, -1);
    __m256i pairs[4];
    load_eight(scan, cells, first, sizeof(uint8_t), pairs);
    for (int c = 0; c < 4; c++) pairs[c] = _mm256_shuffle_epi8(pairs[c], spread);
    return blend_pairs(pairs, cells, first);
}

/* Sample the voxels of a row; the background where none is sampled. */
AVX2_INLINE void sample_i16(const raster_source *source, const raster_brick *brick, const brick_scan *scan,
                            const row_cells *cells, int32_t row, int16_t *values)
{
    (void)brick, (void)row;
    __m256i all = _mm256_packs_epi32(eight_i16(scan, cells, 0), eight_i16(scan, cells, 8));
    fill_i16(source, _mm256_permute4x64_epi64(all, 0xd8), cells->kinds.sampled, values);
}

AVX2_INLINE void sample_u8(const raster_source *source, const raster_brick *brick, const brick_scan *scan,
                           const row_cells *cells, int32_t row, uint8_t *values)
{
    if (!bytes_to_spare(source, brick, cells)) {
        pliant_raster_row_u8(source, brick, row, values);
        return;
    }
    __m256i words = _mm256_packs_epi32(eight_u8(scan, cells, 0), eight_u8(scan, cells, 8));
    words = _mm256_permute4x64_epi64(words, 0xd8);
    __m128i bytes = _mm_packus_epi16(_mm256_castsi256_si128(words), _mm256_extracti128_si256(words, 1));
    fill_u8(source, bytes, cells->kinds.sampled, values);
}

AVX2_INLINE void sample_f32(const raster_source *source, const raster_brick *brick, const brick_scan *scan,
                            const row_cells *cells, int32_t row, float *values)
{
    (void)brick, (void)row;
    fill_f32(source, eight_f32(scan, cells, 0), eight_f32(scan, cells, 8), cells->kinds.sampled, values);
}

WRITE_FUNCTION(int16_t, i16)
WRITE_FUNCTION(uint8_t, u8)
WRITE_FUNCTION(float, f32)
KERNEL_FUNCTION(pliant_raster_kernels_avx2, __builtin_cpu_supports("avx2") && __builtin_cpu_supports("popcnt"))

#else

bool pliant_raster_kernels_avx2(const raster_source *source, raster_kernels *out)
{
    (void)source, (void)out;
    return false;
}

#endif
