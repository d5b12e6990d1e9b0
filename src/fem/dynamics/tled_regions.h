/* The parts of a body that a cut can change in explicit dynamics (tled_conserve.c). */
#ifndef PLIANT_FEM_DYNAMICS_TLED_REGIONS_H
#define PLIANT_FEM_DYNAMICS_TLED_REGIONS_H

#include "fem/dynamics/tled_cubes.h"

#ifdef __cplusplus
extern "C" {
#endif

/* One side of the cut: before or after it. */
typedef struct pliant_cut_side {
    const pliant_tled *tled;
    const pliant_tet_material *material;
} pliant_cut_side;

typedef struct pliant_cut_regions {
    pliant_cut_side was, now;
    pliant_tled *tled;                  /* the state after the cut */
    uint8_t *cell;                      /* (cells) touched by the cut */
    uint8_t *near;                      /* (nodes after the cut) nonzero: adjacent to a touched cell */
    int32_t *part; /* (nodes after the cut) first node of its region, -1: in no region. Later the region's number */
    int32_t *component;                 /* (nodes after the cut) first node of the component before the cut */
    int32_t count;
    int32_t *node_start, *node;         /* (count + 1), nodes of each region, ascending */
    int32_t *element_start, *element;   /* (count + 1), elements after the cut with a node in the region */
    uint8_t *free;                      /* (count) nonzero: a component without fixed nodes */
    double *gained;                     /* (count) strain energy that the cut added [J] */
    double *scale;                      /* (count) strain energy before [J] */
    double *force, *step; /* (nodes after the cut x 3) elastic forces [N], and forces divided by masses [m/s^2] */
} pliant_cut_regions;

/* Find the regions. The caller sets was, now and tled. Errors: MEMORY; pliant_cut_regions_free frees partial
 * results. */
pliant_status pliant_cut_regions_find(pliant_cut_regions *work, const pliant_body *before, const pliant_body *body);
void pliant_cut_regions_free(pliant_cut_regions *work);
/* Join all sets of nodes that share an element of the system. part: union-find array; -1: in no set. */
void pliant_cut_join_elements(int32_t *part, const pliant_tled_system *system);

static inline bool pliant_cut_node_is_free(const pliant_tled *tled, int32_t node)
{
    return node < tled->system->mesh->num_nodes && tled->inverse_mass[node] > 0;
}

#ifdef __cplusplus
}
#endif

#endif
