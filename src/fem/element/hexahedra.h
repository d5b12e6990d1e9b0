/* Whole cubes of a lattice, and parts that cuts leave of them, which are hexahedra (hexahedra.c): for explicit
 * dynamics, and for coarse cubes that are made of them. */
#ifndef PLIANT_FEM_ELEMENT_HEXAHEDRA_H
#define PLIANT_FEM_ELEMENT_HEXAHEDRA_H

#include "fem/system.h"

#ifdef __cplusplus
extern "C" {
#endif

/* nodes by the bits of their corners, and tetrahedra by slot; part: these are fragments, what is left of the cube on
 * one side of a cut */
typedef struct pliant_cube {
    int32_t tet[5], node[8];
    bool part;
} pliant_cube;

/* The cube that a tetrahedron at load is of, where its five still meet at eight nodes: false elsewhere. */
bool pliant_cube_of(const pliant_mesh *mesh, int32_t tet, pliant_cube *out);

/* What K of a cube of one shape is made of: of every slot the integrals of 2 e : e - 2/3 div^2 and of the square of the
 * change of volume, over the displacements of the corners and the incompatible modes; its volume; b, the mean of the
 * gradients. load: of every slot the integrals of the shape functions */
enum { PLIANT_CUBE_MODES = 33 };
typedef struct pliant_cube_shape {
    double deviatoric[5][PLIANT_CUBE_MODES * PLIANT_CUBE_MODES], dilation[5][PLIANT_CUBE_MODES * PLIANT_CUBE_MODES];
    double volume[5], mean[24], load[5][8];
} pliant_cube_shape;

/* ---- hexahedra_cells.c */
/* The tetrahedra of a lattice by cell, and room for the cubes of one. */
typedef struct pliant_cell_lists {
    const pliant_mesh *mesh;
    int32_t cells, *first, *count; /* (cells) the first tetrahedron, -1: none; how many */
    int32_t *next;                 /* (num_tets) the next one of the same cell, -1: none */
    pliant_cube *cube;
} pliant_cell_lists;
/* Of these tetrahedra, ascending; among NULL: of the first ones. Errors: MEMORY; what was made is the caller's to
 * free. */
pliant_status pliant_cell_lists_make(const pliant_mesh *mesh, const int32_t *among, int32_t tets, pliant_cell_lists *out);
void pliant_cell_lists_free(pliant_cell_lists *lists);
/* A cell's whole cube, or parts: lists->cube. Returns how many. */
int32_t pliant_cubes_of_cell(const pliant_cell_lists *lists, int32_t cell);
/* which of these a tetrahedron of the same cell is in, or -1 */
int32_t pliant_cube_among(const pliant_cell_lists *lists, int32_t count, int32_t tet);

/* Cubes whose five tetrahedra meet at eight nodes, and such parts of cubes, ascending: *out (*count). boxes: only those
 * that no moved node bends. Errors: MEMORY. */
pliant_status pliant_cubes_find(const pliant_mesh *mesh, bool boxes, pliant_cube **out, int32_t *count);
/* Likewise among these tetrahedra, ascending, which are all of their cubes'. Errors: MEMORY. */
pliant_status pliant_cubes_find_among(const pliant_mesh *mesh, const int32_t *tet, int32_t tets, pliant_cube **out, int32_t *count);
/* Leaves of an octree with five tetrahedra that meet at eight nodes, so none in the middle of an edge or face, and that
 * no moved node bends; size: (*count) edge in smallest cells. Errors: MEMORY. */
pliant_status pliant_octree_cubes_find(const pliant_mesh *mesh, pliant_cube **out, int32_t **size, int32_t *count);
/* The corners of every leaf that the quasi-static solver has as a hexahedron, -1 of others: *out (num_leaves). Errors:
 * MEMORY. */
pliant_status pliant_octree_corners_find(const pliant_mesh *mesh, int32_t (**out)[8]);
/* whether no moved node bends one whose edge is so many cells */
bool pliant_cube_is_box(const pliant_mesh *mesh, const pliant_cube *cube, int32_t size);
/* parity: of its cell */
void pliant_cube_integrate(const pliant_mesh *mesh, const pliant_cube *cube, int parity, pliant_cube_shape *out);
/* Gradients of the eight shape functions at a point of the cube [0, 1]^3, x its corners; returns the determinant of the
 * map. */
double pliant_cube_gradients(double x[8][3], const double at[3], double gradient[8][3]);
/* K without its change of volume: out (24 x 24). Returns k, of which K has k b b' more. */
double pliant_cube_deviatoric(const pliant_cube_shape *shape, const pliant_cube *cube, const pliant_tet_material *material, double *out);
/* For count elements with so many corners in all. Errors: MEMORY. */
pliant_status pliant_macros_allocate(pliant_macros *macros, size_t count, size_t corners);
/* Room for as many, with whatever was there: none yet, and who adds one writes all of it. Errors: MEMORY. */
pliant_status pliant_macros_room(pliant_macros *macros, size_t count, size_t corners);
/* The blocks of lanes that they take: for forces of four corners a lane, and a rotation a lane. */
int32_t pliant_macros_blocks(size_t count, size_t corners);
/* The stiffness of one of them, (unknowns x unknowns). Errors: MEMORY. */
pliant_status pliant_macros_keep(pliant_macros *macros, int32_t element, int32_t unknowns, const double *stiffness);
/* That of an element of other ones, with as many corners: the same block. */
void pliant_macros_share_root(const pliant_macros *from, int32_t was, pliant_macros *macros, int32_t element);
/* ---- hexahedra_masses.c */
/* Consistent masses: of hexahedra what they weigh at their corners by the shape functions, of other tetrahedra a
 * fourth: mass (num_nodes) [kg]. Errors: MEMORY. */
pliant_status pliant_hexahedra_masses(const pliant_mesh *mesh, const pliant_tet_material *material, double *mass);
/* The same bits, from those before of so many nodes where nothing has changed. kept: (num_tets) tetrahedra that are the
 * same; *mass: out, whatever is returned, Nullable. Errors: MEMORY. */
pliant_status pliant_hexahedra_masses_next(const pliant_mesh *mesh, const pliant_tet_material *material, const double *before, int32_t nodes_before,
                                           const uint8_t *kept, double **mass);
/* The cube of a lattice that a tetrahedron is in, or a fragment of; of an octree its leaf. */
int32_t pliant_cell_of_tet(const pliant_mesh *mesh, int32_t tet);
size_t pliant_count_cells(const pliant_mesh *mesh); /* how many of these there are */
/* A hexahedron: all of it but corners and cell. Errors: MEMORY. */
pliant_status pliant_macros_add_hexahedron(const pliant_tet_material *material, const pliant_cube *cube, const pliant_cube_shape *shape, pliant_macros *macros,
                                           int32_t element);
/* A tetrahedron that is in no hexahedron, likewise. Errors: MEMORY. */
pliant_status pliant_macros_add_tet(const pliant_mesh *mesh, const pliant_tet_material *material, int32_t tet, pliant_macros *macros, int32_t element);
int pliant_cell_parity(const pliant_mesh *mesh, int32_t cell);
/* (num_tets of the mesh) macro-element that each tetrahedron is, or is part of. Errors: MEMORY. */
pliant_status pliant_hexahedra_of_tets(const pliant_mesh *mesh, const pliant_macros *macros, int32_t **out);
/* Moduli of its tetrahedra: what is without tissue keeps a small part of what the others have; not in a part, so that
 * parts have no more than the whole. */
void pliant_cube_moduli(const pliant_cube *cube, const double volume[5], const pliant_tet_material *material, double lambda[5], double mu[5]);

#ifdef __cplusplus
}
#endif

#endif
