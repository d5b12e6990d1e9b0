/* Construction of meshes, and location of points in them. pliant/mesh.h defines coordinates and numbers. */
#ifndef PLIANT_MESH_MESH_H
#define PLIANT_MESH_MESH_H

#include "base/export.h"
#include "pliant/mesh.h"

#ifdef __cplusplus
extern "C" {
#endif

/* Mesh over the box of a volume (voxel edges, not centres).
 *  @param keep Nullable: (5 * cells) nonzero for lattice tetrahedra to keep. Errors: ARGUMENT, MEMORY. */
pliant_status pliant_mesh_grid(const pliant_geometry *geometry, const int32_t cells[3], const uint8_t *keep,
                               pliant_mesh *out);

/* Adaptive mesh ([C] 4.2, algorithm 1): cubes are split into eight until at least the fraction `purity` of their voxels
 *  is of one material, or `depth` times. Leaves that share a face or an edge differ by at most one level. A leaf with
 *  smaller neighbours is cut from its centre, all others into five tetrahedra. So every inner face belongs to exactly
 *  two tetrahedra. Tetrahedra take the material of their leaf. Tetrahedra of the smallest leaves have their own
 *  material.
 *  @param roots     cells along each axis before any is split
 *  @param keep_air  keep leaves and tetrahedra without tissue
 *  @param hexahedra leaves with tissue are whole
 *  @param materials out, (num_tets), freed with pliant_free
 *  Errors: ARGUMENT, SCENE (no tissue, too many cells), MEMORY. */
pliant_status pliant_mesh_octree(const pliant_geometry *geometry, const int32_t roots[3], int32_t depth, double purity,
                                 bool keep_air, bool hexahedra, const uint8_t *material_of_voxel,
                                 const pliant_material_table *table, pliant_mesh *out, pliant_tet_material **materials);

/* Position of a node relative to the fixed tissue. */
typedef enum pliant_bone_side { PLIANT_BONE_OUTSIDE, PLIANT_BONE_INSIDE, PLIANT_BONE_SURFACE } pliant_bone_side;
/* Minimum quality of a tetrahedron with a moved node, in a lattice of cubes. The quality is its volume divided by the
 *  volume of a regular tetrahedron with the same root mean square edge. Unmoved tetrahedra have 1 and 0.77. */
#define PLIANT_BONE_QUALITY 0.25

/* Move nodes near the surface of fixed voxels (bone) onto it ([H] 4.2). The box and the tetrahedra's connections are
 *  kept. Write rest, num_moved and place_of_node.
 *  @param fixed_voxel (voxels) 1: does not move. Errors: MEMORY, FORMAT. */
pliant_status pliant_mesh_bone(const pliant_geometry *geometry, const uint8_t *fixed_voxel, pliant_mesh *mesh);

/* Recompute the materials of tetrahedra with a node on the surface. Every voxel counts in the tetrahedron that contains
 *  its centre.
 *  @param leave_out_fixed fixed voxels do not count if a corner of the tetrahedron lies outside the fixed region,
 *                         because a sliver of bone would stiffen the whole tetrahedron
 *  @param out (num_tets), others stay. Errors: MEMORY. */
pliant_status pliant_mesh_integrate_moved(const pliant_mesh *mesh, const pliant_geometry *geometry,
                                                     const uint8_t *material_of_voxel, bool leave_out_fixed,
                                                     const pliant_material_table *table, pliant_tet_material *out);

void pliant_mesh_free(pliant_mesh *mesh);

/* The four lattice corners (0 or 1 along each axis, bit d) of a slot, before orientation. */
PLIANT_INTERNAL void pliant_mesh_slot_corners(int parity, int slot, int corners[4]);

/* Slot of the tetrahedron that owns a point of a cell, from its coordinates in [0, 1] and the parity of the cell
 *  ((a + b + c) & 1). Ties go to the central one. */
PLIANT_INTERNAL int pliant_mesh_slot_of(int parity, const double local[3]);

/* Return the lattice tetrahedron of a coarse grid of `cells` that contains lattice tetrahedron `lattice_tet` of the
 *  grid refined by `ratio` along each axis. */
int32_t pliant_lattice_coarse_of(const int32_t cells[3], int32_t ratio, int32_t lattice_tet);

/* Return the lattice node of a finer mesh at the position of a node of a coarser mesh whose lattice it refines. */
int32_t pliant_mesh_lattice_in(const pliant_mesh *fine, const pliant_mesh *coarse, int32_t node);

/* Return the node of a finer mesh at the position of a node of a coarser mesh whose lattice it refines; -1: none. */
int32_t pliant_mesh_node_in(const pliant_mesh *fine, const pliant_mesh *coarse, int32_t node);

/* Return the tetrahedron that contains a world point at rest, and its barycentric coordinates; -1: no tissue. */
PLIANT_INTERNAL int32_t pliant_mesh_locate(const pliant_mesh *mesh, const double world[3], double barycentric[4]);

/* Compute the barycentric coordinates of a world point in a tetrahedron at rest, inside it or not. */
void pliant_mesh_barycentric(const pliant_mesh *mesh, int32_t tet, const double world[3], double barycentric[4]);

/* Return the tetrahedron that contains a point of the deformed mesh; among several, the lowest index; -1: none.
 *  @param positions (num_nodes x 3) [m] */
int32_t pliant_mesh_locate_deformed(const pliant_mesh *mesh, const double *positions, const double world[3],
                                               double barycentric[4]);

/* Sum the voxels' materials over every tetrahedron of a lattice ([H] 2.1). Each voxel counts in one tetrahedron.
 *  @param out (5 * cells) by lattice tetrahedron. Errors: MEMORY. */
pliant_status pliant_lattice_integrate(const pliant_geometry *geometry, const int32_t cells[3],
                                       const uint8_t *material_of_voxel, const pliant_material_table *table,
                                       pliant_tet_material *out);

/* Find the lattice tetrahedron that owns each voxel, by its centre. Ties go to the central one, as in
 *  pliant_lattice_integrate.
 *  @param owner (voxels) out. Errors: MEMORY. */
pliant_status pliant_lattice_owners(const pliant_geometry *geometry, const int32_t cells[3], int32_t *owner);

/* Find the tetrahedron across each face, or -1: neighbours[4 * t + c] lies across the face opposite corner c.
 *  Fragments of one lattice tetrahedron may share a face: then it is the first of them.
 *  @param neighbours (num_tets x 4). Errors: MEMORY, FORMAT (two others on one side of a face). */
pliant_status pliant_mesh_neighbours(const pliant_mesh *mesh, int32_t *neighbours);

/* Fix loose pieces. A piece consists of tetrahedra that are joined by faces. It is supported by three fixed nodes that
 *  span a triangle, or by a supported piece; otherwise it is loose. Nodes shared with a supported piece are not fixed.
 *  @param neighbours Nullable: as of pliant_mesh_neighbours, if they are known
 *  @param fixed (num_nodes) in/out
 *  @param loose (num_tets) out, 1: in a loose piece; it should carry no load
 *  @param pieces out, number of loose pieces
 *  @param how   nodes of loose pieces become this in fixed
 *  @param whole fail if the largest piece is loose
 *  Errors: SCENE (the largest piece is loose); MEMORY. */
pliant_status pliant_mesh_fix_loose_pieces(const pliant_mesh *mesh, const int32_t *neighbours, uint8_t how, bool whole,
                                           uint8_t *fixed, uint8_t *loose, int32_t *pieces);

/* Find the outer faces, oriented outwards.
 * @param neighbours Nullable: as of pliant_mesh_neighbours, if they are known
 * @param inside (num_tets) tetrahedra that the surface encloses; NULL: all
 * @param triangles out: (count x 3), freed with pliant_free
 * Errors: MEMORY, FORMAT. */
pliant_status pliant_mesh_surface(const pliant_mesh *mesh, const int32_t *neighbours, const uint8_t *inside,
                                  int32_t **triangles, int32_t *count);

/* Return the signed volume of a tetrahedron [m^3], and the gradients of its shape functions (4 x 3) [1/m]. */
PLIANT_INTERNAL double pliant_tet_gradients(const double *x0, const double *x1, const double *x2, const double *x3,
                                            double gradients[12]);

/* The same for a tetrahedron of a mesh at rest. */
double pliant_mesh_gradients(const pliant_mesh *mesh, int32_t tet, double gradients[12]);

/* Return the material of a single voxel. */
void pliant_material_of_voxel(const pliant_material_table *table, uint8_t material, pliant_tet_material *out);

#ifdef __cplusplus
}
#endif
#endif
