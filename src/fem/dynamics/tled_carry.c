/* Copies the state of explicit dynamics to the nodes and elements after a cut (tled_conserve.c conserves momentum and
 * energy). */
#include "fem/dynamics/tled_cubes.h"

#include <math.h>
#include <string.h>

/* Return the lane of the element that contains a tetrahedron. */
static int32_t place_of(const pliant_tled_system *system, int32_t tet)
{
    return system->cubes ? system->cubes->element_of_tet[tet] : tet;
}
static float shear_at(const pliant_tled_system *system, int32_t place)
{
    const int32_t block = place / LANES - system->num_blocks;
    return block < 0 ? system->moduli[place / LANES][0][place % LANES] : system->cubes->moduli[block][0][place % LANES];
}

void pliant_tled_carry(pliant_tled *tled, const pliant_tled *from, const pliant_body_map *map)
{
    const pliant_tled_system *system = tled->system;
    tled->tolerance = from->tolerance;
    tled->halvings = from->halvings;
    if (system->quasi_static) {
        tled->substeps = from->substeps;
    } else {
        tled->substeps <<= tled->halvings;
        tled->time_step = ldexp(tled->time_step, -tled->halvings);
    }
    memcpy(tled->target, from->target, sizeof tled->target);
    memcpy(tled->previous_point, from->previous_point, sizeof tled->previous_point);
    memcpy(tled->previous_target, from->previous_target, sizeof tled->previous_target);
    tled->previous_time_step = from->previous_time_step;
    tled->contact_energy = from->contact_energy;
    tled->tool_work = from->tool_work;
    /* Increments belong to one sub-step; relaxation has no velocity. */
    const double faster = tled->time_step / from->time_step;
    pliant_body_map_vectors(map, from->u, tled->u);
    pliant_body_map_vectors(map, from->d, tled->d);
    for (int32_t n = 0; n < system->mesh->num_nodes; n++) {
        const bool moves = tled->inverse_mass[n] > 0 && !system->quasi_static;
        for (int d = 0; d < 3; d++) tled->d[3 * n + d] *= moves ? faster : 0;
    }
    for (int32_t t = 0; tled->memory && t < system->mesh->num_tets; t++) {
        int32_t to = place_of(system, t), source = place_of(from->system, map->tet[t]);
        /* A fragment gets the part that its stiffness has. */
        const float now = shear_at(system, to), was = shear_at(from->system, source),
                    ratio = now == was || !(was > 0) ? 1 : now / was;
        for (int m = 0; m < 6 * PLIANT_PRONY_TERMS; m++)
            tled->memory[to / LANES][m][to % LANES] = ratio * from->memory[source / LANES][m][source % LANES];
    }
}
