/* All voxels of one brick: who owns each, then their values row by row. */
#include "warp/raster.h"

#include <math.h>
#include <string.h>

/* A quotient of integers whose divisor is at most 2^45 is whole or at least 2^-45 away from the next whole number.
 * Below 16, value * (1 / step) is off by less than 2^-47. So with 2^-46 added, rounding down gives the exact result. */
static const double quotient_bias = 0x1p-46;

/* The planes that cut a brick; false when one leaves nothing of it. */
static bool find_planes(const raster_tet *tet, const int32_t origin[3], raster_planes *out)
{
    out->num_rising = out->num_others = 0;
    for (int v = 0; v < 4; v++) {
        const int64_t *normal = tet->normal[v];
        int64_t value = tet->value[v], most = 0, least = 0;
        for (int d = 0; d < 3; d++) {
            value += normal[d] * origin[d];
            *(normal[d] > 0 ? &most : &least) += normal[d] * (BRICK - 1);
        }
        if (value + most < 0) return false;
        if (value + least >= 0) continue;
        struct raster_plane *plane = normal[0] > 0 ? &out->rising[out->num_rising++] : &out->others[out->num_others++];
        *plane = (struct raster_plane){.value = (double)value, .step_j = (double)normal[1], .step_k = (double)normal[2],
                                       .factor = 1 / fabs((double)normal[0]), .bias = quotient_bias};
        if (normal[0] == 0) { /* all or nothing: beyond either end of the row */
            plane->factor = 2 * BRICK;
            plane->bias = BRICK;
        }
    }
    return true;
}

/* The source voxel that slots are relative to: where the first owner has the middle of the brick. Small numbers keep
 * float coordinates good to about 1e-6 voxel. */
static void choose_base(const raster_source *source, const raster_tet *tet, const int32_t origin[3], raster_brick *brick)
{
    brick->base_index = 0;
    for (int d = 0; d < 3; d++) {
        double at = tet->map[d][3];
        for (int c = 0; c < 3; c++) at += tet->map[d][c] * (origin[c] + BRICK / 2);
        int32_t end = source->size[d] - 1;
        int32_t base = at >= end ? end : at > 0 ? (int32_t)at : 0;
        brick->base[d] = base;
        brick->low[d] = (float)-base;
        brick->high[d] = (float)(end - base);
        brick->last[d] = (float)((end > 0 ? end - 1 : 0) - base);
        brick->base_index += base * source->step[d];
    }
}

static void fill_sample(const raster_tet *tet, const int32_t origin[3], const raster_brick *brick, raster_slot *slot)
{
    for (int d = 0; d < 3; d++) {
        const double *map = tet->map[d];
        slot->origin[d] = (float)(map[0] * origin[0] + map[1] * origin[1] + map[2] * origin[2] + (map[3] - brick->base[d]));
        slot->step_i[d] = (float)map[0];
        slot->step_j[d] = (float)map[1];
        slot->step_k[d] = (float)map[2];
    }
}

static void fill_copy(const raster_source *source, const raster_tet *tet, const int32_t origin[3], raster_copy *slot)
{
    *slot = (raster_copy){0};
    for (int d = 0; d < 3; d++) {
        const double *map = tet->map[d];
        double at = map[0] * origin[0] + map[1] * origin[1] + map[2] * origin[2] + map[3];
        slot->first += (int64_t)at * source->step[d];
        slot->step_i += (int64_t)map[0] * source->step[d];
        slot->step_j += (int64_t)map[1] * source->step[d];
        slot->step_k += (int64_t)map[2] * source->step[d];
    }
}

static void find_owners(const raster_source *source, const raster_kernels *kernels, const raster_tet *tets,
                        const int32_t *candidates, size_t num_candidates, const int32_t origin[3], raster_brick *brick)
{
    uint32_t num_slots = 0;
    for (size_t c = 0; c < num_candidates && brick->num_free > 0; c++) {
        const raster_tet *tet = &tets[candidates[c]];
        raster_planes planes;
        if (!find_planes(tet, origin, &planes)) continue;
        int32_t low[3], high[3];
        bool empty = false;
        for (int d = 0; d < 3; d++) {
            low[d] = tet->low[d] > origin[d] ? tet->low[d] - origin[d] : 0;
            high[d] = tet->high[d] < origin[d] + BRICK - 1 ? tet->high[d] - origin[d] : BRICK - 1;
            empty |= low[d] > high[d];
        }
        if (empty) continue;
        uint32_t entry = num_slots << ENTRY_SLOT_SHIFT | (tet->kind == RASTER_COPY ? ENTRY_COPY : 0);
        int32_t claimed = kernels->claim(brick, &planes, low, high, entry);
        if (claimed == 0) continue;
        brick->num_free -= claimed;
        if (num_slots == 0) choose_base(source, tet, origin, brick);
        if (tet->kind == RASTER_COPY)
            fill_copy(source, tet, origin, &brick->slot[num_slots].copy);
        else
            fill_sample(tet, origin, brick, &brick->slot[num_slots].sample);
        num_slots++;
    }
}

void pliant_raster_brick(const raster_grid *grid, const raster_source *source, const raster_kernels *kernels,
                         const raster_tet *tets, const int32_t *candidates, size_t num_candidates,
                         const int32_t brick[3], raster_brick *scratch, void *out)
{
    const int32_t *size = grid->target.size;
    int32_t origin[3], extent[3];
    for (int d = 0; d < 3; d++) {
        origin[d] = brick[d] * BRICK;
        extent[d] = size[d] - origin[d] < BRICK ? size[d] - origin[d] : BRICK;
    }
    /* rows beyond the target are not to be had */
    memset(scratch->owned, 0xff, sizeof scratch->owned);
    for (int32_t k = 0; k < extent[2]; k++)
        for (int32_t j = 0; j < extent[1]; j++) {
            int32_t row = k * BRICK + j;
            scratch->owned[row / ROWS_AT_ONCE] &= ~((uint64_t)ENTRY_MASK << 16 * (row % ROWS_AT_ONCE));
        }
    memset(scratch->num_entries, 0, sizeof scratch->num_entries);
    scratch->num_free = extent[0] * extent[1] * extent[2];
    find_owners(source, kernels, tets, candidates, num_candidates, origin, scratch);

    size_t voxel = pliant_encoding_size(source->encoding), row_bytes = voxel * (size_t)extent[0];
    for (int32_t k = 0; k < extent[2]; k++)
        for (int32_t j = 0; j < extent[1]; j++) {
            alignas(32) unsigned char values[BRICK * sizeof(float)];
            kernels->row(source, scratch, k * BRICK + j, values);
            size_t at = (size_t)origin[0] + (size_t)size[0] * ((size_t)(origin[1] + j) + (size_t)size[1] * (size_t)(origin[2] + k));
            memcpy((unsigned char *)out + voxel * at, values, row_bytes);
        }
}
