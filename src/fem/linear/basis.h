/* The reduced basis of a patch's solution, on the fine mesh around the tools' footprints. Displacements u are relative
 * to the coarse model's fine node positions:
 * - own nodes: nodes within the patch's radius of a footprint; they move freely.
 * - modes: a few displacement fields of all nodes; they are the response of the fine mesh to forces on the footprints
 *   (response.h).
 *
 * u = a + E q, where a lives on the own nodes. By the Galerkin method, only the projections of the forces on the basis
 * count. Elements within twice the radius are corotational (the near part, a separate mesh). Beyond, the body is
 * linear, with the reduced stiffness A = E' K_far E. E is orthonormal on the near part's nodes that are no own nodes.
 * There a is zero, so q = M'u, where M equals E on those rows and is zero elsewhere. The far part exerts the force M A
 * q.
 *
 * The preconditioner is the inverse in this basis. With own rows p,
 *     K_pp a + Q_p q = r_p,   Q_p' a + E'Q q = E'r,   Q = (K_near + M A M') E
 * is solved by a factor of K_pp and the Schur complement on q. This reduction belongs to K_near at one state. It is
 * refreshed like any other factor (refresh.c). */
#ifndef PLIANT_FEM_LINEAR_BASIS_H
#define PLIANT_FEM_LINEAR_BASIS_H

#include "fem/linear/response.h"

#ifdef __cplusplus
extern "C" {
#endif

struct pliant_basis {
    /* The near part. Its rest positions are the coarse model's present fine node positions, so displacements are
     * relative to them. */
    pliant_mesh mesh;
    pliant_system system;     /* of the near part; owns this basis's preconditioner */
    int32_t *fine_node;       /* (mesh.num_nodes) */
    int32_t *near_node;       /* (fine nodes) or -1 */
    int32_t num_own;
    int32_t *own;             /* (num_own) unknowns of the system */
    pliant_system inner;      /* the near elements with the own nodes as unknowns */
    pliant_factor *analyzed;  /* symbolic factor of K_pp; NULL: no own nodes */
    int32_t num_modes;
    double *modes;            /* E: (num_modes x 3 system.num_free) */
    double *outer;            /* M: the same, own rows zero */
    double *whole;            /* E on the fine mesh: (num_modes x 3 fine free nodes) */
    double *far;              /* A: (num_modes x num_modes) [N/m] */
    double *amplitude;        /* (num_modes) work array */
};

/* Values of the reduction at one state. Only one thread at a time may use them. */
typedef struct pliant_reduction {
    pliant_factor *factor;    /* of K_pp */
    double *values;           /* (inner.pattern.num_values) work array */
    double *image;            /* Q: (num_modes x 3 system.num_free) work array */
    double *answers;          /* K_pp^-1 Q_p: (num_modes x 3 num_own) */
    double *schur;            /* (num_modes x num_modes) Cholesky factor */
    double *amplitude, *part; /* (num_modes), (3 num_own) work arrays */
} pliant_reduction;

/* The footprint of a tool: the nodes that it holds or presses. */
typedef struct pliant_footprint {
    int32_t count;
    int32_t *nodes;           /* (count) fine nodes */
    double *weights;          /* (count) sum 1 */
    double centre[3];         /* at rest */
} pliant_footprint;

/* Create a basis around the footprints. Errors: MEMORY, NUMERIC, SCENE (no node around the footprints can move),
 * CANCELLED.
 * @param fine        System of the fine mesh.
 * @param linearized  Around the state at which the stiffness is taken.
 * @param fixed       (fine nodes).
 * @param radius      Radius of the patch at rest [m].
 * @param blocks      (num_blocks) blocks of nine modes (9 x 3 fine free nodes), response.h.
 * @param num_threads Threads of the steps. */
pliant_status pliant_basis_create(const pliant_system *fine, pliant_linearized *linearized, const uint8_t *fixed,
                                  double radius, int32_t num_footprints, const pliant_footprint *footprints,
                                  int32_t num_blocks, const double *const *blocks, int num_threads, pliant_basis **out);
void pliant_basis_free(pliant_basis *basis); /* Nullable */

/* Size of a basis, known before it is created. */
typedef struct pliant_basis_size {
    /* Free fine nodes within the radius of a footprint, and within twice the radius. */
    int32_t own, near;
    int32_t blocks;           /* blocks of nine modes */
} pliant_basis_size;
pliant_basis_size pliant_basis_measure(const pliant_system *fine, double radius, int32_t num_footprints,
                                       const pliant_footprint *footprints, int32_t num_blocks);
/* Return the floating-point operations of creating a basis with its first reduction, and the bytes of its fields and
 * factors. */
double pliant_basis_operations(const pliant_system *fine, pliant_basis_size size);
double pliant_basis_bytes(const pliant_system *fine, pliant_basis_size size);

/* Create a reduction without values, or with a copy of another's values. Errors: MEMORY. */
pliant_status pliant_reduction_create(const pliant_basis *basis, const pliant_reduction *from, pliant_reduction **out);
void pliant_reduction_free(pliant_reduction *reduction); /* Nullable */
/* Compute the reduction at these tangents of the near elements. Errors: NUMERIC, MEMORY; the previous values are lost
 * then. */
pliant_status pliant_reduction_numeric(const pliant_basis *basis, const pliant_tangent *tangents,
                                       pliant_reduction *reduction);
double pliant_reduction_operations(const pliant_basis *basis); /* of pliant_reduction_numeric */
/* Return the operations of multiplying one vector by all element stiffnesses. */
double pliant_reduction_element_operations(const pliant_system *system);
/* Compute out = (stiffness in the basis)^-1 right, (3 system.num_free). Both may be the same array. Errors: MEMORY. */
pliant_status pliant_reduction_solve(const pliant_basis *basis, pliant_reduction *reduction, const double *right,
                                     double *out);
/* Add the forces of the far part. x: (3 mesh.num_nodes); forces: (3 system.num_free) [N]. */
void pliant_basis_far_forces(pliant_basis *basis, const double *x, double *forces);
/* Project positions x (3 mesh.num_nodes) onto the basis: u = a + E q. */
void pliant_basis_project(pliant_basis *basis, double *x);
/* Compute fine positions: base (3 fine nodes) plus the displacement of x. `base` and `out` may be the same array. */
void pliant_basis_positions(pliant_basis *basis, const pliant_system *fine, const double *base, const double *x,
                            double *out);

#ifdef __cplusplus
}
#endif

#endif
