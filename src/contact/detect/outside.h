/* Where tissue ends within the mesh, whose outside lies up to a cube away from it and hardly holds anything: what touches is to meet the tissue.
 *
 * The surface that touches is that of tetrahedra which tissue fills at least half (and, where it fills none around, of those that it fills less); its corners
 * are moved along the surface's normal to where the voxels' tissue ends, no further than a cube,
 * unless the elements around are full or empty. There they are points of a tetrahedron, and go with it; a
 * contact found there pushes at that one's nodes. Where the surface would so go through itself at rest, and touches itself, its corners stay nearer to
 * their nodes. */
#ifndef PLIANT_CONTACT_OUTSIDE_H
#define PLIANT_CONTACT_OUTSIDE_H

#include "contact/contact.h"
#include "pliant/material.h"
#include "pliant/scan.h"

#ifdef __cplusplus
extern "C" {
#endif

/* Of the body at load and its voxels. */
typedef struct pliant_outside_voxels {
    const pliant_body *load;
    const pliant_geometry *geometry;
    const uint8_t *material_of_voxel;
    const pliant_material_table *materials;
    bool touches_itself;       /* tissue touches tissue */
    int threads;
} pliant_outside_voxels;

/* All zero: of no body. */
typedef struct pliant_outside {
    uint64_t revision;         /* of the body; 0: none */
    int32_t *tet_at_load;      /* (nodes at load) that a corner of the surface is in; -1: the node itself */
    double (*share)[4];        /* (nodes at load) where in it, barycentric */
    uint8_t *solid_at_load;    /* (tetrahedra at load) of the inside of the surface */
    uint8_t *solid;            /* (tetrahedra) likewise */
    int32_t *tet;              /* (nodes) as tet_at_load */
    pliant_body view;          /* the body with the triangles of that surface */
    int32_t *triangles;
    double *positions;         /* (nodes x 3) of the step; of corners of the surface where those are [m] */
} pliant_outside;

void pliant_outside_free(pliant_outside *outside); /* what it holds */
/* Another body, unless it is this one. Errors: MEMORY. */
pliant_status pliant_outside_set_body(pliant_outside *outside, const pliant_outside_voxels *voxels, const pliant_body *body);
/* Where the corner of a node of the surface is. @param positions of nodes [m] */
void pliant_outside_corner(const pliant_outside *outside, int32_t node, const double *positions, double out[3]);
/* outside->positions, from those of nodes */
void pliant_outside_place(pliant_outside *outside, const double *positions);
/* Points that were found there: weights of corners become those of nodes. */
void pliant_outside_spread(const pliant_outside *outside, pliant_contacts *contacts);

#ifdef __cplusplus
}
#endif
#endif
