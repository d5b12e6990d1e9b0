/* Functions shared by the inner loops with AVX2 and AVX-512, which are chosen at run time; the rest of the library is
 * portable. The including file defines SIMD and SIMD_INLINE, the attributes of its functions, and SIMD_ROWS, the number
 * of rows whose intervals it finds at once. All operations and their order are the same as in sample_portable.c. */
#ifndef PLIANT_WARP_SIMD_H
#define PLIANT_WARP_SIMD_H

#include "warp/inner_loops.h"
#include "warp/voxel_owners.h"

#include <immintrin.h>
#include <string.h>

#define AVX2 __attribute__((target("avx2,popcnt")))
#define AVX2_INLINE static inline __attribute__((always_inline, target("avx2,popcnt")))

/* indices have 32 bits, and every voxel's right neighbour must be in memory */
static inline bool simd_suits(const raster_source *source)
{
    return source->size[0] >= 2 && source->count <= INT32_MAX / 4;
}

/* Planes of a tetrahedron that intersect a brick, numbered 0 to 3. start: value at the first voxel of the box's first
 * row of a group, plus 1/2 and a term that shifts t by OWNER_SHIFT (less for a plane parallel to the rows, where it has
 * no effect). */
typedef struct brick_planes {
    alignas(32) double start[4], step_group[4];
    uint32_t rising, others; /* one bit per plane */
} brick_planes;

/* Find the planes; false if a plane excludes the whole brick.
 * group: rows at once */
AVX2_INLINE bool find_planes(const raster_tet *tet, const int32_t origin[3], const owner_box *box, int32_t group,
                             brick_planes *planes)
{
    alignas(32) double values[4];
    owner_values(tet, origin, values);
    const __m256d zero = _mm256_setzero_pd(), edge = _mm256_set1_pd(BRICK - 1);
    const __m256d i = _mm256_loadu_pd(tet->normal[0]), j = _mm256_loadu_pd(tet->normal[1]);
    const __m256d k = _mm256_loadu_pd(tet->normal[2]), value = _mm256_load_pd(values);
    __m256d rise = _mm256_add_pd(_mm256_add_pd(_mm256_max_pd(i, zero), _mm256_max_pd(j, zero)), _mm256_max_pd(k, zero));
    __m256d fall = _mm256_add_pd(_mm256_add_pd(_mm256_min_pd(i, zero), _mm256_min_pd(j, zero)), _mm256_min_pd(k, zero));
    /* maximum and minimum in the brick, whose signs are exact */
    if (_mm256_movemask_pd(_mm256_add_pd(value, _mm256_mul_pd(rise, edge)))) return false;
    uint32_t cut = (uint32_t)_mm256_movemask_pd(_mm256_add_pd(value, _mm256_mul_pd(fall, edge)));
    uint32_t up = (uint32_t)_mm256_movemask_pd(_mm256_cmp_pd(i, zero, _CMP_GT_OQ));
    planes->rising = cut & up;
    planes->others = cut & ~up;

    const __m256d size = _mm256_andnot_pd(_mm256_set1_pd(-0.0), i);
    __m256d start =
        _mm256_add_pd(_mm256_add_pd(value, _mm256_set1_pd(0.5)), _mm256_mul_pd(size, _mm256_set1_pd(OWNER_SHIFT)));
    start = _mm256_add_pd(start, _mm256_mul_pd(j, _mm256_set1_pd(box->low[1] / group * group)));
    _mm256_store_pd(planes->start, _mm256_add_pd(start, _mm256_mul_pd(k, _mm256_set1_pd(box->low[2]))));
    _mm256_store_pd(planes->step_group, _mm256_mul_pd(j, _mm256_set1_pd(group)));
    return true;
}

/* Assign the free voxels of 4 rows (the low four masks of 16 bits) to an owner. */
AVX2_INLINE void add_entries(raster_brick *brick, int32_t group, __m128i masks, __m128i entry)
{
    __m128i entries = _mm_or_si128(_mm_cvtepu16_epi32(masks), entry);
    uint32_t counts;
    memcpy(&counts, brick->num_entries + ROWS_AT_ONCE * group, sizeof counts);
    const int32_t row = ROWS_AT_ONCE * group; /* an empty entry is written but not counted */
    brick->entry[counts & 0xff][row] = (uint32_t)_mm_cvtsi128_si32(entries);
    brick->entry[counts >> 8 & 0xff][row + 1] = (uint32_t)_mm_extract_epi32(entries, 1);
    brick->entry[counts >> 16 & 0xff][row + 2] = (uint32_t)_mm_extract_epi32(entries, 2);
    brick->entry[counts >> 24][row + 3] = (uint32_t)_mm_extract_epi32(entries, 3);
    __m128i empty = _mm_cmpeq_epi16(masks, _mm_setzero_si128());
    counts += 0x01010101 & ~(uint32_t)_mm_cvtsi128_si32(_mm_packs_epi16(empty, empty));
    memcpy(brick->num_entries + ROWS_AT_ONCE * group, &counts, sizeof counts);
}

/* Implements find_owners with claim_rows of the including file. A closed surface has rising and other planes, so there
 * are at most three of a kind. There is one instance for every number of planes, so that loops over planes unroll and
 * their values stay in registers. */
#define CLAIM_CASE(rising, others) \
    case 4 * rising + others: return claim_rows(brick, tet, &planes, box, entry, rising, others);
#define CLAIM_FUNCTIONS                                                                                               \
    SIMD static int32_t claim(raster_brick *brick, const raster_tet *tet, const int32_t origin[3],                    \
                              const owner_box *box, uint32_t entry)                                                   \
    {                                                                                                                 \
        brick_planes planes;                                                                                          \
        if (!find_planes(tet, origin, box, SIMD_ROWS, &planes)) return 0;                                             \
        switch (4 * __builtin_popcount(planes.rising) + __builtin_popcount(planes.others)) {                          \
            CLAIM_CASE(0, 0) CLAIM_CASE(0, 1) CLAIM_CASE(0, 2) CLAIM_CASE(0, 3) CLAIM_CASE(1, 0) CLAIM_CASE(1, 1)     \
            CLAIM_CASE(1, 2) CLAIM_CASE(1, 3) CLAIM_CASE(2, 0) CLAIM_CASE(2, 1) CLAIM_CASE(2, 2) CLAIM_CASE(3, 0)     \
            CLAIM_CASE(3, 1)                                                                                          \
        }                                                                                                             \
        return 0;                                                                                                     \
    }                                                                                                                 \
    SIMD static void find_owners(const raster_source *source, const part_view *parts, const raster_tet *tets,         \
                                 const int32_t *candidates, size_t num_candidates, const int32_t origin[3],           \
                                 raster_brick *brick)                                                                 \
    {                                                                                                                 \
        owner_find_all(source, parts, tets, candidates, num_candidates, origin, brick, claim);                        \
    }

/* the voxels of a row that are sampled and copied */
typedef struct row_kinds { uint32_t sampled, copied; } row_kinds;

/* Points of a row: flat index of the left lower corner of their cells relative to the base, and the positions in the
 * cells. */
typedef struct row_cells {
    alignas(64) int32_t corner[BRICK];
    alignas(64) float x[BRICK], y[BRICK], z[BRICK];
    row_kinds kinds;
    bool inner; /* whether no cell is near the end of the scan */
} row_cells;

/* Data that all rows of a brick share: the left voxel of the cell at the brick's base, at (y, z), (y + 1, z), (y, z +
 * 1) and (y + 1, z + 1). */
typedef struct brick_scan { const char *corner[4]; } brick_scan;

AVX2_INLINE brick_scan scan_of(const raster_source *source, const raster_brick *brick, ptrdiff_t voxel)
{
    brick_scan scan;
    for (int c = 0; c < 4; c++)
        scan.corner[c] = (const char *)source->voxels +
                         voxel * (brick->base_index + (c & 1) * source->step[1] + (c >> 1) * source->step[2]);
    return scan;
}

/* Set the sign bit in the lanes whose bit is set, for blend instructions, which use only the sign. */
AVX2_INLINE __m256 left_lanes(__m256i mask)
{
    return _mm256_castsi256_ps(_mm256_sllv_epi32(mask, _mm256_setr_epi32(31, 30, 29, 28, 27, 26, 25, 24)));
}
AVX2_INLINE __m256 right_lanes(__m256i mask)
{
    return _mm256_castsi256_ps(_mm256_sllv_epi32(mask, _mm256_setr_epi32(23, 22, 21, 20, 19, 18, 17, 16)));
}

/* Set all bits in the 16-bit lanes whose bit is set. */
AVX2_INLINE __m256i lanes16(uint32_t mask)
{
    const __m256i bits =
        _mm256_setr_epi16(1, 2, 4, 8, 16, 32, 64, 128, 256, 512, 1024, 2048, 4096, 8192, 16384, INT16_MIN);
    return _mm256_cmpeq_epi16(_mm256_and_si256(_mm256_set1_epi16((int16_t)mask), bits), bits);
}

AVX2_INLINE __m256 between(__m256 a, __m256 b, __m256 t)
{
    return _mm256_add_ps(a, _mm256_mul_ps(t, _mm256_sub_ps(b, a)));
}

typedef int32_t __attribute__((may_alias, aligned(1))) unaligned_int32;

/* Load 32 bits at the four corners of each of 4 cells, from the left voxel on. Single loads are faster than gather
 * instructions on Zen 4, and not much slower on machines with fast gathers. */
AVX2_INLINE void load_pairs(const brick_scan *scan, const int32_t cells[4], const ptrdiff_t voxel, __m128i pairs[4])
{
    const ptrdiff_t at[4] = {voxel * cells[0], voxel * cells[1], voxel * cells[2], voxel * cells[3]};
#define PAIR(l) (*(const unaligned_int32 *)(const void *)(scan->corner[c] + at[l]))
    for (int c = 0; c < 4; c++) {
        __m128i first = _mm_insert_epi32(_mm_cvtsi32_si128(PAIR(0)), PAIR(1), 1);
        pairs[c] = _mm_insert_epi32(_mm_insert_epi32(first, PAIR(2), 2), PAIR(3), 3);
    }
#undef PAIR
}

AVX2_INLINE __m256i join(__m128i left, __m128i right)
{
    return _mm256_inserti128_si256(_mm256_castsi128_si256(left), right, 1);
}

AVX2_INLINE __m256 blend_corners(const __m256 along_x[4], const row_cells *cells, int first)
{
    __m256 y = _mm256_load_ps(cells->y + first), z = _mm256_load_ps(cells->z + first);
    return between(between(along_x[0], along_x[1], y), between(along_x[2], along_x[3], y), z);
}

AVX2_INLINE __m128 two_pairs(const float *voxels, const int32_t cells[2])
{
    __m128 first = _mm_loadl_pi(_mm_setzero_ps(), (const __m64 *)(const void *)(voxels + cells[0]));
    return _mm_loadh_pi(first, (const __m64 *)(const void *)(voxels + cells[1]));
}

/* Sample 8 voxels from `first` on. */
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

/* Replace the values whose mask bit is set. */
AVX2_INLINE void put_i16(__m256i from, uint32_t mask, int16_t *values)
{
    __m256i old = _mm256_loadu_si256((const __m256i *)(const void *)values);
    _mm256_storeu_si256((__m256i *)(void *)values, _mm256_blendv_epi8(old, from, lanes16(mask)));
}

AVX2_INLINE void put_u8(__m128i from, uint32_t mask, uint8_t *values)
{
    __m256i wide = lanes16(mask);
    __m128i own = _mm_packs_epi16(_mm256_castsi256_si128(wide), _mm256_extracti128_si256(wide, 1));
    __m128i old = _mm_loadu_si128((const __m128i *)(const void *)values);
    _mm_storeu_si128((__m128i *)(void *)values, _mm_blendv_epi8(old, from, own));
}

AVX2_INLINE void put_f32(__m256 left, __m256 right, uint32_t mask, float *values)
{
    const __m256i masks = _mm256_set1_epi32((int32_t)mask);
    _mm256_storeu_ps(values, _mm256_blendv_ps(_mm256_loadu_ps(values), left, left_lanes(masks)));
    _mm256_storeu_ps(values + 8, _mm256_blendv_ps(_mm256_loadu_ps(values + 8), right, right_lanes(masks)));
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

/* Store 16 voxels, with the background where the mask bit is not set. A masked store is not used here, because loading
 * it back immediately stalls. */
AVX2_INLINE void fill_i16(const raster_source *source, __m256i from, uint32_t mask, int16_t *values)
{
    if (mask != ENTRY_MASK) from = _mm256_blendv_epi8(_mm256_set1_epi16(source->background.i16), from, lanes16(mask));
    _mm256_storeu_si256((__m256i *)(void *)values, from);
}

AVX2_INLINE void fill_u8(const raster_source *source, __m128i from, uint32_t mask, uint8_t *values)
{
    __m256i wide = lanes16(mask);
    __m128i own = _mm_packs_epi16(_mm256_castsi256_si128(wide), _mm256_extracti128_si256(wide, 1));
    if (mask != ENTRY_MASK) from = _mm_blendv_epi8(_mm_set1_epi8((char)source->background.u8), from, own);
    _mm_storeu_si128((__m128i *)(void *)values, from);
}

AVX2_INLINE void fill_f32(const raster_source *source, __m256 left, __m256 right, uint32_t mask, float *values)
{
    const __m256i masks = _mm256_set1_epi32((int32_t)mask);
    const __m256 background = _mm256_set1_ps(source->background.f32);
    _mm256_storeu_ps(values, _mm256_blendv_ps(background, left, left_lanes(masks)));
    _mm256_storeu_ps(values + 8, _mm256_blendv_ps(background, right, right_lanes(masks)));
}

/* Return whether the loads for a row of bytes stay in memory. A load reads 4 bytes, two more than needed, which do not
 * exist after the scan's last voxels. */
static inline bool bytes_to_spare(const raster_source *source, const raster_brick *brick, const row_cells *cells)
{
    if (cells->inner) return true;
    ptrdiff_t last = source->count - 4 - brick->base_index - source->step[1] - source->step[2],
              furthest = cells->corner[0];
    for (int i = 1; i < BRICK; i++) furthest = cells->corner[i] > furthest ? cells->corner[i] : furthest;
    return furthest <= last;
}

/* Prefetch the source voxels that the row two slices ahead will probably need. */
AVX2_INLINE void prefetch_slices(const brick_scan *scan, const row_cells *cells, ptrdiff_t ahead, ptrdiff_t voxel)
{
    const uintptr_t from = (uintptr_t)scan->corner[3];
    __builtin_prefetch((const void *)(from + (uintptr_t)(voxel * (cells->corner[0] + ahead))));
    __builtin_prefetch((const void *)(from + (uintptr_t)(voxel * (cells->corner[BRICK - 1] + ahead))));
}

/* Define two functions for a voxel type, with find_cells and sample_... of the including file. A slice is processed at
 * once: first all cells, then all values. This overlaps the chains of dependent operations of several rows. Copied runs
 * are copied as whole rows where the scan's memory allows. */
#define WRITE_FUNCTION(type, name)                                                                                  \
    SIMD_INLINE void copy_##name(const raster_source *source, const raster_brick *brick, int32_t row, type *values) \
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
    SIMD static void write_##name(const raster_source *source, const raster_brick *brick, const int32_t extent[3],  \
                                  void *out, ptrdiff_t row_step, ptrdiff_t slice_step)                              \
    {                                                                                                               \
        const brick_scan scan = scan_of(source, brick, sizeof(type));                                               \
        for (int32_t k = 0; k < extent[2]; k++) {                                                                   \
            row_cells cells[BRICK];                                                                                 \
            for (int32_t j = 0; j < extent[1]; j++) find_cells(source, brick, k * BRICK + j, &cells[j]);            \
            for (int32_t j = 0; j < extent[1]; j++) {                                                               \
                type *to = (type *)out + j * row_step + k * slice_step, spare[BRICK];                               \
                type *values = extent[0] == BRICK ? to : spare;                                                     \
                if (k + 1 < extent[2]) __builtin_prefetch(to + slice_step, 1);                                      \
                if (cells[j].kinds.sampled) {                                                                       \
                    prefetch_slices(&scan, &cells[j], 2 * source->step[2], sizeof(type));                           \
                    sample_##name(source, brick, &scan, &cells[j], k * BRICK + j, values);                          \
                } else {                                                                                            \
                    for (int i = 0; i < BRICK; i++) values[i] = source->background.name;                            \
                }                                                                                                   \
                if (cells[j].kinds.copied) copy_##name(source, brick, k * BRICK + j, values);                       \
                if (values != to) memcpy(to, values, (size_t)extent[0] * sizeof *values);                           \
            }                                                                                                       \
        }                                                                                                           \
    }

/* Define the kernels of the including file. */
#define KERNEL_FUNCTION(name, supported)                                    \
    bool name(const raster_source *source, raster_kernels *out)             \
    {                                                                       \
        if (!(supported) || !simd_suits(source)) return false;              \
        out->find_owners = find_owners;                                     \
        switch (source->encoding) {                                         \
        case PLIANT_UINT8: out->write = write_u8; break;                    \
        case PLIANT_INT16: out->write = write_i16; break;                   \
        case PLIANT_FLOAT32: out->write = write_f32; break;                 \
        }                                                                   \
        return true;                                                        \
    }

#endif
