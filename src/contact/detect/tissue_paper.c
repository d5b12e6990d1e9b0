/* The rule of [C] 5.2: a force on the four corners of an overlapping tetrahedron opposes their motion. */
#include "contact/detect/tissue.h"

#include "contact/detect/part_contacts.h"
#include "contact/detect/update_sides.h"

#include <string.h>

pliant_status pliant_tissue_overlapping(pliant_tissue *tissue, const double *positions, uint8_t *overlaps)
{
    const pliant_mesh *mesh = &tissue->body->fine;
    const bool searched = pliant_tissue_search_on_device(tissue, positions, NULL);
    pliant_status status = searched ? PLIANT_OK
                                    : pliant_grid_fill(&tissue->grid, tissue->num_tets, tissue->tet, mesh->tets,
                                                       positions, 0, tissue->threads);
    if (status == PLIANT_OK && !searched)
        status = pliant_grid_overlaps(&tissue->grid, mesh->tets, positions, tissue->threads, &tissue->num_overlaps);
    if (status != PLIANT_OK) return status;
    memset(overlaps, 0, (size_t)mesh->num_nodes);
    for (int c = 0; c < PLIANT_GRID_CHUNKS; c++)
        for (int32_t p = 0; p < 2 * tissue->grid.found[c].count; p++)
            for (int v = 0; v < 4; v++) overlaps[mesh->tets[4 * (size_t)tissue->grid.found[c].pair[p] + (size_t)v]] = 1;
    return PLIANT_OK;
}

pliant_status pliant_tissue_find_slowed(const pliant_tissue *tissue, const uint8_t *overlaps, double overlap_damping,
                                        pliant_contacts *out)
{
    const uint8_t *fixed = tissue->body->fine_fixed;
    int32_t count = 0;
    for (int32_t n = 0; n < tissue->body->fine.num_nodes; n++)
        count += overlaps[n] && !(fixed && fixed[n] == PLIANT_FIXED_AT_REST);
    pliant_status status = count > 0 ? pliant_contacts_reserve(out, out->count + count) : PLIANT_OK;
    for (int32_t n = 0; status == PLIANT_OK && n < tissue->body->fine.num_nodes; n++)
        if (overlaps[n] && !(fixed && fixed[n] == PLIANT_FIXED_AT_REST))
            out->point[out->count++] = (pliant_contact_point){
                .feature = (uint64_t)PLIANT_TISSUE_SLOWED << 56 | (uint64_t)n,
                .kind = PLIANT_OBSTACLE_TISSUE,
                .tool = -1,
                .part = -1,
                .count = 1,
                .node = {n},
                .weight = {1},
                .friction = overlap_damping,
            };
    return status;
}
