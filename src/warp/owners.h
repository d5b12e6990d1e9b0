/* Who owns which voxel of a brick: what both sets of inner loops share, included by each so that it is compiled with
 * the instructions of that set. */
#ifndef PLIANT_WARP_OWNERS_H
#define PLIANT_WARP_OWNERS_H

#include "warp/raster.h"

#if defined(__GNUC__)
#define OWNER_INLINE static inline __attribute__((always_inline))
#else
#define OWNER_INLINE static inline
#endif

/* The planes of a tetrahedron that cut a brick. A voxel i of a row is inside when
 *     -floor(least t of rising) <= i <= floor(least t of the others),   t = value * factor.
 * Values are integers plus 1/2. A divisor is at most 2^45, so the exact quotient is at least 2^-46 away from a whole
 * number; value * (1 / divisor) is off by less than 2^-47 where it is below 16; so rounding down gives the exact result. */
typedef struct owner_planes {
    int32_t num_rising, num_others;
    struct owner_plane { double value, step_j, step_k, factor; } rising[4], others[4]; /* value: at the first voxel */
} owner_planes;

/* First and last row along j and k, and voxel along i, of a tetrahedron's box inside a brick. */
typedef struct owner_box { int32_t low[3], high[3]; } owner_box;

/* Gives free voxels inside the box and all planes to the owner whose entry (without mask) it gets; how many. */
typedef int32_t owner_claim(raster_brick *brick, const owner_planes *planes, const owner_box *box, uint32_t entry);

/* false when a plane leaves nothing of the brick */
OWNER_INLINE bool owner_find_planes(const raster_tet *tet, const int32_t origin[3], owner_planes *out)
{
    double value[4], most[4], least[4];
    for (int v = 0; v < 4; v++) {
        int64_t exact = tet->value[v];
        for (int d = 0; d < 3; d++) exact += (int64_t)tet->normal[d][v] * origin[d];
        value[v] = (double)exact; /* rounded only where it is far from 0 and its sign is all that counts */
    }
    for (int v = 0; v < 4; v++) {
        most[v] = least[v] = value[v];
        for (int d = 0; d < 3; d++) {
            double n = tet->normal[d][v] * (BRICK - 1);
            most[v] += n > 0 ? n : 0;
            least[v] += n < 0 ? n : 0;
        }
    }
    if (most[0] < 0 || most[1] < 0 || most[2] < 0 || most[3] < 0) return false;
    out->num_rising = out->num_others = 0;
    for (int v = 0; v < 4; v++) {
        if (least[v] >= 0) continue;
        struct owner_plane *plane = tet->normal[0][v] > 0 ? &out->rising[out->num_rising++] : &out->others[out->num_others++];
        *plane = (struct owner_plane){value[v] + 0.5, tet->normal[1][v], tet->normal[2][v], tet->factor[v]};
    }
    return true;
}

OWNER_INLINE bool owner_find_box(const raster_tet *tet, const int32_t origin[3], owner_box *box)
{
    for (int d = 0; d < 3; d++) {
        box->low[d] = tet->low[d] > origin[d] ? tet->low[d] - origin[d] : 0;
        box->high[d] = tet->high[d] < origin[d] + BRICK - 1 ? tet->high[d] - origin[d] : BRICK - 1;
        if (box->low[d] > box->high[d]) return false;
    }
    return true;
}

/* The source voxel that slots are relative to: where the first owner has the middle of the brick. Small numbers keep
 * float coordinates good to about 1e-6 voxel. */
OWNER_INLINE void owner_choose_base(const raster_source *source, const raster_tet *tet, const int32_t origin[3], raster_brick *brick)
{
    brick->base_index = 0;
    for (int d = 0; d < 3; d++) {
        double at = tet->map[3][d];
        for (int c = 0; c < 3; c++) at += tet->map[c][d] * (origin[c] + BRICK / 2);
        int32_t end = source->size[d] - 1;
        int32_t base = at >= end ? end : at > 0 ? (int32_t)at : 0;
        brick->base[d] = base;
        brick->low[d] = (float)-base;
        brick->high[d] = (float)(end - base);
        brick->last[d] = (float)((end > 0 ? end - 1 : 0) - base);
        brick->base_index += base * source->step[d];
    }
}

OWNER_INLINE void owner_fill_sample(const raster_tet *tet, const int32_t origin[3], const int32_t base[3], raster_slot *slot)
{
    const double(*map)[4] = tet->map;
    const double i = origin[0], j = origin[1], k = origin[2], from[4] = {base[0], base[1], base[2], 0};
    for (int d = 0; d < 4; d++) slot->origin[d] = (float)(map[0][d] * i + map[1][d] * j + map[2][d] * k + (map[3][d] - from[d]));
    for (int d = 0; d < 4; d++) slot->step_i[d] = (float)map[0][d];
    for (int d = 0; d < 4; d++) slot->step_j[d] = (float)map[1][d];
    for (int d = 0; d < 4; d++) slot->step_k[d] = (float)map[2][d];
}

OWNER_INLINE void owner_fill_copy(const raster_source *source, const raster_tet *tet, const int32_t origin[3], raster_copy *slot)
{
    const double(*map)[4] = tet->map;
    *slot = (raster_copy){0, 0, 0, 0};
    for (int d = 0; d < 3; d++) {
        double at = map[0][d] * origin[0] + map[1][d] * origin[1] + map[2][d] * origin[2] + map[3][d];
        slot->first += (int64_t)at * source->step[d];
        slot->step_i += (int64_t)map[0][d] * source->step[d];
        slot->step_j += (int64_t)map[1][d] * source->step[d];
        slot->step_k += (int64_t)map[2][d] * source->step[d];
    }
}

OWNER_INLINE void owner_find_all(const raster_source *source, const raster_tet *tets, const int32_t *candidates,
                                  size_t num_candidates, const int32_t origin[3], raster_brick *brick, owner_claim *claim)
{
    uint32_t num_slots = 0;
    brick->inner = true;
    for (size_t c = 0; c < num_candidates && brick->num_free > 0; c++) {
        const raster_tet *tet = &tets[candidates[c]];
#if defined(__GNUC__)
        if (c + 1 < num_candidates) /* they lie apart in memory */
            for (size_t byte = 0; byte < sizeof *tet; byte += 64) __builtin_prefetch((const char *)&tets[candidates[c + 1]] + byte);
#endif
        owner_box box;
        owner_planes planes;
        if (!owner_find_box(tet, origin, &box) || !owner_find_planes(tet, origin, &planes)) continue;
        uint32_t entry = num_slots << ENTRY_SLOT_SHIFT | (tet->kind == RASTER_COPY ? ENTRY_COPY : 0);
        int32_t claimed = claim(brick, &planes, &box, entry);
        if (claimed == 0) continue;
        brick->num_free -= claimed;
        if (num_slots == 0) owner_choose_base(source, tet, origin, brick);
        if (tet->kind == RASTER_COPY)
            owner_fill_copy(source, tet, origin, &brick->slot[num_slots].copy);
        else
            owner_fill_sample(tet, origin, brick->base, &brick->slot[num_slots].sample);
        brick->inner &= tet->inner;
        num_slots++;
    }
}

#endif
