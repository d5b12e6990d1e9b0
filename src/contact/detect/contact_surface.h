/* The tissue's boundary within the mesh. The mesh ends up to one cube outside the tissue, and its outermost layer
 * carries almost no load. Contact must happen at the tissue's boundary instead.
 *
 * The contact surface encloses the tetrahedra that are filled with tissue by at least half. Where no such
 * tetrahedron is near, it encloses also those with less tissue. The surface's corners are moved along its normal to
 * the boundary of the tissue in the voxels, by at most one cube. Corners between full or empty elements are not
 * moved. A moved corner is a point of a tetrahedron: it moves with it, and contact forces act on that tetrahedron's
 * nodes. With hexahedra, emptier cubes than min_cube_tissue carry no moved corner if the node has a fuller cube.
 * Contact forces would distort them so much that the equilibrium depends on the path. Their corners belong to a
 * tetrahedron of a fuller cube instead, and follow it by linear extrapolation. With contact of tissue on tissue,
 * corners are moved less where the surface would intersect itself at rest. */
#ifndef PLIANT_CONTACT_CONTACT_SURFACE_H
#define PLIANT_CONTACT_CONTACT_SURFACE_H

#include "contact/contact.h"
#include "pliant/material.h"
#include "pliant/scan.h"

#ifdef __cplusplus
extern "C" {
#endif

/* Voxels and the topology at load. */
typedef struct pliant_contact_surface_voxels {
    const pliant_body *load;
    const pliant_geometry *geometry;
    const uint8_t *material_of_voxel;
    const pliant_material_table *materials;
    double min_cube_tissue; /* with hexahedra: the setting of this name (contact/settings.h); otherwise 0 */
    bool has_self_contact;  /* there is contact of tissue on tissue */
    int threads;
} pliant_contact_surface_voxels;

/* All zero: without a topology. */
typedef struct pliant_contact_surface {
    uint64_t revision;      /* of the topology; 0: none */
    int32_t *tet_at_load;   /* (nodes at load) tetrahedron that contains the corner; -1: the corner is the node */
    double (*weights)[4];   /* (nodes at load) barycentric coordinates in it, also from outside */
    uint8_t *solid_at_load; /* (tetrahedra at load) whether the contact surface encloses it */
    uint8_t *solid;         /* (tetrahedra) as solid_at_load */
    int32_t *tet;           /* (nodes) as tet_at_load */
    pliant_body view;       /* the topology with the triangles of the contact surface */
    int32_t *triangles;
    double *positions; /* (nodes x 3) positions; for nodes of the surface, of their corners [m] */
} pliant_contact_surface;

void pliant_contact_surface_free(pliant_contact_surface *surface); /* frees its contents */
/* Set the topology. Do nothing if it is the current one. Errors: MEMORY. */
pliant_status pliant_contact_surface_set_body(pliant_contact_surface *surface,
                                              const pliant_contact_surface_voxels *voxels, const pliant_body *body);
/* Compute the position of a surface node's corner. surface: Nullable: it is the node. positions: (nodes x 3) [m] */
void pliant_contact_surface_corner(const pliant_contact_surface *surface, int32_t node, const double *positions,
                                   double out[3]);
/* Find the nodes that move a surface node's corner, and their weights. Return their number, 1 or 4. */
int pliant_contact_surface_support(const pliant_contact_surface *surface, int32_t node, int32_t support[4],
                                   double weights[4]);
/* Compute the positions of the corners of some nodes, from the positions of all nodes.
 * @param surface Nullable: the corners are the nodes
 * @param nodes Nullable: (count); NULL: the first ones
 * @param positions, out (nodes x 3) [m] */
void pliant_contact_surface_corners(const pliant_contact_surface *surface, int32_t count, const int32_t *nodes,
                                    const double *positions, int num_threads, double *out);
/* Replace the weights of corners by weights of nodes in contact points. */
void pliant_contact_surface_map_weights(const pliant_contact_surface *surface, pliant_contacts *contacts);

#ifdef __cplusplus
}
#endif
#endif
