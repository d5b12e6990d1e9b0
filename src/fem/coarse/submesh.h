/* The submesh of a coarse tetrahedron: its fine tetrahedra, their nodes, and their dense stiffness. */
#ifndef PLIANT_FEM_COARSE_SUBMESH_H
#define PLIANT_FEM_COARSE_SUBMESH_H

#include "fem/element/hexahedra.h"

#ifdef __cplusplus
extern "C" {
#endif

/* Lists of fine tetrahedra, one for each coarse tetrahedron. */
typedef struct pliant_submesh_lists {
    int32_t *start; /* (coarse.num_tets + 1) */
    /* Fine tetrahedra, ascending in each list. An overlapping tetrahedron is in one list, a touching one in several
     * lists. */
    int32_t *tets;
    int32_t largest; /* length of the longest list */
} pliant_submesh_lists;

/* List the fine tetrahedra. extent: PLIANT_SUBMESH_FACE adds tetrahedra that share a face with a listed one
 * (NUMERICS.md). */
pliant_status pliant_submesh_list(const pliant_mesh *fine, const int32_t *coarse_of_fine, int32_t num_coarse,
                                  pliant_submesh_extent extent, pliant_submesh_lists *out);
void pliant_submesh_lists_free(pliant_submesh_lists *lists);

enum { PLIANT_SUBMESH_COLUMNS = 48 };

typedef struct pliant_submesh {
    const pliant_mesh *fine, *coarse;
    const uint8_t *fixed;                /* (fine nodes) */
    const pliant_tet_material *material; /* (fine tetrahedra) */
    /* Work arrays of one thread, which grow as needed. */
    int32_t capacity, num_nodes, num_tets; /* `capacity`: of the dense arrays, in nodes */
    int32_t *node;                         /* (num_nodes) fine node */
    int32_t *local_of;                     /* (fine nodes) or -1 */
    int32_t *slot;                         /* (num_nodes) work array for a second numbering */
    const int32_t *tets;                   /* (num_tets) fine tetrahedra */
    /* Nullable: hexahedra of the fine mesh, which replace their tetrahedra. cube_of_tet: (fine tetrahedra) or -1. A
     * list that contains only a part of a hexahedron needs NULL here. */
    const pliant_cube *cubes;
    const int32_t *cube_of_tet;
    /* (2) by parity of the cell. For meshes with moved nodes: memory for one shape, computed for each hexahedron. */
    const pliant_cube_shape *shapes;
    double *stiffness;   /* (3 num_nodes x 3 num_nodes) */
    double *work;        /* (3 `capacity` x PLIANT_SUBMESH_COLUMNS) work array */
    double *square;      /* (3 `capacity` x 3 `capacity`) work array */
} pliant_submesh;

pliant_status pliant_submesh_create(const pliant_mesh *fine, const pliant_mesh *coarse, const uint8_t *fixed,
                                    const pliant_tet_material *material, int32_t max_tets, pliant_submesh **out);
void pliant_submesh_free(pliant_submesh *submesh);

/* Load nodes and stiffness of one coarse tetrahedron's list. Errors: MEMORY. */
pliant_status pliant_submesh_load(pliant_submesh *submesh, int32_t num_tets, const int32_t *tets);
/* Return the submesh number of the node at a coarse node; -1 if the submesh has no node there. */
int32_t pliant_submesh_corner(const pliant_submesh *submesh, int32_t coarse_node);
/* Return the shape of a hexahedron of the submesh. `buffer`: memory for the shape of a moved hexahedron. */
const pliant_cube_shape *pliant_submesh_shape(const pliant_submesh *submesh, const pliant_cube *cube,
                                              pliant_cube_shape *buffer);
bool pliant_submesh_has_fixed(const pliant_submesh *submesh);

/* ---- Implemented in condense.c. */
/* Compute the Schur complement on some corners ([H] 3) and the shape functions ([H] 6), with the first n columns of
 * work. Fixed nodes are removed from the problem, and their shape functions are zero ([H] 4.2).
 * @param corners  Number of corners; n = 3 corners, at most 24.
 * @param corner   (corners) node numbers in the submesh, or -1.
 * @param out      (n x n) [N/m].
 * @param shape    (num_nodes x 3 x n).
 * @return False if a corner is missing, or if the remaining submesh is disconnected. */
bool pliant_submesh_condense(pliant_submesh *submesh, int corners, const int32_t *corner, double *out, double *shape);

/* ---- Implemented in homogenize.c. */
/* Factor the stiffness, with a stiff term on its six rigid modes, into square. For loads without resultant the solution
 * is the same as with any six supports. modes: (3 num_nodes x 6) out. Return false if the submesh is disconnected. */
bool pliant_submesh_factor(pliant_submesh *submesh, double *modes);

/* Compute the averaged stiffness of a coarse tetrahedron whose list is loaded.
 * @param grounded  Compute K of the corners with fixed nodes held.
 * @param linear    Out: the submesh is disconnected, so nodes follow the corners linearly.
 * Errors: NUMERIC. */
pliant_status pliant_averaged_tet(pliant_submesh *submesh, int32_t tet, bool grounded, double out[144], bool *linear);

/* Condense the stiffness on the corners and compute the shape functions (num_nodes x 36). A fragment without corners
 * follows them linearly. Errors: NUMERIC. */
pliant_status pliant_schur_tet(pliant_submesh *submesh, int32_t tet, double out[144], double *shape);

#ifdef __cplusplus
}
#endif

#endif
