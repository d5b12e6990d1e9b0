/* Find the owner of each voxel of a brick. Each set of inner loops includes this file, so that it is compiled with its
 * instruction set. */
#ifndef PLIANT_WARP_VOXEL_OWNERS_H
#define PLIANT_WARP_VOXEL_OWNERS_H

#include "warp/raster.h"

#if defined(__GNUC__)
#define OWNER_INLINE static inline __attribute__((always_inline))
#else
#define OWNER_INLINE static inline
#endif

/* Rows are intersected as follows. A tetrahedron has rising planes (normal along i > 0) and others. A voxel i of a row
 * is inside when
 *     -floor(least t of rising) <= i <= floor(least t of the others),   t = value * factor,
 * where value is the plane's value at voxel 0 of the row, an integer plus 1/2. The divisor is at most 2^45, so the
 * exact quotient differs from an integer by at least 2^-46. With OWNER_SHIFT added, it is positive where it matters and
 * below 48. Its error is at most 48 * 2^-52 < 2^-46, so rounding down gives the exact result. */
enum { OWNER_SHIFT = 2 * BRICK };

/* First and last row along j and k, and first and last voxel along i, of a tetrahedron's bounding box inside a
 * brick. */
typedef struct owner_box { int32_t low[3], high[3]; } owner_box;

/* Assign the free voxels inside the box and all planes to the owner with this entry (without mask). Return their
 * number. */
typedef int32_t owner_claim(raster_brick *brick, const raster_tet *tet, const int32_t origin[3], const owner_box *box,
                            uint32_t entry);

/* rasterize_parts.c: same for an element at a cut, in a plain loop for all sets */
int32_t pliant_raster_claim_part(const part_view *parts, int32_t element, const raster_tet *tet,
                                 const int32_t origin[3], const owner_box *box, uint32_t entry, raster_brick *brick);

OWNER_INLINE int32_t owner_floor(double value, int32_t low)
{
    if (value < low) return low;
    int32_t whole = (int32_t)value;
    return whole - (whole > value);
}

/* Compute the planes' values at a brick's first voxel. Where rounded, they are so far from 0 that only the sign
 * matters. */
OWNER_INLINE void owner_values(const raster_tet *tet, const int32_t origin[3], double value[4])
{
    if (tet->small) /* exact in double precision */
        for (int v = 0; v < 4; v++)
            value[v] = (double)tet->value[v] +
                       (tet->normal[0][v] * origin[0] + tet->normal[1][v] * origin[1] + tet->normal[2][v] * origin[2]);
    else
        for (int v = 0; v < 4; v++) {
            int64_t exact = tet->value[v];
            for (int d = 0; d < 3; d++) exact += (int64_t)tet->normal[d][v] * origin[d];
            value[v] = (double)exact;
        }
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

/* Choose the source voxel relative to which slots are stored: the first owner's source position of the brick's centre.
 * Small numbers keep the error of float coordinates at about 1e-6 voxel. */
OWNER_INLINE void owner_choose_base(const raster_source *source, const raster_tet *tet, const int32_t origin[3],
                                    raster_brick *brick)
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

OWNER_INLINE void owner_fill_sample(const raster_tet *tet, const int32_t origin[3], const int32_t base[3],
                                    raster_slot *slot)
{
    const double(*map)[4] = tet->map;
    const double i = origin[0], j = origin[1], k = origin[2], from[4] = {base[0], base[1], base[2], 0};
    for (int d = 0; d < 4; d++)
        slot->origin[d] = (float)(map[0][d] * i + map[1][d] * j + map[2][d] * k + (map[3][d] - from[d]));
    for (int d = 0; d < 4; d++) slot->step_i[d] = (float)map[0][d];
    for (int d = 0; d < 4; d++) slot->step_j[d] = (float)map[1][d];
    for (int d = 0; d < 4; d++) slot->step_k[d] = (float)map[2][d];
}

OWNER_INLINE void owner_fill_copy(const raster_source *source, const raster_tet *tet, const int32_t origin[3],
                                  raster_copy *slot)
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

/* Find the voxels first to last of row (j, k) inside all planes and the box.
 * corner: from owner_values */
OWNER_INLINE void owner_find_row(const raster_tet *tet, const double corner[4], const owner_box *box, int32_t j,
                                 int32_t k, int32_t *first, int32_t *last)
{
    double rise = -box->low[0], fall = box->high[0];
    for (int v = 0; v < 4; v++) {
        double t = (corner[v] + 0.5 + tet->normal[1][v] * j + tet->normal[2][v] * k) * tet->factor[v];
        double *end = tet->normal[0][v] > 0 ? &rise : &fall;
        *end = t < *end ? t : *end;
    }
    *first = -owner_floor(rise, -BRICK);
    *last = owner_floor(fall, -1);
}

/* Decide on the CPU which element draws each voxel. The first candidate that claims a voxel owns it, and the owner's
 * map gives its rest position. In cut tetrahedra, each candidate is a fragment. A fragment claims a voxel only if the
 * rest point belongs to it, and samples only its own voxels (part.h). On the GPU, the minimum key in
 * cuda/warp/voxel_owners.cuh makes the same decision. With a fit, fit_in_tissue and fit_gather (fit_point.h) do. */
OWNER_INLINE void owner_find_all(const raster_source *source, const part_view *parts, const raster_tet *tets,
                                 const int32_t *candidates, size_t num_candidates, const int32_t origin[3],
                                 raster_brick *brick, owner_claim *claim)
{
    uint32_t num_slots = 0;
    brick->inner = true;
    for (size_t c = 0; c < num_candidates && brick->num_free > 0; c++) {
        const raster_tet *tet = &tets[candidates[c]];
#if defined(__GNUC__)
        if (c + 1 < num_candidates) /* they are not contiguous in memory */
            for (size_t byte = 0; byte < sizeof *tet; byte += 64)
                __builtin_prefetch((const char *)&tets[candidates[c + 1]] + byte);
#endif
        owner_box box;
        if (!owner_find_box(tet, origin, &box)) continue;
        uint32_t entry = num_slots << ENTRY_SLOT_SHIFT | (tet->kind == RASTER_COPY ? ENTRY_COPY : 0);
        int32_t claimed = tet->has_parts
                              ? pliant_raster_claim_part(parts, candidates[c], tet, origin, &box, entry, brick)
                              : claim(brick, tet, origin, &box, entry);
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
