/* The fine tetrahedra that belong to one coarse tetrahedron, their nodes and their stiffness, dense. */
#ifndef PLIANT_FEM_COARSE_SUBMESH_H
#define PLIANT_FEM_COARSE_SUBMESH_H

#include "fem/system.h"

#ifdef __cplusplus
extern "C" {
#endif

/* Fine tetrahedra by coarse tetrahedron. */
typedef struct pliant_submesh_lists {
    int32_t *start; /* (coarse.num_tets + 1) */
    int32_t *tets;  /* fine tetrahedra, ascending in each list; an overlapping one is in one list, touching ones in several */
    int32_t largest; /* most tetrahedra in one list */
} pliant_submesh_lists;

/* touch: PLIANT_TOUCH_FACE adds those that share a face with the coarse tetrahedron's own (NUMERICS 1). */
pliant_status pliant_submesh_list(const pliant_mesh *fine, const int32_t *coarse_of_fine, int32_t num_coarse, pliant_touch touch,
                                  pliant_submesh_lists *out);
void pliant_submesh_lists_free(pliant_submesh_lists *lists);

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
    double *stiffness;   /* (3 num_nodes x 3 num_nodes) */
    double *work;        /* (3 room x 32) */
    double *square;      /* (3 room x 3 room) */
} pliant_submesh;

pliant_status pliant_submesh_create(const pliant_mesh *fine, const pliant_mesh *coarse, const uint8_t *fixed,
                                    const pliant_tet_material *material, int32_t most_tets, pliant_submesh **out);
void pliant_submesh_free(pliant_submesh *submesh);

/* Nodes and stiffness of one coarse tetrahedron's list. Errors: MEMORY. */
pliant_status pliant_submesh_load(pliant_submesh *submesh, int32_t num_tets, const int32_t *tets);
/* The stiffness again, of one material everywhere; NULL: of its own. */
void pliant_submesh_assemble(pliant_submesh *submesh, const pliant_tet_material *everywhere);
/* The node of it, by its number there, at a corner of the coarse tetrahedron; -1: none */
int32_t pliant_submesh_corner(const pliant_submesh *submesh, int32_t tet, int corner);
bool pliant_submesh_has_fixed(const pliant_submesh *submesh);

#ifdef __cplusplus
}
#endif

#endif
