/* Coarse cubes and their part of the fine mesh: input of the correctors and macro-elements of lod (lod.h). */
#ifndef PLIANT_FEM_COARSE_LOD_CUBES_H
#define PLIANT_FEM_COARSE_LOD_CUBES_H

#include "fem/system.h"

/* Corrector of one cube. Values are zero on all other nodes. */
typedef struct lod_corrector {
    int32_t count;
    int32_t *node;  /* (count) fine nodes, ascending */
    float *value;   /* (count x 3 x 24) by corner of the cube (bit d: along axis d); zero for missing corners */
} lod_corrector;

typedef struct lod_builder {
    /* Under construction; it has mesh, fine, num_threads, and upsample: P. */
    pliant_system *system;
    const uint8_t *fine_fixed, *coarse_fixed;
    const pliant_tet_material *material; /* (fine tetrahedra) */
    int32_t layers, ratio;
    /* Cubes with tissue, in the order of the lattice. */
    int32_t count;
    int32_t *cell;         /* (count) */
    int32_t *cube_of_cell; /* (coarse cells) or -1 */
    int32_t *element_start, *elements; /* (count + 1): fine elements in each cube */
    int32_t *own;          /* (count x 8) nodes of its coarse tetrahedra, by corner, or -1 */
    uint8_t *grounded;     /* (count) */
    /* (count) size of the corrector's problem: number of free fine nodes, and of constrained coarse nodes. */
    int32_t *patch_nodes, *patch_means;
    /* The fine mesh. */
    pliant_system whole;   /* elements, free nodes and pattern of the fine mesh */
    pliant_tangent *at_rest; /* (whole.num_blocks) */
    /* Nullable: (elements of whole) volume times the bulk modulus that `whole` leaves out [N m] (lod.h). */
    double *bulk;
    double *values;        /* matrix of `whole` at rest, by whole.pattern */
    double *mass;          /* (fine nodes) [kg] */
    /* Stiffness that holds the corners of grounded cubes that move no tissue [N/m]. */
    double support;
    uint8_t *reach;        /* (fine nodes x 6) lowest and highest coarse cell of adjacent tetrahedra, by axis */
    lod_corrector *correctors; /* (count) */
} lod_builder;

/* Return the range of lattice cells within k of a cube, by axis, inclusive. */
void lod_patch(const lod_builder *lod, int32_t cube, int32_t low[3], int32_t high[3]);
/* List the cubes in this range, in the order of the lattice, and return their number. */
enum { PLIANT_MAX_NEAR = (2 * PLIANT_MAX_LAYERS + 1) * (2 * PLIANT_MAX_LAYERS + 1) * (2 * PLIANT_MAX_LAYERS + 1) };
int lod_near(const lod_builder *lod, int32_t cube, int32_t near[PLIANT_MAX_NEAR]);
/* Compute P of a fine node: nodes and weights. Return their number. */
enum { LOD_MAX_WEIGHTS = 8 };
int lod_interpolation(const lod_builder *lod, int32_t fine_node, int32_t nodes[LOD_MAX_WEIGHTS],
                      double weights[LOD_MAX_WEIGHTS]);
/* Return the number of nodes of a fine element, its nodes, and its stiffness at rest. */
int lod_element(const lod_builder *lod, int32_t element, const int32_t **nodes,
                double stiffness[PLIANT_ELEMENT_UNKNOWNS * PLIANT_ELEMENT_UNKNOWNS]);
/* Return the corner of the cube at which a node is, or -1. */
int lod_corner(const lod_builder *lod, int32_t cube, int32_t node);

typedef struct lod_buffers { /* Work arrays of one thread; all entries are -1 between two cubes. */
    int32_t *local;  /* (fine nodes) index in the current problem, or -1 */
    int32_t *slot;   /* (coarse nodes x 2) the same for coarse nodes */
} lod_buffers;
pliant_status lod_buffers_create(const lod_builder *lod, lod_buffers *out);
void lod_buffers_free(lod_buffers *buffers);

/* List the cubes, their elements, corner nodes and grounded flags, and allocate the other arrays. Errors: MEMORY. */
pliant_status lod_list_cubes(lod_builder *lod);
/* Compute mass and reach of the fine nodes. Errors: MEMORY. */
pliant_status lod_measure_fine(lod_builder *lod);

#endif
