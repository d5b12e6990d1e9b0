/* The fine tetrahedra that belong to one coarse tetrahedron, their nodes and their stiffness, dense. */
#ifndef PLIANT_FEM_COARSE_SUBMESH_H
#define PLIANT_FEM_COARSE_SUBMESH_H

#include "fem/element/hexahedra.h"

#ifdef __cplusplus
extern "C" {
#endif

/* Fine tetrahedra by coarse tetrahedron. */
typedef struct pliant_submesh_lists {
    int32_t *start; /* (coarse.num_tets + 1) */
    int32_t *tets;  /* fine tetrahedra, ascending in each list; an overlapping one is in one list, touching ones in several */
    int32_t largest; /* most tetrahedra in one list */
} pliant_submesh_lists;

/* touch: PLIANT_TOUCH_FACE adds those that share a face with the coarse tetrahedron's own (NUMERICS.md). */
pliant_status pliant_submesh_list(const pliant_mesh *fine, const int32_t *coarse_of_fine, int32_t num_coarse, pliant_touch touch,
                                  pliant_submesh_lists *out);
void pliant_submesh_lists_free(pliant_submesh_lists *lists);

enum { PLIANT_SUBMESH_COLUMNS = 48 };

typedef struct pliant_submesh {
    const pliant_mesh *fine, *coarse;
    const uint8_t *fixed;                /* (fine nodes) */
    const pliant_tet_material *material; /* (fine tetrahedra) */
    /* one thread's room, grown as needed */
    int32_t room, num_nodes, num_tets;   /* room: nodes that the dense arrays have room for */
    int32_t *node;       /* (num_nodes) fine node */
    int32_t *local_of;   /* (fine nodes) or -1 */
    int32_t *slot;       /* (num_nodes) room for a second numbering */
    const int32_t *tets; /* (num_tets) fine tetrahedra */
    /* Nullable: hexahedra of the fine mesh, in place of their tetrahedra; cube_of_tet: (fine tetrahedra) or -1. Who
     * loads a list that holds a part of one alone sets them to NULL before. */
    const pliant_cube *cubes;
    const int32_t *cube_of_tet;
    const pliant_cube_shape *shapes;     /* (2) by parity; of meshes with moved nodes room for one that is made anew */
    double *stiffness;   /* (3 num_nodes x 3 num_nodes) */
    double *work;        /* (3 room x PLIANT_SUBMESH_COLUMNS) */
    double *square;      /* (3 room x 3 room) */
} pliant_submesh;

pliant_status pliant_submesh_create(const pliant_mesh *fine, const pliant_mesh *coarse, const uint8_t *fixed,
                                    const pliant_tet_material *material, int32_t most_tets, pliant_submesh **out);
void pliant_submesh_free(pliant_submesh *submesh);

/* Nodes and stiffness of one coarse tetrahedron's list. Errors: MEMORY. */
pliant_status pliant_submesh_load(pliant_submesh *submesh, int32_t num_tets, const int32_t *tets);
/* The stiffness again, of one material everywhere; NULL: of its own. */
void pliant_submesh_assemble(pliant_submesh *submesh, const pliant_tet_material *everywhere);
/* The node of it, by its number there, at a node of the coarse mesh; -1: none */
int32_t pliant_submesh_corner(const pliant_submesh *submesh, int32_t coarse_node);
/* of a hexahedron of it; room: for a shape of its own */
const pliant_cube_shape *pliant_submesh_shape(const pliant_submesh *submesh, const pliant_cube *cube, pliant_cube_shape *room);
bool pliant_submesh_has_fixed(const pliant_submesh *submesh);

/* ---- condense.c */
/* Schur complement on some of its nodes, [H] 3, and shape functions [H] 6: out (n x n), shape (num_nodes x 3 x n), n =
 * 3 corners, at most 24, by the first n columns of work. Fixed nodes are removed from the problem and their shape
 * functions are zero ([H] 4.2). corner: by their numbers there, or -1. False: one is missing, or what is left falls
 * apart. */
bool pliant_submesh_condense(pliant_submesh *submesh, int corners, const int32_t *corner, double *out, double *shape);
/* The reference that it is calibrated on: Young's modulus 1, the mean Poisson's ratio of its tissue. */
pliant_tet_material pliant_submesh_reference(const pliant_submesh *submesh);
/* Condensed, of its own material and all of this one: out, of_reference (n x n); as above, with twice n columns. */
bool pliant_submesh_condense_both(pliant_submesh *submesh, int corners, const int32_t *corner, const pliant_tet_material *reference, double *out,
                                  double *of_reference);

/* ---- homogenize.c */
/* Its stiffness with a stiff term on its six rigid modes, factored into square: for loads without resultant the answer
 * is that of any six supports. modes: (3 num_nodes x 6) out. False: it falls apart. */
bool pliant_submesh_factor(pliant_submesh *submesh, double *modes);

/* Of a coarse tetrahedron whose list is loaded; grounded: K of its corners with fixed nodes held. *linear: its corners
 * are followed linearly, since it falls apart. Errors: NUMERIC. */
pliant_status pliant_averaged_tet(pliant_submesh *submesh, int32_t tet, bool grounded, double out[144], bool *linear);

/* Condensed on its corners, and the shape functions (num_nodes x 36); a fragment that has none of its corners follows
 * them linearly. Errors: NUMERIC. */
pliant_status pliant_schur_tet(pliant_submesh *submesh, int32_t tet, double out[144], double *shape);

#ifdef __cplusplus
}
#endif

#endif
