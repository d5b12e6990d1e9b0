/* Draw the voxels of elements at a cut, which own only a part of their tetrahedron. They are few and are drawn one by
 * one, with the same code for all inner loops. */
#include "warp/inner_loops.h"
#include "warp/part_sample.h"
#include "warp/voxel_owners.h"

#include <math.h>

/* Compute the scan index of a target voxel's rest position. In double precision relative to the target's first voxel,
 * so that it is independent of the brick's base. */
static void find_index(const raster_tet *tet, const int32_t origin[3], int32_t i, int32_t j, int32_t k, double index[3])
{
    const double at[3] = {origin[0] + i, origin[1] + j, origin[2] + k};
    for (int d = 0; d < 3; d++)
        index[d] = part_index(tet->map[0][d], tet->map[1][d], tet->map[2][d], tet->map[3][d], at);
}

/* Return the voxels of a row mask whose rest points belong to the element. */
static uint32_t find_owned_voxels(const part_view *parts, int32_t element, const raster_tet *tet,
                                  const int32_t origin[3], int32_t row, uint32_t mask, raster_brick *brick)
{
    uint32_t own = 0;
    for (uint32_t left = mask; left; left &= left - 1) {
        const int32_t i = raster_lowest_bit(left);
        double index[3];
        find_index(tet, origin, i, row % BRICK, row / BRICK, index);
        const part_claim claim =
            parts->elements[element].box < 0 ? PART_WHOLE : part_claims(parts, parts->elements[element], index);
        if (claim == PART_OTHERS) continue;
        own |= (uint32_t)1 << i;
        if (!brick->all_masked && (claim == PART_WHOLE || tet->kind == RASTER_COPY)) continue;
        brick->masked[brick->num_masked] = (uint16_t)(row * BRICK + i);
        brick->masked_by[brick->num_masked++] = element;
    }
    return own;
}

int32_t pliant_raster_claim_part(const part_view *parts, int32_t element, const raster_tet *tet,
                                 const int32_t origin[3], const owner_box *box, uint32_t entry, raster_brick *brick)
{
    double corner[4];
    int32_t claimed = 0;
    owner_values(tet, origin, corner);
    for (int32_t k = box->low[2]; k <= box->high[2]; k++)
        for (int32_t j = box->low[1]; j <= box->high[1]; j++) {
            const int32_t row = k * BRICK + j, shift = 16 * (row % ROWS_AT_ONCE);
            uint64_t *owned = &brick->owned[row / ROWS_AT_ONCE];
            int32_t first, last;
            owner_find_row(tet, corner, box, j, k, &first, &last);
            uint32_t mask = (uint32_t)ENTRY_MASK << first & (uint32_t)ENTRY_MASK >> (BRICK - 1 - last) &
                            ~(uint32_t)(*owned >> shift);
            mask = find_owned_voxels(parts, element, tet, origin, row, mask & ENTRY_MASK, brick);
            if (!mask) continue;
            *owned |= (uint64_t)mask << shift;
            brick->entry[brick->num_entries[row]++][row] = entry | mask;
            for (; mask; mask &= mask - 1) claimed++;
        }
    return claimed;
}

void pliant_raster_write_masked(const raster_source *source, const part_view *parts, const raster_tet *tets,
                                const int32_t origin[3], const raster_brick *brick, void *out, ptrdiff_t row_step,
                                ptrdiff_t slice_step)
{
    for (int32_t n = 0; n < brick->num_masked; n++) {
        const int32_t voxel = brick->masked[n], i = voxel % BRICK, j = voxel / BRICK % BRICK, k = voxel / BRICK_ROWS;
        double index[3];
        find_index(&tets[brick->masked_by[n]], origin, i, j, k, index);
        const double value = part_sample(source, parts, parts->elements[brick->masked_by[n]], index);
        const ptrdiff_t to = i + j * row_step + k * slice_step;
        switch (source->encoding) {
        case PLIANT_UINT8: ((uint8_t *)out)[to] = (uint8_t)lrint(value); break;
        case PLIANT_INT16: ((int16_t *)out)[to] = (int16_t)lrint(value); break;
        case PLIANT_FLOAT32: ((float *)out)[to] = (float)value; break;
        }
    }
}
