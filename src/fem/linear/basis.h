/* A reduced basis: where a patch's solution is looked for, on the fine mesh around what tools hold, relative to where
 * the coarse model has it:
 *
 *   own      nodes within the patch's radius of a tool's hold: they move freely;
 *   modes    all nodes: a few fields that are the fine mesh's answer to forces on the holds (response.h).
 *
 * u = a + E q, a on the patch's own nodes. Galerkin: only the projections of the forces on these count. Elements within
 * twice the radius are corotational (the near part, a mesh of its own); beyond, the body answers linearly, by the
 * reduced stiffness A = E' K_far E. E is orthonormal on the near part's nodes that are not the patch's own: there a is
 * zero, so that q = M'u with M = E on those rows and zero elsewhere, and what lies beyond pulls with M A q.
 *
 * What stands for the inverse stiffness is that of the basis: with own rows p,
 *     K_pp a + Q_p q = r_p,   Q_p' a + E'Q q = E'r,   Q = (K_near + M A M') E
 * by a factor of K_pp and the Schur complement on q: the reduction, of K_near at one state, made anew as any factor is
 * (refresh.c). */
#ifndef PLIANT_FEM_LINEAR_BASIS_H
#define PLIANT_FEM_LINEAR_BASIS_H

#include "fem/linear/response.h"

#ifdef __cplusplus
extern "C" {
#endif

struct pliant_basis {
    pliant_mesh mesh;         /* the near part; rest is where the coarse model has the nodes now: displacements count from there */
    pliant_system system;     /* of it; its preconditioner is this basis's */
    int32_t *fine_node;       /* (mesh.num_nodes) */
    int32_t *near_node;       /* (fine nodes) or -1 */
    int32_t num_own;
    int32_t *own;             /* (num_own) unknowns of the system */
    pliant_system inner;      /* the near elements with the own nodes as unknowns */
    pliant_factor *analyzed;  /* of K_pp, symbolic; NULL: no own nodes */
    int32_t num_modes;
    double *modes;            /* E: (num_modes x 3 system.num_free) */
    double *outer;            /* M: the same, own rows zero */
    double *whole;            /* E on the fine mesh: (num_modes x 3 fine free nodes) */
    double *far;              /* A: (num_modes x num_modes) [N/m] */
    double *amplitude;        /* (num_modes) room */
};

/* The numbers of one state. Used by one thread at a time. */
typedef struct pliant_reduction {
    pliant_factor *factor;    /* of K_pp */
    double *values;           /* (inner.pattern.num_values) room */
    double *image;            /* Q: (num_modes x 3 system.num_free) room */
    double *answers;          /* K_pp^-1 Q_p: (num_modes x 3 num_own) */
    double *schur;            /* (num_modes x num_modes) Cholesky factor */
    double *amplitude, *part; /* (num_modes), (3 num_own) room */
} pliant_reduction;

/* Where tools hold. */
typedef struct pliant_foothold {
    int32_t count;
    int32_t *nodes;           /* (count) fine nodes */
    double *weights;          /* (count) sum 1 */
    double centre[3];         /* at rest */
} pliant_foothold;

/* Errors: MEMORY, NUMERIC, SCENE (nothing around the holds can move), CANCELLED.
 * @param fine        the system of the fine mesh
 * @param linearized  around the state that the stiffness is taken at
 * @param fixed       (fine nodes)
 * @param radius      of the patch, at rest [m]
 * @param blocks      (num_blocks) of nine modes (9 x 3 fine free nodes), response.h
 * @param num_threads of steps */
pliant_status pliant_basis_create(const pliant_system *fine, pliant_linearized *linearized, const uint8_t *fixed, double radius, int32_t num_footholds, const pliant_foothold *footholds,
                                  int32_t num_blocks, const double *const *blocks, int num_threads, pliant_basis **out);
void pliant_basis_free(pliant_basis *basis); /* Nullable */

/* What one takes, before it is made. */
typedef struct pliant_basis_size {
    int32_t own, near;        /* free fine nodes within the radius of a hold, and within twice of it */
    int32_t blocks;           /* of nine modes */
} pliant_basis_size;
pliant_basis_size pliant_basis_measure(const pliant_system *fine, double radius, int32_t num_footholds, const pliant_foothold *footholds,
                                       int32_t num_blocks);
/* Floating-point operations of making it, with its first numbers; bytes of its fields on the fine mesh and of its
 * factors. */
double pliant_basis_operations(const pliant_system *fine, pliant_basis_size size);
double pliant_basis_bytes(const pliant_system *fine, pliant_basis_size size);

/* Without numbers, or with those of another. Errors: MEMORY. */
pliant_status pliant_reduction_create(const pliant_basis *basis, const pliant_reduction *from, pliant_reduction **out);
void pliant_reduction_free(pliant_reduction *reduction); /* Nullable */
/* At these tangents of the near elements. Errors: NUMERIC, MEMORY; the old numbers are gone then. */
pliant_status pliant_reduction_numeric(const pliant_basis *basis, const pliant_tangent *tangents, pliant_reduction *reduction);
double pliant_reduction_operations(const pliant_basis *basis); /* of that */
double pliant_reduction_element_operations(const pliant_system *system); /* of products of one vector with all elements */
/* out = (the basis's stiffness)^-1 right, (3 system.num_free); may be the same. Errors: MEMORY. */
pliant_status pliant_reduction_solve(const pliant_basis *basis, pliant_reduction *reduction, const double *right, double *out);
/* Add what lies beyond: x (3 mesh.num_nodes), forces (3 system.num_free) [N]. */
void pliant_basis_far_forces(pliant_basis *basis, const double *x, double *forces);
/* Positions x (3 mesh.num_nodes) become the nearest ones within the basis: u = a + E q. */
void pliant_basis_project(pliant_basis *basis, double *x);
/* Fine positions: base (3 fine nodes) and the displacement that x stands for. base and out may be the same. */
void pliant_basis_positions(pliant_basis *basis, const pliant_system *fine, const double *base, const double *x, double *out);

#ifdef __cplusplus
}
#endif

#endif
