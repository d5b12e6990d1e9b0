/* Inner loops in plain C. The operations and their order are the same as in simd.h and the files that include it, so
 * all sets give bitwise identical results. */
#include "warp/inner_loops.h"
#include "warp/voxel_owners.h"

#include <math.h>
#include <string.h>

static int32_t count_bits(uint64_t bits)
{
    int32_t count = 0;
    for (; bits; bits &= bits - 1) count++;
    return count;
}

static int32_t claim(raster_brick *brick, const raster_tet *tet, const int32_t origin[3], const owner_box *box,
                     uint32_t entry)
{
    double corner[4];
    owner_values(tet, origin, corner);
    int32_t claimed = 0;
    for (int32_t k = box->low[2]; k <= box->high[2]; k++)
        for (int32_t j = box->low[1]; j <= box->high[1]; j++) {
            int32_t first, last;
            owner_find_row(tet, corner, box, j, k, &first, &last);
            uint32_t mask = (uint32_t)ENTRY_MASK << first & (uint32_t)ENTRY_MASK >> (BRICK - 1 - last);
            int32_t row = k * BRICK + j, shift = 16 * (row % ROWS_AT_ONCE);
            uint64_t *owned = &brick->owned[row / ROWS_AT_ONCE];
            mask &= ~(uint32_t)(*owned >> shift);
            if (!mask) continue;
            *owned |= (uint64_t)mask << shift;
            brick->entry[brick->num_entries[row]++][row] = entry | mask;
            claimed += count_bits(mask);
        }
    return claimed;
}

static void find_owners(const raster_source *source, const part_view *parts, const raster_tet *tets,
                        const int32_t *candidates, size_t num_candidates, const int32_t origin[3], raster_brick *brick)
{
    owner_find_all(source, parts, tets, candidates, num_candidates, origin, brick, claim);
}

typedef struct sample_point { float x, y, z; } sample_point;

static inline float split(float at, float low, float high, float last, int32_t *whole)
{
    at = at > low ? at : low;
    at = at < high ? at : high;
    float below = floorf(at);
    below = below < last ? below : last;
    *whole = (int32_t)below;
    return at - below;
}

static inline float between(float a, float b, float t) { return a + t * (b - a); }

typedef struct sample_cell {
    ptrdiff_t corner[4]; /* flat index of the cell's left corners: (y, z), (y + 1, z), (y, z + 1), (y + 1, z + 1) */
    ptrdiff_t right;     /* offset to its right corners */
    float x, y, z;       /* position in the cell */
} sample_cell;

static inline sample_cell find_cell(const raster_source *source, const raster_brick *brick, sample_point at)
{
    int32_t i, j, k;
    sample_cell cell = {.right = source->step[0]};
    cell.x = split(at.x, brick->low[0], brick->high[0], brick->last[0], &i);
    cell.y = split(at.y, brick->low[1], brick->high[1], brick->last[1], &j);
    cell.z = split(at.z, brick->low[2], brick->high[2], brick->last[2], &k);
    cell.corner[0] = brick->base_index + i * source->step[0] + j * source->step[1] + k * source->step[2];
    cell.corner[1] = cell.corner[0] + source->step[1];
    cell.corner[2] = cell.corner[0] + source->step[2];
    cell.corner[3] = cell.corner[1] + source->step[2];
    return cell;
}

static inline float blend(const sample_cell *cell, const float along_x[4])
{
    return between(between(along_x[0], along_x[1], cell->y), between(along_x[2], along_x[3], cell->y), cell->z);
}

/* Interpolate integers along x, in units of 1 / SAMPLE_ONE. */
static inline int32_t weigh(const sample_cell *cell, int32_t left, int32_t right)
{
    int32_t weight = (int32_t)lrintf(cell->x * SAMPLE_ONE);
    return left * (SAMPLE_ONE - weight) + right * weight;
}

static inline uint8_t sample_u8(const raster_source *source, const raster_brick *brick, sample_point at)
{
    const uint8_t *voxels = source->voxels;
    sample_cell cell = find_cell(source, brick, at);
    float along_x[4];
    if (source->nearest)
        return voxels[cell.corner[(cell.y >= 0.5f ? 1 : 0) + (cell.z >= 0.5f ? 2 : 0)] +
                      (cell.x >= 0.5f ? cell.right : 0)];
    for (int c = 0; c < 4; c++)
        along_x[c] = (float)weigh(&cell, voxels[cell.corner[c]], voxels[cell.corner[c] + cell.right]);
    return (uint8_t)lrintf(blend(&cell, along_x) * (1.0f / SAMPLE_ONE));
}

static inline int16_t sample_i16(const raster_source *source, const raster_brick *brick, sample_point at)
{
    const int16_t *voxels = source->voxels;
    sample_cell cell = find_cell(source, brick, at);
    float along_x[4];
    for (int c = 0; c < 4; c++)
        along_x[c] = (float)weigh(&cell, voxels[cell.corner[c]], voxels[cell.corner[c] + cell.right]);
    return (int16_t)lrintf(blend(&cell, along_x) * (1.0f / SAMPLE_ONE));
}

static inline float sample_f32(const raster_source *source, const raster_brick *brick, sample_point at)
{
    const float *voxels = source->voxels;
    sample_cell cell = find_cell(source, brick, at);
    float along_x[4];
    for (int c = 0; c < 4; c++)
        along_x[c] = between(voxels[cell.corner[c]], voxels[cell.corner[c] + cell.right], cell.x);
    return blend(&cell, along_x);
}

/* Define two functions for a voxel type; name: union member and suffix of the sampler. */
#define ROW_FUNCTIONS(type, name)                                                                                   \
    static void row_##name(const raster_source *source, const raster_brick *brick, int32_t row, type *values)       \
    {                                                                                                               \
        float j = (float)(row % BRICK), k = (float)(row / BRICK);                                                   \
        for (int i = 0; i < BRICK; i++) values[i] = source->background.name;                                        \
        for (int e = 0; e < brick->num_entries[row]; e++) {                                                         \
            uint32_t entry = brick->entry[e][row];                                                                  \
            const raster_copy *copy = &brick->slot[entry >> ENTRY_SLOT_SHIFT & ENTRY_SLOT].copy;                    \
            const raster_slot *map = &brick->slot[entry >> ENTRY_SLOT_SHIFT & ENTRY_SLOT].sample;                   \
            for (int i = 0; i < BRICK; i++) {                                                                       \
                if (!(entry >> i & 1)) continue;                                                                    \
                if (entry & ENTRY_COPY) {                                                                           \
                    values[i] = ((const type *)source->voxels)[sample_copy_start(copy, row) + i * copy->step_i];    \
                    continue;                                                                                       \
                }                                                                                                   \
                sample_point at = {map->origin[0] + j * map->step_j[0] + k * map->step_k[0] + i * map->step_i[0],   \
                                   map->origin[1] + j * map->step_j[1] + k * map->step_k[1] + i * map->step_i[1],   \
                                   map->origin[2] + j * map->step_j[2] + k * map->step_k[2] + i * map->step_i[2]};  \
                values[i] = sample_##name(source, brick, at);                                                       \
            }                                                                                                       \
        }                                                                                                           \
    }                                                                                                               \
    static void write_##name(const raster_source *source, const raster_brick *brick, const int32_t extent[3],       \
                             void *out, ptrdiff_t row_step, ptrdiff_t slice_step)                                   \
    {                                                                                                               \
        for (int32_t k = 0; k < extent[2]; k++)                                                                     \
            for (int32_t j = 0; j < extent[1]; j++) {                                                               \
                type values[BRICK];                                                                                 \
                row_##name(source, brick, k * BRICK + j, values);                                                   \
                memcpy((type *)out + j * row_step + k * slice_step, values, (size_t)extent[0] * sizeof *values);    \
            }                                                                                                       \
    }
ROW_FUNCTIONS(uint8_t, u8)
ROW_FUNCTIONS(int16_t, i16)
ROW_FUNCTIONS(float, f32)

void pliant_raster_row_u8(const raster_source *source, const raster_brick *brick, int32_t row, uint8_t values[BRICK])
{
    row_u8(source, brick, row, values);
}

raster_kernels pliant_raster_kernels_portable(const raster_source *source)
{
    switch (source->encoding) {
    case PLIANT_UINT8: return (raster_kernels){find_owners, write_u8};
    case PLIANT_INT16: return (raster_kernels){find_owners, write_i16};
    default: return (raster_kernels){find_owners, write_f32};
    }
}
