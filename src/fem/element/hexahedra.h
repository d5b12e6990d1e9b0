/* Hexahedra on complete lattice cubes, and on fragments of cubes after a cut (hexahedra.c). Explicit dynamics uses
 * them, and coarse cubes are built from them. */
#ifndef PLIANT_FEM_ELEMENT_HEXAHEDRA_H
#define PLIANT_FEM_ELEMENT_HEXAHEDRA_H

#include "fem/system.h"

#ifdef __cplusplus
extern "C" {
#endif

/* A hexahedron: nodes by the bits of their corners, tetrahedra by slot. part: the tetrahedra are fragments of the cube
 * on one side of a cut. */
typedef struct pliant_cube {
    int32_t tet[5], node[8];
    bool part;
} pliant_cube;

/* Find the cube of a tetrahedron at load time. Return false if its five tetrahedra do not meet at eight nodes. */
bool pliant_cube_of(const pliant_mesh *mesh, int32_t tet, pliant_cube *out);

/* Integrals from which K of a cube of one shape is assembled. `deviatoric` and `dilation` hold, for every slot, the
 * integrals of 2 e : e - 2/3 div^2 and of the squared change of volume. They act on the corner displacements and the
 * incompatible modes. `mean` is b, the mean of the gradients. `load` holds, for every slot, the integrals of the shape
 * functions. */
enum { PLIANT_CUBE_MODES = 33 };
typedef struct pliant_cube_shape {
    double deviatoric[5][PLIANT_CUBE_MODES * PLIANT_CUBE_MODES], dilation[5][PLIANT_CUBE_MODES * PLIANT_CUBE_MODES];
    double volume[5], mean[24], load[5][8];
} pliant_cube_shape;

/* ---- Implemented in hexahedra_cells.c. */
/* The tetrahedra of a lattice by cell, and memory for the cubes of one cell. */
typedef struct pliant_cell_lists {
    const pliant_mesh *mesh;
    int32_t cells, *first, *count; /* (cells) first tetrahedron, -1: none; number of tetrahedra */
    int32_t *next;                 /* (num_tets) next tetrahedron of the same cell, -1: none */
    pliant_cube *cube;
} pliant_cell_lists;
/* List these tetrahedra, in ascending order. among NULL: the first `tets` tetrahedra. Errors: MEMORY; the caller then
 * frees the partial result. */
pliant_status pliant_cell_lists_make(const pliant_mesh *mesh, const int32_t *among, int32_t tets,
                                     pliant_cell_lists *out);
void pliant_cell_lists_free(pliant_cell_lists *lists);
/* Find the complete cube of a cell, or its parts, in lists->cube. Return their number. */
int32_t pliant_cubes_of_cell(const pliant_cell_lists *lists, int32_t cell);
/* Return the index of the cube that contains a tetrahedron of the same cell, or -1. */
int32_t pliant_cube_among(const pliant_cell_lists *lists, int32_t count, int32_t tet);

/* Find all cubes whose five tetrahedra meet at eight nodes, and all such parts of cubes, in ascending order. boxes:
 * skip cubes with moved nodes. Errors: MEMORY. */
pliant_status pliant_cubes_find(const pliant_mesh *mesh, bool boxes, pliant_cube **out, int32_t *count);
/* Find the same among these tetrahedra. The list is ascending and contains complete cubes. Errors: MEMORY. */
pliant_status pliant_cubes_find_among(const pliant_mesh *mesh, const int32_t *tet, int32_t tets, pliant_cube **out,
                                      int32_t *count);
/* Find the octree leaves with five tetrahedra that meet at eight nodes, without moved nodes. Such leaves have no node
 * in the middle of an edge or face. size: (*count) edge length in smallest cells. Errors: MEMORY. */
pliant_status pliant_octree_cubes_find(const pliant_mesh *mesh, pliant_cube **out, int32_t **size, int32_t *count);
/* Find the corners of every leaf that is a hexahedron in the quasi-static solver; -1 for other leaves. *out:
 * (num_leaves). Errors: MEMORY. */
pliant_status pliant_octree_corners_find(const pliant_mesh *mesh, int32_t (**out)[8]);
/* Return whether a cube has no moved nodes. size: edge length in cells. */
bool pliant_cube_is_box(const pliant_mesh *mesh, const pliant_cube *cube, int32_t size);
/* Compute the integrals of a cube. parity: of its cell. */
void pliant_cube_integrate(const pliant_mesh *mesh, const pliant_cube *cube, int parity, pliant_cube_shape *out);
/* Compute the gradients of the eight shape functions at a point of the cube [0, 1]^3. x: its corners. Return the
 * determinant of the map. */
double pliant_cube_gradients(double x[8][3], const double at[3], double gradient[8][3]);
/* Compute K without its resistance to a mean change of volume: out (24 x 24). Return k; the complete K is
 * out + (k + missing_lambda x volume) b b'.
 * @param missing_lambda  Lambda in addition to the materials'; only a pressure resists its mean change of volume
 *                        (pressures.h) [Pa]. */
double pliant_cube_deviatoric(const pliant_cube_shape *shape, const pliant_cube *cube,
                              const pliant_tet_material *material, double missing_lambda, double *out);
/* Return the mean lambda that materials lack [Pa]. complete: (num_tets) with all of it; NULL: 0. */
double pliant_cube_missing_lambda(const pliant_cube *cube, const double volume[5],
                                  const pliant_tet_material *material, const pliant_tet_material *complete);
/* Compute the moduli of a neo-Hookean cube; zero if it only fills empty space. volume: of its tetrahedra [m^3]. */
void pliant_cube_law(const pliant_cube *cube, const double volume[5], const pliant_tet_material *material,
                     pliant_macro_law *out);
/* Allocate macro-elements. count: elements; corners: total number of corners. Errors: MEMORY. */
pliant_status pliant_macros_allocate(pliant_macros *macros, size_t count, size_t corners);
/* Allocate the same without initializing the memory. The count is zero, and a function that adds an element writes all
 * its data. Errors: MEMORY. */
pliant_status pliant_macros_reserve_entries(pliant_macros *macros, size_t count, size_t corners);
/* Allocate the law of the elements, which the functions that add elements then fill. Errors: MEMORY. */
pliant_status pliant_macros_allocate_law(pliant_macros *macros, pliant_elasticity law);
/* Return the number of lane blocks that hold the elements' forces (four corners per lane) and rotations (one per
 * lane). */
int32_t pliant_macros_blocks(size_t count, size_t corners);
/* Store the stiffness of an element, (unknowns x unknowns), as its root. Errors: MEMORY. */
pliant_status pliant_macros_keep(pliant_macros *macros, int32_t element, int32_t unknowns, const double *stiffness);
/* Share the root of another system's element with the same number of corners. */
void pliant_macros_share_root(const pliant_macros *from, int32_t was, pliant_macros *macros, int32_t element);
/* ---- Implemented in hexahedra_masses.c. */
/* Compute consistent masses: mass (num_nodes) [kg]. A hexahedron contributes by its shape functions, other tetrahedra
 * contribute a fourth of their mass per corner. Errors: MEMORY. */
pliant_status pliant_hexahedra_masses(const pliant_mesh *mesh, const pliant_tet_material *material, double *mass);
/* Compute bitwise identical masses after a cut, reusing the values of unchanged nodes.
 * @param before        (nodes_before) masses before the cut [kg].
 * @param kept          (num_tets) nonzero: the tetrahedron is unchanged.
 * @param mass          Out: set also after an error; may be NULL then.
 * Errors: MEMORY. */
pliant_status pliant_hexahedra_masses_next(const pliant_mesh *mesh, const pliant_tet_material *material,
                                           const double *before, int32_t nodes_before, const uint8_t *kept,
                                           double **mass);
/* Return the lattice cube of a tetrahedron or fragment, or its octree leaf. */
int32_t pliant_cell_of_tet(const pliant_mesh *mesh, int32_t tet);
size_t pliant_count_cells(const pliant_mesh *mesh); /* number of such cubes or leaves */
/* Add a hexahedron; the caller sets its corners and cell. complete: Nullable, as in pliant_system_build_hexahedra.
 * Errors: MEMORY. */
pliant_status pliant_macros_add_hexahedron(const pliant_tet_material *material, const pliant_tet_material *complete,
                                           const pliant_cube *cube, const pliant_cube_shape *shape,
                                           pliant_macros *macros, int32_t element);
/* Add a tetrahedron that is in no hexahedron, likewise. Errors: MEMORY. */
pliant_status pliant_macros_add_tet(const pliant_mesh *mesh, const pliant_tet_material *material, int32_t tet,
                                    pliant_macros *macros, int32_t element);
int pliant_cell_parity(const pliant_mesh *mesh, int32_t cell);
/* Find the macro-element of each tetrahedron: (num_tets of the mesh). Errors: MEMORY. */
pliant_status pliant_hexahedra_of_tets(const pliant_mesh *mesh, const pliant_macros *macros, int32_t **out);
/* Compute the moduli of a cube's tetrahedra. Tetrahedra without tissue get a small fraction of the others' stiffness.
 * In a part they get none, so that the parts together are not stiffer than the whole cube. */
void pliant_cube_moduli(const pliant_cube *cube, const double volume[5], const pliant_tet_material *material,
                        double lambda[5], double mu[5]);

#ifdef __cplusplus
}
#endif

#endif
