/* Coarse cubes and the fine mesh in them: what correctors and macro-elements of lod (lod.h) are made from. */
#ifndef PLIANT_FEM_COARSE_LOD_CUBES_H
#define PLIANT_FEM_COARSE_LOD_CUBES_H

#include "fem/system.h"

#ifdef __cplusplus
extern "C" {
#endif

/* of one cube; values are zero on all other nodes */
typedef struct lod_corrector {
    int32_t count;
    int32_t *node;  /* (count) fine nodes, ascending */
    float *value;   /* (count x 3 x 24) by corner of the cube (bit d: along axis d), absent ones zero */
} lod_corrector;

typedef struct lod_builder {
    pliant_system *system;               /* being made; has mesh, fine, num_threads, and upsample: P */
    const uint8_t *fine_fixed, *coarse_fixed;
    const pliant_tet_material *material; /* (fine tetrahedra) */
    int32_t layers, ratio;
    /* cubes with tissue, in the order of the lattice */
    int32_t count;
    int32_t *cell;         /* (count) */
    int32_t *cube_of_cell; /* (coarse cells) or -1 */
    int32_t *element_start, *elements; /* (count + 1): of the fine mesh's, those in each */
    int32_t *own;          /* (count x 8) nodes of its coarse tetrahedra, by corner, or -1 */
    uint8_t *grounded;     /* (count) */
    int32_t *patch_nodes, *patch_means; /* (count) size of the corrector's problem: free fine nodes, constrained coarse ones */
    /* the fine mesh */
    pliant_system whole;   /* its elements, free nodes, pattern */
    pliant_tangent *at_rest; /* (whole.num_blocks) */
    double *bulk;          /* Nullable: (elements of whole) volume times what of the bulk modulus is left out of it [N m] (lod.h) */
    double *values;        /* its matrix at rest, by whole.pattern */
    double *mass;          /* (fine nodes) as gravity has it [kg] */
    double support;        /* stiffness that keeps corners of grounded cubes that move nothing in place [N/m] */
    uint8_t *reach;        /* (fine nodes x 6) lowest and highest coarse cell of the tetrahedra around, by axis */
    lod_corrector *correctors; /* (count) */
} lod_builder;

/* lattice cells within k of a cube, by axis, inclusive */
void lod_patch(const lod_builder *lod, int32_t cube, int32_t low[3], int32_t high[3]);
/* the cubes there, in the order of the lattice; how many */
enum { PLIANT_MAX_NEAR = (2 * PLIANT_MAX_LAYERS + 1) * (2 * PLIANT_MAX_LAYERS + 1) * (2 * PLIANT_MAX_LAYERS + 1) };
int lod_near(const lod_builder *lod, int32_t cube, int32_t near[PLIANT_MAX_NEAR]);
/* P of a fine node: nodes and weights; how many */
enum { LOD_LEANS = 8 };
int lod_interpolation(const lod_builder *lod, int32_t fine_node, int32_t nodes[LOD_LEANS], double weights[LOD_LEANS]);
/* Nodes and stiffness at rest of a fine element; how many nodes */
int lod_element(const lod_builder *lod, int32_t element, const int32_t **nodes, double stiffness[PLIANT_ELEMENT_UNKNOWNS * PLIANT_ELEMENT_UNKNOWNS]);
/* corner of the cube that a node is, or -1 */
int lod_corner(const lod_builder *lod, int32_t cube, int32_t node);

typedef struct lod_room { /* of one thread; all -1 between two cubes */
    int32_t *local;  /* (fine nodes) place in what is looked at */
    int32_t *slot;   /* (coarse nodes x 2) the same of coarse ones */
} lod_room;
pliant_status lod_room_create(const lod_builder *lod, lod_room *out);
void lod_room_free(lod_room *room);

/* cells, their elements and own nodes, which are grounded; room for the rest. Errors: MEMORY. */
pliant_status lod_list_cubes(lod_builder *lod);
/* mass and reach of the fine nodes. Errors: MEMORY. */
pliant_status lod_measure_fine(lod_builder *lod);

#ifdef __cplusplus
}
#endif

#endif
