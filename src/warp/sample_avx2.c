/* Inner loops with AVX2, chosen at run time; the rest of the library stays portable. Same bits as sample_portable.c.
 * Cost of 8 voxels of 16 bits: 4 gathers (each of 32 bits holds a voxel and its right neighbour) and about 60 other
 * instructions; floats take 8 gathers. */
#include "warp/owners.h"
#include "warp/sample.h"

#if defined(__x86_64__) && defined(__GNUC__)

#include <immintrin.h>
#include <string.h>

#define AVX2 __attribute__((target("avx2,popcnt")))
#define AVX2_INLINE static inline __attribute__((always_inline, target("avx2,popcnt")))

/* The planes of a tetrahedron that cut a brick, by number 0 to 3, and their values at its first voxel plus 1/2. */
typedef struct brick_planes {
    alignas(32) double value[4];
    uint32_t rising, others; /* one bit a plane */
} brick_planes;

/* false when a plane leaves nothing of the brick */
AVX2_INLINE bool find_planes(const raster_tet *tet, const int32_t origin[3], brick_planes *planes)
{
    owner_values(tet, origin, planes->value);
    const __m256d zero = _mm256_setzero_pd(), edge = _mm256_set1_pd(BRICK - 1);
    const __m256d i = _mm256_loadu_pd(tet->normal[0]), j = _mm256_loadu_pd(tet->normal[1]), k = _mm256_loadu_pd(tet->normal[2]);
    __m256d value = _mm256_load_pd(planes->value);
    __m256d rise = _mm256_add_pd(_mm256_add_pd(_mm256_max_pd(i, zero), _mm256_max_pd(j, zero)), _mm256_max_pd(k, zero));
    __m256d fall = _mm256_add_pd(_mm256_add_pd(_mm256_min_pd(i, zero), _mm256_min_pd(j, zero)), _mm256_min_pd(k, zero));
    /* the most and the least in the brick, whose signs are exact */
    if (_mm256_movemask_pd(_mm256_add_pd(value, _mm256_mul_pd(rise, edge)))) return false;
    uint32_t cut = (uint32_t)_mm256_movemask_pd(_mm256_add_pd(value, _mm256_mul_pd(fall, edge)));
    uint32_t up = (uint32_t)_mm256_movemask_pd(_mm256_cmp_pd(i, zero, _CMP_GT_OQ));
    _mm256_store_pd(planes->value, _mm256_add_pd(value, _mm256_set1_pd(0.5)));
    planes->rising = cut & up;
    planes->others = cut & ~up;
    return true;
}

/* Gives 4 rows' free voxels to an owner. */
AVX2_INLINE void add_entries(raster_brick *brick, int32_t group, uint64_t fresh, __m128i entry)
{
    __m128i masks = _mm_cvtsi64_si128((long long)fresh);
    __m128i entries = _mm_or_si128(_mm_cvtepu16_epi32(masks), entry);
    uint32_t counts;
    memcpy(&counts, brick->num_entries + ROWS_AT_ONCE * group, sizeof counts);
    const int32_t row = ROWS_AT_ONCE * group; /* an empty one is written but not counted */
    brick->entry[counts & 0xff][row] = (uint32_t)_mm_cvtsi128_si32(entries);
    brick->entry[counts >> 8 & 0xff][row + 1] = (uint32_t)_mm_extract_epi32(entries, 1);
    brick->entry[counts >> 16 & 0xff][row + 2] = (uint32_t)_mm_extract_epi32(entries, 2);
    brick->entry[counts >> 24][row + 3] = (uint32_t)_mm_extract_epi32(entries, 3);
    __m128i empty = _mm_cmpeq_epi16(masks, _mm_setzero_si128());
    counts += 0x01010101 & ~(uint32_t)_mm_cvtsi128_si32(_mm_packs_epi16(empty, empty));
    memcpy(brick->num_entries + ROWS_AT_ONCE * group, &counts, sizeof counts);
}

/* For every number of planes its own code: the loops over planes unroll, and their values stay in registers. */
AVX2_INLINE int32_t claim_rows(raster_brick *brick, const raster_tet *tet, const brick_planes *planes, const owner_box *box,
                               uint32_t entry, const int32_t num_rising, const int32_t num_others)
{
    const __m256d first_voxel = _mm256_set1_pd(OWNER_SHIFT - box->low[0]), last_voxel = _mm256_set1_pd(OWNER_SHIFT + box->high[0]);
    const __m128i ones = _mm_set1_epi32(ENTRY_MASK), entries = _mm_set1_epi32((int32_t)entry);
    const int32_t first_group = box->low[1] / ROWS_AT_ONCE, last_group = box->high[1] / ROWS_AT_ONCE;
    const int32_t count = num_rising + num_others;
    const __m256d first_rows = _mm256_add_pd(_mm256_set1_pd(first_group * ROWS_AT_ONCE), _mm256_setr_pd(0, 1, 2, 3));
    __m256d start[6], factor[6], step_group[6], step_k[6]; /* start: values in the first rows of the slice */
    uint32_t rising = planes->rising, others = planes->others;
    for (int32_t p = 0; p < count; p++) {
        uint32_t *left = p < num_rising ? &rising : &others;
        const int v = __builtin_ctz(*left);
        *left &= *left - 1;
        factor[p] = _mm256_broadcast_sd(&tet->factor[v]);
        step_k[p] = _mm256_broadcast_sd(&tet->normal[2][v]);
        __m256d step_j = _mm256_broadcast_sd(&tet->normal[1][v]);
        step_group[p] = _mm256_mul_pd(step_j, _mm256_set1_pd(ROWS_AT_ONCE));
        /* a shift of t by OWNER_SHIFT; by less where the plane is parallel to rows, which changes nothing there */
        __m256d shift = _mm256_set1_pd(OWNER_SHIFT * __builtin_fabs(tet->normal[0][v]));
        start[p] = _mm256_add_pd(_mm256_broadcast_sd(&planes->value[v]), shift);
        start[p] = _mm256_add_pd(start[p], _mm256_mul_pd(step_j, first_rows));
        start[p] = _mm256_add_pd(start[p], _mm256_mul_pd(step_k[p], _mm256_set1_pd(box->low[2])));
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
            /* Too small, or so small that it becomes INT_MIN: a shift by more than 16 or 31, which leaves no bit. */
            __m128i first = _mm_sub_epi32(_mm_set1_epi32(OWNER_SHIFT), _mm256_cvttpd_epi32(rise));
            __m128i beyond = _mm_sub_epi32(_mm_set1_epi32(OWNER_SHIFT + BRICK - 1), _mm256_cvttpd_epi32(fall));
            __m128i mask = _mm_and_si128(_mm_sllv_epi32(ones, first), _mm_srlv_epi32(ones, beyond));
            int32_t group = k * (BRICK / ROWS_AT_ONCE) + g;
            uint64_t fresh = (uint64_t)_mm_cvtsi128_si64(_mm_packus_epi32(mask, mask)) & ~brick->owned[group];
            if (!fresh) continue;
            brick->owned[group] |= fresh;
            claimed += (int32_t)_mm_popcnt_u64(fresh);
            add_entries(brick, group, fresh, entries);
        }
    }
    return claimed;
}

/* A closed surface has rising and other planes, so at most three of a kind. */
AVX2 static int32_t claim(raster_brick *brick, const raster_tet *tet, const int32_t origin[3], const owner_box *box, uint32_t entry)
{
    brick_planes planes;
    if (!find_planes(tet, origin, &planes)) return 0;
#define CASE(rising, others) \
    case 4 * rising + others: return claim_rows(brick, tet, &planes, box, entry, rising, others);
    switch (4 * __builtin_popcount(planes.rising) + __builtin_popcount(planes.others)) {
        CASE(0, 0) CASE(0, 1) CASE(0, 2) CASE(0, 3) CASE(1, 0) CASE(1, 1) CASE(1, 2) CASE(1, 3) CASE(2, 0) CASE(2, 1)
        CASE(2, 2) CASE(3, 0) CASE(3, 1)
    }
#undef CASE
    return 0;
}

AVX2 static void find_owners(const raster_source *source, const raster_tet *tets, const int32_t *candidates,
                             size_t num_candidates, const int32_t origin[3], raster_brick *brick)
{
    owner_find_all(source, tets, candidates, num_candidates, origin, brick, claim);
}

/* in the lanes whose bit is set, the sign bit, for blends that ask for no more */
AVX2_INLINE __m256 left_lanes(__m256i mask)
{
    return _mm256_castsi256_ps(_mm256_sllv_epi32(mask, _mm256_setr_epi32(31, 30, 29, 28, 27, 26, 25, 24)));
}
AVX2_INLINE __m256 right_lanes(__m256i mask)
{
    return _mm256_castsi256_ps(_mm256_sllv_epi32(mask, _mm256_setr_epi32(23, 22, 21, 20, 19, 18, 17, 16)));
}

/* all ones in the 16-bit lanes whose bit is set */
AVX2_INLINE __m256i lanes16(uint32_t mask)
{
    const __m256i bits = _mm256_setr_epi16(1, 2, 4, 8, 16, 32, 64, 128, 256, 512, 1024, 2048, 4096, 8192, 16384, INT16_MIN);
    return _mm256_cmpeq_epi16(_mm256_and_si256(_mm256_set1_epi16((int16_t)mask), bits), bits);
}

/* source coordinates of the 16 voxels of a row: [axis][half] */
typedef struct row_points { __m256 at[3][2]; } row_points;

/* the points of all voxels by one map; j, k: of the row */
AVX2_INLINE row_points map_row(const raster_slot *map, __m128 j, __m128 k)
{
    const __m256 left = _mm256_setr_ps(0, 1, 2, 3, 4, 5, 6, 7), right = _mm256_setr_ps(8, 9, 10, 11, 12, 13, 14, 15);
    __m128 start = _mm_add_ps(_mm_load_ps(map->origin), _mm_mul_ps(j, _mm_load_ps(map->step_j)));
    start = _mm_add_ps(start, _mm_mul_ps(k, _mm_load_ps(map->step_k)));
    const __m256 both = _mm256_set_m128(start, start);
    const __m256 from[3] = {_mm256_shuffle_ps(both, both, 0), _mm256_shuffle_ps(both, both, 0x55), _mm256_shuffle_ps(both, both, 0xaa)};
    row_points points;
    for (int d = 0; d < 3; d++) {
        __m256 step = _mm256_broadcast_ss(&map->step_i[d]);
        points.at[d][0] = _mm256_add_ps(from[d], _mm256_mul_ps(left, step));
        points.at[d][1] = _mm256_add_ps(from[d], _mm256_mul_ps(right, step));
    }
    return points;
}

/* the voxels of a row that are sampled and copied, and the points of the sampled, each by its owner's map */
typedef struct row_kinds { uint32_t sampled, copied; } row_kinds;

AVX2_INLINE row_kinds find_points(const raster_brick *brick, int32_t row, row_points *points)
{
    const __m128 j = _mm_set1_ps((float)(row % BRICK)), k = _mm_set1_ps((float)(row / BRICK));
    const int count = brick->num_entries[row];
    int e = 0;
    row_kinds kinds = {0, 0};
    for (; e < count && brick->entry[e][row] & ENTRY_COPY; e++) kinds.copied |= brick->entry[e][row];
    if (e < count) { /* of the first map all, until others claim their part */
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

/* What a brick's rows have in common. */
typedef struct brick_scan {
    const char *corner[4];              /* left voxel of the cell at the brick's base: (y, z), (y + 1, z), (y, z + 1), (y + 1, z + 1) */
    __m256i step_j, step_k;
    __m256 low[3], high[3], last[3];    /* limits of indices */
} brick_scan;

AVX2_INLINE brick_scan scan_of(const raster_source *source, const raster_brick *brick, ptrdiff_t voxel)
{
    brick_scan scan;
    for (int c = 0; c < 4; c++)
        scan.corner[c] = (const char *)source->voxels + voxel * (brick->base_index + (c & 1) * source->step[1] + (c >> 1) * source->step[2]);
    scan.step_j = _mm256_set1_epi32((int32_t)source->step[1]);
    scan.step_k = _mm256_set1_epi32((int32_t)source->step[2]);
    for (int d = 0; d < 3; d++) {
        scan.low[d] = _mm256_set1_ps(brick->low[d]);
        scan.high[d] = _mm256_set1_ps(brick->high[d]);
        scan.last[d] = _mm256_set1_ps(brick->last[d]);
    }
    return scan;
}

/* The points of a row: flat index of the left lower corner of their cells, relative to the base, and where in the cell. */
typedef struct row_cells {
    alignas(32) int32_t corner[BRICK];
    alignas(32) float x[BRICK], y[BRICK], z[BRICK];
    row_kinds kinds;
    bool inner; /* no cell is near the end of the scan */
} row_cells;

/* The cell below 8 coordinates along one axis; where in the cell goes to `within`. inner: no point needs a limit. */
AVX2_INLINE __m256i split(const brick_scan *scan, int axis, const bool inner, __m256 at, float *within)
{
    if (!inner) at = _mm256_min_ps(_mm256_max_ps(at, scan->low[axis]), scan->high[axis]);
    __m256 below = _mm256_floor_ps(at);
    if (!inner) below = _mm256_min_ps(below, scan->last[axis]);
    _mm256_store_ps(within, _mm256_sub_ps(at, below));
    return _mm256_cvttps_epi32(below);
}

AVX2_INLINE void find_cells(const brick_scan *scan, const row_points *points, const bool inner, row_cells *cells)
{
    for (int half = 0; half < 2; half++) {
        __m256i i = split(scan, 0, inner, points->at[0][half], cells->x + 8 * half);
        __m256i j = split(scan, 1, inner, points->at[1][half], cells->y + 8 * half);
        __m256i k = split(scan, 2, inner, points->at[2][half], cells->z + 8 * half);
        j = _mm256_mullo_epi32(j, scan->step_j);
        k = _mm256_mullo_epi32(k, scan->step_k);
        _mm256_store_si256((__m256i *)(void *)(cells->corner + 8 * half), _mm256_add_epi32(i, _mm256_add_epi32(j, k)));
    }
}

/* A slice at a time: first all cells, then all values. One row after the other would wait for each one's chain of
 * dependent operations; this way those of several rows overlap. */
AVX2_INLINE void find_slice(const raster_brick *brick, const brick_scan *scan, int32_t k, int32_t rows, row_cells *cells)
{
    for (int32_t j = 0; j < rows; j++) {
        row_points points;
        cells[j].kinds = find_points(brick, k * BRICK + j, &points);
        cells[j].inner = brick->inner && cells[j].kinds.sampled == ENTRY_MASK; /* a free voxel's point may be anywhere */
        if (cells[j].inner)
            find_cells(scan, &points, true, &cells[j]);
        else if (cells[j].kinds.sampled)
            find_cells(scan, &points, false, &cells[j]);
    }
}

AVX2_INLINE __m256 between(__m256 a, __m256 b, __m256 t) { return _mm256_add_ps(a, _mm256_mul_ps(t, _mm256_sub_ps(b, a))); }

typedef int32_t __attribute__((may_alias, aligned(1))) unaligned_int32;

/* 32 bits of each of 8 cells, from its left voxel on. Single loads: faster than gather instructions here (Zen 4), and
 * not much slower where those are fast. */
AVX2_INLINE __m256i load_pairs(const char *corner, const int32_t cells[8], const ptrdiff_t voxel)
{
#define PAIR(l) (*(const unaligned_int32 *)(const void *)(corner + voxel * cells[l]))
    __m128i first = _mm_cvtsi32_si128(PAIR(0)), second = _mm_cvtsi32_si128(PAIR(4));
    first = _mm_insert_epi32(_mm_insert_epi32(_mm_insert_epi32(first, PAIR(1), 1), PAIR(2), 2), PAIR(3), 3);
    second = _mm_insert_epi32(_mm_insert_epi32(_mm_insert_epi32(second, PAIR(5), 1), PAIR(6), 2), PAIR(7), 3);
#undef PAIR
    return _mm256_inserti128_si256(_mm256_castsi128_si256(first), second, 1);
}

/* left weight in the low, right weight in the high 16 bits of each lane */
AVX2_INLINE __m256i pair_weights(__m256 x)
{
    __m256i right = _mm256_cvtps_epi32(_mm256_mul_ps(x, _mm256_set1_ps(SAMPLE_ONE)));
    __m256i left = _mm256_sub_epi32(_mm256_set1_epi32(SAMPLE_ONE), right);
    return _mm256_or_si256(left, _mm256_slli_epi32(right, 16));
}

AVX2_INLINE __m256 blend_corners(const __m256 along_x[4], const row_cells *cells, int first)
{
    __m256 y = _mm256_load_ps(cells->y + first), z = _mm256_load_ps(cells->z + first);
    return between(between(along_x[0], along_x[1], y), between(along_x[2], along_x[3], y), z);
}

/* from pairs of 16-bit numbers at the four corners */
AVX2_INLINE __m256i blend_pairs(const __m256i pairs[4], const row_cells *cells, int first)
{
    const __m256i weights = pair_weights(_mm256_load_ps(cells->x + first));
    __m256 along_x[4];
    for (int c = 0; c < 4; c++) along_x[c] = _mm256_cvtepi32_ps(_mm256_madd_epi16(pairs[c], weights));
    return _mm256_cvtps_epi32(_mm256_mul_ps(blend_corners(along_x, cells, first), _mm256_set1_ps(1.0f / SAMPLE_ONE)));
}

/* 8 voxels from `first` on */
AVX2_INLINE __m256i eight_i16(const brick_scan *scan, const row_cells *cells, int first)
{
    __m256i pairs[4];
    for (int c = 0; c < 4; c++) pairs[c] = load_pairs(scan->corner[c], cells->corner + first, sizeof(int16_t));
    return blend_pairs(pairs, cells, first);
}

AVX2_INLINE __m256i eight_u8(const brick_scan *scan, const row_cells *cells, int first)
{
    const __m256i spread = _mm256_setr_epi8(0, -1, 1, -1, 4, -1, 5, -1, 8, -1, 9, -1, 12, -1, 13, -1,
                                            0, -1, 1, -1, 4, -1, 5, -1, 8, -1, 9, -1, 12, -1, 13, -1);
    __m256i pairs[4];
    for (int c = 0; c < 4; c++)
        pairs[c] = _mm256_shuffle_epi8(load_pairs(scan->corner[c], cells->corner + first, sizeof(uint8_t)), spread);
    return blend_pairs(pairs, cells, first);
}

AVX2_INLINE __m128 two_pairs(const float *voxels, const int32_t cells[2])
{
    __m128 first = _mm_loadl_pi(_mm_setzero_ps(), (const __m64 *)(const void *)(voxels + cells[0]));
    return _mm_loadh_pi(first, (const __m64 *)(const void *)(voxels + cells[1]));
}

AVX2_INLINE __m256 eight_f32(const brick_scan *scan, const row_cells *cells, int first)
{
    const int32_t *corner = cells->corner + first;
    const __m256 x = _mm256_load_ps(cells->x + first);
    __m256 along_x[4];
    for (int c = 0; c < 4; c++) {
        const float *voxels = (const float *)(const void *)scan->corner[c];
        __m256 even = _mm256_set_m128(two_pairs(voxels, corner + 4), two_pairs(voxels, corner));
        __m256 odd = _mm256_set_m128(two_pairs(voxels, corner + 6), two_pairs(voxels, corner + 2));
        along_x[c] = between(_mm256_shuffle_ps(even, odd, 0x88), _mm256_shuffle_ps(even, odd, 0xdd), x);
    }
    return blend_corners(along_x, cells, first);
}

/* Where mask has a bit, `from` replaces values (32-byte aligned). */
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

AVX2_INLINE void put_f32(__m256 left, __m256 right, uint32_t mask, float *values)
{
    const __m256i masks = _mm256_set1_epi32((int32_t)mask);
    _mm256_store_ps(values, _mm256_blendv_ps(_mm256_load_ps(values), left, left_lanes(masks)));
    _mm256_store_ps(values + 8, _mm256_blendv_ps(_mm256_load_ps(values + 8), right, right_lanes(masks)));
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
    put_f32(_mm256_loadu_ps(from), _mm256_loadu_ps(from + 8), mask, values);
}

/* The sampled voxels of a row into values */
AVX2_INLINE void sample_i16(const raster_source *source, const raster_brick *brick, const brick_scan *scan,
                            const row_cells *cells, int32_t row, int16_t *values)
{
    (void)source, (void)brick, (void)row;
    __m256i all = _mm256_packs_epi32(eight_i16(scan, cells, 0), eight_i16(scan, cells, 8));
    put_i16(_mm256_permute4x64_epi64(all, 0xd8), cells->kinds.sampled, values);
}

AVX2_INLINE void sample_u8(const raster_source *source, const raster_brick *brick, const brick_scan *scan,
                           const row_cells *cells, int32_t row, uint8_t *values)
{
    if (!cells->inner) {
        /* 4 bytes are read: the two wanted and two behind them, which the scan's last voxels do not have */
        ptrdiff_t last = source->count - 4 - brick->base_index - source->step[1] - source->step[2], furthest = cells->corner[0];
        for (int i = 1; i < BRICK; i++) furthest = cells->corner[i] > furthest ? cells->corner[i] : furthest;
        if (furthest > last) {
            pliant_raster_row_u8(source, brick, row, values);
            return;
        }
    }
    __m256i words = _mm256_packs_epi32(eight_u8(scan, cells, 0), eight_u8(scan, cells, 8));
    words = _mm256_permute4x64_epi64(words, 0xd8);
    put_u8(_mm_packus_epi16(_mm256_castsi256_si128(words), _mm256_extracti128_si256(words, 1)), cells->kinds.sampled, values);
}

AVX2_INLINE void sample_f32(const raster_source *source, const raster_brick *brick, const brick_scan *scan,
                            const row_cells *cells, int32_t row, float *values)
{
    (void)source, (void)brick, (void)row;
    put_f32(eight_f32(scan, cells, 0), eight_f32(scan, cells, 8), cells->kinds.sampled, values);
}

/* Source voxels that the row two slices further on will likely want. */
AVX2_INLINE void prefetch_slices(const brick_scan *scan, const row_cells *cells, ptrdiff_t ahead, ptrdiff_t voxel)
{
    const uintptr_t from = (uintptr_t)scan->corner[3];
    __builtin_prefetch((const void *)(from + (uintptr_t)(voxel * (cells->corner[0] + ahead))));
    __builtin_prefetch((const void *)(from + (uintptr_t)(voxel * (cells->corner[BRICK - 1] + ahead))));
}

/* Two functions a type. A copied run goes whole rows at once where the scan's memory allows. */
#define WRITE_FUNCTION(type, name)                                                                                  \
    AVX2_INLINE void copy_##name(const raster_source *source, const raster_brick *brick, int32_t row, type *values) \
    {                                                                                                               \
        const type *voxels = source->voxels;                                                                        \
        for (int e = 0; e < brick->num_entries[row]; e++) {                                                         \
            uint32_t entry = brick->entry[e][row];                                                                  \
            if (!(entry & ENTRY_COPY)) continue;                                                                    \
            const raster_copy *copy = &brick->slot[entry >> ENTRY_SLOT_SHIFT & ENTRY_SLOT].copy;                    \
            int64_t start = sample_copy_start(copy, row);                                                           \
            if (copy->step_i == 1 && start >= 0 && start + BRICK <= source->count)                                  \
                copy_row_##name(voxels + start, entry, values);                                                     \
            else                                                                                                    \
                for (int i = 0; i < BRICK; i++)                                                                     \
                    if (entry >> i & 1) values[i] = voxels[start + i * copy->step_i];                               \
        }                                                                                                           \
    }                                                                                                               \
    AVX2 static void write_##name(const raster_source *source, const raster_brick *brick, const int32_t extent[3],  \
                                  void *out, ptrdiff_t row_step, ptrdiff_t slice_step)                              \
    {                                                                                                               \
        const brick_scan scan = scan_of(source, brick, sizeof(type));                                               \
        for (int32_t k = 0; k < extent[2]; k++) {                                                                   \
            row_cells cells[BRICK];                                                                                 \
            find_slice(brick, &scan, k, extent[1], cells);                                                          \
            for (int32_t j = 0; j < extent[1]; j++) {                                                               \
                alignas(32) type values[BRICK];                                                                     \
                for (int i = 0; i < BRICK; i++) values[i] = source->background.name;                                \
                if (cells[j].kinds.sampled) {                                                                       \
                    prefetch_slices(&scan, &cells[j], 2 * source->step[2], sizeof(type));                           \
                    sample_##name(source, brick, &scan, &cells[j], k * BRICK + j, values);                          \
                }                                                                                                   \
                if (cells[j].kinds.copied) copy_##name(source, brick, k * BRICK + j, values);                       \
                type *to = (type *)out + j * row_step + k * slice_step;                                             \
                if (extent[0] == BRICK)                                                                             \
                    memcpy(to, values, sizeof values);                                                              \
                else                                                                                                \
                    memcpy(to, values, (size_t)extent[0] * sizeof *values);                                         \
            }                                                                                                       \
        }                                                                                                           \
    }
WRITE_FUNCTION(int16_t, i16)
WRITE_FUNCTION(uint8_t, u8)
WRITE_FUNCTION(float, f32)

bool pliant_raster_kernels_avx2(const raster_source *source, raster_kernels *out)
{
    /* indices are 32 bits, and every voxel's right neighbour is in memory */
    if (!__builtin_cpu_supports("avx2") || !__builtin_cpu_supports("popcnt")) return false;
    if (source->size[0] < 2 || source->count > INT32_MAX / 4) return false;
    out->find_owners = find_owners;
    switch (source->encoding) {
    case PLIANT_UINT8: out->write = write_u8; break;
    case PLIANT_INT16: out->write = write_i16; break;
    case PLIANT_FLOAT32: out->write = write_f32; break;
    }
    return true;
}

#else

bool pliant_raster_kernels_avx2(const raster_source *source, raster_kernels *out)
{
    (void)source, (void)out;
    return false;
}

#endif
