/* The parts of a body that a cut in explicit dynamics may change (tled_conserve.c). */
#ifndef PLIANT_FEM_DYNAMICS_TLED_REGIONS_H
#define PLIANT_FEM_DYNAMICS_TLED_REGIONS_H

#include "fem/dynamics/tled_cubes.h"

#ifdef __cplusplus
extern "C" {
#endif

/* one of the two bodies */
typedef struct pliant_cut_side {
    const pliant_tled *tled;
    const pliant_tet_material *material;
} pliant_cut_side;

typedef struct pliant_cut_regions {
    pliant_cut_side was, now;
    pliant_tled *tled;                  /* of now */
    uint8_t *cell;                      /* (cells) touched by the cut */
    uint8_t *near;                      /* (nodes of now) at a touched cell */
    int32_t *part;                      /* (nodes of now) first node of its region, -1: of none. Later the region's number */
    int32_t *component;                 /* (nodes of now) first node of what hung together before the cut */
    int32_t count;
    int32_t *node_start, *node;         /* (count + 1), nodes of each region, ascending */
    int32_t *element_start, *element;   /* (count + 1), elements of now that have a node of it */
    uint8_t *free;                      /* (count) a component without fixed nodes */
    double *gained;                     /* (count) strain energy that the cut added [J] */
    double *scale;                      /* (count) strain energy before [J] */
    double *force, *step;               /* (nodes of now x 3) elastic forces [N], and those over masses [m/s^2] */
} pliant_cut_regions;

/* All but was, now and tled, which are given. Errors: MEMORY; pliant_cut_regions_free frees what there is. */
pliant_status pliant_cut_regions_find(pliant_cut_regions *work, const pliant_body *before, const pliant_body *body);
void pliant_cut_regions_free(pliant_cut_regions *work);
/* Of these parts (union-find; -1: not of any) those become one that an element of the system has nodes of. */
void pliant_cut_join_elements(int32_t *part, const pliant_tled_system *system);

static inline bool pliant_cut_moves(const pliant_tled *tled, int32_t node)
{
    return node < tled->system->mesh->num_nodes && tled->inverse_mass[node] > 0;
}

#ifdef __cplusplus
}
#endif

#endif
