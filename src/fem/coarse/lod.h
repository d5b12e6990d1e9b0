/* Localized orthogonal decomposition with correctors a cube (NUMERICS 4), what is computed beforehand.
 *
 * P: linear interpolation of the coarse nodes. For each coarse cube C and the 24 columns of its nodes, the corrector
 *     Q_C = argmin  a(Q, Q) / 2 - a_C(P, Q)
 * over fields that are zero on fixed fine nodes and outside of the cubes within k of C, and whose weighted means
 * sum_i m_i lambda_j(x_i) Q_i vanish for every free coarse node j (m_i: mass of the fine node, so that gravity does no work on
 * them). Then N = P - sum of Q_C, and a cube's macro-element is K = (N|_C)' K_C (N|_C) on the nodes of the cubes within k.
 *
 * A cube with a fixed fine node that leans on a free coarse one is grounded: its P is zero on fixed nodes, so that N is, and it
 * keeps R = I (NUMERICS 7.1). Other cubes feel its corrector by how far its nodes have moved from rest. */
#ifndef PLIANT_FEM_COARSE_LOD_H
#define PLIANT_FEM_COARSE_LOD_H

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
    int32_t *tet_start, *tets; /* (count + 1): fine tetrahedra of each */
    int32_t *own;          /* (count x 8) nodes of its coarse tetrahedra, by corner, or -1 */
    uint8_t *grounded;     /* (count) */
    int32_t *patch_nodes, *patch_means; /* (count) size of the corrector's problem: free fine nodes, constrained coarse ones */
    /* the fine mesh */
    pliant_system whole;   /* its free nodes, pattern; elements only while that is assembled */
    double *values;        /* its matrix at rest, by whole.pattern */
    double *mass;          /* (fine nodes) a fourth of the tetrahedra around [kg] */
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
int lod_interpolation(const lod_builder *lod, int32_t fine_node, int32_t nodes[4], double weights[4]);
/* corner of the cube that a node is, or -1 */
int lod_corner(const lod_builder *lod, int32_t cube, int32_t node);

typedef struct lod_room { /* of one thread; all -1 between two cubes */
    int32_t *local;  /* (fine nodes) place in what is looked at */
    int32_t *slot;   /* (coarse nodes x 2) the same of coarse ones */
} lod_room;
pliant_status lod_room_create(const lod_builder *lod, lod_room *out);
void lod_room_free(lod_room *room);

/* ---- lod_corrector.c */
/* patch_nodes and patch_means of a cube. Errors: MEMORY. */
pliant_status lod_size(lod_builder *lod, lod_room *room, int32_t cube);
/* Its corrector. Errors: MEMORY, NUMERIC. */
pliant_status lod_correct(lod_builder *lod, lod_room *room, int32_t cube);

/* ---- lod_macro.c */
/* system->macros with corners, frames and the fine nodes that follow each. Errors: MEMORY. */
pliant_status lod_macros_create(lod_builder *lod);
/* The matrix of a cube, and how its fine nodes follow. Errors: MEMORY. */
pliant_status lod_macro(lod_builder *lod, lod_room *room, int32_t cube);

/* ---- lod.c */
/* system->upsample (P), and system->grounded by the tetrahedra of the coarse mesh. Errors: MEMORY. */
pliant_status pliant_lod_ground(pliant_system *system, const uint8_t *fine_fixed, const uint8_t *coarse_fixed,
                                const int32_t *coarse_of_fine);
/* After that: system->macros. Errors: SCENE (beyond the scene's limits), MEMORY, NUMERIC, CANCELLED. */
pliant_status pliant_lod(pliant_system *system, const pliant_scene *scene, const uint8_t *fine_fixed, const uint8_t *coarse_fixed,
                         const pliant_tet_material *material, pliant_progress progress);

#ifdef __cplusplus
}
#endif

#endif
